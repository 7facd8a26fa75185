"""Balances of energy and of volume while a vein is squeezed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import ngsolve as ng
import numpy as np
from ngfsi_geometry.segment import MeshSettings
from ngfsi_geometry.tube import TubeSegment
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from ngfsi.case import TimeStepping
from ngfsi.config.functions import FlowConstant, PressureRamp
from ngfsi.linear.backends import choose_backend
from ngfsi.materials import CompressibleNeoHookean
from ngfsi.measure.energy import Energy
from ngfsi.measure.probe import VesselProbe
from ngfsi.physics.fields import MOTION
from ngfsi.physics.kinematics import Kinematics
from ngfsi.solve.initial import initial_state
from ngfsi.solve.newton import Newton
from ngfsi.solve.time_loop import TimeLoop
from ngfsi.system.schemes import STAGES
from ngfsi.system.system import System
from ngfsi.verify import Benchmark, Reference, Setting, Values
from ngfsi_studies.verification.tube import system

Array = NDArray[np.float64]

SOLID = CompressibleNeoHookean(young=30e3, poisson=0.3, density=1060.0)
END = 0.2


class Smooth(PressureRamp):  # type: ignore[valid-type, misc]
    """A pressure that rises without a kink: final sin^4(pi t / (2 duration))."""

    def __call__(self, t: float) -> float:
        return float(self.final) * float(np.sin(np.pi / 2 * t / self.duration)) ** 4

    @property
    def breakpoints(self) -> tuple[float, ...]:
        return ()


class MovingMesh:
    """Power (W) that the time scheme makes because its rate of J is not that of the mesh: zero on a fixed mesh.

    The kinetic energy rho/2 J |u|^2 changes with J; the balance of momentum knows the rate of J as cof(F) : grad of
    the mesh velocity, the difference of energies as a difference of J.
    """

    def __init__(self, system: System) -> None:
        self._system = system
        self._old = [ng.GridFunction(system.unknowns.space) for _ in range(2)]
        self._weights = [ng.Parameter(0.0) for _ in range(2)]
        motion, rate = system.motion, system.named(system.velocity_history)[MOTION]
        k = Kinematics(ng.Grad(motion))
        by_difference = system.new_weight * k.J
        for weight, old in zip(self._weights, self._old, strict=True):
            by_difference += weight * Kinematics(ng.Grad(old.components[0])).J
        by_mesh = ng.InnerProduct(k.cof, system.new_weight * ng.Grad(motion) + ng.Grad(rate))
        u = system.fields().velocity
        density = by_difference - by_mesh
        fluid = system.domain.dx(*system.domain.lumens, bonus_intorder=2 * system.unknowns.order)
        self._power = system.blood_density / 2 * density * ng.InnerProduct(u, u) * fluid

    def power(self, size: float, states: Sequence[Array]) -> float:
        """Return the power in the newest of the states, after a step of a size (s) as long as the one before."""
        new = self._system.new_weight.Get()
        older = new - 1 / size  # the scheme is exact for constant and linear states
        for weight, old, value, state in zip(
            self._weights, self._old, (-new - older, older), (states[1], states[-1]), strict=True
        ):
            weight.Set(value)
            old.vec.FV().NumPy()[:] = state
        return float(ng.Integrate(self._power, self._system.domain.mesh))


def compute(setting: Setting) -> Values:
    """Return what the balances lack, over the work of the skin's pressure and over the volume that is lost."""
    n = round(1 / setting["size"])
    geometry = TubeSegment(
        length=10e-3, wall_thickness=2e-3, outer_radius=14e-3,
        mesh=MeshSettings(element="mixed", axial_layers=n, far_size=20e-3, vein_size=6e-3 / n, curving_order=2,
                          lumen_radii=(0.6,) if n == 1 else (0.8, 0.6, 0.3)),
    )  # fmt: skip
    loads = {
        "loads.skin_pressure": Smooth(final=1000.0, duration=2 * END),
        "loads.inlet_flow": FlowConstant(value=2.9e-6),
        "time": TimeStepping(step=setting["step"], end=END, scheme=setting["scheme"]),
    }
    found = system(geometry, SOLID, SOLID, 1333.22, 0.0, **loads)
    newton = Newton(found, choose_backend("auto"))
    initial_state(found, newton)
    energy, probe = Energy(found), VesselProbe(found, found.domain.vessels[0])
    rows, of_mesh = [_row(0.0, energy, probe)], [0.0]
    moving, loop = MovingMesh(found), TimeLoop(found.case, found, newton)
    for step in loop.run():
        rows.append(_row(step.time, energy, probe))
        if setting["scheme"] not in STAGES:
            of_mesh.append(moving.power(step.size, loop.history.states))
    times, stored, kinetic, heat, skin, others, rate_of_scheme, excess, volume, rate = np.array(rows).T
    total = stored + kinetic
    integral: Any = _by_spline if setting["scheme"] in STAGES else np.trapezoid
    work = float(integral(skin, times))
    lacking = total[-1] - total[0] - integral(skin + others - heat, times)
    at_once = rate_of_scheme - (skin + others - heat + excess)
    of_scheme = total[-1] - total[0] - integral(rate_of_scheme, times)
    found_of_mesh = {} if len(of_mesh) < len(times) else {
        "energy: fraction of the moving mesh in that": abs(float(integral(of_mesh, times))) / work
    }  # fmt: skip
    return {
        "power lacking at an instant, over the skin's": float(np.abs(at_once).max() / skin.max()),
        "energy: rest of div u over work of the skin": abs(float(integral(excess, times))) / work,
        "energy: rest of the time scheme over work of the skin": abs(float(of_scheme)) / work,
        **found_of_mesh,
        "energy: rest over work of the skin": abs(float(lacking)) / work,
        "energy at rest: power in over dissipation": float(others[0] / heat[0]),
        "volume: rest over loss": abs((volume[-1] - volume[0]) / integral(rate, times) - 1),
    }


def _by_spline(values: Any, times: Any) -> float:
    """Return an integral over time with an error of fourth order, below that of schemes in stages."""
    return float(CubicSpline(times, values).integrate(times[0], times[-1]))


def _row(time: float, energy: Energy, probe: VesselProbe) -> list[float]:
    probe.refresh()
    powers = energy.powers()
    skin = energy.skin_power(powers)
    others = sum(powers.values()) - skin - energy.carried()
    volume = (probe.integral("lumen volume"), probe.integral("lumen rate"))
    return [
        time,
        energy.stored(),
        energy.kinetic(),
        energy.dissipation(),
        skin,
        others,
        energy.rate(),
        energy.excess(),
        *volume,
    ]


CASE = Benchmark(
    title="Balances of energy and volume",
    solves="a vein in tissue whose skin pressure rises smoothly within 0.2 s while blood flows in at a constant rate; "
    "all terms of the energy balance are integrated over the deformed shapes: energy of the solids, kinetic energies, "
    "heat, powers of the skin's pressure and of the tractions at inlet and outlet, kinetic energy carried through them",
    exact="nothing is left at any instant but what convection makes of div u, which is zero only on average and falls "
    "with the size of the elements (the power lacking at an instant is the error of quadrature); over the run, the "
    "error of the time scheme and of the sum over the steps (trapezoidal rule, with schemes in stages a cubic spline), "
    "which falls with its order, as does its part in the moving mesh, whose volumes change by differences; at rest, "
    "heat is the power of the flow. Stiff solids and the pressure's constraint reduce the order of the rates of "
    "schemes in stages, to that of a stage plus one: 3 and 2",
    compute=compute,
)
STEPS: dict[str, dict[str, tuple[float, ...]]] = {
    "ci": {"bdf2": (0.01, 0.005), "esdirk3": (0.04, 0.02)},
    "full": dict.fromkeys(("bdf2", "backward_euler", "esdirk3", "sdirk4"), (0.02, 0.01, 0.005, 0.0025)),
}
LEVELS = {
    level: {
        scheme: tuple({"scheme": scheme, "size": 1.0, "step": h, "h": h} for h in steps)
        for scheme, steps in schemes.items()
    }
    for level, schemes in STEPS.items()
}
LEVELS["full"]["elements"] = tuple({"scheme": "bdf2", "size": h, "step": 0.05, "h": h} for h in (1.0, 0.5))
BALANCE, ORDERS = "balance", {"bdf2": 2.0, "backward_euler": 1.0, "esdirk3": 2.7, "sdirk4": 2.5}
NOTHING = dict.fromkeys(ORDERS, 0.0)
MOVING = {"bdf2": 1e-6, "backward_euler": 1e-4}
ALLOWED = {"bdf2": 1e-2, "backward_euler": 0.1, "esdirk3": 1.2e-2, "sdirk4": 1e-2}
REFERENCES = (
    Reference("power lacking at an instant, over the skin's", 0.0, "1", 1e-5, BALANCE),
    Reference("energy: rest of div u over work of the skin", NOTHING, "1", 1e-4, BALANCE),
    Reference("energy: rest of div u over work of the skin", {"elements": 0.0}, "1", 1e-4, BALANCE, 2.0),
    Reference("energy: rest of the time scheme over work of the skin", NOTHING, "1", ALLOWED, BALANCE, ORDERS),
    Reference("energy: fraction of the moving mesh in that", dict.fromkeys(MOVING, 0.0), "1", MOVING, BALANCE, ORDERS),
    Reference("energy: rest over work of the skin", NOTHING, "1", ALLOWED, BALANCE, ORDERS),
    Reference("energy at rest: power in over dissipation", 1.0, "1", 1e-3, BALANCE),
    Reference("volume: rest over loss", NOTHING, "1", ALLOWED, BALANCE, ORDERS),
)
