"""Quasi-Newton on small algebraic systems with known solutions: mixing, renewal, convergence by block, failure."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from ngsolve import BaseVector, Parameter
from numpy.typing import NDArray

from ngfsi.errors import SolverError
from ngfsi.parallel.ranks import SERIAL, Distribution
from ngfsi.parallel.stopwatch import Stopwatch
from ngfsi.solve import newton as module
from ngfsi.solve.newton import Mixing, Newton
from ngfsi.system.unknowns import BLOCKS

Vector = NDArray[np.float64]

SIZE = 8
PARTS = {name: np.arange(2 * i, 2 * i + 2) for i, name in enumerate(BLOCKS)}
SCALES = {"d": 1e-3, "w": 1.0, "p": 1e3, "e": 1e-3}
SCALE = np.repeat([SCALES[name] for name in BLOCKS], 2)
RNG = np.random.default_rng(6)
COUPLING = np.eye(SIZE) + 0.2 * RNG.standard_normal((SIZE, SIZE))
SOLUTION = RNG.uniform(0.5, 1.5, SIZE)  # in units of the scales


class Algebraic:
    """r(x) = A (y - s) + c (y^3 - s^3), y = x / scale, in the shape of a System; two unknowns in each block."""

    def __init__(self, cubic: float = 0.3, free: NDArray[np.bool_] | None = None, linearise: str = "when slow") -> None:
        self.cubic, self.watch, self.ranks = cubic, Stopwatch(), SERIAL
        self.case = SimpleNamespace(solver=SimpleNamespace(linearise=linearise))
        mask = np.ones(SIZE, dtype=bool) if free is None else free
        self.unknowns = SimpleNamespace(
            blocks=PARTS,
            size=SIZE,
            free=lambda *names: mask & self._of(names),
            equations=np.arange(SIZE),
            less=None,
            mesh_follows=False,
        )
        self.state = SimpleNamespace(vec=BaseVector(SIZE))
        self.new_weight, self.blood_density = Parameter(10.0), Parameter(1060.0)
        self.tangent = None
        self.prescribed = 0
        self._residual = BaseVector(SIZE)
        self.values[:] = 0.0

    @staticmethod
    def _of(names: tuple[str, ...]) -> NDArray[np.bool_]:
        mask = np.zeros(SIZE, dtype=bool)
        for name in names or BLOCKS:
            mask[PARTS[name]] = True
        return mask

    @property
    def values(self) -> Vector:
        return np.asarray(self.state.vec.FV().NumPy())

    def snapshot(self) -> dict[str, Vector]:
        return {"state": self.values.copy()}

    def restore(self, snapshot: dict[str, Vector]) -> None:
        self.values[:] = snapshot["state"]

    def changed_state(self) -> dict[str, Vector]:
        raise AssertionError("there is nobody to tell")

    def enrol(self, _one: object) -> int:
        return -1

    def distribution(self, chosen: NDArray[np.bool_]) -> Distribution:
        return Distribution(SERIAL, int(np.sum(chosen)), np.arange(np.sum(chosen)))

    def all_have_state(self) -> None:
        """There is nobody to tell."""

    def prescribe(self) -> None:
        self.prescribed += 1

    def part_of_residual(self) -> Any:
        y = self.values / SCALE
        self._residual.FV().NumPy()[:] = COUPLING @ (y - SOLUTION) + self.cubic * (y**3 - SOLUTION**3)
        return self._residual

    def jacobian(self) -> Any:
        y = self.values / SCALE
        return (COUPLING + np.diag(3 * self.cubic * y**2)) / SCALE

    def block_scales(self) -> dict[str, float]:
        return SCALES


class Dense:
    """Factors of an algebraic system in the shape of a Factorisation."""

    linear_iterations = 0

    def __init__(self, system: Algebraic, free: NDArray[np.bool_]) -> None:
        self.system, self.free, self.count = system, free, 0
        self.at: list[Vector] = []
        self.rounding: Vector | None = None
        """Of the factors, until they are of double precision."""

    def sharpen(self) -> bool:
        rounded, self.rounding = self.rounding is not None, None
        return rounded

    def renew(self, state: Any) -> None:
        assert state is self.system.state.vec
        self.matrix = self.system.jacobian()
        if self.rounding is not None:
            self.matrix = self.matrix + self.rounding / SCALE
        self.count += 1
        self.at.append(self.system.values.copy())

    def solve(self, residual: Any, update: Any) -> None:
        r, u = residual.FV().NumPy(), update.FV().NumPy()
        assert not np.any(r[~self.free])
        u[:] = 0.0
        u[self.free] = np.linalg.solve(self.matrix[np.ix_(self.free, self.free)], r[self.free])


@pytest.fixture
def make(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Newton]:
    def make(system: Algebraic, *blocks: str) -> Newton:
        monkeypatch.setattr(module, "Factorisation", lambda _form, free, *_: Dense(system, free))
        return Newton(system, "umfpack", *blocks)  # type: ignore[arg-type]

    return make


Make = Callable[..., Newton]


def test_mixing_solves_a_linear_problem_in_as_many_steps_as_unknowns() -> None:
    """Anderson's mixing is then equivalent to GMRES, also where plain iteration diverges and scales differ widely."""
    rng = np.random.default_rng(1)
    n, scale = 6, 10.0 ** np.arange(6)
    matrix = scale[:, None] * (-2.5 * np.eye(n) + 0.8 * rng.standard_normal((n, n))) / scale
    solution = scale * rng.standard_normal(n)
    assert np.abs(np.linalg.eigvals(np.eye(n) + matrix)).max() > 1.2
    mixing, x, errors = Mixing(10.0, 1060.0), np.zeros(n), []
    for _ in range(n + 2):
        x = mixing.next(x, matrix @ (x - solution), scale)
        errors.append(np.abs((x - solution) / scale).max())
    assert errors[0] > 0.1
    assert errors[n] < 1e-9
    other = scale * rng.standard_normal(n)
    again = mixing.of(10.0 + 1e-9, 1060.0)
    x = again.next(x, matrix @ (x - other), scale)
    assert np.abs((x - other) / scale).max() < 1e-6  # what was learnt of the matrix serves for another right side
    x = mixing.of(10.0, 0.0).next(x, np.ones(n), scale)
    assert x == pytest.approx(other + 1.0, rel=1e-5)  # and not for another matrix


def test_mixing_where_a_step_has_changed_nothing() -> None:
    """Two equal steps teach nothing, and do no harm."""
    mixing, step = Mixing(), np.array([0.5, -1.0])
    points = [np.array([1.0, 2.0]), np.array([1.5, 1.0])]
    found = [mixing.next(point, step, np.ones(2)) for point in points]
    assert found[1] == pytest.approx(points[1] + step, rel=1e-12)


def test_first_step_of_mixing_is_plain() -> None:
    assert Mixing().next(np.array([1.0, 2.0]), np.array([0.5, -1.0]), np.ones(2)) == pytest.approx([1.5, 1.0])


def test_solution(make: Make) -> None:
    system = Algebraic()
    solution = make(system).solve(1e-10, 60)
    assert system.values / SCALE == pytest.approx(SOLUTION, rel=1e-9)
    assert set(solution.changes) == set(BLOCKS)
    assert max(solution.changes.values()) < 1e-10
    assert system.prescribed >= 1


@pytest.mark.parametrize("name", BLOCKS)
def test_every_block_converges_against_its_own_scale(make: Make, name: str) -> None:
    """An error of a millionth of the radius is as bad as one of the blood pressure, whichever is the last to go."""
    system = Algebraic(cubic=0.0)
    newton = make(system)
    newton.solve(1e-12, 60)
    system.values[PARTS[name]] += 1e-4 * SCALES[name] * np.array([1.0, -2.0])
    newton.factorisation.matrix *= 1.5  # type: ignore[attr-defined] # so that the first step does not hit
    solution = newton.solve(1e-6, 60)
    assert solution.iterations > 1
    assert np.abs(system.values / SCALE - SOLUTION).max() < 1e-6


def solved(make: Make) -> tuple[Algebraic, Newton]:
    """A solution with factors made near it."""
    system = Algebraic()
    system.values[:] = 1.001 * SCALE * SOLUTION
    newton = make(system)
    solution = newton.solve(1e-10, 60)
    assert (solution.factorisations, solution.iterations <= 5) == (1, True)
    return system, newton


def test_factors_are_kept_while_they_serve(make: Make) -> None:
    system, newton = solved(make)
    for weight, renewed in ((10.0, 0), (11.9, 0), (8.4, 0), (12.1, 1), (14.0, 0), (10.0, 1)):
        system.new_weight.Set(weight)
        system.values[:] *= 1.0 + 1e-3 * RNG.standard_normal(SIZE)
        solution = newton.solve(1e-10, 60)
        assert solution.factorisations == renewed, weight
        assert system.values / SCALE == pytest.approx(SOLUTION, rel=1e-9)


def test_slow_convergence_renews_the_factors_at_the_present_state(make: Make) -> None:
    """Far from the first linearisation; then Newton's method with the exact derivative, which doubles digits."""
    system = Algebraic(cubic=100.0)
    system.values[:] = start = 0.5 * SCALE
    newton = make(system)
    solution = newton.solve(1e-10, 80)
    assert solution.factorisations >= 2
    assert system.values / SCALE == pytest.approx(SOLUTION, rel=1e-9)
    at = newton.factorisation.at  # type: ignore[attr-defined]
    assert np.array_equal(at[0], start)
    assert all(np.any(later != start) for later in at[1:])


def test_newton_as_in_textbooks(make: Make) -> None:
    """Factors of the present state before every update: the error is squared each time."""
    system = Algebraic(linearise="always")
    system.values[:] = 1.3 * SCALE * SOLUTION
    newton = make(system)
    solution = newton.solve(1e-10, 60)
    assert solution.factorisations == solution.iterations
    assert system.values / SCALE == pytest.approx(SOLUTION, rel=1e-9)
    at = newton.factorisation.at  # type: ignore[attr-defined]
    errors = np.array([np.abs(state / SCALE - SOLUTION).max() for state in at])
    assert np.all(errors[1:] < 2 * np.maximum(errors[:-1] ** 2, 1e-15))
    assert newton.solve(1e-10, 60).factorisations == 1


def test_new_factors_when_slow_steps_have_cost_as_much(make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    system, newton = solved(make)
    monkeypatch.setattr(module, "FEWEST", 1)
    cost = module.renewal_cost(SIZE, iterates=False)
    excess, renewed = newton._excess, []
    for _ in range(30):
        system.values[:] *= 1.001
        solution = newton.solve(1e-10, 60)
        renewed.append(solution.factorisations)
        assert solution.factorisations == (excess >= cost)
        excess = (0 if solution.factorisations else excess) + solution.iterations - 1
    assert 1 <= sum(renewed) < 10


@pytest.mark.parametrize("rounding", [0.01, 30.0, np.nan])
def test_factors_of_single_precision_serve_while_the_solution_converges(make: Make, rounding: float) -> None:
    """Once renewed ones are too slow, or the solve fails, the same is solved with others, and so is what follows."""
    system = Algebraic()
    system.values[:] = 1.3 * SCALE * SOLUTION
    newton = make(system)
    dense: Any = newton.factorisation
    dense.rounding = rounding * RNG.standard_normal((SIZE, SIZE))
    newton.solve(1e-10, 60)
    assert system.values / SCALE == pytest.approx(SOLUTION, rel=1e-9)
    serves = rounding == 0.01
    assert (dense.rounding is not None) == serves
    kept = newton.arrays()
    other = make(system)
    again: Any = other.factorisation
    again.rounding = rounding * RNG.standard_normal((SIZE, SIZE))
    other.restore(kept)
    assert (again.rounding is not None) == serves
    if not serves:
        np.testing.assert_array_equal(again.matrix, dense.matrix)


def test_fixed_unknowns_stay(make: Make) -> None:
    free = np.ones(SIZE, dtype=bool)
    free[[1, 4]] = False
    system = Algebraic(free=free)
    system.values[[1, 4]] = 0.3 * SCALE[[1, 4]]
    make(system).solve(1e-12, 60)
    assert np.array_equal(system.values[[1, 4]], 0.3 * SCALE[[1, 4]])
    rows = np.asarray(system.part_of_residual().FV().NumPy())
    assert np.abs(rows[free]).max() < 1e-10
    assert np.abs(rows[~free]).min() > 1e-3


def test_chosen_blocks_are_solved_with_the_others_held(make: Make) -> None:
    system = Algebraic()
    system.values[:] = 0.9 * SCALE
    newton = make(system, "w", "p")
    solution = newton.solve(1e-12, 60)
    assert set(solution.changes) == {"w", "p"}
    rows = np.asarray(system.part_of_residual().FV().NumPy())
    for name in BLOCKS:
        assert np.array_equal(system.values[PARTS[name]], 0.9 * SCALE[PARTS[name]]) == (name in "de")
        assert (np.abs(rows[PARTS[name]]).max() < 1e-10) == (name in "wp")


class Rootless(Algebraic):
    """One block's equations, y^2 + 1 = 0, have no real solution."""

    def __init__(self, name: str) -> None:
        super().__init__()
        self.part = PARTS[name]

    def part_of_residual(self) -> Any:
        residual = super().part_of_residual()
        y = self.values[self.part] / SCALE[self.part]
        residual.FV().NumPy()[self.part] = y * y + 1
        return residual

    def jacobian(self) -> Any:
        matrix = super().jacobian()
        matrix[self.part] = 0.0
        y = self.values[self.part] / SCALE[self.part]
        matrix[np.ix_(self.part, self.part)] = np.diag(2 * y / SCALE[self.part])
        return matrix


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("d", "the displacement of the solids still changes by"),
        ("w", "the velocity still changes by"),
        ("p", "the blood pressure still changes by"),
        ("e", "the mesh motion still changes by"),
    ],
)
def test_failure_restores_the_state_and_names_the_block(make: Make, name: str, words: str) -> None:
    system = Rootless(name)
    system.values[:] = start = SCALE * RNG.uniform(0.3, 0.6, SIZE)
    with pytest.raises(
        SolverError,
        match=rf"did not converge in (17|12) iterations: {words} .* of its scale \({re.escape(f'{SCALES[name]:.3g}')}",
    ):
        make(system).solve(1e-10, 17)
    assert np.array_equal(system.values, start)


def test_not_finite(make: Make) -> None:
    """Noticed at once; the state is as before, and the next solve starts with new factors."""
    system = Algebraic()
    newton = make(system)
    newton.solve(1e-10, 60)
    start = system.values.copy()
    system.cubic = np.nan
    with pytest.raises(SolverError, match="met values that are not finite after 1 iterations"):
        newton.solve(1e-10, 60)
    assert np.array_equal(system.values, start)
    system.cubic = 0.2
    assert newton.solve(1e-10, 60).factorisations >= 1
    assert system.values / SCALE == pytest.approx(SOLUTION, rel=1e-9)


def test_factors_of_the_steps_to_come(make: Make) -> None:
    """One step with another weight takes the factors of those after it: they need no others, and the weight stays."""
    system, newton = solved(make)
    for weight, ahead, renewed in ((10.0, 15.0, 1), (15.0, 15.0, 0), (10.0, None, 1), (10.0, 11.0, 0)):
        system.new_weight.Set(weight)
        assert newton.solve(1e-10, 60, ahead).factorisations == renewed, (weight, ahead)
        assert system.new_weight.Get() == weight


def test_new_factors_cost_what_was_measured() -> None:
    """In iterations, each a residual and a solution, for all rows of the table of docs/solvers.md 0.9 to 2.0 times
    as much."""
    text = (Path(__file__).parents[2] / "docs" / "solvers.md").read_text(encoding="utf-8")
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if "size " in line]
    measured = [row for row in rows if len(row) == 9 and row[2] in ("pardiso", "p_multigrid")]
    assert len(measured) > 12
    for row in measured:
        residual, assembly, renewal, solution = map(float, row[3:7])
        found = module.renewal_cost(int(row[1].replace(",", "")), iterates=row[2] == "p_multigrid")
        assert 0.8 < found * (residual + solution) / (assembly + renewal) < 2.1, row
