"""GMRES with a two-level p-multigrid, physics by physics: for systems whose factors no longer fit.

The preconditioner is block triangular, one correction after the other:

1. blood, wall and the tissue's functions of first order, by a direct solver. The basis is hierarchical, so their matrix
   is a part of the whole one. The blood's added mass and the thin, stiff wall, which no smoother bears, are in it;
2. mesh motion, which follows from the wall, by a direct solver;
3. the tissue, by one sweep of block Gauss-Seidel over the patches of elements around its vertices, with which
   iterations do not grow with the order (Schöberl, Melenk, Pechstein and Zaglmayr, IMA J Numer Anal 28, 2008).

docs/solvers.md has the numbers of iterations, and from which size on this is faster than a direct solver.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import ngsolve as ng
import numpy as np
from scipy.sparse.linalg import LinearOperator, gmres

from ngfsi.arrays import Array
from ngfsi.errors import SolverError
from ngfsi.linear.levels import Levels
from ngfsi.system.sparse import csr

TOLERANCE = 1e-2
"""Of an update, over the scales of its unknowns; Newton's iterations refine it, and hardly take more."""
MOST_ITERATIONS = 100
"""More of them mean that the preconditioner does not fit the matrix."""


class PMultigrid:
    """Solver of a matrix by GMRES with this preconditioner.

    Attributes:
        iterations: of GMRES since the beginning.
    """

    def __init__(
        self, matrix: Any, rows: ng.BitArray, scale: Array, levels: Levels, factors: Callable[..., Any]
    ) -> None:
        """Set up.

        Args:
            rows: the unknowns to solve for.
            scale: of each unknown, in whose measure GMRES judges its error.
            factors: of a direct solver: takes a matrix, the rows and its old result, if any.
        """
        self.iterations = 0
        self._matrix, self._factors = matrix, factors
        solved = np.array(list(rows), dtype=bool)
        self._free = np.flatnonzero(solved)
        self._groups, patches = levels.among(solved)
        self._patches = [patch.tolist() for patch in patches]
        self._inverses: list[Any] = [None] * len(self._groups)
        self._x, self._y, self._defect, self._correction = (matrix.CreateColVector() for _ in range(4))
        for vector in (self._x, self._defect):  # of which only parts are written
            vector[:] = 0.0
        self.update(scale)

    def update(self, scale: Array) -> None:
        """Take the new values of the matrix, which then must stay until the next update, and new scales."""
        self._scale = scale[self._free]
        whole = csr(self._matrix)
        # the rows alone whose defect is wanted
        self._rows = [whole[group] for group in self._groups[1:]]
        for i, group in enumerate(self._groups):
            chosen = ng.BitArray(self._matrix.height)
            chosen.Clear()
            for number in group:
                chosen[int(number)] = True
            self._inverses[i] = self._factors(self._matrix, chosen, self._inverses[i])
        self._smoother = None  # its memory is free before the new one takes it
        self._smoother = self._matrix.CreateBlockSmoother(self._patches) if self._patches else None

    def solve(self, right: Any) -> Array:
        """Return the solution, its error below `TOLERANCE` in the Euclidean norm of the unknowns over their scales.

        Raises:
            SolverError: GMRES needs more than `MOST_ITERATIONS`.
        """
        measure = self._scale
        operator = LinearOperator(
            (len(measure), len(measure)), matvec=lambda x: self._applied(x * measure) / measure, dtype=float
        )
        found, failed = gmres(
            operator, self._precondition(right) / measure, rtol=TOLERANCE, restart=MOST_ITERATIONS, maxiter=1,
            callback=self._count, callback_type="pr_norm",
        )  # fmt: skip
        if failed:
            raise SolverError(f"GMRES did not solve the linearised system in {MOST_ITERATIONS} iterations")
        solution = np.zeros(self._matrix.height)
        solution[self._free] = found * measure
        return solution

    def _count(self, _norm: float) -> None:
        self.iterations += 1

    def _applied(self, x: Array) -> Array:
        self._x.FV().NumPy()[self._free] = x
        self._y.data = self._matrix * self._x
        return self._precondition(self._y)

    def _precondition(self, right: Any) -> Array:
        """Return the result of one sweep over physics and patches, from zero."""
        total = self._correction
        first, *others = self._inverses
        total.data = first * right
        values, wanted = (vector.FV().NumPy() for vector in (total, right))
        for group, rows, inverse in zip(self._groups[1:], self._rows, others, strict=True):
            self._defect.FV().NumPy()[group] = wanted[group] - rows @ values
            total.data += inverse * self._defect
        if self._smoother is not None:
            self._smoother.SmoothBack(total, right)
        return np.asarray(values[self._free])
