"""Wall shear stress over time at material points of the moving wall: TAWSS, its gradient, OSI, RRT.

The stress is taken by its components along and around the vein on the wall (`WallSample.tangential`), so that a wall
that turns does not look like a stress that turns.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ngfsi.arrays import Array
from ngfsi.units import SAME_TIME

if TYPE_CHECKING:
    import pyvista as pv


@dataclass(frozen=True)
class ShearHistory:
    """Of each point.

    Attributes:
        tawss: time-averaged wall shear stress, mean of |tau| (Pa).
        osi: oscillatory shear index, (1 - |mean of tau| / mean of |tau|) / 2, from 0 to 1/2 (He and Ku, J Biomech Eng
            118, 1996); 0 where there is no stress.
        rrt: relative residence time, 1 / ((1 - 2 OSI) TAWSS) (1/Pa; Himburg et al., Ann Biomed Eng 32, 2004); infinite
            where the mean of tau vanishes.
    """

    tawss: Array
    osi: Array
    rrt: Array

    @classmethod
    def of(cls, times: Array, shear: Array) -> ShearHistory:
        """Return the averages over time, by the trapezoidal rule.

        Args:
            times: (n,) s, increasing, at least two.
            shear: (n, points, components) Pa.

        Raises:
            ValueError: fewer than two times, or as many times as stresses are not given.
        """
        from scipy.integrate import trapezoid  # takes half a second, which reading a run need not wait for

        if len(times) < 2 or len(times) != len(shear):
            raise ValueError(f"averages need two times or more, with a stress each: {len(times)}, {len(shear)}")
        span = times[-1] - times[0]
        size = trapezoid(np.linalg.norm(shear, axis=2), times, axis=0) / span
        vector = np.linalg.norm(trapezoid(shear, times, axis=0) / span, axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            osi = np.where(size > 0, (1 - vector / size) / 2, 0.0)
            return cls(size, osi, np.where(vector > 0, 1 / vector, np.inf))


def within(times: Array, values: Array, start: float, end: float) -> tuple[Array, Array]:
    """Return the times (m,) from `start` to `end` (s), both included, and the values (m, ...) then: at the ends by
    lines between the given ones, so that an average over them is one over exactly that time, whatever the steps.

    Args:
        times: (n,) s, increasing, at least two, around start and end.
        values: (n, ...)
    """

    def at(time: float) -> Array:
        k = int(np.clip(np.searchsorted(times, time), 1, len(times) - 1))
        done = np.clip((time - times[k - 1]) / (times[k] - times[k - 1]), 0.0, 1.0)
        return np.asarray((1 - done) * values[k - 1] + done * values[k])

    inside = (times > start + SAME_TIME) & (times < end - SAME_TIME)
    return np.r_[start, times[inside], end], np.stack([at(start), *values[inside], at(end)])


def slope(surface: pv.UnstructuredGrid, name: str) -> Array:
    """Return the size of the gradient of a point field along a surface, at its points (unit of the field per m)."""
    gradient = surface.compute_derivative(scalars=name, gradient="slope").point_data["slope"]
    return np.asarray(np.linalg.norm(gradient, axis=1))
