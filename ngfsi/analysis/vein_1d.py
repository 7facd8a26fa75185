"""Flow in a collapsible vein in one dimension: seconds instead of minutes, and no more than the tube law knows.

A_t + (A u)_x = 0,  rho (u_t + u u_x) = -p_x - 2 tau / R,  p = p_e + T(A)

with the mean velocity u, the external pressure p_e, and circles of radius R (wetted perimeter over area: 2 / R). The
wall shear stress is that of laminar flow whose mean velocity changes (Zielke, J Basic Eng 90 (1968) 109):

tau = 4 mu u / R + 2 mu / R sum_k m_k y_k,  y_k' = u' - n_k nu / R^2 y_k

Where the blood thins under shear, mu is the viscosity that developed flow of the present velocity has in a round pipe,
`FluidLaw.developed_viscosity`: exact for slow changes.

with m_k = 1 and the squared zeros n_k of the Bessel function J_2. A last mode stands for all beyond: it adds what they
lack in sum m_k / n_k = 1/12 and sum m_k / n_k^2 = 1/576, the answers to a slowly changing acceleration. What the walls'
own motion and the way from the inlet do to the profile is left out. Area at the middles of cells, velocity at their
faces, central differences; time by scipy.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import root
from scipy.special import jn_zeros

from ngfsi.analysis.tube_law import TubeLaw
from ngfsi.arrays import Array
from ngfsi.errors import SolverError

OverTime = Callable[[float], float]

CELLS = 30
"""Of a vein that is compared with a run. With twice as many the calf's flow differs by 0.1 %, SAWSS by 0.9 % (rms)."""
TOLERANCE, SLOW = 1e-7, 1e-2
"""Of the time integration, relative; below this fraction of the wave speed velocities are held against that."""
_ZEROS = jn_zeros(2, 12) ** 2
_LACKING = 1 / 12 - np.sum(1 / _ZEROS), 1 / 576 - np.sum(1 / _ZEROS**2)
RATES = np.append(_ZEROS, _LACKING[0] / _LACKING[1])[:, None]
WEIGHTS = np.append(np.ones_like(_ZEROS), _LACKING[0] ** 2 / _LACKING[1])
MODES = len(WEIGHTS)
STEADY = 1e-9
"""Accelerations in a steady state, over those of waves that empty the vein."""


@dataclass(frozen=True)
class Solution:
    """What was computed, at given times.

    Attributes:
        times: (n,) s
        places: (cells,) middles of the cells along the vein, m.
        area: (n, cells) m2
        flow: (n, cells + 1) through the faces, from inlet to outlet, m3/s.
        shear: (n, cells) magnitude of the wall shear stress at the faces after the cells, Pa.
    """

    times: Array
    places: Array
    area: Array
    flow: Array
    shear: Array

    @property
    def mean_area(self) -> Array:
        """Volume over length, m2."""
        return np.asarray(self.area.mean(axis=1))

    @property
    def sawss(self) -> Array:
        """Wall shear stress (Pa), mean over the wall."""
        perimeter = np.sqrt(self.area)
        return np.asarray(np.sum(self.shear * perimeter, axis=1) / np.sum(perimeter, axis=1))


@dataclass(frozen=True)
class CollapsibleVein:
    """A vein with a given inflow and outlet pressure.

    Attributes:
        law: with parameters at the middles of even cells.
        length: m
        density: of the blood, kg/m3.
        viscosity: of the blood (Pa s), of 4 u / R (1/s), the wall shear rate of a constant one.
        inflow: m3/s over time.
        outlet_pressure, external_pressure: Pa over time.
    """

    law: TubeLaw
    length: float
    density: float
    viscosity: Callable[[Array], Array | float]
    inflow: OverTime
    outlet_pressure: OverTime
    external_pressure: OverTime

    def solve(self, times: Array) -> Solution:
        """Return the flow at times (n,) [s], the first of them in the steady state of its loads.

        Raises:
            SolverError: there is no steady state, or the flow chokes (is as fast as its waves), and when.
        """
        start = self.steady(float(times[0]))
        cells = len(start) // (2 + MODES)
        speeds = SLOW * self.law.wave_speed(start[:cells], self.density)
        scales = np.concatenate([start[:cells], *[speeds] * (1 + MODES)])
        with np.errstate(invalid="ignore"):  # of trial steps that go too far, which are then shortened
            found = solve_ivp(self.rates, (times[0], times[-1]), start, t_eval=times, rtol=TOLERANCE,
                              atol=TOLERANCE * scales)  # fmt: skip
        states = found.y.reshape(2 + MODES, cells, -1)
        area, velocity = states[0], states[1]
        self._refuse_choked(found.t, area, velocity)
        if found.status != 0:
            raise SolverError(
                f"the one-dimensional vein collapses: it cannot be followed beyond t = {found.t[-1]:.4g} s"
            )
        inflow = np.array([self.inflow(time) for time in times])
        return Solution(
            times=times,
            places=(np.arange(cells) + 0.5) * self.length / cells,
            area=area.T,
            flow=np.column_stack([inflow, (velocity * _at_faces(area)).T]),
            shear=np.abs(self._shear(states)).T,
        )

    def rates(self, time: float, state: Array) -> Array:
        """Return the rates of areas in the cells, then of velocities and modes at their ends, ((2 + modes) cells,)."""
        states = state.reshape(2 + MODES, -1)
        area, velocity, modes = states[0], states[1], states[2:]
        size = self.length / len(area)
        faces, inflow = _at_faces(area), self.inflow(time)
        flow = np.append(inflow, velocity * faces)
        pressure = self.external_pressure(time) + self.law.pressure(area)
        beyond = 2 * self.outlet_pressure(time) - pressure[-1]  # so that the outlet's face has the outlet's pressure
        squares = np.append(inflow / _at_faces(area[::-1])[-1], velocity) ** 2
        convection = np.append(squares[2:] - squares[:-2], 3 * squares[-1] - 4 * squares[-2] + squares[-3]) / (4 * size)
        force = -np.diff(pressure, append=beyond) / size - 2 * self._shear(states) / np.sqrt(faces / np.pi)
        acceleration = force / self.density - convection
        decay = self._viscosity(velocity, faces) / self.density * np.pi / faces * RATES
        return np.concatenate([-np.diff(flow) / size, acceleration, (acceleration - decay * modes).ravel()])

    def _shear(self, states: Array) -> Array:
        """Return the wall shear stress (Pa) at the faces after the cells."""
        faces, velocity, modes = _at_faces(states[0]), states[1], np.tensordot(WEIGHTS, states[2:], axes=1)
        viscosity = self._viscosity(velocity, faces)
        return np.asarray(viscosity * (4 * velocity + 2 * modes) / np.sqrt(faces / np.pi))

    def _viscosity(self, velocity: Array, area: Array) -> Array | float:
        return self.viscosity(4 * velocity / np.sqrt(area / np.pi))

    def steady(self, time: float) -> Array:
        """Return the steady state under the loads at a time (s), as in `rates`.

        Raises:
            SolverError: there is none.
        """
        guess = self.law.area_at(self.outlet_pressure(time) - self.external_pressure(time) + 0 * self.law.area)
        inflow = self.inflow(time)

        def state(scaled: Array) -> Array:
            area = scaled * guess
            return np.concatenate([area, inflow / _at_faces(area), np.zeros(MODES * len(area))])

        def lacking(scaled: Array) -> Array:
            scale = self.law.slope(guess) * guess / (self.density * self.length)
            return np.asarray(self.rates(time, state(scaled))[len(guess) : 2 * len(guess)] / scale)

        with np.errstate(invalid="ignore"):
            found = root(lacking, np.ones_like(guess), tol=1e-12)
        start = state(found.x)
        if not np.max(np.abs(found.fun)) < STEADY or not np.all(start[: len(guess)] > 0):
            raise SolverError(f"the one-dimensional vein has no steady flow under its loads at t = {time:.4g} s")
        self._refuse_choked(np.array([time]), *start.reshape(2 + MODES, -1, 1)[:2])
        return start

    def _refuse_choked(self, times: Array, area: Array, velocity: Array) -> None:
        slower = np.abs(velocity.T) < self.law.wave_speed(area.T, self.density)
        if not slower.all():
            when = times[np.argmin(slower.all(axis=1))]
            raise SolverError(f"the one-dimensional vein chokes at t = {when:.4g} s: its blood is as fast as its waves")


def _at_faces(area: Array) -> Array:
    """Return the areas at the faces after the cells (cells, ...); that of the outlet by extrapolation."""
    return np.concatenate([(area[1:] + area[:-1]) / 2, (3 * area[-1:] - area[-2:-1]) / 2])
