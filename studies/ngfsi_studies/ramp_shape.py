"""How much of the rise of the wall shear stress hangs on how the pressure rises, which the source study does not say?

The source lets 25 mmHg on the skin rise "gradually" within 1 s. The calf is squeezed by a linear ramp, the choice of
`compare_tissues`, and by a smooth rise of the same size and duration, in steps that follow the blood as it swings; half
of the step tells what the steps make of the difference.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ngfsi.case import Case
from ngfsi.config.functions import PressureRamp, PressureSmoothRamp
from ngfsi.report.tables import markdown_table
from ngfsi.report.terminal import console
from ngfsi.store.stored import StoredRun
from ngfsi.store.table import write_rows
from ngfsi.study import Outcome, run_cases, write_page
from ngfsi.units import MMHG, SAME_TIME, Shown, in_unit
from ngfsi_studies import compare_tissues
from ngfsi_studies.figures import Line, lines
from ngfsi_studies.source import claims
from ngfsi_studies.tissue_findings import SWING, Finding, find

TISSUES = {"M": "m_s1", "N": "n_likely"}
SHAPES = {"linear": PressureRamp, "smooth": PressureSmoothRamp}
DURATION = 1.0
"""Of the rise (s)."""


class Level(NamedTuple):
    """How finely to compute: mesh and order as of a level of compare_tissues.py, step (s)."""

    mesh: compare_tissues.Level
    step: float


_DEMO, _PAPER, _FINE = (compare_tissues.LEVELS[name] for name in ("demo", "paper", "fine"))
LEVELS = {"demo": Level(_DEMO, 0.01), "paper": Level(_PAPER, _PAPER.step), "fine": Level(_FINE, _FINE.step)}


@dataclass(frozen=True)
class Point:
    """What is computed: tissue, shape of the rise; `halved`: with half of the step."""

    tissue: str
    shape: str
    halved: bool = False

    @property
    def key(self) -> str:
        """Name of the run."""
        return f"{self.tissue.lower()}-{self.shape}" + ("-halved" if self.halved else "")


POINTS = (*(Point(*one) for one in product(TISSUES, SHAPES)), *(Point("M", shape, halved=True) for shape in SHAPES))


def case(point: Point, level: Level) -> Case:
    """Return the case of a point."""
    base = compare_tissues.case(TISSUES[point.tissue], level.mesh)
    step = level.step / 2 if point.halved else level.step
    return base.replace(**{
        "name": point.key,
        "loads.skin_pressure": SHAPES[point.shape](final=25 * MMHG, duration=DURATION),
        "time.step": step,
        "time.smallest_step": step / 64,
        "time.end": DURATION,
        "output.fields_every": 0,
        "output.wall_every": 1000,
    })  # fmt: skip


def study(level: str, folder: Path, quiet: bool = False) -> Path:
    """Run the study at a level into a folder and return the path of the report."""
    outcomes = run_cases({point.key: case(point, LEVELS[level]) for point in POINTS}, folder, quiet=quiet)
    path = write_report(level, folder, outcomes)
    if not quiet:
        console().print(path.read_text(encoding="utf-8").partition("\n\n")[2].partition("\n\n")[0])
    return path


def swing(run: StoredRun) -> float:
    """Return by how much SAWSS swings in the last `SWING` of a run, as a fraction of that at t = 0.

    Half the distance between the largest and the smallest deviation from a cubic, which follows the course.
    """
    times, shear = run.series["time_s"], run.series["sawss_Pa"]
    last = times >= times[-1] - SWING - SAME_TIME
    since = times[last] - times[-1]
    rest = shear[last] - np.polyval(np.polyfit(since, shear[last], 3), since)
    return float(np.ptp(rest) / 2 / shear[0])


@dataclass(frozen=True)
class Result:
    """The numbers of one run: rises of SAWSS since t = 0, the mean one and the swing of the last `SWING`."""

    tissue: str
    shape: str
    step_s: float
    loss_1: float
    rise_end_percent: float
    rise_mean_percent: float
    rise_largest_percent: float
    time_largest_s: float
    swing_percent: float
    period_s: float


def result(point: Point, finding: Finding) -> Result:
    """Return the numbers of a run."""
    shear = finding.run.series["sawss_Pa"]
    highest = int(np.argmax(shear))
    return Result(
        tissue=point.tissue,
        shape=point.shape,
        step_s=finding.run.case.time.step,
        loss_1=finding.ramp_end.loss,
        rise_end_percent=finding.ramp_end.rise,
        rise_mean_percent=finding.mean_rise,
        rise_largest_percent=100 * float(shear[highest] / shear[0] - 1),
        time_largest_s=float(finding.run.series["time_s"][highest]),
        swing_percent=100 * swing(finding.run),
        period_s=finding.period or 0.0,
    )


def write_report(level: str, folder: Path, outcomes: Mapping[str, Outcome]) -> Path:
    """Write report.md, results.csv and the figure from what became of the runs, and return the report's path."""
    found = {p: f for p in POINTS if (f := find(p.key, outcomes[p.key])) is not None and not f.failure}
    results = [result(point, finding) for point, finding in found.items()]
    if results:
        write_rows(folder / "results.csv", [asdict(one) for one in results])
        _draw(found, folder)
    parts = [
        f"# Linear and smooth rise of the pressure, level `{level}`\n",
        answer(results),
        "![SAWSS under both rises](rise.png)\n",
        "SAWSS over that at t = 0 while the pressure on the skin rises to 25 mmHg: p = 25 mmHg s (linear), 25 mmHg "
        "(1 - cos(pi s)) / 2 (smooth), s the time over the duration.\n",
        table(results),
        f"Rises are against t = 0; mean: of the last {SWING:g} s; swing: half the distance between the largest and the "
        "smallest deviation of SAWSS from a cubic through that time, over SAWSS at t = 0. Printed by the source: "
        f"{_printed()} %.\n",
    ]
    return write_page(folder, "ramp_shape", level, parts, outcomes)


def _printed() -> str:
    said = claims()["sawss_rise_percent"]
    return " and ".join(f"{said[tissue]:g} ({tissue})" for tissue in TISSUES)


def answer(results: Sequence[Result]) -> str:
    """Return what the shape of the rise decides, in sentences."""
    said = []
    for tissue in TISSUES:
        pair = [_of(results, tissue, shape)[:1] for shape in SHAPES]
        if not all(pair):
            continue
        (linear,), (smooth,) = pair
        said.append(
            f"- **{tissue}**: against t = 0 SAWSS is {linear.rise_end_percent:+.0f} % at the end of the linear rise "
            f"and {smooth.rise_end_percent:+.0f} % at that of the smooth one, where the vein expels no blood any more; "
            f"in the mean of the last {SWING:g} s {linear.rise_mean_percent:+.0f} and "
            f"{smooth.rise_mean_percent:+.0f} %; "
            f"at most {linear.rise_largest_percent:+.0f} % (at {linear.time_largest_s:.2f} s) and "
            f"{smooth.rise_largest_percent:+.0f} % (at {smooth.time_largest_s:.2f} s). In the last {SWING:g} s it "
            f"swings by {linear.swing_percent:.1f} and {smooth.swing_percent:.1f} % of SAWSS at t = 0. The loss of "
            f"volume is {100 * linear.loss_1:.1f} and {100 * smooth.loss_1:.1f} %."
        )
    changes = [
        f"{steps[1].rise_end_percent - steps[0].rise_end_percent:+.1f} ({shape})"
        for shape in SHAPES
        if len(steps := _of(results, "M", shape)) == 2
    ]
    if changes:
        said.append(
            f"- **Half of the step** changes the rise at the end, M, by {' and '.join(changes)} percentage points."
        )
    return "\n".join(said) + "\n"


def _of(results: Sequence[Result], tissue: str, shape: str) -> list[Result]:
    """Return the runs of one tissue and shape, the longest step first."""
    chosen = [one for one in results if (one.tissue, one.shape) == (tissue, shape)]
    return sorted(chosen, key=lambda one: -one.step_s)


def table(results: Sequence[Result]) -> str:
    """Return all runs."""
    head = ("tissue, rise", "step ms", "loss %", "rise of SAWSS at the end %", "mean %", "largest %", "at s", "swing %",
            "period s")  # fmt: skip
    cells = [
        (
            f"{one.tissue}, {one.shape}", f"{1e3 * one.step_s:g}", f"{100 * one.loss_1:.1f}",
            f"{one.rise_end_percent:.0f}", f"{one.rise_mean_percent:.0f}", f"{one.rise_largest_percent:.0f}",
            f"{one.time_largest_s:.2f}", f"{one.swing_percent:.1f}", f"{one.period_s:.2f}" if one.period_s else "-",
        )
        for one in results
    ]  # fmt: skip
    return markdown_table(head, cells)


def _draw(found: Mapping[Point, Finding], folder: Path) -> None:
    panels: dict[str, list[Line]] = {}
    for point, finding in found.items():
        series = finding.run.series
        label = f"{point.shape}, {in_unit(finding.run.case.time.step, 'ms')}"
        style = "-" if not point.halved else ":"
        panels.setdefault(f"{point.tissue} tissue", []).append(
            Line(label, series["time_s"], series["sawss_Pa"] / series["sawss_Pa"][0], style)
        )
    lines(panels, (Shown("time", "s"), Shown("SAWSS over that at t = 0", "1")), folder / "rise.png")
