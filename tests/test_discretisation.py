"""The study of elements: meshes of one family differ in size alone, and what it recommends is what the numbers say."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from ngfsi_studies import discretisation, integration
from ngfsi_studies.compare_tissues import LEVELS


def test_meshes_of_a_family() -> None:
    """All sizes halve together; layers are thinner at the wall, and otherwise even; demo is one of them."""
    layered, even = (discretisation.Family("mixed", 2, (1.0,), layered=way) for way in (True, False))
    one, two = (discretisation.elements(layered, size) for size in (1.0, 0.5))
    assert discretisation.elements(discretisation.Family("mixed", 3, (2.0,)), 2.0) == LEVELS["demo"].mesh
    assert (two.far_size, two.vein_size) == pytest.approx((one.far_size / 2, one.vein_size / 2), rel=1e-12)
    assert two.axial_layers == 2 * one.axial_layers
    assert len(two.lumen_radii) + 1 == 2 * (len(one.lumen_radii) + 1) == 6
    thickness = -np.diff([1.0, *two.lumen_radii, 0.0])
    assert all(outer < inner for outer, inner in pairwise(thickness))
    assert -np.diff([1.0, *discretisation.elements(even, 0.5).lumen_radii, 0.0]) == pytest.approx(
        np.full(6, 1 / 6),
        abs=1e-3,  # they are rounded so
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
        key: dict(zip(discretisation.COLUMNS, (1000, cpu, 500.0, area, 120 - area, sawss, 2 * sawss), strict=True))
        for key, (cpu, area, sawss) in rows.items()
    }
    errors = {key: discretisation.errors_of(table[key], table["all"]) for key in ("bad", "good", "best")}
    assert errors["good"] == pytest.approx({"area": 5e-4, "loss": 2.5e-3, "sawss": 5e-3, "largest": 5e-3}, rel=1e-9)
    assert "are **good**, with 1,000 unknowns and 2 s" in discretisation.answer(table, errors)
    assert "within 0.1 % in area and 1 % in SAWSS" in discretisation.answer(table, errors)
    assert "No elements" in discretisation.answer(table, {"bad": errors["bad"]})


def test_changes_between_rules() -> None:
    """Of area and wall shear the largest over time, of the mean that of the ramp without its begin; a step that was
    halved in one of the runs counts for no more than its time."""
    reference = {
        "time_s": np.array([0.0, 0.5, 1.0]),
        "lumen_volume_m3": np.array([9e-6, 8e-6, 7e-6]),
        "sawss_Pa": np.array([0.1, 0.2, 0.2]),
    }
    other = {
        "time_s": reference["time_s"],
        "lumen_volume_m3": np.array([9e-6, 8.0008e-6, 7e-6]),
        "sawss_Pa": np.array([0.11, 0.202, 0.2]),
    }
    changes = integration.changes_of(other, reference)
    assert changes == pytest.approx({"area": 1e-4, "sawss": 0.1, "mean": 5e-3}, rel=1e-6)
    halved = {"time_s": np.array([0.0, 0.5, 0.75, 1.0])}
    halved |= {name: np.insert(column, 2, column[2]) for name, column in other.items() if name != "time_s"}
    assert integration.changes_of(halved, reference) == pytest.approx(changes, rel=1e-6)


def test_more_points_and_nothing_else() -> None:
    """The cases of the study differ in their rules alone."""
    family = integration.FAMILIES["demo"][0]
    usual, finest = (integration.more(family, extra) for extra in (0, 8))
    assert finest == usual.replace(**{"discretisation.extra_integration_order": 8})
    assert usual.discretisation.extra_integration_order == 0
    assert usual.discretisation.order == family.order


def test_rules_that_count_as_exact_are_named_with_their_cost() -> None:
    """The first of the same elements, whatever others do, and the worst of what the usual rules leave out."""
    changes = {"a, +0": 1e-5, "b, +0": 4e-5, "b, +2": 1e-9, "a, +2": 1e-7, "a, +4": 1e-9}
    found = {key: dict.fromkeys(integration.WANTED, value) for key, value in changes.items()}
    table = {key: {"cpu_s": 10.0 * number} for number, key in enumerate(found, 1)}
    said = integration.answer(table, found)
    assert "at most 4e-05 of the area and 4e-05 of the SAWSS" in said
    assert said.endswith("take 5.0 times as long (a, +4).")
