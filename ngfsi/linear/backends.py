"""Linear solvers: which there are, whether they are here, and how they are told to work.

The direct ones speak NGSolve's interface of analysis, factorisation, solution and renewed factorisation; another one is
another entry of `BACKENDS`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any, Literal

import ngsolve as ng
import numpy as np
from ngsolve.solvers.mkl_pardiso import MKLPardiso

from ngfsi.arrays import Array
from ngfsi.errors import SolverError
from ngfsi.linear.levels import Levels
from ngfsi.linear.petsc import Mumps, without_petsc
from ngfsi.parallel.ranks import SERIAL, all_ranks

Name = Literal["pardiso", "pardiso_single", "umfpack", "mumps", "p_multigrid", "fieldsplit"]

NESTED_DISSECTION = {"ordering": "metis", "refinement": 0}
"""It keeps the factors small, and Newton itself refines: the platform's defaults cost 20 % more fill and nine times the
time of a solve."""
SINGLE_PRECISION = 27
"""MKL's number of the parameter."""


class SinglePardiso(MKLPardiso):  # type: ignore[misc]
    """Pardiso on matrix, factors and vectors of single precision."""

    def Analyze(self) -> None:
        """Order and factorise."""
        self._release()
        (values, self._indices_np, self._indptr_np), self._csr_mat = self.get_csr()
        self._params[SINGLE_PRECISION] = 1
        self._n[0] = len(self._indptr_np) - 1
        self._data_np = np.array(values, dtype=np.float32)
        self._b_np, self._x_np = np.zeros((2, self._n[0]), dtype=np.float32)
        for name in ("data", "indices", "indptr", "b", "x"):
            setattr(self, f"_{name}", np.ctypeslib.as_ctypes(getattr(self, f"_{name}_np")))
        self._call_pardiso(12)
        self._is_first_factor_call = True


ng.la.RegisterInverseType("pardiso_single", SinglePardiso)
ng.la.RegisterInverseType("mumps", Mumps)


@cache
def without_mkl() -> str:
    """Say why MKL's Pardiso cannot be used here, or nothing."""
    one = ng.la.SparseMatrixd.CreateFromCOO([0], [0], [1.0], 1, 1)
    try:
        one.Inverse(inverse="pardiso")
    except Exception:  # NGSolve raises a plain Exception when the library is missing
        return "needs MKL, which cannot be loaded here: install the extra `ngfsi[mkl]` (x86-64 only)"
    return ""


@dataclass(frozen=True)
class Backend:
    """A linear solver.

    Attributes:
        name: for `solver.linear` and for NGSolve.
        about: what it is good for.
        missing: says why it cannot be used here, or nothing.
        updates: whether a new matrix of the same pattern needs no new analysis.
        flags: for NGSolve.
        distributed: whether several ranks can work on it together.
        single: the same with factors of single precision, which serve a solver that judges by the exact residual.
        iterates: makes a solver that iterates on the levels of coupled systems, of a matrix, the rows, their scale, in
            whose measure it judges its error, the levels, and whether the matrix is shared; None: a direct solver.
    """

    name: Name
    about: str
    missing: Callable[[], str] = str
    updates: bool = False
    flags: Mapping[str, Any] = field(default_factory=dict)
    distributed: bool = False
    single: Name | None = None
    iterates: Callable[[Any, ng.BitArray, Array, Levels, bool], Any] | None = None

    def factors(self, matrix: Any, rows: ng.BitArray, old: Any | None, *, shared: bool = False) -> Any:
        """Return factors of the chosen rows and columns of a matrix, made from the old ones of the same if possible.

        Args:
            shared: the matrix is the sum of those with which all ranks call this.

        Raises:
            SolverError: this solver has none, it iterates.
        """
        if self.iterates:
            raise SolverError(f"solver.linear = '{self.name}' is for coupled systems: use 'auto' for this one")
        if old is None or not self.updates:
            return matrix.Inverse(rows, inverse=self.name, flags={**self.flags, "shared": shared})
        old.Update()
        return old


def _p_multigrid(matrix: Any, rows: ng.BitArray, scale: Array, levels: Levels, _shared: bool) -> Any:
    from ngfsi.linear.multigrid import PMultigrid  # which direct solvers do without

    return PMultigrid(matrix, rows, scale, levels, BACKENDS[choose_backend("auto")].factors)


def _fieldsplit(matrix: Any, rows: ng.BitArray, scale: Array, levels: Levels, shared: bool) -> Any:
    from ngfsi.linear.fieldsplit import FieldSplit

    return FieldSplit(matrix, rows, scale, levels, all_ranks() if shared else SERIAL)


BACKENDS = {
    backend.name: backend
    for backend in (
        Backend("pardiso", "MKL's, the fastest here", lambda: without_mkl(), updates=True, flags=NESTED_DISSECTION,
                single="pardiso_single"),
        Backend("umfpack", "comes with NGSolve"),
        Backend("pardiso_single", "Pardiso with factors of single precision, to the same tolerance: what 'auto' takes "
                "for runs while it converges, in two thirds of the time and memory", lambda: without_mkl(),
                updates=True, flags=NESTED_DISSECTION),
        Backend("mumps", "through PETSc, the one for several ranks", without_petsc, updates=True, distributed=True),
        Backend("p_multigrid", "GMRES, tissue by two-level p-multigrid, blood and wall by a direct solver: for large "
                  "tissues, whose factors would not fit", iterates=_p_multigrid),
        Backend("fieldsplit", "the same through PETSc, for several ranks", without_petsc, distributed=True,
                  iterates=_fieldsplit),
    )
}  # fmt: skip
"""In the order in which 'auto' takes them."""


def choose_backend(wanted: Literal["auto"] | Name) -> Name:
    """Return the direct solver to use.

    Raises:
        SolverError: the one that is asked for is not here, or not for as many ranks as there are.
    """
    ranks = all_ranks().size
    fit = {name: backend for name, backend in BACKENDS.items() if backend.distributed or ranks == 1}
    if wanted == "auto":
        wanted = next((name for name, backend in fit.items() if not backend.missing()), "mumps")
    if wanted not in fit:
        raise SolverError(f"solver.linear = '{wanted}' works in one process, and there are {ranks}: use 'auto'")
    if reason := BACKENDS[wanted].missing():
        others = " or ".join(f"'{name}'" for name, backend in fit.items() if not backend.missing())
        raise SolverError(f"solver.linear = '{wanted}' {reason}{f' or use {others}' if others else ''}")
    return wanted


def of_double_precision(single: Name) -> Name | None:
    """Return the solver of which another one is the same with factors of single precision; None: it is none."""
    return next((name for name, backend in BACKENDS.items() if backend.single == single), None)


CROSSING = {2: 450_000, 3: 270_000}
"""Order -> unknowns from which `p_multigrid` takes less time than a direct solver with factors of single precision
(docs/solvers.md)."""
CROSSING_OF_TETRAHEDRA = 100_000
"""The same of tetrahedra of any order, measured with order 2."""


def fitting(direct: Name, unknowns: int, order: int, memory: float, *, tetrahedra: bool = False) -> tuple[Name, str]:
    """Return the solver to take for a coupled system in one process where 'auto' is asked for, and why.

    Args:
        direct: what else is taken.
        unknowns: of the system.
        order: of its elements.
        memory: of the machine (GB).
        tetrahedra: whether its elements are such, all of them.
    """
    crossing = CROSSING_OF_TETRAHEDRA if tetrahedra else CROSSING[min(max(order, 2), 3)]
    needed = 5.3 * (unknowns / 1e5) ** 1.2  # in GB, Pardiso's runs of docs/solvers.md
    kind = " on tetrahedra" if tetrahedra else ""
    said = f"solver.linear = 'auto' of {unknowns:,} unknowns:"
    if unknowns >= crossing:
        return "p_multigrid", f"{said} p_multigrid, which{kind} is faster than a direct solver from {crossing:,} on"
    if needed > memory:
        return "p_multigrid", (
            f"{said} p_multigrid, as {direct} would take about {needed:.0f} GB of the {memory:.0f} GB that there are"
        )
    return direct, f"{said} {direct}, which{kind} is faster than p_multigrid below {crossing:,}; about {needed:.1f} GB"
