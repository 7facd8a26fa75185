"""Conversion factors against independent definitions, and the rounding of decimal input."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
import scipy.constants
from hypothesis import given
from hypothesis import strategies as st

from ngfsi.units import SI_SUFFIX, SUFFIXES, Shown, from_si, in_unit, seconds, symbol, to_si, unit_of


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


CENTI, MILLI, MICRO = Fraction(1, 100), Fraction(1, 1000), Fraction(1, 10**6)
ML, MMHG = CENTI**3, Fraction("133.322")
DEFINED: dict[str, dict[str, float | Fraction]] = {
    "length": {"m": 1, "cm": CENTI, "mm": MILLI, "um": MICRO},
    "area": {"m2": 1, "cm2": CENTI**2, "mm2": MILLI**2},
    "volume": {"m3": 1, "ml": ML, "mm3": MILLI**3},
    "time": {"s": 1, "ms": MILLI, "min": 60, "h": 60 * 60},
    "velocity": {"m_s": 1, "cm_s": CENTI, "mm_s": MILLI},
    "diffusivity": {"m2_s": 1, "mm2_s": MILLI**2},
    "acceleration": {"m_s2": 1},
    "flow_rate": {"m3_s": 1, "ml_s": ML, "ml_min": ML / 60, "l_min": (10 * CENTI) ** 3 / 60},
    "pressure": {"Pa": 1, "kPa": 1000, "MPa": 1000**2, "mmHg": MMHG},
    "tension": {"N_m": 1},
    "density": {"kg_m3": 1, "g_cm3": MILLI / CENTI**3},
    "viscosity": {"Pa_s": 1, "mPa_s": MILLI},
    "shear_rate": {"1_s": 1},
    "resistance": {"Pa_s_m3": 1, "Pa_s_ml": 1 / ML, "mmHg_s_ml": MMHG / ML},
    "compliance": {"m3_Pa": 1, "ml_mmHg": ML / MMHG},
    "angle": {"rad": 1, "deg": math.pi / 180},
    "number": {"1": 1, "percent": CENTI},
    "eigenvalue": {"1_s2": 1},
}
"""What each unit is by its name: prefixes, powers, and 133.322 Pa for a millimetre of mercury."""


def test_each_unit_is_what_its_name_says() -> None:
    known: dict[str, object] = {suffix: (unit.dimension, unit.factor) for suffix, unit in SUFFIXES.items()}
    assert known == {
        suffix: (dimension, pytest.approx(float(size), rel=1e-15))
        for dimension, units in DEFINED.items()
        for suffix, size in units.items()
    }
    assert float(MMHG) == pytest.approx(scipy.constants.mmHg, rel=3e-6)


PRINTED = {
    "m2": "m²", "cm2": "cm²", "mm2": "mm²", "m3": "m³", "mm3": "mm³", "m_s": "m/s", "cm_s": "cm/s", "mm_s": "mm/s",
    "m_s2": "m/s²", "m2_s": "m²/s", "mm2_s": "mm²/s", "m3_s": "m³/s", "ml_s": "ml/s",
    "ml_min": "ml/min", "l_min": "l/min", "kg_m3": "kg/m³",
    "g_cm3": "g/cm³", "Pa_s": "Pa s", "mPa_s": "mPa s", "Pa_s_m3": "Pa s/m³", "Pa_s_ml": "Pa s/ml",
    "mmHg_s_ml": "mmHg s/ml", "N_m": "N/m", "m3_Pa": "m³/Pa", "ml_mmHg": "ml/mmHg", "1": "", "percent": "%",
    "1_s": "1/s", "1_s2": "1/s²",
}  # fmt: skip
"""How units are printed that are not printed as they are written."""


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_how_a_unit_is_printed_and_read_from_a_column(suffix: str) -> None:
    assert symbol(suffix) == PRINTED.get(suffix, suffix)
    assert unit_of(f"mean_value_{suffix}") == suffix


def test_what_is_shown_stands_beside_its_unit() -> None:
    """Numbers and label follow from one unit, which must be one of the column."""
    flow, share = Shown("flow", "ml_s"), Shown("area", "percent", "of t = 0")
    assert (flow.label, flow.head, flow(2e-6)) == ("flow [ml/s]", "flow ml/s", pytest.approx(2.0, rel=1e-15))
    assert (share.label, share.head, share(0.25)) == ("area [% of t = 0]", "area % of t = 0", 25.0)
    assert (Shown("ratio", "1").label, Shown("ratio", "1").head, Shown("", "1").label) == ("ratio [1]", "ratio", "")
    assert flow.check("flow_in_m3_s") == "flow_in_m3_s"
    assert flow(np.array([3e-6, 1e-6])) == pytest.approx([3.0, 1.0], rel=1e-15)
    for column in ("sawss_Pa", "lumen_volume_m3", "flow_ml_s", "unknowns"):
        with pytest.raises(ValueError, match="it is no flow_rate"):
            flow.check(column)
    assert in_unit(3333.05, "mmHg") == "25 mmHg"
    assert in_unit([1e-3, -2.5e-3, 0.0], "mm", ".1f") == "(1.0, -2.5, 0.0) mm"


def test_durations() -> None:
    assert [seconds(text) for text in ("90s", "2h", "1h 30min", "2.5min")] == [90.0, 7200.0, 5400.0, 150.0]
    for text in ("", "2", "2 d", "h", "-1h"):
        with pytest.raises(ValueError, match="is no duration"):
            seconds(text)


def test_each_dimension_has_one_si_unit_listed_first() -> None:
    assert set(SI_SUFFIX) == {unit.dimension for unit in SUFFIXES.values()}
    for dimension, first in SI_SUFFIX.items():
        of_it = [suffix for suffix, unit in SUFFIXES.items() if unit.dimension == dimension]
        assert [first] == of_it[:1] == [suffix for suffix in of_it if SUFFIXES[suffix].factor == 1.0]


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_si_passes_bitwise(value: float) -> None:
    assert to_si(value, "Pa") == value


@given(st.floats(min_value=-1e12, max_value=1e12), st.sampled_from(sorted(SUFFIXES)))
def test_round_trip(value: float, suffix: str) -> None:
    assert from_si(to_si(value, suffix), suffix) == pytest.approx(value, rel=1e-15, abs=1e-300)


def test_too_large_becomes_infinite() -> None:
    assert to_si(1e308, "MPa") == math.inf
    assert to_si(-(10**400), "Pa") == -math.inf
    assert math.isnan(to_si(math.nan, "kPa"))
