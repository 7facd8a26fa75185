"""Wall shear stress on the deformed inner wall of the vein: what the blood exerts on the wall, in two ways.

gradient: tangential part of mu (L + L^T) n, from the trace of the velocity's gradient.
consistent: the traction that the blood's momentum balance lacks when tested with motions of the wall, as a field on the
wall (Gresho, Lee and Sani, IJNMF 4, 1984; Melbo and Kvamsdal, CMAME 192, 2003), its tangential part.

The benchmark wall_shear measures both. On hexahedra the gradient is the better one in tubes that narrow, by a
factor of 1.2 to 2; on prisms, and with order 3 in an oval tube, the consistent one is, by a factor of 1 to 4. A run
reports `METHOD`, and the mean of the other beside it: their difference tells how fine the mesh is.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import ngsolve as ng
import numpy as np

from ngfsi.arrays import Array, Numbers
from ngfsi.measure.points import Points, joined
from ngfsi.mesh.centreline import Centreline, direction, find_centrelines
from ngfsi.mesh.geometry import Vessel
from ngfsi.physics import terms
from ngfsi.physics.fields import MOTION
from ngfsi.physics.integrals import rules
from ngfsi.physics.kinematics import Kinematics
from ngfsi.system.forms import linear_form
from ngfsi.system.sparse import csr
from ngfsi.system.system import System
from ngfsi.system.together import OnAllRanks, together
from ngfsi.system.unknowns import same_functions

Method = Literal["gradient", "consistent"]

METHOD: Method = "gradient"
CONSISTENT: Method = "consistent"
INTEGRATE = 5
"""Order of NGSolve's `Integrate` for a sum of integrals."""


@dataclass(frozen=True)
class WallSample:
    """Values on the deformed wall, at material points: the same at all times.

    Attributes:
        points: (n, 3) m.
        quads: (m, 4) numbers of points.
        shear: (n, 3) wall shear stress, Pa.
        pressure: (n,) pressure of the blood, Pa.
        tangential: (n, 2) components of the shear along the vessel (along the material line that was parallel to its
            centreline) and around it, Pa: they follow the wall as it turns.
    """

    points: Array
    quads: Numbers
    shear: Array
    pressure: Array
    tangential: Array


@dataclass(frozen=True)
class ShearStatistics:
    """Magnitude of the wall shear stress over the deformed area.

    Attributes:
        mean: Pa
        smallest, largest: at quadrature points, Pa.
        low: fraction of the area with less than the threshold.
    """

    mean: float
    smallest: float
    largest: float
    low: float


class Wall(OnAllRanks):
    """The interface as a boundary of the blood.

    The unknowns d live on both sides of the interface, where a boundary value of their gradient would be that of
    either side; velocity and motion are therefore first carried over to fields that exist in the blood alone, exactly,
    since they lie in the same space there.
    """

    def __init__(self, system: System, vessel: Vessel, lines: tuple[Centreline, ...] = ()) -> None:
        """Prepare.

        Args:
            lines: its centrelines; default: those found.
        """
        super().__init__(system)
        self.vessel, self._lines = vessel, lines
        domain, order = system.domain, system.unknowns.order
        fluid = str(vessel.lumen)
        space = ng.VectorH1(domain.mesh, order=order, definedon=fluid)
        self._motion, self._velocity = ng.GridFunction(space), ng.GridFunction(space)
        self._in_motion = same_functions(domain, space, system.unknowns.space.components[0], fluid)
        self._in_velocity = system.unknowns.partner[self._in_motion]
        self._region = domain.boundaries(vessel.interface)
        k = Kinematics(ng.BoundaryFromVolumeCF(ng.Grad(self._motion)))
        stress = terms.viscous_stress(system.blood, k, ng.BoundaryFromVolumeCF(ng.Grad(self._velocity)))
        area = k.cof * domain.outward_normal(str(vessel.lumen))
        stretch = ng.Norm(area)
        self.stretch = stretch.Compile()
        normal = area / stretch
        self._ds = domain.ds(vessel.interface, bonus_intorder=order)
        self._projection = Projection(system, vessel, stretch, self._ds)
        self._traction = Traction(system, vessel, k, stress, self._projection)
        self.shears: dict[Method, Any] = {
            "gradient": (-terms.tangential(stress * normal, normal)).Compile(),
            "consistent": (-terms.tangential(self._traction.field, normal)).Compile(),
        }
        self.shear = self.shears[METHOD]
        self._threshold = ng.Parameter(0.0)
        sizes = [ng.Norm(shear) for shear in self.shears.values()]
        lows = [ng.IfPos(self._threshold - size, stretch, 0.0) for size in sizes]
        self._sizes = ng.CF(tuple(sizes)).Compile()
        self._integrands = ng.CF((stretch, *(size * stretch for size in sizes), *lows)).Compile()
        self._statistics: dict[tuple[float, Method], ShearStatistics] = {}
        """Of the present state, by threshold: what all methods need is evaluated once."""
        self._shear = self._projection.work_of(self.shear)
        self.field = ng.GridFunction(self._projection.space)
        """The wall shear stress (Pa) as a continuous field, which can be evaluated at any point of the interface."""
        self._gradient = k.F
        self._normal = normal.Compile()
        self._points, self._at_extremes = (
            Points.of(system, self._region, rules(n)) for n in (INTEGRATE + order, 2 * order)
        )

    @together
    def refresh(self) -> None:
        """Take the system's present state."""
        system = self.system
        state, history = system.named(system.state), system.named(system.velocity_history)
        m, rates = (np.asarray(part[MOTION].vec.FV().NumPy()) for part in (state, history))
        moved, flowing = self._in_motion >= 0, self._in_velocity >= 0
        motion, velocity = (np.asarray(field.vec.FV().NumPy()) for field in (self._motion, self._velocity))
        motion[moved] = m[self._in_motion[moved]]
        velocity[moved] = system.new_weight.Get() * motion[moved] + rates[self._in_motion[moved]]
        velocity[flowing] += system.values[self._in_velocity[flowing]]
        self._statistics.clear()
        self._projection.refresh()
        self._traction.refresh()
        self._shear.Assemble()
        self._projection.solve(self._shear.vec.FV().NumPy(), self.field)

    @together
    def statistics(self, threshold: float = 0.0, method: Method = METHOD) -> ShearStatistics:
        """Return mean and extremes of the wall shear stress's magnitude, and the fraction of the area below `threshold`
        (Pa)."""
        if (threshold, method) not in self._statistics:
            self._threshold.Set(threshold)
            sums = self._points.integrals(self._integrands)
            self.system.ranks.add(sums)
            area, *parts = map(float, sums)
            values, count = self._at_extremes.values(self._sizes), len(self.shears)
            extremes = np.concatenate([np.min(values, axis=0, initial=np.inf), -np.max(values, axis=0, initial=0.0)])
            extremes = self.system.ranks.smallest(extremes)[0]
            found = zip(self.shears, parts[:count], parts[count:], extremes[:count], -extremes[count:], strict=True)
            for name, sum_, low, smallest, largest in found:
                shear = ShearStatistics(sum_ / area, float(smallest), float(largest), low / area)
                self._statistics[threshold, name] = shear
        return self._statistics[threshold, method]

    def integral(self, integrand: Any) -> float:
        """Return the integral over the deformed wall of a field on it."""
        return float(ng.Integrate(integrand * self.stretch * self._ds, self.system.domain.mesh))

    def sample(self, refinement: int) -> WallSample:
        """Return values on a grid of (refinement + 1)^2 points on each quadrilateral of the interface.

        Triangles (tetrahedral meshes) are sampled as degenerate quadrilaterals.
        """
        values, row = self._on_grid(refinement), refinement + 1
        points, shear, normal, along = np.split(values[:, :12], 4, axis=1)
        first = np.arange(0, len(points), row**2)
        cells = np.add.outer(row * np.arange(refinement), np.arange(refinement)).ravel()
        quads = np.add.outer(np.add.outer(first, cells), [0, 1, row + 1, row]).reshape(-1, 4)
        along = along - np.sum(along * normal, axis=1)[:, None] * normal
        along /= np.linalg.norm(along, axis=1)[:, None]
        tangential = np.stack([np.sum(shear * way, axis=1) for way in (along, np.cross(along, normal))], axis=1)
        return WallSample(points, quads, shear, values[:, 12], tangential)

    @together
    def _on_grid(self, refinement: int) -> Array:
        """Return the values of `_sampled` at all points of the grid, on rank 0."""
        ticks = np.linspace(0.0, 1.0, refinement + 1).tolist()
        corners = [(s, t) for t in ticks for s in ticks]
        places = {ng.ET.QUAD: corners, ng.ET.TRIG: [(s * (1 - t), t) for s, t in corners]}
        rules = {kind: ng.IntegrationRule(inside, [1.0] * len(inside)) for kind, inside in places.items()}
        points = Points.of(self.system, self._region, rules)
        return joined(self.system.ranks.collect((points.mine, points.values(self._sampled))))

    @cached_property
    def _sampled(self) -> Any:
        """Place (m), wall shear stress (Pa), normal, where the material lines along the centreline lead, pressure (Pa);
        lines are looked for when samples are wanted."""
        domain = self.system.domain
        lines = self._lines or find_centrelines(domain, self.vessel)
        along = self._gradient * direction(domain, self.vessel, lines)
        place, pressure = ng.CF((ng.x, ng.y, ng.z)) + self._motion, self.system.blood_pressure(self.vessel.name)
        return ng.CF((place, self.shear, self._normal, along, pressure)).Compile()


class Projection:
    """Least squares over the deformed interface, onto the continuous fields on it with the order of the velocity.

    Attributes:
        space: vector fields whose unknowns on the interface count.
    """

    def __init__(self, system: System, vessel: Vessel, stretch: Any, ds: Any) -> None:
        """Prepare.

        Args:
            stretch: deformed over reference area.
            ds: measure of the reference area.
        """
        self._stretch, self._system = stretch, system
        mesh, order = system.domain.mesh, system.unknowns.order
        self._mine = system.domain.ds(vessel.interface, bonus_intorder=order, definedonelements=system.mine(ng.BND))
        self.space = ng.VectorH1(mesh, order=order)
        wall = system.domain.boundaries(vessel.interface)
        whole, scalar = ng.H1(mesh, order=order), ng.H1(mesh, order=order, definedon=wall)
        trial, test = scalar.TnT()
        self._mass = ng.BilinearForm(scalar, check_unused=False)
        self._mass += stretch * trial * test * ds
        same = {here: there for face in wall.Elements()
                for here, there in zip(scalar.GetDofNrs(face), whole.GetDofNrs(face), strict=True)}  # fmt: skip
        self._there = np.array(list(same))
        self._places = np.array(list(same.values())) + whole.ndof * np.arange(3)[:, None]
        self._factors: Any = None

    def refresh(self) -> None:
        """Take the present shape of the wall."""
        from scipy.sparse.linalg import splu  # takes long to import

        self._mass.Assemble()
        self._factors = splu(csr(self._mass.mat)[self._there][:, self._there].tocsc())

    def work_of(self, field: Any) -> ng.LinearForm:
        """Return the work of a vector field on this rank's part of the interface, to be assembled and solved for its
        projection."""
        return linear_form(self.space, [(self._stretch * (field * self.space.TestFunction().Trace()), self._mine)])

    def solve(self, work: Array, result: Any) -> None:
        """Write the field that does the work (N/m, one value per function, of each rank its part) on each function of
        the space."""
        there = work[self._places]
        self._system.ranks.add(there)
        result.vec.FV().NumPy()[self._places] = self._factors.solve(there.T).T


class Traction:
    """Viscous traction sigma n of the blood (Pa), n out of the blood, from its momentum balance.

    The blood's residual in the equations of the wall is the work of its whole traction there. Its pressure must not be
    projected with it onto a wall whose normal jumps between elements: it is taken out with its own trace.

    Attributes:
        field: on the interface.
    """

    def __init__(self, system: System, vessel: Vessel, k: Kinematics, stress: Any, projection: Projection) -> None:
        self._system, self._projection = system, projection
        self._form = system.blood_form(vessel)
        self._residual = system.state.vec.CreateVector()
        self.field = ng.GridFunction(projection.space)
        test, domain = projection.space.TestFunction().Trace(), system.domain
        area = k.cof * domain.outward_normal(str(vessel.lumen))
        pressure = system.fields().pressure * area
        more = {"bonus_intorder": system.unknowns.order, "definedonelements": system.mine(ng.BND)}
        parts = [(pressure * test, domain.ds(vessel.interface, **more))]
        # what holds the prescribed velocity, on functions of the rim
        for name in set(system.unknowns.on_opening) & set(vessel.openings):
            parts.append(((pressure - stress * area) * test, domain.ds(name, **more)))
        self._known = linear_form(projection.space, parts)

    def refresh(self) -> None:
        """Take the system's present state."""
        self._form.Apply(self._system.state.vec, self._residual)
        self._known.Assemble()
        known = self._known.vec.FV().NumPy()
        self._projection.solve(known + self._residual.FV().NumPy()[: len(known)], self.field)
