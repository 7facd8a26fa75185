"""Quemada fluid: a suspension whose particles are aggregates at rest, and single under shear."""

from __future__ import annotations

from typing import Any, ClassVar, Literal, Self

from pydantic import Field, model_validator

from ngfsi.materials.fluid.yielding import Yielding
from ngfsi.units import ShearRate, Viscosity


class Quemada(Yielding):
    """mu = mu_p (1 - k H/2)^-2 with the intrinsic viscosity k = (k_0 + k_inf s)/(1 + s), s = sqrt(g/g_c).

    H is the haematocrit. With k_0 H < 2 the viscosity at rest is finite.
    """

    formula: ClassVar[str] = (
        r"\mu = \mu_p\left(1 - \tfrac12 H\,\frac{k_0 + k_\infty s}{1 + s}\right)^{-2},\quad s = \sqrt{g/\dot\gamma_c},"
        r"\quad g = \sqrt{\dot\gamma^2 + \dot\gamma_0^2}"
    )
    source: ClassVar[str] = "D. Quemada, Rheol Acta 17 (1978) 632 and 643"

    law: Literal["quemada"] = "quemada"
    viscosity_of_plasma: Viscosity = Field(gt=0)
    """Viscosity of the plasma."""
    haematocrit: float = Field(gt=0, lt=1)
    """Volume of red cells over that of blood."""
    k_rest: float = Field(gt=0)
    """Intrinsic viscosity of the cells at rest."""
    k_high_shear: float = Field(gt=0)
    """Intrinsic viscosity of the cells at high shear rates."""
    critical_shear_rate: ShearRate = Field(gt=0)
    """Shear rate between both limits."""

    @model_validator(mode="after")
    def _flows(self) -> Self:
        if self.k_high_shear > self.k_rest:
            raise ValueError(f"k_high_shear = {self.k_high_shear:g} must not be larger than k_rest = {self.k_rest:g}")
        if self.k_rest * self.haematocrit >= 2:
            raise ValueError(
                f"at rest this blood is solid: k_rest times the haematocrit, {self.k_rest * self.haematocrit:.4g}, "
                "must be less than 2"
            )
        return self

    def unregularised(self, shear_rate: Any) -> Any:
        s = (shear_rate / self.critical_shear_rate) ** 0.5
        k = (self.k_rest + self.k_high_shear * s) / (1 + s)
        return self.viscosity_of_plasma * (1 - k * self.haematocrit / 2) ** -2
