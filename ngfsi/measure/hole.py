"""Measures of a hole through solids in 3-D, in which there is a pressure instead of blood."""

from __future__ import annotations

from typing import Any

import ngsolve as ng
import numpy as np

from ngfsi.conditions.supports import ALIGNED
from ngfsi.mesh.domain import Domain
from ngfsi.mesh.geometry import Vessel
from ngfsi.physics.kinematics import Kinematics
from ngfsi.system.system import System

IN_PLANE = ("roller", "clamped")
"""Ends that stay in their plane."""


class Hole:
    """A hole between ends that stay in parallel planes, or closed within the solids.

    Attributes:
        length: between the planes of the ends (m).
    """

    def __init__(self, system: System, vessel: Vessel) -> None:
        domain, self.vessel, self._system = system.domain, vessel, system
        axis = domain.mean_normal(domain.ends[0])
        heights = [float(domain.centroid(name) @ axis) for name in domain.ends]
        self.length = max(heights) - min(heights)
        # the part of x across the axis has the divergence 2 and no flux through the ends
        across, n = ng.CF((ng.x, ng.y, ng.z)) + system.motion, ng.CF(tuple(axis))
        across -= ng.InnerProduct(across, n) * n
        area = Kinematics(ng.Grad(system.motion)).cof * domain.outer_normal()
        over = domain.ds(vessel.interface, bonus_intorder=2 * system.unknowns.order)
        self._inwards = -ng.InnerProduct(across, area) / 2 * over

    @classmethod
    def all_of(cls, system: System) -> dict[str, Hole]:
        """Return the holes of a system by vessel, those whose volume its surface tells."""
        domain, ends = system.domain, system.case.conditions.ends
        if domain.mesh.dim == 2 or ends not in IN_PLANE or not domain.ends:
            return {}
        normals = [domain.mean_normal(name) for name in domain.ends]
        if any(abs(abs(normal @ normals[0]) - 1) > ALIGNED for normal in normals):
            return {}
        found = {vessel.name: vessel for vessel in domain.vessels if vessel.lumen is None}
        return {name: cls(system, vessel) for name, vessel in found.items() if _opens_at_ends(domain, vessel)}

    def volume(self) -> float:
        """Return the deformed volume (m3)."""
        return float(ng.Integrate(self._inwards, self._system.domain.mesh))

    def pressure(self) -> float:
        """Return the pressure in it (Pa)."""
        condition: Any = self._system.conditions[f"in {self.vessel.interface}"]
        return float(condition.value.Get())


def _opens_at_ends(domain: Domain, vessel: Vessel) -> bool:
    """Whether the surface of a hole meets no boundary but ends."""
    others = set(domain.geometry.boundary_names) - {vessel.interface, *domain.ends}
    mine = domain.vertices_on(vessel.interface)
    return not any(np.intersect1d(mine, domain.vertices_on(name)).size for name in others)
