"""Export: the deformed mesh and its fields at one time, in formats of other programs.

Each holds cells and faces of boundaries, with the names of regions and boundaries, and nodes that neighbours share.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import meshio
import ngsolve as ng
import numpy as np
import pyvista as pv

from ngfsi.arrays import Numbers
from ngfsi.errors import OutputError, unknown
from ngfsi.mesh.cells import FACES_IN_ABAQUS, KINDS
from ngfsi.mesh.domain import Domain
from ngfsi.store.disk import explained
from ngfsi.store.fields import BOUNDARIES, DISPLACEMENT, FACES, FOLDER, NUMBERED, REGION, REGIONS, FieldWriter
from ngfsi.store.stored import StoredRun

FORMATS = {"xdmf": ".xdmf", "vtu": ".vtu", "gmsh": ".msh", "abaqus": ".inp"}
"""Name -> suffix."""
MERGE_DISTANCE = 1e-7
"""Points [m] nearer than this are the same node: single precision on a mesh of decimetres."""
BOUNDARY = "boundary"
"""Cell field with the number of a face's boundary, -1 for cells, as `region` is -1 for faces."""

GMSH_PRISM = [0, 1, 2, 3, 4, 5, 6, 8, 12, 7, 13, 14, 9, 11, 10, 15, 17, 16]
"""Place in VTK of each node of Gmsh's 18-node prism (Gmsh manual, node ordering), which meshio leaves to the caller."""
QUADS = {frozenset((0, 1, 4, 3)): 15, frozenset((1, 2, 5, 4)): 16, frozenset((2, 0, 3, 5)): 17}
"""Corners of a face of a prism -> its middle node among the prism's 18."""
BY_CORNERS = {(3, 4): "tetra", (3, 6): "wedge", (3, 8): "hexahedron", (2, 3): "triangle", (2, 4): "quad",
              (1, 2): "line"}  # fmt: skip
"""Dimension and number of corners -> straight cell."""
ABAQUS = {"tetra": "C3D4", "wedge": "C3D6", "hexahedron": "C3D8", "triangle": "S3", "quad": "S4"}
"""Straight cell -> element of Abaqus."""
PER_LINE = 16
"""Numbers in a line of a set in Abaqus's files."""


class Named(NamedTuple):
    """A mesh with shared nodes, and the names of what its cell fields `region` and `boundary` number."""

    mesh: meshio.Mesh
    regions: list[str]
    boundaries: list[str]

    def named(self, block: int) -> tuple[str, list[str]]:
        """Return the field that numbers a block's cells, and the names."""
        faces = (self.mesh.cell_data[REGION][block] < 0).all()
        return (BOUNDARY, self.boundaries) if faces else (REGION, self.regions)


def export(run: StoredRun, time: float, fmt: str, destination: Path | None = None) -> tuple[Path, float]:
    """Write the fields stored nearest to `time` [s] and return the file and the time of those fields.

    All formats hold the deformed mesh with its regions and boundaries: as cell fields `region` and `boundary`, with the
    names of their numbers in field data (vtu: `region:wall` = 1) or information (xdmf), or, in gmsh and abaqus, as
    named sets of cells. In xdmf the boundaries are in a file of their own, `..._boundaries.xdmf`, since readers take
    one kind of cells a file. Cells are curved, but straight for abaqus, and for xdmf where they are of several kinds;
    abaqus has no fields. Neighbours share their nodes; on the border of blood and tissue the fields are those of the
    blood.

    Args:
        fmt: one of `FORMATS`.
        destination: file; default: `<time>` with the format's suffix in the run's folder `export`.

    Raises:
        OutputError: unknown format, nothing stored, or the file cannot be written.
    """
    if fmt not in FORMATS:
        raise OutputError(unknown("format", fmt, FORMATS))
    grid = run.fields(time)
    found = min(run.field_times(), key=lambda stored: abs(stored - time))
    path = destination or run.path / "export" / f"t_{found:.6g}s{FORMATS[fmt]}"
    regions = [str(name) for name in grid.field_data[REGIONS]]
    # where nodes coincide the first one's values win: begin with the blood
    named = _named(grid, sorted(range(len(regions)), key=lambda number: regions[number] not in run.lumens))
    with explained(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        write(named, path, fmt)
    return path, found


def of_domain(domain: Domain) -> Named:
    """Return the mesh of a domain in its reference shape, curved cells of second order."""
    rest = ng.CF((0.0,) * domain.mesh.dim)
    with tempfile.TemporaryDirectory(prefix="ngfsi-mesh-") as scratch:
        writer = FieldWriter(Path(scratch), domain, {DISPLACEMENT: rest}, double=True)
        writer.write(0.0)
        grid = pv.read(Path(scratch) / FOLDER / NUMBERED.format("volume", 0))
    return _named(grid, range(len(domain.regions)))


def write(named: Named, path: Path, fmt: str) -> None:
    """Write a mesh in one of `FORMATS`.

    Raises:
        OSError: the file cannot be written.
    """
    if fmt == "gmsh":
        # version 2.2 keeps names and is read by every program
        meshio.write(path, _with_groups(named), file_format="gmsh22")
    elif fmt == "abaqus":
        path.write_text("\n".join(_abaqus(named._replace(mesh=straight(named.mesh)))) + "\n", encoding="utf-8")
    elif fmt == "vtu":
        grid = pv.from_meshio(named.mesh)
        for field, names in ((REGION, named.regions), (BOUNDARY, named.boundaries)):
            for number, name in enumerate(names):  # as numbers, since few programs read texts
                grid.field_data[f"{field}:{name}"] = np.array([number], dtype=np.int32)
        with path.open("wb"):  # VTK does not say why it cannot
            grid.save(path)
    else:
        largest = max(block.dim for block in named.mesh.cells)
        for dim, place in ((largest, path), (largest - 1, path.with_stem(f"{path.stem}_boundaries"))):
            part = _part(named.mesh, dim)
            if part.cells:
                meshio.write(place, straight(part) if len(part.cells) > 1 else part, file_format="xdmf")
                _inform(place, dim, named.regions if dim == largest else named.boundaries)


def _part(mesh: meshio.Mesh, dim: int) -> meshio.Mesh:
    """Return the cells of a dimension, with their nodes alone."""
    chosen = [k for k, block in enumerate(mesh.cells) if block.dim == dim]
    used = np.unique(np.concatenate([np.zeros(0, int), *(mesh.cells[k].data.ravel() for k in chosen)]))
    return meshio.Mesh(
        points=mesh.points[used],
        cells=[(mesh.cells[k].type, np.searchsorted(used, mesh.cells[k].data)) for k in chosen],
        point_data={name: values[used] for name, values in mesh.point_data.items()},
        cell_data={name: [parts[k] for k in chosen] for name, parts in mesh.cell_data.items()},
    )


def _named(grid: pv.UnstructuredGrid, order: Sequence[int]) -> Named:
    """Return a stored grid, whose cells have nodes of their own, with shared nodes and faces of its boundaries; regions
    are taken in an order."""
    numbers = grid.cell_data[REGION]
    grid.cell_data["cell"] = np.arange(grid.n_cells, dtype=np.int32)
    parts = [grid.extract_cells(np.flatnonzero(numbers == number)) for number in order if number in numbers]
    shared = pv.merge(parts, merge_points=False).clean(tolerance=MERGE_DISTANCE, average_point_data=False)
    converted = pv.to_meshio(shared)
    cells = [(block.type, np.asarray(block.data)) for block in converted.cells]
    region = [np.asarray(block, dtype=np.int32) for block in converted.cell_data[REGION]]
    boundary = [np.full(len(block), -1, dtype=np.int32) for block in region]
    rows = np.asarray(grid.field_data[FACES]).reshape(-1, 6) if FACES in grid.field_data else np.zeros((0, 6), int)
    for kind, nodes, tags in _faces(rows, cells, converted.cell_data["cell"]):
        cells.append((kind, nodes))
        region.append(np.full(len(nodes), -1, dtype=np.int32))
        boundary.append(tags)
    mesh = meshio.Mesh(
        points=np.asarray(converted.points, dtype=float),
        cells=cells,
        point_data={name: np.asarray(converted.point_data[name], dtype=float) for name in grid.point_data},
        cell_data={REGION: region, BOUNDARY: boundary},
    )
    names = [str(name) for name in grid.field_data[BOUNDARIES]] if len(rows) else []
    return Named(mesh, [str(name) for name in grid.field_data[REGIONS]], names)


def _faces(rows: Numbers, cells: Sequence[tuple[str, Any]], numbers: Sequence[Any]) -> list[tuple[str, Any, Any]]:
    """Return kind, nodes and numbers of names of faces of boundaries, curved as the cells that they are of.

    Args:
        rows: see `BoundaryFaces`.
        cells: kinds and nodes.
        numbers: of the cells in `rows`, a block each.
    """
    place = {int(n): (block, row) for block, part in enumerate(numbers) for row, n in enumerate(part)}
    found: dict[str, tuple[list[list[int]], list[int]]] = {}
    for name, cell, *corners in rows.tolist():
        block, row = place[cell]
        kind, nodes = cells[block][0], cells[block][1][row]
        local = [corner for corner in corners if corner >= 0]
        ring = [*local, local[0]]
        middles = {frozenset(edge): KINDS[kind].corners + k for k, edge in enumerate(KINDS[kind].edges)}
        between = list(pairwise(ring)) if len(local) > 2 else [tuple(local)]
        local += [middles[frozenset(edge)] for edge in between]
        if kind == "wedge18" and len(ring) == 5:
            local.append(QUADS[frozenset(ring)])
        title = {3: "line3", 6: "triangle6", 8: "quad8", 9: "quad9"}[len(local)]
        faces, tags = found.setdefault(title, ([], []))
        faces.append([int(nodes[k]) for k in local])
        tags.append(name)
    return [(title, np.array(faces), np.array(tags, dtype=np.int32)) for title, (faces, tags) in found.items()]


def straight(mesh: meshio.Mesh) -> meshio.Mesh:
    """Return the mesh with straight cells between the corners alone."""
    kinds = [KINDS[block.type] for block in mesh.cells]
    corners = [block.data[:, : kind.corners] for block, kind in zip(mesh.cells, kinds, strict=True)]
    used = np.unique(np.concatenate([block.ravel() for block in corners]))
    return meshio.Mesh(
        points=mesh.points[used],
        cells=[
            (BY_CORNERS[kind.dim, kind.corners], np.searchsorted(used, block))
            for kind, block in zip(kinds, corners, strict=True)
        ],
        point_data={name: values[used] for name, values in mesh.point_data.items()},
        cell_data=mesh.cell_data,
    )


def _with_groups(named: Named) -> meshio.Mesh:
    """Return the mesh with regions and boundaries as physical groups, and with the nodes of curved prisms in the order
    of Gmsh."""
    mesh = named.mesh
    dimensions = [block.dim for block in mesh.cells]
    first = {max(dimensions): 1, max(dimensions) - 1: 1 + len(named.regions)}
    tags: list[Any] = []
    titles: dict[str, Any] = {}
    for k, block in enumerate(mesh.cells):
        field, names = named.named(k)
        tags.append(mesh.cell_data[field][k] + first[block.dim])
        titles |= {name: np.array([i + first[block.dim], block.dim]) for i, name in enumerate(names)}
    return meshio.Mesh(
        points=mesh.points,
        cells=[(b.type, b.data[:, GMSH_PRISM] if b.type == "wedge18" else b.data) for b in mesh.cells],
        point_data=mesh.point_data,
        cell_data={tag: tags for tag in ("gmsh:physical", "gmsh:geometrical")},
        field_data=titles,
    )


def _abaqus(named: Named) -> Iterator[str]:
    """Yield the lines of Abaqus's input: regions as sets of elements, boundaries as surfaces of element faces; of plane
    meshes the regions alone."""
    mesh = named.mesh
    yield from ("*Heading", "ngfsi", "*Node")
    yield from (f"{k}, {x!r}, {y!r}, {z!r}" for k, (x, y, z) in enumerate(mesh.points.tolist(), start=1))
    owners: dict[frozenset[int], tuple[int, int]] = {}
    sets: dict[str, list[int]] = {}
    surfaces: dict[str, list[frozenset[int]]] = {}
    number = 0
    for k, block in enumerate(mesh.cells):
        field, names = named.named(k)
        tags = mesh.cell_data[field][k].tolist()
        if field == BOUNDARY:
            for tag, nodes in zip(tags, block.data.tolist(), strict=True):
                surfaces.setdefault(names[tag], []).append(frozenset(nodes))
            continue
        yield f"*Element, type={ABAQUS[block.type]}"
        for tag, nodes in zip(tags, block.data.tolist(), strict=True):
            number += 1
            yield ", ".join(map(str, (number, *(node + 1 for node in nodes))))
            sets.setdefault(names[tag], []).append(number)
            for side, face in enumerate(FACES_IN_ABAQUS.get(len(nodes), ()) if block.dim == 3 else (), start=1):
                owners.setdefault(frozenset(nodes[corner] for corner in face), (number, side))
    for name, members in sets.items():
        yield f"*Elset, elset={name}"
        yield from (", ".join(map(str, members[k : k + PER_LINE])) for k in range(0, len(members), PER_LINE))
    for name, faces in surfaces.items() if owners else ():
        yield f"*Surface, type=ELEMENT, name={name}"
        yield from (f"{owners[face][0]}, S{owners[face][1]}" for face in faces)


def _inform(path: Path, dim: int, names: Sequence[str]) -> None:
    """Write the names of numbers into an XDMF file as meshio reads them: there they are information of the grid."""
    root: Any = ElementTree.Element("main")
    for number, name in enumerate(names):
        ElementTree.SubElement(root, "map", key=name, dim=str(dim)).text = str(number)
    tree = ElementTree.parse(path)
    for grid in tree.iter("Grid"):
        ElementTree.SubElement(grid, "Information", Name="field_data").text = ElementTree.tostring(root, "unicode")
    tree.write(path, encoding="utf-8", xml_declaration=True)
