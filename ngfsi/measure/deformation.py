"""How far a system's elements are moved and deformed, at their quadrature points."""

from __future__ import annotations

import ngsolve as ng
import numpy as np

from ngfsi.physics.kinematics import Kinematics
from ngfsi.solve.system import System

SHAPES = (ng.TRIG, ng.QUAD, ng.TET, ng.PRISM, ng.HEX, ng.PYRAMID)


class Deformation:
    """Displacement and volume ratio det F of a system's present state."""

    def __init__(self, system: System) -> None:
        domain, motion = system.domain, system.state.components[0]
        self._solids = domain.geometry.solids
        self._size, self._J = ng.Norm(motion), Kinematics(ng.Grad(motion)).J
        rules = {shape: ng.IntegrationRule(shape, 2 * system.unknowns.order) for shape in SHAPES}
        self._points = {name: domain.mesh.MapToAllElements(rules, domain.materials(name)) for name in domain.regions}

    def smallest_jacobian(self, region: str) -> float:
        """Return the smallest det F of a region."""
        return float(np.min(self._J(self._points[region])))

    def largest_displacement(self) -> float:
        """Return the largest displacement (m) of the solids."""
        return max(float(np.max(self._size(self._points[name]))) for name in self._solids)

    def inversion(self) -> str:
        """Say in which region an element is turned inside out, or nothing."""
        for region in self._points:
            smallest = self.smallest_jacobian(region)
            if not smallest > 0:
                return f"elements of region '{region}' are turned inside out (smallest det F {smallest:.3g})"
        return ""
