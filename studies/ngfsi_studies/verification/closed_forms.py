"""Uniaxial tension and compression, and simple shear, of a block."""

from __future__ import annotations

import ngsolve as ng
import numpy as np
from ngsolve import Grad, GridFunction, Id
from ngsolve.meshes import MakeStructured3DMesh
from scipy.optimize import brentq

from ngfsi.materials import MooneyRivlin, SolidLaw, load_set
from ngfsi.physics import terms
from ngfsi.verify import Benchmark, Reference, Setting, Values
from ngfsi_studies.verification.radial import stress_of
from ngfsi_studies.verification.solid import solve

LAWS = {"M": "mooney_rivlin_s1", "N": "neo_hookean_likely"}
STRETCHES, SHEARS = (0.75, 1.2), (0.2, 0.5)


def compute(setting: Setting) -> Values:
    """Return the force on the moved face over its area (Pa)."""
    found = {}
    for name, key in LAWS.items():
        law: SolidLaw = load_set(key)  # type: ignore[assignment]
        for stretch in STRETCHES:
            found[f"{name}: P_zz at stretch {stretch}"] = _uniaxial(law, stretch, setting["order"])
        for shear in SHEARS:
            found[f"{name}: sigma_xz at shear {shear}"] = _shear(law, shear, setting["order"])
    return found


def _uniaxial(law: SolidLaw, stretch: float, order: int) -> float:
    """Pull at one face of the unit cube, with rollers on three faces and two free ones."""
    held = {"dirichletx": "back", "dirichlety": "left", "dirichletz": "bottom|top"}
    return _force(law, order, ng.CF((0, 0, (stretch - 1) * ng.z)), 2, held)


def _shear(law: SolidLaw, shear: float, order: int) -> float:
    """Shear the whole surface of the unit cube."""
    return _force(law, order, ng.CF((shear * ng.z, 0, 0)), 0, {"dirichlet": ".*"})


def _force(law: SolidLaw, order: int, moved: ng.CoefficientFunction, component: int, held: dict[str, str]) -> float:
    mesh = MakeStructured3DMesh(hexes=False, nx=2, ny=2, nz=2, mapping=_skewed)
    space = ng.VectorH1(mesh, order=order, **held)
    d, v = space.TnT()
    form = ng.BilinearForm(space)
    form += terms.internal_work(law, Id(3) + Grad(d), Grad(v)).Compile() * ng.dx
    found = GridFunction(space)
    found.Set(moved)
    free = np.array(list(space.FreeDofs()))
    reaction = solve(form, found, free)
    # virtual work of the reactions in a motion that moves the upper face only
    face = GridFunction(space)
    face.Set(ng.CF(tuple(float(i == component) for i in range(3))), definedon=mesh.Boundaries("top"))
    return float(reaction @ face.vec.FV().NumPy())


def _skewed(x: float, y: float, z: float) -> tuple[float, float, float]:
    """Move the inner vertices of the cube."""
    bump = 64 * x * (1 - x) * y * (1 - y) * z * (1 - z)
    return x + 0.08 * bump, y - 0.06 * bump, z + 0.05 * bump


def _exact(name: str, kind: str, amount: float) -> float:
    law: SolidLaw = load_set(LAWS[name])  # type: ignore[assignment]
    if kind == "shear":
        # J = 1 and I1 = I2 = 3 + shear^2: sigma = 2 (W1 + W2) shear
        if isinstance(law, MooneyRivlin):
            return 2 * amount * (law.c10 + law.c01 + 2 * law.c11 * amount**2)
        assert law.shear_modulus is not None
        return law.shear_modulus * amount
    stress = stress_of(law)
    across = brentq(lambda side: stress(np.array([side, side, amount]))[0], 0.5, 2.0, xtol=1e-15)
    return float(stress(np.array([across, across, amount]))[2])


CASE = Benchmark(
    title="Uniaxial stretch and simple shear",
    solves="a skewed mesh of a cube that is pulled or pressed at one face, its sides free, or sheared all over; the "
    "force is the virtual work of the reactions",
    exact="P_zz from the energy in principal stretches with stress-free sides (a scalar equation), and "
    "sigma_xz = 2 (W_1 + W_2) shear; such states are even, so that any mesh has them exactly",
    compute=compute,
)
LEVELS = {level: {f"k = {k}": ({"order": k},) for k in orders} for level, orders in
          {"ci": (1, 2), "full": (1, 2, 3, 4)}.items()}  # fmt: skip
REFERENCES = (
    *(
        Reference(f"{name}: P_zz at stretch {s}", _exact(name, "stretch", s), "Pa", 1e-9, "radial.py, zero side stress")
        for name in LAWS
        for s in STRETCHES
    ),
    *(
        Reference(f"{name}: sigma_xz at shear {s}", _exact(name, "shear", s), "Pa", 1e-9, "closed form")
        for name in LAWS
        for s in SHEARS
    ),
)
