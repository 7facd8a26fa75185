"""Base of the laws with fibres: a stored energy of F and of unit vectors, which a case gives as fields."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar, NamedTuple

from ngsolve import CoefficientFunction, Cof, Det, IfPos, InnerProduct, Trace, log
from pydantic import Field

from ngfsi.errors import MaterialError
from ngfsi.materials.solid.directions import FibreDirection
from ngfsi.materials.solid.law import Pair, Place, SolidLaw, SolidModel, right_cauchy_green
from ngfsi.units import Pressure


class FibreLaw(SolidLaw):
    """A solid with one family of fibres or more."""

    families: ClassVar[tuple[int, int]] = (1, 1)
    """Fewest and most."""

    fibres: tuple[FibreDirection, ...]
    """Directions in the shape free of stress, one for each family."""
    K: Pressure = Field(gt=0)
    """Initial bulk modulus: K/2 ((J^2 - 1)/2 - ln J)."""

    @abstractmethod
    def distortion(self, stretch: Stretch) -> CoefficientFunction:
        """Return the stored energy (J per m3 of reference volume) without that of changes of volume."""

    def parts(self, stretch: Stretch) -> Pair:
        """Return the parts of the stored energy, as of `energies`."""
        return self.distortion(stretch), self.K / 2 * ((stretch.J**2 - 1) / 2 - log(stretch.J))

    def energies(self, _F: CoefficientFunction) -> Pair:
        raise MaterialError(f"law '{self.law}' has fibres, whose directions are those of a region: it must be bound")

    def bind(self, place: Place) -> SolidModel:
        fewest, most = self.families
        if not fewest <= len(self.fibres) <= most:
            wanted = f"{fewest}" if fewest == most else f"{fewest} to {most}"
            raise MaterialError(f"law '{self.law}' has {wanted} families of fibres, not {len(self.fibres)}")
        return Fibred(self, [fibre.field(place.domain, place.region) for fibre in self.fibres])


class Fibred(SolidModel):
    """A law with fibres in known directions.

    Attributes:
        law, directions: unit vectors as coefficient functions.
    """

    def __init__(self, law: FibreLaw, directions: Sequence[Any]) -> None:
        self.density, self.law, self.directions = law.density, law, directions

    def energies(self, F: CoefficientFunction) -> Pair:
        return self.law.parts(Stretch.of(F, self.directions))

    def variations(self, F: CoefficientFunction, H: CoefficientFunction) -> Pair:
        stretch = Stretch.of(F, self.directions)
        rest, bulk = self.law.parts(stretch)
        return self._variation(rest, stretch, F, H), self._variation(bulk, stretch, F, H)

    def variation(self, F: CoefficientFunction, H: CoefficientFunction) -> CoefficientFunction:
        stretch = Stretch.of(F, self.directions)
        return self._variation(sum(self.law.parts(stretch)), stretch, F, H)

    def _variation(self, W: Any, stretch: Stretch, F: CoefficientFunction, H: CoefficientFunction) -> Any:
        """Return P : H by the derivatives of the invariants, as `IsotropicLaw` does for speed."""
        C, HF = right_cauchy_green(F), H.trans * F
        found = 2 * W.Diff(stretch.trace) * InnerProduct(F, H) + W.Diff(stretch.J) * InnerProduct(Cof(F), H)
        for a, along, squared in zip(self.directions, stretch.along, stretch.squared, strict=True):
            Ca = C * a
            of_a = HF * a
            found += 2 * W.Diff(along) * InnerProduct(a, of_a)
            found += 2 * W.Diff(squared) * (InnerProduct(Ca, of_a) + InnerProduct(a, HF * Ca))
        return found


class Stretch(NamedTuple):
    """tr C, J = det F, and a . C a and a . C^2 a of each family: variables, to differentiate an energy by."""

    trace: Any
    J: Any
    along: list[Any]
    squared: list[Any]

    @classmethod
    def of(cls, F: CoefficientFunction, directions: Sequence[Any]) -> Stretch:
        C = right_cauchy_green(F)
        Ca = [C * a for a in directions]
        along = [InnerProduct(a, one).MakeVariable() for a, one in zip(directions, Ca, strict=True)]
        return cls(Trace(C).MakeVariable(), Det(F).MakeVariable(), along,
                   [InnerProduct(one, one).MakeVariable() for one in Ca])  # fmt: skip

    @property
    def I1(self) -> Any:
        """Isochoric tr C."""
        return self.J ** (-2 / 3) * self.trace

    @property
    def I4(self) -> list[Any]:
        """Isochoric a . C a: squares of the fibres' stretches."""
        return [self.J ** (-2 / 3) * one for one in self.along]

    @property
    def I5(self) -> list[Any]:
        """Isochoric a . C^2 a."""
        return [self.J ** (-4 / 3) * one for one in self.squared]


def positive(value: Any) -> Any:
    """Return a value where it is positive, and 0 elsewhere: of fibres that bear tension alone."""
    return IfPos(value, value, 0.0)
