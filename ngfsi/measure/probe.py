"""Probe: all measurements of one state, each computed once."""

from __future__ import annotations

from typing import Any

import ngsolve as ng
from ngsolve import Id, InnerProduct

from ngfsi.measure.deformation import Deformation
from ngfsi.measure.sections import Sections
from ngfsi.measure.side import Side
from ngfsi.measure.transmural import WallLoad
from ngfsi.measure.wall import ShearStatistics, Wall
from ngfsi.mesh.centreline import find_centrelines, vessels_of
from ngfsi.mesh.geometry import Vein
from ngfsi.physics import terms
from ngfsi.physics.kinematics import Kinematics
from ngfsi.system.system import System

INTEGRATE = 5
"""Order of NGSolve's `Integrate` for a sum of integrals."""


class Probe:
    """Measurements of a system's state; `refresh` after each step."""

    def __init__(self, system: System) -> None:
        self.system = system
        self.domain = system.domain
        self.vein: Vein = system.case.geometry
        self.fluid = self.vein.fluid
        vessel = vessels_of(self.vein)[0]
        lines = find_centrelines(self.domain, vessel)
        self.wall = Wall(system, vessel, lines)
        self.sections = Sections(system, vessel, lines[0])
        self.outlines = Sections(system, vessel, lines[0], lines[0].stations(system.case.output.stations))
        self.deformation = Deformation(system)
        self._sides = {name: Side(system, name) for name in system.solids}
        self.load = WallLoad(system, self.sections, self._sides.get("tissue"))
        self.shear = self.consistent_shear = ShearStatistics(0.0, 0.0, 0.0, 0.0)
        self._fields = system.fields(system.state.components)
        self._motion = Kinematics(self._fields.grad_motion)
        self._integrals = self._define()
        self._known: dict[str, float] = {}

    def refresh(self) -> None:
        """Take the system's present state."""
        for side in self._sides.values():
            side.refresh()
        self.wall.refresh()
        self.sections.refresh(self.wall.field)
        self.load.refresh()
        self.shear = self.wall.statistics(self.system.case.output.low_shear)
        self.consistent_shear = self.wall.statistics(method="consistent")
        self._known.clear()

    def integral(self, name: str) -> float:
        """Return a named integral of the present state (see `_define`), SI; computed once per state."""
        if name not in self._known:
            self._known[name] = float(ng.Integrate(self._integrals[name], self.domain.mesh))
        return self._known[name]

    def solid_pressure(self, region: str, side: str = "") -> float:
        """Return the mean of p = -tr(sigma)/3 (Pa) over the deformed region, or over its side of a boundary."""
        what = f"{region}@{side}" if side else region
        return self.integral(f"p*size {what}") / self.integral(f"size {side or region}")

    def _define(self) -> dict[str, Any]:
        dx, ds, fluid = self.domain.dx, self.domain.ds, self.fluid
        k, f = self._motion, self._fields
        order = self.system.unknowns.order
        grad_rate = self.system.new_weight * f.grad_motion + ng.Grad(self.system.velocity_history.components[0])
        normal = ng.specialcf.normal(3)
        surface = Kinematics(f.grad_motion)
        flux = terms.relative_flux(surface, f.relative, normal)
        more = {"bonus_intorder": 2 * order}
        # both are polynomials of at most this order on each element
        exact = 3 * max(order, self.domain.geometry.curving_order) - 1
        whole = {"bonus_intorder": max(exact - INTEGRATE, 0)}
        integrals = {
            "lumen volume": k.J * dx(fluid, **whole),
            "lumen rate": InnerProduct(k.cof, grad_rate) * dx(fluid, **whole),
            "flux inlet": flux * ds("inlet", **more),
            "flux outlet": flux * ds("outlet", **more),
        }
        return integrals | self._pressures()

    def _pressures(self) -> dict[str, Any]:
        """Integrals of the hydrostatic pressure: over the wall, and on both sides of its outer face."""
        grad_d = ng.Grad(self.system.state.components[0])
        k, normal = Kinematics(grad_d), ng.specialcf.normal(3)
        relaxation = self.system.stress_free_gradient()
        strain = Id(3) + grad_d if relaxation is None else (Id(3) + grad_d) * relaxation
        integrals: dict[str, Any] = {}
        outer = self.domain.ds("wall_outer")
        for name, side in self._sides.items():
            p = terms.hydrostatic_pressure(self.system.solids[name], side.strain)
            area = ng.Norm(side.motion.cof * normal)
            integrals[f"p*size {name}@wall_outer"] = (p * area).Compile() * outer
        integrals["size wall_outer"] = area.Compile() * outer
        p_wall = terms.hydrostatic_pressure(self.system.solids["wall"], strain).Compile()
        integrals["p*size wall"] = (p_wall * k.J).Compile() * self.domain.dx("wall")
        integrals["size wall"] = k.J * self.domain.dx("wall")
        return integrals
