"""What p-multigrid factorises and what it smooths."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from ngsolve import CELL, EDGE, FACE, VERTEX, NodeId

from ngfsi.arrays import Mask, Numbers
from ngfsi.mesh.domain import Domain
from ngfsi.system.unknowns import Unknowns


@dataclass(frozen=True)
class Levels:
    """What is factorised and what is smoothed.

    Attributes:
        factorised: masks of the unknowns that a direct solver takes, one group after the other.
        patches: numbers of the unknowns of each patch to smooth.
    """

    factorised: tuple[Mask, ...]
    patches: list[Numbers]

    def among(self, solved: Mask) -> tuple[list[Numbers], list[Numbers]]:
        """Return the numbers of the groups that are factorised, and of the patches, without empty ones.

        Args:
            solved: mask of the unknowns to solve for; all of the motion alone, or all.
        """
        masks = (mask[: len(solved)] & solved for mask in self.factorised)
        patches = (patch[solved[patch]] for patch in self.patches)
        return [np.flatnonzero(mask) for mask in masks if np.any(mask)], [patch for patch in patches if len(patch)]


def levels_of(domain: Domain, unknowns: Unknowns) -> Levels:
    """Return the levels: smoothed is the solid of the most elements, away from what else there is."""
    motion, mesh = unknowns.space.components[0], domain.mesh
    smoothed = max(domain.geometry.solids, key=lambda name: len(list(domain.materials(name).Elements())))
    fine = np.zeros(unknowns.size, dtype=bool)
    fine[: motion.ndof] = list(motion.GetDofs(domain.materials(smoothed)))
    if others := {*mesh.GetMaterials()} - {smoothed}:
        fine[: motion.ndof] &= ~np.array(list(motion.GetDofs(domain.materials(*others))))
    starts = [motion.Range(i).start for i in range(len(motion.components))]

    def on(kind: Any, number: int) -> Numbers:
        """Return the numbers of the unknowns of a node of the mesh."""
        own = np.array(motion.components[0].GetDofNrs(NodeId(kind, number)), dtype=np.int64)
        return np.concatenate([own + start for start in starts])

    patches = [[on(VERTEX, i)] for i in range(mesh.nv)]
    direct = ~fine
    direct[np.concatenate([patch[0] for patch in patches])] = True
    cells = mesh.ne if mesh.dim == 3 else 0
    for kind, count in ((EDGE, mesh.nedge), (FACE, mesh.nface), (CELL, cells)):
        for i in range(count):
            inside = on(kind, i)
            for vertex in mesh[NodeId(kind, i)].vertices:
                patches[vertex.nr].append(inside)
    mesh_motion = np.zeros_like(fine)
    mesh_motion[unknowns.blocks["e"]] = True
    joined = (np.concatenate(parts) for parts in patches)
    return Levels((direct & ~mesh_motion, mesh_motion), [patch[fine[patch]] for patch in joined])
