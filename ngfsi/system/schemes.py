"""Time schemes: the rate at the new time as a weighted sum of the new and two old states."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

SchemeName = Literal["bdf2", "backward_euler", "static"]


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
