"""Errors of the straight vein of `ngfsi bench` on several meshes, and what a step costs: of loss of volume, SAWSS and
largest wall shear.

    python -m ngfsi_studies.vein_accuracy FOLDER [MESH...]

The vein is clamped, in steady flow under 10 mmHg on the skin (`time.scheme = "static"`), so that errors are those of
space alone. The reference has elements of order 4 that are twelve times thinner at the ends than at mid-length, where
clamped tissue has its layers. With names of meshes, as in the table, these alone are computed, and the last of them is
the reference. A step's seconds, of a processor, are the mean of the first 5 of 20 steps of backward Euler to the same
load, with the factors that they need. The figure is FOLDER/vein_accuracy.png.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from itertools import chain
from pathlib import Path

from ngfsi_geometry.segment import MeshSettings

from ngfsi.case import Case
from ngfsi.errors import unknown
from ngfsi.report.figures import Convergence, convergence
from ngfsi.report.tables import markdown_table
from ngfsi.report.terminal import console
from ngfsi.store.stored import StoredRun
from ngfsi.study import run_cases
from ngfsi.units import Shown
from ngfsi_studies import linear_solvers
from ngfsi_studies.compare_tissues import mesh
from ngfsi_studies.speed import CASES

REFERENCE = "reference"
FIGURE = "vein_accuracy.png"
TIMED = 5
"""Number of steps whose seconds are taken."""
WANTED = 0.01
"""Error of loss and SAWSS that is drawn."""
OTHERS = {"svMultiPhysics, 23,600 tetrahedra": 1.2, "svMultiPhysics, 290,000 tetrahedra": 20.0}
"""Seconds of a processor a step that stabilised elements of first order took for a vessel with wall; its errors are not
known."""


def families() -> dict[str, dict[str, Case]]:
    """Return the vein, as `ngfsi bench` runs it, on its meshes, by kind of elements and by what they are."""
    plain, few = CASES["vein"], mesh(2.5, 3)
    six, ten, sixteen = (
        few.replace(axial_layers=n, end_refinement=thin) for n, thin in ((6, 6.0), (10, 12.0), (16, 20.0))
    )
    finer = mesh(1.0, 3).replace(axial_layers=16, end_refinement=20.0)
    tetrahedra = {
        "six layers, thin at the ends": six,
        "ten layers, thinner at the ends": ten,
        "sixteen layers, thinnest at the ends": sixteen,
        "sixteen layers, thinnest at the ends, finer section": finer,
    }
    straight = "straight tetrahedra, order 2"
    found = {straight: {straight: CASES["vein-tetrahedra"]}}
    found["tetrahedra, order 2"] = {
        f"tetrahedra, {name}, order 2": _on(plain, elements.replace(element="tetrahedron"), 2)
        for name, elements in tetrahedra.items()
    }
    layers = {"two layers": few, "six layers, thin at the ends": six, "ten layers, thinner at the ends": ten,
              "sixteen layers, thinnest at the ends": sixteen}  # fmt: skip
    for order, count in ((2, 4), (3, 2), (4, 2)):
        found[f"hexahedra, order {order}"] = {
            f"hexahedra, {name}, order {order}": _on(plain, elements, order)
            for name, elements in list(layers.items())[:count]
        }
    return found


def cases() -> dict[str, Case]:
    """Return the vein in steady flow on its meshes, by what these are."""
    at_ends = mesh(2.5, 3).replace(axial_layers=8, end_refinement=12.0)
    found = dict(chain.from_iterable(family.items() for family in families().values()))
    found[REFERENCE] = _on(CASES["vein"], at_ends, 4)
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


def errors(run: StoredRun, reference: StoredRun) -> tuple[float, ...]:
    """Return the relative errors of volume, loss, SAWSS and largest wall shear stress."""
    return tuple(found / right - 1 for found, right in zip(values(run), values(reference), strict=True))


def table(runs: Mapping[str, StoredRun], reference: str = REFERENCE, seconds: Mapping[str, float] | None = None) -> str:
    """Return the errors of all runs against the reference, and the seconds of a step, as Markdown."""
    head = ("elements", "unknowns", "volume %", "loss of volume %", "SAWSS %", "largest wall shear %")
    cells = {
        name: (name, f"{run.manifest['unknowns']:,}",
               *(f"{100 * error:+.2f}" for error in errors(run, runs[reference])))
        for name, run in runs.items()
    }  # fmt: skip
    if seconds is None:
        return markdown_table(head, list(cells.values()))
    steps = {name: f"{seconds[name]:.3g}" if name in seconds else "" for name in cells}
    return markdown_table((*head, "a step (s)"), [(*row, steps[name]) for name, row in cells.items()])


def draw(runs: Mapping[str, StoredRun], seconds: Mapping[str, float], reference: str, path: Path) -> None:
    """Draw the errors of loss and SAWSS over the seconds of a step, a line for each kind of elements."""
    panels = {}
    for title, number in (("error of the loss of volume", 1), ("error of the SAWSS", 2)):
        panels[title] = [
            Convergence(kind, [seconds[name] for name in found],
                        [abs(errors(runs[name], runs[reference])[number]) for name in found])
            for kind, family in families().items()
            if (found := [name for name in family if name in seconds and name in runs and name != reference])
        ]  # fmt: skip
    convergence(panels, path, (Shown("CPU time of a step", "s"), Shown("error", "percent")),
                dict.fromkeys(panels, WANTED), OTHERS)  # fmt: skip


def main(folder: str, *names: str) -> None:
    """Compute and print the table, and draw the figure.

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
    runs = {name: one.run for name, one in found.items() if one.run and not one.failure}
    timed = {name: case for family in families().values() for name, case in family.items() if name in runs}
    seconds = {name: linear_solvers.step_seconds(case.replace(**{"time.end": TIMED * case.time.step}))
               for name, case in timed.items()}  # fmt: skip
    console().print(table(runs, reference, seconds))
    draw(runs, seconds, reference, Path(folder) / FIGURE)


if __name__ == "__main__":
    main(*sys.argv[1:])
