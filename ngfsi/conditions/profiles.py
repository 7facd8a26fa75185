"""Velocity profiles at openings of any shape, as unknowns of the relative velocity on the opening's face."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import ngsolve as ng
import numpy as np

from ngfsi.arrays import Array
from ngfsi.materials.fluid.law import SMALLEST_SHEAR_RATE, FluidLaw
from ngfsi.mesh.domain import Domain

HARMONICS = 12
"""Of a periodic flow that Womersley's profile follows; the rest is developed flow."""
SAMPLES = 128
PICARD = 60
"""Most iterations for the profile of a fluid that thins."""


def inwards(domain: Domain, opening: str, lumen: str) -> Any:
    """Return the unit normal that points into the blood, mean over an opening: a constant vector."""
    normal = domain.mean_normal(opening)
    same = ng.Integrate(domain.outward_normal(lumen) * ng.CF(tuple(normal)) * domain.ds(opening), domain.mesh)
    return ng.CF(tuple(-np.sign(same) * normal))


def developed(domain: Domain, opening: str, order: int) -> ng.GridFunction:
    """Return a solution of Poisson's equation on an opening that vanishes on its rim: the axial velocity of developed
    flow in a cylinder over the opening, of any shape, up to a factor."""
    return _on_face(domain, opening, order, 1.0, 0.0)


def developed_of_law(domain: Domain, opening: str, order: int, fluid: FluidLaw, flow: float) -> ng.GridFunction:
    """Return the axial velocity (m/s) of developed flow of a fluid in a cylinder over an opening, of any shape.

    In -div(mu(|grad u|) grad u) = G the pressure gradient G is found with the velocity, of which the viscosity is that
    of the last iterate (Picard): an iteration takes a fraction of about 1 - n off the error, n the slope of stress over
    shear rate in logarithms.

    Args:
        flow: through the opening, m3/s.
    """
    found, over = developed(domain, opening, order), domain.ds(opening, bonus_intorder=2 * order)
    gradient = ng.Grad(found).Trace()
    viscosity = fluid.viscosity_at(ng.sqrt(ng.InnerProduct(gradient, gradient) + SMALLEST_SHEAR_RATE**2))
    before = np.zeros(len(found.vec))
    for _ in range(PICARD):
        values = found.vec.FV().NumPy()
        values *= flow / ng.Integrate(found * over, domain.mesh)
        if np.abs(values - before).max() < 1e-9 * np.abs(values).max():
            break
        before = values.copy()
        found.vec.data = _on_face(domain, opening, order, 1.0, 0.0, viscosity).vec
    return found


def womersley(domain: Domain, opening: str, order: int, parameter: float) -> ng.GridFunction:
    """Return the complex amplitude, up to a factor, of the axial velocity that oscillates in a cylinder over an opening
    (J. R. Womersley, J Physiol 127, 1955, for the circle): -laplace u + i parameter u = 1, parameter = rho w / mu."""
    return _on_face(domain, opening, order, 1.0, 1j * parameter)


def _on_face(
    domain: Domain, opening: str, order: int, load: float, mass: complex, viscosity: Any = 1.0
) -> ng.GridFunction:
    """Solve -div(viscosity grad u) + mass u = load on an opening's face, zero on its rim."""
    lumens = domain.materials(*domain.lumens)
    # a space of the face alone has no functions on other boundaries, from which to tell its rim
    space = ng.H1(domain.mesh, order=order, definedon=lumens, complex=bool(mass))
    trial, test = space.TnT()
    over = domain.ds(opening, bonus_intorder=2 * order)
    form = ng.BilinearForm(space, check_unused=False)
    form += (viscosity * ng.Grad(trial).Trace() * ng.Grad(test).Trace() + mass * trial * test) * over
    right = ng.LinearForm(space)
    right += load * test * over
    form.Assemble()
    right.Assemble()
    inside = space.GetDofs(domain.boundaries(opening)) & ~rim(domain, opening, space)
    found = ng.GridFunction(space)
    inverse = "umfpack" if mass else "sparsecholesky"
    found.vec.data = form.mat.Inverse(inside, inverse=inverse) * right.vec
    return found


def rim(domain: Domain, opening: str, space: Any) -> ng.BitArray:
    """Return the unknowns of a space on the rim of an opening: those that it shares with other boundaries."""
    others = [name for name in domain.geometry.boundary_names if name != opening]
    return space.GetDofs(domain.boundaries(*others))


def oscillating(
    flow: Callable[[float], float], period: float, profile_of: Callable[[float], tuple[Array, complex]]
) -> Callable[[float], Array]:
    """Return the prescribed values over time of a periodic flow (m3/s) of a period (s), its mean left out.

    Args:
        profile_of: angular frequency (1/s) -> complex values of unit amplitude, and their flux (m3/s).
    """
    times = period * np.arange(SAMPLES) / SAMPLES
    amplitudes = np.fft.rfft([flow(float(t)) for t in times]) / SAMPLES
    waves = []
    for n in range(1, HARMONICS + 1):
        values, flux = profile_of(2 * np.pi * n / period)
        waves.append((2 * np.pi * n / period, 2 * amplitudes[n] * values / flux))

    def at(t: float) -> Array:
        return np.asarray(sum(np.real(wave * np.exp(1j * omega * t)) for omega, wave in waves))

    return at
