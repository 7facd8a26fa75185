"""Why the wall shear stress is what it is: the rise of SAWSS since t = 0 as a sum of causes, at each instant.

Developed (Poiseuille) flow in each section has the wall shear stress 4 mu Q / (pi R^3) with R from the section's area,
and in an ellipse of semi-axes a, b the mean 4 mu Q (a^2 + b^2) / (a^2 b^2 perimeter). Between the stress at t = 0 and
that computed at t stand, one after the other:

narrowing       the section's own area, with the flow of the inlet
squeeze flow    the flow that really passes, with what the shrinking vein before the section expels
shape           ellipse instead of circle
profile         what developed flow does not explain: the profile has no time (unsteadiness) or length (entrance) to
                develop
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ngfsi.arrays import Array

STAGES = {
    "narrowing": "sawss_poiseuille_inlet_Pa",
    "squeeze flow": "sawss_poiseuille_local_Pa",
    "shape": "sawss_ellipse_local_Pa",
    "profile": "sawss_Pa",
}
"""Cause -> column of the stress with this cause and those before it."""
START = "at t = 0"


def narrowing(loss: float) -> float:
    """Return the ratio of SAWSS in a round vein that has lost a fraction of its volume to that before, at a constant
    flow: 4 mu Q / (pi R^3) with R^2 (1 - loss)."""
    return float((1 - loss) ** -1.5)


def decompose(series: Mapping[str, Array]) -> dict[str, Array]:
    """Return the parts of SAWSS (Pa) over time by cause, the stress at t = 0 first; their sum is `sawss_Pa`.

    Args:
        series: columns of a run's time series.
    """
    parts = {START: np.full_like(series["sawss_Pa"], series["sawss_Pa"][0])}
    before = np.zeros_like(series["sawss_Pa"])
    for cause, column in STAGES.items():
        step = series[column] - before
        parts[cause] = step - step[0]
        before = series[column]
    return parts
