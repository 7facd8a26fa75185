"""Closed outlines in a plane: periodic cubic splines through points, their arc length, area and nearest points.

SciPy's interpolation and Matplotlib take most of a second to import: a case without outlines need not wait for them.
"""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from ngfsi.arrays import Array, Mask, Waves
from ngfsi.config.columns import read_columns
from ngfsi.config.model import ConfigModel
from ngfsi.errors import GeometryError, NgfsiError
from ngfsi.units import Length, in_unit

GAUSS, WEIGHTS = (0.5 * values for values in np.polynomial.legendre.leggauss(6))
GAUSS = GAUSS + 0.5
OPEN = 8.0
"""A gap between the last and the first point this many times as long as the others means an open outline."""
NEWTON_STEPS = 8


class Outline(ConfigModel):
    """A closed curve through points, counter-clockwise: the periodic cubic spline by the length of the chords.

    Points may come in either sense, and the first may stand last again.
    """

    refusal: ClassVar[type[NgfsiError]] = GeometryError

    x: tuple[Length, ...] = Field(min_length=4, description="lateral positions of the points")
    y: tuple[Length, ...] = Field(min_length=4, description="anterior positions of the points")

    @classmethod
    def through(cls, points: Array) -> Self:
        """Return the outline through points (n, 2) [m]."""
        return cls(x=tuple(map(float, points[:, 0])), y=tuple(map(float, points[:, 1])))

    @classmethod
    def circle(cls, x: float, y: float, radius: float, points: int = 32) -> Self:
        """Return a circle [m]; with 32 points the spline's area is that of the circle to 1e-5."""
        angles = 2 * np.pi * np.arange(points) / points
        return cls.through(np.column_stack([x + radius * np.cos(angles), y + radius * np.sin(angles)]))

    @classmethod
    def from_csv(cls, path: Path) -> Self:
        """Return the outline through the points of a CSV file with columns `x_mm` and `y_mm` (or another length).

        Raises:
            OutputError: the file cannot be read.
            GeometryError: the points make no closed curve; names the file.
        """
        columns = read_columns(path, {"x": "length", "y": "length"})
        try:
            return cls.through(np.column_stack([columns["x"], columns["y"]]))
        except GeometryError as error:
            raise GeometryError(f"'{path}': {error}") from None

    @model_validator(mode="before")
    @classmethod
    def _in_order(cls, data: Any) -> Any:
        """Drop a first point that stands last again, and turn clockwise points round."""
        if not (isinstance(data, dict) and {"x", "y"} <= set(data)):
            return data
        x, y = (tuple(data[axis]) for axis in "xy")
        if len(x) != len(y) or len(x) < 2:
            return data
        if (x[0], y[0]) == (x[-1], y[-1]):
            x, y = x[:-1], y[:-1]
        if np.dot(x, np.roll(y, -1)) < np.dot(y, np.roll(x, -1)):
            x, y = x[::-1], y[::-1]
        return data | {"x": x, "y": y}

    @model_validator(mode="after")
    def _is_closed_and_simple(self) -> Self:
        if len(self.x) != len(self.y):
            raise ValueError(f"an outline needs as many x as y, not {len(self.x)} and {len(self.y)}")
        steps = np.hypot(*(np.roll(self.points, -1, axis=0) - self.points).T)
        if not np.all(steps > 0):
            raise ValueError(f"an outline has the same point twice, number {int(np.argmin(steps)) + 1} and the next")
        if steps[-1] > OPEN * np.max(steps[:-1]):
            gap = (
                f"{in_unit(steps[-1], 'mm', '.3g')} apart, {steps[-1] / np.median(steps):.0f} times the usual distance"
            )
            raise ValueError(f"the outline is open: its first and last point are {gap}; add the missing points")
        if crossing := _crossing(self.points):
            raise ValueError(f"the outline crosses itself between points {crossing[0]} and {crossing[1]}: mend them")
        return self

    @cached_property
    def points(self) -> Array:
        """The given points (n, 2) [m], counter-clockwise."""
        return np.column_stack([self.x, self.y])

    @cached_property
    def _spline(self) -> Any:
        from scipy.interpolate import CubicSpline

        closed = np.vstack([self.points, self.points[:1]])
        return CubicSpline(np.r_[0.0, np.cumsum(np.hypot(*np.diff(closed, axis=0).T))], closed, bc_type="periodic")

    @cached_property
    def _arc(self) -> tuple[Array, Array]:
        """Parameters of the spline and arc lengths there, four to a piece."""
        knots = self._spline.x
        fine = np.r_[(knots[:-1, None] + np.diff(knots)[:, None] * np.arange(4) / 4).ravel(), knots[-1]]
        speed = np.linalg.norm(self._spline(fine[:-1, None] + np.diff(fine)[:, None] * GAUSS, 1), axis=-1)
        return fine, np.r_[0.0, np.cumsum(np.diff(fine) * (speed @ WEIGHTS))]

    @property
    def length(self) -> float:
        """Arc length [m]."""
        return float(self._arc[1][-1])

    def _integral(self, integrand: Any) -> Any:
        """Return the integral of a function of position and tangent (m, 2) over the spline's parameter."""
        fine, _ = self._arc
        at, h = (fine[:-1, None] + np.diff(fine)[:, None] * GAUSS).ravel(), np.diff(fine)
        values = integrand(self._spline(at), self._spline(at, 1))
        return np.tensordot((h[:, None] * WEIGHTS).ravel(), values, axes=(0, 0))

    @property
    def area(self) -> float:
        """Enclosed area [m2]."""
        return float(self._integral(lambda p, t: (p[:, 0] * t[:, 1] - p[:, 1] * t[:, 0]) / 2))

    @property
    def centroid(self) -> Array:
        """Centroid (2,) of the enclosed area [m]."""
        moments = self._integral(lambda p, t: np.column_stack([p[:, 0] ** 2 * t[:, 1], -(p[:, 1] ** 2) * t[:, 0]]) / 2)
        return np.asarray(moments / self.area)

    def harmonics(self, centre: tuple[float, float], modes: int) -> Waves:
        """Return the Fourier coefficients 0..modes [m2] of the squared distance from a centre over the angle around it.

        Where a ray meets the curve several times, what it passes inside counts: 2 pi c_n is the integral of
        exp(-i n angle) (x dy - y dx) along the curve, so that pi c_0 is the area for every curve and centre.
        """
        z = complex(*centre)

        def moments(p: Array, t: Array) -> Waves:
            away = p[:, 0] + 1j * p[:, 1] - z
            sweep = away.real * t[:, 1] - away.imag * t[:, 0]
            turned: Waves = (away.conj() / np.abs(away))[:, None] ** np.arange(modes + 1)
            return np.asarray(sweep[:, None] * turned)

        return np.asarray(self._integral(moments) / (2 * np.pi))

    def at(self, arc: Array) -> Array:
        """Return the points (n, 2) [m] at arc lengths (n,) [m] from the first point, taken modulo the length."""
        return np.asarray(self._spline(self._parameter(np.asarray(arc))))

    def _parameter(self, arc: Array) -> Array:
        from scipy.interpolate import PchipInterpolator

        fine, lengths = self._arc
        return np.asarray(PchipInterpolator(lengths, fine)(np.mod(arc, self.length)))

    def resampled(self, count: int) -> Array:
        """Return points (count, 2) [m] at equal arc lengths."""
        return self.at(self.length * np.arange(count) / count)

    def nearest(self, points: Array) -> Array:
        """Return the arc lengths (n,) [m] of the points of the curve nearest to points (n, 2) [m]."""
        from scipy.interpolate import CubicSpline
        from scipy.spatial import cKDTree

        fine, lengths = self._arc
        near = self._spline(fine[:-1])
        start = cKDTree(near).query(points)[1]
        t, reach = fine[start], np.max(np.diff(fine))
        period = fine[-1]
        for _ in range(NEWTON_STEPS):
            offset, tangent, bend = self._spline(t) - points, self._spline(t, 1), self._spline(t, 2)
            slope = np.sum(tangent**2, axis=1) + np.sum(offset * bend, axis=1)
            step = np.sum(offset * tangent, axis=1) / np.maximum(slope, 0.1 * np.sum(tangent**2, axis=1))
            t = np.mod(t - np.clip(step, -reach, reach), period)
        return np.asarray(CubicSpline(fine, lengths)(t))

    def offset(self, distance: float) -> Outline:
        """Return the curve at a distance [m] outside (negative: inside), through shifted points.

        Raises:
            GeometryError: the curve is bent too sharply for that.
        """
        at = self._spline.x[:-1]
        tangent = self._spline(at, 1)
        outward = np.column_stack([tangent[:, 1], -tangent[:, 0]]) / np.linalg.norm(tangent, axis=1)[:, None]
        return Outline.through(self.points + distance * outward)

    def contains(self, points: Array) -> Mask:
        """Return which of points (..., 2) [m] lie inside the curve, sampled at 4 points to a piece."""
        from matplotlib.path import Path as Polygon

        inside = Polygon(self._spline(self._arc[0])).contains_points(points.reshape(-1, 2))
        return np.asarray(inside.reshape(points.shape[:-1]))

    def distance_to(self, other: Outline) -> float:
        """Return the smallest distance [m] between points of this curve and the other."""
        ring = self._spline(self._arc[0][:-1])
        return float(np.min(np.linalg.norm(other.at(other.nearest(ring)) - ring, axis=1)))


def polygon_area(ring: Array) -> float:
    """Return the area inside a closed polygon (n, 2) by the shoelace formula; a first point may stand last again."""
    x, y = ring.T
    return float(abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))) / 2)


def distances(one: Array, other: Array) -> Array:
    """Return the distances [m] of the points of two curves from the nearest points of the other."""
    from scipy.spatial import cKDTree

    return np.asarray(np.r_[cKDTree(other).query(one)[0], cKDTree(one).query(other)[0]])


def dense(line: Array, step: float) -> Array:
    """Return points (n, 2) [m] along a line at distances of at most `step` [m]."""
    arc = np.r_[0.0, np.cumsum(np.hypot(*np.diff(line, axis=0).T))]
    at = np.linspace(0, arc[-1], 1 + int(np.ceil(arc[-1] / step)))
    return np.column_stack([np.interp(at, arc, part) for part in line.T])


def closed(ring: Array) -> Array:
    """Return points (n + 1, 2) of a ring (n, 2) whose first one stands last again."""
    return np.asarray(np.vstack([ring, ring[:1]]))


def _crossing(points: Array) -> tuple[int, int] | None:
    """Return the numbers (from 1) of two sides of a closed polygon that cross each other, or None."""
    a, b = points, np.roll(points, -1, axis=0)

    def side(p: Array, q: Array, r: Array) -> Array:
        return np.asarray((q[..., 0] - p[..., 0]) * (r[..., 1] - p[..., 1])
                          - (q[..., 1] - p[..., 1]) * (r[..., 0] - p[..., 0]))  # fmt: skip

    count = len(points)
    for i in range(count - 2):
        j = np.arange(i + 2, count - (i == 0))
        apart = side(a[i], b[i], a[j]) * side(a[i], b[i], b[j]) < 0
        hit = j[apart & (side(a[j], b[j], a[i]) * side(a[j], b[j], b[i]) < 0)]
        if len(hit):
            return i + 1, int(hit[0]) + 1
    return None
