"""Pulsating flow in a straight, rigid, round tube (Womersley 1955)."""

from __future__ import annotations

import ngsolve as ng
import numpy as np
from ngfsi_geometry.segment import MeshSettings
from ngfsi_geometry.tube import TubeSegment
from numpy.typing import NDArray
from scipy.special import jv

from ngfsi.case import TimeStepping
from ngfsi.conditions import GivenVelocity
from ngfsi.linear.backends import choose_backend
from ngfsi.materials import CompressibleNeoHookean
from ngfsi.measure.wall import Wall
from ngfsi.physics.fields import VELOCITY
from ngfsi.solve.newton import Newton
from ngfsi.solve.time_loop import TimeLoop
from ngfsi.verify import Benchmark, Reference, Setting, Values
from ngfsi_studies.verification.tube import BLOOD, relative_error, system

Array = NDArray[np.float64]

RADIUS, LENGTH, PERIOD = 5.55e-3, 5e-3, 1.0
MEAN_GRADIENT, GRADIENT = 10.0, 20.0
"""Mean and amplitude of the pressure gradient (Pa/m): the flow never turns back, when the outlet would brake it."""
OMEGA = 2 * np.pi / PERIOD
ALPHA = RADIUS * np.sqrt(OMEGA * BLOOD.density / BLOOD.viscosity)
KAPPA = 1j**1.5 * ALPHA
SOLID = CompressibleNeoHookean(young=30e3, poisson=0.3, density=1060.0)
"""Of no influence: the tube's shape is held."""
TERMS = 40
"""Of the power series of the profile: exact to rounding for |kappa| up to 15."""


def wall_shear(t: float) -> float:
    """Return the exact shear stress on the wall (Pa)."""
    slope = GRADIENT / (1j * OMEGA * BLOOD.density) * KAPPA / RADIUS * jv(1, KAPPA) / jv(0, KAPPA)
    return MEAN_GRADIENT * RADIUS / 2 - float(BLOOD.viscosity * np.real(slope * np.exp(1j * OMEGA * t)))


def profile(t: float) -> ng.CoefficientFunction:
    """Return the exact axial velocity (m/s) as a power series in (r/R)^2, which NGSolve can evaluate."""
    s = (ng.x**2 + ng.y**2) / RADIUS**2
    factor = GRADIENT / (1j * OMEGA * BLOOD.density) * np.exp(1j * OMEGA * t)
    series = ng.CF(0.0)
    coefficient, powers = 1.0 + 0j, ng.CF(1.0)
    for n in range(TERMS):
        series += float(np.real(-factor * coefficient / jv(0, KAPPA))) * powers
        coefficient *= -(KAPPA**2) / 4 / (n + 1) ** 2
        powers = powers * s
    steady = MEAN_GRADIENT * RADIUS**2 / (4 * BLOOD.viscosity) * (1 - s)
    return steady + float(np.real(factor)) + series


def velocity(t: float) -> ng.CoefficientFunction:
    """Return the exact velocity (m/s)."""
    return ng.CF((0, 0, profile(t)))


def compute(setting: Setting) -> Values:
    """Return the largest error of the mean wall shear over a period, and that of the velocity at its end."""
    geometry = TubeSegment(
        length=LENGTH, lumen_diameter=2 * RADIUS, wall_thickness=3e-3, outer_radius=14e-3,
        mesh=MeshSettings(element="mixed", axial_layers=1, far_size=20e-3,
                          vein_size=2 * np.pi * RADIUS / setting["around"], lumen_radii=(0.93, 0.8, 0.55),
                          curving_order=setting["order"]),
    )  # fmt: skip
    found = system(geometry, SOLID, SOLID, 1.0, 0.0, GivenVelocity("inlet", velocity), **{
        "conditions.ends": "clamped",
        "time": TimeStepping(step=setting["h"] * PERIOD, end=PERIOD, scheme=setting["scheme"]),
    })  # fmt: skip
    found.set_steady()
    found.update(0.0)
    flowing, domain = found.named(found.state)[VELOCITY], found.domain
    flowing.Set(velocity(0.0), definedon=domain.materials("fluid"), bonus_intorder=4)
    found.prescribe()
    newton, wall = Newton(found, choose_backend("auto"), "w", "p"), Wall(found, found.domain.vessels[0])
    errors = []
    for step in TimeLoop(found.case, found, newton).run():
        wall.refresh()
        axial = ng.Integrate(wall.shear[2] * domain.ds("interface"), domain.mesh) / domain.area("interface")
        # the normal of the interface, and with it the sign, is that of the mesh
        errors.append(abs(abs(axial) - wall_shear(step.time)))
    amplitude = np.ptp([wall_shear(t) for t in np.linspace(0, PERIOD, 200)]) / 2
    return {
        "mean wall shear, largest error over amplitude": float(max(errors) / amplitude),
        "velocity after a period, L2 error": relative_error(flowing, velocity(PERIOD), domain, "fluid"),
    }


CASE = Benchmark(
    title="Womersley flow",
    solves=f"flow under a pressure gradient that oscillates once in a second, at a Womersley number of {ALPHA:.2f}, "
    "about a mean that keeps it from turning back, in a tube whose shape is held: one period from the exact state, the "
    "exact profile at the inlet, the outlet condition of every run",
    exact="Poiseuille flow and u = Re[G / (i w rho) (1 - J0(k r/R) / J0(k)) e^(i w t)], k = i^(3/2) alpha, and their "
    "slope at the wall; the largest error over the period falls with the order of the time scheme",
    compute=compute,
)
LEVELS = {
    "ci": {"bdf2": tuple({"scheme": "bdf2", "order": 3, "around": 10, "h": h} for h in (1 / 10, 1 / 20))},
    "full": {
        scheme: tuple({"scheme": scheme, "order": 3, "around": 16, "h": h} for h in (1 / 10, 1 / 20, 1 / 40))
        for scheme in ("bdf2", "backward_euler")
    },
}
SOURCE, ORDERS = "J. R. Womersley, J Physiol 127 (1955) 553", {"bdf2": 2.0, "backward_euler": 1.0}
ALLOWED = {"bdf2": 1.5e-2, "backward_euler": 0.1}
REFERENCES = (
    Reference("mean wall shear, largest error over amplitude", 0.0, "1", ALLOWED, SOURCE, ORDERS),
    Reference("velocity after a period, L2 error", 0.0, "1", {"bdf2": 2e-3, "backward_euler": 5e-2}, SOURCE),
)
