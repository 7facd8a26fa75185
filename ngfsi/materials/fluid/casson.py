"""Casson fluid: a yield stress and a square root that thins."""

from __future__ import annotations

from typing import Any, ClassVar, Literal

from pydantic import Field

from ngfsi.materials.fluid.yielding import Yielding
from ngfsi.units import Pressure, Viscosity


class Casson(Yielding):
    """sqrt(tau) = sqrt(tau_y) + sqrt(k g)."""

    formula: ClassVar[str] = (
        r"\mu = \left(\sqrt{k} + \sqrt{\tau_y/g}\right)^2,\quad g = \sqrt{\dot\gamma^2 + \dot\gamma_0^2}"
    )
    source: ClassVar[str] = "N. Casson, in: C. C. Mill (ed.), Rheology of Disperse Systems (1959) 84"

    law: Literal["casson"] = "casson"
    yield_stress: Pressure = Field(ge=0)
    """Shear stress below which blood does not flow."""
    viscosity_at_high_shear: Viscosity = Field(gt=0)
    """Limit at high shear rates."""

    def unregularised(self, shear_rate: Any) -> Any:
        return (self.viscosity_at_high_shear**0.5 + (self.yield_stress / shear_rate) ** 0.5) ** 2
