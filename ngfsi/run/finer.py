"""The state of a system in elements of one order more on the same mesh, from the one it has.

Its state is taken over, and solved for again with its rates held as they are: what elements of this order cannot show
is what changes. That takes a factorisation or two, of a matrix of the higher order, and no run.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ngfsi.errors import SolverError
from ngfsi.run.computation import fitting_backend
from ngfsi.solve.initial import NEWTON_STEPS
from ngfsi.solve.newton import Newton
from ngfsi.system.system import System

FIELDS = ("state", "velocity_history", "acceleration_history")
TOLERANCE = 1e-5
"""Of the changes of the last iteration over the scales: what is looked for is far larger, or good enough."""


def has_finer(system: System) -> bool:
    """Whether the state is that of the unknowns alone, and not of internal variables or of a prestressed shape."""
    return system.relaxation is None and not any(model.state_arrays() for model in system.solids.values())


class Finer:
    """A system of one order more than another one.

    Attributes:
        system: the finer one, in the state of the last `take`.
    """

    def __init__(self, coarse: System) -> None:
        case = coarse.case.replace(**{"discretisation.order": coarse.case.discretisation.order + 1})
        self._coarse = coarse
        self.system = type(coarse)(case, coarse.domain)
        self._newton = Newton(self.system, fitting_backend(self.system)[0], *self.system.unknowns.to_solve)

    def take(self, time: float) -> None:
        """Solve for the state that corresponds to the present one of the other system, at a time (s).

        Raises:
            SolverError: there is none.
        """
        coarse, fine = self._coarse, self.system
        fine.update(time)
        given, own = coarse.snapshot(), fine.snapshot()
        # what acts, in numbers: a prescribed motion, of which there are as many as unknowns, is up to date
        fine.restore(own | {name: part for name, part in given.items() if part.shape == own.get(name, part).shape})
        rates = coarse.rates()
        new, rest = coarse.new_weight.Get(), coarse.acceleration_history.vec.FV().NumPy()
        held = {"state": coarse.values.copy(), "velocity_history": rates, "acceleration_history": new * rates + rest}
        before = {name: np.array(getattr(coarse, name).vec.FV().NumPy()) for name in FIELDS}
        for name, values in held.items():
            field = getattr(coarse, name)
            field.vec.FV().NumPy()[:] = values
            self._take_over(field, getattr(fine, name))
        for name, values in before.items():
            getattr(coarse, name).vec.FV().NumPy()[:] = values
        fine.new_weight.Set(0.0)
        tolerance = max(TOLERANCE, fine.case.solver.tolerance)
        try:
            self._newton.solve(tolerance, NEWTON_STEPS)
        except SolverError:  # with factors of another time; those that failed are not kept
            self._newton.solve(tolerance, NEWTON_STEPS)

    def _take_over(self, given: Any, taken: Any) -> None:
        """Write a function of the coarse space, which is one of the fine space, too."""
        numbers = set(self.system.unknowns.scales)
        for name, here, there in zip(self.system.unknowns.fields, given.components, taken.components, strict=True):
            if name in numbers:
                there.vec.FV().NumPy()[:] = here.vec.FV().NumPy()
            else:
                there.Set(here)
