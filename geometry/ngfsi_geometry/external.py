"""A user's own mesh of a vessel, read by meshio (Gmsh, VTU, Abaqus and more), with its groups as checked names.

The mesh stays straight between its corners; the middle nodes of second-order cells become the shape map, quadratic on
each edge as in the cells themselves. Nodes in the middle of faces and cells are not needed for that and left out.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from math import pi
from typing import Any, ClassVar, Literal, NamedTuple, Self

import meshio
import numpy as np
from meshio._mesh import topological_dimension
from numpy.typing import NDArray
from pydantic import Field, model_validator

from ngfsi.config.model import ConfigModel
from ngfsi.errors import GeometryError, NgfsiError, unknown
from ngfsi.mesh.curving import EdgeBulges
from ngfsi.mesh.geometry import Vessel
from ngfsi.units import to_si
from ngfsi_geometry.content import check_digest, digest

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

REGIONS = ("fluid", "wall", "tissue")
"""From inside outwards; faces between two regions have normals out of the former."""
BOUNDARIES = ("interface", "wall_outer", "tibia", "fibula", "skin", "inlet", "outlet", "wall_bottom", "wall_top",
              "tissue_bottom", "tissue_top")  # fmt: skip
OPENING = re.compile(r"(inlet|outlet)(?:_([2-9]|[1-9][0-9]+))?")
"""Further openings have a number."""
COMMON: dict[tuple[str, ...], str] = {
    ("fluid", "wall"): "interface",
    ("fluid", "tissue"): "interface",
    ("wall", "tissue"): "wall_outer",
}
"""Regions on both sides of a face -> its name, if it is in no group."""
FLAT = 0.015
"""Nodes of an opening may be off its plane by this fraction of its radius: normals then differ by parts in a hundred,
the flow through it by parts in ten thousand."""
GMSH = "gmsh:physical"


@dataclass(frozen=True)
class Kind:
    """A kind of cell in VTK's order: dimension, number of corners, edges, faces, and corners of the base.

    Attributes:
        other_edges: their order in files of other programs, whose middle nodes meshio leaves as they are.
    """

    dim: int
    corners: int
    edges: tuple[tuple[int, int], ...]
    faces: tuple[tuple[int, ...], ...] = ()
    base: int = 0
    other_edges: tuple[tuple[int, int], ...] = ()


TRIANGLE = Kind(2, 3, ((0, 1), (1, 2), (2, 0)))
QUAD = Kind(2, 4, ((0, 1), (1, 2), (2, 3), (3, 0)))
TETRA = Kind(3, 4, ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)), ((0, 1, 2), (0, 1, 3), (1, 2, 3), (0, 2, 3)), 3)
WEDGE = Kind(3, 6, ((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)),
             ((0, 1, 2), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)), 3,
             ((0, 1), (2, 0), (0, 3), (1, 2), (1, 4), (2, 5), (3, 4), (5, 3), (4, 5)))  # fmt: skip
HEXAHEDRON = Kind(3, 8, ((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4),
                         (0, 4), (1, 5), (2, 6), (3, 7)),
                  ((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)), 4)  # fmt: skip
KINDS = {
    "triangle": TRIANGLE, "triangle6": TRIANGLE, "quad": QUAD, "quad8": QUAD, "quad9": QUAD,
    "tetra": TETRA, "tetra10": TETRA, "wedge": WEDGE, "wedge15": WEDGE, "wedge18": WEDGE,
    "hexahedron": HEXAHEDRON, "hexahedron20": HEXAHEDRON, "hexahedron27": HEXAHEDRON,
}  # fmt: skip
# meshio reads and writes them, but does not know their dimension
topological_dimension.setdefault("wedge15", 3)
IGNORED = ("vertex", "line", "line3")


@dataclass(frozen=True)
class Contents:
    """What a file holds.

    Attributes:
        points: corners (n, 3) [m].
        cells: region, kind and corners (m, corners) of cells, positive in VTK's order.
        faces: name, regions behind and before (None: outside), and corners, normals forwards.
        curved: edges with a middle node.
    """

    points: Array
    cells: tuple[tuple[str, Kind, Indices], ...]
    faces: tuple[tuple[str, str, str | None, Indices], ...]
    curved: EdgeBulges


class Side(NamedTuple):
    """One side of a face: region and middle [m] of the cell there, and the face's corners in order."""

    region: str
    centre: Array
    corners: Indices


@dataclass(frozen=True)
class Plane:
    """The plane nearest to the nodes of an opening, and the radius [m] of the circle with the opening's area."""

    centre: Array
    normal: Array
    radius: float

    def distance(self, points: Array) -> float:
        """Return the largest distance [m] of points (n, 3) from the plane."""
        return float(np.max(np.abs((points - self.centre) @ self.normal)))


class ExternalMesh(ConfigModel):
    """A mesh from a file: a vessel along any line, with any number of flat openings, in the coordinates of the file.

    Regions are fluid, wall and tissue, those that the file has. Blood enters through the boundaries inlet, inlet_2 ...
    and leaves through outlet, outlet_2 ... A face in no group is the interface between blood and a solid, the outer
    wall between wall and tissue, and an end of wall or tissue in the plane of an inlet (bottom) or of an outlet (top).
    Without tissue the outer surface of the wall is the skin, on which the pressure from outside acts.
    """

    refusal: ClassVar[type[NgfsiError]] = GeometryError

    file: str = Field(min_length=1)
    unit: Literal["m", "cm", "mm", "um"] = "mm"
    """Unit of length in the file."""
    names: dict[str, str] = Field(default_factory=dict)
    """Name of a group in the file (or its number) -> name of the region or boundary; others must have these names."""
    groups: str = GMSH
    """Array of numbers of the cells' groups, where the file has no named sets of cells."""
    sha256: str = Field(default_factory=lambda given: digest(given["file"], "mesh"))
    """Of the file: a case belongs to its content."""

    @model_validator(mode="after")
    def _can_be_used(self) -> Self:
        check_digest(self.file, "mesh", self.sha256)
        if wrong := next((n for n in self.names.values() if n not in REGIONS and not _is_boundary(n)), None):
            raise ValueError(unknown("region or boundary", wrong, (*REGIONS, *BOUNDARIES, "inlet_2", "outlet_2")))
        needed = {"inlet", "outlet", "interface"} if self.fluid else set()
        if missing := sorted(needed - set(self.boundary_names)):
            raise ValueError(
                f"'{self.file}' has no cells of {', '.join(missing)}: name its groups, which are "
                f"{', '.join(self._found)}, in `names`"
            )
        for name in (*self._openings("inlet"), *self._openings("outlet")):
            self._check_flat(name)
        return self

    def _check_flat(self, name: str) -> None:
        points, curved = self._contents.points, self._contents.curved
        faces = [corners for title, _, _, corners in self._contents.faces if title == name]
        plane, nodes = _plane(points, faces), np.concatenate([part.ravel() for part in faces])
        here = np.isin(curved.edges, nodes).all(axis=1)
        middles = points[curved.edges[here]].mean(axis=1) + curved.bulges[here]
        away = plane.distance(np.vstack([points[nodes], middles]))
        if away > FLAT * plane.radius:
            raise ValueError(
                f"the {name} of '{self.file}' must be flat: a node lies {1e3 * away:.3g} mm off its plane, more than "
                f"{FLAT:.1%} of its radius of {1e3 * plane.radius:.3g} mm: cut the vessel by a plane there, and give "
                f"each opening a name of its own ({name}, {name.partition('_')[0]}_2 ...)"
            )

    def _openings(self, kind: str) -> tuple[str, ...]:
        """Return the names of the inlets or of the outlets, by their numbers."""
        found = [match for name in self.boundary_names if (match := OPENING.fullmatch(name)) and match[1] == kind]
        return tuple(match[0] for match in sorted(found, key=lambda match: int(match[2] or 1)))

    @cached_property
    def _raw(self) -> Any:
        try:
            return meshio.read(self.file)
        except (Exception, SystemExit) as error:  # meshio's readers raise whatever they stumble over, or exit
            raise GeometryError(f"'{self.file}' cannot be read as a mesh: {error or type(error).__name__}") from None

    @cached_property
    def _groups(self) -> dict[str, list[Indices]]:
        """Group -> numbers of its cells in each block."""
        mesh = self._raw
        if self.groups in mesh.cell_data:
            tags = mesh.cell_data[self.groups]
            titles = {(int(tag), int(dim)): name for name, (tag, dim) in mesh.field_data.items()}
            found: dict[str, list[Indices]] = {}
            for k, (block, numbers) in enumerate(zip(mesh.cells, tags, strict=True)):
                for tag in np.unique(numbers):
                    title = titles.get((int(tag), block.dim), str(tag))
                    parts = found.setdefault(title, [np.zeros(0, dtype=np.int64) for _ in mesh.cells])
                    parts[k] = np.flatnonzero(numbers == tag)
            return found
        if mesh.cell_sets:
            return {name: [np.asarray(p, dtype=np.int64) for p in parts] for name, parts in mesh.cell_sets.items()}
        arrays = ", ".join(mesh.cell_data) or "none"
        raise GeometryError(
            f"'{self.file}' has no groups '{self.groups}' and no sets: its arrays of cells are {arrays}"
        )

    @property
    def _found(self) -> tuple[str, ...]:
        return tuple(self._groups)

    @cached_property
    def _contents(self) -> Contents:
        return _contents(self._raw, self._named(), to_si(1.0, self.unit), self.file)

    def _named(self) -> Iterator[tuple[str, Kind, Indices]]:
        """Yield name, kind and nodes of the cells of each group, surfaces and volumes."""
        for title, parts in self._groups.items():
            for block, numbers in zip(self._raw.cells, parts, strict=True):
                if not len(numbers) or block.type in IGNORED:
                    continue
                if block.type not in KINDS:
                    raise GeometryError(f"'{self.file}' has cells '{block.type}': mesh with {', '.join(KINDS)}")
                kind, name = KINDS[block.type], self.names.get(title, title)
                if name in REGIONS if kind.dim == 3 else _is_boundary(name):
                    yield name, kind, np.asarray(block.data[numbers], dtype=np.int64)

    @property
    def _regions(self) -> set[str]:
        return {name for name, _, _ in self._contents.cells}

    @property
    def solids(self) -> tuple[str, ...]:
        """Names of the solids."""
        return tuple(name for name in ("tissue", "wall") if name in self._regions)

    @property
    def fluid(self) -> str | None:
        """Name of the blood, if there is any."""
        return "fluid" if "fluid" in self._regions else None

    @property
    def vessels(self) -> tuple[Vessel, ...]:
        """The vessel; none in solids without an interface."""
        if "interface" not in self.boundary_names:
            return ()
        wall = "wall" if "wall" in self._regions else None
        outer = "wall_outer" if "wall_outer" in self.boundary_names else None
        inlets, outlets = self._openings("inlet"), self._openings("outlet")
        return (Vessel(lumen=self.fluid, wall=wall, outer=outer, inlets=inlets, outlets=outlets, radius=self.size),)

    @property
    def curving_order(self) -> int:
        """2 if the file has second-order cells, else 1."""
        return 2 if len(self._contents.curved.edges) else 1

    @property
    def boundary_names(self) -> tuple[str, ...]:
        """Every boundary of the mesh."""
        return tuple(dict.fromkeys(name for name, *_ in self._contents.faces))

    @property
    def internal_names(self) -> tuple[str, ...]:
        """Boundaries inside a region: none."""
        return ()

    @property
    def rigid_names(self) -> tuple[str, ...]:
        """Boundaries that are fixed in space: bones, and without solids the wall."""
        fixed = ("tibia", "fibula") if self.solids else ("interface",)
        return tuple(name for name in fixed if name in self.boundary_names)

    @property
    def length(self) -> float:
        """Distance [m] of the first inlet and the first outlet; without blood the longest extent of the mesh."""
        if not self.fluid:
            return float(np.max(np.ptp(self._contents.points, axis=0)))
        return float(np.linalg.norm(self._measured["outlet"][1] - self._measured["inlet"][1]))

    @cached_property
    def _measured(self) -> dict[str, tuple[float, Array]]:
        """Area [m2] and centre (x, y, z) [m] of first inlet, first outlet and interface, curved edges included."""
        import ngsolve as ng

        mesh, shape = self._shaped
        mesh.SetDeformation(shape)
        found = {}
        for name in {"inlet", "outlet", "interface"} & set(self.boundary_names):
            over = ng.ds(definedon=mesh.Boundaries(name), bonus_intorder=4)
            area, *moments = (float(ng.Integrate(value * over, mesh)) for value in (ng.CF(1.0), ng.x, ng.y, ng.z))
            found[name] = area, np.array(moments) / area
        mesh.UnsetDeformation()
        return found

    @property
    def size(self) -> float:
        """Radius [m] of the circle with the area of the first inlet; without blood half of the mesh's least extent."""
        if not self.fluid:
            return float(np.min(np.ptp(self._contents.points, axis=0))) / 2
        return float(np.sqrt(self._measured["inlet"][0] / pi))

    @property
    def lumen_radius(self) -> float:
        """Radius of the lumen [m]."""
        return self.size

    @property
    def wall_thickness(self) -> float:
        """Thickness [m] of a round wall with the volume and the inner area of this one; 0 without a wall."""
        if "wall" not in self._regions or "interface" not in self._measured:
            return 0.0
        mean = self.exact_volumes()["wall"] / self._measured["interface"][0]
        return self.size * (float(np.sqrt(1 + 2 * mean / self.size)) - 1)

    @property
    def vein_centre(self) -> tuple[float, float]:
        """Position (x, y) of the first inlet's centre [m]."""
        x, y, _ = self._measured["inlet"][1].tolist()
        return x, y

    def inflow(self) -> None:
        """Return nothing: the developed profile in an inlet of any shape is found on the mesh."""

    def exact_volumes(self) -> dict[str, float]:
        """Return the volume [m3] of each region as the cells of the file have it."""
        import ngsolve as ng

        mesh, shape = self._shaped
        det = ng.Det(ng.Id(3) + ng.Grad(shape))
        return {
            name: float(ng.Integrate(det * ng.dx(definedon=mesh.Materials(name), bonus_intorder=4), mesh))
            for name in self._regions
        }

    def shape_map(self) -> EdgeBulges | None:
        """Return the displacement [m] from the straight cells to the curved ones; None if they are straight."""
        return self._contents.curved if self.curving_order > 1 else None

    @property
    def _shaped(self) -> tuple[Any, Any]:
        """The straight mesh, and the displacement to its curved cells."""
        import ngsolve as ng

        mesh = ng.Mesh(self.netgen_mesh())
        return mesh, self._contents.curved.on(ng.VectorH1(mesh, order=2))

    def mesh_attempts(self) -> tuple[str, ...]:
        """Return the one way to mesh."""
        return ("the cells of the file",)

    def netgen_mesh(self, attempt: int = 0) -> Any:  # noqa: ARG002 - there is one way
        """Return the straight Netgen mesh [m] with its names."""
        import netgen.meshing as nm

        contents = self._contents
        mesh = nm.Mesh(dim=3)
        mesh.AddPoints(np.ascontiguousarray(contents.points))
        domains = {name: k for k, name in enumerate((n for n in REGIONS if n in self._regions), start=1)}
        for number, (name, behind, before, corners) in enumerate(contents.faces, start=1):
            sides = domains[behind], domains.get(before or "", 0)
            index = mesh.Add(nm.FaceDescriptor(surfnr=number, domin=sides[0], domout=sides[1], bc=number))
            mesh.SetBCName(number - 1, name)
            mesh.AddElements(dim=2, index=index, data=np.ascontiguousarray(corners, dtype=np.int32), base=0)
        for name, number in domains.items():
            mesh.SetMaterial(number, name)
        for name, kind, corners in contents.cells:
            # Netgen's base is clockwise seen from above
            turned = np.hstack([corners[:, : kind.base][:, ::-1], _top(kind, corners)])
            mesh.AddElements(dim=3, index=domains[name], data=np.ascontiguousarray(turned, dtype=np.int32), base=0)
        return mesh


def _is_boundary(name: str) -> bool:
    return name in BOUNDARIES or OPENING.fullmatch(name) is not None


def _plane(points: Array, faces: Iterable[Indices]) -> Plane:
    """Return the plane through faces (m, 3 or 4), by least squares of the distances of their nodes."""
    parts = [points[corners] for corners in faces]
    nodes = points[np.unique(np.concatenate([corners.ravel() for corners in faces]))]
    centre = nodes.mean(axis=0)
    normal = np.linalg.svd(nodes - centre, full_matrices=False)[2][-1]
    fans = (np.cross(part[:, 1:-1] - part[:, :1], part[:, 2:] - part[:, :1]) for part in parts)
    area = sum(float(np.sum(np.linalg.norm(fan, axis=-1))) / 2 for fan in fans)
    return Plane(centre, normal, float(np.sqrt(area / pi)))


def _top(kind: Kind, corners: Indices) -> Indices:
    top = corners[:, kind.base :]
    return top[:, ::-1] if top.shape[1] > 1 else top


def _contents(raw: Any, groups: Iterator[tuple[str, Kind, Indices]], scale: float, file: str) -> Contents:
    """Sort out what a file holds."""
    named = list(groups)
    bodies = [(name, kind, nodes) for name, kind, nodes in named if kind.dim == 3]
    if not bodies:
        raise GeometryError(f"'{file}' has no cells of {', '.join(REGIONS)}: name its groups in `names`")
    nodes = scale * np.asarray(raw.points, dtype=float)
    used = np.unique(np.concatenate([nodes_[:, : kind.corners].ravel() for _, kind, nodes_ in bodies]))
    new = np.full(len(nodes), -1)
    new[used] = np.arange(len(used))
    points = nodes[used]
    cells = tuple((name, kind, _positive(points, kind, new[n[:, : kind.corners]])) for name, kind, n in bodies)
    surfaces = [(name, new[n[:, : kind.corners]]) for name, kind, n in named if kind.dim == 2]
    return Contents(points, cells, _faces(points, cells, surfaces, file), _bulges(nodes, new, bodies))


def _positive(points: Array, kind: Kind, corners: Indices) -> Indices:
    """Return cells with their base counter-clockwise seen from above."""
    a, b, c = (points[corners[:, k]] for k in range(3))
    up = points[corners[:, kind.base :]].mean(axis=1) - points[corners[:, : kind.base]].mean(axis=1)
    wrong = np.einsum("ij,ij->i", np.cross(b - a, c - a), up) < 0
    mirrored = np.hstack([corners[:, : kind.base][:, ::-1], _top(kind, corners)])
    return np.where(wrong[:, None], mirrored, corners)


def _faces(points: Array, cells: Any, surfaces: Any, file: str) -> tuple[tuple[str, str, str | None, Indices], ...]:
    """Return the faces of all boundaries with the regions on their sides; refuse those whose name nothing tells."""
    sides = _sides(points, cells)
    named: list[tuple[str, Indices, list[Side]]] = []
    for name, corners in surfaces:
        for face in corners:
            beside = sides.pop(tuple(sorted(face.tolist())), [])
            if not beside:
                raise GeometryError(f"'{file}': a face of '{name}' is no face of a cell, or has two names")
            named.append((name, face, beside))
    planes = _planes(points, surfaces)
    for beside in sides.values():
        if len(beside) == 1 or beside[0].region != beside[1].region:
            face = beside[0].corners
            named.append((_inferred([side.region for side in beside], points[face], planes, file), face, beside))
    bare = all(region != "tissue" for region, *_ in cells)
    found: dict[tuple[str, str, str | None, int], list[Indices]] = {}
    for name, face, beside in named:
        a, b, c = points[face[:3]]
        forwards = np.dot(np.cross(b - a, c - a), points[face].mean(axis=0) - beside[0].centre) > 0
        before = beside[1].region if len(beside) > 1 else None
        title = "skin" if bare and name == "wall_outer" and before is None else name
        found.setdefault((title, beside[0].region, before, len(face)), []).append(face if forwards else face[::-1])
    return tuple((name, behind, before, np.array(faces)) for (name, behind, before, _), faces in found.items())


def _sides(points: Array, cells: Any) -> dict[tuple[int, ...], list[Side]]:
    """Return the one or two sides of each face of the cells, that of the inner region first, by its sorted corners."""
    sides: dict[tuple[int, ...], list[Side]] = {}
    for region, kind, corners in sorted(cells, key=lambda cell: REGIONS.index(cell[0])):
        centres = points[corners].mean(axis=1)
        for local in kind.faces:
            faces = corners[:, local]
            for key, centre, face in zip(map(tuple, np.sort(faces, axis=1).tolist()), centres, faces, strict=True):
                sides.setdefault(key, []).append(Side(region, centre, face))
    return sides


def _planes(points: Array, surfaces: Any) -> list[tuple[str, Plane]]:
    """Return the planes of the openings, each with the side of the vessel on which it lies."""
    openings: dict[str, list[Indices]] = {}
    for name, corners in surfaces:
        if OPENING.fullmatch(name):
            openings.setdefault(name, []).append(corners)
    return [("bottom" if n.startswith("inlet") else "top", _plane(points, part)) for n, part in openings.items()]


def _inferred(regions: list[str], corners: Array, planes: list[tuple[str, Plane]], file: str) -> str:
    """Return the name of a face in no group, by the regions on its sides and the planes in which it lies.

    Raises:
        GeometryError: they do not tell.
    """
    if (name := COMMON.get(tuple(regions))) is not None:
        return name
    ends = {side for side, plane in planes if plane.distance(corners) <= FLAT * plane.radius}
    if regions != ["fluid"] and len(ends) == 1:
        return f"{regions[0]}_{ends.pop()}"
    place = ", ".join(f"{1e3 * x:.3g}" for x in corners.mean(axis=0))
    between = " and ".join(regions) + (" and outside" if len(regions) == 1 else "")
    raise GeometryError(
        f"'{file}': a face between {between} near ({place}) mm has no name of a boundary: put it into one of "
        f"{', '.join(BOUNDARIES)}"
    )


def _edges_in(nodes: Array, kind: Kind, cells: Indices) -> tuple[tuple[int, int], ...]:
    """Return the order of edges in which the middle nodes of cells lie nearest to the middles of their ends."""

    def away(edges: tuple[tuple[int, int], ...]) -> float:
        middles = nodes[cells[:, kind.corners : kind.corners + len(edges)]]
        return float(np.sum((middles - nodes[cells[:, np.array(edges)]].mean(axis=2)) ** 2))

    return min((kind.edges, kind.other_edges), key=away) if kind.other_edges else kind.edges


def _bulges(nodes: Array, new: Indices, bodies: Any) -> EdgeBulges:
    """Return the edges that have middle nodes."""
    edges, bulges = [np.zeros((0, 2), dtype=np.int64)], [np.zeros((0, 3))]
    for _, kind, cell in bodies:
        if cell.shape[1] > kind.corners:
            for k, ends in enumerate(_edges_in(nodes, kind, cell)):
                corners, middle = cell[:, list(ends)], cell[:, kind.corners + k]
                edges.append(np.sort(new[corners], axis=1))
                bulges.append(nodes[middle] - nodes[corners].mean(axis=1))
    both, first = np.unique(np.vstack(edges), axis=0, return_index=True)
    return EdgeBulges(both, np.vstack(bulges)[first])
