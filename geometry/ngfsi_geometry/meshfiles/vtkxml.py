"""VTK's XML files of unstructured grids (.vtu) and polygons (.vtp), in text, base64 or appended data."""

from __future__ import annotations

import base64
import lzma
import re
import zlib
from collections.abc import Callable
from itertools import pairwise
from typing import Any
from xml.etree import ElementTree

import numpy as np

from ngfsi.mesh.cells import NODES, SURFACES
from ngfsi_geometry.meshfiles.raw import (
    Array,
    Block,
    Indices,
    RawMesh,
    UnreadableError,
    grouped_by_arrays,
    integers,
)

KINDS_OF = {
    1: "vertex", 3: "line", 21: "line3", 5: "triangle", 22: "triangle6", 34: "triangle7", 9: "quad", 23: "quad8",
    28: "quad9", 10: "tetra", 24: "tetra10", 14: "pyramid", 27: "pyramid13", 37: "pyramid14", 13: "wedge",
    26: "wedge15", 32: "wedge18", 12: "hexahedron", 25: "hexahedron20", 29: "hexahedron27",
}  # fmt: skip
"""VTK's number of a cell type -> kind. Lagrange cells of second order have the nodes of the quadratic ones."""
LAGRANGE = {69: "triangle6", 70: "quad9", 71: "tetra10", 72: "hexahedron27", 73: "wedge18"}
DTYPES = {"Int8": "i1", "UInt8": "u1", "Int16": "i2", "UInt16": "u2", "Int32": "i4", "UInt32": "u4", "Int64": "i8",
          "UInt64": "u8", "Float32": "f4", "Float64": "f8"}  # fmt: skip
INFLATE: dict[str, Callable[[], Any]] = {
    "vtkZLibDataCompressor": zlib.decompressobj, "vtkLZMADataCompressor": lzma.LZMADecompressor,
}  # fmt: skip
LARGEST_BLOCK = 2**28
"""Bytes of a block that was compressed, beyond which it is damaged."""


NAMED = {"region": 3, "boundary": 2}
"""Field data of `ngfsi export`, with the number of a name, begin so -> dimension of the cells with that number."""


class Arrays:
    """Decodes the arrays of one file."""

    def __init__(self, data: bytes) -> None:
        start = re.search(rb"<AppendedData[^>]*encoding=[\"'](raw|base64)[\"'][^>]*>\s*_", data)
        self._appended = b""
        self._raw = bool(start) and start is not None and start[1] == b"raw"
        if start:
            end = data.rfind(b"</AppendedData>")
            self._appended = data[start.end() : end if end > start.end() else len(data)]
            data = data[: start.end()] + b"</AppendedData></VTKFile>"
        if b"<!ENTITY" in data[:4096]:
            raise UnreadableError("its XML defines entities")
        self.root: Any = ElementTree.fromstring(data)
        self._order = ">" if self.root.get("byte_order") == "BigEndian" else "<"
        self._header = self._order + ("u8" if self.root.get("header_type") == "UInt64" else "u4")
        name = self.root.get("compressor")
        if name and name not in INFLATE:
            raise UnreadableError(f"it is compressed by {name[:40]}: write it with zlib or without compression")
        self._inflate = INFLATE[name] if name else None

    def of(self, element: Any) -> Any:
        """Return the values of a DataArray."""
        kind, form = element.get("type"), element.get("format", "ascii")
        if kind not in DTYPES:
            raise UnreadableError(f"it has an array of {str(kind)[:40]}")
        dtype = np.dtype(self._order + DTYPES[kind])
        if form == "ascii":
            words = (element.text or "").split()
            values = np.array(words).astype(dtype) if words else np.zeros(0, dtype)
        elif form == "appended":
            at = int(element.get("offset", 0))
            if not 0 <= at <= len(self._appended):
                raise UnreadableError("an array lies beyond the end")
            values = np.frombuffer(self._bytes(self._appended[at:], self._raw), dtype=dtype)
        else:
            values = np.frombuffer(self._bytes((element.text or "").strip().encode(), False), dtype=dtype)
        width = int(element.get("NumberOfComponents") or 1)
        return values.reshape(-1, width) if width > 1 else values

    def _bytes(self, text: bytes, raw: bool) -> bytes:
        """Return the bytes of an array, behind its header of one length or of those of compressed blocks."""
        size = np.dtype(self._header).itemsize

        def piece(at: int, count: int) -> bytes:
            """Of `count` bytes from the place `at` of the text."""
            if count < 0 or at + count > len(text):
                raise UnreadableError("it ends too early")
            return text[at : at + count] if raw else base64.b64decode(text[at : at + 4 * -(-count // 3)])[:count]

        def length(count: int) -> int:
            return count if raw else 4 * -(-count // 3)

        if self._inflate is None:
            # header and data are encoded as one
            if raw:
                (count,) = np.frombuffer(piece(0, size), self._header)
                return piece(size, int(count))
            (count,) = np.frombuffer(piece(0, size), self._header)
            return piece(0, size + int(count))[size:]
        (blocks,) = np.frombuffer(piece(0, size), self._header).tolist()
        head = size * (3 + blocks)
        _, whole_block, _, *sizes = np.frombuffer(piece(0, head), self._header).tolist()
        begin = length(head)
        packed = piece(begin, sum(sizes))
        ends = np.cumsum([0, *sizes])
        most = min(whole_block, LARGEST_BLOCK)
        return b"".join(self._inflate().decompress(packed[a:b], most) for a, b in pairwise(ends))


def read(data: bytes, wanted: str | None, file: str) -> RawMesh:
    """Return the mesh in a file's content.

    Args:
        wanted: array that numbers the groups; None: see `grouped_by_arrays`.

    Raises:
        UnreadableError, or another of `read.DAMAGED`: it is none.
        GeometryError: the groups cannot be told.
    """
    arrays = Arrays(data)
    grid = next((e for e in arrays.root if e.tag in ("UnstructuredGrid", "PolyData")), None)
    if grid is None:
        raise UnreadableError("it holds no unstructured grid and no polygons")
    names = {}
    for element in grid.iterfind("FieldData/DataArray"):
        what, _, name = str(element.get("Name")).partition(":")
        if what in NAMED and name:
            names[NAMED[what], int(np.ravel(arrays.of(element))[0])] = name
    pieces = [(_piece(piece, arrays, grid.tag == "PolyData")) for piece in grid.iterfind("Piece")]
    if not pieces:
        raise UnreadableError("it holds no piece")
    points: list[Array] = []
    blocks: list[Block] = []
    values: dict[str, list[Any]] = {name: [] for name in pieces[0][2]}
    offset = 0
    for place, kinds, cell_arrays in pieces:
        for kind, numbers, nodes in kinds:
            blocks.append(Block(kind, nodes + offset))
            for name in values:
                values[name].append(cell_arrays[name][numbers])
        points.append(place)
        offset += len(place)
    groups = grouped_by_arrays(tuple(blocks), values, wanted, file, names)
    return RawMesh(np.vstack(points), tuple(blocks), groups)


def _piece(piece: Any, arrays: Arrays, polygons: bool) -> tuple[Array, list[tuple[str, Indices, Indices]], Any]:
    """Return points, cells by kind with their numbers, and arrays of cells of a piece."""
    place = piece.find("Points/DataArray")
    if place is None:
        raise UnreadableError("it has no points")
    points = np.asarray(arrays.of(place), dtype=float).reshape(-1, 3)
    if polygons:
        if int(piece.get("NumberOfStrips") or 0):
            raise UnreadableError("it has strips of triangles: write it with triangles")
        first = int(piece.get("NumberOfVerts") or 0) + int(piece.get("NumberOfLines") or 0)
        parts = {e.get("Name"): arrays.of(e) for e in piece.iterfind("Polys/DataArray")}
    else:
        first = 0
        parts = {e.get("Name"): arrays.of(e) for e in piece.iterfind("Cells/DataArray")}
    nodes = integers(parts["connectivity"])
    ends = integers(parts["offsets"])
    if len(ends) and (ends[-1] > len(nodes) or (np.diff(ends, prepend=0) < 0).any()):
        raise UnreadableError("its cells have other nodes than it holds")
    counts = np.diff(ends, prepend=0)
    types = counts if polygons else integers(parts["types"])
    if len(types) != len(ends):
        raise UnreadableError("its cells and their types are not as many")
    found = []
    for number in np.unique(types):
        rows = np.flatnonzero(types == number)
        kind = (SURFACES if polygons else KINDS_OF | LAGRANGE).get(int(number))
        if kind is None:
            what = f"polygons with {number} corners" if polygons else f"cells of VTK's type {number}"
            raise UnreadableError(f"it has {what}: write linear or quadratic triangles, quadrilaterals, tetrahedra, "
                                  "pyramids, wedges and hexahedra")  # fmt: skip
        if (counts[rows] != NODES[kind]).any():
            raise UnreadableError(f"its cells '{kind}' have not {NODES[kind]} nodes each")
        starts = ends[rows] - NODES[kind]
        found.append((kind, rows + first, nodes[starts[:, None] + np.arange(NODES[kind])]))
    return points, found, _cell_arrays(piece, arrays, first + len(ends))


def _cell_arrays(piece: Any, arrays: Arrays, count: int) -> dict[str, Any]:
    found = {}
    for element in piece.iterfind("CellData/DataArray"):
        if element.get("type") in DTYPES:
            values = np.asarray(arrays.of(element))
            if len(values) != count:
                raise UnreadableError(f"the array '{str(element.get('Name'))[:40]}' has not one value a cell")
            found[str(element.get("Name"))] = values
    return found
