"""Steady flow between walls of the calf's tissue, sheared by it to finite strain."""

from __future__ import annotations

from typing import Any

import ngsolve as ng
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from geometry.channel import ElasticChannel, PlaneMesh
from ngfsi.case import Materials
from ngfsi.materials import MooneyRivlin, Newtonian, load_set
from ngfsi.solve.linear import choose_backend
from ngfsi.solve.newton import Newton
from ngfsi.verify import Benchmark, Reference, Setting, Values
from studies.verification.plane import at_rest, body_force, case_of
from studies.verification.polynomial import evaluated, interpolated
from studies.verification.tube import relative_error

Array = NDArray[np.float64]

INNER, WALL, LENGTH = 5.55e-3, 3e-3, 4e-3
TISSUE: MooneyRivlin = load_set("mooney_rivlin_s1")  # type: ignore[assignment]
FLUID = Newtonian(density=1060.0, viscosity=1e3)
"""So thick that it shears the walls by a half at a Reynolds number of 1e-4."""
GRADIENT = 1.5e6
FLOW = 2 * GRADIENT * INNER**3 / (3 * FLUID.viscosity)
STEPS = 32
SHARES = np.linspace(1, 0, STEPS, endpoint=False)[::-1]


def shear(y: float) -> float:
    """Return the shear that carries the stress G y: 2 (c10 + c01) g + 4 c11 g^3 = G y."""

    def surplus(g: float) -> float:
        return 2 * (TISSUE.c10 + TISSUE.c01) * g + 4 * TISSUE.c11 * g**3 - GRADIENT * y

    return float(brentq(surplus, 0.0, 10.0, xtol=1e-15))


def displacement() -> Any:
    """Return the exact axial displacement (m): the integral of the shear from the outer face."""
    outer = INNER + WALL
    towards = interpolated(np.vectorize(shear), INNER, outer).integ()
    return ng.CF((evaluated(towards(outer) - towards, ng.sqrt(ng.y**2)), 0))


def compute(setting: Setting) -> Values:
    """Return the errors of the displacement and of the force on the walls."""
    mesh = PlaneMesh(far_size=setting["size"] * 4e-3, curving_order=setting["order"])
    geometry = ElasticChannel(length=LENGTH, height=2 * INNER, wall_thickness=WALL, mesh=mesh)
    law = TISSUE.replace(K=TISSUE.shear_modulus / setting["h"])
    changes = {"conditions.ends": "guided", "solver.tolerance": 1e-5}
    found, _ = at_rest(case_of(geometry, FLOW, Materials(solid=law, fluid=FLUID), **changes))
    # a force on all of it: no pressure presses on the walls
    share = body_force(found, ng.CF((GRADIENT, 0)))
    newton = Newton(found, choose_backend("auto"))
    for part in SHARES:
        share.Set(part)
        found.flow_rate = part * FLOW
        newton.solve(found.case.solver.tolerance, found.case.solver.max_iterations)
    motion = found.fields(found.state.components).motion
    return {"displacement of the walls, L2 error": relative_error(motion, displacement(), found.domain, "solid")}


CASE = Benchmark(
    title="Walls sheared by steady flow",
    solves="the coupled system between walls of the calf's Mooney-Rivlin tissue, with c11, under an axial force that "
    "shears them by more than a half; the bulk modulus is 1/h times the shear modulus, and h goes to zero",
    exact="the shear g of an incompressible wall, 2 (c10 + c01) g + 4 c11 g^3 = G y, integrated",
    compute=compute,
)
LEVELS = {
    "ci": {"k = 3": tuple({"order": 3, "size": 0.5, "h": h} for h in (1e-2, 1e-3))},
    "full": {f"k = {k}": tuple({"order": k, "size": 0.25, "h": h} for h in (1e-1, 1e-2, 1e-3, 1e-4)) for k in (3, 4)},
}
REFERENCES = (Reference("displacement of the walls, L2 error", 0.0, "1", 2e-4, "closed form", 1.0),)
