"""Laws of solids: a stored energy, bound to a region of a system.

A law is one file with its parameters and its energy. Stress and tangent are not written anywhere: NGSolve
differentiates the energy. The system asks a law for a `SolidModel` of each region (`bind`): the law itself where it is
the same everywhere and remembers nothing, else a model that knows places, directions of fibres, internal variables.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple, Self, final

import numpy as np
from ngsolve import CoefficientFunction, Cof, Det, InnerProduct, Parameter, Trace
from pydantic import Field, model_validator

from ngfsi.arrays import Array
from ngfsi.config.messages import key_error
from ngfsi.config.model import dimension_of_field
from ngfsi.errors import unknown
from ngfsi.materials.law import Law
from ngfsi.materials.solid.internal import InternalVariable
from ngfsi.materials.solid.varying import AnyVariation
from ngfsi.materials.solid.viscosity import Held, Overstress, SolidViscosity
from ngfsi.mesh.domain import Domain
from ngfsi.units import Density

Pair = tuple[CoefficientFunction, CoefficientFunction]


@dataclass(frozen=True)
class Place:
    """Where a law is bound.

    Attributes:
        domain: the reference shape.
        region: name of the solid.
        order: polynomial order of the displacement.
        F: deformation gradient (3x3) of the present state from the shape that is free of stress.
        step: size of the step that is being taken (s); infinite at rest.
        before: returns F of the last accepted state, at the start of that step, which the system keeps once asked.
        rate: returns dF/dt (1/s) of the time scheme for an F at the end of the step.
    """

    domain: Domain
    region: str
    order: int
    F: CoefficientFunction
    step: Parameter
    before: Callable[[], CoefficientFunction]
    rate: Callable[[CoefficientFunction], CoefficientFunction]

    @property
    def mesh(self) -> Any:
        """Of the reference shape."""
        return self.domain.mesh


class SolidModel(ABC):
    """A hyperelastic or viscoelastic solid in one region, as the system uses it."""

    density: float
    """Mass per reference volume (kg/m3)."""

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
        """Return P : H with the first Piola-Kirchhoff stress P, the derivative of the energy at F in the direction H.

        Models with internal variables add their stress here and in `variations`.
        """
        strain = F.MakeVariable()
        return self.energy(strain).Diff(strain, H)

    @property
    def at_rest(self) -> SolidModel:
        """The model of what is left of the stresses at rest."""
        return self

    def held(self) -> Held | None:
        """Return what internal variables hold and turn into heat in the present state, if there are any."""
        return None

    def take_step(self, step: float) -> None:  # noqa: B027
        """Take note of the size of the step that is being taken (s), `Place.step`; infinite at rest."""

    def internal_variables(self) -> dict[str, InternalVariable]:
        """Return what the solid remembers, by name; most remember nothing."""
        return {}

    @final
    def accept(self) -> None:
        """Take note that the state is accepted: internal variables take their new values as a step begins."""
        known = self.internal_variables().values()
        new = [one.updated() for one in known]  # of all before the first is overwritten
        for one, values in zip(known, new, strict=True):
            one.field.vec.data = values

    @final
    def state_arrays(self) -> dict[str, Array]:
        """Return copies of the internal variables, for `restore_state`."""
        return {name: np.array(one.field.vec.FV().NumPy()) for name, one in self.internal_variables().items()}

    @final
    def restore_state(self, arrays: Mapping[str, Array]) -> None:
        """Take what `state_arrays` of an equal model returned."""
        for name, one in self.internal_variables().items():
            one.field.vec.FV().NumPy()[:] = arrays[name]


class SolidLaw(Law, SolidModel):
    """A law of solids."""

    density: Density = Field(ge=0)
    viscosity: SolidViscosity | None = None
    """Viscosity beside the law, which is then the stress at infinite time."""
    varying: tuple[AnyVariation, ...] = ()
    """Factors on moduli that depend on the place."""
    isotropic: ClassVar[bool] = False
    """Whether the energy is one of the principal stretches alone: then its ellipticity is checked in a run."""

    def bind(self, _place: Place) -> SolidModel:
        """Return the model of a region at rest."""
        return self

    @model_validator(mode="after")
    def _moduli_vary(self) -> Self:
        moduli = [name for name in type(self).model_fields if dimension_of_field(type(self), name) == "pressure"]
        names = [one.parameter for one in self.varying]
        for name in names:
            if name not in moduli:
                raise key_error("varying", f"has an unknown value: {unknown('modulus', name, moduli)}")
            if names.count(name) > 1:
                raise key_error("varying", f"has two factors on '{name}': keep one of them")
        return self

    def at(self, domain: Domain, region: str) -> Self:
        """Return the law of a region: where moduli vary, with coefficient functions in their place."""
        changes: dict[str, Any] = {}
        for one in self.varying:
            factor, value = one.factor(domain, region), getattr(self, one.parameter)
            changes[one.parameter] = tuple(factor * v for v in value) if isinstance(value, tuple) else factor * value
        return self.model_copy(update=changes) if changes else self

    def model(self, place: Place) -> SolidModel:
        """Return the model of a region, with the viscosity."""
        elastic = self.at(place.domain, place.region).bind(place)
        return elastic if self.viscosity is None else Viscous(elastic, Overstress(self.viscosity, place))

    @property
    def shear_modulus(self) -> float | None:
        """Initial shear modulus (Pa); None: the law has no such thing."""
        return None

    @property
    def bulk_modulus(self) -> float | None:
        """Initial bulk modulus (Pa); None: the law has no such thing."""
        return None

    @property
    def youngs_modulus(self) -> float | None:
        """Initial Young's modulus (Pa), where there are the others."""
        G, K = self.shear_modulus, self.bulk_modulus
        return None if G is None or K is None else 9 * K * G / (3 * K + G)

    @property
    def poissons_ratio(self) -> float | None:
        """Initial Poisson ratio, where there are moduli."""
        G, K = self.shear_modulus, self.bulk_modulus
        return None if G is None or K is None else (3 * K - 2 * G) / (2 * (3 * K + G))


class Viscous(SolidModel):
    """A solid with viscosity: a hyperelastic model and an overstress."""

    def __init__(self, elastic: SolidModel, over: Overstress) -> None:
        self.density, self._elastic, self._over = elastic.density, elastic, over

    @property
    def at_rest(self) -> SolidModel:
        return self._elastic

    def energies(self, F: CoefficientFunction) -> Pair:
        return self._elastic.energies(F)

    def variations(self, F: CoefficientFunction, H: CoefficientFunction) -> Pair:
        rest, bulk = self._elastic.variations(F, H)
        return rest + self._over.work(F, H), bulk

    def variation(self, F: CoefficientFunction, H: CoefficientFunction) -> CoefficientFunction:
        return self._elastic.variation(F, H) + self._over.work(F, H)

    def held(self) -> Held:
        return self._over.held()

    def take_step(self, step: float) -> None:
        self._elastic.take_step(step)
        self._over.take_step(step)

    def internal_variables(self) -> dict[str, InternalVariable]:
        return self._elastic.internal_variables() | self._over.internal_variables


def right_cauchy_green(F: CoefficientFunction) -> CoefficientFunction:
    """Return C = F^T F (3x3)."""
    return F.trans * F


class Invariants(NamedTuple):
    """I1 = tr C, I2 = (I1^2 - C : C)/2 and J = det F."""

    I1: CoefficientFunction
    I2: CoefficientFunction
    J: CoefficientFunction

    @property
    def shrink(self) -> CoefficientFunction:
        """J^(-1/3)."""
        return self.J ** (-1 / 3)

    @property
    def isochoric(self) -> tuple[CoefficientFunction, CoefficientFunction]:
        """I1 and I2 of the volume-preserving part J^(-1/3) F: both are 3 at rest and blind to dilation."""
        squared = self.shrink * self.shrink
        return squared * self.I1, squared * squared * self.I2


class Variables(Invariants):
    """Invariants of F, each a variable of its own, so that an energy can be differentiated by them.

    So is J^(-1/3), since a power takes as long as all else: of the derivatives by J, too, there is one.
    """

    shrink: CoefficientFunction = None

    @classmethod
    def of(cls, F: CoefficientFunction) -> Self:
        """Return those of F (3x3)."""
        C = right_cauchy_green(F)
        parts = (Trace(C), (Trace(C) ** 2 - InnerProduct(C, C)) / 2, Det(F))
        found = cls(*(part.MakeVariable() for part in parts))
        # not of the variable J, by which it would be differentiated then
        found.shrink = (Det(F) ** (-1 / 3)).MakeVariable()
        return found

    def slopes(self, W: CoefficientFunction) -> tuple[CoefficientFunction, CoefficientFunction, CoefficientFunction]:
        """Return the derivatives of an energy by the three invariants."""
        W1, W2, WJ = (W.Diff(invariant) for invariant in self)
        return W1, W2, WJ - W.Diff(self.shrink) * self.shrink / (3 * self.J)


class IsotropicLaw(SolidLaw):
    """A solid whose energy is one of the invariants I1 = tr C, I2 = (I1^2 - C : C)/2 and J = det F.

    Only the energy's derivatives by three numbers are left to NGSolve then, and those of the invariants by F are
    written here, for all laws (Holzapfel, Nonlinear Solid Mechanics, 2000, section 6.2): that more than halves the
    time of the tissue's forms.
    """

    isotropic: ClassVar[bool] = True

    @abstractmethod
    def energies_of(self, strain: Invariants) -> Pair:
        """Return the parts of the stored energy (J per m3 of reference volume), as of `energies`."""

    def energies(self, F: CoefficientFunction) -> Pair:
        return self.energies_of(Variables.of(F))

    def variations(self, F: CoefficientFunction, H: CoefficientFunction) -> Pair:
        strain = Variables.of(F)
        rest, bulk = self.energies_of(strain)
        return _variation(rest, strain, F, H), _variation(bulk, strain, F, H)

    def variation(self, F: CoefficientFunction, H: CoefficientFunction) -> CoefficientFunction:
        strain = Variables.of(F)
        return _variation(sum(self.energies_of(strain)), strain, F, H)


def _variation(
    W: CoefficientFunction, strain: Variables, F: CoefficientFunction, H: CoefficientFunction
) -> CoefficientFunction:
    """Return P : H with P = 2 (W_1 + W_2 I1) F - 2 W_2 F C + W_J cof F."""
    W1, W2, WJ = strain.slopes(W)
    stress = 2 * (W1 + W2 * strain.I1) * F - 2 * W2 * (F * right_cauchy_green(F)) + WJ * Cof(F)
    return InnerProduct(stress, H)
