"""Units: the only place with conversion factors. Everywhere else numbers are SI floats.

A quantity in a file carries its unit in the key, `lumen_diameter_mm = 11.1`; `ConfigModel` strips the
suffix and converts. The aliases `Length`, `Pressure`, ... mark the fields for which that holds. What readers see is
converted by `Shown`, a name and a unit from which both the numbers and what stands beside them follow.

Source of the factors: BIPM, The International System of Units (9th ed.), and for mmHg the value of the study that
this package follows, 133.322 Pa (the conventional 133.322387 Pa differs by 3e-6).
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, Annotated, NamedTuple, TypeVar

if TYPE_CHECKING:
    from ngfsi.arrays import Array

Value = TypeVar("Value", float, "Array")


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

INCH = 0.0254
DOT, POINT = INCH / 96, INCH / 72
"""Pixel of SVG and of CSS, and point of fonts, in metres (W3C, CSS Values and Units Level 3)."""

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
    "m2_s": Unit("diffusivity", 1.0),
    "mm2_s": Unit("diffusivity", 1e-6),
    "m3_s": Unit("flow_rate", 1.0),
    "ml_s": Unit("flow_rate", 1e-6),
    "ml_min": Unit("flow_rate", 1e-6 / 60),
    "l_min": Unit("flow_rate", 1e-3 / 60),
    "Pa": Unit("pressure", 1.0),
    "kPa": Unit("pressure", 1e3),
    "MPa": Unit("pressure", 1e6),
    "mmHg": Unit("pressure", MMHG),
    "N_m": Unit("tension", 1.0),
    "kg_m3": Unit("density", 1.0),
    "g_cm3": Unit("density", 1e3),
    "Pa_s": Unit("viscosity", 1.0),
    "mPa_s": Unit("viscosity", 1e-3),
    "1_s": Unit("shear_rate", 1.0),
    "Pa_s_m3": Unit("resistance", 1.0),
    "Pa_s_ml": Unit("resistance", 1e6),
    "mmHg_s_ml": Unit("resistance", MMHG * 1e6),
    "m3_Pa": Unit("compliance", 1.0),
    "ml_mmHg": Unit("compliance", 1e-6 / MMHG),
    "rad": Unit("angle", 1.0),
    "deg": Unit("angle", math.pi / 180),
}
"""Suffix as written in files -> unit; the SI unit stands first in its dimension."""

SUFFIXES: dict[str, Unit] = UNITS | {
    "1": Unit("number", 1.0),
    "percent": Unit("number", 1e-2),
    "1_s2": Unit("eigenvalue", 1.0),
}
"""Suffix of a column -> unit: beside those of keys those that no key has."""

DURATION = r"(\d+(?:\.\d+)?)(h|min|s)"

SAME_TIME = 1e-9
"""Times [s] closer than this are one."""

SI_SUFFIX: dict[str, str] = {unit.dimension: suffix for suffix, unit in SUFFIXES.items() if unit.factor == 1.0}
"""Dimension -> suffix of its SI unit."""

Length = Annotated[float, Dimension("length")]
Area = Annotated[float, Dimension("area")]
Volume = Annotated[float, Dimension("volume")]
Time = Annotated[float, Dimension("time")]
Velocity = Annotated[float, Dimension("velocity")]
Acceleration = Annotated[float, Dimension("acceleration")]
Diffusivity = Annotated[float, Dimension("diffusivity")]
FlowRate = Annotated[float, Dimension("flow_rate")]
Pressure = Annotated[float, Dimension("pressure")]
Tension = Annotated[float, Dimension("tension")]
Density = Annotated[float, Dimension("density")]
Viscosity = Annotated[float, Dimension("viscosity")]
ShearRate = Annotated[float, Dimension("shear_rate")]
Resistance = Annotated[float, Dimension("resistance")]
Compliance = Annotated[float, Dimension("compliance")]
Angle = Annotated[float, Dimension("angle")]


def suffixes(dimension: str) -> list[str]:
    """Return the suffixes of all units of a dimension, the SI unit first."""
    return sorted(
        (s for s, unit in UNITS.items() if unit.dimension == dimension), key=lambda s: s != SI_SUFFIX[dimension]
    )


USUAL = {"length": "mm", "area": "mm2", "volume": "ml", "flow_rate": "ml_s", "pressure": "mmHg", "angle": "deg"}
"""Dimension -> unit in which a value of it is expected, where that is not the SI unit."""


def readable(dimension: str, value: float | Iterable[float] | None) -> str:
    """Return the suffix of the unit in which a value, or a list of them, takes the fewest characters, or the usual one
    where that takes one more."""
    numbers = [] if value is None else list(value) if isinstance(value, Iterable) else [value]
    usual = USUAL.get(dimension, SI_SUFFIX[dimension])
    if not any(numbers):
        return usual
    units = [usual, *(unit for unit in suffixes(dimension) if unit != usual)]
    return min(units, key=lambda unit: sum(len(f"{from_si(number, unit):.6g}") for number in numbers) - (unit == usual))


def unit_of(column: str) -> str:
    """Return the unit that the name of a column ends with, e.g. ml_s of flow_ml_s; empty if there is none."""
    return max((unit for unit in SUFFIXES if column.endswith(f"_{unit}")), key=len, default="")


def to_si(value: float, suffix: str) -> float:
    """Convert `value` in the unit `suffix` to SI.

    The product is taken of the decimal numbers as written and rounded once, so that 11.1 mm is the float 0.0111 and
    not its neighbour. Values too large for a float become infinite, which a ConfigModel refuses.
    """
    factor = SUFFIXES[suffix].factor
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


def from_si(value: Value, suffix: str) -> Value:
    """Convert the SI `value`, a number or an array, to the unit `suffix` (for display)."""
    return value / SUFFIXES[suffix].factor


def symbol(suffix: str) -> str:
    """Return a unit as it is printed, e.g. "ml/s", "mm²", "Pa s/m³"; empty for pure numbers."""
    if suffix in ("1", "percent"):
        return "%" if suffix == "percent" else ""
    printed = re.sub("(Pa|mmHg)_s", r"\1 s", suffix).replace("_", "/")
    return re.sub("(?<=[a-z])[23]", lambda power: "²³"[int(power[0]) - 2], printed)


def in_unit(value: float | Iterable[float], suffix: str, spec: str = "g") -> str:
    """Return the SI `value` in a unit with the unit, e.g. "25 mmHg" or, of several, "(1, 0, 2) mm"; `spec` as of
    `format`."""
    if isinstance(value, Iterable):
        return f"({', '.join(format(from_si(one, suffix), spec) for one in value)}) {symbol(suffix)}"
    return f"{from_si(value, suffix):{spec}} {symbol(suffix)}"


@dataclass(frozen=True)
class Shown:
    """A quantity on an axis or in a table: what stands there and the numbers both follow from the unit.

    Attributes:
        name: stands before the unit.
        unit: its suffix.
        beside: stands behind the unit, as "of t = 0" behind that of a ratio.
    """

    name: str
    unit: str
    beside: str = ""

    @property
    def label(self) -> str:
        """Of an axis, e.g. "flow [ml/s]"; empty without a name."""
        return f"{self.name} [{' '.join(filter(None, (symbol(self.unit) or '1', self.beside)))}]" if self.name else ""

    @property
    def head(self) -> str:
        """Of a column of a table, e.g. "flow ml/s"."""
        return " ".join(filter(None, (self.name, symbol(self.unit), self.beside)))

    @property
    def si(self) -> str:
        """Suffix of the columns that hold the quantity."""
        return SI_SUFFIX[SUFFIXES[self.unit].dimension]

    def __call__(self, values: Value) -> Value:
        """Return SI values in the unit."""
        return from_si(values, self.unit)

    def check(self, column: str) -> str:
        """Return a column that holds the quantity.

        Raises:
            ValueError: it is of another dimension.
        """
        if unit_of(column) != self.si:
            raise ValueError(f"'{column}' cannot be shown in {self.unit}: it is no {SUFFIXES[self.unit].dimension}")
        return column
