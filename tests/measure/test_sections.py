"""Sections of straight veins in any direction, of cones that move, and of walls that wind about the planes."""

from __future__ import annotations

from typing import Any

import ngsolve as ng
import numpy as np
import pytest
from ngfsi_geometry.segment import MeshSettings
from numpy.typing import NDArray

from ngfsi.measure.probe import Probe
from ngfsi.measure.shape import Shape
from ngfsi.mesh.geometry import Vessel
from ngfsi.system.system import System
from tests.runs import row
from tests.vein import COARSE, TUBE, BonedTube, case_of, position, probe_of, sections_of, set_motion, system_of

Array = NDArray[np.float64]

RADIUS, LENGTH = TUBE.lumen_radius, TUBE.length
AXES = {"z": (0.0, 0.0, 1.0), "x": (1.0, 0.0, 0.0), "oblique": (1.0, 2.0, 3.0)}
F = np.array([[1.12, 0.2, 0.1], [-0.05, 0.8, -0.15], [0.05, -0.04, 1.02]])
A = np.array([[1.1, 0.7, 3.0], [-0.4, -2.3, 1.5], [0.3, 0.2, -0.4]])


class Turned(BonedTube):
    """A vein in any direction, of flat elements."""

    mesh: MeshSettings = COARSE.replace(curving_order=1, axial_layers=2)
    axis: tuple[float, float, float]

    @property
    def turn(self) -> Array:
        """The rotation from z to the axis."""
        way = np.array(self.axis) / np.linalg.norm(self.axis)
        first = np.cross([0, 1, 0], way) / np.linalg.norm(np.cross([0, 1, 0], way))
        return np.column_stack([first, np.cross(way, first), way])

    @property
    def vessels(self) -> tuple[Vessel, ...]:
        ends = np.zeros((2, 3))
        ends[1] = self.turn[:, 2] * self.length
        return (Vessel(centreline=tuple(map(tuple, ends)), radius=self.lumen_radius),)

    def inflow(self) -> Any:
        return ng.CF(tuple(self.turn[:, 2].tolist()))

    def netgen_mesh(self, attempt: int = 0) -> Any:
        mesh = super().netgen_mesh(attempt)
        points = mesh.Coordinates()
        points[:] = points @ self.turn.T
        return mesh


def matrix(values: Array) -> ng.CoefficientFunction:
    return ng.CF(tuple(values.ravel().tolist()), dims=(3, 3))


@pytest.fixture(scope="module")
def along_z() -> tuple[Probe, Array]:
    return turned("z")


def turned(name: str) -> tuple[Probe, Array]:
    """Return the measures of a vein in some direction, deformed and moving alike as seen along it, and its rotation."""
    geometry = Turned(axis=AXES[name])
    system = system_of(case_of(geometry, **{"conditions.ends": "clamped", "discretisation.order": 2}))
    turn = geometry.turn
    deformation, rate = (turn @ part @ turn.T for part in (F, A))
    motion = matrix(deformation) * position() - position()
    system.state.components[0].Set(motion)
    system.new_weight.Set(2.0)
    system.velocity_history.components[0].Set(matrix(rate) * (matrix(deformation) * position()) - 2 * motion)
    system.state.components[2].Set(1e3 + 1e5 * ng.InnerProduct(ng.CF(tuple(turn[:, 2].tolist())), position()))
    probe = Probe(system)
    probe.refresh()
    return probe, turn


@pytest.mark.parametrize("name", ["x", "oblique"])
def test_a_vein_in_any_direction(along_z: tuple[Probe, Array], name: str) -> None:
    """All measures are those of the same vein along z, turned with it."""
    (reference, back), (probe, turn) = along_z, turned(name)
    turn = turn @ back.T
    expected, found = row(reference), row(probe)
    for column, value in expected.items():
        assert found[column] == pytest.approx(value, rel=1e-8, abs=1e-13), column
    assert np.ptp(probe.vessels[""].sections.blood) == pytest.approx(1e5 * LENGTH, rel=1e-6)
    shapes = [Shape.of(part.vessels[""].sections, cut=True) for part in (reference, probe)]
    for measure in ("area", "perimeter", "major", "minor", "circularity"):
        assert getattr(shapes[1], measure) == pytest.approx(getattr(shapes[0], measure), rel=1e-8), measure
    for measure in ("centre", "axis"):
        assert getattr(shapes[1], measure) == pytest.approx(getattr(shapes[0], measure) @ turn.T, abs=1e-9), measure
    samples = [part.vessels[""].wall.sample(1) for part in (reference, probe)]
    assert np.abs(samples[0].tangential).max() > 1e-3
    assert samples[1].tangential == pytest.approx(samples[0].tangential, abs=1e-9)


FLAT = TUBE.replace(**{"mesh.curving_order": 1, "mesh.axial_layers": 2})
"""Of flat elements: an exact prism, which curved ones are to 1e-3 only."""


def cone(widening: float) -> System:
    """Return a system whose vein has the radius R (1 + widening z / L)."""
    system = system_of(case_of(FLAT, **{"discretisation.order": 3}))
    x, y, z = (position()[i] for i in range(3))
    set_motion(system, widening / LENGTH * z * ng.CF((x, y, 0)))
    return system


def disc(system: System) -> float:
    """Area of the discrete lumen, which is a cylinder in the reference shape."""
    return system.domain.volume("fluid") / LENGTH


def test_a_cone_that_moves_along_its_axis() -> None:
    """Its area A = A0 (1 + w z / L)^2 at a station of space changes by -v dA/dz."""
    widening, speed = 0.4, 0.03
    system = cone(widening)
    system.velocity_history.components[0].Set(ng.CF((0, 0, speed)))
    sections = sections_of(system, LENGTH * np.array([0.1, 0.35, 0.5, 0.9]))
    wide = 1 + widening * sections.stations / LENGTH
    assert sections.areas == pytest.approx(disc(system) * wide**2, rel=1e-8)
    assert sections.area_rates == pytest.approx(-2 * speed * disc(system) * wide * widening / LENGTH, rel=1e-6)


def test_flow_through_places_that_a_vein_moves_along() -> None:
    """A cylinder that moves along its axis as a whole takes its blood along, v A of it, and none flows into it."""
    system, speed = system_of(case_of(FLAT)), 0.03
    system.velocity_history.components[0].Set(ng.CF((0, 0, speed)))
    probe = probe_of(system)
    assert probe.inflow() == pytest.approx(0.0, abs=1e-12 * speed * disc(system))
    assert probe.branches[""].flows == pytest.approx(np.full(11, speed * disc(system)), rel=1e-9)


def test_rates_of_area_integrate_to_the_rate_of_the_volume() -> None:
    """Of a cone whose wall moves along it, but not at its ends, by Gauss's rule along the vein."""
    system = cone(0.4)
    z = position()[2]
    system.velocity_history.components[0].Set(100 * ng.CF((0.1 * position()[0], 0, z * (LENGTH - z) / LENGTH)))
    nodes, weights = np.polynomial.legendre.leggauss(8)
    sections = sections_of(system, LENGTH * (nodes + 1) / 2)
    total = LENGTH / 2 * np.dot(weights, sections.area_rates)
    assert total == pytest.approx(probe_of(system).integral("lumen rate"), rel=1e-6)


@pytest.mark.parametrize("height", [1e-13, 1e-9, 1e-5, 0.02, 0.2])
def test_walls_that_wind_about_the_planes(height: float) -> None:
    """Points of a cylinder move along it, to and fro around it: all its sections stay what they are, also those that
    lay between two layers of elements, and at the ends, which the planes cut in part."""
    system = system_of(case_of(FLAT, **{"discretisation.order": 2}))
    x, y, _ = (position()[i] for i in range(3))
    set_motion(system, ng.CF((0, 0, height * (x * y / RADIUS + 0.3 * x))))
    sections, still = (sections_of(of) for of in (system, system_of(system.case)))
    sections.refresh(), still.refresh()
    assert sections.areas == pytest.approx(np.full(11, disc(system)), rel=1e-9)
    assert sections.perimeters == pytest.approx(still.perimeters, rel=1e-5)
    assert sections.whole[1:-1].all()


def test_mean_over_the_wall_of_uneven_sections() -> None:
    """Weights are parts of the wall: of z over a cone, (1/2 + w/3) / (1 + w/2) of the length."""
    widening = 0.5
    sections = sections_of(cone(widening), LENGTH * np.linspace(0, 1, 41) ** 2)
    exact = LENGTH * (1 / 2 + widening / 3) / (1 + widening / 2)
    assert sections.mean_over_wall(sections.stations) == pytest.approx(exact, rel=1e-3)
