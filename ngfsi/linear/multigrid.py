"""GMRES with a two-level p-multigrid, physics by physics: for large systems, whose factors cost too much.

The preconditioner is block triangular, one correction after the other:

1. blood, wall and the tissue's functions of first order, by a direct solver. The basis is hierarchical, so their matrix
   is a part of the whole one. The blood's added mass and the thin, stiff wall, which no smoother bears, are in it;
2. mesh motion, which follows from the wall, by a direct solver, unless it is left to the end (`factorisation.Last`);
3. the tissue, by one sweep of block Gauss-Seidel over the patches of elements around its vertices, with which
   iterations do not grow with the order (Schöberl, Melenk, Pechstein and Zaglmayr, IMA J Numer Anal 28, 2008).

GMRES is in the form of generalised conjugate residuals (Eisenstat, Elman and Schultz, SIAM J. Numer. Anal. 20, 1983),
which has what is left of the update at hand, by which it is corrected at the end without a further sweep.

docs/solvers.md has the numbers of iterations, and from which size on this is faster than a direct solver.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import ngsolve as ng
import numpy as np

from ngfsi.arrays import Array
from ngfsi.errors import SolverError
from ngfsi.linear.levels import Levels
from ngfsi.system.sparse import csr

TOLERANCE = 1e-2
"""Of an update, over the scales of its unknowns; Newton's iterations refine it, and hardly take more."""
LEFT = 5.0
"""How much more than `TOLERANCE` may be left of an update before it is corrected by that for the last time. Newton's
method then takes a tenth more iterations, and all of them a third fewer sweeps."""
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
            scale: of each unknown, in whose measure errors are judged.
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
        """Return the solution, of which before a last correction `LEFT * TOLERANCE` is left, as the preconditioner sees
        it in the Euclidean norm of the unknowns over their scales.

        Raises:
            SolverError: it takes more than `MOST_ITERATIONS`.
        """
        left = self._precondition(right) / self._scale
        found, enough = np.zeros_like(left), LEFT * TOLERANCE * np.linalg.norm(left)
        kept: list[tuple[Array, Array]] = []
        while not np.linalg.norm(left) <= enough:
            if len(kept) == MOST_ITERATIONS or not np.all(np.isfinite(left)):
                raise SolverError(f"GMRES did not solve the linearised system in {MOST_ITERATIONS} iterations")
            self.iterations += 1
            direction, image = left.copy(), self._applied(left * self._scale) / self._scale
            for old, of_old in kept:
                along = image @ of_old
                direction -= along * old
                image -= along * of_old
            length = np.linalg.norm(image)
            kept.append((direction / length, image / length))
            found += (kept[-1][1] @ left) * kept[-1][0]
            left -= (kept[-1][1] @ left) * kept[-1][1]
        solution = np.zeros(self._matrix.height)
        solution[self._free] = (found + left) * self._scale
        return solution

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
