"""A displacement prescribed along a closed outline, as registration gives it: a condition of a case."""

from __future__ import annotations

from functools import cached_property
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator
from scipy.interpolate import CubicSpline

from ngfsi.errors import GeometryError, NgfsiError
from ngfsi.outline import Outline
from ngfsi.section import Section
from ngfsi.units import Length

Array = NDArray[np.float64]


class OutlineDisplacement(Section):
    """Displacement (ux, uy) of points (x, y) of an outline, between them by periodic cubic splines of arc length."""

    refusal: ClassVar[type[NgfsiError]] = GeometryError

    x: tuple[Length, ...] = Field(min_length=4)
    y: tuple[Length, ...] = Field(min_length=4)
    ux: tuple[Length, ...]
    uy: tuple[Length, ...]

    @classmethod
    def between(cls, before: Array, after: Array) -> Self:
        """Return the displacement that takes points (n, 2) [m] of an outline to others."""
        moved = after - before
        parts = (before[:, 0], before[:, 1], moved[:, 0], moved[:, 1])
        return cls(**dict(zip(("x", "y", "ux", "uy"), (tuple(map(float, part)) for part in parts), strict=True)))

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if len({len(self.x), len(self.y), len(self.ux), len(self.uy)}) > 1:
            raise ValueError("a displacement needs as many x, y, ux and uy")
        _ = self._outline
        return self

    @cached_property
    def _outline(self) -> Outline:
        return Outline(x=self.x, y=self.y)

    @cached_property
    def _spline(self) -> CubicSpline:
        arc = self._outline.nearest(np.column_stack([self.x, self.y]))
        order = np.argsort(arc)
        knots, values = arc[order], np.column_stack([self.ux, self.uy])[order]
        closed = np.r_[knots, knots[0] + self._outline.length], np.vstack([values, values[:1]])
        return CubicSpline(*closed, bc_type="periodic")

    def __call__(self, points: Array) -> Array:
        """Return the displacement (n, 2) [m] of the points of the outline nearest to points (n, 2) [m]."""
        return np.asarray(self._spline(self._outline.nearest(points)))
