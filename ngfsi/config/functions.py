"""Curves: quantities prescribed over time, tagged by `kind`, e.g. `{kind = "ramp", final_mmHg = 25, duration_s = 1}`.

A curve is a function of the time in seconds that returns SI, and names its `breakpoints`: the times where its slope
jumps. A time scheme of higher order restarts there.
"""

from __future__ import annotations

from abc import abstractmethod
from bisect import bisect_right
from functools import cache
from itertools import pairwise
from math import cos, isclose, pi
from pathlib import Path
from typing import Annotated, Any, ClassVar, Generic, Literal, Self, TypeVar

from pydantic import Field, model_validator

from ngfsi.config.columns import first_columns
from ngfsi.config.messages import key_error
from ngfsi.config.model import ConfigModel, tagged
from ngfsi.errors import OutputError
from ngfsi.units import MMHG, Angle, Density, FlowRate, Length, Pressure, Time

Q = TypeVar("Q", bound=float)


class Curve(ConfigModel):
    """Base of the curves."""

    kind: str

    @abstractmethod
    def __call__(self, t: float) -> float:
        """Return the value at time t (s), in SI."""

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Times (s) where the slope jumps."""
        return ()


class Constant(Curve, Generic[Q]):
    """The same value at all times."""

    kind: Literal["constant"] = "constant"
    value: Q
    """At all times."""

    def __call__(self, t: float) -> float:  # noqa: ARG002 - a curve takes the time even if it ignores it
        return self.value


Posture = Literal["lying", "sitting", "standing"]

BELOW_HEART: dict[Posture, float] = {"lying": 0.0, "sitting": 0.50, "standing": 0.93}
"""Depth of the middle of the calf below the heart (m) of an adult of 1.75 m: calf at 0.20, heart at 0.73 of the stature
above the sole; a seat takes away the thigh, 0.245 of it (R. Drillis and R. Contini, Body segment parameters, 1966, for
knee and hip; height of the heart and of the middle of the calf are round numbers)."""

FREE_FALL = 9.81
"""Acceleration of the weight (m/s2)."""


class Hydrostatic(Curve):
    """The pressure of blood at rest: that at the height of the heart, and the weight of the column below it.

    `{kind = "hydrostatic", posture = "standing"}` takes the depth of the middle of the calf.
    """

    kind: Literal["hydrostatic"] = "hydrostatic"
    posture: Posture = "lying"
    """From which the depth below the heart follows."""
    below_heart: Length = Field(default_factory=lambda given: BELOW_HEART.get(given.get("posture"), 0.0))
    """Depth below the heart; default: by posture 0, 0.50 or 0.93 m."""
    at_heart: Pressure = 10 * MMHG
    """In a vein at the height of the heart; default: the outlet pressure of the source study, of a subject lying."""
    density: Density = Field(default=1060.0, gt=0)
    """Of the blood in the veins above."""

    def __call__(self, t: float) -> float:  # noqa: ARG002 - a curve takes the time even if it ignores it
        return self.at_heart + self.density * FREE_FALL * self.below_heart


class Rise(Curve, Generic[Q]):
    """From `initial` to `final` within `duration` after `start`, held before and after; base of the ramps."""

    initial: Q = Field(default=0.0)  # type: ignore[assignment] # Q is a float, its alias only names the dimension
    """Up to the start."""
    final: Q
    """From the end of the rise on."""
    start: Time = 0.0
    """When the rise begins."""
    duration: Time = Field(gt=0)
    """Of the rise."""

    def __call__(self, t: float) -> float:
        done = self._fraction(min(max((t - self.start) / self.duration, 0.0), 1.0))
        # exact at both ends, which initial + done * (final - initial) is not
        return (1.0 - done) * self.initial + done * self.final

    @staticmethod
    @abstractmethod
    def _fraction(elapsed: float) -> float:
        """Return the fraction of the rise after a fraction of the duration."""


class Ramp(Rise[Q]):
    """Linear rise."""

    kind: Literal["ramp"] = "ramp"

    @staticmethod
    def _fraction(elapsed: float) -> float:
        return elapsed

    @property
    def breakpoints(self) -> tuple[float, ...]:
        return () if self.initial == self.final else (self.start, self.start + self.duration)


class SmoothRamp(Rise[Q]):
    """Rise without a kink, by (1 - cos(pi s))/2 of the difference after a fraction s of the duration."""

    kind: Literal["smooth_ramp"] = "smooth_ramp"

    @staticmethod
    def _fraction(elapsed: float) -> float:
        return (1.0 - cos(pi * elapsed)) / 2


class Sampled(Curve, Generic[Q]):
    """Through given points; base of the curves of many values."""

    times: tuple[Time, ...] = Field(min_length=1)
    """Of the values, rising."""
    values: tuple[Q, ...] = Field(min_length=1)
    """At these times."""

    @model_validator(mode="after")
    def _is_a_function(self) -> Self:
        if len(self.times) != len(self.values):
            numbers = f"{len(self.times)} and {len(self.values)}"
            raise ValueError(f"a {self.kind} needs as many times as values, not {numbers}")
        for earlier, later in pairwise(self.times):
            if later <= earlier:
                raise ValueError(f"the times of a {self.kind} must increase, but {later:g} s follows {earlier:g} s")
        return self


class Table(Sampled[Q]):
    """Linear between given points, held before the first and after the last."""

    kind: Literal["table"] = "table"

    def __call__(self, t: float) -> float:
        right = bisect_right(self.times, t)
        if right == 0 or right == len(self.times):
            return self.values[max(right - 1, 0)]
        t0, t1 = self.times[right - 1 : right + 1]
        done = (t - t0) / (t1 - t0)
        return (1.0 - done) * self.values[right - 1] + done * self.values[right]

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Times (s) where the slope jumps, the ends included unless the table is level there."""
        points = list(zip(self.times, self.values, strict=True))
        slopes = [0.0, *((v1 - v0) / (t1 - t0) for (t0, v0), (t1, v1) in pairwise(points)), 0.0]
        bends = [not isclose(before, after, rel_tol=1e-9) for before, after in pairwise(slopes)]
        return tuple(t for t, bend in zip(self.times, bends, strict=True) if bend)


class Harmonics(Curve, Generic[Q]):
    """Periodic: mean + sum over n = 1, 2, ... of amplitude_n cos(2 pi n t / period + phase_n)."""

    kind: Literal["harmonics"] = "harmonics"
    mean: Q
    """Mean over a period."""
    amplitudes: tuple[Q, ...] = Field(min_length=1)
    """Of the harmonics from the first on."""
    phases: tuple[Angle, ...]
    """Of the harmonics, as many as amplitudes."""
    period: Time = Field(gt=0)
    """Of the first harmonic."""

    @model_validator(mode="after")
    def _one_phase_each(self) -> Self:
        if len(self.phases) != len(self.amplitudes):
            numbers = f"{len(self.phases)} and {len(self.amplitudes)}"
            raise ValueError(f"harmonics need as many phases as amplitudes, not {numbers}")
        return self

    def __call__(self, t: float) -> float:
        waves = enumerate(zip(self.amplitudes, self.phases, strict=True), start=1)
        return self.mean + sum(size * cos(2 * pi * n * t / self.period + phase) for n, (size, phase) in waves)


class Waveform(Sampled[Q]):
    """One period of a measured curve, repeated: a periodic cubic spline through the points, the last as the first.

    Instead of times and values a file may be named, `{kind = "waveform", file = "inflow.csv"}`: two columns with a
    header that carries units, e.g. `time_s,flow_ml_s`. The resolved case holds the numbers, and needs the file no more.
    """

    instead_of_file: ClassVar[tuple[str, ...]] = ("times", "values")

    kind: Literal["waveform"] = "waveform"
    times: tuple[Time, ...] = Field(min_length=4)
    """Of one period."""

    @model_validator(mode="before")
    @classmethod
    def _read_file(cls, data: Any) -> Any:
        if not isinstance(data, dict) or "file" not in data:
            return data
        try:
            (time, times), (unit, values) = first_columns(Path(str(data["file"])), 2)
        except OutputError as error:
            raise key_error("file", f"is not accepted: {error}") from None
        others = {key: value for key, value in data.items() if key != "file"}
        return {**others, f"times_{time}": times, f"values_{unit}": values}

    @model_validator(mode="after")
    def _is_a_period(self) -> Self:
        if abs(self.values[-1] - self.values[0]) > 1e-6 * max(map(abs, self.values)):
            raise ValueError("the last value of a waveform must repeat the first one: it closes the period")
        return self

    def __call__(self, t: float) -> float:
        return float(_periodic(self.times, self.values)(t))


@cache
def _periodic(times: tuple[float, ...], values: tuple[float, ...]) -> Any:
    from scipy.interpolate import CubicSpline  # takes half a second, which most cases need not wait for

    return CubicSpline(times, (*values[:-1], values[0]), bc_type="periodic")


PressureConstant, FlowConstant = Constant[Pressure], Constant[FlowRate]
PressureRamp, FlowRamp = Ramp[Pressure], Ramp[FlowRate]
PressureSmoothRamp, FlowSmoothRamp = SmoothRamp[Pressure], SmoothRamp[FlowRate]
PressureTable, FlowTable = Table[Pressure], Table[FlowRate]
PressureHarmonics, FlowHarmonics = Harmonics[Pressure], Harmonics[FlowRate]
PressureWaveform, FlowWaveform = Waveform[Pressure], Waveform[FlowRate]

PressureCurve = Annotated[
    Curve,
    tagged("kind", PressureConstant, PressureRamp, PressureSmoothRamp, PressureTable, PressureHarmonics,
           PressureWaveform, Hydrostatic),
]  # fmt: skip
"""A pressure over time: Pa over s."""

FlowCurve = Annotated[
    Curve, tagged("kind", FlowConstant, FlowRamp, FlowSmoothRamp, FlowTable, FlowHarmonics, FlowWaveform)
]
"""A volume flow rate over time: m3/s over s."""

FactorConstant, FactorRamp, FactorSmoothRamp, FactorTable = (
    Constant[float],
    Ramp[float],
    SmoothRamp[float],
    Table[float],
)
FactorHarmonics, FactorWaveform = Harmonics[float], Waveform[float]

FactorCurve = Annotated[
    Constant[float] | Ramp[float] | SmoothRamp[float] | Table[float] | Harmonics[float] | Waveform[float],
    tagged("kind", FactorConstant, FactorRamp, FactorSmoothRamp, FactorTable, FactorHarmonics, FactorWaveform),
]
"""A factor over time: pure numbers over s."""
