"""States at t = 0: steady flow in the vein, with the tissue inflated (preload) or already carrying it (prestress)."""

from __future__ import annotations

from collections.abc import Callable

import ngsolve as ng
import numpy as np
from ngsolve import GridFunction, Id, Inv

from ngfsi.errors import SolverError
from ngfsi.linear.backends import Name
from ngfsi.linear.factorisation import Factorisation
from ngfsi.linear.levels import levels_of
from ngfsi.solve.newton import Newton
from ngfsi.system.forms import tangent_form
from ngfsi.system.system import System

Say = Callable[[str], None]
"""Takes lines for the log."""
FINEST_LOAD_STEP = 1 / 64
NEWTON_STEPS = 30
START_TOLERANCE = 1e-5
"""Tolerance of creeping flow, which only starts the steady flow with inertia. Its own rounding is about 1e-9: viscous
stresses are a millionth of the pressure."""


def silent(_line: str) -> None:
    """Keep no log."""


def initial_state(system: System, newton: Newton, say: Say = silent) -> int:
    """Bring the system to its steady state under the loads of t = 0; return the number of factorisations.

    Where nothing acts at t = 0 that is the given shape, and there is nothing to solve.

    preload: the reference shape is free of stress, and the blood inflates it.
    prestress: the reference shape carries the loads already; steady flow in it, then the stress-free shape that the
    same loads deform into it.

    Raises:
        SolverError: the solids cannot carry the loads; says up to which fraction of them.
    """
    system.set_steady()
    system.update(0.0)
    system.prescribe()
    if system.is_at_rest():
        say("nothing acts at t = 0: all is at rest in the given shape")
        return 0
    blood, solids = bool(system.domain.lumens), bool(system.solids)
    if solids and system.case.conditions.initial_state == "prestress":
        count = 0
        if blood:
            say("steady flow in the given shape")
            count = steady_flow(system, newton.factorisation.backend).factorisation.count
        else:
            system.update(0.0)
        say("stress-free shape by inverse design")
        return count + _relax(system, newton.factorisation.backend)
    if blood:
        say("inflating the vein with creeping flow" if solids else "creeping flow in the given shape")
        in_load_steps(system, newton)
        say("steady flow with inertia")
        _with_inertia(system, newton)
    else:
        say("equilibrium under the loads at t = 0")
        in_load_steps(system, newton)
        newton.solve(system.case.solver.tolerance, NEWTON_STEPS)
    return newton.factorisation.count


def steady_flow(system: System, backend: Name) -> Newton:
    """Solve for the steady flow at t = 0 in the present shape, which is held, and return its solver.

    Raises:
        SolverError: no steady flow was found.
    """
    system.set_steady()
    flow = Newton(system, backend, *(name for name in system.unknowns.blocks if name not in "de"))
    in_load_steps(system, flow)
    _with_inertia(system, flow)
    return flow


def in_load_steps(system: System, newton: Newton) -> None:
    """Creeping flow under growing fractions of the loads of t = 0; inertia is left out, so the flow is linear.

    A pressure residual that is small against the load but large against viscous stresses would otherwise drive the
    flow of a Newton iterate to absurd Reynolds numbers.

    Raises:
        SolverError: says which fraction of the loads was reached, whose state is left.
    """
    density = system.blood_density.Get()
    system.blood_density.Set(0.0)

    def load(fraction: float) -> None:
        system.update(0.0, fraction)
        system.prescribe()

    _by_fractions(newton, max(START_TOLERANCE, system.case.solver.tolerance), load,
                  "the initial state was found only up to {:.0%} of the loads at t = 0")  # fmt: skip
    system.blood_density.Set(density)


def _with_inertia(system: System, newton: Newton) -> None:
    """Steady flow with inertia, in growing fractions of the density if it cannot be had at once."""
    density = system.blood_density.Get()
    _by_fractions(newton, system.case.solver.tolerance, lambda part: system.blood_density.Set(part * density),
                  "no steady flow was found at t = 0")  # fmt: skip


def _by_fractions(newton: Newton, tolerance: float, apply: Callable[[float], None], failed: str) -> None:
    """Solve with the whole of something, in as few fractions as it takes; `failed` says which was reached if any."""
    reached, step = 0.0, 1.0
    while reached < 1.0:
        trial = min(1.0, reached + step)
        apply(trial)
        try:
            newton.solve(tolerance, NEWTON_STEPS)
        except SolverError as error:
            step /= 2
            if step < FINEST_LOAD_STEP:
                raise SolverError(f"{failed.format(reached)}: {error}") from None
        else:
            reached = trial


def relaxation_form(system: System, *, condense: bool) -> ng.BilinearForm:
    """Return the work of the solids' stresses in the given shape, as a form of the displacement from it to the shape
    free of stress."""
    given = Id(system.domain.mesh.dim)
    trial, test = system.unknowns.space.components[0].TnT()
    unloaded = Inv(given + ng.Grad(trial))
    integrals = [one for name in system.solids for one in system.work_integrals(name, given, ng.Grad(test), unloaded)]
    return tangent_form(system.unknowns.space.components[0], integrals, condense=condense)


def _relax(system: System, backend: Name) -> int:
    """Find the displacement U from the given to the stress-free shape (Govindjee and Mihalic 1996).

    Unknown is X0 = X + U(X). Equilibrium on the given shape, d = 0, is solved for U; its residual is that of the
    coupled system, so that the system is in equilibrium with d = 0 to solver tolerance, not approximately.
    """
    assert system.relaxation is not None
    space = system.unknowns.space.components[0]
    relaxation = GridFunction(space)
    form = relaxation_form(system, condense=system.tangent.condense)
    load = np.array(system.residual().FV().NumPy()[: space.ndof])  # of blood and skin: the tissue is not stressed yet
    free = system.unknowns.free("d")[: space.ndof]
    factorisation = Factorisation(form, free, backend, levels=lambda: levels_of(system.domain, system.unknowns))
    residual, update = relaxation.vec.CreateVector(), relaxation.vec.CreateVector()
    for _ in range(NEWTON_STEPS):
        form.Apply(relaxation.vec, residual)
        values = residual.FV().NumPy()
        values[:] = np.where(free, values + load, 0.0)
        factorisation.renew(relaxation.vec)
        factorisation.solve(residual, update)
        relaxation.vec.data -= update
        change = float(np.max(np.abs(update.FV().NumPy()))) / system.domain.geometry.size
        if not np.isfinite(change):
            break
        if change < system.case.solver.tolerance:
            system.relaxation.vec.data = relaxation.vec
            return factorisation.count
    raise SolverError("the stress-free shape was not found: inverse design did not converge")
