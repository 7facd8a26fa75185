"""Case files to begin with, and the schema by which editors check case files."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import jsonschema
import pytest

from ngfsi import cli, registry
from ngfsi.case import Case
from ngfsi.case.formats import FORMAT
from ngfsi.config.describe import json_schema
from ngfsi.errors import CaseError, OutputError
from ngfsi.run.new import GROUP, SCHEMA, new
from ngfsi.units import readable

KINDS = registry.names(GROUP)
CHECKED = jsonschema.Draft7Validator(json_schema(Case))


def accepted(text: str) -> bool:
    return CHECKED.is_valid(tomllib.loads(text))


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Each template in a folder of its own."""
    paths = {kind: tmp_path_factory.mktemp(kind) / f"{kind}.toml" for kind in KINDS}
    for kind, path in paths.items():
        assert new(kind, path) == ""
    return paths


@pytest.mark.parametrize("kind", KINDS)
def test_a_template_is_the_case_without_its_comments(kind: str, written: dict[str, Path]) -> None:
    """So it is with each key that it leaves out and has a default, if that is written where it stands."""
    path = written[kind]
    text = path.read_text(encoding="utf-8")
    plain = registry.find(GROUP, kind, "template")(None)
    assert tomllib.loads(text) == {"format": FORMAT, **tomllib.loads(plain)}
    case = Case.from_toml(path)
    full = path.with_name("full.toml")
    lines, left_out = [], 0
    for line in text.splitlines():
        given = re.match(r"# (\w+ = \S.*?|\[\w+\])(  # |$)", line)
        left_out += given is not None
        lines.append(given[1] if given and ("  # " in line or given[1].startswith("[")) else line)
    full.write_text("\n".join(lines), encoding="utf-8")
    assert left_out > 15
    assert Case.from_toml(full) == case


@pytest.mark.parametrize("kind", KINDS)
def test_the_schema_accepts_what_runs(kind: str, written: dict[str, Path]) -> None:
    text = written[kind].read_text(encoding="utf-8")
    assert text.startswith(f"#:schema {SCHEMA}\n")
    beside = json.loads(written[kind].with_name(SCHEMA).read_text(encoding="utf-8"))
    assert beside == json_schema(Case)
    assert [error.message for error in CHECKED.iter_errors(tomllib.loads(text))] == []


WRONG = {
    "a key of no table": ("[time]", "[time]\nsteps = 3"),
    "no unit": ("step_ms = 50", "step = 50"),
    "a unit of another dimension": ("step_ms = 50", "step_mm = 50"),
    "a key that is missing": ("step_ms = 50", ""),
    "a value outside of its range": ("step_ms = 50", "step_ms = 0"),
    "an order that is too high": ("\norder = 3", "\norder = 7"),
    "a geometry that does not exist": ('type = "calf"', 'type = "leg"'),
    "a key of another geometry": ("length_mm = 120", "length_mm = 120\nouter_radius_mm = 30"),
    "a set that does not exist": ('set = "vein_wall"', 'set = "vein"'),
    "a law without its constants": ('{ set = "vein_wall" }', '{ law = "neo_hookean" }'),
    "a curve that does not exist": ('kind = "ramp"', 'kind = "slope"'),
    "a curve without its end": ("final_mmHg = 25, ", ""),
}


@pytest.mark.parametrize(("old", "wrong"), WRONG.values(), ids=WRONG)
def test_the_schema_refuses_what_the_program_refuses(old: str, wrong: str, tmp_path: Path) -> None:
    text = registry.find(GROUP, "calf", "template")(None)
    assert old in text
    assert accepted(text)
    assert not accepted(text.replace(old, wrong, 1))
    path = tmp_path / "wrong.toml"
    path.write_text(text.replace(old, wrong, 1), encoding="utf-8")
    with pytest.raises(CaseError):
        Case.from_toml(path)


def test_limits_and_defaults_of_a_quantity_are_in_its_unit() -> None:
    parts = json_schema(Case)["$defs"]
    assert parts["Cuff"]["properties"]["edge_mm"]["default"] == 5
    assert parts["Cuff"]["properties"]["edge_um"]["default"] == 5000
    assert parts["Output"]["properties"]["low_shear_kPa"]["default"] == 1e-4
    half = parts["Cuff"]["properties"]["half_width_deg"]["anyOf"][0]
    assert half == {"type": "number", "exclusiveMinimum": 0, "exclusiveMaximum": 180}


def test_each_key_has_a_meaning() -> None:
    """In the schema as the command prints it."""
    command = [sys.executable, "-m", "ngfsi.cli", "schema"]
    printed = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    said = [part for part in printed["$defs"].values() if "properties" in part]
    assert len(said) > 50
    silent = [
        (part["title"], key)
        for part in said
        for key, value in part["properties"].items()
        if not ({"description", "const", "$ref"} & value.keys())
    ]
    assert silent == []


def test_a_mesh_of_ones_own(tmp_path: Path, written: dict[str, Path], capsys: pytest.CaptureFixture[str]) -> None:
    """The case names it; where its groups have other names the sentence lists them."""
    mesh = written["mesh"].with_name("vein.msh")
    path = tmp_path / "mine.toml"
    assert new("mesh", path, mesh) == ""
    assert Case.from_toml(path).geometry.file == str(mesh)
    assert not (tmp_path / "vein.msh").exists()
    other = tmp_path / "other.msh"
    other.write_bytes(mesh.read_bytes().replace(b'"inlet"', b'"Einlass"'))
    with pytest.raises(SystemExit) as end:
        cli.main(["new", "mesh", "-o", str(tmp_path / "other.toml"), "--file", str(other)])
    assert end.value.code == 0
    assert "Einlass" in capsys.readouterr().out
    with pytest.raises(OutputError, match="needs no file"):
        new("calf", tmp_path / "calf.toml", mesh)


def test_nothing_is_overwritten(written: dict[str, Path]) -> None:
    before = written["calf"].read_text(encoding="utf-8")
    with pytest.raises(OutputError, match="is there already"):
        new("calf", written["calf"])
    assert written["calf"].read_text(encoding="utf-8") == before


def test_the_unit_in_which_a_value_is_short() -> None:
    assert readable("length", 5e-3) == "mm"
    assert readable("length", [1.5e-2, 2e-3]) == "mm"
    assert readable("pressure", 3333.05) == "mmHg"
    assert readable("pressure", 12e3) == "kPa"
    assert readable("density", 1060.0) == "kg_m3"
    assert readable("length", None) == "mm"
    assert readable("time", 0.0) == "s"
