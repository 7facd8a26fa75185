"""A collapsible tube between two resistances: a waterfall, whose flow does not depend on its height."""

from __future__ import annotations

from typing import Any

import numpy as np
from ngfsi_geometry.segment import MeshSettings
from ngfsi_geometry.tube import BareTube

from ngfsi.case import Case, Conditions, Discretisation, Loads, Materials, TimeStepping
from ngfsi.conditions import ContactModel, OpeningModel, ResistanceOpening
from ngfsi.config.functions import PressureTable
from ngfsi.linear.backends import choose_backend
from ngfsi.materials import CompressibleNeoHookean, Newtonian
from ngfsi.mesh.domain import Domain
from ngfsi.solve.initial import initial_state
from ngfsi.solve.newton import Newton
from ngfsi.solve.time_loop import TimeLoop
from ngfsi.system.system import System
from ngfsi.verify import Benchmark, Reference, Setting, Signals, Values

DROP = 2000.0
"""Of pressure (Pa), from upstream to outside."""
OUTSIDE = 3000.0
FLOW = 1e-6
"""Of blood from upstream over that drop (m3/s)."""
UPSTREAM_RESISTANCE = DROP / FLOW
DOWNSTREAM_RESISTANCE = UPSTREAM_RESISTANCE / 5
FALLS, LIMITED, LOW, PRESSED, FED = 0.15, 0.3, 0.6, 0.8, 1.0
"""Until when (s, of a sequence of states at rest): the pressure downstream falls until the tube has collapsed, further,
and much further; the pressure outside rises; that upstream rises."""
DOWNSTREAM = (2700.0, 2400.0, 2000.0, 500.0)
MORE_OUTSIDE, MORE_UPSTREAM = 0.1, 0.2
"""Rises, over the drop."""
WALL = CompressibleNeoHookean(young=10e3, poisson=0.4, density=1000.0)
FLUID = Newtonian(density=1000.0, viscosity=0.1)
"""So viscous that the flow (Reynolds number 1) never reaches the speed of waves, where states at rest end."""


def case_of(setting: Setting) -> Case:
    """Return the case of a tube at rest under pressures that change one after the other."""
    order = setting["order"]
    mesh = MeshSettings(axial_layers=setting["layers"], far_size=20e-3, vein_size=6e-3, lumen_radii=(),
                        curving_order=order)  # fmt: skip
    outside = PressureTable(times=(LOW, PRESSED), values=(OUTSIDE, OUTSIDE + MORE_OUTSIDE * DROP))
    upstream = PressureTable(times=(PRESSED, FED), values=(OUTSIDE + DROP, OUTSIDE + (1 + MORE_UPSTREAM) * DROP))
    downstream = PressureTable(times=(0.0, FALLS, LIMITED, LOW), values=DOWNSTREAM)
    openings: dict[str, OpeningModel] = {
        "inlet": ResistanceOpening(resistance=UPSTREAM_RESISTANCE, distal_pressure=upstream),
        "outlet": ResistanceOpening(resistance=DOWNSTREAM_RESISTANCE, distal_pressure=downstream),
    }
    return Case(
        name="flow_limitation",
        geometry=BareTube(
            length=20e-3, lumen_diameter=10e-3, aspect_ratio=2.0, wall_thickness=1e-3, mesh=mesh
        ),
        materials=Materials(wall=WALL, fluid=FLUID),
        loads=Loads(skin_pressure=outside, openings=openings),
        conditions=Conditions(ends="roller", contact=ContactModel(residual_gap=0.05)),
        discretisation=Discretisation(order=order),
        time=TimeStepping(scheme="static", step=0.05, end=FED),
    )  # fmt: skip


def compute(setting: Setting) -> tuple[Values, Signals]:
    """Return the flows, over what they must be, and all pressures (Pa) and the flow (m3/s) on the way."""
    case = case_of(setting)
    system = System(case, Domain.build(case.geometry))
    newton = Newton(system, choose_backend("auto"))
    initial_state(system, newton)
    acting: dict[str, Any] = dict(system.conditions)
    inlet, outlet, skin = acting["inlet"], acting["outlet"], acting["on the skin"]

    def row(time: float) -> list[float]:
        given = [one.value.Get() for one in (inlet, skin, outlet)]
        return [time, *given, inlet.given_pressure(), outlet.given_pressure(), outlet.outflow()]

    rows = [row(0.0)]
    rows += [row(step.time) for step in TimeLoop(case, system, newton).run()]
    found = np.array(rows)
    flow = {time: found[int(np.argmin(np.abs(found[:, 0] - time))), -1] for time in (0.0, LIMITED, LOW, PRESSED, FED)}
    open_tube = (OUTSIDE + DROP - DOWNSTREAM[0]) / (UPSTREAM_RESISTANCE + DOWNSTREAM_RESISTANCE)
    values = {
        "open tube": flow[0.0] / open_tube,
        "collapsed tube": flow[LOW] / FLOW,
        "pressure downstream falls": flow[LOW] / flow[LIMITED] - 1,
        "pressure outside rises": flow[PRESSED] / flow[LOW],
        "pressure upstream rises": flow[FED] / flow[LOW],
    }
    names = ("time_s", "upstream_Pa", "outside_Pa", "downstream_Pa", "inlet_Pa", "outlet_Pa", "flow_m3_s")
    return values, Signals(names, found)


CASE = Benchmark(
    title="Flow limitation in a collapsible tube (waterfall)",
    solves="states at rest of an oval tube (2 : 1, length twice its diameter, wall a fifth of its radius), fed through "
    "a resistance and drained through a fifth of it, with blood of 100 mPa s: the pressure downstream falls from "
    "300 Pa below the one outside, where the tube is open, to 2500 Pa below it; then the pressure outside rises, then "
    "that upstream. The tube touches itself (`[conditions.contact]`, residual gap 0.05)",
    exact="the flow of an open tube is that of the two resistances; once the tube has collapsed, that of the "
    "pressure upstream beyond the one outside over the resistance upstream, whatever the pressure downstream. The "
    "stiffness of the wall leaves 10 of 2000 Pa at the inlet of the tube",
    compute=compute,
)
LEVELS = {
    "ci": {"k = 2": ({"order": 2, "layers": 3, "h": 1 / 3},)},
    "full": {"k = 2": tuple({"order": 2, "layers": n, "h": 1 / n} for n in (3, 6))},
}
SOURCE = "S. Permutt and R. L. Riley, J Appl Physiol 18 (1963) 924"
REFERENCES = (
    Reference("open tube", 1.0, "1", 1e-2, "Ohm's law"),
    Reference("collapsed tube", 1.0, "1", 2e-2, SOURCE),
    Reference("pressure downstream falls", 0.0, "1", 3e-3, SOURCE),
    Reference("pressure outside rises", 1 - MORE_OUTSIDE, "1", 5e-3, SOURCE),
    Reference("pressure upstream rises", 1 - MORE_OUTSIDE + MORE_UPSTREAM, "1", 5e-3, SOURCE),
)
