"""Lofted veins: volumes, names, refusals."""

from __future__ import annotations

import ngsolve as ng
import numpy as np
import pytest
from ngfsi_geometry.lofted import LoftedMesh, LoftedVein

from ngfsi.errors import GeometryError
from ngfsi.outlines.outline import Outline
from tests.vein import domain_of

MESH = LoftedMesh(around=12, layers=4, inlet_layers=3, lumen_radii=(0.8,), curving_order=3)


def ellipse(a: float, b: float, x: float = 0.0, turn: float = 0.0) -> Outline:
    t = 2 * np.pi * np.arange(48) / 48
    shape = (a * np.cos(t) + 1j * b * np.sin(t)) * np.exp(1j * turn) + x
    return Outline.through(np.column_stack([shape.real, shape.imag]))


def vein(outlines: list[Outline], length: float = 10e-3, **more: float) -> LoftedVein:
    heights = tuple(map(float, np.linspace(0, length, len(outlines))))
    return LoftedVein(outlines=tuple(outlines), heights=heights, mesh=MESH, **more)


def test_volume_of_a_bent_turning_ellipse() -> None:
    """Sections of one area, moved and turned from one to the next: their volume is area times length."""
    stack = [ellipse(2.4e-3, 1.6e-3, x=0.4e-3 * k, turn=0.15 * k) for k in range(6)]
    geometry = vein(stack, inlet_diameters=2.0)
    assert geometry.areas(np.array(geometry.heights)) == pytest.approx(np.pi * 3.84e-6, rel=1e-4)
    assert geometry.volume == pytest.approx(np.pi * 3.84e-6 * 10e-3, rel=5e-3)
    domain = domain_of(geometry)
    assert domain.volume("fluid") == pytest.approx(geometry.exact_volumes()["fluid"], rel=1e-3)
    assert domain.area("inlet") == pytest.approx(np.pi * 3.84e-6, rel=1e-3)
    assert domain.area("outlet") == pytest.approx(np.pi * 3.84e-6, rel=1e-3)
    assert domain.statistics()["smallest_jacobian_ratio"] > 0.2
    (vessel,) = geometry.vessels
    assert (vessel.lumen, vessel.interface, vessel.wall, vessel.outer) == ("fluid", "interface", None, None)
    (begin, end), first = vessel.centreline, geometry.outlines[0].centroid
    assert (end[2] - begin[2], begin[2]) == pytest.approx((10e-3, 4 * vessel.radius), rel=1e-12)
    where = ng.CF((ng.x, ng.y, ng.z))(domain.mesh(*begin))  # in the reference shape: the middle of the first section
    assert where == pytest.approx((*first, 0.0), abs=2e-5)


def test_points_of_a_flat_vein_are_found_in_the_straight_mesh() -> None:
    """On its axis, where it is 3 : 1 and turns, and off it: the places there map back to the points, to rounding."""
    stack = [ellipse(2.4e-3, 0.8e-3, x=0.3e-3 * k, turn=0.2 * k) for k in range(6)]
    domain = domain_of(vein(stack, inlet_diameters=2.0))
    z = np.linspace(1e-3, 9e-3, 9)
    points = np.column_stack([np.interp(z, np.linspace(0, 10e-3, 6), 0.3e-3 * np.arange(6)), 0 * z, z])
    points = np.vstack([points, np.add(points, (0.4e-3, 0.1e-3, 0.0))])
    straight = domain.on_straight_mesh(points)
    found = ng.CF((ng.x, ng.y, ng.z))(domain.mesh(*straight.T))
    assert np.abs(found - points).max() < 1e-12
    assert np.abs(straight - points).max() > 0.2e-3


def test_refused_stacks() -> None:
    round_ = ellipse(2e-3, 2e-3)
    with pytest.raises(GeometryError, match="section 3 does not: sort the slices"):
        LoftedVein(outlines=(round_,) * 4, heights=(0.0, 2e-3, 1e-3, 3e-3))
    with pytest.raises(GeometryError, match="as many heights as outlines: 3, 4"):
        LoftedVein(outlines=(round_,) * 4, heights=(0.0, 2e-3, 3e-3))
    with pytest.raises(GeometryError, match=r"section 4 lies 9.0 mm beside the one before: is it another vein"):
        vein([round_, round_, round_, ellipse(2e-3, 2e-3, x=9e-3)])
