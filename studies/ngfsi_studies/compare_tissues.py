"""Mooney-Rivlin (M) against Neo-Hookean (N) tissue: how far do 25 mmHg on the calf close the vein?

Repeats the fluid-structure interaction of the source study and holds its printed results against the computed ones.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from ngfsi_geometry.calf import CalfSegment
from ngfsi_geometry.segment import MeshSettings

from ngfsi.case import Case, Discretisation, Loads, Materials, Output, Solver, TimeStepping
from ngfsi.case.case import Scheme
from ngfsi.config.functions import PressureRamp
from ngfsi.report.terminal import console
from ngfsi.store.disk import replace_file
from ngfsi.store.table import write_rows
from ngfsi.study import Outcome, run_cases
from ngfsi.units import MMHG
from ngfsi_studies import tissue_report as report
from ngfsi_studies.source import claims
from ngfsi_studies.tissue_figures import draw
from ngfsi_studies.tissue_findings import Finding, Row, find, numerical_errors, stored_row


class Variant(NamedTuple):
    """What is compared: title, parameter set of the tissue, lumen diameter [m]."""

    title: str
    tissue: str
    lumen: float = 11.1e-3


VARIANTS = {
    "m_s1": Variant("M, K 28.45 kPa", "mooney_rivlin_s1"),
    "n_likely": Variant("N, likely constants", "neo_hookean_likely"),
    "m_tenth": Variant("M / 10", "mooney_rivlin_tenth"),
    "m_s1_8mm": Variant("M, K 28.45 kPa, lumen 8 mm", "mooney_rivlin_s1", 8e-3),
    "n_likely_8mm": Variant("N, likely constants, lumen 8 mm", "neo_hookean_likely", 8e-3),
    "n_printed": Variant("N, printed constants", "neo_hookean_printed"),
    "m_s2": Variant("M, K 22.69 kPa", "mooney_rivlin_s2"),
    "m_s3": Variant("M, K 22.93 kPa", "mooney_rivlin_s3"),
    "m_s4": Variant("M, K 35.41 kPa", "mooney_rivlin_s4"),
}


class Level(NamedTuple):
    """How finely to compute: mesh, polynomial order, time step and end [s], which variants, time scheme and
    tolerance of Newton's method."""

    mesh: MeshSettings
    order: int
    step: float
    end: float
    variants: tuple[str, ...]
    scheme: Scheme = "bdf2"
    tolerance: float = Solver().tolerance


MAIN = ("m_s1", "n_likely")


def mesh(size: float, order: int, *, layered: bool = True) -> MeshSettings:
    """Return settings of meshes that differ in size alone, with hexahedra around the vein.

    Args:
        size: of the elements, as a multiple of 25 mm in the tissue and 3.2 mm at the vein.
        layered: whether the lumen's elements grow from the wall inwards.
    """
    count = max(2, round(3 / size))
    depths = np.arange(1, count) / count
    radii = 1 - (depths**1.5 if layered else depths)
    return MeshSettings(
        element="mixed",
        far_size=25e-3 * size,
        vein_size=3.2e-3 * size,
        axial_layers=max(2, round(6 / size)),
        lumen_radii=tuple(map(float, radii.round(3))),
        curving_order=order,
    )


LEVELS = {
    "demo": Level(mesh(2.0, 3), 3, 0.05, 1.0, MAIN),
    "paper": Level(mesh(1.5, 3), 3, 0.025, 1.5, tuple(VARIANTS), "sdirk4", 1e-4),
    "fine": Level(mesh(1.0, 3), 3, 0.0125, 1.0, MAIN, "sdirk4", 1e-4),
}
"""Few elements of order 3 are the cheapest way to errors of 0.1 % in area and 1 % in SAWSS (`discretisation.py`),
and few steps of fourth order that to the least error of SAWSS at every instant (`time_schemes.py`)."""


_COARSE = MeshSettings(
    element="mixed", far_size=40e-3, vein_size=4.4e-3, axial_layers=3, lumen_radii=(0.7,), curving_order=2
)
COARSE = Level(_COARSE, 2, 0.2, 1.0, MAIN[:1])
"""For studies of hundreds of runs, which measure its error themselves."""


def case(key: str, level: Level) -> Case:
    """Return the case of a variant."""
    variant = VARIANTS[key]
    return Case(
        name=key,
        geometry=CalfSegment(lumen_diameter=variant.lumen, mesh=level.mesh),
        materials=Materials.from_dict(
            {"tissue": {"set": variant.tissue}, "wall": {"set": "vein_wall_source"}, "fluid": {"set": "blood"}}
        ),
        loads=Loads(skin_pressure=PressureRamp(final=25 * MMHG, duration=1.0)),
        discretisation=Discretisation(order=level.order),
        time=TimeStepping(scheme=level.scheme, step=level.step, end=level.end),
        solver=Solver(tolerance=level.tolerance),
        output=Output(fields_every=round(0.25 / level.step)),
    )


def study(level: str, folder: Path, quiet: bool = False) -> Path:
    """Run the comparison at a level into a folder and return the path of the report."""
    chosen = LEVELS[level]
    outcomes = run_cases({key: case(key, chosen) for key in chosen.variants}, folder, quiet=quiet)
    return write_report(level, folder, outcomes, quiet=quiet)


def write_report(level: str, folder: Path, outcomes: Mapping[str, Outcome], *, quiet: bool = False) -> Path:
    """Write report.md and its figures from what became of the runs, and return its path."""
    found = {key: find(VARIANTS[key].title, outcome) for key, outcome in outcomes.items()}
    findings = {key: finding for key, finding in found.items() if finding}
    missing = {VARIANTS[key].title: outcomes[key].failure for key, finding in found.items() if finding is None}
    rows = [stored_row(key, finding) for key, finding in findings.items()]
    if rows:
        write_rows(folder / "results.csv", rows)
    path = folder / "report.md"
    replace_file(path, _text(level, findings, rows, missing, draw(findings, folder)).encode())
    if not quiet:
        console().print(report.terminal_table(rows))
    return path


def _text(
    level: str, findings: Mapping[str, Finding], rows: Sequence[Row], missing: Mapping[str, str], files: Any
) -> str:
    claimed = claims()
    shown = report.pattern_table(rows)
    return "\n".join(
        (
            f"# M against N tissue: a deep vein under 25 mmHg, level `{level}`\n",
            report.headline(rows, claimed, dict(zip("MN", MAIN, strict=True))),
            report.ROUND,
            report.results_table(rows, missing),
            *filter(None, [report.notes(findings.values(), missing)]),
            report.ABBREVIATIONS + "\n",
            "## Figures\n",
            report.pictures(files),
            "## The source's numbers\n",
            f"{claimed['citation']}. Computed values are those at the end of the ramp.\n",
            report.claims_table(rows, claimed, numerical_errors(level)),
            report.reasons(findings, claimed),
            *(["## The pattern of displacement and wall shear stress\n", shown] if shown else []),
            "## Costs\n",
            report.costs_table(findings.values()),
            f"## To repeat it\n\n    ngfsi study compare_tissues --level {level}\n",
            "`ngfsi run <run>/case.toml --output <folder>` repeats one run alone. Computed with\n",
            report.provenance(list(findings.values())),
        )
    )
