"""A boundary as curved elements on which fields are polynomials, and the curves in which planes cut it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import ngsolve as ng
import numpy as np
from numpy.polynomial import legendre

from ngfsi.arrays import Array, Mask, Numbers

CORNERS = {
    ng.ET.QUAD: [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)],
    ng.ET.TRIG: [(1.0, 0.0), (0.0, 1.0), (0.0, 0.0), (0.0, 0.0)],
}
"""In NGSolve's order of the vertices; a triangle is a quadrilateral with one edge of no length."""
ITERATIONS = 40
"""Of Newton's method; a handful is needed unless a plane touches an edge."""
CONVERGED = 1e-14
"""Change of a parameter, which is from 0 to 1 in an element, that is rounding."""
LARGEST_STEP = 0.5
"""Change of a parameter in one iteration."""
NEAR = 0.5
"""Largest distance of a curve's middle from the given one, over its perimeter: what is farther is of other vessels."""


class Gauss(NamedTuple):
    """Quadrature from 0 to 1: nodes, weights, derivatives at the nodes and powers from the values there."""

    nodes: Array
    weights: Array
    slope: Array
    powers: Array


@cache
def gauss(points: int) -> Gauss:
    """Return Gauss's rule with so many points."""
    nodes, weights = legendre.leggauss(points)
    nodes = (nodes + 1) / 2
    powers = np.asarray(np.linalg.inv(np.vander(nodes, increasing=True)), dtype=float)
    slopes = np.hstack([np.zeros((points, 1)), np.vander(nodes, points - 1, increasing=True) * np.arange(1, points)])
    return Gauss(nodes, weights / 2, np.asarray(slopes @ powers), powers)


class Line(NamedTuple):
    """A chain of arcs from edge to edge.

    Attributes:
        element: (arcs,)
        ends: (arcs, 2, 2) parameters in the element.
        closed: whether the last arc ends where the first begins.
    """

    element: Numbers
    ends: Array
    closed: bool


@dataclass(frozen=True)
class Outlines:
    """Closed curves on a surface, one per station: arcs from edge to edge of its elements, known at Gauss points.

    Attributes:
        station: (arcs,) number of the curve to which an arc belongs; ascending, and in order around the curve.
        element: (arcs,) of the surface.
        points: (arcs, points, 2) parameters in the element, counter-clockwise about the plane's normal.
        normal: (stations, 3) of the planes.
        whole: (stations,) whether the curve lies in the plane; else it is a rim, or there is none.
    """

    station: Numbers
    element: Numbers
    points: Array
    normal: Array
    whole: Mask

    @classmethod
    def interlaced(cls, parts: Sequence[Outlines]) -> Outlines:
        """Return curves of which the first part has the first one, the second part the second one, and so on around."""
        station = np.concatenate([number + len(parts) * part.station for number, part in enumerate(parts)])
        order, count = np.argsort(station, kind="stable"), sum(len(part.whole) for part in parts)
        element, points = (
            np.concatenate([getattr(part, name) for part in parts])[order] for name in ("element", "points")
        )
        normal, whole = np.empty((count, 3)), np.empty(count, dtype=bool)
        for number, part in enumerate(parts):
            normal[number :: len(parts)], whole[number :: len(parts)] = part.normal, part.whole
        return cls(station[order], element, points, normal, whole)

    def derivative(self, values: Array) -> Array:
        """Return the derivative of values (arcs, points, dim) by the parameter of each arc, from 0 to 1."""
        return np.asarray(gauss(self.points.shape[1]).slope @ values)

    def integral(self, values: Array) -> Array:
        """Return the integral (stations,) of values (arcs, points) over the parameters of the arcs of each curve."""
        values = values @ gauss(self.points.shape[1]).weights
        return np.asarray(np.bincount(self.station, values, len(self.whole)), dtype=float)

    def spread(self, values: Array) -> Array:
        """Return values (stations, dim) of the stations at each arc: (arcs, 1, dim)."""
        return np.asarray(values[self.station, None])

    def enclosed(self, points: Array, tangent: Array) -> Array:
        """Return the areas (stations,) that curves enclose, seen along the normals.

        Args:
            points, tangent: (arcs, points, 3)
        """
        return self.integral(np.sum(np.cross(points, tangent) * self.spread(self.normal), axis=2)) / 2

    def means(self, points: Array) -> Array:
        """Return the means (stations, 3) of the points (arcs, points, 3) of each curve."""
        count = np.bincount(self.station, minlength=len(self.whole))
        sums = [np.bincount(self.station, x, len(self.whole)) for x in points.mean(axis=1).T]
        return np.asarray(np.stack(sums, axis=1) / np.maximum(count, 1)[:, None])

    def centroids(self, points: Array) -> Array:
        """Return the centroids (stations, 3) of the areas within curves of points (arcs, points, 3)."""
        origin = self.means(points)
        arms, tangent = points - self.spread(origin), self.derivative(points)
        areas = np.sum(np.cross(arms, tangent) * self.spread(self.normal), axis=2)
        moments = np.stack([self.integral(arms[..., axis] * areas) for axis in range(3)], axis=1)
        return np.asarray(origin + moments / (3 * self.enclosed(arms, tangent))[:, None])

    def rings(self, points: Array, number: int) -> Array:
        """Return `number` points (stations, number, 3) at even lengths around each curve; NaN where there is none.

        They begin towards x, or y where the normal is nearly along x.

        Args:
            points: (arcs, points, 3)
        """
        found, rule = np.full((len(self.whole), number, 3), np.nan), gauss(points.shape[1])
        lengths = np.linalg.norm(self.derivative(points), axis=2) @ rule.weights
        towards = across(self.normal)[0]
        for station in np.unique(self.station):
            arcs = np.flatnonzero(self.station == station)
            arcs = np.roll(arcs, -int(np.argmax(points[arcs, 0] @ towards[station])))
            ends = np.concatenate([[0.0], np.cumsum(lengths[arcs])])
            wanted = np.linspace(0.0, ends[-1], number, endpoint=False)
            arc = np.minimum(np.searchsorted(ends, wanted, side="right"), len(arcs)) - 1
            powers = np.vander((wanted - ends[arc]) / lengths[arcs[arc]], len(rule.nodes), increasing=True)
            found[station] = np.einsum("np,npk->nk", powers @ rule.powers, points[arcs[arc]])
        return found


def across(axis: Array) -> tuple[Array, Array]:
    """Return two unit vectors (n, 3) across unit axes, the first towards x, or y where the axis is nearly along x."""
    towards = np.where(np.abs(axis[:, :1]) < 0.9, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    first = towards - np.sum(towards * axis, axis=1)[:, None] * axis
    first /= np.linalg.norm(first, axis=1)[:, None]
    return first, np.cross(axis, first)


class Surface:
    """A boundary of a mesh; fields on it are given by coefficients (elements, functions, dim) of their polynomials."""

    def __init__(self, mesh: Any, region: Any, degree: int) -> None:
        """Prepare.

        Args:
            region: the boundary.
            degree: of the polynomials that place and fields are on each element.
        """
        elements, ticks = list(region.Elements()), np.linspace(0.0, 1.0, degree + 1)
        self._derivative = _slopes(degree)
        self._degree = degree
        quad = np.array([(s, t) for t in ticks for s in ticks])
        nodes = {ng.ET.QUAD: quad, ng.ET.TRIG: quad[quad.sum(axis=1) < 1 + ticks[1] / 2]}
        rules = {kind: ng.IntegrationRule([tuple(p) for p in at], [1.0] * len(at)) for kind, at in nodes.items()}
        self._at = mesh.MapToAllElements(rules, region)
        kinds = [element.type for element in elements]
        first = np.cumsum([0, *(len(nodes[kind]) for kind in kinds)])
        total = np.add.outer(np.arange(degree + 1), np.arange(degree + 1)).ravel()
        self._elements, self._nodes = elements, list(nodes.values())
        self._parts = []
        """Of each kind: its elements, the numbers of their values, its functions, coefficients from values."""
        for kind, at in nodes.items():
            these = np.array([k for k, other in enumerate(kinds) if other == kind], dtype=np.int64)
            functions = np.flatnonzero((total <= degree) | (kind == ng.ET.QUAD))
            inverse = np.linalg.inv(self._basis(at)[:, functions])
            self._parts.append((these, first[these][:, None] + np.arange(len(at)), functions, inverse))
        vertices = np.array([[*(v.nr for v in element.vertices), element.vertices[-1].nr][:4] for element in elements])
        _, numbers = np.unique(vertices, return_inverse=True)
        self._vertices = numbers.reshape(-1, 4)
        self._corners = np.array([CORNERS[kind] for kind in kinds])
        pairs = np.stack([self._vertices, np.roll(self._vertices, -1, axis=1)], axis=2)
        _, edges, counts = np.unique(
            np.sort(pairs.reshape(-1, 2), axis=1), axis=0, return_inverse=True, return_counts=True
        )
        self._edges = edges.reshape(-1, 4)
        on, edge = np.nonzero((counts[self._edges] == 1) & (pairs[..., 0] != pairs[..., 1]))
        ends = np.stack([self._corners[on, edge], self._corners[on, (edge + 1) % 4]], axis=1)
        self._rims = [line for line in _lines(pairs[on, edge], on, ends) if line.closed]
        """Of the edges that belong to one element."""

    def coefficients(self, field: Any) -> Array:
        """Return the coefficients of a coefficient function in its present state."""
        values = np.asarray(field(self._at))
        found = np.zeros((len(self._vertices), (self._degree + 1) ** 2, values.shape[1]))
        for elements, numbers, functions, inverse in self._parts:
            found[elements[:, None], functions] = inverse @ values[numbers]
        return found

    def transposed(self, factors: Array, outlines: Outlines, space: Any) -> Array:
        """Return the derivative of a weighted sum of a field's values on outlines by the unknowns of its space.

        Args:
            factors: (arcs, points, dim) of the values.
            space: `VectorH1`.
        """
        of_coefficients = np.zeros((len(self._vertices), (self._degree + 1) ** 2, factors.shape[2]))
        np.add.at(of_coefficients, outlines.element, np.swapaxes(self._basis(outlines.points), 1, 2) @ factors)
        scalar = space.components[0]
        found = np.zeros((factors.shape[2], scalar.ndof))
        for (elements, _, functions, inverse), nodes in zip(self._parts, self._nodes, strict=True):
            of_values = np.swapaxes(inverse, 0, 1) @ of_coefficients[elements[:, None], functions]
            for number in np.flatnonzero(np.any(of_values, axis=(1, 2))):
                element = self._elements[elements[number]]
                finite, unknowns = scalar.GetFE(element), np.array(scalar.GetDofNrs(element))
                shapes = np.array([finite.CalcShape(*point) for point in nodes])
                np.add.at(found.T, unknowns, shapes.T @ of_values[number])
        return found.ravel()

    def values(self, coefficients: Array, outlines: Outlines) -> Array:
        """Return the values (arcs, points, dim) of a field on outlines."""
        return np.asarray(self._basis(outlines.points) @ coefficients[outlines.element])

    def normals(self, place: Array, outlines: Outlines) -> Array:
        """Return vectors (arcs, points, 3) across the surface on outlines, to one of its sides, of any length."""
        first, second = (self._basis(outlines.points, slope) @ place[outlines.element] for slope in (0, 1))
        return np.cross(first, second)

    def cut(self, place: Array, centres: Array, normals: Array, points: int) -> Outlines:
        """Return the curves in which planes cut the surface: of several in one plane the one nearest the centre.

        Where that is not closed, as at an end that the plane leaves, the nearest rim stands for it.

        Args:
            place: coefficients of the points of the surface.
            centres, normals: (stations, 3) a point of each plane [m] and its unit normal.
            points: of each arc.
        """
        corners = np.zeros((self._vertices.max() + 1, 3))
        corners[self._vertices] = self._basis(self._corners) @ place
        plane = np.einsum("sk,ebk->seb", normals, place)
        plane[..., 0] -= np.sum(centres * normals, axis=1)[:, None]
        distance = normals @ corners.T - np.sum(centres * normals, axis=1)[:, None]
        station, element, edges = self._crossed(distance, plane)
        first, second = (self._vertices[element[:, None], (edges + k) % 4] for k in (0, 1))
        begin = self._corners[element[:, None], edges]
        way = self._corners[element[:, None], (edges + 1) % 4] - begin
        roots = self._roots(plane[station, element], begin, way, distance[station[:, None], first] < 0)
        numbers, bounds = self._edges[element[:, None], edges], np.searchsorted(station, np.arange(len(centres) + 1))
        # both elements of an edge take the root of one: where the edge nearly lies in the plane, it is badly known
        same = np.unique(np.column_stack([np.repeat(station, 2), numbers.ravel()]), axis=0, return_index=True,
                         return_inverse=True)  # fmt: skip
        roots = np.where(first > second, 1 - roots, roots).ravel()[same[1]][same[2]].reshape(roots.shape)
        ends = begin + np.where(first > second, 1 - roots, roots)[..., None] * way
        parts, whole = [], np.zeros(len(centres), dtype=bool)
        for k, (centre, normal) in enumerate(zip(centres, normals, strict=True)):
            here = slice(bounds[k], bounds[k + 1])
            line, whole[k] = self._nearest(place, centre, _lines(numbers[here], element[here], ends[here]))
            if not whole[k]:
                line, _ = self._nearest(place, centre, self._rims)
            chords = self._basis(line.ends) @ place[line.element] - centre
            if np.sum(np.cross(chords[:, 0], chords[:, 1]) @ normal) < 0:
                line = Line(line.element[::-1], line.ends[::-1, ::-1], line.closed)
            parts.append(line)
        station = np.repeat(np.arange(len(centres)), [len(line.element) for line in parts])
        element, ends = (np.concatenate([part[k] for part in parts]) for k in (0, 1))
        chord = ends[:, 1] - ends[:, 0]
        at = ends[:, :1] + gauss(points).nodes[:, None] * chord[:, None]
        cut = whole[station]
        side = np.stack([-chord[:, 1], chord[:, 0]], axis=1)[cut]
        side /= np.maximum(np.linalg.norm(side, axis=1), np.finfo(float).tiny)[:, None]
        way = np.broadcast_to(side[:, None], at[cut].shape)
        at[cut] += self._roots(plane[station[cut], element[cut]], at[cut], way)[..., None] * way
        return Outlines(station, element, at, normals, whole)

    def _crossed(self, distance: Array, plane: Array) -> tuple[Numbers, Numbers, Numbers]:
        """Return station, element and both edges (arcs, 2) of each arc of an element between two edges.

        A vertex is on one side or on the other, also if it lies in the plane: so curves are closed whatever it meets.

        Args:
            distance: (stations, vertices) of the vertices from the planes.
            plane: (stations, elements, functions) the distance's coefficients.
        """
        above = (distance >= 0)[:, self._vertices]
        crossed = above != np.roll(above, -1, axis=2)
        count = crossed.sum(axis=2)
        station, element = np.nonzero(count == 2)
        there = crossed[station, element]
        edges = np.stack([np.argmax(there, axis=1), 3 - np.argmax(there[:, ::-1], axis=1)], axis=1)
        saddle = np.nonzero(count == 4)
        # which opposite corners does the middle join?
        middle = plane[saddle] @ self._basis(np.full(2, 0.5)) >= 0
        first = (middle == above[(*saddle, 0)])[:, None]
        pairs = np.where(first, [[0, 1]], [[3, 0]]), np.where(first, [[2, 3]], [[1, 2]])
        station = np.concatenate([station, saddle[0], saddle[0]])
        element, edges = np.concatenate([element, saddle[1], saddle[1]]), np.concatenate([edges, *pairs])
        order = np.argsort(station, kind="stable")
        return station[order], element[order], edges[order]

    def _nearest(self, place: Array, centre: Array, lines: Sequence[Line]) -> tuple[Line, bool]:
        """Return the line whose middle is nearest to a point, none if there is none, and whether it is around it."""
        best, smallest, around = Line(np.zeros(0, dtype=np.int64), np.zeros((0, 2, 2)), closed=False), np.inf, False
        for line in lines:
            chords = self._basis(line.ends) @ place[line.element]
            lengths = np.linalg.norm(chords[:, 1] - chords[:, 0], axis=1)
            size = float(lengths.sum())
            middle = lengths @ chords.mean(axis=1) / size if size > 0 else chords[0, 0]
            if (distance := float(np.linalg.norm(middle - centre))) < smallest:
                best, smallest, around = line, distance, line.closed and distance < NEAR * size
        return best, around

    def _roots(self, plane: Array, start: Array, way: Array, below: Mask | None = None) -> Array:
        """Return how far (arcs, points) it is along ways from parameters (arcs, points, 2) to the planes.

        Args:
            plane: (arcs, functions) coefficients of the distance from the plane.
            below: whether starts are on the plane's negative side, if the plane is known to lie between 0 and 1.
        """
        coefficients, low = plane.reshape(-1, self._degree + 1, self._degree + 1), np.zeros(start.shape[:2])
        high, step = np.ones_like(low), low if below is None else low + 0.5
        for _ in range(ITERATIONS):
            at = start + step[..., None] * way
            x, y = (self._legendre(at[..., axis]) for axis in (0, 1))
            part = x @ coefficients
            value = np.sum(part * y, axis=2)
            slope = way[..., 0] * np.sum(x @ self._derivative @ coefficients * y, axis=2)
            slope += way[..., 1] * np.sum(part * (y @ self._derivative), axis=2)
            change = -value / np.where(slope == 0, np.inf, slope)
            if below is not None:
                before = (value < 0) == below
                low, high = np.where(before, step, low), np.where(before, high, step)
                outside = (step + change < low) | (step + change > high)
                change = np.where(outside, (low + high) / 2 - step, change)
            change = np.clip(change, -LARGEST_STEP, LARGEST_STEP)
            step = step + change
            if np.all(np.abs(change) < CONVERGED):
                break
        return np.asarray(step)

    def _basis(self, at: Array, slope: int | None = None) -> Array:
        """Return the functions (..., functions) at parameters (..., 2), or their derivatives along one of these."""
        factors = [self._legendre(at[..., axis]) for axis in (0, 1)]
        if slope is not None:
            factors[slope] = factors[slope] @ self._derivative
        return np.asarray((factors[0][..., :, None] * factors[1][..., None, :]).reshape(*at.shape[:-1], -1))

    def _legendre(self, at: Array) -> Array:
        """Return Legendre's polynomials (..., degree + 1) on [0, 1]; NumPy's own function takes three times as long."""
        values = np.empty((*at.shape, self._degree + 1))
        values[..., 0], values[..., 1] = 1.0, 2 * at - 1
        for n in range(1, self._degree):
            values[..., n + 1] = ((2 * n + 1) * values[..., 1] * values[..., n] - n * values[..., n - 1]) / (n + 1)
        return values


def _slopes(degree: int) -> Array:
    """Return the matrix from Legendre's polynomials on [0, 1] to their derivatives: columns are polynomials."""
    slopes = np.zeros((degree + 1, degree + 1))
    slopes[:degree] = 2 * legendre.legder(np.eye(degree + 1), axis=0).reshape(degree, -1)
    return slopes


def _lines(pairs: Numbers, element: Numbers, ends: Array) -> list[Line]:
    """Join arcs into lines.

    Args:
        pairs: (arcs, 2) numbers of the points in which arcs begin and end; at most two arcs have one in common.
        element, ends: of the arcs.
    """
    at: dict[int, list[int]] = {}
    links = [(int(a), int(b)) for a, b in pairs]
    for number, link in enumerate(links):
        for end in link:
            at.setdefault(end, []).append(number)
    loose = [numbers[0] for numbers in at.values() if len(numbers) == 1]
    left, lines = dict.fromkeys([*loose, *range(len(links))]), list[Line]()
    while left:
        arc: int | None = next(iter(left))
        begin = end = min(links[next(iter(left))], key=lambda end: len(at[end]))
        order, turned = list[int](), list[bool]()
        while arc is not None:
            del left[arc]
            order.append(arc)
            turned.append(links[arc][0] != end)
            end = links[arc][1 - turned[-1]]
            arc = next((other for other in at[end] if other in left), None)
        of_arcs = np.where(np.array(turned)[:, None, None], ends[order][:, ::-1], ends[order])
        lines.append(Line(element[order], of_arcs, end == begin))
    return lines
