"""The study of elements: meshes of one family differ in size alone, and what it recommends is what the numbers say."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from studies import discretisation
from studies.compare_tissues import LEVELS


def test_meshes_of_a_family() -> None:
    """At size 1 they have the element sizes of level demo; layers are thinner at the wall, and otherwise even."""
    demo = LEVELS["demo"].mesh
    layered, even = (discretisation.Family("mixed", 2, (1.0,), layered=way) for way in (True, False))
    one, two = (discretisation.mesh(layered, size) for size in (1.0, 0.5))
    assert (one.far_size, one.vein_size, one.axial_layers) == (demo.far_size, demo.vein_size, demo.axial_layers)
    assert (two.far_size, two.vein_size) == pytest.approx((demo.far_size / 2, demo.vein_size / 2), rel=1e-12)
    assert two.axial_layers == 2 * demo.axial_layers
    assert len(two.lumen_radii) + 1 == 2 * (len(one.lumen_radii) + 1) == 2 * (len(demo.lumen_radii) + 1)
    thickness = -np.diff([1.0, *two.lumen_radii, 0.0])
    assert all(outer < inner for outer, inner in pairwise(thickness))
    assert -np.diff([1.0, *discretisation.mesh(even, 0.5).lumen_radii, 0.0]) == pytest.approx(
        np.full(6, 1 / 6), rel=1e-9
    )


def test_steps_reach_the_end_of_the_ramp() -> None:
    case = discretisation.ramp(discretisation.FAMILIES[0], 2.0)
    assert case.time.steps == discretisation.STEPS
    assert case.loads.skin_pressure(case.time.end) == case.loads.skin_pressure(10.0) > 0


def test_the_cheapest_of_the_good_is_named() -> None:
    """Not the cheapest, whose wall shear is 2 % off, nor the best, which costs more."""
    rows = {
        "bad": (1.0, 100.02, 1.02),
        "good": (2.0, 99.95, 0.995),
        "best": (3.0, 100.0, 1.001),
        "all": (9.0, 100.0, 1.0),
    }
    table = {
        key: dict(zip(discretisation.COLUMNS, (1000, cpu, 500.0, area, sawss), strict=True))
        for key, (cpu, area, sawss) in rows.items()
    }
    errors = {key: discretisation.errors_of(table[key], table["all"]) for key in ("bad", "good", "best")}
    assert errors["good"] == pytest.approx({"area": 0.05, "sawss": 0.5}, rel=1e-9)
    assert "are **good**, with 1,000 unknowns and 2 s" in discretisation.answer(table, errors)
    assert "No elements" in discretisation.answer(table, {"bad": errors["bad"]})
