"""The study of flows: what it answers, from findings that are known."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from ngfsi_studies import flow_rate
from ngfsi_studies.flow_rate import FLOWS, SOURCE, Point, case, flow_for, points
from ngfsi_studies.source import claims, inferred_flow, tables

from ngfsi.analysis.decomposition import narrowing
from ngfsi.study import Outcome


def test_narrowing_of_the_printed_losses() -> None:
    """25 and 19 % less area at one flow: by hand, 1/0.866^3 and 1/0.9^3."""
    assert narrowing(0.25) == pytest.approx(1.5396, rel=1e-4)
    assert narrowing(0.19) == pytest.approx(1 / 0.729, rel=1e-12)


def test_the_inferred_flow() -> None:
    """1.12 times the 2.6011 ml/s of subject 7, whose TAWSS after over before is the ratio printed with the rises."""
    assert inferred_flow() == pytest.approx(1.12 * 2.6011, rel=1e-12)
    assert pytest.approx(inferred_flow() * 1e-6, rel=1e-4) == SOURCE
    said, subject = tables("rigid_veins")["tawss_Pa"], tables("compare_tissues")["subject"] - 1
    ratio = said["mean_after"][subject] / said["mean_before"][subject]
    assert round(100 * ratio) == claims()["sawss_rise_percent"]["rigid_wall_flow"]


def test_the_flow_that_a_rise_needs() -> None:
    """On a rise linear in 1 / flow it is exact, and nothing is made up beyond what was computed."""
    assert "above all that was computed, 50 to 60 %" in flow_rate._out_of_reach([60.0, 50.0], 61.0)
    flows = [0.2, 0.6, 1.8, 5.4]
    rises = [50 + 70 / flow for flow in flows]
    assert flow_for(flows, rises, 120.0) == pytest.approx(1.0, rel=1e-12)
    assert flow_for(flows, rises, rises[0] + 1) is None
    assert flow_for(flows, rises, rises[-1] - 1) is None


def test_cases() -> None:
    """They differ in what is studied alone, and their runs have names of their own."""
    chosen = {point: case(point, "demo") for point in points("demo")}
    assert len({one.name for one in chosen.values()}) == len(chosen)
    for point, one in chosen.items():
        assert one.loads.inlet_flow(0.3) == point.flow
        assert one.conditions.coupling == point.coupling
        assert one.geometry.lumen_diameter == point.lumen
        assert one.time.step == (0.05 if point.finer else 0.1)
    base = chosen[Point("M", 11.1e-3, SOURCE)]
    same = chosen[Point("M", 11.1e-3, FLOWS[0])].replace(**{"loads.inlet_flow": base.loads.inlet_flow})
    assert same.digest == base.digest


def test_the_answer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With rises that are linear in 1 / flow it is read off; one-way coupling is held against two-way coupling."""

    def known(key: str, _outcome: Outcome) -> Any:
        (point,) = (p for p in points("demo") if p.key == key)
        rise = 60 + 190e-6 / point.flow + (7 if point.coupling == "one_way" and point.flow == SOURCE else 0)
        parts = {"narrowing": 0.1, "squeeze flow": rise / 100, "shape": 0.0, "profile": 0.2}
        moment = SimpleNamespace(loss=0.2, rise=rise, parts=parts, sawss_ratio=1 + rise / 100)
        return SimpleNamespace(ramp_end=moment, mean_rise=rise, start_sawss=1.0, failure="")

    monkeypatch.setattr(flow_rate, "find", known)
    outcomes = {point.key: Outcome(None) for point in points("demo")}
    text = flow_rate.write_report("demo", tmp_path, outcomes).read_text(encoding="utf-8")
    assert "**M**: the printed loss of 25 % raises SAWSS by 54 % at a constant flow, not by the printed 205 %." in text
    # 190 / 145 and 190 / 85
    assert "lumen 11.1 mm, 205 %: reached at 1.3 ml/s." in text
    assert "lumen 8 mm, 145 %: reached at 2.2 ml/s." in text
    assert "2.913 ml/s is inferred, the flow of subject 7" in text
    assert "**One-way coupling** changes the mean rise by 7 percentage points at most" in text
    assert {path.name for path in tmp_path.glob("*.png")} == {"rise.png", "causes.png"}
