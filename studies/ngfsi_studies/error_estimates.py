"""How good are the errors from space that `ngfsi run --error` tells? They are held against true ones.

    python -m ngfsi_studies.error_estimates FOLDER [CASE...]

Steady states: the clamped vein of `ngfsi bench` on layers, on curved and on straight tetrahedra, against the reference
of `vein_accuracy`; the calf on a coarse mesh, against that of `compare_tissues`, level `demo`; a tube of Mooney-Rivlin
material, against the radial equilibrium; beams of Turek and Hron, against what they converge to. Effectivity is the
estimate over the error: 1 is right, less says too little.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import ngsolve as ng
import numpy as np
from ngfsi_geometry.channel import Beam
from ngfsi_geometry.segment import MeshSettings
from ngfsi_geometry.tube import TubeSegment

from ngfsi.case import Case, Materials
from ngfsi.errors import unknown
from ngfsi.linear.backends import choose_backend
from ngfsi.materials import MooneyRivlin
from ngfsi.measure.probe import Probe
from ngfsi.report.tables import markdown_table
from ngfsi.report.terminal import console
from ngfsi.run.computation import finished
from ngfsi.run.estimate import MORE, at_end, estimate
from ngfsi.run.finer import Finer
from ngfsi.solve.initial import initial_state
from ngfsi.solve.newton import Newton
from ngfsi.store.stored import StoredRun
from ngfsi.system.system import System
from ngfsi_studies import compare_tissues, vein_accuracy, vein_refinement
from ngfsi_studies.verification import mooney_rivlin_cylinder as cylinder
from ngfsi_studies.verification.plane import at_rest, case_of, refined
from ngfsi_studies.verification.radial import Layer, inner_displacement
from ngfsi_studies.verification.tube import BLOOD, PASSIVE, system
from ngfsi_studies.verification.turek_hron import (
    BEAM_IN_CHANNEL,
    DATA,
    SHARP,
    flow_case,
    force_on_obstacle,
    tip_motion,
)
from ngfsi_studies.verification.turek_hron_solid import GRAVITY, LOAD_FACTORS

Values = Mapping[str, float]


class Row(NamedTuple):
    """A quantity of a case: its estimated and its true error, relative."""

    case: str
    unknowns: int
    quantity: str
    estimate: float
    error: float


def _of_runs(cases: Mapping[str, Case], exact: Case, folder: Path) -> Iterator[Row]:
    """Compare what `--error` says of runs with their distance from another one."""
    right = _values(finished(exact, folder / "exact", quiet=True))
    for name, case in cases.items():
        found = finished(case, folder / name.replace(",", "").replace(" ", "-"), quiet=True)
        rows = found.errors or estimate(found, quiet=True)
        for row in rows:
            quantity = str(row["quantity"])
            error = abs(_values(found)[quantity] / right[quantity] - 1)
            yield Row(name, found.manifest["unknowns"], quantity, float(row["space_end_1"]), error)


def _values(found: StoredRun) -> Values:
    return {str(row["quantity"]): float(row["value"]) for row in at_end(found)}


def vein(folder: Path) -> Iterator[Row]:
    """Clamped, under 10 mmHg on the skin: layers at the ends, which even elements do not resolve."""
    known = vein_accuracy.cases()
    chosen = {f"vein, two layers, order {k}": known[f"hexahedra, two layers, order {k}"] for k in (2, 3)}
    tetrahedra = vein_refinement.SECTION.replace(element="tetrahedron")
    for shape, order in (("curved", 2), ("straight", 1)):
        mesh: dict[str, Any] = {"geometry.mesh": tetrahedra.replace(curving_order=order), "discretisation.order": 2}
        chosen[f"vein, {shape} tetrahedra, order 2"] = known["hexahedra, two layers, order 2"].replace(**mesh)
    yield from _of_runs(chosen, known[vein_accuracy.REFERENCE], folder / "vein")


def calf(folder: Path) -> Iterator[Row]:
    """M tissue at rest under 25 mmHg."""
    coarse = {"calf, coarse, order 2": vein_refinement.calf_at_rest(compare_tissues.COARSE)}
    yield from _of_runs(coarse, vein_refinement.calf_at_rest(compare_tissues.LEVELS["demo"]), folder / "calf")


def _of_systems(name: str, found: System, measure: Callable[[System], Values], exact: Values) -> Iterator[Row]:
    """Compare what elements of one order more change with the distance from exact values."""
    finer = Finer(found)
    finer.take(0.0)
    here, more = measure(found), measure(finer.system)
    for quantity, right in exact.items():
        change, error = (abs((here[quantity] - other[quantity]) / right) for other in (more, exact))
        yield Row(name, found.unknowns.size, quantity, MORE * change, error)


def tube(_folder: Path) -> Iterator[Row]:
    """Of Mooney-Rivlin material, opened to twice its radius, with steady flow."""
    inside, radius = cylinder.LARGEST * cylinder.SCALE, cylinder.INNER
    c10, c01, bulk = (one * cylinder.SCALE for one in (80e6, 20e6, 20e9))
    law = MooneyRivlin(c10=c10, c01=c01, c11=0.0, K=bulk, density=0.0)
    opened = radius + inner_displacement(radius, [Layer(law, cylinder.OUTER)], inside)
    exact = {
        "gain of volume": (opened / radius) ** 2 - 1,
        "SAWSS": 4 * BLOOD.viscosity * PASSIVE * inside / (np.pi * opened**3),
    }

    def measure(found: System) -> Values:
        probe = Probe(found)
        probe.refresh()
        vessel = probe.vessels[""]
        gain = vessel.integral("lumen volume") / found.domain.volume("fluid") - 1
        return {"gain of volume": gain, "SAWSS": vessel.shear.mean}

    for order in (2, 3):
        mesh = MeshSettings(element="mixed", axial_layers=1, far_size=5e-3, vein_size=4e-3, wall_layers=1,
                            lumen_radii=(), curving_order=order)  # fmt: skip
        geometry = TubeSegment(length=2e-3, lumen_diameter=2 * radius, wall_thickness=3e-3, outer_radius=cylinder.OUTER,
                               mesh=mesh)  # fmt: skip
        found = system(geometry, law, law, inside, 0.0)
        initial_state(found, Newton(found, choose_backend("auto")))
        yield from _of_systems(f"tube, order {order}", found, measure, exact)


FSI1 = {"ux": 2.26809e-5, "uy": 0.818603e-3, "drag": 14.294, "lift": 0.764752}
CSM1 = {"ux": -7.18785e-3, "uy": -66.1032e-3}
"""To which these converge (m, N): order 4 on half of the sizes, docs/verification.md."""


def beams(_folder: Path) -> Iterator[Row]:
    """Of Turek and Hron: CSM1 under its weight, FSI1 in flow."""
    weight = {"loads.further": [{"kind": "body_force", "acceleration": [0.0, -GRAVITY]}]}
    beam = refined(Beam(), 2, 1.0).replace(**SHARP)
    found, _ = at_rest(case_of(beam, 0.0, Materials(solid=DATA["CSM1"].beam), **weight))
    newton = Newton(found, choose_backend("auto"))
    for load_factor in LOAD_FACTORS:
        found.update(0.0, load_factor)
        newton.solve(found.case.solver.tolerance, found.case.solver.max_iterations)
    yield from _of_systems("CSM1, order 2", found, _moved, CSM1)
    for order in (2, 3):
        found, _ = at_rest(flow_case("FSI1", refined(BEAM_IN_CHANNEL, order, 1.0).replace(**SHARP)))
        initial_state(found, Newton(found, choose_backend("auto")))
        yield from _of_systems(f"FSI1, order {order}", found, _moved, FSI1)


def _moved(found: System) -> Values:
    parts = [*tip_motion(found), *(force_on_obstacle(found)() if found.domain.lumens else ())]
    return dict(zip(FSI1, parts, strict=False))


CASES: dict[str, Callable[[Path], Iterator[Row]]] = {"tube": tube, "beams": beams, "calf": calf, "vein": vein}


def table(rows: Iterable[Row]) -> str:
    """Return the errors in per cent, and how good they are, as Markdown."""
    head = ("case", "unknowns", "quantity", "estimate %", "error %", "effectivity")
    cells = [(one.case, f"{one.unknowns:,}", one.quantity, f"{100 * one.estimate:.2g}", f"{100 * one.error:.2g}",
              f"{one.estimate / one.error:.1f}") for one in rows]  # fmt: skip
    return markdown_table(head, cells)


def main(folder: str, *names: str) -> None:
    """Compute what is not there yet, and print the table.

    Raises:
        SystemExit: there is no case of that name.
    """
    if missing := [name for name in names if name not in CASES]:
        sys.exit(unknown("case", missing[0], CASES))
    with ng.TaskManager():
        console().print(table([row for name in names or CASES for row in CASES[name](Path(folder))]))


if __name__ == "__main__":
    main(*sys.argv[1:])
