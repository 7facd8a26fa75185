"""Stacks of outlines as smooth surfaces: Fourier series around, splines along z."""

from __future__ import annotations

from collections.abc import Sequence
from math import pi
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_interp_spline, make_lsq_spline

from ngfsi.outlines.outline import Outline

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

SAMPLES = 128
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


def thickened(row: Complex, thickness: float) -> Complex:
    """Return the coefficients of the curve at a distance [m] outside of another, point by point along its normals."""
    modes = len(row) // 2
    orders = np.arange(-modes, modes + 1)
    waves = np.exp(2j * pi * np.outer(np.arange(SAMPLES) / SAMPLES, orders))
    tangent = waves @ (1j * orders * row)
    found = np.fft.fft(waves @ row - 1j * thickness * tangent / np.abs(tangent)) / SAMPLES
    return np.asarray(found[orders])


class Loft:
    """A surface around z: at each height a Fourier series of x + iy.

    Attributes:
        modes: highest order.
        start, end: heights [m] between which it lies.
    """

    def __init__(self, heights: Array, rows: Sequence[Complex], pieces: int | None = None) -> None:
        """Join sections.

        Args:
            heights: (n,) m, increasing.
            rows: n coefficients of the sections, -modes..modes.
            pieces: of the splines along z, which then fit the sections by least squares; None: they pass through all.
        """
        self.modes = len(rows[0]) // 2
        self.start, self.end = float(heights[0]), float(heights[-1])
        values = np.stack([[row.real, row.imag] for row in rows])
        if pieces is None or pieces >= len(heights) - DEGREE:
            self._splines: BSpline = make_interp_spline(heights, values, k=DEGREE)
        else:
            inner = np.quantile(heights, np.linspace(0, 1, pieces + 1))[1:-1]
            knots = np.r_[[self.start] * (DEGREE + 1), inner, [self.end] * (DEGREE + 1)]
            self._splines = make_lsq_spline(heights, values, knots, k=DEGREE)

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
        nodes, weights = np.polynomial.legendre.leggauss(8)
        knots = np.unique(np.clip(self._splines.t, self.start if start is None else start, self.end))
        middle, half = (knots[1:] + knots[:-1]) / 2, np.diff(knots) / 2
        at = (middle[:, None] + half[:, None] * nodes).ravel()
        return float(np.sum(self.areas(at).reshape(len(half), -1) * weights * half[:, None]))

    def position(self, zeta: tuple[Any, Any], z: Any) -> tuple[Any, Any]:
        """Return where (x, y) [m] the point zeta of the unit disc lies at z [m], coefficient functions.

        Inside of the disc it is the series' harmonic extension.
        """
        import ngsolve as ng

        knots = [float(t) for t in self._splines.t]
        # NGSolve's splines vanish outside of their knots, also by rounding
        knots[: DEGREE + 1] = [knots[0] - ROUNDING] * (DEGREE + 1)
        knots[-DEGREE - 1 :] = [knots[-1] + ROUNDING] * (DEGREE + 1)
        power: tuple[Any, Any] = (ng.CF(1.0), ng.CF(0.0))
        x: Any = ng.CF(0.0)
        y: Any = ng.CF(0.0)
        for n in range(self.modes + 1):
            for sign in (1, -1) if n else (1,):
                values = self._splines.c[:, :, self.modes + sign * n]
                a, b = (ng.BSpline(DEGREE + 1, knots, list(map(float, part)))(z) for part in values.T)
                # (a + i b) zeta^n, or its conjugate power
                x += a * power[0] - sign * b * power[1]
                y += b * power[0] + sign * a * power[1]
            power = (power[0] * zeta[0] - power[1] * zeta[1], power[0] * zeta[1] + power[1] * zeta[0])
        return x, y
