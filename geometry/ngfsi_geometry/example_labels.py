"""A label map of a calf as rough as hand-made ones are, drawn from formulas: a file to try things with.

python -m ngfsi_geometry.example_labels leg.nii.gz
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np

from ngfsi_geometry.imaging import LABELS

PIXEL, SLICE, COUNT = 1.0, 4.0, 12
"""Sizes of pixels and distance of slices [mm], number of slices."""
TWO_VEINS = {"skin": "Skin", "tibia": "Tibia", "fibula": "Fibula", "lumen": "Peroneal vein", "lumen_2": "Soleal vein"}


def rough_calf(seed: int = 3) -> Any:
    """Return a SimpleITK image (mm) of labels, in the patient's axes, with names of segments as 3D Slicer has them.

    The first vein runs obliquely, by half of the slices' distance to the side in each, and is a crescent in slice 5;
    the second is straight; the tibia has an arm from slice 9 on; the skin is noise to a fifth of a pixel.
    """
    import SimpleITK as sitk  # noqa: N813 - its usual name

    y, x = np.mgrid[:96, :104]
    numbers = np.zeros((COUNT, 96, 104), dtype=np.uint8)
    rng = np.random.default_rng(seed)
    for k, layer in enumerate(numbers):
        layer[np.hypot(x - 52, (y - 48) * 1.1) < 44 + rng.normal(0, 0.2, x.shape)] = LABELS["skin"]
        arm = (k > 8) & (abs(y - 66) < 3) & (x > 40) & (x < 57)
        layer[(abs(x - 40) + abs(y - 66) < 13) | arm] = LABELS["tibia"]
        layer[np.hypot(x - 72, y - 56) < 6] = LABELS["fibula"]
        layer[np.hypot(x - 30, y - 40) < 4] = LABELS["lumen_2"]
        middle = 66 - 2 * k
        ring = np.hypot(x - middle, y - 36)
        crescent = (ring < 7) & (np.hypot(x - middle, y - 33) > 5) & (y > 31)
        layer[crescent if k == 5 else ring < 5] = LABELS["lumen"]
    image = sitk.GetImageFromArray(numbers)
    image.SetDirection([-1, 0, 0, 0, -1, 0, 0, 0, 1])
    image.SetSpacing([PIXEL, PIXEL, SLICE])
    for k, (name, title) in enumerate(TWO_VEINS.items()):
        image.SetMetaData(f"Segment{k}_Name", title)
        image.SetMetaData(f"Segment{k}_LabelValue", str(LABELS[name]))
        image.SetMetaData(f"Segment{k}_Layer", "0")
    return image


if __name__ == "__main__":
    import SimpleITK as sitk  # noqa: N813 - its usual name

    sitk.WriteImage(rough_calf(), sys.argv[1])
