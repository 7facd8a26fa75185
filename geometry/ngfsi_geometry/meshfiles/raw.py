"""What a mesh file holds, whatever its format, and how readers refuse."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ngfsi.errors import GeometryError
from ngfsi.mesh.cells import KINDS, NODES

Array: TypeAlias = NDArray[np.float64]
Indices: TypeAlias = NDArray[np.int64]


LARGEST_NUMBER = 2.0**53
"""Of an integer that a real number holds."""


FARTHEST = 1e12
"""Coordinate of a node, in whatever unit, from which on it is none."""


class UnreadableError(Exception):
    """A file is not what its format asks for; `read` says of which file."""


@dataclass(frozen=True)
class Block:
    """Cells of one kind (see `KINDS`): numbers of their nodes from 0, shape (m, nodes), corners first."""

    kind: str
    nodes: Indices

    @property
    def dim(self) -> int:
        """Dimension of the cells."""
        return KINDS[self.kind].dim


@dataclass(frozen=True)
class Group:
    """Cells of one dimension that belong together.

    Attributes:
        titles: what it may be called, the plainest first: its name, "dimension:number", its number.
        members: block -> numbers of its cells in the group.
    """

    titles: tuple[str, ...]
    dim: int
    members: Mapping[int, Indices]

    @property
    def size(self) -> int:
        """Number of its cells."""
        return sum(len(part) for part in self.members.values())


@dataclass(frozen=True)
class RawMesh:
    """Points (n, 3) in the file's unit, blocks of cells, their groups, and what the reader has to say."""

    points: Array
    blocks: tuple[Block, ...]
    groups: tuple[Group, ...]
    remarks: tuple[str, ...] = ()

    def checked(self) -> RawMesh:
        """Return the mesh with its numbers checked: finite points, nodes that exist, whole cells.

        Raises:
            UnreadableError: something is wrong.
        """
        points = np.asarray(self.points, dtype=float)
        if points.ndim != 2 or points.shape[1] != 3:
            raise UnreadableError(f"its points have the shape {points.shape}, not three coordinates each")
        used = np.unique(np.concatenate([block.nodes.ravel() for block in self.blocks] or [np.zeros(0, np.int64)]))
        if len(used) and (used[0] < 0 or used[-1] >= len(points)):
            raise UnreadableError(f"a cell has a node that is not among its {len(points)} nodes")
        if not (np.abs(points[used]) < FARTHEST).all():
            raise UnreadableError(f"a node has a coordinate that is not finite, or of {FARTHEST:g} or more")
        for block in self.blocks:
            if block.nodes.shape[1:] != (NODES[block.kind],):
                raise UnreadableError(f"cells '{block.kind}' have {block.nodes.shape[1:]} nodes")
        return replace(self, points=points)

    @property
    def titles(self) -> str:
        """The groups, for a sentence: first titles, with the numbers of cells or faces."""
        shown = [f"{g.titles[0]} ({g.size} {'cells' if g.dim == 3 else 'faces'})" for g in self.groups if g.dim > 1]
        return ", ".join(shown) or "none"


def titles_of(dim: int, number: int, name: str | None = None, array: str | None = None) -> tuple[str, ...]:
    """Return what a group with a number, and perhaps a name, may be called."""
    by_array = (f"{array}:{number}",) if array else ()
    return *((name,) if name else ()), f"{dim}:{number}", str(number), *by_array


def by_number(
    blocks: Iterable[Block], numbers: Iterable[Indices], names: Mapping[tuple[int, int], str], array: str | None = None
) -> tuple[Group, ...]:
    """Return the groups of cells with the same number.

    Args:
        names: (dimension, number) -> name.
        array: what holds the numbers.
    """
    found: dict[tuple[int, int], dict[int, Indices]] = {}
    for k, (block, tags) in enumerate(zip(blocks, numbers, strict=True)):
        for number in np.unique(tags):
            found.setdefault((block.dim, int(number)), {})[k] = np.flatnonzero(tags == number)
    return tuple(
        Group(titles_of(*key, names.get(key), array), key[0], members) for key, members in sorted(found.items())
    )


def whole(values: object) -> Indices | None:
    """Return an array as whole numbers, or None if it holds others."""
    array = np.asarray(values)
    if array.ndim == 2 and array.shape[1] == 1:
        array = array[:, 0]
    if array.ndim != 1 or array.dtype.kind not in "iufb":
        return None
    if array.dtype.kind == "f" and not ((np.abs(array) < LARGEST_NUMBER).all() and (array == np.round(array)).all()):
        return None
    return array.astype(np.int64)


def integers(values: object) -> Indices:
    """Return numbers of nodes or counts as integers.

    Raises:
        UnreadableError: they are none.
    """
    found = whole(np.ravel(np.asarray(values)))
    if found is None:
        raise UnreadableError("a number that should be whole is none")
    return found


KNOWN_ARRAYS = ("gmsh:physical", "ModelRegionID", "ModelFaceID", "CellEntityIds", "cell_tags", "CellTags", "medit:ref",
                "cell_ids", "region", "boundary", "gmsh:geometrical")  # fmt: skip
"""Arrays in which programs keep the numbers of groups: Gmsh, SimVascular, VMTK, FEniCS, Medit, ngfsi."""


def grouped_by_arrays(
    blocks: tuple[Block, ...], arrays: Mapping[str, list[object]], wanted: str | None, file: str,
    names: Mapping[tuple[int, int], str] | None = None,
) -> tuple[Group, ...]:  # fmt: skip
    """Return the groups that arrays of cells tell: volumes and surfaces each by the first array that has numbers.

    Args:
        arrays: name -> values, an array for each block.
        wanted: name of the array; None: one of those known, or else the only one of whole numbers.

    Raises:
        GeometryError: none can be chosen.
    """
    numbers = {name: parts for name, values in arrays.items() if (parts := _all_whole(values)) is not None}
    if wanted is not None and wanted not in numbers:
        raise GeometryError(f"'{file}' has no groups '{wanted}': its arrays of whole numbers of cells are "
                            f"{', '.join(numbers) or 'none'}")  # fmt: skip
    found: list[Group] = []
    for dim in (3, 2):
        here = [k for k, block in enumerate(blocks) if block.dim == dim]
        chosen = _choice(numbers, here, wanted, file)
        if here and chosen is not None:
            sub = by_number([blocks[k] for k in here], [numbers[chosen][k] for k in here], names or {}, chosen)
            found += [Group(g.titles, dim, {here[k]: part for k, part in g.members.items()}) for g in sub]
        elif here and wanted is None and not numbers:
            found.append(Group(titles_of(dim, 0), dim, {k: np.arange(len(blocks[k].nodes)) for k in here}))
    return tuple(found)


def _choice(numbers: Mapping[str, list[Indices]], here: list[int], wanted: str | None, file: str) -> str | None:
    """Return the array that numbers the groups of some blocks; None: there is none."""
    if wanted is not None:
        return wanted
    different = {name: {int(v) for k in here for v in np.unique(numbers[name][k])} for name in numbers}
    telling = [name for name in KNOWN_ARRAYS if different.get(name, set()) - {-1}]
    # one that tells groups apart before one that has the same number everywhere, as faces in ModelRegionID
    several = [name for name in telling if len(different[name]) > 1]
    if telling:
        return (several or telling)[0]
    if len(numbers) > 1 and here:
        raise GeometryError(f"'{file}' has several arrays of whole numbers of cells: say in `groups` which of "
                            f"{', '.join(numbers)} numbers the groups")  # fmt: skip
    return next(iter(numbers), None)


def _all_whole(values: list[object]) -> list[Indices] | None:
    parts = [whole(part) for part in values]
    return None if any(part is None for part in parts) else [part for part in parts if part is not None]
