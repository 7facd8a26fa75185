"""Parameters of the tissue from areas measured in a section: bulk modulus by root finding, several by least squares."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.optimize import least_squares, root_scalar

from ngfsi.arrays import Array
from ngfsi.case import Case
from ngfsi.errors import MaterialError, SolverError
from ngfsi.measure.plane import PlaneSectionProbe
from ngfsi.mesh.domain import Domain
from ngfsi.solve.statics import equilibrium
from ngfsi.system.system import System

SECOND = 1.25
"""Second trial of the root finding, over the first."""
ACCURACY = 1e-3
MOST_SOLVES = 12
LARGEST = 1e5
"""Parameters beyond this factor of the first trial are not looked for."""

Measure = Callable[[PlaneSectionProbe], float]


def area_loss(boundary: str, area: float) -> Measure:
    """Return the measure of the fraction that a closed boundary loses of its area (m2) at rest."""
    return lambda probe: 1 - probe.enclosed_area(boundary) / area


class Model:
    """A case as a function of some of its values, e.g. "materials.tissue.K"; equilibria start from the last one."""

    def __init__(self, case: Case, parameters: Sequence[str], domain: Domain | None = None) -> None:
        self.case, self.parameters = case, tuple(parameters)
        self.domain = domain or Domain.build(case.geometry)
        self.solves = 0
        self._last: System | None = None

    def __call__(self, *values: float) -> PlaneSectionProbe:
        """Return the measures of the equilibrium for values (SI) of the parameters.

        Raises:
            SolverError: there is no equilibrium.
        """
        changed = self.case.replace(**dict(zip(self.parameters, values, strict=True)))
        self.solves += 1
        self._last = equilibrium(changed, self.domain, self._last)
        return PlaneSectionProbe(self._last)


@dataclass(frozen=True)
class Calibrated:
    """A parameter found: its value (SI), the measure there, the number of equilibria it took, and those tried."""

    value: float
    measure: float
    solves: int
    tried: tuple[tuple[float, float], ...]


def calibrate(model: Model, measure: Measure, target: float, first: float) -> Calibrated:
    """Return the value of a model's one parameter at which a measure meets its target, by secants in its logarithm.

    Args:
        first: trial value (SI).

    Raises:
        MaterialError: no value meets the target; says what the tried ones give.
        SolverError: an equilibrium could not be found.
    """
    tried: list[tuple[float, float]] = []
    before = model.solves

    @cache  # the root finding begins with the first one again
    def gap(logarithm: float) -> float:
        if abs(logarithm - np.log(first)) > np.log(LARGEST) or len(tried) >= MOST_SOLVES:
            raise MaterialError(_unmet(model.parameters[0], target, tried))
        value = float(np.exp(logarithm))
        tried.append((value, measure(model(value))))
        return tried[-1][1] - target

    start = np.log(first)
    if abs(gap(start)) > ACCURACY * abs(target) / 10:
        found = root_scalar(
            gap, x0=start, x1=start + np.log(SECOND), method="secant", xtol=ACCURACY, maxiter=MOST_SOLVES
        )
        if not found.converged:
            raise MaterialError(_unmet(model.parameters[0], target, tried))
    value, reached = min(tried, key=lambda pair: abs(pair[1] - target))
    return Calibrated(value, reached, model.solves - before, tuple(tried))


def _unmet(name: str, target: float, tried: Sequence[tuple[float, float]]) -> str:
    low, high = min(tried), max(tried)
    return (
        f"no value of {name} gives {target:.4g}: {low[0]:.3g} gives {low[1]:.4g} and {high[0]:.3g} gives {high[1]:.4g} "
        "(SI units)"
    )


@dataclass(frozen=True)
class Identified:
    """Several parameters found together: values (SI), their correlation, misfit (rms of relative gaps), equilibria.

    Attributes:
        uncertainty: relative standard deviation of each parameter per relative standard deviation of the measures.
    """

    values: Array
    correlation: Array
    uncertainty: Array
    misfit: float
    solves: int


def identify(model: Model, measures: Mapping[str, tuple[Measure, float]], first: Sequence[float]) -> Identified:
    """Return the values of a model's parameters that fit several measures best, by least squares in their logarithms.

    Args:
        measures: name -> measure and its target; at least as many as parameters.

    Raises:
        MaterialError: there are fewer measures than parameters, or they do not tell the parameters apart.
        SolverError: an equilibrium could not be found.
    """
    if len(measures) < len(model.parameters):
        raise MaterialError(
            f"{len(model.parameters)} parameters need as many measures at least, there are {len(measures)}"
        )
    before = model.solves

    def gaps(logarithms: Array) -> Array:
        probe = model(*np.exp(logarithms))
        return np.array([measure(probe) / target - 1 for measure, target in measures.values()])

    # differences of 1e-3 are large against what an equilibrium leaves, and small against the bend of the measures
    found = least_squares(gaps, np.log(first), method="lm", diff_step=1e-3 / np.abs(np.log(first)).max(), xtol=1e-6)
    shape = found.jac.T @ found.jac
    if not found.success or np.linalg.cond(shape) > 1 / np.finfo(float).eps:
        raise MaterialError(f"{', '.join(measures)} do not tell {', '.join(model.parameters)} apart")
    inverse = np.linalg.inv(shape)
    sd = np.sqrt(np.diag(inverse))
    misfit = float(np.sqrt(np.mean(found.fun**2)))
    return Identified(np.exp(found.x), inverse / np.outer(sd, sd), sd, misfit, model.solves - before)


def curve(model: Model, measure: Measure, values: Sequence[float]) -> tuple[Array, Array]:
    """Return the values of a model's one parameter that have an equilibrium, and the measure at them."""
    found = []
    for value in values:
        try:
            found.append((value, measure(model(value))))
        except SolverError:
            continue
    pairs = np.array(found).reshape(-1, 2)
    return pairs[:, 0], pairs[:, 1]
