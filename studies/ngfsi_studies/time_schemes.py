"""Which time scheme gives the wall shear stress and the volume at every instant for the least work?

The calf is squeezed by the first part of a linear and of a smooth rise to 25 mmHg, by each scheme in steps of several
sizes, and by schemes that choose their steps for several tolerances. All are compared with small steps of the scheme of
fourth order on the same mesh, at the times that all have in common: the largest deviation counts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from ngfsi.arrays import Array
from ngfsi.case import Case, Solver
from ngfsi.report.tables import markdown_table
from ngfsi.report.terminal import console
from ngfsi.run.estimate import differences, surplus
from ngfsi.store.stored import StoredRun
from ngfsi.store.table import write_rows
from ngfsi.study import Outcome, run_cases, write_page
from ngfsi.units import MMHG, SAME_TIME, Shown
from ngfsi_studies import compare_tissues
from ngfsi_studies.figures import Line, lines
from ngfsi_studies.ramp_shape import SHAPES


class Level(NamedTuple):
    """What is computed: mesh as of a level of compare_tissues.py, end (s), steps (s) by scheme, tolerances of the
    schemes that choose their steps, the step (s) of the reference, the distance (s) of the times of comparison, and
    tolerances of Newton's method by scheme that are not the usual one, which the reference has."""

    mesh: compare_tissues.Level
    end: float
    steps: Mapping[str, Sequence[float]]
    tolerances: Mapping[str, Sequence[float]]
    reference: float
    shown: float = 0.02
    newton: Mapping[str, float] = MappingProxyType({})


LEVELS = {
    "demo": Level(
        compare_tissues.COARSE, 0.2,
        {"bdf2": (0.02, 0.01, 0.005, 0.0025, 0.00125), "esdirk3": (0.02, 0.01, 0.005), "sdirk4": (0.02, 0.01, 0.005)},
        {"esdirk3": (0.3, 0.1, 0.03)}, 0.002,
    ),
    "paper": Level(
        compare_tissues.LEVELS["paper"], compare_tissues.LEVELS["paper"].end,
        {"bdf2": (0.01, 0.005), "sdirk4": (0.05, 0.025)}, {}, 0.005, 0.05, {"sdirk4": 1e-4},
    ),
}  # fmt: skip


@dataclass(frozen=True)
class Point:
    """One run: shape of the rise, scheme, step (s) and tolerance of the error of a step; None: steps are given."""

    shape: str
    scheme: str
    step: float
    tolerance: float | None = None

    @property
    def key(self) -> str:
        """Name of the run."""
        size = f"{1e3 * self.step:g}ms" if self.tolerance is None else f"tolerance-{self.tolerance:g}"
        return f"{self.shape}-{self.scheme}-{size}"

    @property
    def doubled(self) -> Point:
        """With steps of double size."""
        return replace(self, step=2 * self.step)

    @property
    def curve(self) -> str:
        """Name of the curve on which it is a point."""
        return self.scheme if self.tolerance is None else f"{self.scheme}, own steps"


def reference_of(shape: str, level: Level) -> Point:
    """Return the run with which those of a shape are compared."""
    return Point(shape, "sdirk4", level.reference)


def points(level: Level) -> list[Point]:
    """Return all runs, the references first."""
    found = [reference_of(shape, level) for shape in SHAPES]
    for shape in SHAPES:
        found += [Point(shape, scheme, step) for scheme, steps in level.steps.items() for step in steps]
        found += [
            Point(shape, scheme, level.shown, one) for scheme, all_of in level.tolerances.items() for one in all_of
        ]
    return found


def case(point: Point, level: Level) -> Case:
    """Return the case of a point: M tissue, 25 mmHg within 1 s, of which the first part is computed."""
    usual = Solver().tolerance
    newton = usual if point == reference_of(point.shape, level) else level.newton.get(point.scheme, usual)
    return compare_tissues.case("m_s1", level.mesh).replace(**{
        "name": point.key,
        "solver.tolerance": newton,
        "loads.skin_pressure": SHAPES[point.shape](final=25 * MMHG, duration=1.0),
        "time.scheme": point.scheme,
        "time.step": point.step,
        "time.smallest_step": point.step / 1024,
        "time.error_tolerance": point.tolerance,
        "time.end": level.end,
        "output.fields_every": 0,
        "output.wall_every": 100_000,
        "output.checkpoint_every": 0,
    })  # fmt: skip


def study(level: str, folder: Path, quiet: bool = False) -> Path:
    """Run the study at a level into a folder and return the path of the report."""
    chosen = LEVELS[level]
    outcomes = run_cases({p.key: case(p, chosen) for p in points(chosen)}, folder, quiet=quiet)
    path = write_report(level, folder, outcomes)
    if not quiet:
        console().print(path.read_text(encoding="utf-8").partition("\n\n")[2])
    return path


@dataclass(frozen=True)
class Result:
    """The errors of one run, and what it took: iterations of Newton's method, factorisations, seconds of a processor.

    Errors are largest deviations from the reference at the times of comparison: of SAWSS over its own mean in time, of
    the loss of volume over the largest loss.
    """

    shape: str
    curve: str
    step_s: float
    tolerance: float
    iterations: int
    factorisations: int
    cpu_s: float
    sawss_error: float
    sawss_rms: float
    loss_error: float
    sawss_estimate: float = 0.0
    loss_estimate: float = 0.0
    """What `ngfsi run --error` would say from the run of double steps; 0: there is none."""


def at_common_times(run: StoredRun, column: str, end: float, shown: float) -> Array:
    """Return a column at the times of comparison, of a distance (s), up to an end (s).

    Raises:
        ValueError: the run has not all of them.
    """
    wanted = np.arange(1, round(end / shown) + 1) * shown
    times = run.series["time_s"]
    nearest = np.array([int(np.argmin(np.abs(times - t))) for t in wanted])
    if np.max(np.abs(times[nearest] - wanted)) > SAME_TIME:
        raise ValueError(f"the run '{run.case.name}' has not each multiple of {shown:g} s among its times")
    return np.asarray(run.series[column][nearest])


def result(
    point: Point, run: StoredRun, reference: StoredRun, shown: float, companion: StoredRun | None = None
) -> Result:  # fmt: skip
    """Return the numbers of a run; `companion`: that of double steps."""
    end = run.case.time.end
    shear, exact = (at_common_times(one, "sawss_Pa", end, shown) for one in (run, reference))
    volume, exact_volume = (at_common_times(one, "lumen_volume_m3", end, shown) for one in (run, reference))
    deviation = np.abs(shear - exact) / exact.mean()
    lost = np.max(np.abs(exact_volume - reference.series["lumen_volume_m3"][0]))
    told = differences(run, companion, surplus(point.scheme)) if companion else {}
    return Result(
        point.shape, point.curve, point.step, point.tolerance or 0.0, int(run.costs["iterations"].sum()),
        int(run.costs["factorisations"].sum()), float(run.manifest["cpu_s"]), float(deviation.max()),
        float(np.sqrt(np.mean(deviation**2))), float(np.max(np.abs(volume - exact_volume)) / lost),
        told.get(("sawss_Pa", "largest"), 0.0), told.get(("lumen_volume_m3", "largest"), 0.0),
    )  # fmt: skip


def write_report(level: str, folder: Path, outcomes: Mapping[str, Outcome]) -> Path:
    """Write report.md, results.csv and the figures from what became of the runs, and return the report's path."""
    chosen = LEVELS[level]
    done = {key: one.run for key, one in outcomes.items() if one.run is not None and not one.failure}
    results = [
        result(point, done[point.key], done[exact.key], chosen.shown, done.get(point.doubled.key))
        for point in points(chosen)
        if point.key in done and (exact := reference_of(point.shape, chosen)).key in done and point != exact
    ]
    if results:
        write_rows(folder / "results.csv", [asdict(one) for one in results])
        draw(results, folder)
    looser = "".join(f" Newton's tolerance is {one:g} with {name}." for name, one in chosen.newton.items())
    parts = [
        f"# Time schemes: errors at every instant and work, level `{level}`\n",
        f"The calf with M tissue, until {chosen.end:g} s, under 25 mmHg within 1 s, linear (with a kink at t = 0) and "
        f"smooth. Errors are the largest over the multiples of {1e3 * chosen.shown:g} ms, against sdirk4 with "
        f"{1e3 * chosen.reference:g} ms on the same mesh: of SAWSS over its mean in time, of the loss of volume over "
        "the largest loss. Effectivity is what `ngfsi run --error` would say, from the run of double steps in the "
        "table, over these errors. Seconds of a processor are of whole runs, with the start of Python and the state at "
        f"rest.{looser}\n",
        "![Largest error of SAWSS over iterations](sawss.png)\n",
        "![Largest error of the loss of volume over iterations](loss.png)\n",
        table(results),
    ]
    return write_page(folder, "time_schemes", level, parts, outcomes)


def table(results: Sequence[Result]) -> str:
    """Return all runs."""
    head = ("rise", "scheme", "step ms, tolerance", "iterations", "factorisations", "CPU s", "SAWSS, largest %",
            "SAWSS, rms %", "loss, largest %", "effectivity, SAWSS", "effectivity, loss")  # fmt: skip
    cells = [
        (one.shape, one.curve, f"{one.tolerance:g}" if one.tolerance else f"{1e3 * one.step_s:g}", f"{one.iterations}",
         f"{one.factorisations}", f"{one.cpu_s:.0f}", f"{100 * one.sawss_error:.2f}", f"{100 * one.sawss_rms:.2f}",
         f"{100 * one.loss_error:.3f}",
         *(f"{told / error:.1f}" if told else "-"
           for told, error in ((one.sawss_estimate, one.sawss_error), (one.loss_estimate, one.loss_error))))
        for one in results
    ]  # fmt: skip
    return markdown_table(head, cells)


def draw(results: Sequence[Result], folder: Path) -> None:
    """Draw errors over iterations."""
    for name, label in (("sawss", "largest error of SAWSS"), ("loss", "largest error of the loss")):
        panels: dict[str, list[Line]] = {}
        for shape in SHAPES:
            for curve in dict.fromkeys(one.curve for one in results):
                of = [one for one in results if (one.shape, one.curve) == (shape, curve)]
                errors = [getattr(one, f"{name}_error") for one in of]
                if of:
                    panels.setdefault(f"{shape} rise", []).append(Line(curve, [one.iterations for one in of], errors))
        lines(panels, (Shown("iterations", "1"), Shown(label, "1")), folder / f"{name}.png", log=(True, True))
