"""What scalars there are: how each begins, what makes it grow, what of it enters, and what is shown of it."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field

from ngfsi.arrays import Array
from ngfsi.config.model import ConfigModel
from ngfsi.transport.state import BloodState
from ngfsi.units import Diffusivity, Length, Time

Point = tuple[Length, Length, Length]


class ScalarModel(ConfigModel):
    """A scalar that the blood carries, as a case file holds it; registered by its `kind` (`ngfsi.scalars`).

    By default it is 0 at the start and where blood enters, and never falls below it.

    Attributes:
        unit: SI suffix of what is shown.
        means: what it is, for tables and plots.
    """

    unit: ClassVar[str] = "1"
    means: ClassVar[str] = ""

    kind: str
    name: str = Field(default="", pattern=r"^([a-z][a-z0-9_]*)?$")
    """Begins its columns; default: its kind. Two of one kind need different ones."""
    diffusivity: Diffusivity = Field(default=0.0, ge=0)
    """By which it spreads in the blood; nothing spreads through walls and openings."""

    @property
    def label(self) -> str:
        """What its columns begin with."""
        return self.name or self.kind

    @property
    def since(self) -> float:
        """When it begins (s)."""
        return 0.0

    def begin(self, blood: BloodState) -> list[Array]:
        """Return its values at the start, at the points of the cells."""
        return [np.zeros_like(volumes) for volumes in blood.flow.volumes]

    def source(self, blood: BloodState) -> list[Array]:
        """Return how fast it grows (1/s times its unit) at the points of the cells."""
        return [np.zeros_like(volumes) for volumes in blood.flow.volumes]

    def outside(self, _seconds: float) -> float:
        """Return by how much it grows in blood that stays outside of the vessel for a time."""
        return 0.0

    def bounds(self, _time: float) -> tuple[float, float]:
        """Return the least and the largest value that is possible at a time (s)."""
        return 0.0, inf

    def shown(self, values: Array) -> Array:
        """Return what is shown of its values, in `unit`."""
        return values


class Age(ScalarModel):
    """Time since the blood entered, or since the start of the run where that is shorter (s)."""

    unit: ClassVar[str] = "s"
    means: ClassVar[str] = "age of the blood"

    kind: Literal["age"] = "age"

    def source(self, blood: BloodState) -> list[Array]:
        return [np.ones_like(volumes) for volumes in blood.flow.volumes]

    def outside(self, seconds: float) -> float:
        return seconds

    def bounds(self, time: float) -> tuple[float, float]:
        return 0.0, time


class Washout(ScalarModel):
    """Fraction of the blood that was in a marked volume at a time: 1 there, 0 elsewhere and in what enters."""

    means: ClassVar[str] = "fraction of marked blood"

    kind: Literal["washout"] = "washout"
    start: Time = Field(default=0.0, ge=0)
    """When the blood is marked."""
    corners: tuple[Point, Point] | None = None
    """Opposite corners of a box in the reference shape, whose blood is marked; default: all."""
    washed_out: float = Field(default=0.9, gt=0, lt=1)
    """Part of the marked blood that must have left for the time of washout."""

    @property
    def since(self) -> float:
        return self.start

    def begin(self, blood: BloodState) -> list[Array]:
        if self.corners is None:
            return [np.ones_like(volumes) for volumes in blood.flow.volumes]
        low, high = np.min(self.corners, axis=0), np.max(self.corners, axis=0)
        return [np.all((low <= at) & (at <= high), axis=-1).astype(float) for at in blood.cells.places]

    def bounds(self, _time: float) -> tuple[float, float]:
        return 0.0, 1.0


class Measure(NamedTuple):
    """C, a and b of an exposure C (tau/Pa)^a (t/s)^b."""

    constant: float
    stress_power: float
    time_power: float


MEASURES = {
    "stimulation": Measure(1.0, 1.0, 0.452),
    "activation": Measure(1 / 3.5, 1.0, 1.0),
    "lysis": Measure(3.31e-8, 3.075, 0.77),
}
"""By name. Stimulation: the "platelet stimulation function" of R. Boreda, R. S. Fatemi, S. E. Rittgers (J Vasc Invest
1, 1995, 26), after experiments that J. D. Hellums collected (Ann Biomed Eng 22, 1994, 445). Activation: the threshold
of 3.5 Pa s (35 dyn s/cm2) that is read from Hellums's diagram and commonly used for devices (D. Bluestein et al., Ann
Biomed Eng 25, 1997, 344). Lysis: release of lactate dehydrogenase in per cent, 3.31e-6 tau^3.075 t^0.77 (M.
Giersiepen et al., Int J Artif Organs 13, 1990, 300, after L. J. Wurzinger et al.), measured at 57 to 255 Pa for 7 to
700 ms. As commonly quoted; the printed papers were not at hand."""


def _measure(given: dict[str, Any]) -> Measure:
    return MEASURES[given.get("measure", "stimulation")]


class Exposure(ScalarModel):
    """Exposure of platelets to shear stress, C (tau/Pa)^a (t/s)^b of a stress tau that acts for a time t.

    `measure` names published constants, by default those of tau t^0.452; with others it is any measure of activation by
    a power law. Over a history the (1/b)-th power is added up, D^(1/b) = int C^(1/b) tau^(a/b) dt (A. Garon, M.-I.
    Farinas, Artif Organs 28, 2004, 1016), which is what the blood carries.
    """

    means: ClassVar[str] = "exposure of platelets to shear"

    kind: Literal["exposure"] = "exposure"
    measure: Literal["stimulation", "activation", "lysis"] = "stimulation"
    """stimulation: tau t^0.452. activation: tau t over Hellums's threshold, so that 1 is where platelets begin to be
    activated. lysis: of platelets, as a fraction, by Giersiepen."""
    constant: float = Field(default_factory=lambda given: _measure(given).constant, gt=0)
    """C; default: that of the measure."""
    stress_power: float = Field(default_factory=lambda given: _measure(given).stress_power, gt=0)
    """a; likewise."""
    time_power: float = Field(default_factory=lambda given: _measure(given).time_power, gt=0)
    """b; likewise."""

    def source(self, blood: BloodState) -> list[Array]:
        return [(self.constant * tau**self.stress_power) ** (1 / self.time_power) for tau in blood.shear_stresses]

    def shown(self, values: Array) -> Array:
        return np.asarray(np.maximum(values, 0.0) ** self.time_power)


class NearWall(ScalarModel):
    """Time that the blood has spent near the wall since it entered (s)."""

    unit: ClassVar[str] = "s"
    means: ClassVar[str] = "time spent near the wall"

    kind: Literal["near_wall"] = "near_wall"
    layer: Length = Field(default=0.5e-3, gt=0)
    """Distance from the wall that is near."""

    def source(self, blood: BloodState) -> list[Array]:
        return [(distance < self.layer).astype(float) for distance in blood.wall_distances]

    def bounds(self, time: float) -> tuple[float, float]:
        return 0.0, time


def check_names(scalars: Sequence[ScalarModel]) -> str:
    """Return why scalars cannot be told apart, or "" if they can."""
    labels = [scalar.label for scalar in scalars]
    twice = sorted({label for label in labels if labels.count(label) > 1})
    return f"has several scalars '{twice[0]}': give each a name of its own" if twice else ""
