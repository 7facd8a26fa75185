"""From a raw mesh and names of its groups to regions and boundaries: what is inferred is said, what is wrong refused.

The mesh stays straight between its corners; the middle nodes of second-order cells become bulges of edges, quadratic on
each edge as in the cells themselves. Nodes in the middle of faces and cells are not needed for that and left out.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import pi
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from ngfsi.errors import GeometryError, suggestion
from ngfsi.mesh.cells import KINDS, Kind
from ngfsi.mesh.curving import EdgeBulges
from ngfsi.units import in_unit
from ngfsi_geometry.meshfiles.raw import Array, Group, Indices, RawMesh

REGIONS = ("fluid", "wall", "tissue")
"""From inside outwards; faces between two regions have normals out of the former."""
BOUNDARIES = ("interface", "wall_outer", "tibia", "fibula", "skin", "inlet", "outlet", "wall_bottom", "wall_top",
              "tissue_bottom", "tissue_top")  # fmt: skip
OPENING = re.compile(r"(inlet|outlet)(?:_([2-9]|[1-9][0-9]+))?")
"""Further openings have a number."""
OMITTED = ""
"""In place of a name: cells that are left out."""
COMMON: dict[tuple[str, ...], str] = {
    ("fluid", "wall"): "interface",
    ("fluid", "tissue"): "interface",
    ("wall", "tissue"): "wall_outer",
}
"""Regions on both sides of a face -> its name, if it is in no group."""
FLAT = 0.015
"""Nodes of an opening may be off its plane by this fraction of its radius: normals then differ by parts in a hundred,
the flow through it by parts in ten thousand."""
END = 0.015
"""Ends of wall and tissue may be off the plane of an opening by this fraction of the mesh's length: layers that meshers
put around a surface end along its normals."""
ALONG = 0.7
"""Least cosine between the normals of an opening and of a face that is an end beside it."""
LEAST_VOLUME = 1e-12
"""Of a cell, relative to the cube of its longest edge: none."""


@dataclass(frozen=True)
class Contents:
    """What a file holds.

    Attributes:
        points: corners (n, 3) [m].
        cells: region, kind and corners (m, corners) of cells, positive in VTK's order.
        faces: name, regions behind and before (None: outside), and corners, normals forwards.
        curved: edges with a middle node.
        remarks: what was inferred, left out or not used.
    """

    points: Array
    cells: tuple[tuple[str, Kind, Indices], ...]
    faces: tuple[tuple[str, str, str | None, Indices], ...]
    curved: EdgeBulges
    remarks: tuple[str, ...]


class Refusal(NamedTuple):
    """How to word what is wrong with a file: its name, and millimetres of a place."""

    file: str

    def at(self, place: Array, what: str) -> GeometryError:
        """Return the error of what is wrong near a place [m], which `what` has as {place}."""
        return GeometryError(f"'{self.file}': " + what.format(place="near " + in_unit(place, "mm", ".3g")))


@dataclass(frozen=True)
class Plane:
    """The plane nearest to the nodes of an opening, and the radius [m] of the circle with the opening's area."""

    centre: Array
    normal: Array
    radius: float

    def distance(self, points: Array) -> float:
        """Return the largest distance [m] of points (n, 3) from the plane."""
        return float(np.max(np.abs((points - self.centre) @ self.normal)))


class Faces(NamedTuple):
    """Faces of cells, once each.

    Attributes:
        corners: (n, 4), around the normal; the fourth of a triangle is -1.
        regions: (n, 2) numbers in `REGIONS` of the cells on both sides, the inner one first; -1: outside.
        centre: (n, 3) middle [m] of the first cell.
        middle: (n, 3) of the face [m].
        normal: (n, 3), out of the first cell, as long as the area [m2].
    """

    corners: Indices
    regions: Indices
    centre: Array
    middle: Array
    normal: Array


def is_boundary(name: str) -> bool:
    """Whether a name is that of a boundary."""
    return name in BOUNDARIES or OPENING.fullmatch(name) is not None


def plane_of(points: Array, faces: Iterable[Indices]) -> Plane:
    """Return the plane through faces (m, 3 or 4), by least squares of the distances of their nodes."""
    parts = [points[corners] for corners in faces]
    nodes = np.unique(np.concatenate([part.reshape(-1, 3) for part in parts]), axis=0)
    centre = nodes.mean(axis=0)
    normal = np.linalg.svd(nodes - centre, full_matrices=False)[2][-1]
    fans = (np.cross(part[:, 1:-1] - part[:, :1], part[:, 2:] - part[:, :1]) for part in parts)
    area = sum(float(np.sum(np.linalg.norm(fan, axis=-1))) / 2 for fan in fans)
    return Plane(centre, normal, float(np.sqrt(area / pi)))


def name_of(group: Group, names: Mapping[str, str]) -> str | None:
    """Return the region or boundary, of the dimension of the group, that it is; None: neither."""
    for title in group.titles:
        name = names.get(title)
        if name == OMITTED and title in names:
            return OMITTED
        if name is not None and (name in REGIONS if group.dim == 3 else is_boundary(name)):
            return name
    plain = group.titles[0]
    named = any(title in names for title in group.titles if not title.isdigit())
    fits = plain in REGIONS if group.dim == 3 else is_boundary(plain)
    return plain if fits and not named else None


def contents(raw: RawMesh, names: Mapping[str, str], scale: float, file: str) -> Contents:
    """Sort out what a file holds.

    Args:
        names: title of a group -> region or boundary, or `OMITTED`; others must be called so.
        scale: metres per unit of the file.

    Raises:
        GeometryError: it is no mesh of a vessel; says why, and where.
    """
    refusal = Refusal(file)
    remarks = [*raw.remarks, *_check_names(raw, names, file)]
    bodies, omitted = _bodies(raw, names, refusal)
    nodes = scale * raw.points
    used = np.unique(np.concatenate([nodes_[:, : kind.corners].ravel() for _, kind, nodes_ in bodies]))
    new = np.full(len(nodes), -1)
    new[used] = np.arange(len(used))
    points = nodes[used]
    cells = tuple((name, kind, _positive(points, kind, new[n[:, : kind.corners]])) for name, kind, n in bodies)
    _check_cells(points, cells, refusal)
    faces = _faces(points, cells, refusal)
    surfaces = _surfaces(raw, names, nodes, new)
    given, said = _given(faces, surfaces, bool(omitted), refusal)
    if omitted:
        remarks.append(f"{omitted} cells are left out")
    titles, inferred = _titles(points, faces, given, refusal)
    boundaries = _boundaries(faces, titles)
    return Contents(points, cells, boundaries, _bulges(nodes, new, bodies), tuple([*remarks, *said, *inferred]))


def _check_names(raw: RawMesh, names: Mapping[str, str], file: str) -> list[str]:
    """Refuse names of groups that are not there; return what is to be said of the others.

    Raises:
        GeometryError: `names` has something that is no group, or one of the other dimension.
    """
    remarks = []
    for title, name in names.items():
        found = [group for group in raw.groups if title in group.titles]
        if not found:
            known = [t for group in raw.groups if group.dim > 1 for t in group.titles[:1]]
            raise GeometryError(f"`names` has '{title}', which is no group of '{file}': "
                                f"{suggestion(title, known)}its groups are {raw.titles}"
                                f"{''.join(f' ({remark})' for remark in raw.remarks)}")  # fmt: skip
        dim = 3 if name in REGIONS else 2
        if name != OMITTED and all(group.dim != dim for group in found):
            kinds = ("cells", "faces") if dim == 3 else ("faces", "cells")
            raise GeometryError(f"`names` has '{title}' as {name}, which is made of {kinds[0]}, but in '{file}' that "
                                f"group holds {kinds[1]}: its groups are {raw.titles}")  # fmt: skip
        if name != OMITTED and {2, 3} <= {group.dim for group in found}:
            remarks.append(f"'{title}' means cells and faces: {name} is of the {'cells' if dim == 3 else 'faces'}; "
                           f"'3:{title}' and '2:{title}' tell them apart")  # fmt: skip
    unused = [
        g for g in raw.groups if g.dim == 2 and name_of(g, names) is None and not g.titles[0].startswith("entity")
    ]
    if unused:
        listed = ", ".join(f"{group.titles[0]} ({group.size} faces)" for group in unused)
        remarks.append(f"groups that are no boundary and not used: {listed}")
    return remarks


def _bodies(raw: RawMesh, names: Mapping[str, str], refusal: Refusal) -> tuple[list[tuple[str, Kind, Indices]], int]:
    """Return region, kind and nodes of the cells of each block, and how many cells are left out."""
    solid = [k for k, block in enumerate(raw.blocks) if block.dim == 3]
    region = {k: np.full(len(raw.blocks[k].nodes), -1) for k in solid}
    left_out = {k: np.zeros(len(raw.blocks[k].nodes), dtype=bool) for k in solid}
    for group in raw.groups:
        name = name_of(group, names) if group.dim == 3 else None
        for k, rows in group.members.items() if name is not None else ():
            if name == OMITTED:
                left_out[k][rows] = True
                continue
            number = REGIONS.index(name or "")
            twice = rows[(region[k][rows] >= 0) & (region[k][rows] != number)]
            if len(twice):
                place = raw.points[raw.blocks[k].nodes[twice[0]]].mean(axis=0)
                other = REGIONS[region[k][twice[0]]]
                at = ", ".join(f"{x:.4g}" for x in place)
                raise GeometryError(
                    f"'{refusal.file}': {len(twice)} cells are in {other} and in {name}, the first at "
                    f"({at}) in the units of the file: leave one of their groups out of `names`"
                )
            region[k][rows] = number
    if all((numbers < 0).all() for numbers in region.values()):
        raise GeometryError(f"'{refusal.file}' has no cells of {', '.join(REGIONS)}: name its groups, which are "
                            f"{raw.titles}, in `names`")  # fmt: skip
    _check_all_known(raw, region, left_out, refusal)
    found = []
    for k, numbers in region.items():
        for number in np.unique(numbers[numbers >= 0]):
            block = raw.blocks[k]
            found.append((REGIONS[number], KINDS[block.kind], block.nodes[numbers == number]))
    return found, sum(int(np.count_nonzero(numbers < 0)) for numbers in region.values())


def _check_all_known(
    raw: RawMesh, region: Mapping[int, Indices], left_out: Mapping[int, np.ndarray], refusal: Refusal
) -> None:
    """Refuse cells that are in no region and not left out on purpose."""
    lost = {k: (numbers < 0) & ~left_out[k] for k, numbers in region.items()}
    count = sum(int(part.sum()) for part in lost.values())
    if not count:
        return
    groups = [
        g.titles[0] for g in raw.groups if g.dim == 3 and any(lost[k][rows].any() for k, rows in g.members.items())
    ]
    of = f" of the group{'s' * (len(groups) > 1)} {', '.join(repr(g) for g in groups)}" if groups else " in no group"
    example = groups[0] if groups else "..."
    raise GeometryError(f"'{refusal.file}': {count} cells{of} are in no region: name them in `names`, or leave them "
                        f"out by \"{example}\" = \"\" there")  # fmt: skip


def _top(kind: Kind, corners: Indices) -> Indices:
    top = corners[:, kind.base :]
    return top[:, ::-1] if top.shape[1] > 1 else top


def turned(kind: Kind, corners: Indices) -> Indices:
    """Return cells (m, corners) mirrored: with their base in the other sense."""
    return np.hstack([corners[:, : kind.base][:, ::-1], _top(kind, corners)])


def _positive(points: Array, kind: Kind, corners: Indices) -> Indices:
    """Return cells with their base counter-clockwise seen from above."""
    wrong = _height(points, kind, corners) < 0
    return np.where(wrong[:, None], turned(kind, corners), corners)


def _height(points: Array, kind: Kind, corners: Indices) -> Array:
    """Return a multiple of the volume of cells, negative for those in the other sense."""
    a, b, c = (points[corners[:, k]] for k in range(3))
    up = points[corners[:, kind.base :]].mean(axis=1) - points[corners[:, : kind.base]].mean(axis=1)
    return np.asarray(np.einsum("ij,ij->i", np.cross(b - a, c - a), up))


def _check_cells(points: Array, cells: Sequence[tuple[str, Kind, Indices]], refusal: Refusal) -> None:
    """Refuse cells without volume."""
    for name, kind, corners in cells:
        size = np.max(np.ptp(points[corners], axis=1), axis=1)
        flat = np.flatnonzero(~(_height(points, kind, corners) > LEAST_VOLUME * size**3))
        if len(flat):
            raise refusal.at(points[corners[flat[0]]].mean(axis=0),
                             f"{len(flat)} cells of {name} have no volume, the first {{place}}")  # fmt: skip


def _padded(corners: Indices) -> Indices:
    return corners if corners.shape[1] == 4 else np.column_stack([corners, np.full(len(corners), -1)])


def _middle(points: Array, corners: Indices) -> Array:
    """Return the middles of faces (n, 4)."""
    three = points[corners[:, :3]].sum(axis=1)
    quad = corners[:, 3] >= 0
    three[quad] += points[corners[quad, 3]]
    return np.asarray(three / (3.0 + quad)[:, None])


def _faces(points: Array, cells: Sequence[tuple[str, Kind, Indices]], refusal: Refusal) -> Faces:
    """Return the faces of cells; refuse those of three cells, and of two on the same side."""
    corners, regions, centres = [], [], []
    for name, kind, nodes in cells:
        middle = points[nodes].mean(axis=1)
        for local in kind.faces:
            corners.append(_padded(nodes[:, list(local)]))
            regions.append(np.full(len(nodes), REGIONS.index(name)))
            centres.append(middle)
    every, region, centre = np.vstack(corners), np.concatenate(regions), np.vstack(centres)
    _, inverse, counts = np.unique(np.sort(every, axis=1), axis=0, return_inverse=True, return_counts=True)
    order = np.lexsort((region, inverse.ravel()))
    if (counts > 2).any():
        one = order[np.cumsum(counts)[np.argmax(counts > 2)] - 1]
        raise refusal.at(_middle(points, every[one : one + 1])[0],
                         f"{int((counts > 2).sum())} faces are of three cells or more, the first {{place}}: cells "
                         "overlap, or are there twice")  # fmt: skip
    first = order[np.cumsum(counts) - counts]
    second = order[np.cumsum(counts) - 1]
    inside = np.flatnonzero(counts == 2)
    sides = np.column_stack([region[first], np.where(counts == 2, region[second], -1)])
    a, b, c = (points[every[first, k]] for k in range(3))
    last = np.where(every[first, 3] >= 0, every[first, 3], every[first, 0])
    normal = (np.cross(b - a, c - a) + np.cross(c - a, points[last] - a)) / 2
    middle = _middle(points, every[first])
    away = np.einsum("ij,ij->i", normal, middle - centre[first])
    normal = np.where((away < 0)[:, None], -normal, normal)
    ahead = every[first]
    reverse = np.where(ahead[:, 3:] >= 0, ahead[:, [3, 2, 1, 0]], ahead[:, [2, 1, 0, 3]])
    oriented = np.where((away < 0)[:, None], reverse, ahead)
    beyond = np.einsum("ij,ij->i", normal[inside], centre[second[inside]] - middle[inside])
    # faces of four corners may be warped: there a little is allowed
    size = np.linalg.norm(normal[inside], axis=1) ** 1.5
    folded = inside[beyond < np.where(every[first[inside], 3] >= 0, -0.05, -1e-9) * size]
    if len(folded):
        raise refusal.at(middle[folded[0]], f"the mesh is folded {{place}}: two cells lie on the same side of a face "
                         f"({len(folded)} such faces)")  # fmt: skip
    return Faces(oriented, sides, centre[first], middle, normal)


def _surfaces(
    raw: RawMesh, names: Mapping[str, str], nodes: Array, new: Indices
) -> list[tuple[str, Indices, Array]]:  # fmt: skip
    """Return names, corners (m, 4) and middles [m] of the faces in groups; corners that no cell has are -2."""
    found = []
    for group in raw.groups:
        name = name_of(group, names) if group.dim == 2 else None
        for k, rows in group.members.items() if name else ():
            block = raw.blocks[k]
            corners = block.nodes[rows][:, : KINDS[block.kind].corners]
            known = np.where(new[corners] < 0, -2, new[corners])
            found.append((name or "", _padded(known), nodes[corners].mean(axis=1)))
    return found


def _given(
    faces: Faces, surfaces: Sequence[tuple[str, Indices, Array]], omitted: bool, refusal: Refusal
) -> tuple[list[str | None], list[str]]:
    """Return for each face the name of its group, and what is to be said.

    Raises:
        GeometryError: a face is none of a cell, or in two groups.
    """
    given: list[str | None] = [None] * len(faces.corners)
    if not surfaces:
        return given, []
    every = np.vstack([faces.corners, *(corners for _, corners, _ in surfaces)])
    _, inverse = np.unique(np.sort(every, axis=1), axis=0, return_inverse=True)
    inverse = inverse.ravel()
    place = np.full(inverse.max() + 1, -1)
    place[inverse[: len(faces.corners)]] = np.arange(len(faces.corners))
    start, lost = len(faces.corners), 0
    for name, corners, middles in surfaces:
        at = place[inverse[start : start + len(corners)]]
        start += len(corners)
        count = int((at < 0).sum())
        if count and not omitted:
            raise refusal.at(middles[np.argmax(at < 0)], f"{count} faces of '{name}' are no faces of cells, the first "
                             "{place}: faces and cells must have the same nodes")  # fmt: skip
        lost += count
        for face in at[at >= 0].tolist():
            if given[face] not in (None, name):
                raise refusal.at(faces.middle[face], f"a face {{place}} is in {given[face]} and in {name}: give it one "
                                 "name")  # fmt: skip
            given[face] = name
    return given, [f"{lost} faces of cells that are left out"] if lost else []


def _titles(
    points: Array, faces: Faces, given: Sequence[str | None], refusal: Refusal
) -> tuple[list[str | None], list[str]]:
    """Return for each face the name of its boundary, None inside of a region, and what was inferred."""
    titles = list(given)
    bare = not (faces.regions == REGIONS.index("tissue")).any()
    fluid = REGIONS.index("fluid")
    blood = [k for k, name in enumerate(given) if name and OPENING.fullmatch(name) and faces.regions[k, 0] == fluid]
    planes = _planes(points, faces, given, blood)
    counts: Counter[str] = Counter()
    for k, name in enumerate(given):
        regions = [REGIONS[r] for r in faces.regions[k] if r >= 0]
        if name is not None and OPENING.fullmatch(name) and regions[0] != "fluid" and planes:
            titles[k] = f"{regions[0]}_{'bottom' if name.startswith('inlet') else 'top'}"
            counts[f"{titles[k]}: {{}} faces of {regions[0]} in the group of {name}"] += 1
        elif name == "wall_outer" and bare and len(regions) == 1:
            titles[k] = "skin"
    length = float(np.max(np.ptp(points, axis=0)))
    for k in np.flatnonzero(faces.regions[:, 0] != faces.regions[:, 1]).tolist():
        if titles[k] is None:
            regions = [REGIONS[r] for r in faces.regions[k] if r >= 0]
            found = COMMON.get(tuple(regions)) or _end(points, faces, k, regions, planes, length)
            if found is None:
                raise _nameless(faces, k, regions, titles, refusal)
            titles[k] = found
            between = f"between {' and '.join(regions)}" if len(regions) > 1 else f"of {regions[0]}"
            counts[f"{found}: {{}} faces {between} in no group"] += 1
    return titles, [text.format(count) for text, count in sorted(counts.items())]


def _nameless(
    faces: Faces, k: int, regions: Sequence[str], titles: Sequence[str | None], refusal: Refusal
) -> GeometryError:
    same = sum(t is None for t, r in zip(titles, faces.regions, strict=True) if (r == faces.regions[k]).all())
    between = " and ".join(regions) + (" and outside" if len(regions) == 1 else "")
    return refusal.at(faces.middle[k], f"a face between {between} {{place}} has no name of a boundary, as have "
                      f"{same} in all: put them into one of {', '.join(BOUNDARIES)}; where parts should touch, their "
                      "nodes are not the same")  # fmt: skip


def _planes(points: Array, faces: Faces, given: Sequence[str | None], blood: Sequence[int]) -> list[tuple[str, Plane]]:
    """Return the planes of the openings, each with the side of the vessel on which it lies."""
    openings: dict[str, list[int]] = {}
    for k in blood:
        openings.setdefault(given[k] or "", []).append(k)
    return [
        ("bottom" if name.startswith("inlet") else "top", plane_of(points, split(faces.corners[rows])))
        for name, rows in openings.items()
    ]


def split(corners: Indices) -> list[Indices]:
    """Return faces (m, 4) as triangles (m, 3) and quadrilaterals (m, 4)."""
    quad = corners[:, 3] >= 0
    return [part for part in (corners[~quad][:, :3], corners[quad]) if len(part)]


def _end(
    points: Array, faces: Faces, k: int, regions: Sequence[str], planes: Sequence[tuple[str, Plane]], length: float
) -> str | None:
    """Return the name of a face that is an end of wall or tissue beside an opening; None: it is none."""
    if len(regions) > 1 or regions[0] == "fluid":
        return None
    corners = faces.corners[k][faces.corners[k] >= 0]
    direction = faces.normal[k] / np.linalg.norm(faces.normal[k])
    near = [
        (plane.distance(points[corners]), side)
        for side, plane in planes
        if plane.distance(points[corners]) <= max(FLAT * plane.radius, END * length)
        and abs(float(direction @ plane.normal)) > ALONG
    ]
    return f"{regions[0]}_{min(near)[1]}" if near else None


def _boundaries(faces: Faces, titles: Sequence[str | None]) -> tuple[tuple[str, str, str | None, Indices], ...]:
    """Return the faces of each boundary by the regions on their sides, with normals out of the first."""
    found: dict[tuple[str, str, str | None, int], list[int]] = {}
    for k, name in enumerate(titles):
        if name is not None:
            behind, before = faces.regions[k]
            beyond = REGIONS[before] if before >= 0 else None
            corners = 4 if faces.corners[k, 3] >= 0 else 3
            found.setdefault((name, REGIONS[behind], beyond, corners), []).append(k)
    result = []
    for (name, behind_, beyond, count), rows in found.items():
        result.append((name, behind_, beyond, faces.corners[rows][:, :count]))
    return tuple(result)


def _bulges(nodes: Array, new: Indices, bodies: Iterable[tuple[str, Kind, Indices]]) -> EdgeBulges:
    """Return the edges that have middle nodes, and the quadrilaterals.

    Which node is in the middle of what is seen from their places: formats differ in that order.
    """
    edges, bulges = [np.zeros((0, 2), dtype=np.int64)], [np.zeros((0, 3))]
    quads, middles = [np.zeros((0, 4), dtype=np.int64)], [np.zeros((0, 3))]
    for _, kind, cell in bodies:
        if cell.shape[1] == kind.corners:
            continue
        size = np.max(np.ptp(nodes[cell[:, : kind.corners]], axis=1), axis=1)
        fours = [face for face in kind.faces if len(face) == 4]
        further = cell.shape[1] > kind.corners + len(kind.edges)
        places = [*kind.edges, *(fours if further else ()), *((tuple(range(kind.corners)),) if further else ())]
        straight = np.stack([nodes[cell[:, list(place)]].mean(axis=1) for place in places], axis=1)
        found = nodes[cell[:, kind.corners :]]
        away = np.linalg.norm(found[:, :, None] - straight[:, None], axis=-1) / size[:, None, None]
        for node, number in zip(*linear_sum_assignment(np.mean(away**2, axis=0)), strict=True):
            corners = new[cell[:, list(places[number])]]
            if len(places[number]) == 2:
                edges.append(np.sort(corners, axis=1))
                bulges.append(found[:, node] - straight[:, number])
            elif number < len(kind.edges) + len(fours):
                quads.append(corners)
                middles.append(found[:, node] - straight[:, number])
    both, first = np.unique(np.vstack(edges), axis=0, return_index=True)
    on_edges = np.vstack(bulges)[first]
    around = np.vstack(quads)
    four, one = np.unique(np.sort(around, axis=1), axis=0, return_index=True)
    beyond = np.vstack(middles)[one] - _by_edges(around[one], both, on_edges)
    return EdgeBulges(both, on_edges, four, beyond)


def _by_edges(quads: Indices, edges: Indices, bulges: Array) -> Array:
    """Return how far the middles of quadrilaterals (m, 4), corners in turn, follow the bulges of their edges: half."""
    number = {edge: k for k, edge in enumerate(map(tuple, edges.tolist()))}
    total = np.zeros((len(quads), 3))
    for side in range(4):
        ends = np.sort(quads[:, [side, (side + 1) % 4]], axis=1)
        total += bulges[[number[a, b] for a, b in ends.tolist()]] / 2
    return total
