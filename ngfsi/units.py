"""Units: the only place with conversion factors. Everywhere else numbers are SI floats.

A quantity in a file carries its unit in the key, `lumen_diameter_mm = 11.1`; `ConfigModel` strips the
suffix and converts. The aliases `Length`, `Pressure`, ... mark the fields for which that holds.

Source of the factors: BIPM, The International System of Units (9th ed.), and for mmHg the value of the study that
this package follows, 133.322 Pa (the conventional 133.322387 Pa differs by 3e-6).
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from fractions import Fraction
from typing import Annotated, NamedTuple


@dataclass(frozen=True)
class Dimension:
    """Marks a float as a physical quantity, e.g. `Annotated[float, Dimension("length")]`."""

    name: str


class Unit(NamedTuple):
    """A unit: the dimension it measures and its size in SI."""

    dimension: str
    factor: float


MMHG = 133.322
"""One millimetre of mercury in pascal."""

UNITS: dict[str, Unit] = {
    "m": Unit("length", 1.0),
    "cm": Unit("length", 1e-2),
    "mm": Unit("length", 1e-3),
    "um": Unit("length", 1e-6),
    "m2": Unit("area", 1.0),
    "cm2": Unit("area", 1e-4),
    "mm2": Unit("area", 1e-6),
    "m3": Unit("volume", 1.0),
    "ml": Unit("volume", 1e-6),
    "mm3": Unit("volume", 1e-9),
    "s": Unit("time", 1.0),
    "ms": Unit("time", 1e-3),
    "min": Unit("time", 60.0),
    "h": Unit("time", 3600.0),
    "m_s": Unit("velocity", 1.0),
    "cm_s": Unit("velocity", 1e-2),
    "mm_s": Unit("velocity", 1e-3),
    "m_s2": Unit("acceleration", 1.0),
    "m3_s": Unit("flow_rate", 1.0),
    "ml_s": Unit("flow_rate", 1e-6),
    "ml_min": Unit("flow_rate", 1e-6 / 60),
    "l_min": Unit("flow_rate", 1e-3 / 60),
    "Pa": Unit("pressure", 1.0),
    "kPa": Unit("pressure", 1e3),
    "MPa": Unit("pressure", 1e6),
    "mmHg": Unit("pressure", MMHG),
    "kg_m3": Unit("density", 1.0),
    "g_cm3": Unit("density", 1e3),
    "Pa_s": Unit("viscosity", 1.0),
    "mPa_s": Unit("viscosity", 1e-3),
    "Pa_s_m3": Unit("resistance", 1.0),
    "Pa_s_ml": Unit("resistance", 1e6),
    "mmHg_s_ml": Unit("resistance", MMHG * 1e6),
    "m3_Pa": Unit("compliance", 1.0),
    "ml_mmHg": Unit("compliance", 1e-6 / MMHG),
    "rad": Unit("angle", 1.0),
    "deg": Unit("angle", math.pi / 180),
}
"""Suffix as written in files -> unit; the SI unit stands first in its dimension."""

DURATION = r"(\d+(?:\.\d+)?)(h|min|s)"

SAME_TIME = 1e-9
"""Times [s] closer than this are one."""

SI_SUFFIX: dict[str, str] = {unit.dimension: suffix for suffix, unit in UNITS.items() if unit.factor == 1.0}
"""Dimension -> suffix of its SI unit."""

Length = Annotated[float, Dimension("length")]
Area = Annotated[float, Dimension("area")]
Volume = Annotated[float, Dimension("volume")]
Time = Annotated[float, Dimension("time")]
Velocity = Annotated[float, Dimension("velocity")]
Acceleration = Annotated[float, Dimension("acceleration")]
FlowRate = Annotated[float, Dimension("flow_rate")]
Pressure = Annotated[float, Dimension("pressure")]
Density = Annotated[float, Dimension("density")]
Viscosity = Annotated[float, Dimension("viscosity")]
Resistance = Annotated[float, Dimension("resistance")]
Compliance = Annotated[float, Dimension("compliance")]
Angle = Annotated[float, Dimension("angle")]


def suffixes(dimension: str) -> list[str]:
    """Return the suffixes of all units of a dimension, the SI unit first."""
    return sorted(
        (s for s, unit in UNITS.items() if unit.dimension == dimension), key=lambda s: s != SI_SUFFIX[dimension]
    )


def unit_of(column: str) -> str:
    """Return the unit that the name of a column ends with, e.g. ml_s of flow_ml_s; empty if there is none."""
    return max((unit for unit in UNITS if column.endswith(f"_{unit}")), key=len, default="")


def to_si(value: float, suffix: str) -> float:
    """Convert `value` in the unit `suffix` to SI.

    The product is taken of the decimal numbers as written and rounded once, so that 11.1 mm is the float 0.0111 and
    not its neighbour. Values too large for a float become infinite, which a ConfigModel refuses.
    """
    factor = UNITS[suffix].factor
    try:
        number = float(value)
        if factor == 1.0 or not math.isfinite(number):
            return number
        return float(Fraction(repr(number)) * Fraction(repr(factor)))
    except OverflowError:
        return math.inf if value > 0 else -math.inf


def seconds(text: str) -> float:
    """Return the seconds in a duration such as "2h", "1h30min" or "90s".

    Raises:
        ValueError: the text is none.
    """
    parts = re.findall(DURATION, text.replace(" ", ""))
    if not parts or "".join(number + unit for number, unit in parts) != text.replace(" ", ""):
        raise ValueError(f"'{text}' is no duration: write e.g. 2h, 1h30min or 90s")
    return sum(to_si(float(number), unit) for number, unit in parts)


def from_si(value: float, suffix: str) -> float:
    """Convert the SI `value` to the unit `suffix` (for display)."""
    return value / UNITS[suffix].factor
