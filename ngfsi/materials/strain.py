"""Strain measures that several laws share, as NGSolve expressions of the deformation gradient F (3x3)."""

from __future__ import annotations

from ngsolve import CoefficientFunction, Det, InnerProduct, Trace


def right_cauchy_green(F: CoefficientFunction) -> CoefficientFunction:
    """Return C = F^T F (3x3)."""
    return F.trans * F


def isochoric_invariants(F: CoefficientFunction) -> tuple[CoefficientFunction, CoefficientFunction]:
    """Return I1 and I2 of the volume-preserving part J^(-1/3) F: both are 3 at rest and blind to dilation."""
    C = right_cauchy_green(F)
    J = Det(F)
    I1 = Trace(C)
    I2 = (I1 * I1 - InnerProduct(C, C)) / 2
    return J ** (-2 / 3) * I1, J ** (-4 / 3) * I2
