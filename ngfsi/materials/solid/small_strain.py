"""A solid at small strain: linear elasticity with the initial moduli of another law."""

from __future__ import annotations

from dataclasses import dataclass

from ngsolve import CoefficientFunction, Id, InnerProduct, Trace

from ngfsi.materials.law import Pair, SolidLaw


@dataclass(frozen=True)
class SmallStrain:
    """W = K/2 tr(e)^2 + mu dev(e) : dev(e) with e the symmetric part of F - I (Landau and Lifshitz, vol. 7, section 4).

    Not objective: for comparison with linear elasticity on the undeformed shape.
    """

    law: SolidLaw

    @property
    def density(self) -> float:
        """Mass per reference volume (kg/m3)."""
        return self.law.density

    def energy(self, F: CoefficientFunction) -> CoefficientFunction:
        """Return the stored energy (J per m3 of reference volume) at F (3x3)."""
        e = _strain(F)
        return self.variation(F, e) / 2

    def variations(self, F: CoefficientFunction, H: CoefficientFunction) -> Pair:
        """Return the parts of `variation` of distortion and of dilation."""
        e = _strain(F)
        distortion = 2 * self.law.shear_modulus * (e - Trace(e) / 3 * Id(3))
        return InnerProduct(distortion, H), self.law.bulk_modulus * Trace(e) * Trace(H)

    def variation(self, F: CoefficientFunction, H: CoefficientFunction) -> CoefficientFunction:
        """Return sigma : H, the derivative of the energy at F in the direction H."""
        return sum(self.variations(F, H))


def _strain(F: CoefficientFunction) -> CoefficientFunction:
    return (F + F.trans) / 2 - Id(3)
