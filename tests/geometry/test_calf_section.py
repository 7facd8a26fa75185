"""Outlines and cross-sections of the calf."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from ngfsi_geometry.calf_section import SUBJECTS, CalfSection, Vein, subject

from ngfsi.errors import GeometryError, OutputError
from ngfsi.outlines.outline import Outline
from tests.vein import domain_of

ANGLES = 2 * np.pi * np.arange(48) / 48


def ellipse(a: float, b: float, x: float = 0.0) -> Outline:
    return Outline.through(np.column_stack([x + a * np.cos(ANGLES), b * np.sin(ANGLES)]))


def test_area_length_and_centroid_of_an_ellipse() -> None:
    outline = ellipse(3e-3, 2e-3, x=1e-3)
    assert outline.area == pytest.approx(np.pi * 6e-6, rel=2e-6)
    # Ramanujan's second formula, exact to 1e-9 at this eccentricity
    h = (1 / 5) ** 2
    assert outline.length == pytest.approx(np.pi * 5e-3 * (1 + 3 * h / (10 + np.sqrt(4 - 3 * h))), rel=2e-6)
    assert outline.centroid == pytest.approx([1e-3, 0.0], rel=1e-6, abs=1e-12)


def test_arc_length_and_nearest_points() -> None:
    outline = ellipse(3e-3, 2e-3)
    arc = outline.length * np.array([0.0, 0.123, 0.5, 0.987])
    points = outline.at(arc)
    assert np.allclose((points[:, 0] / 3e-3) ** 2 + (points[:, 1] / 2e-3) ** 2, 1, rtol=2e-5)
    assert np.mod(outline.nearest(points) + 1e-9, outline.length) == pytest.approx(arc + 1e-9, rel=1e-6)
    fine = outline.resampled(1000)
    steps = np.linalg.norm(np.diff(fine, axis=0), axis=1)
    assert np.ptp(steps) < 1e-4 * steps.mean()
    # the nearest point of a circle lies on the ray from its centre
    circle = Outline.circle(0.0, 0.0, 1e-3)
    assert circle.nearest(np.array([[3e-3, 3e-3], [0.0, -0.2e-3]])) == pytest.approx(
        np.array([1, 6]) * np.pi / 4 * 1e-3, rel=1e-4
    )


def test_orientation_and_repeated_end() -> None:
    points = ellipse(3e-3, 2e-3).points
    for given in (points[::-1], np.vstack([points, points[:1]])):
        assert Outline.through(given).area == pytest.approx(np.pi * 6e-6, rel=2e-6)


def test_offset() -> None:
    wall = Outline.circle(1e-3, 2e-3, 4e-3).offset(0.8e-3)
    assert wall.area == pytest.approx(np.pi * 4.8e-3**2, rel=1e-4)


@pytest.mark.parametrize(
    ("points", "sentence"),
    [
        (np.array([[0, 0], [2, 2], [2, 0], [0, 2.0]]) * 1e-3, "the outline crosses itself between points 1 and 3"),
        # a quarter is missing: sqrt(2) radii, over 2 sin(pi / 48)
        (Outline.circle(0.0, 0.0, 1e-3, 48).points[:37], r"is open: .* point are 1\.41 mm apart, 11 times the usual"),
        (np.array([[0, 0], [1, 0], [1, 0], [0, 1.0]]), "the same point twice, number 2 and the next"),
    ],
)
def test_refused_outlines(points: np.ndarray, sentence: str) -> None:
    with pytest.raises(GeometryError, match=sentence):
        Outline.through(points)


def test_outline_from_csv(tmp_path: Path) -> None:
    file = tmp_path / "skin.csv"
    points = 1e3 * ellipse(30e-3, 20e-3).points
    file.write_text("y_mm,x_mm\n" + "\n".join(f"{y},{x}" for x, y in points) + "\n")
    assert Outline.from_csv(file).area == pytest.approx(np.pi * 6e-4, rel=2e-6)
    file.write_text("x,y\n1,2\n")
    with pytest.raises(OutputError, match="no column of 'x': name it one of x_m, x_cm, x_mm"):
        Outline.from_csv(file)
    file.write_text("x_mm,y_mm\n1,2\n1,oops\n")
    with pytest.raises(OutputError, match="line 3: 'oops' in column 'y_mm' is not a finite number"):
        Outline.from_csv(file)


@pytest.mark.parametrize("number", SUBJECTS)
def test_areas_of_the_meshed_subjects(number: int) -> None:
    section = subject(number)
    domain = domain_of(section)
    inside = section.skin.area - section.tibia.area - section.fibula.area - section.veins[0].lumen.area
    assert domain.volume() == pytest.approx(inside, rel=2e-5)
    assert domain.volume("wall") == pytest.approx(np.pi * (4.8e-3**2 - 4e-3**2), rel=5e-4)
    for name in ("anterior", "lateral"):
        assert domain.volume(name) == pytest.approx(getattr(section, name).area, rel=1e-4)
    # the fibula stands in the border of the deep posterior compartment
    assert 0.7 * section.deep_posterior.area < domain.volume("deep_posterior") < section.deep_posterior.area
    assert domain.statistics()["smallest_jacobian_ratio"] > 0.3


def test_fascia_and_two_veins() -> None:
    one = subject(1)
    veins = (*one.veins, Vein(lumen=Outline.circle(-12e-3, -18e-3, 2e-3), wall_thickness=0.5e-3))
    section = one.replace(fascia=one.skin.offset(-5e-3), veins=veins)
    domain = domain_of(section)
    assert domain.volume("fat") == pytest.approx(one.skin.area - section.fascia.area, rel=1e-4)
    assert domain.area("lumen_2") == pytest.approx(2 * np.pi * 2e-3, rel=1e-4)
    assert domain.volume("wall") == pytest.approx(section.exact_volumes()["wall"], rel=1e-3)
    names = [(v.name, v.lumen, v.interface, v.outer, v.openings) for v in section.vessels]
    assert names == [("", None, "lumen", "wall_outer", ()), ("vein_2", None, "lumen_2", "wall_outer_2", ())]
    assert [v.radius for v in section.vessels] == pytest.approx([4e-3, 2e-3], rel=1e-4)


def test_section_from_a_folder(tmp_path: Path) -> None:
    one = subject(2)
    outlines = {"skin": one.skin, "tibia": one.tibia, "fibula": one.fibula, "vein": one.veins[0].lumen}
    for name, outline in outlines.items():
        rows = "\n".join(f"{x!r},{y!r}" for x, y in zip(outline.x, outline.y, strict=True))
        (tmp_path / f"{name}.csv").write_text(f"x_m,y_m\n{rows}\n")
    section = CalfSection.from_folder(tmp_path)
    assert section.solids == ("tissue", "wall")
    assert section.skin.area == pytest.approx(one.skin.area, rel=1e-9)


def test_refused_sections() -> None:
    one = subject(1)
    with pytest.raises(GeometryError, match=r"tibia and the wall of vein 1 are .* mm of tissue must lie between"):
        one.replace(veins=(Vein(lumen=Outline.circle(-14e-3, 10e-3, 4e-3)),))
    with pytest.raises(GeometryError, match="the wall of vein 1 and skin are across each other"):
        one.replace(veins=(Vein(lumen=Outline.circle(90e-3, 0.0, 4e-3)),))
    with pytest.raises(GeometryError, match="no synthetic subject 5: choose one of 1, 2, 3, 4"):
        subject(5)
