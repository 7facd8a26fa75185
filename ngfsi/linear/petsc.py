"""Matrices of PETSc that are the sum of those of all ranks, each of some elements.

A row belongs to the lowest rank with an element there; PETSc's type `is` takes the sum. MUMPS makes LU factors of them,
and distributes the rows as it likes (Amestoy, Duff, L'Excellent and Koster, SIAM J Matrix Anal Appl 23, 2001).
"""

from __future__ import annotations

from functools import cache
from typing import Any

import ngsolve as ng
import numpy as np

from ngfsi.arrays import Array, Numbers
from ngfsi.errors import SolverError
from ngfsi.parallel.ranks import SERIAL, Ranks, all_ranks

MEMORY, WORKSPACE_SHARE = 14, 40
"""MUMPS's number of the parameter, and the fraction (%) of workspace that pivoting may take beyond the estimate."""
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
        return f"needs petsc4py, which cannot be loaded here ({error}): see 'Several processes' in docs/using.md"
    if not PETSc.Sys.hasExternalPackage("mumps"):
        return "needs a PETSc with MUMPS, which the one here is without"
    return ""


class Rows:
    """How the rows of a matrix are distributed: numbered anew so that those of each rank follow each other.

    Attributes:
        order: of each new number the old one.
        number: of each old number the new one.
        mine: the new numbers of this rank.
    """

    def __init__(self, order: Numbers, mine: slice) -> None:
        self.order, self.mine = order, mine
        self.number = np.empty_like(order)
        self.number[order] = np.arange(len(order))

    @classmethod
    def of(cls, ranks: Ranks, count: int, touched: Numbers) -> Rows:
        """Return the distribution of `count` rows, of which each belongs to the lowest rank that touches it."""
        owner = ranks.lowest(count, touched)
        if np.any(owner == ranks.size):
            raise SolverError(f"the matrix is singular: {np.sum(owner == ranks.size)} of its rows are empty")
        starts = np.searchsorted(np.sort(owner), [ranks.rank, ranks.rank + 1])
        return cls(np.argsort(owner, kind="stable"), slice(*map(int, starts)))


class Summed:
    """The sum of the matrices of all ranks, as PETSc's.

    Attributes:
        rows: how they are distributed.
        matrix: PETSc's, the same object after an update.
        comm: PETSc's communicator.
    """

    def __init__(self, ranks: Ranks, values: Array, columns: Numbers, starts: Numbers) -> None:
        """Take the rows of this rank's matrix, compressed.

        Raises:
            SolverError: a row is empty on all ranks.
        """
        from petsc4py import PETSc

        PETSc.garbage_cleanup(PETSc.COMM_SELF)  # petsc4py keeps what Python has dropped
        self._ranks = ranks
        self.comm = PETSc.COMM_SELF if ranks is SERIAL else PETSc.COMM_WORLD
        touched = np.flatnonzero(np.diff(starts))
        self.rows = Rows.of(ranks, len(starts) - 1, touched)
        place = np.full(len(starts) - 1, -1, dtype=PETSc.IntType)
        place[touched] = np.arange(len(touched))
        self._pattern = np.append(starts[touched], starts[-1]).astype(PETSc.IntType), place[columns]
        there = PETSc.LGMap().create(self.rows.number[touched].astype(PETSc.IntType), comm=self.comm)
        size = (self.rows.mine.stop - self.rows.mine.start, len(starts) - 1)
        self._mine = PETSc.Mat().createAIJ((len(touched),) * 2, csr=(*self._pattern, values), comm=PETSc.COMM_SELF)
        self._sum = PETSc.Mat().create(self.comm)
        self._sum.setSizes((size, size))
        self._sum.setType("is")
        self._sum.setLGMap(there, there)
        self._sum.setISLocalMat(self._mine)
        self._sum.assemble()
        self.matrix = self._sum.convert("aij", PETSc.Mat())
        self._right, self._solution = self.matrix.createVecs()
        self._touched, self._local = touched, PETSc.Vec().createSeq(len(touched), comm=PETSc.COMM_SELF)
        rows = PETSc.IS().createGeneral(self.rows.number[touched].astype(PETSc.IntType), comm=PETSc.COMM_SELF)
        self._exchange = PETSc.Scatter().create(self._right, rows, self._local, None)
        self.keep(there, self._mine, self._sum, self.matrix, self._right, self._solution, self._exchange)

    def keep(self, *objects: Any) -> None:
        """Keep what PETSc destroys on all ranks together."""
        if self._ranks is not SERIAL:
            _kept.extend(objects)

    def update(self, values: Array) -> None:
        """Take new values of the same pattern."""
        self._mine.setValuesCSR(*self._pattern, values)
        self._mine.assemble()
        self._sum.assemble()
        self._sum.convert("aij", self.matrix)

    def scale_columns(self, scale: Array) -> None:
        """Multiply the columns, until the next update, with factors that every rank has of all."""
        self._solution.array[:] = self.part(scale)
        self.matrix.diagonalScale(None, self._solution)

    def indices(self, numbers: Numbers) -> Any:
        """Return a choice of the distributed rows as PETSc's, of which each rank has its own."""
        from petsc4py import PETSc

        mine = numbers[(self.rows.mine.start <= numbers) & (numbers < self.rows.mine.stop)]
        return PETSc.IS().createGeneral(np.sort(mine).astype(PETSc.IntType), comm=self.comm)

    def part(self, whole: Array) -> Array:
        """Return of a vector that every rank has the rows of this one."""
        return whole[self.rows.order[self.rows.mine]]

    def solved(self, solver: Any, right: Array) -> Array:
        """Return what one of PETSc's solvers finds, in the rows that this rank touches, and 0 in others.

        Args:
            right: this rank's part of the right-hand side, which is the sum of all, in the same rows.
        """
        from petsc4py import PETSc

        self._local.array[:] = right[self._touched]
        self._right.set(0.0)
        self._exchange.scatter(self._local, self._right, PETSc.InsertMode.ADD_VALUES, PETSc.ScatterMode.SCATTER_REVERSE)
        solver.solve(self._right, self._solution)
        self._exchange.scatter(self._solution, self._local)
        found = np.zeros(len(self.rows.order))
        found[self._touched] = self._local.array
        return found


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
        """Solve; each rank gives its part of the right-hand side and gets the solution where it has elements."""
        sol.FV().NumPy()[:] = self._summed.solved(self._solver, b.FV().NumPy())

    def _csr(self) -> tuple[Array, Numbers, Numbers]:
        values, columns, starts = (part.NumPy() for part in self.GetInnerMatrix().CSR())
        return np.array(values), np.asarray(columns, dtype=np.int64), np.asarray(starts, dtype=np.int64)
