"""Equilibrium of plane sections under constant loads, one from another, without a folder: for identification."""

from __future__ import annotations

from contextlib import suppress

from ngfsi.case import Case, Conditions, Discretisation, Loads, Materials, Solver, TimeStepping
from ngfsi.config.functions import PressureConstant
from ngfsi.config.model import ConfigModel
from ngfsi.errors import CaseError, SolverError
from ngfsi.linear.backends import choose_backend
from ngfsi.mesh.domain import Domain
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
        SolverError: no equilibrium was found; says up to which fraction of the loads.
    """
    if any(vessel.lumen for vessel in case.geometry.vessels):
        raise CaseError(f"a {type(case.geometry).__name__} has a fluid: compute it with `ngfsi run`")
    system = System(case, domain or Domain.build(case.geometry))
    system.set_steady()
    newton = Newton(system, choose_backend(case.solver.linear))
    limits = case.solver.tolerance, case.solver.max_iterations
    if start is not None:
        system.values[:] = start.values
        system.update(0.0)
        with suppress(SolverError):
            newton.solve(*limits)
            return system
        system.values[:] = 0.0
    in_load_steps(system, newton)
    newton.solve(*limits)
    return system
