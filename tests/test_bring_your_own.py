"""The examples of docs/bring_your_own.md are what they say they are."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from ngfsi.case import Case
from ngfsi.mesh.domain import Domain

PAGE = (Path(__file__).parents[1] / "docs" / "bring_your_own.md").read_text(encoding="utf-8")
FILES = dict(re.findall(r"```(?:python|toml)\n# (\S+)\n(.*?)```", PAGE, flags=re.S))


@pytest.mark.parametrize(("name", "regions", "openings"), [
    ("fork", {"fluid"}, ("inlet", "outlet", "outlet_2")), ("bent", {"fluid", "wall", "tissue"}, ("inlet", "outlet")),
])  # fmt: skip
def test_example(tmp_path: Path, name: str, regions: set[str], openings: tuple[str, ...]) -> None:
    for suffix in (".py", ".toml"):
        (tmp_path / f"{name}{suffix}").write_text(FILES[f"{name}{suffix}"], encoding="utf-8")
    subprocess.run([sys.executable, f"{name}.py"], cwd=tmp_path, check=True, capture_output=True)
    case = Case.from_toml(tmp_path / f"{name}.toml")
    domain = Domain.build(case.geometry)
    assert (set(domain.regions), domain.vessels[0].openings) == (regions, openings)
    if name == "fork":
        straight = Domain.build(case.geometry.replace(smooth=())).volume()
        assert 1.01 < domain.volume() / straight < 1.05
