"""Three-dimensional pictures: drawn in a child process, whose end is survived and told."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any

import imageio_ffmpeg
import matplotlib.image
import numpy as np
import PIL.Image
import pytest

from ngfsi.errors import OutputError
from ngfsi.report import render
from ngfsi.report.render import animation, displacement_picture, wall_shear_picture
from ngfsi.store.stored import StoredRun


def test_pictures(stored: StoredRun, tmp_path: Path) -> None:
    for name, failure in (
        ("displacement", displacement_picture({"M": stored}, 1.5, tmp_path / "displacement.png")),
        ("wall_shear", wall_shear_picture({"M": stored}, [0.0, 1.5], tmp_path / "wall_shear.png")),
    ):
        if failure.startswith("3-D pictures need OpenGL"):
            pytest.skip(failure)
        assert failure == ""
        image = matplotlib.image.imread(tmp_path / f"{name}.png")[..., :3]
        colourful = np.ptp(image, axis=-1) > 0.1
        assert 0.1 < colourful.mean() < 0.9, name


@pytest.mark.parametrize(
    ("end", "sentence"),
    [
        ((-6, "", ""), "3-D pictures need OpenGL, which did not work here (on Debian or Ubuntu: apt-get install"),
        ((1, "", "Trace\nRuntimeError: no display"), "RuntimeError: no display"),
        ((1, "OpenGL works\n", "KeyError: 'x'"), "the picture could not be drawn: KeyError: 'x'"),
    ],
)
def test_a_child_that_fails(
    stored: StoredRun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, end: tuple[int, str, str], sentence: str
) -> None:
    def run(args: list[str], **_: Any) -> Any:
        return subprocess.CompletedProcess(args, *end)

    monkeypatch.setattr(render.subprocess, "run", run)
    old = tmp_path / "old.png"
    old.write_text("of an earlier run")
    assert sentence in displacement_picture({"M": stored}, 1.5, old)
    assert not old.exists()  # nobody shall take it for the new one


def test_a_child_that_hangs(stored: StoredRun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(render, "TIMEOUT", 0.05)
    assert "took longer than 0.05 s" in wall_shear_picture({"M": stored}, [0.0], tmp_path / "wall.png")


def test_animation(stored: StoredRun, tmp_path: Path) -> None:
    """A frame for each stored wall: the vein narrows under a camera that stands still."""
    failure = animation(stored, tmp_path / "vein.gif")
    if failure.startswith("3-D pictures need OpenGL"):
        pytest.skip(failure)
    assert failure == ""
    film = PIL.Image.open(tmp_path / "vein.gif")
    assert film.n_frames == len(stored.field_times("wall"))
    heights = []
    for number in (0, 4):  # 0 and 1 s; below the title, above the bar
        film.seek(number)
        picture = np.asarray(film.convert("RGB")).astype(float)[60:190]
        column = np.ptp(picture[:, picture.shape[1] // 2], axis=-1) > 30
        heights.append(column.sum())
    assert heights[1] / heights[0] == pytest.approx(np.sqrt(0.75), abs=0.06)


def test_a_film(tmp_path: Path) -> None:
    """Frames of one colour each come back from the MP4 as they went in, in their order."""
    colours = [(200, 30, 30), (30, 160, 60), (40, 60, 190)]
    render._save_frames([PIL.Image.new("RGB", (64, 36), colour) for colour in colours], tmp_path / "film.mp4")
    reader = imageio_ffmpeg.read_frames(str(tmp_path / "film.mp4"))
    facts = next(reader)
    assert facts["size"] == (64, 36)
    frames = [np.frombuffer(frame, dtype=np.uint8).reshape(36, 64, 3) for frame in reader]
    assert np.array([frame.mean(axis=(0, 1)) for frame in frames]) == pytest.approx(np.array(colours), abs=8)


def test_an_animation_that_cannot_be_written(stored: StoredRun, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="cannot be written: Is a directory"):
        animation(stored, tmp_path)
