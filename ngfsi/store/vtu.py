"""Unstructured grids as VTK's XML files (.vtu), with compressed binary arrays.

VTK itself would take 80 MB of the memory of a run, and a third of a second to load; the writer of meshio has no field
data, in which names of regions and faces of boundaries stand.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

BLOCK = 2**20
"""Bytes that are compressed together."""
LEVEL = 1
"""Of compression: higher ones take twice the time for files smaller by a twentieth."""
TYPES = {"f4": "Float32", "f8": "Float64", "u1": "UInt8", "i4": "Int32", "i8": "Int64"}


@dataclass
class Grid:
    """Cells with values at their points and of their own.

    Attributes:
        points: (n, 3) m.
        nodes: numbers of the points of the cells, one cell after the other.
        ends: (cells,) where the nodes of each cell end.
        kinds: (cells,) VTK's numbers of the types of cells.
        point_data, cell_data: arrays with a row for each point or cell, by name.
        field_data: arrays or words, by name.
    """

    points: Any
    nodes: Any
    ends: Any
    kinds: Any
    point_data: dict[str, Any] = field(default_factory=dict)
    cell_data: dict[str, Any] = field(default_factory=dict)
    field_data: dict[str, Any] = field(default_factory=dict)

    def write(self, path: Path) -> None:
        """Write the grid into a file.

        Raises:
            OSError: the file cannot be written.
        """
        appended = _Appended()
        nodes, ends = (np.asarray(numbers, dtype=np.int64) for numbers in (self.nodes, self.ends))
        cells = {"connectivity": nodes, "offsets": ends, "types": np.asarray(self.kinds, dtype=np.uint8)}
        fields = "".join(appended.words(name, given) if _is_words(given) else appended.array(name, given, tuples=True)
                         for name, given in self.field_data.items())  # fmt: skip
        parts = {"PointData": self.point_data, "CellData": self.cell_data, "Points": {"Points": self.points},
                 "Cells": cells}  # fmt: skip
        piece = "".join(
            f"<{title}>{''.join(appended.array(name, values) for name, values in arrays.items())}</{title}>\n"
            for title, arrays in parts.items()
        )
        text = (
            '<?xml version="1.0"?>\n<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" '
            'header_type="UInt64" compressor="vtkZLibDataCompressor">\n<UnstructuredGrid>\n'
            f"<FieldData>{fields}</FieldData>\n"
            f'<Piece NumberOfPoints="{len(self.points)}" NumberOfCells="{len(self.kinds)}">\n{piece}</Piece>\n'
            '</UnstructuredGrid>\n<AppendedData encoding="raw">\n_'
        )
        with path.open("wb") as file:
            file.write(text.encode())
            file.writelines(appended.pieces)
            file.write(b"\n</AppendedData>\n</VTKFile>\n")


class _Appended:
    """What stands behind the description of the arrays, which refers to it."""

    def __init__(self) -> None:
        self.pieces: list[bytes] = []
        self._size = 0

    def array(self, name: str, values: Any, *, tuples: bool = False) -> str:
        """Append an array of numbers and return its description, with the number of its rows if that is unknown."""
        values = np.ascontiguousarray(values)
        kind, width = TYPES[values.dtype.str[1:]], values.shape[1] if values.ndim == 2 else 1
        known = f' NumberOfTuples="{len(values)}"' if tuples else ""
        said = (f'<DataArray type="{kind}" Name={quoteattr(name)} NumberOfComponents="{width}"{known} '
                f'format="appended" offset="{self._size}"/>\n')  # fmt: skip
        self._append(memoryview(values).cast("B") if values.size else memoryview(b""))
        return said

    @staticmethod
    def words(name: str, words: Sequence[str]) -> str:
        """Return words, as the numbers of their letters, each with a 0 at its end."""
        numbers = " ".join(str(number) for word in words for number in (*word.encode(), 0))
        about = f'type="String" Name={quoteattr(name)} NumberOfTuples="{len(words)}" format="ascii"'
        return f"<Array {about}>{numbers}</Array>\n"

    def _append(self, content: memoryview) -> None:
        blocks = [zlib.compress(content[at : at + BLOCK], LEVEL) for at in range(0, len(content), BLOCK)]
        head = [len(blocks), BLOCK, len(content) % BLOCK, *map(len, blocks)]
        for piece in (np.array(head, dtype="<u8").tobytes(), *blocks):
            self.pieces.append(piece)
            self._size += len(piece)


def _is_words(given: Any) -> bool:
    return not isinstance(given, np.ndarray)
