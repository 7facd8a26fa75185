"""Derivatives of residuals by differences."""

from __future__ import annotations

from typing import Any

import ngsolve as ng
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def apply(form: ng.BilinearForm, at: Any, values: Array) -> Array:
    """Residual of a form at given values; `at`: a vector of the right kind."""
    x, r = at.CreateVector(), at.CreateVector()
    x.FV().NumPy()[:] = values
    form.Apply(x, r)
    return np.array(r.FV().NumPy())


def slope(
    residual: ng.BilinearForm, tangent: ng.BilinearForm, state: Any, direction: Array, step: float = 1e-3
) -> tuple[Array, Array]:
    """Return the tangent at `state` times a direction, and the residual's central difference of fourth order.

    Args:
        step: factor on the direction.
    """
    tangent.AssembleLinearization(state)
    along, result = state.CreateVector(), state.CreateVector()
    along.FV().NumPy()[:] = direction
    result.data = tangent.mat * along
    return np.array(result.FV().NumPy()), difference(residual, state, direction, step)


def difference(form: ng.BilinearForm, state: Any, direction: Array, step: float) -> Array:
    """Central difference of fourth order of a form's residual."""
    values = np.array(state.FV().NumPy())
    near, far = (
        apply(form, state, values + h * direction) - apply(form, state, values - h * direction)
        for h in (step, 2 * step)
    )
    return (8 * near - far) / (12 * step)
