"""Flow in a vein with a rigid wall: the blood of the coupled system alone, steady or over breathing cycles."""

from __future__ import annotations

from dataclasses import dataclass

import ngsolve as ng
import numpy as np
from numpy.typing import NDArray

from ngfsi.case import Case, Conditions, Discretisation, Loads, Materials, TimeStepping
from ngfsi.config.functions import FlowCurve, PressureConstant
from ngfsi.config.model import ConfigModel
from ngfsi.linear.backends import choose_backend
from ngfsi.materials import Newtonian
from ngfsi.measure.shear_history import ShearHistory
from ngfsi.measure.wall import Wall
from ngfsi.mesh.domain import Domain
from ngfsi.solve.initial import steady_flow
from ngfsi.solve.time_loop import TimeLoop
from ngfsi.system.system import System

Array = NDArray[np.float64]

SAME = 0.01
"""Cycles whose wall shear stress differs by less, in the mean over wall and cycle, are taken as periodic."""
MOST_CYCLES = 6


def rigid_case(
    geometry: ConfigModel, blood: Newtonian, flow: FlowCurve, *, order: int, step: float = 1.0, end: float = 1.0
) -> Case:
    """Return the case of flow through a rigid vein into an outlet of pressure 0; `end` in s is that of one cycle."""
    rest = PressureConstant(value=0.0)
    return Case(
        name="rigid-vein",
        geometry=geometry,
        materials=Materials(fluid=blood),
        loads=Loads(skin_pressure=rest, inlet_flow=flow, outlet_pressure=rest),
        conditions=Conditions(ends="clamped"),
        discretisation=Discretisation(order=order),
        time=TimeStepping(step=step, end=end),
    )


def steady(case: Case, domain: Domain | None = None) -> System:
    """Return the system in steady flow under the loads of t = 0.

    Raises:
        SolverError: no steady flow was found.
    """
    system = System(case, domain or Domain.build(case.geometry))
    with ng.TaskManager():
        steady_flow(system, choose_backend(case.solver.linear))
    return system


@dataclass(frozen=True)
class Cycle:
    """The last of some cycles.

    Attributes:
        history: TAWSS, OSI, RRT at points of the wall.
        points: (n, 3) these, m.
        times: (m,) s within the cycle.
        mean_shear: (m,) mean of the wall shear stress's magnitude over the points, Pa.
        changes: of each cycle against the one before, relative; the last is below `SAME` if the state is periodic.
    """

    history: ShearHistory
    points: Array
    times: Array
    mean_shear: Array
    changes: tuple[float, ...]

    @property
    def periodic(self) -> bool:
        """Whether the last cycle repeats the one before."""
        return bool(self.changes) and self.changes[-1] < SAME


def pulsatile(case: Case, domain: Domain | None = None) -> Cycle:
    """March cycles of length `case.time.end` from the steady flow of t = 0 until they repeat.

    Raises:
        SolverError: a step failed.
    """
    system = System(case, domain or Domain.build(case.geometry))
    newton = steady_flow(system, choose_backend(case.solver.linear))
    period, steps = case.time.end, case.time.steps
    long = case.replace(**{"time.end": MOST_CYCLES * period})
    wall = Wall(system)
    before: Array | None = None
    changes: list[float] = []
    rows, times = [_shear(wall)], [0.0]
    for step in TimeLoop(long, system, newton).run():
        rows.append(_shear(wall))
        times.append(step.time)
        if step.index % steps:
            continue
        cycle = np.array(rows[-steps - 1 :])
        if before is not None:
            changes.append(float(np.linalg.norm(cycle - before, axis=2).mean() / np.linalg.norm(cycle, axis=2).mean()))
            if changes[-1] < SAME:
                break
        before = cycle
    cycle, at = np.array(rows[-steps - 1 :]), np.array(times[-steps - 1 :])
    history = ShearHistory.of(at, cycle)
    mean = np.linalg.norm(cycle, axis=2).mean(axis=1)
    return Cycle(history, wall.sample(1).points, at - at[0], mean, tuple(changes))


def _shear(wall: Wall) -> Array:
    wall.refresh()
    return wall.sample(1).tangential
