"""The girth of a limb along z, as a smooth function of the height."""

from __future__ import annotations

from typing import Any

import ngsolve as ng
import numpy as np
from numpy.polynomial import legendre

from ngfsi.mesh.domain import Domain

DEGREE = 6
"""Of the polynomial in z: a calf between ankle and knee bulges once."""
EXTRA_ORDER = 8
"""Integration order beyond that of the elements."""


class Girth:
    """Perimeter of a surface around the z-axis (m), a polynomial in z.

    The integral of f(z) times the perimeter over z is that of f sqrt(1 - n_z^2) over the surface (coarea formula). So
    its Legendre coefficients are integrals, and no cuts are made; a cone's are exact but for its mesh.
    """

    def __init__(self, domain: Domain, boundary: str) -> None:
        heights = domain.vertices[domain.vertices_on(boundary)][:, 2]
        self._middle, self._half = float(heights.max() + heights.min()) / 2, float(np.ptp(heights)) / 2
        along, over = ng.specialcf.normal(3)[2], domain.ds(boundary, bonus_intorder=EXTRA_ORDER)
        steep = ng.sqrt(1 - along * along)
        moments = [ng.Integrate(self._legendre(ng.z, k) * steep * over, domain.mesh) for k in range(DEGREE + 1)]
        self._coefficients = np.array([(2 * k + 1) / (2 * self._half) * one for k, one in enumerate(moments)])

    def at(self, z: Any) -> Any:
        """Return the perimeter (m) at a height, a number, an array or a coefficient function (m)."""
        return sum(c * self._legendre(z, k) for k, c in enumerate(self._coefficients))

    def _legendre(self, z: Any, degree: int) -> Any:
        s = (z - self._middle) / self._half
        value = s * 0
        for power in legendre.leg2poly([0] * degree + [1])[::-1]:
            value = value * s + float(power)
        return value
