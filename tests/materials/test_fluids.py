"""Laws of fluids that thin under shear: viscosities by hand, and developed flow in pipes by one quadrature."""

from __future__ import annotations

from functools import cache
from typing import Any

import ngsolve as ng
import numpy as np
import pytest
from netgen.geom2d import unit_square
from ngfsi_geometry.segment import MeshSettings
from scipy.integrate import quad
from scipy.optimize import brentq

from ngfsi.conditions.profiles import developed_of_law
from ngfsi.errors import MaterialError
from ngfsi.linear.backends import choose_backend
from ngfsi.materials import available_sets, load_set
from ngfsi.materials.fluid.carreau_yasuda import CarreauYasuda
from ngfsi.materials.fluid.casson import Casson
from ngfsi.materials.fluid.cross import Cross
from ngfsi.materials.fluid.law import FluidLaw
from ngfsi.materials.fluid.quemada import Quemada
from ngfsi.measure.probe import Probe
from ngfsi.measure.wall import Wall
from ngfsi.physics.fields import PRESSURE, VELOCITY
from ngfsi.registry import everything, find
from ngfsi.solve.initial import steady_flow
from ngfsi.system.system import System
from tests.runs import row
from tests.vein import TUBE, case_of, domain_of

SETS = {name: load_set(name) for name in available_sets() if isinstance(load_set(name), FluidLaw)}
each_set = pytest.mark.parametrize("name", SETS)
FLOW = 2.9e-6


def quemada(s: float) -> float:
    return float(1.2 / (1 - 0.225 * (4.33 + 2.07 * s) / (1 + s)) ** 2)


# mPa s at 1, 19 and 100 1/s, from the formulas by hand
KNOWN = {
    "blood": lambda _: 3.5,
    "blood_carreau": lambda g: 3.45 + 52.55 * (1 + (3.313 * g) ** 2) ** (-0.6432 / 2),
    "blood_carreau_yasuda": lambda g: 3.45 + 52.55 * (1 + (1.902 * g) ** 1.25) ** (-0.78 / 1.25),
    "blood_carreau_yasuda_boyd": lambda g: 3.5 + 156.5 * (1 + (8.2 * g) ** 0.64) ** -1.23,
    "blood_analogue": lambda g: 2.2 + 19.8 * (1 + (0.11 * g) ** 0.644) ** (-0.608 / 0.644),
    "blood_cross": lambda g: 3.45 + 52.55 / (1 + (1.007 * g) ** 1.028),
    "blood_casson": lambda g: (3.5**0.5 + (4.0 / np.hypot(g, 0.1)) ** 0.5) ** 2,
    "blood_quemada": lambda g: quemada((np.hypot(g, 0.1) / 1.88) ** 0.5),
}


def test_every_law_has_a_set() -> None:
    laws = everything("ngfsi.fluid_laws", "law").values()
    assert {type(law) for law in SETS.values()} == {law for law in laws if law.__module__.startswith("ngfsi.")}


@each_set
def test_viscosities_by_hand(name: str) -> None:
    law, mesh = SETS[name], ng.Mesh(unit_square.GenerateMesh(maxh=1))
    for g in (1.0, 19.0, 100.0):
        assert 1e3 * law.viscosity_at(g) == pytest.approx(KNOWN[name](g), rel=1e-6)
        sheared = ng.CF((0, g * 3 / 5, 0, g * 3 / 5, 0, g * 4 / 5, 0, g * 4 / 5, 0), dims=(3, 3))
        found = ng.CF(law.apparent_viscosity(sheared))(mesh(0.3, 0.3))
        assert found == pytest.approx(law.viscosity_at(g), rel=1e-5)
    assert 1e3 * law.nominal_viscosity == pytest.approx(KNOWN[name](100.0), rel=1e-6)


def test_the_default_vein_is_where_blood_thins() -> None:
    """At 19 1/s all published laws of blood are above the constant, by a third to a factor of 2."""
    ratios = [law.viscosity_at(19.0) / 3.5e-3 for name, law in SETS.items() if name not in ("blood", "blood_analogue")]
    assert min(ratios) > 1.3
    assert max(ratios) == pytest.approx(2.03, abs=0.01)


@each_set
def test_written_and_read(name: str) -> None:
    law = SETS[name]
    assert type(law).from_dict(law.to_toml_dict()) == law
    assert find("ngfsi.fluid_laws", law.law, "law") is type(law)
    assert law.formula
    assert law.source


@pytest.mark.parametrize(
    ("law", "values", "said"),
    [
        (CarreauYasuda, {"viscosity_at_rest": 1.0, "viscosity_at_high_shear": 2.0, "time_constant": 1.0, "n": 0.5},
         "must not be larger than that at rest"),
        (Cross, {"viscosity_at_rest": 1.0, "viscosity_at_high_shear": 0.01, "time_constant": 1.0, "m": 2.0},
         "stress would fall"),
        (Quemada, {"viscosity_of_plasma": 1e-3, "haematocrit": 0.5, "k_rest": 4.0, "k_high_shear": 2.0,
                   "critical_shear_rate": 1.0}, "solid"),
        (Quemada, {"viscosity_of_plasma": 1e-3, "haematocrit": 0.5, "k_rest": 2.0, "k_high_shear": 3.0,
                   "critical_shear_rate": 1.0}, "must not be larger than k_rest"),
        (Casson, {"yield_stress": -1.0, "viscosity_at_high_shear": 1.0}, "yield_stress"),
    ],
)  # fmt: skip
def test_what_cannot_flow_is_refused(law: type, values: dict[str, float], said: str) -> None:
    with pytest.raises(MaterialError, match=said):
        law(density=1060.0, **values)


class Pipe:
    """Developed flow in a round pipe, by scipy: mu(g) g = G r/2."""

    def __init__(self, law: Any, radius: float, flow: float) -> None:
        self.law, self.radius = law, radius
        self.gradient = float(brentq(lambda G: np.log(self.flow(G) / flow), 1e-4, 1e6, xtol=1e-12, rtol=1e-12))
        self.wall = self.gradient * radius / 2

    def rate(self, stress: float) -> float:
        return float(brentq(lambda g: self.law.viscosity_at(g) * g - stress, 1e-12, 1e7, xtol=1e-14, rtol=1e-13))

    def flow(self, gradient: float) -> float:
        """pi int r^2 g dr."""
        return float(quad(lambda r: np.pi * r**2 * self.rate(gradient * r / 2) if r else 0.0, 0, self.radius,
                          epsrel=1e-11, epsabs=0.0, limit=200)[0])  # fmt: skip

    def velocity(self, r: Any) -> Any:
        return [quad(lambda s: self.rate(self.gradient * s / 2), one, self.radius, epsrel=1e-9)[0] for one in r]


@each_set
@pytest.mark.parametrize("rate", [0.3, 20.0, 900.0])
def test_wall_shear_of_developed_flow(name: str, rate: float) -> None:
    """Of Q = pi R^3 rate / 4, by integrals over the radius."""
    law = SETS[name]
    stress = Pipe(law, 5e-3, np.pi * 5e-3**3 * rate / 4).wall
    assert law.developed_viscosity(rate) * rate == pytest.approx(stress, rel=1e-6)
    several = law.developed_viscosity(np.array([[rate, -rate], [1.0, 0.0]]))
    if name != "blood":
        assert several[0] == pytest.approx([stress / rate] * 2, rel=1e-6)
        assert several[1, 1] == pytest.approx(law.viscosity_at(1e-3), rel=2e-2)


MESH = MeshSettings(
    element="mixed", axial_layers=1, far_size=20e-3, vein_size=3.5e-3, lumen_radii=(0.8, 0.5, 0.2),
    curving_order=3,
)  # fmt: skip
PIPE = TUBE.replace(mesh=MESH, length=4e-3)


@cache
def flowing(name: str) -> tuple[System, Pipe]:
    """Return a short pipe with the developed flow that the case asks for."""
    changes = {"discretisation.order": 3, "conditions.ends": "clamped", "loads.inlet_flow": {"kind": "constant",
               "value": FLOW}, "materials.fluid": SETS[name]}  # fmt: skip
    system = System(case_of(PIPE, **changes), domain_of(PIPE))
    steady_flow(system, choose_backend("auto"))
    return system, Pipe(SETS[name], PIPE.lumen_radius, FLOW)


@pytest.mark.parametrize("name", ["blood_casson"])
def test_pipe(name: str) -> None:
    """Profile, wall shear, drop of pressure and what columns make of it."""
    system, exact = flowing(name)
    state, domain = system.named(system.state), system.domain
    radii = np.linspace(0, 0.97, 12) * PIPE.lumen_radius
    found = [domain.value(state[VELOCITY], r * 0.8, r * 0.6, 0.5 * PIPE.length)[2] for r in radii]
    np.testing.assert_allclose(found, exact.velocity(radii), rtol=0, atol=2e-3 * found[0])
    wall = Wall(system, domain.vessels[0])
    wall.refresh()
    assert wall.statistics().mean == pytest.approx(exact.wall, rel=3e-3)
    inlet = ng.Integrate(state[PRESSURE] * domain.ds("inlet"), domain.mesh) / domain.area("inlet")
    assert inlet == pytest.approx(exact.gradient * PIPE.length, rel=5e-3)
    probe = Probe(system)
    probe.refresh()
    values = row(probe)
    for column in ("sawss_poiseuille_inlet_Pa", "sawss_poiseuille_local_Pa", "sawss_ellipse_local_Pa"):
        assert values[column] == pytest.approx(exact.wall, rel=3e-3), column
    speed = FLOW / (np.pi * PIPE.lumen_radius**2)
    assert values["reynolds_1"] == pytest.approx(8 * 1060 * speed**2 / exact.wall, rel=3e-3)  # Metzner and Reed


def test_profile_of_a_flow_between_those_computed() -> None:
    """Profiles of flows a factor of 2 apart, in proportion in between; at 0.3 times the flow it is less blunt."""
    system, _ = flowing("blood_casson")
    condition: Any = system.conditions["inlet"]
    peaks = []
    for factor in (1.0, 0.3):
        condition.value.Set(factor * FLOW)
        system.prescribe()
        assert condition.outflow() == pytest.approx(-factor * FLOW, rel=1e-10)
        velocity = system.domain.value(system.named(system.state)[VELOCITY], 0, 0, 1e-9)[2]
        exact = Pipe(SETS["blood_casson"], PIPE.lumen_radius, factor * FLOW).velocity([0.0])[0]
        assert velocity == pytest.approx(exact, rel=2e-3)
        peaks.append(velocity / factor)
    assert peaks[1] < 0.97 * peaks[0]  # slower, it is nearer to where the slope is smallest
    condition.value.Set(FLOW)
    system.prescribe()


@pytest.mark.parametrize(("ratio", "error"), [(1.0, 1e-3), (2.0, 0.01), (3.0, 0.04)])
def test_mean_wall_shear_in_an_ellipse(ratio: float, error: float) -> None:
    """The viscosity of a round pipe with the same mean of the wall shear rate, against developed flow over the ellipse:
    tau perimeter = G area, G by the work of the flow."""
    a, b = (5.55e-3 * ratio**power for power in (0.5, -0.5))
    tube = TUBE.replace(mesh=MESH, length=4e-3, aspect_ratio=ratio)
    domain, law = domain_of(tube), SETS["blood_carreau"]
    u, over = developed_of_law(domain, "inlet", 4, law, FLOW), domain.ds("inlet", bonus_intorder=8)
    slope = ng.Grad(u).Trace()
    rate = ng.sqrt(ng.InnerProduct(slope, slope) + 1e-6)
    gradient = ng.Integrate(law.viscosity_at(rate) * ng.InnerProduct(slope, slope) * over, domain.mesh) / FLOW
    perimeter = quad(lambda s: np.hypot(a * np.sin(s), b * np.cos(s)), 0, 2 * np.pi)[0]
    mean = gradient * domain.area("inlet") / perimeter
    nominal = 4 * FLOW * (a**2 + b**2) / (a**2 * b**2 * perimeter)
    assert law.developed_viscosity(nominal) * nominal == pytest.approx(mean, rel=error)
