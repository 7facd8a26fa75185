"""Laws of fluids: incompressible, with a viscosity that may depend on the shear rate."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

from ngsolve import InnerProduct, sqrt
from pydantic import Field

from ngfsi.materials.law import Law
from ngfsi.units import Density

SMALLEST_SHEAR_RATE = 1e-3
"""Added in squares to the shear rate (1/s), whose root has no derivative at rest."""


class FluidLaw(Law):
    """sigma = -p I + mu(g) (L + L^T), with the shear rate g = sqrt(2 D : D), D = (L + L^T)/2."""

    density: Density = Field(gt=0)

    @abstractmethod
    def viscosity_at(self, shear_rate: Any) -> Any:
        """Return the viscosity (Pa s) at a shear rate (1/s), as numbers or coefficient functions."""

    def apparent_viscosity(self, twice_D: Any) -> Any:
        """Return the viscosity (Pa s) at a rate of deformation, given as L + L^T (1/s)."""
        return self.viscosity_at(sqrt(InnerProduct(twice_D, twice_D) / 2 + SMALLEST_SHEAR_RATE**2))

    @property
    @abstractmethod
    def nominal_viscosity(self) -> float:
        """A viscosity (Pa s) for estimates and for comparison with Newtonian flow."""
