"""Quasi-Newton with a factorisation kept over iterations and steps, accelerated by Anderson mixing.

With an old factorisation J0 the map x -> x - J0^-1 r(x) is a contraction near the solution; Anderson's mixing
(Walker and Ni, SIAM J. Numer. Anal. 49, 2011) combines its last results by least squares, across solves as in the
coupling of codes (Degroote, Bathe and Vierendeels, Comput Struct 87, 2009). When the contraction is too
slow the system is linearised anew at the present state; if it stays slow that happens in every iteration, which is
Newton's method with the exact Jacobian.

The rule of renewal, in one place:
  before a step   the time scheme's weight of the new state in the steps to come differs from that of the factors by
                  more than 20 % (`Newton.solve`), or the iterations beyond `FEWEST` of all steps with these factors
                  have come to what new ones cost (`renewal_cost`): if they grow evenly, the sum of both is then least;
                  the factors are those of the steps to come, which a single step of backward Euler before can use, too;
  within a step   `PATIENCE` iterations do not reduce the change to a third, or it grows to `GROWTH` times the first.
Factors of single precision make place for ones of double precision, for the rest of the run, where they were made in
this step and still are too slow, or the solve fails.
With solver.linearise = "always" it happens before every update. Newton's method that makes the change grow as much has
diverged, and the solve is given up.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from ngfsi.arrays import Array, Mask, part_of
from ngfsi.errors import SolverError
from ngfsi.linear.backends import BACKENDS, Name
from ngfsi.linear.factorisation import Factorisation, Last
from ngfsi.linear.levels import levels_of
from ngfsi.parallel.ranks import SERIAL, Ranks
from ngfsi.system.system import System
from ngfsi.system.together import OnAllRanks, together
from ngfsi.system.unknowns import NAMES

FEWEST = 4
"""Iterations that a step takes with fresh factors."""
PATIENCE = 4
"""Iterations in which the change must fall to a third."""
GROWTH = 20.0
"""Of the change over the first one of a solve, from which it counts as diverging."""
WEIGHT_DRIFT = 1.2
"""Ratio of the time scheme's weights of the new state, now and in the factors, that calls for new factors."""
DEPTH = 20
"""Number of differences that Anderson mixing keeps."""
SAME_EQUATIONS = 1e-6
"""Relative difference of the parameters of steps that are as long but for rounding."""
DEPENDENT = 1e-12
"""Differences that depend on each other up to the root of this fraction add nothing."""
FACTORED_KEPT = 2
"""Number of last states of factorisation that are kept."""


Way = Literal["plainly", "mixed", "halfway back"]


def renewal_cost(unknowns: int, *, iterates: bool) -> float:
    """Return how many iterations take as long as new factors, from docs/solvers.md: by the number of unknowns alone, so
    that a run does the same again on a busy machine."""
    return float((unknowns / 50) ** 0.4) if iterates else 20 + unknowns / 1500


@dataclass
class Solution:
    """What a solve took."""

    iterations: int = 0
    factorisations: int = 0
    linear_iterations: int = 0
    changes: dict[str, float] = field(default_factory=dict)

    def __add__(self, other: Solution) -> Solution:
        """Return what both took, with the changes of the other, which was later."""
        return Solution(self.iterations + other.iterations, self.factorisations + other.factorisations,
                        self.linear_iterations + other.linear_iterations, other.changes)  # fmt: skip


class Mixing:
    """Anderson's mixing of the iterates x with steps g, measured in the scale of each unknown.

    Differences of earlier solves with the same factors serve on: they say the same about these factors.
    """

    def __init__(self, *equations: float, ranks: Ranks = SERIAL) -> None:
        """Begin.

        Args:
            equations: parameters of which the derivatives depend.
            ranks: each of which has a part of the unknowns, and does the same.
        """
        self._equations, self._ranks = np.array(equations), ranks
        self._count = 0
        self._rows = np.zeros((2, 0, 0))
        """Differences of g, and of x + g; the next one takes the place of the oldest."""
        self._products = np.zeros((DEPTH, DEPTH))
        """Of the differences of g, in the scale of this solve."""
        self._last: tuple[Array, Array] | None = None

    def arrays(self) -> dict[str, Array]:
        """Return what it has learnt as plain arrays, for storage."""
        known = self._rows[:, : self._known]
        return {"equations": self._equations, "rows": known.copy(), "count": np.array(self._count)}

    @classmethod
    def stored(cls, arrays: Mapping[str, Array], ranks: Ranks = SERIAL) -> Mixing:
        """Return the mixing stored as `arrays`."""
        mixing, rows = cls(*arrays["equations"], ranks=ranks), arrays["rows"]
        mixing._count = int(arrays["count"])
        mixing._rows = np.empty((2, DEPTH if mixing._count else 0, rows.shape[2]))
        mixing._rows[:, : mixing._known] = rows
        return mixing

    def of(self, *equations: float) -> Mixing:
        """Return the mixing of another solve with the same factors: this one, or a new one for other equations."""
        if not np.allclose(equations, self._equations, rtol=SAME_EQUATIONS, atol=0.0):
            return Mixing(*equations, ranks=self._ranks)
        self._last = None
        return self

    def next(self, x: Array, g: Array, scale: Array) -> Array:
        """Return the next iterate from the point x and its plain step g; in a solve the scale stays the same."""
        weight = scale**-2
        if self._last is not None:
            self._learn(x - self._last[0], g - self._last[1], weight)
        elif self._known:
            rows = self._rows[0, : self._known] / scale
            self._products[: self._known, : self._known] = self._summed(rows @ rows.T)
        self._last = x, g
        if not self._known:
            return x + g
        rows, both = self._rows[:, : self._known]
        found = self._least_squares(rows, self._products[: self._known, : self._known], weight, g)
        return np.asarray(x + g - found @ both)

    @property
    def _known(self) -> int:
        return min(self._count, DEPTH)

    def _learn(self, dx: Array, dg: Array, weight: Array) -> None:
        if not self._count:
            self._rows = np.empty((2, DEPTH, len(dx)))
        at = self._count % DEPTH
        self._rows[0, at], self._rows[1, at] = dg, dx + dg
        self._count += 1
        products = self._summed(self._rows[0, : self._known] @ (weight * dg))
        self._products[at, : self._known] = self._products[: self._known, at] = products

    def _summed(self, products: Array) -> Array:
        """Return the sum over the parts of all ranks."""
        self._ranks.add(products)
        return products

    def _least_squares(self, rows: Array, products: Array, weight: Array, wanted: Array) -> Array:
        """Return the weights of the rows, few and long, whose sum comes closest to a vector, by given weights of
        entries.

        By normal equations of the rows at unit length, in a third of the time of an orthogonal factorisation; a
        correction for what is left makes up for their rounding.

        Args:
            products: of the rows with each other.
        """
        lengths = np.sqrt(np.diag(products))
        lengths[lengths == 0.0] = 1.0
        inverse = np.linalg.pinv(products / np.outer(lengths, lengths), rcond=DEPENDENT, hermitian=True)
        found = np.zeros(len(rows))
        for again in (False, True):
            left = wanted - found @ rows if again else wanted
            found += inverse @ (self._summed(rows @ (weight * left)) / lengths) / lengths
        return found


class Newton(OnAllRanks):
    """Solver of a system's nonlinear equations on the unknowns of the named blocks (all if none is named).

    Rank 0 decides; of iterates, updates and what mixing has learnt each rank has its own unknowns.
    """

    def __init__(self, system: System, backend: Name, *blocks: str) -> None:
        self.blocks = blocks or tuple(name for name, part in system.unknowns.blocks.items() if len(part))
        self.free: Mask = system.unknowns.free(*blocks)
        with system.ranks.order("newton", lambda: backend, lambda: blocks):
            super().__init__(system)
            self._distribution = system.distribution(self.free)
        self._mine = np.flatnonzero(self.free)[self._distribution.mine]
        self._always = system.case.solver.linearise == "always"
        self.factorisation = Factorisation(
            system.tangent, self.free, backend, system.unknowns.equations, system.watch,
            lambda: levels_of(system.domain, system.unknowns), lambda: self._scale_vector(system.block_scales()),
            system.ranks, system.unknowns.less, None if self._always else self._last(),
        )  # fmt: skip
        self._factored_weight: float | None = None
        self._cost = renewal_cost(system.unknowns.size, iterates=BACKENDS[backend].iterates is not None)
        self._excess = 0
        self._sharpened = False
        self._factored_at: list[dict[str, Array]] = []
        self._mixing = Mixing(*self._equations(), ranks=system.ranks)
        self._update = system.state.vec.CreateVector()
        self._scale = self._x = self._step = self._best = np.zeros(0)

    def arrays(self) -> dict[str, Array]:
        """Return as plain arrays what the next solve depends on, for `restore`: of the factors, where they were made.

        Those are the first and the last point: Pardiso orders and scales every matrix as the first one.
        """
        kept = {f"point{i}.{name}": part for i, point in enumerate(self._factored_at) for name, part in point.items()}
        kept |= {f"mixing.{name}": part for name, part in self._learnt().items()}
        weight = np.nan if self._factored_weight is None else self._factored_weight
        return kept | {"renewal": np.array([weight, self._excess, self._sharpened])}

    def restore(self, arrays: Mapping[str, Array]) -> None:
        """Go on as the solver that returned `arrays`; its factors are made again, and the system is left there."""
        weight, excess, sharpened = arrays["renewal"]
        self._factored_at = []
        if sharpened:
            self._sharpen()
        for i in range(FACTORED_KEPT):
            if point := part_of(arrays, f"point{i}"):
                self.system.restore(point)
                self._factorise()
        self._factored_weight = None if np.isnan(weight) else float(weight)
        self._excess = int(excess)
        self._learn(part_of(arrays, "mixing"))

    @together
    def _learnt(self) -> dict[str, Array]:
        """Return what mixing has learnt, on rank 0."""
        arrays = self._mixing.arrays()
        if arrays["rows"].size:
            arrays["rows"] = self._distribution.collected(arrays["rows"])
        return arrays

    @together
    def _learn(self, arrays: dict[str, Array]) -> None:
        if arrays["rows"].size:
            arrays = arrays | {"rows": arrays["rows"][..., self._distribution.mine]}
        self._mixing = Mixing.stored(arrays, self.system.ranks)

    def solve(self, tolerance: float, max_iterations: int, ahead: float | None = None) -> Solution:
        """Solve from the present state; the solution becomes the state.

        Converged when the change of every block, largest over its unknowns, is below `tolerance` times its scale.

        Args:
            ahead: weight of the new state in the steps to come (1/s); None: that of this solve.

        Raises:
            SolverError: no convergence; names the block, and the state is left as it was.
        """
        start = self.system.values.copy()
        if ahead is None or self._always:
            ahead = self.system.new_weight.Get()
        try:
            solution = self._iterate(tolerance, max_iterations, ahead)
        except SolverError:
            self.system.values[:] = start
            self._factored_weight = None
            if not self._sharpen():
                raise
            return self.solve(tolerance, max_iterations, ahead)
        self._excess += max(0, solution.iterations - FEWEST)
        return solution

    def _iterate(self, tolerance: float, max_iterations: int, ahead: float) -> Solution:
        solution = Solution()
        scales = self.system.block_scales()
        taken = self.factorisation.linear_iterations
        if self._needs_renewal(ahead):
            self._renew(solution, ahead)
        self._begin(scales)
        history: list[float] = []
        always_renew, first = self._always, 0.0
        while solution.iterations < max_iterations:
            solution.iterations += 1
            self.system.prescribe()
            solution.changes = self._plain_step(scales)
            solution.linear_iterations = self.factorisation.linear_iterations - taken
            change = max(solution.changes.values())
            first = first or change
            if not np.isfinite(change) or (always_renew and change > GROWTH * first):
                break
            if change < tolerance:
                self._go("plainly")
                self.system.prescribe()
                return solution
            history.append(change)
            best = change == min(history)
            if not always_renew and not self._too_slow(history):
                self._go("mixed", best=best)
                continue
            always_renew = always_renew or solution.factorisations >= 2
            if solution.factorisations:
                self._sharpen()
            # the best state may be that of the factors, where renewing them would change nothing
            self._go("halfway back" if self._grown(history) else "plainly", best=best)
            self._renew(solution, self.system.new_weight.Get())
            history = []
        raise SolverError(self._failure_message(solution, scales))

    @together
    def _begin(self, scales: Mapping[str, float]) -> None:
        """Begin to solve from the present state."""
        self._scale = self._scale_vector(scales)[self._mine]
        self._mixing = self._mixing.of(*self._equations())
        self._best = self.system.values[self._mine]

    @together
    def _plain_step(self, scales: Mapping[str, float]) -> dict[str, float]:
        """Find the plain step from the present state, and return the change of each block over its scale."""
        residual = self.system.part_of_residual()
        residual.FV().NumPy()[~self.free] = 0.0
        self.factorisation.solve(residual, self._update)
        self._x, self._step = self.system.values[self._mine], -np.asarray(self._update.FV().NumPy()[self._mine])
        return self._changes(scales)

    @together
    def _go(self, way: Way, *, best: bool = False) -> None:
        """Go to the next state: by the plain step, by that of mixing, or to the middle between this and the best state.

        Args:
            best: whether this state is the best one.
        """
        x, step = self._x, self._step
        self._best = x if best else self._best
        if way == "mixed":
            new = self._mixing.next(x, step, self._scale)
        else:
            new = x + step if way == "plainly" else (self._best + x) / 2
        self.system.values[self.free] = self._distribution.whole(new)
        self.system.all_have_state()

    def _needs_renewal(self, weight: float) -> bool:
        if self._factored_weight is None or self._excess >= self._cost or self._always:
            return True
        return max(weight, self._factored_weight) > WEIGHT_DRIFT * min(weight, self._factored_weight)

    def _last(self) -> Last | None:
        """Return the mesh motion as what may be solved for last; None: it may not, or there is none."""
        unknowns = self.system.unknowns
        if not unknowns.mesh_follows:
            return None
        return Last(unknowns.blocks["e"], unknowns.blocks["w"], self.system.new_weight.Get)

    def _equations(self) -> tuple[float, float]:
        """Return what the derivatives depend on beside the state: the weight of the new state, the blood's density."""
        return self.system.new_weight.Get(), self.system.blood_density.Get()

    def _renew(self, solution: Solution, weight: float) -> None:
        """Linearise at the present state with a weight of the new state, and factorise."""
        self.system.prescribe()
        present = self.system.new_weight.Get()
        self.system.new_weight.Set(weight)
        self._factorise()
        self.system.new_weight.Set(present)
        self._factored_weight = weight
        self._forget()
        self._excess = 0
        solution.factorisations += 1

    def _sharpen(self) -> bool:
        """Take factors of double precision from now on; return whether they were of single precision."""
        if not self.factorisation.sharpen():
            return False
        self._sharpened, self._factored_at = True, []
        return True

    @together
    def _forget(self) -> None:
        """Forget what mixing has learnt of the factors before."""
        self._mixing = Mixing(*self._equations(), ranks=self.system.ranks)

    @together
    def _make_factors(self) -> None:
        self.factorisation.renew(self.system.state.vec)

    def _factorise(self) -> None:
        self._make_factors()
        self._factored_at = [*self._factored_at[: FACTORED_KEPT - 1], self.system.snapshot()]

    @staticmethod
    def _grown(history: list[float]) -> bool:
        return history[-1] > GROWTH * history[0]

    def _too_slow(self, history: list[float]) -> bool:
        if self._grown(history):
            return True
        return len(history) > PATIENCE and history[-1] > history[-1 - PATIENCE] / 3

    def _scale_vector(self, scales: Mapping[str, float]) -> Array:
        scale = np.ones(self.system.unknowns.size)
        for name in self.blocks:
            scale[self.system.unknowns.blocks[name]] = scales[name]
        return scale

    def _changes(self, scales: Mapping[str, float]) -> dict[str, float]:
        unknowns = self.system.unknowns
        whole = np.zeros(unknowns.size)
        whole[self._mine] = np.abs(self._step)
        largest = np.array([np.max(whole[unknowns.blocks[name]], initial=0.0) for name in self.blocks])
        (found,) = self.system.ranks.smallest(-largest)
        return {name: -float(change) / scales[name] for name, change in zip(self.blocks, found, strict=True)}

    def _failure_message(self, solution: Solution, scales: Mapping[str, float]) -> str:
        finite = {k: v for k, v in solution.changes.items() if np.isfinite(v)}
        if len(finite) < len(solution.changes):
            return f"Newton's method met values that are not finite after {solution.iterations} iterations"
        largest = max(finite, key=lambda name: finite[name])
        return (
            f"Newton's method did not converge in {solution.iterations} iterations: the {NAMES.get(largest, largest)} "
            f"still changes by {finite[largest]:.1e} of its scale ({scales[largest]:.3g} in SI units)"
        )
