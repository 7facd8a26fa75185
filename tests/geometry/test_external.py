"""Meshes from files: geometry to file to geometry, curved cells, names, refusals."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import meshio
import ngsolve as ng
import numpy as np
import pytest
from ngfsi_geometry.external import ExternalMesh
from ngfsi_geometry.segment import MeshSettings
from ngfsi_geometry.tube import TubeSegment

from ngfsi.errors import GeometryError
from ngfsi.mesh.domain import Domain
from tests.vein import domain_of

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
    assert np.min([v.point[2] for v in after.mesh.vertices]) == 0.0
    with pytest.raises(GeometryError, match="has no groups 'gmsh:physical' and no sets: its arrays of cells are part"):
        ExternalMesh(file=str(file))


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
    turned = {**names, str(numbers["inlet"]): "outlet", str(numbers["outlet"]): "inlet"}
    with pytest.raises(GeometryError, match=r"the inlet of .* must be flat at the lower end along z, a node is 10 mm"):
        ExternalMesh(**given, names=turned)
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
