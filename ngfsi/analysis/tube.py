"""Tube law of a stored run, and the run again in one dimension with that law."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ngfsi.analysis.tube_law import LAWS, Fit, TubeLaw, fit
from ngfsi.analysis.vein_1d import CELLS, CollapsibleVein, Solution
from ngfsi.errors import OutputError
from ngfsi.measure.sections import STATIONS
from ngfsi.store.stored import StoredRun

Array = NDArray[np.float64]
Against = Literal["skin", "tissue"]
"""What is taken for the external pressure: that on the skin, or the tissue's normal traction on the wall."""


def externals(run: StoredRun) -> tuple[Against, ...]:
    """Return what the external pressure of a run can be: with cuffs none on the skin is that of the whole vein."""
    return ("tissue",) if run.case.loads.cuffs else ("skin", "tissue")


def areas(run: StoredRun) -> Array:
    """Return the area (m2) of each station over time, (times, stations)."""
    return _stations(run, "area", "m2")


def transmural(run: StoredRun, against: Against) -> Array:
    """Return the transmural pressure (Pa) at each station over time, (times, stations).

    Raises:
        OutputError: the run was computed before that was measured, or has cuffs instead of one pressure on the skin.
    """
    if against not in externals(run):
        raise OutputError(
            f"the run in '{run.path}' has cuffs on its skin, not one pressure: its transmural pressure is known "
            "against the tissue only"
        )
    if against == "tissue":
        return _stations(run, "p_transmural", "Pa")
    return _stations(run, "p_blood", "Pa") - run.series["skin_pressure_Pa"][:, None]


def tube_laws(run: StoredRun, against: Against = "skin") -> Mapping[str, list[Fit]]:
    """Return each law of `LAWS` fitted at each station over the times of a run, the best law first.

    Raises:
        OutputError: as of `transmural`.
        SolverError: a law does not fit, e.g. since the transmural pressure or the area hardly changes.
    """
    pressure, area = transmural(run, against), areas(run)
    fits = {name: [fit(name, p, a) for p, a in zip(pressure.T, area.T, strict=True)] for name in LAWS}
    return dict(sorted(fits.items(), key=lambda item: overall_error(item[1])))


def overall_error(fits: list[Fit]) -> float:
    """Return the root mean square of the relative gaps of area at all stations."""
    return float(np.sqrt(np.mean([one.error**2 for one in fits])))


@dataclass(frozen=True)
class Gap:
    """How far one dimension is from three over time, relative to the mean of three.

    Attributes:
        mean: of the mean over time.
        rms: root mean square.
    """

    mean: float
    rms: float


@dataclass(frozen=True)
class Comparison:
    """A run in one dimension beside that in three, at the times of its series.

    Attributes:
        fits: of the law at each station, against the pressure on the skin.
        solution: in one dimension.
        one, three: by quantity: area (m2), flow (at the outlet, m3/s), SAWSS (Pa).
        gaps: by quantity.
    """

    fits: list[Fit]
    solution: Solution
    one: Mapping[str, Array]
    three: Mapping[str, Array]
    gaps: Mapping[str, Gap]


def in_one_dimension(run: StoredRun) -> Comparison:
    """Compute the loads of a run in one dimension, with the law that fits best against the pressure on the skin.

    Raises:
        OutputError: as of `tube_laws`, or the run has a given pressure at its inlet.
        SolverError: as of `tube_laws`, or the vein chokes or collapses.
    """
    if run.case.loads.inlet_pressure is not None:
        raise OutputError(f"the run in '{run.path}' has a given inlet pressure: one dimension takes a given inlet flow")
    fits = next(iter(tube_laws(run).values()))
    places, stations = (np.arange(CELLS) + 0.5) / CELLS, np.linspace(0, 1, STATIONS)
    area, stiffness = (
        np.interp(places, stations, [getattr(one.law, name) for one in fits]) for name in ("area", "stiffness")
    )
    case, series = run.case, run.series
    loads, blood = case.loads, case.materials.fluid
    assert blood is not None  # a run is of a vein with blood
    vein = CollapsibleVein(
        law=TubeLaw(fits[0].law.name, area, stiffness),
        length=case.geometry.length,
        density=blood.density,
        viscosity=blood.nominal_viscosity,
        inflow=loads.inlet_flow,
        outlet_pressure=loads.outlet_pressure,
        external_pressure=loads.skin_pressure,
    )
    found = vein.solve(series["time_s"])
    one = {"area": found.mean_area, "flow": found.flow[:, -1], "SAWSS": found.sawss}
    columns = {"area": "lumen_area_mean_m2", "flow": "flow_out_m3_s", "SAWSS": "sawss_Pa"}
    three = {name: series[column] for name, column in columns.items()}
    return Comparison(fits, found, one, three, {name: _gap(one[name], three[name]) for name in one})


def _gap(one: Array, three: Array) -> Gap:
    mean = float(np.mean(three))
    return Gap(float(np.mean(one)) / mean - 1, float(np.sqrt(np.mean((one - three) ** 2))) / mean)


def _stations(run: StoredRun, name: str, unit: str) -> Array:
    columns = [f"{name}_z{station:02d}_{unit}" for station in range(STATIONS)]
    if missing := [column for column in columns if column not in run.series]:
        raise OutputError(f"the run in '{run.path}' holds no {missing[0]}: compute it again")
    return np.column_stack([run.series[column] for column in columns])
