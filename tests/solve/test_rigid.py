"""Runs of flow in rigid veins against exact solutions, and against the whole coupled system."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from ngfsi_geometry.lofted import LoftedMesh, LoftedVein

from ngfsi.case import Case, Discretisation, Loads, Materials, TimeStepping
from ngfsi.config.functions import FlowConstant, FlowCurve, FlowHarmonics, PressureConstant
from ngfsi.linear.backends import choose_backend
from ngfsi.materials import Newtonian
from ngfsi.measure.probe import Probe
from ngfsi.run import run
from ngfsi.run.observers import WALL_REFINEMENT
from ngfsi.solve.newton import Newton
from ngfsi.system.system import System
from tests.geometry.test_lofted import ellipse
from tests.vein import domain_of

BLOOD = Newtonian(density=1060.0, viscosity=3.5e-3)
FLOW, RADIUS = 0.1e-6, 2e-3
POISEUILLE = 4 * BLOOD.viscosity * FLOW / (np.pi * RADIUS**3)
STEADY = TimeStepping(scheme="static", step=1.0, end=1.0)


def vein(a: float, b: float, order: int = 2, layers: int = 3, around: int = 12) -> LoftedVein:
    mesh = LoftedMesh(around=around, layers=layers, inlet_layers=2, lumen_radii=(0.75,), curving_order=order)
    heights = tuple(map(float, np.linspace(0, 4e-3 * layers, 5)))
    return LoftedVein(outlines=(ellipse(a, b),) * 5, heights=heights, inlet_diameters=1.0, mesh=mesh)


def case_of(geometry: LoftedVein, flow: FlowCurve, time: TimeStepping = STEADY) -> Case:
    return Case(
        name="rigid",
        geometry=geometry,
        materials=Materials(fluid=BLOOD),
        loads=Loads(inlet_flow=flow, outlet_pressure=PressureConstant(value=0.0)),
        discretisation=Discretisation(order=geometry.curving_order),
        time=time,
    )


def test_poiseuille(tmp_path: Path) -> None:
    """A round vein: wall shear stress 4 mu Q / (pi R^3), and a pressure that falls by 8 mu Q / (pi R^4) per length."""
    geometry = vein(RADIUS, RADIUS)
    found = run(case_of(geometry, FlowConstant(value=FLOW)), tmp_path / "run", quiet=True).series
    for column in ("wss_min_Pa", "sawss_Pa", "wss_max_Pa", "sawss_consistent_Pa"):
        assert found[column] == pytest.approx(POISEUILLE, rel=1e-2), column
    assert found["flow_in_m3_s"] == pytest.approx(FLOW, rel=1e-9)
    assert found["flow_out_m3_s"] == pytest.approx(FLOW, rel=1e-6)
    assert found["lumen_volume_rate_m3_s"] == pytest.approx(0.0, abs=1e-9 * FLOW)
    fall = 2 * POISEUILLE / RADIUS * (geometry.length + geometry.inlet_length)
    assert found["pressure_inlet_Pa"] - found["pressure_outlet_Pa"] == pytest.approx(fall, rel=4e-3)
    assert not {"displacement_max_m", "p_wall_mean_Pa", "p_tissue_side_Pa"} & set(found)


def test_oval_vein_far_from_its_round_inlet(tmp_path: Path) -> None:
    """Developed flow in an ellipse: tau = 4 mu Q / (pi a b) sqrt(cos^2 t / a^2 + sin^2 t / b^2) at parameter t."""
    a, b = 1.3 * RADIUS, RADIUS / 1.3
    case = case_of(vein(a, b, order=3, around=10), FlowConstant(value=0.1 * FLOW))
    wall = run(case, tmp_path / "run", quiet=True).fields(1.0, "wall")
    far = np.abs(wall.points[:, 2] - 9e-3) < 1.1e-3
    x, y = wall.points[far, 0] / a, wall.points[far, 1] / b
    exact = 0.4 * BLOOD.viscosity * FLOW / (np.pi * a * b) * np.sqrt((x / a) ** 2 + (y / b) ** 2)
    assert far.sum() > 20
    assert wall.point_data["wall_shear_magnitude_Pa"][far] == pytest.approx(exact, rel=5e-2)


def test_the_whole_coupled_system_says_the_same(tmp_path: Path) -> None:
    """All blocks of unknowns, mesh motion included, with a wall that is held: the same flow to solver tolerance."""
    case = case_of(vein(1.2 * RADIUS, RADIUS / 1.2), FlowConstant(value=FLOW))
    wall = run(case, tmp_path / "run", quiet=True).fields(0.0, "wall").point_data
    system = System(case, domain_of(case.geometry))
    system.set_steady()
    system.update(0.0)
    system.prescribe()
    Newton(system, choose_backend("auto"), *system.unknowns.blocks).solve(case.solver.tolerance, 50)
    (vessel,) = Probe(system).vessels.values()
    vessel.refresh()
    shear = vessel.wall.sample(WALL_REFINEMENT).shear
    assert np.abs(wall["wall_shear_Pa"] - shear).max() < 2e-6 * np.abs(shear).max()


def test_flow_over_cycles(tmp_path: Path) -> None:
    """A slow flow to and fro, quasi-steady: OSI 1/2 but at its outlet, TAWSS that of Poiseuille times the mean |cos|;
    constant flow has an OSI of 0."""
    geometry = vein(RADIUS, RADIUS, layers=1)
    constant = run(case_of(geometry, FlowConstant(value=FLOW), TimeStepping(step=2.0, end=4.0)), tmp_path / "constant",
                   quiet=True).wall_history()  # fmt: skip
    assert constant.point_data["TAWSS_Pa"] == pytest.approx(POISEUILLE, rel=1e-2)
    assert constant.point_data["OSI_1"].max() < 1e-6
    to_and_fro = FlowHarmonics(mean=0.0, amplitudes=(0.1 * FLOW,), phases=(0.0,), period=600.0)
    case = case_of(geometry, to_and_fro, TimeStepping(step=100.0, end=1200.0))
    wall = run(case, tmp_path / "waves", quiet=True).wall_history(600.0)
    upstream = wall.points[:, 2] < 0
    assert wall.point_data["OSI_1"][upstream] == pytest.approx(0.5, abs=0.01)
    # the mean of |cos| over a period, by the trapezoidal rule on 6 steps
    mean = np.mean(np.abs(np.cos(np.pi * np.arange(6) / 3)))
    assert wall.point_data["TAWSS_Pa"][upstream] == pytest.approx(0.1 * POISEUILLE * mean, rel=2e-2)
