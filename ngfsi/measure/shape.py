"""Shape of the lumen in sections perpendicular to the vessel's axis, wherever that leads.

SciPy is loaded when there is something to measure, as in `sections`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Self

import numpy as np

from ngfsi.arrays import Array, Numbers
from ngfsi.measure.sections import Sections
from ngfsi.mesh.surface import Outlines, across

CUTS = 3
"""Centroids, and with them the axis, move when the vessel is cut anew."""


@dataclass(frozen=True)
class Shape:
    """Of each station; SI.

    Attributes:
        centre: (stations, 3) centroid.
        axis: (stations, 3) unit tangent of the curve through the centroids.
        area, perimeter: m2, m
        hydraulic_diameter: 4 area / perimeter (m).
        circularity: 4 pi area / perimeter^2, 1 for a circle (Cox, J Paleontology 1, 1927).
        major, minor: semi-axes (m) of the ellipse with the same area and ratio of second moments.
        angle: of the major axis against x in the section's plane (rad), from -pi/2 to pi/2; against y where the axis
            is nearly along x.
    """

    centre: Array
    axis: Array
    area: Array
    perimeter: Array
    hydraulic_diameter: Array
    circularity: Array
    major: Array
    minor: Array
    angle: Array

    @classmethod
    def of(cls, sections: Sections, *, cut: bool = False) -> Self:
        """Return the shape in a refreshed set of two whole sections or more.

        Their outlines, perpendicular to the centreline of the mesh, are looked at along the present axis: exact where
        the vessel is a cylinder, straight or oblique, from one side of the outline to the other. Where a free end has
        moved in, planes before it cut no whole outline: there stands the nearest section that is whole. In a branched
        vessel, where centroids jump at a fork, the axis is the centreline of the mesh.

        Args:
            cut: cut the vessel anew, perpendicular to its axis, as a curved one needs; where such a plane leaves the
                vessel through an end, the first outline stays.
        """
        outlines, points, numbers = sections.outlines, sections.points, np.arange(len(sections.stations))
        whole = np.flatnonzero(sections.whole)
        if len(whole) < 2:
            whole = numbers
        nearest = np.argmin(np.abs(numbers[:, None] - whole), axis=1)
        if sections.vessel.branched:
            return cls._of_outlines(outlines, points, sections.stations, whole, sections.normals)._taken(nearest)
        found = cls._of_outlines(outlines, points, sections.stations, whole)
        for _ in range(CUTS if cut else 0):
            planes = found.centre.copy(), found.axis.copy()
            outlines, points = sections.across(*planes)
            if not np.all(outlines.whole):
                for new, old in zip(planes, (sections.centres, sections.normals), strict=True):
                    new[~outlines.whole] = old[whole][~outlines.whole]
                outlines, points = sections.across(*planes)
            found = cls._of_outlines(outlines, points, sections.stations[whole], np.arange(len(whole)))
        return found._taken(nearest)

    @classmethod
    def _of_outlines(
        cls, outlines: Outlines, points: Array, stations: Array, those: Numbers, axis: Array | None = None
    ) -> Self:
        """Return the shape of some of the outlines at stations, from their points (arcs, points, 3).

        Args:
            axis: (stations, 3); None: that of the curve through the centroids.
        """
        from scipy.interpolate import CubicSpline

        spread, integral, tangents = outlines.spread, outlines.integral, outlines.derivative(points)
        centre = outlines.centroids(points)
        for _ in range(2):  # the centroid is known once the plane is, which needs the axis: a rough one first
            along = CubicSpline(stations[those], centre[those])(stations, 1) if axis is None else axis
            along = along / np.linalg.norm(along, axis=1)[:, None]
            first, second = across(along)
            x, y = (np.sum((points - spread(centre)) * spread(way), axis=2) for way in (first, second))
            dx, dy = (np.sum(tangents * spread(way), axis=2) for way in (first, second))
            area = integral(x * dy - y * dx) / 2
            offsets = integral(x**2 * dy) / (2 * area), -integral(y**2 * dx) / (2 * area)
            centre = centre + offsets[0][:, None] * first + offsets[1][:, None] * second
        x, y = x - offsets[0][outlines.station, None], y - offsets[1][outlines.station, None]
        xx, yy, xy = (integral(f) for f in (x**3 * dy / 3, -(y**3) * dx / 3, x**2 * y * dy / 2))
        perimeter = integral(np.hypot(dx, dy))
        spreading, mean = np.hypot((xx - yy) / 2, xy), (xx + yy) / 2
        ratio = np.sqrt((mean + spreading) / (mean - spreading))
        size = np.sqrt(area / np.pi)
        return cls(
            centre=centre, axis=along, area=area, perimeter=perimeter, hydraulic_diameter=4 * area / perimeter,
            circularity=4 * np.pi * area / perimeter**2, major=size * np.sqrt(ratio), minor=size / np.sqrt(ratio),
            angle=np.arctan2(2 * xy, xx - yy) / 2,
        )._taken(those)  # fmt: skip

    def _taken(self, numbers: Numbers) -> Self:
        """Return the shapes of those sections."""
        return replace(self, **{field.name: getattr(self, field.name)[numbers] for field in fields(self)})

    def rows(self, of: Mapping[str, float]) -> list[dict[str, float]]:
        """Return a row of a table for each station, each of which begins with the columns `of`."""
        columns = {f"centre_{name}_m": part for name, part in zip("xyz", self.centre.T, strict=True)} | {
            "area_m2": self.area, "perimeter_m": self.perimeter, "hydraulic_diameter_m": self.hydraulic_diameter,
            "circularity_1": self.circularity, "major_semiaxis_m": self.major, "minor_semiaxis_m": self.minor,
            "major_angle_rad": self.angle,
        }  # fmt: skip
        return [{**of, "station": station} | {name: float(values[station]) for name, values in columns.items()}
                for station in range(len(self.area))]  # fmt: skip
