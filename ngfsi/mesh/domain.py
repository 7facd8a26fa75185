"""Domain: a curved mesh in metres whose region and boundary names are checked.

NGSolve silently integrates over nothing when a name is misspelt; every name goes through `Domain`, which raises
instead. Names are plain words (`[a-z][a-z0-9_]*`), never patterns.
"""

from __future__ import annotations

import hashlib
import re
from collections import Counter
from collections.abc import Callable
from functools import cached_property
from typing import Any

import netgen.meshing as nm
import ngsolve
import numpy as np
from ngsolve import BND, VOL, CoefficientFunction, Mesh, Region, specialcf

from ngfsi.arrays import Array, Numbers
from ngfsi.errors import MeshError, RegionError, unknown
from ngfsi.mesh.generate import TIMEOUT, MeshReport, check_shape, generate, quiet, shape_of
from ngfsi.mesh.geometry import Geometry, Vessel

LARGEST_VOLUME_ERROR = 0.01
"""Relative; a mesh that lost its curvature has several times as much."""

STRAIGHTENING = 10
"""Steps of Newton's method; five reach rounding in a vein that has collapsed."""
NAME = re.compile(r"[a-z][a-z0-9_]*")
END_FACE = re.compile(r"(tissue|wall|sheath)_(top|bottom)(_\d+)?")
"""Names of end faces of solids."""


class Domain:
    """The reference shape: mesh, regions and boundaries.

    Attributes:
        mesh: NGSolve mesh in metres, straight, with the displacement to the curved reference shape set as deformation.
        geometry: what was meshed.
        report: how the mesh came about.
        vessels: of the geometry.
        lumens: names of the regions of the blood.
        regions: names of all regions, the solids first.
        ends: names of the end faces: openings, and the faces of solids beside them.
    """

    def __init__(self, mesh: Mesh, geometry: Geometry, report: MeshReport) -> None:
        self.mesh, self.geometry, self.report = mesh, geometry, report
        self.vessels = tuple(geometry.vessels)
        self.lumens = tuple(vessel.lumen for vessel in self.vessels if vessel.lumen)
        self.regions = (*geometry.solids, *self.lumens)
        openings = {name for vessel in self.vessels for name in vessel.openings}
        self.ends = tuple(n for n in geometry.boundary_names if n in openings or END_FACE.fullmatch(n))
        self._check_names()
        # must live as long as the mesh
        self._shape = shape_of(mesh, geometry)
        self._quality = check_shape(mesh, self._shape)
        mesh.SetDeformation(self._shape)
        self._volume_errors = self._check_volumes()

    @classmethod
    def build(cls, geometry: Geometry, *, timeout: float = TIMEOUT, cache: bool = True) -> Domain:
        """Mesh a geometry (in a guarded child process, or from the cache), curve it and check it.

        Args:
            timeout: seconds allowed for each attempt of the mesher.
            cache: whether a mesh made earlier may be used and this one kept.

        Raises:
            MeshError: meshing failed in every way, or gave inverted elements or other names than promised.
        """
        straight, report = generate(geometry, timeout=timeout, cache=cache)
        with quiet():
            return cls(Mesh(straight), geometry, report)

    def beyond(self, vessel: Vessel) -> str | None:
        """Return the solid outside of a vessel's wall, at its outer face; None: there is none."""
        if vessel.outer is None or vessel.wall is None:
            return None
        materials, boundaries = self.mesh.GetMaterials(), self.mesh.GetBoundaries()
        faces = [self.mesh.ngmesh.FaceDescriptor(n) for n, name in enumerate(boundaries, 1) if name == vessel.outer]
        sides = {materials[side - 1] for face in faces for side in (face.domin, face.domout) if side}
        return next((name for name in self.geometry.solids if name in sides - {vessel.wall}), None)

    def is_interface(self, name: str) -> bool:
        """Whether a boundary of the blood moves with a solid."""
        return self.has_boundary(name) and bool(self.geometry.solids) and name not in self.geometry.rigid_names

    def has_boundary(self, name: str) -> bool:
        """Whether the geometry has such a boundary."""
        return name in self.geometry.boundary_names

    def materials(self, *names: str) -> Region:
        """Return the union of regions; without names all of them."""
        return self._region(VOL, names)

    def boundaries(self, *names: str) -> Region:
        """Return the union of boundaries; without names all of them."""
        return self._region(BND, names)

    def dx(self, *names: str, **options: Any) -> Any:
        """Return the volume measure of regions; options as of `ngsolve.dx` (bonus_intorder, element_boundary, ...)."""
        return ngsolve.dx(definedon=self.materials(*names), **options)

    def ds(self, *names: str, **options: Any) -> Any:
        """Return the surface measure of boundaries; options as of `ngsolve.ds`."""
        return ngsolve.ds(definedon=self.boundaries(*names), **options)

    def outward_normal(self, region: str) -> Any:
        """Return the normal of the reference shape that points out of a region on its boundaries; in the plane only on
        those of the whole mesh.

        NGSolve's own points from one side of a face to the other in an order of the mesh's.
        """
        number = self.mesh.GetMaterials().index(region) + 1
        return self._normal(lambda face: face.domin == number)

    def outer_normal(self) -> Any:
        """Return the normal of the reference shape that points out of all regions, on the boundaries around them: away
        from solids also on the surface of a hole."""
        return self._normal(lambda face: face.domin > 0)

    def _normal(self, keeps: Callable[[Any], bool]) -> Any:
        """Return NGSolve's normal on faces that keep its direction, and the opposite one on others."""
        normal = specialcf.normal(self.mesh.dim)
        if self.mesh.dim == 2:
            return normal
        faces = [self.mesh.ngmesh.FaceDescriptor(i + 1) for i in range(len(self.mesh.GetBoundaries()))]
        return CoefficientFunction([1.0 if keeps(face) else -1.0 for face in faces]) * normal

    def mean_normal(self, name: str) -> Array:
        """Return the unit vector (dim,) along the mean normal of a boundary, of either sign."""
        total = self._integral(specialcf.normal(self.mesh.dim), name)
        return np.asarray(total / np.linalg.norm(total))

    def centroid(self, *names: str) -> Array:
        """Return the centroid (dim,) [m] of boundaries."""
        place = CoefficientFunction((ngsolve.x, ngsolve.y, ngsolve.z)[: self.mesh.dim])
        return self._integral(place, *names) / self.area(*names)

    def _integral(self, field: CoefficientFunction, *names: str) -> Array:
        """Return the integrals of a vector field's components over boundaries."""
        over = self.ds(*names, bonus_intorder=8)
        return np.array([ngsolve.Integrate(field[i] * over, self.mesh) for i in range(self.mesh.dim)])

    def volume(self, *names: str) -> float:
        """Return the volume [m3] of regions."""
        return float(ngsolve.Integrate(CoefficientFunction(1.0) * self.dx(*names, bonus_intorder=8), self.mesh))

    def area(self, *names: str) -> float:
        """Return the area [m2] of boundaries."""
        return float(ngsolve.Integrate(CoefficientFunction(1.0) * self.ds(*names, bonus_intorder=8), self.mesh))

    @cached_property
    def _vertex_displacements(self) -> Array:
        parts = (self._shape.components[i].vec.FV().NumPy() for i in range(self.mesh.dim))
        return np.stack([part[: self.mesh.nv] for part in parts], axis=1)

    @cached_property
    def vertices(self) -> Array:
        """Places (vertices, dim) [m] of the mesh's vertices in the reference shape."""
        return np.array([vertex.point for vertex in self.mesh.vertices]) + self._vertex_displacements

    def vertices_on(self, *names: str) -> Numbers:
        """Return the numbers of the vertices of boundaries, ascending."""
        return np.unique([v.nr for element in self.boundaries(*names).Elements() for v in element.vertices])

    def on_straight_mesh(self, points: Array) -> Array:
        """Return where points (n, dim) of the curved reference shape lie in the straight mesh.

        NGSolve looks points up in the mesh without its deformation, where curved boundaries run along chords.
        """
        place = CoefficientFunction((ngsolve.x, ngsolve.y, ngsolve.z)[: self.mesh.dim])
        straight = points.copy()
        if self.geometry.shape_map() is not None:
            from scipy.spatial import cKDTree

            nearest = cKDTree(self.vertices).query(points)[1]
            straight -= self._vertex_displacements[nearest]
        for _ in range(STRAIGHTENING):
            at = self.mesh(*straight.T)
            missing = points - place(at)
            # the gradient is by places of the curved shape: 1 - slope is the inverse of that of the map to it
            slope = ngsolve.Grad(self._shape)(at).reshape(-1, self.mesh.dim, self.mesh.dim)
            straight += missing - np.einsum("nij,nj->ni", slope, missing)
        return straight

    def value(self, field: Any, *point: float) -> Any:
        """Return the value of a field at a point of the reference shape [m].

        Raises:
            RegionError: the point lies outside.
        """
        try:
            (straight,) = self.on_straight_mesh(np.array([point], dtype=float))
            return field(self.mesh(*straight))
        except nm.NgException:
            place = ", ".join(f"{x:g}" for x in point)
            raise RegionError(f"the point ({place}) m is not inside of {type(self.geometry).__name__}") from None

    def statistics(self) -> dict[str, Any]:
        """Return facts for the record: elements by type and region, their quality, volume errors, how it was meshed."""
        elements = list(self.mesh.Elements(VOL))
        return {
            "elements": self.mesh.ne, "vertices": self.mesh.nv,
            "elements_by_type": dict(Counter(element.type.name.lower() for element in elements)),
            "elements_by_region": dict(Counter(element.mat for element in elements)),
            "curving_order": self.geometry.curving_order, "smallest_jacobian_ratio": self._quality,
            "relative_volume_errors": self._volume_errors, "way_of_meshing": self.report.way,
            "warnings": list(self.report.warnings), "meshing_seconds": self.report.seconds,
            "from_cache": self.report.cached,
        }  # fmt: skip

    @property
    def fingerprint(self) -> str:
        """Hash of points and elements: unknowns of one mesh mean nothing on another."""
        points = np.array([vertex.point for vertex in self.mesh.vertices])
        elements = [[vertex.nr for vertex in element.vertices] for element in self.mesh.Elements(VOL)]
        return hashlib.sha256(points.tobytes() + repr(elements).encode()).hexdigest()[:32]

    def _region(self, kind: Any, names: tuple[str, ...]) -> Region:
        known = {"region": self.mesh.GetMaterials(), "boundary": self.mesh.GetBoundaries()}
        what, other = ("region", "boundary") if kind == VOL else ("boundary", "region")
        for name in names:
            if not isinstance(name, str) or not NAME.fullmatch(name) or name not in known[what]:
                if name in known[other]:
                    listed = ", ".join(sorted(set(known[what])))
                    raise RegionError(f"'{name}' is a {other}, not a {what}: known as {what} are {listed}")
                raise RegionError(unknown(what, str(name), set(known[what])))
        return Region(self.mesh, kind, "|".join(names) if names else ".*")

    def _check_names(self) -> None:
        """Compare the mesh's names with those the geometry promised."""
        geometry, mesh = self.geometry, self.mesh
        for what, names, wanted, optional in (
            ("regions", mesh.GetMaterials(), self.regions, ()),
            ("boundaries", mesh.GetBoundaries(), geometry.boundary_names, geometry.internal_names),
        ):
            missing, surplus = {*wanted} - {*names}, {*names} - {*wanted, *optional}
            if missing or surplus:
                raise MeshError(
                    f"the mesh of {type(geometry).__name__} has other {what} than promised: "
                    f"missing {sorted(missing) or 'none'}, not promised {sorted(surplus) or 'none'}"
                )

    def _check_volumes(self) -> dict[str, float]:
        """Return the relative volume error of each region; raise when curved elements do not follow the geometry."""
        exact = self.geometry.exact_volumes()
        errors = {name: self.volume(name) / exact[name] - 1 for name in exact}
        worst = max(errors, key=lambda name: abs(errors[name]))
        if self.geometry.curving_order > 1 and abs(errors[worst]) > LARGEST_VOLUME_ERROR:
            raise MeshError(
                f"region '{worst}' of the mesh has {errors[worst]:+.1%} of volume against the exact shape: make the "
                "elements smaller or the curving order higher"
            )
        return errors


def elements_at(domain: Domain, region: str, boundary: str) -> ngsolve.BitArray:
    """Return the elements of a region that touch a boundary."""
    touching = set(domain.vertices_on(boundary).tolist())
    chosen = ngsolve.BitArray(domain.mesh.ne)
    chosen[:] = False
    for element in domain.materials(region).Elements():
        if any(v.nr in touching for v in element.vertices):
            chosen[element.nr] = True
    return chosen


def elements_behind(domain: Domain, region: str, boundary: str) -> ngsolve.BitArray:
    """Return the elements of a region that have a face, in the plane an edge, on a boundary."""
    sides = "faces" if domain.mesh.dim == 3 else "edges"
    on = {side.nr for face in domain.boundaries(boundary).Elements() for side in getattr(face, sides)}
    chosen = ngsolve.BitArray(domain.mesh.ne)
    chosen[:] = False
    for element in domain.materials(region).Elements():
        if any(side.nr in on for side in getattr(element, sides)):
            chosen[element.nr] = True
    return chosen


def faces_of(domain: Domain, elements: ngsolve.BitArray) -> ngsolve.BitArray:
    """Return the elements of boundaries that belong to some elements: of two on both sides, to that of lower number."""
    sides = "faces" if domain.mesh.dim == 3 else "edges"
    owner: dict[int, int] = {}
    for element in domain.mesh.Elements(VOL):
        for side in getattr(element, sides):
            owner.setdefault(side.nr, element.nr)
    return ngsolve.BitArray([elements[owner[getattr(face, sides)[0].nr]] for face in domain.mesh.Elements(BND)])
