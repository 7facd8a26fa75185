"""What the runs of compare_tissues.py say: losses, shear stress and pressure at the moments the source speaks of."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ngfsi.analysis.decomposition import STAGES, decompose
from ngfsi.analysis.tube import transmural
from ngfsi.analysis.tube_law import fit
from ngfsi.errors import SolverError
from ngfsi.store.stored import StoredRun
from ngfsi.study import Outcome
from ngfsi.system import schemes
from ngfsi.units import SAME_TIME, from_si

Array = NDArray[np.float64]
Row = dict[str, Any]
"""Numbers, words, and "" where there is none, as in a CSV file."""

ACCURACY = Path(__file__).with_name("accuracy.toml")
HYDROSTATIC = ("tissue_side", "wall_side", "wall_mean")
SWING = 0.4
"""Time (s) before the end of the ramp over which SAWSS is averaged: some periods of the vein's oscillation."""


@dataclass(frozen=True)
class Moment:
    """A run at one time, held against its state at t = 0 (ratios) and against the unloaded shape.

    Attributes:
        time: s
        skin_pressure: mean over the skin, Pa
        loss: fraction of the lumen's volume lost since t = 0.
        loss_unloaded: fraction lost of the volume of the shape without any load.
        sawss: wall shear stress, mean over the wall [Pa].
        sawss_ratio: SAWSS over that at t = 0.
        parts: SAWSS [Pa] by cause (see ngfsi/analysis/decomposition.py).
        pressures: hydrostatic pressure [Pa] by where it is read: tissue_side, wall_side, wall_mean.
    """

    time: float
    skin_pressure: float
    loss: float
    loss_unloaded: float
    sawss: float
    sawss_ratio: float
    parts: dict[str, float]
    pressures: dict[str, float]

    @property
    def rise(self) -> float:
        """Rise of SAWSS since t = 0 in percent."""
        return 100 * (self.sawss_ratio - 1)

    @property
    def skin_mmhg(self) -> float:
        """Pressure on the skin in mmHg."""
        return from_si(self.skin_pressure, "mmHg")


@dataclass(frozen=True)
class Finding:
    """One run: its title, the moments, and why it ended early if it did."""

    title: str
    run: StoredRun
    start_sawss: float
    inflation: float
    """Volume at t = 0 over the volume without any load, minus one."""
    mean_rise: float
    """Rise of SAWSS since t = 0 in percent, mean over the last `SWING` before `ramp_end`."""
    period: float | None
    """Period (s) of the oscillation of the outflow during the ramp, if the steps resolve it."""
    ramp_end: Moment
    """When the skin pressure is reached, or where the run ended before."""
    end: Moment
    failure: str
    pattern: Pattern | None = None
    """At `ramp_end`, if fields are stored then."""

    @property
    def held(self) -> bool:
        """Whether the run goes on after the ramp."""
        return self.end.time > self.ramp_end.time + SAME_TIME


def find(title: str, outcome: Outcome) -> Finding | None:
    """Return what a run says; None when it has not even a state at t = 0."""
    run = outcome.run
    if run is None or not len(run.series.get("time_s", ())):
        return None
    times = run.series["time_s"]
    row = run.loaded_row
    first, unloaded = run.series["lumen_volume_m3"][0], run.manifest["reference"]["lumen_volume_m3"]
    return Finding(
        title=title,
        run=run,
        start_sawss=float(run.series["sawss_Pa"][0]),
        inflation=float(first / unloaded - 1),
        mean_rise=100 * (mean_sawss(run, float(times[row])) / float(run.series["sawss_Pa"][0]) - 1),
        period=_period(times[: row + 1], run.series["flow_out_m3_s"][: row + 1], _stages(run)),
        ramp_end=_moment(run, row),
        end=_moment(run, len(times) - 1),
        failure=outcome.failure,
        pattern=pattern(run, float(times[row])) if _has_fields(run, float(times[row])) else None,
    )


def _has_fields(run: StoredRun, time: float) -> bool:
    return any(abs(stored - time) < SAME_TIME for stored in run.field_times())


def mean_sawss(run: StoredRun, end: float) -> float:
    """Return SAWSS (Pa), mean over the last `SWING` before `end`, weighted so that oscillations drop out (Hann)."""
    times = np.linspace(max(end - SWING, 0.0), end, 2001)
    weights = 1 - np.cos(np.linspace(0, 2 * np.pi, len(times)))
    return float(np.average(np.interp(times, run.series["time_s"], run.series["sawss_Pa"]), weights=weights))


def _period(times: Array, flows: Array, stages: int = 1) -> float | None:
    """Return the mean distance of the flow's maxima, if there are four or more, each eight stages and three steps from
    the next."""
    inside = flows[1:-1]
    maxima = times[1:-1][(inside > flows[:-2]) & (inside >= flows[2:])]
    if len(maxima) < 4 or np.min(np.diff(maxima)) < (max(8 / stages, 3) - SAME_TIME) * np.min(np.diff(times)):
        return None
    return float(np.mean(np.diff(maxima)))


def _stages(run: StoredRun) -> int:
    """Return how often a step of a run is solved."""
    tableaus = schemes.STAGES.get(run.case.time.scheme)
    return len(tableaus[0].rows) - tableaus[0].explicit if tableaus else 1


def _moment(run: StoredRun, row: int) -> Moment:
    series = run.series
    volume, sawss = series["lumen_volume_m3"], series["sawss_Pa"]
    left = volume[row] / volume[0]
    return Moment(
        time=float(series["time_s"][row]),
        skin_pressure=0.0 if run.skin_pressure is None else float(run.skin_pressure[row]),
        loss=float(1 - left),
        loss_unloaded=float(1 - volume[row] / run.manifest["reference"]["lumen_volume_m3"]),
        sawss=float(sawss[row]),
        sawss_ratio=float(sawss[row] / sawss[0]),
        parts={cause: float(values[row]) for cause, values in decompose(series).items()},
        pressures={where: float(series[f"p_{where}_Pa"][row]) for where in HYDROSTATIC},
    )


@dataclass(frozen=True)
class Pattern:
    """Where the tissue moves and the blood shears, which the source tells in words; names are those of columns.

    Attributes:
        displacement_m: largest of the tissue.
        direction_rad: of its place around the axis of the segment, 0 lateral, -pi/2 posterior.
        between_bones_1: displacement of the tissue midway between the bones, at half length, over the largest.
        shear_distal_1, shear_proximal_1: wall shear stress around the stations of the third of the vein at its inlet
            and of that at its outlet, over the mean of all stations.
        shear_variation_1: standard deviation of the wall shear stress over the stations, over its mean.
        circularity_1: the smallest of all stations, 1 for a circle.
    """

    displacement_m: float
    direction_rad: float
    between_bones_1: float
    shear_distal_1: float
    shear_proximal_1: float
    shear_variation_1: float
    circularity_1: float


def pattern(run: StoredRun, time: float) -> Pattern:
    """Return the pattern of a calf at a time (s) at which its fields are stored."""
    grid = run.fields(time)
    regions = [str(name) for name in grid.field_data["regions"]]
    tissue = grid.extract_cells(np.flatnonzero(grid.cell_data["region"] == regions.index("tissue")))
    moved = tissue.point_data["displacement_m"]
    place, size = tissue.points - moved, np.linalg.norm(moved, axis=1)
    farthest = int(np.argmax(size))
    calf = run.case.geometry
    middle = ((calf.tibia_x + calf.fibula_x) / 2, (calf.tibia_y + calf.fibula_y) / 2, calf.length / 2)
    between = int(np.argmin(np.linalg.norm(place - middle, axis=1)))
    row = int(np.argmin(abs(run.series["time_s"] - time)))
    shear = run.along("wss", "Pa")[row]
    third = len(shear) // 3
    shape = run.shape
    return Pattern(
        displacement_m=float(size[farthest]),
        direction_rad=float(np.arctan2(place[farthest, 1], place[farthest, 0])),
        between_bones_1=float(size[between] / size[farthest]),
        shear_distal_1=float(shear[:third].mean() / shear.mean()),
        shear_proximal_1=float(shear[-third:].mean() / shear.mean()),
        shear_variation_1=float(shear.std() / shear.mean()),
        circularity_1=float(shape["circularity_1"][abs(shape["time_s"] - run.series["time_s"][row]) < SAME_TIME].min()),
    )


def tube_stiffness(run: StoredRun) -> float | None:
    """Return K (Pa) of the linear tube law p - p_skin = K (A/A0 - 1) at mid-length; None where it does not fit."""
    middle = run.along("area", "m2").shape[1] // 2
    try:
        found = fit("linear", transmural(run, "skin")[:, middle], run.along("area", "m2")[:, middle])
    except SolverError:
        return None
    return float(found.law.stiffness)


def stored_row(key: str, finding: Finding) -> Row:
    """Return the numbers of a run as they are stored beside the report, from which its tables are made."""
    now, end, law = finding.ramp_end, finding.end, finding.run.case.materials.law_of("tissue")
    return {
        "run": key,
        "title": finding.title,
        "unknowns": finding.run.manifest["unknowns"],
        "step_s": finding.run.case.time.step,
        "lumen_diameter_m": finding.run.case.geometry.lumen_diameter,
        "shear_modulus_Pa": law.shear_modulus or 0.0,
        "bulk_modulus_Pa": law.bulk_modulus or 0.0,
        "time_s": now.time,
        "skin_pressure_Pa": now.skin_pressure,
        "loss_1": now.loss,
        "loss_unloaded_1": now.loss_unloaded,
        "inflation_1": finding.inflation,
        "sawss_start_Pa": finding.start_sawss,
        "sawss_Pa": now.sawss,
        "sawss_consistent_Pa": float(finding.run.series["sawss_consistent_Pa"][finding.run.loaded_row]),
        "rise_percent": now.rise,
        "rise_mean_percent": finding.mean_rise,
        "rise_held_percent": end.rise if finding.held else "",
        "period_s": finding.period or "",
        "tube_stiffness_Pa": tube_stiffness(finding.run) or "",
        **{f"p_{where}_Pa": now.pressures[where] for where in HYDROSTATIC},
        **{f"{cause.replace(' ', '_')}_Pa": value for cause, value in now.parts.items() if cause in STAGES},
        **(asdict(finding.pattern) if finding.pattern else dict.fromkeys((one.name for one in fields(Pattern)), "")),
        "failure": finding.failure,
    }  # fmt: skip


def numerical_errors(level: str, path: Path = ACCURACY) -> Mapping[str, float]:
    """Return the errors measured for a level, e.g. `loss_percent`; empty when there are none."""
    if not path.exists():
        return {}
    found: Mapping[str, float] = tomllib.loads(path.read_text(encoding="utf-8")).get(level, {})
    return found
