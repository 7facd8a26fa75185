"""Stability of vein and tissue under the present pressures: how far is the vein from collapsing?

The solids are looked at alone, with the blood's pressure held as it is: it follows the moving wall, but does not answer
to it. Their tangent K, at rest, has positive eigenvalues while the shape is stable; K x = lambda M x with the mass
matrix M makes them squares of angular frequencies, of the vein without the mass of its blood. The smallest may belong
to a sway of the whole segment, and tells only when stability is lost, not how soon. That tell two tangents of one ramp:
beyond K0 and K1 the chord K1 + s (K1 - K0) becomes singular first at the smallest positive s, and its null vector is
the mode of collapse (accompanying eigenvalue analysis: Brendel and Ramm, Comput Struct 12, 1980).

K is symmetric where the blood's pressure is even and the ends are held or slide in their plane; elsewhere its symmetric
part is taken, which loses definiteness first.

A plane section has no mass that matters: of it the motion is looked for that it resists least (`Softness`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import ngsolve as ng
import numpy as np
from scipy.sparse.linalg import ArpackError, LinearOperator, eigs, eigsh

from ngfsi.arrays import Array
from ngfsi.conditions import PressureOn
from ngfsi.errors import SolverError
from ngfsi.linear.backends import BACKENDS, choose_backend
from ngfsi.system.forms import tangent_form
from ngfsi.system.sparse import csr
from ngfsi.system.system import System

NEAREST = 4
"""Eigenvalues looked for around zero: once the smallest is negative, it may not be the nearest."""
TOLERANCE = 1e-6
"""Of eigenvalues, relative."""
SEED = 1
"""Of the vector that the iteration starts from."""


@dataclass(frozen=True)
class Stage:
    """What is known of the stability in one state.

    Attributes:
        pressure: on the skin, with the strongest cuff, Pa.
        eigenvalue: smallest one, 1/s2; negative: the shape is unstable.
        critical: pressure on the skin at which the tangent becomes singular, on the chord from the stage before, Pa;
            infinite: nothing softens; NaN: no stable stage is before this one, or the pressure is the same.
        wall_share: fraction of the wall in the mode's kinetic energy.
    """

    pressure: float
    eigenvalue: float
    critical: float
    wall_share: float

    def row(self, time: float) -> dict[str, float]:
        """Return a row of a table; time in s."""
        return {"time_s": time, "skin_pressure_Pa": self.pressure, "smallest_eigenvalue_1_s2": self.eigenvalue,
                "critical_skin_pressure_Pa": self.critical, "wall_share_of_mode_1": self.wall_share}  # fmt: skip


class Before(NamedTuple):
    """An earlier stage: snapshot of the system, entries of the tangent, pressure (Pa), smallest eigenvalue (1/s2)."""

    point: dict[str, Array]
    entries: Array
    pressure: float
    eigenvalue: float


class Stability:
    """The tangent of a system's solids and its eigenvalues, stage by stage of a ramp.

    Attributes:
        eigenvalues: those nearest to zero, 1/s2.
        mode: motion with which the vein collapses where a critical pressure is known, else that of the smallest
            eigenvalue; its largest unknown is 1.
    """

    def __init__(self, system: System) -> None:
        self._system = system
        space = system.unknowns.space.components[0]
        self._free = system.unknowns.free("d")[: space.ndof]
        # eigenvalues need factors of double precision
        chosen = choose_backend(system.case.solver.linear)
        self._backend = BACKENDS["pardiso" if chosen == "pardiso_single" else chosen]
        self._form = tangent_form(space, system.static_integrals(*space.TnT()))
        self.eigenvalues = np.zeros(0)
        self.mode = ng.GridFunction(space)
        self._before: Before | None = None

    def arrays(self) -> dict[str, Array]:
        """Return as plain arrays what the next stage depends on, for `restore`."""
        if self._before is None:
            return {}
        return self._before.point | {"stage": np.array(self._before[2:])}

    def restore(self, arrays: Mapping[str, Array]) -> None:
        """Go on as that which returned `arrays`; the system is left in the state of the last stage."""
        if arrays:
            self._system.restore(arrays)
            self._before = Before(self._system.snapshot(), self._tangent(), *map(float, arrays["stage"]))

    def refresh(self) -> Stage:
        """Return the stage of the system's present state.

        Raises:
            SolverError: a solid has no mass, or the eigenvalues were not found.
        """
        masses, pressure, entries = self._masses, self._pressure(), self._tangent()
        mass, now, solve = sum(masses.values()), self._restricted(self._form), self._inverse(entries)
        try:
            values, vectors = _eigen(now, NEAREST, M=mass, sigma=0.0, OPinv=solve)
            lowest = int(np.argmin(values))
            self.eigenvalues = values
            eigenvalue, mode, critical = float(values[lowest]), vectors[:, lowest], np.nan
            if self._before is not None and self._before.eigenvalue > 0 and pressure != self._before.pressure:
                found = self._collapse(now, pressure, solve if eigenvalue > 0 else None)
                critical, mode = found if found else (np.inf, mode)
        except ArpackError as error:
            raise SolverError(f"the eigenvalues of the tangent were not found: {error}") from None
        self._before = Before(self._system.snapshot(), entries, pressure, eigenvalue)
        self.mode.vec.FV().NumPy()[self._free] = mode / mode[np.argmax(np.abs(mode))]
        fraction = float(mode @ (masses["wall"] @ mode)) / float(mode @ (mass @ mode)) if "wall" in masses else 0.0
        return Stage(pressure, eigenvalue, critical, fraction)

    def _collapse(self, now: Any, pressure: float, solve: LinearOperator | None) -> tuple[float, Array] | None:
        """Return the critical pressure on the chord from the stage before, and its mode; None: nothing softens.

        Args:
            solve: inverse of the tangent now; None: it is not definite, stability was lost on the way.
        """
        assert self._before is not None
        before, start = self._restricted(self._form, self._before.entries), pressure
        change, base = now - before, now
        if not np.any(change.data):
            return None
        if solve is None:
            base, start, solve = before, self._before.pressure, self._inverse(self._before.entries)
        # base + s change is singular where change x = -1/s base x
        values, vectors = _eigen(change, 1, M=base, Minv=solve, which="SA")
        if values[0] >= 0:
            return None
        return start - (pressure - self._before.pressure) / float(values[0]), vectors[:, 0]

    def _pressure(self) -> float:
        acting = [c.value.Get() for c in self._system.conditions.values() if isinstance(c, PressureOn) and c.on_skin]
        return float(acting[0] + max(acting[1:], default=0.0))

    def _tangent(self) -> Array:
        """Return the entries of the present tangent's symmetric part, which the form's matrix then has."""
        self._form.AssembleLinearization(self._system.state.components[0].vec)
        entries = self._form.mat.AsVector().FV().NumPy()
        entries[:] = (entries + csr(self._form.mat).T.tocsr().data) / 2
        return np.array(entries)

    @cached_property
    def _masses(self) -> dict[str, Any]:
        """Mass matrix of each solid on the free unknowns."""
        system, space, found = self._system, self.mode.space, {}
        for name, part in zip(system.solids, system.inertia_integrals(*space.TnT()), strict=True):
            if system.solids[name].density <= 0:
                raise SolverError(f"the stability of solids needs their density, which '{name}' has not")
            form = tangent_form(space, [part])
            form.Assemble()
            found[name] = self._restricted(form)
        return found

    def _restricted(self, form: ng.BilinearForm, entries: Array | None = None) -> Any:
        return csr(form.mat, entries)[self._free][:, self._free]

    def _inverse(self, entries: Array) -> LinearOperator:
        matrix = self._form.mat
        matrix.AsVector().FV().NumPy()[:] = entries
        try:
            factors = self._backend.factors(matrix, ng.BitArray(list(self._free)), None)
        except Exception as error:  # NGSolve raises its own and generic exceptions
            raise SolverError(f"the tangent of the solids could not be factorised: {error}") from error
        load, found = matrix.CreateColVector(), matrix.CreateRowVector()

        def solve(x: Array) -> Array:
            load.FV().NumPy()[self._free] = x.ravel()
            found.data = factors * load
            return np.array(found.FV().NumPy()[self._free])

        load[:] = 0.0
        size = int(np.count_nonzero(self._free))
        return LinearOperator((size, size), matvec=solve, dtype=float)


@dataclass(frozen=True)
class SoftestMode:
    """The motion that a system in equilibrium resists least.

    Attributes:
        stiffness: its stiffness over that of shear alone in the tissue's initial modulus, 0 at a buckling load.
        place: (x, y) of the vertex that moves most, m.
    """

    stiffness: float
    place: tuple[float, float]

    def row(self, time: float) -> dict[str, float]:
        """Return a row of a table; time in s."""
        x, y = self.place
        return {"time_s": time, "softest_stiffness_1": self.stiffness, "softest_x_m": x, "softest_y_m": y}


class Softness:
    """The softest mode of a system, stage by stage."""

    mode = None

    def __init__(self, system: System) -> None:
        self._system = system
        # on several ranks the tangent of one that has all elements
        self._whole = system if system.mine(ng.VOL) is None else System(system.case, system.domain)

    def refresh(self) -> SoftestMode:
        """Return the lowest eigenvalue of the tangent stiffness in the present state against the integral of
        G grad u : grad v, and its mode.

        From order 3 on interior unknowns follow the others, and count in the integral no more than those say.

        Raises:
            SolverError: no eigenvalue was found.
        """
        if self._whole is not self._system:
            self._whole.restore(self._system.snapshot())
        system, tangent, domain = self._whole, self._whole.tangent, self._whole.domain
        space = system.unknowns.space
        chosen = np.flatnonzero(system.unknowns.free() & np.array(list(space.FreeDofs(tangent.condense))))
        tangent.AssembleLinearization(system.state.vec)
        shear = ng.BilinearForm(space, check_unused=False)
        trial, test = (parts[0] for parts in space.TnT())
        for name in domain.geometry.solids:
            modulus = system.case.materials.law_of(name).shear_modulus
            shear += modulus * ng.InnerProduct(ng.Grad(trial), ng.Grad(test)) * domain.dx(name)
        shear.Assemble()
        stiffness, mass = (csr(form.mat)[chosen][:, chosen].tocsc() for form in (tangent, shear))
        try:
            values, modes = eigs(stiffness, k=2, M=mass, sigma=0.0, v0=np.ones(len(chosen)))
        except (ArpackError, RuntimeError) as error:
            raise SolverError(f"no softest mode was found: {error}") from None
        lowest = int(np.argmin(values.real))
        whole = np.zeros(space.ndof)
        whole[chosen] = modes[:, lowest].real
        # the first functions of each component are those of the vertices
        size, vertices = space.components[0].ndof // domain.mesh.dim, domain.mesh.nv
        moved = np.hypot(whole[:vertices], whole[size : size + vertices])
        x, y = domain.mesh.vertices[int(np.argmax(moved))].point[:2]
        return SoftestMode(float(values[lowest].real), (float(x), float(y)))

    def arrays(self) -> dict[str, Array]:
        """Return nothing: no stage depends on another."""
        return {}

    def restore(self, _arrays: object) -> None:
        """Take nothing."""


def _eigen(matrix: Any, count: int, **options: Any) -> tuple[Array, Array]:
    start = np.random.default_rng(SEED).standard_normal(matrix.shape[0])
    values, vectors = eigsh(matrix, k=count, v0=start, tol=TOLERANCE, **options)
    return values, vectors
