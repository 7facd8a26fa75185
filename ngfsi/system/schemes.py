"""Time schemes: the rate at the new time as a weighted sum of the new and two old states, in one step or in stages."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ngfsi.arrays import Array

SchemeName = Literal["bdf2", "backward_euler", "static", "esdirk3", "sdirk4"]


@dataclass(frozen=True)
class Weights:
    """rate(y)_n = new y_n + old y_(n-1) + older y_(n-2), in 1/s."""

    new: float
    old: float
    older: float


STEADY = Weights(0.0, 0.0, 0.0)
"""All rates vanish."""


def backward_euler(step: float) -> Weights:
    """First order."""
    return Weights(1 / step, -1 / step, 0.0)


def bdf2(step: float, previous_step: float) -> Weights:
    """Second order for variable steps (Hairer, Norsett, Wanner, Solving ODEs I, ch. III.5)."""
    ratio = step / previous_step
    return Weights((1 + 2 * ratio) / (1 + ratio) / step, -(1 + ratio) / step, ratio**2 / (1 + ratio) / step)


def fraction_of_error(step: float, previous: float, before: float) -> float:
    """Return the local error of a step of BDF2 over its distance from the quadratic predictor.

    Both are multiples of the third derivative (Milne's device; Hairer, Norsett, Wanner, Solving ODEs I, ch. III.7): of
    BDF2 h^2 (h + h1)^2 / (6 (2 h + h1)), of the polynomial through the last three states h (h + h1) (h + h1 + h2) / 6.

    Args:
        step, previous, before: sizes h, h1, h2 of this step and the last two [s].
    """
    corrector = step**2 * (step + previous) ** 2 / (2 * step + previous)
    return corrector / (corrector + step * (step + previous) * (step + previous + before))


def weights(scheme: SchemeName, step: float, previous_step: float | None) -> Weights:
    """Return the weights of a step [s]; without a smooth previous step (None) the first one is backward Euler.

    The start of BDF2 and each kink of a load therefore cost one step of local error O(step^2), which leaves the
    second order of the whole untouched; carried across a kink, BDF2 would differentiate through it.
    """
    if scheme == "static":
        return STEADY
    if scheme == "backward_euler" or previous_step is None:
        return backward_euler(step)
    return bdf2(step, previous_step)


@dataclass(frozen=True)
class Tableau:
    """A diagonally implicit Runge-Kutta scheme whose last stage is the new state (stiffly accurate).

    Each implicit stage is a step of backward Euler of `gamma` h, from the old state plus what the rates of the stages
    before contribute: all stages share one matrix.

    Attributes:
        rows: weights a_ij of the rates up to the stage's own; a first row of 0 is the old state itself.
        estimate: weights of the rates in the estimated error of a step.
        order: of the error of the states.
        estimate_order: power of the step with which the estimated error falls.
    """

    rows: tuple[tuple[float, ...], ...]
    estimate: tuple[float, ...]
    order: int
    estimate_order: int

    @property
    def explicit(self) -> bool:
        """Whether the first stage is the old state."""
        return self.rows[0][-1] == 0.0

    @property
    def gamma(self) -> float:
        """The weight of a stage's own rate, the same in all implicit stages."""
        return self.rows[-1][-1]

    @property
    def places(self) -> Array:
        """The stages' times within the step, from 0 to 1."""
        return np.array([sum(row) for row in self.rows])


def _third_order() -> tuple[Tableau, Tableau]:
    """Return ESDIRK3(2)4L[2]SA (C. Kennedy, M. Carpenter, NASA/TM-2016-219173) and, with the same gamma, the scheme of
    R. Alexander (SIAM J Numer Anal 14, 1977) that does not use the old rates, for the start and after kinks."""
    g, c = 0.43586652150845899942, 3 / 5
    a32 = c * (c - 2 * g) / (4 * g)
    b2 = (-2 + 3 * c + 6 * g * (1 - c)) / (12 * g * (c - 2 * g))
    b3 = (1 - 6 * g + 6 * g * g) / (3 * c * (c - 2 * g))
    last = (1 - b2 - b3 - g, b2, b3, g)
    second_order = (2756255671327 / 12835298489170, -10771552573575 / 22201958757719,
                    9247589265047 / 10645013368117, 2193209047091 / 5459859503100)  # fmt: skip
    estimate = tuple(b - other for b, other in zip(last, second_order, strict=True))
    smooth = Tableau(((0.0,), (g, g), (c - a32 - g, a32, g), last), estimate, 3, 3)
    tau = (1 + g) / 2
    ends = (-(6 * g * g - 16 * g + 1) / 4, (6 * g * g - 20 * g + 5) / 4, g)
    # a second difference of the rates at even distances, of the size of the other estimate
    difference = tuple(weight * (1 - g) / 8 for weight in (1.0, -2.0, 1.0))
    return smooth, Tableau(((g,), (tau - g, g), ends), difference, 3, 3)


def _fourth_order() -> Tableau:
    """Return SDIRK4 (E. Hairer, G. Wanner, Solving ODEs II, table IV.6.5)."""
    rows = (
        (1 / 4,),
        (1 / 2, 1 / 4),
        (17 / 50, -1 / 25, 1 / 4),
        (371 / 1360, -137 / 2720, 15 / 544, 1 / 4),
        (25 / 24, -49 / 48, 125 / 16, -85 / 12, 1 / 4),
    )
    return Tableau(rows, (-3 / 16, -27 / 32, 25 / 32, 0.0, 1 / 4), 4, 4)


_SMOOTH, _START = _third_order()
STAGES: dict[str, tuple[Tableau, Tableau]] = {"esdirk3": (_SMOOTH, _START), "sdirk4": (_fourth_order(),) * 2}
"""Schemes in stages -> their tableau, and the one for the start and after kinks of a load, where old rates are not
those of the step to come. Where the first stage is explicit the last rate must not depend on the old one: the
accelerations of ESDIRK4(3)6L[2]SA grow by the factor -3.45 in each step (the pressure's constraint is of index 2)."""
