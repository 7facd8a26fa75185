"""Wall shear stress in deformed tubes, by the gradient of the velocity and by the balance of momentum."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, get_args

import ngsolve as ng
import numpy as np

from ngfsi.conditions import BodyForce
from ngfsi.config.functions import FlowConstant
from ngfsi.linear.backends import choose_backend
from ngfsi.materials import CompressibleNeoHookean
from ngfsi.measure.wall import Method, Wall
from ngfsi.solve.initial import NEWTON_STEPS
from ngfsi.solve.newton import Newton
from ngfsi.system.system import System
from ngfsi.verify import Benchmark, Reference, Setting, Values
from ngfsi_studies.verification.tube import BLOOD, round_tube, system

RADIUS, LENGTH, FLOW = 5.55e-3, 20e-3, 2.913e-6
OUTLET_PRESSURE, GRADIENT = 1333.22, 30.0
"""Pressure (Pa) at the outlet, thousands of times the shear stress, and its gradient (Pa/m)."""
SOLID = CompressibleNeoHookean(young=30e3, poisson=0.3, density=1060.0)
"""Of no influence: the tube's shape is held."""
NARROWING, SQUEEZE = 0.3, 0.3
"""Fraction of the radius missing at the outlet, and its rate (1/s)."""
STRETCH = 1.25
"""Of the oval tube, along x; its inverse along y."""


@dataclass(frozen=True)
class Tube:
    """A deformed tube and an exact flow in it, at the places of the reference shape.

    Attributes:
        motion: displacement of the mesh (m).
        motion_rate: its rate (m/s).
        velocity_rate: rate of the velocity at a fixed point of the mesh (m/s2).
        force: on the blood, per reference volume (N/m3).
        shear: stress of the blood on the wall (Pa).
    """

    motion: Any
    motion_rate: Any
    velocity_rate: Any
    force: Any
    shear: Any


ZERO = ng.CF((0, 0, 0))


def oval(stretch: float) -> Tube:
    """Return steady developed flow in a tube of elliptic section: u = 2 Q / (pi a b) (1 - x^2/a^2 - y^2/b^2)."""
    a, b = RADIUS * stretch, RADIUS / stretch
    x, y = stretch * ng.x, ng.y / stretch
    shear = 4 * BLOOD.viscosity * FLOW / (np.pi * a * b) * ng.sqrt(x**2 / a**4 + y**2 / b**4)
    return Tube(ng.CF((x - ng.x, y - ng.y, 0)), ZERO, ZERO, ZERO, ng.CF((0, 0, shear)))


def tapered(narrowing: float, squeeze: float) -> Tube:
    """Return flow in a tube that narrows along z, and faster and faster (`squeeze`, 1/s).

    Of radius R(z, t), with e = r/R and Q(z, t) the inflow plus what the shrinking part before z expels:
    u_z = 2 Q / (pi R^2) (1 - e^2), u_r = e R_z u_z + R_t (2 e - e^3): free of divergence, and the wall's velocity at
    the wall. A force on the blood makes it a solution; the ends of the tube are cylinders, where the profile of the
    inlet and the condition at the outlet hold.
    """
    t = ng.Parameter(0.0)
    zeta = ng.z / LENGTH
    fraction = zeta**3 * (10 - 15 * zeta + 6 * zeta**2)
    scale = 1 - (narrowing + squeeze * t) * fraction
    radius, e2 = RADIUS * scale, (ng.x**2 + ng.y**2) / RADIUS**2
    # dQ/dz = -dA/dt; the integral of fraction * scale along z is that of a polynomial of degree 11, done by hand
    first, second = _integrals(zeta)
    flow = FLOW + 2 * np.pi * RADIUS**2 * squeeze * LENGTH * (first - (narrowing + squeeze * t) * second)
    axial = 2 * flow / (np.pi * radius**2) * (1 - e2)
    radius_z, radius_t = radius.Diff(ng.z), radius.Diff(t)
    outward = (radius_z * axial + radius_t * (2 - e2)) / RADIUS  # u_r over the reference radius
    velocity = ng.CF((ng.x * outward, ng.y * outward, axial))
    motion = ng.CF((ng.x * (scale - 1), ng.y * (scale - 1), 0))
    motion_rate = ng.CF((ng.x, ng.y, 0)) * scale.Diff(t)
    along = scale.Diff(ng.z) / scale

    def slope(f: Any) -> list[Any]:
        """Derivatives by x, y, z of the deformed shape."""
        fx, fy = f.Diff(ng.x), f.Diff(ng.y)
        return [fx / scale, fy / scale, f.Diff(ng.z) - along * (ng.x * fx + ng.y * fy)]

    rho, mu = BLOOD.density, BLOOD.viscosity
    # at the outlet the condition asks for p = p_out + mu du_z/dz there
    pressure = GRADIENT * (LENGTH - ng.z) - 4 * mu * radius_t / radius * (1 - e2)
    pressure_slope, rate = slope(pressure), velocity.Diff(t)
    force = []
    for i in range(3):
        gradient = slope(velocity[i])
        convection = sum(g * (velocity[j] - motion_rate[j]) for j, g in enumerate(gradient))
        viscous = sum(slope(g)[j] for j, g in enumerate(gradient))
        force.append(rho * (rate[i] + convection) + pressure_slope[i] - mu * viscous)
    # on the wall the velocity's gradient is that across it, (du/dn) n^T, but for the wall's own motion
    slant = ng.sqrt(1 + radius_z**2)
    r = ng.sqrt(ng.x**2 + ng.y**2)
    tangent = ng.CF((radius_z * ng.x / r, radius_z * ng.y / r, 1)) / slant
    normal = ng.CF((ng.x / r, ng.y / r, -radius_z)) / slant
    L = ng.CF(tuple(g for i in range(3) for g in slope(velocity[i])), dims=(3, 3))
    shear = -mu * ng.InnerProduct((L + L.trans) * normal, tangent) * tangent
    return Tube(motion, motion_rate, rate, scale**2 * ng.CF(tuple(force)), shear)


def _integrals(zeta: Any) -> tuple[Any, Any]:
    """Return the integrals from 0 to zeta of s and of s^2, s the smooth step of fifth degree."""
    step = np.polynomial.Polynomial([0, 0, 0, 10, -15, 6])
    return tuple(sum(c * zeta**i for i, c in enumerate(p.integ().coef) if c) for p in (step, step**2))


TUBES = {
    "straight": lambda: oval(1.0),
    "oval": lambda: oval(STRETCH),
    "tapered": lambda: tapered(NARROWING, 0.0),
    "moving": lambda: tapered(NARROWING, SQUEEZE),
}


def solved(setting: Setting) -> tuple[System, Tube]:
    """Return the system with the computed flow, and the exact one."""
    order = setting["order"]
    geometry = round_tube(RADIUS, LENGTH, setting["element"], setting["h"], order)
    flow = {"loads.inlet_flow": FlowConstant(value=FLOW), "conditions.ends": "clamped", "solver.tolerance": 1e-6}
    exact = TUBES[setting["tube"]]()
    force = BodyForce(exact.force, "fluid", bonus_intorder=4)
    found = system(geometry, SOLID, SOLID, OUTLET_PRESSURE, 0.0, force, **flow)
    found.set_steady()
    found.update(0.0)
    for field, values in (
        (found.state, exact.motion),
        (found.velocity_history, exact.motion_rate),
        (found.acceleration_history, exact.velocity_rate),
    ):
        field.components[0].Set(values, bonus_intorder=4)
    newton = Newton(found, choose_backend("auto"), "w", "p")
    for load_factor in (0.0, 1.0):  # creeping flow without a force is linear
        found.blood_density.Set(load_factor * BLOOD.density)
        force.update(0.0, load_factor)
        newton.solve(found.case.solver.tolerance, NEWTON_STEPS)
    return found, exact


def compute(setting: Setting) -> Values:
    """Return errors of the wall shear stress by both methods: of the vector, and of the mean of its magnitude."""
    found, exact = solved(setting)
    wall = Wall(found, found.domain.vessels[0])
    wall.refresh()
    size = ng.Norm(exact.shear)
    area, mean, square = (wall.integral(part) for part in (ng.CF(1.0), size, size * size))
    errors = {}
    for method in get_args(Method):
        difference = wall.shears[method] - exact.shear
        errors[f"{method}: L2 error"] = np.sqrt(wall.integral(ng.InnerProduct(difference, difference)) / square)
        errors[f"{method}: error of the mean"] = abs(wall.statistics(method=method).mean * area / mean - 1)
    return {name: float(error) for name, error in errors.items()}


CASE = Benchmark(
    title="Wall shear stress in deformed tubes",
    solves="steady flow at a Reynolds number of 96 and 10 mmHg in a tube of 20 mm that is held in a deformed shape: "
    "straight, oval (axes 1.56 : 1), tapered to 70 % of its radius, and tapered while it shrinks by 30 % of its radius "
    "a second at the outlet, with the rates of that motion; wall shear stress from the gradient of the velocity and "
    "from the balance of momentum. In the last two a force on the blood makes the exact flow a solution",
    exact="developed flow in circle and ellipse; in the others u_z = 2 Q(z) / (pi R^2) (1 - e^2), u_r = e R' u_z + "
    "dR/dt (2 e - e^3) with e = r/R(z, t): the wall shear stress of its gradient at every point of the exact wall",
    compute=compute,
)
ELEMENTS = {"hexahedra": "mixed", "prisms": "prism"}


def _levels(tubes: Iterable[str], orders: dict[str, tuple[int, ...]]) -> dict[str, tuple[Setting, ...]]:
    """Return two sizes of elements for each tube, kind of elements and order."""
    return {
        f"{tube}, {kind}, k = {k}": tuple({"tube": tube, "element": ELEMENTS[kind], "order": k, "h": h} for h in SIZES)
        for tube in tubes
        for kind in orders
        for k in orders[kind]
    }


SIZES = (1.0, 0.5)
LEVELS = {
    "ci": _levels(("moving",), {"hexahedra": (2,)}),
    "full": _levels(TUBES, {"hexahedra": (2, 3), "prisms": (2, 3)}),
}


def _allowed(hexahedra_2: float, hexahedra_3: float, prisms_2: float, prisms_3: float) -> dict[str, float]:
    """Return a value for each series."""
    values = {"hexahedra, k = 2": hexahedra_2, "hexahedra, k = 3": hexahedra_3,
              "prisms, k = 2": prisms_2, "prisms, k = 3": prisms_3}  # fmt: skip
    return {f"{tube}, {kind}": value for tube in TUBES for kind, value in values.items()}


SOURCE = "Hagen-Poiseuille; closed form"
REFERENCES = (
    Reference("gradient: L2 error", 0.0, "1", _allowed(1e-2, 2e-3, 1.5e-2, 5e-3), SOURCE, _allowed(2, 3, 1.5, 2)),
    Reference("gradient: error of the mean", 0.0, "1", _allowed(2e-3, 1e-3, 1e-2, 2e-3), SOURCE),
    Reference("consistent: L2 error", 0.0, "1", _allowed(1e-2, 4e-3, 1.5e-2, 5e-3), SOURCE, _allowed(2, 2, 1.5, 2)),
    Reference("consistent: error of the mean", 0.0, "1", _allowed(3e-3, 1e-3, 4e-3, 2e-3), SOURCE),
)
