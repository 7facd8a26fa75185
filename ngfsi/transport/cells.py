"""The cells of the blood: their neighbours, and the flow of the blood through them in a state of the system.

All is by coordinates of the reference elements. A point of a cell is at x = X(xi) + m(xi), with G = dx/dxi, so that
det G is volume, and cof(G)^T w the flux of a velocity w through faces of the reference element.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import ngsolve as ng
import numpy as np

from ngfsi.arrays import Array, Mask, Numbers
from ngfsi.mesh.domain import Domain
from ngfsi.transport.elements import ReferenceElement, reference_element, rule

ROUNDING = 1e-6
"""Distance of two points over the size of their cell up to which they are one."""


@dataclass(frozen=True)
class Block:
    """The cells of one shape.

    Attributes:
        element: their shape.
        numbers: (c,) of the elements in the mesh.
        cells: where they stand among all cells.
        faces: where their (c, f) points on faces stand among all points on faces, flattened.
        slope: (c, q, 3, 3) gradient of the reference shape by the coordinates of the reference element.
        face_slope: (c, f, 3, 3)
    """

    element: ReferenceElement
    numbers: Numbers
    cells: slice
    faces: slice
    slope: Array
    face_slope: Array

    @property
    def kind(self) -> Any:
        """NGSolve's name of the shape."""
        return getattr(ng.ET, self.element.kind)


class Cells:
    """The elements of the blood of a domain.

    Attributes:
        order: of the polynomials.
        blocks: by shape.
        count: number of cells.
        partner: (points,) to each point on a face that on the other side; itself on boundaries.
        inner, wall: (points,) which points are between cells, or on no opening.
        openings: points on each opening.
        cell, face: (points,) number of the cell and of the face.
        lumens: cells of each region.
        places, face_places: by block, where the points of the cells are in the reference shape, m.
    """

    def __init__(self, domain: Domain, order: int) -> None:
        self.domain, self.order = domain, order
        self._mesh, self._region = domain.mesh, domain.materials(*domain.lumens)
        elements = list(self._region.Elements())
        kinds = [element.type.name for element in elements]
        self.blocks: list[Block] = []
        self.places: list[Array] = []
        self.face_places: list[Array] = []
        cells = faces = 0
        jacobian, place = ng.specialcf.JacobianMatrix(3), ng.CF((ng.x, ng.y, ng.z))
        for kind in dict.fromkeys(kinds):
            element = reference_element(kind, order)
            numbers = np.array([one.nr for one, its in zip(elements, kinds, strict=True) if its == kind])
            last, last_face = cells + len(numbers), faces + len(numbers) * len(element.face)
            slopes = []
            for points, places in ((element.points, self.places), (element.face_points, self.face_places)):
                places.append(self._values(place, kind, points).reshape(len(numbers), -1, 3))
                slopes.append(self._values(jacobian, kind, points).reshape(len(numbers), -1, 3, 3))
            self.blocks.append(Block(element, numbers, slice(cells, last), slice(faces, last_face), *slopes))
            cells, faces = last, last_face
        self.count = cells
        number_of = {number: k for k, number in enumerate(np.concatenate([block.numbers for block in self.blocks]))}
        materials = {one.nr: one.mat for one in elements}
        self.lumens = {
            name: np.array([number_of[nr] for nr in number_of if materials[nr] == name]) for name in domain.lumens
        }
        self._connect({one.nr: [vertex.nr for vertex in one.vertices] for one in elements})

    def _values(self, field: Any, kind: str, points: Array) -> Array:
        """Return a field (points of all cells of a shape, components) at points of the reference element."""
        shape, nothing = getattr(ng.ET, kind), ng.IntegrationRule([], [])
        rules = {one: nothing for one in (ng.ET.HEX, ng.ET.PRISM, ng.ET.TET, ng.ET.PYRAMID)}
        rules[shape] = ng.IntegrationRule([tuple(p) for p in points.tolist()], [1.0] * len(points))
        return np.asarray(field(self._mesh.MapToAllElements(rules, self._region)))

    def _connect(self, corners: Mapping[int, Sequence[int]]) -> None:
        """Find out which points on faces are the same, and which lie on openings."""
        from scipy.spatial import cKDTree  # takes long to import

        sizes, cell, face = [], [], []
        known: dict[frozenset[int], int] = {}
        for block in self.blocks:
            element = block.element
            size = np.abs(np.linalg.det(block.slope)).mean(axis=1) ** (1 / 3)
            sizes.append(np.repeat(size, len(element.face)))
            cell.append(np.repeat(np.arange(block.cells.start, block.cells.stop), len(element.face)))
            of = np.array([[known.setdefault(frozenset(corners[nr][i] for i in one), len(known))
                            for one in element.corners] for nr in block.numbers])  # fmt: skip
            face.append(of[:, element.face].ravel())
        at = np.concatenate([one.reshape(-1, 3) for one in self.face_places])
        self.cell, self.face = np.concatenate(cell), np.concatenate(face)
        # faces apart, so that points of two faces cannot be taken for one
        scale = np.concatenate(sizes)
        apart = np.column_stack([at, self.face * np.ptp(at, axis=0).max()])
        distance, nearest = cKDTree(apart).query(apart, k=2)
        own = np.arange(len(at))
        other = np.where(nearest[:, 0] == own, nearest[:, 1], nearest[:, 0])
        self.inner: Mask = (distance[:, 1] < ROUNDING * scale) & (self.face[other] == self.face)
        self.partner = np.where(self.inner, other, own)
        self.openings: dict[str, Numbers] = {}
        for vessel in self.domain.vessels:
            for name in vessel.openings if vessel.lumen else ():
                on = {known[frozenset(v.nr for v in one.vertices)] for one in self.domain.boundaries(name).Elements()}
                self.openings[name] = np.flatnonzero(np.isin(self.face, list(on)) & ~self.inner)
        self.wall = ~self.inner
        for there in self.openings.values():
            self.wall[there] = False

    # ---------------------------------------------------------------- states

    @cached_property
    def _sampling(self) -> list[tuple[Array, Array]]:
        """Points of each shape at which fields are sampled, and what makes coefficients (n, points) of the values."""
        found = []
        for block in self.blocks:
            points, weights = rule(block.kind, 2 * self.order)
            values = block.element.polynomials(points)[0]
            taking = np.linalg.solve(values.T * weights @ values, values.T * weights)
            found.append((points, np.asarray(taking, dtype=float)))
        return found

    def sample(self, field: Any) -> list[Array]:
        """Return the coefficients (cells, polynomials, components) of a field in each block."""
        found = []
        for block, (points, taking) in zip(self.blocks, self._sampling, strict=True):
            values = self._values(field, block.element.kind, points)
            found.append(np.einsum("np,cpd->cnd", taking, values.reshape(len(block.numbers), len(points), -1)))
        return found

    def split(self, points: Array) -> list[Array]:
        """Return values at all points on faces, (..., points), by block as (..., cells, points of a cell)."""
        return [points[..., block.faces].reshape(*points.shape[:-1], len(block.numbers), -1) for block in self.blocks]


@dataclass(frozen=True)
class Flow:
    """Volume of the cells and flow through them, in a state.

    Attributes:
        volumes: by block (c, q), what each point weighs in integrals over the deformed cell.
        fluxes: by block (3, c, q), flux by the coordinates of the reference element, times the weights there.
        through: (points,) flux out of the cell at each point on its faces, times its weight: opposite on both sides.
        metrics: by block (c, q, 3, 3), J G^-1 G^-T times the weights: what makes the flux of diffusion of a gradient by
            the coordinates of the reference element; None: not asked for.
        normal_metrics: by block (c, f, 3), its part through faces, times the weights there.
    """

    volumes: list[Array]
    fluxes: list[Array]
    through: Array
    metrics: list[Array] | None = None
    normal_metrics: list[Array] | None = None

    @classmethod
    def of(
        cls, cells: Cells, motion: Sequence[Array], velocity: Sequence[Array], *, diffusive: bool = False
    ) -> Flow:  # fmt: skip
        """Return the flow of a relative velocity (m/s) on the moved cells, both by their coefficients."""
        volumes, fluxes, through = [], [], np.zeros(len(cells.cell))
        metrics: list[Array] = []
        normal_metrics: list[Array] = []
        for block, m, w in zip(cells.blocks, motion, velocity, strict=True):
            e = block.element
            cof, determinant = deformed(block.slope, e.slopes, m)
            # cells of negative size turn the other way
            sign = np.sign(determinant[:, :1])
            volumes.append(e.weights * determinant * sign)
            along = np.sum(cof * (e.values @ w)[..., None], axis=2) * (sign * e.weights)[..., None]
            fluxes.append(np.ascontiguousarray(np.moveaxis(along, -1, 0)))
            face_cof, face_determinant = deformed(block.face_slope, e.face_slopes, m)
            normal = np.sum(face_cof * e.areas[:, None, :], axis=-1)
            if diffusive:
                metrics.append(cof.swapaxes(-1, -2) @ cof * (e.weights / np.abs(determinant))[..., None, None])
                normal_metrics.append(np.sum(normal[..., None] * face_cof, axis=-2)
                                      / np.abs(face_determinant)[..., None])  # fmt: skip
            through[block.faces] = (sign * np.sum(normal * (e.face_values @ w), axis=-1)).ravel()
        through = np.where(cells.inner, (through - through[cells.partner]) / 2, through)
        through[cells.wall] = 0.0
        return cls(volumes, fluxes, through, metrics or None, normal_metrics or None)

    def between(self, other: Flow) -> Flow:
        """Return the mean of two flows."""

        def mean(one: Sequence[Array], two: Sequence[Array]) -> list[Array]:
            return [(a + b) / 2 for a, b in zip(one, two, strict=True)]

        def mean_if(one: Sequence[Array] | None, two: Sequence[Array] | None) -> list[Array] | None:
            return None if one is None or two is None else mean(one, two)

        return Flow(mean(self.volumes, other.volumes), mean(self.fluxes, other.fluxes),
                    (self.through + other.through) / 2, mean_if(self.metrics, other.metrics),
                    mean_if(self.normal_metrics, other.normal_metrics))  # fmt: skip


def deformed(slope: Array, slopes: Array, motion: Array) -> tuple[Array, Array]:
    """Return cof(G) and det(G) of moved cells at points (c, p, 3, 3), (c, p).

    Args:
        slope: (c, p, 3, 3) of the reference shape.
        slopes: (p, n, 3) of the polynomials.
        motion: (c, n, 3) coefficients of the displacement, m.
    """
    G = slope + gradients(slopes, motion)
    cof = cofactors(G)
    return cof, np.sum(G[:, :, 0] * cof[:, :, 0], axis=-1)


def gradients(slopes: Array, coefficients: Array) -> Array:
    """Return the gradients (c, p, 3, 3) at points of vector fields (c, n, 3), by the coordinates of the elements."""
    points, number, _ = slopes.shape
    found = slopes.transpose(0, 2, 1).reshape(-1, number) @ coefficients
    return found.reshape(len(coefficients), points, 3, 3).swapaxes(-1, -2)


def cofactors(G: Array) -> Array:
    """Return cof(G) = det(G) G^-T of tensors (..., 3, 3)."""
    a, b, c = G[..., 0, :], G[..., 1, :], G[..., 2, :]
    return np.stack([_cross(b, c), _cross(c, a), _cross(a, b)], axis=-2)


def _cross(a: Array, b: Array) -> Array:
    (a0, a1, a2), (b0, b1, b2) = np.moveaxis(a, -1, 0), np.moveaxis(b, -1, 0)
    return np.stack([a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0], axis=-1)
