"""The time loop: steps that meet the kinks of the loads, are halved on failure and grow back.

A stage of a Runge-Kutta scheme is a step of backward Euler from a state of its own (`system.schemes.Tableau`). With
time.error_tolerance such a scheme is free in its steps between kinks, by a controller with proportional and integral
part on its estimated error; what is asked for at other times is interpolated (dense output).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import ceil
from time import perf_counter

import numpy as np

from ngfsi.arrays import Array, part_of
from ngfsi.case.case import SAME_TIME, Case
from ngfsi.errors import SolverError
from ngfsi.solve.initial import Say, silent
from ngfsi.solve.newton import Newton, Solution
from ngfsi.system.schemes import STAGES, Tableau, backward_euler, fraction_of_error, weights
from ngfsi.system.system import System

GROWS_BELOW = 10.0
"""Steps of BDF2 grow when their error is this much smaller than allowed."""
SAFETY, SHRINK, GROW, KEEP = 0.9, 0.2, 4.0, 1.2
"""Of the controller: factor on the size that the estimate asks for, the limits of a change, and up to which growth the
size is kept, for the sake of the factors."""
INTEGRAL, PROPORTIONAL = 0.7, 0.4
"""Exponents of the controller, over the order of the estimate (Hairer, Wanner, Solving ODEs II, ch. IV.2)."""
NEAR = 0.3
"""Ratio of a distance (`Condition.gaps`) to that at the start below which a step may not change it much."""
CLOSES, OPENS = 0.55, 1.3
"""Of such a distance, predicted at the end of a step over that at its start: a step is halved that would fall below the
former, and the prediction is shortened where it exceeds the latter. Newton's method otherwise meets sides that have
passed through each other, or spends iterations on coming back."""
SHORTER = 0.8
"""Factor on the predicted change, again and again."""
APART = 0.19
"""Part of a step by which the times must differ through whose states one extrapolates."""


class StepRefusedError(SolverError):
    """A step whose estimated error is too large; `size` (s) is that of the one to try instead."""

    def __init__(self, message: str, size: float) -> None:
        super().__init__(message)
        self.size = size


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


@dataclass(frozen=True)
class Solved:
    """What was solved within an accepted step, by a scheme of one step or as one of its stages.

    Attributes:
        time, step: s; as the system had them.
        new: weight of the state in its rates (1/s).
        state: of all unknowns.
        earlier: what the histories of the rates are sums of: number of what was solved -> weights of its state and of
            its rate in that of the velocity, which are those of rate and acceleration in that of the acceleration. 0
            is the last accepted state, -1 the one before, and the stages of this step are 1, 2, ...
    """

    time: float
    step: float
    new: float
    state: Array
    earlier: Mapping[int, tuple[float, float]]


@dataclass
class History:
    """Old states, newest first: enough for the scheme and the predictor.

    Attributes:
        accelerations: rates of the rates, of the last two states of a scheme in stages.
    """

    times: list[float] = field(default_factory=list)
    states: list[Array] = field(default_factory=list)
    rates: list[Array] = field(default_factory=list)
    smooth: int = 0
    """Number of steps since the start or the last kink of a load."""
    accepted: int = 0
    """Number of steps in all."""
    size: float | None = None
    """Size (s) to be tried next; None: the nominal one."""
    accelerations: list[Array] = field(default_factory=list)
    error: float = 1.0
    """Estimated error of the last step, over the one allowed."""
    shown: float = 0.0
    """Last time (s) of which the state was shown, by a scheme that is free in its steps."""

    def arrays(self) -> dict[str, Array]:
        """Return the history as plain arrays, for storage."""
        counts = np.array([self.smooth, self.accepted])
        size = np.array([] if self.size is None else [self.size])
        return {"times": np.array(self.times), "states": np.array(self.states), "rates": np.array(self.rates),
                "counts": counts, "size": size, "accelerations": np.array(self.accelerations),
                "control": np.array([self.error, self.shown])}  # fmt: skip

    @classmethod
    def stored(cls, arrays: Mapping[str, Array]) -> History:
        """Return the history stored as `arrays`."""
        times = [float(t) for t in arrays["times"]]
        smooth, accepted = map(int, arrays["counts"])
        size = float(arrays["size"][0]) if len(arrays["size"]) else None
        error, shown = map(float, arrays["control"])
        return cls(times, list(arrays["states"]), list(arrays["rates"]), smooth, accepted, size,
                   list(arrays["accelerations"]), error, shown)  # fmt: skip

    def push(self, time: float, state: Array, rate: Array, acceleration: Array | None = None) -> None:
        """Add an accepted state."""
        self.times.insert(0, time)
        self.states.insert(0, state)
        self.rates.insert(0, rate)
        if acceleration is not None:
            self.accelerations.insert(0, acceleration)
        del self.times[3:], self.states[3:], self.rates[3:], self.accelerations[2:]

    def smooth_part(self) -> tuple[list[float], list[Array]]:
        """Return times and states since the last kink."""
        count = min(self.smooth + 1, len(self.times))
        return self.times[:count], self.states[:count]

    def extrapolated(self, time: float) -> Array:
        """Return the polynomial through the states since the last kink, at most quadratic, at a new time."""
        return _polynomial(*self.smooth_part(), time)

    def between(self, time: float) -> tuple[Array, Array, Array]:
        """Return state, rates and their rates at a time within the last step of a scheme in stages.

        By the cubic polynomial through the ends with their rates; after a kink by the quadratic one without the rates
        before, which are not those after it.
        """
        (y1, y0), (r1, r0), h = self.states[:2], self.rates[:2], self.times[0] - self.times[1]
        s = (time - self.times[1]) / h
        if self.smooth == 1 or len(self.accelerations) < 2:
            bent = (h * r1 - (y1 - y0)) / h**2
            slope = (y1 - y0) / h - h * bent
            return y0 + s * h * slope + (s * h) ** 2 * bent, slope + 2 * s * h * bent, 2 * bent
        a1, a0 = self.accelerations
        return _cubic(y0, y1, r0, r1, h, s), _cubic(r0, r1, a0, a1, h, s), _slope_of_cubic(r0, r1, a0, a1, h, s)


def _polynomial(times: list[float], states: list[Array], time: float) -> Array:
    """Return the value at a time of the polynomial through states (Lagrange)."""
    result = np.zeros_like(states[0])
    for i, state in enumerate(states):
        others = times[:i] + times[i + 1 :]
        result += np.prod([(time - t) / (times[i] - t) for t in others]) * state
    return result


def _cubic(y0: Array, y1: Array, r0: Array, r1: Array, h: float, s: float) -> Array:
    """Return the cubic with given values and slopes at the ends of a step h, at the part s of it (Hermite)."""
    ends = (1 - s) ** 2 * (1 + 2 * s) * y0 + s**2 * (3 - 2 * s) * y1
    return np.asarray(ends + h * s * (1 - s) * ((1 - s) * r0 - s * r1))


def _slope_of_cubic(y0: Array, y1: Array, r0: Array, r1: Array, h: float, s: float) -> Array:
    return np.asarray(6 * s * (1 - s) * (y1 - y0) / h + (1 - s) * (1 - 3 * s) * r0 + s * (3 * s - 2) * r1)


class TimeLoop:
    """Advances a system from its initial state to the end of the case.

    Attributes:
        milestones: times (s) that are hit, which are those of all steps if none is shortened; the last is the end.
    """

    def __init__(
        self, case: Case, system: System, newton: Newton, inspect: Callable[[], str] = str, say: Say = silent,
        history: History | None = None, explain: Callable[[bool], str] = lambda _: "",
        keep: Callable[[Sequence[Solved]], None] = lambda _: None,
    ) -> None:  # fmt: skip
        """Prepare the loop.

        Args:
            inspect: returns why the present state is unacceptable (an inverted element, say), or ""; default: never.
            say: takes lines for the log; default: none is kept.
            explain: returns what else to say of the last good state when the loop gives up, given whether any step was
                taken; default: nothing.
            keep: takes what was solved within each accepted step, in order; default: nothing does.
            history: of an earlier loop, which this one continues; default: the system's state, at rest at t = 0.
        """
        self.case, self.system, self.newton = case, system, newton
        self._inspect, self._say, self._explain, self._keep = inspect, say, explain, keep
        self._may_grow = True
        self.history = history or History()
        self.milestones = self._plan()
        self._stages = STAGES.get(case.time.scheme)
        self._free = self._stages is not None and case.time.error_tolerance is not None
        self._acceleration: Array | None = None
        self._solved: list[Solved] = []
        self._at_end: dict[str, Array] | None = None

    @property
    def time(self) -> float:
        """The time (s) of the state that was shown last."""
        return self.history.shown if self._free else self.history.times[0]

    def arrays(self) -> dict[str, Array]:
        """Return as plain arrays all that the steps to come depend on, for `restore`."""
        self._begin()
        system = self._at_end or self.system.snapshot()
        parts = {"history": self.history.arrays(), "newton": self.newton.arrays(), "system": system}
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
        """Yield after each accepted step, the system holding its state and rates; where steps are free, at each
        milestone, with the cost since the last one.

        Raises:
            SolverError: a step failed at the smallest size; says at which time and why.
        """
        return self._run_freely() if self._free else self._run_on_grid()

    def _run_on_grid(self) -> Iterator[Step]:
        self._begin()
        time = self.history.times[0]
        self.system.values[:] = self.history.states[0]
        for milestone in self.milestones:
            while milestone - time > SAME_TIME * self.case.time.step:
                started = perf_counter()
                time, size, solution = self._accepted(time, milestone)
                self.history.accepted += 1
                yield Step(self.history.accepted, time, size, solution, perf_counter() - started)

    def _run_freely(self) -> Iterator[Step]:
        self._begin()
        time = self.history.times[0]
        near = SAME_TIME * self.case.time.step
        stops = [t for t in self.milestones if self._is_kink(t) or t == self.milestones[-1]]
        for milestone in (t for t in self.milestones if t - self.history.shown > near):
            started, taken = perf_counter(), Solution()
            while milestone - time > near:
                if self.history.smooth and self._is_kink(time):
                    self.history.smooth = 0
                time, _, solution = self._accepted(time, next(t for t in stops if t - time > near))
                taken = taken + solution
            self.history.accepted += 1
            self.history.shown = milestone
            if time - milestone > near:
                self._at_end = self.system.snapshot()
                self._show(milestone)
            size = self.history.times[0] - self.history.times[1]
            yield Step(self.history.accepted, milestone, size, taken, perf_counter() - started)
            if self._at_end:
                self.system.restore(self._at_end)
                self._at_end = None

    def _show(self, time: float) -> None:
        """Let the system hold the state at a time within the last step, which depends on no other."""
        assert self._stages is not None
        system, history = self.system, self.history
        state, rate, acceleration = history.between(time)
        size = self._stages[0].gamma * (history.times[0] - history.times[1])
        base, base_rate = state - size * rate, rate - size * acceleration
        system.update(time)
        system.set_rates(backward_euler(size), (base, base), (base_rate, base_rate), time - history.times[1])
        system.values[:] = state
        system.prescribe()

    def _accepted(self, time: float, milestone: float) -> tuple[float, float, Solution]:
        """Take one step towards the milestone, and keep its state; return the new time, the step's size and cost."""
        size, solution = self._advance(time, milestone)
        self._keep(self._solved)
        at_milestone = abs(time + size - milestone) <= SAME_TIME * self.case.time.step
        time = milestone if at_milestone else time + size
        self.history.push(time, self.system.values.copy(), self.system.rates(), self._acceleration)
        self.history.smooth = 0 if self._is_kink(time) and not self._free else self.history.smooth + 1
        return time, size, solution

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
                if not self._free and self.history.size and self._may_grow:
                    self.history.size = 2 * self.history.size if 2 * self.history.size < self.case.time.step else None
                return size, solution

    def _attempt(self, time: float, size: float) -> Solution:
        if self._stages:
            return self._attempt_stages(time, size, self._stages)
        system, history, case = self.system, self.history, self.case
        previous = history.times[0] - history.times[1] if history.smooth >= 1 else None
        old = min(1, len(history.states) - 1)
        system.update(time + size)
        states, rates = (history.states[0], history.states[old]), (history.rates[0], history.rates[old])
        step, chosen = np.inf if case.time.scheme == "static" else size, weights(case.time.scheme, size, previous)
        system.set_rates(chosen, states, rates, step)
        predicted = history.extrapolated(time + size)
        self._start_from(predicted, size)
        ahead = weights(case.time.scheme, size, size).new
        solution = self.newton.solve(case.solver.tolerance, case.solver.max_iterations, ahead)
        if reason := self._inspect():
            raise SolverError(reason)
        self._check_accuracy(size, predicted)
        earlier = {0: (chosen.old, 0.0), -1: (chosen.older, 0.0)}
        self._solved = [Solved(time + size, step, chosen.new, system.values.copy(), earlier)]
        return solution

    def _start_from(self, predicted: Array, size: float) -> None:
        """Let the system hold a predicted state, or less of its change where sides that touch would part fast.

        Raises:
            StepRefusedError: they would come together too fast, and the step can be halved.
        """
        system, before, factor = self.system, self.history.states[0], 1.0
        system.values[:] = before
        gap = system.gaps()
        system.values[:] = predicted
        now = system.gaps()
        if np.any((now < CLOSES * gap) & (now < NEAR)) and size / 2 >= self.case.time.smallest_step:
            raise StepRefusedError("sides that are in contact would come too near to each other in it", size / 2)
        while np.any((now > OPENS * gap) & (gap < NEAR)) and factor > 1 - SHORTER:
            factor *= SHORTER
            system.values[:] = before + factor * (predicted - before)
            now = system.gaps()

    def _attempt_stages(self, time: float, size: float, tableaus: tuple[Tableau, Tableau]) -> Solution:
        system, history, wanted = self.system, self.history, self.case.solver
        tableau = tableaus[0 if history.smooth and history.accelerations else 1]
        stage = backward_euler(tableau.gamma * size)
        times, states = history.smooth_part()
        rates: list[Array] = []
        accelerations: list[Array] = []
        taken, solved = Solution(), list[Solved]()
        first = 0 if tableau.explicit else 1
        for row, place in zip(tableau.rows, tableau.places, strict=True):
            if row[-1] == 0.0:
                rates.append(history.rates[0])
                accelerations.append(history.accelerations[0])
                continue
            base = history.states[0] + size * _sum(row, rates)
            base_rate = history.rates[0] + size * _sum(row, accelerations)
            now = time + place * size
            system.update(now)
            system.set_rates(stage, (base, base), (base_rate, base_rate), place * size)
            self._start_from(_polynomial(*_nearest(times, states, now, APART * size), now), size)
            taken = taken + self.newton.solve(wanted.tolerance, wanted.max_iterations, stage.new)
            times, states = [now, *times], [system.values.copy(), *states]
            rates.append(system.rates())
            accelerations.append(stage.new * (rates[-1] - base_rate))
            earlier = {n: (0.0, stage.old * size * weight) for n, weight in enumerate(row[:-1], start=first)}
            earlier[0] = stage.old, earlier.get(0, (0.0, 0.0))[1]
            solved.append(Solved(now, place * size, stage.new, states[0], earlier))
        if reason := self._inspect():
            raise SolverError(reason)
        self._acceleration, self._solved = accelerations[-1], solved
        if self._free:
            self._control(size, self._over_scales(size * np.abs(_sum(tableau.estimate, rates))), tableau.estimate_order)
        return taken

    def _control(self, size: float, error: float, order: int) -> None:
        """Choose the size of the next step, or refuse this one and choose one to take instead."""
        allowed, smallest = self.case.time.error_tolerance, self.case.time.smallest_step
        assert allowed is not None
        excess = max(error / allowed, 1e-9)
        if excess > 1 and size * (1 - SAME_TIME) > smallest:
            smaller = max(smallest, size * max(SHRINK, SAFETY * excess ** (-1 / order)))
            reason = f"its estimated error {error:.2g} exceeds time.error_tolerance = {allowed:g}"
            raise StepRefusedError(reason, smaller)
        change = SAFETY * excess ** (-INTEGRAL / order) * self.history.error ** (PROPORTIONAL / order)
        if not 1 <= change <= KEEP:
            self.history.size = max(smallest, size * min(max(change, SHRINK), GROW))
        else:
            self.history.size = size
        self.history.error = max(excess, 1e-2)

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
        return self._over_scales(estimate)

    def _over_scales(self, estimate: Array) -> float:
        """Return the largest part of an error of the unknowns over the scales of displacement and velocity."""
        blocks, scales = self.system.unknowns.blocks, self.system.block_scales()
        both = [name for name in ("d", "w") if name in scales]
        return max(float(np.max(estimate[blocks[name]], initial=0.0)) / scales[name] for name in both)

    def _retreat(self, time: float, size: float, error: SolverError) -> None:
        """Halve the step, or take the size that the controller wants, or give up."""
        smaller = error.size if isinstance(error, StepRefusedError) else size / 2
        if smaller < self.case.time.smallest_step:
            acting = self.system.sentence()
            raise SolverError(
                f"the run ended at t = {time:.6g} s{f' with {acting}' if acting else ''}: a step of {size:.3g} s to "
                f"t = {time + size:.6g} s failed and time.smallest_step forbids a smaller one: {error}"
                f"{self._explain(self.history.accepted > 0)}"
            ) from error
        self.history.size = smaller
        self._say(f"t = {time:.6g} s: a step of {size:.3g} s failed ({error}); trying {smaller:.3g} s")


def _sum(weights: Sequence[float], arrays: list[Array]) -> Array | float:
    """Return the weighted sum of arrays, as many as there are; 0 if there is none."""
    return sum((weight * array for weight, array in zip(weights, arrays, strict=False)), start=0.0)


def _nearest(times: list[float], states: list[Array], now: float, apart: float) -> tuple[list[float], list[Array]]:
    """Return the three times nearest to a new one that differ by so much, with their states."""
    chosen: list[int] = []
    for i in sorted(range(len(times)), key=lambda i: abs(times[i] - now)):
        if all(abs(times[i] - times[j]) > apart for j in chosen):
            chosen.append(i)
    return [times[i] for i in chosen[:3]], [states[i] for i in chosen[:3]]
