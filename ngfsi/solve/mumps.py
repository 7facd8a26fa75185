"""MUMPS through PETSc: LU factors of a matrix that is the sum of those of all ranks, each of some elements.

A row belongs to the lowest rank with an element there; PETSc's type `is` takes the sum and MUMPS distributes it as it
likes (Amestoy, Duff, L'Excellent and Koster, SIAM J Matrix Anal Appl 23, 2001).
"""

from __future__ import annotations

from functools import cache
from typing import Any

import ngsolve as ng
import numpy as np
from numpy.typing import NDArray

from ngfsi.errors import SolverError
from ngfsi.world import ALONE, World, world

MEMORY, WORKSPACE_SHARE = 14, 40
"""MUMPS's number of the parameter, and the share (%) of workspace that pivoting may take beyond the estimate."""
ERROR, DETAIL = 1, 2
"""MUMPS's numbers of the results that say how it went."""
SINGULAR = -10

_kept: list[Any] = []
"""PETSc destroys its objects on all ranks together, which Python's garbage collection would not wait for."""


@cache
def without_petsc() -> str:
    """Say why MUMPS cannot be used here, or nothing."""
    try:
        from petsc4py import PETSc
    except ImportError as error:
        return f"needs petsc4py, which cannot be loaded here ({error}): see 'Several processes' in the README"
    if not PETSc.Sys.hasExternalPackage("mumps"):
        return "needs a PETSc with MUMPS, which the one here is without"
    return ""


class Mumps(ng.la.SparseFactorizationInterface):  # type: ignore[misc]
    """As NGSolve wants a factorisation. With the flag `shared` all ranks make and use it together."""

    def __init__(self, matrix: Any, *args: Any, **more: Any) -> None:
        super().__init__(matrix, *args, **more)
        self._world = world() if matrix.inverse_flags.ToDict().get("shared") else ALONE

    def Analyze(self) -> None:
        """Number the rows, and hand the pattern to PETSc."""
        from petsc4py import PETSc

        comm = PETSc.COMM_SELF if self._world is ALONE else PETSc.COMM_WORLD
        self._values, columns, starts = self._csr()
        self._touched = np.flatnonzero(np.diff(starts))
        self._rows = Rows.of(self._world, len(starts) - 1, self._touched)
        place = np.full(len(starts) - 1, -1, dtype=PETSc.IntType)
        place[self._touched] = np.arange(len(self._touched))
        self._columns = place[columns]
        self._starts = np.append(starts[self._touched], starts[-1]).astype(PETSc.IntType)
        there = PETSc.LGMap().create(self._rows.number[self._touched].astype(PETSc.IntType), comm=comm)
        size = (self._rows.mine.stop - self._rows.mine.start, len(starts) - 1)
        self._mine = PETSc.Mat().createAIJ(
            (len(self._touched),) * 2, csr=(self._starts, self._columns, self._values), comm=PETSc.COMM_SELF
        )
        self._sum = PETSc.Mat().create(comm)
        self._sum.setSizes((size, size))
        self._sum.setType("is")
        self._sum.setLGMap(there, there)
        self._sum.setISLocalMat(self._mine)
        self._sum.assemble()
        self._matrix = self._sum.convert("aij", PETSc.Mat())
        self._solver = PETSc.KSP().create(comm)
        self._solver.setOperators(self._matrix)
        self._solver.setType("preonly")
        factors = self._solver.getPC()
        factors.setType("lu")
        factors.setFactorSolverType("mumps")
        factors.setFactorSetUpSolverType()
        self._factors = factors.getFactorMatrix()
        self._factors.setMumpsIcntl(MEMORY, WORKSPACE_SHARE)
        self._right, self._solution = self._matrix.createVecs()
        self._new = True
        if self._world is not ALONE:
            _kept.append((self._mine, self._sum, self._matrix, self._solver, self._right, self._solution, there))

    def Factor(self) -> None:
        """Factorise the present values.

        Raises:
            SolverError: the matrix is singular, or the factors do not fit.
        """
        if not self._new:
            self._mine.setValuesCSR(self._starts, self._columns, self._csr()[0])
            self._mine.assemble()
            self._sum.assemble()
            self._sum.convert("aij", self._matrix)
            self._solver.setOperators(self._matrix)
        self._new = False
        self._solver.setUp()
        if (error := self._factors.getMumpsInfog(ERROR)) < 0:
            what = "it is singular" if error == SINGULAR else f"error {error}, {self._factors.getMumpsInfog(DETAIL)}"
            raise SolverError(f"MUMPS: {what}")

    def Solve(self, b: Any, sol: Any) -> None:
        """Solve; all ranks give the same right-hand side and get the whole solution."""
        rows = self._rows
        self._right.array[:] = b.FV().NumPy()[rows.order[rows.mine]]
        self._solver.solve(self._right, self._solution)
        whole = np.zeros(len(rows.order))
        whole[rows.order[rows.mine]] = self._solution.array
        self._world.add(whole)
        sol.FV().NumPy()[:] = whole

    def _csr(self) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.int64]]:
        values, columns, starts = (part.NumPy() for part in self.GetInnerMatrix().CSR())
        return np.array(values), np.asarray(columns, dtype=np.int64), np.asarray(starts, dtype=np.int64)


class Rows:
    """How the rows of a matrix are distributed: numbered anew so that those of each rank follow each other.

    Attributes:
        order: of each new number the old one.
        number: of each old number the new one.
        mine: the new numbers of this rank.
    """

    def __init__(self, order: NDArray[np.int64], mine: slice) -> None:
        self.order, self.mine = order, mine
        self.number = np.empty_like(order)
        self.number[order] = np.arange(len(order))

    @classmethod
    def of(cls, ranks: World, count: int, touched: NDArray[np.int64]) -> Rows:
        """Return the distribution of `count` rows, of which each belongs to the lowest rank that touches it."""
        owner = ranks.lowest(count, touched)
        if np.any(owner == ranks.size):
            raise SolverError(f"the matrix is singular: {np.sum(owner == ranks.size)} of its rows are empty")
        starts = np.searchsorted(np.sort(owner), [ranks.rank, ranks.rank + 1])
        return cls(np.argsort(owner, kind="stable"), slice(*map(int, starts)))


ng.la.RegisterInverseType("mumps", Mumps)
