"""Cross-sections of the deformed lumen at stations along the vein, and the flow through them."""

from __future__ import annotations

import ngsolve as ng
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from ngfsi.domain import Vein
from ngfsi.solve.system import System

Array = NDArray[np.float64]

STATIONS = 11
POINTS = 96
PLANE_ITERATIONS = 3


class Sections:
    """Outlines of the lumen in planes z = const of the deformed vein, evenly spaced from inlet to outlet."""

    def __init__(self, system: System, stations: int = STATIONS, points: int = POINTS) -> None:
        self.system = system
        self.vein: Vein = system.case.geometry
        geometry = self.vein
        self.heights = np.linspace(0.0, geometry.length, stations)
        angles = 2 * np.pi * np.arange(points) / points
        x0, y0 = geometry.vein_centre
        fields = system.fields(system.state.components)
        self._values = ng.CF((ng.CF((ng.x, ng.y, ng.z)) + fields.motion, fields.velocity))
        ring = [x0 + geometry.lumen_radius * np.cos(angles), y0 + geometry.lumen_radius * np.sin(angles)]
        outline = [np.tile(line, (stations, 1)) for line in ring]
        on_wall = np.stack([*outline, np.broadcast_to(self.heights[:, None], outline[0].shape)], axis=-1)
        straight = system.domain.on_straight_mesh(on_wall.reshape(-1, 3)).reshape(on_wall.shape)
        self._x, self._y = straight[..., 0], straight[..., 1]
        self.rings = np.zeros((stations, points, 3))
        self.areas = np.zeros(stations)
        self.area_rates = np.zeros(stations)
        self.perimeters = np.zeros(stations)

    def refresh(self) -> None:
        """Take the system's present state."""
        plane = self.heights[:, None]
        z = np.broadcast_to(plane, self._x.shape).copy()
        length = self.vein.length
        # which material point of the wall lies in the plane now? Axial displacements are small: a fixed point finds it
        for _ in range(PLANE_ITERATIONS):
            values = self._evaluate(self._values, self._x, self._y, z)
            z = np.clip(z + plane - values[..., 2], 0.0, length)
        values = self._evaluate(self._values, self._x, self._y, z)
        self.rings, velocity = values[..., :3], values[..., 3:]
        tangent, rate_tangent = _derivative(self.rings), _derivative(velocity)
        self.areas = _enclosed(self.rings, tangent)
        self.area_rates = _enclosed(velocity, tangent) + _enclosed(self.rings, rate_tangent)
        self.perimeters = np.mean(np.hypot(tangent[..., 0], tangent[..., 1]), axis=1)

    def local_flows(self, inflow: float) -> Array:
        """Return the flow (m3/s) through each station, from the inflow and the rates of area before it."""
        return np.asarray(inflow - CubicSpline(self.heights, self.area_rates).antiderivative()(self.heights))

    def poiseuille_sawss(self, inflow: float, viscosity: float) -> float:
        """Return the SAWSS (Pa) of developed flow with the same area and flow in each section.

        tau = 4 mu Q / (pi R^3), R from the area, weighted by the perimeter.
        """
        radius = np.sqrt(self.areas / np.pi)
        shear = 4 * viscosity * np.abs(self.local_flows(inflow)) / (np.pi * radius**3)
        return float(np.trapezoid(shear * self.perimeters) / np.trapezoid(self.perimeters))

    def _evaluate(self, field: ng.CoefficientFunction, x: Array, y: Array, z: Array) -> Array:
        values = np.asarray(field(self.system.domain.mesh(x.ravel(), y.ravel(), z.ravel())))
        return values.reshape(*x.shape, -1)


def _derivative(ring: Array) -> Array:
    """Derivative along closed curves (stations, points, 3), by the parameter of period 1, through Fourier series."""
    count = ring.shape[1]
    wave = 2j * np.pi * np.fft.rfftfreq(count, 1 / count)
    wave[-1] = 0.0  # the highest mode of an even number of points has no derivative at them
    return np.fft.irfft(np.fft.rfft(ring, axis=1) * wave[None, :, None], count, axis=1)


def _enclosed(ring: Array, tangent: Array) -> Array:
    """Half the integral of x dy - y dx: the enclosed area for a ring and its own tangent."""
    return np.asarray(np.mean(ring[..., 0] * tangent[..., 1] - ring[..., 1] * tangent[..., 0], axis=1) / 2)
