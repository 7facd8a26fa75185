"""Entries of NGSolve's sparse matrices as arrays, and as matrices of SciPy."""

from __future__ import annotations

from typing import Any

import numpy as np

from ngfsi.arrays import Array, Numbers


def pattern(matrix: Any) -> tuple[Numbers, Numbers]:
    """Return the columns of a matrix's entries, row by row, and where each row starts among them, the end last."""
    columns, starts = (np.asarray(part, dtype=np.int64) for part in matrix.CSR()[1:])
    return columns, starts


def csr(matrix: Any, entries: Array | None = None) -> Any:
    """Return a matrix as SciPy's `csr_matrix`, on its own arrays: it changes, and must end, with the matrix.

    Args:
        entries: those of another matrix with the same pattern, in place of the matrix's own.
    """
    from scipy.sparse import csr_matrix  # not before it is needed: importing the solver takes no longer for it

    values, columns, starts = map(np.asarray, matrix.CSR())
    return csr_matrix((values if entries is None else entries, columns, starts), shape=(matrix.height, matrix.width))


def ranges(starts: Numbers, ends: Numbers) -> Numbers:
    """Return the numbers from each start up to its end, one after the other."""
    sizes = ends - starts
    before = np.cumsum(sizes) - sizes
    found: Numbers = np.arange(int(sizes.sum())) + np.repeat(starts - before, sizes)
    return found
