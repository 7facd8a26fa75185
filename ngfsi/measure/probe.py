"""Probe: all measurements of one state, each computed once, as far as the model has what they are of."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any

import ngsolve as ng
import numpy as np
from ngsolve import InnerProduct

from ngfsi.conditions import PressureOn
from ngfsi.measure.branch import Branch, Layers
from ngfsi.measure.deformation import Deformation
from ngfsi.measure.hole import Hole
from ngfsi.measure.plane import PlaneSectionProbe
from ngfsi.measure.points import Points
from ngfsi.measure.scalars import Scalars
from ngfsi.measure.sections import STATIONS
from ngfsi.measure.transmural import Side
from ngfsi.measure.wall import CONSISTENT, INTEGRATE, METHOD, ShearStatistics, Wall
from ngfsi.mesh.centreline import Centreline, find_centrelines
from ngfsi.mesh.geometry import Vessel
from ngfsi.physics import terms
from ngfsi.physics.integrals import rules
from ngfsi.physics.kinematics import Kinematics
from ngfsi.system.system import System
from ngfsi.system.together import OnAllRanks, together

DRAWN = 41
"""Points by which a curved centreline is stored."""
NO_SHEAR = ShearStatistics(0.0, 0.0, 0.0, 0.0)


class Integrals(OnAllRanks):
    """Named integrals over the present state, each computed once; `forget` after each step.

    Those that are defined together are integrated together, for what they have in common.
    """

    def __init__(self, system: System) -> None:
        super().__init__(system)
        self._groups: dict[str, tuple[list[str], Any, Points]] = {}
        self._known: dict[str, float] = {}

    def define(self, region: Any, bonus: int, integrands: Mapping[str, Any]) -> None:
        """Add integrals by name.

        Args:
            region: of the mesh, or of its boundary.
            bonus: order of integration beyond `INTEGRATE`.
            integrands: scalar.
        """
        names, joined = list(integrands), ng.CF(tuple(integrands.values())).Compile()
        self._groups |= dict.fromkeys(names, (names, joined, Points.of(self.system, region, rules(INTEGRATE + bonus))))

    def __call__(self, name: str) -> float:
        """Return a named integral, SI."""
        if name not in self._known:
            self._known |= self._evaluate(name)
        return self._known[name]

    @together
    def _evaluate(self, name: str) -> dict[str, float]:
        """Return an integral and those that are defined with it."""
        names, integrands, points = self._groups[name]
        values = points.integrals(integrands)
        self.system.ranks.add(values)
        return dict(zip(names, map(float, values), strict=True))

    def forget(self) -> None:
        """Take note of a new state."""
        self._known.clear()


class VesselProbe(OnAllRanks):
    """Measurements of one vessel with blood in it, in 3-D.

    Attributes:
        branches: what is measured along each centreline, by its name; along the first one also as `sections` and
            `load`.
        outside: region of the tissue around the wall; None: there is none.
    """

    def __init__(self, system: System, vessel: Vessel) -> None:
        super().__init__(system)
        self.vessel, self.domain = vessel, system.domain
        lines = find_centrelines(system.domain, vessel)
        self.wall = Wall(system, vessel, lines)
        self.outside = outside = system.domain.beyond(vessel)
        self._sides = {name: Side(system, name) for name in (vessel.wall, outside) if name and outside}
        self.integral = Integrals(system)
        self._layers = Layers(system, vessel) if vessel.branched else None
        tissue = (self._sides[outside], outside) if outside else None
        self.branches = {
            name: Branch(system, vessel, name, line, tissue, self._layers, self.integral)
            for name, line in zip(vessel.branches, lines, strict=True)
        }
        self.sections, self.load = self.branches[""].sections, self.branches[""].load
        self.shear = self.consistent_shear = NO_SHEAR
        self._define()

    def refresh(self) -> None:
        """Take the system's present state."""
        self.shear, self.consistent_shear = self._refresh()
        self.integral.forget()

    @together
    def _refresh(self) -> tuple[ShearStatistics, ShearStatistics]:
        for side in self._sides.values():
            side.refresh()
        self.wall.refresh()
        if self._layers:
            self._layers.refresh()
        for branch in self.branches.values():
            branch.refresh(self.wall.field)
        low = self.system.case.output.low_shear
        return self.wall.statistics(low, METHOD), self.wall.statistics(low, CONSISTENT)

    def summary(self) -> dict[str, Any]:
        """Return what readers of the run must know of the vessel, for the manifest."""
        vessel = self.vessel
        lines = {name: {"length_m": branch.line.length, "centreline_m": _drawn(branch.line)}
                 for name, branch in self.branches.items()}  # fmt: skip
        return {"lumen": vessel.lumen, "interface": vessel.interface, "wall": vessel.wall, "outer": vessel.outer,
                "inlets": list(vessel.inlets), "outlets": list(vessel.outlets), "radius_m": vessel.radius,
                "stations": STATIONS, **lines.pop(""), **({"branches": lines} if lines else {})}  # fmt: skip

    def inflow(self) -> float:
        """Return the flow into the vessel through all inlets (m3/s)."""
        return -sum(self.integral(f"flux {name}") for name in self.vessel.inlets)

    def outflow(self) -> float:
        """Return the flow out of the vessel through all outlets (m3/s)."""
        return sum(self.integral(f"flux {name}") for name in self.vessel.outlets)

    def mean_pressure(self, opening: str) -> float:
        """Return the mean pressure of the blood over a deformed opening (Pa)."""
        reference = float(self.system.reference(self.vessel.name).Get())
        return self.integral(f"p*size {opening}") / self.integral(f"size {opening}") + reference

    def solid_pressure(self, region: str, side: str = "") -> float:
        """Return the mean of p = -tr(sigma)/3 (Pa) over the deformed region, or over its side of a boundary."""
        what = f"{region}@{side}" if side else region
        return self.integral(f"p*size {what}") / self.integral(f"size {side or region}")

    def _define(self) -> None:
        system, vessel, domain = self.system, self.vessel, self.domain
        f, order = system.fields(), system.unknowns.order
        k, normal = Kinematics(f.grad_motion), domain.outward_normal(str(vessel.lumen))
        # both are polynomials of at most this order on each element
        exact = 3 * max(order, domain.geometry.curving_order) - 1
        rate = InnerProduct(k.cof, f.grad_motion_rate)
        self.integral.define(domain.materials(str(vessel.lumen)), max(exact - INTEGRATE, 0),
                             {"lumen volume": k.J, "lumen rate": rate})  # fmt: skip
        flux, through = (terms.relative_flux(k, u, normal) for u in (f.relative, f.velocity))
        size = ng.Norm(k.cof * normal)
        for name in vessel.openings:
            found = {"flux": flux, "through": through, "size": size, "p*size": f.pressure * size}
            self.integral.define(domain.boundaries(name), 2 * order,
                                 {f"{what} {name}": integrand for what, integrand in found.items()})  # fmt: skip
        self._define_wall()

    def _define_wall(self) -> None:
        """Integrals of the hydrostatic pressure: over the wall, and on both sides of its outer face."""
        system, domain, wall, normal = self.system, self.domain, self.vessel.wall, ng.specialcf.normal(3)
        sides: dict[str, Any] = {}
        for name, side in self._sides.items():
            p = terms.hydrostatic_pressure(system.solids[name], side.strain)
            area = ng.Norm(side.motion.cof * normal)
            sides |= {f"p*size {name}@outer": p * area, "size outer": area}
        if sides:
            self.integral.define(domain.boundaries(str(self.vessel.outer)), 0, sides)
        if wall:
            k = Kinematics(ng.Grad(system.motion))
            p = terms.hydrostatic_pressure(system.solids[wall], system.deformation_gradient())
            self.integral.define(domain.materials(wall), 0, {f"p*size {wall}": p * k.J, f"size {wall}": k.J})


def _drawn(line: Centreline) -> list[list[float]]:
    """Return the points (n, 3) [m] by which a centreline is stored."""
    points: list[list[float]] = line.points(line.stations(2 if line.straight else DRAWN)).tolist()
    return points


class Probe(OnAllRanks):
    """Measurements of a system's state; `refresh` after each step.

    Attributes:
        vessels: those with blood, in 3-D, by name.
        holes: those without, in 3-D, by name.
        plane: measures of a plane section; None in 3-D.
        scalars: what the blood carries, which `refresh` does not take along; None: nothing.
    """

    def __init__(self, system: System) -> None:
        super().__init__(system)
        self.domain = system.domain
        self.deformation = Deformation(system)
        in_plane, vessels = system.domain.mesh.dim == 2, system.domain.vessels
        self.vessels = {} if in_plane else {v.name: VesselProbe(system, v) for v in vessels if v.lumen}
        self.holes = Hole.all_of(system)
        self.plane = PlaneSectionProbe(system) if in_plane and not system.domain.lumens else None
        self.scalars = Scalars(system) if system.case.scalars else None
        self.integral = Integrals(system)
        self._pressing = [c for c in system.conditions.values() if isinstance(c, PressureOn) and c.on_skin]
        if self._pressing:
            self._define_skin()

    def refresh(self) -> None:
        """Take the system's present state."""
        for vessel in self.vessels.values():
            vessel.refresh()
        self.integral.forget()

    @property
    def pressed(self) -> bool:
        """Whether pressure acts on a skin."""
        return bool(self._pressing)

    def given(self, condition: str) -> float:
        """Return the present value of a condition (SI)."""
        found: Any = self.system.conditions[condition]
        return float(found.value.Get())

    def mean_skin_pressure(self) -> float:
        """Return the mean of all pressures on the deformed skin, cuffs included (Pa)."""
        return self.integral("p*size skin") / self.integral("size skin")

    def largest_skin_pressure(self) -> float:
        """Return the largest pressure at a quadrature point of the skin, cuffs included (Pa)."""
        return -self._smallest_suction()

    @together
    def _smallest_suction(self) -> float:
        values = np.append(-self._skin_points.values(self._pressure), np.inf)
        return float(self.system.ranks.smallest(np.min(values, keepdims=True))[0][0])

    @cached_property
    def _skin_points(self) -> Points:
        return Points.of(self.system, self.domain.boundaries("skin"), rules(2 * self.system.unknowns.order))

    def _define_skin(self) -> None:
        self._pressure = sum((c.pressure for c in self._pressing[1:]), start=ng.CF(self._pressing[0].pressure))
        k = Kinematics(ng.Grad(self.system.motion))
        size = ng.Norm(k.cof * ng.specialcf.normal(self.domain.mesh.dim))
        self.integral.define(self.domain.boundaries("skin"), 2 * self.system.unknowns.order,
                             {"p*size skin": self._pressure * size, "size skin": size})  # fmt: skip
