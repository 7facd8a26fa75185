"""Muscle by a polynomial of the first invariant and the stretch of its fibres."""

from __future__ import annotations

from typing import Any, ClassVar, Literal

from ngsolve import sqrt
from pydantic import Field

from ngfsi.materials.solid.fibres import FibreLaw, Stretch
from ngfsi.units import Pressure


class HumphreyYin(FibreLaw):
    """W = c1 (l - 1)^2 + c2 (l - 1)^3 + c3 (I1 - 3) + c4 (I1 - 3)(l - 1) + c5 (I1 - 3)^2 with the fibres' stretch l."""

    formula: ClassVar[str] = (
        r"W = c_1(\bar\lambda - 1)^2 + c_2(\bar\lambda - 1)^3 + c_3(\bar I_1 - 3) + c_4(\bar I_1 - 3)(\bar\lambda - 1)"
        r" + c_5(\bar I_1 - 3)^2 + \tfrac{K}{2}\left[\tfrac12(J^2 - 1) - \ln J\right]"
    )
    source: ClassVar[str] = "J. D. Humphrey, R. K. Strumpf, F. C. P. Yin, J Biomech Eng 112 (1990) 333 and 340"

    law: Literal["humphrey_yin"] = "humphrey_yin"
    c1: Pressure = Field(ge=0)
    """Factor of (stretch - 1)^2."""
    c2: Pressure
    """Factor of (stretch - 1)^3."""
    c3: Pressure = Field(gt=0)
    """Factor of I1 - 3."""
    c4: Pressure
    """Factor of (I1 - 3)(stretch - 1)."""
    c5: Pressure
    """Factor of (I1 - 3)^2."""

    def distortion(self, stretch: Stretch) -> Any:
        I1, fibre = stretch.I1 - 3, sqrt(stretch.I4[0]) - 1
        return (
            self.c1 * fibre**2 + self.c2 * fibre**3 + self.c3 * I1 + self.c4 * I1 * fibre + self.c5 * I1**2
        )  # fmt: skip
