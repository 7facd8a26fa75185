"""A segment of the calf through stacks of outlines: skin, bones and deep veins as images show them.

The mesh is that of a straight segment of the mean outlines, whose surfaces are moved onto lofts of the outlines; what
is between follows as an elastic body, conforming and of the mesh's curving order. Ends are flat.
Axes: x lateral, y anterior, z proximal; the origin lies in the middle of the skin, at the height of the first outline.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations, pairwise
from math import pi
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from ngfsi.config.model import ConfigModel
from ngfsi.errors import GeometryError, NgfsiError
from ngfsi.mesh.curving import BoundaryMotion, reference_shape
from ngfsi.mesh.geometry import Vessel
from ngfsi.outlines.outline import Outline, closed, dense, distances
from ngfsi.units import Length, in_unit
from ngfsi_geometry.calf import CalfSegment, CalfVein, Compartments
from ngfsi_geometry.calf_section import touching
from ngfsi_geometry.extrusion import extrude
from ngfsi_geometry.loft import StarLoft
from ngfsi_geometry.plane import SectionMesh, Star
from ngfsi_geometry.segment import TISSUE_ENDS, FatLayer, MeshSettings

Array = NDArray[np.float64]

ANATOMY = ("skin", "tibia", "fibula", "lumen")
FEWEST = 4
"""Outlines that a stack needs."""
EDGE_POINTS = 800
POINTS = 96
"""Of a section that is checked."""
DENSE = 4
"""Heights for each outline at which the surface through them is looked at."""
NEAREST = 0.2
"""Least distance of a surface from its middle, as a fraction of its radius."""
PIXELS = 2
"""Distances between surface and label up to so many pixels are not worth a word: labels are rounded to pixels, and one
more is what outlines may be away from them."""
GAP = 2e-3
"""Between the curves of the straight segment, at least [m]; they are made smaller where outlines are nearer."""
FRACTIONS = 1.0, 0.9, 0.8, 0.65, 0.5, 0.35
SAMPLED = 0.45, 0.85
"""Of the way from the middle of an element to its corners, where it is asked in which label it lies."""
STEPS = 4
"""In which the straight segment is deformed."""


@dataclass(frozen=True)
class Stack:
    """Outlines of skin, tibia, fibula, lumen, and of lumen_2 ... from distal to proximal, and their heights [m].

    Attributes:
        first: number of the first of them in an image, for sentences.
    """

    outlines: Mapping[str, tuple[Outline, ...]]
    heights: tuple[float, ...]
    first: int = 0

    @property
    def lumens(self) -> tuple[str, ...]:
        """Names of the veins."""
        return tuple(name for name in self.outlines if name not in ("skin", "tibia", "fibula"))

    def check(self) -> None:
        """Refuse stacks that make no calf.

        Raises:
            GeometryError: names the slice.
        """
        counts = {name: len(self.outlines[name]) for name in self.outlines}
        if {*counts.values()} != {len(self.heights)} or len(self.heights) < FEWEST:
            listed = ", ".join(f"{count} of {name}" for name, count in counts.items())
            raise GeometryError(
                f"a lofted calf needs {FEWEST} outlines or more of each part and as many heights: there are "
                f"{len(self.heights)} heights, {listed}"
            )
        if np.any(np.diff(self.heights) <= 0):
            number = self.first + int(np.argmin(np.diff(self.heights))) + 1
            raise GeometryError(f"the heights of a stack must increase, that of slice {number} does not: sort them")
        for name in self.outlines:
            self._check_jumps(name)

    def _check_jumps(self, name: str) -> None:
        stack = self.outlines[name]
        for k, (low, high) in enumerate(pairwise(stack), start=self.first + 1):
            moved = float(np.linalg.norm(high.centroid - low.centroid))
            risen = self.heights[k - self.first] - self.heights[k - self.first - 1]
            if moved > max(np.sqrt(low.area / pi), risen):
                raise GeometryError(
                    f"slice {k}: '{name}' lies {1e3 * moved:.1f} mm beside that of the slice before, by more than its "
                    "radius and steeper than 45 degrees: look whether both are the same part"
                )


class CalfLoft(ConfigModel):
    """Calf segment through outlines; regions and boundaries as of the geometry calf."""

    refusal: ClassVar[type[NgfsiError]] = GeometryError
    fluid: ClassVar[str] = CalfSegment.fluid

    wall_thickness: Length = Field(1e-3, gt=0, description="thickness of the vein wall; source study: 1 mm")
    modes: int = Field(4, ge=1, le=24, description="most Fourier modes kept of each outline")
    smoothing: Length = Field(
        20e-3,
        gt=0,
        description="length of the pieces of the splines along z, which are fitted to the outlines by least squares; "
        "at most the distance of the outlines: they are met exactly",
    )
    mesh: MeshSettings = MeshSettings()

    @property
    @abstractmethod
    def stack(self) -> Stack:
        """The outlines."""

    @property
    def _fat(self) -> FatLayer | None:
        """The layer under the skin."""
        return None

    @property
    def _compartments(self) -> Compartments | None:
        """The septa that part the tissue."""
        return None

    @model_validator(mode="after")
    def _check_stack(self) -> Self:
        self.stack.check()
        for k, section in enumerate(self.sections(), start=self.stack.first):
            skin = section.pop("skin")
            skin = section.pop("fascia", skin)
            veins = {f"the wall of vein {n}": section.pop(_named("wall_outer", n)) for n in self._numbers}
            if reason := touching({"tibia": section["tibia"], "fibula": section["fibula"], **veins}, skin):
                raise GeometryError(f"slice {k}: {reason.replace('skin', 'fascia') if self._fat else reason}")
        _ = self.straight
        return self

    def sections(self) -> Iterator[dict[str, Outline]]:
        """Yield the sections of all surfaces at the heights of the outlines, in their coordinates."""
        z = np.array(self.stack.heights) - self.stack.heights[0]
        points = {name: loft.sections(z, POINTS) for name, loft in self._in_place.items()}
        for k in range(len(z)):
            yield {n: Outline.through(np.column_stack([p[k].real, p[k].imag])) for n, p in points.items()}

    @cached_property
    def _in_place(self) -> dict[str, StarLoft]:
        """Surfaces by the name of their boundary, in the coordinates of the outlines."""
        stack = self.stack
        z = np.array(stack.heights) - stack.heights[0]
        found = {name: self._loft(z, stack.outlines[name]) for name in ("skin", "tibia", "fibula")}
        if self._fat:
            found["fascia"] = self._within(found["skin"], z, self._fat.thickness)
        for number, name in enumerate(stack.lumens, start=1):
            lumen = self._loft(z, stack.outlines[name])
            found[_named("interface", number)] = lumen
            found[_named("wall_outer", number)] = lumen.thickened(z, self.wall_thickness, self._pieces)
        return found

    @cached_property
    def _lofts(self) -> dict[str, StarLoft]:
        """The surfaces around the origin."""
        return {name: loft.moved(-self._middle_of_skin) for name, loft in self._in_place.items()}

    @property
    def _middle_of_skin(self) -> complex:
        return _middle(self._in_place["skin"])[1]

    def deviations(self) -> list[dict[str, float | str]]:
        """Return for each slice and part how the smooth surfaces differ from what is given there.

        Keys: slice, part, area of the given outline [m2] and relative error of the surface's, distance of the centroids
        [m], and largest and root mean square distance [m] of the section from the outline (of labels: their edge).
        """
        names = {name: name for name in ("skin", "tibia", "fibula")}
        names |= {name: _named("interface", k) for k, name in enumerate(self.stack.lumens, start=1)}
        rows: list[dict[str, float | str]] = []
        for k, section in enumerate(self.sections()):
            for part, name in names.items():
                given, found = self.stack.outlines[part][k], section[name]
                step = found.length / EDGE_POINTS
                away = distances(dense(closed(found.points), step), self.edge(part, k))
                rows.append({
                    "slice": self.stack.first + k, "part": part, "area_m2": given.area,
                    "area_error_1": found.area / given.area - 1,
                    "centroid_error_m": float(np.linalg.norm(found.centroid - given.centroid)),
                    "distance_max_m": float(away.max()), "distance_rms_m": float(np.sqrt(np.mean(away**2))),
                })  # fmt: skip
        return rows

    def edge(self, part: str, number: int) -> Array:
        """Return points (n, 2) [m] of the edge of a part in one of the slices, from 0."""
        outline = self.stack.outlines[part][number]
        return outline.resampled(EDGE_POINTS)

    @property
    def resolution(self) -> float:
        """Distance [m] of the surfaces from the outlines that is not worth a word; 0: any is."""
        return 0.0

    @property
    def remarks(self) -> tuple[str, ...]:
        """Sentences about parts whose surfaces are far from what the image shows, the worst slice of each."""
        if not self.resolution:
            return ()
        worst: dict[str, dict[str, Any]] = {}
        for row in self.deviations():
            if row["distance_max_m"] > max(self.resolution, worst.get(str(row["part"]), row)["distance_max_m"] - 1e-12):
                worst[str(row["part"])] = row
        return tuple(
            f"the smooth surface of '{part}' is up to {in_unit(row['distance_max_m'], 'mm', '.2g')} from its label, in "
            f"slice {row['slice']}, more than {PIXELS} pixels: `ngfsi outlines` shows all, more modes or a smaller "
            "smoothing_mm bring it nearer"
            for part, row in worst.items()
        )

    def _within(self, skin: StarLoft, z: Array, thickness: float) -> StarLoft:
        """Return the surface at a distance [m] within the skin."""
        inner = np.sqrt(skin.squares(z).min(axis=1)) - thickness
        if inner.min() < GAP:
            number = self.stack.first + int(np.argmin(inner))
            raise GeometryError(f"slice {number}: fat of {1e3 * thickness:g} mm leaves nothing inside: make it thinner")
        return skin.thickened(z, -thickness, self._pieces)

    @property
    def _pieces(self) -> int:
        return max(1, round(self.length / self.smoothing))

    def _loft(self, z: Array, outlines: tuple[Outline, ...]) -> StarLoft:
        """Return the smooth surface near outlines, of fewer modes where it would else come too near to its middle."""
        for modes in range(self.modes, 0, -1):
            loft = StarLoft.through(z, outlines, modes, self._pieces)
            squares = loft.squares(np.linspace(z[0], z[-1], DENSE * len(z)))
            if np.all(squares.min(axis=1) > NEAREST**2 * squares.mean(axis=1)):
                break
        return loft

    @cached_property
    def _curves(self) -> dict[str, Star]:
        """Curves of the straight segment that is meshed: the lofts' means along z, apart from each other."""
        found = {}
        for name, loft in self._lofts.items():
            middle, row = loft.mean()
            found[name] = Star(name, middle.real, middle.imag, tuple(map(complex, row)))
        outer = [found.pop(name) for name in ("skin", "fascia") if name in found]
        for fraction in FRACTIONS:
            smaller = {name: curve.scaled(name, fraction) for name, curve in found.items()}
            outside = [curve for name, curve in smaller.items() if not name.startswith("interface")]
            gaps = [a.gap(b) for a, b in combinations(outside, 2)] + [a.margin(outer[-1]) for a in outside]
            if min(gaps) >= GAP:
                break
        return {**{curve.name: curve for curve in outer}, **smaller}

    @cached_property
    def straight(self) -> CalfSegment:
        """A straight segment of circles of the same areas, from which names and numbers of elements are taken."""
        curves = self._curves
        skin, tibia, fibula = (curves[name] for name in ("skin", "tibia", "fibula"))
        pairs = [(curves[_named("interface", k)], curves[_named("wall_outer", k)]) for k in self._numbers]
        (lumen, outer), *others = pairs
        further = tuple(
            CalfVein(lumen_diameter=2 * hole.radius, wall_thickness=wall.radius - hole.radius, x=wall.x, y=wall.y)
            for hole, wall in others
        )
        return CalfSegment(
            length=self.length, lumen_diameter=2 * lumen.radius, mesh=self.mesh,
            wall_thickness=outer.radius - lumen.radius, vein_x=outer.x, vein_y=outer.y,
            skin_radius_distal=skin.radius, skin_radius_proximal=skin.radius,
            tibia_x=tibia.x, tibia_y=tibia.y, tibia_diameter=2 * tibia.radius,
            fibula_x=fibula.x, fibula_y=fibula.y, fibula_diameter=2 * fibula.radius, further_veins=further,
            fat=FatLayer(thickness=skin.radius - curves["fascia"].radius) if self._fat else None,
            compartments=self._compartments,
        )  # fmt: skip

    @property
    def _numbers(self) -> range:
        return range(1, 1 + len(self.stack.lumens))

    @property
    def length(self) -> float:
        """Length of the segment [m]."""
        return self.stack.heights[-1] - self.stack.heights[0]

    @property
    def lumen_radius(self) -> float:
        """Radius [m] of the circle with the mean area of the lumen."""
        return self._radius(1)

    def _radius(self, number: int) -> float:
        return float(np.sqrt(_middle(self._lofts[_named("interface", number)])[0] / pi))

    @property
    def size(self) -> float:
        """Radius of the lumen [m]."""
        return self.lumen_radius

    @property
    def vein_centre(self) -> tuple[float, float]:
        """Mean position (x, y) of the vein's axis [m], its place in the straight mesh."""
        return self.straight.vein_centre

    @property
    def solids(self) -> tuple[str, ...]:
        """Names of the regions of the solids."""
        return *self.straight.solids, *self.further_regions

    @property
    def further_regions(self) -> tuple[str, ...]:
        """Names of the regions of labels, in which elements lie that are of the tissue without them."""
        return ()

    def label_volumes(self) -> dict[str, float]:
        """Return the volumes [m3] of those labels."""
        return {}

    def region_at(self, points: Array) -> NDArray[np.str_]:
        """Return the region at points (n, 3) [m] of the tissue: one of `further_regions`, or tissue."""
        return np.full(len(points), "tissue")

    @property
    def vessels(self) -> tuple[Vessel, ...]:
        """The veins, in the straight mesh."""
        return tuple(replace(vessel, radius=self._radius(k)) for k, vessel in enumerate(self.straight.vessels, start=1))

    @property
    def rigid_names(self) -> tuple[str, ...]:
        """Boundaries that are fixed in space: the bones."""
        return self.straight.rigid_names

    @property
    def boundary_names(self) -> tuple[str, ...]:
        """Every boundary the mesh must have, curved ones first."""
        return self.straight.boundary_names

    @property
    def internal_names(self) -> tuple[str, ...]:
        """Boundaries inside a region that the mesh may have."""
        return self.straight.internal_names

    @property
    def curving_order(self) -> int:
        """Polynomial order of the curved mesh."""
        return self.mesh.curving_order

    def exact_volumes(self) -> dict[str, float]:
        """Return the volume [m3] of each region between the lofts, but for those of labels and what is left."""
        inside = {name: loft.volume() for name, loft in self._lofts.items()}
        inmost = inside.get("fascia", inside["skin"])
        found = {"tissue": inmost - inside["tibia"] - inside["fibula"]}
        if self._fat:
            found["fat"] = inside["skin"] - inmost
        for k in self._numbers:
            lumen, outer = inside[_named("interface", k)], inside[_named("wall_outer", k)]
            found["tissue"] -= outer
            found |= {_named("wall", k): outer - lumen, _named("fluid", k): lumen}
        if self.further_regions or self._compartments:
            found.pop("tissue")
        return found

    def mesh_attempts(self) -> tuple[str, ...]:
        """Return a description of each way to mesh this segment, in the order to be tried."""
        return self.straight.mesh_attempts()

    def netgen_mesh(self, attempt: int = 0) -> Any:
        """Return the Netgen mesh [m] of the straight segment; attempt: index in `mesh_attempts`."""
        mesh = self.straight.netgen_mesh(attempt, self._curves)
        if not self.further_regions:
            return mesh
        section, heights = self.straight.layered(attempt, self._curves)
        ends = {**self.straight.ends, **dict.fromkeys(self.further_regions, TISSUE_ENDS)}
        split = self.mesh.element == "tetrahedron"
        return extrude(section, heights, ends, split, self._regions(section, len(heights) - 1, self._vertices(mesh)))

    def parts_to_refine(self, mesh: Any) -> NDArray[np.int64]:
        """Return the number of the layer of each element of a mesh of this segment.

        Raises:
            GeometryError: the mesh has no layers.
        """
        return self.straight.parts_to_refine(mesh)

    def refined(self, marked: NDArray[np.bool_], _file: Path) -> Self:
        """Return the segment with some of its layers cut in two."""
        return self.replace(mesh=self.mesh.with_halved_layers(marked))

    def _vertices(self, mesh: Any) -> Array:
        """Return where the vertices (n, 3) [m] of a straight mesh lie between the lofts."""
        import ngsolve as ng

        straight = ng.Mesh(mesh)
        shape = reference_shape(straight, self.boundary_names, self.curving_order, self.shape_map())
        moved = [np.array(component.vec.FV().NumPy()[: straight.nv]) for component in shape.components]
        return np.asarray([vertex.point for vertex in straight.vertices] + np.stack(moved, axis=1))

    def _regions(self, section: SectionMesh, layers: int, vertices: Array) -> list[list[NDArray[np.str_]]]:
        """Return the region of each cell in each layer: of the tissue that in which most of its sample points lie.

        Those at a vein are all in that in which most of them lie, so that the vein has one neighbour.
        """
        at_veins = np.concatenate([ring.nodes for ring in section.rings if ring.circle.name.startswith("wall_outer")])
        plane, found, votes = len(section.points), [], []
        for layer in range(layers):
            parts = []
            for name, cells in section.cells:
                corners = vertices[np.hstack([cells, cells + plane]) + layer * plane]
                middles = corners.mean(axis=1, keepdims=True)
                samples = np.concatenate([middles, *((1 - t) * middles + t * corners for t in SAMPLED)], axis=1)
                regions = np.full(samples.shape[:2], name, dtype=object)
                if name == "tissue":
                    regions = self.region_at(samples.reshape(-1, 3)).reshape(samples.shape[:2])
                chosen = np.array([_most(row) for row in regions], dtype=object)
                if name == "tissue":
                    near = np.isin(cells, at_veins).any(axis=1)
                    votes += chosen[near].tolist()
                    chosen[near] = None
                parts.append(chosen)
            found.append(parts)
        beside = _most(np.array(votes))
        return [[np.array([one or beside for one in part]) for part in parts] for parts in found]

    def shape_map(self) -> BoundaryMotion:
        """Return the displacement [m] of the straight segment's surfaces to the lofts."""
        import ngsolve as ng

        motions = {}
        for name, loft in self._lofts.items():
            curve = self._curves[name]
            across = ng.x - curve.x, ng.y - curve.y
            radius = ng.sqrt(across[0] ** 2 + across[1] ** 2)
            x, y = loft.position((across[0] / radius, across[1] / radius), ng.z)
            motions[name] = ng.CF((x - ng.x, y - ng.y, 0.0)).Compile()
        return BoundaryMotion(motions, STEPS, straight=True)

    def inflow(self) -> None:
        """Return nothing: the developed profile in a section of any shape is found on the mesh."""


class LoftedCalf(CalfLoft):
    """Calf segment through given outlines."""

    skin: tuple[Outline, ...] = Field(description="outline of the skin in each slice")
    tibia: tuple[Outline, ...] = Field(description="outline of the tibia in each slice")
    fibula: tuple[Outline, ...] = Field(description="outline of the fibula in each slice")
    lumen: tuple[Outline, ...] = Field(description="outline of the vein's lumen in each slice")
    fat: FatLayer | None = Field(None, description="layer of fat under the skin, a region of its own")
    compartments: Compartments | None = None
    """Regions in the place of the tissue, parted by septa that go from the bones as in the geometry calf."""
    further_lumens: tuple[tuple[Outline, ...], ...] = Field((), description="outlines of further veins")
    heights: tuple[Length, ...] = Field(description="positions z of the outlines, from distal to proximal")
    first_slice: int = Field(0, ge=0, description="number of the first outline in the image, for sentences")

    @property
    def _fat(self) -> FatLayer | None:
        return self.fat

    @property
    def _compartments(self) -> Compartments | None:
        return self.compartments

    @cached_property
    def stack(self) -> Stack:
        """The outlines."""
        outlines = {name: getattr(self, name) for name in ANATOMY}
        outlines |= {_named("lumen", k): stack for k, stack in enumerate(self.further_lumens, start=2)}
        return Stack(outlines, self.heights, self.first_slice)


def _most(names: NDArray[Any]) -> str:
    """Return the name that is there most often."""
    there, counts = np.unique(names.astype(str), return_counts=True)
    return str(there[np.argmax(counts)])


def _named(part: str, number: int) -> str:
    return part if number == 1 else f"{part}_{number}"


def _middle(loft: StarLoft) -> tuple[float, complex]:
    """Return the mean area [m2] of the sections along z, and the mean of their middles x + iy [m]."""
    middle, row = loft.mean()
    return pi * float(row[0].real), middle
