"""Compressible Neo-Hookean solid given by linear constants."""

from __future__ import annotations

from typing import ClassVar, Literal

from ngsolve import CoefficientFunction, Det, Trace, log

from ngfsi.materials.linear import LinearAtRest
from ngfsi.materials.strain import right_cauchy_green


class CompressibleNeoHookean(LinearAtRest):
    """W = mu/2 (tr C - 3 - 2 ln J) + lambda/2 (ln J)^2; stiffens without bound as J -> 0, unlike Saint Venant's law."""

    formula: ClassVar[str] = r"W = \tfrac{\mu}{2}(\mathrm{tr}\,C - 3 - 2\ln J) + \tfrac{\lambda}{2}(\ln J)^2"
    source: ClassVar[str] = (
        "J. Bonet, R. D. Wood, Nonlinear Continuum Mechanics for Finite Element Analysis, section 6.4"
    )

    law: Literal["compressible_neo_hookean"] = "compressible_neo_hookean"

    def energy(self, F: CoefficientFunction) -> CoefficientFunction:
        """Return the stored energy (J per m3 of reference volume) at the deformation gradient F (3x3)."""
        ln_J = log(Det(F))
        return self.shear_modulus / 2 * (Trace(right_cauchy_green(F)) - 3 - 2 * ln_J) + self.lame / 2 * ln_J**2
