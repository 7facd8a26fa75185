"""Wall shear stress in ten veins with rigid walls before and after compression: what do volume, flow and shape explain?

Repeats chapter 5 of the source study. Its vein shapes are not available: synthetic veins have the printed volumes and
mean flows, and after compression one of three shapes of the same areas.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from math import pi
from pathlib import Path
from typing import Any, NamedTuple

import ngsolve as ng
import numpy as np
from ngfsi_geometry.lofted import LoftedMesh, LoftedVein
from numpy.typing import NDArray

from ngfsi.config.functions import FlowConstant, FlowWaveform, Waveform
from ngfsi.errors import NgfsiError
from ngfsi.identify.waveform import ensemble
from ngfsi.materials import Newtonian, load_set
from ngfsi.measure.wall import Wall
from ngfsi.mesh.domain import Domain
from ngfsi.outlines.outline import Outline
from ngfsi.report.tables import markdown_table
from ngfsi.report.terminal import console
from ngfsi.run.rigid import SAME, Cycle, pulsatile, rigid_case, steady
from ngfsi.store.disk import explained, replace_file
from ngfsi.store.table import write_rows
from ngfsi.study import workers
from ngfsi.units import to_si
from ngfsi_studies.figures import Line, lines
from ngfsi_studies.source import tables

Array = NDArray[np.float64]

PRINTED = tables("rigid_veins")
LENGTH = to_si(PRINTED["segment_length_mm"], "mm")
SECTIONS, WINDOWS = 11, 10
SHAPES = {"round": (1.0, 1.0), "oval": (2.0, 1.0), "collapsed": (3.0, 0.6)}
"""Shape -> ratio of its axes, and thickness in the middle over that of an ellipse."""
BEFORE = (1.2, 1.0)
SEED = 5
PULSATILE = 7
"""Subject computed over breathing cycles, too: the one of the largest flow."""


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
    """Steady flow at the printed mean flow in one vein: wall shear stress (Pa) over the segment, without the inlet.

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


def find(subject: int, state: str, level: Level) -> Finding:
    """Compute the steady flow of one vein; `state`: before, or a shape after compression."""
    when = "before" if state == "before" else "after"
    volume = to_si(PRINTED["vein_volume_mm3"][when][subject - 1], "mm3")
    flow = to_si(PRINTED["flow_ml_s"][when][subject - 1], "ml_s")
    geometry = vein(subject, volume, BEFORE if state == "before" else SHAPES[state], level.mesh)
    radius = np.sqrt(volume / LENGTH / pi)
    uniform = 4 * blood().viscosity * flow / (pi * radius**3)
    try:
        system = steady(rigid_case(geometry, blood(), FlowConstant(value=flow), order=level.order))
    except NgfsiError as error:
        return Finding(subject, state, volume, flow, uniform=uniform, failure=str(error))
    wall = Wall(system)
    wall.refresh()
    edges = np.linspace(0, LENGTH, WINDOWS + 1)
    heights = tuple(map(float, (edges[1:] + edges[:-1]) / 2))
    size = ng.Norm(wall.shear)
    shear = tuple(_mean(wall, size, a, b) for a, b in pairwise(edges))
    sample = wall.sample(2)
    inside = np.linalg.norm(sample.shear, axis=1)[sample.points[:, 2] > 0]
    velocity = tuple(float(flow / area) for area in geometry.areas(np.array(heights)))
    return Finding(
        subject, state, volume, flow, _mean(wall, size, 0.0, LENGTH), float(inside.min()), float(inside.max()), uniform,
        heights, velocity, shear,
    )  # fmt: skip


def _mean(wall: Wall, field: Any, low: float, high: float) -> float:
    """Return the mean of a field over the part of the wall between two heights (m)."""
    part = ng.IfPos((ng.z - low) * (high - ng.z), 1.0, 0.0)
    return wall.integral(field * part) / wall.integral(part)


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


def over_cycles(level: Level) -> Cycle:
    """Compute the chosen subject before compression over breathing cycles."""
    flow = breathing(to_si(PRINTED["flow_ml_s"]["before"][PULSATILE - 1], "ml_s"))
    geometry = vein(PULSATILE, to_si(PRINTED["vein_volume_mm3"]["before"][PULSATILE - 1], "mm3"), BEFORE, level.mesh)
    period = flow.times[-1]
    case = rigid_case(geometry, blood(), flow, order=level.order, step=period / level.steps, end=period)
    return pulsatile(case, Domain.build(geometry))


def study(level: str, folder: Path, quiet: bool = False) -> Path:
    """Compute all veins and write report.md, results.csv and figures; return the report's path."""
    with explained(folder, "made"):
        folder.mkdir(parents=True, exist_ok=True)
    chosen, found = LEVELS[level], []
    states = list(product(range(1, len(PRINTED["flow_ml_s"]["before"]) + 1), ("before", *SHAPES)))
    with workers() as pool:
        cycle = pool.submit(over_cycles, chosen)
        for f in pool.map(find, *zip(*states, strict=True), [chosen] * len(states)):
            found.append(f)
            if not quiet:
                console().print(f"subject {f.subject}, {f.state}: {f.failure or f'{f.mean:.3f} Pa'}")
        return write_report(level, folder, found, cycle.result())


def write_report(level: str, folder: Path, found: Sequence[Finding], cycle: Cycle) -> Path:
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
        "computed and left out of the averages.",
        "## TAWSS computed and printed",
        _table(good),
        "## What shape explains",
        _shapes(good),
        "## Along the veins",
        _axial(folder, good),
        "## Over breathing cycles",
        _cycles(folder, good, cycle),
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
    printed = PRINTED["tawss_Pa"]
    rows = []
    for subject, states in by_state(found).items():
        k = subject - 1
        cells = [_three(printed, "before", k), _values(states.get("before")), _three(printed, "after", k)]
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
    printed = PRINTED["tawss_Pa"]
    table = {k: s for k, s in by_state(found).items() if "before" in s}
    rows = []
    for shape in _shapes_of(found):
        pairs = {k: s[shape].mean / s["before"].mean for k, s in table.items() if shape in s}
        over = [s[shape].mean / s[shape].uniform for s in table.values() if shape in s]
        rises = 100 * (np.array(list(pairs.values())) - 1)
        rows.append((shape, f"{rises.mean():.0f}", f"{np.median(rises):.0f}", f"{rises.min():.0f} to {rises.max():.0f}",
                     f"{np.sum(rises > 0)} of {len(rises)}", f"{np.mean(over):.3f}"))  # fmt: skip
    said = PRINTED["tawss_rise_percent"]
    ratios = 100 * (np.array(printed["mean_after"]) / np.array(printed["mean_before"]) - 1)
    rows.append(("printed", f"{said['mean']:g}", f"{said['median']:g}", f"{said['min']:g} to {said['max']:g}",
                 f"{np.sum(ratios > 0)} of 10", "-"))  # fmt: skip
    head = ("shape after", "rise, mean %", "median %", "range %", "rising", "mean over that of a uniform round tube")
    before = {k: s["before"].mean for k, s in table.items()}
    logs = np.log([[before[k], printed["mean_before"][k - 1]] for k in before])
    after = {k: s["oval"].mean for k, s in table.items() if "oval" in s}
    later = np.log([[after[k], printed["mean_after"][k - 1]] for k in after])
    return markdown_table(head, rows) + (
        f"\nComputed over printed TAWSS, geometric mean: {np.exp(np.mean(logs[:, 0] - logs[:, 1])):.2f} before, "
        f"{np.exp(np.mean(later[:, 0] - later[:, 1])):.2f} after (oval). Correlation of the logarithms over the "
        f"subjects: {np.corrcoef(logs.T)[0, 1]:.2f} before, {np.corrcoef(later.T)[0, 1]:.2f} after. What "
        "volume and flow do not explain is the shape along the axis, which is not printed: mean shear goes with the "
        "mean of A^(-3/2), to which narrow places contribute most."
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
    labels = ("mean velocity over its mean along the vein [1]", "wall shear stress over its mean [1]")
    lines({state: drawn for state, drawn in panels.items() if drawn}, labels, folder / "axial.png")
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


def _cycles(folder: Path, found: Sequence[Finding], cycle: Cycle) -> str:
    lines(
        {"mean over the wall, last cycle": [Line(f"subject {PULSATILE}", cycle.times, cycle.mean_shear)]},
        ("time in the cycle [s]", "wall shear stress [Pa]"),
        folder / "cycle.png",
    )
    inside = cycle.points[:, 2] > 0
    tawss, osi = cycle.history.tawss[inside], cycle.history.osi[inside]
    reference = [f.mean for f in found if (f.subject, f.state) == (PULSATILE, "before")]
    steady_text = f"; steady flow at the mean flow gives {reference[0]:.3f} Pa" if reference else ""
    state = "periodic" if cycle.periodic else f"not periodic within {SAME:.0%}"
    changes = ", ".join(f"{100 * change:.2g} %" for change in cycle.changes)
    return (
        f"![wall shear stress over a cycle](cycle.png)\n\nSubject {PULSATILE} before compression, over cycles whose "
        "flow is the ensemble mean of noisy breaths found in a synthetic signal: "
        f"{state}, changes from cycle to cycle {changes}. "
        f"TAWSS at points of the wall: mean {tawss.mean():.3f}, {tawss.min():.3f} to {tawss.max():.3f} Pa"
        f"{steady_text}. "
        f"OSI: mean {osi.mean():.4f}, at most {osi.max():.4f}."
    )
