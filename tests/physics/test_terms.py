"""Kinematics and every term of the weak form against formulas written out with numpy at random matrices.

The formulas are those of the deformed shape, multiplied by the ratio of volumes or areas: sigma : grad v dv with
dv = J dV and grad v = Grad v F^-1, and t . v da with n da = J F^-T N dA (Nanson).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest
from ngsolve import CF, Grad, GridFunction, Id, Mesh, VectorH1, ds, dx, specialcf, x, y, z
from ngsolve.meshes import MakeStructured3DMesh
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from ngfsi.materials import CompressibleNeoHookean, MooneyRivlin, Newtonian
from ngfsi.physics import terms
from ngfsi.physics.integrals import Integral
from ngfsi.physics.kinematics import Kinematics
from ngfsi.system.forms import residual_form, tangent_form
from tests.slopes import slope

Array = NDArray[np.float64]
I = np.eye(3)  # noqa: E741

YOUNG, POISSON = 133e3, 0.3
MU, LAM = YOUNG / 2.6, YOUNG * POISSON / (1.3 * 0.4)
SOLID = CompressibleNeoHookean(young=YOUNG, poisson=POISSON, density=1060.0)
MOONEY = MooneyRivlin(c10=13.1e3, c01=-9.61e3, c11=8.86e3, K=28.45e3, density=1060.0)
BLOOD = Newtonian(density=1060.0, viscosity=3.5e-3)

RNG = np.random.default_rng(4)
H = 0.3 * RNG.standard_normal((3, 3))  # grad m
GU = 10.0 * RNG.standard_normal((3, 3))  # reference gradient of u
GV = RNG.standard_normal((3, 3))  # reference gradient of the test function
G0 = I + 0.2 * RNG.standard_normal((3, 3))  # dX/dX0 of a prestressed shape
U, W, A, V, N = (RNG.standard_normal(3) for _ in range(5))
N = N / np.linalg.norm(N)
P, Q, RHO = 800.0, 1.7, 1060.0

F = I + H
J = float(np.linalg.det(F))
FINV = np.linalg.inv(F)
L = GU @ FINV
GRADV = GV @ FINV
AREA = J * FINV.T @ N
STRESS = BLOOD.viscosity * (L + L.T)


@cache
def cube() -> Mesh:
    return MakeStructured3DMesh(hexes=False, nx=1, ny=1, nz=1)


def value(term: CF) -> Array:
    """Value of a constant coefficient function."""
    found = np.array(term(cube()(0.3, 0.3, 0.3)))
    return found.reshape(term.dims) if len(term.dims) == 2 else found


def matrix(values: Array) -> CF:
    return CF(tuple(values.ravel()), dims=(3, 3))


def vector(values: Array) -> CF:
    return CF(tuple(values))


K = Kinematics(matrix(H))


def neo_hookean_stress(F: Array) -> Array:
    """First Piola-Kirchhoff stress mu (F - F^-T) + lambda ln J F^-T."""
    back = np.linalg.inv(F).T
    return MU * (F - back) + LAM * np.log(np.linalg.det(F)) * back


def test_the_random_matrices_are_generic() -> None:
    assert 0.2 < J < 5
    assert abs(J - 1) > 0.1
    assert np.linalg.norm(F - F.T) > 0.3


def test_kinematics() -> None:
    assert_allclose(value(K.F), F, rtol=1e-14)
    assert value(K.J) == pytest.approx(J, rel=1e-13)
    assert_allclose(value(K.inverse), FINV, rtol=1e-12)
    assert_allclose(value(K.cof), J * FINV.T, rtol=1e-12)
    # Nanson: the area spanned by two mapped tangents
    a, b = V, W
    assert_allclose(value(K.cof) @ np.cross(a, b), np.cross(F @ a, F @ b), rtol=1e-12)


TERMS: dict[str, tuple[Callable[[], CF], float]] = {
    "internal work": (
        lambda: terms.internal_work(SOLID, matrix(F), matrix(GV)),
        float(np.sum(neo_hookean_stress(F) * GV)),
    ),
    "internal work of a prestressed shape": (
        lambda: terms.internal_work(SOLID, matrix(F), matrix(GV), matrix(G0)),
        float(np.sum(neo_hookean_stress(F @ G0) * (GV @ G0)) / np.linalg.det(G0)),
    ),
    "inertia": (lambda: terms.inertia(RHO, vector(A), vector(V)), RHO * A @ V),
    "convective inertia": (
        lambda: terms.convective_inertia(RHO, K, vector(A), matrix(GU), vector(W), vector(V)),
        RHO * J * (A + L @ W) @ V,
    ),
    "fluid stress work": (
        lambda: terms.fluid_stress_work(BLOOD, K, matrix(GU), CF(P), matrix(GV)),
        J * float(np.sum((STRESS - P * I) * GRADV)),
    ),
    "incompressibility": (lambda: terms.incompressibility(K, matrix(GU), CF(Q)), -J * float(np.trace(L)) * Q),
    "harmonic extension": (lambda: terms.harmonic_extension(2.5, matrix(H), matrix(GV)), 2.5 * float(np.sum(H * GV))),
    "follower pressure": (lambda: terms.follower_pressure(CF(P), K, vector(N), vector(V)), P * AREA @ V),
    "relative flux": (lambda: terms.relative_flux(K, vector(W), vector(N)), W @ AREA),
    "hydrostatic pressure": (
        lambda: terms.hydrostatic_pressure(SOLID, matrix(F)),
        -float(np.trace(neo_hookean_stress(F) @ F.T)) / (3 * J),
    ),
    # with isochoric invariants only the volumetric part has a trace: p = -K (J - 1)
    "hydrostatic pressure of the tissue": (
        lambda: terms.hydrostatic_pressure(MOONEY, matrix(F)),
        -MOONEY.K * (J - 1),
    ),
}


@pytest.mark.parametrize("name", TERMS)
def test_terms(name: str) -> None:
    term, expected = TERMS[name]
    assert value(term()) == pytest.approx(expected, rel=1e-11)


def test_cauchy_stress() -> None:
    stress = neo_hookean_stress(F) @ F.T / J
    assert_allclose(np.reshape(value(terms.cauchy_stress(SOLID, matrix(F))), (3, 3)), stress, rtol=1e-11)


def test_tangential_part_of_a_traction() -> None:
    n = AREA / np.linalg.norm(AREA)
    traction = STRESS @ n
    shear = value(terms.tangential(vector(traction), vector(-n)))
    assert_allclose(shear, traction - (traction @ n) * n, rtol=1e-10)
    assert abs(shear @ n) < 1e-12 * np.linalg.norm(shear)


# ---------------------------------------------------------------- derivatives by differences


def _terms(m: Any, v: Any) -> dict[str, tuple[Any, Any]]:
    """Each term with everything that can depend on the unknown m doing so, and its measure."""
    k, u, grad_u, grad_v = Kinematics(Grad(m)), 3 * m, 3 * Grad(m), Grad(v)
    n, surface = specialcf.normal(3), Kinematics(Grad(m).Trace())
    outlet = terms.opening(BLOOD, CF(P), k, grad_u, n, v) + terms.backflow(CF(RHO), k, u, m, n, v)
    return {
        "internal work": (terms.internal_work(SOLID, Id(3) + Grad(m), grad_v), dx),
        "internal work, tissue": (terms.internal_work(MOONEY, Id(3) + Grad(m), grad_v), dx),
        "prestressed": (terms.internal_work(SOLID, Id(3) + Grad(m), grad_v, matrix(G0)), dx),
        "convective inertia": (terms.convective_inertia(RHO, k, 7 * m, grad_u, u, v), dx),
        "fluid stress work": (terms.fluid_stress_work(BLOOD, k, grad_u, 100 * m[0], grad_v), dx),
        "incompressibility": (terms.incompressibility(k, grad_u, v[0]), dx),
        "harmonic extension": (terms.harmonic_extension(2.0, Grad(m), grad_v), dx),
        "follower pressure": (terms.follower_pressure(CF(P), surface, n, v.Trace()), ds),
        "outlet": (outlet, ds(skeleton=True)),
        "elastic extension": (terms.elastic_extension(2.0, k, grad_v), dx),
    }


@pytest.mark.parametrize("dilation", [0.5, -0.3])
def test_derivative_of_every_term(dilation: float) -> None:
    """At random states around a dilation, so that blood flows out through the whole outlet (+) or in (-)."""
    space = VectorH1(cube(), order=2)
    trial, test = space.TnT()
    state, rng = GridFunction(space), np.random.default_rng(5)
    state.Set(dilation * CF((x - 0.5, y - 0.5, z - 0.5)))
    state.vec.FV().NumPy()[:] += 0.03 * rng.standard_normal(space.ndof)
    direction = rng.standard_normal(space.ndof)
    for name, (integrand, measure) in _terms(trial, test).items():
        parts = [Integral([integrand], measure)]
        residual, tangent = residual_form(space, parts), tangent_form(space, parts)
        exact, measured = slope(residual, tangent, state.vec, direction, step=3e-4)
        assert np.linalg.norm(exact) > 0, name
        assert np.linalg.norm(exact - measured) < 1e-8 * np.linalg.norm(exact), name
