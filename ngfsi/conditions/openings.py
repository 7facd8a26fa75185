"""Openings of vessels: given flow, given pressure, free of traction, and a resistance behind them.

Tractions are those of developed flow (Heywood, Rannacher and Turek, IJNMF 22, 1996): sigma n = -p n + mu L^T n. Blood
that comes back through an outlet enters with the developed profile of its flow; of what differs from that profile the
kinetic energy is taken out (after Bertoglio et al., IJNMBE 34, 2018).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Literal

import ngsolve as ng
import numpy as np
from ngsolve import GridFunction, Parameter

from ngfsi.arrays import Array, Numbers
from ngfsi.conditions.condition import Condition, OpeningModel, Setup, WithValue
from ngfsi.conditions.profiles import developed, inwards, oscillating, rim, womersley
from ngfsi.config.functions import FlowCurve, PressureConstant, PressureCurve
from ngfsi.errors import CaseError
from ngfsi.mesh.domain import Domain, elements_at
from ngfsi.mesh.geometry import Vessel
from ngfsi.physics import terms
from ngfsi.physics.fields import MOTION, VELOCITY, Fields
from ngfsi.physics.integrals import Integral
from ngfsi.physics.kinematics import Kinematics
from ngfsi.units import Resistance

Profile = Literal["developed", "flat", "womersley"]


class Opening(WithValue):
    """What acts at an opening of a vessel.

    Attributes:
        opening: boundary of the blood.
        vessel: whose it is.
        outwards: whether flow out of the vessel counts as positive.
    """

    def __init__(self, domain: Domain, opening: str, vessel: Vessel, curve: Callable[[float], float]) -> None:
        super().__init__(opening, curve)
        self.domain, self.opening, self.vessel = domain, opening, vessel
        assert vessel.lumen is not None
        self.lumen = vessel.lumen
        self.outwards = opening in vessel.outlets

    def attach(self, setup: Setup) -> None:
        """Take what it acts on."""
        self._setup = setup
        self.flux = flux_through(setup.fields(setup.state), self.domain, self.opening, self.lumen)

    def outflow(self) -> float:
        """Return the flow (m3/s) of the present state out of the moving opening."""
        return float(ng.Integrate(self.flux, self.domain.mesh))

    def _profile(self) -> GridFunction:
        """Return developed flow into the vessel as a relative velocity, up to a factor; zero away from the opening."""
        geometry, field = self.domain.geometry, GridFunction(self._setup.unknowns.space)
        given = geometry.inflow() if self.opening == "inlet" else None
        if given is None:
            face = developed(self.domain, self.opening, self._setup.order)
            self._set(field, face * inwards(self.domain, self.opening, self.lumen))
        else:
            self._set(field, given, dual=False)
        return field

    def _inflow_of(self, field: GridFunction) -> Any:
        """Return the integral of the flow (m3/s) of a relative velocity through the moving opening, of either sign."""
        motion, normal = Kinematics(ng.Grad(self._setup.state[MOTION])), ng.specialcf.normal(self.domain.mesh.dim)
        measure = self.domain.ds(self.opening, bonus_intorder=2 * self._setup.order)
        velocity = field.components[self._setup.unknowns.place(VELOCITY)]
        return terms.relative_flux(motion, velocity, normal) * measure

    def _size(self, flux: Any) -> float:
        return float(abs(ng.Integrate(flux, self.domain.mesh)))

    def _set(self, field: GridFunction, velocity: Any, *, dual: bool = True) -> None:
        """Give the relative velocity values on the opening; `dual`: exact, if they are of the velocity's space."""
        place, face = self._setup.unknowns.place(VELOCITY), self.domain.boundaries(self.opening)
        field.components[place].Set(velocity, definedon=face, bonus_intorder=4, dual=dual)


def flux_through(fields: Fields, domain: Domain, opening: str, lumen: str) -> Any:
    """Return the integral of the flow out of the blood through a moving opening (m3/s)."""
    normal = domain.outward_normal(lumen) if domain.mesh.dim == 3 else ng.specialcf.normal(2)
    flux = terms.relative_flux(Kinematics(fields.grad_motion), fields.relative, normal)
    return flux * domain.ds(opening, bonus_intorder=2 * fields.motion.space.globalorder)


class GivenFlow(Opening):
    """A flow: its profile on the opening, scaled such that the flux through the deformed opening is the one wanted."""

    def __init__(
        self, domain: Domain, opening: str, vessel: Vessel, curve: Callable[[float], float], profile: Profile
    ) -> None:
        super().__init__(domain, opening, vessel, curve)
        self._kind = profile

    def velocity_on(self) -> tuple[str, ...]:
        """Return the opening."""
        return (self.opening,)

    def attach(self, setup: Setup) -> None:
        """Take what it acts on."""
        super().attach(setup)
        self._numbers = setup.unknowns.on_opening[self.opening]
        self._field = self._flat() if self._kind == "flat" else self._profile()
        self._shape = self._values(self._field)
        self._flux = self._inflow_of(self._field)
        self._wave: Callable[[float], Array] | None = None
        if self._kind == "womersley":
            self._wave = self._oscillating()
        self._time, self._factor = 0.0, 1.0

    def _values(self, field: GridFunction) -> Array:
        return np.array(field.vec.FV().NumPy()[self._numbers])

    def _flat(self) -> GridFunction:
        field = GridFunction(self._setup.unknowns.space)
        self._set(field, inwards(self.domain, self.opening, self.lumen))
        component = field.components[self._setup.unknowns.place(VELOCITY)]
        for number in np.flatnonzero(list(rim(self.domain, self.opening, component.space))):
            component.vec[int(number)] = 0.0
        return field

    def _oscillating(self) -> Callable[[float], Array]:
        """Return Womersley's profile over time, without the mean of the flow."""
        period = getattr(self.curve, "period", None)
        if period is None:
            raise CaseError(
                f"profile = 'womersley' at '{self.opening}' needs a periodic flow, of kind 'harmonics' or 'waveform'"
            )
        fluid = self._setup.fluid
        assert fluid is not None
        into = inwards(self.domain, self.opening, self.lumen)

        def profile_of(omega: float) -> tuple[Array, complex]:
            parameter = fluid.density * omega / fluid.nominal_viscosity
            face = womersley(self.domain, self.opening, self._setup.order, parameter)
            values, flux = [], []
            for part in (face.real, face.imag):
                self._set(self._field, part * into)
                values.append(self._values(self._field))
                flux.append(self._size(self._flux))
            signs = [np.sign(float(ng.Integrate(part * self.domain.ds(self.opening), self.domain.mesh)))
                     for part in (face.real, face.imag)]  # fmt: skip
            return values[0] + 1j * values[1], complex(signs[0] * flux[0], signs[1] * flux[1])

        found = oscillating(self.curve, period, profile_of)
        self._set(self._field, developed(self.domain, self.opening, self._setup.order) * into)
        self._shape = self._values(self._field)
        return found

    def prescribed(self) -> Numbers:
        """Return the unknowns of the velocity on the opening."""
        return np.asarray(self._numbers)

    def update(self, t: float, load_factor: float = 1.0) -> None:
        """Take the flow of time t (s), or a fraction of it."""
        super().update(t, load_factor)
        self._time, self._factor = t, load_factor

    def prescribe(self, values: Array) -> None:
        """Scale the profile to the deformed opening."""
        wanted = -self.value.Get() if self.outwards else self.value.Get()
        if self._wave is None:
            values[self._numbers] = self._shape * (wanted / self._size(self._flux))
            return
        sign = -self._factor if self.outwards else self._factor
        waves = sign * self._wave(self._time)
        values[self._numbers] = waves
        left = wanted + self.outflow()
        values[self._numbers] += self._shape * (left / self._size(self._flux))

    def flow_scale(self) -> float:
        """Return the size of the present flow."""
        return float(abs(self.value.Get()))

    def sentence(self) -> str:
        """Return what acts now."""
        return f"{self.value.Get():.4g} m3/s through '{self.opening}'"


class Traction(Opening):
    """A pressure at an opening (Pa)."""

    def __init__(
        self, domain: Domain, opening: str, vessel: Vessel, curve: Callable[[float], float], *, developed: bool = True
    ) -> None:
        super().__init__(domain, opening, vessel, curve)
        self._developed = developed
        self._entering = Parameter(0.0)
        self._back: GridFunction | None = None

    def attach(self, setup: Setup) -> None:
        """Take what it acts on."""
        super().attach(setup)
        self._reference = setup.references[self.vessel.name].value
        if self.outwards:  # at an inlet blood is meant to enter with its energy
            self._back = self._profile()
            self._back_flux = self._inflow_of(self._back)

    def pressure(self) -> Any:
        """Return the pressure beyond the reference of the vessel (Pa), as a function of the unknowns."""
        return self.value - self._reference

    def given_pressure(self) -> float:
        """Return the present pressure at the opening (Pa)."""
        return float(self.value.Get())

    def integrals(self, elements: ng.BitArray | None) -> list[Integral]:
        """Return the virtual work of the traction, over the boundaries of the elements there.

        NGSolve's own over a boundary with the whole gradient (`skeleton`) takes all elements, and room for them.
        """
        setup = self._setup
        fields = setup.fields(setup.trial)
        k, v = Kinematics(fields.grad_motion), setup.test[MOTION]
        work = self._traction(fields, k, v)
        found = [through(setup.domain, self.lumen, self.opening, work, elements)]
        if self._back is not None:
            entering = self._entering * self._back.components[setup.unknowns.place(VELOCITY)]
            normal, difference = ng.specialcf.normal(setup.domain.mesh.dim), fields.velocity - entering
            work = terms.backflow(setup.blood_density, k, difference, fields.relative, normal, v)
            # one order more, for the product of three velocities: 4e-4 of the force become 1e-7
            found.append(through(setup.domain, self.lumen, self.opening, work, elements, bonus=1))
        return found

    def blood_integrals(self, elements: ng.BitArray | None) -> list[Integral]:
        """Return the virtual work of the traction, which acts on the blood."""
        return Traction.integrals(self, elements)

    def _traction(self, f: Fields, k: Kinematics, v: Any) -> Any:
        setup, normal = self._setup, ng.specialcf.normal(self.domain.mesh.dim)
        assert setup.fluid is not None
        if self._developed:
            return terms.opening(setup.fluid, self.pressure(), k, f.grad_velocity, normal, v)
        return terms.follower_pressure(self.pressure(), k, normal, v)

    def prescribe(self, _values: Array) -> None:
        """Take the flow with which blood comes back through an outlet."""
        if self._back is not None:
            self._entering.Set(max(0.0, -self.outflow()) / self._size(self._back_flux))

    def state_arrays(self) -> dict[str, Array]:
        """Return the present value, and the factor on the profile with which blood comes back."""
        return {"value": np.array([self.value.Get(), self._entering.Get()])}

    def restore_state(self, arrays: Mapping[str, Array]) -> None:
        """Take these."""
        value, entering = map(float, arrays["value"])
        self.value.Set(value)
        self._entering.Set(entering)

    def pressure_scale(self) -> float:
        """Return the pressure beyond the reference."""
        return float(abs(self.value.Get() - self._reference.Get()))

    def sentence(self) -> str:
        """Return what acts now."""
        return f"{self.value.Get():.4g} Pa at '{self.opening}'"


class ResistiveTraction(Traction):
    """A resistance behind an opening: p = p0 + R Q, with the flow Q out of the vessel; p - p0 is an unknown."""

    def __init__(
        self, domain: Domain, opening: str, vessel: Vessel, curve: Callable[[float], float], resistance: float
    ) -> None:
        super().__init__(domain, opening, vessel, curve)
        self.resistance = resistance
        self.unknown = f"{opening}_pressure"

    def given_pressure(self) -> float:
        """Return the present pressure at the opening (Pa)."""
        return super().given_pressure() + float(self._setup.state[self.unknown].vec[0])

    def own_unknowns(self) -> dict[str, float]:
        """Return the pressure beyond p0."""
        return {self.unknown: 1.0}

    def pressure(self) -> Any:
        """Return the pressure beyond the reference of the vessel (Pa)."""
        return super().pressure() + self._setup.trial[self.unknown]

    def integrals(self, elements: ng.BitArray | None) -> list[Integral]:
        """Return the virtual work of the traction, and the law of the resistance."""
        return [
            *super().integrals(elements),
            *self.law(self._setup.trial[self.unknown], self._setup.test[self.unknown]),
        ]

    def law(self, p: Any, q: Any) -> list[Integral]:
        """Return p - p0 - R Q = 0, tested with q, as an integral over the opening."""
        setup = self._setup
        if not setup.leads:
            return []
        fields, area = setup.fields(setup.trial), self.domain.area(self.opening)
        normal = self.domain.outward_normal(self.lumen)
        flux = terms.relative_flux(Kinematics(fields.grad_motion.Trace()), fields.relative.Trace(), normal)
        balance = (p / area - self.resistance * flux) * q
        return [Integral([balance], self.domain.ds(self.opening, bonus_intorder=2 * setup.order))]


def through(
    domain: Domain, lumen: str, boundary: str, integrand: Any, elements: ng.BitArray | None, bonus: int = 0
) -> Integral:
    """Return an integrand, which may hold the whole gradient, on a boundary of the blood, the normal pointing out."""
    face = GridFunction(ng.FacetFESpace(domain.mesh, order=0))
    face.Set(1, definedon=domain.boundaries(boundary))
    near = elements_at(domain, lumen, boundary)
    if elements is not None:
        near &= elements
    measure = domain.dx(lumen, element_boundary=True, definedonelements=near, bonus_intorder=bonus)
    return Integral([face * integrand], measure)


class FlowOpening(OpeningModel):
    """A flow over time: into the vessel at an inlet, out of it at an outlet."""

    kind: Literal["flow"] = "flow"
    flow: FlowCurve
    profile: Profile = "developed"
    """developed: that of steady flow in a cylinder over the opening; womersley: of a periodic flow in it; or flat."""

    def condition(self, domain: Domain, opening: str, vessel: Vessel) -> Condition:
        """Return the condition at an opening."""
        return GivenFlow(domain, opening, vessel, self.flow, self.profile)


class PressureOpening(OpeningModel):
    """A pressure over time."""

    kind: Literal["pressure"] = "pressure"
    pressure: PressureCurve

    def condition(self, domain: Domain, opening: str, vessel: Vessel) -> Condition:
        """Return the condition at an opening."""
        return Traction(domain, opening, vessel, self.pressure)

    def reference(self) -> Callable[[float], float]:
        """Return the pressure."""
        return self.pressure


class FreeOpening(OpeningModel):
    """Free of traction: sigma n = 0."""

    kind: Literal["free"] = "free"

    def condition(self, domain: Domain, opening: str, vessel: Vessel) -> Condition:
        """Return the condition at an opening."""
        return Traction(domain, opening, vessel, _nothing, developed=False)

    def reference(self) -> Callable[[float], float]:
        """Return a pressure of 0."""
        return _nothing


class ResistanceOpening(OpeningModel):
    """A resistance R between the opening and a pressure p0: p = p0 + R Q, Q out of the vessel."""

    kind: Literal["resistance"] = "resistance"
    resistance: Resistance
    distal_pressure: PressureCurve = PressureConstant(value=0.0)

    def condition(self, domain: Domain, opening: str, vessel: Vessel) -> Condition:
        """Return the condition at an opening."""
        return ResistiveTraction(domain, opening, vessel, self.distal_pressure, self.resistance)

    def reference(self) -> Callable[[float], float]:
        """Return the pressure behind the resistance."""
        return self.distal_pressure


def _nothing(_t: float) -> float:
    return 0.0
