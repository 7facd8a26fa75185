"""Flow around a rigid cylinder with a rigid beam (Turek-Hron CFD1 to CFD3)."""

from __future__ import annotations

from typing import Any

from ngfsi.solve.initial import steady_flow
from ngfsi.solve.linear import choose_backend
from ngfsi.solve.newton import Newton
from ngfsi.verify import Benchmark, Reference, Setting, Values
from studies.verification.plane import at_rest, march, refined
from studies.verification.turek_hron import (
    BEAM_IN_CHANNEL,
    SOURCE,
    flow_case,
    force_on_obstacle,
    oscillations,
    rising_case,
)


def compute(setting: Setting) -> Values:
    """Return the force (N per metre of depth) on cylinder and beam, steady or periodic."""
    name, geometry = setting["case"], refined(BEAM_IN_CHANNEL, setting["order"], setting["h"])
    if name == "CFD3":
        system, _ = at_rest(rising_case(name, geometry, setting["step"], setting["end"]))
        force = force_on_obstacle(system)
        return oscillations(march(system, Newton(system, choose_backend("auto"), "w", "p"), force), "drag", "lift")
    system, _ = at_rest(flow_case(name, geometry))
    steady_flow(system, choose_backend("auto"))
    drag, lift = force_on_obstacle(system)()
    return {"drag": drag, "lift": lift}


CASE = Benchmark(
    title="Turek-Hron CFD1-3: flow around a rigid beam",
    solves="flow at Reynolds numbers of 20, 100 and 200 around a cylinder with a beam, both held; CFD3 sheds vortices",
    exact="published values of the force on both; lift is small against drag, and so is its absolute error",
    compute=compute,
)


def _levels(steady: dict[tuple[str, int], tuple[float, ...]], shed: tuple[dict[str, Any], ...]) -> dict[str, Any]:
    levels: dict[str, Any] = {
        f"{name}, k = {k}": tuple({"case": name, "order": k, "h": h} for h in hs) for (name, k), hs in steady.items()
    }
    return levels | ({"CFD3": tuple({"case": "CFD3", **setting} for setting in shed)} if shed else {})


LEVELS = {
    "ci": _levels({("CFD1", 3): (1.0,)}, ()),
    "full": _levels(
        {(name, k): (1.0, 0.5) for name in ("CFD1", "CFD2") for k in (2, 3, 4)},
        tuple({"order": 3, "h": 1.0, "step": step, "end": 8.0} for step in (0.01, 0.005)),
    ),
}


def _by_series(cfd1: float, cfd2: float) -> dict[str, float]:
    return {f"{name}, k = {k}": value for name, value in (("CFD1", cfd1), ("CFD2", cfd2)) for k in (2, 3, 4)}


def _allowed(**by_case: tuple[float, float, float]) -> dict[str, float]:
    return {
        f"{name}, k = {k}": value
        for name, values in by_case.items()
        for k, value in zip((2, 3, 4), values, strict=True)
    }


SHED = {
    "drag, mean": (439.45, "N", 1e-2),
    "drag, amplitude": (5.6183, "N", 5e-2),
    "drag, frequency": (4.3956, "1/s", 1e-2),
    "lift, mean": (-11.893, "N", 0.2),
    "lift, amplitude": (437.81, "N", 2e-2),
    "lift, frequency": (4.3956, "1/s", 1e-2),
}
DRAG = _allowed(CFD1=(2e-3, 5e-4, 1e-4), CFD2=(1e-2, 2e-3, 1e-3))
LIFT = _allowed(CFD1=(5e-2, 1e-2, 2e-3), CFD2=(0.4, 5e-2, 1e-2))
REFERENCES = (
    Reference(
        "drag", _by_series(14.2929, 136.700), "N", _allowed(CFD1=(2e-3, 5e-4, 1e-4), CFD2=(1e-2, 2e-3, 1e-3)), SOURCE
    ),
    Reference(
        "lift", _by_series(1.11905, 10.534), "N", _allowed(CFD1=(5e-2, 1e-2, 2e-3), CFD2=(0.4, 5e-2, 1e-2)), SOURCE
    ),
    *(Reference(name, {"CFD3": value}, unit, allowed, SOURCE) for name, (value, unit, allowed) in SHED.items()),
)
