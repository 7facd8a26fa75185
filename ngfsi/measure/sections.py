"""Cross-sections of the deformed lumen at stations along the vein, and the flow through them.

SciPy is loaded when there is something to measure: half a second, for which a refused case need not wait.
"""

from __future__ import annotations

from typing import Any

import ngsolve as ng
import numpy as np
from numpy.typing import NDArray

from ngfsi.mesh.geometry import Vein, Vessel
from ngfsi.system.system import System

Array = NDArray[np.float64]

STATIONS = 11
PLANE_ITERATIONS = 6
OBLIQUE_ITERATIONS = 12
"""Each leaves the share of the distance by which material is stretched along the vein, or the vein runs obliquely."""


class Sections:
    """Outlines of the lumen in planes z = const of the deformed vein, by default evenly spaced from inlet to outlet.

    An outline is the curve of the discrete wall itself: arcs from element to element, each known at Gauss points, so
    that areas integrate to the volume of the discrete lumen.

    Attributes:
        heights: (stations,) m
        arcs: of which each outline is made.
        rings: (stations, points, 3) m
        areas, area_rates, perimeters: (stations,) m2, m2/s, m
        shears: (stations,) wall shear stress, mean over the outline, Pa; of `shear` in `refresh`.
    """

    def __init__(self, system: System, vessel: Vessel, count: int = STATIONS) -> None:
        self.system = system
        self.vein: Vein = system.case.geometry
        self.vessel, self.length = vessel, self.vein.length
        self.heights = np.linspace(0.0, self.vein.length, count)
        fields = system.fields()
        self._values = ng.CF((ng.CF((ng.x, ng.y, ng.z)) + fields.motion, fields.velocity))
        corners = _corners(system)
        self.arcs = Arcs(len(corners), system.unknowns.order + 2)
        outline = self.arcs.between(corners)
        shape = (len(self.heights), len(outline))
        self._x, self._y = (np.broadcast_to(outline[:, i], shape) for i in range(2))
        self.rings = np.zeros((*shape, 3))
        self.areas, self.area_rates, self.perimeters, self.shears = np.zeros((4, len(self.heights)))

    def refresh(self, shear: ng.CoefficientFunction | None = None) -> None:
        """Take the system's present state.

        Args:
            shear: wall shear stress (Pa), a field that can be evaluated on the interface.
        """
        plane = self.heights[:, None]
        z = np.broadcast_to(plane, self._x.shape).copy()
        length = self.vein.length
        # which material point of the wall lies in the plane now? Axial displacements are small: a fixed point finds it
        for _ in range(PLANE_ITERATIONS):
            values = self._evaluate(self._values, z)
            z = np.clip(z + plane - values[..., 2], 0.0, length)
        values = self._evaluate(self._values, z)
        self.rings, velocity = values[..., :3], values[..., 3:]
        tangent, rate_tangent = self.arcs.derivative(self.rings), self.arcs.derivative(velocity)
        self.areas = self._enclosed(self.rings, tangent)
        self.area_rates = self._enclosed(velocity, tangent) + self._enclosed(self.rings, rate_tangent)
        lengths = np.linalg.norm(tangent[..., :2], axis=2)
        self.perimeters = self.arcs.integral(lengths)
        if shear is not None:
            sizes = np.linalg.norm(self._evaluate(shear, z), axis=2)
            self.shears = self.arcs.integral(sizes * lengths) / self.perimeters

    @property
    def blood(self) -> Array:
        """Pressure of the blood on the axis at each station (Pa)."""
        x, y = np.broadcast_to(np.array(self.vein.vein_centre)[:, None], (2, len(self.heights)))
        return np.asarray(
            self.system.blood_pressure(self.vessel.name)(self.system.domain.mesh(x, y, self.heights))
        ).ravel()

    def across(self, stations: NDArray[np.int64], centre: Array, axis: Array) -> Array:
        """Return outlines in any planes, as far as the material reaches.

        Args:
            stations: numbers of the outlines from which the search begins.
            centre, axis: (stations, 3) a point of each plane (m) and its unit normal.

        Returns:
            (stations, points, 3) m
        """
        z = np.broadcast_to(self.heights[stations, None], (len(stations), self._x.shape[1])).copy()
        for _ in range(OBLIQUE_ITERATIONS):
            ring = self._evaluate(self._values, z, stations)[..., :3]
            distance = np.einsum("spk,sk->sp", ring - centre[:, None], axis)
            z = np.clip(z - distance, 0.0, self.vein.length)
        return self._evaluate(self._values, z, stations)[..., :3]

    def local_flows(self, inflow: float) -> Array:
        """Return the flow (m3/s) through each station, from the inflow and the rates of area before it."""
        from scipy.interpolate import CubicSpline

        return np.asarray(inflow - CubicSpline(self.heights, self.area_rates).antiderivative()(self.heights))

    def mean_over_wall(self, values: Array) -> float:
        """Return the mean of a quantity of each section, weighted by the perimeter."""
        from scipy.integrate import trapezoid

        return float(trapezoid(values * self.perimeters) / trapezoid(self.perimeters))

    def _enclosed(self, ring: Array, tangent: Array) -> Array:
        """Half the integral of x dy - y dx: the enclosed area for a ring and its own tangent."""
        return self.arcs.integral(ring[..., 0] * tangent[..., 1] - ring[..., 1] * tangent[..., 0]) / 2

    def _evaluate(self, field: ng.CoefficientFunction, z: Array, stations: Any = slice(None)) -> Array:
        x, y = self._x[stations].ravel(), self._y[stations].ravel()
        values = np.asarray(field(self.system.domain.mesh(x, y, z.ravel())))
        return values.reshape(*z.shape, -1)


class Arcs:
    """Closed curves of smooth arcs between corners, each sampled at Gauss points of its parameter from 0 to 1."""

    def __init__(self, count: int, points: int) -> None:
        self._count, self._points = count, points
        nodes, weights = np.polynomial.legendre.leggauss(points)
        self._nodes, self._weights = (nodes + 1) / 2, weights / 2
        powers = np.vander(self._nodes, increasing=True)
        slopes = np.hstack([np.zeros((points, 1)), powers[:, :-1] * np.arange(1, points)])
        self._slope = slopes @ np.linalg.inv(powers)

    def between(self, corners: Array) -> Array:
        """Return the sampled points (points, dim) on the chords of a polygon (count, dim)."""
        after = np.roll(corners, -1, axis=0)
        share = self._nodes[None, :, None]
        return np.asarray(((1 - share) * corners[:, None] + share * after[:, None]).reshape(-1, corners.shape[1]))

    def derivative(self, curves: Array) -> Array:
        """Return the derivative of curves (curves, points, dim) by the parameter of each arc."""
        arcs = curves.reshape(len(curves), self._count, self._points, -1)
        return np.asarray(np.einsum("ij,cajd->caid", self._slope, arcs).reshape(curves.shape))

    def integral(self, values: Array) -> Array:
        """Return the integrals of values (curves, points) over the parameters of all arcs."""
        return np.asarray(np.sum(values.reshape(len(values), self._count, self._points) @ self._weights, axis=1))


def _corners(system: System) -> Array:
    """Return the corners (n, 2) of the straight mesh's lumen, in order around it: those of the inlet's rim."""
    domain = system.domain
    on = [{v for e in domain.boundaries(name).Elements() for v in e.vertices} for name in ("interface", "inlet")]
    points = np.array([domain.mesh[v].point[:2] for v in on[0] & on[1]])
    around = points - points.mean(axis=0)
    return np.asarray(points[np.argsort(np.arctan2(around[:, 1], around[:, 0]))])
