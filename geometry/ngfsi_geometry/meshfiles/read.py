"""Which reader reads a file, and folders of files that belong together."""

from __future__ import annotations

import lzma
import re
import warnings
import zlib
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from scipy.spatial import cKDTree

from ngfsi.errors import GeometryError
from ngfsi.mesh.cells import KINDS, NODES
from ngfsi_geometry.meshfiles import abaqus, gmsh, netgen, vtkxml, xdmf
from ngfsi_geometry.meshfiles.raw import Array, Block, Group, RawMesh, UnreadableError, grouped_by_arrays

LARGEST = 2 * 1024**3
"""Bytes of a file, beyond which it is refused: some 20 million cells."""
SUFFIXES = (".msh", ".inp", ".vtu", ".vtp", ".xdmf", ".vol", ".vol.gz", ".vtk", ".med", ".bdf", ".mesh")
"""What is looked for in a folder."""
COMPLETE = "mesh-complete"
"""Begins the names of the files that SimVascular writes for one mesh."""
DAMAGED = (ValueError, KeyError, IndexError, TypeError, OverflowError, MemoryError, RuntimeError, EOFError, zlib.error,
           lzma.LZMAError, ElementTree.ParseError)  # fmt: skip
"""What readers stumble over in files that are not whole."""
MATCH = 1e-2
"""Nodes of the files of a folder are the same if they are nearer than this fraction of the shortest edge."""


def read(path: str, groups: str | None) -> RawMesh:
    """Return the mesh in a file, or in all files of a folder, whose nodes are matched by their places.

    Args:
        groups: array of the cells' numbers of groups; None: that which tells them (see `grouped_by_arrays`).

    Raises:
        GeometryError: it cannot be read.
    """
    place = Path(path)
    if not place.is_dir():
        return _file(place, groups, path)
    files = _files(place)
    if not files:
        raise GeometryError(f"the folder '{path}' holds no mesh: looked for are {', '.join(SUFFIXES)}")
    parts = {_title(place, file): _file(file, groups, str(file)) for file in files}
    return _joined(_without_prefix(parts))


def _files(folder: Path) -> list[Path]:
    """Return the mesh files in a folder; of SimVascular's the volume, and its surface's parts, that have names."""
    files = [f for f in sorted(folder.rglob("*")) if f.is_file() and f.name.lower().endswith(SUFFIXES)]
    complete = {f.parent for f in files if f.name == f"{COMPLETE}.mesh.vtu"}
    chosen = []
    for file in files:
        home = next((c for c in complete if c in file.parents), None)
        surface = home is not None and file.parent.name == "mesh-surfaces"
        if home is None or surface or file.name == f"{COMPLETE}.mesh.vtu":
            chosen.append(file)
    return chosen


def _title(folder: Path, file: Path) -> str:
    """Return how the groups of a file of a folder begin: its path without suffix, or SimVascular's folder of it."""
    inside = file.relative_to(folder).as_posix().removesuffix(file.suffix)
    home = inside.replace(f"{COMPLETE}.mesh", "").replace("mesh-surfaces/", "").replace(f"{COMPLETE}/", "")
    return home.strip("/")


def _without_prefix(parts: dict[str, RawMesh]) -> dict[str, RawMesh]:
    """Return the parts whose groups have their file's title before their own titles, unless no other file has them.

    A file with one group of a dimension gives it its title.
    """
    known = Counter((group.dim, title) for part in parts.values() for group in part.groups for title in group.titles)
    found = {}
    for title, part in parts.items():
        groups = []
        for group in part.groups:
            alone = title and sum(other.dim == group.dim for other in part.groups) == 1
            plain = tuple(t for t in group.titles if known[group.dim, t] == 1)
            named = tuple(t for t in plain if not t.replace(":", "").isdigit())
            own = tuple("/".join(filter(None, (title, t))) for t in group.titles)
            titles = (*named, *((title,) if alone else ()), *own, *plain)
            groups.append(Group(tuple(dict.fromkeys(titles)), group.dim, group.members))
        found[title] = RawMesh(part.points, part.blocks, tuple(groups), part.remarks)
    return found


def _joined(parts: dict[str, RawMesh]) -> RawMesh:
    points: list[Array] = []
    blocks: list[Block] = []
    groups: list[Group] = []
    offset = 0
    for part in parts.values():
        first = len(blocks)
        blocks += [Block(block.kind, block.nodes + offset) for block in part.blocks]
        groups += [Group(g.titles, g.dim, {first + k: rows for k, rows in g.members.items()}) for g in part.groups]
        points.append(part.points)
        offset += len(part.points)
    both = RawMesh(np.vstack(points), tuple(blocks), tuple(groups),
                   tuple(dict.fromkeys(r for part in parts.values() for r in part.remarks)))  # fmt: skip
    return merged(both, MATCH)


def merged(mesh: RawMesh, fraction: float) -> RawMesh:
    """Return the mesh with nodes that are nearer than a fraction of its shortest edge made one."""
    shortest = np.inf
    for block in mesh.blocks:
        edges = np.array(KINDS[block.kind].edges, dtype=np.int64).reshape(-1, 2)
        ends = mesh.points[block.nodes[:, edges]]
        lengths = np.linalg.norm(ends[:, :, 0] - ends[:, :, 1], axis=-1)
        shortest = min(shortest, float(np.min(lengths[lengths > 0], initial=np.inf)))
    if not np.isfinite(shortest):
        return mesh
    used = np.unique(np.concatenate([block.nodes.ravel() for block in mesh.blocks]))
    pairs = cKDTree(mesh.points[used]).query_pairs(fraction * shortest, output_type="ndarray")
    if not len(pairs):
        return mesh
    first = np.arange(len(mesh.points))
    for a, b in np.sort(used[pairs], axis=1)[np.lexsort(np.sort(used[pairs], axis=1).T[::-1])]:
        first[b] = min(first[b], first[a])
    blocks = tuple(Block(block.kind, first[block.nodes]) for block in mesh.blocks)
    count = int(np.count_nonzero(first != np.arange(len(first))))
    remark = f"{count} nodes lie where others do, and were made one with them"
    return RawMesh(mesh.points, blocks, mesh.groups, (*mesh.remarks, remark))


def _file(path: Path, groups: str | None, file: str) -> RawMesh:
    readers: dict[str, Callable[[bytes], RawMesh]] = {
        ".msh": lambda data: gmsh.read(data, groups), ".inp": abaqus.read, ".vol": netgen.read, ".gz": netgen.read,
        ".vtu": lambda data: vtkxml.read(data, groups, file), ".vtp": lambda data: vtkxml.read(data, groups, file),
    }  # fmt: skip
    suffix = path.suffix.lower()
    try:
        if path.stat().st_size > LARGEST:
            raise UnreadableError(f"it is larger than {LARGEST / 1e9:.0f} GB")
        if suffix in readers:
            return readers[suffix](path.read_bytes()).checked()
        if suffix == ".xdmf":
            return xdmf.read(path, groups, file).checked()
        return _other(path, groups, file).checked()
    except OSError as error:
        raise GeometryError(f"the mesh '{file}' cannot be read: {error.strerror or error}") from None
    except UnreadableError as error:
        raise GeometryError(f"'{file}' cannot be read as a mesh: {error}") from None
    except DAMAGED as error:
        reason = re.sub(r"np\.\w+_\((.*)\)", r"\1", f"{type(error).__name__}: {error}")
        raise GeometryError(f"'{file}' cannot be read as a mesh: it is damaged ({reason[:200]})") from None


def _other(path: Path, groups: str | None, file: str) -> RawMesh:
    """Return what meshio reads of further formats."""
    import meshio
    from meshio._mesh import topological_dimension

    # meshio reads them, but does not know their dimension
    topological_dimension.setdefault("wedge15", 3)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            mesh: Any = meshio.read(path)
    except (Exception, SystemExit) as error:  # meshio's readers raise whatever they stumble over, or exit
        raise UnreadableError(str(error) or type(error).__name__) from None
    for block in mesh.cells:
        if block.type not in KINDS:
            raise UnreadableError(f"it has cells '{block.type}': mesh with {', '.join(NODES)}")
    blocks = tuple(Block(block.type, np.asarray(block.data, dtype=np.int64)) for block in mesh.cells)
    if mesh.cell_sets and groups is None:
        found = []
        for name, parts in mesh.cell_sets.items():
            for dim in (2, 3):
                here = {k: np.asarray(part, dtype=np.int64) for k, part in enumerate(parts)
                        if len(part) and blocks[k].dim == dim}  # fmt: skip
                found += [Group((name,), dim, here)] if here else []
        return RawMesh(mesh.points, blocks, tuple(found))
    names = {(int(dim), int(number)): name for name, (number, dim) in mesh.field_data.items()}
    return RawMesh(mesh.points, blocks, grouped_by_arrays(blocks, dict(mesh.cell_data), groups, file, names))
