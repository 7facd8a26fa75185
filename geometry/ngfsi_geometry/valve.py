"""A vein with a rigid wall around a valve that is held open: two leaflets, and the sinus behind them.

Each leaflet is a flat sheet from the wall, where the sinus begins, to its free edge. Where it cuts the wall its
attachment has the shape of a U, as that of a cusp; between leaflet and wall is the pocket, open downstream.
"""

from __future__ import annotations

from itertools import pairwise
from math import pi
from typing import Any, ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from ngfsi.config.model import ConfigModel
from ngfsi.errors import GeometryError, NgfsiError
from ngfsi.mesh.geometry import Vessel
from ngfsi.units import Length

PROFILE_POINTS = 25
"""Of the spline along the sinus."""


class ValvePocket(ConfigModel):
    """Region fluid, boundaries interface (wall and leaflets), inlet and outlet; z downstream, leaflets at +y and -y.

    By default the proportions of valves of deep leg veins: a free passage between the leaflets of about two thirds of
    the vein (F. Lurie et al., J Vasc Surg 38, 2003, 955), leaflets as long as the vein is wide.
    """

    refusal: ClassVar[type[NgfsiError]] = GeometryError
    solids: ClassVar[tuple[str, ...]] = ()
    fluid: ClassVar[str] = "fluid"
    internal_names: ClassVar[tuple[str, ...]] = ()
    rigid_names: ClassVar[tuple[str, ...]] = ("interface",)
    boundary_names: ClassVar[tuple[str, ...]] = ("interface", "inlet", "outlet")

    radius: Length = Field(4e-3, gt=0, description="of the vein, away from the valve")
    leaflet_length: Length = Field(8e-3, gt=0, description="along the vein, from the wall to the free edge")
    opening: Length = Field(4.4e-3, gt=0, description="distance between the free edges")
    thickness: Length = Field(0.5e-3, gt=0, description="of the leaflets")
    sinus_length: Length = Field(15e-3, gt=0, description="along the vein, from where the leaflets begin")
    bulge: float = Field(0.35, ge=0, le=1, description="by how much the sinus is wider than the vein, over its radius")
    upstream: Length = Field(10e-3, gt=0, description="length of the vein before the valve")
    downstream: Length = Field(20e-3, gt=0, description="length of the vein behind the sinus")
    element_size: Length = Field(2.5e-3, gt=0, description="of the largest elements")
    leaflet_size: Length = Field(1.6e-3, gt=0, description="of the elements at leaflets and sinus")
    curving_order: int = Field(2, ge=1, le=6, description="polynomial order of the curved elements")

    @model_validator(mode="after")
    def _leaflets_fit(self) -> Self:
        if self.opening + 2 * self.thickness >= 2 * self.radius:
            raise ValueError("opening must leave room for two leaflets: less than the diameter less both thicknesses")
        if self.leaflet_length >= self.sinus_length:
            raise ValueError("leaflet_length must be less than sinus_length: the pockets end within the sinus")
        return self

    @property
    def length(self) -> float:
        """From inlet to outlet, m."""
        return self.upstream + self.sinus_length + self.downstream

    @property
    def vessels(self) -> tuple[Vessel, ...]:
        """The vein; its line is straight, along the whole of it."""
        line = (0.0, 0.0, 0.0), (0.0, 0.0, self.length)
        return (Vessel(wall=None, outer=None, centreline=line, radius=self.radius),)

    @property
    def size(self) -> float:
        """The radius, m."""
        return self.radius

    def pocket(self) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        """Return opposite corners [m] of a box in the pocket at +y, behind the outer half of the leaflet; it reaches
        through the wall."""
        wide, begin = 2 * self.radius * (1 + self.bulge), self.leaflet_length / 2
        leaflet = (self.radius + self.opening / 2) / 2 + 1.5 * self.thickness
        return (-wide, leaflet, self.upstream + begin), (wide, wide, self.upstream + self.leaflet_length)

    def wall_radius(self, z: Any) -> Any:
        """Return the radius of the wall [m] at z [m]."""
        s = np.clip((np.asarray(z) - self.upstream) / self.sinus_length, 0.0, 1.0)
        return self.radius * (1 + self.bulge * np.sin(pi * s) ** 2)

    def body(self) -> Any:
        """The blood as a solid of OCC, its faces named."""
        from netgen import occ

        start, end = self.upstream, self.upstream + self.sinus_length
        z = np.linspace(start, end, PROFILE_POINTS)
        points = [occ.Pnt(float(r), 0, float(h)) for r, h in zip(self.wall_radius(z), z, strict=True)]
        along = [occ.Pnt(0, 0, 0), occ.Pnt(self.radius, 0, 0), points[0]]
        back = [points[-1], occ.Pnt(self.radius, 0, self.length), occ.Pnt(0, 0, self.length), along[0]]
        edges = [occ.Segment(a, b) for a, b in pairwise(along)]
        edges.append(occ.SplineInterpolation(points, tol=1e-9) if self.bulge else occ.Segment(points[0], points[-1]))
        edges += [occ.Segment(a, b) for a, b in pairwise(back)]
        body = occ.Face(occ.Wire(edges)).Revolve(occ.Axis((0, 0, 0), occ.Z), 360)
        for side in (1, -1):
            body = body - self._leaflet(side)
        body.mat("fluid")
        for face in body.faces:
            face.name = "interface"
            near = start - self.thickness < face.center.z < end
            face.maxh = self.leaflet_size if near else self.element_size
        body.faces.Min(occ.Z).name, body.faces.Max(occ.Z).name = "inlet", "outlet"
        return body

    def _leaflet(self, side: int) -> Any:
        """Return a sheet that begins outside of the wall."""
        from netgen import occ

        half, wide = self.thickness / 2, 4 * self.radius
        tip = np.array([self.opening / 2 + half, self.upstream + self.leaflet_length])
        along = tip - np.array([self.radius + half, self.upstream])
        along /= np.linalg.norm(along)
        across = np.array([along[1], -along[0]])
        begin = tip - along * (1.5 * self.leaflet_length)
        corners = [begin - half * across, tip - half * across, tip + half * across, begin + half * across]
        wire = [occ.Pnt(-wide, side * float(y), float(z)) for y, z in corners]
        sides = [occ.Segment(a, b) for a, b in zip(wire, [*wire[1:], wire[0]], strict=True)]
        return occ.Face(occ.Wire(sides)).Extrude(occ.Vec(2 * wide, 0, 0))

    def mesh_attempts(self) -> tuple[str, ...]:
        """Return the ways to mesh."""
        return "tetrahedra", "smaller tetrahedra"

    def netgen_mesh(self, attempt: int = 0) -> Any:
        """Return the straight Netgen mesh [m] with its geometry and names."""
        from netgen import occ

        largest = self.element_size * (0.8 if attempt else 1.0)
        sizes = {"maxh": largest, "grading": 0.4, "curvaturesafety": 1.0, "segmentsperedge": 0.5}
        return occ.OCCGeometry(self.body()).GenerateMesh(**sizes)

    def inflow(self) -> Any:
        """Return the developed velocity of unit mean through the round inlet."""
        from ngsolve import CF, x, y

        return CF((0, 0, 2 * (1 - (x**2 + y**2) / self.radius**2)))

    def shape_map(self) -> None:
        """Return None: what is meshed is the reference shape."""
        return

    def exact_volumes(self) -> dict[str, float]:
        """Return the volume [m3] of the blood."""
        return {"fluid": self.body().mass}
