"""Thick-walled cylinders in plane strain under pressure, by the radial equilibrium: no finite elements.

With r(R) the deformed radius, the stretches are l_r = r', l_t = r/R, l_z = 1, and the first Piola-Kirchhoff stresses
P_i = dW/dl_i of the energy in principal stretches, written out here law by law. Equilibrium is dP_r/dR = (P_t - P_r)/R;
a pressure p acts as P_r = -p r/R. The two-point boundary value problem is solved by scipy's collocation.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_bvp

from ngfsi.materials import CompressibleNeoHookean, MooneyRivlin, NeoHookean, SaintVenantKirchhoff, SolidLaw
from ngfsi.verify import VerificationError

Array = NDArray[np.float64]
Stress = Callable[[Array], Array]
"""Principal stresses P_i of the principal stretches l_i, both of shape (3, n)."""
LOAD_FACTORS = (0.25, 0.5, 0.75, 1.0)
"""Of the pressures, in turn: collocation starts from the solution before."""
TOLERANCE = 1e-9
"""Of the relative residuals."""


def stress_of(law: SolidLaw) -> Stress:
    """Return the principal stresses of a law."""
    return FORMULAS[type(law)](law)


def _mooney_rivlin(law: MooneyRivlin) -> Stress:
    def stress(stretch: Array) -> Array:
        J, I1, I2, slope1, slope2 = _isochoric(stretch)
        by_I1 = law.c10 + law.c11 * (I2 - 3)
        by_I2 = law.c01 + law.c11 * (I1 - 3)
        return by_I1 * slope1 + by_I2 * slope2 + law.K * (J - 1) * J / stretch

    return stress


def _neo_hookean(law: NeoHookean) -> Stress:
    k = law.Kv / 2 if law.volumetric == "K=Kv" else law.Kv

    def stress(stretch: Array) -> Array:
        J, _, _, slope1, _ = _isochoric(stretch)
        return law.C10 * slope1 + k * (J * J - 1) / stretch

    return stress


def _compressible_neo_hookean(law: CompressibleNeoHookean) -> Stress:
    lam, mu = _lame(law.young, law.poisson)
    return lambda stretch: mu * (stretch - 1 / stretch) + lam * np.log(np.prod(stretch, axis=0)) / stretch


def _saint_venant_kirchhoff(law: SaintVenantKirchhoff) -> Stress:
    lam, mu = _lame(law.young, law.poisson)

    def stress(stretch: Array) -> Array:
        strain = (stretch**2 - 1) / 2
        return np.asarray(stretch * (lam * np.sum(strain, axis=0) + 2 * mu * strain))

    return stress


def _isochoric(stretch: Array) -> tuple[Array, Array, Array, Array, Array]:
    """J, the isochoric invariants, and their derivatives by the stretches."""
    J, squares = np.prod(stretch, axis=0), stretch**2
    I1 = np.sum(squares, axis=0)
    I2 = (I1**2 - np.sum(squares**2, axis=0)) / 2
    slope1 = J ** (-2 / 3) * (2 * stretch - 2 * I1 / (3 * stretch))
    slope2 = J ** (-4 / 3) * (2 * stretch * (I1 - squares) - 4 * I2 / (3 * stretch))
    return J, J ** (-2 / 3) * I1, J ** (-4 / 3) * I2, slope1, slope2


def _lame(young: float, poisson: float) -> tuple[float, float]:
    return young * poisson / ((1 + poisson) * (1 - 2 * poisson)), young / (2 * (1 + poisson))


FORMULAS: dict[type[SolidLaw], Callable[..., Stress]] = {
    MooneyRivlin: _mooney_rivlin,
    NeoHookean: _neo_hookean,
    CompressibleNeoHookean: _compressible_neo_hookean,
    SaintVenantKirchhoff: _saint_venant_kirchhoff,
}


@dataclass(frozen=True)
class Layer:
    """A ring of one law, up to its outer radius (m)."""

    law: SolidLaw
    outer: float


def inner_displacement(inner: float, layers: Sequence[Layer], inside: float, outside: float = 0.0) -> float:
    """Return the radial displacement (m) of the inner face under pressures (Pa) inside and outside."""
    begins = np.array([inner, *(layer.outer for layer in layers[:-1])])
    widths = np.array([layer.outer for layer in layers]) - begins
    stresses = [stress_of(layer.law) for layer in layers]
    scale = max(abs(inside), abs(outside))

    def slope(s: Array, y: Array) -> Array:
        """Of r / inner and P / scale in each layer, over the fraction s of its thickness."""
        slopes = []
        for stress, begin, width, r, P in zip(stresses, begins, widths, y[::2], y[1::2], strict=True):
            along, slope_of_P = _equilibrium(stress, begin + s * width, inner * r, scale * P)
            slopes += [width * along / inner, width * slope_of_P / scale]
        return np.array(slopes)

    def surplus(load_factor: float) -> Callable[[Array, Array], Array]:
        def of_ends(first: Array, last: Array) -> Array:
            pressed_inside = first[1] + load_factor * inside / scale * first[0]
            pressed_outside = last[-1] + load_factor * outside / scale * last[-2] * inner / layers[-1].outer
            return np.array([pressed_inside, pressed_outside, *(first[2:] - last[:-2])])

        return of_ends

    s = np.linspace(0, 1, 21)
    at_rest = [((begin + s * width) / inner, np.zeros_like(s)) for begin, width in zip(begins, widths, strict=True)]
    y = np.vstack([row for rows in at_rest for row in rows])
    for load_factor in LOAD_FACTORS:
        s, y = _solved(slope, surplus(load_factor), s, y)
    return float(inner * (y[0, 0] - 1))


def stress_free_radius(law: SolidLaw, inner: float, outer: float, inside: float) -> float:
    """Return the inner radius (m) of the unloaded ring of one law that a pressure inflates to the given radii."""
    stress = stress_of(law)

    def slope(r: Array, y: Array) -> Array:
        """Of R / inner and P / inside, over the deformed radius."""
        along, slope_of_P = _equilibrium(stress, inner * y[0], r, inside * y[1])
        return np.array([1 / along / inner, slope_of_P / along / inside])

    r = np.linspace(inner, outer, 21)
    y = np.vstack([r / inner, np.zeros_like(r)])
    for load_factor in LOAD_FACTORS:

        def surplus(first: Array, last: Array, load_factor: float = load_factor) -> Array:
            return np.array([first[1] + load_factor / first[0], last[1]])

        r, y = _solved(slope, surplus, r, y)
    return float(inner * y[0, 0])


def _solved(slope: Any, surplus: Any, x: Array, y: Array) -> tuple[Array, Array]:
    """Return nodes and values of the solution of a boundary value problem near y(x)."""
    result = solve_bvp(slope, surplus, x, y, tol=TOLERANCE, max_nodes=20_000)
    if not result.success:
        raise VerificationError(f"the radial equilibrium was not solved: {result.message}")
    return result.x, result.y


def _equilibrium(stress: Stress, R: Array, r: Array, P: Array) -> tuple[Array, Array]:
    """Return dr/dR, the radial stretch that carries the radial stress P, and dP/dR.

    The stretch is found by Newton's method from no change of volume.
    """
    around, axial = r / R, np.ones_like(r)
    along = 1 / around

    def radial(stretch: Array) -> Array:
        return np.asarray(stress(np.array([stretch, around, axial]))[0])

    for _ in range(50):
        h = 1e-6 * along
        change = (radial(along) - P) * 2 * h / (radial(along + h) - radial(along - h))
        along = along - change
        if np.all(np.abs(change) < 1e-13 * along):
            return along, (stress(np.array([along, around, axial]))[1] - P) / R
    raise VerificationError("no radial stretch carries the radial stress")


def lame(inner: float, outer: float, young: float, poisson: float, inside: float, outside: float) -> float:
    """Displacement (m) of the inner face of a linear elastic cylinder in plane strain (Lame 1852)."""
    squares = outer**2 - inner**2
    even = (inside * inner**2 - outside * outer**2) / squares
    odd = (inside - outside) * inner**2 * outer**2 / squares
    return float((1 + poisson) / young * ((1 - 2 * poisson) * even * inner + odd / inner))
