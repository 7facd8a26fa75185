"""Lofted calf segments: exact volumes, developed flow, from a phantom and back, runs, refusals that name the slice."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable
from functools import cache
from math import pi
from pathlib import Path
from typing import Any

import ngsolve as ng
import numpy as np
import pytest
import SimpleITK as sitk  # noqa: N813 - its usual name
from ngfsi_geometry import templates
from ngfsi_geometry.calf import CalfSegment, Compartments
from ngfsi_geometry.calf_section import COMPARTMENTS, subject
from ngfsi_geometry.example_labels import rough_calf
from ngfsi_geometry.imaging import LABELS, LabelMap, phantom_stack
from ngfsi_geometry.labelled import LabelledCalf
from ngfsi_geometry.loft import DENSE, SAMPLES, around, series
from ngfsi_geometry.lofted_calf import ANATOMY, LoftedCalf
from ngfsi_geometry.segment import FatLayer, MeshSettings

from ngfsi import cli
from ngfsi.case import Case
from ngfsi.case.geometries import name_of
from ngfsi.config.columns import read_columns
from ngfsi.config.model import ConfigModel
from ngfsi.errors import GeometryError
from ngfsi.mesh.domain import Domain
from ngfsi.mesh.geometry import COMPARTMENTS as COMPARTMENTS_OF_CALF
from ngfsi.outlines.outline import Outline
from ngfsi.run import run
from ngfsi.store import open_run
from tests.geometry.test_imaging import voxel_error
from tests.vein import domain_of

COARSE = MeshSettings(
    element="mixed", far_size=25e-3, vein_size=3.6e-3, axial_layers=1, lumen_radii=(0.6,), curving_order=3
)
LENGTH, COUNT = 10e-3, 6
HEIGHTS = tuple(map(float, np.linspace(0, LENGTH, COUNT)))
TAPERED = CalfSegment(length=LENGTH, skin_radius_distal=54e-3, skin_radius_proximal=56e-3, mesh=COARSE)


def circles(calf: CalfSegment) -> dict[str, tuple[Outline, ...]]:
    """Return the outlines of a tapered calf at HEIGHTS."""
    a, b = calf.skin_radius_distal, calf.skin_radius_proximal
    found = {bone.name: (Outline.circle(bone.x, bone.y, bone.radius, 64),) * COUNT for bone in calf.bones}
    found["lumen"] = (Outline.circle(*calf.vein_centre, calf.lumen_radius, 64),) * COUNT
    found["skin"] = tuple(Outline.circle(0, 0, a + (b - a) * z / LENGTH, 64) for z in HEIGHTS)
    return found


@cache
def lofted() -> LoftedCalf:
    return LoftedCalf(heights=HEIGHTS, mesh=COARSE, **circles(TAPERED))


def ellipse(a: float, b: float, x: float, y: float, turn: float = 0.0) -> Outline:
    t = 2 * pi * np.arange(96) / 96
    shape = (a * np.cos(t) + 1j * b * np.sin(t)) * np.exp(1j * turn) + x + 1j * y
    return Outline.through(np.column_stack([shape.real, shape.imag]))


def test_lofts_of_circles_are_the_circular_calf() -> None:
    """The taper, which is a polynomial there and a loft with Laplace's equation here, included."""
    here, there = domain_of(lofted()), domain_of(TAPERED)
    for name in there.regions:
        assert here.volume(name) == pytest.approx(there.volume(name), rel=5e-4), name
    for name in TAPERED.boundary_names:
        # edges of second order have errors of a part in a thousand
        assert here.area(name) == pytest.approx(there.area(name), rel=1.5e-3), name
    assert here.area("inlet") == pytest.approx(pi * TAPERED.lumen_radius**2, rel=1e-4)
    assert here.geometry.rigid_names == ("tibia", "fibula")


def test_fat_and_compartments_of_outlines() -> None:
    """Those of the circular calf, whose septa lie as here; the fat is a ring. Membranes find their boundaries."""
    straight = TAPERED.replace(skin_radius_distal=55e-3, skin_radius_proximal=55e-3)
    straight = straight.replace(fat=FatLayer(thickness=6e-3), compartments=Compartments())
    geometry = LoftedCalf(heights=HEIGHTS, mesh=COARSE, fat=straight.fat, compartments=Compartments(),
                          **circles(straight))  # fmt: skip
    here, exact = domain_of(geometry), straight.exact_volumes()
    assert set(here.regions) == {*COMPARTMENTS_OF_CALF, "fat", "wall", "fluid"}
    for name, volume in exact.items():
        # septa follow the surfaces as an elastic body does, from chords to arcs
        assert here.volume(name) == pytest.approx(volume, rel=2e-2 if name in COMPARTMENTS_OF_CALF else 1e-3), name
    assert geometry.exact_volumes()["fat"] == pytest.approx(pi * (55e-3**2 - 49e-3**2) * LENGTH, rel=1e-4)
    assert here.area("fascia") == pytest.approx(2 * pi * 49e-3 * LENGTH, rel=1e-3)
    septum = straight._septa[0].line
    assert here.area("interosseous_membrane") == pytest.approx(np.hypot(*(septum[1] - septum[0])) * LENGTH, rel=5e-3)
    assert here.statistics()["smallest_jacobian_ratio"] > 0.1
    with pytest.raises(GeometryError, match=r"^slice \d: fat of 60 mm leaves nothing inside: make it thinner$"):
        geometry.replace(fat=FatLayer(thickness=60e-3))


def test_distance_within_a_star() -> None:
    """Of an ellipse, less its perimeter times t, plus pi t^2 (Steiner), as long as t is less than the least radius of
    curvature; and seen from beside the middle of a circle."""
    outline = ellipse(54e-3, 49e-3, 0.0, 0.0)
    t, row = 5e-3, outline.harmonics((1e-3, 2e-3), 24)
    found = around(series(row, DENSE * SAMPLES), -t)
    area = pi / len(found) * found.sum()
    assert area == pytest.approx(pi * 54e-3 * 49e-3 - outline.length * t + pi * t * t, rel=2e-4)
    row = Outline.circle(2e-3, 0.0, 5e-3, 64).harmonics((0.0, 0.0), 24)
    angles = 2 * pi * np.arange(SAMPLES) / SAMPLES
    expected = 2e-3 * np.cos(angles) + np.sqrt(4e-3**2 - (2e-3 * np.sin(angles)) ** 2)
    assert np.sqrt(around(series(row, DENSE * SAMPLES), -1e-3)) == pytest.approx(expected, rel=5e-4)


def test_volumes_of_bent_and_turning_parts() -> None:
    """Ellipses of one area at every height, moved and turned: volumes are areas times length, wherever they lie.

    The outer area of the wall is, by Steiner's formula for parallel curves, that of the lumen + perimeter t + pi t^2.
    """
    s = np.linspace(-0.5, 0.5, COUNT)
    skin = tuple(ellipse(54e-3, 49e-3, 3e-3 * q, 5e-3 + 2e-3 * q, 0.2 * q) for q in s)
    tibia = tuple(ellipse(14e-3, 10e-3, -20e-3 + 2e-3 * q, 30e-3 + 3e-3 * q**2, 0.3) for q in s)
    fibula = tuple(ellipse(7e-3, 6e-3, 20e-3 - 2e-3 * q, 10e-3 + 1e-3 * q, 0.0) for q in s)
    lumen = tuple(ellipse(6e-3, 3.5e-3, 5e-3 + 4e-3 * q, -6e-3 - 2e-3 * q**2, 0.4 + 0.3 * q) for q in s)
    mesh = COARSE.replace(curving_order=3, axial_layers=2, far_size=18e-3, vein_size=2.5e-3)
    geometry = LoftedCalf(skin=skin, tibia=tibia, fibula=fibula, lumen=lumen, heights=HEIGHTS, mesh=mesh)
    t, hole = geometry.wall_thickness, pi * 6e-3 * 3.5e-3
    outer = hole + lumen[0].length * t + pi * t * t
    exact = {"fluid": hole, "wall": outer - hole}
    exact["tissue"] = pi * (54e-3 * 49e-3 - 14e-3 * 10e-3 - 7e-3 * 6e-3) - outer
    domain = domain_of(geometry)
    for name, area in exact.items():
        assert geometry.exact_volumes()[name] == pytest.approx(area * LENGTH, rel=1e-3), name
        assert domain.volume(name) == pytest.approx(area * LENGTH, rel=3e-3), name
    assert domain.area("inlet") == pytest.approx(hole, rel=2e-3)
    assert domain.statistics()["smallest_jacobian_ratio"] > 0.1
    outwards = ng.CF((ng.x, ng.y, ng.z)) * ng.specialcf.normal(3)
    body = [name for name in geometry.boundary_names if name not in ("interface", "wall_outer")]
    flux = ng.Integrate(outwards * domain.ds(*body, bonus_intorder=6), domain.mesh)
    assert flux == pytest.approx(3 * domain.volume(), rel=1e-8)  # no gaps, no overlaps


def test_distance_around_a_star() -> None:
    """Around a circle that is seen from beside its middle; around a notch nothing crosses itself."""
    x, radius, t = 2e-3, 5e-3, 1e-3
    row = Outline.circle(x, 0.0, radius, 64).harmonics((0.0, 0.0), 24)
    angles = 2 * pi * np.arange(SAMPLES) / SAMPLES
    outer = radius + t
    expected = x * np.cos(angles) + np.sqrt(outer**2 - (x * np.sin(angles)) ** 2)
    assert np.sqrt(around(series(row, DENSE * SAMPLES), t)) == pytest.approx(expected, rel=3e-4)


def compartments_file(folder: Path) -> Path:
    """Write the label map of a calf whose compartments lie obliquely: moved by 4 mm from end to end."""
    given = subject(1, superficial_posterior=ellipse(26e-3, 12e-3, -2e-3, -34e-3))
    slices = []
    for s in np.linspace(-2e-3, 2e-3, COUNT):
        parts = {name: getattr(given, name) for name in ("skin", "tibia", "fibula")}
        for name in COMPARTMENTS:
            outline = getattr(given, name)
            parts[name] = Outline.through(outline.points + np.array([s, 0.0]))
        slices.append({**parts, "lumen": given.veins[0].lumen})
    file = folder / "compartments.nii.gz"
    image = phantom_stack(slices, given.skin)[0]
    image.SetOrigin([*image.GetOrigin()[:2], 30.0])
    sitk.WriteImage(image, str(file))
    return file


def test_compartments_of_a_label_map(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Volumes within 2 % of the labels', by elements of 5 mm; the vein has one neighbour; a case has laws for all."""
    file = compartments_file(tmp_path)
    mesh = COARSE.replace(far_size=5e-3, axial_layers=2)
    geometry = LabelledCalf(file=str(file), mesh=mesh, compartments=("lateral", *COMPARTMENTS[:1], *COMPARTMENTS[2:]))
    domain = domain_of(geometry)
    assert domain.regions == ("tissue", "wall", *COMPARTMENTS, "fluid")
    wanted = geometry.label_volumes()
    numbers = sitk.GetArrayFromImage(sitk.ReadImage(str(file)))
    pixels = np.array([np.sum(layer == LABELS["lateral"]) for layer in numbers])
    assert wanted["lateral"] == pytest.approx(np.sum((pixels[1:] + pixels[:-1]) / 2) * 0.625e-3**2 * 2e-3, rel=1e-9)
    for name, volume in wanted.items():
        assert domain.volume(name) == pytest.approx(volume, rel=0.02), name
    whole = domain_of(geometry.replace(compartments=()))
    assert sum(domain.volume(name) for name in ("tissue", *COMPARTMENTS)) == pytest.approx(
        whole.volume("tissue"), rel=1e-9
    )
    assert domain.beyond(domain.vessels[0]) in ("tissue", "superficial_posterior")
    with pytest.raises(GeometryError, match="'fat' is not a known label that can be a region"):
        geometry.replace(compartments=("fat",))
    case = tmp_path / "leg.toml"
    case.write_text(case_of(geometry).to_toml(), encoding="utf-8")
    with pytest.raises(SystemExit) as ended:
        cli.main(["outlines", str(case), "-o", str(tmp_path / "out")])
    assert ended.value.code == 0
    assert "deep_posterior: " in capsys.readouterr().out


def test_the_vessel_lies_in_the_straight_mesh() -> None:
    """With the circle's radius that the lofts have, which is smaller in the mesh where parts are near each other."""
    geometry = lofted()
    (vessel,) = geometry.vessels
    x, y = geometry.straight.vein_centre
    assert vessel.centreline == ((x, y, 0.0), (x, y, geometry.length))
    assert vessel.radius == pytest.approx(TAPERED.lumen_radius, rel=1e-4)
    assert geometry.inflow() is None


@pytest.fixture(scope="module")
def label_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Label map of the tapered calf."""
    parts = circles(TAPERED)
    slices = [{name: parts[name][k] for name in ANATOMY} for k in range(COUNT)]
    file = tmp_path_factory.mktemp("image") / "leg.nii.gz"
    sitk.WriteImage(phantom_stack(slices, parts["skin"][-1])[0], file)
    return file


def test_phantom_to_calf(label_file: Path) -> None:
    """Volumes within the error of areas counted in pixels, three standard deviations of their mean over the slices."""
    geometry = LabelledCalf(file=str(label_file), mesh=COARSE)
    assert LabelledCalf.from_dict(geometry.to_toml_dict()) == geometry
    assert geometry.length == pytest.approx(LENGTH, rel=1e-9)
    parts, true = circles(TAPERED), TAPERED.exact_volumes()
    sigma = {name: 3 * LENGTH * voxel_error(parts[name][2]) / np.sqrt(COUNT) for name in ANATOMY}
    errors = {"fluid": sigma["lumen"], "tissue": sum(sigma.values())}
    domain = Domain.build(geometry, cache=False)
    for name, error in errors.items():
        assert geometry.exact_volumes()[name] == pytest.approx(true[name], rel=0, abs=error), name
        assert domain.volume(name) == pytest.approx(true[name], rel=1e-3, abs=error), name
    # the wall's thickness is given: its volume goes with the perimeter alone
    assert geometry.exact_volumes()["wall"] == pytest.approx(true["wall"], rel=1e-2)
    assert geometry.vein_centre == pytest.approx(TAPERED.vein_centre, abs=0.1e-3)


def case_of(geometry: ConfigModel) -> Case:
    written = tomllib.loads(templates.calf())
    written["geometry"] = {"type": name_of(type(geometry)), **geometry.to_toml_dict()}
    return Case.from_dict(written).replace(**{
        "name": "lofted", "loads.skin_pressure.duration": 0.1, "loads.skin_pressure.final": 1000.0, "time.step": 0.1,
        "time.end": 0.1, "output.stations": 3,
    })  # fmt: skip


def area_loss(folder: Path) -> float:
    area = open_run(folder).series["lumen_area_mean_m2"]
    return float(1 - area[-1] / area[0])


def test_runs_of_a_label_map_and_of_the_calf_it_shows(
    label_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Through the command line, from a file that names the label map: the loss of area is that of the true calf.

    With exact outlines the two differ by what the taper's map does inside of the tissue, with pixels by their error.
    """
    file = tmp_path / "lofted.toml"
    file.write_text(case_of(LabelledCalf(file=str(label_file), mesh=COARSE)).to_toml())
    with pytest.raises(SystemExit) as ended:
        cli.main(["run", str(file), "--output", str(tmp_path / "image"), "--quiet"])
    assert ended.value.code == 0, capsys.readouterr().err
    for name, geometry in {"true": TAPERED, "outlines": lofted()}.items():
        run(case_of(geometry), tmp_path / name, quiet=True)
    true = area_loss(tmp_path / "true")
    assert true > 0.02
    assert area_loss(tmp_path / "outlines") == pytest.approx(true, rel=2e-3)
    assert area_loss(tmp_path / "image") == pytest.approx(true, rel=2e-2)
    flow = open_run(tmp_path / "image").series["flow_in_m3_s"][-1]
    assert flow == pytest.approx(2.913e-6, rel=1e-6)


def test_rough_labels_make_a_calf(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A vein that is a crescent in one slice and moves between thick ones, a bone with an arm in the last ones.

    The volume of the blood is that of its voxels, within the error of one slice in twelve; so is what the command says.
    """
    image = rough_calf()
    numbers = sitk.GetArrayFromImage(image)
    sitk.WriteImage(image, tmp_path / "leg.seg.nrrd")
    mesh = COARSE.replace(axial_layers=3, far_size=50e-3, vein_size=5e-3)
    geometry = LabelledCalf(file=str(tmp_path / "leg.seg.nrrd"), further_veins=("lumen_2",), mesh=mesh)
    voxels = float((numbers == LABELS["lumen"]).sum(axis=(1, 2))[1:-1].mean()) * 1e-6
    assert geometry.exact_volumes()["fluid"] == pytest.approx(voxels * geometry.length, rel=0.02)
    assert Domain.build(geometry, cache=False).statistics()["smallest_jacobian_ratio"] > 0.05
    (tmp_path / "case.toml").write_text(case_of(geometry).to_toml())
    with pytest.raises(SystemExit) as ended:
        cli.main(["outlines", str(tmp_path / "case.toml"), "--output", str(tmp_path / "out")])
    assert ended.value.code == 0
    assert re.search(r"lumen: area [+-]0\.[0-9]+% over all slices, at most .* \(slice 5\)", capsys.readouterr().out)
    found = read_columns(tmp_path / "out" / "deviations.csv", {"distance_max": "length", "distance_rms": "length"})
    assert len(found["distance_max"]) == 5 * len(numbers)
    # of pixels of 1 mm: the crescent and the arm are more than two beside their labels, the others are not
    said = [re.search(r"'(\w+)' is up to ([\d.]+) mm .* slice (\d+),", sentence) for sentence in geometry.remarks]
    assert {one[1]: one[3] for one in said if one} == {"tibia": "9", "lumen": "5"}
    assert 0.2e-3 < np.median(found["distance_rms"]) < 1e-3
    assert (tmp_path / "out" / "sections.png").stat().st_size > 10_000


def changed(file: Path, change: Callable[[Any], None]) -> LabelMap:
    image = LabelMap.read(file)
    numbers = image.numbers.copy()
    change(numbers)
    return LabelMap(numbers, image.origin, image.spacing, image.labels)


def test_refusals_name_the_slice(label_file: Path) -> None:
    def without_fibula(numbers: Any) -> None:
        numbers[4][numbers[4] == LABELS["fibula"]] = LABELS["skin"]

    def without_lumen(numbers: Any) -> None:
        numbers[3][numbers[3] == LABELS["lumen"]] = LABELS["skin"]

    def moved(numbers: Any) -> None:
        lumen = numbers[5] == LABELS["lumen"]
        numbers[5][lumen] = LABELS["skin"]
        numbers[5][np.roll(lumen, -16, axis=0)] = LABELS["lumen"]

    def touching(numbers: Any) -> None:
        lumen = numbers[2] == LABELS["lumen"]
        numbers[2][np.roll(lumen, 7, axis=1) & ~lumen] = LABELS["fibula"]

    with pytest.raises(GeometryError, match="slice 4: 'fibula' is not there: label it in this slice"):
        changed(label_file, without_fibula).calf()
    with pytest.raises(GeometryError, match="slice 3 is empty of 'lumen'"):
        changed(label_file, without_lumen).calf()
    with pytest.raises(GeometryError, match=r"slice 5: 'lumen' lies 10\.0 mm beside that of the slice before"):
        changed(label_file, moved).calf()
    with pytest.raises(GeometryError, match=r"slice 2: "):
        changed(label_file, touching).calf()
    image = LabelMap.read(label_file)
    with pytest.raises(GeometryError, match="lies in slices 2 to 4: a lofted calf needs 4, label it in more"):
        image.calf(first=2, last=4)
    with pytest.raises(GeometryError, match="there are no slices 4 to 6: the image has 0 to 5"):
        image.calf(first=4, last=6)
    with pytest.raises(GeometryError, match="slice 2: fibula and the wall of vein 1 are"):
        image.calf(first=2, wall_thickness=6e-3)
    with pytest.raises(GeometryError, match=r"the label map 'nothing\.nii' cannot be read: No such file"):
        LabelledCalf(file="nothing.nii")
    with pytest.raises(GeometryError, match="is not the file of this case, it has changed"):
        LabelledCalf(file=str(label_file), sha256="0" * 64)
    parts = circles(TAPERED)
    with pytest.raises(GeometryError, match="as many heights: there are 6 heights, 6 of skin, 6 of tibia, 5 of fibula"):
        LoftedCalf(heights=HEIGHTS, **(parts | {"fibula": parts["fibula"][1:]}))
    with pytest.raises(GeometryError, match="that of slice 2 does not: sort them"):
        LoftedCalf(heights=(HEIGHTS[0], HEIGHTS[2], HEIGHTS[1], *HEIGHTS[3:]), **parts)


def test_sections_of_real_shape_give_valid_elements() -> None:
    """Rounded triangles as tibias, oval veins, bones and vein that move apart along the segment."""
    for number in (1, 2, 3, 4):
        s = subject(number)
        q = np.linspace(-0.5, 0.5, COUNT)
        oval = s.veins[0].lumen.centroid + (s.veins[0].lumen.points - s.veins[0].lumen.centroid) * [1.4, 0.7]
        parts = {
            name: tuple(Outline.through(points + share * np.array(way)) for share in q)
            for name, points, way in (
                ("skin", s.skin.points, (0.0, 0.0)), ("tibia", s.tibia.points, (2e-3, 3e-3)),
                ("fibula", s.fibula.points, (-3e-3, 1e-3)), ("lumen", oval, (6e-3, -4e-3)),
            )
        }  # fmt: skip
        geometry = LoftedCalf(heights=tuple(12 * z for z in HEIGHTS), mesh=COARSE, **parts)
        quality = domain_of(geometry).statistics()["smallest_jacobian_ratio"]
        assert quality > 0.05, number
