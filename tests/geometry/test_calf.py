"""Calf and tube: exact volumes and areas, names, orientation, collisions, element kinds, taper."""

from __future__ import annotations

from itertools import combinations
from math import cos, pi, sin, sqrt
from typing import Any

import numpy as np
import pytest
from ngfsi_geometry.calf import STILL, CalfSegment, CalfVein, Compartments
from ngfsi_geometry.plane import Ellipse
from ngfsi_geometry.segment import FatLayer, MeshSettings, VeinSegment
from ngfsi_geometry.tube import BareTube, TubeSegment
from ngsolve import BND, CF, H1, VOL, ElementId, Grad, GridFunction, Integrate, Mesh, specialcf, x, y, z

from ngfsi.errors import GeometryError
from ngfsi.mesh.domain import Domain
from ngfsi.mesh.generate import MeshReport, shape_of
from ngfsi.mesh.geometry import COMPARTMENTS

ELEMENTS = ("prism", "mixed", "tetrahedron")


def domain_of(geometry: VeinSegment) -> Domain:
    """Mesh in this process: the builders are tested here, not the guard around them."""
    mesh = Mesh(geometry.netgen_mesh())
    return Domain(mesh, geometry, MeshReport("direct", (), 0.0))


@pytest.fixture(scope="module")
def calf() -> Domain:
    return domain_of(CalfSegment())


def test_default_is_all_prism_and_small(calf: Domain) -> None:
    statistics = calf.statistics()
    assert statistics["elements_by_type"] == {"prism": statistics["elements"]}
    assert 1000 < statistics["elements"] < 2500
    assert statistics["elements_by_region"]["fluid"] > 500
    assert statistics["smallest_jacobian_ratio"] > 0.3


@pytest.mark.parametrize("element", ELEMENTS)
@pytest.mark.parametrize("lumen", [8.0e-3, 11.1e-3])
def test_volumes(element: Any, lumen: float) -> None:
    geometry = CalfSegment(lumen_diameter=lumen, mesh=MeshSettings(element=element))
    domain = domain_of(geometry)
    R, a, t = 55e-3, lumen / 2, 1e-3
    area = {"fluid": pi * a**2, "wall": pi * ((a + t) ** 2 - a**2)}
    area["tissue"] = pi * (R**2 - 12.5e-3**2 - 7e-3**2 - (a + t) ** 2)
    for region, exact in area.items():
        assert domain.volume(region) == pytest.approx(exact * 0.12, rel=1.5e-4), region
        assert geometry.exact_volumes()[region] == pytest.approx(exact * 0.12, rel=1e-12)


@pytest.mark.parametrize("bare", [False, True])
def test_solids_meshed_by_netgen(bare: bool) -> None:
    """The mesh that others have by default: the same regions and boundaries, each of its exact size."""
    settings = MeshSettings(element="csg", curving_order=2)
    length, outer, a, b = 20e-3, 12e-3, 5.55e-3, 6.55e-3
    kind = BareTube if bare else TubeSegment
    domain = domain_of(kind(length=length, outer_radius=outer, mesh=settings))
    areas = {"inlet": pi * a**2, "outlet": pi * a**2, "interface": 2 * pi * a * length,
             "wall_top": pi * (b**2 - a**2), "skin": 2 * pi * (b if bare else outer) * length}  # fmt: skip
    if not bare:
        areas |= {"wall_outer": 2 * pi * b * length, "tissue_bottom": pi * (outer**2 - b**2)}
    for name, exact in areas.items():
        assert domain.area(name) == pytest.approx(exact, rel=5e-4), name
    for region, exact in domain.geometry.exact_volumes().items():
        assert domain.volume(region) == pytest.approx(exact, rel=5e-4), region


@pytest.mark.parametrize("element", ELEMENTS)
def test_volume_error_falls_with_the_curving_order(element: Any) -> None:
    errors = {}
    for order in (1, 2, 4):
        geometry = CalfSegment(mesh=MeshSettings(element=element, axial_layers=2, curving_order=order))
        mesh, exact = Mesh(geometry.netgen_mesh()), geometry.exact_volumes()
        mesh.SetDeformation(shape_of(mesh, geometry))
        volume = Integrate(CF(1), mesh, order=12, region_wise=True)
        errors[order] = max(abs(volume[k] / exact[name] - 1) for k, name in enumerate(mesh.GetMaterials()))
    assert errors[1] > 1e-2
    assert errors[2] < 4e-4
    assert errors[4] < 2e-6


def test_areas(calf: Domain) -> None:
    radius = {"interface": 5.55e-3, "wall_outer": 6.55e-3, "skin": 55e-3, "tibia": 12.5e-3, "fibula": 7e-3}
    for name, r in radius.items():
        accuracy = 5e-4 if name in ("tibia", "fibula") else 5e-5  # few elements around the bones
        assert calf.area(name) == pytest.approx(2 * pi * r * 0.12, rel=accuracy), name
    assert calf.area("inlet") == pytest.approx(pi * 5.55e-3**2, rel=1e-4)
    assert calf.area("wall_top") == pytest.approx(pi * (6.55e-3**2 - 5.55e-3**2), rel=1e-4)
    assert calf.area("tissue_bottom") == pytest.approx(calf.area("tissue_top"), rel=1e-12)


def test_names(calf: Domain) -> None:
    assert set(calf.mesh.GetMaterials()) == {"tissue", "wall", "fluid"}
    outer = "skin tibia fibula interface wall_outer inlet outlet tissue_top tissue_bottom wall_top wall_bottom"
    assert set(calf.mesh.GetBoundaries()) == {*outer.split(), "lumen_layer"}
    layered = domain_of(TubeSegment(mesh=MeshSettings(axial_layers=1, wall_layers=2, far_size=8e-3)))
    assert "wall_layer" in layered.mesh.GetBoundaries()


@pytest.mark.parametrize("element", ELEMENTS)
def test_ends_and_normals(element: Any) -> None:
    """Outer normals point out of the body, interface normals into the wall (checked against the divergence theorem)."""
    domain = domain_of(CalfSegment(mesh=MeshSettings(element=element, axial_layers=2)))
    n, mesh = specialcf.normal(3), domain.mesh
    for name, height, sign in (("inlet", 0.0, -1.0), ("outlet", 0.12, 1.0), ("tissue_top", 0.12, 1.0)):
        area = domain.area(name)
        assert Integrate(z * domain.ds(name, bonus_intorder=8), mesh) / area == pytest.approx(height, abs=1e-12)
        assert Integrate(n[2] * domain.ds(name, bonus_intorder=8), mesh) / area == pytest.approx(sign, rel=1e-12)
    body = [name for name in domain.geometry.boundary_names if name not in ("interface", "wall_outer")]
    through = {
        "outer": Integrate(CF((x, y, z)) * n * domain.ds(*body, bonus_intorder=6), mesh) / 3,
        "lumen": Integrate(CF((x, y, z)) * n * domain.ds("interface", "inlet", "outlet", bonus_intorder=6), mesh) / 3,
    }
    assert through["outer"] == pytest.approx(domain.volume(), rel=1e-12)
    assert through["lumen"] == pytest.approx(domain.volume("fluid"), rel=1e-12)


def test_layers_are_graded_towards_the_ends() -> None:
    mesh = MeshSettings(axial_layers=6, end_refinement=4.0, far_size=8e-3)
    heights = sorted({round(float(v.point[2]), 9) for v in Mesh(TubeSegment(mesh=mesh).netgen_mesh()).vertices})
    steps = np.diff(heights)
    assert len(steps) == 6
    assert steps == pytest.approx(steps[::-1], rel=1e-5)
    assert np.all(np.diff(steps[:3]) > 0)


VARIATIONS: list[dict[str, Any]] = [
    {"lumen_diameter": 3e-3, "wall_thickness": 0.4e-3},
    {"lumen_diameter": 12.5e-3, "wall_thickness": 0.3e-3},
    {"vein_x": 9e-3, "vein_y": -4e-3},
    {"vein_x": -20e-3, "vein_y": -25e-3},
    {"fibula_x": 38e-3, "fibula_y": -12e-3, "fibula_diameter": 20e-3},
    {"tibia_x": -25e-3, "tibia_y": 33e-3},
    {"length": 40e-3, "skin_radius_distal": 70e-3, "skin_radius_proximal": 70e-3},
    {"mesh": MeshSettings(far_size=7e-3, vein_size=1e-3, axial_layers=2)},
    {"mesh": MeshSettings(far_size=40e-3, vein_size=6e-3, axial_layers=2)},
    {"mesh": MeshSettings(lumen_radii=(0.97, 0.9, 0.75, 0.5), axial_layers=2)},
    {"mesh": MeshSettings(lumen_radii=(0.99, 0.9), wall_layers=4, element="mixed", axial_layers=2)},
    {"mesh": MeshSettings(lumen_radii=(), element="tetrahedron", axial_layers=2)},
]


@pytest.mark.parametrize("dimensions", VARIATIONS)
def test_every_sensible_choice_gives_valid_elements(dimensions: dict[str, Any]) -> None:
    geometry = CalfSegment(**({"mesh": MeshSettings(axial_layers=2)} | dimensions))
    domain = domain_of(geometry)
    assert domain.statistics()["smallest_jacobian_ratio"] > 0.3
    errors = domain.statistics()["relative_volume_errors"]
    assert max(map(abs, errors.values())) < 1.5e-3


COLLISIONS = {
    ("vein wall", "tibia"): {"vein_x": -10e-3, "vein_y": 14e-3},
    ("vein wall", "fibula"): {"vein_x": 14e-3},
    ("tibia", "fibula"): {"fibula_x": -5e-3, "fibula_y": 20e-3},
    ("vein wall", "skin"): {"vein_y": -50e-3},
    ("tibia", "skin"): {"tibia_x": -36e-3},
    ("fibula", "skin"): {"fibula_x": 50e-3},
}


@pytest.mark.parametrize("parts", COLLISIONS)
def test_collisions_name_both_parts_and_the_gap(parts: tuple[str, str]) -> None:
    with pytest.raises(GeometryError, match=rf"{parts[0]} and {parts[1]} overlap by [0-9.]+ mm"):
        CalfSegment(**COLLISIONS[parts])


def test_collision_states_the_overlap() -> None:
    with pytest.raises(GeometryError, match=r"vein wall and fibula overlap by 0\.55 mm"):
        CalfSegment(vein_x=7e-3, vein_y=6e-3)
    with pytest.raises(GeometryError, match=r"vein wall and fibula are 0\.45 mm apart, at least 0\.5 mm"):
        CalfSegment(vein_x=6e-3, vein_y=6e-3)


@pytest.mark.parametrize(
    "wrong",
    [
        {"lumen_diameter": 0.0},
        {"wall_thickness": -1e-3},
        {"length": 0.0},
        {"mesh": {"far_size": 0.0}},
        {"mesh": {"curving_order": 0}},
        {"mesh": {"lumen_radii": (0.5, 0.7)}},
        {"mesh": {"lumen_radii": (1.0, 0.7)}},
        {"mesh": {"element": "hexahedron"}},
        {"skin_radius_distal": 62e-3, "skin_radius_proximal": 52e-3},
    ],
)
def test_impossible_values_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(GeometryError):
        CalfSegment(**wrong)


@pytest.mark.parametrize("element", ELEMENTS)
def test_taper(element: Any) -> None:
    """The skin becomes a cone as exactly as it was a cylinder; vein and bones stay as they are."""
    a, b, length = 53e-3, 57e-3, 0.12
    settings = MeshSettings(element=element, axial_layers=4)
    geometry = CalfSegment(skin_radius_distal=a, skin_radius_proximal=b, mesh=settings)
    domain, straight = domain_of(geometry), domain_of(CalfSegment(mesh=settings))
    skin = pi * length * (a * a + a * b + b * b) / 3
    inside = pi * length * (12.5e-3**2 + 7e-3**2 + 6.55e-3**2)
    assert domain.volume("tissue") == pytest.approx(skin - inside, rel=5e-5)
    assert geometry.exact_volumes()["tissue"] == pytest.approx(skin - inside, rel=1e-12)
    assert domain.area("skin") == pytest.approx(pi * (a + b) * sqrt(length**2 + (b - a) ** 2), rel=1e-5)
    off_cone = (x * x + y * y) ** 0.5 - (a + (b - a) * z / length)
    assert sqrt(Integrate(off_cone**2 * domain.ds("skin"), domain.mesh) / domain.area("skin")) < 2e-6
    for body in ("tibia", "fibula", "wall_outer", "interface"):
        assert second_moment(domain, domain.ds(body)) == pytest.approx(
            second_moment(straight, straight.ds(body)), 1e-10
        )
    for body in ("wall", "fluid"):
        assert second_moment(domain, domain.dx(body)) == pytest.approx(
            second_moment(straight, straight.dx(body)), 1e-12
        )
    assert domain.statistics()["smallest_jacobian_ratio"] > 0.1


def second_moment(domain: Domain, measure: Any) -> float:
    return float(Integrate((x * x + y * y + z * z) * measure, domain.mesh))


def test_taper_map_is_zero_near_vein_and_bones_and_full_at_the_skin() -> None:
    geometry = CalfSegment(skin_radius_distal=53e-3, skin_radius_proximal=57e-3)
    mesh = Mesh(geometry.netgen_mesh())  # straight: points lie on chords, up to 1 mm inside the skin
    shape = geometry.shape_map()
    angles = np.linspace(0, 2 * pi, 61)
    for body in (geometry.wall_outer, *geometry.bones):
        room = geometry.skin_radius - np.hypot(body.x, body.y) - body.radius
        for share in (0.3, 0.95):
            r = body.radius + share * STILL * room
            px, py = body.x + r * np.cos(angles), body.y + r * np.sin(angles)
            free = np.all([np.hypot(px - c.x, py - c.y) > c.radius for c in (geometry.wall_outer, *geometry.bones)], 0)
            points = mesh(px[free], py[free], np.full(free.sum(), 0.119))
            assert np.all(shape(points) == 0.0)
    towards = -0.7 * pi  # away from the bones
    px, py = 54.0e-3 * np.cos(towards), 54.0e-3 * np.sin(towards)
    ux, uy, uz = shape(mesh(px, py, 0.119))
    scale = geometry.taper * (2 * 0.119 / 0.12 - 1)
    assert (ux, uy, uz) == pytest.approx((scale * px, scale * py, 0.0), rel=1e-3)


def test_no_taper_no_map(calf: Domain) -> None:
    assert calf.geometry.shape_map() is None


def test_tube_is_a_vein_without_bones() -> None:
    tube = TubeSegment(length=30e-3, lumen_diameter=8e-3, mesh=MeshSettings(far_size=8e-3, axial_layers=2))
    domain = domain_of(tube)
    assert domain.volume() == pytest.approx(pi * 20e-3**2 * 30e-3, rel=1e-4)
    assert {"tibia", "fibula"}.isdisjoint(domain.mesh.GetBoundaries())
    assert tube.vein_centre == (0.0, 0.0)
    with pytest.raises(GeometryError, match="vein wall and skin overlap"):
        TubeSegment(outer_radius=6e-3)


def test_geometry_survives_a_file() -> None:
    geometry = CalfSegment(lumen_diameter=8e-3, mesh=MeshSettings(lumen_radii=(0.9, 0.7)))
    assert CalfSegment.from_dict(geometry.to_toml_dict()) == geometry
    written = CalfSegment.from_dict({"lumen_diameter_mm": 8.0, "mesh": {"lumen_radii": [0.9, 0.7]}})
    assert written == geometry


@pytest.mark.parametrize("element", ELEMENTS)
def test_elements_conform(element: Any) -> None:
    """Neighbours share whole facets: x y z is exact in H1; every facet with one element has a boundary element."""
    mesh = Mesh(TubeSegment(mesh=MeshSettings(element=element, axial_layers=2, far_size=8e-3)).netgen_mesh())
    field = GridFunction(H1(mesh, order=3))
    field.Set(x * y * z)
    assert Integrate((Grad(field) - CF((y * z, x * z, x * y))) ** 2, mesh, order=8) < 1e-24
    outer = [e for e in mesh.Elements(BND) if e.mat not in ("interface", "wall_outer", "lumen_layer")]
    assert len(outer) == sum(1 for facet in mesh.facets if len(facet.elements) == 1)


def test_pairs_of_parts_are_all_covered() -> None:
    assert {frozenset(p) for p in COLLISIONS} == {
        frozenset(p) for p in combinations(("vein wall", "tibia", "fibula", "skin"), 2)
    }


def steiner(a: float, b: float, t: float) -> float:
    """Return the area within the curve at a distance t outside of an ellipse with semi-axes a and b."""
    angle = 2 * pi * np.arange(2000) / 2000
    perimeter = 2 * pi * np.hypot(a * np.sin(angle), b * np.cos(angle)).mean()
    return pi * a * b + perimeter * t + pi * t * t


@pytest.mark.parametrize("tube", [TubeSegment, BareTube])
@pytest.mark.parametrize("element", ELEMENTS)
@pytest.mark.parametrize(("ratio", "turn"), [(1.2, 0.4), (3.2, -0.7), (5.0, 1.2)])
def test_an_oval_vein(tube: type[TubeSegment], element: Any, ratio: float, turn: float) -> None:
    """Its axes lie as asked for, the wall is of even thickness, the skin stays round, the inflow has unit mean."""
    mesh = MeshSettings(element=element, axial_layers=1, far_size=12e-3, lumen_radii=(0.6,), curving_order=3)
    aside, t = (2e-3 if tube is TubeSegment else 0.0), 1e-3
    geometry = tube(
        length=10e-3, lumen_diameter=10e-3, vein_x=aside, aspect_ratio=ratio, oval_direction=turn, mesh=mesh
    )
    domain, a, b = domain_of(geometry), 5e-3 * np.sqrt(ratio), 5e-3 / np.sqrt(ratio)
    for region, area in {"fluid": pi * a * b, "wall": steiner(a, b, t) - pi * a * b}.items():
        assert domain.volume(region) == pytest.approx(area * 10e-3, rel=1e-3), region
        assert geometry.exact_volumes()[region] == pytest.approx(area * 10e-3, rel=1e-9), region
    along, across = ((x - aside) * c + y * s for c, s in ((cos(turn), sin(turn)), (-sin(turn), cos(turn))))
    off = Integrate(
        ((along / a) ** 2 + (across / b) ** 2 - 1) ** 2 * domain.ds("interface", bonus_intorder=4), domain.mesh
    )
    assert off < (2e-3) ** 2 * domain.area("interface")
    inflow = Integrate(geometry.inflow()[2] * domain.ds("inlet", bonus_intorder=6), domain.mesh)
    assert inflow == pytest.approx(domain.area("inlet"), rel=1e-3)
    outer = "wall_outer" if tube is TubeSegment else "skin"
    perimeter = (steiner(a, b, t) - pi * a * b - pi * t * t) / t
    assert domain.area(outer) == pytest.approx((perimeter + 2 * pi * t) * 10e-3, rel=1e-3)
    # the second moment of the lumen's curve shifted by t along its normals
    angle = 2 * pi * np.arange(4000) / 4000
    speed = np.hypot(a * np.sin(angle), b * np.cos(angle))
    curve = a * np.cos(angle) + t * b * np.cos(angle) / speed
    exact = np.sum(curve**2 * (speed + t * a * b / speed**2)) / np.sum(speed + t * a * b / speed**2)
    moment = Integrate(along**2 * domain.ds(outer, bonus_intorder=4), domain.mesh) / domain.area(outer)
    assert moment == pytest.approx(exact, rel=2e-3)
    if tube is TubeSegment:
        assert domain.area("skin") == pytest.approx(2 * pi * geometry.outer_radius * 10e-3, rel=1e-3)


def test_the_size_of_a_lumen_is_said_in_one_of_three_ways() -> None:
    asked = TubeSegment(lumen_diameter=10e-3, aspect_ratio=4.0).veins[0]
    for same in ({"lumen_area": pi * 25e-6, "aspect_ratio": 4.0}, {"lumen_axes": (20e-3, 5e-3)}):
        found = TubeSegment(**same).veins[0]
        assert (found.lumen_radius, found.aspect_ratio) == pytest.approx((asked.lumen_radius, asked.aspect_ratio))
        assert TubeSegment.from_dict(TubeSegment(**same).to_toml_dict()) == TubeSegment(**same)
    with pytest.raises(GeometryError, match="lumen_diameter and lumen_area contradict each other: keep one of them"):
        TubeSegment(lumen_diameter=10e-3, lumen_area=1e-5)
    with pytest.raises(GeometryError, match="aspect_ratio and lumen_axes contradict each other"):
        TubeSegment(lumen_axes=(20e-3, 5e-3), aspect_ratio=3.0)
    with pytest.raises(GeometryError, match="must be the longer and the shorter one, at most 5 times as long"):
        TubeSegment(lumen_axes=(5e-3, 20e-3))


BESIDE = (
    CalfVein(lumen_diameter=5e-3, wall_thickness=0.6e-3, x=-10e-3, y=-20e-3),
    CalfVein(lumen_diameter=6e-3, x=-3.5e-3, y=-9e-3),
)
"""The second of them 1.3 mm beside the first vein of the calf, whose axis lies at (8, -6) mm."""


@pytest.mark.parametrize("element", [*ELEMENTS, "csg"])
def test_further_veins(element: Any) -> None:
    """Each has its own regions and boundaries of the exact sizes, its place, and faces that look out of the blood."""
    settings = MeshSettings(element=element, axial_layers=1, curving_order=3)
    geometry = CalfSegment(length=10e-3, further_veins=BESIDE, mesh=settings)
    assert CalfSegment.from_dict(geometry.to_toml_dict()) == geometry
    domain, L = domain_of(geometry), geometry.length
    assert domain.regions == ("tissue", "wall", "wall_2", "wall_3", "fluid", "fluid_2", "fluid_3")
    assert [vessel.name for vessel in geometry.vessels] == ["", "vein_2", "vein_3"]
    sizes = ((8e-3, -6e-3, 5.55e-3, 1e-3), (-10e-3, -20e-3, 2.5e-3, 0.6e-3), (-3.5e-3, -9e-3, 3e-3, 1e-3))
    for vessel, (x0, y0, r, t) in zip(geometry.vessels, sizes, strict=True):
        exact = {vessel.lumen: pi * r * r, vessel.wall: pi * ((r + t) ** 2 - r * r)}
        for region, area in exact.items():
            assert domain.volume(region) == pytest.approx(area * L, rel=1e-3), region
            assert geometry.exact_volumes()[region] == pytest.approx(area * L, rel=1e-12), region
        assert domain.area(vessel.interface) == pytest.approx(2 * pi * r * L, rel=1e-3)
        assert domain.area(vessel.outer) == pytest.approx(2 * pi * (r + t) * L, rel=1e-3)
        assert [domain.area(name) for name in vessel.openings] == pytest.approx(2 * [pi * r * r], rel=1e-3)
        middle = [
            Integrate(axis * domain.dx(vessel.lumen), domain.mesh) / domain.volume(vessel.lumen) for axis in (x, y)
        ]
        assert middle == pytest.approx([x0, y0], rel=1e-4)
        assert vessel.centreline == ((x0, y0, 0.0), (x0, y0, L))
        assert vessel.radius == r
        if element != "csg":
            flux = CF((x, y, z)) * specialcf.normal(3) * domain.ds(vessel.interface, *vessel.openings, bonus_intorder=6)
            assert Integrate(flux, domain.mesh) == pytest.approx(3 * domain.volume(vessel.lumen), rel=1e-9)
    holes = sum(pi * (r + t) ** 2 for _, _, r, t in sizes) + pi * (12.5e-3**2 + 7e-3**2)
    assert geometry.exact_volumes()["tissue"] == pytest.approx((pi * 55e-3**2 - holes) * L, rel=1e-12)
    assert domain.volume("tissue") == pytest.approx((pi * 55e-3**2 - holes) * L, rel=1e-4)


def test_further_veins_with_taper_and_an_oval_first() -> None:
    """They stay round cylinders while the first becomes an ellipse and the skin a cone."""
    settings = MeshSettings(element="mixed", axial_layers=1)
    straight = CalfSegment(length=20e-3, further_veins=BESIDE, mesh=settings)
    geometry = straight.replace(aspect_ratio=1.3, oval_direction=pi / 2, skin_radius_distal=53e-3)
    domain, before = domain_of(geometry), domain_of(straight)
    errors, first = domain.statistics()["relative_volume_errors"], pi * 5.55e-3**2 * 20e-3
    assert max(map(abs, errors.values())) < 1e-3
    assert domain.volume("fluid") == pytest.approx(first, rel=2e-4)
    for vessel in geometry.vessels[1:]:
        for name in (vessel.interface, vessel.outer):
            assert second_moment(domain, domain.ds(name)) == pytest.approx(second_moment(before, before.ds(name)), 1e-9)


def test_further_veins_in_the_way_are_refused() -> None:
    def beside(x0: float, y0: float) -> None:
        CalfSegment(further_veins=(CalfVein(lumen_diameter=6e-3, x=x0, y=y0),))

    with pytest.raises(GeometryError, match=r"vein wall and wall of vein 2 overlap by 3\.55 mm"):
        beside(1e-3, -6e-3)
    with pytest.raises(GeometryError, match=r"wall of vein 2 and fibula overlap"):
        beside(22e-3, 0.0)
    with pytest.raises(GeometryError, match=r"wall of vein 2 and skin overlap"):
        beside(30e-3, -45e-3)
    with pytest.raises(GeometryError, match=r"wall of vein 2 and wall of vein 3 overlap"):
        CalfSegment(further_veins=(BESIDE[0], BESIDE[0]))


@pytest.mark.parametrize("element", [*ELEMENTS, "csg"])
def test_a_sheath_around_the_wall(element: Any) -> None:
    """Of even thickness around an oval vein (csg: around a round one): its volume and that of what is around it."""
    mesh = MeshSettings(element=element, axial_layers=1, far_size=12e-3, lumen_radii=(0.6,), curving_order=3)
    ratio, t, d = (1.0 if element == "csg" else 2.0), 1e-3, 2.5e-3
    geometry = TubeSegment(
        length=10e-3, lumen_diameter=10e-3, aspect_ratio=ratio, sheath_thickness=d - t, vein_x=2e-3, mesh=mesh
    )
    domain, a, b = domain_of(geometry), 5e-3 * np.sqrt(ratio), 5e-3 / np.sqrt(ratio)
    wall, sheath = (steiner(a, b, distance) for distance in (t, d))
    exact = {"wall": wall - pi * a * b, "sheath": sheath - wall, "tissue": pi * geometry.outer_radius**2 - sheath}
    assert domain.regions == ("tissue", "wall", "sheath", "fluid")
    for region, area in exact.items():
        assert domain.volume(region) == pytest.approx(area * 10e-3, rel=2e-3), region
        assert geometry.exact_volumes()[region] == pytest.approx(area * 10e-3, rel=1e-9), region
    perimeter = (wall - pi * a * b - pi * t * t) / t
    assert domain.area("sheath_outer") == pytest.approx((perimeter + 2 * pi * d) * 10e-3, rel=2e-3)
    assert {"sheath_bottom", "sheath_top"} < {*domain.ends}
    with pytest.raises(GeometryError, match="a tube of wall alone has no sheath"):
        BareTube(sheath_thickness=1e-3)
    with pytest.raises(GeometryError, match="vein sheath and fibula overlap"):
        CalfSegment(sheath_thickness=6e-3)


REGIONS = CalfSegment(
    length=10e-3, fat=FatLayer(), compartments=Compartments(),
    mesh=MeshSettings(element="mixed", far_size=50e-3, vein_size=6.4e-3, axial_layers=2, lumen_radii=(0.646,)),
)  # fmt: skip


def test_fat_and_compartments() -> None:
    """Their areas by a sum over a fine grid of who is nearer to what; septa bear names, ends that of the tissue."""
    domain, exact = domain_of(REGIONS), REGIONS.exact_volumes()
    assert domain.regions == (*COMPARTMENTS, "wall", "fat", "fluid")
    step = 0.05e-3
    x, y = np.meshgrid(np.arange(-55e-3, 55e-3, step) + step / 2, np.arange(-55e-3, 55e-3, step) + step / 2)
    points = np.column_stack([x.ravel(), y.ravel()])
    tissue, given = REGIONS._tissue_at(points), REGIONS.compartments
    assert given
    inside = np.hypot(*points.T) < 50e-3
    for hole in (*REGIONS.bones, *REGIONS.outermost):
        inside &= ~hole.holds(points)
    for number, name in enumerate(COMPARTMENTS, start=1):
        assert exact[name] == pytest.approx(10e-3 * step**2 * np.sum(inside & (tissue == number)), rel=1e-3), name
        assert domain.volume(name) == pytest.approx(exact[name], rel=5e-4), name
    assert domain.volume("fat") == pytest.approx(pi * (55e-3**2 - 50e-3**2) * 10e-3, rel=1e-4)
    # between the bones, in front of them, beside the fibula, behind
    places = {"deep_posterior": (-4e-3, 8e-3), "anterior": (5e-3, 30e-3), "lateral": (35e-3, 10e-3),
              "superficial_posterior": (0.0, -30e-3), "fat": (-52e-3, 0.0)}  # fmt: skip
    for name, place in places.items():
        assert domain.mesh[ElementId(VOL, domain.mesh(*place, 2e-3).nr)].mat == name
    septa = {"interosseous_membrane", "transverse_septum", "anterior_septum", "posterior_septum", "tibial_septum"}
    assert {*septa, "fascia"} < {*domain.mesh.GetBoundaries()}
    bones = REGIONS.bones
    between = np.hypot(bones[0].x - bones[1].x, bones[0].y - bones[1].y) - bones[0].radius - bones[1].radius
    assert domain.area("interosseous_membrane") == pytest.approx(between * 10e-3, rel=1e-6)
    assert domain.area("tissue_bottom") * 10e-3 == pytest.approx(
        sum(exact[name] for name in (*COMPARTMENTS, "fat")), rel=1e-4
    )
    assert domain.beyond(domain.vessels[0]) == "superficial_posterior"


def test_fat_under_a_tapered_skin() -> None:
    """What the taper leaves inside of the fascia, by a fine sum over the section at each height."""
    tapered = REGIONS.replace(skin_radius_distal=53e-3, compartments=None)
    domain, exact = domain_of(tapered), tapered.exact_volumes()
    assert exact["fat"] + exact["tissue"] == pytest.approx(
        tapered.replace(fat=None).exact_volumes()["tissue"], rel=1e-12
    )
    even = pi * (54e-3**2 - 49e-3**2) * 10e-3
    assert abs(domain.volume("fat") - exact["fat"]) < 0.1 * abs(exact["fat"] - even)
    parted = tapered.replace(compartments=Compartments())
    assert {*parted.exact_volumes()} == {"fat", "wall", "fluid"}


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"fat": FatLayer(thickness=8e-3)}, "tibia and fascia overlap"),
        ({"fat": FatLayer(thickness=60e-3)}, "leaves nothing inside"),
        ({"compartments": Compartments(deep_corner=(0.0, -3e-3))}, "transverse_septum and wall_outer are"),
        ({"compartments": Compartments(anterior_septum=2.5)}, "anterior_septum and tibia are"),
        ({"compartments": Compartments(), "mesh": MeshSettings(element="csg")}, "neither fat nor compartments"),
    ],
)
def test_septa_and_fat_that_do_not_fit(values: Any, said: str) -> None:
    with pytest.raises(GeometryError, match=said):
        CalfSegment(**values)
    with pytest.raises(GeometryError, match="a tube of wall alone has no fat"):
        BareTube(fat=FatLayer())


def test_bare_tube_has_no_outer_wall() -> None:
    (vessel,), (of_tube,) = BareTube(length=10e-3).vessels, TubeSegment(length=10e-3).vessels
    assert (vessel.outer, of_tube.outer) == (None, "wall_outer")
    assert vessel.wall == "wall"


def test_an_oval_vein_of_the_calf() -> None:
    """With a tapered skin; one that reaches into a bone is refused."""
    mesh = MeshSettings(element="mixed", far_size=50e-3, vein_size=6.4e-3, axial_layers=3, lumen_radii=(0.646,))
    oval = CalfSegment(aspect_ratio=3.2, skin_radius_distal=52e-3, mesh=mesh)
    statistics = domain_of(oval).statistics()
    assert max(map(abs, statistics["relative_volume_errors"].values())) < 5e-4
    assert statistics["smallest_jacobian_ratio"] > 0.2
    said = r"wall and fibula overlap by 0\.9\d+ mm: wall_outer of 21\.9 by 8\.21 mm, the longer axis at 45\.8 degrees"
    with pytest.raises(GeometryError, match=said):
        CalfSegment(aspect_ratio=3.2, oval_direction=0.8)


@pytest.mark.parametrize("ratio", [1.0, 2.0, 5.0])
def test_the_length_of_an_ellipse(ratio: float) -> None:
    """By the trapezoidal rule, which is exact to rounding for what is periodic."""
    ellipse, angles = Ellipse("lumen", 1.0, 2.0, 3.0, ratio), np.linspace(0, 2 * np.pi, 4000, endpoint=False)
    a, b = 3.0 * ratio**0.5, 3.0 / ratio**0.5
    assert ellipse.length == pytest.approx(
        np.hypot(a * np.sin(angles), b * np.cos(angles)).mean() * 2 * np.pi, rel=1e-9
    )
