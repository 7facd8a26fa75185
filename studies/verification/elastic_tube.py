"""A pulse of pressure in a straight elastic tube."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from geometry.segment import MeshSettings
from geometry.tube import BareTube
from ngfsi.case import Case, Conditions, Discretisation, Loads, Materials, Solver, TimeStepping
from ngfsi.curves import PressureConstant
from ngfsi.domain import Domain
from ngfsi.materials import Newtonian, SaintVenantKirchhoff
from ngfsi.solve.linear import choose_backend
from ngfsi.solve.newton import Newton
from ngfsi.solve.system import System
from ngfsi.solve.timeloop import TimeLoop
from ngfsi.verify import Setting

Array = NDArray[np.float64]

LENGTH, RADIUS, WALL = 50e-3, 5e-3, 1e-3
FLUID = Newtonian(density=1e3, viscosity=3e-3)
SOLID = SaintVenantKirchhoff(young=3e5, poisson=0.3, density=1200.0)
PRESSURE, DURATION, END = 1333.2, 3e-3, 20e-3
STATIONS = (0.25, 0.5, 0.75)
"""Places, over the length, where the inner wall's displacement is recorded."""
MOENS_KORTEWEG = float(np.sqrt(SOLID.young * WALL / (2 * FLUID.density * RADIUS)))
SAME_TIME = 1e-9


class Pulse(PressureConstant):  # type: ignore[valid-type, misc]
    """A pressure that is there from the start and gone after `DURATION`."""

    def __call__(self, t: float) -> float:
        return float(self.value) if t <= DURATION + SAME_TIME else 0.0

    @property
    def breakpoints(self) -> tuple[float, ...]:
        return (DURATION,)


def run(setting: Setting) -> Array:
    """Return rows of time (s) and, at each station, radial and axial displacement (m) of the inner wall."""
    order = setting["order"]
    geometry = BareTube(
        length=LENGTH, lumen_diameter=2 * RADIUS, wall_thickness=WALL,
        mesh=MeshSettings(element="mixed", axial_layers=setting["layers"], far_size=5e-3, vein_size=5e-3,
                          lumen_radii=setting["radii"], curving_order=order),
    )  # fmt: skip
    case = Case(
        name="verification", geometry=geometry, materials=Materials(wall=SOLID, fluid=FLUID),
        loads=Loads(skin_pressure=PressureConstant(value=0.0), outlet_pressure=PressureConstant(value=0.0),
                    inlet_pressure=Pulse(value=PRESSURE)),
        conditions=Conditions(ends="clamped"),
        discretisation=Discretisation(order=order),
        time=TimeStepping(step=setting["step"], end=END, scheme="bdf2"),
        solver=Solver(compile=setting.get("compile", False), tolerance=1e-6),
    )  # fmt: skip
    system = System(case, Domain.build(geometry))
    system.set_steady()
    newton = Newton(system, choose_backend("auto"))
    field = system.state.components[0]
    # on the ring of the interface, a hair inside of the wall
    places = [(RADIUS * (1 + 1e-6), 0.0, share * LENGTH) for share in STATIONS]
    points = system.domain.on_straight_mesh(np.array(places))
    rows = [np.zeros(1 + 2 * len(STATIONS))]
    for step in TimeLoop(case, system, newton, str, _ignore).run():
        print(
            step.index,
            step.time,
            step.size,
            step.solution.iterations,
            step.solution.factorisations,
            f"{step.seconds:.2f}",
            system.unknowns.size,
            flush=True,
        )
        moved = np.array(field(system.domain.mesh(*points.T)))
        rows.append(np.concatenate([[step.time], moved[:, [0, 2]].ravel()]))
    return np.array(rows)


def _ignore(_line: Any) -> None:
    return None


if __name__ == "__main__":
    import sys
    import time

    t = time.time()
    o, l, s = int(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3])
    radii = tuple(map(float, sys.argv[4].split(",")))
    rows = run({"order": o, "layers": l, "step": s, "radii": radii, "compile": len(sys.argv) > 5})
    np.save(f"/tmp/s3/tube_{o}_{l}_{s}_{len(radii)}.npy", rows)
    for r in rows[:: max(1, len(rows) // 25)]:
        print(*(f"{x:.4e}" for x in r))
    print(time.time() - t, rows[:, 3].max(), rows[:, 4].min(), rows[:, 4].max())
