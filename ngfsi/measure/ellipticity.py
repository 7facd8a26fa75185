"""Whether a law still resists shear bands: strong ellipticity in the present state.

The acoustic tensor Q(n) of a law, a . Q(n) a = d2W / dt2 of F + t a x n, is positive definite in each direction n as
long as the material is stable (Ogden, Non-linear elastic deformations, 1984, section 6.2). Where it is not, a solution
may jump across planes, and its elements, not the physics, say how far apart these are: no refinement converges. Saint
Venant-Kirchhoff's law loses it in plane compression at a stretch of 0.73 (Poisson ratio 0.49).
"""

from __future__ import annotations

from functools import cache
from itertools import product
from typing import Any

import ngsolve as ng
import numpy as np
from ngsolve.meshes import MakeStructured3DMesh

from ngfsi.arrays import Array, Numbers
from ngfsi.materials import SolidLaw
from ngfsi.materials.solid.fibres import Fibred, FibreLaw

LARGEST = 10.0
"""Largest stretch looked at."""
ANGLES = np.linspace(0.0, np.pi / 2, 7)[:-1]
"""Of a direction from one principal axis to the next."""
DIFFERENCE = 1e-4
PLANES = ((0, 1, 2), (1, 2, 0), (2, 0, 1))
WORST = 20
"""Points looked at for each extreme: of the smallest stretch, the largest and their product."""


class Ellipticity:
    """Resistance of an isotropic law to shear bands; directions n in the planes of two principal axes are tried."""

    def __init__(self, law: SolidLaw) -> None:
        here = ng.CF((ng.x, 0, 0, 0, ng.y, 0, 0, 0, ng.z), dims=(3, 3))
        self._along, self._across = ([ng.Parameter(0.0) for _ in range(3)] for _ in range(2))
        band = ng.CF(tuple(a * n for a, n in product(self._along, self._across)), dims=(3, 3))
        up, down = (law.variation(here + sign * DIFFERENCE * band, band) for sign in (1, -1))
        self._second = ((up - down) / (2 * DIFFERENCE)).Compile()
        self._unit = law.shear_modulus or self._at_rest()

    def _at_rest(self) -> float:
        """Return the smallest eigenvalue of Q without deformation (Pa), for laws without a shear modulus."""
        self._unit = 1.0
        return float(self.smallest(np.ones((1, 3)))[0])

    def smallest(self, stretches: Array) -> Array:
        """Return the smallest eigenvalue of Q over the initial shear modulus, for principal stretches (n, 3): (n,)."""
        points = _stretches_as_points()(*np.clip(stretches, 0.0, LARGEST).T)
        found = [self._in_direction(points, plane, angle) for plane, angle in product(PLANES, ANGLES)]
        return np.asarray(np.min(found, axis=0)) / self._unit

    def _in_direction(self, points: Any, plane: tuple[int, int, int], angle: float) -> Array:
        """Return the smallest eigenvalue (n,) of Q(n), n in the plane of the first two axes: two in it, one across."""
        i, j, k = plane
        self._set(self._across, {i: np.cos(angle), j: np.sin(angle)})
        first, second, across, both = (self._at(points, axes) for axes in ((i,), (j,), (k,), (i, j)))
        mean, half, mixed = (first + second) / 2, (first - second) / 2, (both - first - second) / 2
        return np.minimum(across, mean - np.hypot(half, mixed))

    def _at(self, points: Any, axes: tuple[int, ...]) -> Array:
        self._set(self._along, dict.fromkeys(axes, 1.0))
        return np.ravel(self._second(points))

    @staticmethod
    def _set(vector: list[ng.Parameter], entries: dict[int, float]) -> None:
        for axis, parameter in enumerate(vector):
            parameter.Set(entries.get(axis, 0.0))


class EllipticityInAllDirections:
    """Resistance of a law with fibres to shear bands: the whole tangent, and directions n all over the sphere."""

    def __init__(self, law: FibreLaw) -> None:
        self._F = [ng.Parameter(float(i == j)) for i, j in product(range(3), repeat=2)]
        self._ways = [[ng.Parameter(0.0) for _ in range(3)] for _ in law.fibres]
        model = Fibred(law, [ng.CF(tuple(way)) for way in self._ways])
        F = ng.CF(tuple(self._F), dims=(3, 3))
        units = (ng.CF(tuple(one.tolist()), dims=(3, 3)) for one in np.eye(9))
        self._stress = ng.CF(tuple(model.variation(F, unit) for unit in units)).Compile()
        self._point = _stretches_as_points()(1.0, 1.0, 1.0)
        self._unit = 1.0
        aligned = np.tile([0.0, 0.0, 1.0], (1, len(law.fibres), 1))
        self._unit = float(self.smallest(np.eye(3)[None], aligned)[0])

    def smallest(self, F: Array, directions: Array) -> Array:
        """Return the smallest eigenvalue of Q over that at rest: (n,).

        Args:
            F: deformation gradients (n, 3, 3).
            directions: unit vectors along the fibres (n, families, 3).
        """
        return np.array([self._at(*one) for one in zip(F, directions, strict=True)]) / self._unit

    def _at(self, F: Array, directions: Array) -> float:
        for way, values in zip(self._ways, directions, strict=True):
            for parameter, value in zip(way, values, strict=True):
                parameter.Set(float(value))
        unit = DIFFERENCE * np.eye(9)
        up, down = (np.array([self._stress_at(F.ravel() + sign * one) for one in unit]) for sign in (1, -1))
        tangent = ((up - down) / (2 * DIFFERENCE)).reshape(3, 3, 3, 3)

        def smallest(n: Array) -> Array:
            return np.asarray(np.linalg.eigvalsh(np.einsum("iajb,na,nb->nij", tangent, n, n))[:, 0])

        best, spread = SPHERE[np.argmin(smallest(SPHERE))], 0.1
        while spread > 1e-4:  # around the best direction, ever nearer
            near = np.vstack([best, best + spread * SPHERE[::8], best - spread * SPHERE[::8]])
            near /= np.linalg.norm(near, axis=1)[:, None]
            best, spread = near[np.argmin(smallest(near))], spread / 2
        return float(smallest(best[None])[0])

    def _stress_at(self, F: Array) -> Array:
        for parameter, value in zip(self._F, F, strict=True):
            parameter.Set(float(value))
        return np.asarray(self._stress(self._point))


def _sphere(number: int) -> Array:
    """Return directions (n, 3) spread evenly over half of the sphere, on a spiral."""
    z = (np.arange(number) + 0.5) / number
    turn = np.pi * (1 + 5**0.5) * np.arange(number)
    return np.stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z], axis=1)


SPHERE = _sphere(400)


def extreme(stretches: Array) -> Numbers:
    """Return numbers of the points, of sorted stretches (n, 3), that are likely to be the worst."""
    orders = (stretches[:, 0], -stretches[:, 2], np.prod(stretches, axis=1))
    last = min(WORST, len(stretches)) - 1
    return np.unique(np.concatenate([np.argpartition(order, last)[: last + 1] for order in orders]))


def principal_stretches(F: Array) -> Array:
    """Return the sorted principal stretches (n, 3) of deformation gradients (n, 3, 3), equal ones to half the
    digits."""
    f = np.ascontiguousarray(F.reshape(-1, 9).T)
    pairs = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
    squares = _eigenvalues(*(f[i] * f[j] + f[3 + i] * f[3 + j] + f[6 + i] * f[6 + j] for i, j in pairs))
    return np.asarray(np.sqrt(np.maximum(squares, 0.0)))


def principal_values(tensors: Array) -> Array:
    """Return the sorted eigenvalues (n, 3) of symmetric tensors (n, 3, 3), equal ones to half the digits."""
    t = np.ascontiguousarray(tensors.reshape(-1, 9).T)
    return _eigenvalues(t[0], t[4], t[8], t[5], t[2], t[1])


def _eigenvalues(xx: Array, yy: Array, zz: Array, yz: Array, xz: Array, xy: Array) -> Array:
    """Return the sorted eigenvalues (n, 3) of symmetric tensors of given entries.

    In closed form (Smith, Commun ACM 4, 1961), which takes a tenth of the time of an eigenvalue solver.
    """
    mean = (xx + yy + zz) / 3
    xx, yy, zz = xx - mean, yy - mean, zz - mean
    spread = np.sqrt((xx**2 + yy**2 + zz**2 + 2 * (yz**2 + xz**2 + xy**2)) / 6)
    determinant = xx * (yy * zz - yz**2) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz)
    tiny: float = np.finfo(spread.dtype).tiny ** 0.25
    cosine = determinant / (2 * np.maximum(spread, tiny) ** 3)
    angle = np.arccos(np.clip(cosine, -1.0, 1.0)) / 3
    largest, smallest = (mean + 2 * spread * np.cos(angle + turn) for turn in (0.0, 2 * np.pi / 3))
    return np.stack([smallest, 3 * mean - largest - smallest, largest], axis=1)


@cache
def _stretches_as_points() -> Any:
    """Return a mesh whose points are triples of principal stretches: laws are evaluated at points of meshes."""
    return MakeStructured3DMesh(
        hexes=True, nx=1, ny=1, nz=1, mapping=lambda x, y, z: (LARGEST * x, LARGEST * y, LARGEST * z)
    )
