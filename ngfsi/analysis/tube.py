"""Tube law of a stored run, and the run again in one dimension with that law."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ngfsi.analysis.tube_law import LAWS, Fit, TubeLaw, fit
from ngfsi.analysis.vein_1d import CELLS, CollapsibleVein, Solution
from ngfsi.arrays import Array
from ngfsi.errors import OutputError
from ngfsi.store.stored import StoredRun

Against = Literal["skin", "tissue"]
"""What is taken for the external pressure: that on the skin, or the tissue's normal traction on the wall."""


def externals(run: StoredRun) -> tuple[Against, ...]:
    """Return what the external pressure of a vessel can be: with cuffs none on the skin is that of the whole vessel."""
    skin: tuple[Against, ...] = ("skin",) if "skin_pressure_Pa" in run.series and not run.case.loads.cuffs else ()
    return (*skin, "tissue") if "p_transmural_z00_Pa" in run.series else skin


def transmural(run: StoredRun, against: Against) -> Array:
    """Return the transmural pressure (Pa) at each station over time, (times, stations).

    Raises:
        OutputError: that was not measured, or cuffs are on the skin instead of one pressure.
    """
    if against == "tissue":
        return run.along("p_transmural", "Pa")
    if run.case.loads.cuffs:
        raise OutputError(
            f"the run in '{run.path}' has cuffs on its skin, not one pressure: its transmural pressure is known "
            "against the tissue only"
        )
    if "skin_pressure_Pa" not in run.series:
        raise OutputError(f"the run in '{run.path}' has no pressure on a skin")
    return run.along("p_blood", "Pa") - run.series["skin_pressure_Pa"][:, None]


def tube_laws(run: StoredRun, against: Against = "skin") -> Mapping[str, list[Fit]]:
    """Return each law of `LAWS` fitted at each station over the times of a run, the best law first.

    Raises:
        OutputError: as of `transmural`, or the vessel has a rigid wall or branches.
        SolverError: a law does not fit, e.g. since the transmural pressure or the area hardly changes.
    """
    if run.own_vessel.further:
        raise OutputError(
            f"the vessel in '{run.path}' is branched: tube laws are of vessels with one inlet and one outlet"
        )
    if run.own_vessel.wall is None:
        raise OutputError(f"the run in '{run.path}' has a rigid wall: its area follows no tube law")
    pressure, area = transmural(run, against), run.along("area", "m2")
    fits = {name: [fit(name, p, a) for p, a in zip(pressure.T, area.T, strict=True)] for name in LAWS}
    return dict(sorted(fits.items(), key=lambda item: overall_error(item[1])))


def overall_error(fits: list[Fit]) -> float:
    """Return the root mean square of the relative gaps of area at all stations."""
    return float(np.sqrt(np.mean([one.error**2 for one in fits])))


@dataclass(frozen=True)
class Gap:
    """How far one dimension is from three, over the mean of three: of the means over time, and root mean square."""

    mean: float
    rms: float


@dataclass(frozen=True)
class Comparison:
    """A run in one dimension beside that in three, at the times of its series.

    Attributes:
        fits: of the law at each station, against the pressure on the skin.
        one, three: by quantity: area (m2), flow (at the outlet, m3/s), SAWSS (Pa).
    """

    fits: list[Fit]
    solution: Solution
    one: Mapping[str, Array]
    three: Mapping[str, Array]
    gaps: Mapping[str, Gap]


def in_one_dimension(run: StoredRun) -> Comparison:
    """Compute a vessel in one dimension, with the law that fits best against the pressure on the skin.

    Raises:
        OutputError: as of `tube_laws`, or the run has a given pressure at its inlet.
        SolverError: as of `tube_laws`, or the vein chokes or collapses.
    """
    if run.case.loads.inlet_pressure is not None:
        raise OutputError(f"the run in '{run.path}' has a given inlet pressure: one dimension takes a given inlet flow")
    fits = next(iter(tube_laws(run).values()))
    places, stations = (np.arange(CELLS) + 0.5) / CELLS, np.linspace(0, 1, len(fits))
    area, stiffness = (
        np.interp(places, stations, [getattr(one.law, name) for one in fits]) for name in ("area", "stiffness")
    )
    case, series = run.case, run.series
    loads, blood = case.loads, case.materials.fluid
    assert blood is not None  # a tube law is of a vein with blood
    vein = CollapsibleVein(
        law=TubeLaw(fits[0].law.name, area, stiffness),
        length=run.own_vessel.course.length,
        density=blood.density,
        viscosity=blood.developed_viscosity,
        inflow=(lambda time: float(np.interp(time, series["time_s"], series["flow_in_m3_s"])))
        if run.vessel
        else loads.inlet_flow,
        outlet_pressure=loads.outlet_pressure,
        external_pressure=loads.skin_pressure,
    )
    solution = vein.solve(series["time_s"])
    one = {"area": solution.mean_area, "flow": solution.flow[:, -1], "SAWSS": solution.sawss}
    columns = {"area": "lumen_area_mean_m2", "flow": "flow_out_m3_s", "SAWSS": "sawss_Pa"}
    three = {name: series[column] for name, column in columns.items()}
    gaps = {name: _gap(series["time_s"], one[name], three[name]) for name in one}
    return Comparison(fits, solution, one, three, gaps)


def _gap(times: Array, one: Array, three: Array) -> Gap:
    span = times[-1] - times[0]
    means = (np.trapezoid(values, times) / span for values in (one, three, (one - three) ** 2))
    mean_one, mean, squares = map(float, means)
    return Gap(mean_one / mean - 1, float(np.sqrt(squares)) / mean)
