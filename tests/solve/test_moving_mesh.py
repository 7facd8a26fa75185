"""Flows that do not care how the mesh moves: the residual must not either.

The velocity u = A x + c of the deformed shape is a polynomial of the deformed coordinates, so that it lies in the
finite element space on any mesh. Its acceleration is zero at a fixed place, hence A (velocity of the mesh) at a fixed
point of the reference shape, and A u following the blood. The expected residual is assembled on the deformed mesh
itself, without pull-back, rates or mesh velocity.
"""

from __future__ import annotations

from typing import Any

import ngsolve as ng
import numpy as np
import pytest
from numpy.typing import NDArray

from ngfsi.conditions.profiles import developed
from ngfsi.materials import Newtonian
from ngfsi.physics.fields import MOTION, PRESSURE, VELOCITY
from ngfsi.physics.integrals import Integral
from ngfsi.system.forms import residual_form
from ngfsi.system.system import System
from tests.slopes import apply
from tests.vein import BONED, block, case_of, deformed, domain_of, position, randomise, rows, value_of

Array = NDArray[np.float64]

THICK = Newtonian(density=1060.0, viscosity=0.5)
UNIFORM = 30.0
"""Beyond the reference; with this fluid (SI) pressure, viscous stress and inertia are of one size."""
REFERENCE = 1300.0
"""Pressure that the wall alone feels."""
MIXED = np.array([[0.9, 0.3, -0.5], [-0.8, 0.4, 0.7], [0.6, -0.2, 0.5]]) * 20
"""Velocity gradient (1/s) with strain, rotation and dilation."""
ALONG, AGAINST = np.array([0.02, -0.01, 0.6]), np.array([0.02, -0.01, -0.6])
"""Velocities (m/s) with which blood leaves or enters everywhere through the outlet."""


class Flow:
    """The velocity A x + c."""

    def __init__(self, gradient: Array, uniform: Array) -> None:
        self.A = ng.CF(tuple(gradient.ravel()), dims=(3, 3))
        self.c = ng.CF(tuple(uniform))

    def __call__(self, place: Any) -> Any:
        return self.A * place + self.c


def prescribed(order: int, flow: Flow, **changes: Any) -> System:
    """Return a system in a random deformed state, moving at random, whose blood flows as given; `changes`: of the
    case."""
    geometry = BONED.replace(**{"mesh.curving_order": order})
    system = System(case_of(geometry, **{"materials.fluid": THICK, **changes}), domain_of(geometry))
    randomise(system)
    domain, new, A = system.domain, system.new_weight.Get(), flow.A
    fluid = domain.materials(*domain.lumens)
    m, w, p = (system.named(system.state)[name] for name in (MOTION, VELOCITY, PRESSURE))
    hm, hw = (system.named(system.velocity_history)[name] for name in (MOTION, VELOCITY))
    am = system.named(system.acceleration_history)[MOTION]
    u = flow(position() + m)
    set_on_solids(system, system.velocity_history, u - new * m)
    mesh_velocity = new * m + hm
    w.Set(u - mesh_velocity, definedon=fluid)
    set_on_solids(system, system.acceleration_history, A * mesh_velocity - new * mesh_velocity)
    hw.Set(A * mesh_velocity - new * u - am, definedon=fluid)
    p.Set(UNIFORM, definedon=fluid)
    value_of(system, "outlet").Set(UNIFORM + REFERENCE)
    system.reference().Set(REFERENCE)
    system.conditions["outlet"].prescribe(system.values)  # the inlet's would be another flow
    return system


def set_on_solids(system: System, field: Any, value: Any) -> None:
    """Give the motion's part of a field a value on the solids, and leave it inside of the lumen as it is."""
    whole = ng.GridFunction(system.unknowns.space)
    whole.components[0].Set(value, definedon=system.domain.materials(*system.domain.geometry.solids))
    part = system.unknowns.blocks["d"]
    field.vec.FV().NumPy()[part] = whole.vec.FV().NumPy()[part]


def residual(system: System) -> Array:
    """Return the residual of the blood, without tissue and mesh motion."""
    (terms, measure), *outlet = system.blood_integrals()
    form = residual_form(system.unknowns.space, [Integral(terms[:-1], measure), *outlet])
    return apply(form, system.state.vec, system.values)


def expected(system: System, flow: Flow, *, free: bool = False) -> Array:
    """Return rho A u . v + sigma : grad v - div u q on the deformed shape, with the traction of the outlet and, where
    blood enters there, the momentum of what differs from developed flow; `free`: without that traction."""
    domain, space = system.domain, system.unknowns.space
    v, _, dp = space.TestFunction()
    grad_v, rho, mu = ng.Grad(v), THICK.density, THICK.viscosity
    shape = developed(domain, "outlet", system.unknowns.order)
    with deformed(system):
        over = domain.ds("outlet", bonus_intorder=4)
        profile = ng.CF((0, 0, -1)) * shape
        profile = profile / ng.Integrate(-profile * ng.specialcf.normal(3) * over, domain.mesh)
        place, n, A = position(), ng.specialcf.normal(3), flow.A
        u = flow(place)
        stress = mu * (A + A.trans) - UNIFORM * ng.Id(3)
        traction = 0 * n if free else mu * A.trans * n - UNIFORM * n
        out = ng.InnerProduct(system.named(system.state)[VELOCITY], n)
        outflow = ng.Integrate(out * domain.ds("outlet", bonus_intorder=4), domain.mesh)
        differs = u - max(0.0, -outflow) * profile
        backflow = rho * ng.IfPos(out, 0, out) * differs
        form = ng.LinearForm(space)
        form += (rho * (A * u) * v + ng.InnerProduct(stress, grad_v) - ng.Trace(A) * dp) * domain.dx(
            "fluid", bonus_intorder=4
        )
        form += -(traction + backflow) * v * domain.ds("outlet", skeleton=True, bonus_intorder=4)
        form.Assemble()
    return np.array(form.vec.FV().NumPy())


FLOWS = {
    "at rest": (0 * MIXED, 0 * ALONG),
    "uniform": (0 * MIXED, ALONG),
    "linear": (MIXED, ALONG),
    "entering through the outlet": (MIXED, AGAINST),
}
ACCURACY = {2: 1e-5, 3: 1e-5}
"""Of the quadrature."""


@pytest.mark.parametrize("order", [2, 3])
@pytest.mark.parametrize("name", FLOWS)
def test_residual_is_that_of_the_deformed_shape(name: str, order: int) -> None:
    flow = Flow(*FLOWS[name])
    system = prescribed(order, flow)
    found, wanted = residual(system), expected(system, flow)
    accuracy = 1e-4 if "entering" in name else ACCURACY[order]  # backflow is switched: not a polynomial
    for row in ("w", "d"):  # with dofs of the inlet, and the forces on the wall
        size = np.linalg.norm(rows(system, row, wanted))
        assert np.linalg.norm(rows(system, row, found - wanted)) < accuracy * size, row
    mass = np.linalg.norm(block(system, "p", wanted))
    dilation = np.pi * 5.55e-3**2 * 1e-2 * abs(np.trace(FLOWS[name][0]))
    assert np.linalg.norm(block(system, "p", found - wanted)) < ACCURACY[order] * mass + 1e-18
    assert -np.sum(block(system, "p", found)) == pytest.approx(dilation, rel=0.5, abs=1e-18)  # the shape is random


@pytest.mark.parametrize(("order", "accuracy"), [(2, 1e-6), (3, 1e-6)])
def test_uniform_flow_at_uniform_pressure_is_a_solution_on_any_moving_mesh(order: int, accuracy: float) -> None:
    system = prescribed(order, Flow(0 * MIXED, ALONG))
    found, free = residual(system), system.unknowns.free()
    force = np.abs(rows(system, "w", found)).max()  # on the inlet, of the pressure there
    assert force > 0.1 * UNIFORM * np.pi * 5.55e-3**2
    assert np.abs(rows(system, "w", found)[block(system, "w", free)]).max() < accuracy * force
    flux = np.pi * 5.55e-3**2 * 0.6
    assert np.abs(block(system, "p", found)).max() < 1e-13 * flux


def test_random_meshes_are_really_deformed() -> None:
    system = prescribed(2, Flow(MIXED, ALONG))
    fields = system.fields()
    J = ng.Det(ng.Id(3) + fields.grad_motion)
    rule = {ng.PRISM: ng.IntegrationRule(ng.PRISM, 4)}
    values = J(system.domain.mesh.MapToAllElements(rule, system.domain.materials("fluid")))
    assert 0 < values.min() < 0.8
    assert values.max() > 1.2
