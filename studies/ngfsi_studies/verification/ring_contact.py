"""Contact of opposite sides of a ring under outer pressure: in a point, then in a segment that grows."""

from __future__ import annotations

from functools import cache

import ngsolve as ng
import numpy as np
from netgen.geom2d import SplineGeometry
from numpy.typing import NDArray
from scipy.integrate import solve_bvp

from ngfsi.physics import terms
from ngfsi.physics.kinematics import Kinematics
from ngfsi.verify import Benchmark, Reference, Setting, Values, VerificationError
from ngfsi_studies.verification.ring_buckling import LAW, collapsed, slopes
from ngfsi_studies.verification.solid import solve

Array = NDArray[np.float64]

THICKNESS = 0.025
"""Of the ring, over the radius of its middle line."""
OVAL = 3e-3
"""Change of the radius, relative, of the ring that is followed: without it the ring would stay round."""
HELD = {"area in point contact": 8.0, "area in segment contact": 16.0}
"""Quantity -> pressure."""
SMALLEST_STEP, LARGEST_STEP = 1e-3, 1.0
"""Of the pressure on the ring."""
STEP = 4.0
"""Largest change of the pressure from one contact of the thin ring to the next."""
PRESSED = 10.0
"""Pressure between the sides, so scaled, at which their distance is the residual gap."""


def mesh(size: float, order: int) -> ng.Mesh:
    """Return a quarter of a ring of unit radius of the middle line, and of its lumen, symmetric about both axes."""
    shape, (inner, outer) = SplineGeometry(), (1 - THICKNESS / 2, 1 + THICKNESS / 2)
    middle = shape.AppendPoint(0, 0)
    right, top, corner, right_out, top_out, corner_out = (
        shape.AppendPoint((1 + OVAL) * x, (1 - OVAL) * y)
        for radius in (inner, outer)
        for x, y in ((radius, 0), (0, radius), (radius, radius))
    )
    arc = {"maxh": size * np.pi / 2}
    shape.Append(["line", middle, right], leftdomain=2, bc="bottom")
    shape.Append(["line", top, middle], leftdomain=2, bc="side")
    shape.Append(["line", right, right_out], leftdomain=1, bc="bottom")
    shape.Append(["line", top_out, top], leftdomain=1, bc="side")
    shape.Append(["spline3", right_out, corner_out, top_out], leftdomain=1, bc="outer", **arc)
    shape.Append(["spline3", right, corner, top], leftdomain=2, rightdomain=1, bc="inner", **arc)
    shape.SetMaterial(1, "ring")
    shape.SetMaterial(2, "lumen")
    found = ng.Mesh(shape.GenerateMesh(maxh=2.5 * size, grading=0.6))
    found.Curve(order)
    return found


def compute(setting: Setting) -> Values:
    """Return areas inside of the ring with no gap, extrapolated from those with a gap and with half of it."""
    wide, narrow = (areas_inside(setting, gap) for gap in (setting["h"], setting["h"] / 2))
    return {name: 2 * narrow[name] - wide[name] for name in HELD}


def areas_inside(setting: Setting, gap: float) -> Values:
    """Return areas inside of the ring, over that of its middle line at rest, with a residual gap, which is the fraction
    of their first distance that is left to sides which are pressed together by `PRESSED`."""
    order = setting["order"]
    quarter = mesh(setting["size"], order)
    space = ng.VectorH1(quarter, order=order, dirichlety="bottom", dirichletx="side")
    d, v = space.TnT()
    scale = LAW.young / (1 - LAW.poisson**2) * THICKNESS**3 / 12
    stiffness, pressure = PRESSED * scale / terms.contact_pressure(gap), ng.Parameter(0.0)
    k, skin = Kinematics(ng.Grad(d)), Kinematics(ng.Grad(d).Trace())
    form = ng.BilinearForm(space)
    form += terms.internal_work(LAW, k.F, ng.Grad(v)).Compile() * ng.dx("ring")
    form += (stiffness * terms.contact_medium(k, ng.Grad(v))).Compile() * ng.dx("lumen", bonus_intorder=4)
    form += terms.follower_pressure(pressure, skin, ng.specialcf.normal(2), v.Trace()) * ng.ds("outer")
    found, free = ng.GridFunction(space), np.array(list(space.FreeDofs()))
    areas, scaled, step = {}, 0.0, LARGEST_STEP
    for name, goal in HELD.items():
        while scaled < goal:
            before, step = np.array(found.vec.FV().NumPy()), min(step, goal - scaled)
            pressure.Set((scaled + step) * scale)
            try:
                solve(form, found, free, tolerance=1e-8)
            except VerificationError:
                found.vec.FV().NumPy()[:] = before
                step /= 2
                if step < SMALLEST_STEP:
                    raise
            else:
                scaled, step = scaled + step, min(1.5 * step, LARGEST_STEP)
        volume = Kinematics(ng.Grad(found)).J * ng.dx("lumen")
        areas[name] = 4 * float(ng.Integrate(volume, quarter)) / np.pi
    return areas


@cache
def thin_ring() -> Values:
    """Return the same areas of a ring whose middle line is inextensible, with half of its thickness on either side.

    A quarter of the middle line meets the other half in a point, with a force, until it is straight there; then it lies
    on it along a segment whose length is unknown.
    """
    top = THICKNESS / 2
    s, state, pressure = collapsed(top)
    found, touching = {}, np.zeros(0)
    for name, goal in HELD.items():
        for p in np.linspace(pressure, goal, 2 + int((goal - pressure) / STEP))[1:]:
            if not len(touching) and state[3, -1] > 0:  # it would bend through the other side
                touching = np.array([1e-2])
            s, state, touching = _in_contact(s / s[-1], state, p, touching, top)
        pressure, x, y = goal, state[0], state[1]
        flat = float(touching.sum())
        middle = 4 * (np.trapezoid(y, -x) + top * flat)
        found[name] = float((middle - np.pi * THICKNESS + np.pi * top**2) / np.pi)
    return found


def _in_contact(s: Array, state: Array, p: float, touching: Array, top: float) -> tuple[Array, Array, Array]:
    """Return the thin ring under a pressure, in contact in a point (`touching` is empty) or along a segment."""

    def slope(s: Array, state: Array, flat: Array = touching) -> Array:
        return slopes(s, state, p, np.pi / 2 - float(flat.sum()))

    def ends(a: Array, b: Array, flat: Array = touching) -> Array:
        straight = [b[3]] if len(flat) else []
        return np.array([a[1], a[2] - np.pi / 2, a[4], b[0] - flat.sum(), b[1] - top, b[2] - np.pi, *straight])

    given = {"p": touching} if len(touching) else {}
    found = solve_bvp(slope, ends, s, state, tol=1e-6, max_nodes=20_000, **given)
    if not found.success:
        raise VerificationError(f"no ring in contact was found: {found.message}")
    return found.x, found.y, found.p if len(touching) else touching


CASE = Benchmark(
    title="Contact of opposite sides of a ring",
    solves="a quarter of a ring of h/R = 1/40, St Venant-Kirchhoff, and of the lumen as the medium that keeps sides "
    "apart (`[conditions.contact]`), with triangles of order k, under follower pressures of 8 and 16 E/(1 - nu^2) h^3 "
    "/ (12 R^3); the area inside, extrapolated from residual gaps g and g/2, over that of the middle line at rest",
    exact="boundary value problem of the thin ring's middle line, inextensible, that touches itself in a point, then "
    "along a segment of unknown length, solved by scipy; what is left of a finite thickness falls as h^2",
    compute=compute,
)
LEVELS = {
    "ci": {"k = 4": ({"order": 4, "size": 0.06, "h": 0.01},)},
    "full": {"k = 4": tuple({"order": 4, "size": 0.06, "h": h} for h in (0.02, 0.01, 0.005))},
}
SOURCE = "boundary value problem of J. E. Flaherty, J. B. Keller, S. I. Rubinow, SIAM J Appl Math 23 (1972) 446"
REFERENCES = tuple(Reference(name, value, "1", 3e-3, SOURCE) for name, value in thin_ring().items())
