"""The study of intermittent compression: how its devices press, and what it reads from runs."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from ngfsi_studies import pneumatic
from ngfsi_studies.pneumatic import COLUMNS, DEVICES, LEVELS, case

from ngfsi.units import MMHG


def pressure(key: str, t: float, z: float) -> float:
    """Return the pressure on the skin at the back (mmHg), away from the edges of chambers."""
    inside = (one for one in DEVICES[key].chambers(0.12) if one.start < z < one.end)
    return sum(one.pressure(t) for one in inside) / MMHG


def test_chambers_fill_one_after_the_other() -> None:
    """All around in half of the time half of the pressure; distal first, the next begins as that is half full."""
    assert [pressure("uniform", 1.0, z) for z in (1e-3, 60e-3, 119e-3)] == pytest.approx([20.0] * 3)
    assert [pressure("sequential", 2.5, z) for z in (20e-3, 60e-3, 100e-3)] == pytest.approx([40.0, 30.0, 10.0])
    (behind,) = DEVICES["behind"].chambers(0.12)
    assert (behind.direction, behind.half_width) == pytest.approx((-np.pi / 2, np.pi / 2))


@pytest.mark.parametrize("key", DEVICES)
def test_the_flow_at_rest_is_that_of_the_vein(key: str) -> None:
    """The same source behind the same resistance as of `closing_vein`, of which a tenth lies before the veins upstream,
    until all chambers are full, and 1 s more."""
    chosen: Any = case(key, LEVELS["paper"])
    inlet = chosen.loads.opening("inlet")
    drop = inlet.distal_pressure(0.0) - chosen.loads.outlet_pressure(0.0)
    assert drop / (inlet.resistance + inlet.distal_resistance) == pytest.approx(2.913e-6, rel=1e-12)
    assert inlet.resistance / inlet.distal_resistance == pytest.approx(1 / 9, rel=1e-12)
    assert [(one.kind, one.start) for one in chosen.scalars] == [("washout", 0.0)]
    full = max(t for cuff in chosen.loads.cuffs for t in cuff.pressure.breakpoints)
    assert chosen.time.end == pytest.approx(full + 1.0, rel=1e-12)


def test_what_a_device_does() -> None:
    """A vein of 8 ml that holds 2 ml at last: 1 ml/s at rest, 5 ml/s for 1 s in the middle."""
    series = {
        "time_s": np.array([0.0, 1.0, 1.0, 2.0, 2.0, 4.0]), "flow_out_m3_s": 1e-6 * np.array([1, 1, 5, 5, 1, 1.0]),
        "area_z10_m2": 1e-5 * np.array([10, 10, 5, 4, 2, 2.0]),
        "lumen_volume_m3": 1e-6 * np.array([8, 8, 8, 4, 3, 2.0]),
        "pressure_stored_inlet_Pa": np.array([1500, 1600, 1800, 1900, 2000, 1700.0]),
        "washout_time_s": np.array([np.nan, np.nan, np.nan, 1.5, 1.5, 1.5]),
        "washout_left_1": np.array([1.0, 0.9, 0.9, 0.3, 0.25, 0.2]),
    }  # fmt: skip
    run: Any = SimpleNamespace(series=series, wall_history=lambda: {"TAWSS_Pa": np.array([0.3, 0.1, 0.2])})
    found = {name: of(run) for name, of in COLUMNS.items()}
    assert found == pytest.approx({
        "peak_velocity_m_s": 0.125, "augmentation_1": 12.5, "ejected_m3": 4e-6, "left_1": 0.25, "washout_s": 1.5,
        "marked_1": 0.2, "least_tawss_Pa": 0.1, "upstream_rise_Pa": 500.0,
    }, rel=1e-9)  # fmt: skip
    rows = pneumatic.table({"strong": found}).splitlines()
    assert [cell.strip() for cell in rows[0].strip("|").split("|")][1:4] == [
        "peak velocity [mm/s]", "over that at rest [1]", "ejected [ml]"
    ]  # fmt: skip
    assert [cell.strip() for cell in rows[2].strip("|").split("|")] == [
        "80 mmHg in 0.5 s", "125", "12.5", "4", "25", "1.5", "20", "0.1", "3.75"
    ]  # fmt: skip
    assert "80 mmHg in 0.5 s moves the blood fastest: 125 mm/s" in pneumatic.answer({"strong": found})
