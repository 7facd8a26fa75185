"""Laws of fluids: incompressible, with a viscosity that may depend on the shear rate."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, ClassVar

import numpy as np
from ngsolve import InnerProduct, sqrt
from pydantic import Field

from ngfsi.arrays import Array
from ngfsi.materials.law import Law
from ngfsi.units import Density

SMALLEST_SHEAR_RATE = 1e-3
"""Added in squares to the shear rate (1/s), whose root has no derivative at rest."""
NOMINAL_SHEAR_RATE = 100.0
"""Shear rate (1/s) at which one number for the viscosity of blood is usually given."""
ITERATIONS = 100
"""Most that find a wall shear rate; a law whose slope changes slowly needs 10."""


def _points() -> tuple[Array, Array]:
    """Return Gauss points and weights of the integral over 0 < s < 1, s = t^2: powers of s are smooth in t."""
    t, w = np.polynomial.legendre.leggauss(40)
    t, w = (t + 1) / 2, w / 2
    return t**2, 2 * t * w


class FluidLaw(Law):
    """sigma = -p I + mu(g) (L + L^T), with the shear rate g = sqrt(2 D : D), D = (L + L^T)/2."""

    newtonian: ClassVar[bool] = False
    """Whether the viscosity is one number: then profiles of developed flow do not depend on the flow."""

    density: Density = Field(gt=0)

    @abstractmethod
    def viscosity_at(self, shear_rate: Any) -> Any:
        """Return the viscosity (Pa s) at a shear rate (1/s), as numbers, arrays or coefficient functions."""

    def apparent_viscosity(self, twice_D: Any) -> Any:
        """Return the viscosity (Pa s) at a rate of deformation, given as L + L^T (1/s)."""
        return self.viscosity_at(sqrt(InnerProduct(twice_D, twice_D) / 2 + SMALLEST_SHEAR_RATE**2))

    def developed_viscosity(self, rate: Any) -> Any:
        """Return the constant viscosity (Pa s, array) whose developed flow Q in a round pipe has the same wall shear
        stress: tau = mu 4 Q/(pi R^3).

        Wall shear rate g and flow of any law are tied by 4 Q/(pi R^3) = 4/tau^3 int_0^tau t^2 g(t) dt, by parts
        4/3 (g - int_0^g (tau(s)/tau(g))^3 ds) (Weissenberg and Rabinowitsch: R. B. Bird, R. C. Armstrong, O. Hassager,
        Dynamics of Polymeric Liquids, vol. 1 (1987), section 10.2).

        Args:
            rate: 4 Q/(pi R^3) (1/s), what the wall shear rate is for a constant viscosity.
        """
        wanted = np.maximum(np.abs(np.asarray(rate, dtype=float)), SMALLEST_SHEAR_RATE)
        found = wanted
        for _ in range(ITERATIONS):
            change = wanted / self._developed_rate(found)
            found = found * change
            if np.all(np.abs(change - 1) < 1e-13):
                break
        return self.viscosity_at(found) * found / wanted

    def _developed_rate(self, wall: Array) -> Array:
        """Return 4 Q/(pi R^3) (1/s) at a wall shear rate (1/s)."""
        s, w = _points()
        inside = np.multiply.outer(wall, s)
        stress = self.viscosity_at(inside) * s / np.asarray(self.viscosity_at(wall))[..., None]
        return np.asarray(4 / 3 * wall * (1 - stress**3 @ w))

    @property
    def nominal_viscosity(self) -> float:
        """Viscosity (Pa s) at 100 1/s, for tables; of Newtonian fluids at any rate."""
        return float(self.viscosity_at(NOMINAL_SHEAR_RATE))
