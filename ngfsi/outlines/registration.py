"""Registration: the displacement that takes one outline of the skin, or one image of a section, to another."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ngfsi.arrays import Array
from ngfsi.errors import GeometryError
from ngfsi.outlines.displacement import OutlineDisplacement
from ngfsi.outlines.outline import Outline

POINTS = 1000
FARTHEST = 5e-3
"""Landmarks farther (m) than this from their outline are refused."""


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
    first = _on(before, landmarks, "before")
    second = _on(after, landmarks_after, "after")
    order = np.argsort(first)
    first, second = first[order], np.mod(second[order] - second[order[0]], after.length)
    if np.any(np.diff(first) <= 0) or np.any(np.diff(second) <= 0):
        names = ", ".join(str(number + 1) for number in order)
        raise GeometryError(
            f"the landmarks follow each other round the outline before as {names}, but not so round the outline after: "
            "pair them anew"
        )
    start = _on(after, landmarks_after, "after")[order[0]]
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
            f"landmark {worst + 1} lies {1e3 * away[worst]:.1f} mm from the outline {which}: landmarks must be within "
            f"{1e3 * FARTHEST:g} mm, check their units and order"
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
