"""The pressure of a stocking on a tapering leg, by Laplace's law."""

from __future__ import annotations

from math import pi
from typing import Any

import numpy as np
import pytest
from ngfsi_geometry.calf import CalfSegment
from ngfsi_geometry.channel import StraightChannel

from ngfsi.conditions import StockingModel
from ngfsi.errors import CaseError
from ngfsi.measure.probe import Probe
from ngfsi.mesh.girth import Girth
from tests.vein import COARSE, case_of, domain_of, system_of

THIN, THICK = 50e-3, 60e-3
CONE = CalfSegment(
    length=50e-3, skin_radius_distal=THIN, skin_radius_proximal=THICK, tibia_y=15e-3,
    mesh=COARSE.replace(axial_layers=2, curving_order=4),
)  # fmt: skip
HEIGHTS = np.array([1e-6, 6e-3, 25e-3, 40e-3, 49.999e-3])
RADII = THIN + (THICK - THIN) * HEIGHTS / CONE.length


def test_the_girth_of_a_cone() -> None:
    """Of one on its side, sqrt(1 - n_z^2) is not 1, which changes the integrals by (b - a)^2 / (2 L^2) = 2 %."""
    found = Girth(domain_of(CONE), "skin").at(HEIGHTS)
    np.testing.assert_allclose(found, 2 * pi * RADII, rtol=1e-4)


def pressures(**stocking: Any) -> Any:
    """Return the pressure (Pa) on the skin of the cone at some heights, at a third of the rise."""
    rise = {"kind": "ramp", "final": 0.6, "duration_s": 0.3}
    system = system_of(case_of(CONE, **{"loads.further": ({"kind": "stocking", "over_time": rise, **stocking},)}))
    system.update(0.1)
    condition = next(c for c in system.conditions.values() if c.name.startswith("stocking"))
    mesh, radius = system.domain.mesh, 0.7 * THIN
    found: Any = condition
    return np.array([found.pressure(mesh(0, -radius, z)) for z in HEIGHTS]), Probe(system)


def test_even_tension_presses_most_where_the_leg_is_thin() -> None:
    """p = T / r at each height, T / (mean of the radii) over the whole skin, exactly."""
    found, probe = pressures(tension_N_m=[100.0])
    np.testing.assert_allclose(found, 20.0 / RADII, rtol=1e-4)
    assert probe.mean_skin_pressure() == pytest.approx(20.0 / (THIN + THICK) * 2, rel=1e-4)
    assert probe.largest_skin_pressure() == pytest.approx(20.0 / THIN, rel=0.02)


def test_a_reversed_gradient() -> None:
    """The tension is linear between its heights and held beyond, so that the pressure grows towards the knee."""
    found, _ = pressures(tension_N_m=[50.0, 130.0], heights_mm=[10.0, 40.0])
    tension = 0.2 * np.array([50.0, 50.0, 90.0, 130.0, 130.0])
    np.testing.assert_allclose(found, tension / RADII, rtol=1e-4)
    assert found[-1] > 1.5 * found[0]


def test_refusals() -> None:
    with pytest.raises(CaseError, match="as many heights as tensions, not 1 and 2"):
        StockingModel.from_dict({"kind": "stocking", "tension_N_m": [1.0, 2.0], "heights_mm": [3.0]})
    with pytest.raises(CaseError, match=r"must increase, but 0\.003 m follows 0.004 m"):
        StockingModel.from_dict({"kind": "stocking", "tension_N_m": [1.0, 2.0], "heights_mm": [4.0, 3.0]})


def test_it_is_worn_on_a_skin() -> None:
    domain = domain_of(StraightChannel())
    with pytest.raises(CaseError, match="worn in 3-D on a boundary 'skin': there is none"):
        StockingModel(tension=(1.0,)).condition(domain, "stocking")
