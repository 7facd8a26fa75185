"""Solution of the linearised system: static condensation, and factorisations that outlive their matrix."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import ngsolve as ng
import numpy as np

from ngfsi.arrays import Array, Mask, Numbers
from ngfsi.errors import SolverError
from ngfsi.linear.backends import BACKENDS, Name
from ngfsi.linear.levels import Levels
from ngfsi.parallel.ranks import SERIAL, Ranks
from ngfsi.parallel.stopwatch import Stopwatch
from ngfsi.system.sparse import pattern, ranges


class Factorisation:
    """LU factors of a form's linearisation on chosen unknowns.

    The factors and the condensation operators stay those of the last `renew`, whatever happens to the state.
    """

    def __init__(
        self, form: ng.BilinearForm, free: Mask, backend: Name, equations: Numbers | None = None,
        watch: Stopwatch | None = None, levels: Callable[[], Levels] | None = None,
        scale: Callable[[], Array] | None = None, ranks: Ranks = SERIAL, less: tuple[Numbers, Numbers] | None = None,
    ) -> None:  # fmt: skip
        """Prepare.

        Args:
            equations: number of the form's row that is each unknown's equation, an involution; default: its own.
            watch: takes the seconds of assembly, factorisation and solves.
            levels: returns those of p-multigrid, for a solver that iterates.
            scale: returns that of each unknown, in whose measure such a solver judges its error; default: 1.
            ranks: ranks of which each has a partition of the form, and which all call `renew` and `solve`.
            less: unknowns from whose equations those of as many others, with entries in the same columns, are taken.
        """
        self.form, self.backend, self.count = form, backend, 0
        self._watch, self._ranks = watch or Stopwatch(), ranks
        self._equations = np.arange(form.space.ndof) if equations is None else equations
        self._solved = ng.BitArray(list(free & np.array(list(form.space.FreeDofs(form.condense)))))
        self._rows: tuple[Numbers, Numbers] | None = None
        self._less = less if less is not None and len(less[0]) else None
        self._inverse: Any = None
        self._iterates = BACKENDS[backend].iterates
        self._levels, self._scale = levels, scale

    def renew(self, state: Any) -> None:
        """Linearise at `state` and factorise.

        Raises:
            SolverError: the matrix is singular or not finite.
        """
        try:
            with self._watch("assembly"):
                self._ranks.together(lambda: self._assemble(state))
            with self._watch("factorisation"):
                self._inverse = self._factors(self._inverse, shared=self._ranks.size > 1)
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

        `residual` has the equation of each unknown in that unknown's place, and is overwritten.

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
            condensed = self._of_all(self.form.harmonic_extension_trans * raw).FV().NumPy()[self._equations]
            if self._less:
                condensed[self._less[0]] -= condensed[self._less[1]]
            values += condensed
            self._invert(residual, update)
            update.data += self._of_all(self.form.harmonic_extension * update + self.form.inner_solve * raw)

    def solve_transposed(self, right: Any, result: Any) -> None:
        """Write the solution of (linearisation)^T result = right, zero on fixed unknowns, to `result`.

        For direct solvers, and a form without condensation.
        """
        assert not self.form.condense
        assert not self._iterates
        with self._watch("solves"):
            result.data = self._inverse.T * right

    def _invert(self, right: Any, result: Any) -> None:
        if self._iterates:
            result.FV().NumPy()[:] = self._inverse.solve(right)
        else:
            result.data = self._inverse * right

    def _of_all(self, product: Any) -> Any:
        """Return the sum over all ranks of a product with an operator of their elements."""
        vector = product.Evaluate()
        self._ranks.add(vector.FV().NumPy())
        return vector
