"""Muscle by shear along and across its fibres, and their stretch."""

from __future__ import annotations

from math import exp as number_exp
from typing import Any, ClassVar, Literal

from ngsolve import IfPos, exp, sqrt
from pydantic import Field

from ngfsi.materials.solid.fibres import FibreLaw, Stretch
from ngfsi.materials.solid.spectral import squared_artanh
from ngfsi.units import Pressure


class Blemker(FibreLaw):
    """W = G1 B1^2 + G2 B2^2 + W3(l), passive: shear along the fibres, shear across them, and their stretch l.

    B1^2 = I5/I4^2 - 1, cosh B2 = (I1 I4 - I5)/(2 sqrt(I4)). With x = l / l_o the fibres' l_o W3' / s is 0 below
    x = 1, P1 (exp(P2 (x - 1)) - 1) up to x*, and straight from there on.
    """

    formula: ClassVar[str] = (
        r"W = G_1 B_1^2 + G_2 B_2^2 + W_3(\bar\lambda) + \tfrac{K}{2}\left[\tfrac12(J^2 - 1) - \ln J\right]"
    )
    source: ClassVar[str] = (
        "S. S. Blemker, P. M. Pinsky, S. L. Delp, J Biomech 38 (2005) 657, without its active part; "
        "J. C. Criscione et al., J Mech Phys Solids 49 (2001) 871"
    )

    law: Literal["blemker"] = "blemker"
    G1: Pressure = Field(gt=0)
    """Modulus of shear along the fibres."""
    G2: Pressure = Field(gt=0)
    """Modulus of shear across the fibres."""
    P1: float = Field(ge=0)
    """Scale of the stress of stretched fibres."""
    P2: float = Field(gt=0)
    """Rate of its exponential growth."""
    peak_stress: Pressure = Field(ge=0)
    """s: largest isometric stress, to which that of passive fibres is related."""
    straight_stretch: float = Field(gt=1)
    """x*: from which on the fibres are straight."""
    optimal_stretch: float = Field(default=1.0, gt=0)
    """l_o: of the fibres at which the muscle is strongest; below 1 they pull in the shape that the case calls free."""

    def distortion(self, stretch: Stretch) -> Any:
        I1, I4, I5 = stretch.I1, stretch.I4[0], stretch.I5[0]
        cosh = (I1 * I4 - I5) / (2 * sqrt(I4))
        along, across = I5 / I4**2 - 1, squared_artanh((cosh - 1) / (cosh + 1))
        return self.G1 * along + self.G2 * across + self.peak_stress * self._stretched(sqrt(I4) / self.optimal_stretch)

    def _stretched(self, x: Any) -> Any:
        """Return W3 / s at l / l_o, whose derivative is continuous."""
        P1, P2, end = self.P1, self.P2, self.straight_stretch
        curved = P1 * ((exp(P2 * (x - 1)) - 1) / P2 - (x - 1))
        grown = number_exp(P2 * (end - 1))
        at_end = P1 * ((grown - 1) / P2 - (end - 1))
        straight = at_end + P1 * (grown - 1) * (x - end) + P1 * P2 * grown * (x - end) ** 2 / 2
        return IfPos(x - end, straight, IfPos(x - 1, curved, 0.0))
