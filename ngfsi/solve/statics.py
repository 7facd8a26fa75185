"""Equilibrium of plane sections: the solid terms of the coupled system, without flow or time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from itertools import pairwise

from ngfsi.case import Case, Conditions, Discretisation, Loads, Materials, Solver, TimeStepping
from ngfsi.config.functions import PressureConstant
from ngfsi.config.model import ConfigModel
from ngfsi.errors import CaseError, SolverError
from ngfsi.linear.backends import choose_backend
from ngfsi.mesh.domain import Domain
from ngfsi.mesh.geometry import vessels_of
from ngfsi.solve.initial import in_load_steps
from ngfsi.solve.newton import Newton
from ngfsi.system.system import System


def section_case(
    geometry: ConfigModel, materials: Materials, *, skin: float = 0.0, blood: float = 0.0,
    conditions: Conditions | None = None, name: str = "section",
) -> Case:  # fmt: skip
    """Return the case of a plane section under pressures (Pa) on the skin and in the veins.

    Args:
        conditions: plane stress or strain, small strain, displacement of the skin.
    """
    return Case(
        name=name,
        geometry=geometry,
        materials=materials,
        loads=Loads(skin_pressure=PressureConstant(value=skin), outlet_pressure=PressureConstant(value=blood)),
        conditions=(conditions or Conditions()).replace(ends="free"),
        discretisation=Discretisation(order=geometry.curving_order),  # type: ignore[attr-defined]
        time=TimeStepping(step=1.0, end=1.0),
        solver=Solver(tolerance=1e-9),
    )


def equilibrium(case: Case, domain: Domain | None = None, start: System | None = None) -> System:
    """Return the system of a case without flow in equilibrium with its loads at t = 0.

    Args:
        domain: mesh of the case's geometry, if it is there already.
        start: a system of the same mesh and conditions, near whose state the equilibrium is expected.

    Raises:
        CaseError: the geometry has a fluid.
        SolverError: no equilibrium was found; says up to which share of the loads.
    """
    system, newton = _at_rest(case, domain)
    if start is not None:
        system.values[:] = start.values
        system.update(0.0)
        with suppress(SolverError):
            newton.solve(case.solver.tolerance, case.solver.max_iterations)
            return system
        system.values[:] = 0.0
    _carry(system, newton, 0.0, 1.0)
    return system


def load_path(case: Case, shares: Sequence[float], domain: Domain | None = None) -> Iterator[System]:
    """Yield the system in equilibrium with growing shares of its loads, each from the one before.

    Raises:
        CaseError: the geometry has a fluid.
        SolverError: no equilibrium was found from some share on; the system last yielded is left at the last one.
    """
    system, newton = _at_rest(case, domain)
    for share, until in pairwise((0.0, *shares)):
        _carry(system, newton, share, until)
        yield system


def _carry(system: System, newton: Newton, share: float, until: float) -> None:
    """Go from one share of the loads to another, and to the case's tolerance there."""
    in_load_steps(system, newton, share, until)
    newton.solve(system.case.solver.tolerance, system.case.solver.max_iterations)


def _at_rest(case: Case, domain: Domain | None) -> tuple[System, Newton]:
    if any(vessel.lumen for vessel in vessels_of(case.geometry)):
        raise CaseError(f"a {type(case.geometry).__name__} has a fluid: compute it with `ngfsi run`")
    system = System(case, domain or Domain.build(case.geometry))
    system.set_steady()
    return system, Newton(system, choose_backend(case.solver.linear))
