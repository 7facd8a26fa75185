"""Steady flow in a straight, rigid, round tube: wall shear at every point of the wall."""

from __future__ import annotations

import ngsolve as ng
import numpy as np

from ngfsi.config.functions import FlowConstant
from ngfsi.linear.backends import choose_backend
from ngfsi.materials import CompressibleNeoHookean
from ngfsi.measure.wall import Wall
from ngfsi.physics.fields import VELOCITY
from ngfsi.solve.initial import steady_flow
from ngfsi.verify import Benchmark, Reference, Setting, Values
from ngfsi_studies.verification.tube import BLOOD, relative_error, round_tube, system

RADIUS, LENGTH, FLOW = 5.55e-3, 20e-3, 2.913e-6
DROP = 8 * BLOOD.viscosity * FLOW * LENGTH / (np.pi * RADIUS**4)
SHEAR = 4 * BLOOD.viscosity * FLOW / (np.pi * RADIUS**3)
OUTLET_PRESSURE = 1.0
SOLID = CompressibleNeoHookean(young=30e3, poisson=0.3, density=1060.0)
"""Of no influence: the tube's shape is held."""


def compute(setting: Setting) -> Values:
    """Return errors of velocity, pressure drop and wall shear."""
    geometry = round_tube(RADIUS, LENGTH, setting["element"], setting["h"], setting["order"])
    flow = {
        "loads.inlet_flow": FlowConstant(value=FLOW),
        "conditions.ends": "clamped",
        "solver.tolerance": 1e-9,
    }
    found = system(geometry, SOLID, SOLID, OUTLET_PRESSURE, 0.0, **flow)
    steady_flow(found, choose_backend("auto"))

    domain = found.domain
    velocity, pressure = found.named(found.state)[VELOCITY], found.blood_pressure()
    parabola = ng.CF((0, 0, 2 * FLOW / (np.pi * RADIUS**2) * (1 - (ng.x**2 + ng.y**2) / RADIUS**2)))
    inlet = ng.Integrate(pressure * domain.ds("inlet"), domain.mesh) / domain.area("inlet")
    wall = Wall(found, found.domain.vessels[0])
    wall.refresh()
    sample = wall.sample(8)
    shear = np.linalg.norm(sample.shear, axis=1)
    middle = shear[np.abs(sample.points[:, 2] - LENGTH / 2) < 1e-9]
    return {
        "velocity, L2 error": relative_error(velocity, parabola, domain, "fluid"),
        "pressure drop": float(inlet - OUTLET_PRESSURE),
        "mean wall shear": wall.statistics().mean,
        "wall shear, largest error of a point": float(np.abs(shear / SHEAR - 1).max()),
        "wall shear, scatter in a slice": float(np.ptp(middle) / SHEAR),
    }


CASE = Benchmark(
    title="Poiseuille flow",
    solves="steady Navier-Stokes flow at a Reynolds number of 96 in a straight tube of 20 mm whose shape is held, with "
    "the parabolic inflow and the outlet condition of every run; wall shear as `sawss` is measured, at 81 points of "
    "each face of the wall, those at the ends included",
    exact="u = 2 Q / (pi R^2) (1 - r^2/R^2), pressure drop 8 mu Q L / (pi R^4), wall shear 4 mu Q / (pi R^3)",
    compute=compute,
)
ELEMENTS = {"hexahedra": "mixed", "prisms": "prism"}
SIZES: dict[str, dict[tuple[str, int], tuple[float, ...]]] = {
    "ci": {("hexahedra", 2): (1.0, 0.5)},
    "full": {
        ("hexahedra", 2): (1.0, 0.5, 0.25),
        ("hexahedra", 3): (1.0, 0.5, 1 / 3),
        ("hexahedra", 4): (1.0, 0.5),
        ("prisms", 2): (1.0, 0.5, 0.25),
        ("prisms", 3): (1.0, 0.5, 1 / 3),
        ("prisms", 4): (1.0, 0.5),
    },
}
LEVELS = {
    level: {
        f"{elements}, k = {k}": tuple({"element": ELEMENTS[elements], "order": k, "h": h} for h in sizes)
        for (elements, k), sizes in series.items()
    }
    for level, series in SIZES.items()
}


def _by_series(hexahedra: tuple[float, float, float], prisms: tuple[float, float, float]) -> dict[str, float]:
    """Return values by series from those for k = 2, 3, 4."""
    both = {"hexahedra": hexahedra, "prisms": prisms}
    return {
        f"{name}, k = {k}": value for name, values in both.items() for k, value in zip((2, 3, 4), values, strict=True)
    }


SOURCE = "Hagen-Poiseuille"
REFERENCES = tuple(
    Reference(quantity, value, unit, tolerance, SOURCE, order)
    for quantity, value, unit, tolerance, order in (
        ("velocity, L2 error", 0.0, "1", _by_series((1e-3, 2e-4, 1e-4), (1e-3, 2e-4, 1e-4)),
         _by_series((3, 4, 5), (3, 4, 5))),
        ("pressure drop", DROP, "Pa", 5e-4, None),
        ("mean wall shear", SHEAR, "Pa", _by_series((1e-3, 2e-4, 1e-4), (1e-2, 1e-3, 1e-3)), None),
        ("wall shear, largest error of a point", 0.0, "1", _by_series((2e-3, 1e-3, 1e-3), (2e-2, 5e-3, 2e-3)),
         _by_series((2, 3, 4), (2, 2, 3))),
        ("wall shear, scatter in a slice", 0.0, "1", _by_series((2e-3, 1e-3, 5e-4), (3e-2, 5e-3, 2e-3)), None),
    )
)  # fmt: skip
