"""Curves, laws, materials, loads, openings and conditions."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from math import cos, pi, sin
from typing import Any, Literal

import ngsolve as ng
import numpy as np
from ngfsi_geometry.calf_section import SectionSizes, subject
from ngfsi_geometry.channel import (
    Beam,
    CylinderMesh,
)
from ngfsi_geometry.tube import TubeSegment

from ngfsi import registry
from ngfsi.case import Conditions, Materials
from ngfsi.conditions import Condition, ConditionModel, ContactModel, Cuff, PressureOn
from ngfsi.config import functions as curves
from ngfsi.materials import CompressibleNeoHookean, MooneyRivlin, NeoHookean, Ogden, SaintVenantKirchhoff, load_set
from ngfsi.materials.membrane import Membrane
from ngfsi.materials.solid.blemker import Blemker
from ngfsi.materials.solid.directions import ConstantDirection
from ngfsi.materials.solid.holzapfel_gasser_ogden import HolzapfelGasserOgden
from ngfsi.materials.solid.humphrey_yin import HumphreyYin
from ngfsi.measure.probe import Probe
from ngfsi.mesh.domain import Domain
from ngfsi.outlines.displacement import OutlineDisplacement
from ngfsi.physics.fields import VELOCITY
from ngfsi.registry import register
from ngfsi.report import terminal
from ngfsi.solve.statics import equilibrium, section_case
from ngfsi.solve.time_loop import TimeLoop
from ngfsi.system.forms import residual_form
from ngfsi.system.system import System
from tests.runs import row
from tests.settings.table import Outcome, entry
from tests.vein import BLOOD, BONED, TISSUE, TUBE, case_of, domain_of, position, rows, set_motion, steady, system_of


@entry("Curve.kind", rel=1e-3)
def _kinds_of_curves() -> Outcome:
    """At a quarter of what each lasts."""
    even = tuple(np.linspace(0, 1, 17).tolist())
    tables: list[dict[str, Any]] = [
        {"kind": "constant", "value_Pa": 3.0},
        {"kind": "ramp", "final_Pa": 3.0, "duration_s": 1.0},
        {"kind": "smooth_ramp", "final_Pa": 3.0, "duration_s": 1.0},
        {"kind": "table", "times_s": [0, 0.5, 1], "values_Pa": [1.0, 4.0, 0.0]},
        {"kind": "harmonics", "mean_Pa": 1.0, "amplitudes_Pa": [2.0], "phases_deg": [90], "period_s": 1.0},
        {"kind": "waveform", "times_s": even, "values_Pa": [2 - sin(2 * pi * t) for t in even]},
        {"kind": "hydrostatic", "posture": "lying"},
    ]
    values = [case_of(**{"loads.skin_pressure": table}).loads.skin_pressure(0.25) for table in tables]
    return values, [3.0, 0.75, 3 * (1 - cos(pi / 4)) / 2, 2.5, -1.0, 1.0, 1333.22]


@entry("Constant.value")
def _value() -> Outcome:
    return curves.PressureConstant(value=7.0)(0.4), 7.0


@entry("Hydrostatic.posture", "Hydrostatic.below_heart", "Hydrostatic.at_heart", "Hydrostatic.density")
def _hydrostatic() -> Outcome:
    """1000 times 9.81 times 1.283, and 10.4 kPa for each metre of blood."""
    deep = curves.Hydrostatic(below_heart=1.283, at_heart=5.0, density=1000.0)
    postures = [curves.Hydrostatic(posture=name)(0.3) for name in ("lying", "sitting", "standing")]
    return [deep(0.1), *postures], [
        5.0 + 12586.23, 1333.22, 1333.22 + 0.50 * 10398.6, 1333.22 + 0.93 * 10398.6
    ]  # fmt: skip


@entry("Rise.initial", "Rise.final", "Rise.start", "Rise.duration")
def _rise() -> Outcome:
    ramp = curves.PressureRamp(initial=2.0, final=10.0, start=0.5, duration=2.0)
    return [ramp(t) for t in (0.4, 0.5, 1.0, 2.5, 3.0)], [2.0, 2.0, 4.0, 10.0, 10.0]


@entry("Sampled.times")
def _table() -> Outcome:
    table = curves.PressureTable(times=(0.5, 1.0, 3.0), values=(1.0, 4.0, -2.0))
    return [table(t) for t in (0.0, 0.6, 2.0, 4.0)], [1.0, 1.6, 1.0, -2.0]


@entry("Harmonics.mean", "Harmonics.amplitudes", "Harmonics.phases", "Harmonics.period")
def _harmonics() -> Outcome:
    curve = curves.PressureHarmonics(mean=3.0, amplitudes=(2.0, 0.5), phases=(0.3, -0.7), period=0.8)
    exact = [3 + 2 * cos(2 * pi * t / 0.8 + 0.3) + 0.5 * cos(4 * pi * t / 0.8 - 0.7) for t in (0.1, 0.9, 5.0)]
    return [curve(t) for t in (0.1, 0.9, 5.0)], exact


@entry("Sampled.values", rel=2e-5)
def _waveform() -> Outcome:
    """A sine that begins at its steepest: a spline with free ends would be 1e-2 off near them."""
    times = np.linspace(0, 0.8, 17)
    curve = curves.PressureWaveform(
        times=tuple(times.tolist()), values=tuple((2 + np.sin(2 * pi * times / 0.8)).tolist())
    )
    asked = (0.01, 0.79, 0.33, 1.63)
    return [curve(t) for t in asked], [2 + sin(2 * pi * t / 0.8) for t in asked]


F = np.array([[1.1, 0.2, 0.0], [-0.1, 0.9, 0.1], [0.05, 0.0, 1.05]])
J = float(np.linalg.det(F))
VOLUME = TUBE.exact_volumes()


def stress(law: Any, region: str = "tissue") -> np.ndarray:
    """Return the Cauchy stress (3, 3) of a region of a tube in a homogeneous deformation."""
    system = system_of(case_of(TUBE, **{f"materials.{region}": law}))
    set_motion(system, ng.CF(tuple((F - np.eye(3)).ravel().tolist()), dims=(3, 3)) * position())
    at = {"tissue": 10e-3, "wall": TUBE.lumen_radius + 1e-3}[region]
    return np.array(system.cauchy_stress(region)(system.domain.mesh(at, 1e-4, 5e-3))).reshape(3, 3)


M = MooneyRivlin(c10=13.1e3, c01=-9.6e3, c11=8.9e3, K=28e3, density=1060.0)
N = NeoHookean(C10=5e3, Kv=30e3, volumetric="K=Kv", density=1060.0)
SVK = SaintVenantKirchhoff(young=30e3, poisson=0.3, density=1060.0)


def deviator(tensor: np.ndarray) -> np.ndarray:
    return np.asarray(tensor - np.trace(tensor) / 3 * np.eye(3))


B = F @ F.T
I1, I2 = (float(v) for v in (np.trace(B) * J ** (-2 / 3), (np.trace(B) ** 2 - np.trace(B @ B)) / 2 * J ** (-4 / 3)))
DEV_1 = 2 / J * deviator(J ** (-2 / 3) * B)
DEV_2 = 2 / J * deviator(J ** (-4 / 3) * (np.trace(B) * B - B @ B))


@entry("MooneyRivlin.c10", rel=1e-7)
def _c10() -> Outcome:
    return stress(M.replace(c10=14.1e3)) - stress(M), 1e3 * DEV_1


@entry("MooneyRivlin.c01", rel=1e-7)
def _c01() -> Outcome:
    return stress(M.replace(c01=-8.6e3)) - stress(M), 1e3 * DEV_2


@entry("MooneyRivlin.c11", rel=1e-7)
def _c11() -> Outcome:
    return stress(M.replace(c11=9.9e3)) - stress(M), 1e3 * ((I2 - 3) * DEV_1 + (I1 - 3) * DEV_2)


@entry("MooneyRivlin.K", rel=1e-7)
def _bulk_modulus() -> Outcome:
    return np.trace(stress(M.replace(K=38e3)) - stress(M)) / 3, 10e3 * (J - 1)


@entry("NeoHookean.C10", rel=1e-7)
def _neo_hookean_shear() -> Outcome:
    return stress(N.replace(C10=6e3)) - stress(N), 1e3 * DEV_1


@entry("NeoHookean.Kv", "NeoHookean.volumetric", rel=1e-7)
def _neo_hookean_bulk() -> Outcome:
    more = [np.trace(stress(N.replace(**change)) - stress(N)) for change in ({"Kv": 60e3}, {"volumetric": "K=2Kv"})]
    return more, [np.trace(stress(N))] * 2


@entry("Ogden.mu", "Ogden.alpha", "Ogden.K", rel=1e-6)
def _ogden() -> Outcome:
    """By the eigenvalues of B, J sigma = sum 2 mu/alpha dev(b^(alpha/2)) + K/2 (J^2 - 1)."""
    values, vectors = np.linalg.eigh(B * J ** (-2 / 3))
    terms = [
        2 * mu / a * deviator(vectors @ np.diag(values ** (a / 2)) @ vectors.T) for mu, a in ((7e3, 3.0), (2e3, -2.0))
    ]
    law = Ogden(mu=(7e3, 2e3), alpha=(3.0, -2.0), K=28e3, density=1060.0)
    return stress(law), (sum(terms) + 14e3 * (J**2 - 1) * np.eye(3)) / J


FIBRES = (ConstantDirection(vector=(1.0, 0.0, 0.0)),)


def pull(law: Any, **changes: Any) -> np.ndarray:
    """Return by how much a change moves the deviator of the stress; B a a B and the like are that of fibres along x."""
    return np.asarray(deviator(stress(law.replace(**changes)) - stress(law)))


A = J ** (-1 / 3) * F[:, 0]
I4 = float(A @ A)
AA = 2 / J * deviator(np.outer(A, A))


@entry("FibreLaw.K", "FibreLaw.fibres", "HolzapfelGasserOgden.c", "HolzapfelGasserOgden.k1", "HolzapfelGasserOgden.k2",
       "HolzapfelGasserOgden.kappa", rel=1e-6)  # fmt: skip
def _holzapfel_gasser_ogden() -> Outcome:
    law = HolzapfelGasserOgden(fibres=FIBRES, K=30e3, c=9e3, k1=7e3, k2=2.0, kappa=0.1, density=1060.0)
    strain = 0.1 * (I1 - 3) + 0.7 * (I4 - 1)
    fibre = 7e3 * strain * np.exp(2.0 * strain**2)
    exact = 4.5e3 * DEV_1 + fibre * (0.1 * DEV_1 + 0.7 * AA) + 15e3 * (J - 1 / J) * np.eye(3)
    return stress(law), exact


@entry("Direction.kind")
def _kinds_of_directions() -> Outcome:
    """Along z, by a constant and by the axis."""
    given = [{"kind": "constant", "vector": [0.0, 0.0, 3.0]}, {"kind": "around", "angle_deg": 90}]
    law = {"law": "holzapfel_gasser_ogden", "c_kPa": 9, "k1_kPa": 7, "k2": 2.3, "K_kPa": 80, "density_kg_m3": 1060}
    system = system_of(case_of(TUBE, **{"materials.wall": {**law, "fibres": given}}))
    model: Any = system.solids["wall"]
    found = [system.domain.value(one, TUBE.lumen_radius + 1e-3, 1e-4, 5e-3) for one in model.directions]
    return np.abs(np.array(found)) + 1, np.array([[1.0, 1.0, 2.0]] * 2)


@entry("HumphreyYin.c1", "HumphreyYin.c2", "HumphreyYin.c3", "HumphreyYin.c4", "HumphreyYin.c5", rel=1e-6)
def _humphrey_yin() -> Outcome:
    law = HumphreyYin(fibres=FIBRES, K=30e3, c1=8e3, c2=20e3, c3=3e3, c4=-4e3, c5=9e3, density=1060.0)
    fibre = I4**0.5 - 1
    along = (16e3 * fibre + 60e3 * fibre**2 - 4e3 * (I1 - 3)) / (2 * I4**0.5)
    return deviator(stress(law)), (3e3 - 4e3 * fibre + 18e3 * (I1 - 3)) * DEV_1 + along * AA


@entry("Blemker.G1", "Blemker.G2", "Blemker.P1", "Blemker.P2", "Blemker.peak_stress", "Blemker.straight_stretch",
       "Blemker.optimal_stretch", rel=1e-6)  # fmt: skip
def _blemker() -> Outcome:
    """Stress of the fibres by hand, below and beyond where they are straight; and that of shear is in proportion to the
    moduli."""
    law = Blemker(fibres=FIBRES, K=30e3, G1=5e3, G2=3e3, P1=0.0, P2=6.0, peak_stress=300e3, straight_stretch=1.05,
                  optimal_stretch=0.95, density=1060.0)  # fmt: skip
    x = I4**0.5 / 0.95
    assert x > 1.05
    grown, pulls = np.exp(6.0 * 0.05), []
    for end in (1.05, 2.0):
        curved = 0.04 * (np.exp(6.0 * (x - 1)) - 1)
        pulls.append(curved if end == 2.0 else 0.04 * (grown - 1) + 0.04 * 6.0 * grown * (x - 1.05))
    found = [pull(law.replace(straight_stretch=end), P1=0.04) for end in (1.05, 2.0)]
    shear = [deviator(stress(law.replace(G1=g1, G2=g2))) for g1, g2 in ((5e3, 3e3), (5e3, 6e3), (10e3, 6e3))]
    wanted = [300e3 * one / (0.95 * 2 * I4**0.5) * AA for one in pulls]
    return np.array([*found, shear[2]]), np.array([*wanted, 2 * shear[0]])


@entry("SolidLaw.viscosity", "SolidViscosity.moduli", "SolidViscosity.times", "SolidViscosity.kelvin_voigt", rel=1e-7)
def _solid_viscosity() -> Outcome:
    """A jump from rest within 2 s, which makes G tau/h (1 - e^(-h/tau)), and a rate of 3 1/s of the whole motion."""
    viscous: dict[str, Any] = {"moduli_kPa": [9, 5], "times_ms": [500, 4000], "kelvin_voigt_Pa_s": 70}
    table = {**SVK.to_toml_dict(), "viscosity": viscous}
    system = system_of(case_of(TUBE, **{"materials.tissue": table}))
    system.set_step(2.0)
    system.new_weight.Set(3.0)
    set_motion(system, ng.CF(tuple((F - np.eye(3)).ravel().tolist()), dims=(3, 3)) * position())
    found = np.array(system.cauchy_stress("tissue")(system.domain.mesh(10e-3, 1e-4, 5e-3))).reshape(3, 3)
    C, L = F.T @ F, F.T @ (3 * (F - np.eye(3)))
    rate = J ** (-2 / 3) * (L + L.T - 2 / 3 * np.trace(np.linalg.inv(C) @ L) * C)
    jump = 9e3 / 4 * (1 - np.exp(-4)) + 5e3 * 2 * (1 - np.exp(-0.5))
    Q = jump * (J ** (-2 / 3) * C - np.eye(3)) + 70 * rate
    return found - stress(SVK), J ** (-5 / 3) * deviator(F @ Q @ F.T)


@entry("SolidLaw.varying", "Variation.kind", "Variation.parameter", rel=1e-7)
def _varying() -> Outcome:
    """At half height of the tube, where the stress is looked at, the factor is in the middle of two."""
    table = {"kind": "by_height", "parameter": "young", "z_mm": [4, 6], "factors": [1.5, 2.5]}
    return stress(SVK.replace(varying=(table,))), 2 * stress(SVK)


@entry("LinearAtRest.young", rel=1e-7)
def _young() -> Outcome:
    return stress(SVK.replace(young=60e3)), 2 * stress(SVK)


@entry("LinearAtRest.poisson", rel=1e-7)
def _poisson() -> Outcome:
    strain = (F.T @ F - np.eye(3)) / 2
    lame, shear = 30e3 * 0.4 / (1.4 * 0.2), 30e3 / 2.8
    return stress(SVK.replace(poisson=0.4)), F @ (lame * np.trace(strain) * np.eye(3) + 2 * shear * strain) @ F.T / J


@entry("Law.law")
def _tag_of_a_law() -> Outcome:
    """A law by its tag in a file is the law of that name."""
    tags = registry.everything("ngfsi.solid_laws", "law")
    given = {"young_kPa": 30, "poisson": 0.3, "density_kg_m3": 1000}
    linear = [tag for tag, law in tags.items() if {"young", "poisson"} <= {*law.model_fields}]
    return [type(case_of(**{"materials.tissue": {"law": tag, **given}}).materials.tissue) for tag in linear], [
        tags[tag] for tag in linear
    ]


@entry("Law.label")
def _label() -> Outcome:
    case = case_of(**{"materials.tissue": {"set": "mooney_rivlin_s1", "label": "of a dancer"}})
    return terminal._solids(case), "of a dancer tissue"


def inertia(region: str, law: Any) -> np.ndarray:
    """Return the residual of an acceleration of a region alone, all else at rest."""
    system = system_of(case_of(TUBE, **{f"materials.{region}": law}))
    system.set_steady()
    before = system.apply().copy()
    system.new_weight.Set(10.0)
    rng = np.random.default_rng(1)
    part = system.unknowns.blocks["d"]
    values = np.zeros(system.unknowns.size)
    values[part] = rng.standard_normal(len(part))
    system.acceleration_history.vec.FV().NumPy()[:] = values
    return rows(system, "d", system.apply() - before)


@entry("SolidModel.density", "Law.density", rel=1e-7)
def _density() -> Outcome:
    light, heavy, none = (inertia("tissue", TISSUE.replace(density=d)) for d in (1000.0, 1500.0, 2000.0))
    return heavy - light, (none - light) / 2


@entry("Newtonian.viscosity", rel=1e-9)
def _viscosity() -> Outcome:
    """The same velocity, twice the shear."""
    means = []
    for factor in (1, 2):
        system = system_of(case_of(TUBE, **{"materials.fluid": BLOOD.replace(viscosity=factor * BLOOD.viscosity)}))
        system.named(system.state)[VELOCITY].Set(ng.CF((0, 0, 1 - (ng.x**2 + ng.y**2) / TUBE.lumen_radius**2)))
        probe = Probe(system)
        probe.refresh()
        means.append(row(probe)["sawss_Pa"])
    return means[1], 2 * means[0]


def viscosity(set_: str, **changes: float) -> float:
    """Return the viscosity (mPa s) of a case's blood at 2 1/s."""
    fluid = case_of(TUBE, **{"materials.fluid": load_set(set_, **changes)}).materials.fluid
    assert fluid is not None
    return 1e3 * float(fluid.viscosity_at(2.0))


@entry("Plateaus.viscosity_at_rest", "Plateaus.viscosity_at_high_shear", "CarreauYasuda.time_constant",
       "CarreauYasuda.a", "CarreauYasuda.n", rel=1e-6)  # fmt: skip
def _carreau_yasuda() -> Outcome:
    given: dict[str, float] = {
        "viscosity_at_rest": 40e-3, "viscosity_at_high_shear": 4e-3, "time_constant": 3.0, "a": 1.5, "n": 0.3
    }  # fmt: skip
    return viscosity("blood_carreau", **given), 4 + 36 * (1 + 6**1.5) ** (-0.7 / 1.5)


@entry("Cross.time_constant", "Cross.m", rel=1e-6)
def _cross() -> Outcome:
    given: dict[str, float] = {"viscosity_at_rest": 40e-3, "viscosity_at_high_shear": 4e-3, "time_constant": 3.0}
    return viscosity("blood_cross", **given, m=0.8), 4 + 36 / (1 + 6**0.8)


@entry("Casson.yield_stress", "Casson.viscosity_at_high_shear", "Yielding.regularisation", rel=1e-6)
def _casson() -> Outcome:
    found = viscosity("blood_casson", yield_stress=9e-3, viscosity_at_high_shear=4e-3, regularisation=1.5)
    return found, (2 + (9 / 2.5) ** 0.5) ** 2


@entry("Quemada.viscosity_of_plasma", "Quemada.haematocrit", "Quemada.k_rest", "Quemada.k_high_shear",
       "Quemada.critical_shear_rate", rel=1e-6)  # fmt: skip
def _quemada() -> Outcome:
    found = viscosity("blood_quemada", viscosity_of_plasma=1.3e-3, haematocrit=0.4, k_rest=4.0, k_high_shear=1.5,
                      critical_shear_rate=0.5, regularisation=1e-4)  # fmt: skip
    return found, 1.3 / (1 - 0.2 * (4 + 1.5 * 2) / 3) ** 2


@entry("Materials.tissue", "Materials.wall", rel=1e-7)
def _materials_of_a_vein() -> Outcome:
    return np.array([stress(SVK.replace(young=60e3), region) for region in ("tissue", "wall")]), np.array(
        [2 * stress(SVK)] * 2
    )


@entry("Materials.fluid")
def _material_of_the_blood() -> Outcome:
    return system_of(case_of(TUBE, **{"materials.fluid": BLOOD.replace(density=1100.0)})).blood.density, 1100.0


PARTS = ("fat", "anterior", "lateral", "superficial_posterior", "deep_posterior")


@entry(*(f"Materials.{part}" for part in PARTS))
def _materials_of_compartments() -> Outcome:
    """One with its own has that, one without that of the tissue."""
    own = TISSUE.replace(young=77e3)
    found = []
    for part in PARTS:
        materials = Materials(tissue=TISSUE, **{part: own})
        found += [materials.law_of(part), materials.law_of(next(other for other in PARTS if other != part))]
    return found, [own, TISSUE] * len(PARTS)


@entry("Materials.membranes", "Membrane.on", "Membrane.thickness", "Membrane.stretch", rel=1e-6)
def _membranes() -> Outcome:
    """The work of a membrane that is free of load but for its stretch s, when its boundary widens evenly: the force
    G t (s^2 - s^-4) on each length. Its material by default is that of its name."""
    law, s = CompressibleNeoHookean(young=30e3, poisson=0.3, density=0.0), 1.3
    membrane = Membrane(on="wall_outer", thickness=2e-3, material=law, stretch=s)
    system = system_of(case_of(TUBE, **{"materials.membranes": (membrane,)}))
    condition, space = system.conditions["membrane on wall_outer"], system.unknowns.space.components[0]
    form, motion = residual_form(space, condition.static_integrals(*space.TnT())), ng.GridFunction(space)
    motion.Set(ng.CF((ng.x, ng.y, 0)))
    force = motion.vec.CreateVector()
    form.Apply(ng.GridFunction(space).vec, force)
    usual = Membrane(on="fascia")
    found = [ng.InnerProduct(force, motion.vec), usual.thickness, usual.material.k1, Membrane(on="skin").material.young]
    force_on_length = law.shear_modulus * 2e-3 * (s**2 - s**-4)
    return found, [force_on_length * system.domain.area("wall_outer"), 0.924e-3, 1e7, 129e3]


@entry("Materials.solid", rel=1e-6)
def _material_of_a_beam() -> Outcome:
    """A shear of small strain: the stress is in proportion to Young's modulus."""
    found = []
    for young in (1e6, 2e6):
        law = SVK.replace(young=young)
        case = section_case(BEAM, Materials(solid=law))
        system = System(case, domain_of(BEAM))
        system.motion.Set(ng.CF((1e-3 * ng.y, 0)))
        found.append(system.cauchy_stress("solid")(system.domain.mesh(0.5, 0.2))[1])
    return found[1], 2 * found[0]


BEAM = Beam(mesh=CylinderMesh(far_size=0.1, cylinder_size=0.05, beam_size=0.05, corner_size=0.05))


@cache
def at_rest(*changes: tuple[str, Any]) -> tuple[System, dict[str, float]]:
    """Return a vein in its steady state, and what is measured there."""
    given = dict(changes)
    system, _ = steady(case_of(given.pop("geometry", BONED), **given))
    probe = Probe(system)
    probe.refresh()
    return system, row(probe)


def measured(column: str, **changes: Any) -> float:
    return at_rest(*((key.replace("__", "."), value) for key, value in changes.items()))[1][column]


@entry("Loads.skin_pressure")
def _skin_pressure() -> Outcome:
    return measured("skin_pressure_mean_Pa", loads__skin_pressure=curves.PressureConstant(value=700.0)), 700.0


@entry("Loads.inlet_flow", rel=1e-7)
def _inlet_flow() -> Outcome:
    return measured("flow_in_m3_s", loads__inlet_flow=curves.FlowConstant(value=1e-6)), 1e-6


@entry("Loads.inlet_pressure", rel=1e-2)
def _inlet_pressure() -> Outcome:
    given = curves.PressureConstant(value=1333.22 + 0.1)
    return measured("pressure_inlet_Pa", loads__inlet_pressure=given) - 1333.22, 0.1


@entry("Loads.outlet_pressure", "PressureOpening.pressure", rel=1e-3)
def _outlet_pressure() -> Outcome:
    given, table = curves.PressureConstant(value=1500.0), {"kind": "constant", "value_Pa": 1500.0}
    at_outlet = Openings(outlet={"kind": "pressure", "pressure": table})
    found = (
        measured("p_blood_z05_Pa", loads__outlet_pressure=given),
        measured("p_blood_z05_Pa", loads__openings=at_outlet),
    )
    return [pressure - measured("p_blood_z05_Pa") for pressure in found], [1500.0 - 1333.22] * 2


class Openings(dict[str, Any]):
    """Conditions at openings, to be looked up by."""

    def __hash__(self) -> int:  # type: ignore[override]
        return hash(repr(self))


@entry("Loads.openings", "OpeningModel.kind", "Resistive.resistance", "Resistive.distal_pressure", rel=1e-4)
def _resistance() -> Outcome:
    """p = p0 + R Q at the outlet."""
    outlet = {
        "kind": "resistance",
        "resistance_Pa_s_m3": 2e7,
        "distal_pressure": {"kind": "constant", "value_Pa": 900.0},
    }
    return measured("pressure_outlet_Pa", loads__openings=Openings(outlet=outlet)), 900.0 + 2e7 * 2.913e-6


@entry("Resistive.valve_leakage", rel=1e-3)
def _valve_leakage() -> Outcome:
    """Against the valve of the inlet the flow takes 1 / leakage of the resistance's pressure."""
    inlet = {"kind": "resistance", "resistance_Pa_s_m3": 1e7, "valve_leakage": 0.04,
             "distal_pressure": {"kind": "constant", "value_Pa": 1000.0}}  # fmt: skip
    back = {"kind": "flow", "flow": {"kind": "constant", "value_ml_s": -2.0}}
    found = measured("pressure_inlet_Pa", loads__openings=Openings(inlet=inlet, outlet=back))
    return found - 1000.0, 1e7 * 2e-6 / 0.04


@entry("WindkesselOpening.distal_resistance", "WindkesselOpening.compliance", rel=1e-4)
def _windkessel() -> Outcome:
    """In steady flow both resistances are one, in the first step of backward Euler after it the compliance takes part
    of what flows in beyond that: (p1 - p0) (C / h + 1 / Rd) = dQ."""
    outlet = Openings(outlet={"kind": "windkessel", "resistance_Pa_s_m3": 0.0, "distal_resistance_Pa_s_m3": 2e7,
                              "compliance_m3_Pa": 5e-9})  # fmt: skip
    steps = curves.FlowTable(times=(0.0, 0.1), values=(1e-6, 3e-6))
    system, newton = steady(case_of(TUBE, **{"loads.openings": outlet, "loads.inlet_flow": steps, "time.end": 0.1}))
    list(TimeLoop(system.case, system, newton).run())
    condition: Any = system.conditions["outlet"]
    flow = condition.outflow()
    return condition.given_pressure(), 20.0 + (flow - 1e-6) / (5e-9 / 0.1 + 1 / 2e7)


@entry("FlowOpening.flow", "FlowOpening.profile", rel=7e-2)
def _profiles_of_the_inflow() -> Outcome:
    """Velocity in the middle of the inlet over its mean: 2 if developed, 1 if flat but for the layer at the wall."""
    found = []
    layered = BONED.replace(mesh=BONED.mesh.replace(lumen_radii=(0.9,), element="mixed", vein_size=3e-3))
    for profile in ("developed", "flat"):
        flow = {"kind": "flow", "flow": {"kind": "constant", "value_ml_s": 2.0}, "profile": profile}
        system, values = at_rest(("geometry", layered), ("loads.openings", Openings(inlet=flow)))
        inside = system.named(system.state)[VELOCITY](system.domain.mesh(0, 0, 1e-9))[2]
        found += [values["flow_in_m3_s"], inside * system.domain.area("inlet")]
    # at the wall a flat profile falls to 0 within the last layer, here linearly from 0.9 of the radius on
    mean = 0.9**2 + 20 * ((1 / 2 - 1 / 3) - (0.9**2 / 2 - 0.9**3 / 3))
    return found, [2e-6, 4e-6, 2e-6, 2e-6 / mean]


@register("ngfsi.conditions", "test_settings_further")
class Further(ConditionModel):
    """What a plugin would add: here a pressure on the skin."""

    kind: Literal["test_settings_further"] = "test_settings_further"
    pressure: curves.PressureCurve

    def condition(self, domain: Domain, name: str) -> Condition:
        return PressureOn(name, domain, ("skin",), self.pressure)


@entry("Loads.further", "ConditionModel.kind")
def _further() -> Outcome:
    table = {"kind": "test_settings_further", "pressure": {"kind": "constant", "value_Pa": 300.0}}
    return measured("skin_pressure_mean_Pa", loads__further=(Further.from_dict(table),)), 300.0


@entry("BodyForceModel.acceleration", "BodyForceModel.regions", "BodyForceModel.over_time")
def _body_force() -> Outcome:
    """Its work along each axis, by the wall's mass alone, at a third of its rise."""
    force = {"kind": "body_force", "acceleration_m_s2": [1.0, -2.0, 3.0], "regions": ["wall"],
             "over_time": {"kind": "ramp", "final": 0.6, "duration_s": 0.3}}  # fmt: skip
    system = system_of(case_of(TUBE, **{"loads.further": (force,)}))
    works = []
    for time in (0.0, 0.1):
        system.update(time)
        along = ng.GridFunction(system.unknowns.space)
        residual = np.array(system.apply())
        works.append([])
        for axis in np.eye(3).tolist():
            along.components[0].Set(ng.CF(tuple(axis)))
            works[-1].append(float(residual @ along.vec.FV().NumPy()))
    mass = system.case.materials.wall.density * system.domain.volume("wall")
    return np.array(works[1]) - works[0], -0.2 * mass * np.array([1.0, -2.0, 3.0])


@entry("DisplacementModel.boundaries", "DisplacementModel.displacement",
       "DisplacementModel.over_time")  # fmt: skip
def _displacement() -> Outcome:
    """Means over the end that is moved, at a third of the rise."""
    moved = {"kind": "displacement", "boundaries": ["tissue_top"], "displacement_mm": [1.0, -2.0, 3.0],
             "over_time": {"kind": "ramp", "final": 0.6, "duration_s": 0.3}}  # fmt: skip
    system = system_of(case_of(TUBE, **{"loads.further": (moved,)}))
    system.update(0.1)
    system.prescribe()
    over, area = system.domain.ds("tissue_top"), system.domain.area("tissue_top")
    means = [float(ng.Integrate(part * over, system.domain.mesh)) / area for part in system.motion]
    return means, [0.2e-3, -0.4e-3, 0.6e-3]


@entry("StockingModel.tension", "StockingModel.heights", "StockingModel.over_time", rel=1e-3)
def _stocking() -> Outcome:
    """Its mean over the skin of a tube, the tension over the radius, at a third of the rise and two of its heights."""
    rise = {"kind": "ramp", "final": 0.6, "duration_s": 0.3}
    worn = {"kind": "stocking", "tension_N_m": [10.0, 40.0], "heights_mm": [-10.0, 20.0], "over_time": rise}
    system = system_of(case_of(TUBE, **{"loads.further": (worn,)}))
    system.update(0.1)
    return Probe(system).mean_skin_pressure(), 0.2 * 25.0 / TUBE.outer_radius


def cuff(**changes: Any) -> Callable[[float, float], float]:
    """Return the fraction of its pressure that a cuff exerts on the skin of a tube, by angle and z."""
    given = {"pressure": curves.PressureConstant(value=1.0), "start": 2e-3, "end": 8e-3, "edge": 1e-3} | changes
    weight, mesh = Cuff(**given).weight(), ng.Mesh(TUBE.netgen_mesh())
    radius = 0.7 * TUBE.outer_radius
    return lambda angle, z: float(weight(mesh(radius * cos(angle), radius * sin(angle), z)))


@entry("Loads.cuffs", "Cuff.pressure", rel=1e-3)
def _cuffs() -> Outcome:
    """Two of them everywhere add to what is on all of the skin."""
    wide = tuple(Cuff(pressure=curves.PressureConstant(value=v), start=-1.0, end=1.0) for v in (100.0, 50.0))
    return measured("skin_pressure_mean_Pa", loads__cuffs=wide), 150.0


@entry("Cuff.start", "Cuff.end", "Cuff.edge", rel=1e-6)
def _height_of_a_cuff() -> Outcome:
    here = cuff()
    quarter = 0.25**2 * (3 - 0.5)
    return [here(0.3, z) for z in (2e-3, 8e-3, 1.75e-3, 8.25e-3, 5e-3)], [0.5, 0.5, quarter, quarter, 1.0]


@entry("Cuff.direction", "Cuff.half_width", rel=1e-6)
def _side_of_a_cuff() -> Outcome:
    here = cuff(direction=0.6, half_width=0.9)
    return [here(0.6 + turn, 5e-3) for turn in (-0.9, 0.0, 0.9)], [0.5, 1.0, 0.5]


FINE = TUBE.mesh.replace(curving_order=4)


@entry("VeinSegment.aspect_ratio", "VeinSegment.oval_direction", "VeinSegment.lumen_area", "VeinSegment.lumen_axes",
       rel=1e-3)  # fmt: skip
def _oval() -> Outcome:
    """Second moments of an ellipse along its axes, a^2/4 and b^2/4."""
    a, b = 7e-3, 4e-3
    same: list[dict[str, Any]] = [{"lumen_area": pi * a * b, "aspect_ratio": a / b}, {"lumen_axes": (2 * a, 2 * b)}]
    found = []
    for size in same:
        domain = domain_of(TubeSegment(length=5e-3, oval_direction=0.6, mesh=FINE, **size))
        for q in (cos(0.6) * ng.x + sin(0.6) * ng.y, cos(0.6) * ng.y - sin(0.6) * ng.x):
            moment = ng.Integrate(q * q * domain.dx("fluid", bonus_intorder=4), domain.mesh)
            found.append(float(moment) / domain.volume("fluid"))
    return found, [a * a / 4, b * b / 4] * 2


@entry("Conditions.ends")
def _ends() -> Outcome:
    """Which directions of the tissue's end faces are held."""
    found = []
    for ends in ("roller", "clamped", "guided", "free"):
        unknowns = system_of(case_of(BONED, **{"conditions.ends": ends}))
        motion, free = unknowns.motion, unknowns.unknowns.free()
        assert motion is not None
        found.append(int(np.count_nonzero(free)))
    roller, clamped, guided, free_ends = found
    return [clamped < guided < roller < free_ends], [True]


@entry("Conditions.coupling")
def _coupling() -> Outcome:
    """One-way: the flow does not move the wall."""
    fast = curves.FlowConstant(value=30e-6)
    moved = [
        abs(
            measured("displacement_max_m", conditions__coupling=coupling, loads__inlet_flow=fast)
            / measured("displacement_max_m", conditions__coupling=coupling)
            - 1
        )
        for coupling in ("one_way", "two_way")
    ]
    return [moved[0] < 1e-9, moved[1] > 1e-5], [True, True]


@entry("Conditions.contact", "ContactModel.residual_gap", rel=1e-2)
def _contact() -> Outcome:
    """What resists, between sides at 5 % of their distance, a virtual motion towards each other: 10 kPa at a residual
    gap of 5 %; the 16th part if it is a half of that."""
    across, found = ng.CF((ng.x, 0, 0)), []
    for gap in (0.05, 0.025):
        system = system_of(case_of(TUBE, **{"conditions.contact": ContactModel(residual_gap=gap)}))
        set_motion(system, -0.95 * across)
        force, nearer = system.state.vec.CreateVector(), ng.GridFunction(system.unknowns.space)
        nearer.components[0].Set(-across)
        form = residual_form(system.unknowns.space, system.conditions["contact"].integrals(None))
        form.Apply(system.state.vec, force)
        found.append(float(ng.InnerProduct(force, nearer.vec)) / system.domain.volume("fluid"))
    return found, [10e3, 10e3 / 16]


@entry("Conditions.initial_state")
def _initial_state() -> Outcome:
    moved = [measured("displacement_max_m", conditions__initial_state=state) for state in ("preload", "prestress")]
    return [moved[0] > 1e-5, moved[1]], [True, 0.0]


SECTION = subject(1, mesh=SectionSizes(far_size=14e-3, bone_size=9e-3, vein_size=3e-3, curving_order=2))


def in_section(pressure: float, **conditions: Any) -> dict[str, float]:
    """Return what is measured of a section under a pressure on its skin."""
    materials = Materials(tissue=TISSUE, wall=SVK)
    system = equilibrium(
        section_case(SECTION, materials, skin=pressure, conditions=Conditions(**conditions)), domain_of(SECTION)
    )
    probe = Probe(system)
    probe.refresh()
    return row(probe)


@entry("Conditions.strain", rel=1e-6)
def _small_strain() -> Outcome:
    """The displacement is in proportion to the load, and at finite strain it is not."""
    moved = {p: in_section(p, strain="small")["displacement_max_m"] for p in (100.0, 4e3)}
    assert abs(in_section(4e3)["displacement_max_m"] / moved[4e3] - 1) > 1e-2
    return moved[4e3], 40 * moved[100.0]


@entry("Conditions.plane_stress")
def _plane_stress() -> Outcome:
    """Tissue that can get thicker gives way more."""
    moved = [
        in_section(500.0, plane_stress=regions)["displacement_max_m"]
        for regions in ((), ("tissue",), tuple(SECTION.solids))
    ]
    return moved == sorted(moved) and moved[1] > 1.05 * moved[0], True


@entry(
    "Conditions.skin_displacement", "OutlineDisplacement.x", "OutlineDisplacement.y", "OutlineDisplacement.ux",
    "OutlineDisplacement.uy", rel=1e-4,
)  # fmt: skip
def _skin_displacement() -> Outcome:
    """The skin is made smaller and moved: its area is known."""
    before = SECTION.skin.points
    moved = OutlineDisplacement.between(before, before * [0.97, 0.99] + [0.0, 1e-3])
    return in_section(0.0, skin_displacement=moved)["skin_area_m2"], 0.97 * 0.99 * SECTION.skin.area
