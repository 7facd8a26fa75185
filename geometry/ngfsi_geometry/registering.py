"""The motion of the skin between two images of a leg, slice by slice, from files."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ngfsi.errors import GeometryError
from ngfsi.outlines.displacement import POINTS, OutlineDisplacement, register_images
from ngfsi.outlines.outline import Outline
from ngfsi.units import from_si
from ngfsi_geometry.imaging import LabelMap, read_image

MOST_LABELS = 32
"""Images with more different values are grey images, with fewer label maps, if the values are whole numbers."""
SKIN = {"skin": 1}


class Slice(NamedTuple):
    """One slice: a SimpleITK image of the plane (mm), and the outline of the body in it."""

    image: Any
    skin: Outline


def slice_of(path: Path, number: int) -> Slice:
    """Return slice `number` (from 0, distal) of a label map or grey image: NIfTI, NRRD, or a DICOM series in a folder.

    The body is what has a label, or in a grey image what is brighter than Otsu's threshold (IEEE Trans SMC 9, 1979).

    Raises:
        GeometryError: it cannot be read, has no such slice, or the body cannot be outlined there.
    """
    import SimpleITK as sitk  # noqa: N813 - its usual name

    volume = read_image(path)
    values = sitk.GetArrayFromImage(volume)
    if not 0 <= number < len(values):
        raise GeometryError(f"'{path}': there is no slice {number}: the image has 0 to {len(values) - 1}")
    labelled = np.array_equal(values, np.round(values)) and len(np.unique(values)) <= MOST_LABELS
    body = values != 0 if labelled else sitk.GetArrayFromImage(sitk.OtsuThreshold(volume, 0, 1)) == 1
    mask = sitk.GetImageFromArray(body.astype(np.uint8))
    mask.CopyInformation(volume)
    try:
        map_ = LabelMap.of_image(mask, SKIN)
        skin = map_.outline("skin", number)
    except GeometryError as error:
        raise GeometryError(f"'{path}': {error}") from None
    image = sitk.GetImageFromArray(values[number].astype(np.float64))
    image.SetOrigin([from_si(place, "mm") for place in map_.origin[:2]])
    image.SetSpacing([from_si(size, "mm") for size in map_.spacing[:2]])
    return Slice(image, skin)


def register_slices(fixed: Slice, moving: Slice, control_spacing: float, points: int = POINTS) -> OutlineDisplacement:
    """Return the displacement of the skin that takes one slice to another, by B-splines over the whole image.

    Args:
        control_spacing: distance of the control points, m.
        points: of the skin before at which it is given, at equal arc lengths.
    """
    ring = fixed.skin.resampled(points)
    return OutlineDisplacement.between(
        ring, ring + register_images(fixed.image, moving.image, control_spacing=control_spacing)(ring)
    )


def gap_to(displacement: OutlineDisplacement, after: Outline) -> tuple[float, float]:
    """Return how far the moved skin lies beside an outline, root of the mean square and largest, m."""
    moved = np.column_stack([displacement.x, displacement.y]) + np.column_stack([displacement.ux, displacement.uy])
    away = np.linalg.norm(after.at(after.nearest(moved)) - moved, axis=1)
    return float(np.sqrt(np.mean(away**2))), float(away.max())
