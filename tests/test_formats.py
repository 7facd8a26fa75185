"""Versions of the format of case files, and the command that writes older files anew."""

from __future__ import annotations

from pathlib import Path

import pytest

from ngfsi import cli
from ngfsi.case import Case
from ngfsi.case.formats import FORMAT, migrated
from ngfsi.errors import CaseError

OLD = """# a leg
name = "leg"  # left
[geometry]
type = "geometry.calf:CalfSegment"
oval_mm = 0.5
lumen_diameter_mm = 11.1
[materials]
tissue = { set = "neo_hookean_likely" }
wall = { set = "vein_wall" }  # soft
fluid = { set = "blood" }
[loads]
[time]
step_ms = 50
end_s = 1
"""
"""As it was written before formats were numbered: a lumen of radii 6.05 and 5.05 mm in the source's wall."""


@pytest.fixture
def old(tmp_path: Path) -> Path:
    path = tmp_path / "leg.toml"
    path.write_text(OLD, encoding="utf-8")
    return path


def test_an_old_case_is_refused_with_the_command_that_helps(old: Path) -> None:
    with pytest.raises(CaseError, match=r"older format: `ngfsi migrate .*leg\.toml` writes it anew"):
        Case.from_toml(old)


def test_an_old_case_means_the_same_in_the_present_format(old: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        cli.main(["migrate", str(old)])
    assert ended.value.code == 0
    said = capsys.readouterr().out
    assert all(key in said for key in ("geometry.type", "oval_mm", "vein_wall_source"))
    assert old.read_text(encoding="utf-8") == OLD
    new = old.with_name(f"leg-{FORMAT}.toml")
    assert all(comment in new.read_text(encoding="utf-8") for comment in ("# a leg", "# left", "# soft"))
    case = Case.from_toml(new)
    radius, ratio = case.geometry.lumen_diameter / 2, case.geometry.aspect_ratio
    assert radius * ratio**0.5 == pytest.approx(6.05e-3, rel=1e-5, abs=0)
    assert radius / ratio**0.5 == pytest.approx(5.05e-3, rel=1e-5, abs=0)
    assert case.materials.law_of("wall").law == "saint_venant_kirchhoff"
    assert case.format == FORMAT


@pytest.mark.parametrize(
    "wrong",
    ["geometry = 3", "materials = [1]\n[geometry]\ntype = 3", '[geometry]\ntype = "calf"\n[materials]\nwall = 3',
     *(f'[geometry]\ntype = "calf"\n{keys}' for keys in (
         'oval_mm = "a"\nlumen_diameter_mm = 9', "oval_mm = 9\nlumen_diameter_mm = 9", "oval = 1",
         "oval_mm = 1\nlumen_diameter_furlong = 9"))],
)  # fmt: skip
def test_what_is_wrong_beside_the_format_is_left_to_be_refused(wrong: str, tmp_path: Path) -> None:
    """In a sentence, by the case: neither reading nor migrating stumbles over it."""
    path = tmp_path / "leg.toml"
    path.write_text(f'name = "leg"\n{wrong}\n', encoding="utf-8")
    with pytest.raises(CaseError):
        Case.from_toml(path)
    path.write_text(migrated(path.read_text(encoding="utf-8"))[0], encoding="utf-8")
    with pytest.raises(CaseError):
        Case.from_toml(path)


def test_a_mistake_alone_makes_no_case_old(old: Path) -> None:
    """The set `vein_wall` is one of both formats: migrating would change what it means."""
    text = OLD.replace("geometry.calf:CalfSegment", "calf").replace("oval_mm = 0.5", "wrong = 1")
    old.write_text(text, encoding="utf-8")
    with pytest.raises(CaseError, match="wrong") as refused:
        Case.from_toml(old)
    assert "migrate" not in str(refused.value)


def test_what_has_no_successor_is_said() -> None:
    text, said = migrated('[geometry]\ntype = "labelled_calf"\npieces = 3\n')
    assert "pieces" not in text
    assert [sentence.partition(" ")[0] for sentence in said] == ["geometry.pieces"]
    text, said = migrated('[geometry]\ntype = "calf"\noval_mm = 0.3\n')
    assert "lumen_axes_mm" in said[0]


def test_a_case_in_the_present_format_stays() -> None:
    text = f'format = "{FORMAT}"\n{OLD}'
    assert migrated(text) == (text, [])


@pytest.mark.parametrize(
    ("written", "reason"),
    [
        ('"0.9"', "`ngfsi migrate FILE` writes the case anew"),
        ('"1.999"', "install a newer one"),
        ('"2.0"', "install a newer one"),
        ("1.0", "write two numbers in quotes"),
        ('"one"', "write two numbers in quotes"),
    ],
)
def test_other_formats_are_refused(old: Path, written: str, reason: str) -> None:
    """Before a key is that the present format does not have."""
    old.write_text(f"format = {written}\nwrong = 1\n{OLD}" if written[1].isdigit() else f"format = {written}\n{OLD}")
    with pytest.raises(CaseError, match=r"format.*") as refused:
        Case.from_toml(old)
    assert reason in str(refused.value)


@pytest.mark.parametrize("written", ['"2.0"', '"one"', "[1, 0]", "1.0", '"' + 5000 * "9" + '.0"'])
def test_what_cannot_be_migrated_is_refused(written: str) -> None:
    with pytest.raises(CaseError, match="format"):
        migrated(f"format = {written}\n{OLD}")
    with pytest.raises(CaseError, match="not valid TOML"):
        migrated("name = ")


def test_nothing_is_overwritten(old: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        cli.main(["migrate", str(old), "-o", str(old)])
    assert "is there already" in capsys.readouterr().err
    assert old.read_text(encoding="utf-8") == OLD
    with pytest.raises(SystemExit, match="2"):
        cli.main(["migrate", str(old.with_name("none.toml"))])
    assert "cannot be read" in capsys.readouterr().err
