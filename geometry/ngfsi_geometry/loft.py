"""Stacks of outlines as smooth surfaces: Fourier series around, splines along z.

A `Loft` is a series of the position in the arc length. A `StarLoft` is one of the squared distance from a smooth line
over the angle around it: a positive distance for each angle makes a curve that cannot cross itself, whatever is left
out of the series or averaged along z, and its area is the series' mean.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from math import pi
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_interp_spline, make_lsq_spline

from ngfsi.errors import GeometryError
from ngfsi.outlines.outline import Outline

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

SAMPLES = 128
DENSE = 8
"""Points of a curve for each one of that around it: a disc's arc between two of them is a part in 500 lower."""
DEGREE = 3
ROUNDING = 1e-9


def coefficients(outline: Outline, modes: int) -> Complex:
    """Return the Fourier coefficients -modes..modes of x + iy [m] in the arc length.

    It begins where the circle of the first harmonic lies nearest to the outline: where that has its angle 0.
    """
    points = outline.resampled(SAMPLES)
    found = np.fft.fft(points[:, 0] + 1j * points[:, 1]) / SAMPLES
    orders = np.arange(-modes, modes + 1)
    return np.asarray(found[orders] * np.exp(-1j * orders * np.angle(found[1])))


class Loft:
    """A surface around z: at each height a Fourier series of x + iy.

    Attributes:
        modes: highest order.
        start, end: heights [m] between which it lies.
    """

    def __init__(self, heights: Array, rows: Sequence[Complex]) -> None:
        """Join sections.

        Args:
            heights: (n,) m, increasing.
            rows: n coefficients of the sections, -modes..modes.
        """
        self.modes = len(rows[0]) // 2
        self.start, self.end = float(heights[0]), float(heights[-1])
        values = np.stack([[row.real, row.imag] for row in rows])
        self._splines = _splines(heights, values)

    def at(self, z: Array) -> Complex:
        """Return the coefficients (n, 2 modes + 1) of the sections at z (n,) [m]."""
        parts = self._splines(z)
        return np.asarray(parts[:, 0] + 1j * parts[:, 1])

    def areas(self, z: Array) -> Array:
        """Return the areas (n,) [m2] of the sections at z [m]: pi sum n |c_n|^2."""
        orders = np.arange(-self.modes, self.modes + 1)
        return np.asarray(pi * np.sum(orders * np.abs(self.at(z)) ** 2, axis=1))

    def volume(self, start: float | None = None) -> float:
        """Return the volume [m3] above a height [m], by default all of it."""
        return _integral(self.areas, self._splines, self.start if start is None else start, self.end)

    def position(self, zeta: tuple[Any, Any], z: Any) -> tuple[Any, Any]:
        """Return where (x, y) [m] the point zeta of the unit disc lies at z [m], coefficient functions.

        Inside of the disc it is the series' harmonic extension.
        """
        import ngsolve as ng

        power: tuple[Any, Any] = (ng.CF(1.0), ng.CF(0.0))
        x: Any = ng.CF(0.0)
        y: Any = ng.CF(0.0)
        for n in range(self.modes + 1):
            for sign in (1, -1) if n else (1,):
                a, b = _along(self._splines, z, self.modes + sign * n)
                # (a + i b) zeta^n, or its conjugate power
                x += a * power[0] - sign * b * power[1]
                y += b * power[0] + sign * a * power[1]
            power = (power[0] * zeta[0] - power[1] * zeta[1], power[0] * zeta[1] + power[1] * zeta[0])
        return x, y


class StarLoft:
    """A surface around z: at each height a Fourier series of the squared distance from a point, over the angle.

    Attributes:
        modes: highest order.
        start, end: heights [m] between which it lies.
    """

    def __init__(self, heights: Array, centres: Complex, rows: Complex, pieces: int) -> None:
        """Join sections.

        Args:
            heights: (n,) m, increasing.
            centres: points x + iy [m] (n,), or (0,) for the origin.
            rows: coefficients (n, modes + 1) [m2] of the squared distances, of the orders from 0 on.
            pieces: of the splines along z, which fit the sections by least squares or, with as many pieces as
                sections, pass through all.
        """
        self.modes = rows.shape[1] - 1
        self.start, self.end = float(heights[0]), float(heights[-1])
        values = np.column_stack([centres, rows])
        self._splines = _splines(heights, np.stack([values.real, values.imag], axis=1), pieces)

    @classmethod
    def through(cls, heights: Array, outlines: Sequence[Outline], modes: int, pieces: int) -> Self:
        """Return the surface near outlines, about the smooth line through their centroids."""
        middles = np.array([complex(*outline.centroid) for outline in outlines])
        line = cls(heights, middles, np.zeros((len(heights), 1), dtype=complex), pieces).centres(heights)
        rows = [outline.harmonics((c.real, c.imag), modes) for c, outline in zip(line, outlines, strict=True)]
        return cls(heights, line, np.array(rows), pieces)

    def thickened(self, heights: Array, thickness: float, pieces: int) -> Self:
        """Return the surface at a distance [m] around this one (< 0: within), in the sections at heights (n,) [m]."""
        squares = np.array([around(row, thickness) for row in self.squares(heights, DENSE * SAMPLES)])
        rows = np.fft.rfft(squares, axis=1)[:, : self.modes + 1] / SAMPLES
        return type(self)(heights, self.centres(heights), rows, pieces)

    def mean(self) -> tuple[complex, Complex]:
        """Return the means along z of the points x + iy [m] in the middle, and of the coefficients [m2]."""
        parts = self._splines.integrate(self.start, self.end) / (self.end - self.start)
        return complex(*parts[:, 0]), np.asarray(parts[0, 1:] + 1j * parts[1, 1:])

    def moved(self, by: complex) -> Self:
        """Return the surface moved by x + iy [m]."""
        other = copy(self)
        values = self._splines.c.copy()
        values[:, :, 0] += [by.real, by.imag]
        other._splines = BSpline(self._splines.t, values, DEGREE)
        return other

    def centres(self, z: Array) -> Complex:
        """Return the points x + iy (n,) [m] about which the sections at z (n,) [m] are described."""
        parts = self._splines(z)
        return np.asarray(parts[:, 0, 0] + 1j * parts[:, 1, 0])

    def squares(self, z: Array, count: int = SAMPLES) -> Array:
        """Return the squared distances (n, count) [m2] at even angles from 0 on, of the sections at z (n,) [m]."""
        parts = self._splines(z)[:, :, 1:]
        return series(parts[:, 0] + 1j * parts[:, 1], count)

    def sections(self, z: Array, count: int = SAMPLES) -> Complex:
        """Return points x + iy (n, count) [m] of the sections at z (n,) [m], at even angles around their centres."""
        rays = np.exp(2j * pi * np.arange(count) / count)
        return np.asarray(self.centres(z)[:, None] + np.sqrt(self.squares(z, count)) * rays)

    def areas(self, z: Array) -> Array:
        """Return the areas (n,) [m2] of the sections at z [m]."""
        return np.asarray(pi * self._splines(z)[:, 0, 1])

    def volume(self) -> float:
        """Return the volume [m3] inside."""
        return _integral(self.areas, self._splines, self.start, self.end)

    def position(self, direction: tuple[Any, Any], z: Any) -> tuple[Any, Any]:
        """Return where (x, y) [m] the surface lies in a direction (cosine, sine) at z [m], coefficient functions."""
        import ngsolve as ng

        power: tuple[Any, Any] = (ng.CF(1.0), ng.CF(0.0))
        square: Any = ng.CF(0.0)
        for n in range(self.modes + 1):
            a, b = _along(self._splines, z, n + 1)
            square += (2 if n else 1) * (a * power[0] - b * power[1])
            power = (
                power[0] * direction[0] - power[1] * direction[1],
                power[0] * direction[1] + power[1] * direction[0],
            )
        x, y = _along(self._splines, z, 0)
        return x + ng.sqrt(square) * direction[0], y + ng.sqrt(square) * direction[1]


def series(rows: Complex, count: int) -> Array:
    """Return the sums (..., count) at even angles from 0 on of Fourier series of orders 0, 1 ... (..., modes + 1)."""
    padded = np.zeros((*rows.shape[:-1], count // 2 + 1), dtype=complex)
    padded[..., : rows.shape[-1]] = rows
    return np.fft.irfft(padded, count, axis=-1) * count


def around(squares: Array, thickness: float) -> Array:
    """Return the squared distances [m2] of the curve at a distance [m] around another, each over even angles from 0 on.

    A negative thickness is the distance of a curve within it, of which no point is nearer to the other.

    What lies within the thickness of a body that is seen whole from a point is so, too: in each direction it reaches as
    far as the farthest of the discs around the points of the other curve, of which (n,) there are DENSE times as many.
    """
    angles = 2 * pi * np.arange(len(squares)) / len(squares)
    off = angles[None] - angles[::DENSE, None]
    radii = np.sqrt(squares)[None]
    inside = thickness**2 - (radii * np.sin(off)) ** 2
    reach = radii * np.cos(off) + np.copysign(np.sqrt(np.maximum(inside, 0.0)), thickness)
    if thickness < 0:
        return np.asarray(np.min(np.where((inside >= 0) & (np.cos(off) > 0), reach, np.inf), axis=1) ** 2)
    return np.asarray(np.max(np.where(inside >= 0, reach, 0.0), axis=1) ** 2)


def parallel(outline: Outline, thickness: float) -> Outline:
    """Return the outline at a distance [m] around another that is seen whole from its centroid; notches are filled.

    Raises:
        GeometryError: it is not.
    """
    x, y = map(float, outline.centroid)
    squares = series(outline.harmonics((x, y), SAMPLES // 4), DENSE * SAMPLES)
    if np.min(squares) <= 0:
        raise GeometryError("the outline is no curve around its middle: smooth it, or give a thinner wall")
    angles = 2 * pi * np.arange(SAMPLES) / SAMPLES
    ring = np.sqrt(around(squares, thickness)) * np.exp(1j * angles) + complex(x, y)
    return Outline.through(np.column_stack([ring.real, ring.imag]))


def _splines(heights: Array, values: Array, pieces: int | None = None) -> BSpline:
    """Return splines along z through values (n, ...), or with few pieces near them by least squares."""
    if pieces is None or pieces >= len(heights) - DEGREE:
        return make_interp_spline(heights, values, k=DEGREE)
    inner = np.quantile(heights, np.linspace(0, 1, pieces + 1))[1:-1]
    knots = np.r_[[heights[0]] * (DEGREE + 1), inner, [heights[-1]] * (DEGREE + 1)]
    return make_lsq_spline(heights, values, knots, k=DEGREE)


def _integral(areas: Callable[[Array], Array], splines: BSpline, start: float, end: float) -> float:
    """Return the integral [m3] of areas over heights [m], piece by piece of the splines."""
    nodes, weights = np.polynomial.legendre.leggauss(8)
    knots = np.unique(np.clip(splines.t, start, end))
    middle, half = (knots[1:] + knots[:-1]) / 2, np.diff(knots) / 2
    at = (middle[:, None] + half[:, None] * nodes).ravel()
    return float(np.sum(areas(at).reshape(len(half), -1) * weights * half[:, None]))


def _along(splines: BSpline, z: Any, number: int) -> tuple[Any, Any]:
    """Return real and imaginary part of one coefficient along z, coefficient functions."""
    import ngsolve as ng

    knots = [float(t) for t in splines.t]
    # NGSolve's splines vanish outside of their knots, also by rounding
    knots[: DEGREE + 1] = [knots[0] - ROUNDING] * (DEGREE + 1)
    knots[-DEGREE - 1 :] = [knots[-1] + ROUNDING] * (DEGREE + 1)
    a, b = (ng.BSpline(DEGREE + 1, knots, list(map(float, part)))(z) for part in splines.c[:, :, number].T)
    return a, b
