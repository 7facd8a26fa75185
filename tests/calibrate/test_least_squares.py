"""Least squares with errors and priors, on Lame's thick ring, whose areas bend with its constants."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

from ngfsi.arrays import Array
from ngfsi.errors import CaseError, MaterialError, SolverError
from ngfsi.identify.least_squares import Fit, Unknown, check, fit, in_words
from tests.solve.test_statics import INNER, OUTER

TRUTH = np.array([12e3, 0.4])
PRESSURES = np.array([[0.5e3], [1e3], [2e3]])
FIRST = (Unknown("young", 20e3, 1e3, 1e6), Unknown("poisson", 0.3, 0.0, 0.5))


def areas(values: Array) -> Array:
    """Return the areas inside of skin and hole of a ring under pressures from outside (plane strain, small strain)."""
    young, poisson = values
    mu, lame = young / 2 / (1 + poisson), young * poisson / (1 + poisson) / (1 - 2 * poisson)
    A = -PRESSURES / (2 * (lame + mu) * (1 - (INNER / OUTER) ** 2))
    radii = np.array([OUTER, INNER])
    moved = radii * (1 + A) + A * (lame + mu) / mu * INNER**2 / radii
    return np.asarray(np.pi * moved**2).ravel()


def slopes(values: Array) -> Array:
    steps = 1e-6 * np.diag(values)
    return np.column_stack([(areas(values + s) - areas(values - s)) / 2 / s.sum() for s in steps])


EXACT = areas(TRUTH)
ERRORS = 3e-3 * EXACT


def fitted(measured: Array = EXACT, unknowns: Any = FIRST, errors: Array = ERRORS) -> Fit:
    return fit(unknowns, measured, errors, areas, slopes)


def test_intervals_hold_what_they_promise() -> None:
    """95 % of many noisy measurements have each constant inside of its interval, though the areas are not linear in
    them; and of 20 of them 19 have, in the mean. The gaps that are left are as probable as any others."""
    random, count = np.random.default_rng(3), 600
    inside, probable, reached = np.zeros(2), [], []
    for _ in range(count):
        found = fitted(EXACT + ERRORS * random.standard_normal(len(EXACT)))
        inside += np.abs(found.values - TRUTH) < found.half_width
        probable.append(found.probability)
        reached.append((found.values - TRUTH) / found.sd)
    assert np.all(np.abs(inside / count - 0.95) < 3 * np.sqrt(0.95 * 0.05 / count))
    assert np.std(reached, axis=0) == pytest.approx(1.0, abs=0.12)
    assert np.corrcoef(np.array(reached).T)[0, 1] == pytest.approx(fitted().correlation[0, 1], abs=0.1)
    assert np.mean(np.array(probable) < 0.1) == pytest.approx(0.1, abs=3 * np.sqrt(0.1 * 0.9 / count))


def test_exact_data_give_the_constants_back() -> None:
    found = fitted()
    assert found.values == pytest.approx(TRUTH, rel=1e-6)
    assert not found.at_bounds
    assert found.freedom == 4


def test_a_prior_is_one_more_measurement() -> None:
    """Of the parameter itself: weights add, where the data know one parameter only."""
    line = np.array([1.0, 1.0])
    one = (Unknown("x", 1.0, mean=4.0, sd=0.5),)
    found = fit(one, np.array([2.0, 3.0]), np.ones(2), lambda x: line * x[0], lambda _: line[:, None])
    assert found.values[0] == pytest.approx((2 + 3 + 4 / 0.25) / (2 + 4), rel=1e-9)
    assert found.sd[0] == pytest.approx(6**-0.5, rel=1e-9)


def test_what_is_known_least() -> None:
    """Two parameters of which only the product is measured well: more of one with as much less of the other."""
    errors = np.array([1e-3, 0.3])
    unknowns = (Unknown("a", 1.5), Unknown("b", 1.5))
    product = lambda x: np.array([x[0] * x[1], x[0] / x[1]])  # noqa: E731
    slope = lambda x: np.array([[x[1], x[0]], [1 / x[1], -x[0] / x[1] ** 2]])  # noqa: E731
    found = fit(unknowns, np.array([2.0, 1.0]), errors, product, slope)
    sd, parts = found.least_known
    assert sd == pytest.approx(0.3 / 2**0.5, rel=1e-3)
    assert parts[0] == pytest.approx(-parts[1], rel=1e-3)
    assert found.correlation[0, 1] == pytest.approx(-1.0, abs=1e-4)
    assert re.search("least: 15 % more . with 15 % less ., which is one standard", found.verdict())
    with pytest.raises(
        MaterialError, match=r"do not tell these parameters apart: 1.5e.02 % more . with 1.5e.02 % less"
    ):
        fit(unknowns, np.array([2.0, 1.0]), np.array([1e-3, 3.0]), product, slope)


def test_what_cannot_be_identified_is_refused() -> None:
    unused = (*FIRST, Unknown("density", 1e3))
    with_unused = lambda x: np.column_stack((slopes(x[:2]), np.zeros(6)))  # noqa: E731
    with pytest.raises(MaterialError, match=r"do not tell the parameter: 1e.08 % more density is"):
        fit(unused, EXACT, ERRORS, lambda x: areas(x[:2]), with_unused)
    known = (*FIRST, Unknown("density", 1e3, mean=1e3, sd=50.0))
    found = fit(known, EXACT, ERRORS, lambda x: areas(x[:2]), with_unused)
    assert found.sd[2] == pytest.approx(50.0, rel=1e-9)
    with pytest.raises(MaterialError, match=r"2 parameters need as many data or priors"):
        fit(FIRST, EXACT[:1], ERRORS[:1], areas, slopes)
    with pytest.raises(CaseError, match=r"first trial, 0\.3, is not between 0\.4 and 0\.5"):
        fitted(unknowns=(FIRST[0], Unknown("poisson", 0.3, 0.4, 0.5)))


def test_bounds_hold_and_are_said() -> None:
    found = fitted(unknowns=(FIRST[0], Unknown("poisson", 0.3, 0.0, 0.35)))
    assert found.values[1] == pytest.approx(0.35, rel=1e-4)
    assert found.at_bounds == ["poisson"]


def test_where_there_is_no_model_the_search_goes_around() -> None:
    """A trial for which nothing can be solved shortens the step; the first one must be solved."""
    tried = []

    def fails(values: Array) -> Array:
        tried.append(values[0])
        if values[0] < 11e3:
            raise SolverError("no solution")
        return areas(values)

    found = fit((Unknown("young", 60e3), FIRST[1]), EXACT, ERRORS, fails, slopes)
    assert found.values == pytest.approx(TRUTH, rel=1e-5)
    assert min(tried) < 11e3
    with pytest.raises(SolverError, match="no solution"):
        fit((Unknown("young", 10e3), FIRST[1]), EXACT, ERRORS, fails, slopes)


def test_runs_of_the_covariance_tell_whether_it_holds() -> None:
    """They spread the data as the covariance says where the model is linear within them; what is not linear grows with
    the errors, as the square of a change over the change."""
    count = 2000
    found = [fitted(errors=part * ERRORS) for part in (1.0, 2.0)]
    runs = [check(one, areas, count) for one in found]
    sd = np.sqrt(np.diag(found[0].slopes @ found[0].covariance @ found[0].slopes.T))
    assert runs[0].spread == pytest.approx(sd, rel=4 / np.sqrt(2 * count))
    assert np.cov(runs[0].values.T) == pytest.approx(found[0].covariance, rel=6 / np.sqrt(count))
    assert runs[1].bend == pytest.approx(2 * runs[0].bend, rel=0.05)
    line = np.array([[1.0, 1.0], [2.0, -1.0]])
    linear = fit((Unknown("a", 1.5, 0.9), Unknown("b", 1.0)), np.array([3.0, 0.0]), np.full(2, 0.5),
                 lambda x: line @ x, lambda _: line)  # fmt: skip
    exact = check(linear, lambda x: line @ x, 50)
    assert exact.bend < 1e-9
    assert exact.values[:, 0].min() >= 0.9  # half a standard deviation below

    def fails(values: Array) -> Array:
        if values[1] < linear.values[1]:
            raise SolverError("no solution")
        return line @ values

    some = check(linear, fails, 50)
    assert len(some.values) + some.failed == 50
    assert 10 < some.failed < 40
    with pytest.raises(SolverError, match="any of 3 sets of parameters"):
        check(linear, lambda _: fails(linear.values - 1.0), 3)


def test_words() -> None:
    assert in_words(["a", "b", "c"], np.array([-0.001, 0.03, -0.09])) == "9 % more c with 3 % less b"
