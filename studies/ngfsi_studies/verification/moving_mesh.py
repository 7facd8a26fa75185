"""Oscillating flow between rigid walls on a mesh that moves violently inside of it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import ngsolve as ng
import numpy as np
from ngfsi_geometry.channel import PlaneMesh, StraightChannel
from numpy.typing import NDArray

from ngfsi.case import Materials, TimeStepping
from ngfsi.conditions import GivenMeshMotion, GivenVelocity
from ngfsi.linear.backends import choose_backend
from ngfsi.measure.deformation import Deformation
from ngfsi.physics.fields import MOTION, VELOCITY
from ngfsi.physics.kinematics import Kinematics
from ngfsi.solve.newton import Newton
from ngfsi.solve.time_loop import History, TimeLoop
from ngfsi.system.system import System
from ngfsi.verify import Benchmark, Reference, Setting, Values
from ngfsi_studies.verification.plane import at_rest, case_of
from ngfsi_studies.verification.shear_waves import FLUID, INNER, KF, OMEGA, PERIOD, swinging
from ngfsi_studies.verification.tube import relative_error

Array = NDArray[np.float64]

LENGTH = 10e-3
GRADIENT, MEAN_GRADIENT = 200.0, 600.0
"""Amplitude and mean of the pressure gradient (Pa/m), for a flow a few times faster than the mesh."""
AMPLITUDE = 1e-3
"""Of the motion of the mesh (m)."""
SHAKES = 1
"""Times that the mesh moves to and fro in a period of the flow."""


def velocity(t: float, y: Any) -> Any:
    """Return the exact axial velocity (m/s) at a distance y from the middle (Womersley flow between plane walls)."""
    amplitude = GRADIENT / (1j * OMEGA * FLUID.density)
    wave = swinging(lambda r: amplitude * (1 - np.cos(KF * r) / np.cos(KF * INNER)), 0.0, INNER, t, ng.sqrt(y**2))
    return wave + MEAN_GRADIENT / (2 * FLUID.viscosity) * (INNER**2 - y**2)


def motion(t: float, amplitude: float, rate: int = 0) -> Any:
    """Return the motion of the mesh (m) between the walls, or its rate."""
    phase = 2 * np.pi * SHAKES / PERIOD
    factor = phase * np.sin(phase * t) / 2 if rate else (1 - np.cos(phase * t)) / 2
    bump = ng.sin(np.pi * ng.x / LENGTH) * ng.cos(np.pi * ng.y / (2 * INNER))
    return amplitude * float(factor) * bump * ng.CF((ng.sin(2 * np.pi * ng.x / LENGTH) + 0.5, 0.8))


def exact_state(system: System, t: float, amplitude: float) -> tuple[Array, Array]:
    """Return the unknowns of mesh and velocity of the exact solution, and the rate of the mesh."""
    state, rate = (ng.GridFunction(system.unknowns.space) for _ in range(2))
    inside = system.unknowns.blocks["e"]
    for order, field in enumerate((state, rate)):
        field.components[0].Set(motion(t, amplitude, order))
        outside = np.delete(np.arange(system.unknowns.size), inside)
        field.vec.FV().NumPy()[outside] = 0.0
    parts = system.named(state)
    relative = ng.CF((velocity(t, ng.y + parts[MOTION][1]), 0)) - rate.components[0]
    parts[VELOCITY].Set(relative, definedon=system.domain.materials("fluid"), bonus_intorder=4)
    return np.array(state.vec.FV().NumPy()), np.array(rate.vec.FV().NumPy())


def compute(setting: Setting) -> Values:
    """Return the largest error of the velocity over a period from the exact state, and how far the mesh is deformed."""
    order, step = setting["order"], setting["step"] * PERIOD
    mesh = PlaneMesh(far_size=setting["size"] * 4e-3, curving_order=order)
    geometry = StraightChannel(length=LENGTH, height=2 * INNER, mesh=mesh)
    changes = {"time": TimeStepping(step=step, end=PERIOD, scheme=setting["scheme"])}
    amplitude = setting["amplitude"]
    found, domain = at_rest(
        case_of(geometry, 0.0, Materials(fluid=FLUID), **changes),
        GivenVelocity("inlet", lambda t: ng.CF((velocity(t, ng.y), 0))),
        GivenMeshMotion(lambda t: motion(t, amplitude)),
    )
    times = [0.0, -step]
    states, rates = map(list, zip(*(exact_state(found, t, amplitude) for t in times), strict=True))
    history = History(times, states, rates, smooth=1)
    loop = TimeLoop(found.case, found, Newton(found, choose_backend("auto"), "w", "p"), history=history)
    fields, deformation = found.fields(), Deformation(found)
    J = Kinematics(fields.grad_motion).J
    errors, ratios = [], []
    for at in loop.run():
        exact = ng.CF((velocity(at.time, ng.y + found.motion[1]), 0))
        errors.append(relative_error(fields.velocity, exact, domain, "fluid", weight=J))
        ratios.append(deformation.smallest_jacobian("fluid"))
    return {"velocity, L2 error": float(max(errors)), "smallest volume ratio of the mesh": min(ratios)}


CASE = Benchmark(
    title="Flow on a moving mesh",
    solves="one period of oscillating flow between rigid walls from the exact state, while the mesh between them "
    "moves to and fro with half the speed of the flow, its elements shrinking to about a third of their size",
    exact="Womersley flow between plane walls, at the deformed places: it does not care how the mesh moves; the "
    "largest error of the period counts. Uniform flow and flows linear in space on randomly moving meshes are tests of "
    "the code, exact to quadrature",
    compute=compute,
)


def _shaken(order: int, sizes: Sequence[float], steps: Sequence[int], scheme: str = "bdf2") -> tuple[Setting, ...]:
    """Return settings of one size of elements or one number of steps per period; the other is refined."""
    return tuple(
        {"scheme": scheme, "amplitude": AMPLITUDE, "order": order, "size": size, "step": 1 / n,
         "h": 1 / n if len(sizes) == 1 else size}
        for size in sizes
        for n in steps
    )  # fmt: skip


LEVELS = {
    "ci": {"time steps": _shaken(3, (0.3,), (10, 20)), "elements, k = 2": _shaken(2, (0.6, 0.3), (20,))},
    "full": {
        "time steps": _shaken(4, (0.3,), (20, 40, 80)),
        "time steps, esdirk3": _shaken(5, (0.3,), (10, 20, 40), "esdirk3"),
        "time steps, sdirk4": _shaken(5, (0.3,), (10, 20, 40), "sdirk4"),
        "elements, k = 2": _shaken(2, (0.6, 0.3), (40,)),
        "elements, k = 3": _shaken(3, (0.6, 0.3), (160,)),
    },
}
ALLOWED = {
    "time steps": 1e-3,
    "time steps, esdirk3": 2e-6,
    "time steps, sdirk4": 3e-6,
    "elements, k = 2": 3e-3,
    "elements, k = 3": 3e-4,
}
REFERENCES = (
    Reference("velocity, L2 error", 0.0, "1", ALLOWED, "J. R. Womersley, J Physiol 127 (1955) 553, in the plane",
              {"time steps": 2.0, "time steps, esdirk3": 3.0, "time steps, sdirk4": 2.0, "elements, k = 2": 3.0,
               "elements, k = 3": 4.0}),
    Reference("smallest volume ratio of the mesh", 0.33, "1", 0.3, "as deformed as intended"),
)  # fmt: skip
