"""Vectors of a run that are read once more, in the opposite order: in memory up to a size, and beyond it on disk."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryFile

import numpy as np

from ngfsi.arrays import Array
from ngfsi.store.disk import explained

IN_MEMORY = 256e6
"""Bytes that stay in memory where there is a folder for others."""


class Vectors:
    """What is kept.

    Attributes:
        in_memory, on_disk: bytes.
    """

    def __init__(self, folder: Path | None = None) -> None:
        """Prepare; `folder`: for files, which have no name, so that none is left behind; None: all stays in memory."""
        self._folder = folder
        self.in_memory = self.on_disk = 0

    def kept(self, values: Array) -> Array:
        """Return an array that is as values are now, for reading.

        Raises:
            OutputError: the folder cannot be written, or is full.
        """
        if self._folder is None or self.in_memory + values.nbytes <= IN_MEMORY:
            self.in_memory += values.nbytes
            return values.copy()
        self.on_disk += values.nbytes
        with explained(self._folder, "written"):
            self._folder.mkdir(parents=True, exist_ok=True)
            with TemporaryFile(dir=self._folder) as file:
                np.ascontiguousarray(values).tofile(file)
                file.flush()
                return np.memmap(file, dtype=values.dtype, mode="r", shape=values.shape)
