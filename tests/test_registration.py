"""Registration against displacements that are known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import SimpleITK as sitk  # noqa: N813 - its usual name
from ngfsi_geometry.calf_section import subject
from ngfsi_geometry.imaging import phantom, phantom_stack

from ngfsi import cli
from ngfsi.case import Conditions
from ngfsi.errors import GeometryError
from ngfsi.outlines.displacement import OutlineDisplacement, register_images, register_outlines
from ngfsi.outlines.outline import Outline

SKIN = subject(1).skin
LANDMARKS = SKIN.at(SKIN.length * np.array([0.05, 0.3, 0.55, 0.8]))


def test_a_rigid_motion_is_found_exactly() -> None:
    """Arc lengths stay, so that any landmarks give it; the outline after begins elsewhere."""
    c, s = np.cos(0.2), np.sin(0.2)
    turn = np.array([[c, -s], [s, c]])
    points = SKIN.resampled(200)
    after = Outline.through(np.roll(points @ turn.T + [3e-3, -2e-3], 37, axis=0))
    found = register_outlines(Outline.through(points), after, LANDMARKS, LANDMARKS @ turn.T + [3e-3, -2e-3])
    probe = SKIN.at(SKIN.length * np.linspace(0, 1, 33)[:-1])
    assert found(probe) == pytest.approx(probe @ turn.T + [3e-3, -2e-3] - probe, abs=2e-7)


def test_unequal_stretch_is_recovered_between_landmarks() -> None:
    """A circle whose arc is moved along itself, piecewise linearly between the landmarks: they make it exact."""
    circle = Outline.circle(0, 0, 50e-3, 64)
    angles = np.array([0.0, 1.5, 3.0, 4.5])
    moved = np.array([0.1, 1.4, 3.2, 4.4])

    def at(a: np.ndarray, radius: float = 50e-3) -> np.ndarray:
        return radius * np.column_stack([np.cos(a), np.sin(a)])

    found = register_outlines(circle, Outline.circle(0, 0, 48e-3, 64), at(angles), at(moved, 48e-3))
    middle = np.array([0.75, 2.25, 3.75])
    wanted = at((moved[:-1] + moved[1:]) / 2, 48e-3) - at(middle)
    assert found(at(middle)) == pytest.approx(wanted, abs=2e-6)


@pytest.mark.parametrize(
    ("before", "after", "sentence"),
    [
        (LANDMARKS, LANDMARKS[:3], "pairs of landmarks: there are 4 before and 3 after"),
        (LANDMARKS, LANDMARKS[[0, 2, 1, 3]], "but not so round the outline after: pair them anew"),
        (LANDMARKS, LANDMARKS * [[1.0], [1.0], [1.0], [1.2]], r"landmark 4 lies .* mm from the outline after"),
    ],
)
def test_refused_landmarks(before: np.ndarray, after: np.ndarray, sentence: str) -> None:
    with pytest.raises(GeometryError, match=sentence):
        register_outlines(SKIN, SKIN, before, after)


def test_how_far_landmarks_are_away() -> None:
    circle = Outline.circle(0.0, 0.0, 50e-3)
    on = circle.at(circle.length * np.arange(4) / 4)
    factors = np.array([[1.05], [1.09], [1.12], [0.95]])
    with pytest.raises(GeometryError, match=r"landmark 3 lies 6\.0 mm from the outline before: .* be within 5 mm"):
        register_outlines(circle, circle, factors * on, on)


def test_a_displacement_needs_matching_lists() -> None:
    with pytest.raises(GeometryError, match="as many x, y, ux and uy"):
        OutlineDisplacement(x=(0.0, 1.0, 1.0, 0.0), y=(0.0, 0.0, 1.0, 1.0), ux=(0.0,) * 4, uy=(0.0,) * 3)


def test_images_give_the_motion_of_the_skin() -> None:
    """A smooth motion normal to the skin, which grey values show; pixels of 2 mm, error less than a tenth of one."""
    one = subject(1)
    after = SKIN.offset(-1.5e-3)
    outlines = {"tibia": one.tibia, "fibula": one.fibula, "lumen": one.veins[0].lumen}
    images = [phantom({"skin": skin, **outlines}, SKIN, 2e-3) for skin in (SKIN, after)]
    found = register_images(*images)
    probe = SKIN.resampled(24)
    moved = probe + found(probe)
    gap = np.linalg.norm(after.at(after.nearest(moved)) - moved, axis=1)
    assert np.sqrt(np.mean(gap**2)) < 0.2e-3


@pytest.mark.parametrize("kind", ["labels", "grey"])
def test_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str], kind: str) -> None:
    """Two files to a CSV that is a condition: the skin moves onto that after, to a fifth of a pixel of 2 mm."""
    one, after = subject(1), SKIN.offset(-2e-3)
    parts = {"tibia": one.tibia, "fibula": one.fibula, "lumen": one.veins[0].lumen}
    for name, skin in {"before": SKIN, "after": after}.items():
        both = phantom_stack([{"skin": SKIN, **parts}, {"skin": skin, **parts}], SKIN, 2e-3)
        sitk.WriteImage(both[kind == "grey"], tmp_path / f"{name}.nii.gz")
    files = [str(tmp_path / f"{name}.nii.gz") for name in ("before", "after")]
    with pytest.raises(SystemExit) as ended:
        cli.main(["register", *files, "--slice", "1", "--output", str(tmp_path / "skin.csv")])
    assert ended.value.code == 0, capsys.readouterr().err
    condition = Conditions.from_dict({"skin_displacement": {"file": str(tmp_path / "skin.csv")}})
    assert Conditions.from_dict(condition.to_toml_dict()) == condition
    moved = condition.skin_displacement
    assert moved is not None
    probe = SKIN.resampled(24)
    assert np.linalg.norm(moved(probe), axis=1).mean() == pytest.approx(2e-3, rel=0.15)
    gap = np.linalg.norm(after.at(after.nearest(probe + moved(probe))) - probe - moved(probe), axis=1)
    assert np.sqrt(np.mean(gap**2)) < 0.4e-3
    with pytest.raises(SystemExit):  # the other slice is that before
        cli.main(["register", *files, "--slice", "1", "--moving-slice", "0", "-o", str(tmp_path / "still.csv")])
    still = Conditions.from_dict({"skin_displacement": {"file": str(tmp_path / "still.csv")}}).skin_displacement
    assert still is not None
    assert np.linalg.norm(still(probe), axis=1).max() < 0.1e-3
    with pytest.raises(SystemExit) as ended:
        cli.main(["register", *files, "--slice", "2"])
    assert ended.value.code == 2
    assert "there is no slice 2: the image has 0 to 1" in capsys.readouterr().err
