"""Ogden solid: sums of powers of the principal stretches."""

from __future__ import annotations

from typing import ClassVar, Literal, Self

from ngsolve import log
from pydantic import Field, model_validator

from ngfsi.materials.solid.law import Invariants, IsotropicLaw, Pair
from ngfsi.materials.solid.spectral import trace_of_power
from ngfsi.units import Pressure


class Ogden(IsotropicLaw):
    """W = sum 2 mu_i/alpha_i^2 (l1^alpha_i + l2^alpha_i + l3^alpha_i - 3) in the isochoric stretches, 1 to 3 terms.

    The mu_i sum up to the initial shear modulus, as in Abaqus and FEBio (c_i = 2 mu_i); Ogden's own constants are
    2 mu_i/alpha_i. The volume has K/2 ((J^2 - 1)/2 - ln J).
    """

    formula: ClassVar[str] = (
        r"W = \sum_i\frac{2\mu_i}{\alpha_i^2}(\bar\lambda_1^{\alpha_i} + \bar\lambda_2^{\alpha_i} + "
        r"\bar\lambda_3^{\alpha_i} - 3) + \tfrac{K}{2}\left[\tfrac12(J^2 - 1) - \ln J\right]"
    )
    source: ClassVar[str] = "R. W. Ogden, Proc R Soc A 326 (1972) 565"

    law: Literal["ogden"] = "ogden"
    mu: tuple[Pressure, ...] = Field(min_length=1, max_length=3)
    """Moduli of the terms."""
    alpha: tuple[float, ...] = Field(min_length=1, max_length=3)
    """Exponents of the terms."""
    K: Pressure = Field(gt=0)
    """Bulk modulus."""

    @model_validator(mode="after")
    def _is_stable_at_rest(self) -> Self:
        if len(self.mu) != len(self.alpha):
            raise ValueError(f"mu has {len(self.mu)} values and alpha {len(self.alpha)}: each term needs both")
        if 0 in self.alpha:
            raise ValueError("alpha must not be 0")
        if self.shear_modulus <= 0:
            raise ValueError(
                f"the initial shear modulus, the sum of mu, must be greater than 0, not {sum(self.mu):g} Pa"
            )
        return self

    def energies_of(self, strain: Invariants) -> Pair:
        I1, I2 = strain.isochoric
        terms = [2 * mu / a**2 * (trace_of_power(I1, I2, a / 2) - 3) for mu, a in zip(self.mu, self.alpha, strict=True)]
        J = strain.J
        return sum(terms[1:], start=terms[0]), self.K / 2 * ((J * J - 1) / 2 - log(J))

    @property
    def shear_modulus(self) -> float:
        return sum(self.mu)

    @property
    def bulk_modulus(self) -> float:
        return self.K
