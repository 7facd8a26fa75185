"""Balance of energy: what conditions bring in is stored, moves, is dissipated, or leaves with the blood."""

from __future__ import annotations

from collections.abc import Iterator
from math import log2, pi, sin
from typing import Any

import ngsolve as ng
import numpy as np
import pytest

from ngfsi.case import Cuff, TimeStepping
from ngfsi.conditions import BodyForce, Condition
from ngfsi.config.functions import FlowSmoothRamp, PressureSmoothRamp
from ngfsi.linear.backends import choose_backend
from ngfsi.materials.solid.viscosity import SolidViscosity
from ngfsi.measure.energy import Energy
from ngfsi.solve.initial import initial_state
from ngfsi.solve.newton import Newton
from ngfsi.solve.time_loop import TimeLoop
from ngfsi.system.system import System
from tests.vein import TISSUE, TUBE, case_of, domain_of, steady

END = 0.3
CUFFS = (
    Cuff(pressure=PressureSmoothRamp(final=1000.0, duration=END), start=-1.0, end=5e-3, edge=2e-3),
    Cuff(pressure=PressureSmoothRamp(final=2000.0, duration=END), start=5e-3, end=1.0, edge=2e-3),
)
IN_CUFFS = ("in cuff 1", "in cuff 2")


def states(step: float, *more: Condition, **changes: Any) -> Iterator[Energy]:
    """Yield the energy of a small vein, with a wall of the tissue's law, at the start and after each step of a run."""
    time = TimeStepping(step=step, end=END)
    case = case_of(TUBE, **{"time": time, "materials.wall": TISSUE, "solver.tolerance": 1e-8, **changes})
    system = System(case, domain_of(case.geometry), more=more)
    newton = Newton(system, choose_backend("auto"))
    initial_state(system, newton)
    energy = Energy(system)
    yield energy
    for _ in TimeLoop(case, system, newton).run():
        yield energy


def balance(energy: Energy) -> tuple[float, float]:
    """Return the rate of the energy by the balance (W), and the size of its terms."""
    incoming = energy.powers().values()
    others = (-energy.carried(), -energy.dissipation(), energy.excess())
    return sum(incoming) + sum(others), sum(map(abs, (*incoming, *others)))


def rest_over_work(step: float) -> float:
    """Return what the balance lacks over a run with cuffs that press harder and harder, over the work of the cuffs."""
    energies, powers, works = [], [], []
    for now in states(step, **{"loads.cuffs": CUFFS}):
        incoming = now.powers()
        energies.append(now.stored() + now.kinetic())
        powers.append(sum(incoming.values()) - now.carried() - now.dissipation())
        works.append([incoming[name] for name in IN_CUFFS])
    work = np.trapezoid(works, dx=step, axis=0)
    assert min(work) > 0.2 * sum(work)
    return float((energies[-1] - energies[0] - np.trapezoid(powers, dx=step)) / sum(work))


def test_balance_over_a_run_with_cuffs() -> None:
    """It closes with the second order of BDF2: without one of the cuffs more than a fifth of their work is missing."""
    coarse, fine = (abs(rest_over_work(step)) for step in (END / 10, END / 20))
    assert fine < 1e-2
    assert log2(coarse / fine) > 1.8


def test_balance_at_each_instant() -> None:
    """A force, a flow that grows and pressures on the skin act: the rate is what they bring in, to quadrature."""
    force = BodyForce(ng.CF((500.0, 0.0, 2000.0)), curve=lambda t: sin(pi * t / (2 * END)) ** 2)
    flow = FlowSmoothRamp(initial=1e-6, final=3e-6, duration=END)
    for now in states(END / 5, force, **{"loads.inlet_flow": flow, "loads.cuffs": CUFFS}):
        rate, size = balance(now)
        assert now.rate() == pytest.approx(rate, abs=2e-5 * size)
    powers = now.powers()
    assert all(abs(powers[name]) > 1e-3 * size for name in (*IN_CUFFS, "inlet", "body force"))
    assert now.skin_power(powers) == pytest.approx(skin_power(now.system), rel=1e-9)


def test_balance_at_each_instant_with_viscous_tissue() -> None:
    """Internal variables hold energy and turn it into heat, in a shape that is not free of stress."""
    viscosity = SolidViscosity(moduli=(20e3, 5e3), times=(0.05, 0.5), kelvin_voigt=50.0)
    changes = {"materials.tissue": TISSUE.replace(viscosity=viscosity), "conditions.initial_state": "prestress"}
    first, *_, last = (
        (*balance(now), now.rate(), now.dissipation()) for now in states(END / 3, **{"loads.cuffs": CUFFS, **changes})
    )
    rate, size, found, heat = last
    assert found == pytest.approx(rate, abs=2e-5 * size)
    assert heat - first[3] > 0.02 * size


def skin_power(system: System) -> float:
    """Return the power of the cuffs from their pressures and the velocity of the deformed skin (W)."""
    pressure = sum((cuff.pressure(END) * cuff.weight() for cuff in CUFFS), start=ng.CF(0.0))
    velocity = system.new_weight * system.motion + system.velocity_history.components[0]
    area = ng.Cof(ng.Id(3) + ng.Grad(system.motion)) * ng.specialcf.normal(3)
    return float(ng.Integrate(-pressure * (velocity * area) * system.domain.ds("skin"), system.domain.mesh))


def test_steady_flow_turns_all_power_into_heat() -> None:
    """At rest nothing is stored; the skin and the ends do no work."""
    system, _ = steady(case_of(TUBE, **{"solver.tolerance": 1e-9}))
    energy = Energy(system)
    powers, heat = energy.powers(), energy.dissipation()
    assert sum(powers.values()) - energy.carried() + energy.excess() == pytest.approx(heat, rel=1e-4)
    assert powers["inlet"] > 0.5 * heat
    assert powers["on the skin"] == powers["ends"] == 0.0
