"""GMRES of PETSc on several ranks, preconditioned physics by physics with the levels of p-multigrid.

The preconditioner is block triangular (`PCFIELDSPLIT`, multiplicative), one correction after the other as in
`multigrid.py`: blood, wall and the tissue's functions of first order by MUMPS; mesh motion by MUMPS; the tissue by
block Gauss-Seidel over the patches of elements around vertices, of which each rank sweeps through its own and all add
up what they find (`PCASM`).
"""

from __future__ import annotations

from typing import Any

import ngsolve as ng
import numpy as np

from ngfsi.arrays import Array, Numbers
from ngfsi.errors import SolverError
from ngfsi.linear import multigrid
from ngfsi.linear.levels import Levels
from ngfsi.linear.petsc import Summed, by_mumps, check
from ngfsi.parallel.ranks import Ranks
from ngfsi.system.sparse import csr

NOT_YET = -3
"""PETSc's reason for an end after the most iterations."""
PREFIX = "ngfsi_tissue_"
"""Of the names of the smoother's options in PETSc."""
SMOOTHER = {"pc_type": "asm", "pc_asm_type": "basic", "pc_asm_local_type": "multiplicative", "sub_pc_type": "lu"}


class FieldSplit:
    """Solver of a matrix, the sum of those of all ranks, by GMRES with this preconditioner.

    Attributes:
        iterations: of GMRES since the beginning.
    """

    def __init__(self, matrix: Any, rows: ng.BitArray, scale: Array, levels: Levels, ranks: Ranks) -> None:
        """Set up.

        Args:
            rows: the unknowns to solve for.
            scale: of each unknown, in whose measure GMRES judges its error.

        Raises:
            SolverError: the matrix is singular, or the factors do not fit.
        """
        from petsc4py import PETSc

        self.iterations = 0
        self._matrix = matrix
        solved = np.array(list(rows), dtype=bool)
        self._free = np.flatnonzero(solved)
        mine = self._mine()
        self._summed = summed = Summed(ranks, mine.data, mine.indices, mine.indptr)
        self._solver = PETSc.KSP().create(summed.comm)
        self._solver.setOperators(summed.matrix)
        self._solver.setType("gmres")
        self._solver.setNormType(PETSc.KSP.NormType.PRECONDITIONED)
        number = np.full(len(solved), -1)
        number[solved] = summed.rows.number
        groups, patches = levels.among(solved)
        self._build([number[group] for group in groups], [number[patch] for patch in patches])
        summed.keep(self._solver)
        self._factorise(scale)

    def _mine(self) -> Any:
        """Return this rank's partition of the matrix on the unknowns to solve for."""
        return csr(self._matrix)[self._free][:, self._free]

    def _build(self, groups: list[Numbers], patches: list[Numbers]) -> None:
        """Choose what is corrected and how; all numbers are those of the distributed rows."""
        from petsc4py import PETSc

        sweep = self._solver.getPC()
        self._parts: list[Any] = []
        if not patches and len(groups) == 1:  # PETSc wants two fields or more
            self._factors = [by_mumps(sweep)]
            return
        smoothed = [np.unique(np.concatenate(patches))] if patches else []
        sweep.setType("fieldsplit")
        sweep.setFieldSplitType(PETSc.PC.CompositeType.MULTIPLICATIVE)
        fields = [self._summed.indices(field) for field in (*groups, *smoothed)]
        sweep.setFieldSplitIS(*((str(i), field) for i, field in enumerate(fields)))
        sweep.setUp()
        self._parts = sweep.getFieldSplitSubKSP()
        self._factors = [by_mumps(part.getPC()) for part in self._parts[: len(groups)]]
        for field, part in zip(smoothed, self._parts[len(groups) :], strict=True):
            own = [patch for patch in patches if self._summed.rows.mine.start <= patch[0] < self._summed.rows.mine.stop]
            _smooth(part.getPC(), [np.searchsorted(field, patch) for patch in own])

    def update(self, scale: Array) -> None:
        """Take the new values of the matrix, and new scales.

        Raises:
            SolverError: it is singular, or the factors do not fit.
        """
        self._summed.update(self._mine().data)
        self._solver.setOperators(self._summed.matrix)
        self._factorise(scale)

    def _factorise(self, scale: Array) -> None:
        """Factorise, for unknowns over their scales: so what GMRES makes small is an update over the scales."""
        self._scale = scale[self._free]
        self._summed.scale_columns(self._scale)
        self._solver.setUp()
        for part in self._parts:
            part.setUp()
            part.setUpOnBlocks()
        for factors in self._factors:
            check(factors)

    def solve(self, right: Any) -> Array:
        """Return the solution, its error below `TOLERANCE` in the Euclidean norm of the unknowns over their scales.

        Each rank gives its part of the right-hand side and gets the solution where it has elements.

        Raises:
            SolverError: on all ranks; GMRES needs more than `MOST_ITERATIONS`, or meets what is not finite.
        """
        self._solver.setGMRESRestart(multigrid.MOST_ITERATIONS)
        self._solver.setTolerances(rtol=multigrid.TOLERANCE, atol=0.0, max_it=multigrid.MOST_ITERATIONS)
        found = self._summed.solved(self._solver, right.FV().NumPy()[self._free])
        self.iterations += self._solver.getIterationNumber()
        reason = self._solver.getConvergedReason()
        if reason == NOT_YET:
            raise SolverError(f"GMRES did not solve the linearised system in {multigrid.MOST_ITERATIONS} iterations")
        if reason <= 0:
            raise SolverError(f"GMRES broke down on the linearised system (PETSc's reason {reason})")
        solution = np.zeros(self._matrix.height)
        solution[self._free] = found * self._scale
        return solution


def _smooth(preconditioner: Any, patches: list[Numbers]) -> None:
    """Have a preconditioner correct patch by patch; a rank without any has an empty one, as PETSc wants it."""
    from petsc4py import PETSc

    for name, value in SMOOTHER.items():  # for the order of the patches PETSc has no other way
        PETSc.Options().setValue(PREFIX + name, value)
    preconditioner.setOptionsPrefix(PREFIX)
    preconditioner.setType("asm")
    found = patches or [np.zeros(0, dtype=np.int64)]
    sets = [PETSc.IS().createGeneral(patch.astype(PETSc.IntType), comm=PETSc.COMM_SELF) for patch in found]
    preconditioner.setASMLocalSubdomains(len(sets), sets, sets)
    preconditioner.setFromOptions()
