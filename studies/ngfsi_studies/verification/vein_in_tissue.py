"""The vein with its wall in tissue, pressed from inside and outside: the static answer of the calf without bones."""

from __future__ import annotations

from functools import cache

from ngfsi.materials import load_set
from ngfsi.units import MMHG
from ngfsi.verify import Benchmark, Reference, Setting, Values
from ngfsi_studies.verification.radial import Layer, inner_displacement
from ngfsi_studies.verification.tube import inner_radius_change

INNER, WALL, OUTER = 5.55e-3, 1e-3, 30e-3
TISSUES = {"M": "mooney_rivlin_s1", "N": "neo_hookean_likely"}
LOADS = {"10 mmHg inside": (10 * MMHG, 0.0), "10 inside, 15 mmHg outside": (10 * MMHG, 15 * MMHG)}


def _cases() -> dict[str, tuple[str, tuple[float, float]]]:
    return {f"{name}: u, {load}": (tissue, LOADS[load]) for name, tissue in TISSUES.items() for load in LOADS}


@cache
def _exact(quantity: str) -> float:
    tissue, (inside, outside) = _cases()[quantity]
    layers = [Layer(load_set("vein_wall_source"), INNER + WALL), Layer(load_set(tissue), OUTER)]  # type: ignore[arg-type]
    return 1e6 * inner_displacement(INNER, layers, inside, outside)


def compute(setting: Setting) -> Values:
    """Return the displacement (um) of the inner face for each tissue and load."""
    wall = load_set("vein_wall_source")
    return {
        quantity: 1e6
        * inner_radius_change(
            INNER, WALL, OUTER, (wall, load_set(tissue)), *pressures,  # type: ignore[arg-type]
            order=setting["order"], refinement=round(1 / setting["h"]),
        )
        for quantity, (tissue, pressures) in _cases().items()
    }  # fmt: skip


CASE = Benchmark(
    title="Vein in tissue, at rest",
    solves="lumen of 11.1 mm, wall of 1 mm (Saint Venant-Kirchhoff) and tissue to 30 mm, of Mooney-Rivlin with c11 "
    "(M) or Neo-Hookean law (N), under blood and skin pressure, by the coupled system with its follower pressures",
    exact="radial equilibrium of the stretches with the energy in principal stretches, as a boundary value "
    "problem (scipy's solve_bvp); it shares no code with the finite elements",
    compute=compute,
)
LEVELS = {
    "ci": {"k = 2": ({"order": 2, "h": 1.0},)},
    "full": {f"k = {k}": tuple({"order": k, "h": h} for h in (1.0, 0.5)) for k in (2, 3, 4)},
}
REFERENCES = tuple(
    Reference(quantity, _exact(quantity), "um", {"k = 2": 5e-3, "k = 3": 1e-3, "k = 4": 5e-4}, "radial.py")
    for quantity in _cases()
)
