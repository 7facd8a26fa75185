"""Force of the fluid on what it flows around."""

from __future__ import annotations

import ngsolve as ng
import numpy as np
from numpy.typing import NDArray

from ngfsi.solve.system import System

Array = NDArray[np.float64]


class Force:
    """Resultant of pressure and viscous stress on boundaries of the deformed fluid.

    It is what the fluid's momentum balance lacks when tested with a unit motion of the boundary, and not an integral
    of stresses there: consistent with the balance, and of twice the order of convergence (John and Matthies, IJNMF 37,
    2001).
    """

    def __init__(self, system: System, *boundaries: str) -> None:
        self._system = system
        self._form = system.fluid_form()
        self._residual = system.state.vec.CreateVector()
        region, dim = system.domain.boundaries(*boundaries), system.domain.mesh.dim
        test = ng.GridFunction(system.unknowns.space)
        self._motions = []
        for unit in np.eye(dim):
            test.components[0].Set(ng.CF(tuple(unit)), definedon=region)
            self._motions.append(np.array(test.vec.FV().NumPy()))

    def __call__(self) -> Array:
        """Return the force (N; per metre of depth in the plane) of the present state."""
        self._form.Apply(self._system.state.vec, self._residual)
        lacking = self._residual.FV().NumPy()
        return np.array([-float(np.dot(lacking, motion)) for motion in self._motions])
