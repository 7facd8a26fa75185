"""Pressures on boundaries: on the skin, of cuffs, of the blood on walls and in holes of plane sections."""

from __future__ import annotations

from collections.abc import Callable
from math import pi
from typing import Any, Self

import ngsolve as ng
from pydantic import Field, model_validator

from ngfsi.conditions.condition import WithValue
from ngfsi.conditions.openings import through
from ngfsi.config.functions import PressureCurve
from ngfsi.config.model import ConfigModel
from ngfsi.mesh.domain import Domain
from ngfsi.mesh.geometry import Vessel
from ngfsi.physics import terms
from ngfsi.physics.fields import MOTION, PRESSURE
from ngfsi.physics.integrals import Integral
from ngfsi.physics.kinematics import Kinematics
from ngfsi.units import Angle, Length

SKIN = "skin"
"""Boundary on which stockings and sleeves press."""


class Cuff(ConfigModel):
    """A pressure on a part of the skin, over time: of a stocking's zone, or of one chamber of a pneumatic sleeve.

    It is whole inside the part, and falls smoothly to zero over `edge`, half of it outside.
    """

    pressure: PressureCurve
    start: Length
    """z where it begins, and `end`: where it ends, on the reference shape."""
    end: Length
    direction: Angle = 0.0
    """Of its middle, around the axis of the segment from x (lateral) to y (anterior)."""
    half_width: Angle | None = Field(default=None, gt=0, lt=pi)
    """Angle from the middle to either side; None: all around."""
    edge: Length = Field(default=5e-3, gt=0)

    @model_validator(mode="after")
    def _has_a_height(self) -> Self:
        if self.end - self.start < self.edge:
            raise ValueError(
                f"a cuff from z = {self.start:g} m to {self.end:g} m is lower than its edge, {self.edge:g} m"
            )
        return self

    def condition(self, domain: Domain, name: str) -> PressureOn:
        """Return the condition."""
        part = terms.part_of_skin(self.start, self.end, self.edge, self.direction, self.half_width)
        return PressureOn(name, domain, (SKIN,), self.pressure, part)


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
