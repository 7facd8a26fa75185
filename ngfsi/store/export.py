"""Export: the deformed mesh and its fields at one time, in formats of other programs, through meshio."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import meshio
import numpy as np
import pyvista as pv

from ngfsi.errors import OutputError, unknown
from ngfsi.store.disk import explained
from ngfsi.store.fields import REGION
from ngfsi.store.stored import StoredRun

FORMATS = {"xdmf": (".xdmf", "xdmf"), "vtu": (".vtu", "vtu"), "gmsh": (".msh", "gmsh22"), "abaqus": (".inp", "abaqus")}
"""Name -> suffix, and meshio's name: of Gmsh's formats the one that keeps region names and that every program reads."""
MERGE_DISTANCE = 1e-7
"""Points [m] nearer than this are the same node: single precision on a mesh of decimetres."""

GMSH_PRISM = [0, 1, 2, 3, 4, 5, 6, 8, 12, 7, 13, 14, 9, 11, 10, 15, 17, 16]
"""Place in VTK of each node of Gmsh's 18-node prism (Gmsh manual, node ordering), which meshio leaves to the caller."""
STRAIGHT = {"wedge18": ("wedge", 6), "tetra10": ("tetra", 4), "hexahedron20": ("hexahedron", 8),
            "triangle6": ("triangle", 3), "quad9": ("quad", 4)}  # fmt: skip
"""Curved cell -> the straight one and how many of the nodes it keeps."""


def export(run: StoredRun, time: float, fmt: str, destination: Path | None = None) -> tuple[Path, float]:
    """Write the fields stored nearest to `time` [s] and return the file and the time of those fields.

    All formats hold the deformed mesh with its regions: as cell field `region` or, in gmsh and abaqus, as named sets of
    cells. Cells are curved, but straight for abaqus, and for xdmf where they are of several kinds; abaqus has no
    fields. Neighbours share their nodes; on the border of blood and tissue the fields are those of the blood.

    Args:
        fmt: one of `FORMATS`.
        destination: file; default: `<time>` with the format's suffix in the run's folder `export`.

    Raises:
        OutputError: unknown format, nothing stored, or the file cannot be written.
    """
    if fmt not in FORMATS:
        raise OutputError(unknown("format", fmt, FORMATS))
    suffix, name = FORMATS[fmt]
    grid = run.fields(time)
    found = min(run.field_times(), key=lambda stored: abs(stored - time))
    path = destination or run.path / "export" / f"t_{found:.6g}s{suffix}"
    regions = [str(name) for name in grid.field_data["regions"]]
    # where nodes coincide the first one's values win: begin with the blood
    mesh = _mesh(grid, sorted(range(len(regions)), key=lambda number: regions[number] not in run.lumens))
    if fmt == "abaqus" or (fmt == "xdmf" and len(mesh.cells) > 1):
        mesh = _straight(mesh)
    if fmt in ("gmsh", "abaqus"):
        mesh = _with_sets(mesh, regions)
    with explained(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        meshio.write(path, mesh, file_format=name)
    return path, found


def _mesh(grid: pv.UnstructuredGrid, order: Sequence[int]) -> meshio.Mesh:
    """Return a stored grid, whose cells have nodes of their own, with shared nodes; regions are taken in an order."""
    numbers = grid.cell_data[REGION]
    parts = [grid.extract_cells(np.flatnonzero(numbers == number)) for number in order if number in numbers]
    shared = pv.merge(parts, merge_points=False).clean(tolerance=MERGE_DISTANCE, average_point_data=False)
    converted = pv.to_meshio(shared)
    return meshio.Mesh(
        points=np.asarray(converted.points, dtype=float),
        cells=converted.cells,
        point_data={name: np.asarray(converted.point_data[name], dtype=float) for name in grid.point_data},
        cell_data={REGION: [np.asarray(block, dtype=np.int32) for block in converted.cell_data[REGION]]},
    )


def _straight(mesh: meshio.Mesh) -> meshio.Mesh:
    """Return the mesh with straight cells between the corners alone."""
    kinds = [STRAIGHT[block.type] for block in mesh.cells]
    corners = [block.data[:, :nodes] for block, (_, nodes) in zip(mesh.cells, kinds, strict=True)]
    used = np.unique(np.concatenate([block.ravel() for block in corners]))
    return meshio.Mesh(
        points=mesh.points[used],
        cells=[(name, np.searchsorted(used, block)) for (name, _), block in zip(kinds, corners, strict=True)],
        point_data={name: values[used] for name, values in mesh.point_data.items()},
        cell_data=mesh.cell_data,
    )


def _with_sets(mesh: meshio.Mesh, regions: list[str]) -> meshio.Mesh:
    """Return the mesh with the regions as named sets, and with the nodes of curved prisms in the order of Gmsh."""
    numbers = mesh.cell_data[REGION]
    dimension = 2 if mesh.cells[0].type.startswith(("triangle", "quad")) else 3
    return meshio.Mesh(
        points=mesh.points,
        cells=[(b.type, b.data[:, GMSH_PRISM] if b.type == "wedge18" else b.data) for b in mesh.cells],
        point_data=mesh.point_data,
        cell_data={tag: [block + 1 for block in numbers] for tag in ("gmsh:physical", "gmsh:geometrical")},
        field_data={name: np.array([i + 1, dimension]) for i, name in enumerate(regions)},
        cell_sets={name: [np.flatnonzero(block == i) for block in numbers] for i, name in enumerate(regions)},
    )
