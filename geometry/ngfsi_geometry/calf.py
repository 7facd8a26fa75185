"""A segment of the calf: straight deep veins in soft tissue around rigid tibia and fibula.

Axes: x lateral, y anterior, z proximal; the origin is the centre of the circular skin. The defaults draw a section at
mid-calf. Sizes of vein and segment are those of the source study (12 cm, lumen 11.1 mm, wall 1 mm); bones and skin,
of which the study prints no sizes, are circles of usual adult size placed as in an anatomical section.
"""

from __future__ import annotations

from collections.abc import Callable
from math import hypot, pi
from typing import Any, ClassVar

import numpy as np
from pydantic import Field, model_validator

from ngfsi.config.model import ConfigModel
from ngfsi.errors import GeometryError, NgfsiError
from ngfsi.mesh.curving import BoundaryMotion
from ngfsi.units import Length
from ngfsi_geometry.plane import Ellipse
from ngfsi_geometry.segment import StraightVein, VeinSegment, smooth_step

STILL = 0.15
"""The taper leaves alone this part of the way from the vein wall, and from each bone, to the skin."""

SMALLEST_DET = 0.2
"""Least determinant of the taper's map that is accepted."""


class CalfVein(ConfigModel):
    """A further vein beside the first, along z as that."""

    refusal: ClassVar[type[NgfsiError]] = GeometryError

    lumen_diameter: Length = Field(gt=0, description="inner diameter")
    wall_thickness: Length = Field(1e-3, gt=0, description="thickness of the wall; source study: 1 mm")
    x: Length = Field(description="lateral position of the axis")
    y: Length = Field(description="anterior position of the axis")


class CalfSegment(VeinSegment):
    """Calf segment with regions tissue, wall and fluid; the bones are holes with the boundaries tibia and fibula.

    Regions and boundaries of further veins end in their number: wall_2, fluid_2, interface_2, inlet_2 and so on.
    """

    vein_x: Length = Field(8e-3, description="lateral position of the vein: just medial to the fibula (peroneal vein)")
    vein_y: Length = Field(-6e-3, description="anterior position of the vein: behind the line through the two bones")
    tibia_diameter: Length = Field(25e-3, gt=0, description="tibia; the circle has 490 mm2, about that of the shaft")
    tibia_x: Length = Field(-21e-3, description="lateral position of the tibia: on the medial side")
    tibia_y: Length = Field(28e-3, description="anterior position of the tibia: its face 7.5 mm below the skin")
    fibula_diameter: Length = Field(14e-3, gt=0, description="fibula; the shaft is 12 to 15 mm wide in adults")
    fibula_x: Length = Field(20e-3, description="lateral position of the fibula: lateral, deep below the muscles")
    fibula_y: Length = Field(6e-3, description="anterior position of the fibula: behind the tibia")
    skin_radius_distal: Length = Field(55e-3, gt=0, description="skin at z = 0; mid-calf circumference 35 cm")
    skin_radius_proximal: Length = Field(55e-3, gt=0, description="skin at z = length; linear taper between the ends")
    further_veins: tuple[CalfVein, ...] = ()
    """Veins beside the first; what else is said of the vein, such as its `aspect_ratio`, is said of the first."""

    @property
    def veins(self) -> tuple[StraightVein, ...]:
        """All veins, the first one of `lumen_diameter` at (`vein_x`, `vein_y`)."""
        further = enumerate(self.further_veins, start=2)
        others = (
            StraightVein(k, v.x, v.y, v.lumen_diameter / 2, v.wall_thickness, hollow=self.hollow) for k, v in further
        )
        return *super().veins, *others

    @property
    def skin_radius(self) -> float:
        """Mean radius of the skin [m], that of the meshed cylinder."""
        return (self.skin_radius_distal + self.skin_radius_proximal) / 2

    @property
    def bones(self) -> tuple[Ellipse, ...]:
        """Cross-sections of tibia and fibula."""
        return (
            Ellipse("tibia", self.tibia_x, self.tibia_y, self.tibia_diameter / 2),
            Ellipse("fibula", self.fibula_x, self.fibula_y, self.fibula_diameter / 2),
        )

    @property
    def taper(self) -> float:
        """Half the change of the skin radius along the segment, relative to its mean."""
        return (self.skin_radius_proximal - self.skin_radius_distal) / (2 * self.skin_radius)

    def skin_volume(self) -> float:
        """Return the volume [m3] inside the skin, a truncated cone."""
        a, b = self.skin_radius_distal, self.skin_radius_proximal
        return pi * self.length * (a * a + a * b + b * b) / 3

    def shape_map(self) -> Any:
        """Return the displacement [m] that tapers the skin and makes the vein oval, None without either.

        The section is scaled in proportion to z, fully at the skin and not at all on and near vein and bones.
        """
        oval = super().shape_map()
        if self.taper == 0:
            return oval
        if oval is not None:
            return self._with_taper(oval)
        from ngsolve import CF, IfPos, sqrt, x, y, z

        def clip(t: Any) -> Any:
            return IfPos(t, IfPos(1 - t, t, 1), 0)

        return self._weight(x, y, clip, sqrt) * self.taper * (2 * z / self.length - 1) * CF((x, y, 0))

    def _with_taper(self, motion: BoundaryMotion) -> BoundaryMotion:
        from ngsolve import CF, x, y, z

        skin = self.taper * (2 * z / self.length - 1) * CF((x, y, 0))
        return BoundaryMotion({**motion.by_name, self.skin.name: skin})

    def _weight(self, x: Any, y: Any, clip: Callable[[Any], Any], root: Callable[[Any], Any]) -> Any:
        """Return the weight of the taper at (x, y), numbers, arrays or coefficient functions: twice differentiable."""
        weight: Any = 1.0
        for body in (*self.outermost, *self.bones):
            room = self.skin_radius - hypot(body.x, body.y) - body.semi_axes[0]
            distance = root((x - body.x) * (x - body.x) + (y - body.y) * (y - body.y)) - body.semi_axes[0]
            t = clip((distance / room - STILL) / (1 - STILL))
            weight = weight * smooth_step(t)
        return weight

    @model_validator(mode="after")
    def _check_taper(self) -> CalfSegment:
        """Refuse a taper that would squeeze the tissue to nothing between the skin and what it leaves alone."""
        radii, angles = np.meshgrid(np.linspace(0, self.skin_radius, 160), np.linspace(0, 2 * np.pi, 181))

        def weight(factor: float) -> Any:
            return self._weight(factor * radii * np.cos(angles), factor * radii * np.sin(angles), _clip, np.sqrt)

        here, along = weight(1.0), (weight(1 + 1e-6) - weight(1 - 1e-6)) / 2e-6  # derivative times radius
        dets = [(1 + s * here) * (1 + s * here + s * along) for s in (-self.taper, self.taper)]
        lowest = float(np.min(dets))
        if lowest < SMALLEST_DET:
            ends = f"{self.skin_radius_distal * 1e3:g} to {self.skin_radius_proximal * 1e3:g} mm"
            raise ValueError(
                f"the taper of the skin from {ends} leaves {max(lowest, 0.0):.0%} of the tissue where bone or vein are "
                f"nearest to it, at least {SMALLEST_DET:.0%} must remain: choose radii that differ less"
            )
        return self


def _clip(t: Any) -> Any:
    return np.clip(t, 0.0, 1.0)
