"""Loads: pressures on the skin, of cuffs, of the blood on walls and in holes of plane sections; forces on regions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from math import pi
from typing import Any, Literal, Self

import ngsolve as ng
from pydantic import Field, model_validator

from ngfsi.conditions.condition import ConditionModel, Setup, WithValue, check_components
from ngfsi.conditions.openings import through
from ngfsi.config.functions import FactorConstant, FactorCurve, FactorRamp, PressureCurve
from ngfsi.config.model import ConfigModel
from ngfsi.errors import CaseError, unknown
from ngfsi.mesh.domain import Domain
from ngfsi.mesh.geometry import Vessel
from ngfsi.mesh.girth import Girth
from ngfsi.physics import terms
from ngfsi.physics.fields import MOTION, PRESSURE
from ngfsi.physics.integrals import Integral
from ngfsi.physics.kinematics import Kinematics
from ngfsi.units import Acceleration, Angle, Length, Tension

SKIN = "skin"
"""Boundary on which stockings and sleeves press."""


class Cuff(ConfigModel):
    """A pressure on a part of the skin, over time: of a stocking's zone, or of one chamber of a pneumatic sleeve.

    It is whole inside the part, and falls smoothly to zero over `edge`, half of it outside.
    """

    pressure: PressureCurve
    """Inside the part, over time."""
    start: Length
    """z where it begins, on the reference shape."""
    end: Length
    """z where it ends."""
    direction: Angle = 0.0
    """Of its middle, around the axis of the segment from x (lateral) to y (anterior)."""
    half_width: Angle | None = Field(default=None, gt=0, lt=pi)
    """Angle from the middle to either side; None: all around."""
    edge: Length = Field(default=5e-3, gt=0)
    """Length over which the pressure falls to zero at both ends."""

    @model_validator(mode="after")
    def _has_a_height(self) -> Self:
        if self.end - self.start < self.edge:
            raise ValueError(
                f"a cuff from z = {self.start:g} m to {self.end:g} m is lower than its edge, {self.edge:g} m"
            )
        return self

    def weight(self) -> Any:
        """Return the fraction of its pressure that acts at a point of the skin."""
        return terms.part_of_skin(self.start, self.end, self.edge, self.direction, self.half_width)


class PressureOn(WithValue):
    """A pressure on boundaries, normal to their deformed shape (Pa), times a function of place."""

    def __init__(
        self, name: str, domain: Domain, boundaries: tuple[str, ...], curve: Callable[[float], float],
        weight: Any = None,
    ) -> None:  # fmt: skip
        super().__init__(name, curve)
        self.boundaries, self._domain = boundaries, domain
        self.pressure = self.value if weight is None else self.value * weight

    @property
    def on_skin(self) -> bool:
        """Whether it acts on the skin."""
        return self.boundaries == (SKIN,)

    def static_integrals(self, m: Any, v: Any) -> list[Integral]:
        domain, grad_m = self._domain, ng.Grad(m)
        if domain.mesh.dim == 3:
            k = self._kinematics(grad_m.Trace())
            work = terms.follower_pressure(self.pressure, k, domain.outer_normal(), v.Trace())
            return [Integral([work], domain.ds(*self.boundaries))]
        # around holes of the plane the normal is outward only as the elements' own
        k = self._kinematics(grad_m)
        integrand = terms.follower_pressure(self.pressure, k, ng.specialcf.normal(2), v)
        return [Integral([integrand], domain.ds(*self.boundaries, skeleton=True))]

    def _kinematics(self, grad_m: Any) -> Kinematics:
        """Return the kinematics of the shape that the pressure is normal to."""
        return Kinematics(0 * grad_m if self._setup.small else grad_m)

    def sentence(self) -> str:
        """Return what acts now: no pressure is not worth a word, least of all on a skin that cuffs press."""
        return f"{self.value.Get():.4g} Pa {self.name}" if self.value.Get() else ""


class Stocking(PressureOn):
    """The pressure on the skin of a fabric under tension, which is worn by degrees."""

    def sentence(self) -> str:
        return f"{self.value.Get():.4g} of the tension of the {self.name}" if self.value.Get() else ""


class StockingModel(ConditionModel):
    """A stocking, whose fabric presses the skin by its tension over the radius (Laplace): p = 2 pi T / girth.

    The girth is that of the skin at rest at each height z. Even tension presses most where the leg is thin; where it
    grows faster towards the knee than the girth, the gradient is reversed ("progressive"). Around the leg the pressure
    is the same, as if each section were round. For bandages: S. Thomas, World Wide Wounds, 2003.
    """

    kind: Literal["stocking"] = "stocking"
    tension: tuple[Tension, ...] = Field(min_length=1)
    """Force around the leg per height of the fabric, at each of `heights`: linear in between, held beyond."""
    heights: tuple[Length, ...] = ()
    """z of each tension; may be left out for one that is the same everywhere."""
    over_time: FactorCurve = FactorRamp(final=1.0, duration=1.0)
    """Factor on the tension."""

    @model_validator(mode="after")
    def _has_heights(self) -> Self:
        if len(self.heights) != len(self.tension) and (self.heights or len(self.tension) > 1):
            raise ValueError(
                f"a stocking needs as many heights as tensions, not {len(self.heights)} and {len(self.tension)}"
            )
        for lower, upper in pairwise(self.heights):
            if upper <= lower:
                raise ValueError(f"the heights of a stocking must increase, but {upper:g} m follows {lower:g} m")
        return self

    def condition(self, domain: Domain, name: str) -> Stocking:
        if domain.mesh.dim != 3 or not domain.has_boundary(SKIN):
            raise CaseError(f"loads.further: {name}: a stocking is worn in 3-D on a boundary 'skin': there is none")
        tension = terms.piecewise(ng.z, self.heights or (0.0,), self.tension)
        return Stocking(name, domain, (SKIN,), self.over_time, 2 * pi * tension / Girth(domain, SKIN).at(ng.z))


class BloodReference(WithValue):
    """The reference pressure of a vessel's blood (Pa), which it exerts on the wall.

    What is solved for is the pressure beyond it: so the rounding of 1,333 Pa is not in flows that 3 Pa drive, and no
    flow is found at once. With one-way coupling it is all that the blood does to the solids.
    """

    def __init__(
        self, vessel: Vessel, domain: Domain, curve: Callable[[float], float], *, one_way: bool = False
    ) -> None:
        super().__init__(f"blood {vessel.name}".strip(), curve)
        self._domain, self._lumen, self._wall, self._one_way = domain, str(vessel.lumen), vessel.interface, one_way
        self._acts = domain.is_interface(vessel.interface)

    def excludes_blood(self) -> bool:
        return self._one_way and self._acts

    def integrals(self, _elements: ng.BitArray | None) -> list[Integral]:
        setup = self._setup
        return self._work(self.value, setup.trial[MOTION], setup.test[MOTION]) if setup.leads else []

    def static_integrals(self, m: Any, v: Any) -> list[Integral]:
        """Return the virtual work on the solids of the blood's whole pressure, held as it is."""
        held = self.value if self._one_way else self.value + self._setup.state[PRESSURE]
        return self._work(held, m, v)

    def _work(self, pressure: Any, m: Any, v: Any) -> list[Integral]:
        if not self._acts:
            return []
        if self._domain.mesh.dim == 2:
            work = -terms.follower_pressure(pressure, Kinematics(ng.Grad(m)), ng.specialcf.normal(2), v)
            return [through(self._domain, self._lumen, self._wall, work, None)]
        out_of_blood = self._domain.outward_normal(self._lumen)
        work = -terms.follower_pressure(pressure, Kinematics(ng.Grad(m).Trace()), out_of_blood, v.Trace())
        return [Integral([work], self._domain.ds(self._wall))]

    def pressure_scale(self) -> float:
        """Return the pressure, where it loads solids."""
        return abs(self.value.Get()) if self._acts else 0.0


class BodyForce(WithValue):
    """A force per volume of the reference shape (N/m3) on regions: a vector field times a function of time."""

    def __init__(
        self, force: Any, *regions: str, curve: Callable[[float], float] = lambda _: 1.0, name: str = "body force",
        **options: Any,
    ) -> None:  # fmt: skip
        """Prepare.

        Args:
            force: vector field (N/m3).
            regions: on which it acts; none: all.
            curve: factor over time (s).
            name: distinguishes it from other forces.
            options: of the measure, e.g. `bonus_intorder`.
        """
        super().__init__(name, curve)
        self.force, self._regions, self._options = force, regions, options

    def integrals(self, elements: ng.BitArray | None) -> list[Integral]:
        return self._work(self._setup.test[MOTION], self._regions or self._setup.domain.regions, elements)

    def blood_integrals(self, elements: ng.BitArray | None) -> list[Integral]:
        return self._work(self._setup.test[MOTION], self._setup.domain.lumens, elements)

    def static_integrals(self, _m: Any, v: Any) -> list[Integral]:
        return self._work(v, self._setup.domain.geometry.solids, None)

    def sentence(self) -> str:
        return f"{self.value.Get():.4g} times the {self.name}"

    def _work(self, v: Any, among: Sequence[str], elements: ng.BitArray | None) -> list[Integral]:
        regions = [name for name in self._regions or among if name in among]
        if not regions:
            return []
        measure = self._setup.domain.dx(*regions, definedonelements=elements, **self._options)
        return [Integral([-self.value * (self.force * v)], measure)]


class SolidsForce(BodyForce):
    """The force of an acceleration on the mass of solids, e.g. their weight."""

    def __init__(self, name: str, acceleration: Sequence[float], regions: Sequence[str], curve: FactorCurve) -> None:
        super().__init__(None, *regions, curve=curve, name=name)
        self._acceleration = tuple(acceleration)

    def attach(self, setup: Setup) -> None:
        """Take what it acts on, and the densities."""
        super().attach(setup)
        mass = setup.domain.mesh.MaterialCF({name: setup.densities[name] for name in self._regions}, default=0.0)
        self.force = mass * ng.CF(self._acceleration)

    def sentence(self) -> str:
        size = self.value.Get() * sum(a * a for a in self._acceleration) ** 0.5
        return f"{size:.4g} m/s2 on {', '.join(self._regions)}"


class BodyForceModel(ConditionModel):
    """A force on solids by their mass, of a given acceleration: `acceleration_m_s2 = [0, 0, -9.81]` is their weight."""

    kind: Literal["body_force"] = "body_force"
    acceleration: tuple[Acceleration, ...]
    """Along x, y and z."""
    regions: tuple[str, ...] = ()
    """Solids on which it acts; none: all."""
    over_time: FactorCurve = FactorConstant(value=1.0)
    """Factor on it."""

    def condition(self, domain: Domain, name: str) -> SolidsForce:
        solids = domain.geometry.solids
        if wrong := next((region for region in self.regions if region not in solids), None):
            raise CaseError(f"loads.further: {name}: {unknown('solid', wrong, solids)}")
        check_components(self.acceleration, "acceleration", name, domain)
        return SolidsForce(name, self.acceleration, self.regions or solids, self.over_time)
