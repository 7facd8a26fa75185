"""Conversion factors against independent definitions, and the rounding of decimal input."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ngfsi.units import SI_SUFFIX, UNITS, from_si, suffixes, to_si


@pytest.mark.parametrize(
    ("value", "suffix", "si"),
    [
        (11.1, "mm", 0.0111),
        (2.5, "cm", 0.025),
        (25, "mmHg", 3333.05),
        (28.45, "kPa", 28450.0),
        (0.133, "MPa", 133000.0),
        (2.913, "ml_s", 2.913e-6),
        (3.5, "mPa_s", 0.0035),
        (50, "ms", 0.05),
        (1.06, "g_cm3", 1060.0),
        (45.1, "mm2", 45.1e-6),
        (7, "mm3", 7e-9),
    ],
)
def test_decimal_input_converts_without_a_rounding_of_its_own(value: float, suffix: str, si: float) -> None:
    assert to_si(value, suffix) == si


def test_factors_that_are_not_decimal() -> None:
    assert to_si(180, "deg") == pytest.approx(math.pi, rel=1e-15)
    # cardiac output of 5 l/min is 83.33 ml/s
    assert to_si(5, "l_min") == pytest.approx(5e-3 / 60, rel=1e-15)
    assert to_si(60, "ml_min") == pytest.approx(1e-6, rel=1e-15)


def test_each_dimension_has_one_si_unit_listed_first() -> None:
    dimensions = {unit.dimension for unit in UNITS.values()}
    assert set(SI_SUFFIX) == dimensions
    for dimension in dimensions:
        ones = [s for s in suffixes(dimension) if UNITS[s].factor == 1.0]
        assert ones == [SI_SUFFIX[dimension]] == suffixes(dimension)[:1]


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_si_passes_bitwise(value: float) -> None:
    assert to_si(value, "Pa") == value


@given(st.floats(min_value=-1e12, max_value=1e12), st.sampled_from(sorted(UNITS)))
def test_round_trip(value: float, suffix: str) -> None:
    assert from_si(to_si(value, suffix), suffix) == pytest.approx(value, rel=1e-15, abs=1e-300)


def test_too_large_becomes_infinite() -> None:
    assert to_si(1e308, "MPa") == math.inf
    assert to_si(-(10**400), "Pa") == -math.inf
    assert math.isnan(to_si(math.nan, "kPa"))
