"""Viscosity of solids: a Prony series and Kelvin-Voigt damping beside any stored energy.

Each term of the series is a Maxwell element, whose overstress Q follows the isochoric strain Cb = J^(-2/3) F^T F:

    dQ/dt + Q/tau = G dCb/dt,    2nd Piola-Kirchhoff stress 2 d/dC (Q : Q)/(4 G) = J^(-2/3) DEV Q

(finite linear viscoelasticity: J. C. Simo, CMAME 60 (1987) 153; G. A. Holzapfel, Nonlinear Solid Mechanics, 2000,
section 6.10; in this form J. Liu, M. Latorre, A. L. Marsden, CMAME 385 (2021) 114059). The element holds the energy
Q : Q/(4 G) and turns Q : Q/(2 G tau) into heat, which is never negative, whatever the law beside it: an overstress in
proportion to the stress of a nonlinear law has no such energy. In small shear G is a shear modulus.

Over a step h the recurrence is exact for a strain that changes evenly:

    Q_n+1 = e^(-h/tau) Q_n + G (1 - e^(-h/tau)) tau/h (Cb_n+1 - Cb_n)
"""

from __future__ import annotations

from math import exp, expm1
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, Self

import ngsolve as ng
from ngsolve import CoefficientFunction, Cof, Det, InnerProduct
from pydantic import Field, model_validator

from ngfsi.config.model import ConfigModel
from ngfsi.errors import MaterialError
from ngfsi.materials.solid.internal import InternalVariable
from ngfsi.units import Pressure, Time, Viscosity

if TYPE_CHECKING:
    from ngfsi.materials.solid.law import Place

ENTRIES = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
"""Of a symmetric tensor those that are kept."""
WHERE = (0, 1, 2, 1, 3, 4, 2, 4, 5)
"""Which of them each of the nine is."""


class SolidViscosity(ConfigModel):
    """Viscosity of a solid; the law's own stress is that at infinite time.

    Attributes:
        moduli: G of each Maxwell element (Pa), its share of the shear modulus at once.
        times: relaxation times of the elements (s).
        kelvin_voigt: shear viscosity of a dashpot beside them (Pa s).
    """

    refusal = MaterialError

    moduli: tuple[Annotated[Pressure, Field(gt=0)], ...] = ()
    times: tuple[Annotated[Time, Field(gt=0)], ...] = ()
    kelvin_voigt: Viscosity = Field(default=0.0, ge=0)

    @model_validator(mode="after")
    def _is_any(self) -> Self:
        if len(self.moduli) != len(self.times):
            raise ValueError(
                f"moduli has {len(self.moduli)} values and times {len(self.times)}: each element needs both"
            )
        if not self.moduli and not self.kelvin_voigt:
            raise ValueError("a viscosity needs moduli and times, or kelvin_voigt")
        return self


class Held(NamedTuple):
    """Energy in internal variables (J/m3), its rate and the heat (W/m3), per volume free of stress."""

    energy: CoefficientFunction
    rate: CoefficientFunction
    dissipation: CoefficientFunction


class Overstress:
    """The stress of a viscosity in one region, with its internal variables Q, one for each element.

    Attributes:
        internal_variables: by name.
    """

    def __init__(self, viscosity: SolidViscosity, place: Place) -> None:
        self._place, self._viscosity = place, viscosity
        region = place.mesh.Materials(place.region)
        space = ng.L2(place.mesh, order=place.order, dim=6, definedon=region)
        self._fields = [ng.GridFunction(space) for _ in viscosity.moduli]
        self._Q = [ng.CF(tuple(field[k] for k in WHERE), dims=(3, 3)) for field in self._fields]
        self._before = isochoric(place.before()) if self._Q else None
        # numbers that are set once a step: an exponential at each point would take a fifth of the tangent's time
        self._decays, self._gains = ([ng.Parameter(0.0) for _ in viscosity.moduli] for _ in range(2))
        self._slope = ng.Parameter(0.0)
        self.take_step(place.step.Get())
        new = [ng.CF(tuple(one[i, j] for i, j in ENTRIES)) for one in self._elements(place.F)]
        self.internal_variables = {
            f"Q{k}": InternalVariable(*one, place) for k, one in enumerate(zip(self._fields, new, strict=True))
        }

    def take_step(self, step: float) -> None:
        """Take the size of the step (s); after an infinite one the elements are relaxed."""
        for G, tau, decay, gain in zip(
            self._viscosity.moduli, self._viscosity.times, self._decays, self._gains, strict=True
        ):
            decay.Set(exp(-step / tau))
            gain.Set(-G * expm1(-step / tau) * tau / step)
        self._slope.Set(sum(gain.Get() for gain in self._gains))

    def work(self, F: CoefficientFunction, H: CoefficientFunction) -> CoefficientFunction:
        """Return Q : dCb/2 with the change dCb of Cb in the direction H (J/m3)."""
        Q, J = self._whole(F), Det(F)
        # P : H with P = J^(-2/3) F DEV Q takes half of the time of Q : dCb/2
        stress = J ** (-2 / 3) * (F * Q - InnerProduct(F * Q, F) / (3 * J) * Cof(F))
        return InnerProduct(stress, H)

    def held(self) -> Held:
        """Return what the elements hold and turn into heat in the present state, as the rates of the scheme have it."""
        F = self._place.F
        rate = change(F, self._place.rate(F))
        energy, power, heat = ng.CF(0.0), ng.CF(0.0), self._viscosity.kelvin_voigt / 2 * InnerProduct(rate, rate)
        for Q, G, tau in zip(self._elements(F), self._viscosity.moduli, self._viscosity.times, strict=True):
            squared, lost = InnerProduct(Q, Q) / (4 * G), InnerProduct(Q, Q) / (2 * G * tau)
            energy, power, heat = energy + squared, power + InnerProduct(Q, rate) / 2 - lost, heat + lost
        return Held(energy, power, heat)

    def _elements(self, F: CoefficientFunction) -> list[CoefficientFunction]:
        """Return Q of each element at F."""
        return [decay * Q + gain * (isochoric(F) - self._before)
                for Q, decay, gain in zip(self._Q, self._decays, self._gains, strict=True)]  # fmt: skip

    def _whole(self, F: CoefficientFunction) -> Any:
        """Return the sum of all elements and the dashpot; the strain at F enters once."""
        found = ng.CF(0.0)
        if self._Q:
            found = self._slope * (isochoric(F) - self._before)
            for Q, decay in zip(self._Q, self._decays, strict=True):
                found = found + decay * Q
        if self._viscosity.kelvin_voigt:
            dashpot = self._viscosity.kelvin_voigt * change(F, self._place.rate(F))
            found = found + dashpot if self._Q else dashpot
        return found


def isochoric(F: CoefficientFunction) -> CoefficientFunction:
    """Return Cb = J^(-2/3) F^T F (3x3)."""
    return Det(F) ** (-2 / 3) * (F.trans * F)


def change(F: CoefficientFunction, H: CoefficientFunction) -> CoefficientFunction:
    """Return the derivative of Cb at F in the direction H (3x3)."""
    J, once = Det(F), F.trans * H
    return J ** (-2 / 3) * (once + once.trans - 2 / 3 * InnerProduct(Cof(F), H) / J * (F.trans * F))
