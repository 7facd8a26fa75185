"""The study of time schemes: its cases, and the errors that it finds in runs that are known."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from ngfsi_studies import time_schemes
from ngfsi_studies.time_schemes import LEVELS, Point, at_common_times, case, points, result

from ngfsi.study import Outcome


def known(step: float, shear: float = 0.0, lost: float = 0.0) -> Any:
    """A run of 0.2 s, with SAWSS 1 Pa + 1 Pa/s t and a loss of a tenth, and deviations at 0.1 s from both."""
    times = np.arange(round(0.2 / step) + 1) * step
    there = np.isclose(times, 0.1)
    series = {"time_s": times, "sawss_Pa": 1 + times + shear * there,
              "lumen_volume_m3": 1e-6 * (1 - times / 2 + lost * there)}  # fmt: skip
    costs = {name: np.array([one, two]) for name, one, two in (("iterations", 3, 4), ("factorisations", 1, 0))}
    return SimpleNamespace(
        series=series, costs=costs, manifest={"cpu_s": 5.0},
        case=SimpleNamespace(name="known", time=SimpleNamespace(end=0.2, step=step)),
    )  # fmt: skip


def test_cases() -> None:
    """They differ in rise, scheme and steps, have names of their own, and are there at the times of comparison."""
    for level in LEVELS.values():
        found = {point.key: case(point, level) for point in points(level)}
        assert len(found) == len(points(level))
        assert {one.time.scheme for one in found.values()} == {"sdirk4", *level.steps}
        assert all(one.time.end == level.end for one in found.values())
        for key, one in found.items():
            loose = {} if one.time.step == level.reference else level.newton
            assert one.solver.tolerance == loose.get(one.time.scheme, 1e-7), key
            assert level.shown / one.time.step == pytest.approx(round(level.shown / one.time.step)), key


def test_errors_are_the_largest_at_common_times() -> None:
    point = Point("linear", "bdf2", 0.01)
    found = result(point, known(0.01, shear=0.0222, lost=0.001), known(0.002), 0.02)
    assert (found.iterations, found.factorisations, found.cpu_s) == (7, 1, 5.0)
    assert found.sawss_error == pytest.approx(0.0222 / 1.11, rel=1e-9)  # the mean over 20, 40, ... 200 ms
    assert found.sawss_rms == pytest.approx(0.02 / np.sqrt(10), rel=1e-9)
    assert found.loss_error == pytest.approx(0.01, rel=1e-9)
    with pytest.raises(ValueError, match=r"not each multiple of 0\.02 s"):
        at_common_times(known(0.2 / 6), "sawss_Pa", 0.2, 0.02)


def test_report(tmp_path: Path) -> None:
    level = LEVELS["demo"]
    reference = Point("linear", "sdirk4", level.reference)
    outcomes = {point.key: Outcome(None, "no mesh") for point in points(level)}
    outcomes[reference.key] = Outcome(known(0.002))
    outcomes["linear-bdf2-10ms"] = Outcome(known(0.01, shear=0.0222, lost=0.001))
    outcomes["linear-bdf2-20ms"] = Outcome(known(0.02, shear=0.0666, lost=0.004))
    text = time_schemes.write_report("demo", tmp_path, outcomes).read_text(encoding="utf-8")
    assert "| linear | bdf2 | 10 | 7 | 1 | 5 | 2.00 | 0.63 | 1.000 | 2.0 | 3.0 |" in text
    assert "- smooth-bdf2-10ms: no mesh" in text
    assert (tmp_path / "sawss.png").exists()
