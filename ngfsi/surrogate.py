"""Surrogate: a Gaussian process through the results of a design, cheap enough to look for the best point of all.

Needs scikit-learn (`pip install -e '.[surrogate]'`).
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve
from scipy.optimize import differential_evolution

from ngfsi.design import Design
from ngfsi.errors import CaseError

Array = NDArray[np.float64]

RESTARTS = 4
"""Starts of the search for the kernel's lengths, beside the first."""
NOISE = (1e-8, 1e-1)
"""Range of the variance of what is no function of the factors, over that of the results."""


@dataclass(frozen=True)
class Surrogate:
    """A Gaussian process with Matern's kernel of order 5/2 and a length for each factor.

    Attributes:
        ranges: (factors, 2) of the design.
        points: (number, factors) computed, in units of the ranges.
        values: (number,) results there.
        process: of scikit-learn, fitted.
    """

    ranges: Array
    points: Array
    values: Array
    process: Any

    @classmethod
    def through(cls, design: Design, results: Sequence[float], seed: int = 0) -> Self:
        """Return the surrogate of a result at the points of a design; those where it is not finite are left out.

        Raises:
            CaseError: fewer results are there than factors, and one.
        """
        from sklearn.exceptions import ConvergenceWarning
        from sklearn.gaussian_process import GaussianProcessRegressor
        from sklearn.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel

        values, number = np.asarray(results, dtype=float), len(design.factors)
        there = np.isfinite(values)
        if np.sum(there) < number + 1:
            raise CaseError(f"a surrogate of {number} factors needs more than {np.sum(there)} finite results")
        unit = _unit(design.points[there], design.ranges)
        shape = Matern(np.full(number, 1.0), (0.05, 100.0), nu=2.5)
        kernel = ConstantKernel(1.0, (1e-2, 1e4)) * shape + WhiteKernel(1e-4, NOISE)
        process = GaussianProcessRegressor(
            kernel, normalize_y=True, n_restarts_optimizer=RESTARTS, random_state=seed
        )  # fmt: skip
        with warnings.catch_warnings():
            # a factor without influence has a length as large as is allowed
            warnings.simplefilter("ignore", ConvergenceWarning)
            process.fit(unit, values[there])
        return cls(design.ranges, unit, values[there], process)

    def __call__(self, points: Array) -> tuple[Array, Array]:
        """Return mean and standard deviation (number,) of the result at points (number, factors)."""
        mean, deviation = self.process.predict(_unit(points, self.ranges), return_std=True)
        return np.asarray(mean), np.asarray(deviation)

    def left_out(self) -> tuple[Array, Array]:
        """Return what the others predict at each computed point, and its standard deviation, both (number,).

        Rasmussen and Williams, Gaussian Processes for Machine Learning (2006), eqs. 5.10 to 5.12; the kernel is kept.
        """
        process, scale = self.process, self.process._y_train_std
        inverse = cho_solve((process.L_, True), np.eye(len(self.points)))
        variance = 1 / np.diag(inverse)
        return self.values - scale * variance * (inverse @ process.y_train_), scale * np.sqrt(variance)

    def best(
        self, number: int, apart: float, place: Callable[[Array], Array] | None = None, seed: int = 0
    ) -> Array:  # fmt: skip
        """Return points (number, factors) of the largest mean, best first, each at least `apart` from those before.

        Args:
            apart: distance between places.
            place: points (n, factors) -> where they are (n, any), for factors that matter more or less with others;
                default: the points in units of the ranges.
        """
        low, high = self.ranges.T
        where = place or (lambda points: _unit(points, self.ranges))
        chosen: list[Array] = []

        def cost(unit: Array) -> Array:  # (factors, candidates), as differential_evolution passes them
            costs = -np.asarray(self.process.predict(unit.T), dtype=float)
            places = where(low + unit.T * (high - low))
            for point in chosen:
                costs[np.linalg.norm(places - where(point[None]), axis=1) < apart] = np.inf
            return costs

        for _ in range(number):
            found = differential_evolution(
                cost, [(0.0, 1.0)] * len(low), rng=seed, vectorized=True, updating="deferred", polish=False,
                popsize=30, tol=1e-8, maxiter=400,
            )  # fmt: skip
            chosen.append(low + np.asarray(found.x) * (high - low))
        return np.array(chosen)


def _unit(points: Array, ranges: Array) -> Array:
    low, high = ranges.T
    return np.asarray((points - low) / (high - low))
