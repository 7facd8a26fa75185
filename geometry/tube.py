"""A straight vein in the middle of a cylinder of tissue, without bones: the plain case for tests and verification."""

from __future__ import annotations

from pydantic import Field

from geometry.segment import MeshSettings, VeinSegment
from ngfsi.units import Length


class TubeSegment(VeinSegment):
    """Vein in a tissue cylinder; regions and boundaries as of the calf, without tibia and fibula."""

    length: Length = Field(50e-3, gt=0, description="length of the tube")
    outer_radius: Length = Field(20e-3, gt=0, description="radius of the tissue cylinder, whose surface is the skin")
    mesh: MeshSettings = MeshSettings(far_size=8e-3, vein_size=3.5e-3, axial_layers=4, lumen_radii=(0.7,))

    @property
    def skin_radius(self) -> float:
        """Radius of the skin [m]."""
        return self.outer_radius
