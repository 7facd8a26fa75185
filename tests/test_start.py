"""What takes long to import is imported by those alone who need it: a command answers before it computes."""

from __future__ import annotations

import subprocess
import sys

import pytest

LARGE = ("matplotlib", "meshio", "mypy", "plotly", "pyvista", "scipy", "SimpleITK", "sklearn")
"""Packages that take tenths of a second and more."""


def loaded(code: str, *names: str) -> set[str]:
    """Return which of some modules a new process has after some code."""
    report = f"import sys; print(*(set({names!r}) & set(sys.modules)))"
    command = [sys.executable, "-c", f"{code}\n{report}"]
    return set(subprocess.run(command, capture_output=True, text=True, check=True).stdout.split())


def test_the_command_line_answers_without_libraries() -> None:
    assert loaded("import ngfsi.cli", "numpy", "netgen", "ngsolve", "pydantic", *LARGE) == set()


@pytest.mark.parametrize(
    "modules",
    [
        "ngfsi.run, ngfsi_geometry.calf, ngfsi_geometry.tube",  # a run, until it has a mesh
        "ngfsi.study",  # and its child processes
        "ngfsi.mesh.generate, ngfsi_geometry.calf",  # the process that meshes
        "ngfsi.run.worker",  # what other ranks do
        "ngfsi.store.stored",  # reading results
    ],
)
def test_what_most_runs_need_not_is_not_loaded(modules: str) -> None:
    assert loaded(f"import {modules}", *LARGE, "ngsolve") == {"ngsolve"}


def test_a_run_loads_what_it_measures_with_before_it_takes_the_time() -> None:
    """Else the seconds of measures and output would be those of imports, and `ngfsi bench` extrapolates them."""
    code = """
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
import ngfsi.run.computation
from tests.test_resume import CASE

def solve(self, domain, stops, *, quiet):
    known = set(sys.modules)
    whole(self, domain, stops, quiet=quiet)
    print(*{name.partition(".")[0] for name in set(sys.modules) - known} & {"pyvista", "scipy"})

whole, ngfsi.run.computation.Computation._solve = ngfsi.run.computation.Computation._solve, solve
with TemporaryDirectory() as folder:
    ngfsi.run.computation.run(CASE.replace(**{"time.end": 0.05}), Path(folder) / "run", quiet=True)
"""
    assert loaded(code, "matplotlib", "meshio", "plotly", "SimpleITK", "scipy.stats") == set()
