"""Cross-sections of the deformed lumen at stations along a vessel, perpendicular to its centreline, and the flow through
them.

The wall is that of the discretisation: on each of its elements place, velocity and shear stress are polynomials. A plane
cuts it in arcs from edge to edge, each known at Gauss points to rounding, so that areas integrate to the volume of the
discrete lumen, on whatever mesh and in whatever direction.

SciPy is loaded when there is something to measure: half a second, for which a refused case need not wait.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import netgen.meshing as nm
import ngsolve as ng
import numpy as np
from numpy.polynomial.legendre import legder, leggauss, legval, legvander
from numpy.typing import NDArray

from ngfsi.mesh.centreline import Centreline
from ngfsi.mesh.geometry import Vessel
from ngfsi.system.system import System

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]

STATIONS = 11
INSIDE = 1e-9
"""Planes at the ends of a vessel lie inside by this share of its length."""
BISECTIONS, NEWTON = 10, 5
CORNERS = {ng.ET.QUAD: np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]]), ng.ET.TRIG: np.array([[1.0, 0], [0, 1], [0, 0]])}
"""Where NGSolve's element of reference has its vertices, in their order."""


class Faces:
    """The elements of one shape on a boundary, with polynomials on them."""

    def __init__(self, mesh: ng.Mesh, region: ng.Region, shape: Any, degree: int) -> None:
        elements = [e for e in region.Elements() if e.type == shape]
        self.corners = CORNERS[shape]
        self.vertices: Numbers = np.array([[v.nr for v in e.vertices] for e in elements], dtype=np.int64).reshape(
            -1, len(self.corners))  # fmt: skip
        ticks = (1 - np.cos(np.pi * np.arange(degree + 1) / degree)) / 2
        nodes = np.array([(s, t) for s in ticks for t in ticks])
        exponents = np.array([(i, j) for i in range(degree + 1) for j in range(degree + 1)])
        if shape == ng.ET.TRIG:
            even = np.arange(degree + 1) / degree
            nodes = np.array([(s, t) for s in even for t in even if s + t < 1 + 1e-12])
            exponents = exponents[exponents.sum(axis=1) <= degree]
        self._degree, self._chosen = degree, exponents[:, 0] * (degree + 1) + exponents[:, 1]
        self._to_coefficients = np.linalg.inv(self._basis(nodes))
        rule = ng.IntegrationRule([tuple(node) for node in nodes], [1.0] * len(nodes))
        none = ng.IntegrationRule([], [])
        rules = {one: rule if one == shape else none for one in CORNERS}
        self._at = mesh.MapToAllElements(rules, region) if elements else None
        self.coefficients = np.zeros((0, len(nodes), 9))

    def take(self, field: Any, size: int) -> None:
        """Take the values of a field of polynomials (components `size`)."""
        if self._at is None:
            return
        values = np.asarray(field(self._at)).reshape(len(self.vertices), -1, size)
        self.coefficients = np.einsum("ij,ejc->eic", self._to_coefficients, values)

    def _basis(self, points: Array, along: int | None = None) -> Array:
        """Return the basis (points, functions) at points (points, 2), or its derivative along s (0) or t (1)."""
        parts = []
        for axis in range(2):
            x = 2 * points[:, axis] - 1
            if axis == along:
                rows = np.eye(self._degree + 1)
                parts.append(np.stack([2 * legval(x, legder(row)) for row in rows], axis=1))
            else:
                parts.append(legvander(x, self._degree))
        whole = np.einsum("pi,pj->pij", *parts).reshape(len(points), -1)
        return np.asarray(whole[:, self._chosen])

    def values(self, elements: Numbers, points: Array, along: int | None = None) -> Array:
        """Return the components (n, size) at points (n, 2) of elements (n,), or their derivatives."""
        return np.einsum("pi,pic->pc", self._basis(points, along), self.coefficients[elements])


@dataclass(frozen=True)
class Outlines:
    """Closed curves of smooth arcs, sampled at Gauss points of each arc's parameter from 0 to 1.

    Attributes:
        curve: (arcs,) number of the curve that an arc belongs to; arcs of a curve follow each other.
        points, velocity, shear: (arcs, points, 3) m, m/s, Pa.
        normal: (arcs, points, 3) of the wall, of any length and sign.
        count: number of curves.
    """

    curve: Numbers
    points: Array
    velocity: Array
    shear: Array
    normal: Array
    count: int

    def tangents(self) -> Array:
        """Return the derivatives of the points by the parameter of each arc."""
        nodes = (leggauss(self.points.shape[1])[0] + 1) / 2
        powers = np.vander(nodes, increasing=True)
        slopes = np.hstack([np.zeros((len(nodes), 1)), powers[:, :-1] * np.arange(1, len(nodes))])
        return np.asarray(np.einsum("ij,ajc->aic", slopes @ np.linalg.inv(powers), self.points))

    def integral(self, values: Array) -> Array:
        """Return for each curve the integral of values (arcs, points) over the parameters of its arcs."""
        weights = leggauss(self.points.shape[1])[1] / 2
        return np.bincount(self.curve, values @ weights, self.count)

    def rings(self) -> list[Array]:
        """Return the points (n, 3) of each curve in order."""
        return [self.points[self.curve == k].reshape(-1, 3) for k in range(self.count)]


class Sections:
    """Outlines of the lumen in planes across a vessel, by default evenly spaced from inlet to outlet.

    Attributes:
        heights: (stations,) positions on the centreline, m.
        outlines: as of the last `refresh`.
        whole: (stations,) whether the plane of a station cuts the wall all around; where it does not, as at an end that
            has moved inwards, the nearest section that does stands for it.
        areas, area_rates, perimeters: (stations,) m2, m2/s in the fixed plane, m
        shears: (stations,) wall shear stress, mean over the outline, Pa; of `shear` in `refresh`.
    """

    def __init__(self, system: System, vessel: Vessel, line: Centreline, positions: Array | None = None) -> None:
        """Prepare.

        Args:
            positions: of the stations on the line (m); None: STATIONS of them, evenly spaced.
        """
        self.system, self.vessel, self.line, self.length = system, vessel, line, line.length
        self.heights = line.stations(STATIONS) if positions is None else np.asarray(positions)
        fields, mesh = system.fields(), system.domain.mesh
        degree = max(system.unknowns.order, system.domain.geometry.curving_order)
        region = system.domain.boundaries(vessel.interface)
        self._faces = [Faces(mesh, region, shape, degree) for shape in CORNERS]
        self._place, self._velocity = ng.CF((ng.x, ng.y, ng.z)) + fields.motion, fields.velocity
        self._points = system.unknowns.order + 2
        within = np.clip(self.heights, INSIDE * self.length, (1 - INSIDE) * self.length)
        self._planes = line.at(within), line.tangents(within)
        self._axis = self._on_axis()
        self.whole = np.ones(len(self.heights), dtype=bool)
        self.areas, self.area_rates, self.perimeters, self.shears = np.zeros((4, len(self.heights)))

    def refresh(self, shear: ng.CoefficientFunction | None = None) -> None:
        """Take the system's present state.

        Args:
            shear: wall shear stress (Pa), a field of polynomials on the interface.
        """
        field = ng.CF((self._place, self._velocity, shear if shear is not None else ng.CF((0, 0, 0))))
        for faces in self._faces:
            faces.take(field, 9)
        centres, axes = self._planes
        self.outlines, found = self.across(centres, axes)
        self.whole = found
        if not np.any(found):
            raise RuntimeError(f"no plane across the vessel '{self.vessel.name}' cuts its wall all around")
        which, axis = self.outlines, axes[found][self.outlines.curve][:, None]
        tangent = which.tangents()
        inwards = np.cross(axis, tangent)  # of the length of the tangent, outwards turned
        lengths = np.linalg.norm(tangent, axis=2)
        areas = which.integral(np.einsum("apc,apc->ap", np.cross(which.points, tangent), np.broadcast_to(axis, tangent.shape))) / 2
        flux = np.einsum("apc,apc->ap", which.velocity, which.normal)
        across = -np.einsum("apc,apc->ap", which.normal, inwards)
        rates = which.integral(np.divide(flux * lengths**2, across, out=np.zeros_like(flux), where=lengths > 0))
        perimeters = which.integral(lengths)
        sizes = which.integral(np.linalg.norm(which.shear, axis=2) * lengths) / perimeters
        nearest = self.nearest_whole()
        self.areas, self.area_rates, self.perimeters, self.shears = (
            values[nearest] for values in (areas, rates, perimeters, sizes)
        )

    def planes(self, stations: NDArray[np.bool_]) -> tuple[Array, Array]:
        """Return a point (n, 3) [m] and the unit normal (n, 3) of the planes of stations."""
        centres, axes = self._planes
        return centres[stations], axes[stations]

    def nearest_whole(self) -> Numbers:
        """Return for each station the number of the nearest whole section among these."""
        whole = np.flatnonzero(self.whole)
        return np.argmin(np.abs(np.arange(len(self.heights))[:, None] - whole), axis=1)

    @property
    def rings(self) -> list[Array]:
        """Points (n, 3) [m] around each station, in order."""
        rings = self.outlines.rings()
        return [rings[k] for k in self.nearest_whole()]

    @property
    def blood(self) -> Array:
        """Pressure of the blood on the centreline at each station, of the reference shape (Pa)."""
        x, y, z = self._axis.T
        pressure = self.system.blood_pressure(self.vessel.name)
        return np.asarray(pressure(self.system.domain.mesh(x, y, z))).ravel()

    def _on_axis(self) -> Array:
        """Return where the stations lie in the straight mesh; ends a little inside, where a mesh may be open."""
        places, domain = self.line.at(self.heights), self.system.domain
        try:
            return domain.on_straight_mesh(places)
        except nm.NgException:  # the line leaves the straight mesh of a strongly curved shape, or its ends by rounding
            inside = np.clip(self.heights, 1e-6 * self.length, (1 - 1e-6) * self.length)
            return domain.on_straight_mesh(self.line.at(inside))

    def across(self, centres: Array, axes: Array) -> tuple[Outlines, NDArray[np.bool_]]:
        """Return the outlines in planes, counter-clockwise about their axes, and which planes have a whole one.

        Args:
            centres, axes: (planes, 3) a point of each plane (m), near which its outline lies, and its unit normal.
        """
        arcs: list[list[tuple[int, int, Array, Array, int, int]]] = [[] for _ in centres]
        for kind, faces in enumerate(self._faces):
            _cut(faces, kind, centres, axes, arcs)
        loops = [self._loop(found, centre, axis) for found, centre, axis in zip(arcs, centres, axes, strict=True)]
        whole = np.array([loop is not None for loop in loops])
        chosen = [loop for loop in loops if loop is not None]
        return self._sampled(chosen, centres[whole], axes[whole]), whole

    def _loop(self, arcs: Any, centre: Array, axis: Array) -> Any:
        """Return the arcs of the closed curve nearest to a centre, each with its ends in order; None: there is none."""
        at: dict[int, list[int]] = {}
        for number, arc in enumerate(arcs):
            for edge in arc[4:]:
                at.setdefault(edge, []).append(number)
        left, best, nearest = set(range(len(arcs))), None, np.inf
        while left:
            number = left.pop()
            loop, edge, closed = [(arcs[number], False)], arcs[number][5], False
            while True:
                following = [n for n in at[edge] if n in left]
                if not following:
                    closed = edge == loop[0][0][4]
                    break
                number = following[0]
                left.discard(number)
                turned = arcs[number][5] == edge
                loop.append((arcs[number], turned))
                edge = arcs[number][4] if turned else arcs[number][5]
            if not closed or len(loop) < 3:
                continue
            corners = np.array([arc[3 if turned else 2][:3] for arc, turned in loop])
            away = float(np.linalg.norm(corners.mean(axis=0) - centre))
            if away < nearest:
                area = np.sum(np.cross(corners, np.roll(corners, -1, axis=0)) @ axis)
                best, nearest = [(a, not t) for a, t in loop[::-1]] if area < 0 else loop, away
        return best

    def _sampled(self, loops: Any, centres: Array, axes: Array) -> Outlines:
        flat = [(k, arc, turned) for k, loop in enumerate(loops) for arc, turned in loop]
        curve = np.array([k for k, *_ in flat], dtype=np.int64)
        nodes = (leggauss(self._points)[0] + 1) / 2
        values = np.zeros((len(flat), self._points, 12))
        for kind, faces in enumerate(self._faces):
            mine = np.array([n for n, (_, arc, _) in enumerate(flat) if arc[0] == kind], dtype=np.int64)
            if not len(mine):
                continue
            ends = np.array([[flat[n][1][3 if flat[n][2] else 2][3:], flat[n][1][2 if flat[n][2] else 3][3:]]
                             for n in mine])  # fmt: skip
            chord = ends[:, 1] - ends[:, 0]
            points = ends[:, None, 0] + nodes[None, :, None] * chord[:, None]
            lengths = np.maximum(np.linalg.norm(chord, axis=1), 1e-300)
            aside = np.stack([-chord[:, 1], chord[:, 0]], axis=1) / lengths[:, None]
            elements = np.repeat([flat[n][1][1] for n in mine], self._points)
            points, sides = points.reshape(-1, 2), np.repeat(aside, self._points, axis=0)
            c, axis = (np.repeat(part[curve[mine]], self._points, axis=0) for part in (centres, axes))
            for _ in range(NEWTON):
                off = np.einsum("pc,pc->p", faces.values(elements, points)[:, :3] - c, axis)
                slope = sum(sides[:, i] * np.einsum("pc,pc->p", faces.values(elements, points, i)[:, :3], axis)
                            for i in range(2))  # fmt: skip
                points = points - np.divide(off, slope, out=np.zeros_like(off), where=slope != 0)[:, None] * sides
            normal = np.cross(*(faces.values(elements, points, i)[:, :3] for i in range(2)))
            values[mine] = np.hstack([faces.values(elements, points), normal]).reshape(len(mine), self._points, 12)
        place, velocity, shear, normal = np.split(values, 4, axis=2)
        return Outlines(curve, place, velocity, shear, normal, len(loops))

    def local_flows(self, inflow: float) -> Array:
        """Return the flow (m3/s) through each station, from the inflow and the rates of area before it."""
        from scipy.interpolate import CubicSpline

        return np.asarray(inflow - CubicSpline(self.heights, self.area_rates).antiderivative()(self.heights))

    def mean_over_wall(self, values: Array) -> float:
        """Return the mean of a quantity of each section, weighted by the perimeter."""
        from scipy.integrate import trapezoid

        whole = trapezoid(self.perimeters, self.heights)
        return float(trapezoid(values * self.perimeters, self.heights) / whole)


def _cut(faces: Faces, kind: int, centres: Array, axes: Array, arcs: list[Any]) -> None:
    """Add to the arcs of each plane those on the elements of one shape: kind, element, both ends (x, y, z, s, t), and
    the mesh edges on which these lie, as numbers."""
    count, sides = len(faces.vertices), len(faces.corners)
    if not count:
        return
    every = np.arange(count)
    corners = np.stack([faces.values(every, np.tile(corner, (count, 1)))[:, :3] for corner in faces.corners], axis=1)
    heights = np.einsum("eic,pc->pei", corners, axes) - np.einsum("pc,pc->p", centres, axes)[:, None, None]
    above = heights >= 0
    crossed = above != np.roll(above, -1, axis=2)
    planes, elements, edges = np.nonzero(crossed)
    if not len(planes):
        return
    start, end = faces.corners[edges], faces.corners[(edges + 1) % sides]
    c, axis = centres[planes], axes[planes]

    def height(u: Array) -> Array:
        points = start + u[:, None] * (end - start)
        return np.einsum("pc,pc->p", faces.values(elements, points)[:, :3] - c, axis)

    low, high = np.zeros(len(planes)), np.ones(len(planes))
    begins = heights[planes, elements, edges] >= 0
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        same = (height(middle) >= 0) == begins
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    a, b = low, high
    fa, fb = height(a), height(b)
    for _ in range(NEWTON):  # secants between bounds
        u = np.where(fb != fa, a - fa * (b - a) / np.where(fb != fa, fb - fa, 1.0), a)
        u = np.clip(u, low, high)
        a, fa, b, fb = b, fb, u, height(u)
    points = start + b[:, None] * (end - start)
    ends = np.hstack([faces.values(elements, points)[:, :3], points])
    pair = np.sort(np.stack([faces.vertices[elements, edges], faces.vertices[elements, (edges + 1) % sides]], axis=1))
    names = pair[:, 0] << 32 | pair[:, 1]
    order = np.lexsort((edges, elements, planes))
    for first, second in zip(order[:-1], order[1:], strict=True):
        if (planes[first], elements[first]) == (planes[second], elements[second]):
            arcs[planes[first]].append((kind, int(elements[first]), ends[first], ends[second], int(names[first]),
                                        int(names[second])))  # fmt: skip
