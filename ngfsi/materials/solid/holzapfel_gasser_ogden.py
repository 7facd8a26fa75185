"""Wall of vessels: fibres of collagen in one family or two, dispersed around their directions."""

from __future__ import annotations

from typing import Any, ClassVar, Literal

from ngsolve import exp
from pydantic import Field

from ngfsi.materials.solid.fibres import FibreLaw, Stretch, positive
from ngfsi.units import Pressure


class HolzapfelGasserOgden(FibreLaw):
    """W = c/2 (I1 - 3) + k1/(2 k2) sum (exp(k2 <E>^2) - 1), E = kappa (I1 - 3) + (1 - 3 kappa)(I4 - 1).

    <E> is max(E, 0); kappa is 0 where all fibres have one direction, and 1/3 where they have none.
    """

    formula: ClassVar[str] = (
        r"W = \tfrac{c}{2}(\bar I_1 - 3) + \frac{k_1}{2k_2}\sum_i\left(e^{k_2\langle E_i\rangle^2} - 1\right) + "
        r"\tfrac{K}{2}\left[\tfrac12(J^2 - 1) - \ln J\right],\ "
        r"E_i = \kappa(\bar I_1 - 3) + (1 - 3\kappa)(\bar I_{4i} - 1)"
    )
    source: ClassVar[str] = "T. C. Gasser, R. W. Ogden, G. A. Holzapfel, J R Soc Interface 3 (2006) 15"
    families: ClassVar[tuple[int, int]] = (1, 2)

    law: Literal["holzapfel_gasser_ogden"] = "holzapfel_gasser_ogden"
    c: Pressure = Field(gt=0)
    """Shear modulus of the ground substance."""
    k1: Pressure = Field(ge=0)
    """Stiffness of the fibres."""
    k2: float = Field(gt=0)
    """Rate of their exponential stiffening."""
    kappa: float = Field(default=0.0, ge=0, le=1 / 3)
    """Dispersion: 0 for fibres that are parallel, 1/3 for all directions alike."""

    def distortion(self, stretch: Stretch) -> Any:
        strains = [
            positive(self.kappa * (stretch.I1 - 3) + (1 - 3 * self.kappa) * (I4 - 1)) for I4 in stretch.I4
        ]  # fmt: skip
        fibres = [self.k1 / (2 * self.k2) * (exp(self.k2 * strain**2) - 1) for strain in strains]
        return sum(fibres, start=self.c / 2 * (stretch.I1 - 3))
