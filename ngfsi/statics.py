"""Equilibrium of plane sections: the solid terms of the coupled system, without flow or time."""

from __future__ import annotations

from ngfsi.case import Case, Conditions, Discretisation, Loads, Materials, Solver, TimeStepping
from ngfsi.curves import PressureConstant
from ngfsi.domain import Domain
from ngfsi.errors import CaseError
from ngfsi.section import Section
from ngfsi.solve.initial import initial_state
from ngfsi.solve.linear import choose_backend
from ngfsi.solve.newton import Newton
from ngfsi.solve.system import System


def section_case(
    geometry: Section, materials: Materials, *, skin: float = 0.0, blood: float = 0.0,
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
        solver=Solver(compile=False, tolerance=1e-9),
    )


def equilibrium(case: Case, domain: Domain | None = None, start: System | None = None) -> System:
    """Return the system of a case without flow in equilibrium with its loads at t = 0.

    Args:
        domain: mesh of the case's geometry, if it is there already.
        start: a system of the same mesh and conditions near whose state the equilibrium is expected; then the loads
            are applied at once, and in steps only if that fails.

    Raises:
        CaseError: the geometry has a fluid.
        SolverError: no equilibrium was found; says up to which share of the loads.
    """
    if case.geometry.fluid is not None:
        raise CaseError(f"a {type(case.geometry).__name__} has a fluid: compute it with `ngfsi run`")
    system = System(case, domain or Domain.build(case.geometry))
    if start is not None:
        system.values[:] = start.values
    initial_state(system, Newton(system, choose_backend(case.solver.linear)))
    return system
