"""Netgen's own format (.vol, also packed as .vol.gz), straight or with middle nodes."""

from __future__ import annotations

import zlib
from typing import Any

import numpy as np

from ngfsi.mesh.cells import SOLIDS, SURFACES
from ngfsi_geometry.meshfiles.raw import Block, Group, Indices, RawMesh, UnreadableError, titles_of

LARGEST = 2**31
"""Bytes of an unpacked file, beyond which it is refused."""


def read(data: bytes) -> RawMesh:
    """Return the mesh in a file's content.

    Raises:
        UnreadableError, or another of `read.DAMAGED`: it is none.
    """
    if data[:2] == b"\x1f\x8b":
        unpack = zlib.decompressobj(wbits=31)
        data = unpack.decompress(data, LARGEST)
        if unpack.unconsumed_tail or not unpack.eof:
            raise UnreadableError("it is not whole, or larger than 2 GB")
    return _read(data.decode("utf-8", "replace").splitlines())


def _read(lines: list[str]) -> RawMesh:
    words = [line.split() for line in lines]
    if not any(w[:1] == ["mesh3d"] for w in words[:5]):
        raise UnreadableError("it does not begin as a mesh of Netgen")
    sections: dict[str, list[list[str]]] = {}
    at = 0
    while at < len(words) and words[at] != ["endmesh"]:  # behind it is the geometry that was meshed
        name = words[at][0] if len(words[at]) == 1 else ""
        count = words[at + 1] if at + 1 < len(words) else []
        if name.isidentifier() and len(count) == 1 and count[0].isdigit():
            rows = words[at + 2 : at + 2 + int(count[0])]
            if len(rows) < int(count[0]) or ["endmesh"] in rows:
                raise UnreadableError("it ends too early")
            sections[name] = rows
            at += 2 + len(rows)
        else:
            at += 1
    points = np.array([[float(x) for x in row[:3]] for row in sections.get("points", [])]).reshape(-1, 3)
    names = {
        (dim, int(row[0])): " ".join(row[1:])
        for dim, section in ((3, "materials"), (2, "bcnames"))
        for row in sections.get(section, [])
    }
    faces = next((rows for name, rows in sections.items() if name.startswith("surfaceelements")), [])
    blocks: list[Block] = []
    members: dict[tuple[int, int], dict[int, Indices]] = {}
    # surface: number of the surface, boundary condition, region in and out, number of nodes, nodes
    _add(blocks, members, 2, [(int(row[1]), row[5 : 5 + int(row[4])]) for row in faces])
    _add(blocks, members, 3, [(int(row[0]), row[2 : 2 + int(row[1])]) for row in sections.get("volumeelements", [])])
    groups = tuple(Group(titles_of(*key, names.get(key)), key[0], part) for key, part in sorted(members.items()))
    return RawMesh(points, tuple(blocks), groups)


def _add(blocks: list[Block], members: Any, dim: int, rows: list[tuple[int, list[str]]]) -> None:
    kinds = SURFACES if dim == 2 else SOLIDS
    counts = {len(nodes) for _, nodes in rows}
    for count in sorted(counts):
        if count not in kinds:
            raise UnreadableError(f"it has elements of {count} nodes")
        chosen = [(number, nodes) for number, nodes in rows if len(nodes) == count]
        numbers = np.array([number for number, _ in chosen])
        for number in np.unique(numbers):
            members.setdefault((dim, int(number)), {})[len(blocks)] = np.flatnonzero(numbers == number)
        blocks.append(Block(kinds[count], np.array([nodes for _, nodes in chosen]).astype(np.int64) - 1))
