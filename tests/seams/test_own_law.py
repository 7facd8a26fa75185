"""The law of docs/extending.md, as a user adds it: a file beside the case, named on the command line."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

import ngfsi

PAGE = (Path(__file__).parents[2] / "docs" / "extending.md").read_text(encoding="utf-8")
SHORT = ["--quiet", "--set", "time.end_s=0.1", "--set", "time.step_ms=50"]


def test_it_runs_as_the_page_says(tmp_path: Path) -> None:
    """It is Mooney-Rivlin's law without its second term, whose run gives the same numbers."""
    code = re.search(r"```python\n# (my_law\.py)\n(.*?)```", PAGE, re.S)
    lines = re.search(r"^    ngfsi new wall\n    ngfsi run .*\n.*$", PAGE, re.M)
    assert code
    assert lines
    (tmp_path / code[1]).write_text(code[2], encoding="utf-8")
    new, own = (shlex.split(line)[1:] for line in lines[0].replace("\\\n", " ").splitlines())
    same = 'materials.wall={law="mooney_rivlin", c10_kPa=22.5, c01_kPa=0, c11_kPa=0, K_kPa=2000, density_kg_m3=1100}'
    for arguments in (new, [*own, *SHORT, "-o", "own"], ["run", "wall.toml", *SHORT, "--set", same, "-o", "same"]):
        ended = subprocess.run(
            [sys.executable, "-m", "ngfsi.cli", *arguments], cwd=tmp_path, capture_output=True, text=True, check=False
        )
        assert ended.returncode == 0, ended.stderr
    own_run, same_run = (ngfsi.open_run(tmp_path / name).series for name in ("own", "same"))
    for column in ("lumen_volume_m3", "sawss_Pa"):
        changes = [run[column][-1] / run[column][0] - 1 for run in (own_run, same_run)]
        assert changes[0] == pytest.approx(changes[1], rel=1e-5, abs=0)
