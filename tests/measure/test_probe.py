"""Integrals over the lumen are exact, whatever the shape of its elements."""

from __future__ import annotations

import ngsolve as ng
import pytest

from ngfsi.measure.probe import VesselProbe
from ngfsi.physics.kinematics import Kinematics
from tests.vein import BONED, case_of, randomise, system_of

HIGHER = 14
"""Integration order beyond that of `Integrate`, of which no term of order 3 needs half."""


@pytest.mark.parametrize("order", [2, 3])
def test_volume_of_any_lumen(order: int) -> None:
    """At random motion and rates of it."""
    system = system_of(case_of(BONED.replace(**{"mesh.curving_order": order})))
    randomise(system)
    probe = VesselProbe(system, system.domain.vessels[0])
    fields, domain = system.fields(), system.domain
    k = Kinematics(fields.grad_motion)
    rate = system.new_weight * fields.grad_motion + ng.Grad(system.velocity_history.components[0])
    for name, integrand in (("lumen volume", k.J), ("lumen rate", ng.InnerProduct(k.cof, rate))):
        exact = ng.Integrate(integrand * domain.dx("fluid", bonus_intorder=HIGHER), domain.mesh)
        assert probe.integral(name) == pytest.approx(exact, rel=1e-11), name
