"""Meshes from files: geometry to file to geometry, curved cells, names, refusals."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import meshio
import netgen.occ as occ
import ngsolve as ng
import numpy as np
import pytest
import vtk
from meshio._mesh import topological_dimension
from ngfsi_geometry.external import ExternalMesh
from ngfsi_geometry.segment import MeshSettings
from ngfsi_geometry.tube import TubeSegment

from ngfsi.errors import GeometryError
from ngfsi.mesh.cells import KINDS as KINDS_BY_NAME
from ngfsi.mesh.domain import Domain
from tests.vein import domain_of

topological_dimension |= {"wedge15": 3, "pyramid13": 3}  # meshio writes them, but does not know their dimension
KINDS = {4: "tetra", 6: "wedge", 8: "hexahedron"}
FACES = {3: "triangle", 4: "quad"}
MM = 1e3
TETRA_EDGES = ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))
"""Between which corners VTK has its nodes 4 to 9; of the cube below, its nodes 8 to 19."""
CUBE_EDGES = ((0, 1), (1, 2), (2, 3), (0, 3), (4, 5), (5, 6), (6, 7), (4, 7), (0, 4), (1, 5), (2, 6), (3, 7))
WEDGE_EDGES = ((0, 1), (1, 2), (0, 2), (3, 4), (4, 5), (3, 5), (0, 3), (1, 4), (2, 5))
GMSH_WEDGE_EDGES = ((0, 1), (0, 2), (0, 3), (1, 2), (1, 4), (2, 5), (3, 4), (3, 5), (4, 5))
"""As in Gmsh's manual, section on node ordering."""
WEDGE_QUADS = ((0, 1, 3, 4), (0, 2, 3, 5), (1, 2, 4, 5))
CUBE_FACES = ((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7))


def tube(element: Any, order: int) -> TubeSegment:
    mesh = MeshSettings(
        element=element, axial_layers=2, far_size=8e-3, vein_size=3e-3, lumen_radii=(0.6,), curving_order=order
    )
    return TubeSegment(length=10e-3, wall_thickness=2e-3, outer_radius=14e-3, mesh=mesh)


Rows = dict[tuple[str, str], list[list[int]]]


def cells_of(geometry: TubeSegment) -> tuple[np.ndarray, Rows]:
    """Return corners [mm] of the straight mesh of a tube, and the cells by name and kind, faces in either sense."""
    mesh = domain_of(geometry).mesh
    rows: Rows = {}
    for elements, kinds, names in (
        (mesh.Elements(ng.VOL), KINDS, ("tissue", "wall", "fluid")),
        (mesh.Elements(ng.BND), FACES, geometry.boundary_names),
    ):
        for element in elements:
            nodes = [v.nr for v in element.vertices][:: 1 if len(element.edges) > 4 or element.nr % 2 else -1]
            if element.mat in names:
                rows.setdefault((element.mat, kinds[len(nodes)]), []).append(nodes)
    return MM * np.array([v.point for v in mesh.vertices]), rows


def raw_mesh(points: np.ndarray, rows: Rows, array: str) -> tuple[meshio.Mesh, dict[str, int]]:
    """Return a mesh whose cells have the number of their group, from 1."""
    numbers = {name: k for k, name in enumerate(dict.fromkeys(name for name, _ in rows), start=1)}
    cells = [(kind, np.array(nodes)) for (_, kind), nodes in rows.items()]
    tags = [np.full(len(nodes), numbers[name], dtype=np.int32) for (name, _), nodes in rows.items()]
    return meshio.Mesh(points, cells, cell_data={array: tags}), numbers


def test_gmsh_file_of_second_order(tmp_path: Path) -> None:
    """A tube of curved tetrahedra comes back with its volumes, and with faces that look out of the blood."""
    geometry, file = tube("tetrahedron", 2), tmp_path / "tube.msh"
    points, rows = cells_of(geometry)
    before = domain_of(geometry)
    shape, middle = before.mesh.deformation, {}
    for (name, kind), cells in list(rows.items()):
        if kind == "tetra":
            for nodes in cells:
                edges = [tuple(sorted((nodes[a], nodes[b]))) for a, b in TETRA_EDGES]
                nodes += [middle.setdefault(edge, len(points) + len(middle)) for edge in edges]
            rows[name, "tetra10"] = rows.pop((name, kind))
    straight = np.vstack([points, [points[list(edge)].mean(axis=0) for edge in middle]])
    before.mesh.UnsetDeformation()
    bent = straight + MM * np.array([shape(before.mesh(*p)) for p in straight / MM])
    before.mesh.SetDeformation(shape)
    raw, numbers = raw_mesh(bent, rows, "gmsh:physical")
    raw.cell_data["gmsh:geometrical"] = raw.cell_data["gmsh:physical"]
    titles = {"fluid": "Blood", "skin": "Outside"}
    raw.field_data = {titles.get(n, n): np.array([k, 3 if n in before.regions else 2]) for n, k in numbers.items()}
    meshio.write(file, raw, file_format="gmsh22", binary=False)

    external = ExternalMesh(file=str(file), names={"Blood": "fluid", "Outside": "skin"})
    assert (external.solids, external.fluid, external.curving_order) == (("tissue", "wall"), "fluid", 2)
    assert ExternalMesh.from_dict(external.to_toml_dict()) == external
    domain = Domain.build(external, cache=False)
    for name in before.regions:
        assert domain.volume(name) == pytest.approx(before.volume(name), rel=1e-8)
    for name in before.geometry.boundary_names:
        assert domain.area(name) == pytest.approx(before.area(name), rel=1e-8)
    assert external.lumen_radius == pytest.approx(geometry.lumen_radius, rel=1e-3)
    assert external.wall_thickness == pytest.approx(geometry.wall_thickness, rel=2e-3)
    assert external.vein_centre == pytest.approx((0.0, 0.0), abs=1e-6)
    outwards = ng.CF((ng.x, ng.y, ng.z)) * ng.specialcf.normal(3)
    flux = ng.Integrate(outwards * domain.ds("interface", "outlet", "inlet", bonus_intorder=4), domain.mesh)
    assert flux == pytest.approx(3 * domain.volume("fluid"), rel=1e-8)


def test_vtu_file_of_wedges_and_hexahedra(tmp_path: Path) -> None:
    geometry, file = tube("mixed", 1), tmp_path / "tube.vtu"
    points, rows = cells_of(geometry)
    raw, numbers = raw_mesh(points + np.array([0.0, 0.0, 7.0]), rows, "part")
    meshio.write(file, raw)
    names = {str(number): name for name, number in numbers.items()}
    external = ExternalMesh(file=str(file), groups="part", names=names)
    after, before = domain_of_file(external), domain_of(geometry)
    assert after.statistics()["elements_by_type"] == before.statistics()["elements_by_type"]
    for name in before.regions:
        assert after.volume(name) == pytest.approx(before.volume(name), rel=1e-10)
    heights = [v.point[2] for v in after.mesh.vertices]  # the coordinates stay those of the file
    assert (min(heights), max(heights)) == pytest.approx((7e-3, 17e-3), rel=1e-12)
    assert ExternalMesh(file=str(file), names=names) == external.replace(groups=None)  # the only array
    with pytest.raises(GeometryError, match="has no groups 'parts': its arrays of whole numbers of cells are part"):
        ExternalMesh(file=str(file), groups="parts")


def domain_of_file(external: ExternalMesh) -> Domain:
    return Domain.build(external, cache=False)


def test_abaqus_file(tmp_path: Path) -> None:
    geometry, file = tube("tetrahedron", 1), tmp_path / "tube.inp"
    points, rows = cells_of(geometry)
    lines = ["*NODE", *(f"{k}, {x!r}, {y!r}, {z!r}" for k, (x, y, z) in enumerate(points.tolist(), start=1))]
    number = 0
    for (name, kind), cells in rows.items():
        lines.append(f"*ELEMENT, TYPE={'C3D4' if kind == 'tetra' else 'S3'}, ELSET={name}")
        for nodes in cells:
            number += 1
            lines.append(", ".join(map(str, [number, *(n + 1 for n in nodes)])))
    file.write_text("\n".join(lines) + "\n")
    after, before = domain_of_file(ExternalMesh(file=str(file))), domain_of(geometry)
    for name in before.regions:
        assert after.volume(name) == pytest.approx(before.volume(name), rel=1e-10)


def test_hexahedron_of_second_order(tmp_path: Path) -> None:
    """A cube under z -> z (1 + 4 a x (1 - x)), which its second-order cell has exactly: of the volume 1 + 2 a / 3."""
    a, file = 0.3, tmp_path / "cube.msh"
    corners = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1.0)])
    points = np.vstack([corners, [corners[list(edge)].mean(axis=0) for edge in CUBE_EDGES]])
    points[:, 2] *= 1 + 4 * a * points[:, 0] * (1 - points[:, 0])
    rows = {("wall", "hexahedron20"): [list(range(20))], ("skin", "quad"): [list(face) for face in CUBE_FACES]}
    raw, numbers = raw_mesh(points, rows, "gmsh:physical")
    raw.cell_data["gmsh:geometrical"] = raw.cell_data["gmsh:physical"]
    meshio.write(file, raw, file_format="gmsh22", binary=False)
    domain = domain_of_file(ExternalMesh(file=str(file), unit="m", names={str(k): n for n, k in numbers.items()}))
    assert domain.volume("wall") == pytest.approx(1 + 2 * a / 3, rel=1e-10)


def test_refused_files(tmp_path: Path) -> None:
    file = tmp_path / "tube.vtu"
    points, rows = cells_of(tube("mixed", 1))
    raw, numbers = raw_mesh(points, rows, "part")
    meshio.write(file, raw)
    names = {str(number): name for name, number in numbers.items()}
    given = {"file": str(file), "groups": "part"}
    with pytest.raises(GeometryError, match=r"the mesh 'nothing.msh' cannot be read: No such file"):
        ExternalMesh(file="nothing.msh")
    with pytest.raises(GeometryError, match="'lumen' is not a known region or boundary"):
        ExternalMesh(**given, names={**names, str(numbers["fluid"]): "lumen"})
    without = {key: name for key, name in names.items() if name != "inlet"}
    with pytest.raises(GeometryError, match=r"a face between fluid and outside near \(.*, 0\) mm has no name"):
        ExternalMesh(**given, names=without)
    closed = {**names, str(numbers["inlet"]): "outlet"}
    with pytest.raises(GeometryError, match=r"has no cells of inlet: name its groups"):
        ExternalMesh(**given, names=closed)
    with pytest.raises(GeometryError, match="'inlet_1' is not a known region or boundary"):
        ExternalMesh(**given, names={**names, str(numbers["inlet"]): "inlet_1"})
    with pytest.raises(GeometryError, match="has no cells of fluid, wall, tissue: name its groups"):
        ExternalMesh(**given)
    external = ExternalMesh(**given, names=names)
    file.write_text("<VTKFile>")
    with pytest.raises(GeometryError, match="is not the file of this case, it has changed"):
        ExternalMesh(**given, names=names, sha256=external.sha256)
    with pytest.raises(GeometryError, match="cannot be read as a mesh"):
        ExternalMesh(**given, names=names)


@pytest.mark.parametrize(
    ("suffix", "kind"), [("vtu", "wedge15"), ("vtu", "wedge18"), ("msh", "wedge15"), ("msh", "wedge18")]
)
def test_wedge_of_second_order(tmp_path: Path, suffix: str, kind: str) -> None:
    """A wedge under z -> z (1 + 4 a x (1 - x)), which its second-order cell has exactly: of the volume 1/2 + a / 3.

    meshio turns wedge15 of Gmsh into VTK's order of nodes and back, and leaves wedge18 as Gmsh has it.
    """
    a, file = 0.3, tmp_path / f"wedge.{suffix}"
    corners = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (0, 1, 1.0)])
    edges = GMSH_WEDGE_EDGES if (suffix, kind) == ("msh", "wedge18") else WEDGE_EDGES
    parts = [*edges, *(WEDGE_QUADS if kind == "wedge18" else ())]
    points = np.vstack([corners, [corners[list(part)].mean(axis=0) for part in parts]])
    points[:, 2] *= 1 + 4 * a * points[:, 0] * (1 - points[:, 0])
    rows = {
        ("wall", kind): [list(range(len(points)))], ("skin", "triangle"): [[0, 1, 2], [3, 4, 5]],
        ("skin", "quad"): [[0, 1, 4, 3], [1, 2, 5, 4], [2, 0, 3, 5]],
    }  # fmt: skip
    array = "gmsh:physical" if suffix == "msh" else "part"
    raw, numbers = raw_mesh(points, rows, array)
    if suffix == "msh":
        raw.cell_data["gmsh:geometrical"] = raw.cell_data[array]
        meshio.write(file, raw, file_format="gmsh22", binary=False)
    else:
        meshio.write(file, raw)
    names = {str(k): name for name, k in numbers.items()}
    domain = domain_of_file(ExternalMesh(file=str(file), unit="m", groups=array, names=names))
    assert domain.geometry.curving_order == 2
    assert domain.volume("wall") == pytest.approx(1 / 2 + a / 3, rel=1e-10)


def external_of(file: Path, points: np.ndarray, rows: Rows) -> ExternalMesh:
    """Write cells to a file and return its mesh; groups that are in `rows` alone."""
    raw, numbers = raw_mesh(points, rows, "part")
    meshio.write(file, raw)
    return ExternalMesh(file=str(file), groups="part", names={str(number): name for name, number in numbers.items()})


def without(rows: Rows, *names: str) -> Rows:
    return {key: cells for key, cells in rows.items() if key[0] not in names}


def middle(domain: Domain, boundary: str) -> list[float]:
    """Return the centre of a boundary [m]."""
    moments = (ng.Integrate(axis * domain.ds(boundary), domain.mesh) for axis in (ng.x, ng.y, ng.z))
    return [moment / domain.area(boundary) for moment in moments]


ENDS = ("wall_bottom", "wall_top", "tissue_bottom", "tissue_top")


@pytest.mark.parametrize("element", ["tetrahedron", "mixed"])
def test_faces_in_no_group_are_inferred_along_any_axis(tmp_path: Path, element: Any) -> None:
    """A tube turned by a random rotation and moved: everything is as of the tube along z with all its groups."""
    geometry = tube(element, 1)
    points, rows = cells_of(geometry)
    turn = np.linalg.qr(np.random.default_rng(3).standard_normal((3, 3)))[0]
    rows = without(rows, "interface", "wall_outer", *ENDS)
    external = external_of(tmp_path / "tube.vtu", points @ turn.T + [40.0, -20.0, 5.0], rows)
    before, after = domain_of(geometry), domain_of_file(external)
    assert set(external.boundary_names) == set(geometry.boundary_names)
    for name in before.regions:
        assert after.volume(name) == pytest.approx(before.volume(name), rel=1e-10)
    for name in geometry.boundary_names:
        assert after.area(name) == pytest.approx(before.area(name), rel=1e-10), name
    for opening, ends in (("inlet", ENDS[::2]), ("outlet", ENDS[1::2])):
        for name in ends:
            assert middle(after, name) == pytest.approx(middle(after, opening), rel=2e-2), name
    assert external.length == pytest.approx(geometry.length, rel=1e-10)
    assert external.lumen_radius == pytest.approx(np.sqrt(before.area("inlet") / np.pi), rel=1e-10)
    (vessel,) = external.vessels
    assert (vessel.lumen, vessel.interface, vessel.wall, vessel.outer) == ("fluid", "interface", "wall", "wall_outer")
    assert (vessel.inlets, vessel.outlets, vessel.centreline) == (("inlet",), ("outlet",), None)
    assert (external.rigid_names, external.inflow()) == ((), None)
    with pytest.raises(GeometryError, match=r"a face between tissue and outside near .* has no name of a boundary"):
        external_of(tmp_path / "open.vtu", points, without(rows, "skin"))


@pytest.mark.parametrize("name", ["wall_outer", "skin"])
def test_wall_without_tissue(tmp_path: Path, name: str) -> None:
    """Its outer surface is the skin, whatever it is called in the file; without a group it is refused."""
    geometry = tube("tetrahedron", 1)
    points, rows = cells_of(geometry)
    rows = without(rows, "tissue", "skin", "tissue_bottom", "tissue_top")
    outer = {(name if title == "wall_outer" else title, kind): cells for (title, kind), cells in rows.items()}
    external = external_of(tmp_path / "tube.vtu", points, outer)
    before, after = domain_of(geometry), domain_of_file(external)
    assert (external.solids, after.regions) == (("wall",), ("wall", "fluid"))
    assert after.area("skin") == pytest.approx(before.area("wall_outer"), rel=1e-3)
    (vessel,) = external.vessels
    assert (vessel.wall, vessel.outer, after.has_boundary("wall_outer")) == ("wall", None, False)
    with pytest.raises(GeometryError, match=r"a face between wall and outside near .* has no name of a boundary"):
        external_of(tmp_path / "open.vtu", points, without(rows, "wall_outer"))


def test_lumen_alone_and_solids_alone(tmp_path: Path) -> None:
    """An oval lumen with a rigid wall: its radius is that of a circle of the same area; a hole has no lumen."""
    points, rows = cells_of(tube("mixed", 1))
    outside = ("tissue", "wall", "skin", "wall_outer", *ENDS)
    oval = external_of(tmp_path / "oval.vtu", points * [1.5, 0.8, 1.0], without(rows, *outside))
    domain = domain_of_file(oval)
    (vessel,) = oval.vessels
    assert (oval.solids, domain.regions, oval.rigid_names) == ((), ("fluid",), ("interface",))
    assert (vessel.wall, vessel.outer, oval.wall_thickness) == (None, None, 0.0)
    assert np.pi * vessel.radius**2 == pytest.approx(domain.area("outlet"), rel=1e-10)
    solids = external_of(tmp_path / "solids.vtu", points, without(rows, "fluid", "inlet", "outlet"))
    (hole,) = solids.vessels
    assert (hole.lumen, hole.interface, hole.openings) == (None, "interface", ())
    assert domain_of_file(solids).regions == ("tissue", "wall")


def test_a_bent_vessel(tmp_path: Path) -> None:
    """A quarter of a torus: by Pappus' theorem volumes are those of a straight tube as long as its middle line."""
    geometry = TubeSegment(length=40e-3, wall_thickness=2e-3, outer_radius=14e-3, mesh=tube("mixed", 1).mesh.replace(
        axial_layers=24, vein_size=2e-3,
    ))  # fmt: skip
    points, rows = cells_of(geometry)
    bend = MM * geometry.length * 2 / np.pi
    angle, radius = points[:, 2] / bend, bend - points[:, 0]
    bent = np.column_stack([bend - radius * np.cos(angle), points[:, 1], radius * np.sin(angle)])
    external = external_of(tmp_path / "bent.vtu", bent, without(rows, *ENDS))
    before, after = domain_of(geometry.replace(**{"mesh.curving_order": 1})), domain_of_file(external)
    for name in before.regions:
        assert after.volume(name) == pytest.approx(before.volume(name), rel=2e-3), name
    for name in ("inlet", "outlet", *ENDS):
        assert after.area(name) == pytest.approx(before.area(name), rel=1e-9), name
    assert external.length == pytest.approx(np.sqrt(2) * bend / MM, rel=1e-9)
    assert external.wall_thickness == pytest.approx(geometry.wall_thickness, rel=2e-2)  # of straight edges


def test_a_branched_vessel(tmp_path: Path) -> None:
    """A square pipe of 4 mm with a branch of 2 mm: one inlet, two outlets, one across the other."""
    pipe, branch = (occ.Box(low, high) for low, high in (((0, 0, 0), (4, 4, 20)), ((4, 1, 9), (10, 3, 11))))
    shape = pipe + branch
    shape.mat("fluid").faces.name = "interface"
    shape.faces.Min(occ.Z).name, shape.faces.Max(occ.Z).name, shape.faces.Max(occ.X).name = (
        "inlet",
        "outlet",
        "outlet_12",
    )
    mesh = ng.Mesh(occ.OCCGeometry(shape).GenerateMesh(maxh=3))
    rows: Rows = {}
    for elements, kinds in ((mesh.Elements(ng.VOL), KINDS), (mesh.Elements(ng.BND), FACES)):
        for element in elements:
            nodes = [v.nr for v in element.vertices]
            rows.setdefault((element.mat, kinds[len(nodes)]), []).append(nodes)
    external = external_of(tmp_path / "branched.vtu", np.array([v.point for v in mesh.vertices]), rows)
    domain, (vessel,) = domain_of_file(external), external.vessels
    assert (vessel.inlets, vessel.outlets) == (("inlet",), ("outlet", "outlet_12"))
    areas = [domain.area(name) for name in vessel.openings]
    assert areas == pytest.approx([16e-6, 16e-6, 4e-6], rel=1e-9)
    assert domain.volume() == pytest.approx((4 * 4 * 20 + 2 * 2 * 6) * 1e-9, rel=1e-9)
    both = {(name.removesuffix("_12"), kind): [] for name, kind in rows}
    for (name, kind), cells in rows.items():
        both[name.removesuffix("_12"), kind] += cells
    with pytest.raises(GeometryError, match=r"the outlet of .* must be flat: .* each opening a name .*outlet_2"):
        external_of(tmp_path / "both.vtu", np.array([v.point for v in mesh.vertices]), both)


@pytest.mark.parametrize(("share", "flat"), [(0.014, True), (0.05, False)])
def test_openings_must_be_flat(tmp_path: Path, share: float, flat: bool) -> None:
    """A wavy inlet, by a share of the lumen's radius, which does not depend on the length of the vessel."""
    geometry = tube("mixed", 1)
    points, rows = cells_of(geometry)
    low = points[:, 2] == 0
    angle = np.arctan2(points[:, 1], points[:, 0])
    points[low, 2] = share * np.hypot(points[:, 0], points[:, 1])[low] * np.cos(2 * angle[low])
    rows = without(rows, "tissue", "wall", "skin", "wall_outer", *ENDS)
    if flat:
        assert external_of(tmp_path / "tube.vtu", points, rows).vessels[0].inlets == ("inlet",)
    else:
        with pytest.raises(GeometryError, match=r"the inlet of .* mm off its plane, more than 1\.5% of its radius"):
            external_of(tmp_path / "tube.vtu", points, rows)


@pytest.mark.parametrize(
    ("name", "cell"),
    [
        ("triangle6", vtk.vtkQuadraticTriangle()),
        ("quad8", vtk.vtkQuadraticQuad()),
        ("tetra10", vtk.vtkQuadraticTetra()),
        ("wedge15", vtk.vtkQuadraticWedge()),
        ("hexahedron20", vtk.vtkQuadraticHexahedron()),
    ],
)
def test_edges_and_faces_are_those_of_vtk(name: str, cell: Any) -> None:
    """Middle nodes of VTK's reference cells lie between the corners of the edges, in their order; faces go around."""
    kind = KINDS_BY_NAME[name]
    for number in range(cell.GetNumberOfPoints()):
        cell.GetPointIds().SetId(number, number)
    nodes = np.reshape([cell.GetParametricCoords()[i] for i in range(3 * cell.GetNumberOfPoints())], (-1, 3))
    assert len(nodes) == kind.corners + len(kind.edges)
    assert nodes[kind.corners :] == pytest.approx(nodes[list(kind.edges)].mean(axis=1), abs=1e-12)
    corners = [[cell.GetFace(i).GetPointId(j) for j in range(cell.GetFace(i).GetNumberOfPoints())]
               for i in range(cell.GetNumberOfFaces())]  # fmt: skip
    assert {frozenset(n for n in face if n < kind.corners) for face in corners} == {*map(frozenset, kind.faces)}
    edges = {*map(frozenset, kind.edges)}
    assert all(frozenset(pair) in edges for face in kind.faces for pair in pairwise((*face, face[0])))
    if kind.faces:
        low = nodes[: kind.base]
        assert low[:, 2] == pytest.approx(np.zeros(kind.base), abs=1e-12)
