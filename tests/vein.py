"""Small veins for the tests of physics, solver and measures: meshes of a few dozen elements, made in this process."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

import ngsolve as ng
import numpy as np
from ngfsi_geometry.plane import Ellipse
from ngfsi_geometry.segment import MeshSettings, VeinSegment
from ngfsi_geometry.tube import TubeSegment
from ngsolve import Parameter
from numpy.typing import NDArray

from ngfsi.case import Case, Conditions, Discretisation, Loads, Materials, TimeStepping
from ngfsi.conditions import WithValue
from ngfsi.config.functions import FlowConstant, PressureConstant
from ngfsi.linear.backends import choose_backend
from ngfsi.materials import CompressibleNeoHookean, Newtonian, load_set
from ngfsi.measure.probe import VesselProbe
from ngfsi.measure.sections import Sections
from ngfsi.mesh.centreline import find_centrelines
from ngfsi.mesh.domain import Domain
from ngfsi.mesh.generate import MeshReport, quiet
from ngfsi.registry import register
from ngfsi.solve.initial import initial_state
from ngfsi.solve.newton import Newton
from ngfsi.system.forms import residual_form
from ngfsi.system.system import System
from ngfsi.system.unknowns import BLOCKS
from tests.slopes import slope

Array = NDArray[np.float64]

BLOOD = Newtonian(density=1060.0, viscosity=3.5e-3)
TISSUE = CompressibleNeoHookean(young=30e3, poisson=0.3, density=1060.0)
WALL = load_set("vein_wall_source")

COARSE = MeshSettings(axial_layers=1, far_size=20e-3, vein_size=6e-3, lumen_radii=(), curving_order=2)
"""Ten triangles around the lumen and two rings of tissue: for identities that hold on any mesh."""


@register("ngfsi.geometries", "boned_tube")
class BonedTube(TubeSegment):
    """A tube with a bone beside the vein: held by it when its ends slide on rollers, and not symmetric."""

    length: float = 10e-3
    wall_thickness: float = 2e-3
    outer_radius: float = 16e-3
    mesh: MeshSettings = COARSE

    @property
    def bones(self) -> tuple[Ellipse, ...]:
        return (Ellipse("tibia", -12e-3, 0.0, 2.5e-3),)


TUBE = TubeSegment(length=10e-3, wall_thickness=2e-3, outer_radius=14e-3, mesh=COARSE)
BONED = BonedTube()


@cache
def domain_of(geometry: Any) -> Domain:
    """Mesh a geometry without the guarded process."""
    with quiet():
        return Domain(ng.Mesh(geometry.netgen_mesh()), geometry, MeshReport("direct", (), 0.0))


def case_of(geometry: VeinSegment = BONED, **changes: Any) -> Case:
    """Return a case with cheap materials and constant loads of the size of the calf's, with changes."""
    order = geometry.curving_order if geometry.curving_order >= 2 else 2
    case = Case(
        name="test",
        geometry=geometry,
        materials=Materials(tissue=TISSUE, wall=WALL, fluid=BLOOD),
        loads=Loads(
            skin_pressure=PressureConstant(value=0.0),
            inlet_flow=FlowConstant(value=2.913e-6),
            outlet_pressure=PressureConstant(value=1333.22),
        ),
        conditions=Conditions(),
        discretisation=Discretisation(order=order),
        time=TimeStepping(step=0.1, end=0.3),
    )
    return case.replace(**changes) if changes else case


def system_of(case: Case) -> System:
    """Return the system of a case."""
    return System(case, domain_of(case.geometry))


def steady(case: Case) -> tuple[System, Newton]:
    """Return the system in its steady state at t = 0, and its solver."""
    system = system_of(case)
    newton = Newton(system, choose_backend(case.solver.linear))
    initial_state(system, newton)
    return system, newton


def sections_of(system: System, positions: Array | None = None) -> Sections:
    """Return refreshed sections of the first vessel, at positions along it."""
    vessel = system.domain.vessels[0]
    sections = Sections(system, vessel, find_centrelines(system.domain, vessel)[0], positions)
    sections.refresh()
    return sections


def probe_of(system: System) -> VesselProbe:
    """Return refreshed measurements of the first vessel."""
    probe = VesselProbe(system, system.domain.vessels[0])
    probe.refresh()
    return probe


def block(system: System, name: str, vector: Array) -> Array:
    """Return the part of a vector of all unknowns that belongs to one of them."""
    return vector[system.unknowns.blocks[name]]


def rows(system: System, name: str, vector: Array) -> Array:
    """Return the part of a form's residual that belongs to the equations of one of the unknowns."""
    return vector[system.unknowns.equations][system.unknowns.blocks[name]]


def column_slope(system: System, name: str, step: float) -> tuple[Array, Array]:
    """Return the residual's derivative in a random direction of one of the unknowns: the system's, by differences."""
    part = system.unknowns.blocks[name]
    direction = np.zeros(system.unknowns.size)
    direction[part] = np.random.default_rng(2).standard_normal(len(part))
    return slope(system.form, system.tangent, system.state.vec, direction, step)


def position() -> ng.CoefficientFunction:
    """Point of the reference shape."""
    return ng.CF((ng.x, ng.y, ng.z))


def set_motion(system: System, motion: ng.CoefficientFunction) -> None:
    """Deform tissue and lumen by one displacement field of polynomial degree within the order."""
    system.motion.Set(motion)


def value_of(system: System, condition: str) -> Parameter:
    """Return the number that a condition acts with (SI), to read and to set."""
    found = system.conditions[condition]
    assert isinstance(found, WithValue)
    return found.value


def blood_form(system: System) -> ng.BilinearForm:
    """Return the residual of all that the blood does: its own, and the reference pressure that it puts on the wall."""
    reference = system.conditions["blood"].integrals(None)
    return residual_form(system.unknowns.space, [*system.blood_integrals(), *reference])


def randomise(system: System, seed: int = 1, amplitude: float = 4e-4) -> None:
    """Give state, rates and loads random values of a lively flow in a visibly deformed vein."""
    rng = np.random.default_rng(seed)
    scales = {"d": amplitude, "w": 0.1, "p": 1000.0, "e": amplitude}
    rate = 20.0
    system.new_weight.Set(rate)
    system.reference().Set(500.0)
    for condition, value in {"on the skin": 700.0, "outlet": 1300.0, "inlet": 3e-6}.items():
        if condition in system.conditions:
            value_of(system, condition).Set(value)
    for name in BLOCKS:
        part = system.unknowns.blocks[name]
        fixed = ~system.unknowns.free()[part]
        for vector, factor in (
            (system.state.vec, 1.0),
            (system.velocity_history.vec, rate),
            (system.acceleration_history.vec, rate**2 if name != "w" else rate),
        ):
            values = scales[name] * factor * rng.standard_normal(len(part))
            values[fixed] = 0.0
            vector.FV().NumPy()[part] = values
    system.prescribe()


@contextmanager
def deformed(system: System) -> Iterator[None]:
    """Let the mesh be the deformed shape."""
    mesh, displacement = system.domain.mesh, system.motion
    reference = mesh.deformation
    moved = ng.GridFunction(ng.VectorH1(mesh, order=system.unknowns.order))
    mesh.UnsetDeformation()
    moved.Set(reference + displacement)
    mesh.SetDeformation(moved)
    try:
        yield
    finally:
        mesh.SetDeformation(reference)
