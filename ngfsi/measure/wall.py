"""Wall shear stress on the deformed inner wall of the vein, from the blood's side."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import ngsolve as ng
import numpy as np
from numpy.typing import NDArray

from ngfsi.physics import terms
from ngfsi.physics.kinematics import Kinematics
from ngfsi.solve.system import System

Array = NDArray[np.float64]


@dataclass(frozen=True)
class WallSample:
    """Values on the deformed wall.

    Attributes:
        points: (n, 3) m.
        quads: (m, 4) numbers of points.
        shear: (n, 3) wall shear stress, Pa.
        pressure: (n,) pressure of the blood, Pa.
    """

    points: Array
    quads: NDArray[np.int64]
    shear: Array
    pressure: Array


@dataclass(frozen=True)
class ShearStatistics:
    """Magnitude of the wall shear stress (Pa): mean over the deformed area, and extremes at quadrature points."""

    mean: float
    smallest: float
    largest: float


class Wall:
    """The interface as a boundary of the blood.

    The unknowns d live on both sides of the interface, where a boundary value of their gradient would be that of
    either side; velocity and motion are therefore first carried over to fields that exist in the blood alone, exactly,
    since they lie in the same space there.
    """

    def __init__(self, system: System) -> None:
        self.system = system
        domain, order = system.domain, system.unknowns.order
        fluid = domain.fluid
        space = ng.VectorH1(domain.mesh, order=order, definedon=fluid)
        self._motion, self._velocity = ng.GridFunction(space), ng.GridFunction(space)
        self._fields = system.fields(system.state.components)
        self._fluid = domain.materials(fluid)
        self._region = domain.boundaries("interface")
        normal = ng.specialcf.normal(3)
        grad_m = ng.BoundaryFromVolumeCF(ng.Grad(self._motion))
        k = Kinematics(grad_m)
        stress = terms.viscous_stress(system.blood, k, ng.BoundaryFromVolumeCF(ng.Grad(self._velocity)))
        self.shear = terms.wall_shear(stress, k, normal)
        self.magnitude = ng.Norm(self.shear)
        self.stretch = ng.Norm(k.cof * normal)
        self._ds = domain.ds("interface", bonus_intorder=order)
        self._points = self._map(_rules(lambda shape: ng.IntegrationRule(shape, 2 * order)))

    def refresh(self) -> None:
        """Take the system's present state."""
        self._motion.Set(self._fields.motion, definedon=self._fluid)
        self._velocity.Set(self._fields.velocity, definedon=self._fluid)

    def statistics(self) -> ShearStatistics:
        """Return mean and extremes of the wall shear stress's magnitude."""
        mesh = self.system.domain.mesh
        area = ng.Integrate(self.stretch * self._ds, mesh)
        mean = ng.Integrate(self.magnitude * self.stretch * self._ds, mesh) / area
        values = self.magnitude(self._points)
        return ShearStatistics(float(mean), float(values.min()), float(values.max()))

    def sample(self, refinement: int) -> WallSample:
        """Return values on a grid of (refinement + 1)^2 points on each quadrilateral of the interface.

        Triangles (tetrahedral meshes) are sampled as degenerate quadrilaterals.
        """
        corners, weights = _grid(refinement)
        rules = {
            ng.ET.QUAD: ng.IntegrationRule([tuple(c) for c in corners], weights),
            ng.ET.TRIG: ng.IntegrationRule([(s * (1 - t), t) for s, t in corners], weights),
        }
        at = self._map(rules)
        position = ng.CF((ng.x, ng.y, ng.z)) + self._motion
        points = np.asarray(position(at))
        per_element = len(corners)
        first = np.arange(0, len(points), per_element)
        quads = (first[:, None, None] + _cells(refinement)[None]).reshape(-1, 4)
        pressure = self.system.state.components[2]
        return WallSample(points, quads, np.asarray(self.shear(at)), np.asarray(pressure(at)).ravel())

    def _map(self, rules: Any) -> Any:
        return self.system.domain.mesh.MapToAllElements(rules, self._region)


def _rules(make: Any) -> dict[Any, Any]:
    return {ng.ET.QUAD: make(ng.QUAD), ng.ET.TRIG: make(ng.TRIG)}


def _grid(refinement: int) -> tuple[Array, list[float]]:
    ticks = np.linspace(0.0, 1.0, refinement + 1)
    corners = np.array([(s, t) for t in ticks for s in ticks])
    return corners, [1.0] * len(corners)


def _cells(refinement: int) -> NDArray[np.int64]:
    row = refinement + 1
    lower = np.array([j * row + i for j in range(refinement) for i in range(refinement)])
    return np.column_stack([lower, lower + 1, lower + row + 1, lower + row])
