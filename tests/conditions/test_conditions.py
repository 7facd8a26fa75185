"""Each condition against exact values: profiles of inflow, resistance, free openings, reversed flow, oblique ends."""

from __future__ import annotations

from functools import cache
from typing import Any, ClassVar

import ngsolve as ng
import numpy as np
import pytest
from netgen.occ import Axis, Box, OCCGeometry, Pnt, Z
from ngfsi_geometry.lofted import LoftedMesh, LoftedVein
from numpy.typing import NDArray
from scipy.special import jv

from ngfsi.case import Case, Conditions, Discretisation, Loads, Materials, TimeStepping
from ngfsi.conditions import (
    FlowOpening,
    FreeOpening,
    OpeningModel,
    PressureOpening,
    ResistanceOpening,
    WindkesselOpening,
)
from ngfsi.conditions.openings import WindkesselTraction
from ngfsi.conditions.profiles import developed, inwards
from ngfsi.config.functions import FlowConstant, FlowHarmonics, FlowTable, PressureConstant
from ngfsi.config.model import ConfigModel
from ngfsi.errors import CaseError
from ngfsi.linear.backends import choose_backend
from ngfsi.materials import CompressibleNeoHookean
from ngfsi.measure.wall import Wall
from ngfsi.physics.fields import VELOCITY
from ngfsi.solve.initial import steady_flow
from ngfsi.solve.newton import Newton
from ngfsi.solve.statics import equilibrium
from ngfsi.solve.time_loop import TimeLoop
from ngfsi.system.system import System
from tests.geometry.test_lofted import ellipse
from tests.solve import test_moving_mesh as moving
from tests.vein import BLOOD, BONED, TUBE, case_of, domain_of, rows, steady, value_of

Array = NDArray[np.float64]

RADIUS, MU, RHO = 5.55e-3, BLOOD.viscosity, BLOOD.density
FLOW = 2.913e-6
MESH = LoftedMesh(around=12, layers=1, inlet_layers=2, lumen_radii=(0.8, 0.5), curving_order=3)
VENOUS = 1333.22


def tube(a: float = RADIUS, b: float = RADIUS, order: int = 3) -> LoftedVein:
    """Return a rigid tube that begins as a circle and ends as an ellipse, curved to an order."""
    mesh = MESH.replace(curving_order=order)
    heights = tuple(map(float, np.linspace(0, 4e-3, 4)))
    return LoftedVein(outlines=(ellipse(a, b),) * 4, heights=heights, inlet_diameters=1.0, mesh=mesh)


def case_with(order: int = 3, **openings: OpeningModel) -> Case:
    """Return the case of the straight rigid tube."""
    return Case(
        name="opening",
        geometry=tube(order=order),
        materials=Materials(fluid=BLOOD),
        loads=Loads(openings=openings),
        conditions=Conditions(ends="clamped"),
        discretisation=Discretisation(order=order),
        time=TimeStepping(step=0.1, end=1.0),
    )


def system_with(order: int = 3, **openings: OpeningModel) -> System:
    case = case_with(order, **openings)
    return System(case, domain_of(case.geometry))


@cache
def solved(order: int, **openings: OpeningModel) -> System:
    """Return a system in steady flow."""
    system = system_with(order, **openings)
    steady_flow(system, choose_backend("auto"))
    return system


def flow(value: float) -> FlowOpening:
    return FlowOpening(flow=FlowConstant(value=value))


def pressure(value: float) -> PressureOpening:
    return PressureOpening(pressure=PressureConstant(value=value))


def mean(system: System, field: Any, opening: str) -> float:
    """Return the mean of a field over an opening."""
    domain = system.domain
    return float(ng.Integrate(field * domain.ds(opening, bonus_intorder=4), domain.mesh) / domain.area(opening))


def difference(system: System, one: Any, other: Any, *openings: str) -> float:
    """Return the root mean square of the difference of two fields over that of the second, in the blood or on
    openings."""
    domain = system.domain
    measure = domain.ds(*openings, bonus_intorder=6) if openings else domain.dx("fluid", bonus_intorder=6)
    squares = [ng.Integrate(ng.InnerProduct(f, f) * measure, domain.mesh) for f in (one - other, other)]
    return float(np.sqrt(squares[0] / squares[1]))


def velocity(system: System) -> Any:
    return system.named(system.state)[VELOCITY]


def length(system: System) -> float:
    geometry = system.case.geometry
    return float(geometry.length + geometry.inlet_length)


PARABOLA = ng.CF((0, 0, 2 * FLOW / (np.pi * RADIUS**2) * (1 - (ng.x**2 + ng.y**2) / RADIUS**2)))
GRADIENT = 8 * MU * FLOW / (np.pi * RADIUS**4)


# ---------------------------------------------------------------- profiles


@pytest.mark.parametrize(("a", "b"), [(RADIUS, RADIUS), (1.3 * RADIUS, RADIUS / 1.3)])
def test_developed_profile(a: float, b: float) -> None:
    """2 (1 - x^2/a^2 - y^2/b^2), of unit mean, by Poisson's equation."""
    domain = domain_of(tube(a, b))
    found, exact = developed(domain, "outlet", 3), 2 * (1 - ng.x**2 / a**2 - ng.y**2 / b**2)
    over = domain.ds("outlet", bonus_intorder=6)
    found = found * (domain.area("outlet") / ng.Integrate(found * over, domain.mesh))
    error, size = (ng.Integrate(f * f * over, domain.mesh) for f in (found - exact, exact))
    assert np.sqrt(error / size) < 2e-3
    for opening, way in (("inlet", 1.0), ("outlet", -1.0)):
        assert domain.value(inwards(domain, opening, "fluid"), 0, 0, 0) == pytest.approx((0, 0, way), abs=1e-6)


def at_inlet(system: System, field: Any) -> tuple[Array, Array]:
    """Return the distances (n,) [m] from the axis of points of the inlet, the rims of its elements included, and the
    values of a field there."""
    steps = np.linspace(0, 1, 5)
    square = [(float(s), float(t)) for s in steps for t in steps]
    points = {ng.QUAD: square, ng.TRIG: [(s, t) for s, t in square if s + t <= 1]}
    rules = {shape: ng.IntegrationRule(inside, [1.0] * len(inside)) for shape, inside in points.items()}
    at = system.domain.mesh.MapToAllElements(rules, system.domain.boundaries("inlet"))
    place = np.asarray(ng.CF((ng.x, ng.y))(at))
    return np.hypot(*place.T), np.asarray(field(at))


def test_flat_profile() -> None:
    """One velocity wherever the wall's elements do not reach, and the flow wanted."""
    system = system_with(inlet=FlowOpening(flow=FlowConstant(value=FLOW), profile="flat"), outlet=pressure(0.0))
    system.update(0.0)
    system.prescribe()
    radii, found = at_inlet(system, velocity(system))
    core, rim = found[radii < 0.79 * RADIUS], found[radii > 0.999 * RADIUS]
    mean_velocity = FLOW / (np.pi * RADIUS**2)
    assert core[:, 2] == pytest.approx(np.full(len(core), core[0, 2]), rel=1e-6)
    assert np.abs(found[:, :2]).max() < 1e-6 * mean_velocity
    assert mean_velocity < core[0, 2] < 1.4 * mean_velocity
    assert np.abs(rim).max() < 1e-12 * mean_velocity
    assert mean(system, velocity(system)[2], "inlet") * system.domain.area("inlet") == pytest.approx(FLOW, rel=1e-10)


KAPPA = 1j**1.5 * RADIUS * np.sqrt(2 * np.pi * RHO / MU)
"""At 1 Hz."""


def pulse(radius: Array | float, t: float) -> Any:
    """Return the axial velocity (m/s) of the flow FLOW cos(2 pi t) (Womersley 1955)."""
    shape = (1 - jv(0, KAPPA * radius / RADIUS) / jv(0, KAPPA)) / (1 - 2 * jv(1, KAPPA) / (KAPPA * jv(0, KAPPA)))
    return FLOW / (np.pi * RADIUS**2) * np.real(shape * np.exp(2j * np.pi * t))


def test_womersley_profile() -> None:
    """The velocity at the inlet over a period, and what shear it makes on the wall there: more than developed flow, and
    ahead of it."""
    sine = FlowHarmonics(mean=0.0, amplitudes=(FLOW,), phases=(0.0,), period=1.0)
    system = system_with(4, inlet=FlowOpening(flow=sine, profile="womersley"), outlet=pressure(0.0))
    amplitude = np.abs([pulse(0.0, t) for t in np.linspace(0, 1, 40)]).max()
    shears, times = [], np.arange(8) / 8
    outwards = ng.CF((ng.x, ng.y, 0)) / ng.sqrt(ng.x**2 + ng.y**2)
    for t in times:
        system.update(t)
        system.prescribe()
        w = velocity(system)
        radii, found = at_inlet(system, w[2])
        assert np.abs(found.ravel() - pulse(radii, t)).max() < 2e-3 * amplitude, t
        flux = mean(system, w[2], "inlet") * system.domain.area("inlet")
        assert flux == pytest.approx(sine(t), abs=1e-10 * FLOW)
        radii, slopes = at_inlet(system, ng.BoundaryFromVolumeCF(ng.Grad(w)[2, :] * outwards))
        shears.append(-MU * slopes.ravel()[radii > 0.999 * RADIUS].mean())
    found = 2 * np.mean(np.array(shears) * np.exp(-2j * np.pi * times))
    ratio = jv(1, KAPPA) / jv(0, KAPPA)
    exact = -MU * FLOW / (np.pi * RADIUS**3) * KAPPA * ratio / (1 - 2 * ratio / KAPPA)
    assert abs(exact) == pytest.approx(0.16693, rel=1e-4)
    assert np.degrees(np.angle(exact)) == pytest.approx(36.3, abs=0.05)
    assert abs(found) == pytest.approx(abs(exact), rel=3e-3)
    assert np.degrees(np.angle(found)) == pytest.approx(np.degrees(np.angle(exact)), abs=0.2)


def test_womersley_profile_of_a_constant_flow_is_refused() -> None:
    with pytest.raises(CaseError, match="'womersley' at 'inlet' needs a periodic flow"):
        system_with(inlet=FlowOpening(flow=FlowConstant(value=FLOW), profile="womersley"), outlet=pressure(0.0))


# ---------------------------------------------------------------- openings


@pytest.mark.parametrize("distal", [0.0, VENOUS])
def test_resistance(distal: float) -> None:
    """p = p0 + R Q at the outlet to solver tolerance, and Poiseuille's drop on top of it at the inlet."""
    resistance = 2 / FLOW
    behind = PressureConstant(value=distal)
    system = solved(2, inlet=flow(FLOW), outlet=ResistanceOpening(resistance=resistance, distal_pressure=behind))
    outlet: Any = system.conditions["outlet"]
    beyond = float(system.named(system.state)["outlet_pressure"].vec[0])
    assert system.blood_density.Get() == RHO  # it grew while the flow was found
    assert outlet.outflow() == pytest.approx(FLOW, rel=1e-6)
    assert beyond == pytest.approx(resistance * outlet.outflow(), rel=1e-8)
    at_outlet, at_inlet = (mean(system, system.blood_pressure(), name) for name in ("outlet", "inlet"))
    assert at_outlet - distal == pytest.approx(2.0, rel=1e-3)
    assert at_inlet - at_outlet == pytest.approx(GRADIENT * length(system), rel=2e-3)
    assert difference(system, velocity(system), PARABOLA) < 2e-3


@pytest.mark.parametrize("opening", ["outlet", "inlet"])
def test_a_valve_lets_blood_through_towards_the_heart(opening: str) -> None:
    """300 Pa across a resistance drive dp / R ahead, and back the leak, a tenth of it; the tube has 0.03 % of R."""
    resistance, leakage = 300.0 / FLOW, 0.1
    for high, low, share in (("inlet", "outlet", 1.0), ("outlet", "inlet", -leakage)):
        known = {high: PressureConstant(value=300.0), low: PressureConstant(value=0.0)}
        behind = ResistanceOpening(resistance=resistance, distal_pressure=known[opening], valve_leakage=leakage)
        other = "inlet" if opening == "outlet" else "outlet"
        system = solved(2, **{opening: behind, other: PressureOpening(pressure=known[other])})
        outlet: Any = system.conditions["outlet"]
        assert outlet.outflow() == pytest.approx(share * FLOW, rel=2e-3)
        # by which Newton's method judges changes of the velocity
        assert system.conditions[opening].flow_scale() == pytest.approx(abs(share) * FLOW, rel=2e-3)


def test_windkessel() -> None:
    """In a vein that is held Q = a t from rest on gives p - p0 = a (Rp t + Rd (t - T (1 - exp(-t / T)))), T = Rd C."""
    slope, first, distal, decay, step = 2e-6, 3e7, 1e8, 0.2, 0.01
    behind = WindkesselOpening(
        resistance=first, compliance=decay / distal, distal_resistance=distal,
        distal_pressure=PressureConstant(value=500.0),
    )  # fmt: skip
    case = case_of(TUBE, **{
        "loads.inlet_flow": FlowTable(times=(0.0, 1.0), values=(0.0, slope)), "loads.openings": {"outlet": behind},
        "conditions.ends": "clamped", "time.step": step, "time.end": 0.4,
    })  # fmt: skip
    system, _ = steady(case)
    still = [name for name in system.unknowns.blocks if name not in "de"]
    loop, outlet = TimeLoop(case, system, Newton(system, choose_backend("auto"), *still)), system.conditions["outlet"]
    assert isinstance(outlet, WindkesselTraction)
    t, found = np.array([(taken.time, outlet.given_pressure() - 500.0) for taken in loop.run()]).T
    exact = slope * (first * t + distal * (t - decay * (1 - np.exp(-t / decay))))
    assert np.abs(found - exact).max() < 1e-3 * exact.max()
    assert found[-1] < 0.8 * slope * (first + distal) * t[-1]


def test_free_opening() -> None:
    """On a moving mesh, for a flow that is known: no traction at all on the deformed outlet."""
    linear = moving.Flow(moving.MIXED, moving.ALONG)
    system = moving.prescribed(2, linear, **{"loads.openings": {"outlet": FreeOpening()}})
    value_of(system, "outlet").Set(0.0)
    system.reference().Set(0.0)
    found = moving.residual(system)
    wanted, developed_flow = (moving.expected(system, linear, free=free) for free in (True, False))
    for row in ("w", "d"):
        size = np.linalg.norm(rows(system, row, wanted))
        assert np.linalg.norm(rows(system, row, found - wanted)) < 1e-5 * size
        assert np.linalg.norm(rows(system, row, found - developed_flow)) > 1e-2 * size


def test_reversed_flow() -> None:
    """Blood that enters through the outlet does so developed: velocity and wall shear are those of forward flow."""
    forward, back = (solved(2, inlet=flow(sign * FLOW), outlet=pressure(0.0)) for sign in (1, -1))
    assert difference(back, -velocity(back), velocity(forward)) < 1e-3
    assert difference(back, -velocity(back), PARABOLA, "outlet") < 2e-3
    shears = []
    for system in (forward, back):
        wall = Wall(system, system.domain.vessels[0])
        wall.refresh()
        shears.append(wall.sample(1).shear)
    assert np.abs(shears[0] + shears[1]).max() < 2e-3 * np.linalg.norm(shears[0], axis=1).max()


def test_no_flow_at_all() -> None:
    """A vein in tissue, filled with blood at rest: found at once, and without a trace of flow."""
    loads = {"loads.inlet_flow": FlowConstant(value=0.0), "loads.outlet_pressure": PressureConstant(value=VENOUS)}
    system, newton = steady(case_of(BONED, **loads))
    domain = system.domain
    assert np.abs(system.values[system.unknowns.blocks["w"]]).max() < 1e-12
    assert np.abs(system.values[system.unknowns.blocks["p"]]).max() < 1e-12 * VENOUS
    assert mean(system, system.blood_pressure(), "inlet") == pytest.approx(VENOUS, rel=1e-12)
    assert np.abs(system.values[system.unknowns.blocks["d"]]).max() > 1e-3 * domain.geometry.size
    assert newton.factorisation.count <= 3


def test_an_inlet_3_pa_above_the_outlet() -> None:
    """Hagen and Poiseuille's flow, pi R^4 dp / (8 mu L), behind a pressure that is hundreds of times as large."""
    system = solved(3, inlet=pressure(VENOUS + 3.0), outlet=pressure(VENOUS))
    drop = GRADIENT * length(system)
    outlet: Any = system.conditions["outlet"]
    assert outlet.outflow() == pytest.approx(3.0 / drop * FLOW, rel=5e-3)
    assert difference(system, velocity(system), 3.0 / drop * PARABOLA) < 5e-3
    assert mean(system, system.blood_pressure(), "inlet") - VENOUS == pytest.approx(3.0, rel=5e-3)


# ---------------------------------------------------------------- supports

SIDE = 10e-3
SOFT = CompressibleNeoHookean(young=30e3, poisson=0.3, density=1000.0)


class Block(ConfigModel):
    """A block of tissue between two ends, turned about an oblique axis."""

    solids: ClassVar[tuple[str, ...]] = ("tissue",)
    vessels: ClassVar[tuple[Any, ...]] = ()
    rigid_names: ClassVar[tuple[str, ...]] = ()
    internal_names: ClassVar[tuple[str, ...]] = ()
    boundary_names: ClassVar[tuple[str, ...]] = ("skin", "tissue_bottom", "tissue_top")
    curving_order: ClassVar[int] = 1
    size: ClassVar[float] = SIDE
    turn: float = 0.0

    @property
    def rotation(self) -> Array:
        """Rodrigues' formula."""
        k = np.array([1.0, 2.0, 0.5]) / np.sqrt(5.25)
        cross = np.array([[0, -k[2], k[1]], [k[2], 0, -k[0]], [-k[1], k[0], 0]])
        return np.eye(3) + np.sin(self.turn) * cross + (1 - np.cos(self.turn)) * cross @ cross

    def inflow(self) -> Any:
        return

    def shape_map(self) -> None:
        return

    def mesh_attempts(self) -> tuple[str, ...]:
        return ("direct",)

    def exact_volumes(self) -> dict[str, float]:
        return {"tissue": SIDE**3}

    def netgen_mesh(self, attempt: int = 0) -> Any:  # noqa: ARG002 - there is one way
        box = Box(Pnt(0, 0, 0), Pnt(SIDE, SIDE, SIDE))
        box.faces.name = "skin"
        box.faces.Min(Z).name, box.faces.Max(Z).name = "tissue_bottom", "tissue_top"
        box.solids.name = "tissue"
        turned = box.Rotate(Axis((0, 0, 0), (1.0, 2.0, 0.5)), np.degrees(self.turn)) if self.turn else box
        return OCCGeometry(turned).GenerateMesh(maxh=SIDE / 2)


def pressed(turn: float) -> System:
    """Return a block in equilibrium under a pressure on its sides, between rollers."""
    geometry = Block(turn=turn)
    case = Case(
        name="block",
        geometry=geometry,
        materials=Materials(tissue=SOFT),
        loads=Loads(skin_pressure=PressureConstant(value=3e3)),
        conditions=Conditions(ends="roller"),
        discretisation=Discretisation(order=2),
        time=TimeStepping(step=1.0, end=1.0),
    )
    return equilibrium(case, domain_of(geometry))


def test_rollers_on_an_oblique_end() -> None:
    """The ends slide in their plane and do not leave it: the block gets thinner as between rollers along z, with the
    stretches s, s, 1 everywhere and the stress -p across. It may turn about the normal of the ends."""
    along, oblique = pressed(0.0), pressed(0.7)
    shear, lame = SOFT.shear_modulus, SOFT.lame
    s = 1.0
    for _ in range(50):  # stress mu (s^2 - 1)/J + lame ln(J)/J = -p, J = s^2
        stress = (shear * (s * s - 1) + 2 * lame * np.log(s)) / s**2
        slope = (2 * shear * s + 2 * lame / s) / s**2 - 2 * stress / s
        s -= (stress + 3e3) / slope
    for system in (along, oblique):
        Q = system.domain.geometry.rotation
        wanted = Q @ np.diag([s**2, s**2, 1.0]) @ Q.T
        F = ng.Id(3) + ng.Grad(system.motion)
        centre = Q @ np.full(3, SIDE / 2)
        found = np.array((F.trans * F)(system.domain.mesh(*centre))).reshape(3, 3)
        assert found == pytest.approx(wanted, abs=2e-5)
        for end in ("tissue_bottom", "tissue_top"):
            normal = ng.CF(tuple(Q[:, 2]))
            assert np.sqrt(mean(system, (system.motion * normal) ** 2, end)) < 1e-5 * (1 - s) * SIDE
    assert s < 0.97
