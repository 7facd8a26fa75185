"""Orders of convergence of the solids' forms at finite strain on a curved domain."""

from __future__ import annotations

import ngsolve as ng
import numpy as np
from ngfsi_geometry.segment import MeshSettings
from ngfsi_geometry.tube import TubeSegment
from ngsolve import Grad, GridFunction, Id, cos, sin

from ngfsi.materials import load_set
from ngfsi.mesh.domain import Domain
from ngfsi.physics import terms
from ngfsi.verify import Benchmark, Reference, Setting, Values
from ngfsi_studies.verification.solid import solve
from ngfsi_studies.verification.tube import relative_error

RADIUS, WALL, OUTER, LENGTH = 5e-3, 2e-3, 9e-3, 4e-3
REGIONS = ("tissue", "wall", "fluid")


def displacement(amplitude: float = 4e-4) -> tuple[ng.CoefficientFunction, ng.CoefficientFunction]:
    """Return a smooth displacement (m) and its gradient; strains reach 0.2."""
    x, y, z, a = ng.x, ng.y, ng.z, 250.0
    parts = (sin(a * x) * cos(0.6 * a * z), cos(a * y) * sin(0.8 * a * x), sin(a * z) * cos(a * y))
    gradient = [part.Diff(by) for part in parts for by in (x, y, z)]
    return amplitude * ng.CF(parts), amplitude * ng.CF(tuple(gradient), dims=(3, 3))


def compute(setting: Setting) -> Values:
    """Return the errors of displacement and of its gradient."""
    order, n = setting["order"], round(1 / setting["h"])
    geometry = TubeSegment(
        length=LENGTH, lumen_diameter=2 * RADIUS, wall_thickness=WALL, outer_radius=OUTER,
        mesh=MeshSettings(element="mixed", axial_layers=2 * n, wall_layers=n, far_size=4e-3 / n,
                          vein_size=2 * np.pi * RADIUS / (8 * n), curving_order=order,
                          lumen_radii=tuple(i / n for i in range(n - 1, 0, -1))),
    )  # fmt: skip
    domain = Domain.build(geometry)
    law = load_set("mooney_rivlin_s1")
    exact, gradient = displacement()
    space = ng.VectorH1(domain.mesh, order=order)
    d, v = space.TnT()
    form, forces = ng.BilinearForm(space, check_unused=False), ng.LinearForm(space)
    work, exact_work = (terms.internal_work(law, Id(3) + g, Grad(v)) for g in (Grad(d), gradient))  # type: ignore[arg-type]
    measure = domain.dx(*REGIONS, bonus_intorder=1)
    form += work.Compile() * measure
    forces += exact_work.Compile() * measure
    forces.Assemble()
    found = GridFunction(space)
    found.Set(exact)
    start = np.array(found.vec)
    outer = domain.boundaries("skin", "tissue_top", "tissue_bottom", "wall_top", "wall_bottom", "inlet", "outlet")
    found.Set(exact, definedon=outer, bonus_intorder=4)
    free = ~np.array(list(space.GetDofs(outer)))
    found.vec.FV().NumPy()[free] = start[free]  # which NGSolve has set to zero
    solve(form, found, free, forces, tolerance=1e-9)

    return {
        "displacement, L2 error": relative_error(found, exact, domain, *REGIONS),
        "gradient, L2 error": relative_error(Grad(found), gradient, domain, *REGIONS),
    }


CASE = Benchmark(
    title="Manufactured solution of the solids",
    solves="Mooney-Rivlin tissue at strains of up to 0.2 in a cylinder with curved prisms and hexahedra, with the "
    "forces and the boundary values that make a product of sines the solution",
    exact="the displacement, whose error falls as h^(k+1), and its gradient, whose error falls as h^k",
    compute=compute,
)
LEVELS = {
    "ci": {f"k = {k}": tuple({"order": k, "h": h} for h in (1.0, 0.5)) for k in (1, 2)},
    "full": {
        f"k = {k}": tuple({"order": k, "h": h} for h in sizes)
        for k, sizes in {1: (1.0, 0.5, 0.25), 2: (1.0, 0.5, 0.25), 3: (1.0, 0.5), 4: (1.0, 0.5)}.items()
    },
}
ORDERS = {f"k = {k}": k for k in (1, 2, 3, 4)}
REFERENCES = (
    Reference("displacement, L2 error", 0.0, "1", {f"k = {k}": 0.4 * 10.0**-k for k in ORDERS.values()}, "manufactured",
              {name: k + 1 for name, k in ORDERS.items()}),
    Reference("gradient, L2 error", 0.0, "1", {f"k = {k}": 4 * 10.0**-k for k in ORDERS.values()}, "manufactured",
              dict(ORDERS)),
)  # fmt: skip
