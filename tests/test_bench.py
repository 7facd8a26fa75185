"""Benchmarks of speed: what is counted is right, pairs are compared with each other, and counts do not get worse."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from ngfsi_studies.speed import CASES, VARIANTS

from ngfsi import cli
from ngfsi.bench import engine as bench
from ngfsi.case import Case
from ngfsi.parallel.stopwatch import Stopwatch

RECORDED = {"unknowns": 3096, "factorisations": 3, "iterations": 30}
"""Of the case `tiny`: what more of these costs, on any machine. With the mesh motion in the same factors as the rest it
was 29, and each of them took longer."""


def test_counts_do_not_get_worse() -> None:
    """A change that makes these smaller should make them smaller here too."""
    found = bench.run_sample(bench.Setup(CASES["tiny"]))
    counts = {name: getattr(found, name) for name in RECORDED}
    assert all(counts[name] <= RECORDED[name] for name in RECORDED), counts
    assert found.steps == 5
    assert {"assembly", "factorisation", "residuals", "solves"} <= set(found.phases)
    assert min(found.phases.values()) > 0


def test_work_inside_of_other_work_counts_once() -> None:
    times = iter([0.0, 1.0, 4.0, 6.0, 10.0, 20.0])
    watch = Stopwatch(lambda: next(times))
    with watch("steps"), pytest.raises(ZeroDivisionError), watch("solves"):  # from 0 to 6, and from 1 to 4
        raise ZeroDivisionError
    with watch("solves"):  # from 10 to 20
        pass
    assert dict(watch.seconds) == {"steps": 3.0, "solves": 13.0}


SAMPLE = bench.Sample(10.0, 100.0, 1000, 5, 20, 2, 10.0, {"assembly": 6.0, bench.OUTSIDE: 4.0}, {"lumen": 8.0})


def test_pairs_are_taken_by_turns(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A machine that gets slower by half with every run does not spoil the median of the ratios."""
    order: list[str] = []
    meshed: list[Any] = []

    def take(setup: bench.Setup, _steps: int | None) -> Any:
        order.append(linearise := setup.case.solver.linearise)
        mood, slower = 1.5 ** len(order), 3.0 if linearise == "always" else 1.0
        return replace(SAMPLE, seconds=10 * mood * slower, whole_s=10 * mood * slower)

    monkeypatch.setattr(bench, "run_sample", take)
    tiny = CASES["tiny"]
    monkeypatch.setattr(bench.Domain, "build", meshed.append)
    found = bench.compare("tiny", tiny, {"newton": VARIANTS["newton"](tiny)}, pairs=4)
    assert order == ["when slow", "always", "always", "when slow"] * 2
    assert len(meshed) == 2
    assert found.ratios("newton", "whole_s") == pytest.approx([4.5, 2.0, 4.5, 2.0])
    assert found.results() == {"lumen": {bench.BASELINE: 8.0, "newton": 8.0}}
    assert found.phases()["assembly"] == {bench.BASELINE: 6.0, "newton": 6.0}
    stored = json.loads(found.write(tmp_path).read_text(encoding="utf-8"))
    assert len(stored["samples"]["newton"]) == 4
    assert stored["ratios"]["newton"]["factorisations"] == [1.0] * 4
    assert "ngsolve" in stored["versions"]


def test_first_steps_are_extrapolated(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three of five steps of 2 s each, and four measures of 0.5 s, in a process of 10 s: the whole takes 15 s."""

    def child(command: list[str], env: dict[str, str]) -> Any:
        ran.append(Case.from_toml(command[-2]))
        assert env["NGS_NUM_THREADS"] == env["MKL_NUM_THREADS"] == "7"
        return SimpleNamespace(returncode=0)

    ran: list[Case] = []
    clock = iter([0.0, 10.0])
    stored = type("Run", (), {
        "manifest": {"seconds": {"assembly": 5.0, "measures": 2.0}, "unknowns": 9, "factorisations": 1,
                     "peak_memory_MB": 2.0},
        "costs": {name: np.full(3, value) for name, value in
                  (("step", 1.0), ("iterations", 4.0), ("wall_s", 2.0))},
        "series": {"time_s": np.array([0.0, 0.01, 0.04]), "lumen_volume_m3": np.array([9e-6, 8e-6]),
                   "sawss_Pa": np.array([9.0, 0.1, 0.3])},
    })()  # fmt: skip
    monkeypatch.setattr(bench.process.subprocess, "run", lambda command, env, **_: child(command, env))
    monkeypatch.setattr(bench, "perf_counter", lambda: next(clock))
    monkeypatch.setattr(bench, "open_run", lambda _: stored)
    found = bench.run_sample(bench.Setup(CASES["tiny"], threads=7), steps=3)
    assert ran[0].time.end == pytest.approx(0.03)
    assert (found.seconds, found.whole_s, found.iterations, found.memory) == (10.0, 15.0, 12, 2.0)
    assert found.phases == {"assembly": 5.0, "measures": 2.0, bench.OUTSIDE: 3.0}
    # at the end, and the mean of the steps by their size, of which the state at t = 0 is none
    assert found.results == pytest.approx({"lumen, mm3": 8000.0, "mean SAWSS, Pa": 0.25}, rel=1e-12)


def test_a_run_that_fails_is_named_and_the_rounds_before_it_are_kept(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    tiny, take, answers = CASES["tiny"], bench.run_sample, iter([SAMPLE, SAMPLE])
    monkeypatch.setattr(bench, "run_sample", lambda setup, steps: next(answers, None) or take(setup, steps))
    hopeless = bench.Setup(tiny.replace(**{"solver.max_iterations": 1}))
    with pytest.raises(bench.SolverError, match=r"^tiny, hopeless, run 2 of 5: .*did not converge"):
        bench.compare("tiny", tiny, {"hopeless": hopeless}, pairs=5, folder=tmp_path)
    assert len(json.loads((tmp_path / "tiny.json").read_text(encoding="utf-8"))["samples"]["hopeless"]) == 1


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [(["calf-dem"], "'calf-dem' is not a known case: did you mean 'calf-demo'?"),
     (["tiny", "--against", "textbok"], "'textbok' is not a known variant: did you mean 'textbook'?")],
)  # fmt: skip
def test_unknown_names(arguments: list[str], sentence: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        cli.main(["bench", *arguments])
    assert ended.value.code == 2
    assert sentence in capsys.readouterr().err
