"""Errors of the straight vein of `ngfsi bench` on layers that `ngfsi run --refine` halves, and on even ones.

    python -m ngfsi_studies.vein_refinement FOLDER

Clamped and in steady flow as in `vein_accuracy`, with few elements of second order in the section. The reference has
the same section and order, and 16 layers that are twenty times thinner at the ends: errors are those of the layers.
"""

from __future__ import annotations

import sys
from pathlib import Path

from ngfsi_geometry.segment import MeshSettings

from ngfsi.case import Case
from ngfsi.report.terminal import console
from ngfsi.run.computation import finished
from ngfsi.run.refine import refine
from ngfsi_studies.speed import CASES
from ngfsi_studies.vein_accuracy import REFERENCE, table

SECTION = MeshSettings(element="mixed", far_size=25e-3, vein_size=5e-3, axial_layers=2, lumen_radii=(0.7,),
                       curving_order=2)  # fmt: skip
EVEN, TIMES = (2, 4, 6, 8, 10), 3
"""Numbers of even layers, and how often those of the first are refined."""


def case(**mesh: float) -> Case:
    """Return the vein on layers that differ from those of `SECTION`."""
    elements = SECTION.replace(**mesh)
    return CASES["vein"].replace(**{"geometry.mesh": elements, "time.scheme": "static", "time.step": 0.1,
                                    "time.smallest_step": 0.1 / 64, "output.wall_every": 1000})  # fmt: skip


def main(folder: str) -> None:
    """Compute what is not there yet, and print the table."""
    home = Path(folder)
    runs = {f"{n} even layers": finished(case(axial_layers=n), home / f"even-{n}", quiet=True) for n in EVEN}
    for number, run in enumerate(refine(runs[f"{EVEN[0]} even layers"], TIMES, quiet=True), start=1):
        layers = run.case.geometry.mesh.axial_layers
        runs[f"{layers} layers, refinement {number}"] = run
    runs[REFERENCE] = finished(case(axial_layers=16, end_refinement=20.0), home / REFERENCE, quiet=True)
    console().print(table(runs))


if __name__ == "__main__":
    main(*sys.argv[1:])
