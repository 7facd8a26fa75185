"""Sections perpendicular to the axis of a vein that is bent to an arc."""

from __future__ import annotations

import ngsolve as ng
import numpy as np
import pytest
from ngfsi_geometry.segment import MeshSettings
from ngfsi_geometry.tube import TubeSegment

from ngfsi.measure.sections import Sections
from ngfsi.measure.shape import Shape
from tests.vein import case_of, position, set_motion, system_of

BEND, RADIUS, LENGTH = 60e-3, 5e-3, 50e-3
TUBE = TubeSegment(
    length=LENGTH,
    lumen_diameter=2 * RADIUS,
    mesh=MeshSettings(axial_layers=5, far_size=12e-3, vein_size=3e-3, lumen_radii=(0.6,), curving_order=3),
)


def test_torus() -> None:
    """Circles about an arc; cut at constant heights they are larger by the cosine of the slope, and off the arc."""
    system = system_of(case_of(TUBE, **{"discretisation.order": 3}))
    x, y, z = (position()[i] for i in range(3))
    turned = z / BEND
    set_motion(system, ng.CF(((BEND + x) * ng.cos(turned) - BEND - x, 0 * y, (BEND + x) * ng.sin(turned) - z)))
    sections = Sections(system, stations=BEND * np.sin(np.linspace(8e-3, 40e-3, 7) / BEND))
    sections.refresh()
    found = Shape.of(sections, cut=True)
    inside = slice(1, -1)  # a spline is less exact at its ends
    assert found.area == pytest.approx(np.full(7, np.pi * RADIUS**2), rel=1e-3)
    assert found.circularity[inside] == pytest.approx(np.full(5, 1.0), rel=1e-3)
    assert np.hypot(found.centre[:, 0] + BEND, found.centre[:, 2]) == pytest.approx(np.full(7, BEND), rel=1e-4)
    angle = np.arctan2(found.centre[:, 2], found.centre[:, 0] + BEND)
    tangent = np.stack([-np.sin(angle), 0 * angle, np.cos(angle)], axis=1)
    assert found.axis[inside] == pytest.approx(tangent[inside], abs=2e-3)
    # what the cut is for
    at_heights = Shape.of(sections)
    off_the_arc = np.abs(np.hypot(at_heights.centre[:, 0] + BEND, at_heights.centre[:, 2]) - BEND)
    assert off_the_arc.max() > 10 * np.abs(np.hypot(found.centre[:, 0] + BEND, found.centre[:, 2]) - BEND).max()
