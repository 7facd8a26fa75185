"""Flow in rigid veins against exact solutions, and against the whole coupled system."""

from __future__ import annotations

import numpy as np
import pytest
from ngfsi_geometry.lofted import LoftedMesh, LoftedVein

from ngfsi.config.functions import FlowConstant, FlowHarmonics
from ngfsi.linear.backends import choose_backend
from ngfsi.materials import Newtonian
from ngfsi.measure.wall import Wall
from ngfsi.run.rigid import pulsatile, rigid_case, steady
from ngfsi.solve.newton import Newton
from ngfsi.system.system import System
from tests.geometry.test_lofted import ellipse
from tests.vein import domain_of

BLOOD = Newtonian(density=1060.0, viscosity=3.5e-3)
FLOW, RADIUS = 0.1e-6, 2e-3


def vein(a: float, b: float, order: int = 2, layers: int = 3, around: int = 12) -> LoftedVein:
    mesh = LoftedMesh(around=around, layers=layers, inlet_layers=2, lumen_radii=(0.75,), curving_order=order)
    heights = tuple(map(float, np.linspace(0, 4e-3 * layers, 5)))
    return LoftedVein(outlines=(ellipse(a, b),) * 5, heights=heights, inlet_diameters=1.0, mesh=mesh)


def test_poiseuille() -> None:
    geometry = vein(RADIUS, RADIUS)
    system = steady(rigid_case(geometry, BLOOD, FlowConstant(value=FLOW), order=2), domain_of(geometry))
    wall = Wall(system)
    wall.refresh()
    found = wall.statistics()
    exact = 4 * BLOOD.viscosity * FLOW / (np.pi * RADIUS**3)
    assert (found.smallest, found.mean, found.largest) == pytest.approx((exact,) * 3, rel=1e-2)


def test_oval_vein_far_from_its_round_inlet() -> None:
    """Developed flow in an ellipse: tau = 4 mu Q / (pi a b) sqrt(cos^2 t / a^2 + sin^2 t / b^2) at parameter t."""
    a, b = 1.3 * RADIUS, RADIUS / 1.3
    geometry = vein(a, b, order=3, around=10)
    system = steady(rigid_case(geometry, BLOOD, FlowConstant(value=0.1 * FLOW), order=3), domain_of(geometry))
    wall = Wall(system)
    wall.refresh()
    sample = wall.sample(2)
    far = np.abs(sample.points[:, 2] - 9e-3) < 1.1e-3
    x, y = sample.points[far, 0] / a, sample.points[far, 1] / b
    exact = 0.4 * BLOOD.viscosity * FLOW / (np.pi * a * b) * np.sqrt((x / a) ** 2 + (y / b) ** 2)
    assert far.sum() > 20
    assert np.linalg.norm(sample.shear[far], axis=1) == pytest.approx(exact, rel=5e-2)


def test_the_whole_coupled_system_says_the_same() -> None:
    """All blocks of unknowns, mesh motion included, with a wall that is held: the same flow to solver tolerance."""
    geometry = vein(1.2 * RADIUS, RADIUS / 1.2)
    case = rigid_case(geometry, BLOOD, FlowConstant(value=FLOW), order=2)
    alone = steady(case, domain_of(geometry))
    system = System(case, domain_of(geometry))
    system.set_steady()
    system.update(0.0)
    Newton(system, choose_backend("auto")).solve(case.solver.tolerance, 50)
    shears = []
    for found in (alone, system):
        wall = Wall(found)
        wall.refresh()
        shears.append(wall.sample(1).shear)
    assert np.abs(shears[1] - shears[0]).max() < 1e-6 * np.abs(shears[0]).max()


def test_cycles() -> None:
    """Constant flow repeats at once with OSI 0; a slow flow to and fro has an OSI of 1/2, but at its outlet."""
    geometry = vein(RADIUS, RADIUS, layers=1, around=8)
    flow = FlowConstant(value=FLOW)
    cycle = pulsatile(rigid_case(geometry, BLOOD, flow, order=2, step=2.0, end=4.0), domain_of(geometry))
    exact = 4 * BLOOD.viscosity * FLOW / (np.pi * RADIUS**3)
    assert cycle.periodic
    assert len(cycle.changes) == 1
    assert cycle.history.tawss == pytest.approx(exact, rel=1e-2)
    assert cycle.history.osi.max() < 1e-6
    to_and_fro = FlowHarmonics(mean=0.0, amplitudes=(0.1 * FLOW,), phases=(0.0,), period=600.0)
    cycle = pulsatile(rigid_case(geometry, BLOOD, to_and_fro, order=2, step=100.0, end=600.0), domain_of(geometry))
    assert cycle.periodic
    upstream = cycle.points[:, 2] < 0
    assert cycle.history.osi[upstream] == pytest.approx(0.5, abs=0.01)
    # the mean of |cos| over a period, by the trapezoidal rule on 6 steps
    mean = np.mean(np.abs(np.cos(np.pi * np.arange(6) / 3)))
    assert cycle.history.tawss[upstream] == pytest.approx(0.1 * exact * mean, rel=2e-2)
