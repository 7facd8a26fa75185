"""A straight vein in the middle of a cylinder of tissue, without bones: the plain case for tests and verification."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from pydantic import Field, model_validator

from ngfsi.units import Length
from ngfsi_geometry.plane import Ellipse, Ring, SectionMesh, Star, even_angles
from ngfsi_geometry.segment import MeshSettings, VeinSegment


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

    @property
    def tissues(self) -> tuple[str, ...]:
        """There are none."""
        return ()

    @property
    def skin_radius(self) -> float:
        """Outer radius of the wall [m]."""
        return self.lumen_radius + self.wall_thickness

    @property
    def skin(self) -> Ellipse:
        """Outer surface of the wall."""
        return replace(self.wall_outer, name="skin")

    def _section(self, factor: float, curves: Mapping[str, Star]) -> SectionMesh:  # noqa: ARG002 - circles
        """Return the mesh of the cross-section, its element sizes multiplied by a factor."""
        (vein,) = self.veins
        angles = even_angles(self._vein_segments(vein, self.mesh.vein_size * factor))
        rim = Ring(self.skin, np.arange(len(angles), dtype=np.int32), "wall", None)
        outline = SectionMesh(self.skin.points(angles), [], [rim])
        return self._filled(outline, vein, self.skin.name)

    @model_validator(mode="after")
    def _check_positions(self) -> BareTube:
        """Accept any size: there is nothing beside the wall."""
        if self.sheath_thickness:
            raise ValueError("a tube of wall alone has no sheath: leave out sheath_thickness, or use the type tube")
        if self.fat:
            raise ValueError("a tube of wall alone has no fat: leave out fat, or use the type tube")
        return self
