"""Springs on the outer face of a wall, added in this file alone."""

from __future__ import annotations

from typing import Any

import ngsolve as ng
import numpy as np
import pytest
from ngfsi_geometry.segment import MeshSettings
from ngfsi_geometry.tube import BareTube

from ngfsi.case import Materials
from ngfsi.conditions import Condition
from ngfsi.config.functions import FlowConstant, PressureConstant
from ngfsi.linear.backends import choose_backend
from ngfsi.materials import CompressibleNeoHookean
from ngfsi.physics.integrals import Integral
from ngfsi.solve.initial import initial_state
from ngfsi.solve.newton import Newton
from ngfsi.system.system import System
from tests.vein import BLOOD, case_of, domain_of

E, NU, STIFFNESS, PRESSURE = 100e3, 0.3, 5e6, 10.0


class Springs(Condition):
    """Traction -k u on a boundary."""

    name = "springs"

    def supports(self) -> bool:
        return True

    def static_integrals(self, m: Any, v: Any) -> list[Integral]:
        work = STIFFNESS * ng.InnerProduct(m.Trace(), v.Trace())
        return [Integral([work], self._setup.domain.ds("skin"))]


def test_a_thick_cylinder_on_springs() -> None:
    """Lame's solution u = A r + B/r in plane strain, with sigma_r(a) = -p and sigma_r(b) = -k u(b)."""
    mesh = MeshSettings(element="mixed", axial_layers=1, vein_size=3e-3, lumen_radii=(), wall_layers=2, curving_order=3)
    tube = BareTube(length=3e-3, wall_thickness=3e-3, mesh=mesh)
    a, b = tube.lumen_radius, tube.lumen_radius + tube.wall_thickness
    lame, shear = E * NU / ((1 + NU) * (1 - 2 * NU)), E / (2 * (1 + NU))
    stress = [[2 * (lame + shear), -2 * shear / r**2] for r in (a, b)]
    rows = [stress[0], [stress[1][0] + STIFFNESS * b, stress[1][1] + STIFFNESS / b]]
    A, B = np.linalg.solve(rows, [-PRESSURE, 0.0])
    wall = CompressibleNeoHookean(young=E, poisson=NU, density=1000.0)
    case = case_of().replace(**{
        "geometry": tube, "materials": Materials(wall=wall, fluid=BLOOD), "discretisation.order": 3,
        "loads.inlet_flow": FlowConstant(value=0.0), "loads.outlet_pressure": PressureConstant(value=PRESSURE),
    })  # fmt: skip
    system = System(case, domain_of(tube), more=[Springs()])
    initial_state(system, Newton(system, choose_backend("auto")))
    radial = (ng.x * system.motion[0] + ng.y * system.motion[1]) / ng.sqrt(ng.x**2 + ng.y**2)
    for name, r in (("interface", a), ("skin", b)):
        found = ng.Integrate(radial * system.domain.ds(name), system.domain.mesh) / system.domain.area(name)
        assert found == pytest.approx(A * r + B / r, rel=1e-3, abs=0)
