"""Transmission of the load from the skin to the vein: pressure of the tissue around the vein's wall."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree
from scipy.stats import binned_statistic

from ngfsi.arrays import Array
from ngfsi.errors import OutputError
from ngfsi.store.fields import DISPLACEMENT, REGION
from ngfsi.store.stored import StoredRun

SAME_NODE = 1e-4
"""Nodes of tissue and wall this close, as a fraction of the lumen's radius, are one node of the face between them; they
are stored with single precision."""
ANGLES = 24
PRESSURE = "hydrostatic_pressure_Pa"


@dataclass(frozen=True)
class Surroundings:
    """The tissue at the outer face of the vein's wall, at the nodes of its cells there.

    Attributes:
        angle: rad from x (see `Course.start`), of the reference shape, -pi to pi.
        pressure: hydrostatic, -tr(sigma)/3, compression positive, Pa.
    """

    angle: Array
    pressure: Array

    @classmethod
    def of(cls, run: StoredRun, time: float) -> Surroundings:
        """Return what is stored nearest to `time` (s) around the vessel, of a branched one around its centreline.

        Raises:
            OutputError: the vessel has no wall in tissue, or the run holds no hydrostatic pressure.
        """
        found = run.own_vessel
        tissue = {*run.case.geometry.solids} - {other.wall for other in run.vessels.values()}
        if found.wall is None or not tissue:
            raise OutputError(f"the run in '{run.path}' has no tissue around a wall of the vessel")
        grid = run.fields(time)
        if PRESSURE not in grid.point_data:
            raise OutputError(f"the run in '{run.path}' holds no hydrostatic pressure: compute it again")
        regions = np.array([str(name) for name in grid.field_data["regions"]])
        parts = [
            grid.extract_cells(np.flatnonzero(np.isin(regions, list(names))[grid.cell_data[REGION]]))
            for names in (tissue, {found.wall})
        ]
        around, wall = (np.asarray(part.points - part.point_data[DISPLACEMENT], dtype=float) for part in parts)
        there = cKDTree(wall).query(around)[0] < SAME_NODE * found.radius
        there[there] = found.has_near(around[there])
        angle, _ = found.course.around(around[there])
        return cls(angle, np.asarray(parts[0].point_data[PRESSURE], dtype=float)[there])

    def by_angle(self) -> tuple[Array, Array]:
        """Return the middles of even sectors (rad) and the mean pressure (Pa) in each, NaN where no node is."""
        mean, edges, _ = binned_statistic(self.angle, self.pressure, "mean", ANGLES, (-np.pi, np.pi))
        return (edges[1:] + edges[:-1]) / 2, mean


def transmission(run: StoredRun) -> Array:
    """Return the pressure transmission factor over time: rise of the tissue's pressure at the vessel's wall since
    t = 0, mean over its area, over that of the skin's mean pressure; NaN while the skin's has not changed.

    Raises:
        OutputError: there is no tissue around the vessel.
    """
    if "p_tissue_side_Pa" not in run.series:
        raise OutputError(f"the run in '{run.path}' has no tissue around the vessel")
    arrived = run.series["p_tissue_side_Pa"] - run.series["p_tissue_side_Pa"][0]
    rise = np.zeros_like(arrived) if run.skin_pressure is None else run.skin_pressure - run.skin_pressure[0]
    return np.asarray(np.divide(arrived, rise, out=np.full_like(arrived, np.nan), where=rise != 0))
