"""A segment of the calf through stacks of outlines: skin, bones and one deep vein as images show them.

The mesh is that of a straight segment of circles (calf.py), whose surfaces are moved onto lofts of the
outlines; what is between follows by Laplace's equation, conforming and of the mesh's curving order. Ends are flat.
Axes: x lateral, y anterior, z proximal; the origin lies in the middle of the skin, at the height of the first outline.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations, pairwise
from math import hypot, pi
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from ngfsi.config.model import ConfigModel
from ngfsi.errors import GeometryError, NgfsiError
from ngfsi.mesh.curving import BoundaryMotion
from ngfsi.mesh.geometry import Vessel
from ngfsi.outlines.outline import Outline
from ngfsi.units import Length
from ngfsi_geometry.calf import CalfSegment
from ngfsi_geometry.calf_section import CalfSection, Vein
from ngfsi_geometry.loft import Complex, Loft, coefficients, thickened
from ngfsi_geometry.plane import Ellipse
from ngfsi_geometry.segment import MeshSettings

Array = NDArray[np.float64]

ANATOMY = ("skin", "tibia", "fibula", "lumen")
FEWEST = 4
"""Outlines that a stack needs."""
GAP = 2e-3
"""Between the circles of the straight segment, at least [m]; they are made smaller where outlines are nearer."""


@dataclass(frozen=True)
class Stack:
    """Outlines of skin, tibia, fibula and lumen from distal to proximal, and their heights [m].

    Attributes:
        first: number of the first of them in an image, for sentences.
    """

    outlines: Mapping[str, tuple[Outline, ...]]
    heights: tuple[float, ...]
    first: int = 0

    def check(self, wall_thickness: float) -> None:
        """Refuse stacks that make no calf.

        Raises:
            GeometryError: names the slice.
        """
        counts = {name: len(self.outlines[name]) for name in ANATOMY}
        if {*counts.values()} != {len(self.heights)} or len(self.heights) < FEWEST:
            listed = ", ".join(f"{count} of {name}" for name, count in counts.items())
            raise GeometryError(
                f"a lofted calf needs {FEWEST} outlines or more of each part and as many heights: there are "
                f"{len(self.heights)} heights, {listed}"
            )
        if np.any(np.diff(self.heights) <= 0):
            number = self.first + int(np.argmin(np.diff(self.heights))) + 1
            raise GeometryError(f"the heights of a stack must increase, that of slice {number} does not: sort them")
        for k in range(len(self.heights)):
            parts: dict[str, Any] = {name: self.outlines[name][k] for name in ANATOMY}
            try:
                CalfSection(veins=(Vein(lumen=parts.pop("lumen"), wall_thickness=wall_thickness),), **parts)
            except GeometryError as error:
                sentence = str(error).removeprefix(f"{CalfSection.__name__}: ")
                raise GeometryError(f"slice {self.first + k}: {sentence}") from None
        for name in ANATOMY:
            self._check_jumps(name)

    def _check_jumps(self, name: str) -> None:
        stack = self.outlines[name]
        for k, (low, high) in enumerate(pairwise(stack), start=self.first + 1):
            moved = float(np.linalg.norm(high.centroid - low.centroid))
            if moved > np.sqrt(low.area / pi):
                raise GeometryError(
                    f"slice {k}: '{name}' lies {1e3 * moved:.1f} mm beside that of the slice before, by more than its "
                    "radius: look whether both are the same part"
                )


class CalfLoft(ConfigModel):
    """Calf segment through outlines; regions and boundaries as of the geometry calf."""

    refusal: ClassVar[type[NgfsiError]] = GeometryError
    fluid: ClassVar[str] = CalfSegment.fluid

    wall_thickness: Length = Field(1e-3, gt=0, description="thickness of the vein wall; source study: 1 mm")
    modes: int = Field(8, ge=1, le=24, description="Fourier modes kept of each outline")
    pieces: int = Field(6, ge=1, description="pieces of the splines along z that fit the outlines by least squares")
    mesh: MeshSettings = MeshSettings()

    @property
    @abstractmethod
    def stack(self) -> Stack:
        """The outlines."""

    @model_validator(mode="after")
    def _check_stack(self) -> Self:
        self.stack.check(self.wall_thickness)
        _ = self.straight
        return self

    @cached_property
    def _lofts(self) -> dict[str, Loft]:
        """Surfaces by the name of their boundary, around the origin."""
        stack = self.stack
        rows = {name: [coefficients(o, self.modes) for o in stack.outlines[name]] for name in ANATOMY}
        rows["interface"] = rows.pop("lumen")
        rows["wall_outer"] = [thickened(row, self.wall_thickness) for row in rows["interface"]]
        z = np.array(stack.heights) - stack.heights[0]
        middle = _middle(Loft(z, rows["skin"], self.pieces))[1]

        def moved(row: Complex) -> Complex:
            row = row.copy()
            row[self.modes] -= middle
            return row

        return {name: Loft(z, [moved(row) for row in stacked], self.pieces) for name, stacked in rows.items()}

    @cached_property
    def straight(self) -> CalfSegment:
        """The straight segment that is meshed: circles of the mean areas about the mean axes, apart from each other."""
        circles = {}
        for name, loft in self._lofts.items():
            area, middle = _middle(loft)
            circles[name] = Ellipse(name, middle.real, middle.imag, float(np.sqrt(area / pi)))
        skin, lumen = circles.pop("skin"), circles.pop("interface")
        fraction = _fraction(list(circles.values()), skin)
        inner = {name: replace(circle, radius=fraction * circle.radius) for name, circle in circles.items()}
        tibia, fibula, outer = (inner[name] for name in ("tibia", "fibula", "wall_outer"))
        return CalfSegment(
            length=self.length, lumen_diameter=2 * fraction * lumen.radius, mesh=self.mesh,
            wall_thickness=outer.radius - fraction * lumen.radius, vein_x=outer.x, vein_y=outer.y,
            skin_radius_distal=skin.radius, skin_radius_proximal=skin.radius,
            tibia_x=tibia.x, tibia_y=tibia.y, tibia_diameter=2 * tibia.radius,
            fibula_x=fibula.x, fibula_y=fibula.y, fibula_diameter=2 * fibula.radius,
        )  # fmt: skip

    @property
    def length(self) -> float:
        """Length of the segment [m]."""
        return self.stack.heights[-1] - self.stack.heights[0]

    @property
    def lumen_radius(self) -> float:
        """Radius [m] of the circle with the mean area of the lumen."""
        return float(np.sqrt(_middle(self._lofts["interface"])[0] / pi))

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
        return self.straight.solids

    @property
    def vessels(self) -> tuple[Vessel, ...]:
        """The vein, in the straight mesh."""
        return tuple(replace(vessel, radius=self.lumen_radius) for vessel in self.straight.vessels)

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
        """Return the volume [m3] of each region between the lofts."""
        inside = {name: loft.volume() for name, loft in self._lofts.items()}
        tissue = inside["skin"] - inside["tibia"] - inside["fibula"] - inside["wall_outer"]
        return {"tissue": tissue, "wall": inside["wall_outer"] - inside["interface"], "fluid": inside["interface"]}

    def mesh_attempts(self) -> tuple[str, ...]:
        """Return a description of each way to mesh this segment, in the order to be tried."""
        return self.straight.mesh_attempts()

    def netgen_mesh(self, attempt: int = 0) -> Any:
        """Return the Netgen mesh [m] of the straight segment; attempt: index in `mesh_attempts`."""
        return self.straight.netgen_mesh(attempt)

    def shape_map(self) -> BoundaryMotion:
        """Return the displacement [m] of the straight segment's surfaces to the lofts."""
        import ngsolve as ng

        circles = {c.name: c for c in (self.straight.skin, self.straight.wall_outer, *self.straight.bones)}
        circles["interface"] = circles["wall_outer"]
        motions = {}
        for name, loft in self._lofts.items():
            across = ng.x - circles[name].x, ng.y - circles[name].y
            radius = ng.sqrt(across[0] ** 2 + across[1] ** 2)
            x, y = loft.position((across[0] / radius, across[1] / radius), ng.z)
            motions[name] = ng.CF((x - ng.x, y - ng.y, 0.0)).Compile()
        return BoundaryMotion(motions)

    def inflow(self) -> None:
        """Return nothing: the developed profile in a section of any shape is found on the mesh."""


class LoftedCalf(CalfLoft):
    """Calf segment through given outlines."""

    skin: tuple[Outline, ...]
    tibia: tuple[Outline, ...]
    fibula: tuple[Outline, ...]
    lumen: tuple[Outline, ...]
    heights: tuple[Length, ...] = Field(description="positions z of the outlines, from distal to proximal")
    first_slice: int = Field(0, ge=0, description="number of the first outline in the image, for sentences")

    @cached_property
    def stack(self) -> Stack:
        """The outlines."""
        return Stack({name: getattr(self, name) for name in ANATOMY}, self.heights, self.first_slice)


def _middle(loft: Loft) -> tuple[float, complex]:
    """Return the mean area [m2] of the sections along z, and the mean of their middles x + iy [m]."""
    rows = loft.at(np.linspace(loft.start, loft.end, 65))
    return loft.volume() / (loft.end - loft.start), complex(np.mean(rows[:, loft.modes]))


def _fraction(inner: list[Ellipse], skin: Ellipse) -> float:
    """Return the factor on the radii of circles, at most 1, with which they leave the gap between them."""
    fractions = [(hypot(a.x - b.x, a.y - b.y) - GAP) / (a.radius + b.radius) for a, b in combinations(inner, 2)]
    fractions += [(skin.radius - hypot(a.x - skin.x, a.y - skin.y) - GAP) / a.radius for a in inner]
    return min(1.0, *fractions)
