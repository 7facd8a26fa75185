"""Averages over a period of known stresses."""

from __future__ import annotations

import numpy as np
import pytest
import pyvista as pv

from ngfsi.measure.shear_history import ShearHistory, slope, within

TIMES = np.linspace(0.0, 2.0, 4001)
PHASE = np.pi * TIMES


def test_reversing_stress() -> None:
    """a + b cos with b > a reverses; mean of |a + b cos| = 2/pi (a asin(a/b) + sqrt(b^2 - a^2))."""
    a, b = 0.3, 0.8
    shear = np.stack([a + b * np.cos(PHASE), 0 * PHASE], axis=-1)[:, None]
    found = ShearHistory.of(TIMES, shear)
    mean = 2 / np.pi * (a * np.arcsin(a / b) + np.sqrt(b**2 - a**2))
    assert found.tawss == pytest.approx(mean, rel=1e-6)
    assert found.osi == pytest.approx((1 - a / mean) / 2, rel=1e-6)
    assert found.rrt == pytest.approx(1 / a, rel=1e-9)


def test_limits() -> None:
    """A turning stress has the index 1/2 and stays for ever, a steady one 0; none has none."""
    steady, turning = np.full((4001, 2), 0.5), np.stack([np.cos(PHASE), np.sin(PHASE)], axis=-1)
    found = ShearHistory.of(TIMES, np.stack([steady, turning, 0 * steady], axis=1))
    assert found.tawss == pytest.approx([np.sqrt(0.5), 1.0, 0.0], rel=1e-9)
    assert found.osi == pytest.approx([0.0, 0.5, 0.0], abs=1e-9)
    assert found.rrt[0] == pytest.approx(np.sqrt(2.0), rel=1e-9)
    assert found.rrt[1] > 1e12
    assert np.isinf(found.rrt[2])


def test_uneven_times() -> None:
    """A stress that grows linearly has its middle as mean, however the times lie."""
    times = np.array([0.0, 0.1, 0.7, 1.0])
    assert ShearHistory.of(times, times[:, None, None] * np.ones(2)).tawss == pytest.approx(np.sqrt(2) / 2, rel=1e-12)


def test_average_over_exactly_a_period() -> None:
    """Steps that do not divide the period, one of them halved twice: still the mean of a + b sin(2 pi t/T)."""
    period, a, b = 4.0, 1.0, 0.8
    times = np.sort(np.r_[np.arange(0.0, 9.0, 0.17), 5.1 - 0.085, 5.1 - 0.0425])
    shear = (a + b * np.sin(2 * np.pi * times / period + 0.7))[:, None, None]
    end = float(times[-1])
    cut, values = within(times, shear, end - period, end)
    assert (cut[0], cut[-1]) == (end - period, end)
    assert ShearHistory.of(cut, values).tawss == pytest.approx(a, rel=2e-3)
    stored = times > end - period
    assert abs(ShearHistory.of(times[stored], shear[stored]).tawss[0] - a) > 0.015  # over the stored times alone
    assert within(times, times, 1.0, 2.5)[1] == pytest.approx(within(times, times, 1.0, 2.5)[0], rel=1e-12)


def test_slope_along_a_wall() -> None:
    """Of s = 3 z + R cos(angle) on a cylinder: 3 along it and sin(angle) around it, and nothing across the wall."""
    tube = pv.Cylinder(radius=5e-3, height=20e-3, direction=(0, 0, 1), resolution=96, capping=False)
    tube = tube.triangulate().subdivide(1).cast_to_unstructured_grid()
    x, y, z = np.asarray(tube.points, dtype=float).T
    tube["s_Pa"] = 3 * z + x
    wanted = np.hypot(3, y / np.hypot(x, y))
    # a polygon of 192 sides: the chord's direction is that of the tangent to 1e-3
    np.testing.assert_allclose(slope(tube, "s_Pa"), wanted, rtol=2e-3)
