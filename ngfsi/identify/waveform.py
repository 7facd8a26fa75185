"""A representative waveform from a measured signal: its cycles found, and their ensemble mean."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d
from scipy.signal import find_peaks

from ngfsi.arrays import Array
from ngfsi.errors import CaseError

SMOOTHING = 0.08
"""Width of the filter with which the beginnings of cycles are looked for, as a fraction of the period."""
LEAST_CORRELATION = 0.2
NEAR_HIGHEST = 0.7
CLOSEST = 0.6
"""Beginnings of cycles are at least this fraction of the period apart."""


@dataclass(frozen=True)
class Ensemble:
    """Mean of cycles.

    Attributes:
        times: (n,) s, from 0 to the mean period; the last value repeats the first.
        values: (n,) mean of the cycles.
        spread: (n,) standard deviation of the cycles.
        starts: (cycles + 1,) s, where the cycles of the signal begin.
    """

    times: Array
    values: Array
    spread: Array
    starts: Array

    @property
    def period(self) -> float:
        """Mean period (s)."""
        return float(self.times[-1])


def ensemble(times: Array, signal: Array, points: int = 48) -> Ensemble:
    """Return the ensemble mean of the cycles of a signal sampled evenly.

    The period is that of the first maximum of the autocorrelation; cycles begin at minima of the smoothed signal.

    Args:
        times, signal: (n,) s, and any unit.

    Raises:
        CaseError: the samples are not even, or fewer than two whole cycles are found.
    """
    step = np.diff(times)
    if len(times) != len(signal) or len(times) < 8 or np.ptp(step) > 1e-3 * abs(step.mean()):
        raise CaseError("a waveform is found in a signal of at least 8 even samples, with as many times as values")
    dt = float(step.mean())
    centred = gaussian_filter1d(signal - np.mean(signal), 1.0)
    correlation = np.correlate(centred, centred, "full")[len(centred) - 1 :]
    # each lag by the number of its pairs, so that many cycles do not count for more than few
    correlation = correlation / np.arange(len(centred), 0, -1)
    crossing = int(np.argmax(correlation < 0))
    half = len(correlation) // 2
    peaks, _ = find_peaks(correlation[crossing:half], height=LEAST_CORRELATION * correlation[0])
    if crossing == 0 or len(peaks) == 0:
        raise CaseError("no cycle is found that repeats within half of the signal: record at least two whole cycles")
    lags = crossing + peaks
    # the first of the high maxima: lower ones before it are of harmonics, later ones of several cycles
    period = float(lags[np.argmax(correlation[lags] > NEAR_HIGHEST * correlation[lags].max())]) * dt
    smooth = gaussian_filter1d(signal, SMOOTHING * period / dt)
    minima, _ = find_peaks(-smooth, distance=max(1, round(CLOSEST * period / dt)), prominence=0.2 * np.ptp(smooth))
    if len(minima) < 3:
        raise CaseError(f"only {max(len(minima) - 1, 0)} whole cycles of {period:.3g} s are found: record more")
    starts = times[minima]
    phase = np.linspace(0, 1, points + 1)[:-1]
    whole = CubicSpline(times, signal)
    cycles = np.array([whole(a + phase * (b - a)) for a, b in pairwise(starts)])
    mean, spread = cycles.mean(axis=0), cycles.std(axis=0, ddof=1) if len(cycles) > 1 else np.zeros(points)
    length = float(np.mean(np.diff(starts)))
    return Ensemble(length * np.r_[phase, 1.0], np.r_[mean, mean[:1]], np.r_[spread, spread[:1]], starts)
