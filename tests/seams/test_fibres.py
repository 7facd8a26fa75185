"""A law with a field of fibre directions, added in this file alone: the engine knows nothing of fibres."""

from __future__ import annotations

from typing import Any, ClassVar, Literal

import ngsolve as ng
import numpy as np
import pytest
from ngsolve import CoefficientFunction, Det, InnerProduct
from scipy.optimize import root

from ngfsi.conditions import Condition
from ngfsi.linear.backends import choose_backend
from ngfsi.materials.solid.law import Pair, Place, SolidLaw, SolidModel
from ngfsi.measure.deformation import Deformation
from ngfsi.solve.initial import initial_state
from ngfsi.solve.newton import Newton
from ngfsi.system.system import System
from ngfsi.units import Angle, Pressure
from tests.seams.block import case_of, domain, mean


class Fibred(SolidLaw):
    """W = mu/2 (J^(-2/3) tr C - 3) + K/2 (J - 1)^2 + k/2 (a . C a - 1)^2, fibres a at an angle in the plane xy."""

    formula: ClassVar[str] = ""
    source: ClassVar[str] = "for this test"
    law: Literal["test_fibred"] = "test_fibred"
    mu: Pressure = 10e3
    K: Pressure = 40e3
    k: Pressure = 30e3
    angle: Angle = 0.0

    def energies(self, _F: CoefficientFunction) -> Pair:
        raise AssertionError("a law with fibres must be bound")

    def bind(self, place: Place) -> SolidModel:
        field = ng.GridFunction(ng.VectorL2(place.mesh, order=0))
        field.Set(ng.CF((np.cos(self.angle), np.sin(self.angle), 0.0)))
        return FibredModel(self, field)


class FibredModel(SolidModel):
    def __init__(self, law: Fibred, direction: CoefficientFunction) -> None:
        self.density, self._law, self._direction = law.density, law, direction

    def energies(self, F: CoefficientFunction) -> Pair:
        law, J, C = self._law, Det(F), F.trans * F
        fibre = InnerProduct(self._direction, C * self._direction) - 1
        shear = law.mu / 2 * (J ** (-2 / 3) * ng.Trace(C) - 3) + law.k / 2 * fibre**2
        return shear, law.K / 2 * (J - 1) ** 2


class Held(Condition):
    """Holds the rigid motions of a body in balance, by six unknowns of three vertices on the axes."""

    name = "held"

    def points(self, motion: Any) -> list[int]:
        mesh = motion.mesh
        at = {tuple(np.round(mesh[v].point, 12)): v for v in mesh.vertices}
        origin, x, y = (motion.GetDofNrs(at[place]) for place in ((0, 0, 0), (10e-3, 0, 0), (0, 10e-3, 0)))
        return [*origin, x[1], x[2], y[2]]


def stretches(law: Fibred, pressure: float) -> tuple[float, float]:
    """Return the stretches along and across the fibres under a pressure on all sides, from W(f, t) by hand.

    Cauchy stresses f W_f / J and t W_t / (2 J) are -p, with J = f t^2.
    """

    def surplus(unknown: Any) -> list[float]:
        f, t = unknown
        J = f * t**2
        trace = f**2 + 2 * t**2
        of_J = law.K * (J - 1) - law.mu / 3 * J ** (-5 / 3) * trace
        along = law.mu * J ** (-2 / 3) * f + of_J * t**2 + 2 * law.k * (f**2 - 1) * f
        across = 2 * law.mu * J ** (-2 / 3) * t + of_J * 2 * f * t
        return [f * along / J + pressure, t * across / (2 * J) + pressure]

    found = root(surplus, (1.0, 1.0), tol=1e-13)
    assert found.success
    return float(found.x[0]), float(found.x[1])


@pytest.mark.parametrize("degrees", [0, 45, 120])
def test_a_cube_with_oblique_fibres_under_pressure(degrees: float) -> None:
    law = Fibred(density=1000.0, angle=float(np.radians(degrees)))
    pressure, cube = 8e3, domain()
    system = System(case_of(law, pressure), cube, more=[Held()])
    initial_state(system, Newton(system, choose_backend("auto")))
    F = np.reshape(
        mean(ng.CF(tuple(ng.Grad(system.motion)[i, j] for i in range(3) for j in range(3))), cube), (3, 3)
    ) + np.eye(3)
    f, t = stretches(law, pressure)
    a = np.array([np.cos(law.angle), np.sin(law.angle), 0.0])
    wanted = t * np.eye(3) + (f - t) * np.outer(a, a)
    assert abs(f - t) > 0.05  # the fibres matter
    np.testing.assert_allclose(F.T @ F, wanted @ wanted, rtol=1e-9, atol=1e-9)
    assert abs((F.T @ F)[0, 1]) > 0.05 or degrees == 0  # oblique fibres shear the cube


def test_ellipticity_is_said_not_to_be_checked() -> None:
    cube = domain()
    said = Deformation(System(case_of(Fibred(density=1000.0)), cube, more=[Held()])).approaching()
    (text,) = said
    assert text.startswith("strong ellipticity of 'solid' is not checked")
