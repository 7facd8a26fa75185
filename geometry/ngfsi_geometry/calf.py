"""A segment of the calf: straight deep veins in soft tissue around rigid tibia and fibula.

Axes: x lateral, y anterior, z proximal; the origin is the centre of the circular skin. The defaults draw a section at
mid-calf. Sizes of vein and segment are those of the source study (12 cm, lumen 11.1 mm, wall 1 mm); bones and skin,
of which the study prints no sizes, are circles of usual adult size placed as in an anatomical section.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import atan2, cos, hypot, pi, radians, sin, sqrt
from typing import Any, ClassVar

import numpy as np
from pydantic import Field, model_validator

from ngfsi.config.model import ConfigModel
from ngfsi.errors import GeometryError, NgfsiError
from ngfsi.mesh.curving import BoundaryMotion
from ngfsi.mesh.geometry import COMPARTMENTS
from ngfsi.units import Angle, Length
from ngfsi_geometry.plane import Curve, Ellipse, Indices, Line, Points, even_angles, within
from ngfsi_geometry.segment import FINE_ANGLES, NARROWEST_GAP, StraightVein, VeinSegment, smooth_step

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


class Compartments(ConfigModel):
    """The four compartments of the calf, parted by plane septa from the bones to each other and to the fascia.

    Drawn after anatomical sections at mid-calf, as the bones: the deep posterior compartment lies between and behind
    these, the peroneal vein behind it in the superficial one. All angles are directions from the middle of a bone, from
    x (lateral) to y (anterior).
    """

    refusal: ClassVar[type[NgfsiError]] = GeometryError

    anterior_septum: Angle = Field(radians(60), description="anterior intermuscular septum, from the fibula outwards")
    posterior_septum: Angle = Field(
        radians(-35), description="posterior intermuscular septum, from the fibula outwards"
    )
    tibial_septum: Angle = Field(
        radians(127), description="where muscle in front of the tibia ends, at its face under the skin"
    )
    deep_at_tibia: Angle = Field(radians(250), description="where the transverse septum leaves the tibia")
    deep_at_fibula: Angle = Field(radians(180), description="where the transverse septum leaves the fibula")
    deep_corner: tuple[Length, Length] = Field(
        (-14e-3, -3e-3), description="(x, y) where the transverse septum bends between them"
    )


@dataclass(frozen=True)
class Septum:
    """A plane border between tissues, or two: from a bone, at an angle, to another or to the fascia, at an angle."""

    name: str
    bone: Ellipse
    angle: float
    other: Ellipse
    other_angle: float
    corners: tuple[tuple[float, float], ...] = ()

    @property
    def line(self) -> Points:
        """Beginning, corners and end (n, 2) [m]."""
        begin, end = self.bone.points(np.array([self.angle])), self.other.points(np.array([self.other_angle]))
        return np.vstack([begin, *self.corners, end])

    @property
    def places(self) -> Points:
        """Points (n, 2) [m] all along."""
        return np.vstack([a + np.linspace(0, 1, 50)[:, None] * (b - a) for a, b in pairwise(self.line)])


class CalfSegment(VeinSegment):
    """Calf segment with regions tissue, wall and fluid; the bones are holes with the boundaries tibia and fibula.

    With `compartments` there are anterior, lateral, superficial_posterior and deep_posterior in the place of tissue.
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
    compartments: Compartments | None = Field(None, description="regions in the place of the tissue, and their septa")
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
    def tissues(self) -> tuple[str, ...]:
        """Names of the regions around the veins."""
        return COMPARTMENTS if self.compartments else super().tissues

    @property
    def septa(self) -> tuple[str, ...]:
        """Names of plane borders between tissues."""
        return tuple(septum.name for septum in self._septa)

    @property
    def _septa(self) -> tuple[Septum, ...]:
        if not self.compartments:
            return ()
        given, (tibia, fibula) = self.compartments, self.bones
        across = atan2(fibula.y - tibia.y, fibula.x - tibia.x)
        outwards = (("anterior_septum", fibula), ("posterior_septum", fibula), ("tibial_septum", tibia))
        return (
            Septum("interosseous_membrane", tibia, across, fibula, across + pi),
            Septum("transverse_septum", tibia, given.deep_at_tibia, fibula, given.deep_at_fibula, (given.deep_corner,)),
            *(Septum(name, bone, getattr(given, name), self.fascia, self._outwards(bone, getattr(given, name)))
              for name, bone in outwards),
        )  # fmt: skip

    def _outwards(self, bone: Ellipse, angle: float) -> float:
        """Return the angle around the axis at which a ray from the middle of a bone meets the fascia."""
        along = bone.x * cos(angle) + bone.y * sin(angle)
        far = sqrt(along**2 + self.fascia.radius**2 - bone.x**2 - bone.y**2) - along
        return atan2(bone.y + far * sin(angle), bone.x + far * cos(angle))

    def _tissue_at(self, points: Points) -> Indices:
        """Return the number of the tissue, from 1, that is or would be at points of the section."""
        if not self.compartments:
            return super()._tissue_at(points)
        (tibia, fibula), far = self.bones, 4 * self.skin_radius
        given = self.compartments

        def ray(bone: Ellipse, *angles: float) -> list[tuple[float, float]]:
            return [(bone.x + far * cos(angle), bone.y + far * sin(angle)) for angle in angles]

        _, transverse, *_ = self._septa
        middles = [(bone.x, bone.y) for bone in (tibia, fibula)]
        front, behind, inner = given.anterior_septum, given.posterior_septum, given.tibial_septum
        corners = {
            "anterior": [*middles, *ray(fibula, front, front + _between(front, inner) / 2), *ray(tibia, inner)],
            "lateral": [middles[1], *ray(fibula, behind, behind + _between(behind, front) / 2, front)],
            "deep_posterior": [*middles, *transverse.line[::-1]],
        }
        found = np.full(len(points), 1 + COMPARTMENTS.index("superficial_posterior"), dtype=np.int32)
        for name, polygon in corners.items():
            found[within(points, np.array(polygon))] = 1 + COMPARTMENTS.index(name)
        return found

    def _lines(self, loops: list[tuple[Curve, Points]], near: float, far: float) -> list[Line]:
        """Return the septa, and move nodes of the loops to where they end."""
        places = {curve.name: k for k, (curve, _) in enumerate(loops)}
        taken: set[tuple[int, int]] = set()

        def node(curve: Ellipse, angle: float) -> tuple[int, int]:
            k = places[curve.name]
            angles = loops[k][1]
            away = np.abs(np.mod(angles - angle + pi, 2 * pi) - pi)
            n = next(n for n in np.argsort(away).tolist() if (k, n) not in taken)
            angles[n] += np.mod(angle - angles[n] + pi, 2 * pi) - pi
            taken.add((k, n))
            return k, n

        found = []
        for septum in self._septa:
            to_vein = min(float(np.hypot(*(septum.places[:, None] - vein.points(even_angles(60))[None]).T).min())
                          for vein in self.outermost)  # fmt: skip
            ends = node(septum.bone, septum.angle), node(septum.other, septum.other_angle)
            found.append(Line(septum.name, *ends, septum.corners, min(far, near + 0.5 * to_vein)))
        return found

    @model_validator(mode="after")
    def _check_septa(self) -> CalfSegment:
        """Refuse septa that meet veins, bones or each other where they do not begin or end."""
        for k, septum in enumerate(self._septa):
            inner = [*self.outermost, *(bone for bone in self.bones if bone not in (septum.bone, septum.other))]
            bodies = {body.name: body.points(even_angles(FINE_ANGLES)) for body in inner}
            bodies |= {other.name: other.places for other in self._septa[:k]}
            for name, its in bodies.items():
                gap = float(np.hypot(*(septum.places[:, None] - its[None]).T).min())
                if gap < NARROWEST_GAP:
                    raise ValueError(
                        f"compartments: {septum.name} and {name} are {gap * 1e3:.2g} mm apart, at least "
                        f"{NARROWEST_GAP * 1e3:g} mm are needed: change the angles of the septa"
                    )
        return self

    def _volumes_around(self, holes: Sequence[float]) -> dict[str, float]:
        """Return the volumes [m3] of tissues and fat around veins of given areas [m2]; of compartments that the taper
        changes there are none in closed form."""
        found = super()._volumes_around(holes)
        if not self.compartments:
            return found
        whole = found.pop("tissue")
        if self.taper:
            return found
        of_veins = {name: 0.0 for name in COMPARTMENTS}
        for vein, area in zip(self.veins, holes, strict=True):
            of_veins[COMPARTMENTS[int(self._tissue_at(np.array([[vein.x, vein.y]]))[0]) - 1]] += area
        areas = self._areas()
        volumes = {name: (area - of_veins[name]) * self.length for name, area in areas.items()}
        return {**volumes, "superficial_posterior": whole - sum(volumes.values()), **found}

    def _areas(self) -> dict[str, float]:
        """Return the areas [m2] inside the borders of three compartments, by Green's theorem along lines and arcs."""
        between, transverse, front, behind, inner = self._septa
        (tibia, fibula), outer = self.bones, self.fascia

        def line(septum: Septum, *, back: bool = False) -> float:
            points = septum.line[::-1] if back else septum.line
            return sum(float(a * d - b * c) / 2 for (a, b), (c, d) in pairwise(points))

        def arc(circle: Ellipse, begin: float, end: float, sense: int) -> float:
            turn = sense * ((sense * (end - begin)) % (2 * pi))
            (a, b), (c, d) = circle.points(np.array([begin, end]))
            return float(circle.radius**2 * turn + circle.x * (d - b) - circle.y * (c - a)) / 2

        return {
            "anterior": line(between) + arc(fibula, between.other_angle, front.angle, -1) + line(front)
            + arc(outer, front.other_angle, inner.other_angle, 1) + line(inner, back=True)
            + arc(tibia, inner.angle, between.angle, -1),
            "lateral": arc(fibula, front.angle, behind.angle, -1) + line(behind)
            + arc(outer, behind.other_angle, front.other_angle, 1) + line(front, back=True),
            "deep_posterior": line(transverse) + arc(fibula, transverse.other_angle, between.other_angle, -1)
            + line(between, back=True) + arc(tibia, between.angle, transverse.angle, -1),
        }  # fmt: skip

    def fascia_volume(self) -> float:
        """Return the volume [m3] inside the fascia, which the taper moves in part."""
        if not self.fat:
            return self.skin_volume()
        x, y = self.fascia.points(even_angles(4 * FINE_ANGLES)).T
        moved = self._weight(x, y, _clip, np.sqrt) * self.taper
        return float(pi * self.fascia.radius**2 * self.length * np.mean(1 + moved**2 / 3))

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
        import ngsolve as ng
        from ngsolve import CF, IfPos, x, y, z

        def clip(t: Any) -> Any:
            return IfPos(t, IfPos(1 - t, t, 1), 0)

        return self._weight(x, y, clip, ng.sqrt) * self.taper * (2 * z / self.length - 1) * CF((x, y, 0))

    def _with_taper(self, motion: BoundaryMotion) -> BoundaryMotion:
        from ngsolve import CF, x, y, z

        skin = self.taper * (2 * z / self.length - 1) * CF((x, y, 0))
        held = {name: field for name, field in motion.by_name.items() if name not in (self.fascia.name, *self.septa)}
        return BoundaryMotion({**held, self.skin.name: skin})

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


def _between(begin: float, end: float) -> float:
    """Return the angle [rad] from one direction to another, counter-clockwise."""
    return (end - begin) % (2 * pi)


def _clip(t: Any) -> Any:
    return np.clip(t, 0.0, 1.0)
