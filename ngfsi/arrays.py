"""Arrays of NumPy, for annotations: of numbers, of complex ones, of whole numbers, of truth values."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Waves = NDArray[np.complex128]
Numbers = NDArray[np.int64]
Mask = NDArray[np.bool_]
