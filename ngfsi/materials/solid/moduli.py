"""Relations between the constants of isotropic linear elasticity (any textbook, e.g. Landau & Lifshitz, vol. 7, §5)."""

from __future__ import annotations


def young(shear: float, bulk: float) -> float:
    """Return Young's modulus (Pa) from the shear and bulk modulus (Pa)."""
    return 9 * bulk * shear / (3 * bulk + shear)


def poisson(shear: float, bulk: float) -> float:
    """Return the Poisson ratio from the shear and bulk modulus (Pa)."""
    return (3 * bulk - 2 * shear) / (2 * (3 * bulk + shear))


def shear(young: float, poisson: float) -> float:
    """Return the shear modulus (Pa), Lame's mu, from Young's modulus (Pa) and the Poisson ratio."""
    return young / (2 * (1 + poisson))


def bulk(young: float, poisson: float) -> float:
    """Return the bulk modulus (Pa) from Young's modulus (Pa) and the Poisson ratio."""
    return young / (3 * (1 - 2 * poisson))


def lame(young: float, poisson: float) -> float:
    """Return Lame's first constant lambda (Pa) from Young's modulus (Pa) and the Poisson ratio."""
    return young * poisson / ((1 + poisson) * (1 - 2 * poisson))
