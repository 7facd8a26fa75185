"""The study of how the pressure rises: its cases, and what it says of runs that are known."""

from __future__ import annotations

import csv
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from ngfsi_studies import ramp_shape
from ngfsi_studies.ramp_shape import LEVELS, POINTS, case, swing

from ngfsi.study import Outcome
from ngfsi.units import MMHG


def test_cases() -> None:
    """They differ in the rise of the pressure and in the step alone."""
    cases = {point: case(point, LEVELS["demo"]) for point in POINTS}
    assert len({one.name for one in cases.values()}) == len(POINTS) == 6
    for point, one in cases.items():
        halfway = {"linear": 0.25, "smooth": (1 - np.cos(np.pi / 4)) / 2}[point.shape]
        assert one.loads.skin_pressure(0.25) == pytest.approx(halfway * 25 * MMHG, rel=1e-12)
        assert one.loads.skin_pressure(1.0) == pytest.approx(25 * MMHG, rel=1e-12)
        assert one.time.step == (0.005 if point.halved else 0.01)
        assert one.time.end == 1.0


def known(shift: float, swings: float) -> Any:
    """SAWSS along a cubic from 1 Pa, with a swing of a period of 0.1 s in the last 0.4 s."""
    times = np.arange(201) * 0.005
    shear = 1 + shift * times**3 + swings * np.sin(2 * np.pi * (times - 1) / 0.1) * (times > 0.599)
    return SimpleNamespace(
        series={"time_s": times, "sawss_Pa": shear}, case=SimpleNamespace(time=SimpleNamespace(step=0.005))
    )


def test_swing() -> None:
    """A cubic does not count, a sine around it does with its amplitude, of which the cubic takes a little."""
    assert swing(known(-0.7, 0.0)) == pytest.approx(0.0, abs=1e-9)
    assert swing(known(2.0, 0.1)) == pytest.approx(0.1, rel=0.12)


def test_the_report(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each rise and step with its own numbers, the effect of the step as a difference, and the printed rises."""
    ends = {"m-linear": 146, "m-smooth": -8, "n-linear": 71, "n-smooth": -5, "m-linear-halved": 105}

    def found(key: str, _outcome: Outcome) -> Any:
        run = known(1.5 if "linear" in key else 0.5, 0.0)
        run.case.time.step = 0.005 if "halved" in key else 0.01
        moment = SimpleNamespace(loss=0.2 if key[0] == "m" else 0.12, rise=ends[key])
        period = 0.125 if "linear" in key else None
        return SimpleNamespace(run=run, ramp_end=moment, mean_rise=ends[key] - 20, period=period, failure="")

    monkeypatch.setattr(ramp_shape, "find", lambda key, one: None if one.failure else found(key, one))
    outcomes = {point.key: Outcome(None, "" if point.key in ends else "no mesh") for point in POINTS}
    text = ramp_shape.write_report("demo", tmp_path, outcomes).read_text(encoding="utf-8")
    assert "- **M**: against t = 0 SAWSS is +146 % at the end of the linear rise and -8 % at that of the smooth" in text
    assert "at most +150 % (at 1.00 s) and +50 % (at 1.00 s)" in text
    assert "changes the rise at the end, M, by -41.0 (linear) percentage points" in text
    assert "| M, linear | 10 | 20.0 | 146 | 126 | 150 | 1.00 | 0.0 | 0.12 |" in text
    assert "| N, smooth | 10 | 12.0 | -5 | -25 | 50 | 1.00 | 0.0 | - |" in text
    assert "Printed by the source: 205 (M) and 145 (N) %." in text
    assert "- m-smooth-halved: no mesh" in text
    with (tmp_path / "results.csv").open() as file:
        assert [float(row["rise_end_percent"]) for row in csv.DictReader(file)] == list(ends.values())
    assert (tmp_path / "rise.png").stat().st_size > 10_000
