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
        self._displacement, self._relaxation = system.state.components[0], system.relaxation
        self._copies = {name: ng.GridFunction(space) for name in ("displacement", "relaxation")}
        gradients = {name: ng.BoundaryFromVolumeCF(ng.Grad(copy)) for name, copy in self._copies.items()}
        self.motion = Kinematics(gradients["displacement"])
        self.strain: Any = self.motion.F
        if self._relaxation is not None:
            self.strain = self.motion.F * Inv(Kinematics(gradients["relaxation"]).F)

    def refresh(self) -> None:
        """Take the system's present state."""
        self._copy(self._displacement, self._copies["displacement"])
        if self._relaxation is not None:
            self._copy(self._relaxation, self._copies["relaxation"])

    def _copy(self, field: Any, copy: Any) -> None:
        copy.vec.FV().NumPy()[self._there] = field.vec.FV().NumPy()[self._numbers]
