"""Channels: what they say of their vessel stands in their meshes."""

from __future__ import annotations

from typing import Any

import pytest
from ngfsi_geometry.channel import (
    Beam,
    BeamInChannel,
    CylinderInChannel,
    CylinderInDuct,
    CylinderMesh,
    ElasticChannel,
    StraightChannel,
)
from ngsolve import Integrate

from tests.vein import domain_of

COARSE = CylinderMesh(far_size=0.3, curving_order=2)


@pytest.mark.parametrize(
    ("geometry", "interface", "wall"),
    [
        (StraightChannel(), "walls", None),
        (ElasticChannel(), "interface", "solid"),
        (CylinderInChannel(mesh=COARSE), "walls", None),
        (CylinderInDuct(mesh=COARSE, layers=1), "walls", None),
        (BeamInChannel(mesh=COARSE), "interface", "solid"),
    ],
)
def test_the_vessel_of_a_channel(geometry: Any, interface: str, wall: str | None) -> None:
    (vessel,) = geometry.vessels
    assert (vessel.name, vessel.lumen, vessel.interface, vessel.wall) == ("", "fluid", interface, wall)
    assert (vessel.outer, vessel.centreline, vessel.radius) == (None, None, geometry.size)
    domain = domain_of(geometry)
    section = geometry.height**2 if isinstance(geometry, CylinderInDuct) else geometry.height
    assert [domain.area(name) for name in vessel.openings] == pytest.approx([section, section], rel=1e-9)
    assert domain.area(interface) > 0
    assert set(domain.regions) == {"fluid", wall} - {None}


def test_a_beam_alone_has_no_vessel() -> None:
    geometry = Beam(mesh=COARSE)
    assert geometry.vessels == ()
    assert domain_of(geometry).regions == ("solid",)


@pytest.mark.parametrize(
    "geometry", [CylinderInChannel(mesh=COARSE), CylinderInDuct(mesh=COARSE, layers=1), StraightChannel()]
)
def test_inflow_has_unit_mean(geometry: Any) -> None:
    """Over the inlet, where it is zero at the walls and positive between them."""
    domain = domain_of(geometry)
    inlet, profile = domain.ds("inlet", bonus_intorder=6), geometry.inflow()
    mean = Integrate(profile[0] * inlet, domain.mesh) / domain.area("inlet")
    assert mean == pytest.approx(1.0, rel=1e-9)
    square = Integrate(profile[0] ** 2 * inlet, domain.mesh) / domain.area("inlet")
    assert square == pytest.approx(1.2 ** (domain.mesh.dim - 1), rel=1e-9)
