"""Kinematics of a motion x = X + m(X) from the reference shape.

Each quantity is one expression however often it is asked for, since NGSolve evaluates equal expressions again.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

from ngsolve import CF, Cof, Det, Id

ACROSS = CF((1, 0, 0, 1, 0, 0), dims=(3, 2))
ALONG = CF((0, 0, 0, 0, 0, 0, 0, 0, 1), dims=(3, 3))


@dataclass(frozen=True)
class Kinematics:
    """Deformation gradient and what follows from it.

    Attributes:
        gradient: grad m, 3x3 in 3-D and 2x2 in the plane, of the displacement with respect to the reference shape.
            On a boundary the surface gradient serves for `cof`, since cof(F) N only depends on tangential derivatives.
    """

    gradient: Any

    @cached_property
    def F(self) -> Any:
        """Deformation gradient I + grad m."""
        return Id(self.gradient.dims[0]) + self.gradient

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


def in_3d(gradient: Any, stretch: Any) -> Any:
    """Return a tensor of the plane as one of space, with a stretch across the plane; those of space as they are.

    Plane strain is a deformation gradient with the stretch 1, and variations of it with 0; plane stress has a stretch
    that is an unknown, and its variation.
    """
    if gradient.dims[0] == 3:
        return gradient
    return ACROSS * gradient * ACROSS.trans + stretch * ALONG
