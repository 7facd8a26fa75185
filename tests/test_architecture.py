"""Imports point one way: a room knows the rooms before it and no other, and a module none that leads back to it.

All imports count: those inside of functions, those for type checking alone, and those by name, as of `import_module`
and of child processes.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import ngfsi
from ngfsi.registry import IN_CASES

ROOT = Path(ngfsi.__file__).parent
ORDER = (
    "arrays", "errors", "units", "registry", "process", "config", "parallel", "mesh", "outlines", "materials",
    "physics", "conditions", "transport", "case", "system", "linear", "solve", "measure", "store", "analysis", "report",
    "identify", "gradient", "run", "study", "bench", "verify", "cli",
)  # fmt: skip
NAMED = re.compile(r"(ngfsi(?:\.\w+)+)(?::\w+)?")
"""A module in a text, or a function of one that a child process calls."""


def name_of(path: Path) -> str:
    """Return the name of a module, e.g. "ngfsi.mesh.domain"; of a package that of its `__init__`."""
    return ".".join(("ngfsi", *path.relative_to(ROOT).with_suffix("").parts)).removesuffix(".__init__")


MODULES = {name_of(path): path for path in sorted(ROOT.rglob("*.py"))}


def nodes(path: Path) -> Iterable[ast.AST]:
    return ast.walk(ast.parse(path.read_text(encoding="utf-8")))


def imported(node: ast.AST) -> set[str]:
    """Return the modules of the package that a statement or a text names."""
    match node:
        case ast.ImportFrom(module=str(module), names=names):
            found = {f"{module}.{one.name}" for one in names} | {module}
        case ast.Import(names=names):
            found = {one.name for one in names}
        case ast.Constant(value=str(text)) if text not in IN_CASES and (matched := NAMED.fullmatch(text)):
            found = {matched[1]}
        case _:
            found = set()
    return found & set(MODULES) - {"ngfsi"}


def at_import(path: Path) -> set[str]:
    """Return the modules of the package that a module needs before it can be imported."""
    statements = ast.parse(path.read_text(encoding="utf-8")).body
    return {name for statement in statements for name in imported(statement)}


def room_of(module: str) -> str:
    return module.split(".")[1]


@pytest.mark.parametrize("module", [name for name in MODULES if name != "ngfsi"])
def test_imports_point_one_way(module: str) -> None:
    room = room_of(module)
    assert room in ORDER, f"give the new room '{room}' its place in ORDER"
    later = set(ORDER[ORDER.index(room) + 1 :])
    named = {name for node in nodes(MODULES[module]) for name in imported(node)}
    assert {name for name in named if room_of(name) in later} == set()


def test_no_module_leads_back_to_itself() -> None:
    graph = {name: at_import(path) - {name} for name, path in MODULES.items()}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(f"modules import each other: {' -> '.join(error.args[1])}")


@pytest.mark.parametrize("path", MODULES.values(), ids=MODULES)
def test_the_engine_names_neither_geometries_nor_studies(path: Path) -> None:
    assert not re.search(r"\bngfsi_(geometry|studies)\b", path.read_text(encoding="utf-8"))
