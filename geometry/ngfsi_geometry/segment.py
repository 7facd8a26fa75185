"""What all straight vein segments share: dimensions of vein and skin, checks, mesh sizes and the mesh itself."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations, pairwise
from math import ceil, cos, degrees, isclose, pi, sin, sqrt
from pathlib import Path
from typing import Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from ngfsi.config.model import ConfigModel
from ngfsi.errors import GeometryError, NgfsiError
from ngfsi.mesh.curving import BoundaryMotion
from ngfsi.mesh.geometry import Vessel
from ngfsi.units import Angle, Area, Length
from ngfsi_geometry.extrusion import extrude, layer_heights
from ngfsi_geometry.plane import (
    Curve,
    Ellipse,
    Indices,
    Line,
    Points,
    SectionMesh,
    Star,
    even_angles,
    fill_vein,
    triangulate,
    within,
)

TISSUE_ENDS = ("tissue_bottom", "tissue_top")

SIZE_FACTORS = (1.0, 0.93, 1.08, 0.8)
"""Factors on the element sizes to be tried in turn if the mesher fails."""

NARROWEST_GAP = 0.5e-3
"""Parts closer than this [m] are refused: the tissue between them could not be meshed sensibly."""


MOST_EDGES = 10_000

LARGEST_RATIO = 5.0
"""Of the axes of a lumen."""

FINE_ANGLES = 720
"""Places on a curve at which its distance from others is looked at."""

EDGES_OF_AN_OVAL = 6
"""Edges around a lumen, for each unit of its aspect ratio, with which its tips are resolved."""


class MeshSettings(ConfigModel):
    """How finely a segment is meshed."""

    refusal: ClassVar[type[NgfsiError]] = GeometryError

    element: Literal["prism", "mixed", "tetrahedron", "csg"] = Field(
        "prism",
        description="prisms; prisms with hexahedra in the layers of wall and lumen, which may then be of any "
        "thickness (mixed); tetrahedra, three to a prism; or Netgen's own of default sizes, to compare with (csg)",
    )
    far_size: Length = Field(18e-3, gt=0, description="element size in the tissue far from the vein")
    vein_size: Length = Field(2.5e-3, gt=0, description="element length around the lumen, less where layers are thin")
    layer_boundaries: tuple[float, ...] = Field(
        (),
        description="heights of the borders between layers along z, as fractions of the length, in place of even "
        "layers or of end_refinement; `ngfsi run --refine` halves layers so",
    )
    axial_layers: int = Field(
        default_factory=lambda given: (
            len(given.get("layer_boundaries", ())) + 1 if given.get("layer_boundaries") else 8
        ),
        ge=1,
        le=2000,
        description="number of element layers along z",
    )
    end_refinement: float = Field(
        1.0, ge=1, le=20, description="layers at the ends are this many times thinner than at mid-length"
    )
    lumen_radii: tuple[float, ...] = Field(
        (0.85, 0.6),
        description="radii of the concentric layer boundaries in the lumen as fractions of its radius, from the wall "
        "inwards; wall shear needs thin layers at the wall",
    )
    wall_layers: int = Field(1, ge=1, le=8, description="number of element layers through the vein wall")
    curving_order: int = Field(
        3,
        ge=1,
        le=8,
        description="polynomial order of the curved elements; best the order of the displacement: with a lower one "
        "thin walls bend wrongly, with a higher one linear fields are not exact",
    )

    @model_validator(mode="after")
    def _check_radii(self) -> MeshSettings:
        """Refuse layer boundaries in the lumen that are out of order."""
        falling = all(inner < outer for outer, inner in pairwise((1.0, *self.lumen_radii, 0.0)))
        if not falling:
            raise ValueError(f"lumen_radii {list(self.lumen_radii)} must decrease, from below 1 (the wall) to above 0")
        return self

    @model_validator(mode="after")
    def _check_layers(self) -> MeshSettings:
        """Refuse borders between layers that are out of order, or that contradict other keys."""
        borders = self.layer_boundaries
        if not all(low < high for low, high in pairwise((0.0, *borders, 1.0))):
            raise ValueError(f"layer_boundaries {list(borders)} must increase, from above 0 to below 1 (the length)")
        if borders and (self.axial_layers != len(borders) + 1 or self.end_refinement != 1):
            raise ValueError(
                f"{len(borders)} layer_boundaries are of {len(borders) + 1} layers of given heights: leave out "
                "axial_layers and end_refinement"
            )
        return self

    def heights(self, length: float) -> Points:
        """Return the z [m] of the borders of layers, from 0 to a length [m]."""
        if self.layer_boundaries:
            return length * np.array([0.0, *self.layer_boundaries, 1.0])
        return layer_heights(length, self.axial_layers, self.end_refinement)

    def with_halved_layers(self, marked: NDArray[np.bool_]) -> MeshSettings:
        """Return the settings with some of the layers, from z = 0 on, cut in two."""
        heights = self.heights(1.0)
        middles = (heights[:-1] + heights[1:])[marked] / 2
        borders = tuple(map(float, np.sort([*heights[1:-1], *middles])))
        return self.replace(layer_boundaries=borders, axial_layers=len(borders) + 1, end_refinement=1.0)


@dataclass(frozen=True)
class StraightVein:
    """A vein of circular or elliptic lumen along z, with a wall of even thickness and perhaps a sheath around it.

    Attributes:
        number: 1 for the first of a segment, which has the plain names; the names of others end in it.
        x, y: position of its axis [m].
        lumen_radius: of the circle with the lumen's area [m].
        wall_thickness: [m].
        aspect_ratio: of the lumen's axes.
        direction: of the longer axis, from x to y [rad].
        hollow: whether the lumen is a hole.
        sheath_thickness: of the loose connective tissue around the wall [m]; 0: there is none.
    """

    number: int
    x: float
    y: float
    lumen_radius: float
    wall_thickness: float
    aspect_ratio: float = 1.0
    direction: float = 0.0
    hollow: bool = False
    sheath_thickness: float = 0.0

    def named(self, part: str) -> str:
        """Return the name of a part of this vein."""
        return part if self.number == 1 else f"{part}_{self.number}"

    @property
    def interface(self) -> Ellipse:
        """Inner surface of the wall."""
        return Ellipse(self.named("interface"), self.x, self.y, self.lumen_radius, self.aspect_ratio, self.direction)

    @property
    def wall_outer(self) -> Ellipse:
        """Outer surface of the wall as it is meshed; around an oval lumen `thickening` makes the wall even."""
        return self.interface.wider(self.named("wall_outer"), self.wall_thickness)

    @property
    def coats(self) -> dict[str, tuple[Ellipse, float]]:
        """Region around the lumen -> its outer surface as meshed, and the distance [m] of that from the lumen."""
        found = {self.named("wall"): (self.wall_outer, self.wall_thickness)}
        if self.sheath_thickness:
            distance = self.wall_thickness + self.sheath_thickness
            found[self.named("sheath")] = self.interface.wider(self.named("sheath_outer"), distance), distance
        return found

    @property
    def outermost(self) -> Ellipse:
        """Border to the tissue: the outer surface of the sheath, without one of the wall."""
        return [surface for surface, _ in self.coats.values()][-1]

    def thickening(self, surface: Ellipse, distance: float, x: Any, y: Any) -> tuple[Any, Any]:
        """Return the displacement [m] that takes a meshed surface to the curve at a distance [m] from the lumen."""
        (a, b), (A, B) = self.interface.semi_axes, surface.semi_axes
        along, across = surface.local(x, y)
        length = (along * along / A**2 + across * across / B**2) ** 0.5
        cosine, sine = along / (A * length), across / (B * length)
        normal = ((b * cosine) ** 2 + (a * sine) ** 2) ** 0.5
        u = (a + distance * b / normal) * cosine - along
        v = (b + distance * a / normal) * sine - across
        c, s = cos(self.direction), sin(self.direction)
        return c * u - s * v, s * u + c * v

    @property
    def ends(self) -> dict[str, tuple[str, str]]:
        """Region -> boundary names of its faces at z = 0 and z = length."""
        blood = {} if self.hollow else {"fluid": ("inlet", "outlet")}
        coats = ("wall", "sheath") if self.sheath_thickness else ("wall",)
        pairs = blood | {region: (f"{region}_bottom", f"{region}_top") for region in coats}
        return {self.named(region): (self.named(low), self.named(high)) for region, (low, high) in pairs.items()}

    def layers(self, mesh: MeshSettings) -> list[tuple[Ellipse, str]]:
        """Return the ellipses inside the outermost surface, from outside inwards, with the region outside each."""
        fractions = np.arange(mesh.wall_layers - 1, 0, -1) / mesh.wall_layers
        wall = [self.interface.wider("wall_layer", float(f) * self.wall_thickness) for f in fractions]
        lumen = [self.interface.scaled("lumen_layer", f) for f in (() if self.hollow else mesh.lumen_radii)]
        sheath = [(self.wall_outer, self.named("sheath"))] if self.sheath_thickness else []
        walls = [(c, self.named("wall")) for c in (*wall, self.interface)]
        return sheath + walls + [(c, self.named("fluid")) for c in lumen]

    def vessel(self, length: float, outer: bool) -> Vessel:
        """Return what a geometry says of this vein; outer: whether there is tissue around it."""
        filled = not self.hollow
        return Vessel(
            name="" if self.number == 1 else f"vein_{self.number}", lumen=self.named("fluid") if filled else None,
            interface=self.interface.name, wall=self.named("wall"), outer=self.wall_outer.name if outer else None,
            inlets=(self.named("inlet"),) if filled else (), outlets=(self.named("outlet"),) if filled else (),
            centreline=((self.x, self.y, 0.0), (self.x, self.y, length)), radius=self.lumen_radius,
        )  # fmt: skip


class FatLayer(ConfigModel):
    """Fat under the skin: the region `fat`, which the boundary `fascia` parts from what is inside."""

    refusal: ClassVar[type[NgfsiError]] = GeometryError

    thickness: Length = Field(
        5e-3,
        gt=0,
        description="an assumption, from usual skinfolds at the medial calf of 9 mm in men and 18 mm in women, which "
        "are two layers",
    )


class VeinSegment(ConfigModel):
    """A straight vein in a cylinder of tissue, from z = 0 (inlet) to z = length (outlet); base of the builders."""

    refusal: ClassVar[type[NgfsiError]] = GeometryError
    fluid: ClassVar[str] = "fluid"

    length: Length = Field(120e-3, gt=0, description="length of the segment; source study: 12 cm")
    lumen_area: Area | None = Field(None, gt=0, description="area of the lumen, from which its diameter follows")
    lumen_axes: tuple[Length, Length] | None = Field(
        None, description="longer and shorter inner diameter, from which diameter and aspect ratio follow"
    )
    lumen_diameter: Length = Field(
        default_factory=lambda given: _diameter(given) or 11.1e-3,
        gt=0,
        description="inner diameter of the vein, of an oval one that of the circle with the same area; source study: "
        "11.1 mm",
    )
    aspect_ratio: float = Field(
        default_factory=lambda given: _ratio(given) or 1.0,
        ge=1,
        le=LARGEST_RATIO,
        description="of the longer to the shorter axis of the lumen, an ellipse in a wall of even thickness",
    )
    oval_direction: Angle = Field(0.0, description="of the ellipse's longer axis, from x (lateral) to y (anterior)")
    wall_thickness: Length = Field(1e-3, gt=0, description="thickness of the vein wall; source study: 1 mm")
    sheath_thickness: Length = Field(
        0.0, ge=0, description="thickness of a layer of loose connective tissue around the wall, the region sheath"
    )
    vein_x: Length = Field(0.0, description="lateral position of the vein's axis")
    vein_y: Length = Field(0.0, description="anterior position of the vein's axis")
    hollow: bool = Field(
        False,
        description="whether lumens are holes without blood, in which `loads.outlet_pressure` presses: solids alone",
    )
    fat: FatLayer | None = Field(None, description="layer of fat under the skin, a region of its own")
    mesh: MeshSettings = MeshSettings()

    @property
    @abstractmethod
    def skin_radius(self) -> float:
        """Mean radius of the skin [m]."""

    @property
    def bones(self) -> tuple[Ellipse, ...]:
        """Cross-sections of the rigid bones."""
        return ()

    @property
    def veins(self) -> tuple[StraightVein, ...]:
        """All veins, the first one of `lumen_diameter` at (`vein_x`, `vein_y`)."""
        place = self.vein_x, self.vein_y
        shape = self.aspect_ratio, self.oval_direction
        sizes = self.lumen_radius, self.wall_thickness
        return (StraightVein(1, *place, *sizes, *shape, self.hollow, self.sheath_thickness),)

    @property
    def vessels(self) -> tuple[Vessel, ...]:
        """All veins."""
        return tuple(vein.vessel(self.length, bool(self.tissues)) for vein in self.veins)

    @property
    def tissues(self) -> tuple[str, ...]:
        """Names of the regions around the veins."""
        return ("tissue",)

    @property
    def solids(self) -> tuple[str, ...]:
        """Names of the regions of the solids."""
        fat = ("fat",) if self.fat else ()
        return *self.tissues, *(region for vein in self.veins for region in vein.coats), *fat

    @property
    def lumen_radius(self) -> float:
        """Radius of the circle with the lumen's area [m]."""
        return self.lumen_diameter / 2

    @property
    def vein_centre(self) -> tuple[float, float]:
        """Position (x, y) of the vein's axis [m]."""
        return self.vein_x, self.vein_y

    @property
    def size(self) -> float:
        """Radius of the lumen [m]."""
        return self.lumen_radius

    @property
    def rigid_names(self) -> tuple[str, ...]:
        """Boundaries that are fixed in space: the bones."""
        return tuple(bone.name for bone in self.bones)

    def inflow(self) -> Any:
        """Return the developed velocity of unit mean through the inlet."""
        from ngsolve import CF, x, y

        lumen = self.veins[0].interface
        (along, across), (a, b) = lumen.local(x, y), lumen.semi_axes
        return CF((0, 0, 2 * (1 - (along / a) ** 2 - (across / b) ** 2)))

    @property
    def curving_order(self) -> int:
        """Polynomial order of the curved mesh."""
        return self.mesh.curving_order

    @property
    def skin(self) -> Ellipse:
        """Cross-section of the skin, before any taper."""
        return Ellipse("skin", 0.0, 0.0, self.skin_radius)

    @property
    def fascia(self) -> Ellipse:
        """Cross-section of what is inside of the fat, before any taper; without fat the skin."""
        return (
            replace(self.skin, name="fascia", radius=self.skin_radius - self.fat.thickness) if self.fat else self.skin
        )

    @property
    def rims(self) -> tuple[Ellipse, ...]:
        """Curves of the section around which there are tissues or fat: those around all, the skin last, and bones."""
        return *self.bones, *((self.fascia,) if self.fat else ()), self.skin

    @property
    def septa(self) -> tuple[str, ...]:
        """Names of plane borders between tissues."""
        return ()

    @property
    def wall_outer(self) -> Ellipse:
        """Outer surface of the first vein's wall."""
        return self.veins[0].wall_outer

    @property
    def outermost(self) -> tuple[Ellipse, ...]:
        """Borders of all veins to the tissue."""
        return tuple(vein.outermost for vein in self.veins)

    @property
    def ends(self) -> dict[str, tuple[str, str]]:
        """Region -> boundary names of its faces at z = 0 and z = length."""
        around = dict.fromkeys((*self.tissues, *(("fat",) if self.fat else ())), TISSUE_ENDS)
        return {region: pair for vein in self.veins for region, pair in vein.ends.items()} | around

    @property
    def surface_names(self) -> tuple[str, ...]:
        """Boundaries along z."""
        outer = [surface for vein in self.veins for surface, _ in vein.coats.values()]
        coats = outer if self.tissues else ()
        fascia = (self.fascia,) if self.fat else ()
        lumens = (vein.interface for vein in self.veins)
        return *(one.name for one in (self.skin, *fascia, *self.bones, *coats, *lumens)), *self.septa

    @property
    def boundary_names(self) -> tuple[str, ...]:
        """Every boundary the mesh must have, curved ones first."""
        return *self.surface_names, *dict.fromkeys(name for pair in self.ends.values() for name in pair)

    @property
    def internal_names(self) -> tuple[str, ...]:
        """Boundaries inside a region that the mesh may have: surfaces between layers of elements."""
        return ("wall_layer",) if self.hollow else ("lumen_layer", "wall_layer")

    def shape_map(self) -> Any:
        """Return the displacement from the meshed shape to the reference shape, or None if they are the same.

        Around an oval vein the outer surfaces of wall and sheath move to an even distance from the lumen.
        """
        oval = [vein for vein in self.veins if vein.aspect_ratio > 1]
        if not oval:
            return None
        from ngsolve import CF, x, y

        motions = dict.fromkeys(self.surface_names, CF((0, 0, 0)))
        for vein in oval:
            for surface, distance in vein.coats.values():
                outer = surface.name if self.tissues else self.skin.name
                motions[outer] = CF((*vein.thickening(surface, distance, x, y), 0))
        return BoundaryMotion(motions)

    def exact_volumes(self) -> dict[str, float]:
        """Return the volume [m3] of each region."""
        found: dict[str, float] = {}
        holes = []
        for vein in self.veins:
            lumen = inside = pi * vein.lumen_radius**2
            if not self.hollow:
                found[vein.named("fluid")] = lumen * self.length
            for region, (_, distance) in vein.coats.items():
                # Steiner's formula for parallel curves
                outer = lumen + vein.interface.length * distance + pi * distance**2
                found[region], inside = (outer - inside) * self.length, outer
            holes.append(inside)
        around = self._volumes_around(holes) if self.tissues else {}
        return around | found

    def _volumes_around(self, holes: Sequence[float]) -> dict[str, float]:
        """Return the volumes [m3] of tissue and fat around veins of given areas [m2]."""
        inside = self.fascia_volume()
        tissue = inside - (sum(holes) + sum(pi * bone.radius**2 for bone in self.bones)) * self.length
        return {"tissue": tissue} | ({"fat": self.skin_volume() - inside} if self.fat else {})

    def fascia_volume(self) -> float:
        """Return the volume [m3] inside the fascia."""
        return pi * self.fascia.radius**2 * self.length

    def skin_volume(self) -> float:
        """Return the volume [m3] inside the skin."""
        return pi * self.skin_radius**2 * self.length

    def mesh_attempts(self) -> tuple[str, ...]:
        """Return a description of each way to mesh this segment, in the order to be tried."""
        if self.mesh.element == "csg":
            return ("Netgen's default sizes",)
        return tuple(f"element sizes x {factor:g}" for factor in SIZE_FACTORS)

    def netgen_mesh(self, attempt: int = 0, curves: Mapping[str, Star] | None = None) -> Any:
        """Return the straight Netgen mesh [m] with its geometry and names.

        Args:
            attempt: index in `mesh_attempts`.
            curves: boundary -> curve in place of its ellipse; of all boundaries along z.
        """
        if self.mesh.element == "csg":
            return self._mesh_of_solids()
        return extrude(*self.layered(attempt, curves or {}), self.ends, split=self.mesh.element == "tetrahedron")

    def layered(self, attempt: int, curves: Mapping[str, Star]) -> tuple[SectionMesh, Points]:
        """Return the mesh of the section, and the heights [m] of the layers; arguments as of `netgen_mesh`."""
        return self._section(SIZE_FACTORS[attempt], curves), self.mesh.heights(self.length)

    def parts_to_refine(self, mesh: Any) -> NDArray[np.int64]:
        """Return the number of the layer of each element of a mesh of this segment.

        Raises:
            GeometryError: the mesh has no layers.
        """
        if self.mesh.element == "csg":
            raise GeometryError("a mesh of element = 'csg' has no layers that could be halved: use another element")
        middles = [np.mean([mesh[vertex].point[2] for vertex in element.vertices]) for element in mesh.Elements()]
        return np.searchsorted(self.mesh.heights(self.length), middles) - 1

    def refined(self, marked: NDArray[np.bool_], _file: Path) -> Self:
        """Return the segment with some of its layers cut in two."""
        return self.replace(mesh=self.mesh.with_halved_layers(marked))

    def _section(self, factor: float, curves: Mapping[str, Star]) -> SectionMesh:
        """Return the mesh of the cross-section, its element sizes multiplied by a factor."""
        far, near = self.mesh.far_size * factor, self.mesh.vein_size * factor
        rims = [(vein.outermost, even_angles(self._vein_segments(vein, near))) for vein in self.veins]
        rims += [(circle, self._angles(circle, near, far)) for circle in self.rims]
        loops = [(curves.get(circle.name, circle), angles) for circle, angles in rims]
        lines, material_at = self._lines(loops, near, far), None
        if self.fat or lines:
            # of chords, which is what is meshed
            material_at = partial(self._material_at, {one.name: one.points(angles) for one, angles in loops})
        names = (*self.tissues, "fat") if self.fat else self.tissues
        section = triangulate(names, loops, far, lines, material_at)
        for vein in self.veins:
            section = self._filled(section, vein, vein.outermost.name, curves)
        return section

    def _lines(self, _loops: list[tuple[Curve, Points]], _near: float, _far: float) -> list[Line]:
        """Return the septa, and move nodes of the loops to where they end."""
        return []

    def _material_at(self, polygons: Mapping[str, Points], points: Points) -> Indices:
        """Return the number of the material at points of the section: of `tissues` and fat, from 1; 0: none."""
        found = self._tissue_at(points)
        for name, corners in reversed(list(polygons.items())):
            inside = within(points, corners)
            if name == "skin":
                found[~inside] = 0
            elif name == "fascia":
                found[~inside & (found > 0)] = len(self.tissues) + 1
            else:
                found[inside] = 0
        return found

    def _tissue_at(self, points: Points) -> Indices:
        """Return the number of the tissue, from 1, that is or would be at points of the section."""
        return np.ones(len(points), dtype=np.int32)

    def _filled(
        self, section: SectionMesh, vein: StraightVein, hole: str, curves: Mapping[str, Star] | None = None
    ) -> SectionMesh:
        """Return a section with a vein in its hole."""
        core = None if self.hollow else vein.named("fluid")
        ellipses = vein.layers(self.mesh)
        layers: list[tuple[Curve, str]] = list(ellipses)
        if curves:
            inner, outer = curves[vein.interface.name], curves[vein.wall_outer.name]
            layers = [(_between(inner, outer, vein, ellipse), region) for ellipse, region in ellipses]
        return fill_vein(section, hole, layers, core, self.mesh.element != "mixed")

    def _mesh_of_solids(self) -> Any:
        from ngfsi_geometry.csg import mesh_of_solids  # with Netgen's CSG, which nothing else needs

        tissue = bool(self.tissues)
        regions: dict[str, tuple[Ellipse, Sequence[Ellipse]]] = {}
        for vein in self.veins:
            if not self.hollow:
                regions[vein.named("fluid")] = (vein.interface, ())
            inside = vein.interface
            for region, (surface, _) in vein.coats.items():
                regions[region] = (surface if tissue else self.skin, (inside,))
                inside = surface
        if tissue:
            regions["tissue"] = (self.skin, (*self.outermost, *self.bones))
        return mesh_of_solids(regions, self.ends, self.length)

    @model_validator(mode="after")
    def _check_positions(self) -> VeinSegment:
        """Refuse parts that overlap, leave the skin or nearly touch."""
        inner = (*self.outermost, *self.bones)
        if self.fat and self.fat.thickness > self.skin_radius - NARROWEST_GAP:
            raise ValueError(f"fat of {self.fat.thickness * 1e3:g} mm leaves nothing inside: make it thinner")
        gaps = [(a, b, a.beside(b)) for a, b in combinations(inner, 2)]
        gaps += [(a, self.fascia, a.inside(self.fascia)) for a in inner]
        for a, b, gap in gaps:
            if gap < NARROWEST_GAP:
                raise ValueError(_collision(a, b, gap))
        return self

    @model_validator(mode="after")
    def _check_element(self) -> VeinSegment:
        """Refuse parts that Netgen's own meshes have not."""
        if self.mesh.element == "csg" and (self.fat or self.septa):
            raise ValueError("meshes of element = 'csg' have neither fat nor compartments: use another element")
        return self

    @model_validator(mode="after")
    def _check_lumen(self) -> VeinSegment:
        """Refuse a lumen that is given twice, and differently."""
        given = {"lumen_area": self.lumen_area, "lumen_axes": self.lumen_axes}
        follow = {"lumen_diameter": _diameter(given), "aspect_ratio": _ratio(given)}
        for name, value in follow.items():
            if value and not isclose(value, getattr(self, name), rel_tol=1e-9):
                source = "lumen_axes" if self.lumen_axes else "lumen_area"
                raise ValueError(f"{name} and {source} contradict each other: keep one of them")
        if not (self.lumen_diameter > 0 and 1 <= self.aspect_ratio <= LARGEST_RATIO):
            raise ValueError(
                f"lumen_axes must be the longer and the shorter one, at most {LARGEST_RATIO:g} times as long"
            )
        return self

    @model_validator(mode="after")
    def _check_sizes(self) -> VeinSegment:
        """Refuse elements so small that no computer could hold them."""
        veins = [(circle, self.mesh.vein_size) for circle in self.outermost]
        for circle, size in ((self.skin, self.mesh.far_size), *veins):
            if 2 * pi * circle.radius > MOST_EDGES * size:
                raise ValueError(f"elements of {size * 1e3:.3g} mm would be more than {MOST_EDGES:,} edges on a circle")
        return self

    def _vein_segments(self, vein: StraightVein, size: float) -> int:
        """Return the (even) number of edges around a vein: short enough for arcs to stay within thin layers."""
        outer = vein.outermost
        size = min([size, *(2 * outer.gap(other) for other in self.outermost if other != outer)])
        segments = vein.interface.length / size
        if vein.aspect_ratio > 1:
            segments = max(segments, EDGES_OF_AN_OVAL * vein.aspect_ratio)
        if self.mesh.element != "mixed":
            # in a layer of thickness t on radius r, the diagonal of an edge clears the arc if t / r > 2 (pi / n)^2
            ellipses = [outer, *(ellipse for ellipse, _ in vein.layers(self.mesh))]
            thinnest = min(
                wide / narrow - 1
                for outside, inside in pairwise(ellipses)
                for wide, narrow in zip(outside.semi_axes, inside.semi_axes, strict=True)
            )
            segments = max(segments, pi * sqrt(3 / thinnest))
        return 2 * max(4, ceil(segments / 2))

    def _angles(self, circle: Ellipse, near: float, far: float) -> Points:
        """Return the angles of the nodes on a circle: elements grow with the distance to veins, gaps are resolved; on
        the fascia, which is near to a bone at one place, there."""
        others = [c for c in (self.skin, *self.rims[:-1], *self.outermost) if c != circle]
        to_vein = min(circle.gap(outer) for outer in self.outermost)
        size = min(far, near + 0.5 * to_vein)
        if circle.name == "fascia":
            at = even_angles(FINE_ANGLES)
            places = np.vstack([other.points(even_angles(FINE_ANGLES)) for other in others])
            gaps = np.hypot(*(circle.points(at)[:, None] - places[None]).T).min(axis=0)
            density = np.cumsum(1 / np.minimum(size, 2 * gaps))
            count = max(8, ceil(2 * pi * circle.radius / FINE_ANGLES * density[-1]))
            nodes = density[-1] * (np.arange(count) + 0.25) / count
            return np.asarray(np.interp(nodes, np.r_[0.0, density], np.r_[0.0, at + np.pi / FINE_ANGLES / 2]))
        size = min(size, *(2 * circle.gap(c) for c in others))
        return even_angles(max(8, ceil(2 * pi * circle.radius / size)))


def _between(inner: Star, outer: Star, vein: StraightVein, circle: Ellipse) -> Star:
    """Return the curve in the place of a circle of a vein whose lumen and wall end at two curves."""
    t = (circle.radius - vein.lumen_radius) / vein.wall_thickness
    if t <= 0:
        return inner.scaled(circle.name, circle.radius / vein.lumen_radius)
    row = tuple((1 - t) * a + t * b for a, b in zip(inner.row, outer.row, strict=True))
    return replace(inner, name=circle.name, row=row)


def smooth_step(t: Any) -> Any:
    """Rise from 0 at t = 0 to 1 at t = 1, twice differentiable at both."""
    return t * t * t * (10 - 15 * t + 6 * t * t)


def _collision(a: Ellipse, b: Ellipse, gap: float) -> str:
    parts = f"{a.name} and {b.name}".replace("wall_outer_", "wall of vein ").replace("wall_outer", "vein wall")
    parts = parts.replace("sheath_outer", "vein sheath")
    where = "; ".join(f"{one.name} {_size(one)} at ({one.x * 1e3:g}, {one.y * 1e3:g}) mm" for one in (a, b))
    if gap <= 0:
        return f"{parts} overlap by {-gap * 1e3:.3g} mm: {where}"
    return f"{parts} are {gap * 1e3:.3g} mm apart, at least {NARROWEST_GAP * 1e3:g} mm are needed: {where}"


def _size(one: Ellipse) -> str:
    if one.ratio == 1:
        return f"of radius {one.radius * 1e3:g} mm"
    a, b = (2e3 * semi for semi in one.semi_axes)
    return f"of {a:.3g} by {b:.3g} mm, the longer axis at {degrees(one.direction):.3g} degrees,"


def _diameter(given: Mapping[str, Any]) -> float | None:
    """Return the diameter [m] of the circle with the area of a lumen given by its axes or its area."""
    if axes := given.get("lumen_axes"):
        return sqrt(axes[0] * axes[1])
    return 2 * sqrt(area / pi) if (area := given.get("lumen_area")) else None


def _ratio(given: Mapping[str, Any]) -> float | None:
    """Return the aspect ratio of a lumen given by its axes."""
    return axes[0] / axes[1] if (axes := given.get("lumen_axes")) else None
