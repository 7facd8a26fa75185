"""Terms of the weak form: each returns the integrand of a virtual work on the reference shape.

Signs: the residual is internal minus external virtual work, so pressures enter with a plus (they push against the
outward normal). `v`, `grad_v` are the test displacement or velocity and its reference gradient.

Formulation: Donea, Huerta, Ponthot, Rodriguez-Ferran, "Arbitrary Lagrangian-Eulerian methods", Encyclopedia of
Computational Mechanics (2004), non-conservative form on the reference shape.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import cos, sin
from typing import Any, TypeAlias

from ngsolve import CoefficientFunction, Cof, Det, Id, IfPos, InnerProduct, OuterProduct, Trace, acos, sqrt, x, y, z

from ngfsi.materials.fluid.law import FluidLaw
from ngfsi.materials.solid.law import SolidModel
from ngfsi.physics.kinematics import Kinematics, in_3d

CF: TypeAlias = Any
"""A CoefficientFunction, a number or a proxy of a trial or test function: NGSolve has no type for their union."""


def internal_work(
    law: SolidModel, F: CF, grad_v: CF, relaxation: CF | None = None, across: tuple[CF, CF] = (1, 0)
) -> CF:
    """P : grad v with P = dW/dF; in the plane, of plane strain unless the stretch across it varies.

    Args:
        across: stretch across the plane and its virtual change; tested with all changes it makes P33 vanish: plane
            stress.
        relaxation: G = dX/dX0 maps the stress-free shape X0 to the reference shape X where the latter is prestressed:
            the law sees F G, and the energy per reference volume is W / det G (inverse design, Govindjee and Mihalic,
            CMAME 136, 1996; use as prestress as in Gee, Foerster and Wall, IJNMBE 26, 2010).
    """
    F, grad_v, volume = _from_free_of_stress(F, grad_v, relaxation, across)
    return law.variation(F, grad_v) / volume


def internal_works(
    law: SolidModel, F: CF, grad_v: CF, relaxation: CF | None = None, across: tuple[CF, CF] = (1, 0)
) -> tuple[CF, CF]:
    """Two parts of `internal_work`, the second of which grows with the bulk modulus."""
    F, grad_v, volume = _from_free_of_stress(F, grad_v, relaxation, across)
    rest, bulk = law.variations(F, grad_v)
    return rest / volume, bulk / volume


def _from_free_of_stress(F: CF, grad_v: CF, relaxation: CF | None, across: tuple[CF, CF]) -> tuple[CF, CF, CF | float]:
    """Return gradients in 3-D with respect to the shape that is free of stress, and the volume that 1 has become."""
    if relaxation is None:
        return in_3d(F, across[0]), in_3d(grad_v, across[1]), 1.0
    return in_3d(F * relaxation, across[0]), in_3d(grad_v * relaxation, across[1]), Det(relaxation)


def membrane_work(law: SolidModel, F: CF, grad_v: CF, normal: CF, stretch: float) -> CF:
    """Derivative of a law's energy in a membrane, per its volume in the given shape (J/m3).

    It keeps its volume: its deformation gradient is s F P + n N / (s^2 A), with the projection P onto the given face of
    normal N, the deformed normal n and the ratio A of deformed to given area, and the stretch s of the given face.
    """
    strain = F.MakeVariable()
    area = Cof(strain) * normal
    across = OuterProduct(area, normal) / (stretch**2 * InnerProduct(area, area))
    whole = stretch * strain * (Id(3) - OuterProduct(normal, normal)) + across
    return law.variation(whole, whole.Diff(strain, grad_v))


def stored_energy(law: SolidModel, F: CF, relaxation: CF | None = None) -> CF:
    """W per reference volume (J/m3), whose derivative `internal_work` is."""
    if relaxation is None:
        return law.energy(in_3d(F, 1))
    return law.energy(in_3d(F * relaxation, 1)) / Det(relaxation)


def hydrostatic_pressure(law: SolidModel, F: CF, across: CF = 1) -> CF:
    """p = -tr(sigma)/3 (Pa, compression positive); tr(sigma) = P : F / J; `across`: stretch across a plane."""
    F = in_3d(F, across)
    return -law.variation(F, F) / (3 * Det(F))


def cauchy_stress(law: SolidModel, F: CF, *, small: bool = False) -> CF:
    """sigma = P F^T / J (Pa, 3x3): sigma : E = P : (E F) / J for each unit tensor E, the symmetric ones once.

    Args:
        small: at small strain all stresses are one.
    """
    F = in_3d(F, 1)
    entries: dict[tuple[int, int], Any] = {}
    for i in range(3):
        for j in range(i, 3):
            unit = CoefficientFunction(tuple(float((a, b) == (i, j)) for a in range(3) for b in range(3)), dims=(3, 3))
            entry = law.variation(F, unit) if small else law.variation(F, unit * F) / Det(F)
            entries[i, j] = entries[j, i] = entry
    return CoefficientFunction(tuple(entries[i, j] for i in range(3) for j in range(3)), dims=(3, 3))


def inertia(density: float | CF, acceleration: CF, v: CF) -> CF:
    """rho0 a . v per reference volume."""
    return density * InnerProduct(acceleration, v)


def convective_inertia(density: float | CF, k: Kinematics, rate: CF, grad_u: CF, relative_velocity: CF, v: CF) -> CF:
    """rho J (du/dt at a fixed reference point + L w) . v; w = u - mesh velocity convects."""
    return density * InnerProduct(k.J * rate + grad_u * (k.cof.trans * relative_velocity), v)


def viscous_stress(fluid: FluidLaw, k: Kinematics, grad_u: CF, held: CF | None = None) -> CF:
    """mu (L + L^T) with L = grad u F^-1, the velocity gradient in the deformed shape; `held`: as below."""
    L = grad_u * k.inverse
    viscosity = fluid.apparent_viscosity(L + L.trans)
    return (viscosity if held is None else (viscosity + held) / 2) * (L + L.trans)


def fluid_stress_work(
    fluid: FluidLaw, k: Kinematics, grad_u: CF, p: CF, grad_v: CF, held: CF | None = None
) -> CF:  # fmt: skip
    """J sigma F^-T : grad v with sigma = -p I + mu (L + L^T).

    Args:
        held: the viscosity as a function of the present state instead of the unknowns. Its mean with mu has half of
            the derivative. Newton's method for a stress like g^n diverges where n < 1/2, as in blood around 1 1/s; with
            half of the derivative of the viscosity it converges for any n, by (1 - n)/(1 + n) an iteration.
    """
    stress = viscous_stress(fluid, k, grad_u, held)
    return InnerProduct(stress * k.cof, grad_v) - p * InnerProduct(k.cof, grad_v)


def incompressibility(k: Kinematics, grad_u: CF, q: CF) -> CF:
    """-J div u q = -cof(F) : grad u q."""
    return -InnerProduct(k.cof, grad_u) * q


def harmonic_extension(stiffness: CF, grad_m: CF, grad_v: CF) -> CF:
    """Laplace equation for the mesh displacement m; a stiffness that is constant only scales the equation."""
    return stiffness * InnerProduct(grad_m, grad_v)


def elastic_extension(stiffness: CF, k: Kinematics, grad_v: CF) -> CF:
    """Equilibrium of a mesh with the energy F : F / 2 - ln J, which grows without bound as an element collapses.

    A stiffness of 1/h^2 keeps small elements in shape (Stein, Tezduyar and Benney, J Appl Mech 70, 2003).
    """
    return stiffness * (InnerProduct(k.F, grad_v) - InnerProduct(k.cof, grad_v) / k.J)


def contact_medium(k: Kinematics, grad_v: CF) -> CF:
    """P : grad v of the energy |cof F|^4 / J^3 + 3 J of a medium that keeps the sides of a gap apart.

    With the motion from the deformed to the reference shape, y, it is |grad y|^4 for each deformed volume, and a
    constant which leaves the reference shape without stress. It is polyconvex, resists any flattening without bound,
    and hardly what else happens to the gap. For powers of 2 in place of 4 its minimisers in the plane are one to one
    whenever the reference shape is convex, however bent the deformed one is (T. Rado, H. Kneser and G. Choquet; A. M.
    Winslow's way to make meshes).
    """
    F, H = in_3d(k.F, 1), in_3d(grad_v, 0)
    C, J = F.trans * F, Det(F)
    squared = (Trace(C) * Trace(C) - InnerProduct(C, C)) / 2
    varied = 2 * InnerProduct(Trace(C) * F - F * C, H)
    return 2 * squared / J**3 * varied + 3 * (1 - squared**2 / J**4) * InnerProduct(Cof(F), H)


def contact_pressure(ratio: float) -> float:
    """Return the pressure of that medium between parallel sides at a ratio of their distance to that at the start."""
    return 3 / ratio**4 + 4 / ratio**2 - 7


def follower_pressure(pressure: CF, k: Kinematics, normal: CF, v: CF) -> CF:
    """p cof(F) N . v: a pressure on the deformed face, N the outward reference normal."""
    return pressure * InnerProduct(k.cof * normal, v)


def part_of_skin(start: float, end: float, edge: float, direction: float = 0.0, half_width: float | None = None) -> CF:
    """Fraction of a pressure that acts at a point of the skin: 1 inside of a part, 0 outside, smooth over its edge.

    The integral over z is end - start exactly, and over the arc at radius r it is 2 r half_width.

    Args:
        start, end: z of its ends [m].
        edge: width of the smooth edge [m], half of it outside.
        direction, half_width: middle and half of the angle around the axis [rad]; half_width None: all around.
    """
    fraction = _smooth_step((z - start) / edge) * _smooth_step((end - z) / edge)
    if half_width is None:
        return fraction
    radius = sqrt(x * x + y * y)
    # the arc cosine must not see rounding beyond 1
    cosine = (x * cos(direction) + y * sin(direction)) / radius * (1 - 1e-14)
    return fraction * _smooth_step((half_width - acos(cosine)) * radius / edge)


def piecewise(s: CF, points: Sequence[float], values: Sequence[float]) -> CF:
    """Value at s between given points, which increase: linear there, held beyond them."""
    found = CoefficientFunction(values[0])
    for (s0, s1), (v0, v1) in zip(pairwise(points), pairwise(values), strict=True):
        found += (v1 - v0) * IfPos(s - s1, 1.0, IfPos(s - s0, (s - s0) / (s1 - s0), 0.0))
    return found


def _smooth_step(s: CF) -> CF:
    """Rise from 0 at s = -1/2 to 1 at s = 1/2, odd about the middle and without a kink."""
    inside = IfPos(s - 0.5, 1.0, IfPos(s + 0.5, s + 0.5, 0.0))
    return inside * inside * (3 - 2 * inside)


def opening(fluid: FluidLaw, pressure: CF, k: Kinematics, grad_u: CF, normal: CF, v: CF) -> CF:
    """Traction sigma n = -p n + mu L^T n on an opening of given pressure, which developed flow satisfies exactly."""
    area, L = k.cof * normal, grad_u * k.inverse
    transposed = fluid.apparent_viscosity(L + L.trans) * InnerProduct(L.trans * area, v)
    return pressure * InnerProduct(area, v) - transposed


def backflow(density: CF, k: Kinematics, u: CF, w: CF, normal: CF, v: CF) -> CF:
    """Traction rho (w.n)_- u that takes out the kinetic energy of blood that comes back through an outlet.

    It vanishes where the flow leaves (Bertoglio et al., IJNMBE 34, 2018).
    """
    flux = InnerProduct(w, k.cof * normal)
    return -density * IfPos(flux, 0, flux) * InnerProduct(u, v)


def relative_flux(k: Kinematics, w: CF, normal: CF) -> CF:
    """Volume flux per reference area of blood through the moving face: w . cof(F) N."""
    return InnerProduct(w, k.cof * normal)


def tangential(traction: CF, normal: CF) -> CF:
    """Part of a traction (vector, Pa) in the face with a unit normal, which may point either way: its shear stress."""
    return traction - InnerProduct(traction, normal) * normal
