"""What the runs of compare_tissues.py say: losses, shear stress and pressure at the moments the source speaks of."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ngfsi.analysis.decomposition import decompose
from ngfsi.store.stored import StoredRun
from ngfsi.study import Outcome
from ngfsi.units import SAME_TIME, from_si

Array = NDArray[np.float64]

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
        period=_period(times[: row + 1], run.series["flow_out_m3_s"][: row + 1]),
        ramp_end=_moment(run, row),
        end=_moment(run, len(times) - 1),
        failure=outcome.failure,
    )


def mean_sawss(run: StoredRun, end: float) -> float:
    """Return SAWSS (Pa), mean over the last `SWING` before `end`, weighted so that oscillations drop out (Hann)."""
    times = np.linspace(max(end - SWING, 0.0), end, 2001)
    weights = 1 - np.cos(np.linspace(0, 2 * np.pi, len(times)))
    return float(np.average(np.interp(times, run.series["time_s"], run.series["sawss_Pa"]), weights=weights))


def _period(times: Array, flows: Array) -> float | None:
    """Return the mean distance of the flow's maxima, if there are four or more, each many steps from the next."""
    inside = flows[1:-1]
    maxima = times[1:-1][(inside > flows[:-2]) & (inside >= flows[2:])]
    if len(maxima) < 4 or np.min(np.diff(maxima)) < 8 * np.min(np.diff(times)):
        return None
    return float(np.mean(np.diff(maxima)))


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


def numerical_errors(level: str, path: Path = ACCURACY) -> Mapping[str, float]:
    """Return the errors measured for a level, e.g. `volume_percent`; empty when there are none."""
    if not path.exists():
        return {}
    found: Mapping[str, float] = tomllib.loads(path.read_text(encoding="utf-8")).get(level, {})
    return found
