"""A cube of one solid whose whole surface is the skin: for laws, of which every homogeneous state is exact."""

from __future__ import annotations

from typing import Any, ClassVar

import ngsolve as ng
from ngsolve.meshes import MakeStructured3DMesh

from ngfsi.case import Case, Conditions, Discretisation, Loads, Materials, Solver, TimeStepping
from ngfsi.config.functions import PressureConstant
from ngfsi.config.model import ConfigModel
from ngfsi.mesh.domain import Domain
from ngfsi.registry import register

SIDE = 10e-3


@register("ngfsi.geometries", "test_block")
class Block(ConfigModel):
    """The cube, of eight hexahedra."""

    guarded: ClassVar[bool] = False
    solids: ClassVar[tuple[str, ...]] = ("solid",)
    vessels: ClassVar[tuple[Any, ...]] = ()
    boundary_names: ClassVar[tuple[str, ...]] = ("skin",)
    internal_names: ClassVar[tuple[str, ...]] = ()
    rigid_names: ClassVar[tuple[str, ...]] = ()
    curving_order: ClassVar[int] = 1
    size: ClassVar[float] = SIDE

    def mesh_attempts(self) -> tuple[str, ...]:
        """Return the one way to mesh."""
        return ("structured",)

    def netgen_mesh(self, attempt: int = 0) -> Any:  # noqa: ARG002 - there is one way
        """Return the mesh."""
        mesh = MakeStructured3DMesh(
            hexes=True, nx=2, ny=2, nz=2, mapping=lambda x, y, z: (SIDE * x, SIDE * y, SIDE * z)
        )
        for number in range(len(mesh.GetBoundaries())):
            mesh.ngmesh.SetBCName(number, "skin")
        mesh.ngmesh.SetMaterial(1, "solid")
        return mesh.ngmesh

    def shape_map(self) -> None:
        """Return no map."""

    def inflow(self) -> None:
        """Return nothing: there is no fluid."""

    def exact_volumes(self) -> dict[str, float]:
        """Return the volume [m3]."""
        return {"solid": SIDE**3}


def domain() -> Domain:
    """Return the cube's domain."""
    return Domain.build(Block(), cache=False)


def case_of(law: Any, pressure: float = 0.0, **changes: Any) -> Case:
    """Return the case of a cube of a law under a pressure (Pa)."""
    return Case(
        name="block",
        geometry=Block(),
        materials=Materials(solid=law),
        loads=Loads(skin_pressure=PressureConstant(value=pressure)),
        conditions=Conditions(ends="roller"),
        discretisation=Discretisation(order=2),
        time=TimeStepping(step=0.1, end=0.5),
        solver=Solver(tolerance=1e-11),
    ).replace(**changes)


def mean(field: Any, over: Domain) -> Any:
    """Return the mean of a field's components over the cube."""
    parts = [float(ng.Integrate(field[i] * over.dx("solid"), over.mesh)) for i in range(field.dim)]
    return [part / SIDE**3 for part in parts]
