"""A user's own mesh of a vein along z, read by meshio (Gmsh, VTU, Abaqus and more), with its groups as checked names.

The mesh stays straight between its corners; the middle nodes of second-order cells become the shape map, quadratic on
each edge as in the cells themselves. Nodes in the middle of faces and cells are not needed for that and left out.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from math import pi
from typing import Any, ClassVar, Literal, Self

import meshio
import numpy as np
from meshio._mesh import topological_dimension
from numpy.typing import NDArray
from pydantic import Field, model_validator

from ngfsi.config.model import ConfigModel
from ngfsi.errors import GeometryError, NgfsiError, unknown
from ngfsi.mesh.curving import EdgeBulges
from ngfsi.units import to_si
from ngfsi_geometry.content import check_digest, digest
from ngfsi_geometry.segment import END_NAMES

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

REGIONS = ("fluid", "wall", "tissue")
"""From inside outwards; faces between two regions have normals out of the former."""
BOUNDARIES = (
    "interface",
    "wall_outer",
    "tibia",
    "fibula",
    "skin",
    *(name for ends in END_NAMES.values() for name in ends),
)
FLAT = 1e-3
"""Nodes of inlet and outlet may be off their plane by this share of the length."""
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


class ExternalMesh(ConfigModel):
    """A mesh from a file: regions fluid, wall and tissue, those that it has; blood flows along z.

    The mesh is moved along z such that it begins at z = 0, with the inlet. The inlet is round: the profile of the flow
    and the radius of the lumen are those of its circle.
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
        known = (*REGIONS, *BOUNDARIES)
        if wrong := next((name for name in self.names.values() if name not in known), None):
            raise ValueError(unknown("region or boundary", wrong, known))
        needed = {"inlet", "outlet", "interface"} if self.fluid else set()
        if missing := sorted(needed - set(self.boundary_names)):
            raise ValueError(
                f"'{self.file}' has no cells of {', '.join(missing)}: name its groups, which are "
                f"{', '.join(self._found)}, in `names`"
            )
        for name, z in (("inlet", 0.0), ("outlet", self.length)) if self.fluid else ():
            faces = [
                self._contents.points[corners, 2] for title, _, _, corners in self._contents.faces if title == name
            ]
            away = max(float(np.max(np.abs(part - z))) for part in faces)
            if away > FLAT * self.length:
                raise ValueError(
                    f"the {name} of '{self.file}' must be flat at the {'lower' if z == 0 else 'upper'} end along z, a "
                    f"node is {1e3 * away:.3g} mm away: turn the mesh such that the blood flows along z"
                )
        return self

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
                if name in (REGIONS if kind.dim == 3 else BOUNDARIES):
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
    def curving_order(self) -> int:
        """2 if the file has second-order cells, else 1."""
        return 2 if len(self._contents.curved.edges) else 1

    @property
    def boundary_names(self) -> tuple[str, ...]:
        """Every boundary of the mesh."""
        there = {name for name, *_ in self._contents.faces}
        return tuple(name for name in BOUNDARIES if name in there)

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
        """Extent [m] along z."""
        return float(np.ptp(self._contents.points[:, 2]))

    @cached_property
    def _ends(self) -> dict[str, tuple[float, float, float]]:
        """Area [m2] and centre (x, y) [m] of inlet and lower end of the wall, curved edges included."""
        import ngsolve as ng

        mesh, shape = self._shaped
        mesh.SetDeformation(shape)
        found = {}
        for name in {"inlet", "wall_bottom"} & set(self.boundary_names):
            over = ng.ds(definedon=mesh.Boundaries(name), bonus_intorder=4)
            area, x, y = (float(ng.Integrate(value * over, mesh)) for value in (ng.CF(1.0), ng.x, ng.y))
            found[name] = area, x / area, y / area
        mesh.UnsetDeformation()
        return found

    @property
    def size(self) -> float:
        """Radius [m] of the circle with the area of the inlet; without blood half of the mesh's width."""
        return (
            float(np.sqrt(self._ends["inlet"][0] / pi))
            if self.fluid
            else float(np.ptp(self._contents.points[:, 0])) / 2
        )

    @property
    def lumen_radius(self) -> float:
        """Radius of the lumen [m]."""
        return self.size

    @property
    def wall_thickness(self) -> float:
        """Thickness [m] of the ring with the area of the wall's lower end; 0 without one."""
        area = self._ends["wall_bottom"][0] if "wall_bottom" in self._ends else 0.0
        return float(np.sqrt(self.size**2 + area / pi)) - self.size

    @property
    def vein_centre(self) -> tuple[float, float]:
        """Position (x, y) of the inlet's centre [m]."""
        return self._ends["inlet"][1:]

    def inflow(self) -> Any:
        """Return the developed velocity of unit mean through a round inlet."""
        from ngsolve import CF, x, y

        x0, y0 = self.vein_centre
        return CF((0, 0, 2 * (1 - ((x - x0) ** 2 + (y - y0) ** 2) / self.size**2)))

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
    points[:, 2] -= points[:, 2].min()
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
    """Return the named faces with the regions on their sides; refuse outer or common faces without a name."""
    sides: dict[tuple[int, ...], list[tuple[str, Array]]] = {}
    for region, kind, corners in cells:
        centres = points[corners].mean(axis=1)
        for local in kind.faces:
            for key, centre in zip(map(tuple, np.sort(corners[:, local], axis=1).tolist()), centres, strict=True):
                sides.setdefault(key, []).append((region, centre))
    found: dict[tuple[str, str, str | None, int], list[Indices]] = {}
    for name, corners in surfaces:
        for face in corners:
            beside = sorted(sides.pop(tuple(sorted(face.tolist())), []), key=lambda side: REGIONS.index(side[0]))
            if not beside:
                raise GeometryError(f"'{file}': a face of '{name}' is no face of a cell, or has two names")
            a, b, c = points[face[:3]]
            forwards = np.dot(np.cross(b - a, c - a), points[face].mean(axis=0) - beside[0][1]) > 0
            before = beside[1][0] if len(beside) > 1 else None
            found.setdefault((name, beside[0][0], before, len(face)), []).append(face if forwards else face[::-1])
    for key, beside in sides.items():
        if len({region for region, _ in beside}) > 1 or len(beside) == 1:
            place = ", ".join(f"{1e3 * x:.3g}" for x in points[list(key)].mean(axis=0))
            between = " and ".join(region for region, _ in beside) + (" and outside" if len(beside) == 1 else "")
            raise GeometryError(
                f"'{file}': a face between {between} near ({place}) mm has no name of a boundary: put it into one of "
                f"{', '.join(BOUNDARIES)}"
            )
    return tuple((name, behind, before, np.array(faces)) for (name, behind, before, _), faces in found.items())


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
