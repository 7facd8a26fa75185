"""Channels: straight, between elastic walls, and around a cylinder with and without an elastic beam behind it.

Axes: x along the channel, y across it; all but the duct are plane, and 1 m deep. The dimensions of cylinder
and beam are those of Turek and Hron, "Proposal for numerical benchmarking of fluid-structure interaction ...", LNCSE 53
(2006).
"""

from __future__ import annotations

from abc import abstractmethod
from collections import defaultdict
from math import asin, hypot, pi, sqrt
from typing import Any, ClassVar

import numpy as np
from netgen.occ import Glue, MoveTo, OCCGeometry, X, Y
from pydantic import Field, model_validator

from ngfsi.config.model import ConfigModel
from ngfsi.errors import GeometryError, NgfsiError
from ngfsi.mesh.geometry import Vessel
from ngfsi.units import Length
from ngfsi_geometry.extrusion import extrude, layer_heights
from ngfsi_geometry.plane import Ellipse, Ring, SectionMesh, Side, counter_clockwise

ON_CIRCLE = 1e-6
"""Points this close (relative) to the cylinder's radius lie on it."""


class PlaneMesh(ConfigModel):
    """How finely a plane section is meshed."""

    refusal: ClassVar[type[NgfsiError]] = GeometryError

    far_size: Length = Field(60e-3, gt=0, description="element size, far from a cylinder if there is one")
    grading: float = Field(0.3, gt=0, le=1, description="how fast elements grow away from small ones")
    curving_order: int = Field(3, ge=1, le=8, description="polynomial order of the curved elements")


class CylinderMesh(PlaneMesh):
    """How finely a plane section with a cylinder is meshed."""

    cylinder_size: Length = Field(20e-3, gt=0, description="element size at the cylinder")
    beam_size: Length = Field(20e-3, gt=0, description="element size along the beam")
    corner_size: Length = Field(5e-3, gt=0, description="element size at the beam's corners, where stresses are large")


class PlaneSection(ConfigModel):
    """Base of the plane geometries; those with a fluid have one vessel, whose walls are elastic or rigid."""

    refusal: ClassVar[type[NgfsiError]] = GeometryError
    solids: ClassVar[tuple[str, ...]] = ()
    fluid: ClassVar[str | None] = "fluid"

    mesh: PlaneMesh = PlaneMesh()

    @property
    def curving_order(self) -> int:
        """Polynomial order of the curved mesh."""
        return self.mesh.curving_order

    @property
    @abstractmethod
    def size(self) -> float:
        """Length [m] against which displacements are judged."""

    @property
    def vessels(self) -> tuple[Vessel, ...]:
        """The channel."""
        if self.fluid is None:
            return ()
        solid = next(iter(self.solids), None)
        interface = "interface" if solid else "walls"
        return (Vessel(interface=interface, wall=solid, outer=None, radius=self.size),)

    @property
    def internal_names(self) -> tuple[str, ...]:
        """Boundaries inside a region: none."""
        return ()

    def shape_map(self) -> Any:
        """Return no map: the mesh has the reference shape."""
        return

    def mesh_attempts(self) -> tuple[str, ...]:
        """Return the one way to mesh."""
        return ("the given element sizes",)

    def _mesh(self, shape: Any) -> Any:
        """Return the straight Netgen mesh of a shape."""
        return OCCGeometry(shape, dim=2).GenerateMesh(maxh=self.mesh.far_size, grading=self.mesh.grading)


def strip(region: str, length: float, low: float, high: float, names: tuple[str, str, str]) -> Any:
    """Return a strip along x (m) with the names of its region and of its ends at x = 0 and x = length and its sides."""
    face = MoveTo(0, low).Rectangle(length, high - low).Face()
    face.edges.name, face.faces.name = names[2], region
    face.edges.Min(X).name, face.edges.Max(X).name = names[:2]
    return face


class StraightChannel(PlaneSection):
    """A channel between two rigid walls: boundaries inlet, outlet and walls; y is measured from its middle."""

    length: Length = Field(10e-3, gt=0, description="length of the channel")
    height: Length = Field(11.1e-3, gt=0, description="height of the channel")

    @property
    def size(self) -> float:
        """Half the height [m]."""
        return self.height / 2

    @property
    def rigid_names(self) -> tuple[str, ...]:
        """Boundaries that are fixed in space."""
        return ("walls",)

    @property
    def boundary_names(self) -> tuple[str, ...]:
        """Every boundary the mesh must have."""
        return *self.rigid_names, "inlet", "outlet"

    def inflow(self) -> Any:
        """Return the parabola of unit mean."""
        from ngsolve import CF, y

        return CF((1.5 * (1 - (2 * y / self.height) ** 2), 0))

    def exact_volumes(self) -> dict[str, float]:
        """Return the volume [m3] of each region."""
        return {"fluid": self.length * self.height}

    def netgen_mesh(self, attempt: int = 0) -> Any:  # noqa: ARG002 - there is one way
        """Return the straight Netgen mesh [m] with its geometry and names."""
        half = self.height / 2
        return self._mesh(strip("fluid", self.length, -half, half, ("inlet", "outlet", "walls")))


class ElasticChannel(StraightChannel):
    """A channel between two elastic walls whose outer faces are fixed: boundaries outer, interface and all ends."""

    solids: ClassVar[tuple[str, ...]] = ("solid",)

    wall_thickness: Length = Field(3e-3, gt=0, description="thickness of the walls")

    @property
    def rigid_names(self) -> tuple[str, ...]:
        """Boundaries that are fixed in space."""
        return ("outer",)

    @property
    def boundary_names(self) -> tuple[str, ...]:
        """Every boundary the mesh must have."""
        return *super().boundary_names, "interface", "wall_bottom", "wall_top"

    def exact_volumes(self) -> dict[str, float]:
        """Return the volume [m3] of each region."""
        return {**super().exact_volumes(), "solid": 2 * self.length * self.wall_thickness}

    def netgen_mesh(self, attempt: int = 0) -> Any:  # noqa: ARG002 - there is one way
        """Return the straight Netgen mesh [m] with its geometry and names."""
        inner, outer = self.height / 2, self.height / 2 + self.wall_thickness
        walls = [
            strip("solid", self.length, low, high, ("wall_bottom", "wall_top", "outer"))
            for low, high in ((-outer, -inner), (inner, outer))
        ]
        for wall, side in zip(walls, (Y, -Y), strict=True):
            wall.edges.Max(side).name = "interface"
        fluid = strip("fluid", self.length, -inner, inner, ("inlet", "outlet", "interface"))
        return self._mesh(Glue([fluid, *walls]))


class CylinderSection(PlaneSection):
    """Base of the sections with a rigid cylinder."""

    mesh: CylinderMesh = CylinderMesh()
    cylinder_x: Length = Field(0.2, description="distance of the cylinder's centre from the inlet")
    cylinder_y: Length = Field(0.2, description="distance of the cylinder's centre from the lower wall")
    cylinder_radius: Length = Field(0.05, gt=0, description="radius of the cylinder")

    @property
    def size(self) -> float:
        """Radius of the cylinder [m]."""
        return self.cylinder_radius

    def _cylinder(self) -> Any:
        return MoveTo(self.cylinder_x, self.cylinder_y).Circle(self.cylinder_radius).Face()

    def _mesh(self, shape: Any) -> Any:
        for edge in shape.edges:
            if self._on_cylinder(edge):
                edge.name, edge.maxh = "cylinder", self.mesh.cylinder_size
            elif edge.name == "interface":
                edge.maxh = self.mesh.beam_size
                for vertex in edge.vertices:
                    vertex.maxh = self.mesh.corner_size
        return super()._mesh(shape)

    def _on_cylinder(self, edge: Any) -> bool:
        """Whether all of an edge lies on the cylinder."""
        points = [edge.start, edge.end, edge.Value((edge.parameter_interval[0] + edge.parameter_interval[1]) / 2)]
        distances = [hypot(p.x - self.cylinder_x, p.y - self.cylinder_y) for p in points]
        return all(abs(d - self.cylinder_radius) < ON_CIRCLE * self.cylinder_radius for d in distances)


class CylinderInChannel(CylinderSection):
    """A channel with a cylinder: boundaries inlet, outlet, walls and cylinder."""

    length: Length = Field(2.2, gt=0, description="length of the channel; that of Schaefer and Turek (1996)")
    height: Length = Field(0.41, gt=0, description="height of the channel")

    @model_validator(mode="after")
    def _check_position(self) -> CylinderInChannel:
        """Refuse a cylinder that is not inside of the channel."""
        r = self.cylinder_radius
        if not (r < self.cylinder_x < self.length - r and r < self.cylinder_y < self.height - r):
            raise ValueError(
                f"a cylinder of radius {r:g} m at ({self.cylinder_x:g}, {self.cylinder_y:g}) m is not inside of a "
                f"channel of {self.length:g} m by {self.height:g} m"
            )
        return self

    @property
    def rigid_names(self) -> tuple[str, ...]:
        """Boundaries that are fixed in space."""
        return "cylinder", "walls"

    @property
    def boundary_names(self) -> tuple[str, ...]:
        """Every boundary the mesh must have, the curved one first."""
        return "cylinder", "walls", "inlet", "outlet"

    def inflow(self) -> Any:
        """Return the parabola of unit mean."""
        from ngsolve import CF, y

        return CF((6 * y * (self.height - y) / self.height**2, 0))

    def exact_volumes(self) -> dict[str, float]:
        """Return the volume [m3] of each region."""
        return {"fluid": self.length * self.height - pi * self.cylinder_radius**2}

    def netgen_mesh(self, attempt: int = 0) -> Any:  # noqa: ARG002 - there is one way
        """Return the straight Netgen mesh [m] with its geometry and names."""
        return self._mesh(self._channel() - self._cylinder())

    def _channel(self) -> Any:
        return strip("fluid", self.length, 0.0, self.height, ("inlet", "outlet", "walls"))


class CylinderInDuct(CylinderInChannel):
    """A channel as deep as high, between four walls, crossed by a cylinder; z is the depth.

    Of prisms: in tetrahedra with three faces on walls, as they occur in corners, the pressure is undetermined.
    """

    layers: int = Field(6, ge=1, description="number of element layers along the cylinder")
    end_refinement: float = Field(3.0, ge=1, le=20, description="how much thinner they are at the walls than between")

    length: Length = Field(2.5, gt=0, description="length of the duct; that of Schaefer and Turek (1996)")
    cylinder_x: Length = Field(0.5, description="distance of the cylinder's axis from the inlet")

    def inflow(self) -> Any:
        """Return the product of two parabolas, of unit mean."""
        from ngsolve import CF, z

        across = super().inflow()[0]
        return CF((across * 6 * z * (self.height - z) / self.height**2, 0, 0))

    def exact_volumes(self) -> dict[str, float]:
        """Return the volume [m3] of each region."""
        return {name: self.height * area for name, area in super().exact_volumes().items()}

    def netgen_mesh(self, attempt: int = 0) -> Any:
        """Return the straight Netgen mesh [m] with its geometry and names."""
        plane = super().netgen_mesh(attempt)
        points = np.array([point.p[:2] for point in plane.Points()])
        triangles = np.array([[v.nr - 1 for v in t.vertices] for t in plane.Elements2D()], dtype=np.int32)
        parts = defaultdict(list)
        for edge in plane.Elements1D():
            begin, end = (v.nr - 1 for v in edge.vertices)
            name = plane.GetBCName(edge.index - 1)
            parts[name if name == "cylinder" else (name, edge.index)].append((begin, end))
        circle = Ellipse("cylinder", self.cylinder_x, self.cylinder_y, self.cylinder_radius)
        around = np.unique(parts.pop("cylinder")).astype(np.int32)
        ring = Ring(circle, around[np.argsort(circle.angles(points[around]))], None, "fluid")
        sides = [Side(name, np.array(edges, dtype=np.int32)) for (name, _), edges in parts.items()]
        cells = [("fluid", counter_clockwise(points, triangles))]
        section = SectionMesh(points, cells, [ring], sides)
        heights = layer_heights(self.height, self.layers, self.end_refinement)
        return extrude(section, heights, {"fluid": ("walls", "walls")}, split=False)


class Beam(CylinderSection):
    """A beam clamped to the back of a cylinder, without a fluid: its surface is the boundary `interface`."""

    solids: ClassVar[tuple[str, ...]] = ("solid",)
    fluid: ClassVar[str | None] = None

    beam_length: Length = Field(0.35, gt=0, description="length of the beam from the cylinder's back")
    beam_thickness: Length = Field(0.02, gt=0, description="thickness of the beam")

    @model_validator(mode="after")
    def _check_thickness(self) -> Beam:
        """Refuse a beam that does not fit the cylinder."""
        if self.beam_thickness >= 2 * self.cylinder_radius:
            raise ValueError(
                f"a beam of {self.beam_thickness:g} m cannot be clamped to a cylinder of radius "
                f"{self.cylinder_radius:g} m: it must be thinner than the cylinder"
            )
        return self

    @property
    def tip(self) -> tuple[float, float]:
        """Middle of the beam's end [m], the point A of the benchmark."""
        return self.cylinder_x + self.cylinder_radius + self.beam_length, self.cylinder_y

    @property
    def rigid_names(self) -> tuple[str, ...]:
        """Boundaries that are fixed in space."""
        return ("cylinder",)

    @property
    def boundary_names(self) -> tuple[str, ...]:
        """Every boundary the mesh must have, the curved one first."""
        return "cylinder", "interface"

    def exact_volumes(self) -> dict[str, float]:
        """Return the volume [m3] of each region."""
        r, half = self.cylinder_radius, self.beam_thickness / 2
        hidden = half * sqrt(r**2 - half**2) + r**2 * asin(half / r)
        return {"solid": self.beam_thickness * (r + self.beam_length) - hidden}

    def netgen_mesh(self, attempt: int = 0) -> Any:  # noqa: ARG002 - there is one way
        """Return the straight Netgen mesh [m] with its geometry and names."""
        return self._mesh(self._beam())

    def inflow(self) -> Any:
        """Return nothing: there is no fluid."""
        return

    def _beam(self) -> Any:
        reach = self.cylinder_radius + self.beam_length
        corner = MoveTo(self.cylinder_x, self.cylinder_y - self.beam_thickness / 2)
        face = corner.Rectangle(reach, self.beam_thickness).Face() - self._cylinder()
        face.edges.name, face.faces.name = "interface", "solid"
        return face


class BeamInChannel(CylinderInChannel, Beam):
    """A channel with a beam clamped to the back of the cylinder: Turek and Hron's."""

    fluid: ClassVar[str | None] = "fluid"

    length: Length = Field(2.5, gt=0, description="length of the channel")

    @model_validator(mode="after")
    def _check_tip(self) -> BeamInChannel:
        """Refuse a beam that reaches out of the channel."""
        if self.tip[0] >= self.length:
            raise ValueError(f"the beam ends at x = {self.tip[0]:g} m, outside of a channel of {self.length:g} m")
        return self

    @property
    def boundary_names(self) -> tuple[str, ...]:
        """Every boundary the mesh must have, the curved one first."""
        return *super().boundary_names, "interface"

    def exact_volumes(self) -> dict[str, float]:
        """Return the volume [m3] of each region."""
        solid, channel = Beam.exact_volumes(self)["solid"], CylinderInChannel.exact_volumes(self)["fluid"]
        return {"solid": solid, "fluid": channel - solid}

    def netgen_mesh(self, attempt: int = 0) -> Any:  # noqa: ARG002 - there is one way
        """Return the straight Netgen mesh [m] with its geometry and names."""
        beam = self._beam()
        return self._mesh(Glue([self._channel() - self._cylinder() - beam, beam]))
