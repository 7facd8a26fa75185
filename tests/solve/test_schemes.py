"""Weights of the time schemes: exact for polynomials of their order, and consistent with each other."""

from __future__ import annotations

import numpy as np
import pytest

from ngfsi.system.schemes import Weights, backward_euler, bdf2, weights

STEPS = [(0.1, 0.1), (0.1, 0.05), (0.02, 0.1), (1.0, 1e-3)]


def rate(w: Weights, values: tuple[float, float, float]) -> float:
    """Rate from the values at the new, last and second last time."""
    return w.new * values[0] + w.old * values[1] + w.older * values[2]


@pytest.mark.parametrize(("step", "previous"), STEPS)
def test_bdf2_is_exact_for_quadratics_with_variable_steps(step: float, previous: float) -> None:
    now = 1.7
    times = np.array([now, now - step, now - step - previous])
    for coefficients in ([3.0, 0.0, 0.0], [-1.0, 2.0, 0.0], [0.5, -2.0, 4.0]):
        y = np.polynomial.Polynomial(coefficients)
        found = rate(bdf2(step, previous), tuple(y(times)))
        scale = max(abs(y(times))) / min(step, previous)
        assert found == pytest.approx(y.deriv()(now), abs=1e-12 * scale)
    cubic = rate(bdf2(step, previous), tuple(times**3))
    # the error of differentiating a cubic through its interpolation at three points
    assert cubic - 3 * now**2 == pytest.approx(-step * (step + previous), rel=1e-6)


def test_bdf2_with_equal_steps_has_the_known_weights() -> None:
    w = bdf2(0.1, 0.1)
    assert (w.new, w.old, w.older) == pytest.approx((15.0, -20.0, 5.0), rel=1e-14)


def test_backward_euler() -> None:
    assert backward_euler(0.25) == Weights(4.0, -4.0, 0.0)


def test_choice_and_start() -> None:
    """Without a smooth step before, BDF2 starts with backward Euler, and does not read the older state."""
    assert weights("bdf2", 0.1, None) == backward_euler(0.1)
    assert weights("bdf2", 0.1, 0.05) == bdf2(0.1, 0.05)
    assert weights("backward_euler", 0.1, 0.05) == backward_euler(0.1)
