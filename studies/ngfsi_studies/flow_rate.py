"""Which flow and lumen would raise the wall shear stress as the source study prints it, and does coupling matter?

The losses of volume that the source prints raise it, at a constant flow, by about a quarter of the printed rises; the
rest must be blood that the shrinking vein expels itself, and profiles that had no time to develop. Both weigh the more,
the less blood flows in and the larger the lumen is. The calf is squeezed with four flows, two lumens and both tissues,
with two-way coupling and with one-way coupling, in which the tissue moves the blood, but the blood presses on the wall
with the pressure of its outlet alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from scipy.interpolate import PchipInterpolator

from ngfsi.analysis.decomposition import STAGES, narrowing
from ngfsi.case import Case
from ngfsi.config.functions import FlowConstant
from ngfsi.report.figures import stacked_bars
from ngfsi.report.tables import markdown_table
from ngfsi.store.table import write_rows
from ngfsi.study import Outcome, run_cases, write_page
from ngfsi.units import Shown, from_si, in_unit, to_si
from ngfsi_studies import compare_tissues
from ngfsi_studies.figures import Line, lines
from ngfsi_studies.source import claims, inferred_flow, tables
from ngfsi_studies.tissue_findings import SWING, Finding, find

Coupling = Literal["two_way", "one_way"]
TISSUES = {"M": "m_s1", "N": "n_likely"}
LUMENS = {11.1e-3: "", 8e-3: "_8mm"}
"""Diameter (m) -> end of the name of the variant in compare_tissues.py."""
SOURCE = 2.913e-6
"""Flow (m3/s) that the source most likely had; it prints none (`source.inferred_flow`)."""
PRINTED = "sawss_rise_percent"


class Level(NamedTuple):
    """How finely to compute: meshes and orders as of a level of compare_tissues.py, step (s)."""

    mesh: compare_tissues.Level
    step: float


FLOWS = (0.2e-6, 1e-6, SOURCE, 5e-6)
COARSE = compare_tissues.COARSE
_DEMO, _PAPER = (compare_tissues.LEVELS[name] for name in ("demo", "paper"))
LEVELS = {
    "demo": Level(COARSE._replace(mesh=COARSE.mesh.replace(vein_size=5e-3, lumen_radii=(0.85, 0.55))), 0.1),
    "paper": Level(_DEMO, 0.05),
    "fine": Level(_PAPER, 0.02),
}
FINER = {"demo": "paper", "paper": "fine"}
"""Level -> that whose mesh and step tell its numerical error."""


@dataclass(frozen=True)
class Point:
    """What is computed: tissue, lumen (m), flow (m3/s), coupling; `finer`: with mesh and step of the next level."""

    tissue: str
    lumen: float
    flow: float
    coupling: Coupling = "two_way"
    finer: bool = False

    @property
    def key(self) -> str:
        """Name of the run."""
        return "-".join([
            self.tissue.lower(), f"{from_si(self.lumen, 'mm'):g}mm", f"{from_si(self.flow, 'ml_s'):g}ml_s",
            self.coupling, *(["finer"] if self.finer else []),
        ])  # fmt: skip


def points(level: str) -> list[Point]:
    """Return what a level computes: one-way coupling and numerical errors in the larger lumen, at some flows."""
    found = [Point(*one) for one in product(TISSUES, LUMENS, FLOWS)]
    found += [Point(*one, coupling="one_way") for one in product(TISSUES, [max(LUMENS)], (FLOWS[0], SOURCE))]
    if level in FINER:
        found.append(Point("M", max(LUMENS), SOURCE, finer=True))
    return found


def case(point: Point, level: str) -> Case:
    """Return the case of a point."""
    chosen = LEVELS[FINER[level] if point.finer else level]
    tissue = compare_tissues.case(f"{TISSUES[point.tissue]}{LUMENS[point.lumen]}", chosen.mesh)
    changes = {
        "name": point.key,
        "loads.inlet_flow": FlowConstant(value=point.flow),
        "conditions.coupling": point.coupling,
        "time.step": chosen.step,
        "time.smallest_step": chosen.step / 64,
        "time.end": 1.0,
        "output.fields_every": 0,
        "output.wall_every": 1000,
    }
    return tissue.replace(**changes)


def study(level: str, folder: Path, quiet: bool = False) -> Path:
    """Run the study at a level into a folder and return the path of the report."""
    chosen = {point: case(point, level) for point in points(level)}
    outcomes = run_cases({point.key: one for point, one in chosen.items()}, folder, quiet=quiet)
    return write_report(level, folder, outcomes)


def write_report(level: str, folder: Path, outcomes: Mapping[str, Outcome]) -> Path:
    """Write report.md, its table as CSV and its figures from what became of the runs, and return its path."""
    findings = {
        point: finding for point in points(level) if (finding := find(point.key, outcomes[point.key])) is not None
    }
    shown = {point: finding for point, finding in findings.items() if not finding.failure}
    write_rows(folder / "flow_rate.csv", [_row(point, finding) for point, finding in shown.items()])
    _draw(shown, folder)
    parts = [
        f"# Flow, lumen and coupling: why SAWSS rises, level `{level}`\n",
        _answer(shown),
        "![Rise of SAWSS over the flow](rise.png)\n",
        "Rise of SAWSS since t = 0 in 1 s of compression, mean of its last "
        f"{SWING:g} s, over the flow at the inlet. Squares: one-way coupling. Dotted: printed by the source.\n",
        "![What the rise consists of](causes.png)\n",
        "M tissue, lumen 11.1 mm, end of the ramp: rise by cause, for each flow in ml/s.\n",
        "## All runs\n",
        _table(shown),
        "Rises are relative to the steady state at t = 0, (c - u)/u as the source prints it. Flow and lumen are "
        f"inputs; nothing was fitted. The source prints no flow: {inferred_flow():.3f} ml/s is inferred, the flow of "
        f"subject {tables('compare_tissues')['subject']} scaled by the areas of model and images.\n",
        "## Numerical error\n",
        _errors(shown),
    ]
    return write_page(folder, "flow_rate", level, parts, outcomes)


def _row(point: Point, finding: Finding) -> dict[str, float | str]:
    now = finding.ramp_end
    return {
        "tissue": point.tissue,
        "coupling": point.coupling,
        "mesh": "finer" if point.finer else "as the others",
        "lumen_diameter_m": point.lumen,
        "inlet_flow_m3_s": point.flow,
        "loss_1": now.loss,
        "sawss_start_Pa": finding.start_sawss,
        "rise_end_percent": now.rise,
        "rise_mean_percent": finding.mean_rise,
        **{f"{cause.replace(' ', '_')}_Pa": value for cause, value in now.parts.items()},
    }


def _answer(found: Mapping[Point, Finding]) -> str:
    printed, loss = claims()[PRINTED], claims()["volume_reduction_percent"]
    lines_of = []
    for tissue in TISSUES:
        alone = 100 * (narrowing(loss[tissue] / 100) - 1)
        said = [
            f"- **{tissue}**: the printed loss of {loss[tissue]:g} % raises SAWSS by {alone:.0f} % at a constant flow, "
            f"not by the printed {printed[tissue]:g} %."
        ]
        for lumen in LUMENS:
            flows, rises = _curve(found, tissue, lumen)
            needed = flow_for(flows, rises, printed[tissue]) if len(flows) > 1 else None
            shown = f"reached at {in_unit(needed, 'ml_s', '.2g')}" if needed else _out_of_reach(rises, printed[tissue])
            said.append(f"  - lumen {in_unit(lumen, 'mm')}, {printed[tissue]:g} %: {shown}.")
        lines_of += said
    return "\n".join([*lines_of, *_coupling(found)]) + "\n"


def _coupling(found: Mapping[Point, Finding]) -> list[str]:
    """Return what one-way coupling changes."""
    gaps = {
        point: abs(finding.mean_rise - found[two].mean_rise)
        for point, finding in found.items()
        if point.coupling == "one_way" and (two := Point(point.tissue, point.lumen, point.flow)) in found
    }
    if not gaps:
        return []
    worst = max(gaps, key=lambda point: gaps[point])
    rise = found[Point(worst.tissue, worst.lumen, worst.flow)].mean_rise
    where = f"{worst.tissue}, {in_unit(worst.lumen, 'mm')}, {in_unit(worst.flow, 'ml_s')}"
    return [
        f"- **One-way coupling** changes the mean rise by {gaps[worst]:.2g} percentage points at most ({where}, where "
        f"two-way coupling gives {rise:.0f} %)."
    ]


def _curve(
    found: Mapping[Point, Finding], tissue: str, lumen: float, coupling: Coupling = "two_way"
) -> tuple[list[float], list[float]]:
    """Return increasing flows (m3/s) and the mean rises (percent) of one tissue and lumen."""
    chosen = [p for p in found if (p.tissue, p.lumen, p.coupling, p.finer) == (tissue, lumen, coupling, False)]
    chosen.sort(key=lambda point: point.flow)
    return [point.flow for point in chosen], [found[point].mean_rise for point in chosen]


def flow_for(flows: Sequence[float], rises: Sequence[float], wanted: float) -> float | None:
    """Return the flow at which a rise has a value, between given points.

    What the vein expels hardly depends on what flows in, so that the rise is nearly linear in 1 / flow.

    Args:
        flows: increasing.
        rises: of each, falling.
        wanted: the value.

    Returns:
        None where it is outside of the given rises.
    """
    if not min(rises) <= wanted <= max(rises):
        return None
    return float(1 / PchipInterpolator(rises[::-1], 1 / np.array(flows[::-1]))(wanted))


def _out_of_reach(rises: Sequence[float], wanted: float) -> str:
    if not rises:
        return "not computed"
    side = "above" if wanted > max(rises) else "below"
    return f"{side} all that was computed, {min(rises):.0f} to {max(rises):.0f} %"


def _draw(found: Mapping[Point, Finding], folder: Path) -> None:
    printed = claims()[PRINTED]
    panels = {}
    for tissue in TISSUES:
        drawn = []
        for coupling, style in (("two_way", "o-"), ("one_way", "s")):
            for lumen in LUMENS:
                flows, rises = _curve(found, tissue, lumen, coupling)  # type: ignore[arg-type]
                label = f"{in_unit(lumen, 'mm')}, {coupling.replace('_', '-')}"
                if flows:
                    drawn.append(Line(label, flows, [to_si(rise, "percent") for rise in rises], style))
        wanted = to_si(printed[tissue], "percent")
        drawn.append(Line(f"printed, {in_unit(wanted, 'percent')}", [FLOWS[0], FLOWS[-1]], [wanted] * 2, ":"))
        panels[f"{tissue} tissue"] = drawn
    rise = Shown("rise of SAWSS", "percent", "of t = 0")
    lines(panels, (Shown("inflow", "ml_s"), rise), folder / "rise.png", log=(True, True))
    chosen = {
        f"{from_si(point.flow, 'ml_s'):g}": finding
        for point, finding in found.items()
        if (point.tissue, point.lumen, point.coupling, point.finer) == ("M", max(LUMENS), "two_way", False)
    }
    parts: dict[str, dict[str, float]] = {cause: {} for cause in STAGES}
    for name, finding in chosen.items():
        for cause in parts:
            parts[cause][name] = finding.ramp_end.parts[cause] / finding.start_sawss
    stacked_bars(parts, rise, folder / "causes.png")


def _table(found: Mapping[Point, Finding]) -> str:
    head = ("run", "lumen mm", "inflow ml/s", "coupling", "loss %", "SAWSS t = 0, Pa", "rise, mean %", "rise, end %",
            "narrowing %", "squeeze flow %", "shape %", "profile %")  # fmt: skip
    rows = []
    for point, finding in found.items():
        fractions = [100 * finding.ramp_end.parts[cause] / finding.start_sawss for cause in STAGES]
        rows.append((
            f"{point.tissue}{', finer' if point.finer else ''}", f"{from_si(point.lumen, 'mm'):g}",
            f"{from_si(point.flow, 'ml_s'):g}", point.coupling.replace("_", "-"), f"{100 * finding.ramp_end.loss:.1f}",
            f"{finding.start_sawss:.4f}", f"{finding.mean_rise:.0f}", f"{finding.ramp_end.rise:.0f}",
            *(f"{fraction:.0f}" for fraction in fractions),
        ))  # fmt: skip
    return markdown_table(head, rows)


def _errors(found: Mapping[Point, Finding]) -> str:
    """Return how far the runs with the next level's mesh and step are."""
    rows: list[tuple[str, ...]] = []
    for point, finer in found.items():
        if point.finer and (coarse := found.get(Point(point.tissue, point.lumen, point.flow))):
            where = f"{point.tissue}, {in_unit(point.lumen, 'mm')}, {in_unit(point.flow, 'ml_s')}"
            pairs = {
                "loss %": [100 * one.ramp_end.loss for one in (finer, coarse)],
                "mean SAWSS over that at t = 0": [1 + one.mean_rise / 100 for one in (finer, coarse)],
                "the same at the end": [one.ramp_end.sawss_ratio for one in (finer, coarse)],
            }
            rows += [(where, what, f"{two:.3f}", f"{one:.3f}", f"{100 * (two / one - 1):+.1f}")
                     for what, (one, two) in pairs.items()]  # fmt: skip
    if not rows:
        return "Not computed at this level.\n"
    head = ("run", "quantity", "here", "with mesh and step of the next level", "difference %")
    return markdown_table(head, rows)
