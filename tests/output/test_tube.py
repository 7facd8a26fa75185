"""The tube law of a stored run whose law is known, and what one dimension makes of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ngfsi.analysis.tube import Against, _gap, in_one_dimension, overall_error, tube_laws
from ngfsi.analysis.tube_law import LAWS
from ngfsi.case import Cuff
from ngfsi.config.functions import PressureConstant
from ngfsi.errors import OutputError
from ngfsi.store.stored import StoredRun
from tests.output.fake import INFLATION, unloaded_area

LOSS, FULL = 0.25, INFLATION * unloaded_area()


@pytest.mark.parametrize(("against", "share"), [("skin", 1.0), ("tissue", 0.8)])
def test_the_law_of_a_linear_vein(stored: StoredRun, against: Against, share: float) -> None:
    """A quarter of the area is lost to the rise of the external pressure."""
    case = stored.case
    skin, blood = case.loads.skin_pressure(1.0), case.loads.outlet_pressure(0.0)
    name, fits = next(iter(tube_laws(stored, against).items()))
    assert name == "linear"
    assert overall_error(fits) < 1e-9
    slope = LOSS * FULL / (share * skin)
    for one in fits:
        assert float(one.law.area) == pytest.approx(FULL - slope * blood, rel=1e-6)
        assert float(one.law.stiffness) == pytest.approx(float(one.law.area) / slope, rel=1e-6)


def test_in_one_dimension(stored: StoredRun) -> None:
    """The fake knows neither inertia nor friction: its area is met up to their pressures, and the same mass leaves."""
    found = in_one_dimension(stored)
    assert found.one["area"] == pytest.approx(stored.series["lumen_area_mean_m2"], rel=0.01)
    assert found.one["area"][-1] < 0.8 * found.one["area"][0]
    assert found.one["flow"][0] == pytest.approx(stored.case.loads.inlet_flow(0.0), rel=1e-4)
    one, three = found.one["SAWSS"], found.three["SAWSS"]
    times = np.array([0.0, 0.1, 0.5, 0.6])  # averages are over time, not over steps
    gap = _gap(times, np.array([0.0, 1.0, 2.0, 0.0]), np.full(4, 1.25))
    assert gap.mean == pytest.approx((0.5 * 0.1 + 1.5 * 0.4 + 1.0 * 0.1) / 0.6 / 1.25 - 1, rel=1e-12)
    first, second, third = 1.25**2 + 0.25**2, 0.25**2 + 0.75**2, 0.75**2 + 1.25**2
    assert gap.rms == pytest.approx(np.sqrt((first * 0.05 + second * 0.2 + third * 0.05) / 0.6) / 1.25, rel=1e-12)
    assert found.gaps["SAWSS"] == _gap(stored.series["time_s"], one, three)


def test_runs_without_these_pressures(stored: StoredRun) -> None:
    old = replace(stored)
    old.__dict__["series"] = {name: values for name, values in stored.series.items() if "p_blood" not in name}
    with pytest.raises(OutputError, match="holds no p_blood_z00_Pa"):
        tube_laws(old)


def test_loads_that_one_dimension_does_not_know(stored: StoredRun) -> None:
    """No law against a skin with cuffs, and no wrong flow where a pressure drives it."""
    pressure = PressureConstant(value=2000.0)
    cuffed, driven = replace(stored), replace(stored)
    cuffed.__dict__["case"] = stored.case.replace(**{"loads.cuffs": (Cuff(pressure=pressure, start=0.02, end=0.06),)})
    driven.__dict__["case"] = stored.case.replace(**{"loads.inlet_pressure": pressure})
    assert len(tube_laws(cuffed, "tissue")) == len(LAWS)
    for run, said in ((cuffed, "has cuffs"), (driven, "given inlet pressure")):
        with pytest.raises(OutputError, match=said):
            in_one_dimension(run)
