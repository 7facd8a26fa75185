"""A displacement prescribed along a closed outline, and registration: what takes one outline, or image, to another."""

from __future__ import annotations

from collections.abc import Callable
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
from ngfsi.units import Length, in_unit

COLUMNS = ("x", "y", "ux", "uy")
POINTS = 1000
FARTHEST = 5e-3
"""Landmarks farther (m) than this from their outline are refused."""


class OutlineDisplacement(ConfigModel):
    """Displacement (ux, uy) of points (x, y) of an outline, between them by periodic cubic splines of arc length.

    Instead of the numbers a file may be named, `skin_displacement = {file = "skin.csv"}`, as `ngfsi register` writes
    it. The resolved case holds the numbers.
    """

    refusal: ClassVar[type[NgfsiError]] = GeometryError
    instead_of_file: ClassVar[tuple[str, ...]] = ("x", "y", "ux", "uy")

    x: tuple[Length, ...] = Field(min_length=4, description="lateral positions of the points")
    y: tuple[Length, ...] = Field(min_length=4, description="anterior positions of the points")
    ux: tuple[Length, ...] = Field(description="lateral displacements of the points")
    uy: tuple[Length, ...] = Field(description="anterior displacements of the points")

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


def register_outlines(
    before: Outline, after: Outline, landmarks: Array, landmarks_after: Array, points: int = POINTS
) -> OutlineDisplacement:
    """Return the displacement of the skin by arc length between landmarks.

    Landmarks that do not slide on the skin (where superficial veins touch it, say) are projected to the nearest points
    of their closed cubic splines; what lies between two of them keeps its fraction of the arc length between them.

    Args:
        landmarks, landmarks_after: pairs (n, 2) [m], at least one.
        points: number of points of the result, at equal arc lengths of the outline before.

    Raises:
        GeometryError: landmarks are unpaired, far from their outline, or in another order round it.
    """
    if landmarks.shape != landmarks_after.shape or landmarks.ndim != 2 or len(landmarks) < 1:
        raise GeometryError(
            f"registration needs pairs of landmarks: there are {len(landmarks)} before and {len(landmarks_after)} after"
        )
    first, second = _on(before, landmarks, "before"), _on(after, landmarks_after, "after")
    order = np.argsort(first)
    start = second[order[0]]
    first, second = first[order], np.mod(second[order] - start, after.length)
    if np.any(np.diff(first) <= 0) or np.any(np.diff(second) <= 0):
        names = ", ".join(str(number + 1) for number in order)
        raise GeometryError(
            f"the landmarks follow each other round the outline before as {names}, but not so round the outline after: "
            "pair them anew"
        )
    arc = before.length * np.arange(points) / points
    knots = np.r_[first, first[0] + before.length]
    images = np.r_[second, after.length]
    shifted = first[0] + np.mod(arc - first[0], before.length)
    return OutlineDisplacement.between(before.at(arc), after.at(start + np.interp(shifted, knots, images)))


def _on(outline: Outline, landmarks: Array, which: str) -> Array:
    """Return the arc lengths of the outline's points nearest to landmarks."""
    arc = outline.nearest(landmarks)
    away = np.linalg.norm(outline.at(arc) - landmarks, axis=1)
    if away.max() > FARTHEST:
        worst = int(np.argmax(away))
        raise GeometryError(
            f"landmark {worst + 1} lies {in_unit(away[worst], 'mm', '.1f')} from the outline {which}: landmarks must "
            f"be within {in_unit(FARTHEST, 'mm')}, check their units and order"
        )
    return arc


def register_images(fixed: Any, moving: Any, *, control_spacing: float = 25e-3) -> Callable[[Array], Array]:
    """Return the displacement [m] of points (n, 2) [m] of a plane image that takes it to another, by B-splines.

    Cubic B-splines of free-form deformation, least squares of the grey values (Rueckert et al., IEEE Trans Med Imaging
    18, 1999), on three levels of smoothing, in SimpleITK.

    Args:
        fixed, moving: SimpleITK images before and after, 2-D, spacing in mm; label maps count as grey values.
        control_spacing: distance of the control points, m.

    Raises:
        GeometryError: the images are not of the plane.
    """
    import SimpleITK as sitk  # noqa: N813 - its usual name

    if fixed.GetDimension() != 2 or moving.GetDimension() != 2:
        raise GeometryError("registration of images works in the plane: give single slices")
    fixed, moving = (sitk.Cast(image, sitk.sitkFloat64) for image in (fixed, moving))
    extent = [size * step for size, step in zip(fixed.GetSize(), fixed.GetSpacing(), strict=True)]
    cells = [max(2, round(length / (1e3 * control_spacing))) for length in extent]
    method = sitk.ImageRegistrationMethod()
    method.SetMetricAsMeanSquares()
    method.SetInterpolator(sitk.sitkLinear)
    method.SetOptimizerAsLBFGSB(gradientConvergenceTolerance=1e-9, numberOfIterations=60)
    method.SetShrinkFactorsPerLevel([2, 1])
    method.SetSmoothingSigmasPerLevel([1.5, 0.7])
    method.SmoothingSigmasAreSpecifiedInPhysicalUnitsOn()
    method.SetInitialTransform(sitk.BSplineTransformInitializer(fixed, cells), inPlace=True)
    method.SetNumberOfThreads(1)
    found = method.Execute(fixed, moving)

    def displacement(points: Array) -> Array:
        moved = np.array([found.TransformPoint([float(c) for c in 1e3 * point]) for point in points])
        return moved * 1e-3 - points

    return displacement
