"""A straight vein in the middle of a cylinder of tissue, without bones: the plain case for tests and verification."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from pydantic import Field, model_validator

from ngfsi.units import Length
from ngfsi_geometry.plane import Ring, SectionMesh, even_angles, fill_vein
from ngfsi_geometry.segment import END_NAMES, MeshSettings, VeinSegment


class TubeSegment(VeinSegment):
    """Vein in a tissue cylinder; regions and boundaries as of the calf, without tibia and fibula."""

    length: Length = Field(50e-3, gt=0, description="length of the tube")
    outer_radius: Length = Field(20e-3, gt=0, description="radius of the tissue cylinder, whose surface is the skin")
    mesh: MeshSettings = MeshSettings(far_size=8e-3, vein_size=3.5e-3, axial_layers=4, lumen_radii=(0.7,))

    @property
    def skin_radius(self) -> float:
        """Radius of the skin [m]."""
        return self.outer_radius


class BareTube(TubeSegment):
    """A tube of wall alone, without tissue: its outer surface is the skin."""

    solids: ClassVar[tuple[str, ...]] = ("wall",)

    @property
    def skin_radius(self) -> float:
        """Outer radius of the wall [m]."""
        return self.lumen_radius + self.wall_thickness

    @property
    def boundary_names(self) -> tuple[str, ...]:
        """Every boundary the mesh must have, curved ones first."""
        there = super().boundary_names
        return tuple(name for name in there if name not in ("wall_outer", *END_NAMES["tissue"]))

    def exact_volumes(self) -> dict[str, float]:
        """Return the volume [m3] of each region."""
        return {name: volume for name, volume in super().exact_volumes().items() if name != "tissue"}

    def _section(self, factor: float) -> SectionMesh:
        """Return the mesh of the cross-section, its element sizes multiplied by a factor."""
        layers = self._vein_layers()
        size = self.mesh.vein_size * factor
        angles = even_angles(self._vein_segments(size, [self.skin, *(circle for circle, _ in layers)]))
        rim = Ring(self.skin, np.arange(len(angles), dtype=np.int32), "wall", None)
        outline = SectionMesh(self.skin.points(angles), [], [rim])
        return fill_vein(outline, layers, self.fluid, split=self.mesh.element != "mixed")

    @model_validator(mode="after")
    def _check_positions(self) -> BareTube:
        """Accept any size: there is nothing beside the wall."""
        return self
