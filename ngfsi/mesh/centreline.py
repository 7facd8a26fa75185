"""The line through the middle of a vessel: along it stations are counted, across it sections are cut.

Where a geometry gives none it is found from the mesh: the way from one opening to another along edges of the lumen that
is cheapest where it keeps away from the wall (as of the vascular modelling toolkit VMTK, Antiga et al., Med Biol Eng
Comput 46, 2008), smoothed by splines.

SciPy is loaded when there is a line to be made, which a refused case need not wait for.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import ngsolve as ng
import numpy as np
from numpy.typing import NDArray

from ngfsi.mesh.domain import Domain
from ngfsi.mesh.geometry import Vessel

Array = NDArray[np.float64]

SAMPLES = 801
"""Points among which the nearest one of a curve is looked for."""
PIECES = 8
"""Of the splines that smooth a way along edges."""


class Centreline:
    """A curve through points.

    Attributes:
        points: (n, 3) m, two or more; of two it is straight, of more a cubic spline over the length of their polygon.
        length: m.
    """

    def __init__(self, points: Sequence[Sequence[float]] | Array) -> None:
        self.points = np.asarray(points, dtype=float)
        knots = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(self.points, axis=0), axis=1))]
        self._knots, self.length = knots, float(knots[-1])

    @property
    def straight(self) -> bool:
        """Whether it is a straight line."""
        return len(self.points) == 2

    @cached_property
    def _spline(self) -> Any:
        from scipy.interpolate import make_interp_spline

        return make_interp_spline(self._knots, self.points, k=min(3, len(self.points) - 1))

    def at(self, s: Array) -> Array:
        """Return the points (n, 3) [m] at positions s (n,) [m] from the start."""
        if self.straight:
            return np.asarray(self.points[0] + np.asarray(s)[:, None] * self.tangents(s))
        return np.asarray(self._spline(s))

    def tangents(self, s: Array) -> Array:
        """Return the unit tangents (n, 3) at positions s (n,) [m]."""
        if self.straight:
            return np.broadcast_to((self.points[1] - self.points[0]) / self.length, (len(s), 3))
        slopes = self._spline(s, 1)
        return np.asarray(slopes / np.linalg.norm(slopes, axis=1)[:, None])

    def position(self, points: Array) -> Array:
        """Return the positions (n,) [m] of the places on the line that are nearest to points (n, 3) [m]."""
        if self.straight:
            return np.asarray((points - self.points[0]) @ self.tangents(np.zeros(1))[0])
        from scipy.spatial import cKDTree

        s = np.linspace(0, self.length, SAMPLES)
        near = s[cKDTree(self.at(s)).query(points)[1]]
        return np.asarray(near + np.einsum("ij,ij->i", points - self.at(near), self.tangents(near)))

    def direction(self, domain: Domain) -> Any:
        """Return the tangent at the nearest place of the line as a field of the straight mesh."""
        if self.straight:
            return ng.CF(tuple(map(float, self.tangents(np.zeros(1))[0])))
        field = ng.GridFunction(ng.VectorH1(domain.mesh, order=1))
        points = np.array([vertex.point for vertex in domain.mesh.vertices])
        s = np.clip(self.position(points), 0.0, self.length)
        field.vec.FV().NumPy()[:] = self.tangents(s).T.ravel()
        return field

    def stations(self, count: int) -> Array:
        """Return evenly spaced positions from start to end (m)."""
        return np.linspace(0.0, self.length, count)


def centrelines(domain: Domain, vessel: Vessel) -> dict[str, Centreline]:
    """Return the lines of a vessel by the opening at the end that is no other's: from the first inlet to each outlet, and
    from each further inlet to the first outlet."""
    if vessel.centreline is not None:
        return {vessel.outlets[0]: Centreline(vessel.centreline)}
    ways = _Ways(domain, vessel)
    first, last = vessel.inlets[0], vessel.outlets[0]
    found = {name: ways.between(first, name) for name in vessel.outlets}
    return found | {name: ways.between(name, last) for name in vessel.inlets[1:]}


class _Ways:
    """Ways through a lumen along the edges of its mesh."""

    def __init__(self, domain: Domain, vessel: Vessel) -> None:
        from scipy.sparse import csr_matrix
        from scipy.spatial import cKDTree

        mesh = domain.mesh
        numbers = sorted({v.nr for e in domain.materials(str(vessel.lumen)).Elements() for v in e.vertices})
        self._new = {number: k for k, number in enumerate(numbers)}
        self._places = np.array([mesh.vertices[number].point for number in numbers])
        wall = {v.nr for e in domain.boundaries(vessel.interface).Elements() for v in e.vertices}
        away = cKDTree(np.array([mesh.vertices[number].point for number in wall])).query(self._places)[0]
        pairs = np.array([[self._new[v.nr] for v in edge.vertices] for e in
                          domain.materials(str(vessel.lumen)).Elements() for edge in map(mesh.__getitem__, e.edges)])
        pairs = np.unique(np.sort(pairs, axis=1), axis=0)
        a, b = pairs.T
        lengths = np.linalg.norm(self._places[a] - self._places[b], axis=1)
        nearest = np.maximum((away[a] + away[b]) / 2, 1e-3 * float(away.max()))
        self._graph = csr_matrix((lengths / nearest**2, (a, b)), shape=(len(numbers),) * 2)
        self._domain, self._radius = domain, float(away.max())

    def between(self, start: str, end: str) -> Centreline:
        """Return the line between two openings, its ends in their middles."""
        from scipy.interpolate import make_lsq_spline
        from scipy.sparse.csgraph import dijkstra

        ends = [self._domain.centroid(name) for name in (start, end)]
        first, last = (int(np.argmin(np.linalg.norm(self._places - middle, axis=1))) for middle in ends)
        _, before = dijkstra(self._graph, directed=False, indices=first, return_predecessors=True)
        way = [last]
        while way[-1] != first:
            way.append(int(before[way[-1]]))
        points = np.vstack([ends[0], self._places[way[::-1]][1:-1], ends[1]])
        s = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))]
        even = np.linspace(0.0, s[-1], 16 * PIECES + 1)
        dense = np.column_stack([np.interp(even, s, column) for column in points.T])
        inner = np.linspace(0.0, s[-1], PIECES + 1)[1:-1]
        knots = np.r_[[0.0] * 4, inner, [s[-1]] * 4]
        weights = np.ones(len(even))
        weights[[0, -1]] = 1e3
        smooth = make_lsq_spline(even, dense, knots, k=3, w=weights)(np.linspace(0.0, s[-1], 4 * PIECES + 1))
        smooth[[0, -1]] = ends
        return Centreline(smooth)
