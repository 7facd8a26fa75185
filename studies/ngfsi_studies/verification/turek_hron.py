"""Data and solvers of the benchmarks of Turek and Hron, all on one channel: of no benchmark by itself."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from ngfsi_geometry.channel import BeamInChannel, PlaneSection
from numpy.typing import NDArray

from ngfsi.case import Case, Materials, TimeStepping
from ngfsi.config.functions import FlowSmoothRamp
from ngfsi.materials import Newtonian, SaintVenantKirchhoff
from ngfsi.measure.force import Force
from ngfsi.system.system import System
from ngfsi_studies.verification.oscillation import Oscillation
from ngfsi_studies.verification.plane import case_of

Array = NDArray[np.float64]

SOURCE = "S. Turek, J. Hron, LNCSE 53 (2006) 371"
HEIGHT = 0.41
FLUID = Newtonian(density=1e3, viscosity=1.0)
RAMP = 2.0
"""Duration (s) of the rise of the inflow."""
TIP_INSET = 1e-9
"""Distance (m) from the tip at which its displacement is taken: points on it may lie outside by rounding."""


@dataclass(frozen=True)
class Data:
    """Mean inflow velocity (m/s), the beam's shear modulus (Pa) and density (kg/m3)."""

    speed: float
    shear_modulus: float
    density: float

    @property
    def beam(self) -> SaintVenantKirchhoff:
        """The material of the beam, of Poisson ratio 0.4."""
        return SaintVenantKirchhoff(young=2 * 1.4 * self.shear_modulus, poisson=0.4, density=self.density)


DATA = {
    "CSM1": Data(0.0, 0.5e6, 1e3),
    "CSM2": Data(0.0, 2.0e6, 1e3),
    "CSM3": Data(0.0, 0.5e6, 1e3),
    "CFD1": Data(0.2, 0.5e6, 1e3),
    "CFD2": Data(1.0, 0.5e6, 1e3),
    "CFD3": Data(2.0, 0.5e6, 1e3),
    "FSI1": Data(0.2, 0.5e6, 1e3),
    "FSI2": Data(1.0, 0.5e6, 1e4),
    "FSI3": Data(2.0, 2.0e6, 1e3),
}


def flow_case(name: str, geometry: PlaneSection, **more: Any) -> Case:
    """Return the case of a benchmark with a fluid."""
    materials = Materials(solid=DATA[name].beam, fluid=FLUID)
    changes = {"discretisation.mesh_motion": "elastic", **more}
    return case_of(geometry, DATA[name].speed * HEIGHT, materials, **changes)


def rising_case(name: str, geometry: PlaneSection, step: float, end: float, **more: Any) -> Case:
    """Return the case of a benchmark whose inflow rises from rest; times in s."""
    inflow = FlowSmoothRamp(final=DATA[name].speed * HEIGHT, duration=RAMP)
    time = TimeStepping(step=step, end=end)
    loads = {"loads.inlet_flow": inflow, "time": time, "solver.tolerance": 1e-6}
    return flow_case(name, geometry, **loads, **more)


def force_on_obstacle(system: System) -> Force:
    """Return the force on cylinder and beam."""
    return Force(system, "cylinder", "interface")


def tip_motion(system: System) -> Array:
    """Return the displacement (m) of the middle of the beam's end."""
    x, y = system.case.geometry.tip
    return np.array(system.domain.value(system.motion, x - TIP_INSET, y))


def oscillations(rows: Array, *names: str) -> dict[str, float]:
    """Return mean, amplitude and frequency of the columns after the first, the time (s)."""
    found = {}
    for name, values in zip(names, rows.T[1:], strict=True):
        oscillation = Oscillation.of(rows[:, 0], values)
        found[f"{name}, mean"] = oscillation.mean
        found[f"{name}, amplitude"] = oscillation.amplitude
        found[f"{name}, frequency"] = oscillation.frequency
    return found


BEAM_IN_CHANNEL = BeamInChannel()
SHARP = {"mesh.corner_size": 1e-5}
"""For steady answers: the singular stresses at the beam's corners are resolved beyond all other errors."""
