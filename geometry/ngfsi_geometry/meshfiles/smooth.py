"""Curved surfaces recovered from straight faces.

An edge of a surface bulges as a curve through its ends that is perpendicular there to the mean normals of the faces
around them, as in A. Vlachos et al., Curved PN triangles, 2001, but with the height of a circle's arc between such
normals. The mesh inside follows by Laplace's equation, so that thin layers at the surface stay whole.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ngfsi.errors import GeometryError, unknown
from ngfsi.mesh.curving import EDGE_FACTOR, EdgeBulges
from ngfsi_geometry.meshfiles.raw import Array, Indices
from ngfsi_geometry.meshfiles.sorting import Contents

SHARP = 0.5
"""Cosine of the angle between the normals of faces, beyond which (60 degrees) their edge stays sharp."""
FLAT_END = 1e-3
"""Sine of the angle between the faces of a boundary and its mean plane, within which the boundary is flat."""


def recovered(contents: Contents, names: Sequence[str], straight: Any) -> Contents:
    """Return the contents with curved edges.

    Args:
        names: boundaries that are smooth; each is taken by itself.
        straight: Netgen mesh of the contents.

    Raises:
        GeometryError: the cells are curved already, or a boundary is not there.
    """
    known = {name for name, *_ in contents.faces}
    if wrong := next((name for name in names if name not in known), None):
        raise GeometryError(f"`smooth` has {unknown('boundary', wrong, known)}")
    if len(contents.curved.edges):
        raise GeometryError("`smooth` is for straight cells: those of this file are curved already")
    bulges: dict[tuple[int, int], Array] = {}
    for name in names:
        edges, away = _bulges(contents.points, [part for title, _, _, part in contents.faces if title == name])
        for edge, bulge in zip(map(tuple, edges.tolist()), away, strict=True):
            bulges.setdefault(edge, bulge)
    flat = _flat(contents, names)
    edges, away = np.array(list(bulges)), np.array(list(bulges.values()))
    for on, normal in flat:
        here = on[edges].all(axis=1)
        away[here] -= np.outer(away[here] @ normal, normal)
    followed = _followed(straight, EdgeBulges(edges, away))
    for on, normal in flat:
        here = on[followed.edges].all(axis=1)
        followed.bulges[here] -= np.outer(followed.bulges[here] @ normal, normal)
    return replace(contents, curved=followed)


def _triangles(parts: Sequence[Indices]) -> Indices:
    """Return faces (m, 3 or 4) as corners with their two neighbours, (n, 3): three of a triangle, four of a quad."""
    found = []
    for part in parts:
        count = part.shape[1]
        for k in range(count):
            found.append(part[:, [k, (k + 1) % count, (k - 1) % count]])
    return np.vstack(found)


def _bulges(points: Array, parts: Sequence[Indices]) -> tuple[Indices, Array]:
    """Return the edges of a surface (n, 2), smaller number first, and their bulges [m]."""
    corner = _triangles(parts)
    ahead, back = (points[corner[:, k]] - points[corner[:, 0]] for k in (1, 2))
    cross = np.cross(ahead, back)
    size = np.linalg.norm(cross, axis=1)
    lengths = np.linalg.norm(ahead, axis=1) * np.linalg.norm(back, axis=1)
    normal = cross / size[:, None]
    # weights that give a sphere's normals exactly: N. Max, Weights for computing vertex normals, 1999
    weight = size / lengths**2
    edges, which = np.unique(np.sort(corner[:, :2], axis=1), axis=0, return_inverse=True)
    which = which.ravel()
    middle = np.zeros((len(edges), 3))
    np.add.at(middle, which, normal)
    middle /= np.linalg.norm(middle, axis=1)[:, None]
    order = np.argsort(corner[:, 0], kind="stable")
    first = np.searchsorted(corner[order, 0], np.arange(len(points) + 1))
    bulges, both = np.zeros((len(edges), 3)), np.zeros((len(edges), 3))
    along = points[edges[:, 1]] - points[edges[:, 0]]
    for end, sign in ((0, 1.0), (1, -1.0)):
        count = np.diff(first)[edges[:, end]]
        owner = np.repeat(np.arange(len(edges)), count)
        member = order[np.repeat(first[edges[:, end]], count) + np.arange(count.sum()) - np.repeat(
            np.cumsum(count) - count, count)]  # fmt: skip
        smooth = np.einsum("ij,ij->i", normal[member], middle[owner]) > SHARP
        mean = np.zeros((len(edges), 3))
        np.add.at(mean, owner, np.where(smooth, weight[member], 0.0)[:, None] * normal[member])
        mean /= np.maximum(np.linalg.norm(mean, axis=1), np.finfo(float).tiny)[:, None]
        bulges -= (sign * np.einsum("ij,ij->i", along, mean))[:, None] * mean
        both += mean
    cosine = np.linalg.norm(both, axis=1) / 2
    # normals a and b of an arc of half the angle t: its height is the chord's times tan(t/2) / 2
    bulges /= (4 * np.maximum(cosine, SHARP) * (1 + cosine))[:, None]
    sides = np.einsum("ij,ij->i", normal, middle[which])
    sharp = np.zeros(len(edges), dtype=bool)
    np.logical_or.at(sharp, which, sides < np.sqrt((1 + SHARP) / 2))
    bulges[sharp] = 0.0
    return edges, bulges


def _flat(contents: Contents, names: Sequence[str]) -> list[tuple[Any, Array]]:
    """Return nodes (a mask) and normal of each flat boundary other than those named."""
    found = []
    for name in dict.fromkeys(title for title, *_ in contents.faces if title not in names):
        parts = [part for title, _, _, part in contents.faces if title == name]
        corner = _triangles(parts)
        start, ahead, back = (contents.points[corner[:, k]] for k in range(3))
        cross = np.cross(ahead - start, back - start)
        mean = cross.sum(axis=0) / np.linalg.norm(cross, axis=1).sum()
        if 1 - np.linalg.norm(mean) < FLAT_END:
            on = np.zeros(len(contents.points), dtype=bool)
            on[corner.ravel()] = True
            found.append((on, mean / np.linalg.norm(mean)))
    return found


def _followed(straight: Any, given: EdgeBulges) -> EdgeBulges:
    """Return bulges of all edges: those of the surface, and inside what solves Laplace's equation on the edges."""
    import ngsolve as ng

    mesh = ng.Mesh(straight)
    space = ng.H1(mesh, order=2)
    edges = np.array([sorted(vertex.nr for vertex in edge.vertices) for edge in mesh.edges])
    dofs = np.array([space.GetDofNrs(ng.NodeId(ng.EDGE, edge.nr))[0] for edge in mesh.edges])
    numbers = {edge: k for k, edge in enumerate(map(tuple, edges.tolist()))}
    on_surface = np.array([numbers[a, b] for a, b in given.edges.tolist()])
    free = ng.BitArray(space.ndof)
    free[:] = False
    for dof in dofs[np.setdiff1d(np.arange(len(edges)), on_surface)]:
        free[int(dof)] = True
    trial, test = space.TnT()
    matrix = ng.BilinearForm(ng.Grad(trial) * ng.Grad(test) * ng.dx, symmetric=True).Assemble().mat
    inverse = matrix.Inverse(free, inverse="sparsecholesky")
    bulges = np.zeros((len(edges), 3))
    for axis in range(3):
        values = ng.GridFunction(space)
        for k, bulge in zip(on_surface, given.bulges[:, axis], strict=True):
            values.vec[int(dofs[k])] = EDGE_FACTOR * float(bulge)
        values.vec.data -= inverse @ matrix * values.vec
        bulges[:, axis] = np.asarray(values.vec)[dofs] / EDGE_FACTOR
    return EdgeBulges(edges, bulges)
