"""Meshes as other programs write them: formats, groups, what is inferred, and what is refused with its place."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import h5py
import meshio
import ngsolve as ng
import numpy as np
import pytest
import pyvista as pv
from ngfsi_geometry.external import ExternalMesh
from ngfsi_geometry.meshfiles.gmsh import TYPES
from ngfsi_geometry.tube import TubeSegment

from ngfsi.errors import GeometryError
from ngfsi.mesh.domain import Domain
from tests.geometry.test_external import ENDS, MM, Rows, cells_of, external_of, raw_mesh, tube, without
from tests.vein import domain_of

NUMBER_OF = {kind: number for number, kind in TYPES.items()}
REGIONS = ("fluid", "wall", "tissue")


def dim_of(name: str) -> int:
    return 3 if name in REGIONS else 2


def numbers_of(rows: Rows) -> dict[str, int]:
    """Return numbers of groups, of regions and of boundaries each from 1."""
    names = dict.fromkeys(name for name, _ in rows)
    return {n: k for dim in (2, 3) for k, n in enumerate((n for n in names if dim_of(n) == dim), start=1)}


def msh41(points: np.ndarray, rows: Rows, *, binary: bool = False, named: bool = True, physical: bool = True) -> bytes:
    """Return a mesh in Gmsh's version 4.1, one entity and group a name; `physical`: whether they are in groups."""
    numbers = numbers_of(rows)

    def of(kind: str, values: Any) -> bytes:
        flat = np.ravel(values)
        if binary:
            return flat.astype({"i": "<i4", "u": "<u8", "d": "<f8"}[kind]).tobytes()
        return (" ".join(repr(float(v)) if kind == "d" else str(int(v)) for v in flat) + "\n").encode()

    out = b"$MeshFormat\n4.1 %d 8\n" % binary + (struct.pack("<i", 1) + b"\n" if binary else b"") + b"$EndMeshFormat\n"
    if named:
        lines = [f'{dim_of(n)} {k} "{n}"' for n, k in numbers.items()]
        out += f"$PhysicalNames\n{len(lines)}\n".encode() + "\n".join(lines).encode() + b"\n$EndPhysicalNames\n"
    counts = [sum(dim_of(n) == dim for n in numbers) for dim in (2, 3)]
    out += b"$Entities\n" + of("u", [0, 0, *counts])
    for dim in (2, 3):
        for name, number in numbers.items():
            if dim_of(name) == dim:
                groups = of("u", [1]) + of("i", [number]) if physical else of("u", [0])
                out += of("i", [100 + number]) + of("d", [0] * 6) + groups + of("u", [0])
    out += b"\n$EndEntities\n$Nodes\n" + of("u", [1, len(points), 1, len(points)])
    out += of("i", [3, 101, 0]) + of("u", [len(points)]) + of("u", np.arange(len(points)) + 1) + of("d", points)
    total = sum(map(len, rows.values()))
    out += b"\n$EndNodes\n$Elements\n" + of("u", [len(rows), total, 1, total])
    first = 1
    for (name, kind), cells in rows.items():
        out += of("i", [dim_of(name), 100 + numbers[name], NUMBER_OF[kind]]) + of("u", [len(cells)])
        out += of("u", np.column_stack([np.arange(first, first + len(cells)), np.array(cells) + 1]))
        first += len(cells)
    return out + b"\n$EndElements\n"


@pytest.fixture(scope="module")
def mixed() -> tuple[TubeSegment, np.ndarray, Rows]:
    geometry = tube("mixed", 1)
    return geometry, *cells_of(geometry)


def assert_same(domain: Domain, geometry: TubeSegment, rel: float = 1e-10) -> None:
    before = domain_of(geometry)
    for name in before.regions:
        assert domain.volume(name) == pytest.approx(before.volume(name), rel=rel), name
    for name in geometry.boundary_names:
        assert domain.area(name) == pytest.approx(before.area(name), rel=rel), name


@pytest.mark.parametrize("version", ["22", "22 binary", "41", "41 binary"])
def test_gmsh(tmp_path: Path, mixed: Any, version: str) -> None:
    geometry, points, rows = mixed
    file, binary = tmp_path / "tube.msh", version.endswith("binary")
    if version.startswith("41"):
        file.write_bytes(msh41(points, rows, binary=binary))
    else:
        raw, numbers = raw_mesh(points, rows, "gmsh:physical")
        raw.cell_data["gmsh:geometrical"] = raw.cell_data["gmsh:physical"]
        raw.field_data = {n: np.array([k, dim_of(n)]) for n, k in numbers.items()}
        meshio.write(file, raw, file_format="gmsh22", binary=binary)
    external = ExternalMesh(file=str(file))
    assert_same(Domain.build(external), geometry)
    assert external.remarks == ()


def test_numbers_that_mean_cells_and_faces(tmp_path: Path, mixed: Any) -> None:
    """A number alone means what the name asks for, which is said; with its dimension it is told apart."""
    geometry, points, rows = mixed
    file, numbers = tmp_path / "tube.msh", numbers_of(rows)
    file.write_bytes(msh41(points, rows, named=False))
    told = ExternalMesh(file=str(file), names={f"{dim_of(n)}:{k}": n for n, k in numbers.items()})
    assert_same(Domain.build(told), geometry)
    assert told.remarks == ()
    some = {f"2:{k}": n for n, k in numbers.items() if dim_of(n) == 2} | {str(numbers[n]): n for n in REGIONS}
    both = ExternalMesh(file=str(file), names=some)
    assert_same(Domain.build(both), geometry)
    number = numbers["fluid"]
    assert f"'{number}' means cells and faces: fluid is of the cells; '3:{number}' and '2:{number}'" in both.remarks[0]
    with pytest.raises(
        GeometryError, match=r"`names` has '3:1' as skin, which is made of faces, but in .* holds cells"
    ):
        ExternalMesh(file=str(file), names={"3:1": "skin"})
    with pytest.raises(GeometryError, match=r"`names` has '3:9', which is no group of .* its groups are .*3:1 \("):
        ExternalMesh(file=str(file), names={"3:9": "fluid"})


def test_gmsh_saved_with_all_cells(tmp_path: Path, mixed: Any) -> None:
    """Version 4.1 has the groups at its entities. Version 2.2 loses them: the entities' numbers are left."""
    geometry, points, rows = mixed
    file = tmp_path / "tube.msh"
    extra = {**rows, ("rim", "line"): [[0, 1]], ("corner", "vertex"): [[0]]}
    file.write_bytes(msh41(points, {k: c for k, c in extra.items() if k[1] not in ("line", "vertex")}))
    assert_same(Domain.build(ExternalMesh(file=str(file))), geometry)
    raw, numbers = raw_mesh(points, rows, "gmsh:geometrical")
    raw.cell_data["gmsh:physical"] = [np.zeros(len(block.data), dtype=np.int32) for block in raw.cells]
    meshio.write(file, raw, file_format="gmsh22", binary=False)
    external = ExternalMesh(file=str(file), names={str(k): name for name, k in numbers.items()})
    assert_same(Domain.build(external), geometry)
    assert "saved without Mesh.SaveAll it has the names" in external.remarks[0]
    with pytest.raises(GeometryError, match=r"has 'fluid', which is no group .* saved without Mesh.SaveAll"):
        ExternalMesh(file=str(file), names={"fluid": "fluid"})


def test_cells_in_no_region(tmp_path: Path, mixed: Any) -> None:
    """They are refused, unless left out on purpose; so are groups that are not used."""
    _, points, rows = mixed
    file = tmp_path / "tube.msh"
    count = sum(len(c) for (n, _), c in rows.items() if n == "tissue")
    file.write_bytes(msh41(points, rows).replace(b'"tissue"', b'"muscle"'))
    with pytest.raises(
        GeometryError, match=rf": {count} cells of the group 'muscle' are in no region: .*\"muscle\" = \"\""
    ):
        ExternalMesh(file=str(file))
    external = ExternalMesh(file=str(file), names={"muscle": "", "skin": "", "wall_outer": "skin"})
    assert external.solids == ("wall",)
    assert f"{count} cells are left out" in external.remarks
    assert "skin" in external.boundary_names
    (tmp_path / "more.msh").write_bytes(msh41(points, {**rows, ("valve", "triangle"): rows["inlet", "triangle"]}))
    more = ExternalMesh(file=str(tmp_path / "more.msh"))
    assert more.remarks == (
        f"groups that are no boundary and not used: valve ({len(rows['inlet', 'triangle'])} faces)",
    )


def test_abaqus_sets_and_surfaces(tmp_path: Path, mixed: Any) -> None:
    """As Abaqus/CAE writes: sets of elements of an instance, surfaces as faces of solid elements."""
    geometry, points, rows = mixed
    sides = {
        "wedge": ((0, 1, 2), (3, 5, 4), (0, 3, 4, 1), (1, 4, 5, 2), (2, 5, 3, 0)),
        "hexahedron": ((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)),
    }
    types = {"wedge": "C3D6", "hexahedron": "C3D8"}
    lines = ["*Part, name=P", "*Node"]
    lines += [f"{k}, {x!r}, {y!r}, {z!r}" for k, (x, y, z) in enumerate(points.tolist(), start=1)]
    number, sets, faces = 0, {}, {}
    for (name, kind), cells in rows.items():
        if name in REGIONS:
            lines.append(f"*Element, type={types[kind]}")
            for nodes in cells:
                number += 1
                lines.append(", ".join(map(str, [number, *(n + 1 for n in nodes)])))
                sets.setdefault(name, []).append(number)
                for k, side in enumerate(sides[kind], start=1):
                    faces.setdefault(frozenset(nodes[i] for i in side), (number, k))
    for name, members in sets.items():
        whole = members == list(range(members[0], members[-1] + 1))
        lines += [f"*Elset, elset={name}-1" + (", generate" if whole else "")]
        lines += [f"{members[0]}, {members[-1]}, 1"] if whole else [", ".join(map(str, members))]
    lines += ["*End Part", "*Assembly, name=A", "*Instance, name=P-1, part=P", "0., 0., 5.", "*End Instance"]
    by_surface: dict[str, list[tuple[int, int]]] = {}
    for (name, _), cells in rows.items():
        if name not in REGIONS:
            by_surface.setdefault(name, []).extend(faces[frozenset(nodes)] for nodes in cells)
    for name, members_ in by_surface.items():
        for k in sorted({k for _, k in members_}):
            lines += [f"*Elset, elset=_{name}_S{k}, internal, instance=P-1"]
            lines += [", ".join(str(n) for n, s in members_ if s == k)]
        lines += [
            f"*Surface, type=ELEMENT, name={name}",
            *(f"_{name}_S{k}, S{k}" for k in sorted({k for _, k in members_})),
        ]
    file = tmp_path / "tube.inp"
    file.write_text("\n".join([*lines, "*End Assembly"]) + "\n")
    external = ExternalMesh(file=str(file), names={f"{name}-1": name for name in REGIONS})
    domain = Domain.build(external)
    assert_same(domain, geometry)
    assert min(v.point[2] for v in domain.mesh.vertices) == pytest.approx(5e-3)


def grid_of(points: np.ndarray, rows: Rows, names: tuple[str, ...]) -> meshio.Mesh:
    """Return the part of a mesh with some of its groups, with nodes of its own."""
    chosen = {key: cells for key, cells in rows.items() if key[0] in names}
    used = np.unique(np.concatenate([np.ravel(cells) for cells in chosen.values()]))
    return raw_mesh(points[used], {k: np.searchsorted(used, c).tolist() for k, c in chosen.items()}, "ModelRegionID")[0]


def polygons(points: np.ndarray, rows: Rows, name: str) -> pv.PolyData:
    faces = [nodes for (n, _), cells in rows.items() if n == name for nodes in cells]
    used = np.unique(np.concatenate(faces))
    surface = pv.PolyData(points[used], np.concatenate([[len(f), *np.searchsorted(used, f)] for f in faces]))
    surface.cell_data["ModelFaceID"] = np.full(len(faces), 2)
    return surface


@pytest.mark.parametrize("shift", [1e-6, 0.3])
def test_simvascular_pair(tmp_path: Path, mixed: Any, shift: float) -> None:
    """Lumen and wall in folders of their own, whose nodes match but for rounding; the place where they do not."""
    _, points, rows = mixed
    files = {"lumen": ("fluid", ("inlet", "outlet", "interface")), "wall": ("wall", ("interface", "wall_outer"))}
    for folder, (region, surfaces) in files.items():
        place = tmp_path / "both" / folder / "mesh-complete"
        (place / "mesh-surfaces").mkdir(parents=True)
        moved = points + (shift if folder == "wall" else 0.0)
        meshio.write(place / "mesh-complete.mesh.vtu", grid_of(moved, rows, (region,)))
        for name in surfaces:
            polygons(moved, rows, name).save(place / "mesh-surfaces" / f"{name}.vtp")
        polygons(moved, rows, surfaces[0]).save(place / "mesh-complete.exterior.vtp")
    names = {"lumen": "fluid", "wall": "wall", "lumen/inlet": "inlet", "lumen/outlet": "outlet",
             "lumen/interface": "interface", "wall/wall_outer": "skin"}  # fmt: skip
    if shift > 1e-3:
        match = r"a face between wall and outside near \(.* as have \d+ in all: .* touch, their nodes are not the same"
        with pytest.raises(GeometryError, match=match):
            ExternalMesh(file=str(tmp_path / "both"), names=names)
        return
    external = ExternalMesh(file=str(tmp_path / "both"), names=names)
    domain, before = Domain.build(external), domain_of(tube("mixed", 1))
    for name in ("fluid", "wall"):
        assert domain.volume(name) == pytest.approx(before.volume(name), rel=1e-5)
    assert domain.area("wall_top") == pytest.approx(before.area("wall_top"), rel=1e-5)
    assert any("nodes lie where others do" in remark for remark in external.remarks)


@pytest.mark.parametrize(("mode", "kind"), [("ascii", None), ("binary", "zlib"), ("appended", "zlib"),
                                            ("appended", None), ("raw", None), ("raw", "lzma")])  # fmt: skip
def test_vtk_encodings(tmp_path: Path, mixed: Any, mode: str, kind: str | None) -> None:
    """As VTK's own writer encodes arrays; the numbers of the groups are found among other arrays."""
    import vtk

    geometry, points, rows = mixed
    raw, numbers = raw_mesh(points, rows, "ModelRegionID")
    grid = pv.from_meshio(raw)
    grid.cell_data["quality"] = np.random.default_rng(1).random(grid.n_cells)
    file, writer = tmp_path / "tube.vtu", vtk.vtkXMLUnstructuredGridWriter()
    writer.SetFileName(str(file))
    writer.SetInputData(grid)
    {"ascii": writer.SetDataModeToAscii, "binary": writer.SetDataModeToBinary}.get(mode, writer.SetDataModeToAppended)()
    writer.SetEncodeAppendedData(mode == "appended")
    writer.SetCompressorType({None: 0, "zlib": 1, "lzma": 3}[kind])
    writer.Write()
    external = ExternalMesh(file=str(file), names={str(k): name for name, k in numbers.items()})
    assert_same(Domain.build(external), geometry, rel=1e-5 if mode == "ascii" else 1e-10)


def test_fenics(tmp_path: Path) -> None:
    """Cells and faces in two XDMF files with their numbers in HDF5, topologies in lower case, as DOLFIN writes them."""
    geometry = tube("tetrahedron", 1)
    points, rows = cells_of(geometry)
    numbers = numbers_of(rows)
    for title, kind in (("mesh", "tetra"), ("facets", "triangle")):
        chosen = {name: cells for (name, k), cells in rows.items() if k == kind}
        cells = np.array([c for part in chosen.values() for c in part])
        with h5py.File(tmp_path / f"{title}.h5", "w") as store:
            store["Mesh/topology"], store["Mesh/geometry"] = cells, points
            store["f"] = np.concatenate([np.full(len(part), numbers[n]) for n, part in chosen.items()])
        topology = {"tetra": "tetrahedron", "triangle": "triangle"}[kind]
        (tmp_path / f"{title}.xdmf").write_text(
            f"""<Xdmf Version="3.0"><Domain><Grid Name="mesh" GridType="Uniform">
            <Topology NumberOfElements="{len(cells)}" TopologyType="{topology}" NodesPerElement="{cells.shape[1]}">
            <DataItem Dimensions="{len(cells)} {cells.shape[1]}" NumberType="UInt" Format="HDF">
            {title}.h5:/Mesh/topology</DataItem></Topology>
            <Geometry GeometryType="XYZ"><DataItem Dimensions="{len(points)} 3" Format="HDF">
            {title}.h5:/Mesh/geometry</DataItem></Geometry>
            <Attribute Name="f" AttributeType="Scalar" Center="Cell"><DataItem Dimensions="{len(cells)} 1" Format="HDF">
            {title}.h5:/f</DataItem></Attribute></Grid></Domain></Xdmf>"""
        )
    names = {f"{'mesh' if dim_of(n) == 3 else 'facets'}/{k}": n for n, k in numbers.items()}
    assert_same(Domain.build(ExternalMesh(file=str(tmp_path), names=names)), geometry)


@pytest.mark.parametrize("suffix", [".vol", ".vol.gz"])
def test_netgen(tmp_path: Path, mixed: Any, suffix: str) -> None:
    """A mesh of ngfsi as Netgen keeps it, in metres."""
    geometry, _, _ = mixed
    file = tmp_path / f"tube{suffix}"
    domain_of(geometry).mesh.ngmesh.Save(str(file))
    assert_same(Domain.build(ExternalMesh(file=str(file), unit="m")), geometry)


def test_pyramids(tmp_path: Path) -> None:
    """A cube of six pyramids, each a sixth of it; of second order under z -> z (1 + 4 a x (1 - x))."""
    a, middle = 0.1, 8
    corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1.0), (0.5,) * 3]
    faces = [[0, 1, 2, 3], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]
    rows: Rows = {("wall", "pyramid"): [[*face, middle] for face in faces], ("skin", "quad"): faces}
    straight = Domain.build(external_of(tmp_path / "cube.vtu", np.array(corners), rows))
    assert straight.volume("wall") == pytest.approx(1e-9, rel=1e-10)
    edges: dict[tuple[int, int], int] = {}
    points = list(corners)
    for cell in rows["wall", "pyramid"]:
        for i, j in ((0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 4), (2, 4), (3, 4)):
            ends = tuple(sorted((cell[i], cell[j])))
            if ends not in edges:
                edges[ends] = len(points)
                points.append(tuple(np.mean([corners[k] for k in ends], axis=0)))
    second = [[*c, *(edges[tuple(sorted((c[i], c[j])))] for i, j in (
        (0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 4), (2, 4), (3, 4)))] for c in rows["wall", "pyramid"]]  # fmt: skip
    bent = np.array(points)
    bent[:, 2] *= 1 + 4 * a * bent[:, 0] * (1 - bent[:, 0])
    curved = external_of(tmp_path / "bent.vtu", bent, {("wall", "pyramid13"): second, ("skin", "quad"): faces})
    # the middle node of the cube is a corner, and moves too
    assert Domain.build(curved).volume("wall") == pytest.approx((1 + 2 * a / 3) * 1e-9, rel=1e-10)


def test_ends_of_the_wall_that_stick_out(tmp_path: Path, mixed: Any) -> None:
    """Layers around a lumen that end off its plane, in the group of the opening or in none, are ends of the wall."""
    geometry, points, rows = mixed
    out = points.copy()
    beyond = np.hypot(points[:, 0], points[:, 1]) > 1.02 * MM * geometry.lumen_radius
    out[beyond & (points[:, 2] == 0), 2] = -0.014 * MM * geometry.length
    joined = {key: list(cells) for key, cells in without(rows, *ENDS).items()}
    joined["inlet", "quad"] += rows["wall_bottom", "quad"]
    external = external_of(tmp_path / "tube.vtu", out, joined)
    domain = Domain.build(external)
    assert domain.area("inlet") == pytest.approx(domain_of(geometry).area("inlet"), rel=1e-10)
    assert domain.area("wall_bottom") == pytest.approx(domain_of(geometry).area("wall_bottom"), rel=1e-2)
    count = len(rows["wall_bottom", "quad"])
    assert f"wall_bottom: {count} faces of wall in the group of inlet" in external.remarks
    assert f"wall_top: {count} faces of wall in no group" in external.remarks


def test_wrong_meshes_are_refused_with_the_place(tmp_path: Path) -> None:
    points, rows = cells_of(tube("tetrahedron", 1))
    lumen = without(rows, "tissue", "wall", "skin", "wall_outer", *ENDS)
    file = tmp_path / "wrong.vtu"

    def refused(match: str, changed: Rows, place: np.ndarray = points) -> None:
        with pytest.raises(GeometryError, match=match):
            external_of(file, place, changed)

    cells = lumen["fluid", "tetra"]
    refused(r"faces are of three cells or more, the first near \(", {**lumen, ("fluid", "tetra"): [*cells, *cells]})
    flat = points.copy()
    flat[cells[0][3]] = points[cells[0][:3]].mean(axis=0)
    refused(r"cells of fluid have no volume, the first near \(|folded near", lumen, flat)
    inner = set(np.ravel(cells)) - {n for key, part in lumen.items() if key[0] != "fluid" for n in np.ravel(part)}
    folded = points.copy()
    folded[sorted(inner)[0]] += [50.0, 0.0, 0.0]
    refused(r"the mesh is folded near \(.*two cells lie on the same side", lumen, folded)
    inlet, outlet = (lumen[name, "triangle"] for name in ("inlet", "outlet"))
    two = {**lumen, ("outlet", "triangle"): [*outlet, inlet[0]]}
    refused(r"a face near \(.* is in inlet and in outlet: give it one name", two)
    none = {**lumen, ("inlet", "triangle"): [*inlet, [0, 1, 2]]}
    refused(r"1 faces of 'inlet' are no faces of cells, the first near \(", none)


def test_smooth_surfaces(tmp_path: Path) -> None:
    """Curved again from straight faces, a tube of a dozen edges around has the volumes of the round one."""
    mesh = tube("tetrahedron", 1).mesh.replace(vein_size=2.5e-3, far_size=5e-3)
    geometry = TubeSegment(length=10e-3, wall_thickness=2e-3, outer_radius=14e-3, mesh=mesh)
    points, rows = cells_of(geometry)
    straight = external_of(tmp_path / "tube.vtu", points, rows)
    curved = straight.replace(smooth=("interface", "wall_outer", "skin"))
    exact = {"fluid": np.pi * geometry.lumen_radius**2 * geometry.length}
    low = Domain.build(straight).volume("fluid") / exact["fluid"] - 1
    domain = Domain.build(curved)
    assert low < -0.02
    assert domain.volume("fluid") == pytest.approx(exact["fluid"], rel=1e-3)
    assert domain.area("inlet") == pytest.approx(np.pi * geometry.lumen_radius**2, rel=1e-3)
    normal = ng.specialcf.normal(3)
    over = domain.ds("inlet", bonus_intorder=4)
    assert abs(ng.Integrate(normal[0] ** 2 * over, domain.mesh)) < 1e-12 * domain.area("inlet")  # flat as before
    with pytest.raises(GeometryError, match="'lumen' is not a known boundary"):
        straight.replace(smooth=("lumen",))
