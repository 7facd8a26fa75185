"""Saint Venant-Kirchhoff solid: linear elasticity made objective."""

from __future__ import annotations

from typing import ClassVar, Literal

from ngsolve import CoefficientFunction, Id, InnerProduct, Trace

from ngfsi.materials.linear import LinearAtRest
from ngfsi.materials.strain import right_cauchy_green


class SaintVenantKirchhoff(LinearAtRest):
    """W = lambda/2 tr(E)^2 + mu tr(E^2) with the Green-Lagrange strain E = (C - I)/2.

    Softens in compression and loses stability there (uniaxially at a stretch of sqrt(1/3)): for small strains.
    """

    formula: ClassVar[str] = (
        r"W = \tfrac{\lambda}{2}(\mathrm{tr}\,E)^2 + \mu\,\mathrm{tr}(E^2),\quad E = \tfrac12(C - I)"
    )
    source: ClassVar[str] = "P. G. Ciarlet, Mathematical Elasticity, vol. I (1988), section 3.9"

    law: Literal["saint_venant_kirchhoff"] = "saint_venant_kirchhoff"

    def energy(self, F: CoefficientFunction) -> CoefficientFunction:
        """Return the stored energy (J per m3 of reference volume) at the deformation gradient F (3x3)."""
        E = (right_cauchy_green(F) - Id(3)) / 2
        return self.lame / 2 * Trace(E) ** 2 + self.shear_modulus * InnerProduct(E, E)
