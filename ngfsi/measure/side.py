"""A face between two solids as the boundary of one of them."""

from __future__ import annotations

from typing import Any

import ngsolve as ng
import numpy as np
from ngsolve import Inv

from ngfsi.physics.kinematics import Kinematics
from ngfsi.system.system import System
from ngfsi.system.unknowns import same_functions


class Side:
    """What a solid is subject to at its boundary; `refresh` after each step.

    The displacement lives on both sides of a face between solids, where a boundary value of its gradient would be that
    of either side. It is therefore carried over to a field that exists in the one solid alone, exactly, since that lies
    in the same space there.

    Attributes:
        motion: kinematics of the deformation, as boundary values.
        strain: deformation gradient from the shape that is free of stress, as boundary values: what the law sees.
    """

    def __init__(self, system: System, region: str) -> None:
        """Prepare.

        Args:
            region: the solid.
        """
        space = ng.VectorH1(system.domain.mesh, order=system.unknowns.order, definedon=region)
        here = same_functions(system.domain, space, system.unknowns.space.components[0], region)
        self._there, self._numbers = np.flatnonzero(here >= 0), here[here >= 0]
        fields = [field for field in (system.motion, system.relaxation) if field is not None]
        self._copies = [(field, ng.GridFunction(space)) for field in fields]
        self.motion, *relaxation = (Kinematics(ng.BoundaryFromVolumeCF(ng.Grad(copy))) for _, copy in self._copies)
        self.strain: Any = self.motion.F * Inv(relaxation[0].F) if relaxation else self.motion.F

    def refresh(self) -> None:
        """Take the system's present state."""
        for field, copy in self._copies:
            copy.vec.FV().NumPy()[self._there] = field.vec.FV().NumPy()[self._numbers]
