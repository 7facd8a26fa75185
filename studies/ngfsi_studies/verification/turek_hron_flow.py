"""Flow around a rigid cylinder with a rigid beam (Turek-Hron CFD1 to CFD3)."""

from __future__ import annotations

from typing import Any

import ngsolve as ng

from ngfsi.conditions import BodyForce
from ngfsi.linear.backends import choose_backend
from ngfsi.solve.initial import steady_flow
from ngfsi.solve.newton import Newton
from ngfsi.verify import Benchmark, Reference, Setting, Signals, Values
from ngfsi_studies.verification.plane import at_rest, march, refined
from ngfsi_studies.verification.turek_hron import (
    BEAM_IN_CHANNEL,
    RAMP,
    SHARP,
    SOURCE,
    flow_case,
    force_on_obstacle,
    oscillations,
    rising_case,
)

KICK, KICK_SIZE, KICK_TIME = 2e4, 0.05, 0.2
"""Force (N/m3) that starts the vortices, half the dynamic pressure over the cylinder; where (m) and how long (s)."""


def kick() -> BodyForce:
    """Return a push sideways for a moment in the wake: vortices would else take long to start."""
    x, y = BEAM_IN_CHANNEL.tip
    wake = ng.exp(-((ng.x - x - KICK_SIZE) ** 2 + (ng.y - y) ** 2) / KICK_SIZE**2)
    return BodyForce(ng.CF((0, KICK * wake)), curve=lambda t: float(RAMP < t < RAMP + KICK_TIME), name="kick")


def compute(setting: Setting) -> Values | tuple[Values, Signals]:
    """Return the force (N per metre of depth) on cylinder and beam."""
    name, geometry = setting["case"], refined(BEAM_IN_CHANNEL, setting["order"], setting["h"])
    if name == "CFD3":
        shedding, _ = at_rest(rising_case(name, geometry, setting["step"], setting["end"]), kick())
        force = force_on_obstacle(shedding)
        rows = march(shedding, Newton(shedding, choose_backend("auto"), "w", "p"), force)
        return oscillations(rows, "drag", "lift"), Signals(("time_s", "drag_N", "lift_N"), rows)
    system, _ = at_rest(flow_case(name, geometry.replace(**SHARP)))
    steady_flow(system, choose_backend("auto"))
    drag, lift = force_on_obstacle(system)()
    return {"drag": drag, "lift": lift}


CASE = Benchmark(
    title="Turek-Hron CFD1-3: flow around a rigid beam",
    solves="flow around a cylinder with a beam, both held: steady at Reynolds numbers of 20 and 100, and shedding "
    "vortices at 200, started by a push in the wake",
    exact="published values of the force on both; lift is small against drag, and so is its absolute error. On a mesh "
    "twice as coarse the vortices of CFD3 saturate at a lift of +-283 instead of +-438 N, with steps of 5 and of 2 ms",
    compute=compute,
)
STEADY = {"CFD1": (14.2929, 1.11905), "CFD2": (136.700, 10.534)}
"""Drag and lift (N per metre of depth)."""
LEVELS: dict[str, dict[str, tuple[dict[str, Any], ...]]] = {
    "ci": {"CFD1, k = 3": ({"case": "CFD1", "order": 3, "h": 1.0},)},
    "full": {
        **{
            f"{name}, k = {k}": tuple({"case": name, "order": k, "h": h} for h in (1.0, 0.5))
            for name in STEADY
            for k in (2, 3, 4)
        },
        "CFD3": ({"case": "CFD3", "order": 3, "h": 0.5, "step": 0.005, "end": 8.0},),
    },
}


def _steady(quantity: str, which: int, allowed: dict[str, tuple[float, float, float]]) -> Reference:
    values, tolerances = {}, {}
    for name, by_order in allowed.items():
        for k, tolerance in zip((2, 3, 4), by_order, strict=True):
            values[f"{name}, k = {k}"] = STEADY[name][which]
            tolerances[f"{name}, k = {k}"] = tolerance
    return Reference(quantity, values, "N", tolerances, SOURCE)


def _swings(quantity: str, unit: str, value: float, allowed: float) -> Reference:
    return Reference(quantity, {"CFD3": value}, unit, allowed, SOURCE)


REFERENCES = (
    _steady("drag", 0, {"CFD1": (2e-3, 1e-4, 1e-5), "CFD2": (1e-2, 2e-3, 1e-3)}),
    _steady("lift", 1, {"CFD1": (2e-2, 2e-3, 2e-4), "CFD2": (0.4, 5e-2, 1e-2)}),
    _swings("drag, mean", "N", 439.45, 1e-2),
    _swings("drag, amplitude", "N", 5.6183, 0.2),
    _swings("lift, mean", "N", -11.893, 0.4),
    _swings("lift, amplitude", "N", 437.81, 5e-2),
    _swings("lift, frequency", "1/s", 4.3956, 1e-2),
)
