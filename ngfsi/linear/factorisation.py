"""Solution of the linearised system: static condensation, and factorisations that outlive their matrix."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import ngsolve as ng
import numpy as np

from ngfsi.arrays import Array, Mask, Numbers
from ngfsi.errors import SolverError
from ngfsi.linear.backends import BACKENDS, Name, choose_backend, of_double_precision
from ngfsi.linear.levels import Levels
from ngfsi.parallel.ranks import SERIAL, Ranks
from ngfsi.parallel.stopwatch import Stopwatch
from ngfsi.system.sparse import csr, pattern, ranges

WORTH = 0.15
"""Fraction of the unknowns from which it pays to solve for them after the others: with a fifth of them factors take two
thirds of the time and the memory; a step of the calf, where they are 11 %, one iteration more."""


@dataclass(frozen=True)
class Last:
    """Unknowns that may be solved for after the others: two small factorisations in place of a large one.

    That is not the exact linearisation: what the others' equations know of them is left out, but for the sum of an
    other and the rate of one of these, which is kept when the latter is found: the velocity of the blood is that of
    the mesh, whose motion is found last, and the one relative to it.

    Attributes:
        unknowns: their numbers.
        others: of as many others, each in a sum with the rate of one of these.
        rate: returns by how much the rate of one of these changes with it (1/s), in the system that is linearised.
    """

    unknowns: Numbers
    others: Numbers
    rate: Callable[[], float]


class Factorisation:
    """LU factors of a form's linearisation on chosen unknowns.

    The factors and the condensation operators stay those of the last `renew`, whatever happens to the state.
    """

    def __init__(
        self, form: ng.BilinearForm, free: Mask, backend: Name, equations: Numbers | None = None,
        watch: Stopwatch | None = None, levels: Callable[[], Levels] | None = None,
        scale: Callable[[], Array] | None = None, ranks: Ranks = SERIAL, less: tuple[Numbers, Numbers] | None = None,
        last: Last | None = None,
    ) -> None:  # fmt: skip
        """Prepare.

        Args:
            equations: number of the form's row that is each unknown's equation, an involution; default: its own.
            watch: takes the seconds of assembly, factorisation and solves.
            levels: returns those of p-multigrid, for a solver that iterates.
            scale: returns that of each unknown, in whose measure such a solver judges its error; default: 1.
            ranks: ranks of which each has a partition of the form, and which all call `renew` and `solve`.
            less: unknowns from whose equations those of as many others, with entries in the same columns, are taken.
            last: what is left out of the equations of the other unknowns, and solved for after them by a direct solver.
        """
        self.form, self.backend, self.count = form, backend, 0
        self._watch, self._ranks = watch or Stopwatch(), ranks
        self._equations = np.arange(form.space.ndof) if equations is None else equations
        solved = free & np.array(list(form.space.FreeDofs(form.condense)))
        self._iterates = BACKENDS[backend].iterates
        after = np.zeros_like(solved)
        if last is not None and (self._iterates is None or ranks.size == 1):
            after[last.unknowns] = solved[last.unknowns]
        if not WORTH * np.sum(solved) <= np.sum(after) < np.sum(solved):
            after[:] = False
        self._solved, self._after = (ng.BitArray(list(rows)) for rows in (solved & ~after, after))
        self._last = np.flatnonzero(after)
        if last is not None:
            both = after[last.unknowns] & solved[last.others]
            self._pairs, self._rate_of = (last.others[both], last.unknowns[both]), last.rate
        self._rate = 0.0
        self._rows: tuple[Numbers, Numbers] | None = None
        self._less = less if less is not None and len(less[0]) else None
        self._inverse: Any = None
        self._inverse_of_last: Any = None
        self._rows_of_last: Any = None
        self._levels, self._scale = levels, scale

    def sharpen(self) -> bool:
        """Make factors of double precision from the next `renew` on; return whether they were of single precision."""
        double = of_double_precision(self.backend)
        if double is None:
            return False
        self.backend, self._inverse, self._inverse_of_last = double, None, None
        return True

    def renew(self, state: Any) -> None:
        """Linearise at `state` and factorise.

        Raises:
            SolverError: the matrix is singular or not finite.
        """
        try:
            with self._watch("assembly"):
                self._ranks.together(lambda: self._assemble(state))
            with self._watch("factorisation"):
                shared = self._ranks.size > 1
                self._inverse = self._factors(self._inverse, shared=shared)
                if len(self._last):
                    direct = choose_backend("auto") if self._iterates else self.backend
                    self._inverse_of_last = BACKENDS[direct].factors(
                        self.form.mat, self._after, self._inverse_of_last, shared=shared
                    )
                    self._rows_of_last = csr(self.form.mat)[self._last]
                    self._rate = self._rate_of()
        except Exception as error:  # NGSolve raises its own and generic exceptions for singular element matrices
            if self._ranks.size > 1 and not isinstance(error, SolverError):
                raise  # what the other ranks do not know of cannot be gone on from
            raise SolverError(f"the linearised system could not be factorised: {error}") from error
        self.count += 1

    def _factors(self, old: Any, *, shared: bool) -> Any:
        matrix = self.form.mat
        if self._iterates is None or self._levels is None:
            return BACKENDS[self.backend].factors(matrix, self._solved, old, shared=shared)
        scale = np.ones(matrix.height) if self._scale is None else self._scale()
        if old is None:
            return self._iterates(matrix, self._solved, scale, self._levels(), shared)
        old.update(scale)
        return old

    def _assemble(self, state: Any) -> None:
        """Linearise, and put each equation into the row of its unknown."""
        self.form.AssembleLinearization(state)
        self._rows = self._rows or self._moved_rows()
        target, source = self._rows
        values = self.form.mat.AsVector().FV().NumPy()
        values[target] = values[source]
        if self._less:
            lessened, others = (self._entries(rows)[0] for rows in self._less)
            values[lessened] -= values[others]

    def _moved_rows(self) -> tuple[Numbers, Numbers]:
        """Return where the entries of the rows that move are to be, and where they are."""
        moved = np.flatnonzero(self._equations != np.arange(len(self._equations)))
        (target, columns), (source, others) = (self._entries(rows) for rows in (moved, self._equations[moved]))
        if not np.array_equal(columns, others):
            raise SolverError("equations can be exchanged only between rows with entries in the same columns")
        return target, source

    def _entries(self, rows: Numbers) -> tuple[Numbers, Numbers]:
        """Return where the entries of rows are, one row after the other, and their columns."""
        columns, starts = pattern(self.form.mat)
        entries = ranges(starts[rows], starts[rows + 1])
        return entries, columns[entries]

    @property
    def linear_iterations(self) -> int:
        """Iterations of an iterative solver since the beginning; 0 for a direct one."""
        return int(self._inverse.iterations) if self._iterates and self._inverse is not None else 0

    def solve(self, residual: Any, update: Any) -> None:
        """Write the solution of (linearisation) update = residual, zero on fixed unknowns, to `update`.

        `residual` has the equation of each unknown in that unknown's place, and is overwritten. On several ranks it is
        this rank's part of a sum, and `update` is known where the rank has elements.

        Raises:
            SolverError: an iterative solver does not converge.
        """
        with self._watch("solves"):
            if not self.form.condense:
                self._invert(residual, update)
                return
            values = residual.FV().NumPy()
            raw = residual.CreateVector()
            raw.FV().NumPy()[self._equations] = values
            condensed = (self.form.harmonic_extension_trans * raw).Evaluate().FV().NumPy()[self._equations]
            if self._less:
                condensed[self._less[0]] -= condensed[self._less[1]]
            values += condensed
            self._invert(residual, update)
            update.data += self.form.harmonic_extension * update + self.form.inner_solve * raw

    def solve_transposed(self, right: Any, result: Any) -> None:
        """Write the solution of (linearisation)^T result = right, zero on fixed unknowns, to `result`.

        For direct solvers, and a form without condensation. What is solved for after the others is so before them here;
        `right` is overwritten.
        """
        assert not self.form.condense
        assert not self._iterates
        with self._watch("solves"):
            if not len(self._last):
                result.data = self._inverse.T * right
                return
            values, (others, these) = right.FV().NumPy(), self._pairs
            values[these] -= self._rate * values[others]
            before = right.CreateVector()
            before.data = self._inverse_of_last.T * right
            values -= self._rows_of_last.T @ before.FV().NumPy()[self._last]
            result.data = self._inverse.T * right
            result.data += before

    def _invert(self, right: Any, result: Any) -> None:
        if self._iterates:
            result.FV().NumPy()[:] = self._inverse.solve(right)
        else:
            result.data = self._inverse * right
        if len(self._last):
            right.FV().NumPy()[self._last] -= self._rows_of_last @ result.FV().NumPy()
            result.data += self._inverse_of_last * right
            others, these = self._pairs
            values = result.FV().NumPy()
            values[others] -= self._rate * values[these]
