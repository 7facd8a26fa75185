"""A vein with a rigid wall through a stack of outlines, upstream of it a straight inlet that begins as a circle.

The mesh is that of a round tube of hexahedra and prisms, taken to the vein by a smooth map: in each section the
harmonic extension of the outline's Fourier series in its arc length, along the vein cubic splines of the coefficients.
"""

from __future__ import annotations

from functools import cached_property
from math import pi
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from ngfsi.config.model import ConfigModel
from ngfsi.errors import GeometryError, NgfsiError
from ngfsi.mesh.geometry import Vessel
from ngfsi.outlines.outline import Outline
from ngfsi.units import Length
from ngfsi_geometry.extrusion import extrude
from ngfsi_geometry.loft import Loft, coefficients
from ngfsi_geometry.plane import Ellipse, Ring, SectionMesh, even_angles, fill_vein
from ngfsi_geometry.segment import smooth_step

Array = NDArray[np.float64]


class LoftedMesh(ConfigModel):
    """How finely a lofted vein is meshed."""

    refusal: ClassVar[type[NgfsiError]] = GeometryError

    around: int = Field(16, ge=8, description="elements around the wall, even")
    layers: int = Field(16, ge=1, description="element layers along the stack")
    inlet_layers: int = Field(8, ge=1, description="element layers along the inlet extension")
    lumen_radii: tuple[float, ...] = Field((0.85, 0.6), description="layer boundaries in the lumen, as of MeshSettings")
    curving_order: int = Field(3, ge=1, le=8, description="polynomial order of the curved elements")


class LoftedVein(ConfigModel):
    """A rigid vein: region fluid, boundaries interface (the wall), inlet and outlet. z is proximal, downstream."""

    refusal: ClassVar[type[NgfsiError]] = GeometryError
    solids: ClassVar[tuple[str, ...]] = ()
    fluid: ClassVar[str] = "fluid"
    guarded: ClassVar[bool] = False

    outlines: tuple[Outline, ...] = Field(min_length=4, description="sections from distal to proximal")
    heights: tuple[Length, ...] = Field(description="their positions z")
    inlet_diameters: float = Field(6.0, ge=1, description="length of the inlet, in diameters; source study: 6")
    modes: int = Field(8, ge=1, le=24, description="Fourier modes kept of each outline")
    mesh: LoftedMesh = LoftedMesh()

    @model_validator(mode="after")
    def _check_stack(self) -> Self:
        """Refuse stacks that do not rise, and sections that jump."""
        if len(self.outlines) != len(self.heights):
            raise ValueError(f"a stack needs as many heights as outlines: {len(self.heights)}, {len(self.outlines)}")
        steps = np.diff(self.heights)
        if not np.all(steps > 0):
            number = int(np.argmin(steps)) + 2
            raise ValueError(f"the heights of a stack must increase, section {number} does not: sort the slices")
        for number, (low, high) in enumerate(zip(self.outlines[:-1], self.outlines[1:], strict=True), start=2):
            moved = float(np.linalg.norm(high.centroid - low.centroid))
            if moved > 2 * np.sqrt(low.area / pi):
                raise ValueError(
                    f"section {number} lies {1e3 * moved:.1f} mm beside the one before: is it another vein?"
                )
        return self

    @property
    def length(self) -> float:
        """Length of the stack [m], without the inlet."""
        return self.heights[-1] - self.heights[0]

    @cached_property
    def size(self) -> float:
        """Radius [m] of the circle with the first section's area, of which the meshed tube is."""
        return float(np.sqrt(self.outlines[0].area / pi))

    @property
    def inlet_length(self) -> float:
        """Length [m] of the inlet, which lies before the first section."""
        return self.inlet_diameters * 2 * self.size

    @property
    def vessels(self) -> tuple[Vessel, ...]:
        """The vein; its line is that of the stack, without the inlet, along which sections of the tube stay plane."""
        ends = self.inlet_length, self.inlet_length + self.length
        line = (0.0, 0.0, ends[0]), (0.0, 0.0, ends[1])
        return (Vessel(wall=None, outer=None, centreline=line, radius=self.size),)

    @property
    def rigid_names(self) -> tuple[str, ...]:
        """Boundaries that are fixed in space."""
        return ("interface",)

    @property
    def boundary_names(self) -> tuple[str, ...]:
        """Every boundary the mesh must have, curved ones first."""
        return "interface", "inlet", "outlet"

    @property
    def internal_names(self) -> tuple[str, ...]:
        """Boundaries inside of the lumen, between layers of elements."""
        return ("lumen_layer",)

    @property
    def curving_order(self) -> int:
        """Polynomial order of the curved mesh."""
        return self.mesh.curving_order

    def inflow(self) -> Any:
        """Return the developed velocity of unit mean through the round inlet."""
        from ngsolve import CF, x, y

        x0, y0 = self.outlines[0].centroid
        return CF((0, 0, 2 * (1 - ((x - x0) ** 2 + (y - y0) ** 2) / self.size**2)))

    @cached_property
    def _loft(self) -> Loft:
        """The vein's surface, inlet included."""
        stack = [coefficients(outline, self.modes) for outline in self.outlines]
        circle = np.zeros(2 * self.modes + 1, dtype=complex)
        circle[self.modes], circle[self.modes + 1] = complex(*self.outlines[0].centroid), self.size
        start, extent = self.heights[0], self.inlet_length
        # round for a third of the inlet, then over to the first section's shape by two thirds
        before = [
            (start - extent * (1 - s), smooth_step(min(max(3 * s - 1, 0.0), 1.0))) for s in np.linspace(0, 1, 25)[:-1]
        ]
        z = np.array([place for place, _ in before] + list(self.heights))
        return Loft(z, [(1 - fraction) * circle + fraction * stack[0] for _, fraction in before] + stack)

    def areas(self, z: Array) -> Array:
        """Return the areas (n,) [m2] of the sections at z [m]."""
        return self._loft.areas(z)

    @property
    def volume(self) -> float:
        """Volume [m3] of the stack, without the inlet."""
        return self._loft.volume(self.heights[0])

    def exact_volumes(self) -> dict[str, float]:
        """Return the volume [m3] of the blood, inlet included."""
        return {"fluid": self._loft.volume()}

    def shape_map(self) -> Any:
        """Return the displacement [m] from the round tube to the vein."""
        import ngsolve as ng

        start = self._loft.start  # the tube begins at 0
        x, y = self._loft.position((ng.x / self.size, ng.y / self.size), ng.z + start)
        return ng.CF((x - ng.x, y - ng.y, start)).Compile()

    def mesh_attempts(self) -> tuple[str, ...]:
        """Return the one way to mesh."""
        return ("the given numbers of elements",)

    def netgen_mesh(self, attempt: int = 0) -> Any:  # noqa: ARG002 - there is one way
        """Return the straight Netgen mesh [m] of the round tube with its geometry and names."""
        angles = even_angles(self.mesh.around)
        wall = Ellipse("interface", 0.0, 0.0, self.size)
        rim = Ring(wall, np.arange(len(angles), dtype=np.int32), self.fluid, None)
        outline = SectionMesh(wall.points(angles), [], [rim])
        layers = [(Ellipse("lumen_layer", 0.0, 0.0, f * self.size), self.fluid) for f in self.mesh.lumen_radii]
        section = fill_vein(outline, wall.name, layers, self.fluid, split=False)
        start, first = self.heights[0] - self.inlet_length, self.heights[0]
        inlet = np.linspace(start, first, self.mesh.inlet_layers + 1)[:-1]
        heights = np.r_[inlet, np.linspace(first, self.heights[-1], self.mesh.layers + 1)]
        return extrude(section, heights - start, {self.fluid: ("inlet", "outlet")}, split=False)
