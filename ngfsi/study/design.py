"""Designs: which values of a case's keys a study computes, and what its results say about them.

A factor is a key of the case file with its unit, `materials.tissue.K_kPa`, and the range or the values it takes.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from ngfsi.arrays import Array
from ngfsi.case import Case
from ngfsi.errors import CaseError

Ranges = Mapping[str, tuple[float, float]]
Kind = Literal["points", "saltelli", "morris"]

LEVELS = 4
"""Values that a factor takes in Morris's method."""
STEP = LEVELS / (2 * (LEVELS - 1))
"""By which it changes there, as a fraction of its range, so that each value is as likely as the others."""


@dataclass(frozen=True)
class Design:
    """Points in the space of some factors.

    Attributes:
        factors: keys of the case file.
        points: (number, factors) values, in the units of the keys.
        kind: which sensitivity indices the order of the points admits.
        ranges: (factors, 2) lowest and highest value.
    """

    factors: tuple[str, ...]
    points: Array
    kind: Kind
    ranges: Array

    def values(self) -> dict[str, dict[str, float]]:
        """Return the value of each factor, by the number of the point."""
        digits = len(str(len(self.points)))
        return {
            f"{number:0{digits}d}": dict(zip(self.factors, map(float, point), strict=True))
            for number, point in enumerate(self.points)
        }

    def cases(self, base: Case) -> dict[str, Case]:
        """Return the case of each point by its number.

        Raises:
            CaseError: a key is unknown or a value is refused (or the error class of the section concerned).
        """
        return {key: base.replace(**values) for key, values in self.values().items()}


def grid(values: Mapping[str, Sequence[float]]) -> Design:
    """Return all combinations of the values of each factor, the last one running fastest."""
    return _design(values, np.array(list(itertools.product(*values.values())), dtype=float))


def one_at_a_time(base: Mapping[str, float], values: Mapping[str, Sequence[float]]) -> Design:
    """Return the point `base`, and for each factor its values with all others as in `base`."""
    middle = [base[name] for name in values]
    points = [middle]
    for number, name in enumerate(values):
        points += [[*middle[:number], value, *middle[number + 1 :]] for value in values[name]]
    return _design(values, np.array(points, dtype=float))


def latin_hypercube(ranges: Ranges, number: int, seed: int = 0) -> Design:
    """Return points that are evenly spread along each factor (McKay, Beckman and Conover, Technometrics 21, 1979)."""
    return _spread(ranges, "LatinHypercube", number, seed)


def sobol(ranges: Ranges, number: int, seed: int = 0) -> Design:
    """Return scrambled points of Sobol's sequence, evenly spread in the whole space.

    Raises:
        CaseError: the number is no power of two, at which alone they are balanced.
    """
    if number < 1 or number & (number - 1):
        raise CaseError(f"{number} points of Sobol's sequence are not balanced: take a power of two")
    return _spread(ranges, "Sobol", number, seed)


def saltelli(ranges: Ranges, number: int, seed: int = 0) -> Design:
    """Return number (factors + 2) points for Sobol's indices (Saltelli et al., Comput Phys Commun 181, 2010)."""
    from SALib.sample import sobol as sample

    points = sample.sample(_problem(ranges), number, calc_second_order=False, seed=seed)
    return _design(ranges, points, "saltelli")


def morris(ranges: Ranges, trajectories: int, seed: int = 0) -> Design:
    """Return trajectories (factors + 1) points for Morris's elementary effects (Technometrics 33, 1991)."""
    from SALib.sample import morris as sample

    return _design(ranges, sample.sample(_problem(ranges), trajectories, num_levels=LEVELS, seed=seed), "morris")


@dataclass(frozen=True)
class Indices:
    """How much of a result each factor explains; half widths are those of 95 % confidence.

    Attributes:
        name: of the two columns: Sobol's first order and total, or Morris's mu* and sigma.
        first, second: (factors,).
        first_half_width, second_half_width: (factors,); nan where there is none.
    """

    names: tuple[str, str]
    first: Array
    first_half_width: Array
    second: Array
    second_half_width: Array


def indices(design: Design, results: Sequence[float], seed: int = 0) -> Indices:
    """Return the sensitivity of a result, given at each point of a design by `saltelli` or `morris`.

    Raises:
        CaseError: the design is another, or a result is missing.
    """
    values = np.asarray(results, dtype=float)
    if len(values) != len(design.points) or not np.all(np.isfinite(values)):
        raise CaseError("sensitivity indices need a finite result at every point of the design")
    problem = _problem(dict(zip(design.factors, map(tuple, design.ranges), strict=True)))
    if design.kind == "saltelli":
        from SALib.analyze import sobol as analysis

        found = analysis.analyze(problem, values, calc_second_order=False, seed=seed)
        return Indices(("S1", "ST"), *(np.asarray(found[key]) for key in ("S1", "S1_conf", "ST", "ST_conf")))
    if design.kind == "morris":
        from SALib.analyze import morris as effects

        found = effects.analyze(problem, design.points, values, num_levels=LEVELS, seed=seed)
        mean, width, sigma = (np.asarray(found[key], dtype=float) for key in ("mu_star", "mu_star_conf", "sigma"))
        return Indices(("mu*", "sigma"), mean, width, sigma, np.full(len(sigma), np.nan))
    raise CaseError("sensitivity indices need a design by saltelli or morris")


def whole_trajectories(design: Design, results: Sequence[float]) -> tuple[Design, list[float]]:
    """Return the part of a design by `morris` all of whose results are finite, and these.

    One failed case costs the effects of its trajectory alone; the others are as good without it.
    """
    values = np.asarray(results, dtype=float).reshape(-1, len(design.factors) + 1)
    kept = np.repeat(np.all(np.isfinite(values), axis=1), values.shape[1])
    return replace(design, points=design.points[kept]), [float(value) for value in values.ravel()[kept]]


def _spread(ranges: Ranges, sampler: Literal["LatinHypercube", "Sobol"], number: int, seed: int) -> Design:
    from scipy.stats import qmc  # takes a second, which the child processes of a study need not wait for

    low, high = np.array(list(ranges.values()), dtype=float).T
    unit = getattr(qmc, sampler)(len(ranges), rng=seed).random(number)
    return _design(ranges, qmc.scale(unit, low, high))


def _design(values: Mapping[str, Sequence[float]], points: Array, kind: Kind = "points") -> Design:
    limits = np.array([[min(given), max(given)] for given in values.values()], dtype=float)
    return Design(tuple(values), points, kind, limits)


def _problem(ranges: Mapping[str, Any]) -> dict[str, Any]:
    return {"num_vars": len(ranges), "names": list(ranges), "bounds": [list(given) for given in ranges.values()]}
