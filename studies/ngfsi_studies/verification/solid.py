"""Newton's method for the equilibrium of a solid alone, for benchmarks without blood."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ngfsi.linear.backends import choose_backend
from ngfsi.linear.factorisation import Factorisation
from ngfsi.verify import VerificationError

NEWTON_STEPS = 20


def solve(
    form: Any, found: Any, free: NDArray[np.bool_], forces: Any = None, tolerance: float = 1e-13
) -> NDArray[np.float64]:
    """Solve form(found) = forces on the free unknowns, from the values that `found` has; return the reactions.

    Args:
        tolerance: largest change (m) at convergence.

    Raises:
        VerificationError: no convergence.
    """
    factorisation = Factorisation(form, free, choose_backend("auto"))
    residual, update = found.vec.CreateVector(), found.vec.CreateVector()
    for _ in range(NEWTON_STEPS):
        form.Apply(found.vec, residual)
        if forces is not None:
            residual.data -= forces.vec
        reactions = np.array(residual.FV().NumPy())
        residual.FV().NumPy()[~free] = 0.0
        factorisation.renew(found.vec)
        factorisation.solve(residual, update)
        found.vec.data -= update
        if np.abs(update.FV().NumPy()).max() < tolerance:
            return reactions
    raise VerificationError("Newton's method did not converge")
