"""Newtonian fluid."""

from __future__ import annotations

from typing import Any, ClassVar, Literal

from pydantic import Field

from ngfsi.materials.fluid.law import FluidLaw
from ngfsi.units import Viscosity


class Newtonian(FluidLaw):
    """sigma = -p I + mu (grad u + grad u^T), incompressible."""

    formula: ClassVar[str] = r"\sigma = -p I + \mu\,(\nabla u + \nabla u^T),\quad \nabla\cdot u = 0"
    source: ClassVar[str] = "G. K. Batchelor, An Introduction to Fluid Dynamics (1967), section 3.3"
    newtonian: ClassVar[bool] = True

    law: Literal["newtonian"] = "newtonian"
    viscosity: Viscosity = Field(gt=0)
    """Dynamic viscosity."""

    def viscosity_at(self, _shear_rate: Any) -> float:
        return self.viscosity

    def apparent_viscosity(self, _twice_D: Any) -> float:
        return self.viscosity

    def developed_viscosity(self, _rate: Any) -> float:
        return self.viscosity
