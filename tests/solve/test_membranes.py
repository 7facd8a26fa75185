"""Thin stiff layers on boundaries: against Laplace's law, Lame's tissue in a thin ring, and at large strain."""

from __future__ import annotations

from typing import Any

import ngsolve as ng
import numpy as np
import pytest
from ngfsi_geometry.segment import FatLayer, MeshSettings
from ngfsi_geometry.tube import BareTube, TubeSegment
from ngfsi_studies.verification.radial import Layer, inner_displacement
from scipy.optimize import brentq

from ngfsi.case import Case, Discretisation, Loads, Materials, Solver, TimeStepping
from ngfsi.config.functions import PressureConstant
from ngfsi.errors import CaseError, MaterialError
from ngfsi.materials import CompressibleNeoHookean
from ngfsi.materials.membrane import Membrane
from ngfsi.materials.solid.directions import AlongHarmonic, InSurface
from ngfsi.materials.solid.holzapfel_gasser_ogden import HolzapfelGasserOgden
from ngfsi.measure.hole import Hole
from ngfsi.solve.statics import equilibrium
from ngfsi.system.forms import residual_form
from ngfsi.system.system import System
from tests.vein import domain_of

R, LENGTH = 5e-3, 5e-3
MESH = MeshSettings(element="mixed", axial_layers=1, vein_size=3e-3, curving_order=3)
TUBE = BareTube(hollow=True, length=LENGTH, lumen_diameter=2 * R, wall_thickness=1e-3, mesh=MESH)
TISSUE = CompressibleNeoHookean(young=30e3, poisson=0.3, density=1060.0)
NOTHING = CompressibleNeoHookean(young=1.0, poisson=0.0, density=1060.0)
G, T = 1e6, 0.1e-3
SHEET = CompressibleNeoHookean(young=2 * 1.49 * G, poisson=0.49, density=1100.0)


def case(geometry: Any, materials: Materials, pressure: float) -> Case:
    """Return the case of a pressure (Pa) in the hole, ends sliding in their planes."""
    return Case(
        name="membrane", geometry=geometry, materials=materials, discretisation=Discretisation(order=3),
        loads=Loads(outlet_pressure=PressureConstant(value=pressure)), time=TimeStepping(step=1.0, end=1.0),
        solver=Solver(tolerance=1e-8),
    )  # fmt: skip


def widened(geometry: Any, materials: Materials, pressure: float) -> float:
    """Return by how much (m) the hole is widened."""
    system = equilibrium(case(geometry, materials, pressure), domain_of(geometry))
    (hole,) = Hole.all_of(system).values()
    after = hole.volume()
    system.values[:] = 0.0
    return float((np.sqrt(after) - np.sqrt(hole.volume())) / np.sqrt(np.pi * LENGTH))


def test_laplace() -> None:
    """p = T / r with the force T = G t (l - 1/l^3) of an incompressible sheet at l around and 1 along, widened by a
    quarter; what bears it is a millionth as stiff."""
    stretch = 1.25
    pressure = G * T * (stretch - stretch**-3) / (stretch * R)
    materials = Materials(wall=NOTHING, membranes=(Membrane(on="interface", thickness=T, material=SHEET),))
    assert widened(TUBE, materials, pressure) == pytest.approx((stretch - 1) * R, rel=5e-4)


@pytest.mark.parametrize("stretch", [1.04, 0.98])
def test_bundles_of_a_fascia(stretch: float) -> None:
    """p = t W' / (l R) with the energy of two families at 50 degrees to the circumference, that bear tension alone."""
    c, k1, k2, angle = 1e5, 1e6, 50.0, np.radians(50)
    ways = tuple(InSurface(angle=sign * angle) for sign in (1.0, -1.0))
    law = HolzapfelGasserOgden(c=c, k1=k1, k2=k2, K=1e6, fibres=ways, density=1100.0)
    strain = np.cos(angle) ** 2 * (stretch**2 - 1)
    slope = c * (stretch - stretch**-3)
    if strain > 0:
        slope += 2 * k1 * strain * np.exp(k2 * strain**2) * 2 * np.cos(angle) ** 2 * stretch
    wall = TISSUE.replace(young=20e3)
    alone = brentq(lambda p: inner_displacement(R, [Layer(wall, 6e-3)], p) - (stretch - 1) * R, -1e3, 1e3, xtol=1e-4)
    ring = T * slope / (stretch * R)
    assert abs(ring) > abs(alone)
    materials = Materials(wall=wall, membranes=(Membrane(on="interface", thickness=T, material=law),))
    found = widened(TUBE, materials, alone + ring)
    assert found == pytest.approx((stretch - 1) * R, rel=1e-3)


FAT = TISSUE.replace(young=8e3, poisson=0.4)
LAYERED = TubeSegment(
    hollow=True, length=LENGTH, lumen_diameter=2 * R, outer_radius=16e-3, fat=FatLayer(thickness=6e-3),
    mesh=MeshSettings(element="mixed", axial_layers=1, vein_size=4e-3, far_size=6e-3, curving_order=3),
)  # fmt: skip


def test_fat_around_tissue() -> None:
    """At large strain against the radial equilibrium of three layers."""
    laws = {"wall": TISSUE.replace(young=100e3), "tissue": TISSUE, "fat": FAT}
    layers = [Layer(law, outer) for law, outer in zip(laws.values(), (6e-3, 10e-3, 16e-3), strict=True)]
    wanted = inner_displacement(R, layers, 6e3)
    assert wanted > 0.1 * R
    assert widened(LAYERED, Materials(**laws), 6e3) == pytest.approx(wanted, rel=1e-3)


def test_lame_in_two_rings() -> None:
    """Tissue, fascia, fat and taut skin at small strain: u = A r + B / r in each layer, whose radial stresses jump at a
    sheet of energy W(l) by t / R (W' + (W'' - W') u / R)."""
    pressure, stretch = 20.0, 1.0005
    sheets = {10e-3: (G, 0.05e-3, 1.0), 16e-3: (G / 10, 0.2e-3, stretch)}
    rows, right = [], []
    radii, laws = (R, 10e-3, 16e-3), (TISSUE, FAT)

    def stress(law: CompressibleNeoHookean, r: float) -> list[float]:
        """Of A and B, by Hooke's law in plane strain."""
        return [2 * (law.lame + law.shear_modulus), -2 * law.shear_modulus / r**2]

    rows.append([*stress(laws[0], radii[0]), 0, 0])
    right.append(-pressure)
    for k, r in enumerate(radii[1:]):
        modulus, thickness, s = sheets[r]
        slope, curvature = modulus * (s**2 - s**-4), modulus * (s**2 + 3 * s**-4)
        u = [0.0] * (2 * k) + [r, 1 / r] + [0.0] * (2 - 2 * k)
        inside = [0.0] * (2 * k) + stress(laws[k], r) + [0.0] * (2 - 2 * k)
        outside = [0.0, 0.0, *stress(laws[1], r)] if k == 0 else [0.0] * 4
        jump = thickness * (curvature - slope) / r**2
        rows.append([b - a - jump * one for a, b, one in zip(inside, outside, u, strict=True)])
        right.append(thickness * slope / r)
    rows.append([radii[1], 1 / radii[1], -radii[1], -1 / radii[1]])
    right.append(0.0)
    A, B, *_ = np.linalg.solve(rows, right)
    wanted = A * R + B / R
    membranes = [Membrane(on=name, thickness=t, stretch=s,
                          material=SHEET.replace(young=2 * 1.49 * modulus))
                 for name, (modulus, t, s) in zip(("fascia", "skin"), sheets.values(), strict=True)]  # fmt: skip
    materials = Materials(wall=TISSUE, tissue=TISSUE, fat=FAT, membranes=tuple(membranes))
    assert widened(LAYERED, materials, pressure) == pytest.approx(wanted, rel=2e-3)


def test_directions_in_a_surface() -> None:
    """Counter-clockwise around the axis on surfaces of either normal, turned towards the axis by the angle."""
    domain, angle = domain_of(LAYERED), 0.6
    around = ng.CF((-ng.y, ng.x, 0)) / ng.sqrt(ng.x**2 + ng.y**2)
    for on in ("interface", "fascia", "skin"):
        way = InSurface(angle=angle).field(domain, on)
        found = [ng.Integrate(part * domain.ds(on), domain.mesh) / domain.area(on) for part in (way * around, way[2])]
        assert found == pytest.approx([np.cos(angle), np.sin(angle)], rel=1e-4)
    with pytest.raises(MaterialError, match="for membranes: 'fat' is a region"):
        InSurface().field(domain, "fat")
    with pytest.raises(MaterialError, match="for regions: 'fascia' is a membrane"):
        AlongHarmonic(start="skin", end="fascia").field(domain, "fascia")


def test_energy_follows_the_path() -> None:
    """The work of the membrane's forces along a large motion is the change of its energy."""
    system = System(
        case(LAYERED, Materials(wall=TISSUE, tissue=TISSUE, fat=FAT, membranes=(OWN,)), 0.0), domain_of(LAYERED)
    )
    condition, space = system.conditions["membrane on fascia"], system.unknowns.space.components[0]
    form = residual_form(space, condition.static_integrals(*space.TnT()))
    end, now = ng.GridFunction(space), ng.GridFunction(space)
    # not linear: a bend and a twist beside a stretch
    end.Set(ng.CF((0.2 * ng.x + 20 * ng.z**2, -0.1 * ng.y + 30 * ng.x * ng.z, 0.1 * ng.z)))
    force, work = end.vec.CreateVector(), 0.0
    for t, w in zip(*np.polynomial.legendre.leggauss(8), strict=True):
        now.vec.data = (1 + t) / 2 * end.vec
        form.Apply(now.vec, force)
        work += w / 2 * ng.InnerProduct(force, end.vec)
    # of an incompressible neo-Hookean sheet, by the metric of the deformed surface
    F, n = ng.Id(3) + ng.Grad(end).Trace(), ng.specialcf.normal(3)
    area = ng.Norm(ng.Cof(F) * n)
    trace = ng.Trace(F.trans * F) - 1
    energy = OWN.material.shear_modulus / 2 * (trace + 1 / area**2 - 3) * OWN.thickness
    wanted = ng.Integrate(energy * system.domain.ds("fascia", bonus_intorder=6), system.domain.mesh)
    assert work == pytest.approx(wanted, rel=1e-5)


OWN = Membrane(on="fascia", thickness=T, material=SHEET)


def test_what_is_refused() -> None:
    """Unknown boundaries with those that there are, and what a membrane has not."""
    with pytest.raises(
        CaseError, match=r"'fashia' is not a known boundary.*known are fascia, interface, skin, wall_outer"
    ):
        widened(
            LAYERED,
            Materials(wall=TISSUE, tissue=TISSUE, membranes=(Membrane(on="fashia", thickness=T, material=SHEET),)),
            0.0,
        )
    with pytest.raises(MaterialError, match=r"thickness_mm.*usual ones are known of skin"):
        Membrane(on="tibia")
