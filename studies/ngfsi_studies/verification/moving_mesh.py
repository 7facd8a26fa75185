"""Oscillating flow between rigid walls on a mesh that moves violently inside of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import ngsolve as ng
import numpy as np
from ngfsi_geometry.channel import PlaneMesh, StraightChannel
from numpy.typing import NDArray

from ngfsi.case import Case, Materials, TimeStepping
from ngfsi.linear.backends import choose_backend
from ngfsi.measure.deformation import Deformation
from ngfsi.mesh.domain import Domain
from ngfsi.physics.kinematics import Kinematics
from ngfsi.solve.newton import Newton
from ngfsi.solve.time_loop import History, TimeLoop
from ngfsi.system.system import System
from ngfsi.verify import Benchmark, Reference, Setting, Values
from ngfsi_studies.verification.plane import case_of
from ngfsi_studies.verification.shear_waves import FLUID, INNER, KF, OMEGA, PERIOD, SOME_FLOW, swinging
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


class Shaken(System):
    """The coupled system with the exact profile at the inlet and a prescribed motion of the mesh between the walls."""

    def __init__(self, case: Case, domain: Domain, amplitude: float) -> None:
        super().__init__(case, domain)
        bump = ng.sin(np.pi * ng.x / LENGTH) * ng.cos(np.pi * ng.y / (2 * INNER))
        field = ng.GridFunction(self.unknowns.space)
        field.components[0].Set(amplitude * bump * ng.CF((ng.sin(2 * np.pi * ng.x / LENGTH) + 0.5, 0.8)))
        self.shape = np.array(field.vec.FV().NumPy())[self.unknowns.blocks["e"]]

    def place(self) -> Any:
        """Return the position across the channel of each point of the mesh."""
        return ng.y + self.state.components[0][1]

    def mesh(self, t: float, rate: int = 0) -> Array:
        """Return a vector of unknowns with the motion of the mesh, or its rate."""
        phase, values = 2 * np.pi * SHAKES / PERIOD, np.zeros(self.unknowns.size)
        share = phase * np.sin(phase * t) / 2 if rate else (1 - np.cos(phase * t)) / 2
        values[self.unknowns.blocks["e"]] = self.shape * share
        return values

    def exact_state(self, t: float) -> Array:
        """Return the unknowns of mesh and velocity of the exact solution."""
        self.values[:] = self.mesh(t)
        rate, field = ng.GridFunction(self.unknowns.space), ng.GridFunction(self.unknowns.space)
        rate.vec.FV().NumPy()[:] = self.mesh(t, 1)
        relative = ng.CF((velocity(t, self.place()), 0)) - rate.components[0]
        field.components[1].Set(relative, definedon=self.domain.materials("fluid"), bonus_intorder=4)
        exact: Array = self.values + np.array(field.vec.FV().NumPy())
        return exact

    def set_loads(self, t: float) -> None:
        """Take inflow and mesh of time t (s)."""
        super().set_loads(t)
        inflow, profile = ng.GridFunction(self.unknowns.space), ng.CF((velocity(t, ng.y), 0))
        inflow.components[1].Set(profile, definedon=self.domain.boundaries("inlet"), bonus_intorder=4)
        inlet, inside = self.unknowns.inlet, self.unknowns.blocks["e"]
        self._prescribed = (inlet, np.array(inflow.vec.FV().NumPy()[inlet])), (inside, self.mesh(t)[inside])

    def apply_inflow(self) -> None:
        """Prescribe profile and mesh."""
        for where, values in self._prescribed:
            self.values[where] = values


def compute(setting: Setting) -> Values:
    """Return the largest error of the velocity over a period from the exact state, and how far the mesh is deformed."""
    order, step = setting["order"], setting["step"] * PERIOD
    mesh = PlaneMesh(far_size=setting["size"] * 4e-3, curving_order=order)
    geometry = StraightChannel(length=LENGTH, height=2 * INNER, mesh=mesh)
    changes = {"time": TimeStepping(step=step, end=PERIOD, scheme="bdf2")}
    found = Shaken(
        case_of(geometry, SOME_FLOW, Materials(fluid=FLUID), **changes), Domain.build(geometry), setting["amplitude"]
    )
    history = History([0.0, -step], [found.exact_state(t) for t in (0.0, -step)],
                      [found.mesh(t, 1) for t in (0.0, -step)], smooth=1)  # fmt: skip
    loop = TimeLoop(found.case, found, Newton(found, choose_backend("auto"), "w", "p"), history=history)
    J = Kinematics(found.fields(found.state.components).grad_motion).J
    u, deformation = found.fields(found.state.components).velocity, Deformation(found)
    errors, ratios = [], []
    for at in loop.run():
        exact = ng.CF((velocity(at.time, found.place()), 0))
        errors.append(relative_error(u, exact, found.domain, "fluid", weight=J))
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


def _levels(steps: Sequence[float], sizes: Mapping[int, Sequence[float]]) -> dict[str, tuple[Setting, ...]]:
    shaken = {"amplitude": AMPLITUDE}
    return {
        "time steps": tuple({**shaken, "order": 4, "size": 0.3, "step": h, "h": h} for h in steps),
        **{
            f"elements, k = {k}": tuple(
                {**shaken, "order": k, "size": h, "step": 1 / (40 if k == 2 else 160), "h": h} for h in of_order
            )
            for k, of_order in sizes.items()
        },
    }


LEVELS = {
    "ci": _levels((1 / 10, 1 / 20), {2: (0.6, 0.3)}),
    "full": _levels((1 / 20, 1 / 40, 1 / 80), {2: (0.6, 0.3), 3: (0.6, 0.3)}),
}
ALLOWED = {"time steps": 1e-3, "elements, k = 2": 3e-3, "elements, k = 3": 3e-4}
REFERENCES = (
    Reference("velocity, L2 error", 0.0, "1", ALLOWED, "J. R. Womersley, J Physiol 127 (1955) 553, in the plane",
              {"time steps": 2.0, "elements, k = 2": 3.0, "elements, k = 3": 4.0}),
    Reference("smallest volume ratio of the mesh", 0.33, "1", 0.3, "as deformed as intended"),
)  # fmt: skip
