"""A vein segment meshed by Netgen from its solids (CSG) with its default element sizes: what one has without effort.

Netgen makes tetrahedra as small as its curvature and its thinnest parts ask for, everywhere as long as wide: for the
calf 20,000, where elements drawn along the vein (`geometry.segment`) are a few hundred. It is there to compare with.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import netgen.csg as nc

from ngfsi_geometry.extrusion import cylinder
from ngfsi_geometry.plane import Ellipse


def mesh_of_solids(
    regions: Mapping[str, tuple[Ellipse, Sequence[Ellipse]]], ends: Mapping[str, tuple[str, str]], length: float
) -> Any:
    """Return Netgen's mesh [m], straight, with its geometry and names.

    Args:
        regions: name -> the circle around it and those of its holes; surfaces are named as the circles.
        ends: name -> names of its faces at z = 0 and z = `length` [m].
    """
    geometry = nc.CSGeometry()
    bottom = nc.Plane(nc.Pnt(0, 0, 0), nc.Vec(0, 0, -1))
    top = nc.Plane(nc.Pnt(0, 0, length), nc.Vec(0, 0, 1))
    circles = {c.name: c for outer, holes in regions.values() for c in (outer, *holes)}
    cylinders = {name: cylinder(c, -length, 2 * length).bc(name) for name, c in circles.items()}
    for name, (outer, holes) in regions.items():
        solid = cylinders[outer.name] * bottom * top
        for hole in holes:
            solid = solid - cylinders[hole.name]
        # the planes are surfaces of all regions: their names are given by region
        geometry.Add(solid.mat(name), bcmod=list(zip((bottom, top), ends[name], strict=True)))
    return geometry.GenerateMesh()
