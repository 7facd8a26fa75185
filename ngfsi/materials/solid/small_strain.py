"""A solid at small strain: linear elasticity with the initial moduli of another law."""

from __future__ import annotations

from ngsolve import CoefficientFunction, Id, InnerProduct, Trace

from ngfsi.errors import MaterialError
from ngfsi.materials.solid.law import Pair, SolidLaw, SolidModel


class SmallStrain(SolidModel):
    """W = K/2 tr(e)^2 + mu dev(e) : dev(e) with e the symmetric part of F - I (Landau and Lifshitz, vol. 7, section 4).

    Not objective: for comparison with linear elasticity on the undeformed shape.
    """

    def __init__(self, law: SolidLaw) -> None:
        """Take the moduli of a law.

        Raises:
            MaterialError: it has none, or has a viscosity.
        """
        if law.viscosity is not None:
            raise MaterialError(f"law '{law.law}' has a viscosity, which small strain has not: use strain = 'finite'")
        if law.shear_modulus is None or law.bulk_modulus is None:
            raise MaterialError(f"law '{law.law}' has no initial moduli for small strain: use strain = 'finite'")
        self.density, self._shear, self._bulk = law.density, law.shear_modulus, law.bulk_modulus

    def energies(self, F: CoefficientFunction) -> Pair:
        distortion, dilation = self.variations(F, _strain(F))
        return distortion / 2, dilation / 2

    def variations(self, F: CoefficientFunction, H: CoefficientFunction) -> Pair:
        e = _strain(F)
        distortion = 2 * self._shear * (e - Trace(e) / 3 * Id(3))
        return InnerProduct(distortion, H), self._bulk * Trace(e) * Trace(H)

    def variation(self, F: CoefficientFunction, H: CoefficientFunction) -> CoefficientFunction:
        return sum(self.variations(F, H))


def _strain(F: CoefficientFunction) -> CoefficientFunction:
    return (F + F.trans) / 2 - Id(3)
