"""Dual solutions of measured quantities in a steady state: how much a force anywhere changes them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import ngsolve as ng
import numpy as np

from ngfsi.gradient.functionals import measured
from ngfsi.gradient.lagrangian import Uncondensed
from ngfsi.linear.backends import BACKENDS, choose_backend
from ngfsi.linear.factorisation import Factorisation
from ngfsi.system.system import System


def has_duals(system: System) -> bool:
    """Whether a system has an adjoint: its linearisation is whole, without memory, and factorised."""
    one_way = system.case.conditions.coupling == "one_way"
    memory = any(model.state_arrays() for model in system.solids.values())
    return not (one_way or memory or BACKENDS[choose_backend(system.case.solver.linear)].iterates)


def duals(system: Uncondensed, quantities: Iterable[str]) -> dict[str, Any]:
    """Return the dual solution of each quantity, a grid function of the space of the unknowns, in the present state as
    a steady one: its component of the motion is what the balance of momentum is tested with.

    That velocities prescribed at an opening depend on the opening's shape is left out.

    Raises:
        CaseError: the model has no such quantity.
        SolverError: the linearisation is singular.
    """
    unknowns, backend = system.unknowns, choose_backend(system.case.solver.linear)
    free = unknowns.free(*unknowns.to_solve)
    factors = Factorisation(system.tangent, free, backend, unknowns.equations, less=unknowns.less)
    factors.renew(system.state.vec)
    right, multipliers = (system.state.vec.CreateVector() for _ in range(2))
    found = {}
    for name in quantities:
        right.FV().NumPy()[:] = np.where(free, measured(system, name).gradient()[0], 0.0)
        factors.solve_transposed(right, multipliers)
        found[name] = ng.GridFunction(unknowns.space)
        unknowns.test(multipliers.FV().NumPy(), found[name].vec.FV().NumPy())
    return found
