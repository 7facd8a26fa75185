"""The softest motion of a plane section: where it is about to buckle."""

from __future__ import annotations

from dataclasses import dataclass

import ngsolve as ng
import numpy as np
from scipy.sparse.linalg import ArpackError, eigs

from ngfsi.arrays import Array
from ngfsi.errors import SolverError
from ngfsi.system.sparse import csr
from ngfsi.system.system import System


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

    def refresh(self) -> SoftestMode:
        """Return the lowest eigenvalue of the tangent stiffness in the present state against the integral of
        G grad u : grad v, and its mode.

        From order 3 on interior unknowns follow the others, and count in the integral no more than those say.

        Raises:
            SolverError: no eigenvalue was found.
        """
        system, tangent, domain = self._system, self._system.tangent, self._system.domain
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
