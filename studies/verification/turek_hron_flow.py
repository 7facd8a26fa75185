"""Flow around a rigid cylinder with a rigid beam (Turek-Hron CFD1 and CFD2)."""

from __future__ import annotations

from ngfsi.solve.initial import steady_flow
from ngfsi.solve.linear import choose_backend
from ngfsi.verify import Benchmark, Reference, Setting, Values
from studies.verification.plane import at_rest, refined
from studies.verification.turek_hron import BEAM_IN_CHANNEL, SOURCE, flow_case, force_on_obstacle


def compute(setting: Setting) -> Values:
    """Return the force (N per metre of depth) on cylinder and beam."""
    system, _ = at_rest(flow_case(setting["case"], refined(BEAM_IN_CHANNEL, setting["order"], setting["h"])))
    steady_flow(system, choose_backend("auto"))
    drag, lift = force_on_obstacle(system)()
    return {"drag": drag, "lift": lift}


CASE = Benchmark(
    title="Turek-Hron CFD1-2: flow around a rigid beam",
    solves="steady flow at Reynolds numbers of 20 and 100 around a cylinder with a beam, both held",
    exact="published values of the force on both; lift is small against drag, and so is its absolute error",
    compute=compute,
)
LEVELS = {
    "ci": {"CFD1, k = 3": ({"case": "CFD1", "order": 3, "h": 1.0},)},
    "full": {
        f"{name}, k = {k}": tuple({"case": name, "order": k, "h": h} for h in (1.0, 0.5))
        for name in ("CFD1", "CFD2")
        for k in (2, 3, 4)
    },
}


def _by_series(cfd1: float, cfd2: float) -> dict[str, float]:
    return {f"{name}, k = {k}": value for name, value in (("CFD1", cfd1), ("CFD2", cfd2)) for k in (2, 3, 4)}


def _allowed(**by_case: tuple[float, float, float]) -> dict[str, float]:
    return {
        f"{name}, k = {k}": value
        for name, values in by_case.items()
        for k, value in zip((2, 3, 4), values, strict=True)
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
)
