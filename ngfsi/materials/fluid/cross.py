"""Cross fluid: a viscosity that falls from one plateau to another."""

from __future__ import annotations

from typing import Any, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from ngfsi.materials.fluid.plateaus import Plateaus
from ngfsi.units import Time


class Cross(Plateaus):
    """mu = mu_inf + (mu_0 - mu_inf) / (1 + (lambda g)^m), with a stress mu g that must rise with the shear rate."""

    formula: ClassVar[str] = r"\mu = \mu_\infty + \frac{\mu_0 - \mu_\infty}{1 + (\lambda\dot\gamma)^m}"
    source: ClassVar[str] = "M. M. Cross, J Colloid Sci 20 (1965) 417"

    law: Literal["cross"] = "cross"
    time_constant: Time = Field(gt=0)
    """1 over the shear rate at which the viscosity is midway."""
    m: float = Field(gt=0)
    """Exponent of the decay."""

    @model_validator(mode="after")
    def _stress_rises(self) -> Self:
        rates = np.geomspace(1e-3, 1e3, 600) / self.time_constant
        falls = np.diff(self.viscosity_at(rates) * rates) <= 0
        if np.any(falls):
            raise ValueError(
                f"the stress would fall as the shear rate rises beyond {rates[np.argmax(falls)]:.3g} 1/s: m is too "
                "large for these viscosities"
            )
        return self

    def falling(self, shear_rate: Any) -> Any:
        return 1 / (1 + (self.time_constant * shear_rate) ** self.m)
