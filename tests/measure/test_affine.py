"""Everything measured, in states where the vein is an ellipse and the blood deforms evenly: closed forms of all of it.

Reference positions X move to x = F X, and there the velocity is u = A x, of mesh and blood alike.
"""

from __future__ import annotations

import ngsolve as ng
import numpy as np
import pytest
from numpy.typing import NDArray

from ngfsi.materials import SaintVenantKirchhoff
from ngfsi.measure.probe import Probe
from ngfsi.measure.shape import Shape
from ngfsi.system.system import System
from tests.runs import row
from tests.vein import BLOOD, BONED, TISSUE, case_of, position, sections_of, set_motion, system_of, value_of

Array = NDArray[np.float64]

F = np.array([[1.12, 0.2, 0.1], [-0.05, 0.8, -0.15], [0.0, 0.0, 1.0]])
A = np.array([[1.1, 0.7, 3.0], [-0.4, -2.3, 1.5], [0.0, 0.0, 0.0]])
"""Without third rows: what is in a plane across the vein stays in it."""

WALL = SaintVenantKirchhoff(young=133e3, poisson=0.3, density=1060.0)
RADIUS, LENGTH = BONED.lumen_radius, BONED.length
FLOW = 3e-6


@pytest.fixture(scope="module", params=[2, 3])
def probe(request: pytest.FixtureRequest) -> Probe:
    geometry = BONED.replace(**{"mesh.curving_order": request.param})
    system = system_of(case_of(geometry, **{"materials.wall": WALL}))
    motion = matrix(F) * position() - position()
    system.motion.Set(motion)
    system.new_weight.Set(2.0)
    velocity = matrix(A) * (matrix(F) * position())
    system.velocity_history.components[0].Set(velocity - 2 * motion)
    value_of(system, "inlet").Set(FLOW)
    probe = Probe(system)
    probe.refresh()
    return probe


def matrix(values: Array) -> ng.CoefficientFunction:
    return ng.CF(tuple(values.ravel().tolist()), dims=(3, 3))


def circle_error(system: System) -> float:
    """How far the reference lumen is from the exact cylinder."""
    return abs(system.domain.volume("fluid") / (np.pi * RADIUS**2 * LENGTH) - 1)


def test_volume_and_its_rate(probe: Probe) -> None:
    found = row(probe)
    volume = np.linalg.det(F) * probe.domain.volume("fluid")
    assert found["lumen_volume_m3"] == pytest.approx(volume, rel=1e-12)
    assert found["lumen_area_mean_m2"] == pytest.approx(volume / LENGTH, rel=1e-12)
    assert found["lumen_volume_rate_m3_s"] == pytest.approx(np.trace(A) * volume, rel=1e-10)
    assert abs(found["flow_in_m3_s"]) + abs(found["flow_out_m3_s"]) < 1e-12 * abs(np.trace(A) * volume)
    assert found["mass_defect_m3_s"] == pytest.approx(np.trace(A) * volume, rel=1e-10)


def test_volume_ratio_and_displacement(probe: Probe) -> None:
    found = row(probe)
    for region in ("tissue", "wall", "fluid"):
        assert found[f"detF_min_{region}_1"] == pytest.approx(np.linalg.det(F), rel=1e-10)
    # at quadrature points, which lie inside of the farthest point of the skin
    angle = np.linspace(0, 2 * np.pi, 721)
    skin = BONED.outer_radius * np.array([np.cos(angle), np.sin(angle), 0 * angle]) + np.array([[0], [0], [LENGTH]])
    farthest = np.linalg.norm((F - np.eye(3)) @ skin, axis=0).max()
    assert 0.9 * farthest < found["displacement_max_m"] < farthest


def test_cross_sections(probe: Probe) -> None:
    """Ellipses, shifted from plane to plane."""
    area = np.pi * RADIUS**2 * np.linalg.det(F[:2, :2])
    sections, tolerance = probe.vessels[""].sections, 5 * circle_error(probe.system)
    assert sections.areas == pytest.approx(np.full(11, area), rel=tolerance)
    for height, ring in zip(sections.stations, sections.rings, strict=True):
        assert ring[:, 2] == pytest.approx(np.full(len(ring), height), abs=1e-8 * LENGTH)
    assert sections.rings[10].mean(axis=0)[:2] == pytest.approx(LENGTH * F[:2, 2], rel=1e-3)
    angle = np.linspace(0, 2 * np.pi, 2000, endpoint=False)
    ellipse = F[:2, :2] @ np.array([-np.sin(angle), np.cos(angle)]) * RADIUS
    perimeter = 2 * np.pi * np.linalg.norm(ellipse, axis=0).mean()
    assert sections.perimeters == pytest.approx(np.full(11, perimeter), rel=2 * tolerance)


def test_shape_perpendicular_to_the_axis(probe: Probe) -> None:
    """An oblique cylinder, looked at along its axis, is an ellipse with the singular values of the map as semi-axes."""
    axis = F[:, 2] / np.linalg.norm(F[:, 2])
    axes, semi, _ = np.linalg.svd((np.eye(3) - np.outer(axis, axis)) @ F[:, :2] * RADIUS)
    angle = np.linspace(0, 2 * np.pi, 2000, endpoint=False)
    perimeter = 2 * np.pi * np.hypot(semi[0] * np.sin(angle), semi[1] * np.cos(angle)).mean()
    found, rel = Shape.of(probe.vessels[""].sections), 5 * circle_error(probe.system)
    assert found.axis == pytest.approx(np.tile(axis, (11, 1)), abs=2e-3)
    assert found.area == pytest.approx(np.full(11, np.pi * semi[0] * semi[1]), rel=rel)
    assert found.perimeter == pytest.approx(np.full(11, perimeter), rel=rel)
    assert found.hydraulic_diameter == pytest.approx(4 * found.area / perimeter, rel=rel)
    assert found.circularity == pytest.approx(4 * np.pi * found.area / perimeter**2, rel=2 * rel)
    assert found.major == pytest.approx(np.full(11, semi[0]), rel=10 * rel)
    assert found.minor == pytest.approx(np.full(11, semi[1]), rel=10 * rel)
    first = np.array([1, 0, 0]) - axis[0] * axis
    along = axes[:, 0] * np.sign(axes[0, 0])
    expected = np.arctan2(along @ np.cross(axis, first) / np.linalg.norm(first), along @ first / np.linalg.norm(first))
    assert found.angle == pytest.approx(np.full(11, expected), abs=0.02)
    assert found.centre == pytest.approx(np.outer(probe.vessels[""].sections.stations, F[:, 2]), abs=1e-3 * RADIUS)


def test_areas_integrate_to_the_volume_of_the_discrete_lumen(probe: Probe) -> None:
    """At Gauss points of the one layer of elements along the axis, to rounding."""
    nodes, weights = np.polynomial.legendre.leggauss(5)
    sections = sections_of(probe.system, LENGTH * (nodes + 1) / 2)
    assert LENGTH * np.dot(weights / 2, sections.areas) == pytest.approx(
        probe.vessels[""].integral("lumen volume"), rel=1e-9
    )


def test_flow_along_the_vein(probe: Probe) -> None:
    """Blood that the shrinking sections before a station expel is added to the inflow."""
    area, rate = np.pi * RADIUS**2 * np.linalg.det(F[:2, :2]), np.trace(A[:2, :2])
    flows = FLOW - rate * area * probe.vessels[""].sections.stations
    tolerance = circle_error(probe.system)
    assert probe.vessels[""].sections.local_flows(FLOW) - FLOW == pytest.approx(flows - FLOW, rel=3.5 * tolerance)
    diameter = np.sqrt(4 * area / np.pi)
    entering = row(probe)["flow_in_m3_s"]  # of this velocity field, held against its closed form elsewhere
    reynolds = BLOOD.density * np.abs(flows - FLOW + entering).max() / area * diameter / BLOOD.viscosity
    assert row(probe)["reynolds_1"] == pytest.approx(reynolds, rel=4 * tolerance)


def test_developed_flow_in_the_same_sections(probe: Probe) -> None:
    """4 mu Q / (pi R^3) with the flow of the inlet, and as much more in the ellipse as its force balance says."""
    found = row(probe)
    sections, viscosity = probe.vessels[""].sections, BLOOD.viscosity
    area = np.pi * RADIUS**2 * np.linalg.det(F[:2, :2])
    circle = 4 * viscosity * abs(found["flow_in_m3_s"]) / np.pi / (area / np.pi) ** 1.5
    assert abs(found["flow_in_m3_s"]) < 1e-15  # no flow comes in
    assert found["sawss_poiseuille_inlet_Pa"] == pytest.approx(circle, abs=1e-12)
    flows = np.abs(sections.local_flows(found["flow_in_m3_s"]))
    assert found["sawss_poiseuille_local_Pa"] == pytest.approx(
        4 * viscosity * flows.mean() / np.pi / (area / np.pi) ** 1.5, rel=5 * circle_error(probe.system)
    )
    # ratio of the ellipse to the circle of the same area
    axis = F[:, 2] / np.linalg.norm(F[:, 2])
    semi = np.linalg.svd((np.eye(3) - np.outer(axis, axis)) @ F[:, :2] * RADIUS)[1]
    angle = np.linspace(0, 2 * np.pi, 2000, endpoint=False)
    a, b, perimeter = *semi, 2 * np.pi * np.hypot(semi[0] * np.sin(angle), semi[1] * np.cos(angle)).mean()
    ratio = (a**2 + b**2) / (a**2 * b**2 * perimeter) * np.pi * (area / np.pi) ** 1.5
    assert found["sawss_ellipse_local_Pa"] / found["sawss_poiseuille_local_Pa"] == pytest.approx(ratio, rel=0.02)
    assert ratio > 1.05


def test_wall_shear(probe: Probe) -> None:
    """Tangential part of mu (A + A^T) n on an elliptic cylinder, integrated by the trapezoidal rule."""
    angle = np.linspace(0, 2 * np.pi, 4000, endpoint=False)
    reference = np.array([np.cos(angle), np.sin(angle), 0 * angle])
    areas = np.linalg.det(F) * np.linalg.inv(F).T @ reference
    stretch = np.linalg.norm(areas, axis=0)
    n = areas / stretch
    traction = BLOOD.viscosity * (A + A.T) @ n
    shear = np.linalg.norm(traction - np.sum(traction * n, axis=0) * n, axis=0)
    mean = np.sum(shear * stretch) / np.sum(stretch)
    assert shear.min() < 0.9 * mean < 1.1 * mean < shear.max()
    found, tolerance = row(probe), {2: 2e-3, 3: 5e-4}[probe.system.unknowns.order]
    assert found["sawss_Pa"] == pytest.approx(mean, rel=tolerance)
    assert found["wss_min_Pa"] == pytest.approx(shear.min(), rel=20 * tolerance)
    assert found["wss_max_Pa"] == pytest.approx(shear.max(), rel=20 * tolerance)


def test_wall_shear_around_stations(probe: Probe) -> None:
    """Mean over the outline of each section, by arc length: the field is the same in all of them."""
    angle = np.linspace(0, 2 * np.pi, 4000, endpoint=False)
    n = np.linalg.inv(F).T @ np.array([np.cos(angle), np.sin(angle), 0 * angle])
    n /= np.linalg.norm(n, axis=0)
    traction = BLOOD.viscosity * (A + A.T) @ n
    shear = np.linalg.norm(traction - np.sum(traction * n, axis=0) * n, axis=0)
    lengths = np.linalg.norm(F[:2, :2] @ np.array([-np.sin(angle), np.cos(angle)]), axis=0)
    mean = np.sum(shear * lengths) / np.sum(lengths)
    assert abs(shear.mean() / mean - 1) > 0.02
    assert probe.vessels[""].sections.shears == pytest.approx(
        np.full(11, mean), rel={2: 5e-3, 3: 1e-3}[probe.system.unknowns.order]
    )


def test_share_of_low_wall_shear(probe: Probe) -> None:
    """Between the extremes it grows from nothing to all; at the median of the exact stress it is a half."""
    angle = np.linspace(0, 2 * np.pi, 4000, endpoint=False)
    areas = np.linalg.inv(F).T @ np.array([np.cos(angle), np.sin(angle), 0 * angle])
    stretch = np.linalg.norm(areas, axis=0)
    n = areas / stretch
    traction = BLOOD.viscosity * (A + A.T) @ n
    shear = np.linalg.norm(traction - np.sum(traction * n, axis=0) * n, axis=0)
    order = np.argsort(shear)
    median = shear[order][np.searchsorted(np.cumsum(stretch[order]), stretch.sum() / 2)]
    shares = [probe.vessels[""].wall.statistics(t).low for t in (0.9 * shear.min(), median, 1.1 * shear.max())]
    assert shares == pytest.approx([0.0, 0.5, 1.0], abs=0.05)


def test_sampled_wall(probe: Probe) -> None:
    sample = probe.vessels[""].wall.sample(3)
    back = sample.points @ np.linalg.inv(F).T
    assert np.hypot(back[:, 0], back[:, 1]) == pytest.approx(np.full(len(back), RADIUS), rel=5e-3)
    n = back * [1, 1, 0] @ np.linalg.inv(F)
    n /= np.linalg.norm(n, axis=1)[:, None]
    traction = -BLOOD.viscosity * n @ (A + A.T)
    shear = traction - np.sum(traction * n, axis=1)[:, None] * n
    assert np.linalg.norm(sample.shear - shear, axis=1).max() < 0.1 * np.linalg.norm(shear, axis=1).max()
    assert sample.quads.max() == len(sample.points) - 1
    # along the material line that was parallel to the axis, and across it on the wall
    along = F[:, 2] / np.linalg.norm(F[:, 2])
    around = np.cross(along, n)
    expected = np.stack([shear @ along, np.sum(shear * around, axis=1)], axis=1)
    assert np.abs(sample.tangential - expected).max() < 0.1 * np.abs(expected).max()


def test_hydrostatic_pressure(probe: Probe) -> None:
    """p = -tr(sigma)/3, written out for both laws."""
    J, b, E = np.linalg.det(F), F @ F.T, (F.T @ F - np.eye(3)) / 2
    mu, lame = (TISSUE.young / 2.6, TISSUE.young * 0.3 / (1.3 * 0.4))
    tissue = (mu * (b - np.eye(3)) + lame * np.log(J) * np.eye(3)) / J
    mu, lame = (WALL.young / 2.6, WALL.young * 0.3 / (1.3 * 0.4))
    wall = F @ (lame * np.trace(E) * np.eye(3) + 2 * mu * E) @ F.T / J
    found = row(probe)
    assert found["p_tissue_side_Pa"] == pytest.approx(-np.trace(tissue) / 3, rel=1e-9)
    for where in ("side", "mean"):
        assert found[f"p_wall_{where}_Pa"] == pytest.approx(-np.trace(wall) / 3, rel=1e-9)


def test_free_ends_that_have_moved_in() -> None:
    """A vein shortened to 0.7 of its length is a cylinder still, also for the planes that it no longer reaches."""
    system = system_of(case_of(BONED))
    set_motion(system, ng.CF((0, 0, -0.3 * (ng.z - LENGTH / 2))))
    sections = sections_of(system)
    found = Shape.of(sections)
    assert found.area == pytest.approx(np.full(11, np.pi * RADIUS**2), rel=5 * circle_error(system))
    assert found.axis == pytest.approx(np.tile([0, 0, 1], (11, 1)), abs=1e-6)
    assert found.centre[:, 2].min() == pytest.approx(2e-3, rel=1e-3)
