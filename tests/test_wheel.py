"""The wheel: installed into an empty environment, and used in an empty folder, as whoever has no clone uses it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.vein import TUBE, case_of

ROOT = Path(__file__).parents[1]
CASE = case_of(TUBE).replace(**{"name": "tiny", "time.end": 0.1})

THIRD_PARTY = {
    "pyproject.toml": """
[build-system]
requires = ["hatchling"]
build-backend = "hatchling.build"

[project]
name = "acme-veins"
version = "1.0"

[project.entry-points."ngfsi.geometries"]
acme_vein = "acme_veins:AcmeVein"

[project.entry-points."ngfsi.solid_laws"]
acme_law = "acme_veins:AcmeLaw"
""",
    "acme_veins.py": """
from typing import Literal

from ngfsi.materials import CompressibleNeoHookean
from ngfsi.units import Length
from ngfsi_geometry.tube import TubeSegment


class AcmeVein(TubeSegment):
    length: Length = 8e-3


class AcmeLaw(CompressibleNeoHookean):
    law: Literal["acme_law"] = "acme_law"
""",
}


def ended_well(*command: str | Path, folder: Path, **more: str) -> str:
    """Run a command without what the environment says of other modules, and return what it wrote."""
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    ended = subprocess.run(
        command, cwd=folder, env=environment | more, capture_output=True, encoding="utf-8", check=False
    )
    assert ended.returncode == 0, ended.stderr
    return ended.stdout


class Installation:
    """An environment whose dependencies are those of this one, and in which nothing else is installed."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.python = folder / "bin" / "python"
        ended_well(sys.executable, "-m", "venv", "--without-pip", folder, folder=folder.parent)
        (self.packages,) = (folder / "lib").glob("python3*/site-packages")
        dependencies = [path for path in sys.path if path.endswith(("site-packages", "dist-packages"))]
        (self.packages / "dependencies.pth").write_text("\n".join(dependencies))  # its own .pth files have no effect
        self.before = set(self.packages.iterdir())

    def install(self, project: Path) -> set[str]:
        """Build the wheel of a project and install it; return the names that it put beside other packages."""
        pip = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check"]
        wheels = self.folder / f"wheels-{project.name}"
        build = ["wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", wheels, project]
        ended_well(*pip, *build, folder=self.folder)
        (wheel,) = wheels.iterdir()
        ended_well(*pip, "--python", self.python, "install", "--no-deps", "--no-index", wheel, folder=self.folder)
        new = set(self.packages.iterdir()) - self.before
        self.before |= new
        return {path.name for path in new if path.suffix != ".dist-info"} - {"__pycache__"}

    def ngfsi(self, *arguments: str | Path, folder: Path) -> str:
        return ended_well(
            self.folder / "bin" / "ngfsi", *arguments, folder=folder, NGFSI_CACHE=str(self.folder / "cache")
        )


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Installation:
    environment = Installation(tmp_path_factory.mktemp("environment") / "venv")
    assert environment.install(ROOT) == {"ngfsi", "ngfsi_geometry", "ngfsi_studies"}
    where = "import ngfsi, ngfsi_geometry as g, ngfsi_studies as s; print(ngfsi.__file__, g.__file__, s.__file__)"
    found = ended_well(environment.python, "-c", where, folder=environment.folder).split()
    assert all(Path(path).is_relative_to(environment.packages) for path in found)
    return environment


def test_commands(installed: Installation, tmp_path: Path) -> None:
    """In a folder with nothing but a case file; what they write is in `runs`."""
    (tmp_path / "tiny.toml").write_text(CASE.to_toml())
    installed.ngfsi("run", "tiny.toml", "--quiet", folder=tmp_path)
    assert "completed" in installed.ngfsi("info", "runs/tiny", folder=tmp_path)
    assert "runs/report.html" in installed.ngfsi("report", "runs/tiny", folder=tmp_path)
    assert "runs/verify/verification.md" in installed.ngfsi("verify", "closed_forms", "--quiet", folder=tmp_path)
    assert "--slice" in installed.ngfsi("register", "--help", folder=tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {"tiny.toml", "runs"}
    assert {path.name for path in (tmp_path / "runs").iterdir()} == {"tiny", "report.html", "verify"}


def test_studies_have_their_data(installed: Installation, tmp_path: Path) -> None:
    """The study of the tissues is found and makes its cases; its printed numbers and errors are there."""
    code = """
from ngfsi import registry
study = registry.find("ngfsi.studies", "compare_tissues", "study")
from ngfsi_studies import compare_tissues, source, tissue_findings
assert study is compare_tissues.study
assert compare_tissues.case(compare_tissues.MAIN[0], compare_tissues.LEVELS["demo"]).to_toml()
assert source.claims()["sawss_rise_percent"]["M"] == 205.0
assert source.tables("rigid_veins")
assert tissue_findings.numerical_errors("demo")["loss_percent"] > 0
"""
    ended_well(installed.python, "-c", code, folder=tmp_path)


def test_a_package_of_somebody_else(installed: Installation, tmp_path: Path) -> None:
    """It registers a geometry and a law, which a case uses by their names; the mesher, another process, knows them."""
    project, folder = tmp_path / "acme", tmp_path / "empty"
    project.mkdir()
    folder.mkdir()
    for name, text in THIRD_PARTY.items():
        (project / name).write_text(text)
    assert installed.install(project) == {"acme_veins.py"}
    text = CASE.to_toml().replace('"tube"', '"acme_vein"').replace('"compressible_neo_hookean"', '"acme_law"')
    (folder / "case.toml").write_text(text)
    installed.ngfsi("run", "case.toml", "--quiet", folder=folder)
    stored = (folder / "runs" / "tiny" / "case.toml").read_text(encoding="utf-8")
    assert 'type = "acme_vein"' in stored
    assert 'law = "acme_law"' in stored
