"""A tapered panel, clamped at one side and sheared at the other (Cook 1974)."""

from __future__ import annotations

import ngsolve as ng
import numpy as np
from netgen.geom2d import SplineGeometry

from ngfsi.linear.backends import choose_backend
from ngfsi.linear.factorisation import Factorisation
from ngfsi.materials import SaintVenantKirchhoff
from ngfsi.physics import terms
from ngfsi.physics.kinematics import Kinematics
from ngfsi.verify import Benchmark, Reference, Setting, Values

CORNERS = ((0.0, 0.0), (48e-3, 44e-3), (48e-3, 60e-3), (0.0, 44e-3))
SIDES = ("lower", "loaded", "upper", "clamped")
LAW = SaintVenantKirchhoff(young=70e6, poisson=1 / 3, density=0.0)
TRACTION = 6.25e6
AT_CORNER = 0.1
"""Size of the elements at the upper corners, where the stress is singular, over that of the others."""


def compute(setting: Setting) -> Values:
    """Return the deflection (m) of the loaded side's upper corner: one linear solve from the unloaded shape."""
    order, size = setting["order"], setting["h"] * 16e-3
    panel = SplineGeometry()
    sizes = (size, size, AT_CORNER * size, AT_CORNER * size)
    points = [panel.AppendPoint(*corner, maxh=maxh) for corner, maxh in zip(CORNERS, sizes, strict=True)]
    for side, (start, name) in enumerate(zip(points, SIDES, strict=True)):
        panel.Append(["line", start, points[(side + 1) % 4]], bc=name)
    mesh = ng.Mesh(panel.GenerateMesh(maxh=size, grading=0.3))
    space = ng.VectorH1(mesh, order=order, dirichlet="clamped")
    d, v = space.TnT()
    form, load = ng.BilinearForm(space), ng.LinearForm(space)
    form += terms.internal_work(LAW, Kinematics(ng.Grad(d)).F, ng.Grad(v)).Compile() * ng.dx
    load += TRACTION * v[1] * ng.ds("loaded")
    load.Assemble()
    found = ng.GridFunction(space)
    factorisation = Factorisation(form, np.array(list(space.FreeDofs())), choose_backend("auto"))
    factorisation.renew(found.vec)
    factorisation.solve(load.vec, found.vec)
    x, y = CORNERS[2]
    return {"deflection": float(found(mesh(x, y))[1])}


CASE = Benchmark(
    title="Cook's membrane",
    solves="a tapered panel in plane strain that bends and shears, by linear elasticity: the derivative of the Saint "
    "Venant-Kirchhoff law at rest",
    exact="the deflection of its upper corner, between published values",
    compute=compute,
)
LEVELS = {
    "ci": {f"k = {k}": ({"order": k, "h": 0.5},) for k in (2, 3)},
    "full": {f"k = {k}": tuple({"order": k, "h": h} for h in (1.0, 0.5, 0.25, 0.125)) for k in (1, 2, 3, 4)},
}
ALLOWED = {"k = 1": 2e-2, **dict.fromkeys(("k = 2", "k = 3", "k = 4"), 2e-3)}
REFERENCES = (Reference("deflection", 32.25e-3, "m", ALLOWED, "R. D. Cook, J Struct Div 100 (1974) 1851"),)
