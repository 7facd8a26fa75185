"""Errors of the straight vein of `ngfsi bench` on several meshes: of loss of volume, SAWSS and largest wall shear.

    python -m ngfsi_studies.vein_accuracy FOLDER [MESH...]

The vein is clamped, in steady flow under 10 mmHg on the skin (`time.scheme = "static"`), so that errors are those of
space alone. The reference has elements of order 4 that are twelve times thinner at the ends than at mid-length, where
clamped tissue has its layers. With names of meshes, as in the table, these alone are computed, and the last of them is
the reference.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path

from ngfsi_geometry.segment import MeshSettings

from ngfsi.case import Case
from ngfsi.errors import unknown
from ngfsi.report.tables import markdown_table
from ngfsi.report.terminal import console
from ngfsi.store.stored import StoredRun
from ngfsi.study import run_cases
from ngfsi_studies.compare_tissues import mesh
from ngfsi_studies.speed import CASES

REFERENCE = "reference"


def cases() -> dict[str, Case]:
    """Return the vein on its meshes, by what these are."""
    plain, tetrahedra = CASES["vein"], CASES["vein-tetrahedra"]
    few, more = mesh(2.5, 3), mesh(2.5, 3).replace(axial_layers=6, end_refinement=6.0)
    at_ends = mesh(2.5, 3).replace(axial_layers=8, end_refinement=12.0)
    found = {"straight tetrahedra, order 2": tetrahedra}
    for order in (2, 3, 4):
        found[f"hexahedra, two layers, order {order}"] = _on(plain, few, order)
    for order in (3, 4):
        found[f"hexahedra, six layers, thin at the ends, order {order}"] = _on(plain, more, order)
    found[REFERENCE] = _on(plain, at_ends, 4)
    return {name: case.replace(**{"name": name.replace(",", "").replace(" ", "-"), "time.scheme": "static",
                                  "time.step": 0.1, "time.smallest_step": 0.1 / 64, "output.wall_every": 1000})
            for name, case in found.items()}  # fmt: skip


def _on(case: Case, elements: MeshSettings, order: int) -> Case:
    return case.replace(**{"geometry.mesh": elements.replace(curving_order=order), "discretisation.order": order})


def values(run: StoredRun) -> tuple[float, float, float, float]:
    """Return volume (m3), loss since t = 0, SAWSS and the largest wall shear stress (Pa) at the end."""
    volume = run.series["lumen_volume_m3"]
    return (float(volume[-1]), float(1 - volume[-1] / volume[0]), float(run.series["sawss_Pa"][-1]),
            float(run.series["wss_max_Pa"][-1]))  # fmt: skip


def table(runs: Mapping[str, StoredRun], reference: str = REFERENCE) -> str:
    """Return the errors of all runs against the reference, as Markdown."""
    exact = values(runs[reference])
    head = ("elements", "unknowns", "volume %", "loss of volume %", "SAWSS %", "largest wall shear %")
    cells = [
        (name, f"{run.manifest['unknowns']:,}",
         *(f"{100 * (found / right - 1):+.2f}" for found, right in zip(values(run), exact, strict=True)))
        for name, run in runs.items()
    ]  # fmt: skip
    return markdown_table(head, cells)


def main(folder: str, *names: str) -> None:
    """Compute and print the table.

    Raises:
        SystemExit: there is no mesh of that name, or the reference failed.
    """
    known = cases()
    if missing := [name for name in names if name not in known]:
        sys.exit(unknown("mesh", missing[0], known))
    found = run_cases({name: known[name] for name in names or known}, Path(folder))
    reference = [*found][-1]
    if failure := found[reference].failure:
        sys.exit(f"there are no errors without the reference, '{reference}': {failure}")
    console().print(table({name: one.run for name, one in found.items() if one.run and not one.failure}, reference))


if __name__ == "__main__":
    main(*sys.argv[1:])
