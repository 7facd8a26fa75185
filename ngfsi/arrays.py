"""Arrays of NumPy, for annotations: of numbers, of whole numbers, of truth values."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]
Mask = NDArray[np.bool_]
