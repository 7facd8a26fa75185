"""Verification: every benchmark at level ci, and that a wrong number, a lost order or a missing value is seen."""

from __future__ import annotations

import sys
from importlib.metadata import EntryPoint
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ngfsi import cli, registry
from ngfsi.verify import Benchmark, Reference, Result, Setting, Signals, VerificationError
from ngfsi.verify import engine as verify
from ngfsi.verify.page import FOLDER, write_page


@pytest.mark.parametrize("name", registry.names(verify.GROUP))
def test_benchmark(name: str) -> None:
    result = verify.verify(name, verify.chosen([name])[name], "ci")
    failed = [(row.series, row.quantity, row.error, row.order) for row in result.rows if not row.passed]
    assert not failed
    module = verify.chosen([name])[name]
    wanted = {r.quantity for r in module.REFERENCES if any(r.holds(series) for series in module.LEVELS["ci"])}
    assert {row.quantity for row in result.rows} == wanted


@pytest.mark.parametrize("name", registry.names(verify.GROUP))
def test_benchmark_is_complete(name: str) -> None:
    """What the full level lists has a tolerance, and refines."""
    module = verify.chosen([name])[name]
    assert set(module.LEVELS) == {"ci", "full"}
    for series in module.LEVELS.values():
        for label, settings in series.items():
            sizes = [setting.get("h", 0) for setting in settings]
            assert sizes == sorted(sizes, reverse=True)
            held = [reference for reference in module.REFERENCES if reference.holds(label)]
            assert held
            for reference in held:
                assert verify._of_series(reference.tolerance, label) < 0.5
                if reference.order is not None:
                    assert verify._of_series(reference.order, label) >= 1


def fake(error: float = 1e-3, rate: float = 2.0, value: float = 5.0) -> Any:
    """A benchmark whose error falls at a rate."""

    def compute(setting: Setting) -> dict[str, float]:
        return {"drag": value, "velocity error": error * (2 * setting["h"]) ** rate}

    return SimpleNamespace(
        CASE=Benchmark("A fake", "nothing", "itself", compute),
        LEVELS={"ci": {"k = 2": ({"h": 1.0}, {"h": 0.5})}},
        REFERENCES=(
            Reference("drag", 5.0, "N", {"k = 2": 1e-2}, "a book"),
            Reference("velocity error", 0.0, "1", 2e-3, "a paper", 2.0),
            Reference("lift of another series", {"k = 3": 1.0}, "N", 1e-3, "a paper"),
        ),
    )


def test_what_passes() -> None:
    result = verify.verify("fake", fake(value=5.04), "ci")
    drag, velocity = result.rows  # the third reference is not of this series
    assert drag.error == pytest.approx(0.008)
    assert (drag.order, drag.passed) == (0.0, True)
    assert velocity.order == pytest.approx(2.0)
    assert velocity.errors == (pytest.approx(4e-3), pytest.approx(1e-3))
    assert result.passed


@pytest.mark.parametrize(
    ("change", "passes"),
    [({"value": 5.1}, (False, True)), ({"value": 4.9}, (False, True)), ({"rate": 1.6}, (True, False)),
     ({"error": 3e-3}, (True, False)), ({"error": float("nan")}, (True, False)), ({"rate": 1.8}, (True, True))],
)  # fmt: skip
def test_what_fails(change: dict[str, float], passes: tuple[bool, bool]) -> None:
    result = verify.verify("fake", fake(**change), "ci")
    assert tuple(row.passed for row in result.rows) == passes
    assert result.passed == all(passes)


def test_a_quantity_that_is_not_computed() -> None:
    module = fake()
    module.REFERENCES = (Reference("lift", 1.0, "N", 0.1, "a book"),)
    with pytest.raises(VerificationError, match=r"'lift' was not computed: \['drag', 'velocity error'\]"):
        verify.verify("fake", module, "ci")


def test_page(tmp_path: Path) -> None:
    for name, module in (("one", fake()), ("two", fake(value=6.0))):
        result = verify.verify(name, module, "ci")
        result.write(tmp_path / FOLDER)
        assert Result.read(tmp_path / FOLDER / f"{name}.json") == result
    text = write_page(tmp_path).read_text(encoding="utf-8")
    assert "1 of 2 benchmarks pass." in text
    assert "| drag | 6 N | 5 N | 2.0e-01 | 1.0e-02 | 0.00 | - | **fail** |" in text
    assert "| velocity error | 0.001 | 0 | 1.0e-03 | 2.0e-03 | 2.00 | 2 | pass |" in text
    assert "![Convergence](verification/one.png)" in text
    assert (tmp_path / FOLDER / "one.png").stat().st_size > 10_000
    assert "Sources: a book; a paper" in text
    assert "**Not verified:** Turek-Hron CFD3" in text


def test_signals(tmp_path: Path) -> None:
    """Of the finest computation, as table and picture."""

    def compute(setting: Setting) -> tuple[dict[str, float], Signals]:
        return {"drag": 5.0}, Signals(("time_s", "drag_n"), np.array([[0.0, 5.0], [setting["h"], 5.5]]))

    module = fake()
    module.CASE, module.REFERENCES = Benchmark("A fake", "nothing", "itself", compute), module.REFERENCES[:1]
    verify.verify("swing", module, "ci").write(tmp_path / FOLDER)
    kept = Result.read(tmp_path / FOLDER / "swing.json").signals["k = 2"]
    assert kept.columns == ("time_s", "drag_n")
    assert kept.rows.tolist() == [[0.0, 5.0], [0.5, 5.5]]
    assert (tmp_path / FOLDER / "swing-k-2.csv").read_text(encoding="utf-8") == "time_s,drag_n\n0,5\n0.5,5.5\n"
    text = write_page(tmp_path).read_text(encoding="utf-8")
    assert "![k = 2 over time](verification/swing-k-2.png)" in text
    assert (tmp_path / FOLDER / "swing-k-2.png").stat().st_size > 10_000
    module.CASE = fake().CASE
    verify.verify("swing", module, "ci").write(tmp_path / FOLDER)
    assert {path.name for path in (tmp_path / FOLDER).iterdir()} == {"swing.json"}


def test_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    modules = {f"fake_{name}": fake(value=value) for name, value in (("good", 5.0), ("bad", 6.0))}
    entries = [EntryPoint(name.removeprefix("fake_"), name, verify.GROUP) for name in modules]
    monkeypatch.setattr(registry, "installed", lambda group: entries if group == verify.GROUP else [])
    for name, module in modules.items():
        monkeypatch.setitem(sys.modules, name, module)

    def code(*arguments: str) -> int:
        with pytest.raises(SystemExit) as ended:
            cli.main(["verify", *arguments, "--output", str(tmp_path)])
        return int(ended.value.code or 0)

    assert code("good") == 0
    assert "pass" in capsys.readouterr().out
    assert code() == 3
    assert "ngfsi: not within their tolerance: bad" in capsys.readouterr().err
    assert "1 of 2 benchmarks pass." in (tmp_path / "verification.md").read_text(encoding="utf-8")
    assert code("goof") == 2
    assert "'goof' is not a known benchmark: did you mean 'good'?" in capsys.readouterr().err
