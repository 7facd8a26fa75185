"""Equilibrium of plane sections: the solid terms of the coupled system, without flow or time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise

import ngsolve as ng
import numpy as np
from scipy.sparse.linalg import ArpackError, eigs

from ngfsi.case import Case, Conditions, Discretisation, Loads, Materials, Solver, TimeStepping
from ngfsi.config.functions import PressureConstant
from ngfsi.config.model import ConfigModel
from ngfsi.errors import CaseError, SolverError
from ngfsi.linear.backends import choose_backend
from ngfsi.mesh.domain import Domain
from ngfsi.solve.initial import in_load_steps
from ngfsi.solve.newton import Newton
from ngfsi.system.sparse import csr
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


@dataclass(frozen=True)
class SoftestMode:
    """The motion that a system in equilibrium resists least.

    Attributes:
        stiffness: its stiffness over that of shear alone in the tissue's initial modulus, 0 at a buckling load.
        place: (x, y) of the vertex that moves most, m.
    """

    stiffness: float
    place: tuple[float, float]


def softest_mode(system: System) -> SoftestMode:
    """Return the lowest eigenvalue of the tangent stiffness against the integral of G grad u : grad v, and its mode.

    From order 3 on interior unknowns follow the others, and count in the integral no more than those say.

    Raises:
        SolverError: no eigenvalue was found.
    """
    tangent, space, domain = system.tangent, system.unknowns.space, system.domain
    free = system.unknowns.free() & np.array(list(space.FreeDofs(tangent.condense)))
    tangent.AssembleLinearization(system.state.vec)
    shear = ng.BilinearForm(space, check_unused=False)
    trial, test = (parts[0] for parts in space.TnT())
    for name in domain.geometry.solids:
        modulus = system.case.materials.law_of(name).shear_modulus
        shear += modulus * ng.InnerProduct(ng.Grad(trial), ng.Grad(test)) * domain.dx(name)
    shear.Assemble()
    chosen = np.flatnonzero(free)
    stiffness, mass = (csr(form.mat)[chosen][:, chosen].tocsc() for form in (tangent, shear))
    try:
        values, modes = eigs(stiffness, k=2, M=mass, sigma=0.0, v0=np.ones(len(chosen)))
    except (ArpackError, RuntimeError) as error:
        raise SolverError(f"no softest mode was found: {error}") from None
    lowest = int(np.argmin(values.real))
    whole = np.zeros(space.ndof)
    whole[chosen] = modes[:, lowest].real
    # the first functions of each component are those of the vertices
    size, vertices = space.components[0].ndof // domain.mesh.dim, domain.mesh.nv
    moved = np.hypot(whole[:vertices], whole[size : size + vertices])
    x, y = domain.mesh.vertices[int(np.argmax(moved))].point[:2]
    return SoftestMode(float(values[lowest].real), (float(x), float(y)))


def _carry(system: System, newton: Newton, share: float, until: float) -> None:
    """Go from one share of the loads to another, and to the case's tolerance there."""
    in_load_steps(system, newton, share, until)
    newton.solve(system.case.solver.tolerance, system.case.solver.max_iterations)


def _at_rest(case: Case, domain: Domain | None) -> tuple[System, Newton]:
    if case.geometry.fluid is not None:
        raise CaseError(f"a {type(case.geometry).__name__} has a fluid: compute it with `ngfsi run`")
    system = System(case, domain or Domain.build(case.geometry))
    system.set_steady()
    return system, Newton(system, choose_backend(case.solver.linear))
