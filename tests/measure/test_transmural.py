"""Pressure on the vein's wall against Lame's ring, and of the blood against Poiseuille's law."""

from __future__ import annotations

from typing import Any

import ngsolve as ng
import numpy as np
import pytest
from ngfsi_geometry.segment import MeshSettings
from ngfsi_geometry.tube import TubeSegment
from numpy.typing import NDArray

from ngfsi.config.functions import FlowConstant, PressureConstant
from ngfsi.materials import CompressibleNeoHookean, SaintVenantKirchhoff
from ngfsi.measure.transmural import Side, WallLoad
from ngfsi.system.system import System
from tests.vein import BLOOD, TUBE, case_of, position, sections_of, set_motion, steady, system_of

INNER, WALL, OUTER, LENGTH = 5e-3, 1.5e-3, 12e-3, 20e-3
SOFT = CompressibleNeoHookean(young=30e3, poisson=0.3, density=0.0)
MESH = MeshSettings(axial_layers=2, far_size=4e-3, vein_size=2.5e-3, lumen_radii=(0.6,), curving_order=3)
BLOOD_PRESSURE, SKIN_PRESSURE, FLOW = 2.0, 5.0, 1e-8


def test_pressure_on_the_wall_and_on_the_axis() -> None:
    tube = TubeSegment(length=LENGTH, lumen_diameter=2 * INNER, wall_thickness=WALL, outer_radius=OUTER, mesh=MESH)
    loads = {
        "loads.outlet_pressure": PressureConstant(value=BLOOD_PRESSURE),
        "loads.skin_pressure": PressureConstant(value=SKIN_PRESSURE),
        "loads.inlet_flow": FlowConstant(value=FLOW),
    }
    system = steady(case_of(tube, **{"materials.tissue": SOFT, "materials.wall": SOFT}, **loads))[0]
    heights = np.linspace(0, LENGTH, 5)
    load = _load(system, heights)
    drop = 8 * BLOOD.viscosity * FLOW / (np.pi * INNER**4) * (LENGTH - heights)
    assert sections_of(system, heights).blood - BLOOD_PRESSURE == pytest.approx(drop, rel=0.02, abs=0.02 * drop[0])
    # the pressures of blood and skin reach the outer face in shares that do not depend on the (single) material
    share = INNER**2 * (OUTER**2 / (INNER + WALL) ** 2 - 1) / (OUTER**2 - INNER**2)
    exact = SKIN_PRESSURE + share * (BLOOD_PRESSURE - SKIN_PRESSURE)
    assert load.tissue == pytest.approx(np.full(5, exact), rel=5e-3)


def test_large_strain() -> None:
    """All is widened by a tenth across the vein: the second Piola stress of Saint Venant and Kirchhoff is the true one
    there, (2 lambda + 2 mu) (1.1^2 - 1) / 2, and the wall's own law does not matter."""
    young, poisson, stretch = 20e3, 0.2, 1.1
    tissue = SaintVenantKirchhoff(young=young, poisson=poisson, density=0.0)
    system = system_of(case_of(TUBE, **{"materials.tissue": tissue}))
    x, y, _ = (position()[i] for i in range(3))
    set_motion(system, (stretch - 1) * ng.CF((x, y, 0)))
    load = _load(system, np.linspace(0, TUBE.length, 3))
    factor = young / ((1 + poisson) * (1 - 2 * poisson))  # lambda + mu = factor / 2
    assert load.tissue == pytest.approx(np.full(3, -factor * (stretch**2 - 1) / 2), rel=1e-5)


def test_a_sheared_vein() -> None:
    """Tissue that slides along the vein, z + g x, presses as a closed form of its stress says, by the deformed normal:
    F has a row that its cofactor has not, and taking one for the other is seen."""
    mu, lam, g = 8e3, 5e3, 0.3
    young, poisson = mu * (3 * lam + 2 * mu) / (lam + mu), lam / (2 * (lam + mu))
    tissue = SaintVenantKirchhoff(young=young, poisson=poisson, density=0.0)
    system = system_of(case_of(TUBE, **{"materials.tissue": tissue}))
    x = position()[0]
    set_motion(system, ng.CF((0, 0, g * x)))
    load = _load(system, np.linspace(0, TUBE.length, 3))
    F = np.eye(3) + g * np.outer([0, 0, 1], [1, 0, 0])
    E = (F.T @ F - np.eye(3)) / 2
    sigma = F @ (lam * np.trace(E) * np.eye(3) + 2 * mu * E) @ F.T / np.linalg.det(F)
    angle = 2 * np.pi * (np.arange(400) + 0.5) / 400
    normals = np.linalg.inv(F).T @ np.array([np.cos(angle), np.sin(angle), 0 * angle])
    area = np.linalg.norm(normals, axis=0)
    pressure = -np.einsum("ia,ij,ja->a", normals, sigma, normals) / area**2
    assert load.tissue == pytest.approx(np.full(3, np.average(pressure, weights=area)), rel=1e-4)


def test_a_mesh_without_layers() -> None:
    """Tissue that is widened the more the farther along the vein: vertices at any heights, taken station by station,
    show the same rise as layers do."""
    tissue = SaintVenantKirchhoff(young=20e3, poisson=0.2, density=0.0)
    layers = TUBE.replace(**{"mesh.axial_layers": 8, "mesh.curving_order": 1})
    found = []
    for geometry in (layers, Jagged(**{name: getattr(layers, name) for name in type(layers).model_fields})):
        system = system_of(case_of(geometry, **{"materials.tissue": tissue}))
        x, y, z = (position()[i] for i in range(3))
        set_motion(system, 0.02 * z / TUBE.length * ng.CF((x, y, 0)))
        found.append(_load(system, np.linspace(0, TUBE.length, 5)).tissue)
    assert np.ptp(found[0]) > 100
    assert found[1] == pytest.approx(found[0], abs=0.1 * np.ptp(found[0]))


class Jagged(TubeSegment):
    """A tube whose vertices between the ends stand at heights of their own."""

    def netgen_mesh(self, attempt: int = 0) -> Any:
        mesh = super().netgen_mesh(attempt)
        points = mesh.Coordinates()
        inside = (points[:, 2] > 1e-9) & (points[:, 2] < self.length - 1e-9)
        points[inside, 2] += np.random.default_rng(1).uniform(-0.2, 0.2, inside.sum()) * self.length / 8
        return mesh


def _load(system: System, heights: NDArray[np.float64]) -> WallLoad:
    tissue = Side(system, "tissue")
    sections = sections_of(system, heights)
    load = WallLoad(system, sections, tissue, "tissue")
    tissue.refresh()
    load.refresh()
    return load
