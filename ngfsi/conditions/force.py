"""Forces on regions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Literal

import ngsolve as ng

from ngfsi.conditions.condition import ConditionModel, Setup, WithValue, check_components
from ngfsi.config.functions import FactorConstant, FactorCurve
from ngfsi.errors import CaseError, unknown
from ngfsi.mesh.domain import Domain
from ngfsi.physics.fields import MOTION
from ngfsi.physics.integrals import Integral
from ngfsi.units import Acceleration


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
