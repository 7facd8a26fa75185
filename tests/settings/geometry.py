"""Geometries, from numbers, outlines and files."""

from __future__ import annotations

from functools import cache
from math import pi, sqrt
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import meshio
import ngsolve as ng
import numpy as np
import pytest
import SimpleITK as sitk  # noqa: N813 - its usual name
from ngfsi_geometry.calf import CalfSegment, CalfVein, Compartments
from ngfsi_geometry.calf_section import Vein
from ngfsi_geometry.channel import (
    Beam,
    CylinderInChannel,
    CylinderInDuct,
    CylinderMesh,
    ElasticChannel,
    PlaneMesh,
)
from ngfsi_geometry.external import ExternalMesh
from ngfsi_geometry.from_surface import VesselFromSurface
from ngfsi_geometry.imaging import LABELS, phantom_stack
from ngfsi_geometry.labelled import LabelledCalf
from ngfsi_geometry.loft import StarLoft
from ngfsi_geometry.lofted import LoftedMesh, LoftedVein
from ngfsi_geometry.lofted_calf import ANATOMY, LoftedCalf
from ngfsi_geometry.segment import FatLayer, MeshSettings
from ngfsi_geometry.tube import TubeSegment
from ngfsi_geometry.valve import ValvePocket

from ngfsi.case import Case
from ngfsi.errors import NgfsiError
from ngfsi.mesh.domain import Domain
from ngfsi.outlines.outline import Outline
from tests.geometry.test_lofted_calf import COARSE, compartments_file
from tests.settings.physics import BEAM, FINE, SECTION
from tests.settings.table import Outcome, entry
from tests.surfaces import LENGTH, RADIUS, tube
from tests.vein import TISSUE, TUBE, case_of, domain_of, system_of


@entry("Case.geometry")
def _type_of_a_geometry() -> Outcome:
    """Its name in a file."""
    case = case_of(TUBE).to_toml_dict()
    found = type(Case.from_dict({**case, "geometry": {**CALF.to_toml_dict(), "type": "calf"}}).geometry)
    return [type(Case.from_dict(case).geometry), found], [TubeSegment, CalfSegment]


def volume(geometry: Any, region: str = "fluid") -> float:
    return float(domain_of(geometry).volume(region))


def middle(geometry: Any, region: str = "fluid") -> list[float]:
    """Return the centroid of a region in the plane."""
    domain = domain_of(geometry)
    return [float(ng.Integrate(axis * domain.dx(region), domain.mesh)) / domain.volume(region) for axis in (ng.x, ng.y)]


@entry(
    "VeinSegment.length",
    "VeinSegment.lumen_diameter",
    "VeinSegment.wall_thickness",
    "TubeSegment.outer_radius",
    rel=1e-3,
)
def _sizes_of_a_tube() -> Outcome:
    geometry = TubeSegment(length=8e-3, lumen_diameter=9e-3, wall_thickness=1.5e-3, outer_radius=13e-3, mesh=FINE)
    areas = pi * np.array([4.5e-3**2, 6e-3**2 - 4.5e-3**2, 13e-3**2 - 6e-3**2])
    return [volume(geometry, region) for region in ("fluid", "wall", "tissue")], 8e-3 * areas


@entry("VeinSegment.sheath_thickness", "Materials.sheath", rel=1e-3)
def _sheath() -> Outcome:
    """A region of its own around the wall, with its own material."""
    sheathed = TubeSegment(length=8e-3, sheath_thickness=2e-3, mesh=FINE)
    changes = {"geometry": sheathed, "materials.sheath": TISSUE.replace(density=900.0)}
    system = system_of(case_of(TUBE).replace(**changes))
    outer = sheathed.lumen_radius + sheathed.wall_thickness
    found = [volume(sheathed, "sheath"), system.solids["sheath"].density]
    return found, [pi * ((outer + 2e-3) ** 2 - outer**2) * 8e-3, 900.0]


@entry("VeinSegment.fat", "FatLayer.thickness", rel=1e-4)
def _fat() -> Outcome:
    """A region of its own under the skin; its material is entered with those of compartments."""
    fat = TubeSegment(length=8e-3, outer_radius=14e-3, fat=FatLayer(thickness=3e-3), mesh=FINE)
    return [volume(fat, "fat")], [pi * (14e-3**2 - 11e-3**2) * 8e-3]


@entry(
    "CalfSegment.compartments", "Compartments.anterior_septum", "Compartments.posterior_septum",
    "Compartments.tibial_septum", "Compartments.deep_at_tibia", "Compartments.deep_at_fibula",
    "Compartments.deep_corner", rel=1e-4,
)  # fmt: skip
def _compartments() -> Outcome:
    """Means over septa of directions seen from the bones, and the area of the one with a corner."""
    angles = {"anterior_septum": 1.1, "posterior_septum": -0.7, "tibial_septum": 2.2}
    deep = {"deep_at_tibia": 4.2, "deep_at_fibula": 3.3, "deep_corner": (-12e-3, -2e-3)}
    calf = CalfSegment(length=10e-3, compartments=Compartments(**angles, **deep), mesh=MeshSettings(axial_layers=1))
    domain, found, wanted = domain_of(calf), [], []
    for name, angle in angles.items():
        bone = calf.bones[0 if name == "tibial_septum" else 1]
        seen = (-ng.sin(angle) * (ng.x - bone.x) + ng.cos(angle) * (ng.y - bone.y)) ** 2 * domain.ds(name)
        found.append(1 + float(ng.Integrate(seen, domain.mesh)) / domain.area(name) / 1e-8)
        wanted.append(1.0)
    (tibia, fibula), corner = calf.bones, np.array(deep["deep_corner"])
    ends = tibia.points(np.array([4.2]))[0], fibula.points(np.array([3.3]))[0]
    found.append(domain.area("transverse_septum"))
    wanted.append(10e-3 * sum(float(np.hypot(*(end - corner))) for end in ends))
    return found, wanted


@entry("LabelledCalf.compartments", rel=0.02)
def _compartments_of_labels() -> Outcome:
    """By elements of 5 mm, the volume of the label's voxels."""
    with TemporaryDirectory() as folder:
        file = str(compartments_file(Path(folder)))
        calf = LabelledCalf(file=file, compartments=("lateral",), mesh=COARSE.replace(far_size=5e-3, axial_layers=2))
        return [volume(calf, "lateral")], [calf.label_volumes()["lateral"]]


@entry("VeinSegment.hollow")
def _hollow() -> Outcome:
    """The wall is as before, and the blood is not there."""
    hollow = domain_of(TUBE.replace(hollow=True))
    return [hollow.volume("wall"), hollow.volume()], [
        volume(TUBE, "wall"),
        volume(TUBE, "wall") + volume(TUBE, "tissue"),
    ]


@entry("VeinSegment.vein_x", "VeinSegment.vein_y", rel=1e-6)
def _place_of_a_vein() -> Outcome:
    return middle(TUBE.replace(vein_x=2e-3, vein_y=-1e-3)), [2e-3, -1e-3]


CALF = CalfSegment(
    length=10e-3, tibia_diameter=20e-3, tibia_x=-20e-3, tibia_y=25e-3,
    fibula_diameter=12e-3, fibula_x=22e-3, fibula_y=4e-3,
    skin_radius_distal=52e-3, skin_radius_proximal=54e-3, mesh=MeshSettings(axial_layers=2, curving_order=3),
    further_veins=(CalfVein(lumen_diameter=6e-3, wall_thickness=0.7e-3, x=-10e-3, y=-15e-3),),
)  # fmt: skip


@entry(
    "CalfSegment.tibia_diameter", "CalfSegment.tibia_x", "CalfSegment.tibia_y", "CalfSegment.fibula_diameter",
    "CalfSegment.fibula_x", "CalfSegment.fibula_y", rel=2e-3,
)  # fmt: skip
def _bones() -> Outcome:
    """Area and centroid of their surfaces."""
    domain, found = domain_of(CALF), []
    for name in ("tibia", "fibula"):
        area = domain.area(name)
        found += [area, *(float(ng.Integrate(axis * domain.ds(name), domain.mesh)) / area for axis in (ng.x, ng.y))]
    return found, [pi * 20e-3 * 10e-3, -20e-3, 25e-3, pi * 12e-3 * 10e-3, 22e-3, 4e-3]


@entry("CalfSegment.skin_radius_distal", "CalfSegment.skin_radius_proximal", rel=1e-3)
def _skin() -> Outcome:
    """Ends of the tissue, with the holes of bones and veins."""
    holes = 10e-3**2 + 6e-3**2 + 6.55e-3**2 + 3.7e-3**2
    ends = [domain_of(CALF).area(name) for name in ("tissue_bottom", "tissue_top")]
    return ends, [pi * (radius**2 - holes) for radius in (52e-3, 54e-3)]


@entry(
    "CalfSegment.further_veins",
    "CalfVein.lumen_diameter",
    "CalfVein.wall_thickness",
    "CalfVein.x",
    "CalfVein.y",
    rel=1e-3,
)
def _further_veins() -> Outcome:
    found = [volume(CALF, "fluid_2"), volume(CALF, "wall_2"), *middle(CALF, "fluid_2")]
    return found, [pi * 9e-6 * 10e-3, pi * (3.7e-3**2 - 9e-6) * 10e-3, -10e-3, -15e-3]


def counts(**mesh: Any) -> dict[str, int]:
    """Return how many elements of each shape a tube has, and how many of them in wall and blood."""
    domain = domain_of(TUBE.replace(mesh=TUBE.mesh.replace(**mesh)))
    names = [element.mat for element in domain.mesh.Elements(ng.VOL)]
    return {
        **domain.statistics()["elements_by_type"],
        **{name: names.count(name) for name in ("wall", "fluid", "tissue")},
    }


@entry("MeshSettings.element", "MeshSettings.axial_layers", "MeshSettings.wall_layers", "MeshSettings.lumen_radii")
def _numbers_of_elements() -> Outcome:
    """Around a lumen of n edges: 2 n prisms to a ring of the wall, or n hexahedra; three tetrahedra to a prism."""
    prisms, layers, split = counts(), counts(axial_layers=3), counts(element="tetrahedron")
    mixed, rings, lumen = counts(element="mixed"), counts(wall_layers=2), counts(lumen_radii=(0.6,))
    found = [layers["wall"] / prisms["wall"], layers["fluid"] / prisms["fluid"], split["wall"] / prisms["wall"]]
    assert set(split) - {"wall", "fluid", "tissue"} == {"tet"}
    # a triangle on each edge around the core, or two more; two rings of the wall instead of one
    more = [lumen["fluid"] / prisms["fluid"], rings["wall"] / rings["fluid"], mixed["wall"] == mixed["hex"]]
    return [*found, *more], [3, 3, 3, 3, 4, True]


@entry("MeshSettings.vein_size", "MeshSettings.far_size")
def _element_sizes() -> Outcome:
    """Half the size: about twice the edges around the vein, more elements in the tissue."""
    usual, around, far = counts(), counts(vein_size=TUBE.mesh.vein_size / 4), counts(far_size=4e-3)
    return [around["wall"] > 2 * usual["wall"], far["tissue"] > 1.5 * usual["tissue"], far["wall"] == usual["wall"]], [
        True
    ] * 3


@entry("MeshSettings.layer_boundaries", rel=1e-9)
def _layer_boundaries() -> Outcome:
    """Vertices lie at these fractions of the length."""
    mesh = domain_of(TUBE.replace(mesh=MeshSettings(layer_boundaries=(0.1, 0.4), far_size=1.0, vein_size=6e-3))).mesh
    return np.unique([round(v.point[2] / TUBE.length, 12) for v in mesh.vertices]), [0.0, 0.1, 0.4, 1.0]


@entry("MeshSettings.end_refinement", rel=1e-6)
def _end_refinement() -> Outcome:
    """Layers at the ends are so many times thinner than in the middle, if there is one in the middle."""
    mesh = domain_of(TUBE.replace(mesh=TUBE.mesh.replace(axial_layers=41, end_refinement=3.0, far_size=1.0))).mesh
    steps = np.diff(np.unique([round(vertex.point[2], 12) for vertex in mesh.vertices]))
    return steps[20] / steps[0], 3.0 ** (40 / 41)


@entry("MeshSettings.curving_order", "LoftedMesh.curving_order", "PlaneMesh.curving_order")
def _curving_orders() -> Outcome:
    """The error of an area falls by orders of magnitude."""
    errors = []
    for geometry in (TUBE, VEIN, CylinderInChannel(mesh=CylinderMesh(far_size=0.2, cylinder_size=0.1))):
        exact = geometry.exact_volumes()["fluid"]
        errors.append([abs(volume(geometry.replace(**{"mesh.curving_order": k})) / exact - 1) for k in (1, 3)])
    return [fine < coarse / 30 for coarse, fine in errors], [True] * 3


def ellipse(a: float, b: float, x: float = 0.0, y: float = 0.0, turn: float = 0.0) -> Outline:
    t = 2 * pi * np.arange(64) / 64
    shape = (a * np.cos(t) + 1j * b * np.sin(t)) * np.exp(1j * turn) + x + 1j * y
    return Outline.through(np.column_stack([shape.real, shape.imag]))


VEIN = LoftedVein(
    outlines=(ellipse(3e-3, 2e-3, x=1e-3),) * 5, heights=(1e-3, 2e-3, 4e-3, 5e-3, 7e-3), inlet_diameters=2.0,
    mesh=LoftedMesh(around=12, layers=4, inlet_layers=3, lumen_radii=(0.8,)),
)  # fmt: skip


@entry("LoftedVein.outlines", "LoftedVein.heights", "LoftedVein.inlet_diameters", rel=2e-3)
def _lofted_vein() -> Outcome:
    """Ellipses upstream of which the inlet is 2 diameters long, and has the same area at its round end."""
    domain = domain_of(VEIN)
    heights = [vertex.point[2] for vertex in domain.mesh.vertices]
    inlet = 2 * 2 * np.sqrt(6e-6)
    return [domain.area("outlet"), domain.area("inlet"), max(heights) - min(heights), middle(VEIN)[0]], [
        pi * 6e-6, pi * 6e-6, 6e-3 + inlet, 1e-3,
    ]  # fmt: skip


@entry("LoftedVein.modes")
def _modes() -> Outcome:
    """A wave of order 5 on the outline is there from that mode on."""
    t = 2 * pi * np.arange(120) / 120
    radius = 2e-3 * (1 + 0.05 * np.cos(5 * t))
    waved = Outline.through(np.column_stack([radius * np.cos(t), radius * np.sin(t)]))
    errors = []
    for modes in (3, 8):
        stack = VEIN.replace(outlines=(waved,) * 5, modes=modes)
        errors.append(abs(float(stack.areas(np.array([5e-3]))[0]) / waved.area - 1))
    return errors[1] < errors[0] / 10, True


@entry("LoftedMesh.around", "LoftedMesh.layers", "LoftedMesh.inlet_layers", "LoftedMesh.lumen_radii")
def _elements_of_a_lofted_vein() -> Outcome:
    """Hexahedra: around x rings x layers."""
    mesh = LoftedMesh(around=14, layers=5, inlet_layers=2, lumen_radii=(0.8, 0.6, 0.4))
    return domain_of(VEIN.replace(mesh=mesh)).statistics()["elements_by_type"]["hex"], 14 * 3 * (5 + 2)


WIDE = PlaneMesh(far_size=5e-3)


@entry("StraightChannel.length", "StraightChannel.height", "ElasticChannel.wall_thickness")
def _channels() -> Outcome:
    geometry = ElasticChannel(length=12e-3, height=8e-3, wall_thickness=2e-3, mesh=WIDE)
    return [volume(geometry), volume(geometry, "solid")], pytest.approx([96e-6, 48e-6])


@entry(
    "CylinderSection.cylinder_x", "CylinderSection.cylinder_y", "CylinderSection.cylinder_radius",
    "CylinderInChannel.length", "CylinderInChannel.height", rel=1e-4,
)  # fmt: skip
def _cylinder() -> Outcome:
    geometry = CylinderInChannel(
        cylinder_x=0.3, cylinder_y=0.22, cylinder_radius=0.06, length=1.0, height=0.5, mesh=CylinderMesh(far_size=0.2)
    )
    hole, area = pi * 0.06**2, 0.5 - pi * 0.06**2
    exact = [(0.5 * 0.5 - hole * 0.3) / area, (0.5 * 0.25 - hole * 0.22) / area]
    return [volume(geometry), *middle(geometry)], [area, *exact]


@entry("Beam.beam_length", "Beam.beam_thickness", rel=1e-4)
def _beam() -> Outcome:
    geometry = BEAM.replace(beam_length=0.3, beam_thickness=0.04)
    mesh = domain_of(geometry).mesh
    points = np.array([vertex.point for vertex in mesh.vertices])
    return [points[:, 0].max() - 0.25, np.ptp(points[points[:, 0] > 0.5][:, 1])], [0.3, 0.04]


@entry(
    "PlaneMesh.far_size",
    "PlaneMesh.grading",
    "CylinderMesh.cylinder_size",
    "CylinderMesh.beam_size",
    "CylinderMesh.corner_size",
)
def _sizes_of_plane_elements() -> Outcome:
    """Smaller ones are more; those that grow faster are fewer."""

    def number(geometry: Any, **mesh: Any) -> int:
        return int(domain_of(geometry.replace(mesh=geometry.mesh.replace(**mesh))).mesh.ne)

    cylinder = CylinderInChannel(mesh=CylinderMesh(far_size=0.1, cylinder_size=0.02))
    beam = Beam(mesh=CylinderMesh(far_size=0.1, beam_size=0.02, corner_size=0.01))
    return [
        number(cylinder, far_size=0.05) > number(cylinder), number(cylinder, grading=0.9) < number(cylinder),
        number(cylinder, cylinder_size=5e-3) > number(cylinder), number(beam, beam_size=6e-3) > number(beam),
        number(beam, corner_size=2e-3) > number(beam),
    ], [True] * 5  # fmt: skip


@entry("CylinderInDuct.layers", "CylinderInDuct.end_refinement")
def _duct() -> Outcome:
    geometry = CylinderInDuct(layers=5, end_refinement=2.0, mesh=CylinderMesh(far_size=0.2, cylinder_size=0.1))
    heights = np.unique([round(vertex.point[2], 9) for vertex in domain_of(geometry).mesh.vertices])
    steps = np.diff(heights)
    return [len(steps), steps[2] / steps[0]], pytest.approx([5, 2**0.8], rel=1e-6)


@entry("CalfSection.veins", "Outline.x", "Outline.y", "Vein.wall_thickness", rel=2e-3)
def _outlines_of_a_section() -> Outcome:
    """What is inside of the outlines as measured on the mesh, and the wall by its thickness (Steiner)."""
    lumen = ellipse(5e-3, 3e-3, 12e-3, -15e-3)
    section = SECTION.replace(veins=(Vein(lumen=lumen, wall_thickness=1.2e-3),))
    domain = domain_of(section)
    outer = lumen.area + lumen.length * 1.2e-3 + pi * 1.2e-3**2
    inside = section.skin.area - section.tibia.area - section.fibula.area - outer
    solids = sum(domain.volume(name) for name in section.solids if name != "wall")
    return [solids, domain.volume("wall"), domain.area("lumen"), domain.area("tibia"), domain.area("fibula")], [
        inside, outer - lumen.area, lumen.length, section.tibia.length, section.fibula.length,
    ]  # fmt: skip


@entry("CalfSection.anterior", "CalfSection.lateral", "CalfSection.superficial_posterior", "CalfSection.deep_posterior",
       "CalfSection.fascia", rel=2e-3)  # fmt: skip
def _compartments() -> Outcome:
    """Each is a region of its own area; fat is what is outside of the fascia."""
    lower = ellipse(8e-3, 5e-3, 0.0, -35e-3)
    fascia = ellipse(45e-3, 49e-3, 0.0, -4e-3)
    section = SECTION.replace(anterior=ellipse(7e-3, 5e-3, 15e-3, 25e-3), lateral=ellipse(4e-3, 9e-3, 37e-3, 2e-3),
                              deep_posterior=ellipse(6e-3, 5e-3, -10e-3, -8e-3), superficial_posterior=lower,
                              fascia=fascia)  # fmt: skip
    domain, parts = domain_of(section), ("anterior", "lateral", "deep_posterior", "superficial_posterior")
    return [domain.volume(name) for name in (*parts, "fat")], [
        *(getattr(section, name).area for name in parts), section.skin.area - fascia.area,
    ]  # fmt: skip


@entry("SectionSizes.bone_size", "SectionSizes.vein_size")
def _sizes_in_a_section() -> Outcome:
    """Half the size: about twice the edges on what it is for."""

    def edges(name: str, **mesh: Any) -> int:
        mesh_ = domain_of(SECTION.replace(mesh=SECTION.mesh.replace(**mesh))).mesh
        return sum(element.mat == name for element in mesh_.Elements(ng.BND))

    around = edges("tibia", bone_size=3e-3) / edges("tibia"), edges("lumen", vein_size=1e-3) / edges("lumen")
    return [ratio > 1.3 for ratio in around], [True] * 2


HEIGHTS = (0.0, 4e-3, 8e-3, 12e-3, 20e-3)


def lofted(**changes: Any) -> LoftedCalf:
    parts = {
        "skin": Outline.circle(0, 0, 54e-3, 64), "tibia": Outline.circle(-21e-3, 28e-3, 12e-3, 64),
        "fibula": Outline.circle(20e-3, 6e-3, 7e-3, 64), "lumen": Outline.circle(5e-3, -8e-3, 5e-3, 64),
    }  # fmt: skip
    stacks = {name: (outline,) * len(HEIGHTS) for name, outline in parts.items()}
    mesh = MeshSettings(element="mixed", axial_layers=1, far_size=30e-3, vein_size=6e-3, lumen_radii=())
    return LoftedCalf(**{"heights": HEIGHTS, "mesh": mesh, **stacks, **changes})


@entry("LoftedCalf.skin", "LoftedCalf.tibia", "LoftedCalf.fibula", "LoftedCalf.lumen", "LoftedCalf.heights",
       "CalfLoft.wall_thickness", rel=3e-3)  # fmt: skip
def _stacks_of_outlines() -> Outcome:
    """Of circles: areas and volumes."""
    domain = domain_of(lofted(wall_thickness=1.4e-3))
    found = [domain.area(name) for name in ("skin", "tibia", "fibula")]
    return [*found, domain.volume("fluid"), domain.volume("wall")], 20e-3 * pi * np.array(
        [108e-3, 24e-3, 14e-3, 25e-6, 6.4e-3**2 - 25e-6]
    )


@entry("LoftedCalf.fat", "LoftedCalf.compartments", rel=2e-3)
def _fat_and_compartments_of_outlines() -> Outcome:
    """A ring of fat; and the interosseous membrane, from bone to bone."""
    domain = domain_of(lofted(fat=FatLayer(thickness=5e-3), compartments=Compartments()))
    apart = np.hypot(41e-3, 22e-3) - 12e-3 - 7e-3
    return [domain.volume("fat"), domain.area("interosseous_membrane")], 20e-3 * np.array(
        [pi * (54e-3**2 - 49e-3**2), apart]
    )


@entry("LoftedCalf.first_slice")
def _first_slice() -> Outcome:
    """By it the slices are counted in refusals."""
    odd = list(lofted().lumen)
    odd[2] = Outline.circle(5e-3, 2e-3, 5e-3, 64)
    with pytest.raises(NgfsiError, match=r"slice 9: 'lumen' lies 10\.0 mm beside"):
        lofted(lumen=tuple(odd), first_slice=7)
    return True, True


@entry("LoftedCalf.further_lumens", rel=1e-5)
def _further_lumens() -> Outcome:
    """Volume of the blood in a second vein."""
    second = (Outline.circle(-8e-3, -20e-3, 3e-3, 64),) * len(lofted().heights)
    domain = domain_of(lofted(further_lumens=(second,)))
    return [domain.volume("fluid"), domain.volume("fluid_2")], 20e-3 * pi * np.array([25e-6, 9e-6])


@entry("CalfLoft.modes", "CalfLoft.smoothing")
def _smoothness_of_a_loft() -> Outcome:
    """A wave of order 5 around, or one that comes and goes along z, is there or smoothed away."""
    t = 2 * pi * np.arange(120) / 120

    def skin(depth: float) -> Outline:
        radius = 54e-3 * (1 + depth * np.cos(5 * t))
        return Outline.through(np.column_stack([radius * np.cos(t), radius * np.sin(t)]))

    heights = tuple(np.linspace(0, 20e-3, 9).tolist())
    rest = {name: (getattr(lofted(), name)[0],) * 9 for name in ("tibia", "fibula", "lumen")}
    around = {n: lofted(heights=heights, skin=(skin(0.08),) * 9, modes=n, **rest) for n in (3, 8)}
    wavy = tuple(skin(0.03 * (k % 2)) for k in range(9))
    along = {mm: lofted(heights=heights, skin=wavy, smoothing=1e-3 * mm, **rest) for mm in (2, 20)}
    middle = np.array([heights[4]])
    smooth = skin(0.0).area

    def skins(geometry: LoftedCalf) -> StarLoft:
        return geometry._lofts["skin"]

    first = {n: abs(skins(geometry).sections(middle)[0, 0]) for n, geometry in around.items()}
    errors = {mm: float(skins(geometry).areas(middle)[0]) / smooth - 1 for mm, geometry in along.items()}
    return [first[8], first[3], abs(errors[2]) < 1e-4 < errors[20]], [
        pytest.approx(54e-3 * 1.08, rel=5e-3), pytest.approx(54e-3 * sqrt(1 + 0.08**2 / 2), rel=1e-3), True
    ]  # fmt: skip


@cache
def image() -> tuple[Path, TemporaryDirectory[str]]:
    """Return a label map of circles, with numbers of its own, in a folder that lasts as long as it."""
    folder = TemporaryDirectory()
    calf = lofted()
    second = Outline.circle(-8e-3, -20e-3, 4e-3, 64)
    slices = [{name: getattr(calf, name)[0] for name in ANATOMY} | {"lumen_3": second} for _ in range(8)]
    labels, _ = phantom_stack(slices, calf.skin[0])
    file = Path(folder.name) / "leg.nii.gz"
    sitk.WriteImage(labels + 10 * sitk.Cast(labels > 0, labels.GetPixelID()), file)
    return file, folder


NUMBERS = {name: number + 10 for name, number in LABELS.items()}


@entry("LabelledCalf.file", "LabelledCalf.labels", "LabelledCalf.vein", "LabelledCalf.further_veins",
       "LabelledCalf.first_slice", "LabelledCalf.last_slice", rel=3e-2)  # fmt: skip
def _label_map() -> Outcome:
    """Areas by pixels; the first and last slices taken are the ends."""
    mesh = lofted().mesh
    names = {("lumen_2" if name == "lumen" else name): NUMBERS[name] for name in ANATOMY}
    calf = LabelledCalf(file=str(image()[0]), labels=names, vein="lumen_2", first_slice=1, last_slice=5, mesh=mesh)
    labels = {name: NUMBERS[name] for name in (*ANATOMY, "lumen_3")}
    whole = LabelledCalf(file=str(image()[0]), labels=labels, further_veins=("lumen_3",), mesh=mesh)
    volumes, second = calf.exact_volumes(), whole.exact_volumes()["fluid_2"]
    found = [volumes["fluid"] / calf.length, whole.length / calf.length, second / whole.length]
    return found, [pi * 25e-6, 7 / 4, pi * 16e-6]


@entry("LabelledCalf.label_table", rel=3e-2)
def _names_of_numbers() -> Outcome:
    """Labels by name, from a table."""
    table = image()[0].parent / "names.csv"
    table.write_text("number,name\n" + "".join(f"{NUMBERS[name]},{name}\n" for name in ANATOMY))
    calf = LabelledCalf(file=str(image()[0]), label_table=str(table), mesh=lofted().mesh)
    return calf.exact_volumes()["fluid"] / calf.length, pi * 25e-6


@entry("LabelledCalf.sha256", "ExternalMesh.sha256", "VesselFromSurface.sha256")
def _content() -> Outcome:
    """A file with another content is refused."""
    for geometry, file in ((LabelledCalf, image()[0]), (ExternalMesh, own_mesh()[0]),
                           (VesselFromSurface, lumen_surface()[0])):  # fmt: skip
        with pytest.raises(NgfsiError, match="it has changed"):
            _ = geometry(file=str(file), sha256="0" * 64).vessels
    return True, True


@cache
def own_mesh() -> tuple[Path, TemporaryDirectory[str]]:
    """Return a file with two tetrahedra and their skin, in groups of the array "part"."""
    folder = TemporaryDirectory()
    file = Path(folder.name) / "block.vtu"
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]], dtype=float)
    faces = [[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 4], [1, 3, 4], [2, 3, 4]]
    cells = [("tetra", [[0, 1, 2, 3], [1, 2, 3, 4]]), ("triangle", faces)]
    meshio.write(file, meshio.Mesh(points, cells, cell_data={"part": [np.array([7, 7]), np.array([8] * 6)]}))
    return file, folder


@entry("ExternalMesh.smooth")
def _smooth() -> Outcome:
    """The cells get curved edges, straight where faces meet at a sharp angle; the boundary must be there."""
    given = {"file": str(own_mesh()[0]), "groups": "part", "names": {"7": "tissue", "8": "skin"}}
    with pytest.raises(NgfsiError, match="'wall' is not a known boundary"):
        ExternalMesh(**given, smooth=("wall",))
    domain = Domain.build(ExternalMesh(**given, smooth=("skin",)), cache=False)
    return [domain.geometry.curving_order, 1e9 * domain.volume("tissue")], [2, 1 / 6 + 1 / 3]


@cache
def lumen_surface() -> tuple[Path, TemporaryDirectory[str]]:
    """Return a file with the surface of a tube, in a folder that lasts as long as it."""
    folder = TemporaryDirectory()
    return tube(Path(folder.name) / "tube.vtp", capped=False), folder


@entry("VesselFromSurface.file", "VesselFromSurface.unit", "VesselFromSurface.wall_thickness",
       "VesselFromSurface.tissue_thickness", "VesselFromSurface.names", rel=3e-3)  # fmt: skip
def _vessel_from_a_surface() -> Outcome:
    """Volumes between cylinders; the ends change their names."""
    given = {"file": str(lumen_surface()[0]), "names": {"inlet": "outlet", "outlet": "inlet"}}
    sizes = {"wall_thickness": 1e-3, "tissue_thickness": 6e-3}
    plain, large = VesselFromSurface(**given, **sizes), VesselFromSurface(file=given["file"], unit="cm")
    inner, outer = RADIUS + 1, RADIUS + 7
    found = [*plain.exact_volumes().values(), large.exact_volumes()["fluid"]]
    ways = [geometry._centre("outlet")[2] - geometry._centre("inlet")[2] for geometry in (plain, large)]
    areas = np.array([RADIUS**2, inner**2 - RADIUS**2, outer**2 - inner**2, 1e3 * RADIUS**2])
    assert ways[0] * ways[1] < 0
    return found, pi * LENGTH * areas * 1e-9


@entry("VesselFromSurface.wall_layers", "VesselFromSurface.tissue_layers", "VesselFromSurface.flow_layers",
       "VesselFromSurface.flow_thickness")  # fmt: skip
def _layers_along_a_surface() -> Outcome:
    """Distances of their borders from the surface, over the radius of the ends."""
    geometry = VesselFromSurface(file=str(lumen_surface()[0]), wall_thickness=1e-3, tissue_thickness=6e-3,
                                 wall_layers=2, tissue_layers=3, flow_layers=4, flow_thickness=0.2)  # fmt: skip
    away = 1e3 * np.linalg.norm(geometry._borders[:, 20, :2], axis=1) - RADIUS
    inner = -1e3 * geometry._smallest * np.array([0.2, 0.15, 0.1, 0.05])
    return away, np.array([*inner, 0, 0.5, 1, 3, 5, 7])


@entry("ExternalMesh.file", "ExternalMesh.groups", "ExternalMesh.names", "ExternalMesh.unit")
def _own_mesh() -> Outcome:
    """Volumes of the tetrahedra, in the unit."""
    given = {"file": str(own_mesh()[0]), "groups": "part", "names": {"7": "tissue", "8": "skin"}}
    domains = [Domain.build(ExternalMesh(**given, unit=unit), cache=False) for unit in ("mm", "cm")]
    return [domain.volume("tissue") for domain in domains], pytest.approx(
        [(1 / 6 + 1 / 3) * 1e-9, (1 / 6 + 1 / 3) * 1e-6]
    )


VALVE = {"radius": 5e-3, "leaflet_length": 7e-3, "opening": 4e-3, "thickness": 0.7e-3, "sinus_length": 12e-3,
         "bulge": 0.2, "upstream": 6e-3, "downstream": 9e-3}  # fmt: skip


@entry(*(f"ValvePocket.{name}" for name in VALVE), rel=2e-4)
def _valve() -> Outcome:
    """The volume of the blood and its part below each height: circles less the strips that the leaflets cut."""
    z = (np.arange(40000) + 0.5) * 27e-3 / 40000
    inside = np.clip((z - 6e-3) / 12e-3, 0, 1)
    r = 5e-3 * (1 + 0.2 * np.sin(pi * inside) ** 2)
    # the middle of a leaflet leads from the wall to its free edge, and backwards by half of its length
    tip, begin = np.array([2.35e-3, 13e-3]), np.array([5.35e-3, 6e-3])
    along = (tip - begin) / np.linalg.norm(tip - begin)
    across = np.array([along[1], -along[0]]) * 0.35e-3
    corners = [tip - 10.5e-3 * along - across, tip - across, tip + across, tip - 10.5e-3 * along + across]
    low, high = np.full_like(z, np.inf), np.full_like(z, -np.inf)
    for (y0, z0), (y1, z1) in zip(corners, [*corners[1:], corners[0]], strict=True):
        on = (z >= min(z0, z1)) & (z <= max(z0, z1))
        y = y0 + (y1 - y0) * (z[on] - z0) / (z1 - z0)
        low[on], high[on] = np.minimum(low[on], y), np.maximum(high[on], y)
    low, high = (np.clip(np.where(np.isfinite(y), y, 0.0), 0, r) for y in (low, high))
    strip = [y * np.sqrt(r**2 - y**2) + r**2 * np.arcsin(y / r) for y in (low, high)]
    areas = pi * r**2 - 2 * (strip[1] - strip[0])
    domain = domain_of(ValvePocket(**VALVE, curving_order=3))
    assert domain.geometry.length == pytest.approx(27e-3, rel=1e-12)
    return domain.geometry.exact_volumes()["fluid"], float(areas.sum() * 27e-3 / 40000)


@entry("ValvePocket.element_size", "ValvePocket.leaflet_size", "ValvePocket.curving_order")
def _elements_of_a_valve() -> Outcome:
    """More of them, and closer to the shape."""
    sizes = [{}, {"element_size": 1.8e-3}, {"leaflet_size": 1.3e-3}, {"curving_order": 3}]
    domains = [domain_of(ValvePocket(**VALVE, **more)) for more in sizes]
    counts = [domain.mesh.ne for domain in domains]
    errors = [abs(domain.statistics()["relative_volume_errors"]["fluid"]) for domain in domains]
    return [counts[1] > 1.1 * counts[0], counts[2] > 1.1 * counts[0], errors[3] < errors[0] / 3], [True] * 3
