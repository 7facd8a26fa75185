"""The study of stasis: what it lets act, and what it reads from runs."""

from __future__ import annotations

from math import pi
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from ngfsi_studies import stasis
from ngfsi_studies.stasis import BLOODS, COLUMNS, CONDITIONS, LEVELS, case, valve_case

from ngfsi.units import MMHG


@pytest.mark.parametrize("key", CONDITIONS)
def test_conditions_act_on_the_same_vein_with_the_same_flow_at_rest(key: str) -> None:
    cases: list[Any] = [case(key, blood, LEVELS["paper"]) for blood in BLOODS]
    for one in cases:
        inlet = one.loads.opening("inlet")
        if key == "breathing":
            times = np.linspace(0, 6, 601)
            flow = np.array([one.loads.inlet_flow(t) for t in times])
            assert np.trapezoid(flow, times) / 6 == pytest.approx(2.913e-6, rel=1e-9)
            assert flow.min() == pytest.approx(-0.5 * 2.913e-6, rel=1e-3)
        else:
            drop = inlet.distal_pressure(0.0) - one.loads.outlet_pressure(0.0)
            assert drop / (inlet.resistance + inlet.distal_resistance) == pytest.approx(2.913e-6, rel=1e-12)
    assert cases[0].materials.fluid.newtonian
    assert not cases[1].materials.fluid.newtonian
    pressures = {"rest": (0, 0, 0), "stocking": (0, 18, 18), "pump": (0, 40, 0), "breathing": (0, 0, 0)}[key]
    found = [cases[0].loads.skin_pressure(t) / MMHG for t in (0.0, 3.0, 11.0)]
    assert found == pytest.approx(list(pressures))
    assert cases[0].loads.skin_pressure(15.0) == pytest.approx(cases[0].loads.skin_pressure(3.0))


def test_flow_through_the_valve() -> None:
    one: Any = valve_case(5.0, LEVELS["demo"])
    valve, flow = one.geometry, one.loads.inlet_flow(0.0)
    assert 4 * 1060 * flow / (pi * 2 * valve.radius * 3.5e-3) == pytest.approx(5.0, rel=1e-12)
    age, pocket = one.scalars
    assert (age.kind, pocket.label) == ("age", "pocket")
    (_, low, start), (_, high, end) = pocket.corners
    assert (start - valve.upstream, end - valve.upstream) == pytest.approx((4e-3, 8e-3))
    # behind the leaflet, whose middle is there half way between its ends
    assert low - 0.5 * (4.25e-3 + 2.45e-3) == pytest.approx(0.5e-3)
    assert high > valve.radius * (1 + valve.bulge)


def test_errors_are_those_of_the_run_at_rest() -> None:
    """Differences to both companions, in proportion; where all are alike, or nothing was washed out, none is known."""
    rest = {"age_s": 2.0, "low_shear_1": 1.0, "washout_s": float("nan")}
    others = [
        {"age_s": 2.1, "low_shear_1": 1.0, "washout_s": 3.0},
        {"age_s": 1.9, "low_shear_1": 1.0, "washout_s": 3.0},
    ]
    errors = stasis.errors_of(rest, others)
    assert errors == pytest.approx({"age_s": 0.1}, rel=1e-12)
    row = dict.fromkeys(stasis.SHOWN, 0.5) | {"age_s": 3.0, "washout_s": float("nan")}
    shown = stasis.table({"stocking_constant": row}, errors)
    assert "| stocking, 18 mmHg | constant viscosity | 3.0 ± 0.3 | 0.5 | 50 |  | 50 | 0.5 | 0.5 |" in shown


def test_what_is_read() -> None:
    """12 s of 3 s in steps, of which the last cycle is all: the low area is 0.2 for half of it."""
    times = np.array([0.0, 6.0, 6.0, 12.0])
    run: Any = SimpleNamespace(series={
        "time_s": times, "age_mean_s": np.array([0, 2.0, 2.0, 3.0]), "age_outlet_s": np.array([0, 4.0, np.nan, 3.5]),
        "washout_left_1": np.array([1, 0.5, 0.5, 0.25]), "washout_time_s": np.array([np.nan, np.nan, np.nan, 9.0]),
        "wss_low_area_1": np.array([0.2, 0.2, 0.4, 0.4]), "sawss_Pa": np.array([0.1, 0.1, 0.3, 0.3]),
        "exposure_mean_1": np.array([0, 0.1, 0.1, 0.2]), "pocket_left_1": np.array([1, 0.8, 0.8, 0.6]),
        "lumen_volume_m3": np.array([8e-6] * 4), "flow_in_m3_s": np.array([2e-6] * 4),
    })  # fmt: skip
    found = {name: of(run) for name, of in COLUMNS.items()}
    assert found == pytest.approx({
        "age_s": 2.5, "oldest_outflow_s": 4.0, "left_1": 0.25, "washout_s": 9.0, "low_shear_1": 0.3, "sawss_Pa": 0.2,
        "exposure_1": 0.2,
    }, rel=1e-12)  # fmt: skip
    pockets = stasis.in_pockets(run)
    assert pockets == pytest.approx({
        "transit_s": 4.0, "transits_1": 3.0, "left_after_one_1": 1 - 0.2 * 4 / 6, "left_1": 0.6
    }, rel=1e-12)  # fmt: skip
    said = stasis.answer({"rest_constant": found, "pump_constant": {**found, "age_s": 1.5}}, {"valve_5": pockets})
    assert "pump, 40 mmHg for 2 s: mean age 1.5 s against 2.5 s at rest" in said
    assert "Reynolds number 5: after 4 s" in said
    rows = stasis.table({"pump_constant": found}, {}).splitlines()
    assert [cell.strip() for cell in rows[2].strip("|").split("|")] == [
        "pump, 40 mmHg for 2 s", "constant viscosity", "2.5", "4", "25", "9", "30", "0.2", "0.2"
    ]  # fmt: skip
