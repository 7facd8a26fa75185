"""The uniaxial fit against constants that are known."""

from __future__ import annotations

import numpy as np
import pytest

from ngfsi.errors import MaterialError
from ngfsi.identify.uniaxial import fit, nominal_stress

CONSTANTS = np.array([13.1e3, -9.61e3, 8.86e3])
STRETCH = 1 - np.linspace(0.01, 0.3, 30)


def test_stress_of_the_law() -> None:
    """P = 2 (x - x^-2)(W1 + W2 / x) with W1 = c10 + c11 (I2 - 3), W2 = c01 + c11 (I1 - 3): Treloar's form."""
    x = STRETCH
    I1, I2 = x**2 + 2 / x, 2 * x + x**-2
    W1, W2 = CONSTANTS[0] + CONSTANTS[2] * (I2 - 3), CONSTANTS[1] + CONSTANTS[2] * (I1 - 3)
    assert nominal_stress(x, CONSTANTS) == pytest.approx(2 * (x - x**-2) * (W1 + W2 / x), rel=1e-12)


def test_exact_data_give_the_constants_back() -> None:
    found = fit(STRETCH, nominal_stress(STRETCH, CONSTANTS))
    assert found.constants == pytest.approx(CONSTANTS, rel=1e-6)
    assert found.residual < 1e-6
    assert found.told_apart


def test_confidence_intervals_hold_what_they_promise() -> None:
    """95 % of many noisy tests have each constant, and the sum, inside of the interval."""
    random, runs = np.random.default_rng(1), 600
    exact, inside = nominal_stress(STRETCH, CONSTANTS), np.zeros(4)
    for _ in range(runs):
        found = fit(STRETCH, exact + 94.54 * random.standard_normal(len(STRETCH)))
        gap = np.abs(found.constants - CONSTANTS)
        total = abs(found.constants[:2].sum() - CONSTANTS[:2].sum())
        inside += [*(gap < found.half_width), total < found.sum_half_width]
    # 95 % +- three standard deviations of a count
    assert np.all(np.abs(inside / runs - 0.95) < 3 * np.sqrt(0.95 * 0.05 / runs))


def test_says_when_the_constants_cannot_be_told_apart() -> None:
    random = np.random.default_rng(2)
    small = 1 - np.linspace(0.002, 0.05, 30)
    found = fit(small, nominal_stress(small, CONSTANTS) + 10 * random.standard_normal(30))
    assert not found.told_apart
    assert "c10 and c01 cannot be told apart by this test" in found.verdict
    assert found.correlation[0, 1] < -0.999
    # and the sum, half the shear modulus, is known
    assert found.sum_half_width < 0.1 * found.difference_half_width
    assert "cannot" not in fit(STRETCH, nominal_stress(STRETCH, CONSTANTS) + random.standard_normal(30)).verdict


def test_refusals() -> None:
    with pytest.raises(MaterialError, match="at least four points, not 3"):
        fit(STRETCH[:3], STRETCH[:3])
    with pytest.raises(MaterialError, match="do not tell three constants apart"):
        fit(np.ones(5), np.zeros(5))
    with pytest.raises(MaterialError, match="not the strain"):
        fit(STRETCH - 1, STRETCH)
