"""Meshes of straight segments: a meshed plane section is extruded along z.

Netgen's own way to prisms (`CloseSurfaces` and `ZRefinement`) identifies points of opposite planes and ends the
process for unlucky dimensions. Here Netgen only triangulates (parts of) one section. The mesh carries a
CSG geometry of its planes and cylinders, so `Curve(order)` puts it onto them, also after saving and loading. Normals
of outer boundaries point out of the body, those of faces between regions away from the vein's axis.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from math import cos, sin
from typing import Any

import netgen.csg as csg
import netgen.meshing as nm
import numpy as np
from numpy.typing import NDArray

from ngfsi_geometry.plane import Ellipse, Indices, Points, SectionMesh


def extrude(
    section: SectionMesh, heights: Points, ends: Mapping[str, tuple[str, str]], split: bool,
    regions: Sequence[Sequence[NDArray[np.str_]]] | None = None,
) -> Any:  # fmt: skip
    """Return the Netgen mesh of the section extruded through the heights z [m] (increasing, from 0).

    Args:
        ends: material -> boundary names of its faces at the first and at the last height.
        split: tetrahedra instead of prisms (needs a section of triangles).
        regions: for each layer the material of each cell, where it is another than that of the section.

    The mesh has names and is straight; with ellipses alone it has a CSG geometry for `Curve`.
    """
    layers, plane = len(heights) - 1, len(section.points)
    mesh = nm.Mesh(dim=3)
    in_plane = np.tile(section.points, (layers + 1, 1))
    mesh.AddPoints(np.ascontiguousarray(np.column_stack([in_plane, np.repeat(heights, plane)])))
    if regions is None:
        regions = [[np.full(len(cell), name) for name, cell in section.cells]] * layers
    there = dict.fromkeys(str(name) for layer in regions for part in layer for name in dict.fromkeys(part.tolist()))
    domains = {name: k for k, name in enumerate(there, start=1)}
    numbers = [np.concatenate([[domains[n] for n in part.tolist()] for part in layer]) for layer in regions]
    # Curve gives an edge shared by two faces the surface of the later one: planes first, so that rims become arcs
    for name, domain in domains.items():
        for surface, layer in enumerate((0, layers - 1)):
            cells = [cell[part == name] for (_, cell), part in zip(section.cells, regions[layer], strict=True)]
            faces = [cell[:, ::-1] if surface == 0 else cell + layers * plane for cell in cells if len(cell)]
            if faces:
                _add_face(mesh, ends[name][surface], surface, (domain, 0), faces)
    beside = _cells_beside(section)
    strips = [(ring.circle.name, np.column_stack((ring.nodes, np.roll(ring.nodes, -1)))) for ring in section.rings]
    strips += [(side.name, side.edges) for side in section.sides]
    for surface, (name, edges) in enumerate(strips, start=2):
        _add_strip(mesh, name, surface, edges, beside, numbers, plane, split)
    for name, domain in domains.items():
        mesh.SetMaterial(domain, name)
    for (k, (_, cell)), (name, domain) in product(enumerate(section.cells), domains.items()):
        chosen = [cell[layer[k] == name] for layer in regions]
        bodies = np.vstack([_raise_cells(part, n, plane, split) for n, part in enumerate(chosen)])
        mesh.AddElements(dim=3, index=domain, data=np.ascontiguousarray(bodies), base=0)
    ellipses = [ring.circle for ring in section.rings if isinstance(ring.circle, Ellipse)]
    if len(ellipses) == len(section.rings):
        mesh.SetGeometry(_surfaces(section, ellipses, float(heights[-1])))
    return mesh


def _surfaces(section: SectionMesh, ellipses: Sequence[Ellipse], length: float) -> Any:
    """Return the CSG geometry of all surfaces."""
    geometry = csg_surfaces(ellipses, length)
    for side in section.sides:
        begin, end = section.points[side.edges[0]]
        outwards = csg.Vec(end[1] - begin[1], begin[0] - end[0], 0)
        geometry.Add(csg.Plane(csg.Pnt(*begin, 0), outwards))
    return geometry


def _cells_beside(section: SectionMesh) -> dict[tuple[int, int], int]:
    """Return by directed edge of the section the number, over all materials, of the cell to its left."""
    found, first = {}, 0
    for _, cells in section.cells:
        for k, cell in enumerate(cells.tolist(), start=first):
            found.update({(a, b): k for a, b in zip(cell, cell[1:] + cell[:1], strict=True)})
        first += len(cells)
    return found


def _add_strip(
    mesh: Any, name: str, surface: int, edges: Indices, beside: Mapping[tuple[int, int], int],
    numbers: Sequence[NDArray[np.int_]], plane: int, split: bool,
) -> None:  # fmt: skip
    """Add the faces over directed edges, one face for each pair of domains to the left and to the right of them."""
    faces: dict[tuple[int, int], list[Indices]] = {}
    for layer, domains in enumerate(numbers):
        pairs = [tuple(int(domains[k]) if (k := beside.get(way, -1)) >= 0 else 0 for way in ((a, b), (b, a)))
                 for a, b in edges.tolist()]  # fmt: skip
        for sides in dict.fromkeys(pairs):
            chosen = edges[[pair == sides for pair in pairs]]
            faces.setdefault((sides[0], sides[1]), []).append(_raise_edges(chosen, layer, plane, split))
    for (left, right), strips in faces.items():
        whole = np.vstack(strips)
        if left == 0:
            left, right, whole = right, left, whole[:, ::-1]
        _add_face(mesh, name, surface, (left, right), [whole])


def _raise_edges(edges: Indices, layer: int, plane: int, split: bool) -> Indices:
    """Return the faces over directed edges (m, 2) in a layer, normals to the right of the edges."""
    a, b = (edges + layer * plane).T
    c, d = b + plane, a + plane
    if not split:
        return np.column_stack((a, b, c, d))
    up = (a < b)[:, None]  # the diagonal starts at the smaller number, as in _raise_cells
    first = np.where(up, np.column_stack((a, b, c)), np.column_stack((a, b, d)))
    second = np.where(up, np.column_stack((a, c, d)), np.column_stack((b, c, d)))
    return np.vstack((first, second))


def _raise_cells(cells: Indices, layer: int, plane: int, split: bool) -> Indices:
    """Return the prisms or hexahedra over cells in a layer, or the tetrahedra of Kuhn's split of the prisms.

    Netgen numbers the vertices of a solid element such that its lower face is clockwise seen from above.
    """
    low = cells[:, ::-1] + layer * plane
    if not split:
        return np.hstack((low, low + plane))
    a, b, c = np.sort(low, axis=1).T
    parts = (a, b, c, c + plane), (a, b + plane, b, c + plane), (a, a + plane, b + plane, c + plane)
    tetrahedra = np.vstack([np.column_stack(part) for part in parts])
    odd = np.tile(_odd(low), len(parts))[:, None]
    return np.where(odd, tetrahedra[:, [1, 0, 2, 3]], tetrahedra)


def _odd(triangles: Indices) -> NDArray[np.bool_]:
    """Return which triangles are odd permutations of their sorted numbers."""
    a, b, c = triangles.T
    return np.asarray((a > b) ^ (b > c) ^ (a > c))


def _add_face(mesh: Any, name: str, surface: int, domains: tuple[int, int], elements: Sequence[Indices]) -> None:
    """Add surface elements as a new named face; domains: behind and before it along its normal."""
    number = mesh.GetNFaceDescriptors() + 1
    index = mesh.Add(nm.FaceDescriptor(surfnr=surface, domin=domains[0], domout=domains[1], bc=number))
    mesh.SetBCName(number - 1, name)
    for part in elements:
        mesh.AddElements(dim=2, index=index, data=np.ascontiguousarray(part, dtype=np.int32), base=0)


def csg_surfaces(ellipses: Sequence[Ellipse], length: float) -> Any:
    """Return a CSG geometry of planes at z = 0 (surface 0) and length (1) and of a cylinder per ellipse (2, ...)."""
    geometry = csg.CSGeometry()
    geometry.Add(csg.Plane(csg.Pnt(0, 0, 0), csg.Vec(0, 0, -1)))
    geometry.Add(csg.Plane(csg.Pnt(0, 0, length), csg.Vec(0, 0, 1)))
    for ellipse in ellipses:
        geometry.Add(cylinder(ellipse, 0, length))
    return geometry


def cylinder(ellipse: Ellipse, low: float, high: float) -> Any:
    """Return Netgen's cylinder over an ellipse, whose axis is given between two heights [m] but has no ends."""
    base = csg.Pnt(ellipse.x, ellipse.y, low)
    if ellipse.ratio == 1:
        return csg.Cylinder(base, csg.Pnt(ellipse.x, ellipse.y, high), ellipse.radius)
    (a, b), c, s = ellipse.semi_axes, cos(ellipse.direction), sin(ellipse.direction)
    # a cone whose ends are equal
    return csg.EllipticCone(base, csg.Vec(a * c, a * s, 0), csg.Vec(-b * s, b * c, 0), high - low, 1.0)


def layer_heights(length: float, layers: int, end_refinement: float) -> Points:
    """Return the z of layer boundaries; layers at the ends are `end_refinement` times thinner than at mid-length."""
    from_middle = np.abs(2 * (np.arange(layers) + 0.5) / layers - 1)
    steps = end_refinement**-from_middle
    heights: Points = np.concatenate([[0.0], np.cumsum(steps)]) * length / steps.sum()
    heights[-1] = length
    return heights
