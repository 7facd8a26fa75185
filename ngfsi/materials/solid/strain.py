"""Strain measures that several laws share, as NGSolve expressions of the deformation gradient F (3x3)."""

from __future__ import annotations

from typing import NamedTuple

from ngsolve import CoefficientFunction, Det, InnerProduct, Trace


def right_cauchy_green(F: CoefficientFunction) -> CoefficientFunction:
    """Return C = F^T F (3x3)."""
    return F.trans * F


class Invariants(NamedTuple):
    """I1 = tr C, I2 = (I1^2 - C : C)/2 and J = det F."""

    I1: CoefficientFunction
    I2: CoefficientFunction
    J: CoefficientFunction

    @classmethod
    def of(cls, F: CoefficientFunction) -> Invariants:
        """Return those of F, each a variable of its own, so that an energy can be differentiated by them."""
        C = right_cauchy_green(F)
        parts = (Trace(C), (Trace(C) ** 2 - InnerProduct(C, C)) / 2, Det(F))
        return cls(*(part.MakeVariable() for part in parts))

    @property
    def isochoric(self) -> tuple[CoefficientFunction, CoefficientFunction]:
        """I1 and I2 of the volume-preserving part J^(-1/3) F: both are 3 at rest and blind to dilation."""
        return self.J ** (-2 / 3) * self.I1, self.J ** (-4 / 3) * self.I2
