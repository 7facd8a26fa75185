"""Contact of opposite sides of the lumen: the force of its medium, and a vein that closes and opens again."""

from __future__ import annotations

from pathlib import Path

import ngsolve as ng
import numpy as np
import pytest
from ngfsi_geometry.tube import TubeSegment
from ngsolve import GridFunction
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid

from ngfsi.conditions.contact import PRESSED, ContactModel
from ngfsi.config.functions import FlowConstant, PressureConstant, PressureHarmonics, PressureTable
from ngfsi.linear.backends import choose_backend
from ngfsi.materials import CompressibleNeoHookean
from ngfsi.measure.deformation import Deformation
from ngfsi.measure.energy import Energy
from ngfsi.physics.kinematics import Kinematics
from ngfsi.run import run
from ngfsi.solve.newton import Newton
from ngfsi.solve.time_loop import StepRefusedError, TimeLoop
from ngfsi.system.forms import residual_form
from ngfsi.system.system import System
from ngfsi.units import MMHG
from tests.measure.test_energy import balance
from tests.runs import assert_resumed
from tests.vein import COARSE, TUBE, case_of, position, set_motion, steady, system_of

Array = NDArray[np.float64]


def linear(matrix: Array) -> ng.CoefficientFunction:
    return ng.CF(tuple(map(tuple, matrix)), dims=(3, 3)) * position()


def work(system: System, motion: Array, virtual: Array) -> float:
    """Return the virtual work of the contact in a linear motion, over the lumen's volume (Pa)."""
    set_motion(system, linear(motion))
    forces, direction = system.state.vec.CreateVector(), GridFunction(system.unknowns.space)
    direction.components[0].Set(linear(virtual))
    residual_form(system.unknowns.space, system.conditions["contact"].integrals(None)).Apply(system.state.vec, forces)
    return float(ng.InnerProduct(forces, direction.vec)) / system.domain.volume(*system.domain.lumens)


def slope(F: Array, virtual: Array) -> float:
    """Return the slope of (|F^-1|^4 + 3) det F along a direction."""
    ahead, behind = ((np.linalg.norm(np.linalg.inv(G)) ** 4 + 3) * np.linalg.det(G)
                     for G in (F + 1e-5 * virtual, F - 1e-5 * virtual))  # fmt: skip
    return float((ahead - behind) / 2e-5)


def test_the_work_is_the_change_of_an_energy() -> None:
    """That of |grad y|^4 + 3 over the deformed volume, with the motion y back to the reference shape; the pressure is
    10 kPa between sides at a tenth of their distance, which is the residual gap."""
    system = system_of(case_of(TUBE, **{"conditions.contact": ContactModel(residual_gap=0.1)}))
    motion, virtual = np.random.default_rng(3).uniform(-0.4, 0.4, (2, 3, 3))
    across = np.diag([1.0, 0.0, 0.0])
    flat = np.eye(3) - 0.9 * across
    assert work(system, flat - np.eye(3), across) == pytest.approx(-PRESSED, rel=1e-9)
    expected = -PRESSED * slope(np.eye(3) + motion, virtual) / slope(flat, across)
    assert work(system, motion, virtual) == pytest.approx(expected, rel=1e-3)


def test_steps_see_contact_coming() -> None:
    """Of sides at 0.25 of their first distance, which det F tells, a step is halved that would bring them to half of
    that or through each other, and what parts them by a half is begun from less; far apart they may do as they like."""
    case = case_of(
        TUBE, **{"conditions.contact": ContactModel(), "time.scheme": "static", "time.step": 1.0, "time.end": 1.0}
    )
    system = system_of(case)

    def state(ratio: float) -> Array:
        set_motion(system, linear(np.diag([ratio - 1, 0.0, 0.0])))
        return np.array(system.values)

    def begun(before: float, predicted: float) -> float:
        loop = TimeLoop(case, system, Newton(system, choose_backend("auto")))
        loop.history.push(0.0, state(before), np.zeros(system.unknowns.size))
        loop._start_from(state(predicted), 1.0)
        gaps = system.gaps()
        np.testing.assert_allclose(gaps, gaps[0], rtol=1e-9)
        return float(gaps[0])

    for predicted in (0.12, -0.5):
        with pytest.raises(StepRefusedError, match="sides that are in contact would come too near") as refused:
            begun(0.25, predicted)
        assert refused.value.size == 0.5
    assert begun(0.25, 0.15) == pytest.approx(0.15, rel=1e-9)
    assert begun(0.25, 0.32) == pytest.approx(0.32, rel=1e-9)
    assert begun(0.25, 0.40) == pytest.approx(0.25 + 0.8**4 * 0.15, rel=1e-9)
    assert begun(0.9, 0.35) == pytest.approx(0.35, rel=1e-9)
    assert begun(0.5, 1.5) == pytest.approx(1.5, rel=1e-9)


VEIN = TubeSegment(
    length=4e-3, wall_thickness=1e-3, outer_radius=16e-3, lumen_diameter=10e-3, aspect_ratio=4.0,
    mesh=COARSE.replace(far_size=40e-3),
)  # fmt: skip
CLOSING = case_of(VEIN, **{
    "loads.inlet_flow": FlowConstant(value=0.0), "loads.outlet_pressure": PressureConstant(value=0.0),
    "loads.skin_pressure": PressureTable(times=(0.0, 1.0, 2.0), values=(0.0, 12 * MMHG, 0.0)),
    "materials.wall": CompressibleNeoHookean(young=10e3, poisson=0.45, density=1060.0),
    "materials.tissue": CompressibleNeoHookean(young=3e3, poisson=0.3, density=1060.0),
    "conditions.contact": ContactModel(residual_gap=0.1), "time.scheme": "static", "time.step": 0.5,
    "time.end": 2.0,
})  # fmt: skip
"""A flat vein in soft tissue that is pressed until its sides touch."""
IN_TIME = {"time.scheme": "bdf2", "time.step": 0.1, "time.end": 0.4}
FLOWING = CLOSING.replace(**{
    "loads.inlet_flow": FlowConstant(value=1e-7), "time.step": 0.05, "time.end": 0.2, "output.checkpoint_every": 1,
    "output.fields_every": 4,
})  # fmt: skip
"""The same as a run with some flow, in five steps: its sides are near each other after two of them."""


def test_a_flat_vein_closes_and_opens_again() -> None:
    """At 12 mmHg the distance of the sides is the residual gap in the middle, and more beside it; the mesh of the blood
    stays valid on the way, which without contact ends as it folds. At rest the vein is what it was."""
    system, newton = steady(CLOSING)
    deformation, lumen = Deformation(system), system.domain.lumens[0]
    volume = Kinematics(ng.Grad(system.motion)).J * system.domain.dx(lumen)
    found = {}
    for step in TimeLoop(CLOSING, system, newton, deformation.inversion).run():
        found[step.time] = ng.Integrate(volume, system.domain.mesh), deformation.smallest_jacobian(lumen)
    rest, closed = system.domain.volume(lumen), found[1.0]
    assert 0.1 < closed[1] < 0.15
    assert 0.1 < closed[0] / rest < 0.2
    assert found[2.0][0] == pytest.approx(rest, rel=1e-9)


def test_the_power_of_the_contact() -> None:
    """While the sides come together the medium takes up what its energy grows by, and the balance of energy closes at
    each instant: what holds the medium at the openings does no work on the blood that flows out there."""
    case = CLOSING.replace(**IN_TIME)
    system, newton = steady(case)
    energy, stiffness = Energy(system), case.conditions.contact.residual_gap
    k = Kinematics(ng.Grad(system.motion))
    medium = (ng.InnerProduct(k.cof, k.cof) ** 2 / k.J**3 + 3 * k.J) * system.domain.dx(
        *system.domain.lumens, bonus_intorder=4
    )
    stiffness = -PRESSED / slope(np.diag([stiffness, 1.0, 1.0]), np.diag([1.0, 0.0, 0.0]))
    for _ in TimeLoop(case, system, newton).run():
        rate, size = balance(energy)
        assert energy.rate() == pytest.approx(rate, abs=1e-3 * size)
        taken, now, rates = -energy.powers()["contact"], system.values.copy(), system.rates()
        energies = []
        for ahead in (1e-5, -1e-5):
            system.values[:] = now + ahead * rates
            energies.append(stiffness * ng.Integrate(medium, system.domain.mesh))
        system.values[:] = now
        assert taken == pytest.approx((energies[0] - energies[1]) / 2e-5, rel=0.02)
        assert taken > 5e-3 * size
    assert Deformation(system).smallest_jacobian(system.domain.lumens[0]) < 0.2


def test_the_balance_of_energy_while_the_sides_meet_and_part() -> None:
    """What the medium takes up it gives back, and over the whole run nothing is missing but errors of the steps: 1.8 %
    of the work on the skin with steps of 0.04 s, here 0.8 or 1.4 %, as a step is halved earlier or later."""
    pressure = PressureHarmonics(mean=1.5 * MMHG, amplitudes=(-1.5 * MMHG,), phases=(0.0,), period=0.4)
    case = CLOSING.replace(**IN_TIME).replace(**{"loads.skin_pressure": pressure, "time.step": 0.02})
    system, newton = steady(case)
    energy, deformation = Energy(system), Deformation(system)
    rows = []
    for step in TimeLoop(case, system, newton).run():
        powers = energy.powers()
        net = sum(powers.values()) - energy.carried() - energy.dissipation() + energy.excess()
        held, least = energy.stored() + energy.kinetic(), deformation.smallest_jacobian(system.domain.lumens[0])
        rows.append((step.time, held, net, powers["contact"], abs(powers["on the skin"]), least))
    times, held, net, contact, skin, least = np.array(rows).T
    came, taken, work = (cumulative_trapezoid(power, times, initial=0.0) for power in (net, -contact, skin))
    assert least.min() < 0.25
    assert taken.max() > 0.025 * work[-1]
    assert abs(taken[-1]) < 0.01 * work[-1]
    assert np.abs(held - held[0] - came).max() < 0.016 * work[-1]


def test_resumed_in_contact_it_is_the_same_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """To the last bit; it goes on from where the sides are near each other."""
    whole = run(FLOWING, tmp_path / "whole", quiet=True)
    least = whole.series["detF_min_fluid_1"]
    assert least[2] < 0.45
    assert least[-1] < 0.3
    assert_resumed(FLOWING, tmp_path / "run", whole.path, monkeypatch)
