"""A vessel from the surface of its lumen: layers of prisms along the wall on both sides, tetrahedra in the middle.

The triangles of the surface stay as they are. Along the normals of its nodes they are raised to prisms: inwards for
the flow at the wall, outwards for the wall and the tissue around it. What is left of the lumen, between the flat ends
of the vessel, Netgen fills with tetrahedra. Edges along the wall are curved: quadratic, at right angles to the normals
at both ends (Nagata, Comput Aided Geom Des 22, 2005), so that few triangles have the volume of a smooth vessel.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import pi
from pathlib import Path
from typing import Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from ngfsi.config.model import ConfigModel
from ngfsi.errors import GeometryError, NgfsiError, unknown
from ngfsi.mesh.curving import EdgeBulges
from ngfsi.mesh.generate import jacobian_ratios
from ngfsi.mesh.geometry import Vessel
from ngfsi.units import Length, to_si
from ngfsi_geometry.content import check_digest, digest

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

SHARP = 35.0
"""Degrees between triangles beyond which an end of the vessel begins."""
FLAT = 0.03
"""Nodes of an end may be off its plane by this fraction of its radius; they are moved onto it."""
LARGEST_BULGE = 0.15
"""Of an edge, as a fraction of its length."""
LEAST_RATIO, FLATTENINGS = 0.03, 6
"""Least ratio of the Jacobian determinants in a curved cell, and how often edges are halved for it."""
MOST_TRIANGLES = 20_000


@dataclass(frozen=True)
class End:
    """A flat end of the lumen.

    Attributes:
        ring: nodes of the surface around it, counter-clockwise seen from outside.
        normal: out of the vessel.
        area: m2
    """

    ring: Indices
    normal: Array
    area: float


@dataclass(frozen=True)
class Lumen:
    """The surface of a lumen without its ends.

    Attributes:
        points: nodes (n, 3) [m].
        triangles: their nodes (m, 3), normals outwards.
        normals: at the nodes (n, 3); along the ends in their planes.
        ends: the largest one first.
    """

    points: Array
    triangles: Indices
    normals: Array
    ends: tuple[End, ...]


class VesselFromSurface(ConfigModel):
    """A vessel whose lumen is inside a surface from a file (STL, VTP, PLY, OBJ), its flat ends open or closed by caps.

    The largest end is the inlet, the others are outlet, outlet_2 ... in the order of their areas; `names` says it
    otherwise. Without wall_thickness the wall is rigid; without tissue_thickness the outside of the wall is the skin.
    """

    refusal: ClassVar[type[NgfsiError]] = GeometryError

    file: str = Field(min_length=1, description="the surface of the lumen: STL, VTP, PLY or OBJ")
    unit: Literal["m", "cm", "mm", "um"] = "mm"
    """Unit of length in the file."""
    wall_thickness: Length | None = Field(None, gt=0, description="thickness of the wall; none: it is rigid")
    wall_layers: int = Field(1, ge=1, le=8, description="number of element layers through the wall")
    tissue_thickness: Length | None = Field(None, gt=0, description="thickness of the tissue around the wall, if any")
    tissue_layers: int = Field(2, ge=1, le=8, description="number of element layers through the tissue")
    flow_thickness: float = Field(
        0.3,
        gt=0,
        lt=0.8,
        description="of the layers at the wall in the lumen, over the radius of the smallest end",
    )
    flow_layers: int = Field(2, ge=1, le=8, description="number of element layers at the wall in the lumen")
    names: dict[str, str] = Field(default_factory=dict)
    """Name that an end has by its area -> name that it gets, e.g. {inlet = "outlet", outlet = "inlet"}."""
    sha256: str = Field(default_factory=lambda given: digest(given["file"], "surface"))
    """Of the file: a case belongs to its content."""

    @model_validator(mode="after")
    def _can_be_used(self) -> Self:
        check_digest(self.file, "surface", self.sha256)
        if self.tissue_thickness and not self.wall_thickness:
            raise ValueError("tissue_thickness needs a wall_thickness: tissue lies around a wall")
        plain = _names_of(len(self._lumen.ends))
        if wrong := next((name for name in self.names if name not in plain), None):
            raise ValueError(unknown("end", wrong, plain))
        if sorted(self._end_names) != sorted(plain):
            raise ValueError(f"`names` must give each end another name of {', '.join(plain)}")
        return self

    @cached_property
    def _lumen(self) -> Lumen:
        try:
            return _lumen(*_read(Path(self.file)), to_si(1.0, self.unit))
        except GeometryError as error:
            raise GeometryError(f"'{self.file}': {error}") from None

    @property
    def _end_names(self) -> tuple[str, ...]:
        return tuple(self.names.get(name, name) for name in _names_of(len(self._lumen.ends)))

    @property
    def fluid(self) -> str:
        """Name of the blood."""
        return "fluid"

    @property
    def solids(self) -> tuple[str, ...]:
        """Names of the solids."""
        return tuple(region for region, _ in self._stack if region != "fluid")[::-1]

    @property
    def _stack(self) -> list[tuple[str, Array]]:
        """Regions from inside outwards, with the distances [m] of their layers' borders from the surface."""
        found = [("fluid", np.linspace(-self.flow_thickness * self._smallest, 0, self.flow_layers + 1))]
        if self.wall_thickness:
            found.append(("wall", np.linspace(0, self.wall_thickness, self.wall_layers + 1)))
            if self.tissue_thickness:
                outer = self.wall_thickness + self.tissue_thickness
                found.append(("tissue", np.linspace(self.wall_thickness, outer, self.tissue_layers + 1)))
        return found

    @property
    def _surfaces(self) -> dict[str, tuple[int, str, str | None]]:
        """Boundary along the vessel -> number of its layer border, and the regions inside and outside of it."""
        names = {"fluid": "interface", "wall": "wall_outer", "tissue": "skin"}
        regions = [region for region, _ in self._stack]
        found: dict[str, tuple[int, str, str | None]] = {}
        border = 0
        for k, (region, distances) in enumerate(self._stack):
            border += len(distances) - 1
            outside = regions[k + 1] if k + 1 < len(regions) else None
            name = "skin" if outside is None and region != "fluid" else names[region]
            found[name] = border, region, outside
        return found

    @property
    def vessels(self) -> tuple[Vessel, ...]:
        """The vessel."""
        names = sorted(self._end_names, key=lambda name: (name.partition("_")[0], int(name.partition("_")[2] or 1)))
        wall = "wall" if "wall" in self.solids else None
        outer = "wall_outer" if "tissue" in self.solids else None
        return (Vessel(wall=wall, outer=outer, inlets=("inlet",), outlets=tuple(names[1:]), radius=self.size),)

    @property
    def curving_order(self) -> int:
        """Edges are quadratic."""
        return 2

    @property
    def boundary_names(self) -> tuple[str, ...]:
        """Every boundary of the mesh, those along the vessel first."""
        ends = [f"{region}_{side}" for region in self.solids for side in ("bottom", "top")]
        return *self._surfaces, *self._end_names, *ends

    @property
    def internal_names(self) -> tuple[str, ...]:
        """Boundaries inside a region: none."""
        return ()

    @property
    def rigid_names(self) -> tuple[str, ...]:
        """Boundaries that are fixed in space: without a wall the inside of it."""
        return () if self.solids else ("interface",)

    @property
    def size(self) -> float:
        """Radius [m] of the circle with the area of the inlet."""
        return float(np.sqrt(self._lumen.ends[self._end_names.index("inlet")].area / pi))

    @property
    def lumen_radius(self) -> float:
        """Radius of the lumen [m]."""
        return self.size

    @property
    def length(self) -> float:
        """Distance [m] of the inlet from the first outlet."""
        first, last = (self._centre(name) for name in ("inlet", "outlet"))
        return float(np.linalg.norm(last - first))

    @property
    def vein_centre(self) -> tuple[float, float]:
        """Position (x, y) of the inlet's middle [m]."""
        x, y, _ = self._centre("inlet").tolist()
        return x, y

    def _centre(self, name: str) -> Array:
        ring = self._lumen.ends[self._end_names.index(name)].ring
        return np.asarray(self._lumen.points[ring].mean(axis=0))

    @property
    def _smallest(self) -> float:
        return float(np.sqrt(min(end.area for end in self._lumen.ends) / pi))

    def inflow(self) -> None:
        """Return nothing: the developed profile in an inlet of any shape is found on the mesh."""

    def mesh_attempts(self) -> tuple[str, ...]:
        """Return the one way to mesh."""
        return ("layers along the surface",)

    @cached_property
    def _borders(self) -> Array:
        """Nodes (layers + 1, n, 3) [m] of the borders between layers, from inside outwards."""
        distances = np.concatenate([part[k > 0 :] for k, (_, part) in enumerate(self._stack)])
        return np.asarray(self._lumen.points + distances[:, None, None] * self._lumen.normals)

    @cached_property
    def _core(self) -> tuple[Array, Indices, list[Indices]]:
        """All nodes (n, 3) [m], those of the borders first; the tetrahedra; and the triangles in the middle of ends."""
        caps, points = [], self._borders.reshape(-1, 3)
        for end in self._lumen.ends:
            inner, triangles = _cap(self._borders[0][end.ring], end.normal)
            numbers = np.r_[end.ring, len(points) + np.arange(len(inner))]
            caps.append(numbers[triangles])
            points = np.vstack([points, inner])
        return *_filled(points, np.vstack([self._lumen.triangles, *caps])), caps

    def netgen_mesh(self, attempt: int = 0) -> Any:  # noqa: ARG002 - there is one way
        """Return the straight Netgen mesh [m] with its names."""
        import netgen.meshing as nm

        lumen, count = self._lumen, len(self._lumen.points)
        points, tetrahedra, caps = self._core
        mesh = nm.Mesh(dim=3)
        mesh.AddPoints(np.ascontiguousarray(points))
        regions = {region: k for k, (region, _) in enumerate(self._stack, start=1)}

        def add(name: str, inside: str, outside: str | None, faces: Sequence[Indices]) -> None:
            number = mesh.GetNFaceDescriptors() + 1
            sides = regions[inside], regions.get(outside or "", 0)
            index = mesh.Add(nm.FaceDescriptor(surfnr=number, domin=sides[0], domout=sides[1], bc=number))
            mesh.SetBCName(number - 1, name)
            for part in faces:
                mesh.AddElements(dim=2, index=index, data=np.ascontiguousarray(part, dtype=np.int32), base=0)

        for name, (border, inside, outside) in self._surfaces.items():
            add(name, inside, outside, [lumen.triangles + border * count])
        border = 0
        for region, distances in self._stack:
            layers = range(border, border + len(distances) - 1)
            border = layers.stop
            for name, end, cap in zip(self._end_names, lumen.ends, caps, strict=True):
                here, after = end.ring, np.roll(end.ring, -1)
                ring = [np.column_stack([here + k * count, here + (k + 1) * count,
                                         after + (k + 1) * count, after + k * count]) for k in layers]  # fmt: skip
                side = "bottom" if name == "inlet" else "top"
                title = name if region == "fluid" else f"{region}_{side}"
                add(title, region, None, [*ring, cap] if region == "fluid" else ring)
            # the lower face is clockwise seen from above
            low = lumen.triangles[:, ::-1]
            cells = np.vstack([np.hstack([low + k * count, low + (k + 1) * count]) for k in layers])
            mesh.AddElements(dim=3, index=regions[region], data=np.ascontiguousarray(cells, dtype=np.int32), base=0)
            mesh.SetMaterial(regions[region], region)
        tetrahedra = np.ascontiguousarray(tetrahedra, dtype=np.int32)
        mesh.AddElements(dim=3, index=regions["fluid"], data=tetrahedra, base=0)
        return mesh

    def shape_map(self) -> EdgeBulges:
        """Return the displacement [m] from the straight edges along the wall to the curved ones."""
        return self._curved

    @cached_property
    def _curved(self) -> EdgeBulges:
        """The curved edges; those of cells that they would turn inside out are less curved."""
        import ngsolve as ng

        curved, count = self._all_curved(), len(self._lumen.points)
        mesh = ng.Mesh(self.netgen_mesh())
        space = ng.VectorH1(mesh, order=2)
        edges = curved.edges % count
        for _ in range(FLATTENINGS):
            bad = np.flatnonzero(jacobian_ratios(mesh, curved.on(space)) < LEAST_RATIO).tolist()
            if not len(bad):
                break
            nodes = np.unique([v.nr for k in bad for v in mesh[ng.ElementId(ng.VOL, int(k))].vertices])
            # the same on all borders, so that layers stay as thick
            on_wall = nodes[nodes < count * len(self._borders)] % count
            near = np.all(np.isin(edges, on_wall), axis=1)
            curved = EdgeBulges(curved.edges, np.where(near, 0.5, 1.0)[:, np.newaxis] * curved.bulges)
        return curved

    def _all_curved(self) -> EdgeBulges:
        lumen, borders = self._lumen, self._borders
        sides = np.sort(np.vstack([lumen.triangles[:, [a, b]] for a, b in ((0, 1), (1, 2), (2, 0))]), axis=1)
        edges = np.unique(sides, axis=0)
        first, second = (lumen.normals[edges[:, k]] for k in (0, 1))
        mean = first + second
        mean /= np.linalg.norm(mean, axis=1, keepdims=True)
        bulges = []
        for nodes in borders:
            chord = nodes[edges[:, 1]] - nodes[edges[:, 0]]
            length = np.linalg.norm(chord, axis=1)
            height = np.einsum("ij,ij->i", second - first, chord) / 8
            bulges.append(np.clip(height, -LARGEST_BULGE * length, LARGEST_BULGE * length)[:, None] * mean)
        numbers = np.vstack([edges + k * len(lumen.points) for k in range(len(borders))])
        return EdgeBulges(numbers, np.vstack(bulges))

    @cached_property
    def _volumes(self) -> dict[str, float]:
        import ngsolve as ng

        mesh = ng.Mesh(self.netgen_mesh())
        det = ng.Det(ng.Id(3) + ng.Grad(self.shape_map().on(ng.VectorH1(mesh, order=2))))
        return {
            region: float(ng.Integrate(det * ng.dx(definedon=mesh.Materials(region), bonus_intorder=4), mesh))
            for region, _ in self._stack
        }

    def exact_volumes(self) -> dict[str, float]:
        """Return the volume [m3] of each region as the cells have it."""
        return dict(self._volumes)


def _names_of(count: int) -> tuple[str, ...]:
    """Return the names of ends by their area, the largest first."""
    return ("inlet", "outlet", *(f"outlet_{k}" for k in range(2, count)))[:count]


def _read(path: Path) -> tuple[Array, Indices]:
    """Return nodes and triangles of a surface file.

    Raises:
        GeometryError: it cannot be read, or holds no triangles.
    """
    import pyvista as pv

    try:
        surface = pv.read(path).extract_surface(algorithm=None).triangulate().clean()
        points = np.asarray(surface.points, dtype=float)
        triangles = np.asarray(surface.faces, dtype=np.int64).reshape(-1, 4)[:, 1:]
    except Exception as error:  # VTK's readers raise whatever they stumble over
        reason = str(error).strip().splitlines() or [type(error).__name__]
        raise GeometryError(f"it cannot be read as a surface (STL, VTP, PLY, OBJ): {reason[0]}") from None
    if not len(triangles):
        raise GeometryError("it cannot be read as a surface (STL, VTP, PLY, OBJ): it holds no triangles")
    if not np.all(np.isfinite(points)):
        raise GeometryError("it has nodes that are not finite: mend it")
    if len(triangles) > MOST_TRIANGLES:
        raise GeometryError(
            f"it has {len(triangles):,} triangles, of which each becomes several cells: remesh it to at most "
            f"{MOST_TRIANGLES:,}, some 8 to 16 edges around the vessel"
        )
    return points, triangles


def _lumen(points: Array, triangles: Indices, scale: float) -> Lumen:
    """Return the surface of a lumen and its ends, from a closed surface or one that is open at the ends.

    Raises:
        GeometryError: it is no surface of a vessel; says where.
    """
    points = points * scale
    triangles = _oriented(points, triangles)
    wall = triangles[~_caps(points, triangles)]
    rings = _rings(wall)
    if len(rings) < 2:
        raise GeometryError(
            f"it has {len(rings)} flat ends, a vessel needs two or more: cut it by planes across the vessel"
        )
    used = np.unique(wall)
    new = np.full(len(points), -1)
    new[used] = np.arange(len(used))
    points, wall = points[used].copy(), new[wall]
    ends, centre = [_end(points, new[ring]) for ring in rings], points.mean(axis=0)
    volume = float(np.sum(np.linalg.det(points[wall] - centre))) / 6
    volume += sum(end.area * float(end.normal @ (points[end.ring].mean(axis=0) - centre)) for end in ends) / 3
    if volume < 0:
        wall = wall[:, ::-1]
        ends = [End(end.ring[::-1].copy(), -end.normal, end.area) for end in ends]
    normals = np.zeros_like(points)
    corners = points[wall]
    for k in range(3):
        a, b = corners[:, (k + 1) % 3] - corners[:, k], corners[:, (k + 2) % 3] - corners[:, k]
        across = np.cross(a, b)
        lengths = np.linalg.norm(across, axis=1)
        angles = np.arctan2(lengths, np.einsum("ij,ij->i", a, b))
        np.add.at(normals, wall[:, k], across * (angles / np.maximum(lengths, 1e-300))[:, None])
    for end in ends:
        normals[end.ring] -= (normals[end.ring] @ end.normal)[:, None] * end.normal
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Lumen(points, wall, normals, tuple(sorted(ends, key=lambda end: -end.area)))


def _sides(triangles: Indices) -> dict[tuple[int, int], list[tuple[int, bool]]]:
    """Return the triangles at each edge (smaller node first), and whether they run along it in that sense."""
    found: dict[tuple[int, int], list[tuple[int, bool]]] = {}
    for number, corners in enumerate(triangles.tolist()):
        for a, b in zip(corners, corners[1:] + corners[:1], strict=True):
            found.setdefault((min(a, b), max(a, b)), []).append((number, a < b))
    return found


def _oriented(points: Array, triangles: Indices) -> Indices:
    """Return the triangles of a surface in one piece with normals to one side.

    Raises:
        GeometryError: edges have more than two triangles, or there are several pieces.
    """
    sides = _sides(triangles)
    crowded = [edge for edge, beside in sides.items() if len(beside) > 2]
    if crowded:
        place = ", ".join(f"{1e3 * c:.4g}" for c in points[list(crowded[0])].mean(axis=0))
        raise GeometryError(
            f"{len(crowded)} of its edges have more than two triangles, one near ({place}) mm: make it a simple surface"
        )
    near: dict[int, list[tuple[int, bool]]] = {}
    for beside in sides.values():
        if len(beside) == 2:
            (one, sense), (other, its) = beside
            near.setdefault(one, []).append((other, sense == its))
            near.setdefault(other, []).append((one, sense == its))
    turned = np.full(len(triangles), -1)
    turned[0], waiting = 0, [0]
    while waiting:
        number = waiting.pop()
        for other, against in near.get(number, ()):
            if turned[other] < 0:
                turned[other] = turned[number] ^ against
                waiting.append(other)
    if np.any(turned < 0):
        raise GeometryError("it is in several pieces: keep the vessel alone, and close gaps between triangles")
    return np.where((turned == 1)[:, None], triangles[:, ::-1], triangles)


def _caps(points: Array, triangles: Indices) -> NDArray[np.bool_]:
    """Return which triangles close the ends: flat patches behind sharp edges, of a surface without open edges."""
    across = np.cross(
        points[triangles[:, 1]] - points[triangles[:, 0]], points[triangles[:, 2]] - points[triangles[:, 0]]
    )
    areas = np.linalg.norm(across, axis=1) / 2
    if np.min(areas) <= 0:
        raise GeometryError("it has triangles without an area: clean it")
    normals = across / (2 * areas[:, None])
    sides = _sides(triangles)
    caps = np.zeros(len(triangles), dtype=bool)
    if any(len(beside) == 1 for beside in sides.values()):
        return caps
    patch = _patches(normals, sides)
    for number in np.unique(patch):
        mine = patch == number
        mean = np.sum(across[mine], axis=0)
        if np.linalg.norm(mean) / 2 > (1 - FLAT) * areas[mine].sum():
            caps |= mine
    return caps


def _patches(normals: Array, sides: Mapping[tuple[int, int], list[tuple[int, bool]]]) -> Indices:
    """Return for each triangle of a closed surface a number of the patch between sharp edges in which it lies."""
    smooth: dict[int, list[int]] = {}
    for (one, _), (other, _) in sides.values():
        if normals[one] @ normals[other] > np.cos(np.radians(SHARP)):
            smooth.setdefault(one, []).append(other)
            smooth.setdefault(other, []).append(one)
    patch = np.full(len(normals), -1)
    for start in range(len(normals)):
        if patch[start] < 0:
            patch[start], waiting = start, [start]
            while waiting:
                for other in smooth.get(waiting.pop(), ()):
                    if patch[other] < 0:
                        patch[other] = start
                        waiting.append(other)
    return patch


def _rings(wall: Indices) -> list[Indices]:
    """Return the open edges of the wall as rings of nodes, each in the sense of an end's outer side."""
    after: dict[int, int] = {}
    for (low, high), beside in _sides(wall).items():
        if len(beside) == 1:
            # the end's triangle runs along the edge against the wall's
            a, b = (high, low) if beside[0][1] else (low, high)
            if a in after:
                raise GeometryError("two of its ends touch each other, or a hole touches an end: mend it")
            after[a] = b
    rings = []
    while after:
        first, node = next(iter(after.items()))
        ring = [first]
        del after[first]
        while node != first:
            ring.append(node)
            if node not in after:
                raise GeometryError("its open edges make no rings: mend it")
            node = after.pop(node)
        rings.append(np.array(ring))
    return rings


def _end(points: Array, ring: Indices) -> End:
    """Return the end inside a ring, whose nodes are moved onto its plane; outwards is the ring's sense.

    Raises:
        GeometryError: it is not flat.
    """
    corners = points[ring]
    centre = corners.mean(axis=0)
    fan = np.cross(corners - centre, np.roll(corners, -1, axis=0) - centre).sum(axis=0) / 2
    area = float(np.linalg.norm(fan))
    normal = fan / max(area, 1e-300)
    off = (corners - centre) @ normal
    radius = np.sqrt(area / pi)
    if np.max(np.abs(off)) > FLAT * radius:
        place = ", ".join(f"{1e3 * c:.4g}" for c in centre)
        raise GeometryError(
            f"the end near ({place}) mm is not flat: a node lies {1e3 * np.max(np.abs(off)):.3g} mm off its plane, "
            f"more than {FLAT:.0%} of its radius of {1e3 * radius:.3g} mm: cut the vessel by a plane there"
        )
    points[ring] -= off[:, None] * normal
    return End(ring, normal, area)


def _cap(corners: Array, normal: Array) -> tuple[Array, Indices]:
    """Return the inner nodes (k, 3) [m] and the triangles of a flat polygon (n, 3), whose nodes come first."""
    from netgen.geom2d import SplineGeometry

    along = np.roll(corners, -1, axis=0)[0] - corners[0]
    along /= np.linalg.norm(along)
    frame = np.array([along, np.cross(normal, along)])
    centre = corners.mean(axis=0)
    flat = (corners - centre) @ frame.T
    scale = float(np.max(np.abs(flat)))
    steps = np.linalg.norm(np.roll(flat, -1, axis=0) - flat, axis=1) / scale
    plane = SplineGeometry()
    ids = [plane.AppendPoint(*(corner / scale)) for corner in flat]
    for k, step in enumerate(steps):
        plane.Append(["line", ids[k], ids[(k + 1) % len(ids)]], leftdomain=1, rightdomain=0, maxh=1.5 * float(step))
    mesh = plane.GenerateMesh(maxh=2 * float(steps.max()), grading=0.8)
    nodes = np.array([point.p[:2] for point in mesh.Points()]) * scale
    rim = {v.nr - 1 for edge in mesh.Elements1D() for v in edge.vertices}
    if len(rim) != len(corners) or not np.allclose(nodes[: len(corners)], flat, atol=1e-9 * scale):
        raise GeometryError("an end could not be triangulated with its nodes: make its edges of more equal length")
    triangles = np.array([[v.nr - 1 for v in t.vertices] for t in mesh.Elements2D()], dtype=np.int64)
    a, b, c = (nodes[triangles[:, k]] for k in range(3))
    wrong = (b - a)[:, 0] * (c - a)[:, 1] < (b - a)[:, 1] * (c - a)[:, 0]
    triangles[wrong] = triangles[wrong][:, ::-1]
    return centre + nodes[len(corners) :] @ frame, triangles


def _filled(points: Array, surface: Indices) -> tuple[Array, Indices]:
    """Return the points with those that Netgen adds, and the tetrahedra inside of a closed surface, of the points.

    Raises:
        GeometryError: it cannot be filled.
    """
    import netgen.meshing as nm

    used = np.unique(surface)
    new = np.full(len(points), -1)
    new[used] = np.arange(len(used))
    # Netgen compares lengths with absolute tolerances
    centre, scale = points[used].mean(axis=0), float(np.ptp(points[used], axis=0).max())
    mesh = nm.Mesh(dim=3)
    mesh.AddPoints(np.ascontiguousarray((points[used] - centre) / scale))
    index = mesh.Add(nm.FaceDescriptor(surfnr=1, domin=1, domout=0, bc=1))
    mesh.AddElements(dim=2, index=index, data=np.ascontiguousarray(new[surface], dtype=np.int32), base=0)
    mesh.GenerateVolumeMesh()
    tetrahedra = np.array([[v.nr - 1 for v in cell.vertices] for cell in mesh.Elements3D()], dtype=np.int64)
    if not len(tetrahedra):
        raise GeometryError("the middle of the lumen could not be filled: choose a smaller flow_thickness")
    inside = np.array([point.p for point in mesh.Points()])[len(used) :] * scale + centre
    numbers = np.r_[used, len(points) + np.arange(len(inside))]
    return np.vstack([points, inside]), numbers[tetrahedra]
