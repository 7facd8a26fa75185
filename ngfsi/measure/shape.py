"""Shape of the lumen in sections perpendicular to the vein's axis, wherever that leads.

SciPy is loaded when there is something to measure, as in `sections`.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from ngfsi.measure.sections import Outlines, Sections

Array = NDArray[np.float64]

CUTS = 3
"""Centroids, and with them the axis, move when the vessel is cut anew."""
ALONG_X = 0.9
"""Component of an axis above which angles are counted from y instead of x."""


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
        angle: of the major axis against x in the section's plane (rad), from -pi/2 to pi/2; against y where the vessel
            runs along x.
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

        Their outlines are looked at along the axis: exact where the vessel is a cylinder, straight or oblique, from one
        side of the outline to the other. Where a free end has moved in, planes before it cut no whole outline: there
        stands the nearest section that is whole.

        Args:
            cut: cut the vessel anew, perpendicular to its axis, as a curved one needs; where such a plane leaves the
                vessel through an end, the outline perpendicular to the centreline stays.
        """
        heights, first = sections.heights[sections.whole], sections.planes(sections.whole)
        found = cls._of(sections.outlines, heights)
        for _ in range(CUTS if cut else 0):
            centres, axes = found.centre.copy(), found.axis.copy()
            outlines, whole = sections.across(centres, axes)
            if not np.all(whole):
                for planes, at_first in zip((centres, axes), first, strict=True):
                    planes[~whole] = at_first[~whole]
                outlines, _ = sections.across(centres, axes)
            found = cls._of(outlines, heights)
        return found._taken(sections.nearest_whole())

    def _taken(self, numbers: NDArray[np.int64]) -> Self:
        """Return the shapes of those sections."""
        return replace(self, **{field.name: getattr(self, field.name)[numbers] for field in fields(self)})

    @classmethod
    def _of(cls, outlines: Outlines, heights: Array) -> Self:
        """Return the shape of outlines at positions along the vessel (m)."""
        from scipy.interpolate import CubicSpline

        points, tangents, curve, integral = outlines.points, outlines.tangents(), outlines.curve, outlines.integral
        lengths = np.linalg.norm(tangents, axis=2)
        centre = np.stack([integral(points[..., i] * lengths) for i in range(3)], axis=1) / integral(lengths)[:, None]
        for _ in range(2):  # the centroid is known once the plane is, which needs the axis: a rough one first
            axis = CubicSpline(heights, centre)(heights, 1)
            axis /= np.linalg.norm(axis, axis=1)[:, None]
            first = np.where(np.abs(axis[:, :1]) < ALONG_X, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
            first = first - np.sum(first * axis, axis=1)[:, None] * axis
            first /= np.linalg.norm(first, axis=1)[:, None]
            second = np.cross(axis, first)
            x, y = (np.einsum("apc,ac->ap", points - centre[curve][:, None], way[curve]) for way in (first, second))
            dx, dy = (np.einsum("apc,ac->ap", tangents, way[curve]) for way in (first, second))
            area = integral(x * dy - y * dx) / 2
            offsets = integral(x**2 * dy) / (2 * area), -integral(y**2 * dx) / (2 * area)
            centre = centre + offsets[0][:, None] * first + offsets[1][:, None] * second
        x, y = x - offsets[0][curve][:, None], y - offsets[1][curve][:, None]
        xx, yy, xy = (integral(f) for f in (x**3 * dy / 3, -(y**3) * dx / 3, x**2 * y * dy / 2))
        perimeter = integral(np.hypot(dx, dy))
        spread, mean = np.hypot((xx - yy) / 2, xy), (xx + yy) / 2
        ratio = np.sqrt((mean + spread) / (mean - spread))
        size = np.sqrt(area / np.pi)
        return cls(
            centre=centre,
            axis=axis,
            area=area,
            perimeter=perimeter,
            hydraulic_diameter=4 * area / perimeter,
            circularity=4 * np.pi * area / perimeter**2,
            major=size * np.sqrt(ratio),
            minor=size / np.sqrt(ratio),
            angle=np.arctan2(2 * xy, xx - yy) / 2,
        )

    def rows(self, time: float) -> list[dict[str, float]]:
        """Return a row of a table for each station; time in s."""
        return [
            {
                "time_s": time,
                "station": station,
                **{f"centre_{name}_m": float(self.centre[station, i]) for i, name in enumerate("xyz")},
                "area_m2": float(self.area[station]),
                "perimeter_m": float(self.perimeter[station]),
                "hydraulic_diameter_m": float(self.hydraulic_diameter[station]),
                "circularity_1": float(self.circularity[station]),
                "major_semiaxis_m": float(self.major[station]),
                "minor_semiaxis_m": float(self.minor[station]),
                "major_angle_rad": float(self.angle[station]),
            }
            for station in range(len(self.area))
        ]
