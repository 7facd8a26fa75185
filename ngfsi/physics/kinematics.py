"""Kinematics of a motion x = X + m(X) from the reference shape."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ngsolve import Cof, Det, Id, Inv


@dataclass(frozen=True)
class Kinematics:
    """Deformation gradient and what follows from it.

    Attributes:
        gradient: grad m, 3x3, of the displacement with respect to the reference shape. On a boundary the surface
            gradient serves for `cof`, since cof(F) N only depends on tangential derivatives.
    """

    gradient: Any

    @property
    def F(self) -> Any:
        """Deformation gradient I + grad m."""
        return Id(3) + self.gradient

    @property
    def J(self) -> Any:
        """Volume ratio det F."""
        return Det(self.F)

    @property
    def inverse(self) -> Any:
        """F^-1."""
        return Inv(self.F)

    @property
    def cof(self) -> Any:
        """Cofactor J F^-T: maps reference area vectors to deformed ones (Nanson)."""
        return Cof(self.F)
