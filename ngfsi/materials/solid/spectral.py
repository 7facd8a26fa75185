"""Functions of the eigenvalues of a symmetric positive definite A (3x3) of determinant 1, by its invariants alone.

A sum over eigenvalues a of 1/(a + t) is (3 t^2 + 2 t I1 + I2)/(t^3 + t^2 I1 + t I2 + 1), the derivative of
ln det(A + t I): so whatever is a sum of such fractions needs no eigenvalues, whose derivatives jump where two of them
coincide. Gauss points make it such a sum, with errors that fall like ((sqrt(a) - 1)/(sqrt(a) + 1))^(2 POINTS): below
1e-13 for the eigenvalues 0.157 ... 6.35 that stretches between 0.5 and 2 can give, below 1e-5 for 0.03 ... 33.
"""

from __future__ import annotations

from functools import cache
from math import ceil, log2, pi, sin
from typing import Any

import numpy as np

POINTS = 20


def resolvent(I1: Any, I2: Any, t: float) -> Any:
    """Return tr (A + t I)^-1."""
    return (3 * t**2 + 2 * t * I1 + I2) / (t**3 + t**2 * I1 + t * I2 + 1)


def trace_of_power(I1: Any, I2: Any, p: float) -> Any:
    """Return tr A^p.

    For 0 < q < 1, a^q is sin(pi q)/pi int t^(q-1) a/(a + t) dt over all t > 0, by Gauss-Jacobi points of
    (1 - t)/(1 + t); other powers by doubling: tr B^2 = (tr B)^2 - 2 tr B^-1 where det B is 1.
    """
    if p == 0:
        return 3.0 + 0 * I1
    doublings = max(ceil(log2(abs(p))), 0)
    q = abs(p) / 2**doublings
    up, down = (I1, I2) if q == 1 else (_root(I1, I2, q), _root(I2, I1, q))
    for _ in range(doublings):
        up, down = up * up - 2 * down, down * down - 2 * up
    return up if p > 0 else down


def _root(I1: Any, I2: Any, q: float) -> Any:
    """Return tr A^q, 0 < q < 1."""
    from scipy.special import roots_jacobi

    with np.errstate(invalid="ignore"):  # of a coefficient that scipy then replaces, since the exponents add up to -1
        s, w = roots_jacobi(POINTS, q - 1, -q)
    t, factor = (1 - s) / (1 + s), 2 * sin(pi * q) / pi * w / (1 + s)
    terms = [f * (3 - ti * resolvent(I1, I2, ti)) for f, ti in zip(factor.tolist(), t.tolist(), strict=True)]
    return sum(terms[1:], start=terms[0])


def trace_of_squared_logarithm(I1: Any, I2: Any) -> Any:
    """Return tr (ln A)^2, whose (ln a)^2 is `squared_artanh` of y = ((a - 1)/(a + 1))^2."""
    terms = []
    for v, w in _points():
        t = (1 + v**0.5) / (1 - v**0.5)
        inverse = t * resolvent(I1, I2, t) - resolvent(I1, I2, 1 / t) / t  # of a / ((a + t)(a + 1/t)), by its poles
        terms.append(4 * w / (1 - v) * (3 - (t + 1 / t + 2) / (t - 1 / t) * inverse))
    return sum(terms[1:], start=terms[0])


def squared_artanh(y: Any) -> Any:
    """Return (2 artanh sqrt(y))^2 = 4 y int artanh(sqrt(v))/(1 - v y) dv over 0 < v < 1, which has no root at y = 0."""
    terms = [w / (1 - v * y) for v, w in _points()]
    return 4 * y * sum(terms[1:], start=terms[0])


@cache
def _points() -> tuple[tuple[float, float], ...]:
    """Return Gauss points and weights for the weight artanh(sqrt(v)) on 0 < v < 1, by Lanczos on a fine rule."""
    s, w = np.polynomial.legendre.leggauss(400)
    s, w = (s + 1) / 2, w / 2
    r = 1 - s**4  # the root of v; gathers points where the weight grows without bound
    v, weight = r**2, 2 * r * 4 * s**3 * w * (np.log(1 + r) / 2 - 2 * np.log(s))
    n = POINTS // 2
    diagonal, beside = np.zeros(n), np.zeros(n)
    before, now, size = np.zeros_like(v), np.ones_like(v), 1.0
    total = float(np.sum(weight))
    for k in range(n):
        norm = float(np.sum(weight * now**2))
        beside[k] = norm / size if k else 0.0
        diagonal[k], size = float(np.sum(weight * v * now**2)) / norm, norm
        before, now = now, (v - diagonal[k]) * now - beside[k] * before
    root = np.sqrt(beside[1:])
    values, vectors = np.linalg.eigh(np.diag(diagonal) + np.diag(root, 1) + np.diag(root, -1))
    return tuple(zip(values.tolist(), (total * vectors[0] ** 2).tolist(), strict=True))
