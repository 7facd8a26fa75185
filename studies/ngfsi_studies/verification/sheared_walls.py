"""Steady flow between walls, and in a sheath, of the calf's tissue, which it shears to finite strain."""

from __future__ import annotations

from typing import Any

import ngsolve as ng
import numpy as np
from ngfsi_geometry.channel import ElasticChannel, PlaneMesh
from numpy.typing import NDArray
from scipy.optimize import brentq

from ngfsi.case import Materials
from ngfsi.conditions import BodyForce
from ngfsi.linear.backends import choose_backend
from ngfsi.materials import MooneyRivlin, Newtonian, load_set
from ngfsi.solve.newton import Newton
from ngfsi.verify import Benchmark, Reference, Setting, Values
from ngfsi_studies.verification.plane import at_rest, case_of
from ngfsi_studies.verification.polynomial import evaluated, interpolated
from ngfsi_studies.verification.tube import relative_error, sheath

Array = NDArray[np.float64]

INNER, WALL, LENGTH = 5.55e-3, 3e-3, 4e-3
TISSUE: MooneyRivlin = load_set("mooney_rivlin_s1")  # type: ignore[assignment]
FLUID = Newtonian(density=1060.0, viscosity=1e3)
"""So thick that it shears the walls by a half at a Reynolds number of 1e-4."""
GRADIENT = {"channel": 1.5e6, "pipe": 3e6}
"""Of the pressure (Pa/m)."""
FLOW = {"channel": 2 * GRADIENT["channel"] * INNER**3 / (3 * FLUID.viscosity),
        "pipe": np.pi * GRADIENT["pipe"] * INNER**4 / (8 * FLUID.viscosity)}  # fmt: skip
STEPS = 32
LOAD_FACTORS = np.linspace(1, 0, STEPS, endpoint=False)[::-1]


def shear(stress: float) -> float:
    """Return the shear g that carries a shear stress (Pa): 2 (c10 + c01) g + 4 c11 g^3."""

    def surplus(g: float) -> float:
        return 2 * (TISSUE.c10 + TISSUE.c01) * g + 4 * TISSUE.c11 * g**3 - stress

    return float(brentq(surplus, 0.0, 10.0, xtol=1e-15))


def displacement(slope: float, across: Any) -> Any:
    """Return the exact axial displacement (m) where the shear stress is `slope` (Pa/m) times the distance `across`.

    It is the integral of the shear from the outer face.
    """
    outer = INNER + WALL
    towards = interpolated(np.vectorize(lambda r: shear(slope * r)), INNER, outer).integ()
    return evaluated(towards(outer) - towards, across)


def compute(setting: Setting) -> Values:
    """Return the errors of the displacement and of the force on the walls."""
    shape, order = setting["shape"], setting["order"]
    flow, gradient = FLOW[shape], GRADIENT[shape]
    law = TISSUE.replace(K=TISSUE.shear_modulus / setting["h"])
    if shape == "pipe":
        geometry: Any = sheath(INNER, WALL, LENGTH, setting["size"], order)
        materials = Materials(tissue=law, wall=law, fluid=FLUID)
        exact = ng.CF((0, 0, displacement(gradient / 2, ng.sqrt(ng.x**2 + ng.y**2))))
        force = ng.CF((0, 0, gradient))
    else:
        mesh = PlaneMesh(far_size=setting["size"] * 4e-3, curving_order=order)
        geometry = ElasticChannel(length=LENGTH, height=2 * INNER, wall_thickness=WALL, mesh=mesh)
        materials = Materials(solid=law, fluid=FLUID)
        exact = ng.CF((displacement(gradient, ng.sqrt(ng.y**2)), 0))
        force = ng.CF((gradient, 0))
    changes = {"conditions.ends": "guided", "solver.tolerance": 1e-5}
    # a force on all of it: no pressure presses on the walls
    found, domain = at_rest(case_of(geometry, flow, materials, **changes), BodyForce(force))
    newton = Newton(found, choose_backend("auto"))
    for load_factor in LOAD_FACTORS:
        found.update(0.0, load_factor)
        newton.solve(found.case.solver.tolerance, found.case.solver.max_iterations)
    return {"displacement of the walls, L2 error": relative_error(found.motion, exact, domain, *domain.geometry.solids)}


CASE = Benchmark(
    title="Walls sheared by steady flow",
    solves="the coupled system between walls (in the plane) and in a sheath (in 3-D) of the calf's Mooney-Rivlin "
    "tissue, with c11, under an axial force G that shears them by more than a half; the bulk modulus is 1/h times the "
    "shear modulus, and h goes to zero",
    exact="the shear g of an incompressible wall, 2 (c10 + c01) g + 4 c11 g^3 = G y between walls and G r/2 in a "
    "sheath, integrated",
    compute=compute,
)
LEVELS = {
    "ci": {"channel, k = 3": tuple({"shape": "channel", "order": 3, "size": 0.5, "h": h} for h in (1e-2, 1e-3))},
    "full": {
        **{
            f"channel, k = {k}": tuple(
                {"shape": "channel", "order": k, "size": 0.25, "h": h} for h in (1e-1, 1e-2, 1e-3, 1e-4)
            )
            for k in (3, 4)
        },
        "pipe, k = 3": tuple({"shape": "pipe", "order": 3, "size": 0.5, "h": h} for h in (1e-2, 1e-3)),
    },
}
ALLOWED = {"channel, k = 3": 2e-4, "channel, k = 4": 2e-4, "pipe, k = 3": 2e-3}
REFERENCES = (Reference("displacement of the walls, L2 error", 0.0, "1", ALLOWED, "closed form", 1.0),)
