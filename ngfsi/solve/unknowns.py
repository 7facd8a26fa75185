"""The unknowns of the coupled problem, split so that the interface conditions hold by construction.

d  displacement of the solids, interface included; its basis functions on the interface reach one element layer into
   the fluid (the discrete lifting), so that the mesh there follows the wall.
w  velocity of the blood relative to the mesh, zero on the interface: u = w + d/dt (d + e) equals the wall's velocity.
p  pressure of the blood.
e  the rest of the mesh motion in the fluid, zero on the interface: mesh displacement m = d + e.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import ngsolve as ng
import numpy as np
from numpy.typing import NDArray

from ngfsi.domain import Domain

Ends = Literal["roller", "clamped", "free"]
BLOCKS = ("d", "w", "p", "e")

SOLID_ENDS = ("tissue_top", "tissue_bottom", "wall_top", "wall_bottom")
OPENINGS = ("inlet", "outlet")


@dataclass(frozen=True)
class Unknowns:
    """Product space of (d, w, p, e).

    Attributes:
        space: the NGSolve space; components in the order of `BLOCKS`.
        blocks: name -> slice of the vector.
        inlet: numbers of the relative velocity's dofs on the inlet, prescribed there.
        order: polynomial order k.
        solvable: mask of the dofs that no boundary condition prescribes. The space's own `FreeDofs` is wrong:
            `Compress` forgets conditions on single components (`dirichletz`).
    """

    space: Any
    blocks: dict[str, slice]
    inlet: NDArray[np.int64]
    order: int
    solvable: NDArray[np.bool_]

    @classmethod
    def build(cls, domain: Domain, order: int, ends: Ends) -> Unknowns:
        """Return the unknowns of polynomial order k: d, w, e of order k and p of order k - 1.

        Roller: the end faces slide in their plane; clamped: they are fixed; free: they carry no load.
        Bones are fixed.
        """
        mesh, fluid = domain.mesh, domain.geometry.fluid
        bones = [name for name in ("tibia", "fibula") if name in domain.geometry.boundary_names]
        ends_of_solid = [name for name in SOLID_ENDS if name in domain.geometry.boundary_names]
        held = {"roller": "dirichletz", "clamped": "dirichlet"}.get(ends)
        fixed = {"dirichlet": "|".join(bones + (ends_of_solid if held == "dirichlet" else []))}
        if held == "dirichletz":
            fixed["dirichletz"] = "|".join(ends_of_solid)
        displacement = ng.VectorH1(mesh, order=order, **{key: names for key, names in fixed.items() if names})
        velocity = ng.VectorH1(mesh, order=order, definedon=fluid, dirichlet="inlet")
        mesh_fixed = {held: "|".join(OPENINGS)} if held else {}
        motion = ng.VectorH1(mesh, order=order, definedon=fluid, **mesh_fixed)
        pressure = ng.H1(mesh, order=order - 1, definedon=fluid)
        solids = displacement.GetDofs(domain.materials(*domain.geometry.solids))
        inside = velocity.GetDofs(domain.materials(fluid)) & ~velocity.GetDofs(domain.boundaries("interface"))
        space = ng.FESpace(
            [
                ng.Compress(displacement, solids),
                ng.Compress(velocity, inside),
                ng.Compress(pressure),
                ng.Compress(motion, inside),
            ]
        )
        blocks = {name: slice(space.Range(i).start, space.Range(i).stop) for i, name in enumerate(BLOCKS)}
        on_inlet = _mask(space.components[1].GetDofs(domain.boundaries("inlet")))
        parts = ((displacement, solids), (velocity, inside), (pressure, pressure.FreeDofs()), (motion, inside))
        solvable = np.concatenate([_mask(parent.FreeDofs())[_mask(kept)] for parent, kept in parts])
        return cls(space, blocks, blocks["w"].start + np.flatnonzero(on_inlet), order, solvable)

    @property
    def size(self) -> int:
        """Number of unknowns, prescribed ones included."""
        return int(self.space.ndof)

    def free(self, *names: str) -> NDArray[np.bool_]:
        """Mask of the unknowns to be solved for, of the named blocks or of all."""
        if not names:
            return self.solvable.copy()
        mask = np.zeros_like(self.solvable)
        for name in names:
            mask[self.blocks[name]] = self.solvable[self.blocks[name]]
        return mask


def _mask(bits: Any) -> NDArray[np.bool_]:
    return np.array(list(bits), dtype=bool)
