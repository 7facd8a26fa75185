"""Hencky solid: linear elasticity in the logarithmic strain."""

from __future__ import annotations

from typing import ClassVar, Literal

from ngsolve import log

from ngfsi.materials.solid.law import Invariants, IsotropicLaw, Pair
from ngfsi.materials.solid.linear import LinearAtRest
from ngfsi.materials.solid.spectral import trace_of_squared_logarithm


class Hencky(LinearAtRest, IsotropicLaw):
    """W = mu |dev ln U|^2 + K/2 (ln J)^2 with the right stretch U = sqrt(C).

    dev ln U is half the logarithm of the isochoric C. See `spectral` for its accuracy.
    """

    formula: ClassVar[str] = r"W = \mu\,\|\mathrm{dev}\ln U\|^2 + \tfrac{K}{2}(\ln J)^2"
    source: ClassVar[str] = "H. Hencky, Z techn Phys 9 (1928) 215; P. Neff et al., Arch Ration Mech Anal 222 (2016) 507"

    law: Literal["hencky"] = "hencky"

    def energies_of(self, strain: Invariants) -> Pair:
        squared = trace_of_squared_logarithm(*strain.isochoric)
        return self.shear_modulus / 4 * squared, self.bulk_modulus / 2 * log(strain.J) ** 2
