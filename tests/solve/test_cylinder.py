"""Rings under pressure: the independent solution against published values, and prestress against that solution."""

from __future__ import annotations

import ngsolve as ng
import numpy as np
import pytest
from ngfsi_geometry.segment import MeshSettings
from ngfsi_geometry.tube import TubeSegment
from ngfsi_studies.verification.radial import Layer, inner_displacement, lame, stress_free_radius

from ngfsi.config.functions import FlowConstant, PressureConstant
from ngfsi.materials import (
    CompressibleNeoHookean,
    MooneyRivlin,
    SaintVenantKirchhoff,
    SolidLaw,
)
from tests.vein import block, case_of, steady

# ---------------------------------------------------------------- the reference itself


@pytest.mark.parametrize(("pressure", "displacement"), [(50e6, 1.24061e-3), (100e6, 3.21150e-3), (150e6, 7.18187e-3)])
def test_reference_reproduces_published_values(pressure: float, displacement: float) -> None:
    """Incompressible Mooney-Rivlin cylinder, inner radius 7, outer 18.625, c10 80, c01 20 MPa."""
    nearly = MooneyRivlin(c10=80e6, c01=20e6, c11=0.0, K=1e5 * 200e6, density=0.0)
    found = inner_displacement(7e-3, [Layer(nearly, 10e-3), Layer(nearly, 18.625e-3)], pressure)
    assert found == pytest.approx(displacement, rel=3e-5)


LAWS: list[SolidLaw] = [
    CompressibleNeoHookean(young=30e3, poisson=0.3, density=0.0),
    SaintVenantKirchhoff(young=30e3, poisson=0.3, density=0.0),
]


@pytest.mark.parametrize("law", LAWS)
def test_reference_is_lame_for_small_pressures(law: CompressibleNeoHookean) -> None:
    found = inner_displacement(5e-3, [Layer(law, 12e-3)], 0.3, 0.1)
    assert found == pytest.approx(lame(5e-3, 12e-3, law.young, law.poisson, 0.3, 0.1), rel=5e-5)


# ---------------------------------------------------------------- the coupled system; more of it in `ngfsi verify`


def test_stress_free_shape_of_a_prestressed_vein() -> None:
    """Inverse design: the unloaded ring that the blood pressure inflates into the given one."""
    inner, outer, pressure = 5.55e-3, 16e-3, 1333.22
    soft = CompressibleNeoHookean(young=30e3, poisson=0.3, density=0.0)
    mesh = MeshSettings(element="mixed", axial_layers=1, far_size=5e-3, vein_size=4e-3, lumen_radii=(), curving_order=3)
    tube = TubeSegment(length=2e-3, lumen_diameter=2 * inner, wall_thickness=2e-3, outer_radius=outer, mesh=mesh)
    materials = {"materials.tissue": soft, "materials.wall": soft, "conditions.initial_state": "prestress"}
    loads = {
        "loads.outlet_pressure": PressureConstant(value=pressure),
        "loads.inlet_flow": FlowConstant(value=1e-10 * pressure),
    }
    system = steady(case_of(tube, **materials, **loads))[0]
    assert not np.any(block(system, "d", system.values))
    n, face = ng.specialcf.normal(3), system.domain.ds("interface", bonus_intorder=4)
    inwards = ng.Integrate(system.relaxation * n * face, system.domain.mesh) / system.domain.area("interface")
    expected = stress_free_radius(soft, inner, outer, pressure) - inner
    assert expected < -0.05 * inner
    assert abs(inwards) == pytest.approx(-expected, rel=1e-3)
