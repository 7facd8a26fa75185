"""Stability of rings and tubes against exact buckling pressures and frequencies."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import ngsolve as ng
import numpy as np
import pytest
from ngfsi_geometry.segment import MeshSettings
from ngfsi_geometry.tube import BareTube, TubeSegment
from ngfsi_studies.verification.ring_buckling import REFERENCES

from ngfsi.case import Case, Cuff, Discretisation, Loads, Materials, TimeStepping
from ngfsi.config.functions import FlowConstant, PressureConstant
from ngfsi.linear.backends import choose_backend
from ngfsi.materials import SaintVenantKirchhoff
from ngfsi.measure.shape import Shape
from ngfsi.measure.stability import Stability, Stage
from ngfsi.physics.fields import PRESSURE
from ngfsi.solve.newton import Newton
from ngfsi.system.system import System
from tests.vein import BLOOD, BONED, WALL, case_of, position, sections_of, set_motion, system_of, value_of

LEVY = REFERENCES[0].value
RADIUS, THICKNESS = 10e-3, 0.5e-3
YOUNG, POISSON = 1e6, 0.3
SCALE = YOUNG / (1 - POISSON**2) * THICKNESS**3 / (12 * RADIUS**3)
BLOOD_PRESSURE = 2 * SCALE
FINITE_THICKNESS = 4e-3
"""By how much a ring of h/R = 1/20 differs from a thin one: 2.5e-3, which falls as its square (ring_buckling)."""


def ring(**changes: Any) -> tuple[System, Newton]:
    """Return a tube of wall alone between rollers, with blood at rest in it: a ring in plane strain."""
    mesh = MeshSettings(element="mixed", axial_layers=1, vein_size=3.95e-3, lumen_radii=(), curving_order=4)
    geometry = BareTube(length=4e-3, lumen_diameter=2 * RADIUS - THICKNESS, wall_thickness=THICKNESS, mesh=mesh)
    case = Case(
        name="ring",
        geometry=geometry,
        materials=Materials(wall=SaintVenantKirchhoff(young=YOUNG, poisson=POISSON, density=1000.0), fluid=BLOOD),
        loads=Loads(
            skin_pressure=PressureConstant(value=0.0),
            inlet_flow=FlowConstant(value=0.0),
            outlet_pressure=PressureConstant(value=BLOOD_PRESSURE),
        ),
        discretisation=Discretisation(order=4),
        time=TimeStepping(step=1.0, end=1.0),
    ).replace(**changes)
    system = system_of(case)
    system.set_steady()
    system.update(0.0)
    return system, Newton(system, choose_backend("auto"), "d", "e")


def press(system: System, newton: Newton, scaled: float) -> None:
    """Find equilibrium under a difference of pressures, over E/(1 - nu^2) h^3 / (12 R^3)."""
    value_of(system, "on the skin").Set(scaled * SCALE + BLOOD_PRESSURE)
    newton.solve(1e-9, 20)


def test_ring_buckles_at_levys_pressure() -> None:
    """Predicted from two stages below it, with a mode that wins as much outwards as inwards and bends two lobes."""
    system, newton = ring()
    stability = Stability(system)
    press(system, newton, 1.0)
    first = stability.refresh()
    press(system, newton, 2.5)
    stage = stability.refresh()
    assert first.eigenvalue > stage.eigenvalue > 0
    assert np.isnan(first.critical)
    assert stage.pressure == pytest.approx(2.5 * SCALE + BLOOD_PRESSURE, rel=1e-12)
    assert (stage.critical - BLOOD_PRESSURE) / SCALE == pytest.approx(LEVY, rel=FINITE_THICKNESS)
    assert stage.wall_share == pytest.approx(1.0, rel=1e-12)
    angles = np.arange(16) * np.pi / 8
    across = np.array([np.cos(angles), np.sin(angles)])
    at = system.domain.mesh(*(0.99 * RADIUS * across), np.full(16, 2e-3))
    outwards = np.sum(np.asarray(stability.mode(at))[:, :2] * across.T, axis=1)
    waves = np.abs(np.fft.rfft(outwards))
    assert np.delete(waves, [1, 2]).max() < 0.02 * waves[2]  # the first is a shift, which holding a point adds


def test_continued_stages_are_the_same() -> None:
    """What is stored of one stage serves for the next, in another system; as it must, that of another stage does not.

    In shapes that are no equilibrium, for which the blood's pressure and the skin's are as good as any.
    """
    squeeze = (position()[0], -2 * position()[1], 0)

    def stage(system: System, stability: Stability, share: float) -> Stage:
        set_motion(system, share * ng.CF(squeeze))
        value_of(system, "on the skin").Set(share * 1e5)
        return stability.refresh()

    systems = [system_of(case_of(BONED)) for _ in range(3)]
    once, continued, other = (Stability(system) for system in systems)
    stage(systems[0], once, 0.001)
    kept = once.arrays()
    continued.restore(kept)
    other.restore({**kept, "state": 0.5 * kept["state"]})
    expected, found, wrong = (
        stage(system, stability, 0.002) for system, stability in zip(systems, (once, continued, other), strict=True)
    )
    assert found == expected
    assert np.isfinite(expected.critical)
    assert wrong.critical != pytest.approx(expected.critical, rel=1e-3)


CUFFS = {"in cuff 1": 0.6, "in cuff 2": 0.2, "on the skin": 0.4}
"""Shares of the load."""


def in_cuffs() -> Callable[[float], System]:
    """Return a vein in two cuffs, still in its reference shape, and what lets a load (Pa) act on it.

    Without stresses its tangent is linear in the pressures: what is found on a chord is exact.
    """
    nothing = PressureConstant(value=0.0)
    cuffs = (Cuff(pressure=nothing, start=-1.0, end=5e-3), Cuff(pressure=nothing, start=5e-3, end=1.0))
    system = system_of(case_of(BONED, **{"loads.cuffs": cuffs}))

    def load(pressure: float) -> System:
        for name, share in CUFFS.items():
            value_of(system, name).Set(share * pressure)
        return system

    return load


def test_cuffs_that_press_unevenly() -> None:
    """The pressure is that under the strongest, and at the critical one the smallest eigenvalue passes zero."""
    load = in_cuffs()
    stability = Stability(load(0.0))
    stability.refresh()
    load(1000.0)
    stage = stability.refresh()
    assert stage.pressure == pytest.approx(1000.0, rel=1e-12)
    below, beyond = (Stability(load(factor * stage.critical)).refresh().eigenvalue for factor in (0.999, 1.001))
    assert below == pytest.approx(-beyond, rel=1e-2)
    assert below > 0


def test_beyond_the_loss_of_stability() -> None:
    """A stage after a stable one tells where it is lost, also if it is unstable itself; one after an unstable one tells
    nothing, stable or not; nor does one at the same pressure."""
    load = in_cuffs()
    stability = Stability(load(0.0))
    stages = [stability.refresh()]
    for pressure in (1e4, 3e4, 4e4, 1e4, 2e4, 2e4):
        load(pressure)
        stages.append(stability.refresh())
    assert [stage.eigenvalue > 0 for stage in stages] == [True, True, False, False, True, True, True]
    exact = stages[1].critical
    assert 2e4 < exact < 3e4
    wanted = [np.nan, exact, exact, np.nan, np.nan, exact, np.nan]
    assert [stage.critical for stage in stages] == pytest.approx(wanted, rel=1e-8, nan_ok=True)


def test_share_of_the_wall_in_the_mode() -> None:
    """Its kinetic energy there over that of all."""
    load = in_cuffs()
    system = load(1000.0)
    stability = Stability(system)
    stage = stability.refresh()
    energies = {
        name: ng.Integrate(
            model.density * ng.InnerProduct(stability.mode, stability.mode) * system.domain.dx(name), system.domain.mesh
        )
        for name, model in system.solids.items()
    }
    assert stage.wall_share == pytest.approx(energies["wall"] / sum(energies.values()), rel=1e-6)


def test_the_blood_presses_with_all_of_its_pressure() -> None:
    """What it has beyond the reference counts as much; with one-way coupling it is not on the wall."""

    def eigenvalue(reference: float, beyond: float, **changes: Any) -> float:
        system = system_of(case_of(BONED, **changes))
        system.reference().Set(reference)
        system.named(system.state)[PRESSURE].Set(beyond)
        return Stability(system).refresh().eigenvalue

    one, both, one_way = (
        eigenvalue(2e3, 0.0), eigenvalue(1e3, 1e3), eigenvalue(2e3, 1e3, **{"conditions.coupling": "one_way"})
    )  # fmt: skip
    assert both == pytest.approx(one, rel=1e-6)
    assert one_way == pytest.approx(one, rel=1e-6)
    assert eigenvalue(1e3, 0.0) != pytest.approx(one, rel=1e-3)


def test_nothing_softens() -> None:
    """What is stretched evenly stiffens, and pressure on a cuff that meets no skin changes nothing."""
    beside = Cuff(pressure=PressureConstant(value=0.0), start=0.5, end=1.0)
    system = system_of(case_of(BONED, **{"loads.cuffs": (beside,), "materials.tissue": WALL}))
    stability = Stability(system)
    critical = []
    for pressure, strain in ((0.0, 0.0), (1000.0, 0.0), (2000.0, 0.05)):
        value_of(system, "in cuff 1").Set(pressure)
        set_motion(system, strain * position())
        critical.append(stability.refresh().critical)
    assert critical == pytest.approx([np.nan, np.inf, np.inf], nan_ok=True)


def test_an_oval_ring_grows_more_oval() -> None:
    """An imperfection a of mode 2 is a / (1 - p/p_c) under a pressure p (Timoshenko and Gere, Theory of Elastic
    Stability, 1961, section 7.4)."""
    imperfection, share = 2e-6, 0.6
    radius = RADIUS - THICKNESS / 2
    ratio = (radius + imperfection) / (radius - imperfection)
    system, newton = ring(**{"geometry.aspect_ratio": ratio, "geometry.oval_direction": 0.4})
    sections = sections_of(system)
    before = Shape.of(sections)
    assert (before.major - before.minor) / 2 == pytest.approx(np.full(11, imperfection), rel=1e-3)
    press(system, newton, share * LEVY)
    sections.refresh()
    found = Shape.of(sections)
    assert (found.major - found.minor) / 2 == pytest.approx(np.full(11, imperfection / (1 - share)), rel=0.02)
    assert found.angle == pytest.approx(np.full(11, 0.4), abs=1e-3)


def test_torsional_frequency() -> None:
    """A clamped tube of one material twists with the frequency c/(2L) of its shear waves, blood aside."""
    length, shear, density = 40e-3, 10e3, 1060.0
    mesh = MeshSettings(element="mixed", axial_layers=3, far_size=8e-3, vein_size=8e-3, lumen_radii=(), curving_order=3)
    tube = TubeSegment(length=length, lumen_diameter=10e-3, wall_thickness=2e-3, outer_radius=12e-3, mesh=mesh)
    solid = SaintVenantKirchhoff(young=2 * shear * 1.2, poisson=0.2, density=density)
    still = {"loads.outlet_pressure": PressureConstant(value=0.0), "conditions.ends": "clamped"}
    system = system_of(case_of(tube, **{"materials.tissue": solid, "materials.wall": solid}, **still))
    stability = Stability(system)
    stage = stability.refresh()
    assert stage.eigenvalue == stability.eigenvalues.min()
    exact = (np.pi / length) ** 2 * shear / density
    assert np.abs(stability.eigenvalues / exact - 1).min() < 1e-4
