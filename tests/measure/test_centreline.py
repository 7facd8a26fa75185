"""Centrelines of straight, bent and branched lumens of tetrahedra, and sections perpendicular to them."""

from __future__ import annotations

from functools import cache

import ngsolve as ng
import numpy as np
import pytest
from numpy.typing import NDArray

from ngfsi.case import Case, Discretisation, Loads, Materials, TimeStepping
from ngfsi.conditions import FreeOpening
from ngfsi.config.functions import FlowConstant
from ngfsi.errors import MeshError
from ngfsi.measure.sections import Sections
from ngfsi.measure.shape import Shape
from ngfsi.mesh.centreline import Centreline, direction, find_centrelines
from ngfsi.mesh.domain import Domain
from ngfsi.mesh.geometry import Vessel
from ngfsi.system.system import System
from tests.lumens import BentLumen, Lumen, Tubes, arc
from tests.vein import BLOOD, domain_of

Array = NDArray[np.float64]

RADIUS, BEND, ANGLE, LENGTH = 4e-3, 20e-3, 2 * np.pi / 3, 30e-3
AREA = np.pi * RADIUS**2
VESSEL = Vessel(wall=None, outer=None, radius=RADIUS)
BENT = BentLumen(radius=RADIUS, bend=BEND, angle=ANGLE, largest=4e-3)
TRUNK, FORK = np.array([0.0, 0.0, -25e-3]), np.zeros(3)
BRANCHES = {"outlet": (np.array([12e-3, 0.0, 20e-3]), 0.8), "second": (np.array([-12e-3, 2e-3, 20e-3]), 0.7)}
SPLIT = Tubes(
    radius=RADIUS,
    inlet=tuple(TRUNK),
    fork=tuple(FORK),
    outlets=tuple((name, tuple(end), part * RADIUS) for name, (end, part) in BRANCHES.items()),
    largest=3e-3,
)


@cache
def system(lumen: Lumen) -> System:
    loads = Loads(inlet_flow=FlowConstant(value=1e-7), openings={"second": FreeOpening()} if lumen == SPLIT else {})
    case = Case(name="lumen", geometry=lumen, materials=Materials(fluid=BLOOD), loads=loads,
                discretisation=Discretisation(order=2), time=TimeStepping(step=1.0, end=1.0))  # fmt: skip
    return System(case, domain_of(lumen))


def straight(way: tuple[float, float, float]) -> Domain:
    half = LENGTH / 2 * np.array(way) / np.linalg.norm(way)
    outlets = (("outlet", tuple(2 * half), RADIUS),)
    return domain_of(Tubes(radius=RADIUS, inlet=(0, 0, 0), fork=tuple(half), outlets=outlets, largest=4e-3))


@pytest.mark.parametrize("way", [(0, 0, 1), (1, 0, 0), (1, 2, 3)])
def test_a_straight_tube_in_any_direction(way: tuple[float, float, float]) -> None:
    (line,) = find_centrelines(straight(way), VESSEL)
    along = np.array(way) / np.linalg.norm(way)
    at = line.stations(100)
    assert line.length == pytest.approx(LENGTH, rel=1e-6)
    assert line.points(at) == pytest.approx(np.outer(at, along), abs=1e-4 * RADIUS)
    assert line.tangents(at) == pytest.approx(np.tile(along, (100, 1)), abs=1e-3)


def test_two_points_make_a_straight_line() -> None:
    line = Centreline([(1e-3, 0, 0), (1e-3, 0, 50e-3)])
    at = line.stations(11)
    assert np.array_equal(line.points(at)[:, :2], np.tile([1e-3, 0], (11, 1)))
    assert line.points(at)[:, 2] == pytest.approx(at, rel=1e-15)
    assert np.array_equal(line.tangents(at), np.tile([0, 0, 1], (11, 1)))
    around = np.array([[2e-3, 1e-3, 20e-3], [0, 0, -1e-3], [0, 0, 60e-3]])
    assert line.coordinate(around) == pytest.approx([20e-3, 0, 50e-3], rel=1e-12)


def test_a_curve_of_points_on_a_circle() -> None:
    line = Centreline(arc(BEND, np.linspace(0, ANGLE, 30)))
    at = line.stations(50)
    assert line.length == pytest.approx(BEND * ANGLE, rel=1e-5)
    assert line.points(at) == pytest.approx(arc(BEND, at / BEND), abs=1e-4 * RADIUS)
    beside = arc(BEND + RADIUS / 2, at / BEND) + np.array([RADIUS / 2, RADIUS, 0])
    assert line.coordinate(beside) == pytest.approx(at, abs=1e-4 * BEND)


def test_a_bent_tube() -> None:
    """Sections perpendicular to the axis of a part of a torus are circles."""
    (line,) = find_centrelines(domain_of(BENT), VESSEL)
    assert line.length == pytest.approx(BEND * ANGLE, rel=1e-4)
    assert line.points(line.stations(50)) == pytest.approx(arc(BEND, line.stations(50) / BEND), abs=2e-3 * RADIUS)
    sections = Sections(system(BENT), VESSEL, line)
    sections.refresh()
    assert sections.areas == pytest.approx(np.full(11, AREA), rel=5e-4)
    assert sections.perimeters == pytest.approx(np.full(11, 2 * np.pi * RADIUS), rel=5e-4)
    assert sections.whole.all()
    found = Shape.of(sections, cut=True)
    assert found.area == pytest.approx(np.full(11, AREA), rel=2e-3)
    assert found.centre == pytest.approx(arc(BEND, line.stations(11) / BEND), abs=5e-3 * RADIUS)
    # Pappus: what the sections sweep is the lumen, and the mean of A along the axis is its volume over the length
    assert sections.areas.mean() * line.length == pytest.approx(domain_of(BENT).volume("fluid"), rel=2e-4)
    # around each outline at even steps
    steps = np.linalg.norm(np.diff(sections.rings, axis=1, append=sections.rings[:, :1]), axis=2)
    assert steps == pytest.approx(np.full(steps.shape, 2 * np.pi * RADIUS / steps.shape[1]), rel=0.1)


def test_the_direction_along_a_bent_tube() -> None:
    domain = domain_of(BENT)
    field = direction(domain, VESSEL, find_centrelines(domain, VESSEL))
    exact = ng.CF((-ng.z, 0, ng.x + BEND)) / ng.sqrt(ng.z**2 + (ng.x + BEND) ** 2)
    off = ng.Integrate(ng.Norm(field - exact) * domain.ds("interface"), domain.mesh)
    assert off / domain.area("interface") < 0.02


def test_a_fork() -> None:
    """From the inlet to each outlet: in the trunk and in each branch along its axis, where sections are circles."""
    domain = domain_of(SPLIT)
    lines = find_centrelines(domain, SPLIT.vessels[0])
    for line, (end, part) in zip(lines, BRANCHES.values(), strict=True):
        way, points = end / np.linalg.norm(end), line.points(line.stations(200))
        trunk, branch = points[points[:, 2] < -1.5 * RADIUS], points[points @ way > 2.5 * RADIUS]
        assert len(trunk) > 50 < len(branch)
        assert np.abs(trunk[:, :2]).max() < 1e-2 * RADIUS
        assert np.linalg.norm(branch - np.outer(branch @ way, way), axis=1).max() < 1e-2 * RADIUS
        at = np.concatenate([np.linspace(0, 18e-3, 4), line.length - np.linspace(0, 8e-3, 3)])
        sections = Sections(system(SPLIT), SPLIT.vessels[0], line, at)
        sections.refresh()
        assert sections.areas[:4] == pytest.approx(np.full(4, AREA), rel=2e-3)
        assert sections.areas[4:] == pytest.approx(np.full(3, part**2 * AREA), rel=1e-2)
        assert sections.whole.all()


@pytest.mark.parametrize(("degrees", "part"), [(51, 0.63), (27, 0.63), (45, 0.38)])
def test_a_narrow_branch_at_a_sharp_angle(degrees: float, part: float) -> None:
    """Its line goes from the axis of the trunk to its own without turning back."""
    way = np.array([np.sin(np.radians(degrees)), 0.0, np.cos(np.radians(degrees))])
    sharp = Tubes(radius=RADIUS, inlet=(0, 0, -14e-3), fork=(0, 0, 0), largest=3e-3,
                  outlets=(("outlet", (0, 0, 24e-3), RADIUS), ("side", tuple(24e-3 * way), part * RADIUS)))  # fmt: skip
    line = find_centrelines(domain_of(sharp), sharp.vessels[0])[1]
    points = line.points(line.stations(200))
    trunk, side = points[points[:, 2] < -RADIUS], points[points @ way > 4.5 * RADIUS]
    assert np.linalg.norm(trunk[:, :2], axis=1).max() < 2e-2 * RADIUS
    assert np.linalg.norm(side - np.outer(side @ way, way), axis=1).max() < 2e-2 * RADIUS
    turns = line.tangents(line.stations(200))
    assert turns[:, 2].min() > 0 < (turns @ way).min()
    assert line.length == pytest.approx(38e-3, rel=3e-2)


def test_planes_that_cut_both_branches() -> None:
    """Of both ellipses the one around the point is taken, and none where the point is far from both."""
    sections = Sections(system(SPLIT), SPLIT.vessels[0], find_centrelines(domain_of(SPLIT), SPLIT.vessels[0])[0])
    sections.refresh()
    ends, parts = np.array([end for end, _ in BRANCHES.values()]), np.array([part for _, part in BRANCHES.values()])
    centres = np.vstack([0.75 * ends, [0.0, 12 * RADIUS, 15e-3]])
    outlines, points = sections.across(centres, np.tile([0.0, 0.0, 1.0], (3, 1)))
    assert outlines.whole.tolist() == [True, True, False]
    areas = outlines.enclosed(points - outlines.spread(centres), outlines.derivative(points))
    assert areas[:2] == pytest.approx(parts**2 * AREA * np.linalg.norm(ends, axis=1) / ends[:, 2], rel=2e-3)
    assert outlines.centroids(points)[:2] == pytest.approx(centres[:2], abs=1e-2 * RADIUS)


def test_a_line_of_the_geometry_goes_first() -> None:
    given = (tuple(TRUNK), tuple(FORK), tuple(BRANCHES["outlet"][0]))
    lines = find_centrelines(domain_of(SPLIT), Vessel(outlets=tuple(BRANCHES), centreline=given, radius=RADIUS))
    assert len(lines) == 2
    assert lines[0].points(np.array([0.0, lines[0].length])) == pytest.approx(np.array(given)[[0, 2]], abs=1e-12)
    assert lines[1].points(np.array([lines[1].length]))[0] == pytest.approx(BRANCHES["second"][0], abs=1e-5)


def test_a_hole_needs_a_line() -> None:
    with pytest.raises(MeshError, match="give its geometry a centreline"):
        find_centrelines(domain_of(BENT), Vessel(name="hole", lumen=None))
