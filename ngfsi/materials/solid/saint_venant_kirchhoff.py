"""Saint Venant-Kirchhoff solid: linear elasticity made objective."""

from __future__ import annotations

from typing import ClassVar, Literal

from ngfsi.materials.solid.law import Invariants, IsotropicLaw, Pair
from ngfsi.materials.solid.linear import LinearAtRest


class SaintVenantKirchhoff(LinearAtRest, IsotropicLaw):
    """W = lambda/2 tr(E)^2 + mu tr(E^2) with the Green-Lagrange strain E = (C - I)/2.

    Softens in compression and loses stability there (uniaxially at a stretch of sqrt(1/3)): for small strains.
    """

    formula: ClassVar[str] = (
        r"W = \tfrac{\lambda}{2}(\mathrm{tr}\,E)^2 + \mu\,\mathrm{tr}(E^2),\quad E = \tfrac12(C - I)"
    )
    source: ClassVar[str] = "P. G. Ciarlet, Mathematical Elasticity, vol. I (1988), section 3.9"

    law: Literal["saint_venant_kirchhoff"] = "saint_venant_kirchhoff"

    def energies_of(self, strain: Invariants) -> Pair:
        I1, I2, _ = strain
        trace = (I1 - 3) / 2
        square = (I1 * I1 - 2 * I2 - 2 * I1 + 3) / 4  # E : E, since C : C = I1^2 - 2 I2
        return self.shear_modulus * square, self.lame / 2 * trace**2
