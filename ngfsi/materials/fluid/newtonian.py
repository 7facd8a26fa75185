"""Newtonian fluid."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from ngfsi.materials.law import Law
from ngfsi.units import Density, Viscosity


class Newtonian(Law):
    """sigma = -p I + mu (grad u + grad u^T), incompressible."""

    formula: ClassVar[str] = r"\sigma = -p I + \mu\,(\nabla u + \nabla u^T),\quad \nabla\cdot u = 0"
    source: ClassVar[str] = "G. K. Batchelor, An Introduction to Fluid Dynamics (1967), section 3.3"

    law: Literal["newtonian"] = "newtonian"
    density: Density = Field(gt=0)
    viscosity: Viscosity = Field(gt=0)
