"""Arrays of NumPy, for annotations: of numbers, of complex ones, of whole numbers, of truth values; and by name."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Waves = NDArray[np.complex128]
Numbers = NDArray[np.int64]
Mask = NDArray[np.bool_]


def part_of(arrays: Mapping[str, Array], name: str) -> dict[str, Array]:
    """Return the arrays named `name.something` as those named `something`."""
    return {key.removeprefix(f"{name}."): part for key, part in arrays.items() if key.startswith(f"{name}.")}
