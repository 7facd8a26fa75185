"""What does intermittent compression do to the blood of a deep vein: how fast, how much, from where?

The oval vein of `closing_vein` under devices as published: 40 to 120 mmHg, reached in 0.5 to 10 s, all around, in three
chambers of which the distal one begins, or from behind alone. A valve keeps the blood from flowing back, and upstream
are the veins of foot and lower calf, filled through the capillaries.
"""

from __future__ import annotations

from collections.abc import Callable
from math import pi
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ngfsi.case import Case, Cuff
from ngfsi.config.functions import PressureConstant, PressureRamp
from ngfsi.report.tables import markdown_table
from ngfsi.report.terminal import console
from ngfsi.store.stored import StoredRun
from ngfsi.store.table import write_rows
from ngfsi.study import run_cases, write_page
from ngfsi.transport.models import Washout
from ngfsi.units import MMHG, Shown, in_unit
from ngfsi_studies import closing_vein
from ngfsi_studies.figures import Line, lines

Array = NDArray[np.float64]

HOLD = 1.0
"""For which the full pressure is held (s)."""
CHAMBERS = 3
LAG = 0.5
"""Delay of each chamber behind the one distal of it, over the inflation of one."""
EDGE = 20e-3
"""Over which the pressure of a chamber falls off (m)."""
UPSTREAM = 1.1e-5 * 1.5e-3
"""Compliance of the veins upstream (m3/Pa): 1.1 % of the volume for each kPa (Phys Med Biol 22, 1977, 1146) of 1.5 l,
about that of foot and lower calf."""
BEFORE_VALVE = 0.1
"""Part of the resistance of capillaries and veins that lies between the valve and the veins upstream."""
LEAKAGE = 1e-3
"""Of the valve."""
WASHED_OUT = 0.5
"""Part of the blood that the vein held at rest whose time of washout is told."""


class Device(NamedTuple):
    """How a device presses: highest pressure (mmHg), time in which each chamber reaches it (s), delay of a chamber
    behind the one distal of it (in such times), and whether it presses from behind alone."""

    title: str
    pressure: float
    inflation: float
    lag: float = 0.0
    behind: bool = False

    @property
    def full(self) -> float:
        """Time at which all chambers are full (s)."""
        return self.inflation * (1 + self.lag * (CHAMBERS - 1))

    def chambers(self, length: float) -> tuple[Cuff, ...]:
        """Return the loads on a segment of a length (m)."""
        number = CHAMBERS if self.lag else 1
        half_width = pi / 2 if self.behind else None
        return tuple(
            Cuff(
                pressure=PressureRamp(
                    final=self.pressure * MMHG, start=k * self.lag * self.inflation, duration=self.inflation
                ),
                # the outer edges lie outside of the segment, so that its ends are pressed in full
                start=k * length / number - (EDGE / 2 if k == 0 else 0),
                end=(k + 1) * length / number + (EDGE / 2 if k == number - 1 else 0),
                edge=EDGE, direction=-pi / 2, half_width=half_width,
            )
            for k in range(number)
        )  # fmt: skip


DEVICES = {
    "uniform": Device("40 mmHg in 2 s", 40, 2.0),
    "rapid": Device("40 mmHg in 0.5 s", 40, 0.5),
    "slow": Device("40 mmHg in 10 s", 40, 10.0),
    "strong": Device("80 mmHg in 0.5 s", 80, 0.5),
    "strongest": Device("120 mmHg in 0.5 s", 120, 0.5),
    "sequential": Device("40 mmHg in 2 s, distal first", 40, 2.0, lag=LAG),
    "rapid_sequential": Device("40 mmHg in 0.5 s, distal first", 40, 0.5, lag=LAG),
    "behind": Device("40 mmHg in 2 s, from behind", 40, 2.0, behind=True),
}


class Level(NamedTuple):
    """How finely to compute: the level of `closing_vein` whose mesh is taken, number of steps of an inflation, longest
    step (s), which devices."""

    mesh: str
    steps: int
    longest: float
    devices: tuple[str, ...]


LEVELS = {
    "demo": Level("demo", 10, 0.2, ("uniform", "rapid", "sequential", "behind")),
    "paper": Level("demo", 20, 0.1, tuple(DEVICES)),
}


def source(base: Case) -> dict[str, Any]:
    """Return what feeds the vein of a case with its flow at rest: veins upstream and a valve, filled by capillaries."""
    whole = closing_vein.CAPILLARIES / base.loads.inlet_flow(0.0)
    return {
        "kind": "windkessel", "resistance_Pa_s_m3": BEFORE_VALVE * whole,
        "distal_resistance_Pa_s_m3": (1 - BEFORE_VALVE) * whole, "compliance_m3_Pa": UPSTREAM,
        "valve_leakage": LEAKAGE,
        "distal_pressure": {"kind": "constant",
                            "value_Pa": base.loads.outlet_pressure(0.0) + closing_vein.CAPILLARIES},
    }  # fmt: skip


def case(key: str, level: Level) -> Case:
    """Return the oval vein in a device."""
    base, device = closing_vein.case(closing_vein.BASE, closing_vein.LEVELS[level.mesh]), DEVICES[key]
    step = min(level.longest, device.inflation / level.steps)
    return base.replace(**{
        "name": key.replace("_", "-"), "loads.openings": {"inlet": source(base)},
        "loads.skin_pressure": PressureConstant(value=0.0), "loads.cuffs": device.chambers(base.geometry.length),
        "scalars": (Washout(washed_out=WASHED_OUT),),
        "time.step": step, "time.smallest_step": step / 256, "time.end": device.full + HOLD,
        "output.fields_every": max(1, round(0.25 / step)),
    })  # fmt: skip


def velocity(run: StoredRun) -> Array:
    """Return the mean velocity at the outlet over time (m/s)."""
    return np.asarray(run.series["flow_out_m3_s"] / run.series["area_z10_m2"])


def expelled(run: StoredRun) -> Array:
    """Return the volume that has left beyond what leaves at rest, over time (m3)."""
    flow, times = run.series["flow_out_m3_s"] - run.series["flow_out_m3_s"][0], run.series["time_s"]
    return np.concatenate([[0.0], np.cumsum((flow[1:] + flow[:-1]) / 2 * np.diff(times))])


COLUMNS: dict[str, Callable[[StoredRun], float]] = {
    "peak_velocity_m_s": lambda run: float(velocity(run).max()),
    "augmentation_1": lambda run: float(velocity(run).max() / velocity(run)[0]),
    "ejected_m3": lambda run: float(expelled(run).max()),
    "left_1": lambda run: float(run.series["lumen_volume_m3"][-1] / run.series["lumen_volume_m3"][0]),
    "washout_s": lambda run: float(run.series["washout_time_s"][-1]),
    "marked_1": lambda run: float(run.series["washout_left_1"][-1]),
    "least_tawss_Pa": lambda run: float(run.wall_history()["TAWSS_Pa"].min()),
    "upstream_rise_Pa": lambda run: float(np.ptp(run.series["pressure_stored_inlet_Pa"])),
}
"""What a device does: largest mean velocity at the outlet, and over that at rest; volume expelled beyond the flow at
rest; volume left in the end, over that at rest; time until of the blood that the vein held `WASHED_OUT` has left, and
the part of it that is left in the end; smallest wall shear stress, averaged over the run; rise of the pressure
upstream, while the vein takes no blood."""
SHOWN = {
    "peak_velocity_m_s": ("peak velocity", "mm_s"), "augmentation_1": ("over that at rest", "1"),
    "ejected_m3": ("ejected", "ml"), "left_1": ("volume left", "percent"),
    "washout_s": ("half of its blood has left in", "s"), "marked_1": ("of its blood stays", "percent"),
    "least_tawss_Pa": ("smallest TAWSS", "Pa"), "upstream_rise_Pa": ("pressure upstream rises by", "mmHg"),
}  # fmt: skip


def study(level: str, folder: Path, quiet: bool = False) -> Path:
    """Run the study at a level into a folder and return the path of the report."""
    chosen = LEVELS[level]
    outcomes = run_cases({key: case(key, chosen) for key in chosen.devices}, folder, quiet=quiet)
    done = {key: one.run for key, one in outcomes.items() if one.run is not None and not one.failure}
    results = {key: {name: of(run) for name, of in COLUMNS.items()} for key, run in done.items()}
    write_rows(folder / "results.csv", [{"device": key, **row} for key, row in results.items()])
    parts = [
        f"# Intermittent compression of an oval vein, level `{level}`\n", answer(results), *_draw(done, folder),
        "## Devices\n", table(results),
        "The vein of study `closing_vein`, 3.2 : 1 in M tissue, blood at 10 mmHg. Each chamber is inflated linearly; "
        f"the full pressure is held for {HOLD:g} s. Velocity: mean over the outlet. The blood that the vein holds at "
        "rest is marked and followed (`washout`): what stays of it, with what has come from upstream, fills the volume "
        "that is left.\n",
    ]  # fmt: skip
    path = write_page(folder, "pneumatic", level, parts, outcomes)
    if not quiet:
        console().print(answer(results))
    return path


def answer(results: dict[str, dict[str, float]]) -> str:
    """Return what matters, in sentences."""
    if not results:
        return "All runs failed.\n"
    said = []
    for name, what in (("peak_velocity_m_s", "moves the blood fastest"), ("ejected_m3", "ejects most"),
                       ("least_tawss_Pa", "has the largest wall shear where it is smallest")):  # fmt: skip
        best = max(results, key=lambda key: results[key][name])
        said.append(f"- {DEVICES[best].title} {what}: {in_unit(results[best][name], SHOWN[name][1], '.3g')}.")
    return "\n".join(said) + "\n"


def table(results: dict[str, dict[str, float]]) -> str:
    """Return all devices."""
    shown = {name: Shown(*of) for name, of in SHOWN.items()}
    cells = [
        (DEVICES[key].title, *(f"{of(row[name]):.3g}".replace("nan", "") for name, of in shown.items()))
        for key, row in results.items()
    ]
    return markdown_table(("device", *(of.label for of in shown.values())), cells)


def _draw(done: dict[str, StoredRun], folder: Path) -> list[str]:
    """Draw the figures and return the lines of the report that show them."""
    if not done:
        return []
    panels = {
        "velocity at the outlet": [
            Line(DEVICES[k].title, r.series["time_s"], velocity(r), "-") for k, r in done.items()
        ]
    }
    lines(panels, (Shown("time", "s"), Shown("mean velocity", "mm_s")), folder / "velocity.png")
    volumes = {
        "blood in the vein": [
            Line(
                DEVICES[k].title, r.series["time_s"], r.series["lumen_volume_m3"] / r.series["lumen_volume_m3"][0], "-"
            )
            for k, r in done.items()
        ]
    }
    lines(volumes, (Shown("time", "s"), Shown("volume over that at rest", "1")), folder / "volume.png")
    return ["![Velocity over time](velocity.png)\n", "![Volume over time](volume.png)\n"]
