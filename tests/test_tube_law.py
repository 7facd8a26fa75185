"""Tube laws find themselves again; a fit says how wrong a law is."""

from __future__ import annotations

import numpy as np
import pytest

from ngfsi.analysis.tube_law import LAWS, TubeLaw, fit
from ngfsi.errors import SolverError

AREA, STIFFNESS = 9e-5, 8e3
PRESSURES = np.linspace(-2000.0, 1300.0, 15)


def law(name: str) -> TubeLaw:
    return TubeLaw(name, np.array(AREA), np.array(STIFFNESS))


@pytest.mark.parametrize(
    ("name", "pressure"), [("linear", -0.19), ("elastic ring", -0.1), ("collapsible", 0.81**10 - 0.9**-3)]
)
def test_printed_formulas(name: str, pressure: float) -> None:
    """At 0.81 of the area; the stiffness is that of the printed law."""
    assert law(name).pressure(np.array(0.81 * AREA)) == pytest.approx(STIFFNESS * pressure, rel=1e-12)


@pytest.mark.parametrize("name", LAWS)
def test_inverse_and_slope(name: str) -> None:
    areas = law(name).area_at(PRESSURES)
    assert law(name).pressure(areas) == pytest.approx(PRESSURES, rel=1e-9)
    step = 1e-4 * areas
    difference = (law(name).pressure(areas + step) - law(name).pressure(areas - step)) / (2 * step)
    assert law(name).slope(areas) == pytest.approx(difference, rel=1e-5)


def test_what_no_law_can_reach() -> None:
    with pytest.raises(SolverError, match="has no area under a transmural pressure of -1e"):
        law("linear").area_at(np.array([0.0, -1e4]))


@pytest.mark.parametrize("name", LAWS)
def test_a_fit_finds_the_law(name: str) -> None:
    areas = law(name).area_at(PRESSURES)
    found = fit(name, PRESSURES, areas)
    assert float(found.law.area) == pytest.approx(AREA, rel=1e-6)
    assert float(found.law.stiffness) == pytest.approx(STIFFNESS, rel=1e-6)
    assert found.largest < 1e-7
    others = [fit(other, PRESSURES, areas) for other in LAWS if other != name]
    assert min(other.error for other in others) > 1e-4


def test_the_error_is_that_of_the_area() -> None:
    """One area of fifteen is off by a tenth of a percent: the root of the mean square is that over sqrt(15)."""
    areas = law("linear").area_at(PRESSURES)
    areas[7] *= 1.001
    found = fit("linear", PRESSURES, areas)
    assert found.error == pytest.approx(1e-3 / np.sqrt(15), rel=0.05)
    assert found.largest == pytest.approx(1e-3, rel=0.1)


@pytest.mark.parametrize(
    ("pressures", "areas", "said"),
    [((0.0, 1.0, 1.0), (1.0, 2.0, 2.0), "three transmural pressures"), ((0.0, 1.0, 2.0), (3.0, 2.0, 1.0), "not grow")],
)
def test_refused(pressures: tuple[float, ...], areas: tuple[float, ...], said: str) -> None:
    with pytest.raises(SolverError, match=said):
        fit("linear", np.array(pressures), np.array(areas))
