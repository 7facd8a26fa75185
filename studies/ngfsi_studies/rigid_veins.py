"""Wall shear stress in ten veins with rigid walls before and after compression: what do volume, flow and shape explain?

Repeats chapter 5 of the source study. Its vein shapes are not available: synthetic veins have the printed volumes and
mean flows, and after compression one of three shapes of the same areas, the same one in all subjects. In two subjects
the blood flows back for a part of the breath before compression; how much is not printed, and two sizes are tried.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product
from math import pi
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from ngfsi_geometry.lofted import LoftedMesh, LoftedVein
from numpy.typing import NDArray

from ngfsi.case import Case, Discretisation, Loads, Materials, Output, TimeStepping
from ngfsi.config.functions import FlowConstant, FlowCurve, FlowWaveform, PressureConstant, Waveform
from ngfsi.identify.waveform import ensemble
from ngfsi.materials import Newtonian, load_set
from ngfsi.outlines.outline import Outline
from ngfsi.report.tables import markdown_table
from ngfsi.report.terminal import console
from ngfsi.store.disk import replace_file
from ngfsi.store.stored import StoredRun
from ngfsi.store.table import write_rows
from ngfsi.study import Outcome, run_cases
from ngfsi.units import SAME_TIME, Shown, to_si
from ngfsi_studies.figures import Line, lines
from ngfsi_studies.source import tables

Array = NDArray[np.float64]

PRINTED = tables("rigid_veins")
LENGTH = to_si(PRINTED["segment_length_mm"], "mm")
SECTIONS, WINDOWS = 11, 10
SHAPES = {"round": (1.0, 1.0), "oval": (2.0, 1.0), "collapsed": (3.0, 0.6)}
"""Shape -> ratio of its axes, and thickness in the middle over that of an ellipse."""
BEFORE = (1.2, 1.0)
STATES = tuple(product(range(1, len(PRINTED["flow_ml_s"]["before"]) + 1), ("before", *SHAPES)))
"""Subjects in each state."""
SEED = 5
PULSATILE = 7
"""Subject computed over breathing cycles, too: the one of the largest flow."""
BACKWARD = (0.5, 1.0, 1.5)
"""Largest flow back over the mean flow, tried in the subjects that have reverse flow before compression."""
REVERSED = tuple(product(PRINTED["reverse_flow_before"], BACKWARD))
CYCLES = 3
SAME = 0.01
"""Cycles whose wall shear stress differs by less, in the mean over wall and cycle, are taken as periodic."""
BREATHS = "breaths"
SHEAR = "wall_shear_magnitude_Pa"
STEADY = TimeStepping(scheme="static", step=1.0, end=1.0)


class Level(NamedTuple):
    """How finely a level computes: order, mesh, time steps of a breathing cycle."""

    order: int
    mesh: LoftedMesh
    steps: int


def _mesh(order: int, around: int, layers: int) -> LoftedMesh:
    return LoftedMesh(
        around=around, layers=layers, inlet_layers=layers // 2, lumen_radii=(0.8, 0.5), curving_order=order
    )


LEVELS = {
    "demo": Level(2, _mesh(2, 12, 8), 20),
    "paper": Level(3, _mesh(3, 16, 14), 60),
    "fine": Level(3, _mesh(3, 24, 24), 120),
}


@dataclass(frozen=True)
class Finding:
    """Flow of the printed mean in one vein: wall shear stress (Pa) over the segment, without the inlet.

    Steady, or its average over a breath where the state is one of reverse flow.

    Attributes:
        uniform: that of a uniform round tube of the same volume and flow.
        heights, velocity, shear: axial curves, of windows of the segment: m, m/s, Pa.
    """

    subject: int
    state: str
    volume: float
    flow: float
    mean: float = np.nan
    smallest: float = np.nan
    largest: float = np.nan
    uniform: float = np.nan
    heights: tuple[float, ...] = ()
    velocity: tuple[float, ...] = ()
    shear: tuple[float, ...] = ()
    failure: str = ""


def outline(area: float, ratio: float, waist: float, turn: float, x: float) -> Outline:
    """Return a closed outline of an area (m2): an ellipse, thinned in its middle by `waist`."""
    t = 2 * pi * np.arange(64) / 64
    shape = ratio**0.5 * np.cos(t) + 1j / ratio**0.5 * np.sin(t) * (1 - (1 - waist) * np.sin(t) ** 4)
    points = np.column_stack([shape.real, shape.imag])
    factor = np.sqrt(area / Outline.through(points).area)
    turned = factor * shape * np.exp(1j * turn)
    return Outline.through(np.column_stack([x + turned.real, turned.imag]))


def vein(subject: int, volume: float, shape: tuple[float, float], mesh: LoftedMesh) -> LoftedVein:
    """Return a synthetic vein of a volume (m3): its area varies by a quarter along it, and its axis bends."""
    random = np.random.default_rng(SEED + subject)
    phase, bend = random.uniform(0, 2 * pi, 2)
    z = np.linspace(0, LENGTH, SECTIONS)
    areas = 1 + 0.25 * np.sin(1.5 * pi * z / LENGTH + phase)
    middle = 1.0e-3 * np.sin(pi * z / LENGTH + bend)

    def of(factor: float) -> LoftedVein:
        stack = tuple(
            outline(factor * volume / LENGTH * a, *shape, 0.6 * height / LENGTH, x)
            for a, height, x in zip(areas, z, middle, strict=True)
        )
        return LoftedVein(outlines=stack, heights=tuple(map(float, z)), mesh=mesh)

    factor = 1.0
    for _ in range(2):  # the volume goes with the factor but for the bend from the inlet into the first section
        factor *= volume / of(factor).volume
    return of(factor)


def blood() -> Newtonian:
    """Return the blood of the study."""
    found = load_set("blood")
    assert isinstance(found, Newtonian)
    return found


def case(geometry: LoftedVein, flow: FlowCurve, level: Level, time: TimeStepping = STEADY) -> Case:
    """Return the case of flow through a vein into an outlet of pressure 0."""
    return Case(
        name="rigid-vein",
        geometry=geometry,
        materials=Materials(fluid=blood()),
        loads=Loads(inlet_flow=flow, outlet_pressure=PressureConstant(value=0.0)),
        discretisation=Discretisation(order=level.order),
        time=time,
        output=Output(fields_every=0),
    )


def given(subject: int, state: str) -> tuple[float, float]:
    """Return volume (m3) and mean flow (m3/s) of a vein; `state`: before, or a shape after compression."""
    when = "before" if state == "before" else "after"
    volume, flow = (PRINTED[name][when][subject - 1] for name in ("vein_volume_mm3", "flow_ml_s"))
    return to_si(volume, "mm3"), to_si(flow, "ml_s")


def cases(level: Level) -> dict[str, Case]:
    """Return the cases of a level: of breathing cycles, the longest, and of steady flow by subject and state."""
    found = {BREATHS: over_breaths(PULSATILE, breathing(given(PULSATILE, "before")[1]), level)}
    for subject, backward in REVERSED:
        flow = reversing(breathing(given(subject, "before")[1]), backward)
        found[f"{subject}_{reversed_state(backward)}"] = over_breaths(subject, flow, level)
    for subject, state in STATES:
        volume, mean = given(subject, state)
        geometry = vein(subject, volume, SHAPES.get(state, BEFORE), level.mesh)
        found[f"{subject}_{state}"] = case(geometry, FlowConstant(value=mean), level)
    return found


def over_breaths(subject: int, flow: Waveform[float], level: Level) -> Case:
    """Return the case of breathing cycles in a vein before compression."""
    geometry = vein(subject, given(subject, "before")[0], BEFORE, level.mesh)
    period = flow.times[-1]
    return case(geometry, flow, level, TimeStepping(step=period / level.steps, end=CYCLES * period))


def reversed_state(backward: float) -> str:
    """Return the name of a state of reverse flow."""
    return f"back_{backward:g}"


def reversing(flow: Waveform[float], backward: float) -> Waveform[float]:
    """Return a flow that swings more around the same mean: its smallest value is `backward` times the mean, back."""
    values = np.array(flow.values)
    mean = values[:-1].mean()
    swing = (1 + backward) * mean / (mean - values.min())
    return FlowWaveform(times=flow.times, values=tuple(map(float, mean + swing * (values - mean))))


def expected(subject: int, state: str, outcome: Outcome) -> Finding:
    """Return what is known of a flow before it is looked at."""
    volume, flow = given(subject, state if state in SHAPES else "before")
    uniform = 4 * blood().viscosity * flow / (pi * (volume / LENGTH / pi) ** 1.5)
    return Finding(subject, state, volume, flow, uniform=uniform, failure=outcome.failure)


def find_reversed(subject: int, backward: float, outcome: Outcome) -> Finding:
    """Return what became of the reverse flow in one vein: averages over the last cycle."""
    known = expected(subject, reversed_state(backward), outcome)
    if outcome.failure or outcome.run is None:
        return known
    tawss = over_cycles(outcome.run).wall
    values = tawss.point_data["TAWSS_Pa"]
    return replace(known, mean=mean_over(tawss, "TAWSS_Pa"), smallest=float(values.min()), largest=float(values.max()))


def find(subject: int, state: str, outcome: Outcome) -> Finding:
    """Return what became of the steady flow in one vein."""
    known = expected(subject, state, outcome)
    flow = known.flow
    if outcome.failure or outcome.run is None:
        return known
    wall, edges = outcome.run.fields(STEADY.end, "wall"), np.linspace(0, LENGTH, WINDOWS + 1)
    heights = (edges[1:] + edges[:-1]) / 2
    inside = between(wall)
    return replace(
        known,
        mean=mean_over(inside, SHEAR),
        smallest=float(inside.point_data[SHEAR].min()),
        largest=float(inside.point_data[SHEAR].max()),
        heights=tuple(map(float, heights)),
        velocity=tuple(map(float, flow / outcome.run.case.geometry.areas(heights))),
        shear=tuple(mean_over(between(wall, low, high), SHEAR) for low, high in pairwise(edges)),
    )


def between(wall: Any, low: float = 0.0, high: float = LENGTH) -> Any:
    """Return the part of a wall between two heights (m); by default the segment, without the inlet."""
    return wall.clip("z", origin=(0, 0, high)).clip("z", origin=(0, 0, low), invert=False)


def mean_over(wall: Any, name: str) -> float:
    """Return the mean of a point field over the area of a wall."""
    whole = wall.integrate_data()
    return float(whole.point_data[name][0] / whole["Area"][0])


def correlation(found: Sequence[Finding]) -> float:
    """Return the correlation of the ratios along the veins: mean velocity and shear, each over its mean of the vein."""
    pairs = [np.array(_relative(f)) for f in found]
    return float(np.corrcoef(np.hstack(pairs)).ravel()[1])


def _relative(f: Finding) -> tuple[Array, Array]:
    return np.array(f.velocity) / np.mean(f.velocity), np.array(f.shear) / np.mean(f.shear)


def breathing(mean: float) -> Waveform[float]:
    """Return a flow over breathing cycles (m3/s): the ensemble mean of five noisy cycles, made for the purpose."""
    random = np.random.default_rng(SEED)
    period = PRINTED["breathing_period_s"]
    starts = np.r_[0.0, np.cumsum(random.uniform(0.92, 1.08, 7) * period)]
    times = np.arange(0.0, starts[-1], 0.1)
    which = np.searchsorted(starts, times, side="right") - 1
    phase = (times - starts[which]) / np.diff(starts)[which]
    signal = 1 - 0.5 * np.cos(2 * pi * phase) + 0.15 * np.sin(4 * pi * phase)
    found = ensemble(times, signal + 0.05 * random.standard_normal(len(times)), points=24)
    values = mean * found.values / found.values[:-1].mean()
    return FlowWaveform(times=tuple(map(float, found.times)), values=tuple(map(float, values)))


@dataclass(frozen=True)
class Cycles:
    """Breathing cycles.

    Attributes:
        wall: the segment's wall with averages over the last cycle (`StoredRun.wall_history`).
        times: (n,) s within the last cycle.
        mean_shear: (n,) wall shear stress, mean over the segment's wall, Pa.
        changes: of each cycle against the one before, relative; the last is below `SAME` if the state is periodic.
    """

    wall: Any
    times: Array
    mean_shear: Array
    changes: tuple[float, ...]


def over_cycles(run: StoredRun) -> Cycles:
    """Compare the cycles of a run by the times of its stored walls."""
    from scipy.interpolate import make_interp_spline

    flow, times = run.case.loads.inlet_flow, np.array(run.field_times("wall"))
    period = flow.times[-1]  # type: ignore[attr-defined] # of a waveform
    walls = [run.fields(time, "wall").point_data for time in times]
    ways = [[wall[f"wall_shear_{way}_Pa"] for way in ("axial", "circumferential")] for wall in walls]
    shear = make_interp_spline(times, np.moveaxis(np.array(ways), 1, 2), k=1)
    phases = np.linspace(0.0, period, round(period / run.case.time.step) + 1)
    cycles = [shear(k * period + phases) for k in range(CYCLES)]
    sizes = [float(np.linalg.norm(cycle, axis=2).mean()) for cycle in cycles]
    gaps = [float(np.linalg.norm(after - before, axis=2).mean()) for before, after in pairwise(cycles)]
    start = (CYCLES - 1) * period
    last = times[times > start - SAME_TIME]
    mean = np.array([mean_over(between(run.fields(time, "wall")), SHEAR) for time in last])
    changes = tuple(gap / size for gap, size in zip(gaps, sizes[1:], strict=True))
    return Cycles(between(run.wall_history(start)), last - start, mean, changes)


def study(level: str, folder: Path, quiet: bool = False) -> Path:
    """Run all veins and write report.md, results.csv and figures; return the report's path."""
    computed = cases(LEVELS[level])
    outcomes = run_cases(computed, folder / "runs", processes=len(computed), quiet=quiet)
    found = [find(subject, state, outcomes[f"{subject}_{state}"]) for subject, state in STATES]
    found += [find_reversed(*one, outcomes[f"{one[0]}_{reversed_state(one[1])}"]) for one in REVERSED]
    if not quiet:
        for f in found:
            console().print(f"subject {f.subject}, {f.state}: {f.failure or f'{f.mean:.3f} Pa'}")
    return write_report(level, folder, found, outcomes[BREATHS])


def write_report(level: str, folder: Path, found: Sequence[Finding], breaths: Outcome) -> Path:
    """Write tables, figures and what they mean."""
    write_rows(folder / "results.csv", [_row(f) for f in found])
    good = [f for f in found if not f.failure]
    failed = [f"- subject {f.subject}, {f.state}: {f.failure}" for f in found if f.failure]
    parts = [
        "# Wall shear stress in ten rigid veins, before and after compression",
        f"Level `{level}`. Synthetic veins with the volumes and mean flows that the source study prints; before "
        "compression nearly round, after it "
        + ", ".join(f"{name} (axes {ratio:g} : 1)" for name, (ratio, _) in SHAPES.items())
        + " with the same areas. Steady flow at the mean flow, blood as in the study; the inlet of 6 diameters is "
        "computed and left out of the averages, which are over the area of the stored wall.",
        "## TAWSS computed and printed",
        _table(good),
        "## What shape explains",
        _shapes(good),
        "## Reverse flow before compression",
        _reverse(good),
        "## Along the veins",
        _axial(folder, good),
        "## Over breathing cycles",
        _cycles(folder, good, breaths),
        *(["## Not computed", "\n".join(failed)] if failed else []),
        "All numbers: [results.csv](results.csv).",
    ]
    path = folder / "report.md"
    replace_file(path, ("\n\n".join(parts) + "\n").encode())
    return path


def _row(f: Finding) -> dict[str, float | str]:
    return {
        "subject": f.subject, "state": f.state, "volume_m3": f.volume, "flow_m3_s": f.flow, "wss_mean_Pa": f.mean,
        "wss_min_Pa": f.smallest, "wss_max_Pa": f.largest, "wss_uniform_tube_Pa": f.uniform, "failure": f.failure,
    }  # fmt: skip


def by_state(found: Sequence[Finding]) -> dict[int, dict[str, Finding]]:
    """Return subject -> state -> finding."""
    table: dict[int, dict[str, Finding]] = {}
    for f in found:
        table.setdefault(f.subject, {})[f.state] = f
    return table


def _table(found: Sequence[Finding]) -> str:
    said = PRINTED["tawss_Pa"]
    rows = []
    for subject, states in by_state(found).items():
        k = subject - 1
        cells = [_three(said, "before", k), _values(states.get("before")), _three(said, "after", k)]
        rows.append((str(subject), *cells, *(_values(states.get(shape)) for shape in _shapes_of(found))))
    head = (
        "subject",
        "before, printed",
        "before, computed",
        "after, printed",
        *(f"after, {shape}" for shape in _shapes_of(found)),
    )
    return markdown_table(head, rows) + "\nMean (min to max), Pa. Printed: over the cycle; computed: at the mean flow."


def _shapes_of(found: Sequence[Finding]) -> list[str]:
    return [shape for shape in SHAPES if any(f.state == shape for f in found)]


def _three(printed: dict[str, Any], when: str, k: int) -> str:
    return f"{printed[f'mean_{when}'][k]:.3f} ({printed[f'min_{when}'][k]:.3f} to {printed[f'max_{when}'][k]:.3f})"


def _values(f: Finding | None) -> str:
    return f"{f.mean:.3f} ({f.smallest:.3f} to {f.largest:.3f})" if f else "-"


def _shapes(found: Sequence[Finding]) -> str:
    """Return what one and the same shape in all subjects makes of the rises, and of TAWSS after compression."""
    printed = PRINTED["tawss_Pa"]
    table = {k: s for k, s in by_state(found).items() if "before" in s}
    rows = []
    for shape in _shapes_of(found):
        pairs = {k: (s["before"].mean, s[shape].mean) for k, s in table.items() if shape in s}
        over = [s[shape].mean / s[shape].uniform for s in table.values() if shape in s]
        rises = np.array([100 * (after / before - 1) for before, after in pairs.values()])
        ratio, correlated = agreement({k: after for k, (_, after) in pairs.items()}, printed["mean_after"])
        rows.append((shape, f"{rises.mean():.0f}", f"{np.median(rises):.0f}", f"{rises.min():.0f} to {rises.max():.0f}",
                     f"{np.sum(rises > 0)} of {len(rises)}", f"{ratio:.2f}", f"{correlated:.2f}",
                     f"{np.mean(over):.3f}"))  # fmt: skip
    said = PRINTED["tawss_rise_percent"]
    ratios = 100 * (np.array(printed["mean_after"]) / np.array(printed["mean_before"]) - 1)
    rows.append(("printed", f"{said['mean']:g}", f"{said['median']:g}", f"{said['min']:g} to {said['max']:g}",
                 f"{np.sum(ratios > 0)} of {len(ratios)}", "1", "1", "-"))  # fmt: skip
    head = ("shape after", "rise, mean %", "median %", "range %", "rising", "TAWSS after over printed, geometric mean",
            "correlation with printed, logarithms", "TAWSS after over that of a uniform round tube")  # fmt: skip
    ratio, correlated = agreement({k: s["before"].mean for k, s in table.items()}, printed["mean_before"])
    return markdown_table(head, rows) + (
        "\nEach line has one shape in all subjects: numbers of two lines do not belong together. TAWSS before over "
        f"printed, geometric mean: {ratio:.2f}; correlation {correlated:.2f}. The mean of the printed rises is "
        f"{ratios.mean():.0f} % when computed from the printed TAWSS. What volume and flow do not explain is the shape "
        "along the axis, which is not printed: mean shear goes with the mean of A^(-3/2), to which narrow places "
        "contribute most."
    )


def agreement(computed: Mapping[int, float], printed: Sequence[float]) -> tuple[float, float]:
    """Return computed over printed, the geometric mean over subjects, and the correlation of their logarithms."""
    logs = np.log([[value, printed[subject - 1]] for subject, value in computed.items()])
    correlated = float(np.corrcoef(logs.T)[0, 1]) if len(logs) > 1 else float("nan")
    return float(np.exp(np.mean(logs[:, 0] - logs[:, 1]))), correlated


def _reverse(found: Sequence[Finding]) -> str:
    """Return what reverse flow before compression makes of TAWSS and its rise."""
    printed, table = PRINTED["tawss_Pa"], by_state(found)
    tried = {"none": "before", **{f"{size:g} of the mean flow": reversed_state(size) for size in BACKWARD}}
    rows, nearest = [], []
    for subject in PRINTED["reverse_flow_before"]:
        said = [printed[f"mean_{when}"][subject - 1] for when in ("before", "after")]
        states = table.get(subject, {})
        known = {name: states[state].mean for name, state in tried.items() if {state, "round"} <= set(states)}
        rises = {name: 100 * (states["round"].mean / value - 1) for name, value in known.items()}
        rise = 100 * (said[1] / said[0] - 1)
        rows += [(f"{subject}, {name}", f"{value:.3f}", f"{said[0]:.3f}", f"{rises[name]:.0f}", f"{rise:.0f}")
                 for name, value in known.items()]  # fmt: skip
        gaps = {abs(value - said[0]): name for name, value in known.items()}
        if gaps:
            name = gaps[min(gaps)]
            nearest.append(f"subject {subject}: {name}, with a rise of {rises[name]:.0f} % (printed {rise:.0f} %)")
    head = ("subject, largest flow back", "TAWSS before, Pa", "printed", "rise, round after, %", "printed")
    listed = " and ".join(map(str, PRINTED["reverse_flow_before"]))
    return (
        f"The study finds the blood of subjects {listed} flowing back for a part of the breath before compression, but "
        "prints no size of it. TAWSS is then that of the mean size of the flow, which exceeds the size of the mean "
        "flow. The synthetic breath, swinging more around the printed mean flow:\n\n"
        + markdown_table(head, rows)
        + "\nReverse flow raises TAWSS before compression, and so lowers the rise. What comes nearest to the printed "
        f"TAWSS: {'; '.join(nearest)}."
    )


def _axial(folder: Path, found: Sequence[Finding]) -> str:
    panels = {
        state: [
            Line(
                f"subject {f.subject}",
                np.array(f.velocity) / np.mean(f.velocity),
                np.array(f.shear) / np.mean(f.shear),
                ".",
            )
            for f in found
            if f.state == state and f.subject <= 5
        ]
        for state in ("before", *SHAPES)
    }
    axes = Shown("mean velocity over its mean along the vein", "1"), Shown("wall shear stress over its mean", "1")
    lines({state: drawn for state, drawn in panels.items() if drawn}, axes, folder / "axial.png")
    values = ", ".join(
        f"{correlation(chosen):.3f} {state}"
        for state in ("before", *SHAPES)
        if (chosen := [f for f in found if f.state == state])
    )
    return (
        "![shear over velocity](axial.png)\n\nSubjects 1 to 5, in windows along the vein. "
        "Correlation of the circumferential mean of the wall shear stress with the mean velocity of the section: "
        f"{values}. The study finds them nearly proportional; in developed flow shear goes with the velocity to the "
        "power 3/2, which over this range of areas looks like a line."
    )


def _cycles(folder: Path, found: Sequence[Finding], breaths: Outcome) -> str:
    if breaths.failure or breaths.run is None:
        return f"Not computed: {breaths.failure}"
    cycles = over_cycles(breaths.run)
    lines(
        {"mean over the wall, last cycle": [Line(f"subject {PULSATILE}", cycles.times, cycles.mean_shear)]},
        (Shown("time in the cycle", "s"), Shown("wall shear stress", "Pa")),
        folder / "cycle.png",
    )
    tawss, osi = (cycles.wall.point_data[name] for name in ("TAWSS_Pa", "OSI_1"))
    reference = [f.mean for f in found if (f.subject, f.state) == (PULSATILE, "before")]
    steady_text = f"; steady flow at the mean flow gives {reference[0]:.3f} Pa" if reference else ""
    state = "periodic" if cycles.changes[-1] < SAME else f"not periodic within {SAME:.0%}"
    changes = ", ".join(f"{100 * change:.2g} %" for change in cycles.changes)
    return (
        f"![wall shear stress over a cycle](cycle.png)\n\nSubject {PULSATILE} before compression, over {CYCLES} cycles "
        "whose flow is the ensemble mean of noisy breaths found in a synthetic signal: "
        f"{state}, changes of the wall shear stress from cycle to cycle {changes}. "
        f"TAWSS: mean {mean_over(cycles.wall, 'TAWSS_Pa'):.3f}, {tawss.min():.3f} to {tawss.max():.3f} Pa"
        f"{steady_text}. "
        f"OSI: mean {mean_over(cycles.wall, 'OSI_1'):.4f}, at most {osi.max():.4f}."
    )
