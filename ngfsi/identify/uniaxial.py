"""Fit of the Mooney-Rivlin constants to uniaxial tests, with confidence intervals and what the test cannot tell."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import t as student

from ngfsi.arrays import Array
from ngfsi.errors import MaterialError
from ngfsi.materials.solid.law import Invariants
from ngfsi.materials.solid.mooney_rivlin import MooneyRivlin

CONSTANTS = ("c10", "c01", "c11")
COMPLEX_STEP = 1e-30
"""Step of the derivative of analytic functions without cancellation (Squire and Trapp, SIAM Rev 40, 1998)."""
TELLS_NOTHING = 1e-8
"""Smallest over largest singular value of the scaled design below which constants are not determined at all."""


@dataclass(frozen=True)
class UniaxialFit:
    """Fitted constants.

    Attributes:
        constants: c10, c01, c11 (Pa).
        half_width: of their 95 % confidence intervals (Pa), by Student's t.
        correlation: (3, 3) of the estimates.
        residual: root mean square of measured minus fitted nominal stress (Pa).
        sum_half_width, difference_half_width: of the confidence intervals of c10 + c01, half the initial shear modulus,
            and of c10 - c01 (Pa).
    """

    constants: Array
    half_width: Array
    correlation: Array
    residual: float
    sum_half_width: float
    difference_half_width: float

    @property
    def told_apart(self) -> bool:
        """Whether c10 and c01 are known by themselves: their difference to less than their size."""
        return self.difference_half_width < float(np.abs(self.constants[:2]).max())

    @property
    def verdict(self) -> str:
        """Say in a sentence what the test tells about c10 and c01."""
        total = self.constants[0] + self.constants[1]
        known = f"c10 + c01 = {total:.4g} +- {self.sum_half_width:.2g} Pa"
        known += f", c10 - c01 is known to +- {self.difference_half_width:.2g} Pa"
        return known if self.told_apart else f"{known}: c10 and c01 cannot be told apart by this test"


def nominal_stress(stretch: Array, constants: Array) -> Array:
    """Return the nominal stress (Pa) of an incompressible bar under uniaxial stretch for c10, c01, c11 (Pa)."""
    return np.asarray(design(stretch) @ constants)


def design(stretch: Array) -> Array:
    """Return dP/dc (n, 3): the stress is linear in the constants; dW/d stretch at J = 1, lateral faces free."""
    moved = np.asarray(stretch) + 1j * COMPLEX_STEP
    strain = Invariants(moved**2 + 2 / moved, 2 * moved + 1 / moved**2, np.ones_like(moved))
    columns = []
    for name in CONSTANTS:
        single: dict[str, Any] = {**dict.fromkeys(CONSTANTS, 0.0), name: 1.0, "K": 0.0}
        # no checks: a law with a single constant would be refused
        law = MooneyRivlin.model_construct(**single)
        columns.append(np.imag(sum(law.energies_of(strain))) / COMPLEX_STEP)
    return np.column_stack(columns)


def fit(stretch: Array, stress: Array) -> UniaxialFit:
    """Fit c10, c01 and c11 to nominal stresses (Pa) by least squares, with the deviations as measure of the noise.

    Raises:
        MaterialError: too few points, or stretches that do not tell three constants apart.
    """
    if len(stretch) <= len(CONSTANTS):
        raise MaterialError(f"a fit of three constants needs at least four points, not {len(stretch)}")
    if not np.all(stretch > 0):
        raise MaterialError("a stretch must be greater than 0: it is the length over that at rest, not the strain")
    A = design(stretch)
    scale = np.linalg.norm(A, axis=0)
    if not np.all(scale > 0) or np.linalg.cond(A / scale) > 1 / TELLS_NOTHING:
        raise MaterialError("these stretches do not tell three constants apart: test over a wider range of stretch")
    constants = np.linalg.lstsq(A / scale, stress, rcond=None)[0] / scale
    gap = stress - A @ constants
    freedom = len(stretch) - len(CONSTANTS)
    shape = np.linalg.inv((A / scale).T @ (A / scale)) / np.outer(scale, scale)
    covariance = shape * (gap @ gap) / freedom
    factor = student.ppf(0.975, freedom)
    sd = np.sqrt(np.diag(shape))
    half = [factor * np.sqrt(a @ covariance @ a) for a in ([1.0, 1.0, 0.0], [1.0, -1.0, 0.0])]
    return UniaxialFit(
        constants=constants,
        half_width=factor * np.sqrt(np.diag(covariance)),
        correlation=shape / np.outer(sd, sd),
        residual=float(np.sqrt(np.mean(gap**2))),
        sum_half_width=float(half[0]),
        difference_half_width=float(half[1]),
    )
