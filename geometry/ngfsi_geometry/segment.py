"""What all straight vein segments share: dimensions of vein and skin, checks, mesh sizes and the mesh itself."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise
from math import ceil, cos, hypot, pi, sin, sqrt
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from ngfsi.config.model import ConfigModel
from ngfsi.errors import GeometryError, NgfsiError
from ngfsi.mesh.geometry import Vessel
from ngfsi.units import Angle, Length
from ngfsi_geometry.extrusion import extrude, layer_heights
from ngfsi_geometry.plane import Circle, SectionMesh, even_angles, fill_vein, triangulate

TISSUE_ENDS = ("tissue_bottom", "tissue_top")

SIZE_FACTORS = (1.0, 0.93, 1.08, 0.8)
"""Factors on the element sizes to be tried in turn if the mesher fails."""

NARROWEST_GAP = 0.5e-3
"""Parts closer than this [m] are refused: the tissue between them could not be meshed sensibly."""


MOST_EDGES = 10_000


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
    axial_layers: int = Field(8, ge=1, le=2000, description="number of element layers along z")
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


@dataclass(frozen=True)
class RoundVein:
    """A vein of circular section along z.

    Attributes:
        number: 1 for the first of a segment, which has the plain names; the names of others end in it.
        x, y: position of its axis [m].
        lumen_radius, wall_thickness: [m].
        hollow: whether the lumen is a hole.
    """

    number: int
    x: float
    y: float
    lumen_radius: float
    wall_thickness: float
    hollow: bool

    def named(self, part: str) -> str:
        """Return the name of a part of this vein."""
        return part if self.number == 1 else f"{part}_{self.number}"

    def circle(self, name: str, radius: float) -> Circle:
        """Return a circle around the axis."""
        return Circle(name, self.x, self.y, radius)

    @property
    def interface(self) -> Circle:
        """Inner surface of the wall."""
        return self.circle(self.named("interface"), self.lumen_radius)

    @property
    def wall_outer(self) -> Circle:
        """Outer surface of the wall."""
        return self.circle(self.named("wall_outer"), self.lumen_radius + self.wall_thickness)

    @property
    def ends(self) -> dict[str, tuple[str, str]]:
        """Region -> boundary names of its faces at z = 0 and z = length."""
        blood = {} if self.hollow else {"fluid": ("inlet", "outlet")}
        pairs = blood | {"wall": ("wall_bottom", "wall_top")}
        return {self.named(region): (self.named(low), self.named(high)) for region, (low, high) in pairs.items()}

    def layers(self, mesh: MeshSettings) -> list[tuple[Circle, str]]:
        """Return the circles inside the outer wall surface, from outside inwards, with the region outside each."""
        fractions = np.arange(mesh.wall_layers - 1, 0, -1) / mesh.wall_layers
        wall = [self.circle("wall_layer", self.lumen_radius + f * self.wall_thickness) for f in fractions]
        inside = () if self.hollow else mesh.lumen_radii
        lumen = [self.circle("lumen_layer", f * self.lumen_radius) for f in inside]
        return [(c, self.named("wall")) for c in (*wall, self.interface)] + [(c, self.named("fluid")) for c in lumen]

    def vessel(self, length: float, outer: bool) -> Vessel:
        """Return what a geometry says of this vein; outer: whether there is tissue around it."""
        filled = not self.hollow
        return Vessel(
            name="" if self.number == 1 else f"vein_{self.number}", lumen=self.named("fluid") if filled else None,
            interface=self.interface.name, wall=self.named("wall"), outer=self.wall_outer.name if outer else None,
            inlets=(self.named("inlet"),) if filled else (), outlets=(self.named("outlet"),) if filled else (),
            centreline=((self.x, self.y, 0.0), (self.x, self.y, length)), radius=self.lumen_radius,
        )  # fmt: skip


class VeinSegment(ConfigModel):
    """A straight vein in a cylinder of tissue, from z = 0 (inlet) to z = length (outlet); base of the builders."""

    refusal: ClassVar[type[NgfsiError]] = GeometryError
    fluid: ClassVar[str] = "fluid"

    length: Length = Field(120e-3, gt=0, description="length of the segment; source study: 12 cm")
    lumen_diameter: Length = Field(11.1e-3, gt=0, description="inner diameter of the vein; source study: 11.1 mm")
    wall_thickness: Length = Field(1e-3, gt=0, description="thickness of the vein wall; source study: 1 mm")
    vein_x: Length = Field(0.0, description="lateral position of the vein's axis")
    vein_y: Length = Field(0.0, description="anterior position of the vein's axis")
    oval: Length = Field(
        0.0,
        ge=0,
        description="by how much the lumen's radius is larger along `oval_direction`, and smaller across: an ellipse, "
        "the imperfection of mode 2 from which a vein collapses; the wall follows in proportion",
    )
    oval_direction: Angle = Field(0.0, description="of the ellipse's longer axis, from x (lateral) to y (anterior)")
    hollow: bool = Field(
        False,
        description="whether lumens are holes without blood, in which `loads.outlet_pressure` presses: solids alone",
    )
    mesh: MeshSettings = MeshSettings()

    @property
    @abstractmethod
    def skin_radius(self) -> float:
        """Mean radius of the skin [m]."""

    @property
    def bones(self) -> tuple[Circle, ...]:
        """Cross-sections of the rigid bones."""
        return ()

    @property
    def veins(self) -> tuple[RoundVein, ...]:
        """All veins, the first one of `lumen_diameter` at (`vein_x`, `vein_y`)."""
        return (RoundVein(1, self.vein_x, self.vein_y, self.lumen_radius, self.wall_thickness, self.hollow),)

    @property
    def vessels(self) -> tuple[Vessel, ...]:
        """All veins."""
        return tuple(vein.vessel(self.length, "tissue" in self.solids) for vein in self.veins)

    @property
    def solids(self) -> tuple[str, ...]:
        """Names of the regions of the solids."""
        return "tissue", *(vein.named("wall") for vein in self.veins)

    @property
    def lumen_radius(self) -> float:
        """Radius of the lumen [m]."""
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

        along, across = self._in_ellipse(x, y)
        a, b = self.lumen_radius + self.oval, self.lumen_radius - self.oval
        return CF((0, 0, 2 * (1 - (along / a) ** 2 - (across / b) ** 2)))

    @property
    def curving_order(self) -> int:
        """Polynomial order of the curved mesh."""
        return self.mesh.curving_order

    @property
    def skin(self) -> Circle:
        """Cross-section of the skin, before any taper."""
        return Circle("skin", 0.0, 0.0, self.skin_radius)

    @property
    def wall_outer(self) -> Circle:
        """Outer surface of the first vein's wall."""
        return self.veins[0].wall_outer

    @property
    def outer_walls(self) -> tuple[Circle, ...]:
        """Outer surfaces of the walls of all veins."""
        return tuple(vein.wall_outer for vein in self.veins)

    @property
    def ends(self) -> dict[str, tuple[str, str]]:
        """Region -> boundary names of its faces at z = 0 and z = length."""
        tissue = {"tissue": TISSUE_ENDS} if "tissue" in self.solids else {}
        return {region: pair for vein in self.veins for region, pair in vein.ends.items()} | tissue

    @property
    def boundary_names(self) -> tuple[str, ...]:
        """Every boundary the mesh must have, curved ones first."""
        outer = self.outer_walls if "tissue" in self.solids else ()
        around = (self.skin, *self.bones, *outer, *(vein.interface for vein in self.veins))
        return *(circle.name for circle in around), *(name for pair in self.ends.values() for name in pair)

    @property
    def internal_names(self) -> tuple[str, ...]:
        """Boundaries inside a region that the mesh may have: surfaces between layers of elements."""
        return ("wall_layer",) if self.hollow else ("lumen_layer", "wall_layer")

    def shape_map(self) -> Any:
        """Return the displacement [m] from the meshed shape to the reference shape, or None if they are the same.

        An oval vein: lumen and wall are stretched along one axis and compressed across, the tissue follows up to the
        next bone or the skin.
        """
        if self.oval == 0:
            return None
        from ngsolve import CF, IfPos, sqrt, x, y

        along, across = self._in_ellipse(x, y)
        fraction = self.oval / self.lumen_radius
        if self.wall_outer.radius < self.skin_radius:
            outside = (sqrt(along * along + across * across) - self.wall_outer.radius) / self._room()
            t = IfPos(outside, IfPos(1 - outside, 1 - outside, 0), 1)
            fraction = fraction * smooth_step(t)
        c, s = cos(self.oval_direction), sin(self.oval_direction)
        return fraction * CF((c * along + s * across, s * along - c * across, 0))

    def _in_ellipse(self, x: Any, y: Any) -> tuple[Any, Any]:
        """Return the coordinates along and across the longer axis of an oval vein, from its centre."""
        c, s = cos(self.oval_direction), sin(self.oval_direction)
        x, y = x - self.vein_x, y - self.vein_y
        return c * x + s * y, c * y - s * x

    def _room(self) -> float:
        """Return the smallest distance [m] of the first vein's wall from what is around it."""
        return min(_gap(self.wall_outer, other) for other in (*self.outer_walls[1:], *self.bones, self.skin))

    def exact_volumes(self) -> dict[str, float]:
        """Return the volume [m3] of each region."""
        found: dict[str, float] = {}
        holes = []
        for vein in self.veins:
            ellipse = 1 - (self.oval / self.lumen_radius) ** 2 if vein.number == 1 else 1.0
            lumen, outer = (pi * circle.radius**2 * ellipse for circle in (vein.interface, vein.wall_outer))
            found[vein.named("wall")] = (outer - lumen) * self.length
            if not self.hollow:
                found[vein.named("fluid")] = lumen * self.length
            holes.append(outer)
        holes += [pi * bone.radius**2 for bone in self.bones]
        tissue = {"tissue": self.skin_volume() - sum(holes) * self.length} if "tissue" in self.solids else {}
        return tissue | found

    def skin_volume(self) -> float:
        """Return the volume [m3] inside the skin."""
        return pi * self.skin_radius**2 * self.length

    def mesh_attempts(self) -> tuple[str, ...]:
        """Return a description of each way to mesh this segment, in the order to be tried."""
        if self.mesh.element == "csg":
            return ("Netgen's default sizes",)
        return tuple(f"element sizes x {factor:g}" for factor in SIZE_FACTORS)

    def netgen_mesh(self, attempt: int = 0) -> Any:
        """Return the straight Netgen mesh [m] with its geometry and names; attempt: index in `mesh_attempts`."""
        if self.mesh.element == "csg":
            return self._mesh_of_solids()
        heights = layer_heights(self.length, self.mesh.axial_layers, self.mesh.end_refinement)
        section = self._section(SIZE_FACTORS[attempt])
        return extrude(section, heights, self.ends, split=self.mesh.element == "tetrahedron")

    def _section(self, factor: float) -> SectionMesh:
        """Return the mesh of the cross-section, its element sizes multiplied by a factor."""
        far, near = self.mesh.far_size * factor, self.mesh.vein_size * factor
        loops = [(vein.wall_outer, even_angles(self._vein_segments(vein, near))) for vein in self.veins]
        loops += [(circle, even_angles(self._segments(circle, near, far))) for circle in (*self.bones, self.skin)]
        section = triangulate("tissue", loops, far)
        for vein in self.veins:
            section = self._filled(section, vein, vein.wall_outer.name)
        return section

    def _filled(self, section: SectionMesh, vein: RoundVein, hole: str) -> SectionMesh:
        """Return a section with a vein in its hole."""
        core = None if self.hollow else vein.named("fluid")
        return fill_vein(section, hole, vein.layers(self.mesh), core, self.mesh.element != "mixed")

    def _mesh_of_solids(self) -> Any:
        from ngfsi_geometry.csg import mesh_of_solids  # with Netgen's CSG, which nothing else needs

        tissue = "tissue" in self.solids
        regions: dict[str, tuple[Circle, Sequence[Circle]]] = {}
        for vein in self.veins:
            if not self.hollow:
                regions[vein.named("fluid")] = (vein.interface, ())
            regions[vein.named("wall")] = (vein.wall_outer if tissue else self.skin, (vein.interface,))
        if tissue:
            regions["tissue"] = (self.skin, (*self.outer_walls, *self.bones))
        return mesh_of_solids(regions, self.ends, self.length)

    @model_validator(mode="after")
    def _check_positions(self) -> VeinSegment:
        """Refuse parts that overlap, leave the skin or nearly touch."""
        inner = (*self.outer_walls, *self.bones)
        gaps = [(a, b, hypot(a.x - b.x, a.y - b.y) - a.radius - b.radius) for a, b in combinations(inner, 2)]
        gaps += [(a, self.skin, self.skin_radius - hypot(a.x, a.y) - a.radius) for a in inner]
        for a, b, gap in gaps:
            if gap < NARROWEST_GAP:
                raise ValueError(_collision(a, b, gap))
        return self

    @model_validator(mode="after")
    def _check_oval(self) -> VeinSegment:
        """Refuse an ellipse that would squeeze wall or tissue to nothing."""
        limit = self.lumen_radius / 2
        if self.wall_outer.radius < self.skin_radius:
            limit = min(limit, self._room() / 4)
        if self.oval > limit:
            raise ValueError(
                f"oval = {self.oval * 1e3:.3g} mm is too much for this vein and the tissue around it: at most "
                f"{limit * 1e3:.3g} mm"
            )
        return self

    @model_validator(mode="after")
    def _check_sizes(self) -> VeinSegment:
        """Refuse elements so small that no computer could hold them."""
        veins = [(circle, self.mesh.vein_size) for circle in self.outer_walls]
        for circle, size in ((self.skin, self.mesh.far_size), *veins):
            if 2 * pi * circle.radius > MOST_EDGES * size:
                raise ValueError(f"elements of {size * 1e3:.3g} mm would be more than {MOST_EDGES:,} edges on a circle")
        return self

    def _vein_segments(self, vein: RoundVein, size: float) -> int:
        """Return the (even) number of edges around a vein: short enough for arcs to stay within thin layers."""
        outer = vein.wall_outer
        size = min([size, *(2 * _gap(outer, other) for other in self.outer_walls if other != outer)])
        segments = 2 * pi * vein.lumen_radius / size
        if self.mesh.element != "mixed":
            # in a layer of thickness t on radius r, the diagonal of an edge clears the arc if t / r > 2 (pi / n)^2
            circles = [outer, *(circle for circle, _ in vein.layers(self.mesh))]
            thinnest = min((outer.radius - inner.radius) / inner.radius for outer, inner in pairwise(circles))
            segments = max(segments, pi * sqrt(3 / thinnest))
        return 2 * max(4, ceil(segments / 2))

    def _segments(self, circle: Circle, near: float, far: float) -> int:
        """Return the number of edges on a circle: elements grow with the distance to veins, gaps are resolved."""
        others = [c for c in (self.skin, *self.bones, *self.outer_walls) if c != circle]
        to_vein = min(_gap(circle, outer) for outer in self.outer_walls)
        size = min(far, near + 0.5 * to_vein, *(2 * _gap(circle, c) for c in others))
        return max(8, ceil(2 * pi * circle.radius / size))


def smooth_step(t: Any) -> Any:
    """Rise from 0 at t = 0 to 1 at t = 1, twice differentiable at both."""
    return t * t * t * (10 - 15 * t + 6 * t * t)


def _gap(a: Circle, b: Circle) -> float:
    """Return the distance between two circles, one beside or inside the other."""
    distance = hypot(a.x - b.x, a.y - b.y)
    return max(distance - a.radius - b.radius, abs(a.radius - b.radius) - distance)


def _collision(a: Circle, b: Circle, gap: float) -> str:
    parts = f"{a.name} and {b.name}".replace("wall_outer_", "wall of vein ").replace("wall_outer", "vein wall")
    where = "; ".join(
        f"{circle.name} of radius {circle.radius * 1e3:g} mm at ({circle.x * 1e3:g}, {circle.y * 1e3:g}) mm"
        for circle in (a, b)
    )
    if gap <= 0:
        return f"{parts} overlap by {-gap * 1e3:.3g} mm: {where}"
    return f"{parts} are {gap * 1e3:.3g} mm apart, at least {NARROWEST_GAP * 1e3:g} mm are needed: {where}"
