"""Imports point one way: a room knows the rooms before it and no other."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import ngfsi

ROOT = Path(ngfsi.__file__).parent
ORDER = (
    "errors", "units", "process", "config", "parallel", "mesh", "outlines", "materials", "case", "physics", "system",
    "linear", "solve", "measure", "store", "analysis", "report", "identify", "run", "study", "bench", "verify", "cli",
)  # fmt: skip


def imports(path: Path) -> set[str]:
    """Return the rooms of the package that a module imports when it is loaded, not those for type checking alone."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    found = [node for node in tree.body if isinstance(node, ast.ImportFrom)]
    return {node.module.split(".")[1] for node in found if node.module and node.module.startswith("ngfsi.")}


@pytest.mark.parametrize("path", sorted(ROOT.rglob("*.py")), ids=lambda path: str(path.relative_to(ROOT)))
def test_imports_point_one_way(path: Path) -> None:
    room = path.relative_to(ROOT).parts[0].removesuffix(".py")
    if room == "__init__":
        return
    assert room in ORDER, f"give the new room '{room}' its place in ORDER"
    later = set(ORDER[ORDER.index(room) + 1 :])
    assert not imports(path) & later
    outside = {"geometry", "studies"}
    assert (
        not {
            name.split(".")[0]
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
            if isinstance(node, ast.ImportFrom) and (name := node.module or "")
        }
        & outside
    )
