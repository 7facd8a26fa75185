"""The time loop on a linear equation whose solution is known: order, kinks of the loads, failing and growing steps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from ngfsi.case import Case
from ngfsi.config.functions import PressureRamp, PressureTable
from ngfsi.errors import SolverError
from ngfsi.solve.newton import Solution
from ngfsi.solve.time_loop import History, Step, TimeLoop
from ngfsi.system.schemes import Weights, bdf2
from tests.vein import case_of

Vector = NDArray[np.float64]

DECAY = 3.0
END = 1.5


@dataclass
class Scalar:
    """y'' + DECAY y' + 5 y = p(t) in the shape of a System: rates of the state and of its rate, by the same weights."""

    case: Case
    values: Vector = field(default_factory=lambda: np.zeros(1))
    unknowns: Any = field(default_factory=lambda: SimpleNamespace(size=1, blocks={"d": np.array([0])}))
    load: float = 0.0
    time: float = 0.0
    weights: list[Weights] = field(default_factory=list)
    sizes: list[float] = field(default_factory=list)
    accepted: list[float] = field(default_factory=list)
    new: float = 0.0
    velocity_history: Vector = field(default_factory=lambda: np.zeros(1))
    acceleration_history: Vector = field(default_factory=lambda: np.zeros(1))

    def update(self, t: float) -> None:
        self.time, self.load = t, self.case.loads.skin_pressure(t)

    def set_rates(self, w: Weights, states: tuple[Vector, Vector], rates: tuple[Vector, Vector], step: float) -> None:
        self.weights.append(w)
        self.sizes.append(step)
        self.new = w.new
        self.velocity_history = w.old * states[0] + w.older * states[1]
        self.acceleration_history = w.old * rates[0] + w.older * rates[1]

    def snapshot(self) -> dict[str, Vector]:
        rates = np.array([self.new, self.velocity_history[0], self.acceleration_history[0]])
        return {"values": self.values.copy(), "load": np.array([self.load]), "rates": rates}

    def restore(self, snapshot: dict[str, Vector]) -> None:
        self.values[:], self.load = snapshot["values"], float(snapshot["load"][0])
        self.new, self.velocity_history[:], self.acceleration_history[:] = snapshot["rates"]

    def accept(self) -> None:
        self.accepted.append(self.time)

    def prescribe(self) -> None:
        pass

    def sentence(self) -> str:
        return f"{self.load:.4g} Pa on the skin"

    def gaps(self) -> Vector:
        return np.zeros(0)

    def block_scales(self) -> dict[str, float]:
        return {"d": 1.0}

    def rates(self) -> Vector:
        return self.new * self.values + self.velocity_history

    def solve(self) -> None:
        # a = n (n y + hv) + ha, v = n y + hv
        n, hv, ha = self.new, self.velocity_history, self.acceleration_history
        self.values[:] = (self.load - (n + DECAY) * hv - ha) / (n * n + DECAY * n + 5.0)


class Fake:
    """A Newton that solves the scalar equation, unless a rule makes a step from one time to another fail."""

    def __init__(self, system: Scalar, fails: Callable[[float, float], bool]) -> None:
        self.system, self.fails = system, fails
        self.time = 0.0

    def arrays(self) -> dict[str, Vector]:
        return {}

    def restore(self, _arrays: dict[str, Vector]) -> None:
        pass

    def solve(self, tolerance: float, max_iterations: int, ahead: float | None = None) -> Solution:
        wanted = self.system.case.solver
        assert (tolerance, max_iterations) == (wanted.tolerance, wanted.max_iterations)
        assert ahead is not None
        if self.fails(self.time, self.system.time):
            self.system.values[:] = 1e9
            raise SolverError("told to fail")
        self.system.solve()
        self.time = self.system.time
        return Solution(iterations=1)


RAMP = PressureRamp(final=5.0, start=0.0, duration=1.0)


@dataclass
class Outcome:
    """What a run gave."""

    steps: list[Step] = field(default_factory=list)
    values: list[float] = field(default_factory=list)
    lines: list[str] = field(default_factory=list)
    system: Any = None

    @property
    def times(self) -> list[float]:
        return [step.time for step in self.steps]

    @property
    def sizes(self) -> list[float]:
        return [step.size for step in self.steps]


def never(_start: float, _end: float) -> bool:
    return False


def run(
    step: float,
    load: Any,
    scheme: str = "bdf2",
    *,
    end: float = END,
    smallest: float = 1e-3,
    fails: Callable[[float, float], bool] = never,
    inspect: Callable[[], str] = lambda: "",
    tolerance: float | None = None,
    outcome: Outcome | None = None,
) -> Outcome:
    """Run the scalar equation; `outcome` is filled even if the run fails."""
    case = case_of(
        **{
            "time.step": step,
            "time.end": end,
            "time.scheme": scheme,
            "time.smallest_step": smallest,
            "loads.skin_pressure": load,
            "time.error_tolerance": tolerance,
        }
    )
    outcome = outcome or Outcome()
    outcome.system = Scalar(case)
    newton = Fake(outcome.system, fails)
    loop = TimeLoop(case, outcome.system, newton, inspect, outcome.lines.append)  # type: ignore[arg-type]
    for taken in loop.run():
        outcome.steps.append(taken)
        outcome.values.append(float(outcome.system.values[0]))
    return outcome


def error(load: Any, step: float, scheme: str, tolerance: float | None = None) -> float:
    """Largest error over the steps, against an integrator of high order that is stopped at the kinks."""
    outcome = run(step, load, scheme, smallest=1e-6, tolerance=tolerance)
    times = np.array(outcome.times)
    y, t, exact = np.zeros(2), 0.0, []
    for until in sorted({*(k for k in load.breakpoints if 0 < k < END), END}):
        inside = times[(times > t + 1e-12) & (times <= until + 1e-12)]
        result = solve_ivp(
            lambda s, v: [v[1], load(s) - DECAY * v[1] - 5 * v[0]], (t, until), y, t_eval=inside, rtol=1e-11, atol=1e-13
        )
        exact += list(result.y[0])
        y, t = result.y[:, -1], until
    return float(np.max(np.abs(np.array(outcome.values) - exact)))


OFF = PressureTable(times=(0.0, 0.3713, 0.9027), values=(0.0, 6.0, 1.0))


@pytest.mark.parametrize(
    ("scheme", "order", "coarsest"),
    [("bdf2", 2, 0.05), ("backward_euler", 1, 0.05), ("esdirk3", 3, 0.1), ("sdirk4", 4, 0.2)],
)
@pytest.mark.parametrize("load", [RAMP, OFF], ids=["on grid", "off grid"])
def test_order(scheme: str, order: int, coarsest: float, load: Any) -> None:
    """Also with steps cut short before a kink and restarted after it."""
    errors = [error(load, coarsest / 2**k, scheme) for k in range(5)]
    assert np.log2(errors[0] / errors[-1]) / 4 == pytest.approx(order, abs=0.15 if order > 2 else 0.06)


def test_kinks_and_end_are_met_and_the_scheme_restarts_there() -> None:
    outcome = run(0.2, OFF, end=1.1)
    times = [0.2, 0.3713, 0.4, 0.6, 0.8, 0.9027, 1.0, 1.1]
    assert outcome.times == pytest.approx(times, rel=1e-14)
    assert outcome.sizes == pytest.approx(np.diff([0.0, *times]), rel=1e-12)
    assert [s.index for s in outcome.steps] == list(range(1, 9))
    restarted = [w.older == 0 for w in outcome.system.weights]
    assert restarted == [True, False, True, False, False, False, True, False]
    simple = run(0.2, OFF, "backward_euler", end=1.1).system
    assert all(w.older == 0 and w.old == -w.new for w in simple.weights)


@pytest.mark.parametrize("step", [0.1, 0.05, 1 / 3, 0.07])
def test_kinks_on_the_grid_are_no_extra_steps(step: float) -> None:
    """Sums of these steps are not exactly the kink at 1 s."""
    outcome = run(step, RAMP)
    assert min(abs(t - 1.0) for t in outcome.times) < 1e-12
    assert outcome.times[-1] == END
    assert min(outcome.sizes) > 0.01 * step
    assert np.all(np.diff(outcome.times) > 0)


def test_planned_number_of_steps() -> None:
    case = case_of(**{"time.step": 0.2, "time.end": 1.1, "loads.skin_pressure": OFF})
    assert len(TimeLoop(case, None, None, lambda: "", print).milestones) == 8  # type: ignore[arg-type]


def test_steps_are_halved_on_failure_and_grow_back() -> None:
    """Steps longer than 0.03 that start between 0.3 and 0.5 fail."""
    outcome = run(0.1, RAMP, end=1.0, fails=lambda a, b: 0.3 - 1e-9 < a < 0.5 - 1e-9 and b - a > 0.03)
    starts = np.array([0.0, *outcome.times[:-1]])
    sizes = np.array(outcome.sizes)
    hard = (starts > 0.3 - 1e-9) & (starts < 0.5 - 1e-9)
    assert np.all(sizes[hard] <= 0.03)
    assert np.all(sizes[hard] >= 0.0125)  # no smaller than a halving needs
    assert sizes[~hard][:3] == pytest.approx([0.1] * 3)
    assert sizes[-3:] == pytest.approx([0.1] * 3)
    assert np.all(sizes[1:] <= 4 * sizes[:-1] * (1 + 1e-9))
    assert {round(t, 9) for t in outcome.times} >= {0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0}
    assert outcome.lines[0] == "t = 0.3 s: a step of 0.1 s failed (told to fail); trying 0.05 s"
    assert outcome.lines[1] == "t = 0.3 s: a step of 0.05 s failed (told to fail); trying 0.025 s"
    smooth = run(0.1, RAMP, end=1.0)
    finer = run(0.00625, RAMP, end=1.0)
    truth = finer.values[-1]
    assert abs(outcome.values[-1] - truth) < 1.5 * abs(smooth.values[-1] - truth)


def test_an_unacceptable_state_is_a_failed_step() -> None:
    complaints = iter(["", "", "turned inside out", *[""] * 100])
    outcome = run(0.25, RAMP, end=1.0, inspect=lambda: next(complaints))
    assert outcome.sizes == pytest.approx([0.25, 0.25, 0.125, 0.125, 0.25], rel=1e-9)
    assert "turned inside out" in outcome.lines[0]


def goes_on(loop: Callable[[], tuple[TimeLoop, Scalar]], stops: Sequence[int], file: Path) -> None:
    """Times, sizes, values and rates of a loop that is stored after so many steps are those of one that never was."""

    def steps(running: TimeLoop, system: Scalar) -> list[tuple[float, ...]]:
        return [(step.time, step.size, float(system.values[0]), float(system.rates()[0])) for step in running.run()]

    wanted = steps(*loop())
    for stopped_after in stops:
        first, _ = loop()
        for _ in zip(range(stopped_after), first.run(), strict=False):
            pass
        np.savez(file, **first.arrays())  # type: ignore[arg-type] # of mypy's view of **
        second, system = loop()
        with np.load(file, allow_pickle=False) as stored:
            second.restore(stored)
        assert second.time == wanted[stopped_after - 1][0]
        assert steps(second, system) == wanted[stopped_after:]


def test_a_stored_history_goes_on_as_if_never_stopped(tmp_path: Path) -> None:
    """Stopped before and after a kink of the load, stored on disk: the same times and values to the last bit."""

    def loop() -> tuple[TimeLoop, Scalar]:
        case = case_of(**{"time.step": 0.1, "time.end": 1.1, "loads.skin_pressure": OFF})
        system = Scalar(case)
        return TimeLoop(case, system, Fake(system, never)), system  # type: ignore[arg-type]

    goes_on(loop, (1, 3, 8), tmp_path / "loop.npz")


def test_giving_up() -> None:
    """With the last accepted state, and a sentence with time, load, size and reason."""
    outcome = Outcome()
    with pytest.raises(SolverError) as caught:
        run(0.1, RAMP, smallest=0.02, fails=lambda _, end: end > 0.52, outcome=outcome)
    assert outcome.times[-1] == pytest.approx(0.5)
    assert outcome.system.values[0] == outcome.values[-1]
    sentence = str(caught.value)
    assert sentence.startswith(
        "the run ended at t = 0.5 s with 2.5 Pa on the skin: a step of 0.025 s to t = 0.525 s failed"
    )
    assert sentence.endswith("time.smallest_step forbids a smaller one: told to fail")
    assert len(outcome.lines) == 2


def test_predictor_is_the_polynomial_since_the_last_kink() -> None:
    y = np.polynomial.Polynomial([1.0, -2.0, 3.0])
    history = History()
    for t in (0.0, 0.1, 0.15, 0.35):
        history.push(t, np.array([y(t)]), np.array([0.0]))
    assert history.times == [0.35, 0.15, 0.1]
    for smooth, expected in (
        (0, y(0.35)),
        (1, y(0.35) + (y(0.35) - y(0.15)) / 0.2 * 0.05),
        (2, y(0.4)),
        (7, y(0.4)),
    ):
        history.smooth = smooth
        assert history.extrapolated(0.4)[0] == pytest.approx(expected, rel=1e-12)


def test_steps_that_follow_the_error() -> None:
    """With a 64th of the tolerance much smaller errors; milestones are met, and steps grow back."""
    found = {}
    for tolerance in (1e-3, 1e-3 / 64):
        outcome = run(0.1, OFF, end=END, smallest=1e-6, tolerance=tolerance)
        found[tolerance] = outcome, error(OFF, 0.1, "bdf2", tolerance)
        assert {round(t, 9) for t in outcome.times} >= {0.3713, 0.9027, *(round(0.1 * k, 9) for k in range(1, 16))}
        assert any("its estimated error" in line for line in outcome.lines)
    (coarse, coarse_error), (fine, fine_error) = found.values()
    assert fine_error < coarse_error / 8
    assert len(fine.steps) > 2 * len(coarse.steps)
    for outcome in (coarse, fine):
        smallest = int(np.argmin(outcome.sizes))
        assert max(outcome.sizes[smallest:]) > 1.9 * outcome.sizes[smallest]


@pytest.mark.parametrize("scheme", ["esdirk3", "sdirk4"])
def test_schemes_in_stages_choose_their_steps_and_interpolate(scheme: str) -> None:
    """Errors follow the tolerance, at times between the steps, too; steps end at kinks, and not at other times."""
    found = {}
    for tolerance in (1e-3, 1e-6):
        outcome = run(0.01, OFF, scheme, smallest=1e-6, tolerance=tolerance)
        found[tolerance] = len(set(outcome.system.sizes)), error(OFF, 0.01, scheme, tolerance)
        wanted = sorted([0.3713, 0.9027, *(round(0.01 * k, 9) for k in range(1, 151))])
        assert outcome.times == pytest.approx(wanted, rel=1e-12)
        assert [step.index for step in outcome.steps] == list(range(1, 153))
        at_once = sum(step.solution.iterations == 0 for step in outcome.steps)
        assert at_once > {1e-3: 120, 1e-6: 40}[tolerance]
    assert found[1e-3][1] < 2e-3
    assert found[1e-6][1] < 6e-6
    assert run(0.1, OFF, scheme, tolerance=1e-6).lines  # the first step is too long


def test_interpolation_within_a_step() -> None:
    """Exact for cubics and their rates; after a kink, of whose other side the old rates are, for quadratics."""
    for smooth, coefficients in ((2, (1.0, -2.0, 3.0, 5.0)), (1, (1.0, -2.0, 3.0))):
        y = np.polynomial.Polynomial(coefficients)
        history = History()
        for t in (0.1, 0.3):
            wrong = 7.0 if (smooth, t) == (1, 0.1) else 0.0
            history.push(t, *(np.array([y.deriv(n)(t) + wrong * (n > 0) if n else y(t)]) for n in range(3)))
        history.smooth = smooth
        for t in (0.1, 0.17, 0.3):
            assert np.ravel(history.between(t)) == pytest.approx([y(t), y.deriv()(t), y.deriv(2)(t)], rel=1e-12)


def test_a_free_scheme_goes_on_as_if_never_stopped(tmp_path: Path) -> None:
    """Also from between its steps: the same times, values and rates to the last bit."""

    def loop() -> tuple[TimeLoop, Scalar]:
        case = case_of(**{"time.step": 0.02, "time.end": 1.1, "loads.skin_pressure": OFF, "time.scheme": "esdirk3",
                          "time.error_tolerance": 1e-3})  # fmt: skip
        system = Scalar(case)
        return TimeLoop(case, system, Fake(system, never)), system  # type: ignore[arg-type]

    goes_on(loop, (1, 9, 18, 30, 46), tmp_path / "loop.npz")


@pytest.mark.parametrize(("scheme", "uses"), [("esdirk3", True), ("sdirk4", False)])
def test_after_a_kink_the_acceleration_before_it_has_no_influence(scheme: str, uses: bool) -> None:
    """It is that of the other side; the explicit stage of esdirk3 uses it elsewhere."""

    def end(smooth: int, acceleration: float) -> float:
        case = case_of(**{"time.step": 0.1, "time.end": 0.2, "loads.skin_pressure": RAMP, "time.scheme": scheme})
        system = Scalar(case)
        zero = np.zeros(1)
        history = History(
            [0.1, 0.0], [zero, zero], [zero, zero], smooth, accelerations=[np.array([acceleration]), zero]
        )
        next(TimeLoop(case, system, Fake(system, never), history=history).run())  # type: ignore[arg-type]
        return float(system.values[0])

    assert end(0, 1e3) == end(0, 0.0)
    assert (end(1, 1e3) != end(1, 0.0)) == uses


def test_stages_share_one_matrix_and_models_see_the_time_since_the_last_state() -> None:
    for scheme, places in (("esdirk3", (0.871733, 0.6, 1.0)), ("sdirk4", (0.25, 0.75, 0.55, 0.5, 1.0))):
        system = run(0.1, RAMP, scheme, end=0.3).system
        assert len({w.new for w in system.weights}) == pytest.approx(1, abs=2)  # to rounding of the steps
        assert np.ptp([w.new for w in system.weights]) < 1e-12 * system.weights[0].new
        assert system.sizes[-len(places) :] == pytest.approx([0.1 * place for place in places], rel=1e-5)
        assert system.accepted == pytest.approx([0.0, 0.1, 0.2])


AT, OLDER, STILL_OLDER, NEXT = 0.4, 0.35, 0.33, 0.5
"""Times of the states that are known, and the end of the step to come."""
SCALES = {"d": 2.0, "w": 5.0, "p": 1e-9}
PARTS = {"d": np.array([0, 1]), "w": np.array([2]), "p": np.array([3])}


class Power(Scalar):
    """Unknowns in blocks, each a multiple of a power of the time: their rates are given, their states are not."""

    def __init__(self, case: Case, factors: Vector, power: int) -> None:
        super().__init__(case, np.zeros(4), SimpleNamespace(size=4, blocks=PARTS))
        self.factors, self.power = factors, power

    def rate(self, t: float) -> Vector:
        return self.power * t ** (self.power - 1) * self.factors

    def solve(self) -> None:
        self.values[:] = (self.rate(self.time) - self.velocity_history) / self.new

    def block_scales(self) -> dict[str, float]:
        return SCALES


def next_step(
    tolerance: float,
    factors: Vector,
    power: int = 3,
    smooth: int = 2,
    smallest: float = 1e-3,
    size: float | None = None,
) -> tuple[float, float | None]:
    """Return the size of the step that is taken from exact states, and the size to be tried next."""
    time: dict[str, Any] = {
        "time.step": NEXT - AT,
        "time.end": NEXT,
        "time.smallest_step": smallest,
        "time.error_tolerance": tolerance,
    }
    case = case_of(**time)
    system = Power(case, factors, power)
    times = [AT, OLDER, STILL_OLDER]
    rates = [system.rate(t) for t in times]
    history = History(times, [t**power * factors for t in times], rates, smooth, 3, size)
    system.time = AT
    newton: Any = Fake(system, never)
    loop = TimeLoop(case, system, newton, history=history)  # type: ignore[arg-type]
    return next(loop.run()).size, history.size


def error_of_bdf2(step: float) -> float:
    """Return that of the next state of t^3."""
    w, end = bdf2(step, AT - OLDER), AT + step
    return abs((3 * end**2 - w.old * AT**3 - w.older * OLDER**3) / w.new - end**3)


@pytest.mark.parametrize(
    ("factors", "share"),
    [((1, -4, 0, 9), 4 / 2), ((-4, 1, 3, 9), 4 / 2), ((1, 1, -15, 9), 15 / 5), ((0, 0, 2, 9), 2 / 5)],
)
def test_a_step_is_refused_from_its_error_on(factors: tuple[float, ...], share: float) -> None:
    """That of the worst unknown of displacement and velocity against its scale; exact for a cubic, whatever the sizes
    of the steps before. A step that cannot be halved is taken as it is."""
    whole, exact = NEXT - AT, share * error_of_bdf2(NEXT - AT)
    assert next_step(1.000001 * exact, np.array(factors))[0] == pytest.approx(whole)
    assert next_step(0.999999 * exact, np.array(factors))[0] == pytest.approx(whole / 2)
    assert next_step(1e-3 * exact, np.array(factors), smallest=whole / 2.01)[0] == pytest.approx(whole / 2)
    assert next_step(1e-3 * exact, np.array(factors), smallest=whole / 1.99)[0] == pytest.approx(whole)


@pytest.mark.parametrize("smooth", [0, 1])
def test_error_of_the_first_steps_after_a_kink(smooth: int) -> None:
    """h^2 for t^2, exact for backward Euler, and taken for the second step, too."""
    factors, exact = np.array([1.0, -4.0, 3.0, 9.0]), 4 / 2 * (NEXT - AT) ** 2
    assert next_step(1.000001 * exact, factors, 2, smooth)[0] == pytest.approx(NEXT - AT)
    assert next_step(0.999999 * exact, factors, 2, smooth)[0] == pytest.approx((NEXT - AT) / 2)


def test_steps_grow_where_their_error_is_a_tenth_of_what_is_allowed() -> None:
    quarter = (NEXT - AT) / 4
    exact = 2 * error_of_bdf2(quarter)
    for tolerance, wanted in ((9.99999 * exact, quarter), (10.00001 * exact, 2 * quarter)):
        found = next_step(tolerance, np.array([0.0, 4.0, 0.0, 0.0]), size=quarter)
        assert found == pytest.approx((quarter, wanted))


@pytest.mark.parametrize(("last_good", "said"), [(0.0, "begun: False"), (0.5, "begun: True")])
def test_the_end_is_explained_knowing_whether_any_step_was_taken(last_good: float, said: str) -> None:
    case = case_of(**{"time.step": 0.25, "time.end": END, "time.smallest_step": 0.2, "loads.skin_pressure": RAMP})
    system = Scalar(case)
    newton = Fake(system, lambda start, _end: start >= last_good - 1e-9)
    loop = TimeLoop(case, system, newton, explain=lambda begun: f", begun: {begun}")  # type: ignore[arg-type]
    with pytest.raises(SolverError, match=f"told to fail, {said}$"):
        list(loop.run())
