"""Abaqus's input format: nodes, elements, `*Elset` and `*Surface` of parts and of their instances."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from ngfsi.mesh.cells import FACES_IN_ABAQUS, KINDS, SOLIDS, SURFACES
from ngfsi_geometry.meshfiles.raw import Array, Block, Group, Indices, RawMesh, UnreadableError

SOLID = re.compile(r"(?:[ADFGQ]{0,2}C|F)3D(\d+)", re.IGNORECASE)
SHELL = re.compile(r"(?:DS|S|SC|STRI|M3D|SFM3D|R3D|CPS|CPE|DC2D)(\d)", re.IGNORECASE)


@dataclass
class Part:
    """Nodes, elements and sets of one part."""

    nodes: dict[int, list[float]] = field(default_factory=dict)
    elements: dict[int, tuple[str, list[int]]] = field(default_factory=dict)
    sets: dict[str, list[int]] = field(default_factory=dict)
    surfaces: dict[str, list[tuple[str, str]]] = field(default_factory=dict)
    shift: Array = field(default_factory=lambda: np.zeros(3))


@dataclass(frozen=True)
class Keyword:
    """A keyword's line, and the fields of its data lines."""

    name: str
    options: dict[str, str]
    lines: list[list[str]]


def read(data: bytes) -> RawMesh:
    """Return the mesh in a file's content.

    Raises:
        UnreadableError, or another of `read.DAMAGED`: it is none.
    """
    parts: dict[str, Part] = {}
    instances: dict[str, str] = {}
    here = ""
    remarks: list[str] = []
    for keyword in _keywords(data.decode("utf-8", "replace")):
        match keyword.name:
            case "PART":
                here = keyword.options.get("NAME", "")
            case "ENDPART" | "ENDINSTANCE":
                here = ""
            case "INSTANCE":
                here = keyword.options.get("PART", "")
                _place(parts, instances, keyword, here)
            case "NODE" | "ELEMENT" | "ELSET" | "SURFACE":
                instance = keyword.options.get("INSTANCE")
                target = instances.get(instance.upper(), instance) if instance else here
                _take(parts.setdefault(target.upper(), Part()), keyword, remarks)
            case "INCLUDE":
                raise UnreadableError("it includes another file (*Include): write it as one")
    return _assembled(parts, tuple(dict.fromkeys(remarks)))


def _keywords(text: str) -> Iterator[Keyword]:
    current: Keyword | None = None
    for line in text.splitlines():
        line = line.strip()
        if not line or line.startswith("**"):
            continue
        if line.startswith("*"):
            if current:
                yield current
            head, *options = (word.strip() for word in line[1:].split(","))
            pairs = (option.partition("=") for option in options if option)
            found = {key.strip().upper(): value.strip().strip('"') for key, _, value in pairs}
            current = Keyword(head.upper().replace(" ", ""), found, [])
        elif current:
            current.lines.append([word.strip() for word in line.rstrip(",").split(",")])
    if current:
        yield current


def _place(parts: dict[str, Part], instances: dict[str, str], keyword: Keyword, part: str) -> None:
    """Note an instance, and where it lies."""
    if part.upper() in {name.upper() for name in instances.values()}:
        raise UnreadableError(f"the part '{part}' has several instances: write it with one instance of each part")
    instances[keyword.options.get("NAME", part).upper()] = part
    if len(keyword.lines) > 1:
        raise UnreadableError(f"an instance of the part '{part}' is turned: write the mesh where it lies")
    if keyword.lines:
        parts.setdefault(part.upper(), Part()).shift = np.array([_real(w) for w in keyword.lines[0][:3]])


def _take(part: Part, keyword: Keyword, remarks: list[str]) -> None:
    options, lines = keyword.options, keyword.lines
    match keyword.name:
        case "NODE":
            for words in lines:
                part.nodes[_whole(words[0])] = [*(_real(w) for w in words[1:4]), 0.0, 0.0, 0.0][:3]
        case "ELEMENT":
            kind = _kind(options.get("TYPE", ""))
            if kind is None:
                remarks.append(f"elements of type '{options.get('TYPE', '')[:40]}' are not read")
                return
            numbers = [_whole(w) for words in lines for w in words if w]
            width = 1 + (int("".join(c for c in kind if c.isdigit()) or KINDS[kind].corners))
            if len(numbers) % width:
                raise UnreadableError(f"an element of type '{options['TYPE'][:40]}' has not {width - 1} nodes")
            rows = np.reshape(numbers, (-1, width)).tolist()
            part.elements.update({number: (kind, nodes) for number, *nodes in rows})
            if name := options.get("ELSET"):
                part.sets.setdefault(name, []).extend(row[0] for row in rows)
        case "ELSET":
            name = options.get("ELSET", "")
            part.sets.setdefault(name, []).extend(_members(part, lines, "GENERATE" in options))
        case "SURFACE":
            name = options.get("NAME", "")
            if options.get("TYPE", "ELEMENT").upper() != "ELEMENT":
                remarks.append(f"the surface '{name}' is one of nodes, and not read: make it one of elements")
                return
            part.surfaces[name] = [(words[0], words[1].upper() if len(words) > 1 else "") for words in lines]


def _members(part: Part, lines: list[list[str]], generate: bool) -> list[int]:
    found: list[int] = []
    if generate:
        for first, last, *step in lines:
            every = max(_whole(step[0]), 1) if step and step[0] else 1
            chosen = range(_whole(first), _whole(last) + 1, every)
            found += [number for number in part.elements if number in chosen]
        return found
    for word in (w for words in lines for w in words if w):
        found += part.sets.get(word, []) if not word.lstrip("-").isdigit() else [int(word)]
    return found


def _kind(name: str) -> str | None:
    """Return the kind of cell of an element's type; None: it is no surface or solid."""
    if match := SOLID.match(name):
        return SOLIDS.get(int(match[1]))
    if match := SHELL.match(name):
        return SURFACES.get(int(match[1]))
    return None


def _whole(word: str) -> int:
    if not re.fullmatch(r"[+-]?\d{1,18}", word):
        raise UnreadableError(f"'{word[:40]}' stands in place of a whole number")
    return int(word)


def _real(word: str) -> float:
    try:
        return float(word.lower().replace("d", "e")) if word else 0.0
    except ValueError:
        raise UnreadableError(f"'{word[:40]}' stands in place of a coordinate") from None


def _assembled(parts: dict[str, Part], remarks: tuple[str, ...]) -> RawMesh:
    """Put the parts together; sets and surfaces of the assembly, numbered as their part's, are in `parts`, too."""
    points: list[Array] = [np.zeros((0, 3))]
    blocks: list[Block] = []
    groups: dict[tuple[str, int], dict[int, Indices]] = {}
    filled = {name: part for name, part in parts.items() if part.elements}
    if not filled:
        raise UnreadableError("it has no elements")
    only = next(iter(filled.values())) if len(filled) == 1 else None
    for part in parts.values():
        if part not in filled.values() and only is not None:  # surfaces of the assembly over sets of instances
            only.surfaces |= part.surfaces
            only.sets |= part.sets
        elif part not in filled.values():
            for other in filled.values():
                other.surfaces |= {n: w for n, w in part.surfaces.items() if all(s in other.sets for s, _ in w)}
    offset = 0
    for part in filled.values():
        index = {number: offset + k for k, number in enumerate(part.nodes)}
        points.append(np.array(list(part.nodes.values())).reshape(-1, 3) + part.shift)
        offset += len(part.nodes)
        _add(part, index, blocks, groups)
    return RawMesh(
        np.vstack(points), tuple(blocks), tuple(Group((name,), dim, m) for (name, dim), m in groups.items()), remarks
    )


def _add(
    part: Part, index: dict[int, int], blocks: list[Block], groups: dict[tuple[str, int], dict[int, Indices]]
) -> None:
    """Add a part's elements as blocks, its sets and surfaces as groups."""
    place: dict[int, tuple[int, int]] = {}
    by_kind: dict[str, list[int]] = {}
    for number, (kind, _) in part.elements.items():
        by_kind.setdefault(kind, []).append(number)
    for kind, numbers in by_kind.items():
        place |= {number: (len(blocks), row) for row, number in enumerate(numbers)}
        blocks.append(Block(kind, _rows([part.elements[n][1] for n in numbers], index)))
    for name, members in part.sets.items():
        if not name.startswith("_"):
            for number in members:
                if number not in place:
                    raise UnreadableError(f"the set '{name[:40]}' holds the element {number}, which is not there")
            _sort_in(groups, name, [place[number] for number in members], blocks)
    for name, faces in part.surfaces.items():
        found: dict[int, list[list[int]]] = {}
        for number, face in _faces(part, name, faces):
            corners = _corners(name, face, *part.elements[number])
            found.setdefault(len(corners), []).append(corners)
        for count, rows in found.items():
            groups.setdefault((name, 2), {})[len(blocks)] = np.arange(len(rows))
            blocks.append(Block(SURFACES[count], _rows(rows, index)))


def _corners(name: str, face: str, kind: str, nodes: list[int]) -> list[int]:
    """Return the corners of a face of an element, "S1" and so on; of a shell its own."""
    if KINDS[kind].dim == 2:
        return nodes[: KINDS[kind].corners]
    local = FACES_IN_ABAQUS[KINDS[kind].corners]
    if not re.fullmatch(r"S[1-9]", face) or int(face[1]) > len(local):
        raise UnreadableError(f"the surface '{name[:40]}' has the face '{face[:10]}' of a {kind}, which is none")
    return [nodes[k] for k in local[int(face[1]) - 1]]


def _rows(rows: list[list[int]], index: dict[int, int]) -> Indices:
    try:
        return np.array([[index[n] for n in row] for row in rows], dtype=np.int64)
    except KeyError as error:
        raise UnreadableError(f"an element has the node {error}, which is not there") from None


def _faces(part: Part, name: str, faces: list[tuple[str, str]]) -> Iterator[tuple[int, str]]:
    for what, face in faces:
        if what not in part.sets and not what.isdigit():
            raise UnreadableError(f"the surface '{name[:40]}' is of the set '{what[:40]}', which is not there")
        for number in part.sets.get(what) or [_whole(what)]:
            if number not in part.elements:
                raise UnreadableError(f"the surface '{name[:40]}' has the element {number}, which is not there")
            yield number, face


def _sort_in(
    groups: dict[tuple[str, int], dict[int, Indices]], name: str, places: list[tuple[int, int]], blocks: list[Block]
) -> None:
    found: dict[int, list[int]] = {}
    for block, row in places:
        found.setdefault(block, []).append(row)
    for block, rows in found.items():
        groups.setdefault((name, blocks[block].dim), {})[block] = np.unique(rows)
