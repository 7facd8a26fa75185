"""A fluid that thins under shear, added in this file alone, in a round pipe."""

from __future__ import annotations

from typing import Any, ClassVar, Literal

import ngsolve as ng
import numpy as np
import pytest
from ngfsi_geometry.segment import MeshSettings

from ngfsi.conditions import GivenVelocity
from ngfsi.linear.backends import choose_backend
from ngfsi.materials.fluid.law import FluidLaw
from ngfsi.measure.wall import Wall
from ngfsi.physics.fields import PRESSURE, VELOCITY
from ngfsi.solve.initial import steady_flow
from ngfsi.system.system import System
from tests.vein import TUBE, case_of, domain_of

FLOW, N, CONSISTENCY = 2.9e-6, 0.7, 20e-3
MESH = MeshSettings(
    element="mixed", axial_layers=2, far_size=20e-3, vein_size=3.5e-3, lumen_radii=(0.85, 0.65, 0.45, 0.25, 0.1),
    curving_order=3,
)  # fmt: skip


class PowerLaw(FluidLaw):
    """mu = K g^(n - 1)."""

    formula: ClassVar[str] = ""
    source: ClassVar[str] = "W. Ostwald, Kolloid-Z 36 (1925) 99"
    law: Literal["test_power_law"] = "test_power_law"
    n: float
    consistency: float

    def viscosity_at(self, shear_rate: Any) -> Any:
        return self.consistency * shear_rate ** (self.n - 1)


def test_developed_flow_in_a_pipe() -> None:
    """u = u0 (3n + 1)/(n + 1) (1 - (r/R)^((n + 1)/n)), wall shear K ((3n + 1) u0/(n R))^n, drop 2 L tau/R."""
    tube = TUBE.replace(mesh=MESH, length=6e-3)
    R, law = tube.lumen_radius, PowerLaw(density=1060.0, n=N, consistency=CONSISTENCY)
    mean = FLOW / (np.pi * R**2)
    radius = ng.sqrt(ng.x**2 + ng.y**2 + 1e-20)
    profile = mean * (3 * N + 1) / (N + 1) * (1 - (radius / R) ** ((N + 1) / N))
    exact = ng.CF((0, 0, profile))
    changes = {"discretisation.order": 3, "conditions.ends": "clamped", "materials.fluid": law}
    system = System(case_of(tube, **changes), domain_of(tube), more=[GivenVelocity("inlet", lambda _: exact)])
    steady_flow(system, choose_backend("auto"))
    state, domain = system.named(system.state), system.domain

    def norm(field: Any) -> float:
        return float(ng.Integrate(ng.InnerProduct(field, field) * domain.dx("fluid", bonus_intorder=6), domain.mesh))

    assert np.sqrt(norm(state[VELOCITY] - exact) / norm(exact)) < 2e-3
    shear = CONSISTENCY * ((3 * N + 1) * mean / (N * R)) ** N
    wall = Wall(system, domain.vessels[0])
    wall.refresh()
    assert wall.statistics().mean == pytest.approx(shear, rel=2e-3, abs=0)
    inlet = ng.Integrate(state[PRESSURE] * domain.ds("inlet"), domain.mesh) / domain.area("inlet")
    assert inlet == pytest.approx(2 * shear * tube.length / R, rel=5e-3, abs=0)
