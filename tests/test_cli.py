"""Command line: what it prints, where results go, and one sentence and an exit code for whatever goes wrong."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

import ngfsi.run.computation
from ngfsi import cli
from ngfsi.case import Case
from ngfsi.errors import CaseError, SolverError
from ngfsi.store import RunFolder, open_run
from tests.output.fake import CASE, fake_run


def ngfsi_(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    """Call the command line; return exit code, standard output and standard error."""
    with pytest.raises(SystemExit) as ended:
        cli.main(list(arguments))
    captured = capsys.readouterr()
    assert isinstance(ended.value.code, int)
    return ended.value.code, captured.out, captured.err


@pytest.fixture
def case_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.chdir(tmp_path)
    Path("case.toml").write_text(CASE.to_toml())
    return "case.toml"


@pytest.fixture
def computed(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Case, Path, bool, float | None]]:
    """What was asked to be computed, in place of computing it."""
    asked: list[tuple[Case, Path, bool, float | None]] = []

    def run(case: Case, folder: Path, *, quiet: bool = False, max_wall: float | None = None) -> None:
        asked.append((case, folder, quiet, max_wall))

    monkeypatch.setattr(ngfsi.run, "run", run)
    return asked


def test_run(capsys: pytest.CaptureFixture[str], case_file: str, computed: list[Any]) -> None:
    code, out, _ = ngfsi_(capsys, "run", case_file)
    assert code == 0
    assert "runs/fake" in out
    changes = ["--set", "time.step_ms=10", "--set", 'materials.tissue={set="neo_hookean_likely"}', "--set", "name=n"]
    limited = ["--output", "here", "--quiet", "--max-wall", "1h 30min", *changes]
    assert ngfsi_(capsys, "run", case_file, *limited) == (0, "", "")
    changed = Case.from_toml(case_file).replace(
        **{"time.step": 0.01, "materials.tissue": {"set": "neo_hookean_likely"}, "name": "n"}
    )
    assert computed == [(CASE, Path("runs/fake"), False, None), (changed, Path("here"), True, 5400.0)]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["run", "nix.toml"], "the case file 'nix.toml' cannot be read: No such file or directory"),
        (["run", "case.toml", "--set", "time.stp_s=1"], "'time.stp_s' is not a known key: did you mean 'step_s'?"),
        (["run", "case.toml", "--set", "materials.tissue.K_kPa=-1"], "materials.tissue.K_kPa = -1 is not accepted"),
        (["run", "case.toml", "--set", "geometry.lumen_diameter_mm=300"], "overlap by"),
        (["run", "case.toml", "--set", "time.step_s"], "'time.step_s' is not understood: write KEY=VALUE"),
        (["study", "closing_vein", "--level", "fine"], "'fine' is not a known level of the study closing_vein: "),
        (["study", "splits", "--level", "best"], "'best' is not a known level of the study splits: "),
        (["run", "case.toml", "--set", "=1"], "'=1' is not understood"),
        (["run", "case.toml", "--max-wall", "2 days"], "--max-wall '2 days' is no duration: write e.g. 2h, 1h30min"),
        (["resume", "nix"], "the folder 'nix' does not exist: name the folder of a run"),
        (["info", "nix"], "the folder 'nix' does not exist"),
        (["info", "."], "the folder '.' holds no run"),
        (["export", "nix", "--time", "1", "--format", "vtu"], "the folder 'nix' does not exist"),
        (["study", "compare_tissue"], "'compare_tissue' is not a known study: did you mean 'compare_tissues'?"),
    ],
)
def test_bad_input_is_one_sentence(
    capsys: pytest.CaptureFixture[str], case_file: str, computed: list[Any], arguments: list[str], sentence: str
) -> None:
    code, out, err = ngfsi_(capsys, *arguments)
    assert (code, out) == (2, "")
    assert err.startswith("ngfsi: ")
    assert sentence in err
    assert err.count("\n") == 1
    assert not computed
    assert Path(case_file).exists()


@pytest.mark.parametrize("arguments", [["walk"], ["run"], ["export", "x", "--format", "vtu"], []])
def test_usage(capsys: pytest.CaptureFixture[str], arguments: list[str]) -> None:
    code, out, err = ngfsi_(capsys, *arguments)
    assert code == 2
    assert "Usage: " in out + err


def test_a_folder_in_use_is_kept(capsys: pytest.CaptureFixture[str], case_file: str) -> None:
    RunFolder.create(Path("runs/fake"), CASE)
    before = Path("runs/fake/manifest.json").read_text(encoding="utf-8")
    code, _, err = ngfsi_(capsys, "run", case_file)
    assert code == 2
    assert err == ("ngfsi: the folder 'runs/fake' already holds a run: name another one with --output, or remove it\n")
    assert Path("runs/fake/manifest.json").read_text(encoding="utf-8") == before


@pytest.mark.parametrize(
    ("error", "code", "sentence"),
    [
        (SolverError("the step at 0.3 s did not converge"), 3, "the step at 0.3 s did not converge"),
        (CaseError("no"), 2, "no"),
        (KeyboardInterrupt(), 130, "interrupted; what was computed is in 'out'"),
    ],
)
def test_runs_that_end_badly(
    capsys: pytest.CaptureFixture[str],
    case_file: str,
    monkeypatch: pytest.MonkeyPatch,
    error: BaseException,
    code: int,
    sentence: str,
) -> None:
    def run(*_: Any, **__: Any) -> None:
        Path("out").mkdir()
        raise error

    monkeypatch.setattr(ngfsi.run, "run", run)
    assert ngfsi_(capsys, "run", case_file, "-o", "out") == (code, "", f"ngfsi: {sentence}\n")


def test_an_error_of_the_program_is_saved(
    capsys: pytest.CaptureFixture[str], case_file: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run(*_: Any, **__: Any) -> None:
        raise ZeroDivisionError("of the program")

    monkeypatch.setattr(ngfsi.run, "run", run)
    code, _, err = ngfsi_(capsys, "run", case_file)
    assert code == 1
    assert "ZeroDivisionError: of the program" in err
    assert err.count("\n") == 1
    (saved,) = re.findall("report it with '(.*)'", err)
    text = Path(saved).read_text(encoding="utf-8")
    Path(saved).unlink()
    assert "Traceback" in text
    assert "def run" not in err


def test_materials(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = ngfsi_(capsys, "materials")
    assert code == 0
    row = next(line for line in out.splitlines() if "mooney_rivlin_s1" in line)
    assert [cell.strip() for cell in row.split("│")[2:7]] == ["mooney_rivlin", "6.98", "28.45", "19.36", "0.387"]
    row = next(line for line in out.splitlines() if "blood" in line)
    assert [cell.strip() for cell in row.split("│")[7:9]] == ["1060", "3.5"]
    assert "negative Poisson ratio" in out
    assert "neo_hookean_printed" in out


def test_info_of_a_run(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    fake_run(tmp_path / "run", status="failed")
    code, out, _ = ngfsi_(capsys, "info", str(tmp_path / "run"))
    assert code == 0
    facts = {line.split()[0]: line.split(maxsplit=1)[1].strip() for line in out.splitlines() if len(line.split()) > 1}
    assert facts["status"] == "failed - the step at 1.5 s did not converge"
    assert facts["unknowns"] == "1234"
    assert facts["mesh.elements_by_type.prism"] == facts["mesh.elements"]
    assert facts["seconds.steps"] == "6"
    rows = {
        row[1].strip(): (row[2].strip(), row[3].strip())
        for line in out.splitlines()
        if len(row := line.split("│")) == 5
    }
    assert rows["skin_pressure"] == ("3333.05", "Pa")
    assert rows["flow_in"] == ("1", "m³/s")
    assert rows["reynolds"] == ("1", "")


def test_info_before_the_first_step_and_of_the_installation(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    RunFolder.create(tmp_path / "run", CASE)
    assert "no step is stored yet" in ngfsi_(capsys, "info", str(tmp_path / "run"))[1]
    code, out, _ = ngfsi_(capsys, "info")
    assert code == 0
    assert re.search(r"linear solver +(pardiso|umfpack)", out)
    assert re.search(r"ngsolve +\d+\.\d+", out)


def test_export(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    fake_run(tmp_path / "run")
    target = tmp_path / "out.msh"
    arguments = ["export", str(tmp_path / "run"), "--time", "0.1", "--format", "gmsh", "--output", str(target)]
    code, out, _ = ngfsi_(capsys, *arguments)
    assert code == 0
    assert f"The fields at 0 s are in '{target}'" in out
    assert target.stat().st_size > 1000


def test_study(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    import ngfsi_studies.compare_tissues

    monkeypatch.chdir(tmp_path)
    asked: list[Any] = []

    def study(level: str, folder: Path, quiet: bool) -> Path:
        asked.append((level, folder, quiet))
        return folder / "report.md"

    monkeypatch.setattr(ngfsi_studies.compare_tissues, "study", study)
    code, out, _ = ngfsi_(capsys, "study", "compare_tissues", "--level", "paper", "-q")
    assert (code, out) == (0, "The report is in 'runs/compare_tissues-paper/report.md'\n")
    ngfsi_(capsys, "study", "compare_tissues", "--output", "x")
    assert asked == [("paper", Path("runs/compare_tissues-paper"), True), ("demo", Path("x"), False)]


def test_ctrl_c_keeps_what_was_computed(tmp_path: Path) -> None:
    """A real run of the real command, stopped after its first stored time."""
    (tmp_path / "case.toml").write_text(CASE.replace(**{"time.step": 0.01}).to_toml())
    process = subprocess.Popen(
        [sys.executable, "-m", "ngfsi.cli", "run", "case.toml", "--output", "out"],
        cwd=tmp_path,
        stderr=subprocess.PIPE,
        text=True,
        # a test started in the background of a shell hands down that the signal is ignored
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    try:
        deadline = time.monotonic() + 240
        while not (tmp_path / "out" / "series.csv").exists() and time.monotonic() < deadline:
            assert process.poll() is None, process.communicate()[1]
            time.sleep(0.1)
        process.send_signal(signal.SIGINT)
        err = process.communicate(timeout=120)[1]
    finally:
        process.kill()
    assert process.returncode == 130
    assert re.fullmatch(
        r"ngfsi: interrupted by Ctrl-C at t = (.*) s, checkpoint at t = \1 s: go on with `ngfsi resume out`",
        err.splitlines()[-1],
    )
    run = open_run(tmp_path / "out")
    assert run.status == "interrupted"
    assert run.series["time_s"][0] == 0.0
    assert json.loads((tmp_path / "out" / "manifest.json").read_text(encoding="utf-8"))["reason"].startswith(
        "interrupted by Ctrl-C"
    )


def test_a_width_without_figures_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fake_run(tmp_path / "run")
    code, _, error = ngfsi_(capsys, "report", str(tmp_path / "run"), "--width-mm", "85", "-o", str(tmp_path / "r.html"))
    assert (code, (tmp_path / "r.html").exists()) == (2, False)
    assert "name a folder for them with --figures" in error
