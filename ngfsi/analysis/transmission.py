"""Transmission of the load from the skin to the vein: pressure of the tissue around the vein's wall."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ngfsi.errors import OutputError
from ngfsi.store.fields import DISPLACEMENT, REGION
from ngfsi.store.stored import Columns, StoredRun

Array = NDArray[np.float64]

SAME_NODE = 1e-4
"""Nodes of tissue and wall this close, as a share of the lumen's radius, are one node of the face between them; they
are stored with single precision."""
ANGLES = 24
PRESSURE = "hydrostatic_pressure_Pa"


@dataclass(frozen=True)
class Surroundings:
    """The tissue at the outer face of the vein's wall, at the nodes of its cells there.

    Attributes:
        angle: rad from x, of the reference shape, -pi to pi.
        pressure: hydrostatic, -tr(sigma)/3, compression positive, Pa.
    """

    angle: Array
    pressure: Array

    @classmethod
    def of(cls, run: StoredRun, time: float) -> Surroundings:
        """Return what is stored nearest to `time` (s).

        Raises:
            OutputError: the run holds no hydrostatic pressure.
        """
        grid, geometry = run.fields(time), run.case.geometry
        if PRESSURE not in grid.point_data:
            raise OutputError(f"the run in '{run.path}' holds no hydrostatic pressure: compute it again")
        regions = [str(name) for name in grid.field_data["regions"]]
        tissue, wall = (
            grid.extract_cells(np.flatnonzero(grid.cell_data[REGION] == regions.index(name)))
            for name in ("tissue", "wall")
        )
        places = [np.asarray(part.points - part.point_data[DISPLACEMENT], dtype=float) for part in (tissue, wall)]
        there = cKDTree(places[1]).query(places[0])[0] < SAME_NODE * geometry.lumen_radius
        x, y = (places[0][there, i] - geometry.vein_centre[i] for i in range(2))
        return cls(np.arctan2(y, x), np.asarray(tissue.point_data[PRESSURE], dtype=float)[there])

    def by_angle(self) -> tuple[Array, Array]:
        """Return the middles of even sectors (rad) and the mean pressure (Pa) in each, NaN where no node is."""
        return _means(self.angle, self.pressure, np.linspace(-np.pi, np.pi, ANGLES + 1))


def transmission(series: Columns) -> Array:
    """Return the pressure transmission factor over time: rise of the tissue's pressure at the vein's wall since t = 0,
    mean over its area, over that of the skin's; NaN while the skin's has not changed."""
    rise = series["skin_pressure_Pa"] - series["skin_pressure_Pa"][0]
    with np.errstate(divide="ignore", invalid="ignore"):
        factor = (series["p_tissue_side_Pa"] - series["p_tissue_side_Pa"][0]) / rise
    return np.where(rise == 0, np.nan, factor)


def _means(places: Array, values: Array, edges: Array) -> tuple[Array, Array]:
    part = np.clip(np.searchsorted(edges, places, side="right") - 1, 0, len(edges) - 2)
    counts, sums = (np.bincount(part, weights, len(edges) - 1) for weights in (None, values))
    with np.errstate(invalid="ignore"):
        return (edges[1:] + edges[:-1]) / 2, sums / counts
