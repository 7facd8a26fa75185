"""Steady flow around a cylinder in a channel (DFG benchmark 2D-1)."""

from __future__ import annotations

from ngfsi_geometry.channel import CylinderInChannel

from ngfsi.case import Materials
from ngfsi.linear.backends import choose_backend
from ngfsi.materials import Newtonian
from ngfsi.measure.force import Force
from ngfsi.physics.fields import PRESSURE
from ngfsi.solve.initial import steady_flow
from ngfsi.system.system import System
from ngfsi.verify import Benchmark, Reference, Setting, Values
from ngfsi_studies.verification.plane import at_rest, case_of, refined

CHANNEL = CylinderInChannel()
FLUID = Newtonian(density=1.0, viscosity=1e-3)
SPEED = 0.2
"""Mean velocity (m/s) at a Reynolds number of 20."""
BESIDE = 1e-5
"""Distance (m) from the cylinder at which its pressure is taken: points on it may lie outside of the curved mesh."""


def coefficient(speed: float) -> float:
    """Return the coefficient of a force of 1 N per metre of depth at a mean velocity (m/s) of the inflow."""
    return 2 / (FLUID.density * speed**2 * 2 * CHANNEL.cylinder_radius)


def pressure_difference(system: System) -> float:
    """Return the pressure (Pa) in front of the cylinder less that behind it."""
    reach, y = CHANNEL.cylinder_radius + BESIDE, CHANNEL.cylinder_y
    pressure = system.named(system.state)[PRESSURE]
    front, back = (system.domain.value(pressure, CHANNEL.cylinder_x + s * reach, y) for s in (-1, 1))
    return float(front - back)


def compute(setting: Setting) -> Values:
    """Return the coefficients of drag and lift and the pressure difference."""
    geometry = refined(CHANNEL, setting["order"], setting["h"])
    system, _ = at_rest(case_of(geometry, SPEED * CHANNEL.height, Materials(fluid=FLUID)))
    steady_flow(system, choose_backend("auto"))
    drag, lift = coefficient(SPEED) * Force(system, "cylinder")()
    return {"drag coefficient": drag, "lift coefficient": lift, "pressure difference": pressure_difference(system)}


CASE = Benchmark(
    title="DFG 2D-1: steady flow around a cylinder",
    solves="flow at a Reynolds number of 20 around a cylinder that stands slightly off the middle of a plane channel; "
    "forces from the balance of momentum (see `ngfsi.measure.force`)",
    exact="values computed with spectral elements, known to ten digits",
    compute=compute,
)
LEVELS = {
    "ci": {"k = 3": ({"order": 3, "h": 0.6},)},
    "full": {f"k = {k}": tuple({"order": k, "h": h} for h in (1.0, 0.5, 0.25)[: 3 if k < 4 else 2]) for k in (2, 3, 4)},
}  # fmt: skip
SOURCE = "G. Nabh (1998), as given for the benchmark of M. Schaefer and S. Turek (1996)"


def _by_order(*values: float) -> dict[str, float]:
    return {f"k = {k}": value for k, value in zip((2, 3, 4), values, strict=True)}


REFERENCES = (
    Reference("drag coefficient", 5.57953523384, "1", _by_order(1e-3, 2e-5, 1e-6), SOURCE),
    Reference("lift coefficient", 0.010618948146, "1", _by_order(0.2, 2e-2, 1e-3), SOURCE),
    Reference("pressure difference", 0.11752016697, "Pa", _by_order(2e-2, 5e-3, 2e-3), SOURCE),
)
