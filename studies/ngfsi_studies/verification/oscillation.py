"""Mean, amplitude and frequency of a periodic signal, as the published benchmarks state them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from ngfsi.verify import VerificationError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Oscillation:
    """Mean (max + min)/2 and amplitude (max - min)/2 over the last period, and frequency (1/s)."""

    mean: float
    amplitude: float
    frequency: float

    @classmethod
    def of(cls, times: Array, values: Array, periods: int = 3) -> Oscillation:
        """Return that of the end of a signal; the frequency over several periods.

        Raises:
            VerificationError: the signal does not cross its middle often enough.
        """
        spline = CubicSpline(times, values)
        extremes = spline.derivative().roots(extrapolate=False)
        recent = values[len(values) // 2 :]
        middle = (recent.max() + recent.min()) / 2
        rising = np.array([t for t in spline.solve(middle, extrapolate=False) if spline(t, 1) > 0])
        if len(rising) <= periods:
            raise VerificationError(f"the signal crosses its middle only {len(rising)} times: compute for longer")
        last = spline(extremes[(extremes >= rising[-2]) & (extremes <= rising[-1])])
        frequency = periods / (rising[-1] - rising[-1 - periods])
        return cls(float(last.max() + last.min()) / 2, float(last.max() - last.min()) / 2, float(frequency))
