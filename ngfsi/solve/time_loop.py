"""The time loop: steps that meet the kinks of the loads, are halved on failure and grow back."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from math import ceil
from time import perf_counter

import numpy as np

from ngfsi.arrays import Array
from ngfsi.case.case import SAME_TIME, Case
from ngfsi.errors import SolverError
from ngfsi.solve.initial import Say, silent
from ngfsi.solve.newton import Newton, Solution, part_of
from ngfsi.system.schemes import fraction_of_error, weights
from ngfsi.system.system import System

GROWS_BELOW = 10.0
"""Steps grow when their error is this much smaller than allowed."""


@dataclass(frozen=True)
class Step:
    """An accepted step: number, time (s) at its end, size (s), what it took, wall time (s)."""

    index: int
    time: float
    size: float
    solution: Solution
    seconds: float

    def cost(self) -> dict[str, float]:
        """Return what it took, as a row of costs.csv."""
        taken = self.solution
        return {"step": self.index, "time_s": self.time, "wall_s": self.seconds, "iterations": taken.iterations,
                "factorisations": taken.factorisations, "linear_iterations": taken.linear_iterations}  # fmt: skip


@dataclass
class History:
    """Old states, newest first: enough for the scheme and the predictor."""

    times: list[float] = field(default_factory=list)
    states: list[Array] = field(default_factory=list)
    rates: list[Array] = field(default_factory=list)
    smooth: int = 0
    """Number of steps since the start or the last kink of a load."""
    accepted: int = 0
    """Number of steps in all."""
    size: float | None = None
    """Size (s) to be tried next; None: the nominal one."""

    def arrays(self) -> dict[str, Array]:
        """Return the history as plain arrays, for storage."""
        counts = np.array([self.smooth, self.accepted])
        size = np.array([] if self.size is None else [self.size])
        return {"times": np.array(self.times), "states": np.array(self.states), "rates": np.array(self.rates),
                "counts": counts, "size": size}  # fmt: skip

    @classmethod
    def stored(cls, arrays: Mapping[str, Array]) -> History:
        """Return the history stored as `arrays`."""
        times = [float(t) for t in arrays["times"]]
        smooth, accepted = map(int, arrays["counts"])
        size = float(arrays["size"][0]) if len(arrays["size"]) else None
        return cls(times, list(arrays["states"]), list(arrays["rates"]), smooth, accepted, size)

    def push(self, time: float, state: Array, rate: Array) -> None:
        """Add an accepted state."""
        self.times.insert(0, time)
        self.states.insert(0, state)
        self.rates.insert(0, rate)
        del self.times[3:], self.states[3:], self.rates[3:]

    def extrapolated(self, time: float) -> Array:
        """Return the polynomial through the states since the last kink, at most quadratic, at a new time."""
        count = min(self.smooth + 1, len(self.times))
        known = self.times[:count]
        result = np.zeros_like(self.states[0])
        for i in range(count):
            others = [known[j] for j in range(count) if j != i]
            result += np.prod([(time - t) / (known[i] - t) for t in others]) * self.states[i]
        return result


class TimeLoop:
    """Advances a system from its initial state to the end of the case.

    Attributes:
        milestones: times (s) that are hit, which are those of all steps if none is shortened; the last is the end.
    """

    def __init__(
        self, case: Case, system: System, newton: Newton, inspect: Callable[[], str] = str, say: Say = silent,
        history: History | None = None, explain: Callable[[bool], str] = lambda _: "",
    ) -> None:  # fmt: skip
        """Prepare the loop.

        Args:
            inspect: returns why the present state is unacceptable (an inverted element, say), or ""; default: never.
            say: takes lines for the log; default: none is kept.
            explain: returns what else to say of the last good state when the loop gives up, given whether any step was
                taken; default: nothing.
            history: of an earlier loop, which this one continues; default: the system's state, at rest at t = 0.
        """
        self.case, self.system, self.newton = case, system, newton
        self._inspect, self._say, self._explain = inspect, say, explain
        self._may_grow = True
        self.history = history or History()
        self.milestones = self._plan()

    def arrays(self) -> dict[str, Array]:
        """Return as plain arrays all that the steps to come depend on, for `restore`."""
        self._begin()
        parts = {"history": self.history.arrays(), "newton": self.newton.arrays(), "system": self.system.snapshot()}
        return {f"{name}.{key}": array for name, part in parts.items() for key, array in part.items()}

    def restore(self, arrays: Mapping[str, Array]) -> None:
        """Go on as the loop that returned `arrays`: the steps to come are the same, to the last bit with one thread."""
        self.history = History.stored(part_of(arrays, "history"))
        self.newton.restore(part_of(arrays, "newton"))
        self.system.restore(part_of(arrays, "system"))

    def _begin(self) -> None:
        if not self.history.times:
            self.history.push(0.0, self.system.values.copy(), np.zeros(self.system.unknowns.size))

    def _plan(self) -> list[float]:
        """Return the times that must be hit: the nominal grid and the kinks of the loads."""
        time = self.case.time
        grid = [min(k * time.step, time.end) for k in range(1, time.steps + 1)]
        for kink in self.case.loads.breakpoints:
            if 0 < kink < time.end and min(abs(kink - t) for t in grid) > SAME_TIME * time.step:
                grid.append(kink)
        return sorted(grid)

    def run(self) -> Iterator[Step]:
        """Yield after each accepted step, the system holding its state and rates.

        Raises:
            SolverError: a step failed at the smallest size; says at which time and why.
        """
        self._begin()
        time = self.history.times[0]
        self.system.values[:] = self.history.states[0]
        for milestone in self.milestones:
            while milestone - time > SAME_TIME * self.case.time.step:
                started = perf_counter()
                size, solution = self._advance(time, milestone)
                at_milestone = abs(time + size - milestone) <= SAME_TIME * self.case.time.step
                time = milestone if at_milestone else time + size
                self.history.push(time, self.system.values.copy(), self.system.rates())
                self.history.smooth = 0 if self._is_kink(time) else self.history.smooth + 1
                self.history.accepted += 1
                yield Step(self.history.accepted, time, size, solution, perf_counter() - started)

    def _is_kink(self, time: float) -> bool:
        return any(abs(time - kink) <= SAME_TIME * self.case.time.step for kink in self.case.loads.breakpoints)

    def _advance(self, time: float, milestone: float) -> tuple[float, Solution]:
        """Take one step towards the milestone, with smaller steps if need be; return its size and cost."""
        self.system.accept()
        accepted = self.system.snapshot()
        while True:
            parts = ceil((milestone - time) / (self.history.size or self.case.time.step) - SAME_TIME)
            size = (milestone - time) / max(parts, 1)
            try:
                solution = self._attempt(time, size)
            except SolverError as error:
                self.system.restore(accepted)
                self._retreat(time, size, error)
            else:
                if self.history.size and self._may_grow:
                    self.history.size = 2 * self.history.size if 2 * self.history.size < self.case.time.step else None
                return size, solution

    def _attempt(self, time: float, size: float) -> Solution:
        system, history, case = self.system, self.history, self.case
        previous = history.times[0] - history.times[1] if history.smooth >= 1 else None
        old = min(1, len(history.states) - 1)
        system.update(time + size)
        states, rates = (history.states[0], history.states[old]), (history.rates[0], history.rates[old])
        step = np.inf if case.time.scheme == "static" else size
        system.set_rates(weights(case.time.scheme, size, previous), states, rates, step)
        predicted = history.extrapolated(time + size)
        system.values[:] = predicted
        ahead = weights(case.time.scheme, size, size).new
        solution = self.newton.solve(case.solver.tolerance, case.solver.max_iterations, ahead)
        if reason := self._inspect():
            raise SolverError(reason)
        self._check_accuracy(size, predicted)
        return solution

    def _check_accuracy(self, size: float, predicted: Array) -> None:
        """Refuse a step that is less accurate than wanted and can be halved; note whether a longer one would do."""
        wanted, smallest = self.case.time.error_tolerance, self.case.time.smallest_step
        if wanted is None:
            return
        error = self._local_error(size, predicted)
        if error > wanted and size / 2 >= smallest:
            raise SolverError(f"its estimated error {error:.2g} exceeds time.error_tolerance = {wanted:g}")
        # of third order: doubled, a step errs eight times as much
        self._may_grow = error < wanted / GROWS_BELOW

    def _local_error(self, size: float, predicted: Array) -> float:
        """Return the estimated error of the step, relative to the scales of displacement and velocity.

        In the first two steps after a kink that of backward Euler, h^2/2 of the second derivative, by the change of
        the rates; it exceeds that of the second of them, which is one of BDF2.
        """
        times = self.history.times
        if self.history.smooth < 2:
            estimate = size / 2 * np.abs(self.system.rates() - self.history.rates[0])
        else:
            fraction = fraction_of_error(size, times[0] - times[1], times[1] - times[2])
            estimate = fraction * np.abs(self.system.values - predicted)
        blocks, scales = self.system.unknowns.blocks, self.system.block_scales()
        both = [name for name in ("d", "w") if name in scales]
        return max(float(np.max(estimate[blocks[name]], initial=0.0)) / scales[name] for name in both)

    def _retreat(self, time: float, size: float, error: SolverError) -> None:
        """Halve the step, or give up."""
        if size / 2 < self.case.time.smallest_step:
            acting = self.system.sentence()
            raise SolverError(
                f"the run ended at t = {time:.6g} s{f' with {acting}' if acting else ''}: a step of {size:.3g} s to "
                f"t = {time + size:.6g} s failed and time.smallest_step forbids a smaller one: {error}"
                f"{self._explain(self.history.accepted > 0)}"
            ) from error
        self.history.size = size / 2
        self._say(f"t = {time:.6g} s: a step of {size:.3g} s failed ({error}); trying {size / 2:.3g} s")
