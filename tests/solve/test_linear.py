"""Direct solvers: two backends agree, and condensation solves the whole linearised system."""

from __future__ import annotations

from contextlib import suppress

import numpy as np
import pytest
from numpy.typing import NDArray

from ngfsi.errors import SolverError
from ngfsi.linear import backends
from ngfsi.linear import factorisation as factorisation_module
from ngfsi.linear.backends import Name, choose_backend, fitting, without_mkl
from ngfsi.linear.factorisation import Factorisation, Last
from ngfsi.system.system import System
from ngfsi.system.unknowns import BLOCKS
from tests.slopes import difference
from tests.vein import BONED, block, case_of, randomise, steady, system_of

Array = NDArray[np.float64]

TOLERANCE = 1e-8
MEMORY_OF_FACTORS = 16
"""Where MKL says how many kB it took."""

needs_pardiso = pytest.mark.skipif(bool(without_mkl()), reason="MKL is not installed")


@pytest.fixture(scope="module", params=[2, 3])
def lively(request: pytest.FixtureRequest) -> System:
    """A random state with (order 3) and without (order 2) unknowns inside of elements."""
    system = system_of(case_of(BONED.replace(**{"mesh.curving_order": request.param})))
    randomise(system)
    assert system.tangent.condense == (request.param == 3)
    return system


def factors(system: System, backend: Name, last: Last | None = None) -> Factorisation:
    return Factorisation(system.tangent, system.unknowns.free(), backend, system.unknowns.equations, last=last)


def update(system: System, backend: Name, last: Last | None = None) -> Array:
    """One Newton update at the system's state."""
    factorisation = factors(system, backend, last)
    factorisation.renew(system.state.vec)
    assert factorisation.count == 1
    residual, result = system.residual(), system.state.vec.CreateVector()
    residual.FV().NumPy()[~system.unknowns.free()] = 0.0
    factorisation.solve(residual, result)
    return np.array(result.FV().NumPy())


def left_over(system: System, row: str, step: Array) -> float:
    """Return what a step leaves of the residual in the free rows of a block, relatively: the residual less its
    derivative along the step, by differences."""
    residual, rows = np.array(system.residual().FV().NumPy()), block(system, row, system.unknowns.free())
    size = 1e-5 * np.abs(block(system, "d", system.values)).max() / np.abs(block(system, "d", step)).max()
    along = difference(system.form, system.state.vec, step, size)[system.unknowns.equations]
    error = block(system, row, along - residual)[rows]
    return float(np.linalg.norm(error) / np.linalg.norm(block(system, row, residual)[rows]))


def test_update_solves_the_linearised_equations(lively: System) -> None:
    """The derivative of the residual along the update is the residual, in every free row, those inside elements too."""
    step, free = update(lively, choose_backend("auto")), lively.unknowns.free()
    assert np.any(step[free])
    assert not np.any(step[~free])
    for row in BLOCKS:
        assert left_over(lively, row, step) < 1e-6, row


def test_the_mesh_motion_may_come_last(monkeypatch: pytest.MonkeyPatch) -> None:
    """The others solve their equations without it, the sum of relative velocity and its rate stays; then it does."""
    monkeypatch.setattr(factorisation_module, "WORTH", 0.0)
    lively = system_of(case_of())
    randomise(lively)
    unknowns, rate = lively.unknowns, 3.0
    last = Last(unknowns.blocks["e"], unknowns.blocks["w"], lambda: rate)
    step = update(lively, choose_backend("auto"), last)
    before, free = step.copy(), unknowns.free()
    both = free[unknowns.blocks["w"]] & free[unknowns.blocks["e"]]
    before[unknowns.blocks["w"][both]] += rate * step[unknowns.blocks["e"][both]]
    before[unknowns.blocks["e"]] = 0.0
    for row, of in (("d", before), ("w", before), ("p", before), ("e", step)):
        assert left_over(lively, row, of) < 1e-6, row


def test_transposed_with_the_mesh_motion_last(monkeypatch: pytest.MonkeyPatch) -> None:
    """A solution times any vector is the other right side times the transposed solution."""
    monkeypatch.setattr(factorisation_module, "WORTH", 0.0)
    lively = system_of(case_of())
    randomise(lively)
    unknowns = lively.unknowns
    solver = factors(lively, choose_backend("auto"), Last(unknowns.blocks["e"], unknowns.blocks["w"], lambda: 3.0))
    solver.renew(lively.state.vec)
    right, other, solution, transposed = (lively.state.vec.CreateVector() for _ in range(4))
    one, two = np.random.default_rng(3).normal(size=(2, unknowns.size)) * unknowns.free()
    right.FV().NumPy()[:], other.FV().NumPy()[:] = one, two
    solver.solve(right, solution)
    solver.solve_transposed(other, transposed)
    assert two @ solution.FV().NumPy() == pytest.approx(one @ transposed.FV().NumPy(), rel=1e-8, abs=0)


@needs_pardiso
def test_backends_agree() -> None:
    system = system_of(case_of())
    randomise(system)
    one, other = update(system, "pardiso"), update(system, "umfpack")
    for row in BLOCKS:
        a, b = block(system, row, one), block(system, row, other)
        assert np.linalg.norm(a - b) < 1e-9 * np.linalg.norm(a), row


@needs_pardiso
def test_factors_of_single_precision() -> None:
    """They take 0.5 to 0.75 of the memory, and Newton's solution is the same to its tolerance, not their rounding."""
    double, single = (
        steady(case_of(**{"solver.linear": name, "solver.tolerance": TOLERANCE}))
        for name in ("pardiso", "pardiso_single")
    )
    for row in BLOCKS:
        a, b = (block(system, row, system.values) for system, _ in (double, single))
        assert np.linalg.norm(a - b) < 10 * TOLERANCE * np.linalg.norm(a), row
    made = [factors(double[0], name) for name in ("pardiso", "pardiso_single")]
    for factorisation in made:
        factorisation.renew(double[0].state.vec)
    before, after = (factorisation._inverse._params[MEMORY_OF_FACTORS] for factorisation in made)
    assert 0.5 <= after / before < 0.75
    randomise(double[0])
    exact, rounded = (update(double[0], name) for name in ("pardiso", "pardiso_single"))
    assert np.linalg.norm(exact - rounded) > 1e-7 * np.linalg.norm(exact)


@pytest.mark.parametrize("backend", [pytest.param("pardiso", marks=needs_pardiso), "umfpack"])
def test_factors_outlive_the_state_until_renewed(backend: Name) -> None:
    system = system_of(case_of())
    randomise(system)
    factorisation = factors(system, backend)
    right, result = system.state.vec.CreateVector(), system.state.vec.CreateVector()
    loads = np.where(system.unknowns.free(), np.random.default_rng(4).standard_normal(system.unknowns.size), 0.0)

    def solved() -> Array:
        right.FV().NumPy()[:] = loads
        factorisation.solve(right, result)
        return np.array(result.FV().NumPy())

    factorisation.renew(system.state.vec)
    first = solved()
    randomise(system, seed=9)
    assert np.array_equal(solved(), first)
    factorisation.renew(system.state.vec)
    assert factorisation.count == 2
    second = solved()
    assert np.linalg.norm(second - first) > 0.1 * np.linalg.norm(first)
    fresh = factors(system, backend)
    fresh.renew(system.state.vec)
    factorisation = fresh
    assert np.linalg.norm(solved() - second) < 1e-9 * np.linalg.norm(second)


@pytest.mark.parametrize("backend", [pytest.param("pardiso", marks=needs_pardiso), "umfpack"])
def test_values_that_are_not_finite_are_reported(backend: Name) -> None:
    """As an error of the factorisation, or as an update that Newton refuses."""
    system = system_of(case_of())
    randomise(system)
    system.values[:] = np.nan
    factorisation = factors(system, backend)
    right, result = system.state.vec.CreateVector(), system.state.vec.CreateVector()
    with suppress(SolverError):
        factorisation.renew(system.state.vec)
        factorisation.solve(right, result)
        assert not np.all(np.isfinite(result.FV().NumPy()))


def test_the_solver_fits_the_size() -> None:
    """As docs/solvers.md has it: by time, or by memory, with the reason."""
    assert fitting("pardiso", 20_000, 2, 16.0)[0] == "pardiso"
    for unknowns, order, tetrahedra, memory, why in (
        (300_000, 3, False, 100.0, "which is faster than a direct solver from 270,000 on"),
        (500_000, 2, False, 1000.0, "which is faster than a direct solver from 450,000 on"),
        (120_000, 2, True, 100.0, "which on tetrahedra is faster than a direct solver from 100,000 on"),
        (300_000, 2, False, 16.0, "20 GB of the 16 GB"),
    ):
        chosen, said = fitting("umfpack", unknowns, order, memory, tetrahedra=tetrahedra)
        assert chosen == "p_multigrid"
        assert why in said
        assert f"{unknowns:,}" in said
    assert fitting("umfpack", 300_000, 2, 24.0)[0] == "umfpack"


def test_choice_of_the_backend(monkeypatch: pytest.MonkeyPatch) -> None:
    assert choose_backend("umfpack") == "umfpack"
    monkeypatch.setattr(backends, "without_mkl", lambda: "needs MKL")
    assert choose_backend("auto") == "umfpack"
    with pytest.raises(SolverError, match=r"solver\.linear = 'pardiso' needs MKL or use 'umfpack'"):
        choose_backend("pardiso")
    monkeypatch.setattr(backends, "without_mkl", str)
    assert choose_backend("auto") == choose_backend("pardiso") == "pardiso"
