"""Exact profiles as polynomials, which NGSolve can evaluate: of no benchmark by itself."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial
from numpy.typing import NDArray

Array = NDArray[np.float64]

DEGREE = 24
"""Exact to rounding for the smooth profiles here."""


def interpolated(function: Callable[[Array], Array], low: float, high: float) -> Chebyshev:
    """Return the polynomial through a function of [low, high]."""
    return Chebyshev.interpolate(function, DEGREE, domain=[low, high])


def evaluated(polynomial: Chebyshev, x: Any) -> Any:
    """Return the polynomial at a coefficient function x."""
    low, high = polynomial.domain
    s, result = (x - (low + high) / 2) / ((high - low) / 2), 0.0
    # in the variable that runs from -1 to 1, where powers lose nothing
    for coefficient in reversed(Chebyshev(polynomial.coef).convert(kind=Polynomial).coef):
        result = result * s + float(coefficient)
    return result
