"""The table of errors of the straight vein: against the reference, each quantity by itself."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import ngfsi_studies.vein_accuracy
import numpy as np
import pytest
from ngfsi_studies.vein_accuracy import REFERENCE, cases, table

import ngfsi.study
from ngfsi.case import Case
from ngfsi.study import Outcome


def known(loss: float, shear: float) -> Any:
    series = {"lumen_volume_m3": np.array([2e-6, 2e-6 * (1 - loss)]), "sawss_Pa": np.array([0.1, shear]),
              "wss_max_Pa": np.array([0.2, 2 * shear])}  # fmt: skip
    return SimpleNamespace(series=series, manifest={"unknowns": 9651})


def test_errors_are_relative_to_the_reference() -> None:
    text = table({"coarse": known(0.06, 0.11), REFERENCE: known(0.08, 0.1)})
    assert "| coarse | 9,651 | +2.17 | -25.00 | +10.00 | +10.00 |" in text
    assert "| reference | 9,651 | +0.00 | +0.00 | +0.00 | +0.00 |" in text
    assert "| coarse | 9,651 | +0.00 | +0.00 | +0.00 | +0.00 |" in table({"coarse": known(0.06, 0.11)}, "coarse")


def test_as_a_module(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """All meshes, or those that are named, of which the last is the reference; without it there is no table."""
    computed: dict[str, Outcome] = {}
    few = ["hexahedra, two layers, order 2", "hexahedra, two layers, order 3"]

    def run_cases(chosen: dict[str, Case], folder: Path) -> dict[str, Outcome]:
        assert folder == Path("here")
        computed.clear()
        computed.update({name: Outcome(known(0.06 + 0.01 * n, 0.1), failures.get(name, ""))
                         for n, name in enumerate(chosen)})  # fmt: skip
        return computed

    failures: dict[str, str] = {}
    monkeypatch.setattr(ngfsi.study, "run_cases", run_cases)

    def run_module(*names: str) -> str:
        monkeypatch.setattr(sys, "argv", ["vein_accuracy", "here", *names])
        runpy.run_path(ngfsi_studies.vein_accuracy.__file__, run_name="__main__")
        return capsys.readouterr().out

    assert f"| {few[0]} | 9,651 | +1.08 | -14.29 | +0.00 | +0.00 |" in run_module(*few)
    assert list(computed) == few
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
