"""What `ngfsi run --refine` gains: on layers of the clamped vein, on tetrahedra of it, and on the calf.

    python -m ngfsi_studies.vein_refinement FOLDER [CASE...]

The vein of `ngfsi bench` is clamped and in steady flow as in `vein_accuracy`, with few elements of second order in the
section. Its layers are held against even ones; the reference has the same section and order, and 16 layers that are
twenty times thinner at the ends, so that errors are those of the layers. Its curved tetrahedra are held against the
reference of `vein_accuracy`, the calf on the coarse mesh of `compare_tissues` against the mesh of its level `demo`.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from ngfsi_geometry.external import ExternalMesh
from ngfsi_geometry.segment import MeshSettings

from ngfsi.case import Case
from ngfsi.errors import unknown
from ngfsi.mesh.domain import Domain
from ngfsi.report.terminal import console
from ngfsi.run.computation import finished
from ngfsi.run.refine import refine
from ngfsi.store.export import of_domain, write
from ngfsi.store.stored import StoredRun
from ngfsi_studies import compare_tissues
from ngfsi_studies.speed import CASES
from ngfsi_studies.vein_accuracy import REFERENCE, cases, table

Runs = dict[str, StoredRun]
SECTION = MeshSettings(element="mixed", far_size=25e-3, vein_size=5e-3, axial_layers=2, lumen_radii=(0.7,),
                       curving_order=2)  # fmt: skip
EVEN, TIMES = (2, 4, 6, 8, 10), 3
"""Numbers of even layers, and how often those of the first are refined."""


def case(**mesh: Any) -> Case:
    """Return the vein on layers that differ from those of `SECTION`."""
    elements = SECTION.replace(**mesh)
    return CASES["vein"].replace(**{"geometry.mesh": elements, "time.scheme": "static", "time.step": 0.1,
                                    "time.smallest_step": 0.1 / 64, "output.wall_every": 1000})  # fmt: skip


def calf_at_rest(level: compare_tissues.Level) -> Case:
    """Return the calf with M tissue at rest under 25 mmHg, on the mesh of a level."""
    return compare_tissues.case("m_s1", level).replace(**{
        "time.scheme": "static", "time.step": 0.25, "time.smallest_step": 0.25 / 64, "time.end": 1.0,
        "output.fields_every": 0, "output.wall_every": 1000,
    })  # fmt: skip


def layers(home: Path) -> Runs:
    """Return the vein on even and on refined layers."""
    runs = {f"{n} even layers": finished(case(axial_layers=n), home / f"even-{n}", quiet=True) for n in EVEN}
    for number, run in enumerate(refine(runs[f"{EVEN[0]} even layers"], TIMES, quiet=True), start=1):
        count = run.case.geometry.mesh.axial_layers
        runs[f"{count} layers, refinement {number}"] = run
    runs[REFERENCE] = finished(case(axial_layers=16, end_refinement=20.0), home / REFERENCE, quiet=True)
    return runs


def tetrahedra(home: Path) -> Runs:
    """Return the vein on curved tetrahedra of a file, on those that refinement bisects, and with all bisected."""
    plain, file = case(element="tetrahedron"), home / "tetrahedra.msh"
    if not file.exists():
        home.mkdir(parents=True, exist_ok=True)
        write(of_domain(Domain.build(plain.geometry)), file, "gmsh")
    given = plain.replace(geometry=ExternalMesh(file=str(file.absolute()), unit="m"))
    runs, even = _refined(given, "tetrahedra", home, cases()[REFERENCE], 2), given
    for times in (1, 2):
        every = np.ones(Domain.build(even.geometry).mesh.ne, dtype=bool)
        even = even.replace(geometry=even.geometry.refined(every, (home / f"even-{times}.msh").absolute()))
        runs[f"tetrahedra, all cut in two, times {times}"] = finished(even, home / f"even-{times}", quiet=True)
    return runs


def calf(home: Path) -> Runs:
    """Return the calf on coarse layers, and on those that refinement halves."""
    coarse, right = (calf_at_rest(level) for level in (compare_tissues.COARSE, compare_tissues.LEVELS["demo"]))
    return _refined(coarse, "coarse calf", home, right, 1)


def _refined(given: Case, name: str, home: Path, right: Case, times: int) -> Runs:
    runs = {name: finished(given, home / "given", quiet=True)}
    for number, run in enumerate(refine(runs[name], times, quiet=True), start=1):
        runs[f"{name}, refinement {number}"] = run
    return runs | {REFERENCE: finished(right, home / REFERENCE, quiet=True)}


REFINED: dict[str, Callable[[Path], Runs]] = {"layers": layers, "tetrahedra": tetrahedra, "calf": calf}


def main(folder: str, *names: str) -> None:
    """Compute what is not there yet, and print the tables.

    Raises:
        SystemExit: there is no case of that name.
    """
    if missing := [name for name in names if name not in REFINED]:
        sys.exit(unknown("case", missing[0], REFINED))
    for name in names or REFINED:
        console().print(table(REFINED[name](Path(folder) / name)))


if __name__ == "__main__":
    main(*sys.argv[1:])
