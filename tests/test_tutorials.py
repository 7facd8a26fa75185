"""The tutorials run as they stand, print what their pages say, and draw their pictures."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

TUTORIALS = Path(__file__).parents[1] / "docs" / "tutorials"
NAMES = sorted(path.stem for path in TUTORIALS.glob("*.py"))
PATIENCE = 600.0
NUMBER = re.compile(r"\d+(?:\.\d+)?")


@pytest.mark.parametrize("name", NAMES)
def test_a_tutorial(name: str, tmp_path: Path) -> None:
    """Words as on the page; numbers to one unit of their last digit, which another processor may round otherwise."""
    ran = subprocess.run(
        [sys.executable, str(TUTORIALS / f"{name}.py")], cwd=tmp_path, capture_output=True, text=True, timeout=PATIENCE,
        check=False,
    )  # fmt: skip
    assert ran.returncode == 0, ran.stderr[-2000:]
    page = (TUTORIALS / f"{name}.txt").read_text(encoding="utf-8")
    assert NUMBER.sub("0", ran.stdout) == NUMBER.sub("0", page)
    for found, expected in zip(NUMBER.findall(ran.stdout), NUMBER.findall(page), strict=True):
        digits = len(expected.partition(".")[2])
        assert abs(float(found) - float(expected)) < 1.01 * 10.0**-digits
    picture = tmp_path / f"{name}.png"
    assert picture.read_bytes().startswith(b"\x89PNG")
