"""Pressure on parts of the skin: forces in closed form, and equal loads written in other ways."""

from __future__ import annotations

from functools import cache
from typing import Any

import ngsolve as ng
import numpy as np
import pytest
from ngfsi_geometry.segment import MeshSettings

from ngfsi.case import Cuff
from ngfsi.config.functions import FlowConstant, PressureConstant, PressureHarmonics, PressureRamp
from ngfsi.errors import CaseError, SolverError
from ngfsi.linear.backends import choose_backend
from ngfsi.solve.initial import initial_state
from ngfsi.solve.newton import Newton
from ngfsi.solve.time_loop import TimeLoop
from ngfsi.system.system import System
from tests.runs import computed, largest_change
from tests.slopes import apply
from tests.vein import TUBE, case_of, sections_of, system_of

PRESSURE = 700.0
FINE = TUBE.replace(mesh=MeshSettings(axial_layers=10, far_size=4e-3, vein_size=6e-3, lumen_radii=(), curving_order=2))


def cuff(**given: Any) -> Cuff:
    return Cuff(pressure=PressureConstant(value=PRESSURE), **{"start": 0.0, "end": TUBE.length, "edge": 2e-3, **given})


def system_with(*cuffs: Cuff, geometry: Any = TUBE) -> System:
    system = system_of(case_of(geometry, **{"loads.cuffs": cuffs}))
    system.set_steady()
    system.update(0.0)
    return system


@cache
def unloaded_system(geometry: Any) -> System:
    system = system_of(case_of(geometry))
    system.update(0.0)
    return system


def force_along(system: System, direction: ng.CoefficientFunction) -> float:
    """Return the virtual work of the load on the undeformed skin along a displacement field."""
    unloaded = unloaded_system(system.case.geometry)
    virtual = ng.GridFunction(system.unknowns.space)
    virtual.components[0].Set(direction)
    rest = np.zeros(system.unknowns.size)
    residual = apply(system.form, system.state.vec, rest) - apply(unloaded.form, unloaded.state.vec, rest)
    return float(residual @ virtual.vec.FV().NumPy())


@pytest.mark.parametrize(
    ("given", "share"),
    [
        ({"start": 0.002, "end": 0.007}, 0.5),
        ({"start": 0.002, "end": 0.007, "half_width": np.pi / 3, "direction": 2.0}, 0.5 / 3),
        ({"start": -1.0, "end": 1.0, "half_width": np.pi / 2}, 0.5),
    ],
)
def test_work_of_a_cuff(given: dict[str, float], share: float) -> None:
    """Along a displacement by the position: p R times the area of the part. It pushes inwards, on residual's sign +."""
    work = force_along(system_with(cuff(**given), geometry=FINE), ng.CF((ng.x, ng.y, 0)))
    whole = PRESSURE * TUBE.skin_radius * 2 * np.pi * TUBE.skin_radius * TUBE.length
    assert work == pytest.approx(share * whole, rel=1e-2)


def test_a_cuff_pushes_from_its_side() -> None:
    """Net force 2 p R h sin(half_width), against its direction."""
    system = system_with(cuff(start=-1.0, end=1.0, direction=0.5, half_width=0.8), geometry=FINE)
    along, across = (force_along(system, ng.CF((np.cos(a), np.sin(a), 0))) for a in (0.5, 0.5 + np.pi / 2))
    expected = 2 * PRESSURE * TUBE.skin_radius * TUBE.length * np.sin(0.8)
    assert along == pytest.approx(expected, rel=1e-2)
    assert abs(across) < 1e-2 * expected


def test_cuffs_that_cover_all_are_pressure_on_the_skin() -> None:
    """Two zones side by side, ramped alike, move the vein as one pressure does; their kinks are met."""
    ramp = PressureRamp(final=2000.0, duration=0.15)
    changes = {"time.step": 0.1, "time.end": 0.2}
    one = computed(case_of(TUBE, **changes, **{"loads.skin_pressure": ramp}))
    lower, upper = (cuff(start=a, end=b).replace(pressure=ramp) for a, b in ((-1.0, 0.004), (0.004, 1.0)))
    two = computed(case_of(TUBE, **changes, **{"loads.cuffs": (lower, upper)}))
    assert [step.time for step in two.steps] == pytest.approx([0.1, 0.15, 0.2])
    assert one["lumen_area_mean_m2"][-1] < 0.95 * one["lumen_area_mean_m2"][0]
    assert largest_change(two["lumen_area_mean_m2"], one["lumen_area_mean_m2"]) < 1e-7


def test_the_vein_narrows_under_the_cuff() -> None:
    """By sections it expels what its volume loses, by Gauss's rule in each layer: a wall that narrows unevenly also
    moves along the vein, without which they would lack 0.5 %."""
    layers = 4
    run = computed(case_of(TUBE.replace(**{"mesh.axial_layers": layers}), **{"time.end": 0.1, "loads.cuffs": (
        cuff(start=0.006, end=1.0).replace(pressure=PressureRamp(final=2000.0, duration=0.1)),)}))  # fmt: skip
    lost = [1 - run[f"area_z{station:02d}_m2"][-1] / run[f"area_z{station:02d}_m2"][0] for station in (0, 10)]
    assert lost[1] > 1.2 * lost[0]
    nodes, weights = np.polynomial.legendre.leggauss(6)
    heights = TUBE.length / layers * np.add.outer(np.arange(layers), (nodes + 1) / 2).ravel()
    total = TUBE.length / layers / 2 * np.dot(np.tile(weights, layers), sections_of(run.system, heights).area_rates)
    assert total == pytest.approx(run["lumen_volume_rate_m3_s"][-1], rel=2e-4)


def test_blood_comes_back_through_the_outlet_while_the_vein_refills() -> None:
    """Cycles of a chamber faster than the inflow: the lumen takes what it lacks from the outlet, cycle after cycle."""
    swing = PressureHarmonics(mean=1000.0, amplitudes=(1000.0,), phases=(np.pi,), period=0.2)
    run = computed(case_of(TUBE, **{
        "loads.cuffs": (cuff(start=-1.0, end=1.0).replace(pressure=swing),),
        "loads.inlet_flow": FlowConstant(value=1e-7),
        "time.step": 0.02, "time.end": 0.4}))  # fmt: skip
    outflow, volume = run["flow_out_m3_s"], run["lumen_volume_m3"]
    assert np.min(outflow) < -5e-7
    assert np.max(np.abs(run["mass_defect_m3_s"])) < 1e-9 * np.max(outflow)
    assert np.mean(outflow[11:]) == pytest.approx(1e-7, rel=0.1)  # over a cycle what comes in goes out
    np.testing.assert_allclose(volume[11:], volume[1:11], rtol=2e-3)
    np.testing.assert_allclose(outflow[13:], outflow[3:11], atol=0.02 * np.max(outflow))


def test_a_failure_says_what_the_cuffs_press() -> None:
    """And not that there is no pressure on the skin beside them."""
    ramp = PressureRamp(final=2000.0, duration=0.1)
    cuffs = cuff(start=-1.0, end=4e-3).replace(pressure=ramp), cuff(start=4e-3, end=1.0)
    case = case_of(TUBE, **{"loads.cuffs": cuffs, "time.step": 0.05, "time.end": 0.1, "time.smallest_step": 0.03})
    system = system_of(case)
    newton = Newton(system, choose_backend("auto"))
    initial_state(system, newton)
    refused = iter(["", "told to fail"])
    with pytest.raises(SolverError) as caught:
        for _ in TimeLoop(case, system, newton, lambda: next(refused)).run():
            pass
    said = str(caught.value)
    assert said.startswith("the run ended at t = 0.05 s with 1000 Pa in cuff 1, 700 Pa in cuff 2, ")
    assert "on the skin" not in said


def test_written_and_refused() -> None:
    case = case_of(TUBE, **{"loads.cuffs": (cuff(direction=1.0, half_width=0.5), cuff())})
    written = case.to_toml_dict()
    assert [set(entry) for entry in written["loads"]["cuffs"]] == [
        {"pressure", "start_m", "end_m", "direction_rad", "half_width_rad", "edge_m"},
        {"pressure", "start_m", "end_m", "direction_rad", "edge_m"},
    ]
    assert type(case).from_dict(written) == case
    with pytest.raises(CaseError, match=r"a cuff from z = 0\.01 m to 0\.005 m is lower than its edge"):
        cuff(start=0.01, end=0.005)
