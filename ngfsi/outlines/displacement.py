"""A displacement prescribed along a closed outline, as registration gives it: a condition of a case."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from ngfsi.arrays import Array
from ngfsi.config.columns import read_columns
from ngfsi.config.messages import key_error
from ngfsi.config.model import ConfigModel
from ngfsi.errors import GeometryError, NgfsiError
from ngfsi.outlines.outline import Outline
from ngfsi.units import Length

COLUMNS = ("x", "y", "ux", "uy")


class OutlineDisplacement(ConfigModel):
    """Displacement (ux, uy) of points (x, y) of an outline, between them by periodic cubic splines of arc length.

    Instead of the numbers a file may be named, `skin_displacement = {file = "skin.csv"}`, as `ngfsi register` writes
    it. The resolved case holds the numbers.
    """

    refusal: ClassVar[type[NgfsiError]] = GeometryError

    x: tuple[Length, ...] = Field(min_length=4)
    y: tuple[Length, ...] = Field(min_length=4)
    ux: tuple[Length, ...]
    uy: tuple[Length, ...]

    @model_validator(mode="before")
    @classmethod
    def _read_file(cls, data: Any) -> Any:
        """Take the columns of a file that is named in place of the numbers."""
        if not isinstance(data, dict) or set(data) != {"file"}:
            return data
        try:
            return cls.from_csv(Path(str(data["file"]))).to_toml_dict()
        except NgfsiError as error:
            raise key_error("file", f"is not accepted: {error}") from None

    @classmethod
    def from_csv(cls, path: Path) -> Self:
        """Return the displacement in a CSV file with columns x, y, ux, uy, each with its unit: `x_mm`, `ux_mm` ...

        Raises:
            OutputError: the file cannot be read, or lacks a column.
            GeometryError: the points make no outline.
        """
        columns = read_columns(path, dict.fromkeys(COLUMNS, "length"))
        return cls(**{name: tuple(map(float, columns[name])) for name in COLUMNS})

    def rows(self) -> list[dict[str, float]]:
        """Return the rows of such a file, in SI."""
        values = zip(*(getattr(self, name) for name in COLUMNS), strict=True)
        return [{f"{name}_m": value for name, value in zip(COLUMNS, row, strict=True)} for row in values]

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
    def _spline(self) -> Any:
        from scipy.interpolate import CubicSpline  # takes half a second, which a case without need not wait for

        arc = self._outline.nearest(np.column_stack([self.x, self.y]))
        order = np.argsort(arc)
        knots, values = arc[order], np.column_stack([self.ux, self.uy])[order]
        closed = np.r_[knots, knots[0] + self._outline.length], np.vstack([values, values[:1]])
        return CubicSpline(*closed, bc_type="periodic")

    def __call__(self, points: Array) -> Array:
        """Return the displacement (n, 2) [m] of the points of the outline nearest to points (n, 2) [m]."""
        return np.asarray(self._spline(self._outline.nearest(points)))
