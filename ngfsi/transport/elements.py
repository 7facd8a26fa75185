"""Reference elements of discontinuous fields: polynomials, points, faces."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import permutations, product
from typing import Any

import ngsolve as ng
import numpy as np
from ngsolve import fem

from ngfsi.arrays import Array, Numbers

FACES: dict[str, tuple[tuple[int, ...], ...]] = {
    "HEX": ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
    "PRISM": ((0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)),
    "TET": ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3)),
    "PYRAMID": ((0, 1, 2, 3), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)),
}
"""Corners of each face, in order around it."""
POWERS: dict[str, Callable[[int, int, int, int], bool]] = {
    "HEX": lambda i, j, k, order: max(i, j, k) <= order,
    "PRISM": lambda i, j, k, order: i + j <= order and k <= order,
    "TET": lambda i, j, k, order: i + j + k <= order,
    "PYRAMID": lambda i, j, k, order: i + j + k <= order,
}
"""Whether x^i y^j z^k is among the polynomials of an order."""
WIDTH = {"HEX": (1.0,) * 3, "PRISM": (0.58, 0.58, 1.0), "TET": (0.42,) * 3, "PYRAMID": (0.42,) * 3}
"""Along each axis, as far as stability is concerned: diameter of the largest sphere, or circle, within."""


@dataclass(frozen=True)
class ReferenceElement:
    """An element of one shape, with polynomials that are orthonormal over it, the first one constant.

    Attributes:
        kind: "HEX", "PRISM", "TET" or "PYRAMID".
        points, weights: (q, 3), (q,) of integrals over it.
        values, slopes: (q, n), (q, n, 3) of the polynomials at the points.
        face_points: (f, 3) those on all faces, one after the other.
        face_values, face_slopes: (f, n), (f, n, 3) of the polynomials there.
        areas: (f, 3) outward normals times what the points weigh.
        face: (f,) number of the face that a point is on.
        corners: of each face.
        polynomials: returns values and slopes of the polynomials at points (p, 3).
    """

    kind: str
    points: Array
    weights: Array
    values: Array
    slopes: Array
    face_points: Array
    face_values: Array
    face_slopes: Array
    areas: Array
    face: Numbers
    corners: tuple[tuple[int, ...], ...]
    polynomials: Callable[[Array], tuple[Array, Array]]

    @cached_property
    def slopes_along(self) -> list[Array]:
        """The polynomials' derivatives (q, n) along each axis."""
        return [np.ascontiguousarray(self.slopes[..., axis]) for axis in range(3)]

    @cached_property
    def products(self) -> Array:
        """Products (q, n * n) of the polynomials."""
        return np.asarray((self.values[:, :, None] * self.values[:, None, :]).reshape(len(self.values), -1))

    @cached_property
    def stiffness(self) -> Array:
        """Integrals (n, n) of the products of the polynomials' gradients."""
        return np.asarray(np.einsum("q,qid,qjd->ij", self.weights, self.slopes, self.slopes))


@cache
def reference_element(kind: str, order: int) -> ReferenceElement:
    """Return the reference element of a shape with polynomials of an order."""
    shape = getattr(ng.ET, kind)
    topology: Any = fem.ElementTopology
    vertices = np.round(np.array(topology(shape).vertices), 9)
    points, weights = rule(shape, 3 * order)
    powers = np.array([(i, j, k) for i, j, k in product(range(order + 1), repeat=3) if POWERS[kind](i, j, k, order)])
    powers = powers[np.argsort(powers.sum(axis=1), kind="stable")]
    middle = vertices.mean(axis=0)
    # orthonormal by a QR decomposition of the weighted powers
    upper = np.linalg.qr(np.sqrt(weights)[:, None] * _powers(points - middle, powers))[1]
    upper *= np.sign(np.diag(upper))[:, None]

    def polynomials(at: Array) -> tuple[Array, Array]:
        values, slopes = _powers(at - middle, powers), _slopes(at - middle, powers)
        inverse = np.linalg.inv(upper)
        return values @ inverse, np.einsum("qnd,nm->qmd", slopes, inverse)

    face_points, areas, face = _faces(kind, vertices, middle, 2 * order + 1)
    return ReferenceElement(kind, points, weights, *polynomials(points), face_points, *polynomials(face_points), areas,
                            face, FACES[kind], polynomials)  # fmt: skip


def _powers(at: Array, powers: Numbers) -> Array:
    return np.asarray(np.prod(at[:, None, :] ** powers, axis=2))


def _slopes(at: Array, powers: Numbers) -> Array:
    found = []
    for axis in range(3):
        lower = powers - np.eye(3, dtype=int)[axis]
        found.append(powers[:, axis] * _powers(at, np.maximum(lower, 0)))
    return np.stack(found, axis=2)


def rule(shape: Any, order: int) -> tuple[Array, Array]:
    """Return points (q, 3) and weights (q,) of NGSolve's rule of an order."""
    found: Any = ng.IntegrationRule(shape, order)
    return np.array([p.point for p in found], dtype=float), np.array([p.weight for p in found], dtype=float)


def _faces(kind: str, vertices: Array, middle: Array, order: int) -> tuple[Array, Array, Numbers]:
    """Return points on all faces, their outward normals times weights, and the number of the face of each."""
    points, areas, numbers = [], [], []
    for number, corners in enumerate(FACES[kind]):
        at, weights = _face_rule(len(corners), order)
        origin, one, other = (vertices[corners[i]] for i in (0, 1, -1))
        normal = np.cross(one - origin, other - origin)
        normal *= np.sign(normal @ (origin - middle))
        points.append(origin + at @ np.stack([one - origin, other - origin]))
        areas.append(weights[:, None] * normal)
        numbers.append(np.full(len(at), number))
    return np.concatenate(points), np.concatenate(areas), np.concatenate(numbers)


def _face_rule(corners: int, order: int) -> tuple[Array, Array]:
    """Return points (n, 2) and weights on the unit square or triangle that stay the same whatever corner comes first:
    so both elements at a face have the same points."""
    points, weights = rule(ng.ET.QUAD if corners == 4 else ng.ET.TRIG, order)
    points = points[:, :2]
    if corners == 4:
        return points, weights
    barycentric = np.column_stack([points, 1 - points.sum(axis=1)])
    merged: dict[tuple[float, ...], tuple[Array, float]] = {}
    for way in permutations(range(3)):
        for point, weight in zip(barycentric[:, way], weights / 6, strict=True):
            key = tuple(np.round(point, 7))
            there, sofar = merged.get(key, (point, 0.0))
            merged[key] = there, sofar + weight
    kept, weight = zip(*merged.values(), strict=True)
    return np.array(kept)[:, :2], np.array(weight)
