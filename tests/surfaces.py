"""Surfaces of lumens: tubes, straight and bent, and a branch, in mm."""

from __future__ import annotations

from math import pi
from pathlib import Path

import numpy as np
import pyvista as pv
from netgen import meshing, occ

RADIUS, LENGTH, BEND = 5.5, 25.0, 20.0
"""Of the tube, of its line when straight, and of the circle along which the quarter of a torus runs."""


def save(file: Path, points: object, triangles: list[list[int]]) -> Path:
    faces = np.column_stack([np.full(len(triangles), 3), triangles]).ravel()
    pv.PolyData(np.asarray(points, dtype=float), faces).save(file)
    return file


def tube(file: Path, around: int = 12, along: int = 6, *, capped: bool = True, bent: bool = False) -> Path:
    """Write a tube along z, or a quarter of a torus."""
    turn, ring = 2 * pi * np.arange(around) / around, np.arange(around)
    points = []
    for s in np.linspace(0, 1, along + 1):
        across, up = RADIUS * np.cos(turn), RADIUS * np.sin(turn)
        if bent:
            far = BEND + across
            points.append(np.column_stack([far * np.cos(pi / 2 * s), far * np.sin(pi / 2 * s), up]))
        else:
            points.append(np.column_stack([across, up, np.full(around, LENGTH * s)]))
    triangles = []
    for k in range(along):
        for i in ring.tolist():
            a, b = k * around + i, k * around + (i + 1) % around
            d, c = a + around, b + around
            triangles += [[a, b, c], [a, c, d]] if (i + k) % 2 else [[a, b, d], [b, c, d]]
    if capped:
        middle = len(points) * around
        points.append(np.array([points[0].mean(axis=0), points[-1].mean(axis=0)]))
        last = along * around
        for i in ring.tolist():
            j = (i + 1) % around
            triangles += [[middle, j, i], [middle + 1, last + i, last + j]]
    return save(file, np.vstack(points), triangles)


def branch(file: Path, size: float = 4.0) -> float:
    """Write a tube with a side branch and a fillet between; return the volume [m3] inside."""
    main = occ.Cylinder(occ.Pnt(0, 0, 0), occ.Z, r=5, h=40)
    shape = main + occ.Cylinder(occ.Pnt(0, 0, 20), occ.X, r=4, h=18)
    seam = [edge for edge in shape.edges if 1 < abs(edge.center.x) < 9 and 10 < edge.center.z < 30]
    shape = shape.MakeFillet(seam, 2.0)
    mesh = occ.OCCGeometry(shape).GenerateMesh(maxh=size, perfstepsend=meshing.MeshingStep.MESHSURFACE)
    points = np.array([point.p for point in mesh.Points()])
    save(file, points, [[v.nr - 1 for v in face.vertices] for face in mesh.Elements2D()])
    return float(shape.mass) * 1e-9
