"""Progress: a bar for those who watch, a few lines for a log, nothing when quiet."""

from __future__ import annotations

from pathlib import Path

import pytest

from ngfsi.run.progress import Progress, Watch
from ngfsi.store import RunFolder
from tests.output.fake import CASE


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """A wide terminal that somebody watches."""
    monkeypatch.setenv("FORCE_COLOR", "1")  # rich then takes any stream for a terminal
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.delenv("CI", raising=False)
    return monkeypatch


def shown(steps: int, capsys: pytest.CaptureFixture[str], *, quiet: bool = False) -> str:
    with Progress("demo", end=2.0, steps=steps, quiet=quiet) as progress:
        for step in range(1, steps + 1):
            progress.advance(step, 2.0 * step / steps, 4)
    captured = capsys.readouterr()
    assert captured.out == ""
    return captured.err


def test_quiet(capsys: pytest.CaptureFixture[str]) -> None:
    assert shown(10, capsys, quiet=True) == ""


def test_plain_lines_every_tenth(capsys: pytest.CaptureFixture[str]) -> None:
    lines = shown(150, capsys).splitlines()
    assert len(lines) == 10
    assert lines[0] == "demo:  10%  step 15/150  t = 0.2 s  4 iterations"
    assert lines[-1] == "demo: 100%  step 150/150  t = 2 s  4 iterations"
    assert len(shown(4, capsys).splitlines()) == 4


def test_the_last_line_is_there_whatever_the_steps(capsys: pytest.CaptureFixture[str]) -> None:
    assert shown(7, capsys).splitlines()[-1].startswith("demo: 100%")


def test_a_bar_on_a_terminal_and_none_in_ci(capsys: pytest.CaptureFixture[str], terminal: pytest.MonkeyPatch) -> None:
    bar = shown(4, capsys)
    assert "step 4/4  t = 2 s  4 iterations" in bar
    assert "ETA" in bar
    assert "100%" not in bar
    terminal.setenv("CI", "true")
    assert shown(4, capsys).splitlines()[-1] == "demo: 100%  step 4/4  t = 2 s  4 iterations"


def test_watching_other_processes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], terminal: pytest.MonkeyPatch
) -> None:
    with Watch({"m": (tmp_path / "m", 1.0), "n": (tmp_path / "n", 1.0)}) as watch:
        watch.look()
        folder = RunFolder.create(tmp_path / "m", CASE)
        folder.append("series", {"time_s": 0.25})
        watch.look()
        watch.finished("n", "no mesh")
    bar = capsys.readouterr().err
    assert "t = 0.25 s" in bar
    assert "waiting" in bar
    assert "failed" in bar
    terminal.setenv("CI", "true")
    with Watch({"m": (tmp_path / "m", 1.0)}) as watch:
        watch.finished("m", "")
    assert capsys.readouterr().err == "m: completed (1 of 1)\n"


def test_progress_over_all_cases(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], terminal: pytest.MonkeyPatch
) -> None:
    """Of many runs those under way and those that failed have a line, and one line counts all."""
    keys = [f"case{number:02d}" for number in range(20)]
    with Watch({key: (tmp_path / key, 1.0) for key in keys}) as watch:
        RunFolder.create(tmp_path / keys[0], CASE).append("series", {"time_s": 0.25})
        watch.look()
        watch.finished(keys[1], "")
        watch.finished(keys[2], "no mesh")
    last = capsys.readouterr().err.rpartition("all cases")[2]
    assert "2 of 20, 1 failed" in last
    assert [key for key in keys if key in last] == [keys[0], keys[2]]
    terminal.setenv("CI", "true")
    with Watch({key: (tmp_path / key, 1.0) for key in keys}) as watch:
        watch.finished(keys[1], "")
        watch.finished(keys[2], "no mesh")
    assert capsys.readouterr().err.splitlines() == [
        "case01: completed (1 of 20)", "case02: failed: no mesh (2 of 20, 1 failed)"
    ]  # fmt: skip
