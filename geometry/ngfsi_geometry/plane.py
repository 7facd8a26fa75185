"""Meshes of a plane section bounded by closed curves and straight sides: tissue in triangles, veins ring by ring."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import ceil, cos, hypot, pi, sin, sqrt
from typing import Any

import numpy as np
from netgen.geom2d import SplineGeometry
from numpy.typing import NDArray

Points = NDArray[np.float64]
Indices = NDArray[np.int32]

LARGEST_FAN = 16
"""Most triangles that meet in the centre of the lumen."""

GROWTH = 0.8
"""How fast elements may grow with the distance from small ones (Netgen's grading, 0 to 1)."""


_AROUND = 2 * np.pi * np.arange(256) / 256
"""Parameters of the points by which distances of ovals are found."""


@dataclass(frozen=True)
class Ellipse:
    """A named ellipse of the section, most often a circle.

    Attributes:
        x, y: centre [m].
        radius: of the circle of the same area [m].
        ratio: of the longer to the shorter axis.
        direction: of the longer axis, from x to y [rad].
    """

    name: str
    x: float
    y: float
    radius: float
    ratio: float = 1.0
    direction: float = 0.0

    @property
    def semi_axes(self) -> tuple[float, float]:
        """The longer and the shorter one [m]."""
        return self.radius * sqrt(self.ratio), self.radius / sqrt(self.ratio)

    @property
    def length(self) -> float:
        """Length of the curve [m]."""
        if self.ratio == 1:
            return 2 * pi * self.radius
        from scipy.special import ellipe  # takes long to load, which round veins need not wait for

        return 4 * self.semi_axes[0] * float(ellipe(1 - 1 / self.ratio**2))

    def wider(self, name: str, distance: float) -> Ellipse:
        """Return the ellipse whose semi-axes are longer by a distance [m]."""
        a, b = (semi + distance for semi in self.semi_axes)
        return replace(self, name=name, radius=sqrt(a * b), ratio=a / b) if self.ratio > 1 else replace(
            self, name=name, radius=self.radius + distance
        )  # fmt: skip

    def scaled(self, name: str, factor: float) -> Ellipse:
        """Return a similar ellipse about the same centre."""
        return replace(self, name=name, radius=factor * self.radius)

    def local(self, x: Any, y: Any) -> tuple[Any, Any]:
        """Return coordinates along and across the longer axis, from the centre; numbers, arrays or fields."""
        c, s = cos(self.direction), sin(self.direction)
        x, y = x - self.x, y - self.y
        return c * x + s * y, c * y - s * x

    def points(self, angles: Points) -> Points:
        """Return the points at the angles of the ellipse's parameter [rad], shape (n, 2)."""
        a, b = self.semi_axes
        c, s = cos(self.direction), sin(self.direction)
        along, across = a * np.cos(angles - self.direction), b * np.sin(angles - self.direction)
        return np.array([self.x, self.y]) + np.column_stack([c * along - s * across, s * along + c * across])

    def angles(self, points: Points) -> Points:
        """Return the parameter [rad] of the similar ellipse through each point."""
        along, across = self.local(*points.T)
        return np.asarray(np.arctan2(self.ratio * across, along) + self.direction)

    def holds(self, points: Points) -> NDArray[np.bool_]:
        """Return which points lie in or on the ellipse."""
        along, across = self.local(*points.T)
        root = sqrt(self.ratio)
        return np.asarray(np.hypot(along / root, across * root) < self.radius * (1 + 1e-9))

    def beside(self, other: Ellipse) -> float:
        """Return the gap between two ellipses beside each other [m]; negative: they overlap by so much."""
        if self.ratio == other.ratio == 1:
            return hypot(self.x - other.x, self.y - other.y) - self.radius - other.radius
        mine, its = self.points(_AROUND), other.points(_AROUND)
        distances = np.hypot(*(mine[:, None] - its[None]).T)  # of points of the other (rows) from mine
        deep = distances[self.holds(its)].min(axis=1), distances.T[other.holds(mine)].min(axis=1)
        overlap = max(float(part.max(initial=0.0)) for part in deep)
        return -overlap if overlap else float(distances.min())

    def inside(self, other: Ellipse) -> float:
        """Return the gap between this ellipse and a circle around it [m]; negative: it reaches out by so much."""
        if self.ratio == 1:
            return other.radius - hypot(self.x - other.x, self.y - other.y) - self.radius
        return other.radius - float(np.hypot(*(self.points(_AROUND) - [other.x, other.y]).T).max())

    def gap(self, other: Ellipse) -> float:
        """Return the gap between two ellipses, one beside or inside the other [m]."""
        return max(self.beside(other), self.inside(other), other.inside(self))


@dataclass(frozen=True)
class Star:
    """A named closed curve of the section that is seen whole from its middle.

    Attributes:
        x, y: the middle [m].
        row: Fourier coefficients 0, 1 ... [m2] of the squared distance from it over the angle around it.
    """

    name: str
    x: float
    y: float
    row: tuple[complex, ...]

    @property
    def radius(self) -> float:
        """Radius of the circle of the same area [m]."""
        return sqrt(self.row[0].real)

    @property
    def length(self) -> float:
        """Length of the curve [m]."""
        ring = self.points(_AROUND)
        return float(np.sum(np.hypot(*(np.roll(ring, -1, axis=0) - ring).T)))

    def scaled(self, name: str, factor: float) -> Star:
        """Return a similar curve about the same middle."""
        return replace(self, name=name, row=tuple(factor**2 * c for c in self.row))

    def points(self, angles: Points) -> Points:
        """Return the points at angles around the middle [rad], shape (n, 2)."""
        orders = np.arange(1, len(self.row))
        waves = np.exp(1j * np.outer(angles, orders)) @ np.array(self.row[1:])
        radii = np.sqrt(self.row[0].real + 2 * waves.real)
        rays = np.column_stack([np.cos(angles), np.sin(angles)])
        return np.asarray(np.array([self.x, self.y]) + radii[:, None] * rays)

    def angles(self, points: Points) -> Points:
        """Return the angles [rad] of points around the middle."""
        return np.asarray(np.arctan2(points[:, 1] - self.y, points[:, 0] - self.x))

    def gap(self, other: Star) -> float:
        """Return the distance [m] of the curve from another; 0 if they cross or one lies in the other."""
        mine, its = self.points(_AROUND), other.points(_AROUND)
        if other.holds(mine).any() or self.holds(its).any():
            return 0.0
        return float(np.hypot(*(mine[:, None] - its[None]).T).min())

    def margin(self, other: Star) -> float:
        """Return the distance [m] of the curve from another around it; 0 if they cross or it lies outside."""
        mine, its = self.points(_AROUND), other.points(_AROUND)
        return float(np.hypot(*(mine[:, None] - its[None]).T).min()) if other.holds(mine).all() else 0.0

    def holds(self, points: Points) -> NDArray[np.bool_]:
        """Return which points lie in the curve."""
        away = np.hypot(points[:, 0] - self.x, points[:, 1] - self.y)
        edge = self.points(self.angles(points)) - [self.x, self.y]
        return np.asarray(away < np.hypot(edge[:, 0], edge[:, 1]))


Curve = Ellipse | Star


@dataclass(frozen=True)
class Ring:
    """The section's nodes on a curve in counter-clockwise order, and the materials on its two sides (None: hole)."""

    circle: Curve
    nodes: Indices
    inside: str | None
    outside: str | None


@dataclass(frozen=True)
class Side:
    """A straight, named line of a section, by its edges (m, 2), in the direction that has a material to their left."""

    name: str
    edges: Indices


@dataclass(frozen=True)
class Line:
    """A line between two curves of a section, from one of the given nodes of each, straight or with corners.

    Attributes:
        start, end: number of the curve among the loops, and of the node on it.
        corners: [m].
        size: longest edge [m].
    """

    name: str
    start: tuple[int, int]
    end: tuple[int, int]
    corners: Sequence[tuple[float, float]]
    size: float


@dataclass(frozen=True)
class SectionMesh:
    """A meshed section.

    Attributes:
        points: shape (n, 2) [m].
        cells: pairs of material and counter-clockwise triangles (m, 3) or quadrilaterals (m, 4).
        rings: the circles, from the skin inwards.
        sides: straight parts of the outline, and lines inside.
    """

    points: Points
    cells: list[tuple[str, Indices]]
    rings: list[Ring]
    sides: Sequence[Side] = ()


def even_angles(segments: int) -> Points:
    """Return the angles of equally spaced nodes, none of them (nor a midpoint) at pi, where arctan2 jumps."""
    return 2 * np.pi * (np.arange(segments) + 0.25) / segments


def triangulate(
    materials: Sequence[str], loops: Sequence[tuple[Curve, Points]], size: float,
    lines: Sequence[Line] = (), material_at: Callable[[Points], Indices] | None = None,
) -> SectionMesh:  # fmt: skip
    """Triangulate the inside of the last curve without holes; each curve comes with the angles of its nodes.

    Where Netgen adds a node to a curve it is moved onto it. Lengths are scaled by the disc's radius before meshing,
    since the mesher compares lengths with absolute tolerances.

    Args:
        materials: names; the first one is everywhere unless `material_at` is given.
        loops: curves beside or inside of each other, the outermost one last.
        size: of the elements [m].
        lines: borders between materials.
        material_at: returns for points (n, 2) [m] the number of the material, from 1; 0: a hole. Default: all
            curves but the last are holes.
    """
    scale = loops[-1][0].radius
    plane = SplineGeometry()
    ids = [[plane.AppendPoint(*corner) for corner in circle.points(angles) / scale] for circle, angles in loops]
    places = [circle.points(angles) for circle, angles in loops]
    pieces: list[tuple[int, int, Points, Points]] = []
    groups: list[range] = []
    for ring, on_ring in zip(ids, places, strict=True):
        ends = [(k, (k + 1) % len(ring)) for k in range(len(ring))]
        groups.append(range(len(pieces) + 1, len(pieces) + 1 + len(ends)))
        pieces += [(ring[a], ring[b], on_ring[a], on_ring[b]) for a, b in ends]
    legs: list[str] = []
    for line in lines:
        (i, a), (j, b) = line.start, line.end
        ends_of_legs = [ids[i][a], *(plane.AppendPoint(x / scale, y / scale) for x, y in line.corners), ids[j][b]]
        corners = [places[i][a], *np.array(line.corners).reshape(-1, 2), places[j][b]]
        for (first, last), (p, q) in zip(pairwise(ends_of_legs), pairwise(corners), strict=True):
            count = ceil(float(np.hypot(*(q - p))) / line.size)
            between = [p + (q - p) * t for t in np.linspace(0, 1, count + 1)]
            numbers = [first, *(plane.AppendPoint(*(one / scale)) for one in between[1:-1]), last]
            groups.append(range(len(pieces) + 1, len(pieces) + 1 + count))
            pieces += [(*pair, *ends) for pair, ends in zip(pairwise(numbers), pairwise(between), strict=True)]
            legs.append(line.name)
    on_sides = [((1, 0) if k is groups[len(loops) - 1] else (0, 1)) for k in groups for _ in k]
    if material_at is not None:
        on_sides = _beside(np.array([[p, q] for _, _, p, q in pieces]), material_at)
    for (begin, after, p, q), (left, right) in zip(pieces, on_sides, strict=True):
        maxh = 1.2 * float(np.linalg.norm(q / scale - p / scale))
        plane.Append(["line", begin, after], leftdomain=left, rightdomain=right, maxh=maxh)
    mesh = plane.GenerateMesh(maxh=size / scale, grading=GROWTH)
    points = np.array([point.p[:2] for point in mesh.Points()]) * scale
    triangles = np.array([[v.nr - 1 for v in t.vertices] for t in mesh.Elements2D()], dtype=np.int32)
    domains = np.array([t.index for t in mesh.Elements2D()])
    # edges have the number of the line of which they are a part
    edges = np.array([(edge.index, *(v.nr - 1 for v in edge.vertices)) for edge in mesh.Elements1D()], dtype=np.int32)
    of = [edges[(edges[:, 0] >= group[0]) & (edges[:, 0] <= group[-1]), 1:] for group in groups]
    rings: list[Ring] = []
    for (circle, _), own in zip(loops, of, strict=False):
        nodes = np.unique(own)
        angles = circle.angles(points[nodes])
        points[nodes] = circle.points(angles)
        sides_of = (materials[0], None) if circle is loops[-1][0] else (None, materials[0])
        rings.insert(0, Ring(circle, nodes[np.argsort(angles)], *sides_of))
    triangles = counter_clockwise(points, triangles)
    cells = [(name, triangles[domains == k]) for k, name in enumerate(materials, start=1) if np.any(domains == k)]
    sides = tuple(Side(name, own) for name, own in zip(legs, of[len(loops) :], strict=True))
    return SectionMesh(points, cells, rings, sides)


def within(points: Points, corners: Points) -> NDArray[np.bool_]:
    """Return which points (n, 2) lie in a polygon (m, 2): beyond an odd number of its sides to the right of them."""
    (x, y), (u, v) = points.T[:, :, None], (np.roll(corners, -1, axis=0) - corners).T
    above = (corners[:, 1] > y) != (np.roll(corners[:, 1], -1) > y)
    with np.errstate(divide="ignore", invalid="ignore"):
        beyond = above & (x < corners[:, 0] + u * (y - corners[:, 1]) / v)
    return np.asarray(beyond.sum(axis=1) % 2 == 1)


def _beside(ends: Points, material_at: Callable[[Points], Indices]) -> list[tuple[int, int]]:
    """Return the materials to the left and to the right of lines between points (n, 2, 2) [m]."""
    along = ends[:, 1] - ends[:, 0]
    off = 0.02 * np.column_stack([-along[:, 1], along[:, 0]])
    middles = ends.mean(axis=1)
    left, right = material_at(middles + off), material_at(middles - off)
    return [(int(a), int(b)) for a, b in zip(left, right, strict=True)]


def counter_clockwise(points: Points, triangles: Indices) -> Indices:
    """Return the triangles with positive orientation."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    clockwise = (b - a)[:, 0] * (c - a)[:, 1] < (b - a)[:, 1] * (c - a)[:, 0]
    return np.where(clockwise[:, None], triangles[:, ::-1], triangles)


def fill_vein(
    section: SectionMesh, hole: str, layers: Sequence[tuple[Curve, str]], core: str | None, split: bool
) -> SectionMesh:
    """Fill a hole of a section with concentric layers and a core.

    Args:
        section: has a ring around the hole, which is the outer wall of a vein.
        hole: name of the ring's circle.
        layers: circles from outside inwards, each with the material between it and the circle before it.
        core: material inside the last circle; None: it stays a hole.
        split: layers of triangles instead of quadrilaterals.
    """
    (rim,) = (ring for ring in section.rings if ring.circle.name == hole)
    rings = [ring for ring in section.rings if ring is not rim]
    cells, points = list(section.cells), [section.points]
    angles, count = rim.circle.angles(section.points[rim.nodes]), len(section.points)
    circle, nodes, outside = rim.circle, rim.nodes, rim.outside
    for inner, material in layers:
        rings.append(Ring(circle, nodes, material, outside))
        new = np.arange(count, count + len(nodes), dtype=np.int32)
        points.append(inner.points(angles))
        cells.append((material, annulus(nodes, new, split)))
        circle, nodes, outside, count = inner, new, material, count + len(new)
    rings.append(Ring(circle, nodes, core, outside))
    if core is None:
        return SectionMesh(np.vstack(points), cells, rings, section.sides)
    core_points, core_triangles = fill_core(circle, nodes, angles, count)
    return SectionMesh(np.vstack([*points, core_points]), [*cells, (core, core_triangles)], rings, section.sides)


def annulus(outer: Indices, inner: Indices, split: bool) -> Indices:
    """Fill the annulus between two rings of equally many nodes; split: triangles with alternating diagonals."""
    a, b, c, d = outer, np.roll(outer, -1), np.roll(inner, -1), inner
    if not split:
        return np.column_stack((a, b, c, d))
    odd = (np.arange(len(outer)) % 2 == 1)[:, None]
    first = np.where(odd, np.column_stack((a, b, c)), np.column_stack((a, b, d)))
    second = np.where(odd, np.column_stack((a, c, d)), np.column_stack((b, c, d)))
    return np.vstack((first, second))


def fill_core(circle: Curve, nodes: Indices, angles: Points, count: int) -> tuple[Points, Indices]:
    """Fill a disc by rings of half as many nodes each while there are many, then a fan around the centre.

    Returns: new points, numbered from `count`, and triangles.
    """
    points, triangles = [], []
    while len(nodes) > LARGEST_FAN and len(nodes) % 2 == 0:
        circle, angles = circle.scaled(circle.name, 0.55), angles[::2]
        new = np.arange(count, count + len(angles), dtype=np.int32)
        even, odd, after, following = nodes[::2], nodes[1::2], np.roll(nodes[::2], -1), np.roll(new, -1)
        triangles += [np.column_stack(t) for t in ((even, odd, new), (odd, following, new), (odd, after, following))]
        points.append(circle.points(angles))
        nodes, count = new, count + len(new)
    triangles.append(np.column_stack((nodes, np.roll(nodes, -1), np.full_like(nodes, count))))
    points.append(np.array([[circle.x, circle.y]]))
    return np.vstack(points), np.vstack(triangles)
