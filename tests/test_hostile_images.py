"""Damaged images: one sentence, or a right read; `python -m tests.mutated_images` tries 500."""

from __future__ import annotations

from pathlib import Path

import pytest
import SimpleITK as sitk  # noqa: N813 - its usual name
from ngfsi_geometry.volumes import read_volume

from ngfsi.errors import GeometryError
from tests.mutated_images import FORMATS, all_tried, sound

FEW = 30


def test_damaged_images() -> None:
    said = [said for _, said, _ in all_tried(FEW)]
    assert FEW / 10 < said.count("read") < FEW / 2


@pytest.mark.parametrize("name", FORMATS)
def test_a_file_that_is_cut_off(tmp_path: Path, name: str) -> None:
    """It is never read as if the rest were zeros."""
    file = tmp_path / name
    sitk.WriteImage(sound(), file)
    content = file.read_bytes()
    for part in (0.0, 0.1, 0.7, 0.99):
        file.write_bytes(content[: int(part * len(content))])
        with pytest.raises(GeometryError, match=name):
            read_volume(file)
