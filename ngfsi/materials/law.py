"""What every material law is: a section with a tag `law`, a density, a label and, for solids, a stored energy.

A law is one file with its parameters, its energy and its initial moduli. Stress and tangent are not written
anywhere: NGSolve differentiates the energy.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

from ngsolve import CoefficientFunction
from pydantic import Field

from ngfsi.errors import MaterialError, NgfsiError
from ngfsi.materials import moduli
from ngfsi.section import Section
from ngfsi.units import Density


class Law(Section):
    """A material of one region: common to solids and fluids."""

    refusal: ClassVar[type[NgfsiError]] = MaterialError
    formula: ClassVar[str]
    """The law in LaTeX."""
    source: ClassVar[str]
    """Where the law comes from."""

    law: str
    """Tag of the law, its name in case files."""
    density: Density
    """Mass per reference volume (kg/m3)."""
    label: str = Field(default_factory=lambda given: given.get("law", ""))
    """How tables and figures call the material: the name of the parameter set, else of the law."""


class SolidLaw(Law, ABC):
    """A hyperelastic solid, given by its energy per reference volume."""

    density: Density = Field(ge=0)

    @abstractmethod
    def energy(self, F: CoefficientFunction) -> CoefficientFunction:
        """Return the stored energy (J per m3 of reference volume) at the deformation gradient F (3x3)."""

    @property
    @abstractmethod
    def shear_modulus(self) -> float:
        """Initial shear modulus (Pa)."""

    @property
    @abstractmethod
    def bulk_modulus(self) -> float:
        """Initial bulk modulus (Pa)."""

    @property
    def youngs_modulus(self) -> float:
        """Initial Young's modulus (Pa)."""
        return moduli.young(self.shear_modulus, self.bulk_modulus)

    @property
    def poissons_ratio(self) -> float:
        """Initial Poisson ratio."""
        return moduli.poisson(self.shear_modulus, self.bulk_modulus)
