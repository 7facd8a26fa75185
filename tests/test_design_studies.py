"""Studies of designs: each factor changes what it names and nothing else, profiles have the mean that they promise."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from math import isclose, pi
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from ngfsi_studies import compare_tissues, sensitivity, stocking_design
from ngfsi_studies.stocking_design import BOUND, PERIOD, RANGES, STANDARD, Profile

from ngfsi.mesh.domain import Domain
from ngfsi.study import Outcome, Results, Study
from ngfsi.study.design import Indices, morris

BASE = sensitivity.base_case(compare_tissues.COARSE)
NAMED = {
    "tissue_K_kPa": lambda c: c.materials.tissue.K,
    "tissue_stiffness_1": lambda c: [getattr(c.materials.tissue, name) for name in ("c10", "c01", "c11")],
    "wall_young_kPa": lambda c: c.materials.wall.young,
    "wall_thickness_mm": lambda c: c.geometry.wall_thickness,
    "vein_x_mm": lambda c: c.geometry.vein_x,
    "vein_y_mm": lambda c: c.geometry.vein_y,
    "lumen_mm": lambda c: c.geometry.lumen_diameter,
    "flow_ml_s": lambda c: c.loads.inlet_flow(0.5),
    "outlet_mmHg": lambda c: c.loads.outlet_pressure(0.5),
    "ends_1": lambda c: c.conditions.ends,
    "state_1": lambda c: c.conditions.initial_state,
}
"""What a factor names -> where it is in a case, SI."""
SI = {"kPa": 1e3, "mm": 1e-3, "s": 1e-6, "mmHg": 133.322}


@pytest.mark.parametrize("factor", sensitivity.FACTORS, ids=lambda factor: factor.name)
def test_each_factor_changes_what_it_names(factor: sensitivity.Factor) -> None:
    low, high = (sensitivity.varied(BASE, {factor.name: value}) for value in (factor.low, factor.high))
    for name, of in NAMED.items():
        if name != factor.name:
            assert of(low) == of(high) == of(BASE), name
    found = [NAMED[factor.name](case) for case in (low, high)]
    if factor.options:
        assert found == list(factor.options)
    elif factor.relative:
        constants = np.array([13100.0, -9610.0, 8860.0])  # Pa, of the source
        np.testing.assert_allclose(found, [factor.low * constants, factor.high * constants], rtol=1e-12)
    else:
        unit = factor.name.rpartition("_")[2]
        assert found == pytest.approx([factor.low * SI[unit], factor.high * SI[unit]], rel=1e-12)


def test_every_corner_of_position_and_size_is_accepted() -> None:
    """Nothing overlaps, even with the widest lumen in the thickest wall."""
    for x in (2, 8):
        for y in (-12, -6):
            point = {"vein_x_mm": x, "vein_y_mm": y, "lumen_mm": 11.1, "wall_thickness_mm": 1.3}
            assert sensitivity.varied(BASE, point).geometry.vein_centre == pytest.approx((x * 1e-3, y * 1e-3))


def test_a_failed_run_costs_its_trajectory_alone() -> None:
    """Effects of a plane are the same without the trajectory of the failed run."""
    design = morris({factor.name: (factor.low, factor.high) for factor in sensitivity.FACTORS}, 4, seed=1)
    slopes = np.arange(1, 12)
    unit = (design.points - design.ranges[:, 0]) / np.ptp(design.ranges, axis=1)
    table = {str(n): {"area_loss_percent": float(value)} for n, value in enumerate(unit @ slopes)}
    outcomes = {key: Outcome(None) for key in table}
    del table["17"]
    found = sensitivity._indices(design, Results(outcomes, table, Path()), "area_loss_percent")
    changed = np.array([2 / 3 if factor.options else 1 for factor in sensitivity.FACTORS])  # a step, not the range
    np.testing.assert_allclose(found.first, changed * slopes, rtol=1e-9)


def test_the_answer_tells_apart_what_can_be_told_apart() -> None:
    mean = np.array([5.0, 4.6, 2.0, 0.1, 0.3, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1])
    width = np.full(11, 0.3)
    text = sensitivity.answer(
        sensitivity.RESULTS["area_loss_percent"], Indices(("mu*", "sigma"), mean, width, mean, width)
    )
    assert "**The loss of area** hangs most on the bulk modulus of the tissue (5 ± 0.3)" in text
    assert "not told apart from the shear stiffness of the tissue (4.6 ± 0.3);" in text
    assert "then on the Young's modulus of the wall (2 ± 0.3);" in text
    assert "at most 0.3 each on the lateral position of the vein," in text


def test_the_report_says_what_matters_most(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def response(point: Mapping[str, float]) -> dict[str, float]:
        bulk, ends = point.get("tissue_K_kPa", 28.0), point.get("ends_1", 0.0) > 0.5
        loss = 30 - 0.5 * bulk - 2 * ends
        return {"area_loss_percent": loss, "sawss_Pa": 0.1 * point.get("flow_ml_s", 3.0), "sawss_rise_percent": loss}

    def computed(study: Study, folder: Path, quiet: bool) -> Results:  # noqa: ARG001
        for key, case in study.cases.items() if study.inputs else ():
            assert pytest.approx(1e3 * study.inputs[key].get("tissue_K_kPa", 28.45)) == case.materials.tissue.K
        table = {key: response(study.inputs.get(key, {})) for key in study.cases}
        return Results({key: Outcome(None) for key in study.cases}, table, folder / f"{study.name}.md")

    monkeypatch.setattr(sensitivity, "run_study", computed)
    text = sensitivity.study("demo", tmp_path, quiet=True).read_text(encoding="utf-8")
    assert "**The loss of area** hangs most on the bulk modulus of the tissue (6.36 ± " in text  # 0.5 (35.41 - 22.69)
    assert "; then on the ends of the segment (2 ± 0)" in text
    assert "**The SAWSS** hangs most on the inflow Q (0.2 ± " in text
    assert "120 of 120 runs, 10 trajectories" in text
    # outside of the range: 30 - 0.5 K
    for line in ("| base | 16 | 0.3 | 16 |", "| K 69 kPa | -4.5 | 0.3 | -4.5 |", "| K 82 kPa | -11 | 0.3 | -11 |"):
        assert line in text
    rows = list(csv.DictReader((tmp_path / "effects.csv").open()))
    assert len(rows) == 3 * 11
    bulk = next(row for row in rows if row["factor"] == "tissue_K_kPa")
    assert float(bulk["mu_star"]) == pytest.approx(6.36)
    assert (tmp_path / "effects.png").exists()


# ---------------------------------------------------------------- stockings

CORNERS = {
    **STANDARD,
    "corner": Profile(*(high for _, high in RANGES.values())),
    "other corner": Profile(*(low for low, _ in RANGES.values())),
    "middle": Profile(0.1, 0.5, -70.0, 0.6, 0.25),
}


@pytest.fixture(scope="module")
def domain() -> Domain:
    return Domain.build(compare_tissues.case("m_s1", compare_tissues.COARSE).geometry)


@pytest.mark.parametrize("profile", CORNERS.values(), ids=list(CORNERS))
def test_the_mean_over_skin_and_cycle_is_the_bound(profile: Profile, domain: Domain) -> None:
    """As the coarse mesh of the runs integrates it, with the measure that the system takes."""
    case = stocking_design.case(profile, compare_tissues.COARSE, 12)
    times = np.arange(12) * PERIOD / 12
    means = [stocking_design.mean_pressure(case, t, domain) for t in times]
    assert np.mean(means) == pytest.approx(BOUND, rel=2e-3)
    assert case.loads.skin_pressure(0.3) == 0
    if profile.pulse == 0:
        assert means == pytest.approx([BOUND] * 12, rel=2e-3)


def pressures(profile: Profile, t: float) -> list[float]:
    """Return the pressures in the middle of each chamber where the side is pressed, distal first."""
    cuffs = profile.chambers(0.12)
    return [sum(c.pressure(t) for c in cuffs if c.start < z < c.end) for z in (0.02, 0.06, 0.10)]


def test_profiles_are_what_they_are_called() -> None:
    assert pressures(STANDARD["uniform"], 0.4) == pytest.approx([BOUND] * 3)
    assert pressures(STANDARD["graduated"], 0.4) == pytest.approx([1.3 * BOUND, BOUND, 0.7 * BOUND])
    assert pressures(STANDARD["posterior"], 0.4) == pytest.approx([2 * BOUND] * 3)
    for cuff in STANDARD["posterior"].chambers(0.12):
        assert isclose(cuff.direction, -pi / 2)
        assert cuff.half_width is not None
        assert isclose(cuff.half_width, pi / 2)
    cycles = STANDARD["sequential cycles"]
    for number in range(3):  # each full a sixth of a period after the one distal of it, empty half a period later
        full = PERIOD * (1 / 2 + number / 6)
        assert pressures(cycles, full)[number] == pytest.approx(2 * BOUND)
        assert pressures(cycles, full + PERIOD / 2)[number] == pytest.approx(0, abs=1e-9 * BOUND)


def fake(times: np.ndarray, shears: np.ndarray) -> Any:
    columns = {f"wss_z{n:02d}_Pa": shears[:, n] for n in range(11)}
    return SimpleNamespace(series={"time_s": times, "flow_out_m3_s": 1e-6 * np.cos(2 * pi * times / PERIOD), **columns})


def test_the_last_cycle_counts_and_its_worst_section() -> None:
    times = np.linspace(0, 1.5 * PERIOD, 37)
    swing = 1 + 0.5 * np.sin(2 * pi * times / PERIOD)
    shears = np.outer(swing, 0.1 + 0.01 * np.arange(11)[::-1])
    shears[times < PERIOD / 2 - 1e-6] = 1e-9  # before the last cycle
    run = fake(times, shears)
    assert stocking_design.COLUMNS["least_tawss_Pa"](run) == pytest.approx(0.1, rel=1e-6)
    assert stocking_design.COLUMNS["mean_tawss_Pa"](run) == pytest.approx(0.15, rel=1e-6)
    assert stocking_design.COLUMNS["least_wss_Pa"](run) == pytest.approx(0.05, rel=1e-6)
    assert stocking_design.COLUMNS["least_outflow_m3_s"](run) == pytest.approx(-1e-6, rel=1e-6)


def test_the_last_cycle_is_one_period_whatever_the_steps() -> None:
    """Steps of 0.17 s in a period of 2 s, some halved: the mean of a swing is its mean."""
    times = np.sort(np.r_[np.arange(0, 3.0, 0.17), 1.955, 2.125, 2.295])
    run = fake(times, np.outer(1 + 0.5 * np.sin(2 * pi * times / PERIOD), np.full(11, 0.2)))
    assert stocking_design.over_cycle(run) == pytest.approx(0.2, rel=2e-2)
    cycle, _ = stocking_design._last_cycle(run)
    assert cycle[-1] - cycle[0] == pytest.approx(PERIOD, rel=1e-12)


def test_the_best_of_a_known_response_is_found_and_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Best where the distal pressure is lowest, half of the pressure in cycles with a lag of 0.15, all around.

    The pulse costs area, of which it may take 25 %: so it is below 0.4, and not 0.5.
    """

    def response(gradient: float, one_side: float, side_deg: float, pulse: float, lag: float) -> float:  # noqa: ARG001
        here = pulse * np.exp(2j * np.pi * lag)
        return float(0.1 - 0.02 * gradient - 0.03 * one_side**2 - 0.05 * abs(here - 0.5 * np.exp(0.3j * np.pi)) ** 2)

    def run_of(point: Mapping[str, float]) -> Any:
        run = fake(np.linspace(0, 1.5 * PERIOD, 31), np.full((31, 11), response(**point)))
        run.case = BASE
        return run

    def computed(study: Study, folder: Path, quiet: bool) -> Results:  # noqa: ARG001
        values = {key: {name: 0.0 for name in study.columns}
                       | {stocking_design.RESULT: response(**point), stocking_design.LOSS: 0.625 * point["pulse"]}
                  for key, point in study.inputs.items()}  # fmt: skip
        outcomes = {key: Outcome(run_of(point)) for key, point in study.inputs.items()}
        return Results(outcomes, values, folder / f"{study.name}.md")

    monkeypatch.setattr(stocking_design, "run_study", computed)
    text = stocking_design.study("demo", tmp_path, quiet=True).read_text(encoding="utf-8")
    rows = {row["profile"]: row for row in csv.DictReader((tmp_path / "ranking.csv").open())}
    best = {name: float(rows["best 1"][name]) for name in ("gradient", "one_side", "pulse", "lag")}
    assert best["gradient"] == pytest.approx(-0.3, abs=0.01)
    assert best["one_side"] == pytest.approx(0, abs=0.1)
    assert 0.35 < best["pulse"] < 0.4  # with two standard deviations to spare
    assert best["lag"] == pytest.approx(0.15, abs=0.02)
    assert float(rows["best 1"][stocking_design.RESULT]) == pytest.approx(0.106, rel=0.01)
    assert "**best 1**" in text
    assert "+20 % against 0.0875 Pa of a uniform pressure" in text  # (0.106 - 0.05 * 0.14**2) / (0.1 - 0.05 / 4)
    assert {path.name for path in tmp_path.glob("*.png")} == {
        "along.png", "outflow.png", "profiles.png", "ranking.png", "surrogate.png"
    }  # fmt: skip


def test_profiles_that_most_likely_leave_the_vein_open() -> None:
    """Two standard deviations below a loss of a quarter."""
    losses: Any = lambda _points: (np.array([0.24, 0.2, 0.2, 0.26]), np.array([0.004, 0.024, 0.026, 0.0]))  # noqa: E731
    assert list(stocking_design.open_enough(losses, np.zeros((4, 5)))) == [True, True, False, False]
