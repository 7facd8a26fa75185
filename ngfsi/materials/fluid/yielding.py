"""Base of the laws with a viscosity that is infinite, or steeper than Newton's method can follow, at rest."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

from pydantic import Field

from ngfsi.materials.fluid.law import FluidLaw
from ngfsi.units import ShearRate


class Yielding(FluidLaw):
    """mu at sqrt(g^2 + g_0^2): what would be solid, or nearly, creeps with the viscosity at a shear rate g_0."""

    regularisation: ShearRate = Field(default=0.1, gt=0)
    """g_0: well below the shear rates that count; published constants hold from about 0.1 1/s on."""

    @abstractmethod
    def unregularised(self, shear_rate: Any) -> Any:
        """Return the viscosity (Pa s) of the law itself at a shear rate (1/s)."""

    def viscosity_at(self, shear_rate: Any) -> Any:
        return self.unregularised((shear_rate**2 + self.regularisation**2) ** 0.5)
