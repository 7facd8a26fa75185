"""The vein as a thick-walled cylinder on rollers: its inner displacement under blood and skin pressure."""

from __future__ import annotations

from typing import Any

import ngsolve as ng
import numpy as np
import pytest

from geometry.segment import MeshSettings
from geometry.tube import TubeSegment
from ngfsi.curves import FlowConstant, PressureConstant
from ngfsi.materials import (
    CompressibleNeoHookean,
    MooneyRivlin,
    SaintVenantKirchhoff,
    SolidLaw,
    load_set,
)
from ngfsi.solve.system import System
from studies.verification.radial import Layer, inner_displacement, lame, stress_free_radius
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


# ---------------------------------------------------------------- the coupled system against it

INNER, WALL, OUTER = 5.55e-3, 2e-3, 16e-3
BLOOD_PRESSURE, SKIN_PRESSURE = 1333.22, 3000.0
TISSUE_M, TISSUE_N, VEIN = load_set("mooney_rivlin_s1"), load_set("neo_hookean_likely"), load_set("vein_wall")
SOFT = CompressibleNeoHookean(young=30e3, poisson=0.3, density=0.0)
STIFF = MooneyRivlin(c10=80e3, c01=20e3, c11=0.0, K=20 * 200e3, density=0.0)


def cylinder(tissue: SolidLaw, wall: SolidLaw, inside: float, outside: float, **changes: Any) -> System:
    """The steady state of a slice of vein in tissue; the blood's own pressure drop is 1e-6 of its pressure."""
    settings = MeshSettings(
        element="mixed", axial_layers=1, far_size=5e-3, vein_size=4e-3, lumen_radii=(), curving_order=3
    )
    dimensions = {"length": 2e-3, "lumen_diameter": 2 * INNER, "wall_thickness": WALL, "outer_radius": OUTER}
    tube = TubeSegment(**(dimensions | changes.pop("dimensions", {})), mesh=settings)
    case = case_of(
        tube,
        **{
            "materials.tissue": tissue,
            "materials.wall": wall,
            "loads.outlet_pressure": PressureConstant(value=inside),
            "loads.skin_pressure": PressureConstant(value=outside),
            "loads.inlet_flow": FlowConstant(value=1e-10 * inside),
            **changes,
        },
    )
    return steady(case)[0]


def inner_strain(system: System) -> float:
    """Relative change of the lumen's radius, from its volume."""
    motion = system.fields(system.state.components).grad_motion
    measure = system.domain.dx("fluid", bonus_intorder=8)
    deformed = ng.Integrate(ng.Det(ng.Id(3) + motion) * measure, system.domain.mesh)
    return float(np.sqrt(deformed / system.domain.volume("fluid")) - 1)


def test_lame() -> None:
    """A strain of 1e-3, which the law's own nonlinearity changes by 2e-3 of itself."""
    found = inner_strain(cylinder(SOFT, SOFT, 20.0, 0.0)) * INNER
    linear = lame(INNER, OUTER, SOFT.young, SOFT.poisson, 20.0, 0.0)
    assert found == pytest.approx(linear, rel=4e-3)
    assert found == pytest.approx(inner_displacement(INNER, [Layer(SOFT, OUTER)], 20.0), rel=3e-4)


@pytest.mark.parametrize(
    ("tissue", "wall", "inside", "outside"),
    [(TISSUE_M, VEIN, BLOOD_PRESSURE, 0.0), (TISSUE_N, SOFT, BLOOD_PRESSURE, SKIN_PRESSURE)],
    ids=["inflated Mooney-Rivlin", "squeezed Neo-Hookean"],
)
def test_finite_strain_of_two_layers(tissue: SolidLaw, wall: SolidLaw, inside: float, outside: float) -> None:
    expected = inner_displacement(INNER, [Layer(wall, INNER + WALL), Layer(tissue, OUTER)], inside, outside) / INNER
    assert abs(expected) > 0.02
    assert inner_strain(cylinder(tissue, wall, inside, outside)) == pytest.approx(expected, rel=4e-4)


def test_nearly_incompressible_mooney_rivlin() -> None:
    """The published cylinder, at a 1000th of its pressure and moduli, with a Poisson ratio of 0.475."""
    dimensions = {"lumen_diameter": 14e-3, "wall_thickness": 3e-3, "outer_radius": 18.625e-3}
    changes = {"dimensions": dimensions, "solver.tolerance": 1e-6, "loads.inlet_flow": FlowConstant(value=1e-4)}
    found = inner_strain(cylinder(STIFF, STIFF, 50e3, 0.0, **changes)) * 7e-3
    assert found == pytest.approx(1.24061e-3, rel=0.015)
    assert found == pytest.approx(inner_displacement(7e-3, [Layer(STIFF, 18.625e-3)], 50e3), rel=3e-4)


def test_stress_free_shape_of_a_prestressed_vein() -> None:
    """Inverse design: the unloaded ring that the blood pressure inflates into the given one."""
    system = cylinder(SOFT, SOFT, BLOOD_PRESSURE, 0.0, **{"conditions.initial_state": "prestress"})
    assert not np.any(block(system, "d", system.values))
    n, face = ng.specialcf.normal(3), system.domain.ds("interface", bonus_intorder=4)
    inwards = ng.Integrate(system.relaxation * n * face, system.domain.mesh) / system.domain.area("interface")
    expected = stress_free_radius(SOFT, INNER, OUTER, BLOOD_PRESSURE) - INNER
    assert expected < -0.05 * INNER
    assert abs(inwards) == pytest.approx(-expected, rel=1e-3)
