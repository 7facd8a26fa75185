"""Forces on regions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import ngsolve as ng

from ngfsi.conditions.condition import Setup, WithValue
from ngfsi.physics.fields import MOTION
from ngfsi.physics.integrals import Integral


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

    def attach(self, setup: Setup) -> None:
        """Take what it acts on."""
        self._setup = setup

    def integrals(self, elements: ng.BitArray | None) -> list[Integral]:
        """Return its virtual work."""
        domain = self._setup.domain
        return self._work(self._setup.test[MOTION], self._regions or domain.regions, elements)

    def blood_integrals(self, elements: ng.BitArray | None) -> list[Integral]:
        """Return its virtual work on the blood."""
        lumens = self._setup.domain.lumens
        return self._work(self._setup.test[MOTION], [n for n in self._regions or lumens if n in lumens], elements)

    def static_integrals(self, _m: Any, v: Any) -> list[Integral]:
        """Return its virtual work on the solids with a test function."""
        solids = self._setup.domain.geometry.solids
        return self._work(v, [n for n in self._regions or solids if n in solids], None)

    def sentence(self) -> str:
        """Return what acts now."""
        return f"{self.value.Get():.4g} times the {self.name}"

    def _work(self, v: Any, regions: Sequence[str], elements: ng.BitArray | None) -> list[Integral]:
        if not regions:
            return []
        measure = self._setup.domain.dx(*regions, definedonelements=elements, **self._options)
        return [Integral([-self.value * (self.force * v)], measure)]
