"""Sizes that no vessel has: said before anything is meshed, with the unit of length that would fit.

The bounds are far wider than anatomy: from venules to an aneurysm of the aorta, from creeping to turbulent flow.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import pi, sqrt
from typing import Any

import numpy as np

from ngfsi.case.case import Case
from ngfsi.conditions.openings import FlowOpening
from ngfsi.units import in_unit, to_si

BOUNDS: dict[str, tuple[str, float, float]] = {
    "lumen_radius": ("radius of the lumen", 0.05e-3, 40e-3),
    "wall_thickness": ("thickness of the wall", 0.005e-3, 15e-3),
    "length": ("length", 0.2e-3, 2.0),
}
"""Property of a geometry -> what it is, least and largest value [m]."""
LARGEST_REYNOLDS, LARGEST_WOMERSLEY = 1e4, 60.0
"""The aorta has some 5000 and 25."""
SAMPLES = 200
"""Times at which a flow is looked at."""
UNITS = ("m", "cm", "mm", "um")


def implausible(case: Case) -> tuple[str, ...]:
    """Return a sentence for each size of a case that no vessel has; none for geometries without a vessel."""
    if not case.geometry.vessels:
        return ()
    sizes = list(_sizes(case.geometry))
    return *(f"{sentence}{_unit_for(case.geometry)}" for sentence in sizes), *_numbers(case, bool(sizes))


def _sizes(geometry: Any, factor: float = 1.0) -> Iterator[str]:
    """Yield what is out of bounds, if all lengths were larger by a factor."""
    for name, (what, least, largest) in BOUNDS.items():
        value = getattr(geometry, name, None)
        if name == "lumen_radius" and value is None and geometry.vessels[0].lumen:
            value = geometry.vessels[0].radius
        if not isinstance(value, int | float) or not value:
            continue
        if not least <= factor * value <= largest:
            bounds = f"{in_unit(least, 'mm')} to {in_unit(largest, 'mm')}"
            yield f"the {what} is {in_unit(float(value), 'mm', '.3g')}, where vessels have {bounds}"


def _unit_for(geometry: Any) -> str:
    """Return which unit of the file would give sizes of vessels, for the end of a sentence."""
    unit = getattr(geometry, "unit", None)
    if unit not in UNITS:
        return ""
    fits = [u for u in UNITS if not list(_sizes(geometry, to_si(1.0, u) / to_si(1.0, unit)))]
    listed = " or ".join(f'"{fit}"' for fit in fits)
    return f': unit = {listed} would fit, not "{unit}"' if fits else ""


def _numbers(case: Case, sizes_are_wrong: bool) -> Iterator[str]:
    """Yield what is out of bounds of Reynolds and Womersley numbers at the first inlet."""
    fluid, vessel = case.materials.fluid, case.geometry.vessels[0]
    opening = case.loads.opening(vessel.inlets[0]) if vessel.inlets else None
    if fluid is None or not vessel.lumen or not isinstance(opening, FlowOpening):
        return
    density, radius = fluid.density, vessel.radius
    if not radius**3 > 0:  # its size was complained of already
        return
    cause = "" if sizes_are_wrong else ": see the unit of the flow, of lengths and of the viscosity"
    times = np.linspace(0.0, case.time.end, SAMPLES)
    flow = max(abs(opening.flow(float(t))) for t in times)
    viscosity = float(fluid.developed_viscosity(4 * flow / (pi * radius**3)))
    reynolds = 2 * density * flow / (pi * radius * viscosity)
    if reynolds > LARGEST_REYNOLDS:
        yield f"the Reynolds number is {reynolds:.2g}, where vessels have {LARGEST_REYNOLDS:g} at most{cause}"
    period = getattr(opening.flow, "period", None) or _length_of(opening.flow)
    if period:
        womersley = radius * sqrt(2 * pi / period * density / viscosity)
        if womersley > LARGEST_WOMERSLEY:
            yield f"the Womersley number is {womersley:.2g}, where vessels have {LARGEST_WOMERSLEY:g} at most{cause}"


def _length_of(curve: Any) -> float | None:
    """Return the period (s) of a waveform; None: it is no periodic curve."""
    return float(curve.times[-1] - curve.times[0]) if getattr(curve, "kind", "") == "waveform" else None
