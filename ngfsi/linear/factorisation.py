"""Solution of the linearised system: static condensation, and factorisations that outlive their matrix."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import ngsolve as ng
import numpy as np

from ngfsi.arrays import Array, Mask, Numbers
from ngfsi.errors import SolverError
from ngfsi.linear.backends import BACKENDS, Iterative, Name
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
        scale: Callable[[], Array] | None = None, ranks: Ranks = SERIAL,
    ) -> None:  # fmt: skip
        """Prepare.

        Args:
            equations: number of the form's row that is each unknown's equation, an involution; default: its own.
            watch: takes the seconds of assembly, factorisation and solves.
            levels: returns those of p-multigrid, for a solver that iterates.
            scale: returns that of each unknown, in whose measure such a solver judges its error; default: 1.
            ranks: ranks of which each has a partition of the form, and which all call `renew` and `solve`.
        """
        self.form = form
        self.backend = backend
        self.count = 0
        self._watch, self._ranks = watch or Stopwatch(), ranks
        self._equations = np.arange(form.space.ndof) if equations is None else equations
        self._solved = ng.BitArray(list(free & np.array(list(form.space.FreeDofs(form.condense)))))
        self._target: Numbers | None = None
        self._inverse: Any = None
        self._iterates = isinstance(BACKENDS[backend], Iterative)
        self._levels = levels
        self._scale = scale

    def renew(self, state: Any) -> None:
        """Linearise at `state` and factorise.

        Raises:
            SolverError: the matrix is singular or not finite.
        """
        try:
            with self._watch("assembly"):
                self._ranks.together(lambda: self._assemble(state))
            with self._watch("factorisation"):
                backend, shared = BACKENDS[self.backend], self._ranks.size > 1
                self._inverse = backend.factors(
                    self.form.mat, self._solved, self._inverse, self._levels, self._scale, shared=shared
                )
        except Exception as error:  # NGSolve raises its own and generic exceptions for singular element matrices
            if self._ranks.size > 1 and not isinstance(error, SolverError):
                raise  # what the other ranks do not know of cannot be gone on from
            raise SolverError(f"the linearised system could not be factorised: {error}") from error
        self.count += 1

    def _assemble(self, state: Any) -> None:
        self.form.AssembleLinearization(state)
        self._take_rows()

    def _take_rows(self) -> None:
        """Put each equation into the row of its unknown."""
        if self._target is None:
            self._target, self._source = self._entries()
        values = self.form.mat.AsVector().FV().NumPy()
        values[self._target] = values[self._source]

    def _entries(self) -> tuple[Numbers, Numbers]:
        """Return where the entries of the rows that move are to be, and where they are."""
        columns, starts = pattern(self.form.mat)
        moved = np.flatnonzero(self._equations != np.arange(len(self._equations)))
        target, source = (ranges(starts[rows], starts[rows + 1]) for rows in (moved, self._equations[moved]))
        if not np.array_equal(columns[target], columns[source]):
            raise SolverError("equations can be exchanged only between rows with entries in the same columns")
        return target, source

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
            self._solve(residual, update)

    def _invert(self, right: Any, result: Any) -> None:
        if self._iterates:
            result.FV().NumPy()[:] = self._inverse.solve(right)
        else:
            result.data = self._inverse * right

    def _solve(self, residual: Any, update: Any) -> None:
        if not self.form.condense:
            self._invert(residual, update)
            return
        values = residual.FV().NumPy()
        raw = residual.CreateVector()
        raw.FV().NumPy()[self._equations] = values
        raw.data += self._of_all(self.form.harmonic_extension_trans * raw)
        values[:] = raw.FV().NumPy()[self._equations]
        self._invert(residual, update)
        update.data += self._of_all(self.form.harmonic_extension * update + self.form.inner_solve * raw)

    def _of_all(self, product: Any) -> Any:
        """Return the sum over all ranks of a product with an operator of their elements."""
        vector = product.Evaluate()
        self._ranks.add(vector.FV().NumPy())
        return vector
