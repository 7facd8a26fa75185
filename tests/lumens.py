"""Lumens of tetrahedra in any direction, for the tests of centrelines and sections: meshes made in this process."""

from __future__ import annotations

from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from netgen import occ
from ngsolve import CF
from numpy.typing import NDArray

from ngfsi.config.model import ConfigModel
from ngfsi.errors import GeometryError
from ngfsi.mesh.geometry import Point, Vessel

Array = NDArray[np.float64]


class Lumen(ConfigModel):
    """A lumen with a rigid wall, as a geometry.

    Attributes:
        radius: of the inlet, m.
        largest: size of the elements, m.
    """

    refusal: ClassVar[type[GeometryError]] = GeometryError
    curving_order: ClassVar[int] = 3
    solids: ClassVar[tuple[str, ...]] = ()
    fluid: ClassVar[str] = "fluid"
    internal_names: ClassVar[tuple[str, ...]] = ()
    rigid_names: ClassVar[tuple[str, ...]] = ("interface",)

    radius: float
    largest: float

    @property
    def ends(self) -> dict[str, Point]:
        """Centre of each opening, the inlet first."""
        raise NotImplementedError

    def solid(self) -> Any:
        """Return the body."""
        raise NotImplementedError

    @property
    def vessels(self) -> tuple[Vessel, ...]:
        inlets = tuple(name for name in self.ends if name.startswith("inlet"))
        outlets = tuple(name for name in self.ends if name not in inlets)
        return (Vessel(wall=None, outer=None, inlets=inlets, outlets=outlets, radius=self.radius),)

    @property
    def boundary_names(self) -> tuple[str, ...]:
        return "interface", *self.ends

    @property
    def size(self) -> float:
        return self.radius

    @cached_property
    def body(self) -> Any:
        """The body with names: faces with their centres at an opening have its."""
        body = self.solid()
        body.mat("fluid")
        for face in body.faces:
            middle = np.array([face.center.x, face.center.y, face.center.z])
            names = [name for name, at in self.ends.items() if np.linalg.norm(middle - at) < 1e-2 * self.radius]
            face.name = names[0] if names else "interface"
        return body

    def mesh_attempts(self) -> tuple[str, ...]:
        return ("one size",)

    def netgen_mesh(self, attempt: int = 0) -> Any:  # noqa: ARG002
        return occ.OCCGeometry(self.body).GenerateMesh(maxh=self.largest)

    def inflow(self) -> Any:
        return CF((0, 0, 1))

    def shape_map(self) -> None:
        return None

    def exact_volumes(self) -> dict[str, float]:
        return {"fluid": self.body.mass}


class BentLumen(Lumen):
    """A part of a torus in the plane of x and z, whose axis leaves the origin along z towards negative x.

    Attributes:
        bend: radius of the axis, m.
        angle: of the part.
    """

    bend: float
    angle: float

    @property
    def ends(self) -> dict[str, Point]:
        return {"inlet": (0.0, 0.0, 0.0), "outlet": tuple(arc(self.bend, np.array([self.angle]))[0])}

    def solid(self) -> Any:
        disc = occ.Face(occ.Wire([occ.Circle(occ.Pnt(0, 0, 0), occ.Z, self.radius)]))
        return disc.Revolve(occ.Axis(occ.Pnt(-self.bend, 0, 0), -occ.Y), float(np.degrees(self.angle)))


class Tubes(Lumen):
    """A straight tube from the inlet to a fork, and from there one to each outlet, or further inlet.

    Attributes:
        inlet, fork: m
        outlets: name, place and radius of each, m.
    """

    inlet: Point
    fork: Point
    outlets: tuple[tuple[str, Point, float], ...]

    @property
    def ends(self) -> dict[str, Point]:
        return {"inlet": self.inlet, **{name: end for name, end, _ in self.outlets}}

    def solid(self) -> Any:
        body = _tube(self.inlet, self.fork, self.radius)
        for _, end, radius in self.outlets:
            body = body + _tube(self.fork, end, radius)
        return body


def _tube(start: Any, end: Any, radius: float) -> Any:
    way = np.subtract(end, start)
    length = float(np.linalg.norm(way))
    return occ.Cylinder(occ.Pnt(*start), occ.Vec(*(way / length)), radius, length)


def arc(bend: float, angle: Array) -> Array:
    """Return the points (n, 3) of the axis of a bent tube."""
    return np.stack([bend * (np.cos(angle) - 1), 0 * angle, bend * np.sin(angle)], axis=1)
