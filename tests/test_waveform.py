"""Cycles found in noisy signals that are made of known ones."""

from __future__ import annotations

import numpy as np
import pytest

from ngfsi.errors import CaseError
from ngfsi.identify.waveform import ensemble


def breath(phase: np.ndarray) -> np.ndarray:
    """A waveform with one minimum, at phase 0, and unequal flanks."""
    return 1.0 - 0.6 * np.cos(2 * np.pi * phase) + 0.15 * np.sin(4 * np.pi * phase)


def test_cycles_of_a_noisy_signal() -> None:
    """Seven breaths between 5.4 and 6.6 s with 5 % of noise: starts, mean period and shape come back."""
    random = np.random.default_rng(7)
    lengths = random.uniform(5.4, 6.6, 7)
    starts = np.r_[0.0, np.cumsum(lengths)]
    times = np.arange(0.0, starts[-1], 0.1)
    which = np.searchsorted(starts, times, side="right") - 1
    signal = breath((times - starts[which]) / lengths[which]) + 0.05 * random.standard_normal(len(times))
    found = ensemble(times, signal)
    inner = starts[1:-1]
    assert len(found.starts) in (len(inner), len(inner) + 1, len(inner) + 2)
    shift = np.array([found.starts[np.argmin(np.abs(found.starts - s))] - s for s in inner])
    assert np.ptp(shift) < 0.6
    assert found.period == pytest.approx(lengths.mean(), rel=0.03)
    # the minimum of the smoothed signal need not be where the cycle was begun: compare in phase
    phase = found.times[:-1] / found.period
    gaps = [np.abs(found.values[:-1] - breath(phase + s)).max() for s in np.linspace(-0.1, 0.1, 41)]
    assert min(gaps) < 0.12
    assert found.values[:-1].mean() == pytest.approx(1.0, rel=0.02)
    assert found.values[0] == found.values[-1]


def test_harmonics_do_not_count_as_cycles() -> None:
    times = np.arange(0.0, 60.0, 0.1)
    found = ensemble(times, np.sin(2 * np.pi * times / 6) + 1.5 * np.sin(4 * np.pi * times / 6))
    assert found.period == pytest.approx(6.0, rel=5e-3)
    assert np.diff(found.starts) == pytest.approx([6.0] * (len(found.starts) - 1), abs=0.11)


@pytest.mark.parametrize("signal", [np.linspace(0, 1, 100), np.sin(np.linspace(0, 6, 100)), np.zeros(100)])
def test_signals_without_cycles(signal: np.ndarray) -> None:
    with pytest.raises(CaseError, match="cycle"):
        ensemble(np.linspace(0, 10, 100), signal)
