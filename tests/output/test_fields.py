"""Fields in files: deformed points, cells of positive volume, regions and times."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import ngsolve as ng
import numpy as np
import pytest
import pyvista as pv
import vtk
from ngfsi_geometry.calf import CalfSegment
from ngfsi_geometry.segment import MeshSettings

from ngfsi.errors import OutputError
from ngfsi.mesh.domain import Domain
from ngfsi.store.fields import CELL_TYPES, DEFORMATION, STRESS, CellType, FieldWriter
from ngfsi.store.stored import StoredRun
from tests.output.fake import GEOMETRY, INFLATION, domain, wall_sample


@pytest.mark.parametrize("element", ["prism", "mixed", "tetrahedron"])
def test_volume_cells_are_deformed_whole_and_positive(
    tmp_path: Path, element: Literal["prism", "mixed", "tetrahedron"]
) -> None:
    mesh = MeshSettings(element=element, axial_layers=2, vein_size=5e-3, far_size=25e-3, lumen_radii=(0.6,))
    geometry = CalfSegment(mesh=mesh)
    body = Domain.build(geometry)
    stretched = ng.GridFunction(ng.VectorH1(body.mesh, order=2))
    stretched.Set(ng.CF((0, 0, 0.1 * ng.z)))
    number = body.mesh.MaterialCF({"tissue": 0, "wall": 1, "fluid": 2})
    writer = FieldWriter(tmp_path, body, {"displacement_m": stretched, "number_1": number})
    writer.write(0.0)
    writer.write_wall(0.0, wall_sample(1.0))
    grid: Any = pv.read(tmp_path / "fields" / "volume_0000.vtu")
    assert [str(name) for name in grid.field_data["regions"]] == ["tissue", "wall", "fluid"]
    volumes = grid.compute_cell_sizes()["Volume"]
    assert volumes.min() > 0
    for index, name in enumerate(("tissue", "wall", "fluid")):
        # second-order cells: within some percent of the round shape
        assert volumes[grid["region"] == index].sum() == pytest.approx(1.1 * geometry.exact_volumes()[name], rel=0.03)
        region = grid.extract_cells(np.flatnonzero(grid["region"] == index))
        np.testing.assert_array_equal(region.point_data["number_1"], index)
    height = grid.points[:, 2]
    np.testing.assert_allclose(grid.point_data["displacement_m"][:, 2], height * 0.1 / 1.1, atol=1e-8)


def test_fields_are_found_by_time(stored: StoredRun) -> None:
    assert stored.field_times() == [0.0, 1.5]
    assert stored.field_times("wall") == pytest.approx(np.arange(0, 1.6, 0.25))
    radius = GEOMETRY.lumen_radius
    for asked, area in ((0.1, INFLATION), (2.0, INFLATION * 0.75)):
        wall = stored.fields(asked, "wall")
        distance = np.hypot(*(wall.points[:, :2] - GEOMETRY.vein_centre).T)
        np.testing.assert_allclose(distance, radius * np.sqrt(area), rtol=1e-5)


def test_wall_fields(stored: StoredRun) -> None:
    wall = stored.fields(0.0, "wall")
    assert wall.n_cells == 24 * 12
    shear = wall.point_data["wall_shear_Pa"]
    np.testing.assert_allclose(wall.point_data["wall_shear_magnitude_Pa"], np.linalg.norm(shear, axis=1), rtol=1e-6)
    assert shear[:, 2].min() == pytest.approx(0.08 / INFLATION**1.5, rel=1e-6)
    np.testing.assert_array_equal(wall.point_data["pressure_Pa"], 1333.0)


def test_the_displacement_is_needed(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="displacement_m"):
        FieldWriter(tmp_path, domain(), {"pressure_Pa": ng.CF(1.0)})


def test_wall_history(stored: StoredRun) -> None:
    """The stress grows as the vein narrows, in one direction: OSI 0, RRT = 1 / TAWSS; within a chosen time only."""
    walls = [stored.fields(time, "wall").point_data["wall_shear_magnitude_Pa"].astype(float) for time in (0.5, 0.75, 1)]
    found = stored.wall_history(0.5, 1.0)
    np.testing.assert_allclose(found["TAWSS_Pa"], (walls[0] + 2 * walls[1] + walls[2]) / 4, rtol=1e-6)
    assert np.abs(found["OSI_1"]).max() < 1e-7
    np.testing.assert_allclose(found["RRT_1_Pa"] * found["TAWSS_Pa"], 1.0, rtol=1e-6)
    assert found["TAWSSG_Pa_m"].shape == found["TAWSS_Pa"].shape
    between = stored.wall_history(0.6, 0.9)  # neither is stored
    ends = 0.6 * walls[0] + 0.4 * walls[1], 0.4 * walls[1] + 0.6 * walls[2]
    exact = (0.15 * (ends[0] + walls[1]) + 0.15 * (walls[1] + ends[1])) / 2 / 0.3
    np.testing.assert_allclose(between["TAWSS_Pa"], exact, rtol=1e-6)
    for start, end in ((0.5, 9.0), (-1.0, 0.5), (0.5, 0.5)):
        with pytest.raises(OutputError, match=rf"holds 7 states of the wall up to 1.5 s: averages from {start:g} to"):
            stored.wall_history(start, end)


def test_invariants_of_the_tensors(tmp_path: Path) -> None:
    """Of a stress and a deformation that turn: principal values, the largest first, and -tr/3."""
    c, s = np.cos(0.4), np.sin(0.4)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    stress = turn @ np.diag([-3e3, 5e3, 1e3]) @ turn.T
    gradient = turn @ np.diag([0.8, 1.3, 1.1])
    tensors = {name: ng.CF(tuple(t.ravel()), dims=(3, 3)) for name, t in ((STRESS, stress), (DEFORMATION, gradient))}
    still = ng.CF((0, 0, 0))
    FieldWriter(tmp_path, domain(), {"displacement_m": still, **tensors}).write(0.0)
    grid: Any = pv.read(tmp_path / "fields" / "volume_0000.vtu")
    assert set(grid.point_data) == {"displacement_m", "hydrostatic_pressure_Pa", "principal_stresses_Pa",
                                    "principal_stretches_1"}  # fmt: skip
    count = grid.n_points
    np.testing.assert_allclose(grid["hydrostatic_pressure_Pa"], -1e3, rtol=1e-5)
    np.testing.assert_allclose(grid["principal_stresses_Pa"], np.tile([5e3, 1e3, -3e3], (count, 1)), rtol=1e-5)
    np.testing.assert_allclose(grid["principal_stretches_1"], np.tile([1.3, 1.1, 0.8], (count, 1)), rtol=1e-5)


@pytest.mark.parametrize("kind", CELL_TYPES.values(), ids=lambda kind: kind.name)
def test_cells_are_those_of_vtk(kind: CellType) -> None:
    """Nodes are where VTK has them, and the order of the mirrored cell mirrors it as a whole."""
    cell = vtk.vtkGenericCell.InstantiateCell(kind.number)
    assert pv.CellType(kind.number).name == kind.name
    nodes = np.reshape([cell.GetParametricCoords()[i] for i in range(3 * cell.GetNumberOfPoints())], (-1, 3))
    if kind.kind == "pyramid13":  # VTK's parameters are those of a cube, one face of which is the apex
        nodes[:, :2] *= 1 - nodes[:, 2:]
    ours = kind.nodes()
    np.testing.assert_allclose(np.pad(ours, ((0, 0), (0, 3 - ours.shape[1]))), nodes, atol=1e-15)
    assert np.linalg.det(ours[list(kind.arms)] - ours[0]) > 0
    mirrored = nodes[list(kind.mirrored)]
    place = np.column_stack([nodes, np.ones(len(nodes))])
    motion, _, dimension, _ = np.linalg.lstsq(place, mirrored, rcond=None)
    assert place @ motion == pytest.approx(mirrored, abs=1e-12)
    turns = motion[: dimension - 1, : dimension - 1]
    assert np.linalg.det(turns) == pytest.approx(-1.0, rel=1e-9)
