"""Synthetic images of sections: grey values of tissue, bones and veins on pixels, as from a scanner."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ngfsi.outline import Outline

Array = NDArray[np.float64]

PIXEL = 0.625e-3
"""Pixel size of the source study's images, m."""
MARGIN = 5e-3
SUB = 3
GREY = {"skin": 100.0, "tibia": -80.0, "fibula": -80.0, "lumen": 60.0}
"""Grey values, added up from outside inwards."""


def phantom(outlines: dict[str, Outline], frame: Outline, pixel: float = PIXEL) -> Any:
    """Return a SimpleITK image (mm) of outlines by name: pixels take the share of each that they cover.

    Args:
        outlines: skin, and any of tibia, fibula, lumen.
        frame: outline that the image holds with a margin; the same frame makes images of one grid.
        pixel: size of the pixels, m.
    """
    import SimpleITK as sitk  # noqa: N813 - its usual name

    low, high = frame.points.min(axis=0) - MARGIN, frame.points.max(axis=0) + MARGIN
    size = np.ceil((high - low) / pixel).astype(int)
    fine = pixel / SUB
    x = low[0] + fine * (np.arange(SUB * size[0]) + 0.5)
    y = low[1] + fine * (np.arange(SUB * size[1]) + 0.5)
    grid = np.stack(np.meshgrid(x, y), axis=-1)
    grey = np.zeros(grid.shape[:2])
    for name, outline in outlines.items():
        grey += GREY[name] * outline.contains(grid.reshape(-1, 2)).reshape(grey.shape)
    pixels = grey.reshape(size[1], SUB, size[0], SUB).mean(axis=(1, 3))
    image = sitk.GetImageFromArray(pixels)
    image.SetSpacing([1e3 * pixel, 1e3 * pixel])
    image.SetOrigin([float(c) for c in 1e3 * (low + pixel / 2)])
    return image
