"""Directions of fibres: fields of unit vectors in a region of the reference shape, by their `kind` in a case file."""

from __future__ import annotations

from abc import abstractmethod
from typing import Annotated, Any, ClassVar, Literal, Self

import ngsolve as ng
import numpy as np
from pydantic import Field, model_validator

from ngfsi.arrays import Array
from ngfsi.config.model import ConfigModel, tagged
from ngfsi.errors import MaterialError, NgfsiError, unknown
from ngfsi.mesh.centreline import Centreline, find_centrelines
from ngfsi.mesh.domain import Domain
from ngfsi.units import Angle, Length


class Direction(ConfigModel):
    """A field of unit vectors; their signs are without meaning."""

    refusal: ClassVar[type[NgfsiError]] = MaterialError

    kind: str

    @abstractmethod
    def field(self, domain: Domain, region: str) -> Any:
        """Return the unit vectors as a coefficient function."""


class ConstantDirection(Direction):
    """One direction everywhere."""

    kind: Literal["constant"] = "constant"
    vector: tuple[float, float, float]
    """Of any length."""

    @model_validator(mode="after")
    def _points_somewhere(self) -> Self:
        if not any(self.vector):
            raise ValueError("the vector has no length")
        return self

    def field(self, _domain: Domain, _region: str) -> Any:
        return ng.CF(tuple((np.array(self.vector) / np.linalg.norm(self.vector)).tolist()))


class AlongCurve(Direction):
    """Along a curve through points: the tangent at the nearest point of it."""

    kind: Literal["along_curve"] = "along_curve"
    points: tuple[tuple[Length, Length, Length], ...] = Field(min_length=2)
    """Of the curve, in order, which a spline follows."""

    def field(self, domain: Domain, _region: str) -> Any:
        line = Centreline(np.array(self.points))
        return _unit(_linear(domain, line.tangents(line.coordinate(domain.vertices))))


class AroundVessel(Direction):
    """Around the centreline of a vessel, or at an angle to that: 90 degrees are along it."""

    kind: Literal["around"] = "around"
    vessel: str = ""
    """Name; empty: the first one."""
    angle: Angle = 0.0
    """From the direction around the centreline towards that along it."""

    def field(self, domain: Domain, _region: str) -> Any:
        names = {vessel.name: vessel for vessel in domain.vessels}
        if self.vessel not in names:
            raise MaterialError(unknown("vessel for fibres around it", self.vessel, names))
        line = find_centrelines(domain, names[self.vessel])[0]
        at = line.coordinate(domain.vertices)
        foot, along = (_linear(domain, values) for values in (line.points(at), line.tangents(at)))
        along = _unit(along)
        around = _unit(ng.Cross(along, ng.CF((ng.x, ng.y, ng.z)) - foot))
        return float(np.cos(self.angle)) * around + float(np.sin(self.angle)) * along


class InSurface(Direction):
    """In a membrane: at an angle to the direction that lies across an axis and goes around it counter-clockwise."""

    kind: Literal["in_surface"] = "in_surface"
    angle: Angle = 0.0
    """90 degrees are along the axis."""
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    """Of any length, through the origin."""

    def field(self, domain: Domain, region: str) -> Any:
        if region in domain.regions:
            raise MaterialError(f"fibres of kind 'in_surface' are for membranes: '{region}' is a region")
        axis, normal = ng.CF(tuple((np.array(self.axis) / np.linalg.norm(self.axis)).tolist())), ng.specialcf.normal(3)
        across, place = _unit(ng.Cross(axis, normal)), ng.CF((ng.x, ng.y, ng.z))
        across = ng.IfPos(ng.Cross(axis, place) * across, 1.0, -1.0) * across
        along = axis - (axis * normal) * normal
        return float(np.cos(self.angle)) * across + float(np.sin(self.angle)) * _unit(along)


class AlongHarmonic(Direction):
    """Along the gradient of the harmonic field of a region that is 0 on one boundary and 1 on another."""

    kind: Literal["harmonic"] = "harmonic"
    start: str
    """Boundary where the harmonic field is 0."""
    end: str
    """Boundary where it is 1."""

    def field(self, domain: Domain, region: str) -> Any:
        _check_volume(self, domain, region)
        space = ng.H1(domain.mesh, order=max(domain.geometry.curving_order, 2), definedon=domain.materials(region),
                      dirichlet="")  # fmt: skip
        trial, test = space.TnT()
        found = ng.GridFunction(space)
        form = ng.BilinearForm(space, check_unused=False)
        form += ng.Grad(trial) * ng.Grad(test) * domain.dx(region)
        form.Assemble()
        found.Set(1.0, definedon=domain.boundaries(self.end))
        free = space.GetDofs(domain.materials(region)) & ~space.GetDofs(domain.boundaries(self.start, self.end))
        residual = (form.mat * found.vec).Evaluate()
        found.vec.data -= form.mat.Inverse(free, inverse="sparsecholesky") * residual
        return _unit(ng.Grad(found))


class FromVtu(Direction):
    """From an array of vectors in a VTU file: in each element that of the nearest cell, or point."""

    kind: Literal["vtu"] = "vtu"
    file: str
    """VTU file with the directions."""
    array: str
    """Its array of vectors, of points or cells."""

    def field(self, domain: Domain, region: str) -> Any:
        _check_volume(self, domain, region)
        import pyvista
        from scipy.spatial import cKDTree

        try:
            grid = pyvista.read(self.file)
        except Exception as error:
            raise MaterialError(f"the fibres in '{self.file}' cannot be read: {error}") from None
        arrays = {**dict.fromkeys(grid.cell_data.keys(), "cell"), **dict.fromkeys(grid.point_data.keys(), "point")}
        if self.array not in arrays:
            raise MaterialError(f"'{self.file}': {unknown('array of vectors', self.array, arrays)}")
        on_cells = arrays[self.array] == "cell"
        vectors = np.asarray((grid.cell_data if on_cells else grid.point_data)[self.array], dtype=float)
        if vectors.ndim != 2 or vectors.shape[1] != 3:
            raise MaterialError(f"array '{self.array}' of '{self.file}' holds no vectors with three components")
        places = np.asarray(grid.cell_centers().points if on_cells else grid.points)
        middles = np.array(
            [np.mean([domain.mesh[v].point for v in one.vertices], axis=0) for one in domain.mesh.Elements()]
        )
        chosen = vectors[cKDTree(places).query(middles)[1]]
        return _unit(_by_element(domain, chosen))


FibreDirection = Annotated[
    Direction, tagged("kind", ConstantDirection, AlongCurve, AroundVessel, InSurface, AlongHarmonic, FromVtu)
]
"""A direction in a case: a table with `kind`."""


def _check_volume(direction: Direction, domain: Domain, region: str) -> None:
    if region not in domain.regions:
        raise MaterialError(f"fibres of kind '{direction.kind}' are for regions: '{region}' is a membrane")


def _unit(vector: Any) -> Any:
    return vector / ng.Norm(vector)


def _linear(domain: Domain, values: Array) -> Any:
    """Return the field that is linear in each element, by its values at vertices (n, 3)."""
    found = ng.GridFunction(ng.VectorH1(domain.mesh, order=1))
    for component, part in zip(found.components, values.T, strict=True):
        component.vec.FV().NumPy()[:] = part
    return found


def _by_element(domain: Domain, values: Array) -> Any:
    """Return the field that is constant in each element, by its values (n, 3)."""
    found = ng.GridFunction(ng.VectorL2(domain.mesh, order=0))
    for component, part in zip(found.components, values.T, strict=True):
        component.vec.FV().NumPy()[:] = part
    return found
