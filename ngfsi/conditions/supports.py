"""What holds and moves the solids and the mesh: rigid boundaries and ends, prescribed motions and velocities."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal

import ngsolve as ng
import numpy as np
from ngsolve import GridFunction
from pydantic import Field

from ngfsi.arrays import Array, Numbers
from ngfsi.conditions.condition import Condition, ConditionModel, Setup, check_components
from ngfsi.config.functions import FactorCurve, FactorRamp
from ngfsi.errors import CaseError, unknown
from ngfsi.mesh.domain import Domain
from ngfsi.outlines.displacement import OutlineDisplacement
from ngfsi.physics.fields import VELOCITY
from ngfsi.physics.integrals import Integral
from ngfsi.units import Length, in_unit

EndsKind = Literal["roller", "clamped", "guided", "free"]
AXES = "xyz"
ALIGNED = 1e-6
"""Normals that differ less from a coordinate axis are along it."""
STIFF = 1e6
"""Stiffness of an end that is held in an oblique direction, over that of the solids."""


class Ends(Condition):
    """Rigid boundaries, and the end faces of a segment.

    roller: the end faces slide in their plane; clamped: they are fixed; guided: they move along their normal alone;
    free: they carry no load. An end whose normal is no coordinate axis is held by stiff springs.
    """

    name = "ends"

    def __init__(self, domain: Domain, kind: EndsKind) -> None:
        """Prepare.

        Raises:
            CaseError: ends of the plane are to roll.
        """
        self._domain, self._kind = domain, kind
        self._rigid, self._ends = list(domain.geometry.rigid_names), domain.ends
        if kind == "roller" and domain.mesh.dim == 2 and self._ends:
            raise CaseError("conditions.ends = 'roller' is for segments in 3-D: use 'clamped' or 'free' in the plane")
        self._normals = {name: domain.mean_normal(name) for name in self._ends if kind in ("roller", "guided")}
        self._axis = {name: _axis(normal) for name, normal in self._normals.items()}

    def fixes(self) -> dict[str, list[str]]:
        fixed = {"": [*self._rigid, *(self._ends if self._kind == "clamped" else [])]}
        axes = AXES[: self._domain.mesh.dim]
        for name, axis in self._axis.items():
            for component in axes if axis else ():
                if (component == axis) == (self._kind == "roller"):
                    fixed.setdefault(component, []).append(name)
        return fixed

    def points(self, motion: Any) -> list[int]:
        """Return unknowns of a space of displacements that are fixed as well, which carry no force in balance.

        Without bones rollers leave rigid motions in the plane of the ends free. Of two axes across the normal, two
        vertices far apart along the first are held along the second, and one between them along the first: a tube that
        widens evenly thus stays where it is.
        """
        if self._kind != "roller" or self._rigid or not self._ends or not self._domain.geometry.solids:
            return []
        domain, first_end = self._domain, self._ends[0]
        outer = next(name for name in ("skin", "wall_outer", *domain.geometry.boundary_names)
                     if domain.has_boundary(name))  # fmt: skip
        vertices = np.intersect1d(domain.vertices_on(outer), domain.vertices_on(*self._same_plane(first_end)))
        first, second = np.delete(range(3), int(np.argmax(np.abs(self._normals[first_end]))))
        along = np.array([domain.mesh.vertices[int(v)].point[first] for v in vertices])
        ends, between = (np.argmin(along), np.argmax(along)), np.argmin(np.abs(along - along.mean()))
        held = [(vertices[end], second) for end in ends] + [(vertices[between], first)]
        return [motion.GetDofNrs(ng.NodeId(ng.VERTEX, int(vertex)))[axis] for vertex, axis in held]

    def _same_plane(self, end: str) -> tuple[str, ...]:
        """Return the ends that lie in the plane of one of them."""
        normal, domain = self._normals[end], self._domain
        heights = {name: domain.centroid(name) @ normal for name in self._ends}
        return tuple(n for n, h in heights.items() if abs(h - heights[end]) < ALIGNED * domain.geometry.size)

    def static_integrals(self, m: Any, v: Any) -> list[Integral]:
        found = []
        for name, normal in self._normals.items():
            if self._axis[name] is None and self._domain.geometry.solids:
                n, stiffness = ng.CF(tuple(normal)), STIFF * self._setup.stiffness / self._domain.geometry.size
                along = (m.Trace() * n) * (v.Trace() * n)
                held = along if self._kind == "roller" else ng.InnerProduct(m.Trace(), v.Trace()) - along
                found.append(Integral([stiffness * held], self._domain.ds(name)))
        return found


def _axis(normal: Array) -> str | None:
    """Return the coordinate axis along a unit vector, if there is one."""
    axis = int(np.argmax(np.abs(normal)))
    return AXES[axis] if abs(abs(normal[axis]) - 1) < ALIGNED else None


class Prescribed(Condition):
    """Unknowns with values of its own: `attach` sets their `_numbers`, and `update` their `_values`."""

    _numbers: Numbers
    _values: Array

    def prescribed(self) -> Numbers:
        return np.asarray(self._numbers)

    def prescribe(self, values: Array) -> None:
        values[self._numbers] = self._values

    def state_arrays(self) -> dict[str, Array]:
        return {"values": self._values.copy()}

    def restore_state(self, arrays: Mapping[str, Array]) -> None:
        self._values = np.array(arrays["values"])


class Displacement(Prescribed):
    """A displacement of boundaries as a whole, times a function of time."""

    def __init__(
        self, name: str, domain: Domain, boundaries: Sequence[str], displacement: Sequence[float],
        curve: Callable[[float], float],
    ) -> None:  # fmt: skip
        self.name, self._boundaries, self._curve = name, tuple(boundaries), curve
        self._domain, self._displacement, self._factor = domain, displacement, 0.0

    def fixes(self) -> dict[str, list[str]]:
        return {"": list(self._boundaries)}

    def attach(self, setup: Setup) -> None:
        super().attach(setup)
        space, on = setup.unknowns.space.components[0], self._domain.boundaries(*self._boundaries)
        field = GridFunction(space)
        field.Set(ng.CF(tuple(self._displacement)), definedon=on)
        self._numbers = np.flatnonzero(list(space.GetDofs(on)))
        self._given = np.array(field.vec.FV().NumPy()[self._numbers])
        self._values = np.zeros(len(self._given))

    def update(self, t: float, load_factor: float = 1.0) -> None:
        self._factor = load_factor * self._curve(t)
        self._values = self._factor * self._given

    def sentence(self) -> str:
        moved = in_unit([self._factor * part for part in self._displacement], "mm", ".4g")
        return f"{', '.join(self._boundaries)} moved by {moved}"


class DisplacementModel(ConditionModel):
    """Boundaries that are moved as given, e.g. `boundaries = ["tissue_top"]`, `displacement_mm = [0, 0, -2]`."""

    kind: Literal["displacement"] = "displacement"
    boundaries: tuple[str, ...] = Field(min_length=1)
    """Faces that are moved."""
    displacement: tuple[Length, ...]
    """Along x, y and z."""
    over_time: FactorCurve = FactorRamp(final=1.0, duration=1.0)
    """Factor on it."""

    def condition(self, domain: Domain, name: str) -> Displacement:
        if wrong := next((one for one in self.boundaries if not domain.has_boundary(one)), None):
            raise CaseError(f"loads.further: {name}: {unknown('boundary', wrong, domain.geometry.boundary_names)}")
        check_components(self.displacement, "displacement", name, domain)
        return Displacement(name, domain, self.boundaries, self.displacement, self.over_time)


class SkinMotion(Prescribed):
    """The prescribed displacement of a plane section's skin."""

    name = "skin motion"

    def __init__(self, domain: Domain, displacement: OutlineDisplacement) -> None:
        """Prepare.

        Raises:
            CaseError: the domain is no plane section.
        """
        if domain.mesh.dim == 3:
            raise CaseError("conditions.skin_displacement is for plane sections: in 3-D boundaries are moved by "
                            '[[loads.further]] with kind = "displacement"')  # fmt: skip
        self._domain, self._displacement, self._factor = domain, displacement, 1.0

    def fixes(self) -> dict[str, list[str]]:
        return {"": ["skin"]}

    def attach(self, setup: Setup) -> None:
        super().attach(setup)
        space = setup.unknowns.space.components[0]
        self._numbers = np.flatnonzero(list(space.GetDofs(self._domain.boundaries("skin"))))
        self._given = self._values = _fit(self._domain, "skin", setup.unknowns.order, self._displacement)

    def update(self, _t: float, load_factor: float = 1.0) -> None:
        self._factor, self._values = load_factor, load_factor * self._given

    def sentence(self) -> str:
        return f"{self._factor:.0%} of the skin's displacement"


def _fit(domain: Domain, boundary: str, order: int, function: Callable[[Array], Array]) -> Array:
    """Return the unknowns of a plane VectorH1 on a boundary, one component after the other, that fit a function best
    which NGSolve cannot evaluate.

    Args:
        function: of points (n, 2) [m] of the reference shape, returns vectors (n, 2).
    """
    region, scalar = domain.boundaries(boundary), ng.H1(domain.mesh, order=order)
    rule = ng.IntegrationRule(ng.SEGM, 2 * order + 1)
    points = np.asarray(ng.CF((ng.x, ng.y))(domain.mesh.MapToAllElements({ng.SEGM: rule}, region)))
    numbers = np.flatnonzero(list(scalar.GetDofs(region)))
    shapes = np.zeros((len(points), len(numbers)))
    for first, element in zip(range(0, len(points), len(rule)), region.Elements(), strict=True):
        finite, columns = scalar.GetFE(element), np.searchsorted(numbers, scalar.GetDofNrs(element))
        for row, point in enumerate(rule, start=first):
            shapes[row, columns] = np.asarray(finite.CalcShape(*point.point))
    return np.asarray(np.linalg.lstsq(shapes, function(points), rcond=None)[0].T.ravel())


class GivenVelocity(Prescribed):
    """The velocity of the blood relative to the mesh on an opening, as a function of time and place."""

    def __init__(self, opening: str, velocity: Callable[[float], Any]) -> None:
        """Prepare; `velocity`: takes the time (s) and returns a vector field (m/s) of the reference shape."""
        self.name, self._velocity = opening, velocity

    def velocity_on(self) -> tuple[str, ...]:
        return (self.name,)

    def attach(self, setup: Setup) -> None:
        super().attach(setup)
        self._numbers = setup.unknowns.on_opening[self.name]
        self._field = GridFunction(setup.unknowns.space)
        self._on_opening = self._field.components[setup.unknowns.place(VELOCITY)]
        self._values = np.zeros(len(self._numbers))

    def update(self, t: float, load_factor: float = 1.0) -> None:
        region = self._setup.domain.boundaries(self.name)
        self._on_opening.Set(load_factor * self._velocity(t), definedon=region, bonus_intorder=4)
        self._values = np.array(self._field.vec.FV().NumPy()[self._numbers])

    def restore_state(self, arrays: Mapping[str, Array]) -> None:
        """Take values, which the field on the opening has as well."""
        super().restore_state(arrays)
        self._field.vec.FV().NumPy()[self._numbers] = self._values

    def sentence(self) -> str:
        return f"a given velocity at '{self.name}'"

    def flow_scale(self) -> float:
        """Return the integral of the velocity's size over the opening (m3/s)."""
        size = ng.Norm(self._on_opening) * self._setup.domain.ds(self.name, bonus_intorder=4)
        return float(ng.Integrate(size, self._setup.domain.mesh))


class GivenMeshMotion(Prescribed):
    """The displacement of the mesh inside of the blood (the unknowns e), as a function of time and place."""

    name = "mesh motion"

    def __init__(self, motion: Callable[[float], Any]) -> None:
        """Prepare; `motion`: takes the time (s) and returns a vector field (m) of the reference shape."""
        self._motion = motion

    def attach(self, setup: Setup) -> None:
        super().attach(setup)
        self._numbers = setup.unknowns.blocks["e"]
        self._field = GridFunction(setup.unknowns.space.components[0])
        self._values = np.zeros(len(self._numbers))

    def update(self, t: float, load_factor: float = 1.0) -> None:
        self._field.Set(load_factor * self._motion(t))
        self._values = np.array(self._field.vec.FV().NumPy()[self._numbers])
