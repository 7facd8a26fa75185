"""Surrogate: a Gaussian process through the results of a design, cheap enough to look for the best point of all.

Needs scikit-learn (`pip install -e '.[surrogate]'`).
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from scipy.linalg import cho_solve
from scipy.optimize import differential_evolution

from ngfsi.arrays import Array, Mask
from ngfsi.errors import CaseError
from ngfsi.study.design import Design

Place = Callable[[Array], Array]
Allowed = Callable[[Array], Mask]

RESTARTS = 4
"""Starts of the search for the kernel's lengths, beside the first."""
NOISE = (1e-8, 1e-1)
"""Range of the variance of what is no function of the factors, over that of the results."""


@dataclass(frozen=True)
class Surrogate:
    """A Gaussian process with Matern's kernel of order 5/2 and a length for each coordinate.

    Attributes:
        ranges: (factors, 2) of the design.
        place: points (number, factors) -> coordinates (number, any) over which the result is smooth.
        places: of the computed points.
        values: (number,) results there.
        process: of scikit-learn, fitted.
    """

    ranges: Array
    place: Place
    places: Array
    values: Array
    process: Any

    @classmethod
    def through(cls, design: Design, results: Sequence[float], place: Place | None = None, seed: int = 0) -> Self:
        """Return the surrogate of a result at the points of a design; those where it is not finite are left out.

        Args:
            place: coordinates in which factors that matter with others alone lose their meaning without them, as an
                angle does with its radius; default: the factors in units of their ranges.

        Raises:
            CaseError: there are not more results than coordinates.
        """
        from sklearn.exceptions import ConvergenceWarning
        from sklearn.gaussian_process import GaussianProcessRegressor
        from sklearn.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel

        low, high = design.ranges.T
        where = place or (lambda points: np.asarray((points - low) / (high - low)))
        values = np.asarray(results, dtype=float)
        there = np.isfinite(values)
        places = where(design.points[there])
        number = places.shape[1]
        if len(places) <= number:
            raise CaseError(f"a surrogate over {number} coordinates needs more than {len(places)} finite results")
        shape = Matern(np.full(number, 1.0), (0.05, 100.0), nu=2.5)
        kernel = ConstantKernel(1.0, (1e-2, 1e4)) * shape + WhiteKernel(1e-4, NOISE)
        process = GaussianProcessRegressor(kernel, normalize_y=True, n_restarts_optimizer=RESTARTS, random_state=seed)
        with warnings.catch_warnings():
            # a coordinate without influence has a length as large as is allowed
            warnings.simplefilter("ignore", ConvergenceWarning)
            process.fit(places, values[there])
        return cls(design.ranges, where, places, values[there], process)

    def __call__(self, points: Array) -> tuple[Array, Array]:
        """Return mean and standard deviation (number,) of the result at points (number, factors)."""
        mean, deviation = self.process.predict(self.place(np.asarray(points)), return_std=True)
        return np.asarray(mean), np.asarray(deviation)

    def left_out(self) -> tuple[Array, Array]:
        """Return what the others predict at each computed point, and its standard deviation, both (number,).

        Rasmussen and Williams, Gaussian Processes for Machine Learning (2006), eqs. 5.10 to 5.12; the kernel is kept.
        """
        process, scale = self.process, self.process._y_train_std
        inverse = cho_solve((process.L_, True), np.eye(len(self.places)))
        variance = 1 / np.diag(inverse)
        return self.values - scale * variance * (inverse @ process.y_train_), scale * np.sqrt(variance)

    def best(self, number: int, apart: float, seed: int = 0, allowed: Allowed | None = None) -> Array:
        """Return points (number, factors) of the largest mean, best first, each with its place at least `apart` from
        those before.

        Args:
            allowed: says of points (candidates, factors) which may be chosen; default: all.
        """
        low, high = self.ranges.T
        chosen: list[Array] = []

        def cost(unit: Array) -> Array:  # (factors, candidates), as differential_evolution passes them
            points = low + unit.T * (high - low)
            places = self.place(points)
            costs = -np.asarray(self.process.predict(places), dtype=float)
            if allowed is not None:
                costs[~allowed(points)] = np.inf
            for point in chosen:
                costs[np.linalg.norm(places - self.place(point[None]), axis=1) < apart] = np.inf
            return costs

        for _ in range(number):
            found = differential_evolution(
                cost, [(0.0, 1.0)] * len(low), rng=seed, vectorized=True, updating="deferred", polish=False,
                popsize=30, tol=1e-8, maxiter=400,
            )  # fmt: skip
            chosen.append(low + np.asarray(found.x) * (high - low))
        return np.array(chosen)
