"""Mean, amplitude and frequency of signals that are known."""

from __future__ import annotations

import numpy as np
import pytest
from ngfsi_studies.verification.oscillation import Oscillation

from ngfsi.verify import VerificationError

TIMES = np.linspace(0.0, 10.0, 2001)


def test_a_signal_with_unequal_halves() -> None:
    """2 sin + cos of twice the angle: from -3 to 3/2, which its mean, 0, is not in the middle of."""
    angle = 2 * np.pi * 0.7 * TIMES
    found = Oscillation.of(TIMES, 0.3 + 2 * np.sin(angle) + np.cos(2 * angle))
    assert (found.mean, found.amplitude) == pytest.approx((0.3 - 0.75, 2.25), rel=1e-5)
    assert found.frequency == pytest.approx(0.7, rel=1e-7)


def test_the_end_of_a_signal_counts() -> None:
    """The first half swings wider and about another middle; of the frequency, which rises, the last periods count."""
    turns = 0.6 * TIMES + 0.045 * TIMES**2
    early = np.where(TIMES < 4, 3.0, 0.0)
    found = Oscillation.of(TIMES, early * (1 + np.sin(np.pi * TIMES)) + np.sin(2 * np.pi * turns), periods=4)
    assert (found.mean, found.amplitude) == pytest.approx((0.0, 1.0), abs=1e-5)
    last = (-0.6 + np.sqrt(0.36 + 0.18 * np.array([6, 10]))) / 0.09  # 0.6 t + 0.045 t^2 = 6, 10
    assert found.frequency == pytest.approx(4 / np.diff(last)[0], rel=1e-5)


def test_too_short_a_signal() -> None:
    with pytest.raises(VerificationError, match="crosses its middle only 3 times"):
        Oscillation.of(TIMES, np.sin(2 * np.pi * 0.25 * (TIMES - 0.5)))
