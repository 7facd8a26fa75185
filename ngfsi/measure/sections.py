"""Cross-sections of the deformed lumen at stations along a vessel, and the flow through them.

SciPy is loaded when there is something to measure: half a second, for which a refused case need not wait.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import netgen.meshing as nm
import ngsolve as ng
import numpy as np

from ngfsi.arrays import Array
from ngfsi.mesh.centreline import Centreline
from ngfsi.mesh.geometry import Vessel
from ngfsi.mesh.surface import Outlines, Surface, gauss
from ngfsi.system.system import System
from ngfsi.system.together import OnAllRanks, together

STATIONS = 11
RING_POINTS = 96
IN_PLANE = 1e-3
"""Largest distance of an outline from its plane, as a fraction of the lumen's radius, that is none."""
INWARDS = 1e-10
"""Fraction of the length by which planes stand nearer to its middle: not in the faces of elements."""


class Sections(OnAllRanks):
    """Outlines of the lumen in planes perpendicular to the centreline, which are fixed in space, by default evenly
    spaced from inlet to outlet.

    An outline is the curve of the discrete wall itself: arcs from element to element, each known at Gauss points, so
    that areas integrate to the volume of the discrete lumen. Where the lumen's end has left a plane, its rim stands for
    the outline.

    Attributes:
        stations: (stations,) arc length along the centreline, m.
        outlines: of the present state.
        whole: (stations,) whether the outline is that of a section in the plane.
        missing: (stations,) whether planes are known to cut no section, as in a fork; the ends are taken as they are.
        points: (arcs, points, 3) at the outlines' Gauss points, m.
        areas, area_rates, perimeters: (stations,) m2, m2/s, m; a rate is that in the fixed plane.
        shears: (stations,) wall shear stress, mean over the outline, Pa; of `shear` in `refresh`.
    """

    def __init__(self, system: System, vessel: Vessel, line: Centreline, stations: Array | None = None) -> None:
        """Prepare.

        Args:
            line: of the vessel.
            stations: m, default: `STATIONS`, evenly spaced.
        """
        super().__init__(system)
        self.vessel, self.line = vessel, line
        self.stations = self.line.stations(STATIONS) if stations is None else stations
        fields = system.fields()
        order = system.unknowns.order
        degree = max(order, system.domain.geometry.curving_order)
        self._surface = Surface(system.domain.mesh, system.domain.boundaries(self.vessel.interface), degree)
        self._state = ng.CF((ng.CF((ng.x, ng.y, ng.z)) + fields.motion, fields.velocity))
        self._arc_points = order + 2
        shift = INWARDS * self.line.length
        inside = self.stations + np.where(self.stations > self.line.length / 2, -shift, shift)
        self.centres, self.normals = self.line.points(inside), self.line.tangents(inside)
        self._blood: Array | None = None
        self._between = (self.stations > 0) & (self.stations < self.line.length)
        self.missing = np.zeros(len(self.stations), dtype=bool)
        self.areas, self.area_rates, self.perimeters, self.shears = np.zeros((4, len(self.stations)))

    def refresh(self, shear: ng.CoefficientFunction | None = None) -> None:
        """Take the system's present state.

        Args:
            shear: wall shear stress (Pa), a field of polynomials on the interface.
        """
        self._blood = None
        surface = self._surface
        state, self.outlines = self._cut()
        self._place = state[..., :3]
        values = surface.values(state, self.outlines)
        self.points, velocity = values[..., :3], values[..., 3:]
        tangent, normal = self.outlines.derivative(self.points), self.outlines.spread(self.normals)
        self.areas = self.outlines.enclosed(self.points - self.outlines.spread(self.centres), tangent)
        self.area_rates = self.outlines.integral(np.sum(velocity * self._outward(tangent, normal), axis=2))
        lengths = np.linalg.norm(tangent - np.sum(tangent * normal, axis=2)[..., None] * normal, axis=2)
        self.perimeters = self.outlines.integral(lengths)
        off = np.abs(np.sum((self.points - self.outlines.spread(self.centres)) * normal, axis=2)).max(axis=1)
        strays = self.outlines.station[off > IN_PLANE * self.vessel.radius]
        there, away = (np.bincount(of, minlength=len(self.stations)) > 0 for of in (self.outlines.station, strays))
        self.whole = there & ~away & ~(self.missing & self._between)
        if self.vessel.branched:
            for values in (self.areas, self.area_rates, self.perimeters):
                values[self._between & ~self.whole] = np.nan
        if shear is not None:
            sizes = np.linalg.norm(surface.values(surface.coefficients(shear), self.outlines), axis=2)
            self.shears = self.outlines.integral(sizes * lengths) / self.perimeters

    @together
    def _cut(self) -> tuple[Array, Outlines]:
        """Return the coefficients of the state, and the outlines at all stations, of which each rank finds some."""
        ranks, state = self.system.ranks, self._surface.coefficients(self._state)
        mine = np.arange(ranks.rank, len(self.stations), ranks.size)
        found = None
        if len(mine):
            found = self._surface.cut(state[..., :3], self.centres[mine], self.normals[mine], self._arc_points)
        parts = [part for part in ranks.gather(found) if part]
        return state, parts[0] if len(parts) == 1 else Outlines.interlaced(parts)

    def _outward(self, tangent: Array, normal: Array) -> Array:
        """Return vectors (arcs, points, 3) whose product with the velocity is the rate at which outlines sweep area,
        per parameter of the arc.

        Material that moves along the plane's normal takes the outline along the wall: with the wall's normal w and the
        outward one n in the plane, the outline moves by v . w / (n . w). A rim goes with its material.
        """
        outward = np.cross(tangent, normal)
        wall = self._surface.normals(self._place, self.outlines)
        whole = self.outlines.whole[self.outlines.station, None] & (np.sum(tangent**2, axis=2) > 0)
        along = np.sum(outward * wall, axis=2)
        swept = wall * (np.sum(outward**2, axis=2) / np.where(whole, along, 1.0))[..., None]
        return np.asarray(np.where(whole[..., None], swept, outward))

    def area_slopes(self, space: Any) -> Array:
        """Return the derivative of the sum of the areas by the unknowns of the motion, of whose space they are."""
        tangent, normal = self.outlines.derivative(self.points), self.outlines.spread(self.normals)
        weights = gauss(self.points.shape[1]).weights[:, None]
        return self._surface.transposed(weights * self._outward(tangent, normal), self.outlines, space)

    @property
    def blood(self) -> Array:
        """Pressure of the blood on the centreline at each station, of the reference shape (Pa)."""
        if self._blood is None:
            pressure = self.system.blood_pressure(self.vessel.name)
            self._blood = np.asarray(pressure(self.system.domain.mesh(*self._on_line.T))).ravel()
        return self._blood

    @cached_property
    def _on_line(self) -> Array:
        """Where the stations lie in the straight mesh."""
        places, domain = self.line.points(self.stations), self.system.domain
        try:
            return domain.on_straight_mesh(places)
        except nm.NgException:  # the line leaves the straight mesh of a strongly curved shape, or its ends by rounding
            margin = 1e-6 * self.line.length
            return domain.on_straight_mesh(self.line.points(np.clip(self.stations, margin, self.line.length - margin)))

    @property
    def rings(self) -> Array:
        """Points (stations, RING_POINTS, 3) at even lengths around each outline, m; NaN where there is no section."""
        rings = self.outlines.rings(self.points, RING_POINTS)
        rings[np.isnan(self.areas)] = np.nan
        return rings

    def across(self, centres: Array, normals: Array) -> tuple[Outlines, Array]:
        """Return outlines in any planes, as far as the material reaches, and their points (arcs, points, 3) [m].

        Args:
            centres, normals: (stations, 3) a point of each plane [m] and its unit normal.
        """
        outlines = self._surface.cut(self._place, centres, normals, self._arc_points)
        return outlines, self._surface.values(self._place, outlines)

    def in_reference(self) -> tuple[Outlines, Array]:
        """Return the outlines of the reference shape, and their points (arcs, points, 3) [m]."""
        place = self._surface.coefficients(ng.CF((ng.x, ng.y, ng.z)))
        outlines = self._surface.cut(place, self.centres, self.normals, self._arc_points)
        return outlines, self._surface.values(place, outlines)

    def local_flows(self, inflow: float) -> Array:
        """Return the flow (m3/s) through each station, from the inflow and the rates of area before it."""
        from scipy.interpolate import CubicSpline

        return np.asarray(inflow - CubicSpline(self.stations, self.area_rates).antiderivative()(self.stations))

    def mean_over_wall(self, values: Array) -> float:
        """Return the mean of a quantity of each section, weighted by the perimeter."""
        from scipy.integrate import trapezoid

        return float(trapezoid(values * self.perimeters, self.stations) / trapezoid(self.perimeters, self.stations))
