"""Gmsh's MSH format, versions 2 and 4.1, text and binary, as section "MSH file format" of its manual describes it.

Groups are physical groups. Cells in none, as Mesh.SaveAll writes them, have the number of their geometric entity.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import numpy as np

from ngfsi_geometry.meshfiles.raw import Array, Block, Group, Indices, RawMesh, UnreadableError, integers, titles_of

TYPES = {
    1: "line", 2: "triangle", 3: "quad", 4: "tetra", 5: "hexahedron", 6: "wedge", 7: "pyramid", 8: "line3",
    9: "triangle6", 10: "quad9", 11: "tetra10", 12: "hexahedron27", 13: "wedge18", 14: "pyramid14", 15: "vertex",
    16: "quad8", 17: "hexahedron20", 18: "wedge15", 19: "pyramid13",
}  # fmt: skip
"""Number of a type in the file -> kind."""
SIZES = {1: 2, 2: 3, 3: 4, 4: 4, 5: 8, 6: 6, 7: 5, 8: 3, 9: 6, 10: 9, 11: 10, 12: 27, 13: 18, 14: 14, 15: 1, 16: 8,
         17: 20, 18: 15, 19: 13}  # fmt: skip
PHYSICAL, GEOMETRICAL = "gmsh:physical", "gmsh:geometrical"
SAVED_ALL = ("its cells are in no physical groups, as Mesh.SaveAll in version 2.2 writes them: groups are the numbers "
             "of the geometry's entities; saved without Mesh.SaveAll it has the names")  # fmt: skip

Cells = list[tuple[int, int, Indices, Indices]]
"""Type, number of the entity (0: that in the tags), tags (m, 2: physical, entity) and nodes (m, k) as in the file."""


class Stream:
    """Numbers of one section, from text or bytes."""

    def __init__(self, section: bytes, binary: bool, order: str) -> None:
        self._binary, self._order, self._at = binary, order, 0
        self._data: Any = section if binary else np.array(section.split())

    def take(self, kind: str, count: int) -> Any:
        """Return so many numbers: "i" integers of 4 bytes, "u" of 8, "d" reals."""
        width = {"i": 4, "u": 8, "d": 8}[kind] if self._binary else 1
        if count < 0 or self._at + count * width > len(self._data):
            raise UnreadableError("it ends too early")
        part = self._data[self._at : self._at + count * width]
        self._at += count * width
        if self._binary:
            part = np.frombuffer(part, dtype=self._order + {"i": "i4", "u": "u8", "d": "f8"}[kind])
        return part.astype(float) if kind == "d" else part.astype(np.int64)

    def one(self, kind: str) -> int:
        """Return the next whole number."""
        return int(self.take(kind, 1)[0])


def read(data: bytes, wanted: str | None = None) -> RawMesh:
    """Return the mesh in a file's content.

    Args:
        wanted: "gmsh:geometrical" takes the geometry's entities for groups, None or "gmsh:physical" physical groups.

    Raises:
        UnreadableError, or another of `read.DAMAGED`: it is none, or of another version.
    """
    sections = dict(_sections(data))
    version, binary, order = _format(sections)
    if b"Nodes" not in sections or b"Elements" not in sections:
        raise UnreadableError("it has no section of nodes or of elements that is whole")
    names = _names(sections.get(b"PhysicalNames", b""))
    streams = {n: Stream(part, binary, order) for n, part in sections.items() if n not in (b"PhysicalNames",)}
    if version == "4.1":
        physical = _entities(streams[b"Entities"]) if b"Entities" in streams else {}
        numbers, points = _nodes(streams[b"Nodes"])
        cells = _elements(streams[b"Elements"])
    else:
        physical = {}
        numbers, points = _nodes2(streams[b"Nodes"], sections[b"Nodes"], binary, order)
        cells = _elements2(streams[b"Elements"], sections[b"Elements"], binary)
    return _assembled(numbers, points, cells, physical, names, wanted)


def _sections(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Yield names and contents of sections, whatever is between their first and last lines."""
    at = 0
    while (match := re.compile(rb"\$([A-Za-z]+)[ \t]*\r?\n").search(data, at)) is not None:
        end = data.find(b"$End" + match[1], match.end())
        if end < 0:
            return
        yield match[1], data[match.end() : end]
        at = end + 4 + len(match[1])


def _format(sections: dict[bytes, bytes]) -> tuple[str, bool, str]:
    head = sections.get(b"MeshFormat", b"").split(b"\n", 1)
    words = head[0].split()
    if len(words) < 3:
        raise UnreadableError("it does not begin as a file of Gmsh, or ends too early")
    version = words[0].decode("ascii", "replace")
    if not version.startswith("2") and version != "4.1":
        raise UnreadableError(f"it is of Gmsh's version {version[:20]}: save it as 4.1 or 2.2")
    binary = words[1] == b"1"
    if not binary:
        return version, False, "="
    if words[2] != b"8" or len(head) < 2 or len(head[1]) < 4:
        raise UnreadableError("its binary numbers are not of 8 bytes")
    order = "=" if int(np.frombuffer(head[1][:4], dtype="i4")[0]) == 1 else ">"
    return version, True, order


def _names(section: bytes) -> dict[tuple[int, int], str]:
    lines = re.findall(rb'(\d+)\s+(\d+)\s+"([^"\n]*)"', section)
    return {(int(dim), int(number)): name.decode("utf-8", "replace") for dim, number, name in lines}


def _entities(stream: Stream) -> dict[tuple[int, int], list[int]]:
    """Return (dimension, number) of each entity -> its physical groups."""
    counts = stream.take("u", 4)
    found: dict[tuple[int, int], list[int]] = {}
    for dim, count in enumerate(counts.tolist()):
        for _ in range(count):
            tag = stream.one("i")
            stream.take("d", 3 if dim == 0 else 6)
            found[dim, tag] = [abs(int(n)) for n in stream.take("i", stream.one("u"))]
            if dim:
                stream.take("i", stream.one("u"))
    return found


def _nodes(stream: Stream) -> tuple[Indices, Array]:
    blocks, _, _, _ = stream.take("u", 4).tolist()
    numbers, points = [np.zeros(0, np.int64)], [np.zeros((0, 3))]
    for _ in range(blocks):
        dim, _, parametric = stream.take("i", 3).tolist()
        count = stream.one("u")
        numbers.append(stream.take("u", count))
        width = 3 + (dim if parametric else 0)
        points.append(stream.take("d", width * count).reshape(-1, width)[:, :3])
    return np.concatenate(numbers), np.vstack(points)


def _elements(stream: Stream) -> Cells:
    blocks, _, _, _ = stream.take("u", 4).tolist()
    cells: Cells = []
    for _ in range(blocks):
        _, entity, kind = stream.take("i", 3).tolist()
        count = stream.one("u")
        rows = stream.take("u", count * (1 + _size(kind))).reshape(count, -1)
        cells.append((kind, entity, np.zeros((count, 2), np.int64), rows[:, 1:]))
    return cells


def _nodes2(stream: Stream, section: bytes, binary: bool, order: str) -> tuple[Indices, Array]:
    if not binary:
        count = stream.one("u")
        rows = stream.take("d", 4 * count).reshape(count, 4)
        return integers(rows[:, 0]), rows[:, 1:]
    count, body = _counted(section)
    record = np.dtype([("number", "i4"), ("place", "f8", 3)])
    record = record if order == "=" else record.newbyteorder(">")
    if not 0 <= count * record.itemsize <= len(body):
        raise UnreadableError("it ends too early")
    rows = np.frombuffer(body, dtype=record, count=count)
    return rows["number"].astype(np.int64), rows["place"].astype(float)


def _counted(section: bytes) -> tuple[int, bytes]:
    first, _, body = section.partition(b"\n")
    if not re.fullmatch(rb"\d{1,18}", first.strip()):
        raise UnreadableError("a section does not begin with a number")
    return int(first), body


def _elements2(stream: Stream, section: bytes, binary: bool) -> Cells:
    found: dict[tuple[int, int], list[Indices]] = {}
    if binary:
        count, body = _counted(section)
        stream = Stream(body, True, stream._order)
        while count > 0:
            kind, number, tags = stream.take("i", 3).tolist()
            if number < 1 or tags < 0:
                raise UnreadableError("a block of elements is empty")
            width = 1 + tags + _size(kind)
            found.setdefault((kind, tags), []).append(stream.take("i", number * width).reshape(number, width))
            count -= number
    else:
        count = stream.one("u")
        for _ in range(count):
            _, kind, tags = stream.take("u", 3).tolist()
            if tags < 0:
                raise UnreadableError("an element has fewer than no tags")
            row = stream.take("u", tags + _size(kind))
            found.setdefault((kind, tags), []).append(np.concatenate([[0], row])[None])
    cells: Cells = []
    for (kind, tags), parts in found.items():
        rows = np.vstack(parts)
        both = np.zeros((len(rows), 2), np.int64)
        both[:, : min(tags, 2)] = rows[:, 1 : 1 + min(tags, 2)]
        cells.append((kind, 0, both, rows[:, 1 + tags :]))
    return cells


def _size(kind: int) -> int:
    if kind not in SIZES:
        raise UnreadableError(f"it has elements of Gmsh's type {kind}: mesh with linear or quadratic elements")
    return SIZES[kind]


def _assembled(
    numbers: Indices, points: Array, cells: Cells, physical: dict[tuple[int, int], list[int]],
    names: dict[tuple[int, int], str], wanted: str | None,
) -> RawMesh:  # fmt: skip
    order = np.argsort(numbers, kind="stable")
    blocks: list[Block] = []
    members: dict[tuple[str, int, int], dict[int, Indices]] = {}
    for kind, entity, tags, nodes in cells:
        place = np.minimum(np.searchsorted(numbers, nodes, sorter=order), max(len(numbers) - 1, 0))
        if len(numbers) == 0 or (numbers[order[place]] != nodes).any():
            raise UnreadableError("an element has a node that is not in the file")
        block = Block(TYPES[kind], order[place].astype(np.int64))
        k = len(blocks)
        blocks.append(block)
        for key, part in _tagged(block.dim, entity, tags, physical, wanted):
            members.setdefault(key, {})[k] = part
    bodies = [key for key in members if key[1] > 1]
    remarks = (SAVED_ALL,) if bodies and wanted != GEOMETRICAL and all(k[0] == "entity" for k in bodies) else ()
    plain = remarks or wanted == GEOMETRICAL
    groups = []
    for (what, dim, number), parts in sorted(members.items()):
        if what == "physical":
            titles = titles_of(dim, number, names.get((dim, number)))
        else:
            titles = titles_of(dim, number) if plain else (f"entity {dim}:{number}",)
        groups.append(Group(titles, dim, parts))
    return RawMesh(points, tuple(blocks), tuple(groups), remarks)


def _tagged(
    dim: int, entity: int, tags: Indices, physical: dict[tuple[int, int], list[int]], wanted: str | None
) -> Iterator[tuple[tuple[str, int, int], Indices]]:
    """Yield the groups of a block's cells: (what, dimension, number), and the numbers of their cells."""
    everyone = np.arange(len(tags))
    if entity:
        groups = [] if wanted == GEOMETRICAL else physical.get((dim, entity), [])
        for number in groups:
            yield ("physical", dim, number), everyone
        if not groups:
            yield ("entity", dim, entity), everyone
        return
    in_group = (tags[:, 0] != 0) & (wanted != GEOMETRICAL)
    for column, chosen, what in ((0, in_group, "physical"), (1, ~in_group, "entity")):
        for number in np.unique(tags[chosen, column]):
            yield (what, dim, int(number)), np.flatnonzero(chosen & (tags[:, column] == number))
