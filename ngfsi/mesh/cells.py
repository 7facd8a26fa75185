"""Kinds of cells of meshes in files, with corners in VTK's order."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Kind:
    """A kind of cell in VTK's order: dimension, number of corners, edges, faces, and corners of the base."""

    dim: int
    corners: int
    edges: tuple[tuple[int, int], ...]
    faces: tuple[tuple[int, ...], ...] = ()
    base: int = 0


POINT = Kind(0, 1, ())
LINE = Kind(1, 2, ((0, 1),))
TRIANGLE = Kind(2, 3, ((0, 1), (1, 2), (2, 0)))
QUAD = Kind(2, 4, ((0, 1), (1, 2), (2, 3), (3, 0)))
TETRA = Kind(3, 4, ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)), ((0, 1, 2), (0, 1, 3), (1, 2, 3), (0, 2, 3)), 3)
PYRAMID = Kind(3, 5, ((0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 4), (2, 4), (3, 4)),
               ((0, 1, 2, 3), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)), 4)  # fmt: skip
WEDGE = Kind(3, 6, ((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)),
             ((0, 1, 2), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)), 3)  # fmt: skip
HEXAHEDRON = Kind(3, 8, ((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4),
                         (0, 4), (1, 5), (2, 6), (3, 7)),
                  ((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)), 4)  # fmt: skip
KINDS: dict[str, Kind] = {
    "vertex": POINT, "line": LINE, "line3": LINE,
    "triangle": TRIANGLE, "triangle6": TRIANGLE, "triangle7": TRIANGLE,
    "quad": QUAD, "quad8": QUAD, "quad9": QUAD,
    "tetra": TETRA, "tetra10": TETRA, "pyramid": PYRAMID, "pyramid13": PYRAMID, "pyramid14": PYRAMID,
    "wedge": WEDGE, "wedge15": WEDGE, "wedge18": WEDGE,
    "hexahedron": HEXAHEDRON, "hexahedron20": HEXAHEDRON, "hexahedron27": HEXAHEDRON,
}  # fmt: skip
"""Name, as of meshio, -> kind; a number at the end counts the nodes, middle ones included."""
NODES = {name: int("".join(c for c in name if c.isdigit()) or kind.corners) for name, kind in KINDS.items()}
"""Name -> number of nodes of a cell."""
SURFACES = {3: "triangle", 4: "quad", 6: "triangle6", 7: "triangle7", 8: "quad8", 9: "quad9"}
SOLIDS = {NODES[name]: name for name, kind in KINDS.items() if kind.dim == 3}
"""Number of nodes -> name of a surface's, and of a solid's, cell."""
FACES_IN_ABAQUS = {
    4: ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0)),
    5: ((0, 1, 2, 3), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)),
    6: ((0, 1, 2), (3, 5, 4), (0, 3, 4, 1), (1, 4, 5, 2), (2, 5, 3, 0)),
    8: ((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)),
}
"""Number of corners of a solid element -> corners of its faces S1, S2 ... of Abaqus."""
