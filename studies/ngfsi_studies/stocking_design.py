"""Which pressure on the skin keeps the blood moving best, if its mean is bounded?

Three chambers along the segment press all around or more from one side, at rest or in sequential cycles; their mean
over skin and cycle is the same in all cases. What is to be large is the wall shear stress where it is smallest: the
smallest, over eleven sections of the vein, of the wall shear stress averaged around the section and over a cycle.
A surrogate through runs on a coarse mesh finds the best, which are then computed on a finer one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from math import pi
from pathlib import Path
from typing import Any, NamedTuple

import ngsolve as ng
import numpy as np
from numpy.typing import NDArray

from ngfsi.case import Case, Cuff, Loads, Output
from ngfsi.config.functions import Harmonics, PressureConstant, PressureHarmonics
from ngfsi.errors import NgfsiError
from ngfsi.measure.sections import STATIONS
from ngfsi.measure.shear_history import within
from ngfsi.mesh.domain import Domain
from ngfsi.report.tables import markdown_table
from ngfsi.report.terminal import console
from ngfsi.store.stored import StoredRun
from ngfsi.store.table import write_rows
from ngfsi.study import Results, Study, run_study, write_page
from ngfsi.study.design import Design, sobol
from ngfsi.study.surrogate import Surrogate
from ngfsi.units import MMHG, Shown, from_si, in_unit, to_si
from ngfsi_studies import compare_tissues
from ngfsi_studies.figures import Line, SkinPressure, lines, skin_pressures
from ngfsi_studies.source import inferred_flow

Array = NDArray[np.float64]

SEED = 11
BOUND = 12 * MMHG
"""Mean pressure on the skin, over its area and a cycle (Pa)."""
PERIOD = 2.0
"""Of a cycle (s)."""
CYCLES = 1.5
"""That are computed; the last one counts: what the start sets swinging is gone after 0.8 s."""
CHAMBERS = 3
EDGE = 20e-3
"""Over which the pressure of a chamber falls off (m); coarse meshes must resolve it."""


class Profile(NamedTuple):
    """A pressure on the skin over z, angle and time, of the given mean.

    Attributes:
        gradient: the distal chamber has 1 + gradient of the mean, the proximal one 1 - gradient.
        one_side: part of the pressure that acts on one half of the skin alone.
        side_deg: direction of the middle of that half: -90 is posterior, 0 lateral.
        pulse: part of the pressure that swings, by a cosine, between nothing and twice the mean.
        lag: delay of each chamber behind the one distal of it, in periods.
    """

    gradient: float = 0.0
    one_side: float = 0.0
    side_deg: float = -90.0
    pulse: float = 0.0
    lag: float = 0.0

    def chambers(self, length: float) -> tuple[Cuff, ...]:
        """Return the loads on a segment of a length (m)."""
        found = []
        for number, weight in enumerate((1 + self.gradient, 1.0, 1 - self.gradient)):
            # the outer edges lie outside of the segment, so that its ends are pressed in full
            start = number * length / CHAMBERS - (EDGE / 2 if number == 0 else 0)
            end = (number + 1) * length / CHAMBERS + (EDGE / 2 if number == CHAMBERS - 1 else 0)
            for fraction, half_width in ((1 - self.one_side, None), (2 * self.one_side, pi / 2)):
                if fraction > 0:
                    found.append(
                        Cuff(
                            pressure=self._over_time(BOUND * weight * fraction, number),
                            start=start, end=end, edge=EDGE,
                            direction=to_si(self.side_deg, "deg"), half_width=half_width,
                        )
                    )  # fmt: skip
        return tuple(found)

    def _over_time(self, mean: float, chamber: int) -> Harmonics[float]:
        return PressureHarmonics(
            mean=mean, amplitudes=(self.pulse * mean,), phases=(pi - 2 * pi * self.lag * chamber,), period=PERIOD
        )

    @property
    def label(self) -> str:
        """The profile in a few words."""
        side = f", {self.one_side:.0%} from {self.side_deg:.0f}°" if self.one_side > 0.005 else ""
        cycle = f", {self.pulse:.0%} in cycles, lag {self.lag:+.2f}" if self.pulse > 0.005 else ""
        return f"gradient {self.gradient:+.2f}{side}{cycle}"


CREDIT = (
    "That pressing from one side closes a vein further, and moves its blood faster, than pressing all around was found "
    "before by Dai, Gertler and Kamm, J Biomech Eng 121 (1999) 557, doi 10.1115/1.2800853, with plane sections and "
    "flow in one dimension."
)
STANDARD = {
    "uniform": Profile(),
    "graduated": Profile(gradient=0.3),
    "posterior": Profile(one_side=1.0),
    "sequential cycles": Profile(pulse=1.0, lag=1 / 6),
}
RANGES = {
    "gradient": (-0.3, 0.3),
    "one_side": (0.0, 1.0),
    "side_deg": (-150.0, -30.0),
    "pulse": (0.0, 1.0),
    "lag": (-1 / 3, 1 / 3),
}


def _last_cycle(run: StoredRun, *columns: str) -> tuple[Array, Array]:
    """Return times (s) of the last cycle, of one period exactly, and columns then, (times, columns); default: the wall
    shear stress (Pa) around each section."""
    times = run.series["time_s"]
    columns = columns or tuple(f"wss_z{station:02d}_Pa" for station in range(STATIONS))
    values = np.column_stack([run.series[column] for column in columns])
    return within(times, values, float(times[-1]) - PERIOD, float(times[-1]))


def over_cycle(run: StoredRun) -> Array:
    """Return the wall shear stress (Pa) around each section, averaged over the last cycle: (stations,)."""
    times, shear = _last_cycle(run)
    return np.asarray(np.trapezoid(shear, times, axis=0) / PERIOD)


def _smallest_outflow(run: StoredRun) -> float:
    return float(np.min(_last_cycle(run, "flow_out_m3_s")[1]))


def _largest_loss(run: StoredRun) -> float:
    """Return the largest fraction of the area of any section that is lost against the shape without loads."""
    areas = np.column_stack([run.series[f"area_z{station:02d}_m2"] for station in range(STATIONS)])
    return float(1 - np.min(areas) / (pi * run.case.geometry.lumen_radius**2))


RESULT, LOSS = "least_tawss_Pa", "largest_loss_1"
COLUMNS: dict[str, Callable[[StoredRun], float]] = {
    RESULT: lambda run: float(np.min(over_cycle(run))),
    "least_wss_Pa": lambda run: float(np.min(_last_cycle(run)[1])),
    "mean_tawss_Pa": lambda run: float(np.mean(over_cycle(run))),
    "least_outflow_m3_s": _smallest_outflow,
    LOSS: _largest_loss,
}


class Level(NamedTuple):
    """How finely to compute: discretisation and steps in a cycle of the runs of the design and of the confirming ones,
    number of runs in the design."""

    runs: compare_tissues.Level
    steps: int
    confirming: compare_tissues.Level
    confirming_steps: int
    number: int


LEVELS = {
    "demo": Level(compare_tissues.COARSE, 10, compare_tissues.LEVELS["demo"], 20, 64),
    "paper": Level(compare_tissues.COARSE, 10, compare_tissues.LEVELS["paper"], 20, 64),
    "fine": Level(compare_tissues.LEVELS["demo"], 20, compare_tissues.LEVELS["fine"], 60, 128),
}


TOLERANCE = 1e-4
"""Of Newton's method in the runs of the design, whose meshes are much more in error."""
FINAL = 1e-6
"""Of Newton's method in the confirming runs."""


def case(profile: Profile, level: compare_tissues.Level, steps: int, tolerance: float = TOLERANCE) -> Case:
    """Return the calf under a profile, with so many steps in a cycle; a profile at rest is steady and needs but one."""
    base = compare_tissues.case(compare_tissues.MAIN[0], level)
    rest = profile.pulse == 0
    return base.replace(
        **{
            "loads": Loads(
                skin_pressure=PressureConstant(value=0.0), cuffs=profile.chambers(base.geometry.length)
            ),
            "time.step": PERIOD if rest else PERIOD / steps,
            "time.end": PERIOD if rest else CYCLES * PERIOD,
            "solver.tolerance": tolerance,
            "output": Output(fields_every=0, wall_every=1000, checkpoint_every=0),
        }
    )  # fmt: skip


def design(level: Level) -> Design:
    """Return the points at which the surrogate is fitted: one half at rest, one half in cycles."""
    still = {name: RANGES[name] for name in ("gradient", "one_side", "side_deg")}
    at_rest = sobol(still, level.number // 2, SEED).points
    in_cycles = sobol(RANGES, level.number // 2, SEED)
    points = np.vstack([np.pad(at_rest, ((0, 0), (0, 2))), in_cycles.points])
    return replace(in_cycles, points=points)


BEST = 3
APART = 0.3
"""Distance of the patterns of the best."""


LARGEST_LOSS = 0.25
"""Of the area of a section, among which the best are looked for. A round section that shrinks loses 0.47 before the law
of the wall loses strong ellipticity (docs/theory.md); one that is pressed from one side flattens, and on the mesh of
level `paper` profiles under which it loses 0.36 on the coarse one had no solution any more."""


def open_enough(losses: Surrogate, points: Array) -> NDArray[np.bool_]:
    """Return of which profiles the largest loss is most likely (two standard deviations) small enough."""
    mean, deviation = losses(points)
    return mean + 2 * deviation < LARGEST_LOSS


def pattern(points: Array) -> Array:
    """Return (number, 5) how profiles differ: the side counts as much as is on it, the lag as much as swings."""
    gradient, one_side, side, pulse, lag = points.T
    side, turn = np.radians(side), 2 * np.pi * lag
    parts = (gradient, one_side * np.cos(side), one_side * np.sin(side), pulse * np.cos(turn), pulse * np.sin(turn))
    return np.stack(parts, axis=1)


def study(level: str, folder: Path, quiet: bool = False) -> Path:
    """Compute the design, find the best profiles, compute them, and return the path of the report.

    Raises:
        CaseError: too few runs of the design came to their end.
        NgfsiError: none of the confirming runs did.
    """
    chosen = LEVELS[level]
    plan = design(chosen)
    named = {key: Profile(**values) for key, values in plan.values().items()}
    results = _run("design", named, chosen.runs, chosen.steps, TOLERANCE, folder, quiet)
    surrogate, losses = (
        Surrogate.through(plan, [results.table.get(key, {}).get(name, np.nan) for key in named], pattern, SEED)
        for name in (RESULT, LOSS)
    )
    points = surrogate.best(BEST, APART, SEED, lambda points: open_enough(losses, points))
    best = {f"best {n}": Profile(*map(float, point)) for n, point in enumerate(points, start=1)}
    compared = {**STANDARD, **best}
    coarse = _run("compared", compared, chosen.runs, chosen.steps, TOLERANCE, folder, quiet)
    fine = _run("confirmed", compared, chosen.confirming, chosen.confirming_steps, FINAL, folder, quiet)
    if not fine.table:
        raise NgfsiError(f"no confirming run came to its end: '{fine.report}' says why")
    found = Found(chosen, surrogate, compared, coarse, fine)
    _draw(found, folder)
    write_rows(folder / "ranking.csv", found.rows())
    path = write_page(folder, "stocking_design", level, _text(level, found, results))
    if not quiet:
        console().print(_answer(found))
    return path


def _run(
    name: str, chosen: Mapping[str, Profile], level: compare_tissues.Level, steps: int, tolerance: float,
    folder: Path, quiet: bool,
) -> Results:  # fmt: skip
    cases = {key: case(profile, level, steps, tolerance) for key, profile in chosen.items()}
    inputs = {key: dict(zip(RANGES, profile, strict=True)) for key, profile in chosen.items()}
    return run_study(Study(name, cases, COLUMNS, inputs), folder, quiet=quiet)


class Found(NamedTuple):
    """What came out: the surrogate, the profiles compared, and their runs on both discretisations."""

    level: Level
    surrogate: Surrogate
    compared: Mapping[str, Profile]
    coarse: Results
    fine: Results

    def predicted(self, key: str) -> tuple[float, float]:
        """Return what the surrogate says of a profile, and its standard deviation (Pa)."""
        mean, deviation = self.surrogate(np.array([self.compared[key]]))
        return float(mean[0]), float(deviation[0])

    def value(self, key: str, name: str = RESULT) -> float:
        """Return a result of the finest run of a profile, nan if it failed."""
        return self.fine.table.get(key, {}).get(name, float("nan"))

    def ranked(self) -> list[str]:
        """Return the profiles whose confirming runs came to their end, the best first."""
        return sorted(self.fine.table, key=lambda key: -self.value(key))

    def rows(self) -> list[dict[str, float | str]]:
        """Return a row for each profile compared."""
        found: list[dict[str, float | str]] = []
        for key, profile in self.compared.items():
            mean, deviation = self.predicted(key)
            row: dict[str, float | str] = {"profile": key, **dict(zip(RANGES, profile, strict=True))}
            row |= {"surrogate_Pa": mean, "surrogate_deviation_Pa": deviation}
            row["coarse_Pa"] = self.coarse.table.get(key, {}).get(RESULT, float("nan"))
            found.append(row | {name: self.value(key, name) for name in COLUMNS})
        return found


def parts_of_skin(case: Case) -> list[Any]:
    """Return where each cuff of a case presses, as a fraction of its pressure."""
    return [cuff.weight() for cuff in case.loads.cuffs]


def mean_pressure(case: Case, time: float, domain: Domain) -> float:
    """Return the pressure on the skin (Pa), mean over its reference area, as the mesh integrates it."""
    pressures = [cuff.pressure(time) for cuff in case.loads.cuffs]
    pressure = sum((p * part for p, part in zip(pressures, parts_of_skin(case), strict=True)), ng.CF(0.0))
    measure = domain.ds("skin")
    return float(ng.Integrate(pressure * measure, domain.mesh) / ng.Integrate(ng.CF(1.0) * measure, domain.mesh))


def _skin(profile: Profile, level: compare_tissues.Level) -> SkinPressure:
    """Return the pressure of a profile, for a picture: mean over the cycle, and over time in each chamber's middle."""
    chosen = case(profile, level, 12)
    domain, height = Domain.build(chosen.geometry), chosen.geometry.length
    cuffs, times = chosen.loads.cuffs, np.linspace(0, PERIOD, 61)
    means = [np.mean([cuff.pressure(t) for t in times[:-1]]) for cuff in cuffs]
    mean = sum((p * part for p, part in zip(means, parts_of_skin(chosen), strict=True)), ng.CF(0.0))
    rules = {shape: ng.IntegrationRule(shape, 8) for shape in (ng.QUAD, ng.TRIG)}
    at = domain.mesh.MapToAllElements(rules, domain.boundaries("skin"))
    x, y, z = np.asarray(ng.CF((ng.x, ng.y, ng.z))(at)).T
    middles = [(number + 0.5) * height / CHAMBERS for number in range(CHAMBERS)]
    chambers = [[sum(c.pressure(t) for c in cuffs if c.start < z0 < c.end) for t in times] for z0 in middles]
    return SkinPressure(
        angles=np.arctan2(y, x),
        heights=z,
        mean=np.asarray(mean(at)).ravel(),
        times=times,
        chambers=dict(zip(("distal", "middle", "proximal"), np.array(chambers), strict=True)),
    )


def _draw(found: Found, folder: Path) -> None:
    """Draw all figures."""
    compared = {key: found.compared[key] for key in found.ranked()}
    skin_pressures({key: _skin(p, found.level.runs) for key, p in compared.items()}, folder / "profiles.png")
    runs = {key: run for key in compared if (run := found.fine.outcomes[key].run)}
    z = np.linspace(0, next(iter(runs.values())).case.geometry.length, STATIONS)
    lines({"mean over the last cycle": [Line(key, z, over_cycle(run)) for key, run in runs.items()]},
          (Shown("height along the vein, from the inlet", "mm"), Shown("wall shear stress around the section", "Pa")),
          folder / "along.png")  # fmt: skip
    outflow = []
    for key, run in runs.items():
        times, outflows = _last_cycle(run, "flow_out_m3_s")
        outflow.append(Line(key, times - times[0], outflows[:, 0], "-"))
    lines({"last cycle": outflow}, (Shown("time in the cycle", "s"), Shown("outflow", "ml_s")), folder / "outflow.png")
    _draw_surrogate(found, folder)


def _draw_surrogate(found: Found, folder: Path) -> None:
    said, deviation = found.surrogate.left_out()
    computed = found.surrogate.values
    ends = np.array([min(computed.min(), said.min()), max(computed.max(), said.max())])
    drawn = [
        Line("runs of the design, each from all others", computed, said, "o", 2 * deviation),
        Line("equal", ends, ends, "--"),
    ]
    new = [(found.coarse.table[key][RESULT], *found.predicted(key)) for key in found.coarse.table]
    if new:
        x, y, spread = np.array(new).T
        drawn.append(Line("profiles compared, not in the design", x, y, "s", 2 * spread))
    axes = Shown("computed", "Pa"), Shown("surrogate, ± 2 standard deviations", "Pa")
    lines({"least TAWSS, coarse mesh": drawn}, axes, folder / "surrogate.png")
    keys = found.ranked()
    places = np.arange(len(keys), dtype=float)
    said_of = np.array([found.predicted(key) for key in keys])
    ranks = [
        Line("confirming mesh", places, [found.value(key) for key in keys], "D"),
        Line("coarse mesh", places, [found.coarse.table.get(key, {}).get(RESULT, np.nan) for key in keys], "o"),
        Line("surrogate, ± 2 standard deviations", places, said_of[:, 0], "s", 2 * said_of[:, 1]),
    ]
    lines({"": ranks}, (Shown("", "1"), Shown("least TAWSS", "Pa")), folder / "ranking.png", ticks=keys)


def _answer(found: Found) -> str:
    """Return the sentences that say what is best."""
    order = found.ranked()
    first, uniform = order[0], found.value("uniform")
    errors = [abs(found.coarse.table[key][RESULT] / found.value(key) - 1) for key in order if key in found.coarse.table]
    level = [key for key in order[1:] if found.value(key) > found.value(first) * (1 - max(errors, default=0.0))]
    gain = 100 * (found.value(first) / uniform - 1)
    text = (
        f"**{first}** ({found.compared[first].label}) keeps the least wall shear stress highest: "
        f"{found.value(first):.4f} Pa, {gain:+.0f} % against {uniform:.4f} Pa of a uniform pressure of the same mean"
    )
    if level:
        text += f"; within the error of the coarse mesh ({100 * max(errors):.1f} %) also {', '.join(level)}"
    reversed_ = [key for key in order if found.value(key, "least_outflow_m3_s") < 0]
    text += ". "
    if reversed_:
        least = min(found.value(key, "least_outflow_m3_s") for key in reversed_)
        text += (
            f"Blood comes back through the outlet while the vein refills under {', '.join(reversed_)}: "
            f"{in_unit(least, 'ml_s', '.2f')} at worst. "
        )
    return text


def _text(level: str, found: Found, results: Results) -> Sequence[str]:
    said, deviation = found.surrogate.left_out()
    values = found.surrogate.values
    q2 = 1 - np.sum((values - said) ** 2) / np.sum((values - values.mean()) ** 2)
    inside = np.mean(np.abs(values - said) < 2 * deviation)
    chosen = found.level
    return (
        f"# Pressure profiles of a stocking, level `{level}`\n",
        _answer(found) + "\n",
        _table(found),
        f"Mean pressure over skin and cycle: {in_unit(BOUND, 'mmHg')} in all of them: what is bounded is "
        "used up. TAWSS is the wall shear stress averaged around one of "
        f"{STATIONS} sections of the vein and over a cycle of {PERIOD:g} s (the last of {CYCLES}); the least of "
        "them is what is to be large. `least at any time` is the least without the average over time: it ranks "
        "differently, for pulses stop the flow for a moment. Loss: the largest of any section and time against "
        "the shape without loads. Tissue M, the inflow constant at "
        f"{inferred_flow():.1f} ml/s (inferred, the source prints none): what a profile does to "
        "the flow from below is not in the model.\n",
        f"{CREDIT}\n",
        "![least TAWSS by profile](ranking.png)\n",
        "## Profiles\n",
        "![pressure on the skin](profiles.png)\n",
        "Above: mean over the cycle, over the angle around the segment (0° lateral, ±180° medial, -90° posterior; "
        "the vein lies at -37°) and the height from the inlet. Below: pressure in the middle of each chamber on "
        "the side that is pressed more.\n",
        "![wall shear stress along the vein](along.png)\n",
        "![outflow over a cycle](outflow.png)\n",
        "Where the outflow is negative the vein refills through its outlet: the condition there takes out the "
        "kinetic energy of what comes in (docs/theory.md), and lets it pass.\n",
        "## Surrogate\n",
        f"A Gaussian process (Matern 5/2, a length for each coordinate) through {len(values)} of "
        f"{len(results.outcomes)} runs at points of Sobol's sequences in {', '.join(RANGES)}, one half of them at "
        "rest. Its coordinates are the gradient, the part on one side times sine and cosine of its direction, and "
        "the part in cycles times sine and cosine of the lag. Left out one by one, "
        f"the runs are predicted with a root mean square error of {np.sqrt(np.mean((values - said) ** 2)):.2g} Pa "
        f"(Q² = {q2:.3f}), {inside:.0%} of them within two standard deviations. The best {BEST} are its largest "
        f"values among profiles that differ by {APART:g} in gradient, side or cycle, and under which no section "
        f"loses more than {LARGEST_LOSS:.0%} of its area at any time, as a second surrogate says with two standard "
        "deviations to spare. The largest values of all lie beyond: there the vein flattens until its wall's law "
        "loses strong ellipticity, and they could not be confirmed on a finer mesh.\n",
        "![surrogate over computed](surrogate.png)\n",
        "## Errors\n",
        f"The design has {chosen.runs.mesh.axial_layers} layers of coarse elements and {chosen.steps} steps in a "
        f"cycle; the profiles compared were computed again with the mesh of a finer level of `compare_tissues` and "
        f"{chosen.confirming_steps} steps. The column `coarse - confirmed` is the error of the former.\n",
        "All runs: [design.md](design.md), [compared.md](compared.md), [confirmed.md](confirmed.md); numbers: "
        "[ranking.csv](ranking.csv).\n",
    )


def _table(found: Found) -> str:
    head = ("rank", "profile", "least TAWSS [Pa]", "coarse - confirmed [%]", "surrogate ± 2 sd [Pa]",
            "least at any time [Pa]", "mean TAWSS [Pa]", "least outflow [ml/s]", "largest loss [%]")  # fmt: skip
    rows = []
    for rank, key in enumerate(found.ranked(), start=1):
        value, coarse = found.value(key), found.coarse.table.get(key, {}).get(RESULT, np.nan)
        mean, deviation = found.predicted(key)
        outflow = from_si(found.value(key, "least_outflow_m3_s"), "ml_s")
        rows.append((
            str(rank), f"{key}: {found.compared[key].label}", f"{value:.4f}", f"{100 * (coarse / value - 1):+.1f}",
            f"{mean:.4f} ± {2 * deviation:.4f}", f"{found.value(key, 'least_wss_Pa'):.4f}",
            f"{found.value(key, 'mean_tawss_Pa'):.4f}", f"{outflow:.2f}",
            f"{100 * found.value(key, LOSS):.1f}",
        ))  # fmt: skip
    failed = [f"{key} failed: {o.failure}" for key, o in found.fine.outcomes.items() if o.failure]
    return markdown_table(head, rows) + "".join(f"\n{line}\n" for line in failed)
