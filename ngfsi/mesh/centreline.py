"""The line through the middle of a vessel: given by its geometry, or found from the mesh of its lumen."""

from __future__ import annotations

from typing import Any

import netgen.meshing as nm
import ngsolve as ng
import numpy as np

from ngfsi.arrays import Array
from ngfsi.errors import MeshError
from ngfsi.mesh.domain import Domain
from ngfsi.mesh.geometry import Vessel
from ngfsi.mesh.surface import Surface

REFITS = 4
"""Of a spline to its own arc length."""
PIECES = 16
"""Between two knots, each integrated by two Gauss points."""
SEARCH = 200
"""Points of a curve among which the nearest begins the search for the foot of a perpendicular."""
FEET = 20
"""Steps of that search."""
CENTRINGS = 4
LEVELS = 10
"""Of the potential, between each two of which there is one point of the first guess."""
FEWEST, MOST = 12, 240
SECTIONS_PER_RADIUS = 3
"""Through whose centroids a line is laid, within these bounds."""
SECTIONS_PER_PIECE = 2
"""Of the smooth line."""
WINDOW, POWER = 2.5, 8
"""A section that is wider than another within so many radii belongs to a fork: the ratio of areas is its weight, to
this power."""
MAPPED, INSIDE, STRAIGHT = 33, 1e-9, 1e-6
"""Points of a given line that are looked up in a reference shape, the first and the last of them by a fraction of the
length inside of the mesh; closer to a straight line than that fraction it is one."""
LOOKED_UP = 40
"""Points of a line that must lie in the blood."""
HOLD = 100.0
"""Weight of both ends of a line, against 1 of each section."""


class Centreline:
    """A smooth curve through points, with its arc length as parameter: a straight line or a cubic spline.

    Attributes:
        length: m
    """

    def __init__(self, points: Any) -> None:
        """Prepare.

        Args:
            points: (n, 3) [m], two or more.
        """
        from scipy.interpolate import CubicSpline

        given = np.asarray(points, dtype=float)
        at = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(given, axis=0), axis=1))])
        nodes = np.concatenate([(np.arange(PIECES) + at) / PIECES for at in (0.5 - 12**-0.5, 0.5 + 12**-0.5)])
        self._curve: Any = None
        for _ in range(REFITS if len(given) > 2 else 0):
            self._curve = CubicSpline(at, given)
            steps = np.diff(at)
            speeds = np.linalg.norm(self._curve(at[:-1, None] + steps[:, None] * nodes, 1), axis=2)
            at = np.concatenate([[0.0], np.cumsum(steps * speeds.mean(axis=1))])
        self.length = float(at[-1] if self._curve is None else self._curve.x[-1])
        self._start, self._way = given[0], (given[-1] - given[0]) / self.length

    @property
    def straight(self) -> bool:
        """Whether it is a straight line."""
        return self._curve is None

    def points(self, at: Array) -> Array:
        """Return the points (n, 3) [m] at arc lengths (n,) [m]."""
        if self._curve is None:
            return np.asarray(self._start + np.asarray(at)[:, None] * self._way)
        return np.asarray(self._curve(at))

    def tangents(self, at: Array) -> Array:
        """Return the unit tangents (n, 3) at arc lengths (n,) [m]."""
        if self._curve is None:
            return np.tile(self._way, (len(at), 1))
        slopes = np.asarray(self._curve(at, 1))
        return np.asarray(slopes / np.linalg.norm(slopes, axis=1)[:, None])

    def coordinate(self, points: Array) -> Array:
        """Return the arc lengths (n,) [m] of the points of the curve that are nearest to points (n, 3) [m]."""
        if self._curve is None:
            return np.asarray(np.clip((points - self._start) @ self._way, 0.0, self.length))
        from scipy.spatial import cKDTree

        coarse = np.linspace(0.0, self.length, SEARCH)
        at = coarse[cKDTree(self.points(coarse)).query(points)[1]]
        for _ in range(FEET):
            at = np.clip(at + np.sum((points - self.points(at)) * self.tangents(at), axis=1), 0.0, self.length)
        return np.asarray(at)

    def stations(self, number: int) -> Array:
        """Return arc lengths (number,) [m] evenly from the first to the last."""
        return np.linspace(0.0, self.length, number)


def find_centrelines(domain: Domain, vessel: Vessel) -> tuple[Centreline, ...]:
    """Return the centrelines of a vessel: from its first inlet to each outlet, and from each further inlet to the first
    outlet. The first is the geometry's own, if it has one.

    Others are found in the reference shape: through the middle of the flow of a potential from end to end, which does
    not enter other branches, and then, a few times, through the centroids of the line's own sections.

    Raises:
        MeshError: the vessel has no lumen to find a line in, or a line as it is found leaves the blood.
    """
    ends = [(vessel.inlets[0], end) for end in vessel.outlets] + [(end, vessel.outlets[0]) for end in vessel.inlets[1:]]
    given = [] if vessel.centreline is None else [_given(domain, vessel.centreline)]
    found = [_found(domain, vessel, *pair) for pair in ends[len(given) :]]
    for name, line in zip(vessel.branches[len(given) :], found, strict=True):
        _check(domain, name, line)
    return *given, *found


def direction(domain: Domain, vessel: Vessel, lines: tuple[Centreline, ...]) -> Any:
    """Return the direction of the nearest centreline as a field on a vessel's interface, of unit length at vertices."""
    vertices = domain.vertices_on(vessel.interface)
    points = domain.vertices[vertices]
    feet = [line.coordinate(points) for line in lines]
    away = [np.linalg.norm(points - line.points(at), axis=1) for line, at in zip(lines, feet, strict=True)]
    ways = np.array([line.tangents(at) for line, at in zip(lines, feet, strict=True)])
    found = ng.GridFunction(ng.VectorH1(domain.mesh, order=1))
    for component, values in zip(
        found.components, ways[np.argmin(away, axis=0), np.arange(len(points))].T, strict=True
    ):
        component.vec.FV().NumPy()[vertices] = values
    return found


def _check(domain: Domain, name: str, line: Centreline) -> None:
    """Refuse a line that leaves the blood: nothing could be measured along it."""
    try:
        domain.on_straight_mesh(line.points(line.length * np.linspace(0.02, 0.98, LOOKED_UP)))
    except nm.NgException:
        raise MeshError(
            f"the centreline {f'of {name}' if name else 'of the vessel'}, as it is found in the mesh, leaves the "
            "blood: at a fork with a sharp angle make the mesh finer, or cut the branch further from it"
        ) from None


def _given(domain: Domain, points: Any) -> Centreline:
    """Return the line through points of the straight mesh in the reference shape."""
    line = Centreline(points)
    if domain.geometry.shape_map() is None:
        return line
    at = np.clip(line.stations(MAPPED), INSIDE * line.length, (1 - INSIDE) * line.length)
    places = np.asarray(ng.CF((ng.x, ng.y, ng.z))(domain.mesh(*line.points(at).T)))
    straight = Centreline(places[[0, -1]])
    bent = np.linalg.norm(places - straight.points(straight.coordinate(places)), axis=1).max() > STRAIGHT * line.length
    return Centreline(places) if bent else straight


def _found(domain: Domain, vessel: Vessel, inlet: str, outlet: str) -> Centreline:
    if vessel.lumen is None:
        raise MeshError(
            f"the vessel '{vessel.name}' is a hole: give its geometry a centreline, which is found in blood"
        )
    first, last = (domain.centroid(name) for name in (inlet, outlet))
    radius = np.sqrt(domain.area(inlet) / np.pi)
    middles = _middles(domain, vessel.lumen, inlet, outlet)
    places = np.vstack([first, middles, last])
    line = Centreline(_smooth(places, _along(places), np.array([HOLD, *(1.0 for _ in middles), HOLD])))
    surface = Surface(domain.mesh, domain.boundaries(vessel.interface), domain.geometry.curving_order)
    place = surface.coefficients(ng.CF((ng.x, ng.y, ng.z)))
    for _ in range(CENTRINGS):
        number = int(np.clip(SECTIONS_PER_RADIUS * line.length / radius, FEWEST, MOST))
        at = line.length * (np.arange(number) + 0.5) / number
        cut = surface.cut(place, line.points(at), line.tangents(at), domain.geometry.curving_order + 2)
        points = surface.values(place, cut)
        areas = np.where(cut.whole, cut.enclosed(points - cut.spread(line.points(at)), cut.derivative(points)), np.inf)
        window = np.abs(at[:, None] - at) < WINDOW * radius
        smallest = np.where(window, areas, np.inf).min(axis=1)
        middles, weights = cut.centroids(points)[cut.whole], (smallest[cut.whole] / areas[cut.whole]) ** POWER
        at = np.concatenate([[0.0], at[cut.whole], [line.length]])
        line = Centreline(_smooth(np.vstack([first, middles, last]), at, np.concatenate([[HOLD], weights, [HOLD]])))
    return line


def _middles(domain: Domain, lumen: str, inlet: str, outlet: str) -> Array:
    """Return points (n, 3) [m] in the middle of the flow of a potential, in its direction."""
    mesh, dx = domain.mesh, domain.dx(lumen)
    space = ng.H1(mesh, order=2, definedon=domain.materials(lumen), dirichlet=f"{inlet}|{outlet}")
    trial, test = space.TnT()
    form = ng.BilinearForm(ng.Grad(trial) * ng.Grad(test) * dx, symmetric=True).Assemble()
    potential = ng.GridFunction(space)
    potential.Set(1.0, definedon=domain.boundaries(outlet))
    inverse = form.mat.Inverse(space.FreeDofs(), inverse="sparsecholesky")
    potential.vec.data -= inverse @ form.mat * potential.vec
    power = ng.Grad(potential) * ng.Grad(potential)
    region = domain.materials(lumen)
    sums = np.stack(
        [
            np.array(ng.Integrate(field * power, mesh, element_wise=True, definedon=region))
            for field in (ng.CF(1.0), potential, ng.x, ng.y, ng.z)
        ],
        axis=1,
    )[[element.nr for element in region.Elements()]]
    level = np.minimum((sums[:, 1] / sums[:, 0] * LEVELS).astype(int), LEVELS - 1)
    total = np.zeros((LEVELS, 5))
    np.add.at(total, level, sums)
    total = total[total[:, 0] > 0]
    return np.asarray(total[:, 2:] / total[:, :1])


def _along(points: Array) -> Array:
    """Return the length (n,) [m] of the broken line through points (n, 3) [m] up to each."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])


def _smooth(points: Array, at: Array, weights: Array) -> Array:
    """Return as many points near given ones, on the cubic spline of few pieces over arc lengths `at` (n,) [m] that
    fits them best; the ends stay."""
    from scipy.interpolate import make_lsq_spline

    pieces = max(1, int((len(points) - 1) / SECTIONS_PER_PIECE) - 2)
    degree = min(3, len(points) - 1)
    inner = np.quantile(at, np.linspace(0.0, 1.0, pieces + 1)[1:-1])
    knots = np.concatenate([np.full(degree + 1, at[0]), inner, np.full(degree + 1, at[-1])])
    smooth = make_lsq_spline(at, points, knots, degree, w=weights)(at)
    smooth[[0, -1]] = points[[0, -1]]
    return np.asarray(smooth)
