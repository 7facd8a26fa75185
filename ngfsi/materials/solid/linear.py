"""Base of the laws that are given by Young's modulus and Poisson ratio and differ only at finite strain.

Relations between the constants: any textbook, e.g. Landau and Lifshitz, vol. 7, section 5.
"""

from __future__ import annotations

from typing import ClassVar

from pydantic import Field

from ngfsi.materials.solid.law import SolidLaw
from ngfsi.units import Pressure


class LinearAtRest(SolidLaw):
    """A solid whose parameters are those of linear elasticity."""

    isotropic: ClassVar[bool] = True

    young: Pressure = Field(gt=0)
    """Young's modulus at small strain."""
    poisson: float = Field(gt=-1, lt=0.5)
    """Poisson's ratio at small strain."""

    @property
    def shear_modulus(self) -> float:
        """Initial shear modulus (Pa), Lame's mu."""
        return self.young / (2 * (1 + self.poisson))

    @property
    def bulk_modulus(self) -> float:
        return self.young / (3 * (1 - 2 * self.poisson))

    @property
    def lame(self) -> float:
        """Lame's first constant lambda (Pa)."""
        return self.young * self.poisson / ((1 + self.poisson) * (1 - 2 * self.poisson))
