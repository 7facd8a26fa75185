"""Hencky solid: linear elasticity in the logarithmic strain."""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np
from ngsolve import CoefficientFunction, Det, Id, InnerProduct, Inv, log

from ngfsi.materials.solid.law import Pair, right_cauchy_green
from ngfsi.materials.solid.linear import LinearAtRest

POINTS = 20
"""Gauss points of the logarithm; even, since they are used in pairs +-t."""


class Hencky(LinearAtRest):
    """W = mu |dev ln U|^2 + K/2 (ln J)^2 with the right stretch U = sqrt(C).

    dev ln U is half the logarithm of the isochoric C. See `logarithm` for its accuracy.
    """

    formula: ClassVar[str] = r"W = \mu\,\|\mathrm{dev}\ln U\|^2 + \tfrac{K}{2}(\ln J)^2"
    source: ClassVar[str] = "H. Hencky, Z techn Phys 9 (1928) 215; P. Neff et al., Arch Ration Mech Anal 222 (2016) 507"

    law: Literal["hencky"] = "hencky"

    def energies(self, F: CoefficientFunction) -> Pair:
        J = Det(F)
        strain = logarithm(J ** (-2 / 3) * right_cauchy_green(F)) / 2
        return self.shear_modulus * InnerProduct(strain, strain), self.bulk_modulus / 2 * log(J) ** 2


def logarithm(A: CoefficientFunction) -> CoefficientFunction:
    """Return ln A of a symmetric positive definite A (3x3), differentiable also where eigenvalues coincide.

    With Z = (A - I)(A + I)^-1 the logarithm is the integral of Z (I + t Z)^-1 over -1 < t < 1; Gauss-Legendre points
    taken in pairs +-t turn it into 2 Z sum w (I - t^2 Z^2)^-1, a rational function (the diagonal Pade approximant
    at I). For an eigenvalue a of A the error falls like ((sqrt(a) - 1)/(sqrt(a) + 1))^(2 POINTS): below 1e-13 for the
    eigenvalues 0.157 ... 6.35 that stretches between 0.5 and 2 can give, below 1e-5 for 0.03 ... 33.
    """
    t, w = np.polynomial.legendre.leggauss(POINTS)
    identity = Id(3)
    Z = (A - identity) * Inv(A + identity)
    Y = Z * Z
    terms = [2 * wi * Inv(identity - ti**2 * Y) for ti, wi in zip(t.tolist(), w.tolist(), strict=True) if ti > 0]
    return Z * sum(terms[1:], start=terms[0])
