"""A solid at small strain: linear elasticity with the initial moduli of another law."""

from __future__ import annotations

from dataclasses import dataclass

from ngsolve import CoefficientFunction, Id, InnerProduct, Trace

from ngfsi.materials.law import SolidLaw


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
        e = (F + F.trans) / 2 - Id(3)
        return InnerProduct(self._stress(e), e) / 2

    def variation(self, F: CoefficientFunction, H: CoefficientFunction) -> CoefficientFunction:
        """Return sigma : H, the derivative of the energy at F in the direction H."""
        return InnerProduct(self._stress((F + F.trans) / 2 - Id(3)), H)

    def _stress(self, e: CoefficientFunction) -> CoefficientFunction:
        shear = self.law.shear_modulus
        return 2 * shear * e + (self.law.bulk_modulus - 2 * shear / 3) * Trace(e) * Id(3)
