"""A cross-section of the calf from closed outlines: skin, bones, compartments, fascia and veins with their walls.

Axes: x lateral, y anterior. The lumens of the veins are holes, on which the blood presses, and so are the bones.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import cos, pi, sin
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from pydantic import Field, model_validator

from ngfsi.config.model import ConfigModel
from ngfsi.errors import GeometryError, NgfsiError
from ngfsi.mesh.geometry import COMPARTMENTS, Vessel
from ngfsi.outlines.outline import Outline
from ngfsi.units import Length
from ngfsi_geometry.channel import PlaneMesh, PlaneSection
from ngfsi_geometry.loft import parallel

NARROWEST_GAP = 0.5e-3
"""Outlines closer than this [m] are refused: what is between them could not be meshed sensibly."""

SIZE_FACTORS = (1.0, 0.8, 0.65)
"""Factors on the element sizes to be tried in turn if elements along curved outlines are inverted."""

SPLINE_POINTS = 4
"""Points handed to Netgen's spline for each given one, so that it follows ours."""
MOST_POINTS = 400


class Vein(ConfigModel):
    """A vein: outline of its lumen, and thickness of its wall."""

    refusal: ClassVar[type[NgfsiError]] = GeometryError

    lumen: Outline
    wall_thickness: Length = Field(0.8e-3, gt=0, description="thickness of the wall; source study, chapter 3: 0.8 mm")

    @property
    def outer(self) -> Outline:
        """Outer outline of the wall."""
        try:
            return self.lumen.offset(self.wall_thickness)
        except GeometryError:  # notches narrower than twice the wall
            return parallel(self.lumen, self.wall_thickness)


class SectionSizes(PlaneMesh):
    """How finely a cross-section is meshed."""

    far_size: Length = Field(9e-3, gt=0, description="element size far from bones and veins")
    bone_size: Length = Field(5e-3, gt=0, description="element size at the bones")
    vein_size: Length = Field(1.6e-3, gt=0, description="element size around the veins")
    curving_order: int = Field(3, ge=1, le=8, description="polynomial order of the curved elements")


class CalfSection(PlaneSection):
    """Cross-section with the regions tissue, wall, fat (with a fascia) and the compartments that have an outline.

    Tissue is what is in none of the others. Boundaries: skin, tibia, fibula, and for each vein lumen and wall_outer,
    the second vein's with _2 and so on. The first vein is the one that is studied.
    """

    fluid: ClassVar[str | None] = None

    skin: Outline
    tibia: Outline
    fibula: Outline
    veins: tuple[Vein, ...] = Field(min_length=1, description="veins, of which the first is the one that is studied")
    anterior: Outline | None = Field(None, description="outline of the anterior compartment")
    lateral: Outline | None = Field(None, description="outline of the lateral compartment")
    superficial_posterior: Outline | None = Field(None, description="outline of the superficial posterior compartment")
    deep_posterior: Outline | None = Field(None, description="outline of the deep posterior compartment")
    fascia: Outline | None = Field(None, description="outline inside which there is muscle, and outside fat")
    mesh: SectionSizes = SectionSizes()

    @classmethod
    def from_folder(cls, folder: Path, **more: Any) -> CalfSection:
        """Return the section whose outlines are CSV files: skin.csv, tibia.csv, vein.csv, vein_2.csv ...

        Raises:
            OutputError: a file is missing or cannot be read.
            GeometryError: the outlines contradict each other.
        """
        optional = [name for name in (*COMPARTMENTS, "fascia") if (folder / f"{name}.csv").exists()]
        outlines: dict[str, Any] = {
            n: Outline.from_csv(folder / f"{n}.csv") for n in ("skin", "tibia", "fibula", *optional)
        }
        files = [folder / "vein.csv", *sorted(folder.glob("vein_[0-9]*.csv"))]
        return cls(veins=tuple(Vein(lumen=Outline.from_csv(file)) for file in files), **outlines, **more)

    @property
    def solids(self) -> tuple[str, ...]:  # type: ignore[override] # which regions there are depends on the outlines
        """Names of the regions."""
        fat = ("fat",) if self.fascia else ()
        return "tissue", "wall", *fat, *(name for name in COMPARTMENTS if getattr(self, name))

    @property
    def rigid_names(self) -> tuple[str, ...]:
        """Boundaries that are fixed in space: the bones."""
        return "tibia", "fibula"

    @property
    def lumen_names(self) -> tuple[str, ...]:
        """Boundaries on which the blood presses, one for each vein."""
        return tuple(f"lumen{_suffix(k)}" for k in range(len(self.veins)))

    @property
    def vessels(self) -> tuple[Vessel, ...]:
        """All veins, which are holes."""
        return tuple(
            Vessel(
                name=f"vein{_suffix(k)}" if k else "", lumen=None, interface=name, outer=f"wall_outer{_suffix(k)}",
                inlets=(), outlets=(), radius=float(np.sqrt(vein.lumen.area / pi)),
            )
            for k, (name, vein) in enumerate(zip(self.lumen_names, self.veins, strict=True))
        )  # fmt: skip

    @property
    def boundary_names(self) -> tuple[str, ...]:
        """Every boundary the mesh must have."""
        outer = (f"wall_outer{_suffix(k)}" for k in range(len(self.veins)))
        return "skin", *self.rigid_names, *outer, *self.lumen_names

    @property
    def internal_names(self) -> tuple[str, ...]:
        """Boundaries between parts of the tissue."""
        return "fascia", *(f"{name}_edge" for name in COMPARTMENTS)

    @property
    def size(self) -> float:
        """Radius [m] of the circle with the area of the first vein's lumen."""
        return self.vessels[0].radius

    def inflow(self) -> Any:
        """Return nothing: there is no fluid."""
        return

    def exact_volumes(self) -> dict[str, float]:
        """Return the volume [m3] of the wall, 1 m deep; the other areas follow from where the outlines cross."""
        return {"wall": sum(vein.outer.area - vein.lumen.area for vein in self.veins)}

    def mesh_attempts(self) -> tuple[str, ...]:
        """Return a description of each way to mesh this section, in the order to be tried."""
        return tuple(f"element sizes x {factor:g}" for factor in SIZE_FACTORS)

    def netgen_mesh(self, attempt: int = 0) -> Any:
        """Return the straight Netgen mesh [m] with its geometry and names; attempt: index in `mesh_attempts`."""
        from netgen.occ import Glue, OCCGeometry

        given = {key: value * SIZE_FACTORS[attempt] for key, value in self.mesh if key.endswith("_size")}
        sizes = self.mesh.model_copy(update=given)
        skin = _face(self.skin, "skin", sizes.far_size)
        bones = [_face(getattr(self, name), name, sizes.bone_size) for name in self.rigid_names]
        lumens = [_face(v.lumen, f"lumen{_suffix(k)}", sizes.vein_size) for k, v in enumerate(self.veins)]
        outers = [_face(v.outer, f"wall_outer{_suffix(k)}", sizes.vein_size) for k, v in enumerate(self.veins)]
        inside = skin
        parts = []
        if self.fascia:
            inside = _face(self.fascia, "fascia", sizes.far_size)
            parts.append(_region(_without(skin, [inside, *bones]), "fat"))
        there = [name for name in COMPARTMENTS if getattr(self, name)]
        shapes = {name: _face(getattr(self, name), f"{name}_edge", sizes.far_size) for name in there}
        parts += [_region(_without(shape, [*bones, *outers]), name) for name, shape in shapes.items()]
        parts.append(_region(_without(inside, [*bones, *outers, *shapes.values()]), "tissue"))
        parts += [_region(outer - lumen, "wall") for outer, lumen in zip(outers, lumens, strict=True)]
        return OCCGeometry(Glue(parts), dim=2).GenerateMesh(maxh=sizes.far_size, grading=sizes.grading)

    @model_validator(mode="after")
    def _check_positions(self) -> CalfSection:
        """Refuse outlines that leave the skin, overlap or nearly touch."""
        inner = {"tibia": self.tibia, "fibula": self.fibula}
        inner |= {f"the wall of vein {k + 1}": vein.outer for k, vein in enumerate(self.veins)}
        if reason := touching(inner, self.skin):
            raise ValueError(reason)
        return self


def touching(inner: Mapping[str, Outline], skin: Outline) -> str | None:
    """Return a sentence about the first two of the parts inside of the skin that overlap, leave it or nearly touch."""
    named = list(inner.items())
    for k, (name, outline) in enumerate(named):
        for other, its in [*named[k + 1 :], ("skin", skin)]:
            gap = outline.distance_to(its)
            apart = not its.contains(outline.points[:1])[0] and not outline.contains(its.points[:1])[0]
            if gap < NARROWEST_GAP or apart is (other == "skin"):
                where = f"{1e3 * gap:.2g} mm apart" if apart is not (other == "skin") else "across each other"
                return (
                    f"{name} and {other} are {where}, near ({1e3 * outline.centroid[0]:.0f}, "
                    f"{1e3 * outline.centroid[1]:.0f}) mm: {1e3 * NARROWEST_GAP:g} mm of tissue must lie between"
                )
    return None


def _suffix(number: int) -> str:
    return f"_{number + 1}" if number else ""


def _face(outline: Outline, name: str, size: float) -> Any:
    """Return the face inside an outline, its edge named."""
    from netgen.occ import Face, Pnt, SplineInterpolation, Wire

    count = min(SPLINE_POINTS * len(outline.x), MOST_POINTS)
    edge = SplineInterpolation([Pnt(*point, 0) for point in outline.resampled(count)], periodic=True)
    edge.name, edge.maxh = name, size
    face = Face(Wire([edge]))
    face.edges.name, face.edges.maxh = name, size
    return face


def _without(shape: Any, holes: list[Any]) -> Any:
    for hole in holes:
        shape = shape - hole
    return shape


def _region(shape: Any, name: str) -> Any:
    shape.faces.name = name
    return shape


def subject(number: int, **more: Any) -> CalfSection:
    """Return a synthetic subject, 1 to 4: sections of different size, shape and vein, none of them of a person.

    Outlines are drawn after anatomical sections at mid-calf, as the sizes of geometry.calf: the tibia a rounded
    triangle with its flat face towards the skin, the deep posterior compartment between and behind the bones, the
    medial peroneal vein behind it beside its border; lumen and wall of the vein are those of chapter 3 of the study.

    Raises:
        GeometryError: there is no such subject.
    """
    if number not in SUBJECTS:
        raise GeometryError(f"there is no synthetic subject {number}: choose one of {', '.join(map(str, SUBJECTS))}")
    s = SUBJECTS[number]
    skin = _wavy(0.0, -4e-3, s["width"], s["depth"], {2: s["waist"], 3: s["calf"]})
    # the fibula lies 2 to 4 mm deeper in wide calves
    fibula = (0.45 * s["width"], 0.14 * s["depth"])
    vein = (s["vein_x"], s["vein_y"])
    outlines = {
        "skin": skin,
        "tibia": _polygon((-0.27 * s["width"], 0.42 * s["depth"]), s["tibia"], (100, 215, 335), 0.16),
        "fibula": _wavy(*fibula, s["fibula"], 0.85 * s["fibula"], {3: 0.06}),
        "deep_posterior": _ellipse(0.05 * s["width"], 0.04 * s["depth"], 0.36 * s["width"], 0.155 * s["depth"], -8),
        "anterior": _ellipse(0.27 * s["width"], 0.52 * s["depth"], 0.26 * s["width"], 0.18 * s["depth"], -38),
        "lateral": _ellipse(0.71 * s["width"], 0.12 * s["depth"], 0.11 * s["width"], 0.26 * s["depth"], 8),
    }
    given = {"veins": (Vein(lumen=Outline.circle(*vein, s["lumen"])),), **outlines}
    return CalfSection(**{**given, **more})


SUBJECTS: dict[int, dict[str, float]] = {
    1: {"width": 52e-3, "depth": 57e-3, "waist": 0.02, "calf": 0.02, "tibia": 14e-3, "fibula": 7e-3,
        "lumen": 4e-3, "vein_x": 12e-3, "vein_y": -15e-3},
    2: {"width": 57e-3, "depth": 56e-3, "waist": 0.0, "calf": 0.04, "tibia": 15e-3, "fibula": 7.5e-3,
        "lumen": 4e-3, "vein_x": 16e-3, "vein_y": -16e-3},
    3: {"width": 47e-3, "depth": 54e-3, "waist": 0.03, "calf": -0.02, "tibia": 14e-3, "fibula": 6.5e-3,
        "lumen": 4e-3, "vein_x": 7e-3, "vein_y": -14e-3},
    4: {"width": 60e-3, "depth": 61e-3, "waist": -0.02, "calf": 0.03, "tibia": 15e-3, "fibula": 8e-3,
        "lumen": 4e-3, "vein_x": 17e-3, "vein_y": -18e-3},
}  # fmt: skip


def _wavy(x: float, y: float, width: float, depth: float, waves: dict[int, float], points: int = 36) -> Outline:
    """Return an ellipse (half axes in m) whose radius is modulated by cos(n angle + n)."""
    ring = []
    for angle in _angles(points):
        factor = 1 + sum(size * cos(n * angle + n) for n, size in waves.items())
        ring.append((x + factor * width * cos(angle), y + factor * depth * sin(angle)))
    return Outline.through(np.array(ring))


def _ellipse(x: float, y: float, a: float, b: float, degrees: float, points: int = 28) -> Outline:
    """Return an ellipse with half axes (m) turned by degrees."""
    c, s = cos(pi * degrees / 180), sin(pi * degrees / 180)
    turned = [(a * cos(t), b * sin(t)) for t in _angles(points)]
    return Outline.through(np.array([(x + c * u - s * v, y + s * u + c * v) for u, v in turned]))


def _polygon(centre: tuple[float, float], radius: float, corners: tuple[float, ...], rounding: float) -> Outline:
    """Return a rounded polygon with corners at angles (degrees): the sum of smooth bumps towards them."""
    ring = []
    for angle in _angles(40):
        bumps = sum(np.exp((cos(angle - pi * corner / 180) - 1) / rounding) for corner in corners)
        r = radius * (0.72 + 0.32 * bumps)
        ring.append((centre[0] + r * cos(angle), centre[1] + r * sin(angle)))
    return Outline.through(np.array(ring))


def _angles(count: int) -> Iterator[float]:
    return (2 * pi * k / count for k in range(count))
