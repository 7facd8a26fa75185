"""Pressures by gradients: the linear programme by a rule of its own, a layout that covers the skin, and a vein."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from ngfsi_geometry.calf_section import SectionSizes, subject

from ngfsi.case import Case
from ngfsi.cli import main
from ngfsi.errors import CaseError, SolverError
from ngfsi.gradient import design
from ngfsi.gradient.design import Layout, Limits, Pressed, improve
from ngfsi.gradient.design_command import grid, pressure, read_pressures, seconds
from ngfsi.gradient.design_in_time import Cycle, Cycled
from ngfsi.gradient.functionals import measured
from ngfsi.store.table import read_rows
from ngfsi.units import MMHG
from tests.gradient.test_gradient import VEIN
from tests.vein import BONED, Array, domain_of

LAYOUT = Layout(1, 4, 0.0, 10e-3)


def test_the_layout_covers_the_skin_once() -> None:
    """Smooth edges of neighbours add up to one, so that the parts do, and equal sectors have equal parts."""
    domain = domain_of(BONED)
    layout = Layout.on(domain, 2, 3)
    assert (layout.bottom, layout.top) == pytest.approx((0.0, BONED.length), abs=1e-9)
    weights = layout.weights(domain)
    assert weights.sum() == pytest.approx(1.0, rel=1e-3)
    assert weights == pytest.approx(1 / 6, rel=0.05)
    assert {frozenset(pair) for pair in layout.neighbours()} == {
        frozenset(pair) for pair in ((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5))
    }


def step(slopes: Array, weights: Array, **limits: float) -> Array:
    """Return the step from a pressure of 1 everywhere, within a region without end, with no bound on the volume."""
    count = len(weights)
    pairs = [(n, n + 1) for n in range(count - 1)]
    given = Limits(**{"mean": 1.0, "high": 3.0, **limits})
    by = np.array([slopes]), np.zeros((1, count))
    return design._step(np.ones(count), np.zeros(1), np.zeros(1), by, np.ones(1), weights, pairs, given, 100.0, 1e3)


def test_the_linear_programme_fills_the_best_first() -> None:
    """With a bounded mean the cuffs get the highest pressure in the order of slope over part, as in a knapsack."""
    random = np.random.default_rng(5)
    slopes, weights = random.uniform(0.1, 1.0, 12), random.dirichlet(np.full(12, 5.0))
    wanted, left = np.zeros(12), 1.0
    for place in np.argsort(-slopes / weights):
        wanted[place] = min(3.0, left / weights[place])
        left -= wanted[place] * weights[place]
    assert 1 + step(slopes, weights) == pytest.approx(wanted, abs=1e-9)
    smooth = 1 + step(slopes, weights, jump=0.5)
    assert np.abs(np.diff(smooth)).max() == pytest.approx(0.5)
    assert smooth @ weights == pytest.approx(1.0)


def test_the_least_of_several_is_raised() -> None:
    """Of two aims with a slope each the lower one gets all until they meet, and a loss ends it before."""
    slopes, weights, given = np.eye(2), np.array([0.5, 0.5]), Limits(mean=1.0, high=9.0)

    def pressures(most: float, cost: float = 1e3) -> Array:
        by = slopes, np.array([[0.0, 1.0]])
        return 1 + design._step(
            np.ones(2), np.array([5.0, 4.0]), np.zeros(1), by, np.array([most]), weights, [], given, 100.0, cost
        )

    assert pressures(9.0) == pytest.approx([0.5, 1.5])
    assert pressures(0.25)[1] == pytest.approx(1.25)
    assert pressures(-0.25)[1] == pytest.approx(0.75)  # what loses too much gives way
    assert pressures(0.25, cost=0.9)[1] == pytest.approx(1.5)  # a limit that costs less than it brings


def test_slopes_are_those_of_differences() -> None:
    """Of the least station's shear and of its area lost, by each cuff; the stations' shears add up to the wall's."""
    domain = domain_of(BONED)
    pressed = Pressed(VEIN, "sawss_least", LAYOUT, domain, Limits(mean=400.0, high=800.0, section_loss=0.5))
    start = np.array([100.0, 300.0, 500.0, 200.0])
    at = pressed.solve(start)
    at = replace(at, losses=np.ones_like(at.losses))  # all count
    aims, losses = pressed.slopes(at, float(at.aims.min()))
    assert not np.isnan(aims).any()
    for place in (1, 2):
        ends = [pressed.solve(start + sign * (np.arange(4) == place)) for sign in (1, -1)]
        for by, name in ((aims, "aims"), (losses, "losses")):
            expected = (getattr(ends[0], name) - getattr(ends[1], name)) / 2
            assert by[:, place] == pytest.approx(expected, rel=1e-4, abs=1e-4 * np.abs(expected).max()), name
    one, whole = at.run.measured, measured(at.run.system, "sawss")._integrals()  # type: ignore[attr-defined]
    parts = [one[name]._integrals() for name in pressed.aims]  # type: ignore[attr-defined]
    for key in ("shear", "size"):
        assert sum(part[key] for part in parts) == pytest.approx(whole[key], rel=1e-6)


def test_a_vein_is_pressed_where_it_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Mean and highest pressure hold, the wall's shear is more, and one without an equilibrium is a step too far."""
    domain = domain_of(BONED)
    limits, failed = Limits(mean=400.0, high=800.0), []
    solve = Pressed.solve

    def fails_once(self: Pressed, pressures: Array) -> object:
        if not failed and np.ptp(pressures) > 0:
            failed.append(pressures)
            raise SolverError("no equilibrium")
        return solve(self, pressures)

    monkeypatch.setattr(Pressed, "solve", fails_once)
    found = improve(VEIN, "sawss", LAYOUT, limits, domain, most=1)
    assert failed[0] == pytest.approx(np.where(failed[0] > 400, 800.0, 0.0), abs=1e-6)
    assert np.abs(found.pressures - 400.0).max() == pytest.approx(400.0 / 3, rel=1e-6)
    assert found.pressures @ LAYOUT.weights(domain) == pytest.approx(400.0, rel=1e-3)
    assert found.value > found.history[0]
    assert (found.runs, found.sweeps) == (2, 2)
    assert len(found.case.loads.cuffs) == 4


def test_the_worst_of_two_is_raised() -> None:
    """A vein with half of the flow has half of the shear: its own counts, and what suits it alone is found."""
    domain, limits = domain_of(BONED), Limits(mean=400.0, high=800.0)
    slow = VEIN.replace(**{"loads.inlet_flow.value": 1.4565e-6})
    alone, both = (
        improve(slow, "sawss", LAYOUT, limits, domain, most=1, others=others) for others in ((), [(VEIN, domain)])
    )
    assert both.history == pytest.approx(alone.history, rel=1e-6)
    assert both.pressures == pytest.approx(alone.pressures, rel=1e-6)
    assert both.runs == 2 * alone.runs


def test_a_cycle_covers_time_once() -> None:
    """Shares of the times add up to one, are whole at their own, and means are those of the curves themselves."""
    cycle = Cycle(1, 2, 0.0, 10e-3, times=(0.0, 0.1, 0.3), cycles=2)
    assert cycle.count == 4
    assert cycle.shares(0.1) == pytest.approx([0, 1])
    for end in (0.3, 3 * 0.1, 0.6):
        assert cycle.shares(end) == pytest.approx([1, 0])
    assert cycle.shares(0.35) == pytest.approx([0.5, 0.5])
    pressures = np.array([1.0, 4.0, 2.0, 8.0])
    times = np.linspace(0.3, 0.6, 3001)
    for number, cuff in enumerate(cycle.cuffs(pressures)):
        curve = [cuff.pressure(float(t)) for t in times]
        assert np.trapezoid(curve, times) / 0.3 == pytest.approx(cycle.mean(pressures)[number])
        assert curve[700] == pytest.approx(cycle.over_time(pressures)[number] @ cycle.shares(float(times[700])))
    assert {frozenset(pair) for pair in cycle.neighbours()} == {frozenset(p) for p in ((0, 2), (1, 3), (0, 1), (2, 3))}
    begun = Cycle(2, 1, 0.0, 1.0, times=(0.0, 1.0, 2.0, 3.0, 4.0)).begun(3.0, 0.0, 4.0)
    assert begun == pytest.approx([3.5, 3.0, 2.5, 3.0, 3.0, 3.5, 3.0, 2.5])


CYCLE = Cycle(1, 3, 0.0, 10e-3, times=(0.0, 0.1, 0.2), cycles=1)
TIMED = VEIN.replace(**{"time.step": 0.1, "time.end": 0.2})


def test_slopes_of_cycles_are_those_of_differences() -> None:
    """Of the mean of the wall's shear over a cycle and of the largest loss, along a direction of all pressures."""
    domain = domain_of(BONED)
    pressed = Cycled(TIMED, "sawss", CYCLE, domain, Limits(mean=400.0, high=800.0))
    start, along = np.array([100.0, 500.0, 300.0, 600.0, 500.0, 200.0]), np.array([0.1, -0.2, 0.05, 0.1, -0.1, 0.3])
    at = pressed.solve(start)
    aims, losses = pressed.slopes(at, float(at.aims.min()))
    ends = [pressed.solve(start + sign * along) for sign in (1, -1)]
    for by, name in ((aims, "aims"), (losses, "losses")):
        expected = (getattr(ends[0], name) - getattr(ends[1], name)) / 2
        assert by @ along == pytest.approx(expected, rel=1e-5), name


def test_cycles_at_rest_are_many_legs_at_rest() -> None:
    """Without rates each time counts for itself: with the same pressures at all, as much as it lasts of what they bring
    at rest, so that no change in time promises anything."""
    domain, limits = domain_of(BONED), Limits(mean=400.0, high=800.0)
    cycle = replace(CYCLE, times=(0.0, 0.1, 0.2))
    still, cycled = (
        Pressed(VEIN, "sawss", LAYOUT, domain, limits),
        Cycled(TIMED.replace(**{"time.scheme": "static"}), "sawss", replace(cycle, sectors=4), domain, limits),
    )
    at, over = np.array([300.0, 500.0, 450.0, 350.0]), cycled.solve(np.repeat([300.0, 500.0, 450.0, 350.0], 2))
    rest = still.solve(at)
    expected, _ = still.slopes(rest, 1.0)
    found, _ = cycled.slopes(over, 1.0)
    assert over.aims == pytest.approx(rest.aims, rel=1e-6)
    assert over.losses == pytest.approx(rest.losses, rel=1e-6)
    assert found.reshape(4, 2) == pytest.approx(np.outer(expected, [0.5, 0.5]), rel=1e-5)


def test_command(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(design, "ENOUGH", 1.0)  # nothing promises so much: the first pressures stay
    (tmp_path / "case.toml").write_text(VEIN.to_toml())
    with pytest.raises(SystemExit) as ended:
        main(["design", str(tmp_path / "case.toml"), "--mean", "3mmHg", "--high", "6mmHg", "--cuffs", "1x3", "--quiet",
              "--also", "materials.tissue.poisson=0.35", "--section-loss", "0.5",
              "-o", str(tmp_path / "out")])  # fmt: skip
    assert not ended.value.code
    rows = read_rows(tmp_path / "out" / "pressures.csv")
    assert [row["pressure_Pa"] for row in rows] == pytest.approx([3 * MMHG] * 3)
    assert Case.from_toml(tmp_path / "out" / "case.toml").time.scheme == "static"
    assert (tmp_path / "out" / "pressures.png").stat().st_size > 1000
    assert not list((tmp_path / "out").glob(".*"))
    assert read_pressures(tmp_path / "out" / "pressures.csv", Layout(1, 3, 0.0, 1.0)) == pytest.approx([3 * MMHG] * 3)
    with pytest.raises(CaseError, match="has no column pressure_Pa of 4 values"):
        read_pressures(tmp_path / "out" / "pressures.csv", LAYOUT)
    shown = capsys.readouterr().out
    assert "0 % more than under the pressures begun with" in shown
    assert "2 runs" in shown
    assert "of a section at most is lost" in shown


def test_what_is_refused() -> None:
    assert pressure("12 mmHg", "--mean") == pytest.approx(12 * MMHG)
    for text in ("12", "12mm", "x"):
        with pytest.raises(CaseError, match=f"--mean {text} is no pressure"):
            pressure(text, "--mean")
    assert grid("4x14") == (4, 14)
    for text in ("4", "0x3", "3x2"):
        with pytest.raises(CaseError, match=f"--cuffs {text} is not understood"):
            grid(text)
    with pytest.raises(CaseError, match=r"--times 0,a is not understood"):
        seconds("0,a")
    with pytest.raises(CaseError, match=r"--times 0,1: write three times \(s\) or more"):
        Cycle.of(LAYOUT, (0.0, 1.0), VEIN)
    with pytest.raises(CaseError, match=r"the run ends at 0.2 s, before a cycle of 0.25 s"):
        Cycle.of(LAYOUT, (0.0, 0.1, 0.25), VEIN)
    assert Cycle.of(LAYOUT, (0.0, 0.04, 0.16), VEIN).cycles == pytest.approx(1.25)
    with pytest.raises(CaseError, match="of 2 mmHg is not between 0 mmHg and 1 mmHg"):
        Limits(mean=2 * MMHG, high=1 * MMHG)
    with pytest.raises(CaseError, match="cannot differ by -1 mmHg"):
        Limits(mean=1 * MMHG, high=2 * MMHG, jump=-1 * MMHG)
    with pytest.raises(CaseError, match=r"'flow_in_least' is not a known quantity at stations.*area_least, sawss"):
        improve(VEIN, "flow_in_least", LAYOUT, Limits(mean=100.0, high=200.0), domain_of(BONED))
    with pytest.raises(CaseError, match="a design is for a segment in 3-D"):
        Layout.on(domain_of(subject(1, mesh=SectionSizes(far_size=14e-3, bone_size=9e-3, vein_size=3e-3))), 1, 3)
