"""What every material law is: a section with a tag `law`, a density, a label and, for solids, a stored energy.

A law is one file with its parameters, its energy and its initial moduli. Stress and tangent are not written
anywhere: NGSolve differentiates the energy.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

from ngsolve import CoefficientFunction, Cof, InnerProduct
from pydantic import Field

from ngfsi.config.model import ConfigModel
from ngfsi.errors import MaterialError, NgfsiError
from ngfsi.materials.solid import moduli
from ngfsi.materials.solid.strain import Invariants, right_cauchy_green
from ngfsi.units import Density

Pair = tuple[CoefficientFunction, CoefficientFunction]


class Law(ConfigModel):
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
    def energies(self, F: CoefficientFunction) -> Pair:
        """Return two parts of the stored energy (J per m3 of reference volume) at the deformation gradient F (3x3).

        The second is what grows with the bulk modulus.
        """

    def energy(self, F: CoefficientFunction) -> CoefficientFunction:
        """Return the stored energy (J per m3 of reference volume) at the deformation gradient F (3x3)."""
        return sum(self.energies(F))

    def variations(self, F: CoefficientFunction, H: CoefficientFunction) -> Pair:
        """Return the derivatives of the parts of the energy at F in the direction H; `variation` is their sum."""
        strain = F.MakeVariable()
        rest, bulk = self.energies(strain)
        return rest.Diff(strain, H), bulk.Diff(strain, H)

    def variation(self, F: CoefficientFunction, H: CoefficientFunction) -> CoefficientFunction:
        """Return P : H, the derivative of the energy at F in the direction H; P is the first Piola-Kirchhoff stress."""
        strain = F.MakeVariable()
        return self.energy(strain).Diff(strain, H)

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


class IsotropicLaw(SolidLaw):
    """A solid whose energy is one of the invariants I1 = tr C, I2 = (I1^2 - C : C)/2 and J = det F.

    Only the energy's derivatives by three numbers are left to NGSolve then, and those of the invariants by F are
    written here, for all laws (Holzapfel, Nonlinear Solid Mechanics, 2000, section 6.2): that more than halves the
    time of the tissue's forms.
    """

    @abstractmethod
    def energies_of(self, strain: Invariants) -> Pair:
        """Return the parts of the stored energy (J per m3 of reference volume), as of `energies`."""

    def energies(self, F: CoefficientFunction) -> Pair:
        """Return the parts of the stored energy (J per m3 of reference volume) at the deformation gradient F (3x3)."""
        return self.energies_of(Invariants.of(F))

    def variations(self, F: CoefficientFunction, H: CoefficientFunction) -> Pair:
        """Return the derivatives of the parts of the energy at F in the direction H; `variation` is their sum."""
        strain = Invariants.of(F)
        rest, bulk = self.energies_of(strain)
        return _variation(rest, strain, F, H), _variation(bulk, strain, F, H)

    def variation(self, F: CoefficientFunction, H: CoefficientFunction) -> CoefficientFunction:
        """Return P : H, the derivative of the energy at F in the direction H."""
        strain = Invariants.of(F)
        return _variation(sum(self.energies_of(strain)), strain, F, H)


def _variation(
    W: CoefficientFunction, strain: Invariants, F: CoefficientFunction, H: CoefficientFunction
) -> CoefficientFunction:
    """Return P : H with P = 2 (W_1 + W_2 I1) F - 2 W_2 F C + W_J cof F."""
    W1, W2, WJ = (W.Diff(invariant) for invariant in strain)
    stress = 2 * (W1 + W2 * strain.I1) * F - 2 * W2 * (F * right_cauchy_green(F)) + WJ * Cof(F)
    return InnerProduct(stress, H)
