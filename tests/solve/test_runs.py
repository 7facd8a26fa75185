"""The coupled system through its time steps: what must hold at every step, and what must not matter."""

from __future__ import annotations

from typing import Any

import ngsolve as ng
import numpy as np
import pytest
from ngfsi_studies.verification.balances import Smooth

from ngfsi.case import Case, Solver
from ngfsi.config.functions import FlowConstant, PressureConstant, PressureRamp
from ngfsi.linear.backends import choose_backend
from ngfsi.materials import MooneyRivlin, NeoHookean, SolidLaw
from ngfsi.measure.sections import Sections
from ngfsi.solve.newton import Newton
from ngfsi.solve.time_loop import TimeLoop
from ngfsi.system.system import System
from tests.conftest import SQUEEZED
from tests.runs import Run, computed, largest_change
from tests.slopes import apply
from tests.vein import BLOOD, BONED, TUBE, block, case_of, steady

FLOW = 2.913e-6
AREA, SHEAR = "lumen_area_mean_m2", "sawss_Pa"
RESULTS = (AREA, SHEAR)


def test_the_run_is_a_lively_one(squeezed: Run) -> None:
    assert squeezed[AREA][-1] < 0.9 * squeezed[AREA][0]
    assert squeezed["flow_out_m3_s"][1] > 1.1 * FLOW
    assert [step.time for step in squeezed.steps] == pytest.approx([0.1, 0.2, 0.3])


@pytest.mark.parametrize("which", ["squeezed", "squeezed_finely"])
def test_flow_through_the_moving_inlet(which: str, request: pytest.FixtureRequest) -> None:
    """The inlet shrinks under the skin's pressure; the flux of the blood relative to it is the prescribed one."""
    run: Run = request.getfixturevalue(which)
    assert run["area_z00_m2"][-1] < 0.98 * run["area_z00_m2"][0]
    assert run["flow_in_m3_s"] == pytest.approx(np.full(len(run.rows), FLOW), rel=1e-10)


@pytest.mark.parametrize(("which", "accuracy"), [("squeezed", 1e-7), ("squeezed_finely", 1e-6)])
def test_balance_of_mass(which: str, accuracy: float, request: pytest.FixtureRequest) -> None:
    """What leaves is what enters and what the lumen loses, step by step; the lumen's rate is that of its volume."""
    run: Run = request.getfixturevalue(which)
    assert np.abs(run["mass_defect_m3_s"]).max() < accuracy * FLOW
    rate = run["lumen_volume_rate_m3_s"]
    assert rate[0] == 0.0
    assert abs(rate[1]) > 0.1 * FLOW
    # the first step is one of backward Euler
    volume = run["lumen_volume_m3"]
    assert rate[1] == pytest.approx((volume[1] - volume[0]) / 0.1, rel=0.05)
    balance = rate + run["flow_out_m3_s"] - run["flow_in_m3_s"]
    assert np.abs(balance).max() < accuracy * FLOW


def test_steady_start(held: Run) -> None:
    """With all loads held nothing changes: far below the 1e-6 of a step that would be noticed."""
    for column in RESULTS:
        assert np.abs(np.diff(held[column])).max() < 1e-9 * held[column][0], column
    scales = held.system.block_scales()
    for name, scale in scales.items():
        changes = [np.abs(block(held.system, name, state - held.states[0])).max() for state in held.states]
        assert max(changes) < held.system.case.solver.tolerance * scale, name


def test_prestressed_start_has_no_displacement(held: Run) -> None:
    prestressed = held.system.relaxation is not None
    assert prestressed == (held.system.case.conditions.initial_state == "prestress")
    displaced = np.abs(block(held.system, "d", held.states[0])).max()
    volume = held.system.domain.volume("fluid")
    if prestressed:
        assert displaced == 0.0
        assert held["lumen_volume_m3"][0] == pytest.approx(volume, rel=1e-14)
    else:
        assert displaced > 1e-5
        assert held["lumen_volume_m3"][0] > 1.02 * volume


def test_state_at_the_start_is_a_solution(held: Run) -> None:
    """Tissue and blood are in balance, row by row, against the forces that balance."""
    system = held.system
    system.values[:] = held.states[0]
    balance, blood = forces(system)
    free = system.unknowns.free()
    for name in ("d", "w"):
        rows = block(system, name, free)
        assert np.abs(block(system, name, balance)[rows]).max() < 1e-7 * np.abs(block(system, "d", blood)).max(), name


def forces(system: System) -> tuple[Any, Any]:
    """Return the residual, and the blood's share of it."""
    both = (apply(one, system.state.vec, system.values) for one in (system.form, system.fluid_form()))
    residual, blood = (raw[system.unknowns.equations] for raw in both)
    return residual, blood


def test_traction_balance_at_the_interface(squeezed: Run) -> None:
    """What the blood does to the wall, the tissue holds: in each row of the interface, and not by being zero."""
    system = squeezed.system
    assert np.array_equal(system.values, squeezed.states[-1])
    residual, blood = forces(system)
    wet = np.abs(block(system, "d", blood)) > 1e-6 * np.abs(block(system, "d", blood)).max()
    rows = wet & block(system, "d", system.unknowns.free())
    assert rows.sum() > 50
    size = np.abs(block(system, "d", blood)[rows]).max()
    assert np.abs(block(system, "d", residual)[rows]).max() < 1e-8 * size
    tissue = block(system, "d", residual - blood)[rows]
    assert np.linalg.norm(tissue + block(system, "d", blood)[rows]) < 1e-8 * np.linalg.norm(tissue)
    pressure = squeezed["outlet_pressure_Pa"][-1]
    outwards = np.abs(block(system, "d", blood)[rows]).sum()
    perimeter = 2 * np.pi * BONED.lumen_radius
    assert outwards > 0.5 * pressure * perimeter * BONED.length


def test_mesh_motion_does_not_matter(squeezed: Run) -> None:
    stiff = computed(SQUEEZED.replace(**{"discretisation.extension_stiffness": 1000.0}))
    assert largest_change(stiff[AREA], squeezed[AREA]) < 1e-8
    assert largest_change(stiff[SHEAR], squeezed[SHEAR]) < 1e-8


def test_tolerance_hardly_matters(squeezed: Run) -> None:
    """A tolerance a hundred times tighter than the default changes the results by less than a millionth."""
    tighter = computed(SQUEEZED.replace(**{"solver.tolerance": Solver().tolerance / 100}))
    for column in RESULTS:
        assert largest_change(squeezed[column], tighter[column]) < 1e-6, column


def test_sections_hold_the_volume(squeezed: Run) -> None:
    """Areas at Gauss points along the squeezed vein, of one layer of elements, add up to the volume of its lumen."""
    nodes, weights = np.polynomial.legendre.leggauss(8)
    squeezed.system.values[:] = squeezed.states[-1]
    sections = Sections(squeezed.system, stations=BONED.length * (nodes + 1) / 2)
    sections.refresh()
    volume = BONED.length * np.dot(weights / 2, sections.areas)
    assert volume == pytest.approx(squeezed["lumen_volume_m3"][-1], rel=1e-6)


@pytest.mark.parametrize(("ends", "held"), [("roller", (2,)), ("clamped", (0, 1, 2)), ("free", ())])
def test_end_conditions(ends: Any, held: tuple[int, ...]) -> None:
    """End faces of solids and mesh stay in their plane (roller), stay at all (clamped), or move along z (free)."""
    system = computed(SQUEEZED.replace(**{"conditions.ends": ends, "time.end": 0.1})).system
    motion, domain = system.fields(system.state.components).motion, system.domain
    for face in ("tissue_top", "tissue_bottom", "wall_top", "wall_bottom", "inlet", "outlet"):
        measure = domain.ds(face)
        size = [float(ng.Integrate(motion[i] * motion[i] * measure, domain.mesh)) ** 0.5 for i in range(3)]
        largest = 1e-6 * domain.area(face) ** 0.5
        for i in range(3):
            assert (size[i] < 1e-12 * largest) == (i in held), (face, i, size)


# ---------------------------------------------------------------- units


def scaled(case: Case, length: float, stress: float, time: float) -> Case:
    """The same case with all lengths, stresses and times multiplied; what has other units follows."""
    geometry, solids, loads = case.geometry, case.materials, case.loads
    flow, density, viscosity = length**3 / time, stress * time**2 / length**2, stress * time

    def law(material: SolidLaw) -> SolidLaw:
        return material.replace(young=material.young * stress, density=material.density * density)

    dimensions = ("length", "lumen_diameter", "wall_thickness", "outer_radius", "vein_x", "vein_y")
    sizes = ("far_size", "vein_size")
    return case.replace(
        **{
            "geometry": geometry.replace(
                **{name: getattr(geometry, name) * length for name in dimensions},
                **{f"mesh.{name}": getattr(geometry.mesh, name) * length for name in sizes},
            ),
            "materials.tissue": law(solids.tissue),
            "materials.wall": law(solids.wall),
            "materials.fluid": BLOOD.replace(density=BLOOD.density * density, viscosity=BLOOD.viscosity * viscosity),
            "loads.skin_pressure": PressureRamp(
                final=loads.skin_pressure.final * stress, duration=loads.skin_pressure.duration * time
            ),
            "loads.inlet_flow": FlowConstant(value=loads.inlet_flow.value * flow),
            "loads.outlet_pressure": PressureConstant(value=loads.outlet_pressure.value * stress),
            "time.step": case.time.step * time,
            "time.end": case.time.end * time,
            "time.smallest_step": case.time.smallest_step * time,
        }
    )


def test_units_do_not_matter() -> None:
    """Everything twice as long, at four times the stress, in half the time."""
    case = SQUEEZED.replace(**{"geometry": TUBE, "conditions.ends": "clamped", "time.end": 0.2})
    small, large = computed(case), computed(scaled(case, 2.0, 4.0, 0.5))
    for column, factor in (
        (AREA, 4.0),
        (SHEAR, 4.0),
        ("wss_max_Pa", 4.0),
        ("flow_out_m3_s", 16.0),
        ("p_wall_side_Pa", 4.0),
        ("displacement_max_m", 2.0),
        ("detF_min_fluid_1", 1.0),
        ("reynolds_1", 1.0),
    ):
        assert largest_change(large[column] / factor, small[column]) < 1e-9, column


def test_units_of_the_file_do_not_matter() -> None:
    """The same case written in other units is the same case, up to rounding."""
    written, other = (SQUEEZED.replace(geometry=TUBE).to_toml_dict() for _ in range(2))
    geometry, time, loads = other["geometry"], other["time"], other["loads"]
    geometry["lumen_diameter_mm"] = geometry.pop("lumen_diameter_m") * 1e3
    time["step_ms"] = time.pop("step_s") * 1e3
    loads["outlet_pressure"] = {"kind": "constant", "value_kPa": 1.33322}
    one, two = Case.from_dict(written), Case.from_dict(other)
    assert two.geometry.lumen_diameter == pytest.approx(one.geometry.lumen_diameter, rel=1e-15)
    assert two.time.step == pytest.approx(one.time.step, rel=1e-15)
    assert two.loads.outlet_pressure(0.0) == pytest.approx(one.loads.outlet_pressure(0.0), rel=1e-15)


# ---------------------------------------------------------------- laws


def test_laws_with_equal_moduli_agree_for_small_loads() -> None:
    """Mooney-Rivlin and Neo-Hookean with G = 6980 Pa, K = 28450 Pa: their difference is of second order."""
    laws = (
        MooneyRivlin(c10=13.1e3, c01=-9.61e3, c11=8.86e3, K=28.45e3, density=1060.0),
        NeoHookean(C10=3490.0, Kv=28.45e3, volumetric="K=Kv", density=1060.0),
    )
    gaps = []
    for pressure in (100.0, 50.0):
        losses = [area_loss(law, pressure) for law in laws]
        assert losses[1] > 1e-5 * pressure
        gaps.append(abs(losses[0] / losses[1] - 1))
    assert gaps[0] < 0.05
    assert gaps[1] < 0.6 * gaps[0]
    assert gaps[1] > 0


def area_loss(law: SolidLaw, pressure: float) -> float:
    """Relative loss of the lumen of a vein without blood pressure that is pressed on."""
    system, _ = steady(
        case_of(
            BONED,
            **{
                "materials.tissue": law,
                "materials.wall": law,
                "loads.skin_pressure": PressureConstant(value=pressure),
                "loads.outlet_pressure": PressureConstant(value=0.0),
                "loads.inlet_flow": FlowConstant(value=1e-7),
            },
        )
    )
    J = ng.Det(ng.Id(3) + system.fields(system.state.components).grad_motion)
    return 1 - ng.Integrate(J * system.domain.dx("fluid"), system.domain.mesh) / system.domain.volume("fluid")


# ---------------------------------------------------------------- order


def test_cubic_displacements(squeezed: Run, squeezed_finely: Run) -> None:
    """Order 3 gives the area of order 2 on the same few elements within the error of the latter."""
    assert squeezed_finely.system.tangent.condense
    assert squeezed_finely[AREA] == pytest.approx(squeezed[AREA][:2], rel=5e-3)
    assert squeezed_finely[SHEAR] == pytest.approx(squeezed[SHEAR][:2], rel=0.15)


@pytest.fixture(scope="module")
def oozing() -> tuple[System, Newton]:
    """A vein full of something so thick that it flows out slowly: no waves, which no step here would resolve."""
    case = case_of(
        BONED,
        **{
            "materials.fluid": BLOOD.replace(viscosity=50.0),
            "loads.inlet_flow": FlowConstant(value=1e-8),
            "loads.skin_pressure": Smooth(final=1000.0, duration=0.4),
            "time.end": 0.2,
        },
    )
    return steady(case)


@pytest.mark.parametrize(("scheme", "order"), [("bdf2", 2.0), ("backward_euler", 0.8)])
def test_order_in_time(oozing: tuple[System, Newton], scheme: str, order: float) -> None:
    """Differences between steps of 0.1, 0.05 and 0.025 s; backward Euler comes up to its first order from below."""
    system, _ = oozing
    start, areas = np.array(system.values), []
    for step in (0.1, 0.05, 0.025):
        system.values[:] = start
        system.case = system.case.replace(**{"time.scheme": scheme, "time.step": step})
        newton = Newton(system, choose_backend("auto"))
        for _ in TimeLoop(system.case, system, newton).run():
            pass
        J = ng.Det(ng.Id(3) + system.fields(system.state.components).grad_motion)
        areas.append(ng.Integrate(J * system.domain.dx("fluid"), system.domain.mesh))
    system.values[:] = start
    coarse, fine = np.diff(areas)
    assert np.log2(coarse / fine) == pytest.approx(order, abs=0.25)
    assert abs(fine) > 1e-7 * areas[0]
