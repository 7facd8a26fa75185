"""The table of errors of the straight vein: against the reference, each quantity by itself."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import ngfsi_studies.linear_solvers
import ngfsi_studies.vein_accuracy
import numpy as np
import pytest
from ngfsi_studies.vein_accuracy import REFERENCE, cases, draw, table

import ngfsi.study
from ngfsi.case import Case
from ngfsi.study import Outcome


def known(loss: float, shear: float) -> Any:
    series = {"lumen_volume_m3": np.array([2e-6, 2e-6 * (1 - loss)]), "sawss_Pa": np.array([0.1, shear]),
              "wss_max_Pa": np.array([0.2, 2 * shear])}  # fmt: skip
    return SimpleNamespace(series=series, manifest={"unknowns": 9651})


def test_errors_are_relative_to_the_reference() -> None:
    text = table({"coarse": known(0.06, 0.11), REFERENCE: known(0.08, 0.1)}, seconds={"coarse": 0.51})
    assert "| coarse | 9,651 | +2.17 | -25.00 | +10.00 | +10.00 | 0.51 |" in text
    assert "| reference | 9,651 | +0.00 | +0.00 | +0.00 | +0.00 |  |" in text
    assert "| coarse | 9,651 | +0.00 | +0.00 | +0.00 | +0.00 |" in table({"coarse": known(0.06, 0.11)}, "coarse")


def test_drawn_are_errors_of_loss_and_shear_over_seconds(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A line for each kind of elements of which there are any, positive errors, and the other program's seconds."""
    drawn: list[Any] = []
    monkeypatch.setattr(ngfsi_studies.vein_accuracy, "convergence", lambda *given: drawn.append(given))
    two, six = (f"hexahedra, {layers}, order 3" for layers in ("two layers", "six layers, thin at the ends"))
    runs = {two: known(0.06, 0.11), six: known(0.08, 0.099), REFERENCE: known(0.08, 0.1)}
    draw(runs, {two: 0.5, six: 2.0}, REFERENCE, tmp_path / "figure.png")
    panels, path, _, wanted, others = drawn[0]
    loss, shear = panels.values()
    assert [line.label for line in loss] == ["hexahedra, order 3"]
    assert loss[0].sizes == [0.5, 2.0]
    np.testing.assert_allclose([loss[0].errors, shear[0].errors], [[0.25, 0.0], [0.1, 0.01]], atol=1e-12)
    assert path == tmp_path / "figure.png"
    assert {*wanted.values()} == {0.01}
    assert {*others.values()} == {1.2, 20.0}


def test_as_a_module(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """All meshes, or those that are named, of which the last is the reference; without it there is no table."""
    computed: dict[str, Outcome] = {}
    few = ["hexahedra, two layers, order 2", "hexahedra, two layers, order 3"]

    def run_cases(chosen: dict[str, Case], folder: Path) -> dict[str, Outcome]:
        assert folder == tmp_path
        computed.clear()
        computed.update({name: Outcome(known(0.06 + 0.01 * n, 0.1 + 0.01 * n), failures.get(name, ""))
                         for n, name in enumerate(chosen)})  # fmt: skip
        return computed

    failures: dict[str, str] = {}
    monkeypatch.setattr(ngfsi.study, "run_cases", run_cases)
    monkeypatch.setattr(ngfsi_studies.linear_solvers, "step_seconds", lambda case: case.time.end)

    def run_module(*names: str) -> str:
        monkeypatch.setattr(sys, "argv", ["vein_accuracy", str(tmp_path), *names])
        runpy.run_path(ngfsi_studies.vein_accuracy.__file__, run_name="__main__")
        return capsys.readouterr().out

    assert f"| {few[0]} | 9,651 | +1.08 | -14.29 | -9.09 | -9.09 | 0.05 |" in run_module(*few)
    assert list(computed) == few
    assert (tmp_path / "vein_accuracy.png").stat().st_size > 10_000
    run_module()
    assert [*computed] == [*cases()]
    failures[few[1]] = "it diverged"
    with pytest.raises(SystemExit, match=r"without the reference, 'hexahedra, two layers, order 3': it diverged"):
        run_module(*few)
    with pytest.raises(SystemExit, match="'order 2' is not a known mesh"):
        run_module("order 2")


def test_cases_differ_in_their_meshes_alone() -> None:
    found = cases()
    assert len({case.name for case in found.values()}) == len(found)
    assert {case.time.scheme for case in found.values()} == {"static"}
    assert len({case.loads for case in found.values()}) == 1
    for name, case in found.items():
        assert f"order {case.discretisation.order}" in name or name == REFERENCE
