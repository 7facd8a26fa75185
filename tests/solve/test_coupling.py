"""One-way coupling: what it leaves alone, and where it is the same as two-way coupling."""

from __future__ import annotations

import numpy as np
import pytest
from ngfsi_geometry.channel import StraightChannel
from numpy.typing import NDArray

from ngfsi.case import Materials
from ngfsi.config.functions import FlowConstant, PressureConstant, PressureRamp
from ngfsi.errors import CaseError
from tests.runs import Run, computed, largest_change
from tests.solve.test_system import STEP
from tests.vein import BLOOD, BONED, block, case_of, column_slope, randomise, rows, steady, system_of

Array = NDArray[np.float64]

ONE_WAY = {"conditions.coupling": "one_way"}


WEAK = {"loads.outlet_pressure": PressureConstant(value=200.0), "solver.tolerance": 1e-8}
"""Blood whose pressure does not hide the flow behind roundings."""


def squeezed(flow: float, **changes: str) -> Run:
    """Return a step of a vein that is squeezed."""
    loads = {"skin_pressure": PressureRamp(final=500.0, duration=0.05), "inlet_flow": FlowConstant(value=flow)}
    changed = {f"loads.{name}": curve for name, curve in loads.items()} | {"time.step": 0.05, "time.end": 0.05}
    return computed(case_of(BONED, **WEAK, **changed, **changes))


def solids(run: Run) -> Array:
    return block(run.system, "d", run.states[-1])


def test_blood_at_rest_presses_as_its_outlet_does() -> None:
    """Both couplings are the same: the blood's stress over a layer of elements, and a pressure on their face."""
    still = WEAK | {"loads.inlet_flow": FlowConstant(value=0.0), "solver.tolerance": 1e-7}
    one, two = (steady(case_of(BONED, **still, **how))[0] for how in (ONE_WAY, {}))
    assert largest_change(block(one, "d", one.values), block(two, "d", two.values)) < 1e-6


def test_the_flow_does_not_move_the_wall() -> None:
    """The solids of a squeezed vein are the same whatever flows, and all blood is accounted for; with two-way coupling
    they are not."""
    weak, strong = (squeezed(flow, **ONE_WAY) for flow in (2e-7, 5e-6))
    assert largest_change(solids(weak), solids(strong)) < 1e-6
    assert strong["sawss_Pa"][-1] > 2 * weak["sawss_Pa"][-1]
    assert np.abs(weak["mass_defect_m3_s"]).max() < 1e-4 * np.abs(weak["flow_out_m3_s"]).max()
    assert largest_change(solids(squeezed(5e-6)), solids(strong)) > 1e-4


@pytest.mark.parametrize("name", ["d", "w", "p", "e"])
def test_tangent(name: str) -> None:
    """It is the residual's derivative, and the blood's unknowns do not stand in the equations of the solids."""
    system = system_of(case_of(BONED, **ONE_WAY))
    randomise(system)
    found, expected = column_slope(system, name, STEP[name])
    assert np.linalg.norm(found - expected) < 1e-7 * np.linalg.norm(expected)
    if name != "d":
        assert np.linalg.norm(rows(system, "d", found)) <= 1e-12 * np.linalg.norm(found)


def test_needs_a_vein() -> None:
    refused = '"one_way", which is for veins in tissue: StraightChannel is none'
    with pytest.raises(CaseError, match=refused):
        case_of(BONED).replace(geometry=StraightChannel(), materials=Materials(fluid=BLOOD), **ONE_WAY)
