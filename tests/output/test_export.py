"""Exports, read back by meshio: shared nodes, regions, node orders, fields at the border of the blood."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import meshio
import ngsolve as ng
import numpy as np
import pytest
import pyvista as pv
from ngfsi_geometry.calf import CalfSegment
from ngfsi_geometry.external import ExternalMesh
from ngfsi_geometry.segment import MeshSettings
from ngfsi_geometry.tube import TubeSegment

from ngfsi.errors import OutputError
from ngfsi.mesh.domain import Domain
from ngfsi.store import RunFolder, open_run
from ngfsi.store.export import FORMATS, export, of_domain, write
from ngfsi.store.fields import FieldWriter
from ngfsi.store.stored import StoredRun
from tests.output.fake import CASE, GEOMETRY, INFLATION, domain

REST = ng.CF((0, 0, 0))


def read(run: StoredRun, fmt: str) -> meshio.Mesh:
    path, time = export(run, 1.4, fmt)
    assert time == 1.5
    assert path.parent == run.path / "export"
    return meshio.read(path)


@pytest.mark.parametrize("fmt", ["xdmf", "vtu", "gmsh"])
def test_curved_formats(stored: StoredRun, fmt: str) -> None:
    mesh = read(stored, fmt)
    kinds = [("wedge18", domain().mesh.ne)]
    assert [(block.type, len(block.data)) for block in mesh.cells if block.dim == 3] == kinds
    assert len(mesh.points) < 6 * domain().mesh.ne  # 18 a cell when not shared
    assert len(np.unique(mesh.points.round(8), axis=0)) == len(mesh.points)
    moved = np.linalg.norm(mesh.point_data["displacement_m"], axis=1)
    assert moved.max() == pytest.approx(GEOMETRY.lumen_radius * (1 - np.sqrt(INFLATION * 0.75)), rel=5e-3)


def test_vtu_names_regions_by_number(stored: StoredRun) -> None:
    regions = read(stored, "vtu").cell_data["region"][0]
    assert np.bincount(regions).tolist() == [(np.array([e.mat for e in domain().mesh.Elements()]) == name).sum()
                                             for name in ("tissue", "wall", "fluid")]  # fmt: skip


def test_gmsh_has_named_volumes_and_its_own_order_of_nodes(stored: StoredRun) -> None:
    mesh = read(stored, "gmsh")
    assert {name: tuple(tag) for name, tag in mesh.field_data.items()} == {
        "tissue": (1, 3),
        "wall": (2, 3),
        "fluid": (3, 3),
        **{name: (number, 2) for number, name in enumerate(domain().geometry.boundary_names, start=4)},
    }
    assert set(mesh.cell_data["gmsh:physical"][0]) == {1, 2, 3}
    nodes = mesh.points[mesh.cells[0].data]
    straight = mesh.cell_data["gmsh:physical"][0] == 1
    # Gmsh manual, Prism18: nodes 6 to 14 on the edges 01 02 03 12 14 25 34 35 45, 15 to 17 on the faces 0143 0253 1254
    vertical = {8: (0, 3), 10: (1, 4), 11: (2, 5)}
    for node, (a, b) in vertical.items():
        np.testing.assert_allclose(nodes[:, node], (nodes[:, a] + nodes[:, b]) / 2, atol=1e-6)
    between = {
        6: (0, 1),
        7: (0, 2),
        9: (1, 2),
        12: (3, 4),
        13: (3, 5),
        14: (4, 5),
        15: (6, 12),
        16: (7, 13),
        17: (9, 14),
    }
    for node, (a, b) in between.items():
        sagitta = np.linalg.norm(nodes[straight, node] - (nodes[straight, a] + nodes[straight, b]) / 2, axis=1)
        edge = np.linalg.norm(nodes[straight, a] - nodes[straight, b], axis=1)
        assert (sagitta < 0.25 * edge).all()


def test_abaqus_has_straight_cells_in_sets(stored: StoredRun) -> None:
    mesh = read(stored, "abaqus")
    assert [block.type for block in mesh.cells] == ["wedge"]
    assert len(mesh.points) == domain().mesh.nv
    assert {name: len(cells[0]) for name, cells in mesh.cell_sets.items()} == {
        name: sum(element.mat == name for element in domain().mesh.Elements()) for name in ("tissue", "wall", "fluid")
    }
    corners = mesh.points[mesh.cells[0].data]
    base = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (np.einsum("ij,ij->i", base, corners[:, 3] - corners[:, 0]) > 0).all()


def test_the_blood_decides_on_its_border(tmp_path: Path) -> None:
    folder = RunFolder.create(tmp_path / "run", CASE)
    everywhere = domain().mesh.MaterialCF({"fluid": 7.0}, default=0.0)
    FieldWriter(folder.path, domain(), {"displacement_m": REST, "pressure_Pa": everywhere}).write(0.0)
    path, _ = export(open_run(folder.path), 0.0, "vtu", tmp_path / "deep" / "out.vtu")
    mesh = meshio.read(path)
    blood = np.unique(mesh.cells[0].data[mesh.cell_data["region"][0] == 2])
    np.testing.assert_array_equal(mesh.point_data["pressure_Pa"][blood], 7.0)
    others = np.setdiff1d(np.arange(len(mesh.points)), blood)
    np.testing.assert_array_equal(mesh.point_data["pressure_Pa"][others], 0.0)


def test_several_kinds_of_cells(tmp_path: Path) -> None:
    mixed = MeshSettings(element="mixed", axial_layers=2, vein_size=5e-3, far_size=25e-3, lumen_radii=(0.6,))
    case = CASE.replace(geometry=CalfSegment(mesh=mixed))
    body = Domain.build(case.geometry)
    folder = RunFolder.create(tmp_path / "run", case)
    FieldWriter(folder.path, body, {"displacement_m": REST}).write(0.0)
    for fmt, kinds in (("xdmf", {"wedge", "hexahedron"}), ("vtu", {"wedge18", "hexahedron20"})):
        path, _ = export(open_run(folder.path), 0.0, fmt)
        assert {block.type for block in meshio.read(path).cells if block.dim == 3} == kinds


def exported(geometry: Any, path: Path, fmt: str) -> Path:
    """Store a run at rest and export it; return the folder of what was written, or the file."""
    case = CASE.replace(geometry=geometry)
    folder = RunFolder.create(path / "run", case)
    FieldWriter(folder.path, Domain.build(geometry), {"displacement_m": REST}).write(0.0)
    written, _ = export(open_run(folder.path), 0.0, fmt, path / "mesh" / f"mesh{FORMATS[fmt]}")
    return written.parent if fmt == "xdmf" else written


@pytest.mark.parametrize("fmt", ["vtu", "gmsh"])
@pytest.mark.parametrize("element", ["tetrahedron", "prism"])
def test_a_mesh_that_is_no_run_is_read_back_exactly(tmp_path: Path, element: Any, fmt: str) -> None:
    mesh = MeshSettings(element=element, axial_layers=2, vein_size=5e-3, far_size=25e-3, lumen_radii=(0.6,),
                        curving_order=2)  # fmt: skip
    before = Domain.build(TubeSegment(length=10e-3, wall_thickness=2e-3, outer_radius=14e-3, mesh=mesh))
    file = tmp_path / f"mesh{FORMATS[fmt]}"
    write(of_domain(before), file, fmt)
    after = Domain.build(ExternalMesh(file=str(file), unit="m"))
    for name in before.regions:
        assert after.volume(name) == pytest.approx(before.volume(name), rel=1e-10, abs=0), name
    for name in before.geometry.boundary_names:
        assert after.area(name) == pytest.approx(before.area(name), rel=1e-10, abs=0), name


@pytest.mark.parametrize("fmt", ["vtu", "gmsh", "abaqus", "xdmf"])
@pytest.mark.parametrize(("element", "order"), [("tetrahedron", 2), ("mixed", 2), ("prism", 2), ("prism", 1)])
def test_read_back(tmp_path: Path, element: Any, order: int, fmt: str) -> None:
    """The same regions and boundaries, of the same volumes and areas, in single precision those of the run.

    Curved hexahedra have no nodes in the middle of faces: a part in a thousand.
    """
    mesh = MeshSettings(element=element, axial_layers=2, vein_size=5e-3, far_size=25e-3, lumen_radii=(0.6,),
                        curving_order=order)  # fmt: skip
    geometry = TubeSegment(length=10e-3, wall_thickness=2e-3, outer_radius=14e-3, mesh=mesh)
    file = exported(geometry, tmp_path, fmt)
    before, after = Domain.build(geometry), Domain.build(ExternalMesh(file=str(file), unit="m"))
    assert (set(after.regions), set(after.geometry.boundary_names)) == (
        set(before.regions), set(geometry.boundary_names),
    )  # fmt: skip
    straight = fmt == "abaqus" or (fmt == "xdmf" and element == "mixed")
    if straight:
        before.mesh.UnsetDeformation()
    rel = 3e-3 if element == "mixed" and not straight else 2e-6
    for name in before.regions:
        assert after.volume(name) == pytest.approx(before.volume(name), rel=rel), name
    for name in geometry.boundary_names:
        assert after.area(name) == pytest.approx(before.area(name), rel=rel), name
    if fmt == "vtu":
        sizes = pv.read(file).compute_cell_sizes()
        assert (np.where(sizes["region"] < 0, sizes["Area"], sizes["Volume"]) > 0).all()


def test_refusals(stored: StoredRun, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="'vtk' is not a known format: did you mean 'vtu'"):
        export(stored, 1.0, "vtk")
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match=r"out\.vtu' cannot be written"):
        export(stored, 1.0, "vtu", tmp_path / "file" / "out.vtu")
    RunFolder.create(tmp_path / "empty", CASE)
    with pytest.raises(OutputError, match="holds no fields of the volume yet"):
        export(open_run(tmp_path / "empty"), 1.0, "vtu")
