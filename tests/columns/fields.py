"""Fields as functions of place that are the same for NumPy and NGSolve, and integrals of them over meshes of flat
elements, by nothing but NumPy: derivatives by complex steps, Gauss's rule on each element.

A field takes x, y, z (arrays or coefficient functions) and returns a value or a tuple of components.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import ngsolve as ng
import numpy as np
from numpy.typing import NDArray

from ngfsi.mesh.domain import Domain

Array = NDArray[np.float64]
Field = Callable[..., Any]

STEP = 1e-30
"""Imaginary part of a place (m), of which no digit is lost."""
NODES, WEIGHTS = (0.5 * values for values in np.polynomial.legendre.leggauss(10))
NODES = NODES + 0.5


def at(field: Field, places: Any) -> Any:
    """Return a field at places (..., n): (...) or (..., components)."""
    values = field(*np.moveaxis(places, -1, 0))
    shape = places.shape[:-1]
    if isinstance(values, tuple):
        return np.stack([np.broadcast_to(value, shape) for value in values], axis=-1)
    return np.broadcast_to(values, shape)


def gradient(field: Field, places: Array) -> Array:
    """Return the derivatives (..., components, n) of a vector field at places (..., n)."""
    steps = 1j * STEP * np.eye(places.shape[-1])
    return np.stack([np.imag(at(field, places + step)) / STEP for step in steps], axis=-1)


def moved(field: Field, places: Array) -> Array:
    """Return places (..., n) after a displacement."""
    return np.asarray(places + at(field, places))


def deformation(field: Field, places: Array) -> Array:
    """Return the gradients (..., n, n) of `moved`."""
    return np.asarray(np.eye(places.shape[-1]) + gradient(field, places))


def cofactor(F: Array) -> Array:
    """Return what takes reference to deformed areas."""
    return np.asarray(np.linalg.det(F)[..., None, None] * np.swapaxes(np.linalg.inv(F), -1, -2))


def _corners(domain: Domain, kind: Any, name: str) -> Iterator[Array]:
    for element in domain.mesh.Elements(kind):
        if element.mat == name:
            yield np.array([domain.mesh[vertex].point for vertex in element.vertices])


def triangle() -> tuple[Array, Array]:
    """Return shares (points, 3) of the corners of a triangle and weights (points,) that sum up to 1."""
    s, t = (part.ravel() for part in np.meshgrid(NODES, NODES))
    weights = np.outer(WEIGHTS, WEIGHTS).ravel() * 2 * (1 - s)
    return np.stack([s, t * (1 - s), (1 - t) * (1 - s)], axis=1), weights


def within(domain: Domain, region: str) -> tuple[Array, Array]:
    """Return places (points, n) and weights (points,) of a region of triangles or prisms [m, m2 or m3]."""
    places, weights = [], []
    shares, parts = triangle()
    for corners in _corners(domain, ng.VOL, region):
        area = np.linalg.norm(np.cross(*np.pad(corners[1:3] - corners[0], ((0, 0), (0, 3 - corners.shape[1]))))) / 2
        if len(corners) == 3:
            places.append(shares @ corners)
            weights.append(area * parts)
        else:
            low, high = shares @ corners[:3], shares @ corners[3:]
            height = corners[3, 2] - corners[0, 2]
            places.append(np.concatenate([(1 - t) * low + t * high for t in NODES]))
            weights.append(np.concatenate([area * abs(height) * w * parts for w in WEIGHTS]))
    return np.concatenate(places), np.concatenate(weights)


def on(domain: Domain, boundary: str) -> tuple[Array, Array]:
    """Return places (faces, points, n) and reference areas (faces, points, n) with the direction of either normal, of a
    boundary of edges, triangles or parallelograms [m, m or m2]."""
    places, areas = [], []
    for corners in _corners(domain, ng.BND, boundary):
        if len(corners) == 2:
            way = corners[1] - corners[0]
            places.append(corners[0] + NODES[:, None] * way)
            areas.append(WEIGHTS[:, None] * np.array([way[1], -way[0]]))
            continue
        size = np.cross(corners[1] - corners[0], corners[-1] - corners[0])
        if len(corners) == 3:
            shares, parts = triangle()
            places.append(shares @ corners)
            areas.append(parts[:, None] * size / 2)
        else:
            s, t = (part.ravel()[:, None] for part in np.meshgrid(NODES, NODES))
            places.append(corners[0] + s * (corners[1] - corners[0]) + t * (corners[3] - corners[0]))
            areas.append(np.outer(WEIGHTS, WEIGHTS).ravel()[:, None] * size)
    return np.array(places), np.array(areas)


def quadrature_points(domain: Domain, kind: Any, name: str, order: int) -> Array:
    """Return the places (points, n) [m] of NGSolve's rule of an order in a region or on a boundary."""
    rules = {shape: ng.IntegrationRule(shape, order) for shape in (ng.PRISM, ng.TRIG, ng.QUAD, ng.SEGM)}
    region = domain.mesh.Materials(name) if kind == ng.VOL else domain.mesh.Boundaries(name)
    place = ng.CF((ng.x, ng.y, ng.z)[: domain.mesh.dim])
    return np.asarray(place(domain.mesh.MapToAllElements(rules, region)))


def cauchy(law: Any, F: Array) -> Array:
    """Return the true stress (..., 3, 3) [Pa] of Saint Venant and Kirchhoff's law, from Young's modulus and Poisson's
    ratio."""
    mu = law.young / 2 / (1 + law.poisson)
    lame = law.young * law.poisson / (1 + law.poisson) / (1 - 2 * law.poisson)
    E = (np.swapaxes(F, -1, -2) @ F - np.eye(3)) / 2
    S = lame * np.trace(E, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) + 2 * mu * E
    return np.asarray(F @ S @ np.swapaxes(F, -1, -2) / np.linalg.det(F)[..., None, None])


def pressure(stress: Array) -> Array:
    """Return -tr/3."""
    return np.asarray(-np.trace(stress, axis1=-2, axis2=-1) / 3)
