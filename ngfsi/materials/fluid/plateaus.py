"""Base of the laws whose viscosity falls from a plateau at rest to another at high shear rates."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, Self

from pydantic import Field, model_validator

from ngfsi.materials.fluid.law import FluidLaw
from ngfsi.units import Viscosity


class Plateaus(FluidLaw):
    """mu = mu_inf + (mu_0 - mu_inf) f(g)."""

    viscosity_at_rest: Viscosity = Field(gt=0)
    """Limit at low shear rates."""
    viscosity_at_high_shear: Viscosity = Field(gt=0)
    """Limit at high shear rates."""

    @model_validator(mode="after")
    def _thins(self) -> Self:
        low, high = self.viscosity_at_rest, self.viscosity_at_high_shear
        if high > low:
            raise ValueError(
                f"the viscosity at high shear, {high:g} Pa s, must not be larger than that at rest, {low:g} Pa s"
            )
        return self

    @abstractmethod
    def falling(self, shear_rate: Any) -> Any:
        """Return f, which falls from 1 to 0, at a shear rate (1/s)."""

    def viscosity_at(self, shear_rate: Any) -> Any:
        high = self.viscosity_at_high_shear
        return high + (self.viscosity_at_rest - high) * self.falling(shear_rate)
