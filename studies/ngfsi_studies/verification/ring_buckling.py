"""Buckling of a thin ring under outer pressure, and its collapse until opposite walls meet."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import ngsolve as ng
import numpy as np
from ngsolve.meshes import MakeStructured2DMesh
from numpy.typing import NDArray
from scipy.integrate import solve_bvp
from scipy.interpolate import PchipInterpolator
from scipy.linalg import eigvalsh
from scipy.optimize import brentq

from ngfsi.materials import SaintVenantKirchhoff
from ngfsi.materials.solid.linear import LinearAtRest
from ngfsi.physics import terms
from ngfsi.physics.kinematics import Kinematics
from ngfsi.system.sparse import csr
from ngfsi.verify import Benchmark, Reference, Setting, Values, VerificationError
from ngfsi_studies.verification.solid import solve

Array = NDArray[np.float64]

LAW = SaintVenantKirchhoff(young=1e6, poisson=0.3, density=0.0)
OVAL = 3e-4
"""Change of the radius, relative, of the ring that is followed: without it the ring would stay round."""
SCALED = (1.5, 2.5, 2.8, 2.95, 3.05, 3.2, 3.5, 4.0, 4.5, 4.8, 5.0, 5.1, 5.2, 5.3, 5.4)
"""Pressures at which the oval ring is computed, over E/(1 - nu^2) h^3 / (12 R^3)."""
BRACKET = (2.8, 3.2)
"""Where the round ring's stiffness vanishes; elsewhere its smallest eigenvalue may be that of another mode."""
TOPS = (0.9, 0.6, 0.3)
"""Heights of the middle line's top on the way to the state in which opposite sides meet."""


class QuarterRing:
    """A quarter of a ring of unit radius of the middle surface, symmetric about both axes."""

    def __init__(self, thickness: float, order: int, around: int, oval: float = 0.0, law: LinearAtRest = LAW) -> None:
        self.scale = law.young / (1 - law.poisson**2) * thickness**3 / 12
        self.mesh = MakeStructured2DMesh(quads=True, nx=1, ny=around)
        angle, radius = ng.pi / 2 * ng.y, 1 + thickness * (ng.x - 0.5) + oval * ng.cos(ng.pi * ng.y)
        self.shape = ng.GridFunction(ng.VectorH1(self.mesh, order=order))
        self.shape.Set(ng.CF((radius * ng.cos(angle) - ng.x, radius * ng.sin(angle) - ng.y)))
        self.mesh.SetDeformation(self.shape)
        space = ng.VectorH1(self.mesh, order=order, dirichlety="bottom", dirichletx="top")
        d, v = space.TnT()
        self.pressure = ng.Parameter(0.0)
        self.form = ng.BilinearForm(space)
        self.form += terms.internal_work(law, Kinematics(ng.Grad(d)).F, ng.Grad(v)).Compile() * ng.dx
        skin = Kinematics(ng.Grad(d).Trace())
        self.form += terms.follower_pressure(self.pressure, skin, ng.specialcf.normal(2), v.Trace()) * ng.ds("right")
        self.found = ng.GridFunction(space)
        self.free = np.array(list(space.FreeDofs()))

    def press(self, scaled: float) -> None:
        """Find the equilibrium under a pressure, over E/(1 - nu^2) h^3 / (12 R^3), from the present shape."""
        self.pressure.Set(scaled * self.scale)
        solve(self.form, self.found, self.free, tolerance=1e-8)

    def stiffness(self, scaled: float) -> float:
        """Return the smallest eigenvalue of the linearised round ring under a pressure."""
        self.press(scaled)
        self.form.AssembleLinearization(self.found.vec)
        matrix = csr(self.form.mat)[self.free][:, self.free]
        return float(eigvalsh(matrix.toarray(), subset_by_index=(0, 0))[0])

    def height(self) -> float:
        """Return how far the middle surface's top is above the middle of the ring, over its radius."""
        return float(1 + self.found(self.mesh(0.5, 1.0))[1])


def compute(setting: Setting) -> Values:
    """Return the pressures of buckling and of collapse."""
    thickness, order, around = setting["h"], setting["order"], setting["around"]
    round_ring = QuarterRing(thickness, order, around)
    buckling = brentq(round_ring.stiffness, *BRACKET, xtol=1e-5)
    ring, heights = QuarterRing(thickness, order, around, OVAL), []
    for scaled in SCALED:
        ring.press(scaled)
        heights.append(ring.height())
    meet = brentq(PchipInterpolator(SCALED, heights), *SCALED[-5::4])
    return {"buckling": float(buckling), "opposite walls meet": float(meet)}


def slopes(_s: Array, state: Array, p: float, length: float = 1.0) -> Array:
    """Return the derivatives of a quarter of an inextensible ring of unit radius and bending stiffness under a
    pressure, by its arc length over `length`: position (x, y), angle t of the tangent, curvature c, and the force (f,
    g) of what follows on what precedes."""
    _, _, t, c, f, g = state
    sine, cosine = np.sin(t), np.cos(t)
    return length * np.vstack([cosine, sine, c, f * sine - g * cosine, p * sine, -p * cosine])


def collapsed(meeting: float = 0.0) -> tuple[Array, Array, float]:
    """Return arc length, state and pressure of a thin ring whose top has come down to a height above its middle."""

    def ends(top: float) -> Callable[..., Array]:
        # from the x-axis, going up, to the height `top`, going left; no shear force where symmetry cuts
        return lambda a, b, _: np.array([a[1], a[2] - np.pi / 2, a[4], b[0], b[1] - top, b[2] - np.pi, b[5]])

    s, p = np.linspace(0, np.pi / 2, 41), 3.0
    t = np.pi / 2 + s
    state = np.vstack([np.sin(t), -np.cos(t), t + 0.1 * np.sin(2 * s), 1 + 0.2 * np.cos(2 * s), p * -np.cos(t),
                       p * -np.sin(t)])  # fmt: skip
    for top in (*TOPS, meeting):
        result = solve_bvp(lambda s, y, q: slopes(s, y, q[0]), ends(top), s, state, p=[p], tol=1e-8, max_nodes=20_000)
        if not result.success:
            raise VerificationError(f"no collapsed ring was found: {result.message}")
        s, state, p = result.x, result.y, float(result.p[0])
    return s, state, p


@cache
def elastica() -> float:
    """Return the pressure at which opposite sides of a thin ring meet, from a boundary value problem."""
    return collapsed()[2]


CASE = Benchmark(
    title="Buckling and collapse of a thin ring",
    solves="a quarter of a ring of thickness h under follower pressure, with quadrilaterals of order 4 or 5: the "
    "pressure at which the smallest eigenvalue of the linearised round ring vanishes, and that at which opposite walls "
    "of a slightly oval ring (3e-4) meet; both over E/(1 - nu^2) h^3 / (12 R^3)",
    exact="3 for the inextensible ring (Levy 1884); the collapse from a boundary value problem of the thin ring's "
    "middle line, solved by scipy; what a finite thickness changes falls as h^2",
    compute=compute,
)
LEVELS = {
    "ci": {"k = 4": tuple({"order": 4, "around": 8, "h": h} for h in (0.05, 0.025))},
    "full": {f"k = {k}": tuple({"order": k, "around": 8, "h": h} for h in (0.05, 0.025, 0.0125)) for k in (4, 5)},
}
REFERENCES = (
    Reference("buckling", 3.0, "1", 1e-3, "M. Levy, J Math Pures Appl 10 (1884) 5", 2.0),
    Reference(
        "opposite walls meet", elastica(), "1", 3e-3,
        "boundary value problem of J. E. Flaherty, J. B. Keller, S. I. Rubinow, SIAM J Appl Math 23 (1972) 446", 2.0,
    ),
)  # fmt: skip
