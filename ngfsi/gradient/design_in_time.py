"""Cycles of pressures in cuffs, as of intermittent compression, by the gradients of whole runs.

Each cuff's pressure is linear between times of a cycle and repeats; what is to be large is the mean over the last cycle
of the run, and losses are those at the time when they are largest. The method is that of `design`: one sweep of the
adjoint for each quantity and loss that counts tells the derivatives by all pressures at all times, for residuals are
linear in them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import ceil
from typing import Any, ClassVar

import ngsolve as ng
import numpy as np

from ngfsi.arrays import Array
from ngfsi.case import Case, Cuff
from ngfsi.config.functions import PressureConstant, PressureTable
from ngfsi.errors import CaseError
from ngfsi.gradient.adjoint import Adjoint, StoredStates
from ngfsi.gradient.design import Equilibrium, Layout, Pressed
from ngfsi.gradient.window import Window
from ngfsi.mesh.domain import Domain
from ngfsi.units import SAME_TIME


@dataclass(frozen=True)
class Cycle(Layout):
    """Cuffs whose pressures are free at times, and linear between them.

    Attributes:
        times: of a cycle (s), from 0 to its end, at which the pressures are those at 0.
        cycles: in the run, of which the last one counts.
    """

    times: tuple[float, ...] = (0.0, 1.0)
    cycles: float = 1.0

    @classmethod
    def of(cls, layout: Layout, times: tuple[float, ...], case: Case) -> Cycle:
        """Return cycles of the cuffs of a layout in a run.

        Raises:
            CaseError: the times do not rise from 0, or the run is shorter than a cycle.
        """
        if len(times) < 3 or times[0] != 0 or np.any(np.diff(times) <= 0):
            written = ",".join(f"{one:g}" for one in times)
            raise CaseError(f"--times {written}: write three times (s) or more that rise from 0 to the end of a cycle, "
                            "e.g. 0,0.5,1,1.5,2")  # fmt: skip
        number = case.time.end / times[-1]
        if number < 1 - SAME_TIME:
            raise CaseError(f"--times: the run ends at {case.time.end:g} s, before a cycle of {times[-1]:g} s, but "
                            "the last cycle is what counts: set time.end to that of one or more")  # fmt: skip
        return cls(layout.rings, layout.sectors, layout.bottom, layout.top, times, number)

    @property
    def places(self) -> int:
        """Number of cuffs."""
        return self.rings * self.sectors

    @property
    def count(self) -> int:
        return self.places * (len(self.times) - 1)

    def cuffs(self, pressures: Array) -> tuple[Cuff, ...]:
        """Return them under pressures (cuffs * times,) [Pa], by cuff and time."""
        period, number, found = self.times[-1], ceil(self.cycles - SAME_TIME), []
        at = [*(n * period + t for n in range(number) for t in self.times[:-1]), number * period]
        for cuff, own in zip(super().cuffs(np.zeros(self.places)), self.over_time(pressures), strict=True):
            table = PressureTable(times=tuple(at), values=(*np.tile(own, number).tolist(), float(own[0])))
            found.append(cuff.replace(pressure=table))
        return tuple(found)

    def over_time(self, pressures: Array) -> Array:
        """Return pressures as (cuffs, times)."""
        return pressures.reshape(self.places, -1)

    def mean(self, pressures: Array) -> Array:
        """Return the mean over a cycle (cuffs,)."""
        return self.over_time(pressures) @ self._durations()

    def _durations(self) -> Array:
        """Return what each time counts in a mean (times,)."""
        sizes = np.diff(self.times)
        return np.asarray((sizes + np.roll(sizes, 1)) / 2 / self.times[-1])

    def shares(self, time: float) -> Array:
        """Return what each pressure of a cycle counts at a time (times,)."""
        time, period = time % self.times[-1], self.times[-1]
        # times of a run are sums, and may miss the end of a cycle by rounding
        time = 0.0 if period - time < SAME_TIME * period else time
        found = np.array([np.interp(time, self.times, one) for one in np.eye(len(self.times))])
        found[0] += found[-1]
        return found[:-1]

    def neighbours(self) -> list[tuple[int, int]]:
        """Return pairs of pressures beside each other, in place and in time."""
        number = len(self.times) - 1
        found = [(a * number + n, b * number + n) for a, b in super().neighbours() for n in range(number)]
        in_time = [(c * number + n, c * number + (n + 1) % number) for c in range(self.places) for n in range(number)]
        return found + in_time

    def weights(self, domain: Domain) -> Array:
        return np.outer(super().weights(domain), self._durations()).ravel()

    def begun(self, mean: float, low: float, high: float) -> Array:
        """Return a weak wave from the inlet on: at pressures that do not change no change in time promises anything."""
        ring, time = np.arange(self.places) // self.sectors, np.array(self.times[:-1]) / self.times[-1]
        swing = np.cos(2 * np.pi * (time[None] - 0.5 * ring[:, None] / self.rings))
        return (mean + min(mean - low, high - mean) / 2 * swing).ravel()


class Cycled(Pressed):
    """A vein under any cycles of pressures."""

    layout: Cycle
    whole: ClassVar = {f"tawss_{kind}": ("tawss", kind) for kind in ("mean", "least")}

    def __init__(self, case: Case, quantity: str, *others: Any) -> None:
        """Prepare; `quantity`: of which the mean over time is meant, or tawss_mean or tawss_least of means over time at
        each face of the wall; `others`: as of `Pressed`."""
        super().__init__(case, quantity, *others)
        self._kind = self.whole.get(quantity, ("", "mean"))[1]

    def _case_of(self, case: Case) -> Case:
        return case.replace(**{"loads.skin_pressure": PressureConstant(value=0.0)})

    def solve(self, pressures: Array) -> Equilibrium:
        """Return what is made of the run: means over the last cycle, and largest losses.

        Raises:
            CaseError, MaterialError, SolverError: there is none.
        """
        with ng.TaskManager():
            run, without_loads = self._computed(pressures)
            values, times = run.values(), run.times
        window = Window(self._kind, times[-1] - self.layout.times[-1], times[-1])
        means = [run.measured[name].made(window, times, values[name]) for name in self.aims]
        weights = {name: slopes for name, (_, slopes) in zip(self.aims, means, strict=True)}
        weights |= {name: np.eye(len(times))[np.argmin(values[name])] for name in self.sizes}
        sizes = np.array([values[name].min() for name in self.sizes])
        return Run(run, np.array([mean for mean, _ in means]), 1 - sizes / without_loads, weights)

    def _by_pressure(self, at: Equilibrium, names: list[str]) -> Array:
        assert isinstance(at, Run)
        adjoint, run = Adjoint(at.run, []), at.run
        found = np.zeros((len(names), self.layout.places, len(self.layout.times) - 1))
        for place, name in enumerate(names):
            adjoint.derivatives({name: at.weights[name]}, seen=self._adds_to(found[place], run))
        return found.reshape(len(names), -1)

    def _adds_to(self, found: Array, run: StoredStates) -> Callable[[int, Array], None]:
        def adds(number: int, multipliers: Array) -> None:
            by_cuff = -self._forces(run, number) @ multipliers
            found[:] += np.outer(by_cuff, self.layout.shares(run.moments[number].time))

        return adds


@dataclass(frozen=True)
class Run(Equilibrium):
    """A run under cycles.

    Attributes:
        weights: of each quantity, the derivatives of what is made of it by its values at the accepted states.
    """

    weights: Mapping[str, Array]
