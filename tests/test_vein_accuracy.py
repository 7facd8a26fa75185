"""The table of errors of the straight vein: against the reference, each quantity by itself."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
from ngfsi_studies.vein_accuracy import REFERENCE, cases, table


def known(loss: float, shear: float) -> Any:
    series = {"lumen_volume_m3": np.array([2e-6, 2e-6 * (1 - loss)]), "sawss_Pa": np.array([0.1, shear]),
              "wss_max_Pa": np.array([0.2, 2 * shear])}  # fmt: skip
    return SimpleNamespace(series=series, manifest={"unknowns": 9651})


def test_errors_are_relative_to_the_reference() -> None:
    text = table({"coarse": known(0.06, 0.11), REFERENCE: known(0.08, 0.1)})
    assert "| coarse | 9,651 | +2.17 | -25.00 | +10.00 | +10.00 |" in text
    assert "| reference | 9,651 | +0.00 | +0.00 | +0.00 | +0.00 |" in text


def test_cases_differ_in_their_meshes_alone() -> None:
    found = cases()
    assert len({case.name for case in found.values()}) == len(found)
    assert {case.time.scheme for case in found.values()} == {"static"}
    assert len({case.loads for case in found.values()}) == 1
    for name, case in found.items():
        assert f"order {case.discretisation.order}" in name or name == REFERENCE
