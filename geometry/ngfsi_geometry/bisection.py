"""Tetrahedra of a mesh from a file, some of them bisected, as a file of the same shape.

The shape is a quadratic displacement of straight tetrahedra. A part of one is straight there, too, and the displacement
on it quadratic: with the nodes of its corners and edges where the displacement has them, the shape is the same.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import meshio
import numpy as np
from numpy.typing import NDArray

from ngfsi.errors import MeshError
from ngfsi.mesh.cells import TETRA, TRIANGLE, Kind
from ngfsi.mesh.generate import quiet
from ngfsi_geometry.meshfiles.raw import Array, Indices
from ngfsi_geometry.meshfiles.sorting import Contents

OWN_NODES = {False: {3: "triangle", 4: "tetra"}, True: {3: "triangle6", 4: "tetra10"}}
"""Whether cells are curved -> number of corners -> kind."""


def bisected(contents: Contents, build: Callable[[], Any], marked: NDArray[np.bool_], file: Path) -> None:
    """Write the mesh (Gmsh 2.2, metres) in which marked tetrahedra are cut in two, and as many others as keep their
    edges common. Cut into eight, as is NGSolve's default, they take more unknowns for the same error.

    Args:
        build: returns the straight Netgen mesh of the contents.

    Raises:
        MeshError: nodes of the refined mesh are not found in the one it was made from.
    """
    import ngsolve as ng

    coarse, straight = ng.Mesh(build()), ng.Mesh(build())
    curved = len(contents.curved.edges) > 0
    for element in straight.Elements(ng.VOL):
        straight.SetRefinementFlag(ng.ElementId(element), bool(marked[element.nr]))
    for face in straight.Elements(ng.BND):
        straight.SetRefinementFlag(ng.ElementId(face), False)
    with quiet():
        straight.Refine(onlyonce=True)
    nodes = np.array([vertex.point for vertex in straight.vertices])
    rows: dict[tuple[int, str], list[list[int]]] = {}
    for dim, elements in ((3, straight.Elements(ng.VOL)), (2, straight.Elements(ng.BND))):
        for element in elements:
            rows.setdefault((dim, element.mat), []).append([vertex.nr for vertex in element.vertices])
    cells = {key: np.array(part, dtype=np.int64) for key, part in rows.items()}
    if curved:
        edges: dict[tuple[int, int], int] = {}
        for (dim, name), corners in cells.items():
            cells[dim, name] = np.hstack(
                [corners, _middles(corners, TETRA if dim == 3 else TRIANGLE, edges, len(nodes))]
            )
        nodes = np.vstack([nodes, nodes[np.array(list(edges))].mean(axis=1)])
        nodes = nodes + _at(coarse, contents.curved.on(ng.VectorH1(coarse, order=2)), nodes)
    _write(file, nodes, cells, curved)


def _middles(corners: Indices, kind: Kind, known: dict[tuple[int, int], int], first: int) -> Indices:
    """Return the numbers of the middle nodes (m, edges) of cells; new ones, from `first` on, become known."""
    pairs = np.sort(corners[:, np.array(kind.edges)], axis=2)
    return np.array([[known.setdefault((a, b), first + len(known)) for a, b in cell] for cell in pairs.tolist()])


def _at(mesh: Any, shape: Any, points: Array) -> Array:
    """Return the values (n, 3) of a displacement at points of its straight mesh."""
    import netgen.meshing as nm

    try:
        return np.asarray(shape(mesh(*points.T)))
    except nm.NgException as error:
        raise MeshError(f"nodes of the refined mesh are not found in the one it was made from: {error}") from None


def _write(file: Path, nodes: Array, cells: dict[tuple[int, str], Indices], curved: bool) -> None:
    """Write cells, by dimension and name of their group."""
    numbers = {key: number for number, key in enumerate(cells, start=1)}
    tags = [np.full(len(part), numbers[key], dtype=np.int32) for key, part in cells.items()]
    kinds = OWN_NODES[curved]
    mesh = meshio.Mesh(
        nodes,
        [(kinds[dim + 1], part) for (dim, _), part in cells.items()],
        cell_data={name: tags for name in ("gmsh:physical", "gmsh:geometrical")},
        field_data={name: np.array([numbers[dim, name], dim]) for dim, name in cells},
    )
    meshio.write(file, mesh, file_format="gmsh22", binary=True)
