"""Surrogates: responses whose optimum is known are found, and what is said of the error is right."""

from __future__ import annotations

import numpy as np
import pytest
from sklearn.base import clone

from ngfsi.errors import CaseError
from ngfsi.study.design import sobol
from ngfsi.study.surrogate import Surrogate

RANGES = {"a": (0.0, 10.0), "b": (-1.0, 1.0), "idle": (5.0, 6.0)}


def two_hills(points: np.ndarray) -> np.ndarray:
    """Hills of height 3 at a = 7, b = 0.5 and 2 at a = 2.5, b = -0.4; the third factor does nothing."""
    a, b = points[:, 0] / 10, points[:, 1] / 2
    first = 3 * np.exp(-((a - 0.7) ** 2 + (b - 0.25) ** 2) / 0.06)
    return np.asarray(first + 2 * np.exp(-((a - 0.25) ** 2 + (b + 0.2) ** 2) / 0.06))


def test_the_optima_of_a_known_response_are_found() -> None:
    design = sobol(RANGES, 64, seed=2)
    surrogate = Surrogate.through(design, list(two_hills(design.points)), lambda points: points[:, :2] / [10, 2])
    best = surrogate.best(2, apart=0.5)
    np.testing.assert_allclose(best[:, 0], [7.0, 2.5], atol=0.2)
    np.testing.assert_allclose(best[:, 1], [0.5, -0.4], atol=0.06)
    mean, deviation = surrogate(best)
    np.testing.assert_allclose(mean, [3.0, 2.0], rtol=0.03)
    assert np.all(abs(mean - two_hills(best)) < 3 * deviation + 1e-3)


def test_the_best_of_what_is_allowed() -> None:
    """Without the higher hill the lower one is the best, and then the edge of what is allowed on its side of it."""
    design = sobol(RANGES, 64, seed=2)
    surrogate = Surrogate.through(design, list(two_hills(design.points)), lambda points: points[:, :2] / [10, 2])
    best = surrogate.best(2, apart=0.5, allowed=lambda points: points[:, 0] < 5)
    np.testing.assert_allclose(best[:, 0], [2.5, 5.0], atol=0.2)
    assert best[0, 1] == pytest.approx(-0.4, abs=0.06)


def test_an_optimum_on_the_edge_of_the_ranges() -> None:
    design = sobol(RANGES, 32, seed=2)
    plane = 2 * design.points[:, 0] / 10 - design.points[:, 1]
    (best,) = Surrogate.through(design, list(plane)).best(1, apart=0.1)
    np.testing.assert_allclose(best[:2], [10.0, -1.0], atol=0.05)


def test_prediction_of_a_point_left_out_is_that_of_a_fit_without_it() -> None:
    """The formula against the fit that it saves, with the same kernel and scale of the results."""
    design = sobol(RANGES, 16, seed=5)
    values = two_hills(design.points)
    surrogate = Surrogate.through(design, list(values))
    said, deviation = surrogate.left_out()
    process = surrogate.process
    center, scale = process._y_train_mean, process._y_train_std
    for out in (0, 7, 15):
        kept = np.arange(16) != out
        other = clone(process).set_params(kernel=process.kernel_, optimizer=None, normalize_y=False)
        other.fit(surrogate.places[kept], (values[kept] - center) / scale)
        mean, spread = other.predict(surrogate.places[out : out + 1], return_std=True)
        assert said[out] == pytest.approx(center + scale * mean[0], rel=1e-6)
        assert deviation[out] == pytest.approx(scale * spread[0], rel=1e-5)


def test_an_angle_means_nothing_without_its_radius() -> None:
    """In polar coordinates points of radius zero are one; computed at one angle, they are known at all."""
    design = sobol({"radius": (0.0, 1.0), "angle": (0.0, 6.0)}, 16, seed=3)
    design.points[:4, 0] = 0.0

    def place(points: np.ndarray) -> np.ndarray:
        radius, angle = points.T
        return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)

    values = place(design.points) @ [1.0, 2.0] + 3
    mean, deviation = Surrogate.through(design, list(values), place)(np.array([[0.0, 0.1], [0.0, 5.3]]))
    np.testing.assert_allclose(mean, 3.0, rtol=1e-3)
    assert deviation[0] == deviation[1]


def test_failed_runs_are_left_out_and_too_few_are_refused() -> None:
    design = sobol(RANGES, 32, seed=2)
    values = two_hills(design.points)
    values[[3, 9]] = np.nan
    surrogate = Surrogate.through(design, list(values))
    assert len(surrogate.values) == len(surrogate.places) == 30
    values[3:] = np.nan
    with pytest.raises(CaseError, match="a surrogate over 3 coordinates needs more than 3 finite results"):
        Surrogate.through(design, list(values))
