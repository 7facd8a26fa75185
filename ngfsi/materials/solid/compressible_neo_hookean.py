"""Compressible Neo-Hookean solid given by linear constants."""

from __future__ import annotations

from typing import ClassVar, Literal

from ngsolve import log

from ngfsi.materials.solid.law import Invariants, IsotropicLaw, Pair
from ngfsi.materials.solid.linear import LinearAtRest


class CompressibleNeoHookean(LinearAtRest, IsotropicLaw):
    """W = mu/2 (tr C - 3 - 2 ln J) + lambda/2 (ln J)^2; stiffens without bound as J -> 0, unlike Saint Venant's law."""

    formula: ClassVar[str] = r"W = \tfrac{\mu}{2}(\mathrm{tr}\,C - 3 - 2\ln J) + \tfrac{\lambda}{2}(\ln J)^2"
    source: ClassVar[str] = (
        "J. Bonet, R. D. Wood, Nonlinear Continuum Mechanics for Finite Element Analysis, section 6.4"
    )

    law: Literal["compressible_neo_hookean"] = "compressible_neo_hookean"

    def energies_of(self, strain: Invariants) -> Pair:
        ln_J = log(strain.J)
        return self.shear_modulus / 2 * (strain.I1 - 3 - 2 * ln_J), self.lame / 2 * ln_J**2
