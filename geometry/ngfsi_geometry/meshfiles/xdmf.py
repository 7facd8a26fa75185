"""XDMF with data in HDF5 or in the file, as FEniCS, ParaView and ngfsi write it: topology names in any case."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from ngfsi.mesh.cells import NODES
from ngfsi_geometry.meshfiles.raw import Block, RawMesh, UnreadableError, grouped_by_arrays, integers

TOPOLOGIES = {
    "polyvertex": "vertex", "polyline": "line", "triangle": "triangle", "quadrilateral": "quad", "tetrahedron": "tetra",
    "pyramid": "pyramid", "wedge": "wedge", "hexahedron": "hexahedron", "edge_3": "line3", "tri_6": "triangle6",
    "triangle_6": "triangle6", "quad_8": "quad8", "quadrilateral_8": "quad8", "quad_9": "quad9",
    "quadrilateral_9": "quad9", "tet_10": "tetra10", "tetrahedron_10": "tetra10", "pyramid_13": "pyramid13",
    "wedge_15": "wedge15", "wedge_18": "wedge18", "hex_20": "hexahedron20", "hexahedron_20": "hexahedron20",
    "hex_27": "hexahedron27", "hexahedron_27": "hexahedron27",
}  # fmt: skip
NUMBERS = {1: "vertex", 2: "line", 4: "triangle", 5: "quad", 6: "tetra", 7: "pyramid", 8: "wedge", 9: "hexahedron",
           34: "line3", 36: "triangle6", 37: "quad8", 35: "quad9", 38: "tetra10", 39: "pyramid13", 40: "wedge15",
           41: "wedge18", 48: "hexahedron20", 50: "hexahedron27"}  # fmt: skip
"""Number in a mixed topology -> kind."""


def read(path: Path, wanted: str | None, file: str) -> RawMesh:
    """Return the mesh in a file and in the HDF5 file that it names, which must lie beside it.

    Raises:
        UnreadableError, or another of `read.DAMAGED`: it is none.
        GeometryError: the groups cannot be told.
    """
    data = path.read_bytes()
    if b"<!ENTITY" in data[:4096]:
        raise UnreadableError("its XML defines entities")
    grids = [g for g in ElementTree.fromstring(data).iter("Grid") if g.find("Topology") is not None]
    if not grids:
        raise UnreadableError("it holds no grid with a topology")
    places = [grid.find("Geometry/DataItem") for grid in grids]
    place = next((p for p in places if p is not None), None)
    if place is None:
        raise UnreadableError("it holds no points")
    points = np.asarray(_values(place, path), dtype=float)
    if points.ndim == 2 and points.shape[1] == 2:
        points = np.pad(points, ((0, 0), (0, 1)))
    blocks: list[Block] = []
    values: dict[str, list[Any]] = {}
    sizes: list[int] = []
    for grid in grids:
        new = list(_cells(grid.find("Topology"), path))
        first = len(blocks)
        blocks += [Block(kind, nodes) for kind, nodes, _ in new]
        sizes += [len(nodes) for _, nodes, _ in new]
        for attribute in grid.iterfind("Attribute"):
            if attribute.get("Center") == "Cell":
                whole = np.asarray(_values(attribute.find("DataItem"), path))
                parts = values.setdefault(str(attribute.get("Name")), [])
                parts += [np.full(n, -1) for n in sizes[len(parts) : first]]
                parts += [whole[rows] for _, _, rows in new]
    for parts in values.values():  # grids of faces and of cells have attributes of their own
        parts += [np.full(n, -1) for n in sizes[len(parts) :]]
    names = {
        (int(entry.get("dim", 0)), int(entry.text or 0)): str(entry.get("key"))
        for grid in grids
        for information in grid.iterfind("Information")
        for entry in (ElementTree.fromstring(information.text) if information.text else ())
    }
    return RawMesh(points, tuple(blocks), grouped_by_arrays(tuple(blocks), values, wanted, file, names))


def _cells(topology: Any, path: Path) -> Iterator[tuple[str, Any, Any]]:
    """Yield kind, nodes and numbers of the cells of a topology."""
    name = str(topology.get("TopologyType") or topology.get("Type")).lower()
    rows = integers(_values(topology.find("DataItem"), path))
    if name == "mixed":
        yield from _mixed(rows)
        return
    if name not in TOPOLOGIES:
        raise UnreadableError(f"it has the topology '{name[:40]}'")
    kind = TOPOLOGIES[name]
    rows = rows.reshape(-1, NODES[kind])
    yield kind, rows, np.arange(len(rows))


def _mixed(stream: Any) -> Iterator[tuple[str, Any, Any]]:
    found: dict[str, tuple[list[Any], list[int]]] = {}
    at = number = 0
    while at < len(stream):
        code = int(stream[at])
        if code not in NUMBERS:
            raise UnreadableError(f"it has a cell of XDMF's type {code}")
        kind = NUMBERS[code]
        at += 2 if code in (1, 2) else 1
        rows, numbers = found.setdefault(kind, ([], []))
        if at + NODES[kind] > len(stream):
            raise UnreadableError("it ends too early")
        rows.append(stream[at : at + NODES[kind]])
        numbers.append(number)
        at, number = at + NODES[kind], number + 1
    for kind, (rows, numbers) in found.items():
        yield kind, np.array(rows), np.array(numbers)


def _values(item: Any, path: Path) -> Any:
    """Return the numbers of a data item."""
    if item is None:
        raise UnreadableError("it lacks a data item")
    if (reference := item.get("Reference")) is not None:
        raise UnreadableError(f"a data item refers to another ({reference[:40]})")
    shape = [int(n) for n in str(item.get("Dimensions", "")).split()]
    form, text = item.get("Format", "XML"), (item.text or "").strip()
    if form == "HDF":
        import h5py

        name, _, inside = text.partition(":")
        if Path(name).name != name:
            raise UnreadableError(f"its numbers are in '{name[:80]}', which does not lie beside it")
        with h5py.File(path.parent / name, "r") as store:
            return store[inside][...].reshape(shape)
    if form != "XML":
        raise UnreadableError(f"its numbers are in the format '{form[:40]}'")
    return np.array(text.split()).astype(float).reshape(shape)
