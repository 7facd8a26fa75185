"""Runs that are asked to end early: they finish the step, keep a checkpoint and say so, by sentence and exit code."""

from __future__ import annotations

import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import ngfsi.run.interrupts
from ngfsi import cli
from ngfsi.errors import Interrupted, StoppedError
from ngfsi.run.computation import run
from ngfsi.run.interrupts import Stops
from ngfsi.run.observers import Series
from ngfsi.store import open_run
from tests.test_resume import CASE

SHORT = CASE.replace(**{"time.end": 0.15})


@pytest.fixture
def after_step_2(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[[], Any]], None]:
    """Let something happen while the second step is recorded."""

    def arrange(happens: Callable[[], Any]) -> None:
        look = Series.look

        def looked(self: Series, time: float, step: Any) -> None:
            look(self, time, step)
            if step and step.index == 2:
                happens()

        monkeypatch.setattr(Series, "look", looked)

    return arrange


def stop_file() -> None:
    Path("out/STOP").touch()


@pytest.mark.parametrize(
    ("request_", "code", "sentence"),
    [
        (lambda: signal.raise_signal(signal.SIGINT), 130, "interrupted by Ctrl-C"),
        (lambda: signal.raise_signal(signal.SIGTERM), 143, "interrupted by SIGTERM"),
        (stop_file, 4, "stopped by the file STOP"),
    ],
)
def test_requests(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
    after_step_2: Callable[[Callable[[], Any]], None], request_: Callable[[], None], code: int, sentence: str,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    Path("case.toml").write_text(SHORT.to_toml())
    before = [signal.getsignal(number) for number in ngfsi.run.interrupts.SIGNALS]
    with monkeypatch.context() as patch:
        after_step_2(request_)
        with pytest.raises(SystemExit) as ended:
            cli.main(["run", "case.toml", "--output", "out", "--quiet"])
        patch.undo()
    assert ended.value.code == code
    reason = f"{sentence} at t = 0.1 s, checkpoint at t = 0.1 s"
    assert capsys.readouterr().err.splitlines()[-1] == f"ngfsi: {reason}: go on with `ngfsi resume out`"
    assert (open_run("out").status, open_run("out").manifest["reason"]) == ("interrupted", reason)
    assert open_run("out").series["time_s"].tolist() == [0, 0.05, 0.1]
    assert not Path("out/STOP").exists()
    assert [signal.getsignal(number) for number in ngfsi.run.interrupts.SIGNALS] == before
    with pytest.raises(SystemExit) as ended:
        cli.main(["resume", "out", "--quiet"])
    assert ended.value.code == 0
    assert open_run("out").series["time_s"].tolist() == pytest.approx([0, 0.05, 0.1, 0.15], rel=1e-12)


def test_the_second_signal_ends_at_once(tmp_path: Path, after_step_2: Callable[[Callable[[], Any]], None]) -> None:
    """Without a checkpoint of that step: the one before is told."""

    def twice() -> None:
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGTERM)

    after_step_2(twice)
    with pytest.raises(Interrupted, match=r"by SIGTERM at t = 0\.1 s, checkpoint at t = 0 s: go on") as ended:
        run(SHORT, tmp_path / "run", quiet=True)
    assert ended.value.exit_code == 143
    assert isinstance(ended.value, KeyboardInterrupt)


def test_signals_before_the_first_step_end_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: Any) -> int:
        signal.raise_signal(signal.SIGTERM)
        raise AssertionError

    monkeypatch.setattr("ngfsi.run.computation.initial_state", interrupted)
    with pytest.raises(Interrupted, match=r"^interrupted by SIGTERM: go on with `ngfsi resume"):
        run(SHORT, tmp_path / "run", quiet=True)
    assert open_run(tmp_path / "run").status == "interrupted"


def test_time_on_the_clock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A run ends before a step as long as the longest so far would pass the limit."""
    now = 100.0
    monkeypatch.setattr(ngfsi.run.interrupts, "perf_counter", lambda: now)
    stops = Stops(tmp_path / "STOP", max_wall=60.0)
    for seconds in (5.0, 20.0, 10.0):
        now += seconds
        assert stops.request() is None
    now += 5.5
    request = stops.request()
    assert isinstance(request, StoppedError)
    assert str(request) == "stopped before the 60 s of --max-wall are over"
    assert request.exit_code == 4


def test_a_limit_shorter_than_the_start_keeps_the_state_at_the_start(tmp_path: Path) -> None:
    with pytest.raises(StoppedError, match=r"of --max-wall are over at t = 0 s, checkpoint at t = 0 s"):
        run(SHORT, tmp_path / "run", quiet=True, max_wall=0.01)
    assert (tmp_path / "run" / "checkpoints" / "step-000000.npz").exists()
