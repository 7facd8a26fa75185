"""Fluid between elastic walls, and in an elastic sheath, under a pressure gradient that oscillates in both."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import ngsolve as ng
import numpy as np
from ngfsi_geometry.channel import ElasticChannel, PlaneMesh
from numpy.typing import NDArray
from scipy.special import jv, yv

from ngfsi.case import Materials, TimeStepping
from ngfsi.conditions import BodyForce, Condition, GivenVelocity
from ngfsi.linear.backends import choose_backend
from ngfsi.materials import CompressibleNeoHookean, Newtonian
from ngfsi.mesh.domain import Domain
from ngfsi.physics.fields import MOTION, VELOCITY
from ngfsi.solve.newton import Newton
from ngfsi.solve.time_loop import History, TimeLoop
from ngfsi.system.system import System
from ngfsi.verify import Benchmark, Reference, Setting, Values
from ngfsi_studies.verification.plane import case_of
from ngfsi_studies.verification.polynomial import evaluated, interpolated
from ngfsi_studies.verification.tube import relative_error, sheath

Array = NDArray[np.float64]
Profile = Callable[[Any], Any]

INNER, OUTER, LENGTH = 5.55e-3, 8.55e-3, 4e-3
"""Half height of the channel or radius of the lumen, the same with the wall, and the length (m)."""
PERIOD = 0.1
OMEGA = 2 * np.pi / PERIOD
FLUID = Newtonian(density=1060.0, viscosity=0.1)
SOLID = CompressibleNeoHookean(young=260.0, poisson=0.3, density=1100.0)
"""So soft that the walls swing as widely as the fluid."""
GRADIENT, MEAN_GRADIENT = 10.0, 30.0
"""Amplitude and mean of the pressure gradient (Pa/m): the flow never turns back, when the outlet would brake it."""
KF = np.sqrt(-1j * OMEGA * FLUID.density / FLUID.viscosity)
KS = OMEGA * np.sqrt(SOLID.density / SOLID.shear_modulus)


@dataclass(frozen=True)
class Wave:
    """Axial velocity (m/s) of the fluid and displacement (m) of the solid over r or |y|: complex amplitudes.

    Attributes:
        directions: 1 between walls, 2 in a sheath, where the mean shear stress is MEAN_GRADIENT r / directions.
    """

    velocity: Profile
    displacement: Profile
    directions: int

    def mean_velocity(self, r: Any) -> Any:
        """Return the steady part of the velocity (m/s)."""
        return MEAN_GRADIENT * (INNER**2 - r**2) / (2 * self.directions * FLUID.viscosity)

    def mean_displacement(self, r: Any) -> Any:
        """Return the steady part of the displacement (m)."""
        return MEAN_GRADIENT * (OUTER**2 - r**2) / (2 * self.directions * SOLID.shear_modulus)

    @classmethod
    def of(
        cls, directions: int, fluid: Profile, solids: tuple[Profile, Profile], slopes: tuple[Profile, Profile, Profile]
    ) -> Wave:
        """Return the solution from the homogeneous solutions: one in the fluid, two in the solid, and their slopes.

        The pressure gradient alone moves fluid and solid evenly; the homogeneous solutions make velocity and shear
        stress continuous and hold the outer face.
        """
        even_v, even_u = GRADIENT / (1j * OMEGA * FLUID.density), -GRADIENT / (OMEGA**2 * SOLID.density)
        mu_f, mu_s, iw = FLUID.viscosity, SOLID.shear_modulus, 1j * OMEGA
        system = [
            [fluid(INNER), -iw * solids[0](INNER), -iw * solids[1](INNER)],
            [mu_f * slopes[0](INNER), -mu_s * slopes[1](INNER), -mu_s * slopes[2](INNER)],
            [0, solids[0](OUTER), solids[1](OUTER)],
        ]
        a, b, c = np.linalg.solve(np.array(system), np.array([iw * even_u - even_v, 0, -even_u]))
        return cls(lambda r: even_v + a * fluid(r), lambda r: even_u + b * solids[0](r) + c * solids[1](r), directions)


def channel_wave() -> Wave:
    """Return the wave between plane walls."""
    return Wave.of(
        1,
        lambda r: np.cos(KF * r),
        (lambda r: np.cos(KS * r), lambda r: np.sin(KS * r)),
        (lambda r: -KF * np.sin(KF * r), lambda r: -KS * np.sin(KS * r), lambda r: KS * np.cos(KS * r)),
    )


def pipe_wave() -> Wave:
    """Return the wave in a round sheath."""
    return Wave.of(
        2,
        lambda r: jv(0, KF * r),
        (lambda r: jv(0, KS * r), lambda r: yv(0, KS * r)),
        (lambda r: -KF * jv(1, KF * r), lambda r: -KS * jv(1, KS * r), lambda r: -KS * yv(1, KS * r)),
    )


class Exact:
    """The exact solution on a domain, and the conditions that drive it.

    The exact profile enters, and the pressure gradient is a force on all of the domain: a pressure in the fluid alone
    would also press on the walls.
    """

    def __init__(self, domain: Domain, wave: Wave) -> None:
        self.axial = 0 if domain.mesh.dim == 2 else 2
        self.across = ng.sqrt(ng.y**2) if domain.mesh.dim == 2 else ng.sqrt(ng.x**2 + ng.y**2 + 1e-30)
        self.domain, self.wave = domain, wave

    def conditions(self) -> tuple[Condition, ...]:
        """Return what drives it."""
        force = BodyForce(self.vector(1.0), curve=lambda t: MEAN_GRADIENT + GRADIENT * float(np.cos(OMEGA * t)))
        return GivenVelocity("inlet", self.relative), force

    def vector(self, axial: Any) -> Any:
        """Return the axial vector field."""
        return ng.CF(tuple(axial if i == self.axial else 0 for i in range(self.domain.mesh.dim)))

    def velocity(self, t: float) -> Any:
        """Return the exact velocity of the fluid."""
        wave = swinging(self.wave.velocity, 0.0, INNER, t, self.across)
        return self.vector(wave + self.wave.mean_velocity(self.across))

    def displacement(self, t: float, rate: int = 0) -> Any:
        """Return the exact displacement of the solids and of the fluid's mesh, or a rate of it."""
        factor = (1j * OMEGA) ** rate
        solid = swinging(lambda r: factor * self.wave.displacement(r), INNER, OUTER, t, self.across)
        inside = _real(factor * self.wave.displacement(INNER), t)
        if rate == 0:
            solid, inside = (
                solid + self.wave.mean_displacement(self.across),
                inside + self.wave.mean_displacement(INNER),
            )
        regions = dict.fromkeys(self.domain.geometry.solids, solid) | {self.domain.lumens[0]: inside}
        return self.vector(self.domain.mesh.MaterialCF(regions))

    def relative(self, t: float) -> Any:
        """Return the exact velocity of the fluid relative to the mesh, which moves evenly with the interface."""
        return self.velocity(t) - self.vector(_real(1j * OMEGA * self.wave.displacement(INNER), t))

    def state(self, system: System, t: float, rate: int = 0) -> Array:
        """Return the unknowns of the exact solution, or of its rate."""
        field = ng.GridFunction(system.unknowns.space)
        parts = system.named(field)
        parts[MOTION].Set(self.displacement(t, rate), bonus_intorder=4)
        if rate == 0:
            fluid = self.domain.materials(*self.domain.lumens)
            parts[VELOCITY].Set(self.relative(t), definedon=fluid, bonus_intorder=4)
        return np.array(field.vec.FV().NumPy())


def _real(amplitude: complex, t: float) -> float:
    return float(np.real(amplitude * np.exp(1j * OMEGA * t)))


def swinging(profile: Profile, low: float, high: float, t: float, across: Any) -> Any:
    """Return the real part of profile(r) e^(i w t) as a polynomial of r."""
    return evaluated(interpolated(lambda r: np.real(profile(r) * np.exp(1j * OMEGA * t)), low, high), across)


def compute(setting: Setting) -> Values:
    """Return the errors of velocity and displacement after a period from the exact state."""
    order, h = setting["order"], setting["size"]
    step = setting["step"] * PERIOD
    pipe = setting["shape"] == "pipe"
    if pipe:
        geometry: Any = sheath(INNER, OUTER - INNER, LENGTH, h, order)
        materials = Materials(tissue=SOLID, wall=SOLID, fluid=FLUID)
    else:
        mesh = PlaneMesh(far_size=h * 4e-3, curving_order=order)
        geometry = ElasticChannel(length=LENGTH, height=2 * INNER, wall_thickness=OUTER - INNER, mesh=mesh)
        materials = Materials(solid=SOLID, fluid=FLUID)
    time = TimeStepping(step=step, end=PERIOD, scheme=setting["scheme"])
    case = case_of(geometry, 0.0, materials, **{"conditions.ends": "guided", "time": time})
    domain = Domain.build(geometry)
    exact = Exact(domain, pipe_wave() if pipe else channel_wave())
    found = System(case, domain, more=exact.conditions())
    history = History([0.0, -step], [exact.state(found, t) for t in (0.0, -step)],
                      [exact.state(found, t, 1) for t in (0.0, -step)], smooth=1)  # fmt: skip
    fields = found.fields()
    errors = []
    for at in TimeLoop(case, found, Newton(found, choose_backend("auto")), history=history).run():
        velocity, displacement = exact.velocity(at.time), exact.displacement(at.time)
        errors.append((relative_error(fields.velocity, velocity, domain, "fluid"),
                       relative_error(fields.motion, displacement, domain, *geometry.solids)))  # fmt: skip
    of_fluid, of_solid = np.max(errors, axis=0)
    return {"velocity of the fluid, L2 error": float(of_fluid), "displacement of the solid, L2 error": float(of_solid)}


CASE = Benchmark(
    title="Shear waves in fluid and solid",
    solves="the coupled system between elastic walls (in the plane) and in an elastic sheath (in 3-D): one period "
    "under an axial pressure gradient that oscillates about a mean, from the exact state; wall and fluid swing alike, "
    "and the largest errors of the period count",
    exact="the even motion plus cos and sin, or Bessel functions, whose velocity and shear stress are continuous at "
    "the interface; the Neo-Hookean law is linear in simple shear, so that this is exact for any amplitude",
    compute=compute,
)


def _channel(order: int, sizes: Sequence[float], steps: Sequence[int], scheme: str = "bdf2") -> tuple[Setting, ...]:
    """Return settings of one size of elements or one number of steps per period; the other is refined."""
    return tuple(
        {"shape": "channel", "scheme": scheme, "order": order, "size": size, "step": 1 / n,
         "h": 1 / n if len(sizes) == 1 else size}
        for size in sizes
        for n in steps
    )  # fmt: skip


LEVELS = {
    "ci": {
        "channel, time steps": _channel(3, (0.5,), (20, 40)),
        "channel, time steps, esdirk3": _channel(4, (0.25,), (10, 20), "esdirk3"),
        "channel, elements, k = 2": _channel(2, (0.6, 0.3), (160,)),
    },
    "full": {
        "channel, time steps": _channel(4, (0.25,), (20, 40, 80)),
        "channel, time steps, esdirk3": _channel(4, (0.25,), (10, 20, 40), "esdirk3"),
        "channel, time steps, sdirk4": _channel(4, (0.25,), (5, 10, 20), "sdirk4"),
        "channel, elements, k = 2": _channel(2, (0.6, 0.2), (320,)),
        "channel, elements, k = 3": _channel(3, (1.0, 0.5, 0.25), (640,)),
        "pipe, time steps": tuple(
            {"shape": "pipe", "scheme": "bdf2", "order": 3, "size": 0.5, "step": h, "h": h} for h in (1 / 20, 1 / 40)
        ),
    },
}
SERIES = {"channel, time steps": 2.0, "channel, time steps, esdirk3": 2.9,
          "channel, elements, k = 2": 3.0, "channel, elements, k = 3": 4.0,
          "pipe, time steps": 2.0}  # fmt: skip
ORDER_OF_FLUID, ORDER_OF_SOLID = ({**SERIES, "channel, time steps, sdirk4": order} for order in (3.0, 4.0))
OF_FLUID = {"channel, time steps": 6e-4, "channel, time steps, esdirk3": 8e-5, "channel, time steps, sdirk4": 2e-5,
            "channel, elements, k = 2": 1e-3, "channel, elements, k = 3": 1e-5,
            "pipe, time steps": 1e-3}  # fmt: skip
OF_SOLID = {"channel, time steps": 3e-3, "channel, time steps, esdirk3": 4e-4, "channel, time steps, sdirk4": 4e-5,
            "channel, elements, k = 2": 3e-3, "channel, elements, k = 3": 3e-5,
            "pipe, time steps": 3e-3}  # fmt: skip
SOURCE = "closed form; the idea is of A. Hessenthaler, M. Balmus, O. Roehrle, D. Nordsletten, CMAME 362 (2020) 112795"
REFERENCES = (
    Reference("velocity of the fluid, L2 error", 0.0, "1", OF_FLUID, SOURCE, ORDER_OF_FLUID),
    Reference("displacement of the solid, L2 error", 0.0, "1", OF_SOLID, SOURCE, ORDER_OF_SOLID),
)
