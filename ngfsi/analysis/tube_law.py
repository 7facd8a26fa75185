"""Tube laws: area of a vein's lumen over the transmural pressure, p - p_e = T(A), fitted to what was measured.

`ratio` of the area to `area` A0 is written a. Each law has a stiffness K (Pa):

linear          constant compliance, T = K (a - 1)
elastic ring    a thin linearly elastic wall, T = K (sqrt(a) - 1)
                (Sherwin, Franke, Peiro and Parker, J Eng Math 47 (2003) 217)
collapsible     T = K (a^10 - a^(-3/2)): similarity of collapsed shapes below A0, stiff above (Shapiro, J Biomech Eng 99
                (1977) 126; exponents of Brook, Falle and Pedley, J Fluid Mech 396 (1999) 223)
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.optimize import elementwise, least_squares

from ngfsi.arrays import Array
from ngfsi.errors import SolverError

Function = Callable[[Array], Array]

LAWS: Mapping[str, tuple[Function, Function]] = {
    "linear": (lambda a: a - 1, np.ones_like),
    "elastic ring": (lambda a: np.sqrt(a) - 1, lambda a: 0.5 / np.sqrt(a)),
    "collapsible": (lambda a: a**10 - a**-1.5, lambda a: 10 * a**9 + 1.5 * a**-2.5),
}
"""Name -> T / K and its derivative by the ratio a of areas."""
WIDEST = 16.0
"""Ratio of areas up to which, and down to its inverse, a law is inverted."""


@dataclass(frozen=True)
class TubeLaw:
    """A law with its parameters: numbers, or arrays of them along the vein.

    Attributes:
        name: in `LAWS`.
        area: A0, without transmural pressure, m2.
        stiffness: K, Pa.
    """

    name: str
    area: Array
    stiffness: Array

    def pressure(self, area: Array) -> Array:
        """Return the transmural pressure (Pa) at an area (m2)."""
        return np.asarray(self.stiffness * LAWS[self.name][0](area / self.area))

    def slope(self, area: Array) -> Array:
        """Return dT/dA (Pa/m2)."""
        return np.asarray(self.stiffness * LAWS[self.name][1](area / self.area) / self.area)

    def wave_speed(self, area: Array, density: float) -> Array:
        """Return the speed (m/s) of small waves in a fluid at rest, c^2 = A/rho dT/dA."""
        return np.sqrt(area / density * self.slope(area))

    def area_at(self, pressure: Array) -> Array:
        """Return the area (m2) under a transmural pressure (Pa), the inverse of `pressure`.

        Raises:
            SolverError: the law has no such area within a factor of `WIDEST` of A0.
        """
        scaled = np.asarray(pressure / self.stiffness)
        function = LAWS[self.name][0]
        ends = np.full_like(scaled, 1 / WIDEST), np.full_like(scaled, WIDEST)
        found = elementwise.find_root(lambda a, wanted: function(a) - wanted, ends, args=(scaled,))
        if not np.all(found.success):
            worst = float(np.asarray(pressure).ravel()[np.argmin(found.success)])
            raise SolverError(f"the tube law '{self.name}' has no area under a transmural pressure of {worst:.4g} Pa")
        return np.asarray(self.area * found.x)


@dataclass(frozen=True)
class Fit:
    """A law fitted to areas, with root mean square and largest of the gaps of area, relative to the measured."""

    law: TubeLaw
    error: float
    largest: float


def fit(name: str, pressure: Array, area: Array) -> Fit:
    """Fit a law to areas (n,) [m2] under transmural pressures (n,) [Pa] by least squares of relative gaps of area.

    A gap is that of the pressure over A dT/dA: the relative gap of area, to first order.

    Raises:
        SolverError: fewer than three different pressures are given, or the area does not grow with the pressure.
    """
    if len(np.unique(pressure)) < 3:
        raise SolverError(f"a tube law needs three transmural pressures or more, not {len(np.unique(pressure))}")
    slope, _ = np.polyfit(pressure, area, 1)
    if slope <= 0:
        raise SolverError("no tube law: the area does not grow with the transmural pressure")
    middle = float(np.mean(area))

    def law_of(logs: Array) -> TubeLaw:
        return TubeLaw(name, middle * np.exp(logs[0]), middle / slope * np.exp(logs[1]))

    def gaps(logs: Array) -> Array:
        law = law_of(logs)
        return (law.pressure(area) - pressure) / (area * law.slope(area))

    found = law_of(least_squares(gaps, np.zeros(2), xtol=1e-12, ftol=1e-12, gtol=1e-12).x)
    relative = found.area_at(pressure) / area - 1
    return Fit(found, float(np.sqrt(np.mean(relative**2))), float(np.max(np.abs(relative))))
