"""Kinematics of a motion x = X + m(X) from the reference shape.

Each quantity is one expression however often it is asked for, since NGSolve evaluates equal expressions again.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

from ngsolve import Cof, Det, Id


@dataclass(frozen=True)
class Kinematics:
    """Deformation gradient and what follows from it.

    Attributes:
        gradient: grad m, 3x3, of the displacement with respect to the reference shape. On a boundary the surface
            gradient serves for `cof`, since cof(F) N only depends on tangential derivatives.
    """

    gradient: Any

    @cached_property
    def F(self) -> Any:
        """Deformation gradient I + grad m."""
        return Id(3) + self.gradient

    @cached_property
    def J(self) -> Any:
        """Volume ratio det F."""
        return Det(self.F)

    @cached_property
    def inverse(self) -> Any:
        """F^-1."""
        return self.cof.trans / self.J

    @cached_property
    def cof(self) -> Any:
        """Cofactor J F^-T: maps reference area vectors to deformed ones (Nanson)."""
        return Cof(self.F)
