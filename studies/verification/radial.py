"""Thick-walled cylinders in plane strain under pressure, by quadrature of the radial equilibrium: no finite elements.

With r(R) the deformed radius, the stretches are l_r = r', l_t = r/R, l_z = 1, and the first Piola-Kirchhoff stresses
P_i = dW/dl_i of the energy in principal stretches, written out here law by law. Equilibrium is dP_r/dR = (P_t - P_r)/R;
a pressure p acts as P_r = -p r/R.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from ngfsi.materials import CompressibleNeoHookean, MooneyRivlin, NeoHookean, SaintVenantKirchhoff, SolidLaw

Array = NDArray[np.float64]
Stress = Callable[[Array], Array]
"""Principal stresses P_i of the principal stretches l_i."""


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
    return lambda stretch: mu * (stretch - 1 / stretch) + lam * np.log(np.prod(stretch)) / stretch


def _saint_venant_kirchhoff(law: SaintVenantKirchhoff) -> Stress:
    lam, mu = _lame(law.young, law.poisson)

    def stress(stretch: Array) -> Array:
        strain = (stretch**2 - 1) / 2
        return stretch * (lam * np.sum(strain) + 2 * mu * strain)

    return stress


def _isochoric(stretch: Array) -> tuple[float, float, float, Array, Array]:
    """J, the isochoric invariants, and their derivatives by the stretches."""
    J, squares = float(np.prod(stretch)), stretch**2
    I1 = float(np.sum(squares))
    I2 = float((I1**2 - np.sum(squares**2)) / 2)
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


def inner_displacement(inner: float, layers: list[Layer], inside: float, outside: float = 0.0) -> float:
    """Return the radial displacement (m) of the inner face under pressures (Pa) inside and outside, by shooting."""

    def surplus(deformed: float) -> float:
        r, P, start = deformed, -inside * deformed / inner, inner
        for layer in layers:
            r, P = _march(stress_of(layer.law), start, layer.outer, r, P)
            start = layer.outer
        return P + outside * r / start

    low, high = _bracket(surplus, inner)
    return float(brentq(surplus, low, high, xtol=1e-15, rtol=1e-13)) - inner


def stress_free_radius(law: SolidLaw, inner: float, outer: float, inside: float) -> float:
    """Return the inner radius (m) of the unloaded ring of one law that a pressure inside inflates to the given one."""

    def end(free: float) -> float:
        P = -inside * inner / free
        return _march(stress_of(law), free, np.inf, inner, P, until=outer)[1]

    return float(brentq(end, 0.7 * inner, inner, xtol=1e-15, rtol=1e-12))


def _march(stress: Stress, start: float, end: float, r: float, P: float, until: float = np.inf) -> tuple[float, float]:
    """Carry deformed radius and radial stress through a ring, to a reference radius or until a deformed one."""

    def slope(R: float, y: Array) -> list[float]:
        around = y[0] / R
        along = _radial_stretch(stress, around, y[1])
        return [along, (stress(np.array([along, around, 1.0]))[1] - y[1]) / R]

    def arrived(_R: float, y: Array) -> float:
        return float(y[0] - until)

    arrived.terminal = True  # type: ignore[attr-defined]
    finite = {"t_span": (start, min(end, 3 * until)), "events": arrived if np.isfinite(until) else None}
    result = solve_ivp(slope, y0=[r, P], rtol=1e-9, atol=[1e-14, 1e-8], **finite)
    return float(result.y[0, -1]), float(result.y[1, -1])


def _radial_stretch(stress: Stress, around: float, P: float) -> float:
    """The radial stretch at which a ring element carries the radial stress P, by Newton from no change of volume."""
    along = 1 / around
    for _ in range(50):
        value = stress(np.array([along, around, 1.0]))[0] - P
        h = 1e-6 * along
        tangent = (stress(np.array([along + h, around, 1.0]))[0] - stress(np.array([along - h, around, 1.0]))[0]) / (
            2 * h
        )
        change = value / tangent
        along -= change
        if abs(change) < 1e-13 * along:
            return float(along)
    raise ValueError(f"no radial stretch carries {P} Pa at a hoop stretch of {around}")


def _bracket(f: Callable[[float], float], inner: float) -> tuple[float, float]:
    """Deformed inner radii around the solution, found from the rest state outwards."""
    at_rest = f(inner)
    step = 1e-4 * inner * (1 if at_rest < 0 else -1)
    near = inner
    for _ in range(60):
        far = near + step
        if f(far) * at_rest <= 0:
            return min(near, far), max(near, far)
        near, step = far, 1.5 * step
    raise ValueError("no deformed radius found")


def lame(inner: float, outer: float, young: float, poisson: float, inside: float, outside: float) -> float:
    """Displacement (m) of the inner face of a linear elastic cylinder in plane strain (Lame 1852)."""
    squares = outer**2 - inner**2
    even = (inside * inner**2 - outside * outer**2) / squares
    odd = (inside - outside) * inner**2 * outer**2 / squares
    return float((1 + poisson) / young * ((1 - 2 * poisson) * even * inner + odd / inner))
