"""What holds and moves the solids and the mesh: rigid boundaries and ends, prescribed motions and velocities."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal

import ngsolve as ng
import numpy as np
from ngsolve import GridFunction

from ngfsi.conditions.boundary import boundary_values
from ngfsi.conditions.condition import Condition, Numbers, Setup, Vector
from ngfsi.errors import CaseError
from ngfsi.mesh.domain import Domain
from ngfsi.outlines.displacement import OutlineDisplacement
from ngfsi.physics.fields import MOTION, VELOCITY
from ngfsi.physics.integrals import Integral

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

    def __init__(self, domain: Domain, kind: EndsKind, *, moved: bool = False) -> None:
        """Prepare.

        Args:
            moved: whether a boundary is moved as prescribed, so that nothing else need hold the solids.

        Raises:
            CaseError: neither rigid boundaries nor ends hold the segment, or ends of the plane are to roll.
        """
        self._domain, self._kind = domain, kind
        self._rigid, self._ends = list(domain.geometry.rigid_names), domain.ends
        solids = bool(domain.geometry.solids)
        if solids and kind in ("free", "guided") and not self._rigid and not moved:
            raise CaseError(f"conditions.ends = '{kind}' leaves a segment without bones adrift: use 'roller' or "
                            "'clamped'")  # fmt: skip
        if kind == "roller" and domain.mesh.dim == 2 and self._ends:
            raise CaseError("conditions.ends = 'roller' is for segments in 3-D: use 'clamped' or 'free' in the plane")
        self._normals = {name: domain.mean_normal(name) for name in self._ends if kind in ("roller", "guided")}
        self._axis = {name: _axis(normal) for name, normal in self._normals.items()}
        self._adrift = solids and kind == "roller" and not self._rigid and bool(self._ends)

    def fixes(self) -> dict[str, list[str]]:
        """Return the boundaries of which components of the displacement are fixed."""
        fixed = {"": [*self._rigid, *(self._ends if self._kind == "clamped" else [])]}
        axes = AXES[: self._domain.mesh.dim]
        for name, axis in self._axis.items():
            for component in axes if axis else ():
                if (component == axis) == (self._kind == "roller"):
                    fixed.setdefault(component, []).append(name)
        return fixed

    def points(self, motion: Any) -> list[int]:
        """Return unknowns of a space of displacements that are fixed as well, which carry no force in balance.

        Without bones rollers leave rigid motions across the axis free: all components of a vertex of the outer surface
        on the first end are held, and of that opposite the one across their line.
        """
        if not self._adrift:
            return []
        domain, first_end = self._domain, self._ends[0]
        outer = next(name for name in ("skin", "wall_outer", *domain.geometry.boundary_names)
                     if domain.has_boundary(name))  # fmt: skip
        on = [{v for e in domain.boundaries(*names).Elements() for v in e.vertices}
              for names in ((outer,), self._same_plane(first_end))]  # fmt: skip
        places = {v: np.array(domain.mesh[v].point) for v in on[0] & on[1]}
        first = min(places, key=lambda v: v.nr)
        other = max(places, key=lambda v: float(np.linalg.norm(places[v] - places[first])))
        across = np.abs(np.cross(self._normals[first_end], places[other] - places[first]))
        held = [axis for axis in range(3) if AXES[axis] != self._axis[first_end]]
        numbers = motion.GetDofNrs(first)
        return [*(numbers[axis] for axis in held), motion.GetDofNrs(other)[int(np.argmax(across))]]

    def _same_plane(self, end: str) -> tuple[str, ...]:
        """Return the ends that lie in the plane of one of them."""
        normal, domain = self._normals[end], self._domain
        heights = {name: domain.centroid(name) @ normal for name in self._ends}
        return tuple(n for n, h in heights.items() if abs(h - heights[end]) < ALIGNED * domain.geometry.size)

    def attach(self, setup: Setup) -> None:
        """Take what it acts on."""
        self._setup = setup

    def integrals(self, _elements: ng.BitArray | None) -> list[Integral]:
        """Return the springs of oblique ends."""
        setup = self._setup
        return self.static_integrals(setup.trial[MOTION], setup.test[MOTION]) if setup.leads else []

    def static_integrals(self, m: Any, v: Any) -> list[Integral]:
        """Return the springs of oblique ends."""
        found = []
        for name, normal in self._normals.items():
            if self._axis[name] is None and self._domain.geometry.solids:
                n, stiffness = ng.CF(tuple(normal)), STIFF * self._setup.stiffness / self._domain.geometry.size
                along = (m.Trace() * n) * (v.Trace() * n)
                held = along if self._kind == "roller" else ng.InnerProduct(m.Trace(), v.Trace()) - along
                found.append(Integral([stiffness * held], self._domain.ds(name)))
        return found


def _axis(normal: Vector) -> str | None:
    """Return the coordinate axis along a unit vector, if there is one."""
    axis = int(np.argmax(np.abs(normal)))
    return AXES[axis] if abs(abs(normal[axis]) - 1) < ALIGNED else None


class SkinMotion(Condition):
    """The prescribed displacement of a plane section's skin."""

    name = "skin motion"

    def __init__(self, domain: Domain, displacement: OutlineDisplacement) -> None:
        self._domain, self._displacement, self._factor = domain, displacement, 1.0

    def fixes(self) -> dict[str, list[str]]:
        """Return the skin."""
        return {"": ["skin"]}

    def attach(self, setup: Setup) -> None:
        """Find the unknowns and their values (m)."""
        space = setup.unknowns.space.components[0]
        given = boundary_values(self._domain, "skin", setup.order, self._displacement)
        self._numbers = np.flatnonzero(list(space.GetDofs(self._domain.boundaries("skin"))))
        self._given = given[self._numbers]

    def prescribed(self) -> Numbers:
        """Return the unknowns on the skin."""
        return np.asarray(self._numbers)

    def prescribe(self, values: Vector) -> None:
        """Write the displacement."""
        values[self._numbers] = self._factor * self._given

    def update(self, _t: float, load_factor: float = 1.0) -> None:
        """Take a fraction of the displacement."""
        self._factor = load_factor

    def sentence(self) -> str:
        """Return what acts now."""
        return f"{self._factor:.0%} of the skin's displacement"


class GivenVelocity(Condition):
    """The velocity of the blood relative to the mesh on an opening, as a function of time and place."""

    def __init__(self, opening: str, velocity: Callable[[float], Any], scale: float = 0.0) -> None:
        """Prepare.

        Args:
            velocity: takes the time (s) and returns a vector field (m/s).
            scale: a flow (m3/s) by which changes of the velocity are judged.
        """
        self.name, self._velocity, self._scale, self._time = opening, velocity, scale, 0.0

    def velocity_on(self) -> tuple[str, ...]:
        """Return the opening."""
        return (self.name,)

    def attach(self, setup: Setup) -> None:
        """Take what it acts on."""
        self._setup = setup
        self._numbers = setup.unknowns.on_opening[self.name]
        self._field = GridFunction(setup.unknowns.space)
        self._values = np.zeros(len(self._numbers))

    def prescribed(self) -> Numbers:
        """Return the unknowns of the velocity on the opening."""
        return np.asarray(self._numbers)

    def update(self, t: float, load_factor: float = 1.0) -> None:
        """Take the velocity of time t (s)."""
        place, region = self._setup.unknowns.place(VELOCITY), self._setup.domain.boundaries(self.name)
        self._field.components[place].Set(self._velocity(t), definedon=region, bonus_intorder=4)
        self._values = load_factor * np.array(self._field.vec.FV().NumPy()[self._numbers])

    def prescribe(self, values: Vector) -> None:
        """Write the velocity."""
        values[self._numbers] = self._values

    def flow_scale(self) -> float:
        """Return the scale."""
        return self._scale


class GivenMeshMotion(Condition):
    """The motion of the mesh inside of the blood: unknowns of the block e over time."""

    name = "mesh motion"

    def __init__(self, motion: Callable[[float, Sequence[int]], Vector]) -> None:
        """Prepare; `motion`: takes the time (s) and the numbers of the unknowns, returns their values (m)."""
        self._motion = motion

    def attach(self, setup: Setup) -> None:
        """Take what it acts on."""
        self._numbers = setup.unknowns.blocks["e"]
        self._values = np.zeros(len(self._numbers))

    def prescribed(self) -> Numbers:
        """Return the unknowns of the mesh inside of the blood."""
        return np.asarray(self._numbers)

    def update(self, t: float, load_factor: float = 1.0) -> None:
        """Take the motion of time t (s)."""
        self._values = load_factor * self._motion(t, self._numbers)

    def prescribe(self, values: Vector) -> None:
        """Write the motion."""
        values[self._numbers] = self._values

    def state_arrays(self) -> dict[str, Vector]:
        """Return the present values."""
        return {"values": self._values}

    def restore_state(self, arrays: Mapping[str, Vector]) -> None:
        """Take these."""
        self._values = np.array(arrays["values"])
