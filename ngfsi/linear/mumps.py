"""MUMPS through PETSc: LU factors of a matrix that is the sum of those of all ranks, each of some elements.

MUMPS distributes the rows as it likes (Amestoy, Duff, L'Excellent and Koster, SIAM J Matrix Anal Appl 23, 2001).
"""

from __future__ import annotations

from typing import Any

import ngsolve as ng
import numpy as np

from ngfsi.arrays import Array, Numbers
from ngfsi.errors import SolverError
from ngfsi.linear.petsc import Summed
from ngfsi.parallel.ranks import SERIAL, all_ranks

MEMORY, WORKSPACE_SHARE = 14, 40
"""MUMPS's number of the parameter, and the fraction (%) of workspace that pivoting may take beyond the estimate."""
ERROR, DETAIL = 1, 2
"""MUMPS's numbers of the results that say how it went."""
SINGULAR = -10


def by_mumps(preconditioner: Any) -> Any:
    """Have one of PETSc's preconditioners, whose matrix is set, be LU factors by MUMPS, and return these."""
    preconditioner.setType("lu")
    preconditioner.setFactorSolverType("mumps")
    preconditioner.setFactorSetUpSolverType()
    factors = preconditioner.getFactorMatrix()
    factors.setMumpsIcntl(MEMORY, WORKSPACE_SHARE)
    return factors


def check(factors: Any) -> None:
    """Raise a SolverError, on all ranks, if MUMPS could not make the factors."""
    if (error := factors.getMumpsInfog(ERROR)) < 0:
        what = "it is singular" if error == SINGULAR else f"error {error}, {factors.getMumpsInfog(DETAIL)}"
        raise SolverError(f"MUMPS: {what}")


class Mumps(ng.la.SparseFactorizationInterface):  # type: ignore[misc]
    """As NGSolve wants a factorisation. With the flag `shared` all ranks make and use it together."""

    def __init__(self, matrix: Any, *args: Any, **more: Any) -> None:
        super().__init__(matrix, *args, **more)
        self._ranks = all_ranks() if matrix.inverse_flags.ToDict().get("shared") else SERIAL

    def Analyze(self) -> None:
        """Number the rows, and hand the pattern to PETSc."""
        from petsc4py import PETSc

        self._summed = Summed(self._ranks, *self._csr())
        self._solver = PETSc.KSP().create(self._summed.comm)
        self._solver.setOperators(self._summed.matrix)
        self._solver.setType("preonly")
        self._factors = by_mumps(self._solver.getPC())
        self._summed.keep(self._solver)
        self._new = True

    def Factor(self) -> None:
        """Factorise the present values.

        Raises:
            SolverError: the matrix is singular, or the factors do not fit.
        """
        if not self._new:
            self._summed.update(self._csr()[0])
            self._solver.setOperators(self._summed.matrix)
        self._new = False
        self._solver.setUp()
        check(self._factors)

    def Solve(self, b: Any, sol: Any) -> None:
        """Solve; all ranks give the same right-hand side and get the whole solution."""
        sol.FV().NumPy()[:] = self._summed.solved(self._solver, b.FV().NumPy())

    def _csr(self) -> tuple[Array, Numbers, Numbers]:
        values, columns, starts = (part.NumPy() for part in self.GetInnerMatrix().CSR())
        return np.array(values), np.asarray(columns, dtype=np.int64), np.asarray(starts, dtype=np.int64)
