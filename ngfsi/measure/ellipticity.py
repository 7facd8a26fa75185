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
    """Resistance of an isotropic law to shear bands; directions n in the planes of two principal axes are tried.

    All moduli follow from the first and second derivatives of the energy by the principal stretches (Ogden, section
    6.1.4); the second ones are differences of the first.
    """

    def __init__(self, law: SolidLaw) -> None:
        self._beyond = [ng.Parameter(0.0) for _ in range(3)]
        x, y, z = (at + beyond for at, beyond in zip((ng.x, ng.y, ng.z), self._beyond, strict=True))
        here = ng.CF((x, 0, 0, 0, y, 0, 0, 0, z), dims=(3, 3))
        axes = (ng.CF(tuple(np.diag(one).ravel().tolist()), dims=(3, 3)) for one in np.eye(3))
        self._slopes = ng.CF(tuple(law.variation(here, axis) for axis in axes)).Compile()
        self._unit = law.shear_modulus or self._at_rest()

    def _at_rest(self) -> float:
        """Return the smallest eigenvalue of Q without deformation (Pa), for laws without a shear modulus."""
        self._unit = 1.0
        return float(self.smallest(np.ones((1, 3)))[0])

    def smallest(self, stretches: Array) -> Array:
        """Return the smallest eigenvalue of Q over the initial shear modulus, for principal stretches (n, 3): (n,)."""
        stretches = np.clip(stretches, 0.0, LARGEST)
        points = _stretches_as_points()(*stretches.T)
        first = self._at(points, np.zeros(3))
        second = np.stack([(self._at(points, step) - self._at(points, -step)) / (2 * DIFFERENCE)
                           for step in DIFFERENCE * np.eye(3)], axis=2)  # fmt: skip
        same, mixed = _shear_moduli(stretches, first, second)
        found = [_in_direction(second, same, mixed, plane, angle) for plane, angle in product(PLANES, ANGLES)]
        return np.asarray(np.min(found, axis=0)) / self._unit

    def _at(self, points: Any, beyond: Array) -> Array:
        """Return the derivatives (n, 3) of the energy by the principal stretches, at a distance from the points."""
        for parameter, value in zip(self._beyond, beyond.tolist(), strict=True):
            parameter.Set(value)
        return np.asarray(self._slopes(points)).reshape(-1, 3)


def _shear_moduli(stretches: Array, first: Array, second: Array) -> tuple[Array, Array]:
    """Return the moduli A_ijij and A_ijji (n, 3, 3) of an energy with these derivatives by the principal stretches; on
    the diagonals nothing."""
    gap = stretches[:, :, None] - stretches[:, None]
    slopes = first[:, :, None] - first[:, None]
    own = np.diagonal(second, axis1=1, axis2=2)
    limit = (own[:, :, None] + own[:, None]) / 2 - second
    close = np.abs(gap) < DIFFERENCE
    turning = np.where(close, limit, slopes / np.where(close, 1.0, gap))
    total = np.maximum(stretches[:, :, None] + stretches[:, None], DIFFERENCE)
    drawing = (first[:, :, None] + first[:, None]) / total
    return (turning + drawing) / 2, (turning - drawing) / 2


def _in_direction(second: Array, same: Array, mixed: Array, plane: tuple[int, int, int], angle: float) -> Array:
    """Return the smallest eigenvalue (n,) of Q(n), n in the plane of the first two axes: two in it, one across."""
    i, j, k = plane
    c, s = np.cos(angle), np.sin(angle)
    first, last = second[:, i, i] * c**2 + same[:, i, j] * s**2, same[:, i, j] * c**2 + second[:, j, j] * s**2
    between, across = (second[:, i, j] + mixed[:, i, j]) * c * s, same[:, k, i] * c**2 + same[:, k, j] * s**2
    return np.asarray(np.minimum(across, (first + last) / 2 - np.hypot((first - last) / 2, between)))


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


def determinants(F: Array) -> Array:
    """Return the determinants (n,) of tensors (n, 3, 3); NumPy's own function takes ten times as long."""
    f = F.reshape(-1, 9).T
    found: Array = f[0] * (f[4] * f[8] - f[5] * f[7]) - f[1] * (f[3] * f[8] - f[5] * f[6])
    found += f[2] * (f[3] * f[7] - f[4] * f[6])
    return found


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
