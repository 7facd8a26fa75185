"""Direct solution of the linearised system: static condensation, and factorisations that outlive their matrix."""

from __future__ import annotations

from functools import cache
from typing import Any, Literal

import ngsolve as ng
import numpy as np
from numpy.typing import NDArray

from ngfsi.errors import SolverError

Backend = Literal["pardiso", "umfpack"]

PARDISO_FLAGS = {"ordering": "metis", "refinement": 0}
"""Nested dissection keeps the factors small, and Newton itself refines: the platform's defaults cost 20 % more fill
and nine times the time of a solve."""


@cache
def pardiso_available() -> bool:
    """Whether MKL's Pardiso solves here (needs the package `mkl`, x86-64 only)."""
    one = ng.la.SparseMatrixd.CreateFromCOO([0], [0], [1.0], 1, 1)
    try:
        one.Inverse(inverse="pardiso")
    except Exception:  # NGSolve raises a plain Exception when the library is missing
        return False
    return True


def choose_backend(wanted: Literal["auto", "pardiso", "umfpack"]) -> Backend:
    """Return the direct solver to use.

    Raises:
        SolverError: pardiso is asked for but cannot be loaded.
    """
    if wanted == "auto":
        return "pardiso" if pardiso_available() else "umfpack"
    if wanted == "pardiso" and not pardiso_available():
        raise SolverError(
            "solver.linear = 'pardiso' needs MKL, which cannot be loaded here: install the extra `ngfsi[mkl]` "
            "(x86-64 only) or use 'umfpack'"
        )
    return wanted


class Factorisation:
    """LU factors of a form's linearisation on chosen unknowns.

    The factors and the condensation operators stay those of the last `renew`, whatever happens to the state.
    """

    def __init__(self, form: ng.BilinearForm, free: NDArray[np.bool_], backend: Backend) -> None:
        self.form = form
        self.backend = backend
        self.count = 0
        self._free = ng.BitArray(list(free))
        coupling = form.space.FreeDofs(form.condense)
        self._solved = self._free & coupling
        self._inverse: Any = None

    def renew(self, state: Any) -> None:
        """Linearise at `state` and factorise.

        Raises:
            SolverError: the matrix is singular or not finite.
        """
        try:
            self.form.AssembleLinearization(state)
            if self._inverse is None or self.backend != "pardiso":
                flags = {"flags": PARDISO_FLAGS} if self.backend == "pardiso" else {}
                self._inverse = self.form.mat.Inverse(self._solved, inverse=self.backend, **flags)
            else:
                self._inverse.Update()
        except Exception as error:  # NGSolve raises its own and generic exceptions for singular element matrices
            raise SolverError(f"the linearised system could not be factorised: {error}") from error
        self.count += 1

    def solve(self, residual: Any, update: Any) -> None:
        """Write the solution of (linearisation) update = residual, zero on fixed unknowns, to `update`.

        `residual` is overwritten.
        """
        if self.form.condense:
            residual.data += self.form.harmonic_extension_trans * residual
            update.data = self._inverse * residual
            update.data += self.form.harmonic_extension * update
            update.data += self.form.inner_solve * residual
        else:
            update.data = self._inverse * residual
