"""The Mooney-Rivlin cylinder at large strain, towards the incompressible limit."""

from __future__ import annotations

from ngfsi.materials import MooneyRivlin
from ngfsi.verify import Benchmark, Reference, Setting, Values
from ngfsi_studies.verification.radial import Layer, inner_displacement
from ngfsi_studies.verification.tube import inner_radius_change

INNER, OUTER = 7e-3, 18.625e-3
PUBLISHED = {50e6: 1.24061e-3, 100e6: 3.21150e-3, 150e6: 7.18187e-3}
"""Pressure inside (Pa) -> displacement of the inner face (m) of the incompressible cylinder."""
SCALE = 1e-3
"""On pressures and moduli, which leaves the displacement alone: the blood's pressure stays within four digits."""


def compute(setting: Setting) -> Values:
    """Return the inner displacement (mm) at each pressure, and over that of the radial equilibrium with this K."""
    bulk = setting["K over G"] * 200e6 * SCALE
    law = MooneyRivlin(c10=80e6 * SCALE, c01=20e6 * SCALE, c11=0.0, K=bulk, density=0.0)
    found = {}
    for pressure in setting["pressures"]:
        inside, mesh = pressure * SCALE, {"order": setting["order"], "refinement": setting["layers"]}
        u = inner_radius_change(INNER, 3e-3, OUTER, (law, law), inside, 0.0, **mesh)
        found[f"u at {pressure / 1e6:g} MPa"] = 1e3 * u
        found[f"u at {pressure / 1e6:g} MPa over radial.py"] = u / inner_displacement(
            INNER, [Layer(law, OUTER)], inside
        )
    return found


CASE = Benchmark(
    title="Mooney-Rivlin cylinder",
    solves="a ring with c10 80, c01 20 MPa and a bulk modulus K of 100 and 1000 times the shear modulus under 50, 100 "
    "and 150 MPa inside, by the coupled system at a thousandth of all stresses",
    exact="p = G/2 [ln(ri^2 Ro^2 / (ro^2 Ri^2)) + k (1/ri^2 - 1/ro^2)] with k = ri^2 - Ri^2 = ro^2 - Ro^2, "
    "incompressible; a finite K changes the displacement by up to 2 G/K, so that it is held against "
    "the one-dimensional solution too",
    compute=compute,
)
COARSE, LARGEST = "k = 3, K/G = 100, largest pressure", max(PUBLISHED)
LEVELS = {
    "ci": {COARSE: ({"order": 3, "layers": 1, "K over G": 100.0, "pressures": (LARGEST,)},)},
    "full": {
        f"k = {k}, K/G = {ratio:g}": ({"order": k, "layers": 2, "K over G": ratio, "pressures": tuple(PUBLISHED)},)
        for k in (3, 4)
        for ratio in (100.0, 1000.0)
    },
}
LIMIT = {f"k = {k}, K/G = {ratio:g}": 2 / ratio for k in (3, 4) for ratio in (100.0, 1000.0)} | {COARSE: 2 / 100.0}


def _each(pressure: float, value: float) -> dict[str, float]:
    """Return the value of a quantity in each series that has its pressure."""
    return {series: value for series in LIMIT if series != COARSE or pressure == LARGEST}


SOURCES = ("closed form for K -> infinity", "radial.py, the same K")
REFERENCES = (
    *(
        Reference(f"u at {pressure / 1e6:g} MPa", _each(pressure, 1e3 * u), "mm", LIMIT, SOURCES[0])
        for pressure, u in PUBLISHED.items()
    ),
    *(
        Reference(f"u at {pressure / 1e6:g} MPa over radial.py", _each(pressure, 1.0), "1", 2e-3, SOURCES[1])
        for pressure in PUBLISHED
    ),
)
