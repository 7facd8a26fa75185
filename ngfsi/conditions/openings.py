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
from pydantic import Field

from ngfsi.arrays import Array, Numbers
from ngfsi.conditions.condition import Condition, OpeningModel, Setup, WithValue
from ngfsi.conditions.profiles import SAMPLES, developed, developed_of_law, inwards, oscillating, rim, womersley
from ngfsi.config.functions import FlowCurve, PressureConstant, PressureCurve
from ngfsi.errors import CaseError
from ngfsi.mesh.domain import Domain, elements_behind
from ngfsi.mesh.geometry import Vessel
from ngfsi.physics import terms
from ngfsi.physics.fields import MOTION, VELOCITY, Fields, Named
from ngfsi.physics.integrals import Integral, OverFaces
from ngfsi.physics.kinematics import Kinematics
from ngfsi.units import Compliance, Resistance

Profile = Literal["developed", "flat", "womersley"]
NOTHING = PressureConstant(value=0.0)
SMOOTH = 1.0
"""Pressure across a valve (Pa) over which it opens."""


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
        self.lumen, self.outwards = str(vessel.lumen), opening in vessel.outlets

    def attach(self, setup: Setup) -> None:
        super().attach(setup)
        self.flux = self._outflow_of(setup.state[VELOCITY])

    def outflow(self) -> float:
        """Return the flow (m3/s) of the present state out of the moving opening."""
        return self._integral(self.flux)

    def _outflow_of(self, velocity: Any) -> Any:
        """Return the integral of the flow (m3/s) of a relative velocity out of the moving opening."""
        normal = self.domain.outward_normal(self.lumen)
        flux = terms.relative_flux(Kinematics(ng.Grad(self._setup.state[MOTION])), velocity, normal)
        return flux * self.domain.ds(self.opening, bonus_intorder=2 * self._setup.unknowns.order)

    def _integral(self, integral: Any) -> float:
        return float(ng.Integrate(integral, self.domain.mesh))

    def _profile(self) -> GridFunction:
        """Return developed flow into the vessel as a relative velocity, up to a factor; zero away from the opening.

        It is that of a constant viscosity.
        """
        given = self.domain.geometry.inflow() if self.opening == "inlet" else None
        return self._computed() if given is None else self._on_opening(given, dual=False)

    def _computed(self) -> GridFunction:
        face = developed(self.domain, self.opening, self._setup.unknowns.order)
        return self._on_opening(face * inwards(self.domain, self.opening, self.lumen))

    def _thinning(self, flow: float) -> GridFunction:
        """Return developed flow (m3/s) of the blood's own law as a relative velocity; zero away from the opening."""
        fluid = self._setup.fluid
        assert fluid is not None
        face = developed_of_law(self.domain, self.opening, self._setup.unknowns.order, fluid, flow)
        return self._on_opening(face * inwards(self.domain, self.opening, self.lumen))

    def _on_opening(self, velocity: Any, *, dual: bool = True) -> GridFunction:
        """Return a field of all unknowns with a relative velocity on the opening alone.

        Args:
            dual: whether the velocity is of the space of the unknowns, and is to be taken exactly.
        """
        field, face = GridFunction(self._setup.unknowns.space), self.domain.boundaries(self.opening)
        self._velocity_of(field).Set(velocity, definedon=face, bonus_intorder=4, dual=dual)
        return field

    def _velocity_of(self, field: GridFunction) -> GridFunction:
        return field.components[self._setup.unknowns.place(VELOCITY)]


class GivenFlow(Opening):
    """A flow: its profile on the opening, scaled such that the flux through the deformed opening is the one wanted.

    The developed profile of blood that thins depends on the flow: those of flows a factor of 2 apart are computed when
    they are needed, and taken in proportion to the logarithm in between.
    """

    def __init__(
        self, domain: Domain, opening: str, vessel: Vessel, curve: Callable[[float], float], profile: Profile
    ) -> None:
        super().__init__(domain, opening, vessel, curve)
        self._kind = profile
        self._time, self._factor = 0.0, 1.0
        self._by_flow: dict[int, tuple[Array, Any]] = {}
        self._scaled: tuple[Array, float] = (np.zeros(0), 1.0)
        self._outflow_form: Any = None

    def velocity_on(self) -> tuple[str, ...]:
        return (self.opening,)

    def attach(self, setup: Setup) -> None:
        super().attach(setup)
        self._numbers = setup.unknowns.on_opening[self.opening]
        profiles = {"developed": self._profile, "flat": self._flat, "womersley": self._computed}
        self._shape = self._with_flux(profiles[self._kind]())
        self._wave = self._oscillating() if self._kind == "womersley" else None

    def _with_flux(self, field: GridFunction) -> tuple[Array, Any]:
        return self._values(field), self._outflow_of(self._velocity_of(field))

    def _shapes(self, flow: float) -> list[tuple[float, Array, Any]]:
        """Return profiles into the vessel at a flow (m3/s): weight, values and flux of each."""
        fluid = self._setup.fluid
        if fluid is None or fluid.newtonian or self._kind == "flat" or flow == 0:
            return [(1.0, *self._shape)]
        number, fraction = divmod(float(np.log2(abs(flow) / self._slowest())), 1.0)
        number, fraction = (int(number), fraction) if number >= 0 else (0, 0.0)
        weights = {number: 1 - fraction, number + 1: fraction}
        for one in weights.keys() - self._by_flow.keys():
            self._by_flow[one] = self._with_flux(self._thinning(2.0**one * self._slowest()))
        return [(weight / 2.0**one, *self._by_flow[one]) for one, weight in weights.items()]

    def _slowest(self) -> float:
        """Return the flow (m3/s) below which the profile stays: a mean velocity of 0.1 % of the size a second."""
        return 1e-3 * self.domain.geometry.size * self.domain.area(self.opening)

    def _values(self, field: GridFunction) -> Array:
        return np.array(field.vec.FV().NumPy()[self._numbers])

    def _flat(self) -> GridFunction:
        field = self._on_opening(inwards(self.domain, self.opening, self.lumen))
        velocity = self._velocity_of(field)
        for number in np.flatnonzero(list(rim(self.domain, self.opening, velocity.space))):
            velocity.vec[int(number)] = 0.0
        return field

    def _oscillating(self) -> Callable[[float], Array]:
        """Return Womersley's profile over time, without the mean of the flow.

        Blood that thins has the viscosity of the mean of the flow's size, developed.
        """
        period = getattr(self.curve, "period", None)
        if period is None:
            raise CaseError(
                f"profile = 'womersley' at '{self.opening}' needs a periodic flow, of kind 'harmonics' or 'waveform'"
            )
        fluid, area = self._setup.fluid, self.domain.area(self.opening)
        assert fluid is not None
        flow = np.mean([abs(self.curve(float(t))) for t in np.linspace(0, period, SAMPLES, endpoint=False)])
        viscosity = fluid.developed_viscosity(4 * flow / (np.pi * (area / np.pi) ** 1.5))
        into = inwards(self.domain, self.opening, self.lumen)

        def profile_of(omega: float) -> tuple[Array, complex]:
            parameter = float(fluid.density * omega / viscosity)
            face = womersley(self.domain, self.opening, self._setup.unknowns.order, parameter)
            parts = [self._on_opening(part * into) for part in (face.real, face.imag)]
            values = [self._values(part) for part in parts]
            fluxes = [-self._integral(self._outflow_of(self._velocity_of(part))) for part in parts]
            return values[0] + 1j * values[1], complex(*fluxes)

        return oscillating(self.curve, period, profile_of)

    def prescribed(self) -> Numbers:
        return np.asarray(self._numbers)

    def update(self, t: float, load_factor: float = 1.0) -> None:
        super().update(t, load_factor)
        self._time, self._factor = t, load_factor

    def prescribe(self, values: Array) -> None:
        """Scale the profile to the deformed opening."""
        sign, left = (-1.0 if self.outwards else 1.0), self.value.Get()
        values[self._numbers] = 0.0
        if self._wave is not None:
            values[self._numbers] = sign * self._factor * self._wave(self._time)
            left += sign * self.outflow()
        self._scaled = shape, flux = self._profile_at(left)
        values[self._numbers] += shape * (sign * left / flux)

    def _profile_at(self, flow: float) -> tuple[Array, float]:
        """Return the profile into the vessel at a flow (m3/s), and its flux in the present shape."""
        shapes = self._shapes(flow)
        flux = -sum(weight * self._integral(one) for weight, _, one in shapes)
        return np.asarray(sum(weight * shape for weight, shape, _ in shapes)), flux

    def pull_back(self, factors: Array) -> Array:
        """Return the derivative by the shape of the opening: by the scaled profile what it changes of the flux is made
        up for."""
        shape, flux = self._scaled
        found = np.zeros(len(factors))
        by_motion = self._by_motion()
        found[: len(by_motion)] = (factors[self._numbers] @ shape) / flux * by_motion
        return found

    def _by_motion(self) -> Array:
        """Return the derivative of the present outflow (m3/s) by the unknowns of the motion."""
        motion, velocity = self._setup.state[MOTION], self._setup.state[VELOCITY]
        if self._outflow_form is None:
            k, normal = (
                Kinematics(ng.Grad(motion.space.TrialFunction()).Trace()),
                self.domain.outward_normal(self.lumen),
            )
            over = self.domain.ds(self.opening, bonus_intorder=2 * self._setup.unknowns.order)
            self._outflow_form = ng.BilinearForm(motion.space, nonassemble=True, check_unused=False)
            self._outflow_form += ng.Variation(terms.relative_flux(k, velocity.Trace(), normal) * over)
        result = motion.vec.CreateVector()
        self._outflow_form.Apply(motion.vec, result)
        return np.array(result.FV().NumPy())

    def flow_scale(self) -> float:
        return float(abs(self.value.Get()))

    def sentence(self) -> str:
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
        self._beside: ng.BilinearForm | None = None

    def attach(self, setup: Setup) -> None:
        super().attach(setup)
        self._reference = setup.references[self.vessel.name].value
        if self.outwards:  # at an inlet blood is meant to enter with its energy
            self._back = self._velocity_of(self._profile())
            self._back_flux = self._outflow_of(self._back)

    def pressure(self) -> Any:
        """Return the pressure beyond the reference of the vessel (Pa), as a function of the unknowns."""
        return self.value - self._reference

    def given_pressure(self) -> float:
        """Return the present pressure at the opening (Pa)."""
        return float(self.value.Get())

    def integrals(self, elements: ng.BitArray | None) -> list[Integral]:
        return self.blood_integrals(elements)

    def blood_integrals(self, elements: ng.BitArray | None) -> list[Integral]:
        """Return the virtual work of the traction, which acts on the blood, over the boundaries of the elements there.

        NGSolve's own over a boundary with the whole gradient (`skeleton`) takes all elements, and room for them.
        """
        setup = self._setup
        return self._works(setup.fields(setup.trial), setup.test[MOTION], elements)

    def integrals_of(self, fields: Fields, test: Named, elements: ng.BitArray | None) -> list[Integral] | None:
        """Return them unless the pressure is an unknown."""
        return None if self.own_unknowns() else self._works(fields, test[MOTION], elements)

    def _works(self, f: Fields, v: Any, elements: ng.BitArray | None) -> list[Integral]:
        setup, domain, normal = self._setup, self.domain, ng.specialcf.normal(self.domain.mesh.dim)
        k = Kinematics(f.grad_motion)
        if self._developed:
            assert setup.fluid is not None
            work = terms.opening(setup.fluid, self.pressure(), k, f.grad_velocity, normal, v)
        else:
            work = terms.follower_pressure(self.pressure(), k, normal, v)
        found: list[Integral] = [through(domain, self.lumen, self.opening, work, elements)]
        if self._back is not None:
            difference = f.velocity - self._entering * self._back
            work = terms.backflow(setup.blood_density, k, difference, f.relative, normal, v)
            # one order more, for the product of three velocities: 4e-4 of the force become 1e-7
            found.append(through(domain, self.lumen, self.opening, work, elements, bonus=1))
        return found

    def prescribe(self, _values: Array) -> None:
        """Take the flow with which blood comes back through an outlet."""
        if self._back is not None:
            self._entering.Set(max(0.0, -self.outflow()) / -self._integral(self._back_flux))

    def followers(self) -> list[tuple[Parameter, Array]]:
        """Return the factor on the profile with which blood comes back: it is 0 while none does."""
        if self._back is None or not self._entering.Get():
            return []
        setup, space = self._setup, self._setup.unknowns.space
        if self._beside is None:
            k = Kinematics(ng.Grad(setup.trial[MOTION]).Trace())
            velocity = setup.trial[VELOCITY].Trace() - self._entering * self._back.Trace()
            flux = terms.relative_flux(k, velocity, self.domain.outward_normal(self.lumen))
            over = self.domain.ds(self.opening, bonus_intorder=2 * setup.unknowns.order)
            self._beside = ng.BilinearForm(space, nonassemble=True, check_unused=False)
            self._beside += ng.Variation(flux * over)
        state = GridFunction(space)
        for part, present in zip(state.components, setup.state.values(), strict=True):
            part.vec.data = present.vec
        slopes = state.vec.CreateVector()
        self._beside.Apply(state.vec, slopes)
        return [(self._entering, np.array(slopes.FV().NumPy()) / self._integral(self._back_flux))]

    def state_arrays(self) -> dict[str, Array]:
        """Return the present value, and the factor on the profile with which blood comes back."""
        return {"value": np.array([self.value.Get(), self._entering.Get()])}

    def restore_state(self, arrays: Mapping[str, Array]) -> None:
        super().restore_state(arrays)
        self._entering.Set(float(arrays["value"][1]))

    def pressure_scale(self) -> float:
        return float(abs(self.value.Get() - self._reference.Get()))

    def sentence(self) -> str:
        return f"{self.value.Get():.4g} Pa at '{self.opening}'"


class ResistiveTraction(Traction):
    """A resistance behind an opening: p = p0 + R Q, with the flow Q out of the vessel; p - p0 is an unknown.

    With a valve the pressure across it drives dp + sqrt(dp^2 + 1 Pa^2) over 2 R towards the heart, and back hardly
    anything but a leak that is a fraction of dp / R.
    """

    def __init__(
        self, domain: Domain, opening: str, vessel: Vessel, curve: Callable[[float], float], resistance: float,
        leakage: float | None = None,
    ) -> None:  # fmt: skip
        """Prepare; `leakage`: of a valve; None: there is none."""
        super().__init__(domain, opening, vessel, curve)
        self.resistance, self._leakage = resistance, leakage
        self.unknown = f"{opening}_pressure"

    def given_pressure(self) -> float:
        return super().given_pressure() + float(self._setup.state[self.unknown].vec[0])

    def flow_scale(self) -> float:
        """Return the present flow, up to that of an open vessel, which the pressure behind the resistance drives."""
        most = self.pressure_scale() / self.resistance if self.resistance else np.inf
        return min(abs(self.outflow()), most)

    def own_unknowns(self) -> dict[str, float]:
        return {self.unknown: 1.0}

    def pressure(self) -> Any:
        return super().pressure() + self._setup.trial[self.unknown]

    def integrals(self, elements: ng.BitArray | None) -> list[Integral]:
        """Return the virtual work of the traction, and the law of what is behind the opening."""
        law = self.law(self._setup.trial[self.unknown], self._setup.test[self.unknown]) if self._setup.leads else []
        return [*super().integrals(elements), *law]

    def law(self, p: Any, q: Any) -> list[Integral]:
        """Return p - p0 - R Q = 0, tested with q, as an integral over the opening."""
        return [self._balance(self._driven_by(p), -self.resistance, q)]

    def _driven_by(self, drop: Any) -> Any:
        """Return R Q under a pressure across the resistance: the pressure itself, or what a valve lets through."""
        if self._leakage is None:
            return drop
        ahead = 1 if self.outwards else -1
        let_through = (ahead * drop + ng.sqrt(drop * drop + SMOOTH**2)) / 2
        return self._leakage * drop + (1 - self._leakage) * ahead * let_through

    def _balance(self, pressure: Any, factor: float, q: Any) -> Integral:
        """Return a + b Q, of a pressure a (Pa) and a factor b on the flow out of the vessel, tested with q."""
        setup = self._setup
        fields, normal = setup.fields(setup.trial), self.domain.outward_normal(self.lumen)
        flux = terms.relative_flux(Kinematics(fields.grad_motion.Trace()), fields.relative.Trace(), normal)
        balance = (pressure / self.domain.area(self.opening) + factor * flux) * q
        return Integral([balance], self.domain.ds(self.opening, bonus_intorder=2 * setup.unknowns.order))


class WindkesselTraction(ResistiveTraction):
    """A resistance Rp before a compliance C with a resistance Rd behind it (Westerhof's three elements).

    p = p0 + ps + Rp Q and C dps/dt = Q - ps / Rd, with the pressure ps in the compliance as another unknown; at the
    start all is in steady flow.
    """

    def __init__(self, domain: Domain, opening: str, vessel: Vessel, model: WindkesselOpening) -> None:
        super().__init__(domain, opening, vessel, model.distal_pressure, model.resistance, model.valve_leakage)
        self._stored, self._compliance = f"{opening}_stored_pressure", model.compliance
        self._distal = model.distal_resistance

    def own_unknowns(self) -> dict[str, float]:
        return {**super().own_unknowns(), self._stored: 1.0}

    def columns(self) -> dict[str, Callable[[], float]]:
        """Return the pressure in the compliance (Pa)."""
        return {f"pressure_stored_{self.opening}_Pa": lambda: self.value.Get() + self._setup.state[self._stored].vec[0]}

    def law(self, p: Any, q: Any) -> list[Integral]:
        setup, stored = self._setup, self._setup.trial[self._stored]
        rate = setup.new_weight * stored + setup.velocity_history[self._stored]
        held = self._distal * self._compliance * rate + stored
        return [*super().law(p - stored, q), self._balance(held, -self._distal, setup.test[self._stored])]


def through(
    domain: Domain, lumen: str, boundary: str, integrand: Any, elements: ng.BitArray | None, bonus: int = 0
) -> OverFaces:
    """Return an integrand, which may hold the whole gradient, on a boundary of the blood, the normal pointing out."""
    face = GridFunction(ng.FacetFESpace(domain.mesh, order=0))
    face.Set(1, definedon=domain.boundaries(boundary))
    near = elements_behind(domain, lumen, boundary)
    if elements is not None:
        near &= elements
    measure = domain.dx(lumen, element_boundary=True, definedonelements=near, bonus_intorder=bonus)
    return OverFaces([face * integrand], measure)


class FlowOpening(OpeningModel):
    """A flow over time: into the vessel at an inlet, out of it at an outlet."""

    kind: Literal["flow"] = "flow"
    flow: FlowCurve
    """Into the vessel at an inlet, out of it at an outlet, relative to the moving opening."""
    profile: Profile = "developed"
    """developed: that of steady flow in a cylinder over the opening; womersley: of a periodic flow in it; or flat."""

    def condition(self, domain: Domain, opening: str, vessel: Vessel) -> Condition:
        return GivenFlow(domain, opening, vessel, self.flow, self.profile)


class PressureOpening(OpeningModel):
    """A pressure over time."""

    kind: Literal["pressure"] = "pressure"
    pressure: PressureCurve
    """Over time."""

    def condition(self, domain: Domain, opening: str, vessel: Vessel) -> Condition:
        return Traction(domain, opening, vessel, self.pressure)

    def reference(self) -> Callable[[float], float]:
        return self.pressure


class FreeOpening(OpeningModel):
    """Free of traction: sigma n = 0."""

    kind: Literal["free"] = "free"

    def condition(self, domain: Domain, opening: str, vessel: Vessel) -> Condition:
        return Traction(domain, opening, vessel, NOTHING, developed=False)

    def reference(self) -> Callable[[float], float]:
        return NOTHING


class Resistive(OpeningModel):
    """What has a resistance R right behind the opening, and in the end a known pressure."""

    resistance: Resistance
    """Pressure over flow, of a windkessel before its compliance."""
    distal_pressure: PressureCurve = NOTHING
    """Behind the resistance."""
    valve_leakage: float | None = Field(default=None, gt=0, lt=1)
    """With a valve that opens towards the heart, in at an inlet and out at an outlet: the flow back over that ahead
    under the same pressure, e.g. 1e-3; default: no valve."""

    def reference(self) -> Callable[[float], float] | None:
        """Return the distal pressure, from which the vessel's may be far away behind a closed valve."""
        return self.distal_pressure if self.valve_leakage is None else None


class ResistanceOpening(Resistive):
    """A resistance R between the opening and a pressure p0: p = p0 + R Q, Q out of the vessel.

    At an inlet that is a source of pressure p0, whose flow stops as the vessel closes.
    """

    kind: Literal["resistance"] = "resistance"

    def condition(self, domain: Domain, opening: str, vessel: Vessel) -> Condition:
        return ResistiveTraction(domain, opening, vessel, self.distal_pressure, self.resistance, self.valve_leakage)


class WindkesselOpening(Resistive):
    """A resistance, and behind it a compliance with a `distal_resistance` to the pressure p0."""

    kind: Literal["windkessel"] = "windkessel"
    compliance: Compliance = Field(gt=0)
    """Volume that is stored behind the resistance over its pressure."""
    distal_resistance: Resistance = Field(gt=0)
    """From the compliance to the distal pressure."""

    def condition(self, domain: Domain, opening: str, vessel: Vessel) -> Condition:
        return WindkesselTraction(domain, opening, vessel, self)
