"""Parameters of any model from measured values with standard errors: least squares, priors, and what the data tell.

The value is that of the least sum of squares of gaps over standard errors, with Gaussian priors as further gaps; the
covariance is the inverse of J^T W J + prior, of the model linearised there (A. Tarantola, Inverse Problem Theory, 2005,
section 3.2.3). It is by the errors that are given, not by the gaps that are left, which tell whether the model fits.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import chi2, norm

from ngfsi.arrays import Array
from ngfsi.errors import CaseError, MaterialError, SolverError

ENDS, SETTLED = 1e-6, 1e-3
"""Relative change of the parameters, and of the sum of squares, at which the search ends. The latter is that of a last
step of a twentieth of a standard deviation with five data; what is left is of second order in that."""
MOST_STEPS = 50
UNKNOWN, HOPELESS = 1.0, 30.0
"""Relative standard deviation of a combination of parameters beyond which it is not identified, and beyond which
nothing is tried."""
COUNTS = 0.1
"""Fraction of the largest part of a combination from which on a part is named."""
LARGEST = 1e6
"""Relative change beyond which numbers say no more."""
LEVEL = 0.95


@dataclass(frozen=True)
class Unknown:
    """A parameter that is looked for.

    Attributes:
        start: first trial.
        low, high: bounds.
        mean, sd: of a Gaussian prior; sd infinite: none.
    """

    name: str
    start: float
    low: float = -np.inf
    high: float = np.inf
    mean: float = 0.0
    sd: float = np.inf

    @property
    def size(self) -> float:
        """By which the parameter is scaled: of a parameter that begins at zero, that of its prior, or 1."""
        return abs(self.start) or (self.sd if np.isfinite(self.sd) else 1.0)


@dataclass(frozen=True)
class Fit:
    """Parameters found.

    Attributes:
        values: of the parameters.
        covariance: of them, with the priors.
        model, slopes: the values of the model, and their derivatives by the parameters.
        gaps: model less measured, over the standard errors.
        least_known: relative standard deviation of the combination of parameters that is known least, and its parts
            (relative changes, of length 1).
        steps: of the search.
    """

    unknowns: Sequence[Unknown]
    values: Array
    covariance: Array
    model: Array
    slopes: Array
    gaps: Array
    least_known: tuple[float, Array]
    steps: int

    @property
    def sd(self) -> Array:
        """Standard deviations."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def half_width(self) -> Array:
        """Of the intervals that hold the parameters with the probability `LEVEL`."""
        return np.asarray(norm.ppf((1 + LEVEL) / 2) * self.sd)

    @property
    def correlation(self) -> Array:
        """Of the parameters."""
        return self.covariance / np.outer(self.sd, self.sd)

    @property
    def at_bounds(self) -> list[str]:
        """Names of parameters that stand at a bound, of which the interval is not to be believed."""
        near = ENDS * np.array([one.size for one in self.unknowns])
        return [one.name for one, value, gap in zip(self.unknowns, self.values, near, strict=True)
                if min(value - one.low, one.high - value) <= gap]  # fmt: skip

    @property
    def freedom(self) -> int:
        """Data more than parameters without a prior."""
        return len(self.gaps) - sum(one.sd == np.inf for one in self.unknowns)

    @property
    def probability(self) -> float:
        """Of gaps as large as these, if the model is right and the errors are those given."""
        return float(chi2.sf(self.gaps @ self.gaps, self.freedom)) if self.freedom > 0 else 1.0

    def verdict(self) -> str:
        """Say what is known least."""
        sd, parts = self.least_known
        named = in_words([one.name for one in self.unknowns], sd * parts)
        return f"What the data tell least: {named}, which is one standard deviation."


def fit(
    unknowns: Sequence[Unknown], measured: Array, errors: Array, model: Callable[[Array], Array],
    slopes: Callable[[Array], Array],
) -> Fit:  # fmt: skip
    """Find the parameters with which a model fits measured values best.

    Args:
        measured, errors: (n,) values and their standard errors, which are independent.
        model: returns the (n,) values for parameters.
        slopes: returns their derivatives (n, parameters).

    Raises:
        MaterialError: the data do not tell the parameters; says which.
        CaseError: bounds do not hold the first trial.
        SolverError: the model has no solution for the first trial, or the search does not end.
    """
    for one in unknowns:
        if not one.low < one.start < one.high:
            raise CaseError(f"{one.name}: the first trial, {one.start:g}, is not between {one.low:g} and {one.high:g}")
    if len(measured) + sum(np.isfinite(one.sd) for one in unknowns) < len(unknowns):
        raise MaterialError(f"{len(unknowns)} parameters need as many data or priors, there are {len(measured)} data")
    sizes, means, sds = (np.array([getattr(one, name) for one in unknowns], float) for name in ("size", "mean", "sd"))
    start, low, high = (np.array([getattr(one, name) for one in unknowns], float) / sizes
                        for name in ("start", "low", "high"))  # fmt: skip
    prior = np.isfinite(sds)
    names = [one.name for one in unknowns]

    def gaps(scaled: Array) -> Array:
        values = scaled * sizes
        of_priors = (values - means)[prior] / sds[prior]
        try:
            return np.concatenate(((model(values) - measured) / errors, of_priors))
        except (CaseError, MaterialError, SolverError):
            if np.array_equal(scaled, start):
                raise
            return np.full(len(measured) + len(of_priors), np.inf)  # the search takes a shorter step

    def matrix(scaled: Array) -> Array:
        of_data = slopes(scaled * sizes) / errors[:, None] * sizes
        found = np.concatenate((of_data, np.diag(sizes / sds)[prior]))
        _refuse(names, found * _relative(scaled), HOPELESS)
        return found

    found = least_squares(gaps, start, matrix, (low, high), xtol=ENDS, ftol=SETTLED, gtol=None, max_nfev=MOST_STEPS)
    if not found.success:
        raise SolverError(f"the search for {', '.join(names)} did not end within {MOST_STEPS} trials")
    by_parts = found.jac * _relative(found.x)
    _refuse(names, by_parts, UNKNOWN)
    covariance = np.linalg.inv(found.jac.T @ found.jac)
    of_data = found.fun[: len(measured)]
    return Fit(
        tuple(unknowns), found.x * sizes, covariance * np.outer(sizes, sizes), measured + errors * of_data,
        found.jac[: len(measured)] * errors[:, None] / sizes, of_data, least_known(by_parts), found.nfev,
    )  # fmt: skip


@dataclass(frozen=True)
class Check:
    """A model at parameters drawn from what a fit left open, beside what its linearised model says of them.

    Attributes:
        values: (n, parameters) drawn.
        model, linear: (n, data) of the model, and of the model linearised at the fit.
        failed: draws for which the model had no solution, which are none of the n.
        middle: (data,) of the model at the fit.
    """

    values: Array
    model: Array
    linear: Array
    failed: int
    middle: Array

    @property
    def spread(self) -> Array:
        """Root mean square of what the drawn parameters change in each datum."""
        return np.asarray(self._size(self.model - self.middle))

    @property
    def linear_spread(self) -> Array:
        """The same of the linearised model."""
        return np.asarray(self._size(self.linear - self.middle))

    @property
    def bend(self) -> float:
        """Of what they change, the part that is not linear: root mean squares over draws and data of like weight."""
        told = self.linear_spread > 0
        return float(self._size(((self.model - self.linear)[:, told] / self.linear_spread[told]).ravel()))

    @staticmethod
    def _size(changes: Array) -> Any:
        return np.sqrt(np.mean(np.square(changes), axis=0))


def check(found: Fit, model: Callable[[Array], Array], count: int, seed: int = 0) -> Check:
    """Return the model at parameters drawn from the covariance of a fit, within its bounds.

    Raises:
        SolverError: the model has no solution for any of them.
    """
    random = np.random.default_rng(seed)
    low, high = (np.array([getattr(one, end) for one in found.unknowns]) for end in ("low", "high"))
    drawn: list[Array] = []
    while len(drawn) < count:
        many = random.multivariate_normal(found.values, found.covariance, count)
        drawn += list(many[np.all((low <= many) & (many <= high), axis=1)])
    solved, values = [], []
    for one in drawn[:count]:
        try:
            values.append(model(one))
        except (CaseError, MaterialError, SolverError):
            continue
        solved.append(one)
    if not solved:
        raise SolverError(f"there is no solution for any of {count} sets of parameters within their intervals")
    changes = np.array(solved) - found.values
    linear = found.model + changes @ found.slopes.T
    return Check(np.array(solved), np.array(values), linear, count - len(solved), found.model)


def _relative(values: Array) -> Array:
    """Return by how much parameters change for a relative change: of one that is zero, by its scale."""
    return np.where(values == 0.0, 1.0, values)


def _refuse(names: Sequence[str], by_parts: Array, most: float) -> None:
    """Refuse parameters of which a combination is known to less than a relative standard deviation.

    Raises:
        MaterialError: says which.
    """
    sd, parts = least_known(by_parts)
    if sd <= most:
        return
    changes = min(sd, LARGEST) * parts
    many = np.count_nonzero(np.abs(parts) >= COUNTS * np.abs(parts).max()) > 1
    told = "tell these parameters apart" if many else "tell the parameter"
    raise MaterialError(
        f"the data do not {told}: {in_words(names, changes)} is one standard deviation; leave one out, give it a "
        "prior, or measure more"
    )


def least_known(by_parts: Array) -> tuple[float, Array]:
    """Return the standard deviation of the combination of parameters that is known least, and its parts.

    Args:
        by_parts: (n, parameters) derivatives of the gaps over their errors by relative changes of the parameters.
    """
    _, sizes, ways = np.linalg.svd(by_parts)
    short = by_parts.shape[0] < by_parts.shape[1]
    return (np.inf if short or not sizes[-1] else float(1 / sizes[-1])), ways[-1]


def in_words(names: Sequence[str], changes: Array) -> str:
    """Return relative changes of parameters in words, the largest first; the first is an increase."""
    largest = changes[np.argmax(np.abs(changes))]
    order = [n for n in np.argsort(-np.abs(changes), kind="stable") if abs(changes[n]) >= COUNTS * abs(largest)]
    more = {True: "more", False: "less"}
    return " with ".join(f"{100 * abs(changes[n]):.2g} % {more[changes[n] * largest > 0]} {names[n]}" for n in order)
