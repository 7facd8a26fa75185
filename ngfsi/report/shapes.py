"""Shapes of stored runs for charts and pictures: solids, half of them, unrolled wall, and where to look from."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ngfsi.arrays import Array
from ngfsi.store.fields import DISPLACEMENT, REGION
from ngfsi.store.stored import StoredRun
from ngfsi.store.vessels import Course, Frame
from ngfsi.units import Shown, from_si

SHEAR = "wall_shear_magnitude_Pa"
WSS, MOVED = Shown("wall shear stress", "Pa"), Shown("displacement", "mm")
AROUND, ALONG = 121, 61
"""Points of an unrolled wall."""
OFF_FACES = 0.01
"""Fraction of the length by which a cut lies off mid-length, where the faces between elements are: VTK finds a point of
a face in either of its elements or in none."""
FROM_THE_SIDE, FROM_ABOVE, FROM_BEHIND = (0.2, 1.1, 0.2), (0.9, -2.1, 2.0), (0.4, -0.7, 0.6)
"""Ways to look, as components along the axes of a `Frame`."""


def course(run: StoredRun) -> Course:
    """Return where the run's vessel leads; without one with a centreline, a line along z through the middle."""
    if run.vessels and run.own_vessel.centreline is not None:
        return run.own_vessel.course
    bounds = np.reshape(run.fields(0.0).bounds, (3, 2))
    middle = bounds.mean(axis=1)
    height = max(np.ptp(bounds[2]), 1e-3 * np.ptp(bounds[0]))  # of a plane section there is none
    return Course(middle + np.array([[0, 0, -height / 2], [0, 0, height / 2]]))


def first_and_loaded(run: StoredRun) -> tuple[float, float]:
    """Return the first stored time of fields (s), and that nearest to the last time of the largest load."""
    times = run.field_times()
    return times[0], min(times, key=lambda time: abs(time - run.loaded_time))


def solids(run: StoredRun, time: float) -> Any:
    """Return the deformed solids nearest to `time` (s) with the size of their `displacement` in m."""
    grid = run.fields(time)
    blood = np.isin([str(name) for name in grid.field_data["regions"]], sorted(run.lumens))
    solid = grid.extract_cells(np.flatnonzero(~blood[grid.cell_data[REGION]]))
    solid.point_data["displacement"] = np.linalg.norm(solid.point_data[DISPLACEMENT], axis=1)
    return solid


def lower_half(run: StoredRun, time: float) -> Any:
    """Return the solids before the middle of the vessel; those of a plane section whole."""
    solid = solids(run, time)
    if is_plane(solid):
        return solid
    frame = course(run).frame(0.5 + OFF_FACES)
    return solid.clip(frame.axes[2], origin=frame.centre)


def is_plane(grid: Any) -> bool:
    """Return whether a mesh is a plane section."""
    return not np.ptp(grid.bounds[4:])


def middle(run: StoredRun) -> Frame:
    """Return the plane across the middle of the run's vessel."""
    return course(run).frame(0.5)


def evenly(times: Sequence[float], most: int) -> list[float]:
    """Return at most so many of the times, the first and the last among them."""
    chosen = np.linspace(0, len(times) - 1, min(most, len(times))).round().astype(int)
    return [times[i] for i in np.unique(chosen)]


def unroll(run: StoredRun) -> tuple[Array, Array, Array]:
    """Return angles [rad], positions [m] and wall shear stress [Pa] (positions, angles) under the largest load.

    Angle and position are those of a point of the wall at the first stored time; of a branched vessel those points are
    taken that are around its centreline.
    """
    from scipy.interpolate import griddata

    vessel = run.own_vessel
    place, values = run.fields(0.0, "wall").points, run.fields(run.loaded_time, "wall").point_data[SHEAR]
    near = vessel.has_near(np.asarray(place, dtype=float))
    angle, position = vessel.course.around(np.asarray(place, dtype=float)[near])
    angles, positions = np.linspace(-np.pi, np.pi, AROUND), np.linspace(position.min(), position.max(), ALONG)
    # degrees and millimetres are of like size, which the triangulation needs
    all_round = np.concatenate([angle + turn for turn in (-2 * np.pi, 0, 2 * np.pi)])
    known = np.column_stack([from_si(all_round, "deg"), np.tile(from_si(position, "mm"), 3)])
    wanted = tuple(np.meshgrid(from_si(angles, "deg"), from_si(positions, "mm")))
    values = np.tile(np.asarray(values, dtype=float)[near], 3)
    linear, nearest = (griddata(known, values, wanted, method=method) for method in ("linear", "nearest"))
    return angles, positions, np.where(np.isfinite(linear), linear, nearest)
