"""Curves: quantities prescribed over time, tagged by `kind`, e.g. `{kind = "ramp", final_mmHg = 25, duration_s = 1}`.

A curve is a function of the time in seconds that returns SI, and names its `breakpoints`: the times where its slope
jumps. A time scheme of higher order restarts there.
"""

from __future__ import annotations

from abc import abstractmethod
from bisect import bisect_right
from itertools import pairwise
from math import cos, isclose, pi
from typing import Annotated, Generic, Literal, Self, TypeVar

from pydantic import Field, model_validator

from ngfsi.section import Section, tagged
from ngfsi.units import FlowRate, Pressure, Time

Q = TypeVar("Q", bound=float)


class Constant(Section, Generic[Q]):
    """The same value at all times."""

    kind: Literal["constant"] = "constant"
    value: Q

    def __call__(self, t: float) -> float:  # noqa: ARG002 - a curve takes the time even if it ignores it
        """Return the value at time t (s), in SI."""
        return self.value

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Times (s) where the slope jumps: none."""
        return ()


class Rise(Section, Generic[Q]):
    """From `initial` to `final` within `duration` after `start`, held before and after; base of the ramps."""

    initial: Q = Field(default=0.0)  # type: ignore[assignment] # Q is a float, its alias only names the dimension
    final: Q
    start: Time = 0.0
    duration: Time = Field(gt=0)

    def __call__(self, t: float) -> float:
        """Return the value at time t (s), in SI."""
        done = self._share(min(max((t - self.start) / self.duration, 0.0), 1.0))
        # exact at both ends, which initial + done * (final - initial) is not
        return (1.0 - done) * self.initial + done * self.final

    @staticmethod
    @abstractmethod
    def _share(elapsed: float) -> float:
        """Return the share of the rise after a share of the duration."""


class Ramp(Rise[Q]):
    """Linear rise."""

    kind: Literal["ramp"] = "ramp"

    @staticmethod
    def _share(elapsed: float) -> float:
        return elapsed

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Times (s) where the slope jumps: both ends of the ramp."""
        return () if self.initial == self.final else (self.start, self.start + self.duration)


class SmoothRamp(Rise[Q]):
    """Rise without a kink, by (1 - cos(pi s))/2 of the difference after a share s of the duration."""

    kind: Literal["smooth_ramp"] = "smooth_ramp"

    @staticmethod
    def _share(elapsed: float) -> float:
        return (1.0 - cos(pi * elapsed)) / 2

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Times (s) where the slope jumps: none."""
        return ()


class Table(Section, Generic[Q]):
    """Linear between given points, held before the first and after the last."""

    kind: Literal["table"] = "table"
    times: tuple[Time, ...] = Field(min_length=1)
    values: tuple[Q, ...] = Field(min_length=1)

    @model_validator(mode="after")
    def _is_a_function(self) -> Self:
        if len(self.times) != len(self.values):
            raise ValueError(f"a table needs as many times as values, not {len(self.times)} and {len(self.values)}")
        for earlier, later in pairwise(self.times):
            if later <= earlier:
                raise ValueError(f"the times of a table must increase, but {later:g} s follows {earlier:g} s")
        return self

    def __call__(self, t: float) -> float:
        """Return the value at time t (s), in SI."""
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


PressureConstant, PressureRamp, PressureTable = Constant[Pressure], Ramp[Pressure], Table[Pressure]
PressureSmoothRamp = SmoothRamp[Pressure]
FlowConstant, FlowRamp, FlowTable = Constant[FlowRate], Ramp[FlowRate], Table[FlowRate]
FlowSmoothRamp = SmoothRamp[FlowRate]

PressureCurve = Annotated[
    Constant[Pressure] | Ramp[Pressure] | SmoothRamp[Pressure] | Table[Pressure],
    tagged("kind", PressureConstant, PressureRamp, PressureSmoothRamp, PressureTable),
]
"""A pressure over time: Pa over s."""

FlowCurve = Annotated[
    Constant[FlowRate] | Ramp[FlowRate] | SmoothRamp[FlowRate] | Table[FlowRate],
    tagged("kind", FlowConstant, FlowRamp, FlowSmoothRamp, FlowTable),
]
"""A volume flow rate over time: m3/s over s."""
