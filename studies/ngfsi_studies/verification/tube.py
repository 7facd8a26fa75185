"""A vein in a tissue cylinder, solved with the coupled system, for benchmarks with radial symmetry."""

from __future__ import annotations

from typing import Any

import ngsolve as ng
import numpy as np
from ngfsi_geometry.segment import MeshSettings
from ngfsi_geometry.tube import TubeSegment

from ngfsi.case import Case, Discretisation, Loads, Materials, TimeStepping
from ngfsi.conditions import Condition
from ngfsi.config.functions import FlowConstant, PressureConstant
from ngfsi.linear.backends import choose_backend
from ngfsi.materials import Newtonian, SolidLaw
from ngfsi.mesh.domain import Domain
from ngfsi.physics.kinematics import Kinematics
from ngfsi.solve.initial import initial_state
from ngfsi.solve.newton import Newton
from ngfsi.system.system import System

BLOOD = Newtonian(density=1060.0, viscosity=3.5e-3)
PASSIVE = 1e-10
"""Flow (m3/s) per blood pressure (Pa) that presses on nothing: its own drop of pressure is 1e-6 of it."""


class ClampedTube(TubeSegment):
    """A sheath whose outer face is fixed."""

    @property
    def rigid_names(self) -> tuple[str, ...]:
        """Boundaries that are fixed in space."""
        return ("skin",)


def round_tube(radius: float, length: float, element: Any, h: float, order: int) -> TubeSegment:
    """Return a round lumen (m) in a wall and tissue that do not matter, with h times the sizes of a coarse mesh."""
    n = round(1 / h)
    mesh = MeshSettings(
        element=element, axial_layers=2 * n, far_size=20e-3, vein_size=2 * np.pi * radius / (8 * n),
        lumen_radii=_rings(n), curving_order=order,
    )  # fmt: skip
    return TubeSegment(length=length, lumen_diameter=2 * radius, wall_thickness=3e-3, outer_radius=14e-3, mesh=mesh)


def _rings(n: int) -> tuple[float, ...]:
    """Return 2 n - 1 even rings of elements in the lumen, fractions of its radius."""
    return tuple(i / (2 * n) for i in range(2 * n - 1, 0, -1))


def sheath(inner: float, thickness: float, length: float, h: float, order: int) -> ClampedTube:
    """Return a lumen in an elastic sheath (m), of two layers of elements, and h times the sizes of a coarse mesh."""
    n = round(1 / h)
    mesh = MeshSettings(
        element="mixed", axial_layers=1, far_size=thickness / 2, vein_size=2 * np.pi * inner / (8 * n),
        lumen_radii=_rings(n), wall_layers=1, curving_order=order,
    )  # fmt: skip
    return ClampedTube(
        length=length, lumen_diameter=2 * inner, wall_thickness=thickness / 2, outer_radius=inner + thickness, mesh=mesh
    )


def system(
    geometry: TubeSegment, law: SolidLaw, wall: SolidLaw, inside: float, outside: float, *conditions: Condition,
    **more: Any,
) -> System:  # fmt: skip
    """Return the system of a tube under pressures (Pa) inside and outside, with the order of its curving.

    Args:
        conditions: what acts beside.
        more: changes of the case.
    """
    case = Case(
        name="verification",
        geometry=geometry,
        materials=Materials(tissue=law, wall=wall, fluid=BLOOD),
        loads=Loads(
            skin_pressure=PressureConstant(value=outside),
            inlet_flow=FlowConstant(value=PASSIVE * inside),
            outlet_pressure=PressureConstant(value=inside),
        ),
        discretisation=Discretisation(order=geometry.curving_order),
        time=TimeStepping(step=0.1, end=0.1),
    ).replace(**more)
    return System(case, Domain.build(geometry), more=conditions)


def inner_radius_change(
    inner: float, wall_thickness: float, outer: float, laws: tuple[SolidLaw, SolidLaw], inside: float, outside: float,
    *, order: int, refinement: int, **more: Any,
) -> float:  # fmt: skip
    """Return the change (m) of the lumen's radius under pressures (Pa), from its volume, by the coupled system.

    Args:
        laws: of wall and of tissue.
        refinement: number of layers in the wall, twice as many in the tissue.
        more: changes of the case.
    """
    geometry = TubeSegment(
        length=2e-3,
        lumen_diameter=2 * inner,
        wall_thickness=wall_thickness,
        outer_radius=outer,
        mesh=MeshSettings(
            element="mixed",
            axial_layers=1,
            far_size=5e-3 / refinement,
            vein_size=4e-3 / refinement,
            wall_layers=refinement,
            lumen_radii=(),
            curving_order=order,
        ),
    )
    found = system(geometry, laws[1], laws[0], inside, outside, **more)
    initial_state(found, Newton(found, choose_backend("auto")))
    motion = Kinematics(found.fields().grad_motion)
    volume = ng.Integrate(motion.J * found.domain.dx("fluid", bonus_intorder=8), found.domain.mesh)
    return float(inner * (np.sqrt(volume / found.domain.volume("fluid")) - 1))


def relative_error(found: Any, exact: Any, domain: Domain, *regions: str, weight: Any = 1.0) -> float:
    """Return the L2 norm of the difference of two fields over that of the exact one, weighted by the mesh's J, say."""
    measure = domain.dx(*regions, bonus_intorder=6)
    squares = [
        ng.Integrate(weight * ng.InnerProduct(field, field) * measure, domain.mesh) for field in (found - exact, exact)
    ]
    return float(np.sqrt(squares[0] / squares[1]))
