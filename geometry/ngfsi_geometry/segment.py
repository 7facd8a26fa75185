"""What all straight vein segments share: dimensions of vein and skin, checks, mesh sizes and the mesh itself."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from itertools import combinations, pairwise
from math import ceil, cos, hypot, pi, sin, sqrt
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from ngfsi.config.model import ConfigModel
from ngfsi.errors import GeometryError, NgfsiError
from ngfsi.units import Angle, Length
from ngfsi_geometry.extrusion import extrude, layer_heights
from ngfsi_geometry.plane import Circle, SectionMesh, even_angles, fill_vein, triangulate

END_NAMES = {
    "fluid": ("inlet", "outlet"),
    "wall": ("wall_bottom", "wall_top"),
    "tissue": ("tissue_bottom", "tissue_top"),
}
"""Region -> boundary names of its faces at z = 0 and z = length."""

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


class VeinSegment(ConfigModel):
    """A straight vein in a cylinder of tissue, from z = 0 (inlet) to z = length (outlet); base of the builders."""

    refusal: ClassVar[type[NgfsiError]] = GeometryError
    solids: ClassVar[tuple[str, ...]] = ("tissue", "wall")
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
        """Outer surface of the vein wall."""
        return self._around_vein("wall_outer", self.lumen_radius + self.wall_thickness)

    @property
    def boundary_names(self) -> tuple[str, ...]:
        """Every boundary the mesh must have, curved ones first."""
        ends = [name for pair in END_NAMES.values() for name in pair]
        return ("skin", *(bone.name for bone in self.bones), "wall_outer", "interface", *ends)

    @property
    def internal_names(self) -> tuple[str, ...]:
        """Boundaries inside a region that the mesh may have: surfaces between layers of elements."""
        return "lumen_layer", "wall_layer"

    def shape_map(self) -> Any:
        """Return the displacement [m] from the meshed shape to the reference shape, or None if they are the same.

        An oval vein: lumen and wall are stretched along one axis and compressed across, the tissue follows up to the
        next bone or the skin.
        """
        if self.oval == 0:
            return None
        from ngsolve import CF, IfPos, sqrt, x, y

        along, across = self._in_ellipse(x, y)
        share = self.oval / self.lumen_radius
        if self.wall_outer.radius < self.skin_radius:
            outside = (sqrt(along * along + across * across) - self.wall_outer.radius) / self._room()
            t = IfPos(outside, IfPos(1 - outside, 1 - outside, 0), 1)
            share = share * smooth_step(t)
        c, s = cos(self.oval_direction), sin(self.oval_direction)
        return share * CF((c * along + s * across, s * along - c * across, 0))

    def _in_ellipse(self, x: Any, y: Any) -> tuple[Any, Any]:
        """Return the coordinates along and across the longer axis of an oval vein, from its centre."""
        c, s = cos(self.oval_direction), sin(self.oval_direction)
        x, y = x - self.vein_x, y - self.vein_y
        return c * x + s * y, c * y - s * x

    def _room(self) -> float:
        """Return the smallest distance [m] of the vein's wall from bones and skin."""
        return min(_gap(self.wall_outer, other) for other in (*self.bones, self.skin))

    def exact_volumes(self) -> dict[str, float]:
        """Return the volume [m3] of each region."""
        area = {c.name: pi * c.radius**2 for c in (self.wall_outer, *self.bones)}
        ellipse = 1 - (self.oval / self.lumen_radius) ** 2
        area["wall_outer"] *= ellipse
        lumen = pi * self.lumen_radius**2 * ellipse
        tissue = self.skin_volume() - sum(area.values()) * self.length
        return {"tissue": tissue, "wall": (area["wall_outer"] - lumen) * self.length, "fluid": lumen * self.length}

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
        return extrude(section, heights, END_NAMES, split=self.mesh.element == "tetrahedron")

    def _section(self, factor: float) -> SectionMesh:
        """Return the mesh of the cross-section, its element sizes multiplied by a factor."""
        far, near = self.mesh.far_size * factor, self.mesh.vein_size * factor
        layers = self._vein_layers()
        loops = [(circle, even_angles(self._segments(circle, near, far))) for circle in (*self.bones, self.skin)]
        around = even_angles(self._vein_segments(near, [self.wall_outer, *(circle for circle, _ in layers)]))
        tissue = triangulate("tissue", [(self.wall_outer, around), *loops], far)
        return fill_vein(tissue, layers, self.fluid, split=self.mesh.element != "mixed")

    def _mesh_of_solids(self) -> Any:
        from ngfsi_geometry.csg import mesh_of_solids  # with Netgen's CSG, which nothing else needs

        lumen, tissue = self._around_vein("interface", self.lumen_radius), "tissue" in self.solids
        regions = {self.fluid: (lumen, ()), "wall": (self.wall_outer if tissue else self.skin, (lumen,))}
        if tissue:
            regions["tissue"] = (self.skin, (self.wall_outer, *self.bones))
        return mesh_of_solids(regions, END_NAMES, self.length)

    def _around_vein(self, name: str, radius: float) -> Circle:
        return Circle(name, self.vein_x, self.vein_y, radius)

    @model_validator(mode="after")
    def _check_positions(self) -> VeinSegment:
        """Refuse parts that overlap, leave the skin or nearly touch."""
        inner = (self.wall_outer, *self.bones)
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
        for circle, size in ((self.skin, self.mesh.far_size), (self.wall_outer, self.mesh.vein_size)):
            if 2 * pi * circle.radius > MOST_EDGES * size:
                raise ValueError(f"elements of {size * 1e3:.3g} mm would be more than {MOST_EDGES:,} edges on a circle")
        return self

    def _vein_segments(self, size: float, circles: Sequence[Circle]) -> int:
        """Return the (even) number of edges around the vein: short enough for arcs to stay within thin layers."""
        segments = 2 * pi * self.lumen_radius / size
        if self.mesh.element != "mixed":
            # in a layer of thickness t on radius r, the diagonal of an edge clears the arc if t / r > 2 (pi / n)^2
            thinnest = min((outer.radius - inner.radius) / inner.radius for outer, inner in pairwise(circles))
            segments = max(segments, pi * sqrt(3 / thinnest))
        return 2 * max(4, ceil(segments / 2))

    def _segments(self, circle: Circle, near: float, far: float) -> int:
        """Return the number of edges on a circle: elements grow with the distance to the vein, gaps are resolved."""
        others = [c for c in (self.skin, *self.bones, self.wall_outer) if c != circle]
        size = min(far, near + 0.5 * _gap(circle, self.wall_outer), *(2 * _gap(circle, c) for c in others))
        return max(8, ceil(2 * pi * circle.radius / size))

    def _vein_layers(self) -> list[tuple[Circle, str]]:
        """Return the circles inside the outer wall surface with the material outside each."""
        fractions = np.arange(self.mesh.wall_layers - 1, 0, -1) / self.mesh.wall_layers
        wall = [self._around_vein("wall_layer", self.lumen_radius + f * self.wall_thickness) for f in fractions]
        interface = self._around_vein("interface", self.lumen_radius)
        lumen = [self._around_vein("lumen_layer", f * self.lumen_radius) for f in self.mesh.lumen_radii]
        return [(c, "wall") for c in (*wall, interface)] + [(c, self.fluid) for c in lumen]


def smooth_step(t: Any) -> Any:
    """Rise from 0 at t = 0 to 1 at t = 1, twice differentiable at both."""
    return t * t * t * (10 - 15 * t + 6 * t * t)


def _gap(a: Circle, b: Circle) -> float:
    """Return the distance between two circles, one beside or inside the other."""
    distance = hypot(a.x - b.x, a.y - b.y)
    return max(distance - a.radius - b.radius, abs(a.radius - b.radius) - distance)


def _collision(a: Circle, b: Circle, gap: float) -> str:
    parts = f"{'vein wall' if a.name == 'wall_outer' else a.name} and {b.name}"
    where = "; ".join(
        f"{circle.name} of radius {circle.radius * 1e3:g} mm at ({circle.x * 1e3:g}, {circle.y * 1e3:g}) mm"
        for circle in (a, b)
    )
    if gap <= 0:
        return f"{parts} overlap by {-gap * 1e3:.3g} mm: {where}"
    return f"{parts} are {gap * 1e3:.3g} mm apart, at least {NARROWEST_GAP * 1e3:g} mm are needed: {where}"
