"""One-way coupling: what it leaves alone, and where it is the same as two-way coupling."""

from __future__ import annotations

import numpy as np
import pytest

from geometry.channel import StraightChannel
from ngfsi.case import Materials
from ngfsi.curves import FlowConstant, PressureRamp
from ngfsi.errors import CaseError
from ngfsi.materials import Newtonian
from tests.runs import Run, computed, largest_change
from tests.vein import BLOOD, BONED, block, case_of, column_slope, randomise, rows, steady, system_of

ONE_WAY = {"conditions.coupling": "one_way"}


def squeezed(flow: float, blood: Newtonian = BLOOD, **changes: str) -> Run:
    """Return the run of a vein in soft tissue that is squeezed within two steps."""
    case = case_of(
        BONED,
        **{
            "loads.skin_pressure": PressureRamp(final=2000.0, duration=0.2),
            "loads.inlet_flow": FlowConstant(value=flow),
            "materials.fluid": blood,
            "time.step": 0.1,
            "time.end": 0.2,
            "solver.tolerance": 1e-9,
            **changes,
        },
    )
    return computed(case)


def solids(run: Run) -> np.ndarray:
    return np.array([block(run.system, "d", state) for state in run.states])


def test_blood_at_rest_presses_as_its_outlet_does() -> None:
    """Both couplings are the same to rounding: the blood's stress over one layer of elements, and the pressure on the
    deformed face that bounds it."""
    still = {"loads.inlet_flow": FlowConstant(value=0.0)}
    one, two = (steady(case_of(BONED, **still, **how))[0] for how in (ONE_WAY, {}))
    assert largest_change(block(one, "d", one.values), block(two, "d", two.values)) < 1e-7


def test_the_flow_does_not_move_the_wall() -> None:
    """The solids of a squeezed vein are the same to rounding, whatever flows; with two-way coupling they are not."""
    weak, strong = (squeezed(flow, **ONE_WAY) for flow in (2e-7, 5e-6))
    assert largest_change(solids(weak), solids(strong)) < 1e-7
    assert strong["sawss_Pa"][-1] > 3 * weak["sawss_Pa"][-1]
    weak, strong = (squeezed(flow) for flow in (2e-7, 5e-6))
    assert largest_change(solids(weak), solids(strong)) > 1e-5
    balance = np.abs(strong["mass_defect_m3_s"]).max() / np.abs(strong["flow_out_m3_s"]).max()
    assert balance < 1e-4


def test_blood_that_weighs_nothing_and_glides_presses_as_its_outlet_does() -> None:
    """Then two-way coupling ends where one-way coupling is."""
    air = Newtonian(density=1e-4, viscosity=1e-9)
    one, two = (squeezed(2e-7, air, **how) for how in (ONE_WAY, {}))
    assert largest_change(solids(one), solids(two)) < 1e-5
    real = squeezed(2e-7)
    assert largest_change(solids(one), solids(real)) > 1e-3


@pytest.mark.parametrize("name", ["d", "w", "p", "e"])
def test_tangent(name: str) -> None:
    """It is the residual's derivative, and the blood's unknowns do not stand in the equations of the solids."""
    system = system_of(case_of(BONED, **ONE_WAY))
    randomise(system)
    found, expected = column_slope(system, name, 1e-3 if name != "d" else 1e-4)
    assert np.linalg.norm(found - expected) < 1e-6 * np.linalg.norm(expected)
    if name != "d":
        assert np.linalg.norm(rows(system, "d", found)) <= 1e-12 * np.linalg.norm(found)


def test_needs_a_vein() -> None:
    refused = r"conditions.coupling is \"one_way\", which is for veins in tissue: StraightChannel is none"
    with pytest.raises(CaseError, match=refused):
        case_of(BONED, geometry=StraightChannel(), materials=Materials(fluid=BLOOD), **ONE_WAY)
