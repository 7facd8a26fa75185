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
    shift = np.array([found.starts[np.argmin(np.abs(found.starts - s))] - s for s in inner])
    assert np.ptp(shift) < 0.25
    assert len(found.starts) == len(inner)
    assert found.period == pytest.approx(np.diff(inner).mean(), rel=5e-3)
    # the minimum of the smoothed signal need not be where the cycle was begun: compare in phase
    phase = found.times[:-1] / found.period
    gaps = [np.abs(found.values[:-1] - breath(phase + s)).max() for s in np.linspace(-0.1, 0.1, 41)]
    assert min(gaps) < 0.12
    assert found.values[:-1].mean() == pytest.approx(1.0, rel=0.02)
    assert found.values[0] == found.values[-1]


def test_unequal_cycles() -> None:
    """Dips that are alike, at unequal distances: the period is the mean of these, not their median nor the lag of the
    highest correlation; mean and spread are those of cycles stretched to one length."""
    lengths = np.array([5.4, 6.8, 5.6, 5.4, 6.8])
    starts = 2 + np.r_[0.0, np.cumsum(lengths)]

    def signal(t: np.ndarray) -> np.ndarray:
        return np.asarray(1 - np.exp(-(((t[..., None] - starts) / 0.8) ** 2)).sum(axis=-1))

    times = np.arange(0.0, starts[-1] + 2, 0.1)
    found = ensemble(times, signal(times))
    assert found.starts == pytest.approx(starts)
    assert found.period == pytest.approx(lengths.mean(), rel=1e-9)
    cycles = signal(starts[:-1, None] + np.outer(lengths, np.linspace(0, 1, 49)))
    assert found.times == pytest.approx(np.linspace(0, 6, 49))
    assert found.values == pytest.approx(cycles.mean(axis=0), abs=1e-5)
    assert found.spread == pytest.approx(np.std(cycles, axis=0, ddof=1), abs=1e-5)


def test_harmonics_do_not_count_as_cycles() -> None:
    times = np.arange(0.0, 60.0, 0.1)
    found = ensemble(times, np.sin(2 * np.pi * times / 6) + 1.5 * np.sin(4 * np.pi * times / 6))
    assert found.period == pytest.approx(6.0, rel=5e-3)
    assert np.diff(found.starts) == pytest.approx([6.0] * (len(found.starts) - 1), abs=0.11)


def test_harmonics_of_few_cycles() -> None:
    """Half a period later the correlation is 0.66 of that a period later, which is of fewer pairs."""
    times = np.arange(4.0, 19.0, 0.1)
    found = ensemble(times, np.sin(2 * np.pi * times / 6) + 2.2 * np.sin(4 * np.pi * times / 6))
    assert np.diff(found.starts) == pytest.approx([6.0, 6.0])


@pytest.mark.parametrize("signal", [np.linspace(0, 1, 100), np.sin(np.linspace(0, 6, 100)), np.zeros(100)])
def test_signals_without_cycles(signal: np.ndarray) -> None:
    with pytest.raises(CaseError, match="cycle"):
        ensemble(np.linspace(0, 10, 100), signal)
