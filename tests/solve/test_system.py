"""The coupled system's residual and its derivative, at states that solve nothing."""

from __future__ import annotations

from typing import Any

import ngsolve as ng
import numpy as np
import pytest
from numpy.typing import NDArray

from ngfsi.config.functions import FlowConstant, PressureConstant
from ngfsi.linear.backends import choose_backend
from ngfsi.physics import terms
from ngfsi.physics.fields import MOTION
from ngfsi.solve.initial import initial_state
from ngfsi.solve.newton import Newton
from ngfsi.system.forms import residual_form
from ngfsi.system.system import System
from ngfsi.system.unknowns import BLOCKS
from tests.slopes import apply, difference
from tests.vein import (
    block,
    blood_form,
    case_of,
    column_slope,
    deformed,
    position,
    randomise,
    rows,
    system_of,
    value_of,
)

Array = NDArray[np.float64]

STEP = {"d": 1e-6, "w": 1e-3, "p": 10.0, "e": 1e-6}
"""Of the differences: small against the random state, large against rounding."""

INDEPENDENT = {("p", "p"), ("e", "w"), ("e", "p")}
"""Blocks (row, column) that are zero: no stabilisation of the pressure, and nothing but geometry moves the mesh."""


@pytest.fixture(scope="module", params=["preload", "prestress"])
def lively(request: pytest.FixtureRequest) -> System:
    """A random state; for prestress with a random stress-free shape."""
    system = system_of(case_of(**{"conditions.initial_state": request.param}))
    randomise(system)
    if system.relaxation is not None:
        values = system.relaxation.vec.FV().NumPy()
        values[:] = 1.5e-4 * np.random.default_rng(8).standard_normal(len(values))
    return system


@pytest.mark.parametrize("column", BLOCKS)
def test_jacobian_by_differences(lively: System, column: str) -> None:
    exact, measured = column_slope(lively, column, STEP[column])
    for row in BLOCKS:
        a, b = rows(lively, row, exact), rows(lively, row, measured)
        assert np.linalg.norm(a - b) <= 1e-7 * np.linalg.norm(a), (row, column)
        assert (not np.any(a)) == ((row, column) in INDEPENDENT), (row, column)


def test_the_residual_is_that_of_its_integrals(lively: System) -> None:
    """Parts in spaces of their own, with rates as vectors and inertia as a matrix, sum up to the integrals of the
    unknowns, which the tangent differentiates."""
    inertia = lively.inertia_integrals(lively._acceleration, lively._test[MOTION])
    whole = residual_form(lively.unknowns.space, [*lively.integrals(), *inertia])
    ours, exact = (apply(form, lively.state.vec, lively.values) for form in (lively.form, whole))
    for name in BLOCKS:
        part = lively.unknowns.blocks[name]
        assert np.linalg.norm(ours[part] - exact[part]) < 1e-12 * np.linalg.norm(exact[part]), name


def test_differences_notice_a_wrong_derivative(lively: System) -> None:
    """The derivative one rate of 0.1 % away is told apart."""
    part = lively.unknowns.blocks["w"]
    direction = np.zeros(lively.unknowns.size)
    direction[part] = 1.0
    before = difference(lively.form, lively.state.vec, direction, STEP["w"])
    rate = lively.new_weight.Get()
    try:
        lively.new_weight.Set(1.001 * rate)
        after = difference(lively.form, lively.state.vec, direction, STEP["w"])
    finally:
        lively.new_weight.Set(rate)
    change = rows(lively, "w", after - before)
    assert np.linalg.norm(change) > 1e-5 * np.linalg.norm(rows(lively, "w", before))


def test_tissue_neither_pushes_nor_turns_itself(lively: System) -> None:
    """Internal forces have no resultant and, the Cauchy stress being symmetric, no moment about the deformed shape."""
    space = lively.unknowns.space
    form = ng.BilinearForm(space, check_unused=False)
    d, v = space.TrialFunction()[0], space.TestFunction()[0]
    for name, law in lively.solids.items():
        work = terms.internal_work(law, ng.Id(3) + ng.Grad(d), ng.Grad(v), lively.stress_free_gradient())
        form += work * lively.domain.dx(name)
    forces = block(lively, "d", apply(form, lively.state.vec, lively.values))
    place = position() + lively.motion
    axis = ng.CF((0.3, -0.5, 0.8))
    motions = [ng.CF((1, 0, 0)), ng.CF((0, 1, 0)), ng.CF((0, 0, 1)), ng.Cross(axis, place) / 1e-2]
    test = ng.GridFunction(space)
    for motion in motions:
        test.components[0].Set(motion, definedon=lively.domain.materials(*lively.domain.geometry.solids))
        shape = block(lively, "d", np.array(test.vec.FV().NumPy()))
        assert abs(forces @ shape) < 1e-10 * np.linalg.norm(forces) * np.linalg.norm(shape)


def test_inertia_and_skin_pressure_of_the_tissue(lively: System) -> None:
    """Virtual work of translations: mass times acceleration, and the force of the pressure on the deformed skin."""
    space, domain = lively.unknowns.space, lively.domain
    whole, blood = (apply(form, lively.state.vec, lively.values) for form in (lively.form, blood_form(lively)))
    forces = block(lively, "d", whole - blood)
    d, rate = lively.motion, lively.new_weight.Get()
    solid_rate = rate * d + lively.velocity_history.components[0]
    acceleration = rate * solid_rate + lively.acceleration_history.components[0]
    with deformed(lively):
        skin = integral(ng.specialcf.normal(3), domain.ds("skin", bonus_intorder=4), domain.mesh)
    masses = [law.density * integral(acceleration, domain.dx(name), domain.mesh) for name, law in lively.solids.items()]
    inertia = sum(masses)
    wanted = inertia + value_of(lively, "on the skin").Get() * skin
    test, found = ng.GridFunction(space), []
    for motion in np.eye(3):
        test.components[0].Set(ng.CF(tuple(motion)), definedon=domain.materials(*domain.geometry.solids))
        found.append(forces @ block(lively, "d", np.array(test.vec.FV().NumPy())))
    assert np.linalg.norm(found - wanted) < 1e-6 * np.linalg.norm(inertia)
    assert np.linalg.norm(inertia) > 1e-2 * np.linalg.norm(wanted)


def integral(vector: ng.CoefficientFunction, measure: Any, mesh: ng.Mesh) -> Array:
    return np.array([ng.Integrate(vector[i] * measure, mesh) for i in range(3)])


def test_integration_converges_with_its_order() -> None:
    """What the rules leave out of the forces falls with their order: the blood's to rounding, the solids' slower, whose
    energy is no polynomial."""
    forces = {}
    for extra in (0, 4, 8, 12):
        system = system_of(case_of(**{"discretisation.extra_integration_order": extra}))
        randomise(system)
        forces[extra] = np.array(system.residual().FV().NumPy())
    for name, bounds in {"d": (2e-3, 1e-4, 2e-6), "w": (1e-6, 1e-11, 1e-13), "p": (1e-6, 1e-12, 1e-12)}.items():
        exact = block(system, name, forces[12])
        for extra, bound in zip((0, 4, 8), bounds, strict=True):
            missing = np.linalg.norm(block(system, name, forces[extra]) - exact) / np.linalg.norm(exact)
            assert missing < bound, (name, extra)
        assert np.linalg.norm(block(system, name, forces[0]) - exact) > bounds[0] / 5 * np.linalg.norm(exact)


@pytest.mark.parametrize("kind", ["preload", "prestress"])
def test_where_nothing_acts_at_the_start_nothing_is_solved(kind: str) -> None:
    """The first thousandth of a pascal is noticed, and so is the least flow."""
    none = PressureConstant(value=0.0)
    nothing = {"loads.inlet_flow": FlowConstant(value=0.0), "loads.outlet_pressure": none,
               "loads.skin_pressure": none, "conditions.initial_state": kind}  # fmt: skip
    little = PressureConstant(value=1e-3)
    for change, rests in (
        ({}, True),
        ({"loads.inlet_flow": FlowConstant(value=1e-15)}, False),
        ({"loads.outlet_pressure": little}, False),
        ({"loads.skin_pressure": little}, False),
    ):
        system = system_of(case_of(**{**nothing, **change}))
        assert (initial_state(system, Newton(system, choose_backend("auto"))) == 0) == rests
        assert np.any(system.values) == (not rests) or kind == "prestress"
