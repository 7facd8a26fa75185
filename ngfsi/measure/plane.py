"""Measures of a plane section of the calf: enclosed areas, pressure over the outline of the vein, deformed outlines."""

from __future__ import annotations

from typing import Any

import ngsolve as ng
import numpy as np

from ngfsi.arrays import Array
from ngfsi.physics.kinematics import Kinematics
from ngfsi.system.system import System


class PlaneSectionProbe:
    """Measures of the present state of a plane section, whose solids have a skin and lumens as holes."""

    def __init__(self, system: System) -> None:
        self.system, self.domain = system, system.domain
        self._motion = system.motion
        vessels, solids = system.domain.vessels, system.domain.geometry.solids
        self.outlines = tuple(n for n in ("skin", *(v.interface for v in vessels)) if system.domain.has_boundary(n))
        self.outer = vessels[0].outer if vessels else None
        self.sides = {name: name for name in ("tissue", "wall") if self.outer and name in solids}
        self._k = Kinematics(ng.Grad(self._motion))
        self._more = {"bonus_intorder": 2 * system.unknowns.order}

    def region_area(self, *names: str) -> float:
        """Return the deformed area (m2) of regions."""
        return self._integrate(self._k.J * self.domain.dx(*names, **self._more))

    def enclosed_area(self, boundary: str) -> float:
        """Return the area (m2) that a deformed closed boundary encloses: skin, lumen, wall_outer."""
        place = ng.CF((ng.x, ng.y)) + self._motion
        flux = place * (self._k.cof * ng.specialcf.normal(2))
        return abs(self._integrate(flux * self.domain.ds(boundary, skeleton=True, **self._more))) / 2

    def pressure_over(self, boundary: str, region: str) -> float:
        """Return the mean of p = -tr(sigma)/3 (Pa) over a deformed boundary, on the side of a region."""
        face = ng.GridFunction(ng.FacetFESpace(self.domain.mesh, order=0))
        face.Set(1, definedon=self.domain.boundaries(boundary))
        size = face * ng.Norm(self._k.cof * ng.specialcf.normal(2))
        side = self.domain.dx(region, element_boundary=True, **self._more)
        pressure = self.system.hydrostatic_pressure(region)
        return self._integrate(pressure * size * side) / self._integrate(size * side)

    def displacement(self, points: Array) -> Array:
        """Return the displacement (n, 2) [m] at points (n, 2) [m] of the reference shape, inside of the solids."""
        straight = self.domain.on_straight_mesh(points)
        return np.array([self._motion(self.domain.mesh(*point)) for point in straight])

    def moved(self, boundary: str, points: int = 6) -> tuple[Array, Array]:
        """Return points (n, 2) [m] of a closed boundary in order, in the reference and in the deformed shape."""
        ticks = [((k + 0.5) / points,) for k in range(points)]
        rule = ng.IntegrationRule(ticks, [1.0] * points)
        at = self.domain.mesh.MapToAllElements({ng.SEGM: rule}, self.domain.boundaries(boundary))
        place = ng.CF((ng.x, ng.y))
        before = np.asarray(place(at))
        after = before + np.asarray(ng.CF(self._motion)(at))
        centre = before - before.mean(axis=0)
        order = np.argsort(np.arctan2(centre[:, 1], centre[:, 0]))
        return before[order], after[order]

    def _integrate(self, integrals: Any) -> float:
        return float(ng.Integrate(integrals, self.domain.mesh))
