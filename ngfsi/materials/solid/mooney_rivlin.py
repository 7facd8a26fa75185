"""Mooney-Rivlin solid with a mixed term, fitted to muscle under compression."""

from __future__ import annotations

from typing import ClassVar, Literal, Self

from pydantic import Field, model_validator

from ngfsi.materials.solid.law import Invariants, IsotropicLaw, Pair
from ngfsi.units import Pressure


class MooneyRivlin(IsotropicLaw):
    """W = c10 (I1 - 3) + c01 (I2 - 3) + c11 (I1 - 3)(I2 - 3) + K/2 (J - 1)^2 in the isochoric invariants.

    The isochoric invariants make the rest state free of stress and K the initial bulk modulus. Single constants may
    be negative; 2 (c10 + c01), the initial shear modulus, may not.
    """

    formula: ClassVar[str] = (
        r"W = c_{10}(\bar I_1 - 3) + c_{01}(\bar I_2 - 3) + c_{11}(\bar I_1 - 3)(\bar I_2 - 3) + \tfrac{K}{2}(J - 1)^2"
    )
    source: ClassVar[str] = "M. Mooney, J Appl Phys 11 (1940) 582; R. S. Rivlin, Phil Trans R Soc A 241 (1948) 379"

    law: Literal["mooney_rivlin"] = "mooney_rivlin"
    c10: Pressure
    """Factor of I1 - 3."""
    c01: Pressure
    """Factor of I2 - 3."""
    c11: Pressure
    """Factor of (I1 - 3)(I2 - 3)."""
    K: Pressure = Field(gt=0)
    """Bulk modulus."""

    @model_validator(mode="after")
    def _is_stable_at_rest(self) -> Self:
        if self.c10 + self.c01 <= 0:
            raise ValueError(
                f"the initial shear modulus 2 (c10 + c01) must be greater than 0, not {self.shear_modulus:.6g} Pa"
            )
        return self

    def energies_of(self, strain: Invariants) -> Pair:
        I1, I2 = strain.isochoric
        distortion = self.c10 * (I1 - 3) + self.c01 * (I2 - 3) + self.c11 * (I1 - 3) * (I2 - 3)
        return distortion, self.K / 2 * (strain.J - 1) ** 2

    @property
    def shear_modulus(self) -> float:
        return 2 * (self.c10 + self.c01)

    @property
    def bulk_modulus(self) -> float:
        return self.K
