"""What is known by name: ngfsi's own things, those of installed packages, and those of a user's Python file."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Iterator
from importlib import import_module
from importlib.metadata import EntryPoint
from inspect import isabstract
from pathlib import Path
from pkgutil import iter_modules
from types import ModuleType
from typing import Any

import ngfsi_geometry
import ngfsi_studies
import ngfsi_studies.verification
import pytest

from ngfsi import cli, process, registry
from ngfsi.case import Case
from ngfsi.case.geometries import is_geometry
from ngfsi.errors import CaseError, MaterialError, NgfsiError
from ngfsi.materials.parameter_sets import FLUIDS, SOLIDS
from ngfsi.report.citing import repeat_commands
from ngfsi.store import open_run
from ngfsi.study import run_cases
from ngfsi.study.engine import _reusable
from tests.vein import TISSUE, TUBE, WALL, BonedTube, case_of

VEIN = '''
from typing import Literal

from ngfsi.materials import CompressibleNeoHookean
from ngfsi.registry import register
from ngfsi.units import Length
from ngfsi_geometry.tube import TubeSegment


@register("ngfsi.geometries", "my_vein")
class MyVein(TubeSegment):
    """A tube of another length."""

    length: Length = 8e-3


@register("ngfsi.solid_laws", "my_law")
class MyLaw(CompressibleNeoHookean):
    """The law of another name."""

    law: Literal["my_law"] = "my_law"
'''


@pytest.fixture(autouse=True)
def forgotten(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """What a test registers is forgotten after it."""
    monkeypatch.setenv("NGFSI_CACHE", str(tmp_path / "cache"))  # so that the mesher is needed
    monkeypatch.setattr(registry, "_registered", list(registry._registered))
    monkeypatch.setattr(registry, "_files", dict(registry._files))
    yield
    for name in [name for name in sys.modules if name.startswith("plugin_")]:
        del sys.modules[name]


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "my_vein.py"
    path.write_text(VEIN)
    return path


def modules(package: ModuleType) -> list[ModuleType]:
    return [import_module(f"{package.__name__}.{info.name}") for info in iter_modules(package.__path__)]


def own(group: str) -> set[str]:
    """Return the modules or classes that the project's entry points of a group name."""
    return {entry.value for entry in registry.installed(group)}


def test_all_that_there_is_is_registered() -> None:
    classes = {item for module in modules(ngfsi_geometry) for item in vars(module).values() if is_geometry(item)}
    concrete = {item for item in classes if not isabstract(item)}
    assert own("ngfsi.geometries") == {f"{item.__module__}:{item.__qualname__}" for item in concrete}
    studies = {module.__name__ for module in modules(ngfsi_studies) if hasattr(module, "study")}
    assert own("ngfsi.studies") == {f"{name}:study" for name in studies}
    benchmarks = {module.__name__ for module in modules(ngfsi_studies.verification) if hasattr(module, "CASE")}
    assert own("ngfsi.benchmarks") == benchmarks


def test_all_that_is_registered_can_be_loaded() -> None:
    for group in ("geometries", "solid_laws", "fluid_laws", "studies", "bench", "claims", "not_verified", "commands"):
        assert registry.everything(f"ngfsi.{group}", group)
    for group in (SOLIDS, FLUIDS):
        for name, law in registry.everything(group, "law").items():
            assert law.model_fields["law"].default == name
            assert registry.name_of(group, law) == name


@pytest.mark.usefixtures("guarded_mesher")
def test_a_file_is_taken_from_the_command_line_alone(
    file: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The run meshes in a child process, which must know the class, too; other commands read the run with the file."""
    monkeypatch.chdir(file.parent)
    text = case_of(TUBE).replace(**{"time.end": 0.1}).to_toml().replace('type = "tube"', 'type = "my_vein"')
    Path("case.toml").write_text(text.replace('"compressible_neo_hookean"', '"my_law"'))

    def ngfsi_(*arguments: str) -> tuple[int, str]:
        with pytest.raises(SystemExit) as ended:
            cli.main(list(arguments))
        assert isinstance(ended.value.code, int)
        return ended.value.code, capsys.readouterr().err

    code, said = ngfsi_("run", "case.toml", "--quiet")
    assert code == 2
    assert "'my_vein' is not a known geometry: " in said
    assert (
        "tube, valve_pocket, vessel_from_surface, and what a Python file registers that --plugin names (and 1 more)"
        in said
    )  # its law is the other
    assert "plugin_my_vein" not in sys.modules
    assert ngfsi_("run", "case.toml", "--quiet", "--plugin", "my_vein.py") == (0, "")
    run = open_run(Path("runs/test"))
    assert type(run.case.geometry).__name__ == "MyVein"
    assert run.case.materials.tissue.law == "my_law"
    assert ngfsi_("info", "runs/test", "--plugin", "my_vein.py") == (0, "")


def test_files_go_on_to_the_runs_of_studies(file: Path, tmp_path: Path) -> None:
    registry.load([str(file)])
    my_vein = registry.find("ngfsi.geometries", "my_vein", "geometry")
    case = case_of(my_vein(mesh=TUBE.mesh, wall_thickness=2e-3, outer_radius=14e-3)).replace(**{"time.end": 0.1})
    outcome = run_cases({"one": case}, tmp_path / "runs", quiet=True)["one"]
    assert outcome.failure == ""
    assert outcome.run is not None
    assert outcome.run.case == case
    assert repeat_commands(outcome.run)[-1].endswith(f"--plugin {file}")
    assert run_cases({"one": case}, tmp_path / "runs", quiet=True)["one"].reused
    registry._files[file] = "of another content"
    assert _reusable(tmp_path / "runs" / "one", case) is None


def test_what_another_process_knows(file: Path, tmp_path: Path) -> None:
    before = registry.plugins()
    assert "ngfsi.geometries boned_tube tests.vein:BonedTube" in before
    registry.load([str(file)])
    assert sorted(registry.plugins()) == sorted([*before, str(file)])
    registry.load(registry.plugins())  # once more is no more
    assert sorted(registry.plugins()) == sorted([*before, str(file)])
    child = process.call("tests.test_registry:report", tmp_path / "known")
    assert child.returncode == 0, child.stderr
    assert (tmp_path / "known").read_text() == "MyVein BonedTube MyLaw"


def report(target: str) -> None:
    """Child process: write which classes are known."""
    wanted = (("ngfsi.geometries", "my_vein"), ("ngfsi.geometries", "boned_tube"), (SOLIDS, "my_law"))
    Path(target).write_text(" ".join(registry.find(*one, "thing").__name__ for one in wanted))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("def", "SyntaxError: "),
        ("import no_such_module", "ModuleNotFoundError: No module named 'no_such_module'"),
        ("x = 1", "it registers nothing: write @register("),
        (VEIN.replace('"my_vein"', '"calf"'), "the name 'calf' is taken, by 'ngfsi_geometry.calf:CalfSegment' of the "
         "package ngfsi: register under another one"),
    ],
)  # fmt: skip
def test_files_that_cannot_be_used(file: Path, text: str, said: str) -> None:
    file.write_text(text)
    before = registry.plugins()
    with pytest.raises(NgfsiError, match="cannot be loaded: ") as caught:
        registry.load([str(file)])
    assert str(file) in str(caught.value)
    assert said in str(caught.value)
    assert registry.plugins() == before
    file.write_text(VEIN)
    registry.load([str(file)])  # mended


def test_plugins_that_are_no_files(file: Path) -> None:
    with pytest.raises(NgfsiError, match=r"none\.py' cannot be loaded: FileNotFoundError"):
        registry.load(["none.py"])
    with pytest.raises(NgfsiError, match=r"'my_vein' is no plugin: name a Python file, \*\.py"):
        registry.load(["my_vein"])
    registry.load([str(file)])
    (file.parent / "copy").mkdir()
    with pytest.raises(NgfsiError, match=r"two plugins are called 'my_vein\.py': give '.*copy/my_vein\.py' another"):
        registry.load([shutil.copy(file, file.parent / "copy")])


class Distribution:
    """Of an entry point."""

    def __init__(self, name: str) -> None:
        self.name = name


def entry(name: str, value: str, distribution: str) -> EntryPoint:
    return EntryPoint(name, value, SOLIDS)._for(Distribution(distribution))  # type: ignore[attr-defined, no-any-return]


def test_packages_at_fault_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    entries: list[Any] = [
        entry("broken", "no_such_module:Law", "acme-laws"),
        entry("gone", "ngfsi.materials:NoSuchLaw", "acme-laws"),
        entry("twice", "ngfsi.materials:Hencky", "acme-laws"),
        entry("twice", "ngfsi.materials:MooneyRivlin", "other-laws"),
    ]
    monkeypatch.setattr(registry, "installed", lambda group: entries if group == SOLIDS else [])
    for name, said in (
        ("broken", "the law 'broken' cannot be loaded from 'no_such_module:Law' of the package acme-laws: Module"),
        ("gone", "the law 'gone' cannot be loaded from 'ngfsi.materials:NoSuchLaw' of the package acme-laws: Attrib"),
        ("twice", "several things are registered as the law 'twice': 'ngfsi.materials:Hencky' of the package acme-"),
    ):
        with pytest.raises(MaterialError) as caught:
            registry.find(SOLIDS, name, "law", MaterialError)
        assert str(caught.value).startswith(said)
        assert "\n" not in str(caught.value)


def test_a_case_cannot_name_a_file(file: Path) -> None:
    data = case_of(TUBE).to_toml_dict()
    for name in (str(file), "my_vein.py", "my_vein:MyVein", "ngfsi.geometries my_vein my_vein:MyVein"):
        with pytest.raises(CaseError, match="is not a known geometry"):
            Case.from_dict(data | {"geometry": {"type": name}})
    with pytest.raises(CaseError, match="'plugin' is not a known key"):
        Case.from_dict(data | {"plugin": str(file)})
    assert "plugin_my_vein" not in sys.modules


def test_laws_are_found_by_their_tag_in_cases() -> None:
    data = case_of(BonedTube()).to_toml_dict()
    assert data["geometry"]["type"] == "boned_tube"
    assert Case.from_dict(data).materials.tissue == TISSUE
    data["materials"]["wall"] = {"law": "hencky", "young_Pa": 1e5, "poisson": 0.4, "density_kg_m3": 1060.0}
    assert Case.from_dict(data).materials.wall != WALL
