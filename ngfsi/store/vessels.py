"""The vessels of a stored run, and positions along and around them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from ngfsi.arrays import Array, Mask
from ngfsi.errors import OutputError
from ngfsi.mesh.centreline import Centreline
from ngfsi.mesh.geometry import Point, Vessel

AXES = ("x", "y", "z")
SAME_LINE = 1.05
"""Ratio of the distances of a point from two centrelines up to which they are one, as before a fork."""
STEEP = 0.7
"""Cosine between a vessel and an axis from which the axis is no direction to count angles from."""


@dataclass(frozen=True)
class Frame:
    """A plane across a vessel.

    Attributes:
        centre: (3,) on the vessel's centreline, m.
        axes: (3, 3) unit vectors: two across, from the first of which angles count, and the third along the vessel.
    """

    centre: Array
    axes: Array

    def across(self, points: Array) -> Array:
        """Return the components (..., 2) [m] in the plane of points (..., 3); x and y of those of a vessel along z."""
        return np.asarray(points @ self.axes[:2].T)

    @property
    def is_transverse(self) -> bool:
        """Whether the plane is that of x and y."""
        return bool(np.allclose(self.axes, np.eye(3), atol=1e-6))


class Course:
    """Where a vessel leads: angles around it and positions along it."""

    def __init__(self, centreline: Any) -> None:
        """Take the points (n, 3) [m] of a centreline."""
        self.line = Centreline(centreline)
        self.length = self.line.length
        steepest = np.abs(self.line.tangents(np.linspace(0.0, self.length, 101))).max(axis=0)
        self._start = 0 if steepest[0] < STEEP else int(np.argmin(steepest))

    @property
    def start(self) -> str:
        """The axis from which angles count: x, unless the vessel runs along it."""
        return AXES[self._start]

    def frames(self, s: Any) -> tuple[Array, Array]:
        """Return centres (..., 3) [m] and axes (..., 3, 3) as of `Frame` at arc lengths (...) [m]."""
        s = np.asarray(s, dtype=float)
        along = self.line.tangents(s.ravel()).reshape(*s.shape, 3)
        first = np.eye(3)[self._start] - along[..., self._start, None] * along
        first /= np.linalg.norm(first, axis=-1, keepdims=True)
        return self.line.points(s.ravel()).reshape(along.shape), np.stack(
            [first, np.cross(along, first), along], axis=-2
        )

    def frame(self, fraction: float) -> Frame:
        """Return the plane at a fraction of the length."""
        return Frame(*self.frames(fraction * self.length))

    def around(self, points: Array) -> tuple[Array, Array]:
        """Return the angle [rad, -pi to pi] around the vessel and the position along it [m] of points (n, 3)."""
        position = self.line.coordinate(points)
        centres, axes = self.frames(position)
        x, y = np.einsum("nij,nj->in", axes[:, :2], points - centres)
        return np.arctan2(y, x), position


@dataclass(frozen=True)
class StoredVessel(Vessel):
    """A vessel as the manifest of a run describes it.

    Attributes:
        further: points [m] of the other centrelines of a branched vessel, by name.
    """

    further: Mapping[str, tuple[Point, ...]] = field(default_factory=dict)

    @classmethod
    def of_entry(cls, name: str, entry: Mapping[str, Any]) -> StoredVessel:
        """Return what an entry of `vessels` in a manifest describes; lengths there are in m."""
        line = _points(entry)
        return cls(
            name,
            lumen=entry.get("lumen"),
            interface=entry.get("interface") or "",
            wall=entry.get("wall"),
            outer=entry.get("outer"),
            inlets=tuple(entry.get("inlets") or ()),
            outlets=tuple(entry.get("outlets") or ()),
            centreline=line if len(line) > 1 else None,
            radius=float(entry.get("radius_m") or 1.0),
            further={branch: _points(one) for branch, one in (entry.get("branches") or {}).items()},
        )

    def of_branch(self, name: str) -> StoredVessel:
        """Return the vessel with the centreline of that name as its own.

        Raises:
            OutputError: it has none of that name.
        """
        if name not in self.further:
            known = ", ".join(f"'{branch}'" for branch in self.further) or "none"
            raise OutputError(f"the vessel '{self.name or self.interface}' has no branch '{name}': it has {known}")
        others = {"": self.centreline or (), **self.further}
        return replace(self, centreline=others.pop(name), further=others)

    def has_near(self, points: Array) -> Mask:
        """Return which of points (n, 3) [m] of the vessel are around its centreline, and not around another of its."""
        if not self.further:
            return np.ones(len(points), dtype=bool)
        lines = [self.course.line, *(Centreline(points) for points in self.further.values())]
        away = np.array([np.linalg.norm(points - line.points(line.coordinate(points)), axis=1) for line in lines])
        return np.asarray(away[0] <= SAME_LINE * away.min(axis=0))

    @cached_property
    def course(self) -> Course:
        """Where it leads.

        Raises:
            OutputError: it has no centreline, as in a plane section.
        """
        if self.centreline is None:
            raise OutputError(f"the vessel '{self.name or self.interface}' has no centreline, as in a plane section")
        return Course(self.centreline)


def _points(entry: Mapping[str, Any]) -> tuple[Point, ...]:
    """Return the points of a centreline [m]."""
    return tuple((float(x), float(y), float(z)) for x, y, z in entry.get("centreline_m") or ())
