"""Carreau-Yasuda fluid: a viscosity that falls from one plateau to another by a power of the shear rate."""

from __future__ import annotations

from typing import Any, ClassVar, Literal

from pydantic import Field

from ngfsi.materials.fluid.plateaus import Plateaus
from ngfsi.units import Time


class CarreauYasuda(Plateaus):
    """mu = mu_inf + (mu_0 - mu_inf) (1 + (lambda g)^a)^((n - 1)/a); Carreau's law is that with a = 2."""

    formula: ClassVar[str] = r"\mu = \mu_\infty + (\mu_0 - \mu_\infty)\left[1 + (\lambda\dot\gamma)^a\right]^{(n-1)/a}"
    source: ClassVar[str] = (
        "P. J. Carreau, Trans Soc Rheol 16 (1972) 99; K. Yasuda, R. C. Armstrong, R. E. Cohen, Rheol Acta 20 (1981) 163"
    )

    law: Literal["carreau_yasuda"] = "carreau_yasuda"
    time_constant: Time = Field(gt=0)
    """1 over the shear rate at which thinning begins."""
    a: float = Field(default=2.0, gt=0)
    """Sharpness of the transition; 2 is the law of Carreau."""
    n: float = Field(gt=0, le=1)
    """Exponent of the power law between the limits."""

    def falling(self, shear_rate: Any) -> Any:
        return (1 + (self.time_constant * shear_rate) ** self.a) ** ((self.n - 1) / self.a)
