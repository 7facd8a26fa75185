"""The coupled system in the plane: the same terms with two components, plane strain, and solids without a fluid."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import ngsolve as ng
import numpy as np
import pytest
from ngfsi_geometry.channel import Beam, BeamInChannel, CylinderInChannel, CylinderMesh
from ngfsi_geometry.segment import MeshSettings
from ngfsi_geometry.tube import BareTube
from ngfsi_studies.verification.plane import case_of

from ngfsi.case import Case, Discretisation, Loads, Materials, TimeStepping
from ngfsi.conditions import Ends, GivenVelocity
from ngfsi.config.functions import FlowConstant, PressureConstant
from ngfsi.errors import CaseError, GeometryError, RegionError
from ngfsi.materials import CompressibleNeoHookean, Newtonian
from ngfsi.run import run
from ngfsi.system.system import System
from ngfsi.system.unknowns import Unknowns
from tests.vein import column_slope, domain_of, randomise, rows

BEAM = CompressibleNeoHookean(young=30e3, poisson=0.3, density=1060.0)
FLUID = Newtonian(density=1060.0, viscosity=3.5e-3)
COARSE = CylinderMesh(far_size=0.4, cylinder_size=0.1, beam_size=0.2, corner_size=0.02, curving_order=2, grading=0.9)


def case_with(geometry: Any, **more: Any) -> Case:
    """Return a case with whatever the geometry has."""
    materials = Materials(solid=BEAM if geometry.solids else None, fluid=FLUID if geometry.vessels else None)
    return case_of(geometry, 0.1, materials, **more)


@pytest.fixture(scope="module", params=["harmonic", "elastic"])
def lively(request: pytest.FixtureRequest) -> System:
    """A random state."""
    geometry = BeamInChannel(mesh=COARSE)
    system = System(case_with(geometry, **{"discretisation.mesh_motion": request.param}), domain_of(geometry))
    randomise(system)
    return system


@pytest.mark.parametrize(("column", "step"), [("d", 1e-6), ("w", 1e-5), ("p", 10.0), ("e", 1e-6)])
def test_jacobian_by_differences(lively: System, column: str, step: float) -> None:
    exact, measured = column_slope(lively, column, step)
    for row in lively.unknowns.blocks:
        a, b = rows(lively, row, exact), rows(lively, row, measured)
        assert np.linalg.norm(a - b) <= 1e-7 * np.linalg.norm(a), (row, column)


def test_what_is_held() -> None:
    """Rigid boundaries hold mesh and fluid, clamped ends the mesh; the interface holds the relative velocity alone."""
    geometry = BeamInChannel(mesh=COARSE)
    domain = domain_of(geometry)
    given = GivenVelocity("inlet", lambda _: ng.CF((1, 0)))
    unknowns = Unknowns.build(domain, 2, [Ends(domain, "clamped"), given])
    field = ng.GridFunction(unknowns.space)
    field.vec.FV().NumPy()[:] = np.where(unknowns.free(), np.random.default_rng(0).standard_normal(unknowns.size), 0.0)
    m, w, _ = field.components

    def moves(part: Any, *names: str) -> bool:
        return bool(ng.Integrate(part * part * domain.ds(*names), domain.mesh) > 1e-20 * domain.area(*names))

    assert [moves(m, name) for name in geometry.boundary_names] == [False, False, False, False, True]
    assert [moves(w, name) for name in geometry.boundary_names] == [False, False, False, True, False]


def test_solids_alone() -> None:
    geometry = Beam(mesh=COARSE)
    system = System(case_with(geometry), domain_of(geometry))
    assert system.unknowns.size == len(system.unknowns.blocks["d"]) == system.unknowns.space.ndof
    assert system.block_scales() == {"d": geometry.cylinder_radius}
    randomise_solid = np.random.default_rng(3).standard_normal(system.unknowns.size)
    system.values[:] = 1e-4 * randomise_solid
    assert np.linalg.norm(system.residual().FV().NumPy()) > 0


def test_plane_strain_is_a_slab_that_cannot_get_thicker() -> None:
    """The same displacement in a cube whose third component vanishes has the same energy and nodal forces' work."""
    from ngsolve.meshes import MakeStructured2DMesh, MakeStructured3DMesh

    from ngfsi.physics import terms
    from ngfsi.physics.kinematics import Kinematics

    works = []
    for mesh, parts in ((MakeStructured2DMesh(nx=2, ny=2), 2), (MakeStructured3DMesh(nx=2, ny=2, nz=1), 3)):
        space = ng.VectorH1(mesh, order=2)
        d, v = ng.GridFunction(space), ng.GridFunction(space)
        d.Set(ng.CF((0.2 * ng.x * ng.y, 0.1 * ng.x**2 - 0.1 * ng.y, 0)[:parts]))
        v.Set(ng.CF((ng.y**2, ng.x * ng.y, 0)[:parts]))
        F = Kinematics(ng.Grad(d)).F
        integrands = (
            terms.internal_work(BEAM, F, ng.Grad(v)),
            terms.stored_energy(BEAM, F),
            terms.hydrostatic_pressure(BEAM, F),
        )
        works.append([ng.Integrate(integrand, mesh, order=12) for integrand in integrands])
    assert works[0] == pytest.approx(works[1], rel=1e-9)
    assert min(abs(np.array(works[0]))) > 10.0


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: BeamInChannel(beam_length=3.0), "the beam ends at x = 3.25 m, outside of a channel of 2.5 m"),
        (lambda: Beam(beam_thickness=0.2), "a beam of 0.2 m cannot be clamped to a cylinder of radius 0.05 m"),
        (lambda: CylinderInChannel(cylinder_y=0.4), "a cylinder of radius 0.05 m at \\(0.2, 0.4\\) m is not inside"),
    ],
)
def test_refused_dimensions(make: Any, sentence: str) -> None:
    with pytest.raises(GeometryError, match=sentence):
        make()


def test_points() -> None:
    domain = domain_of(CylinderInChannel(mesh=COARSE))
    place = ng.CF((ng.x, ng.y))
    for point in ((1.3, 0.3), (0.1499, 0.2), (0.2 + 0.0501 * np.cos(1), 0.2 + 0.0501 * np.sin(1))):
        assert domain.value(place, *point) == pytest.approx(point, rel=1e-12)
    with pytest.raises(RegionError, match=r"the point \(0.2, 0.2\) m is not inside of CylinderInChannel"):
        domain.value(place, 0.2, 0.2)


def test_volumes_and_names() -> None:
    for geometry in (CylinderInChannel(), Beam(), BeamInChannel()):
        statistics = domain_of(geometry).statistics()
        assert max(map(abs, statistics["relative_volume_errors"].values())) < 2e-6
        assert statistics["smallest_jacobian_ratio"] > 0.5


def test_a_run_of_lumen_and_wall(tmp_path: Path) -> None:
    """Lame's widening u = (1 + nu) a ((1 - 2 nu) a^2 + b^2) p / (E (b^2 - a^2)) between rollers."""
    geometry = BareTube(mesh=MeshSettings(element="mixed", axial_layers=1, curving_order=3))
    wall, pressure = CompressibleNeoHookean(young=1e5, poisson=0.3, density=0.0), 5.0
    case = Case(
        name="tube",
        geometry=geometry,
        materials=Materials(wall=wall, fluid=FLUID),
        loads=Loads(inlet_flow=FlowConstant(value=0.0), outlet_pressure=PressureConstant(value=pressure)),
        discretisation=Discretisation(order=3),
        time=TimeStepping(step=1.0, end=1.0),
    )
    series = run(case, tmp_path / "run", quiet=True).series
    a = geometry.lumen_radius
    b = a + geometry.wall_thickness
    widening = 1.3 * a * (0.4 * a**2 + b**2) * pressure / (1e5 * (b**2 - a**2))
    unloaded = np.sqrt(domain_of(geometry).volume("fluid") / geometry.length / np.pi)
    assert np.sqrt(series["area_z05_m2"] / np.pi) - unloaded == pytest.approx(np.full(2, widening), rel=5e-3)
    assert not any("tissue" in column or "transmural" in column for column in series)


def test_a_tube_without_tissue() -> None:
    geometry = BareTube(mesh=MeshSettings(element="mixed", curving_order=3))
    domain = domain_of(geometry)
    wall = np.pi * ((geometry.lumen_radius + geometry.wall_thickness) ** 2 - geometry.lumen_radius**2)
    assert domain.volume("wall") == pytest.approx(wall * geometry.length, rel=2e-4)
    assert domain.area("skin") == pytest.approx(2 * np.pi * geometry.skin_radius * geometry.length, rel=2e-4)
    assert domain.regions == ("wall", "fluid")


def test_rollers_need_space() -> None:
    with pytest.raises(CaseError, match=r"conditions\.ends = 'roller' is for segments in 3-D"):
        Ends(domain_of(BeamInChannel(mesh=COARSE)), "roller")
