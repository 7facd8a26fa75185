"""The unknowns of the coupled problem, split so that the interface conditions hold by construction.

Three fields:
m  displacement of the mesh: of tissue and wall, and by arbitrary extension of the lumen;
w  velocity of the blood relative to the mesh, zero on the interface: u = w + dm/dt equals the wall's velocity there;
p  pressure of the blood;
and in plane stress, where there is no fluid, s, the change of the stretch across the plane.

The unknowns of m are two blocks: d, those of the solids, interface included, whose basis functions reach one element
layer into the lumen; and e, those inside of the lumen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import ngsolve as ng
import numpy as np
from numpy.typing import NDArray

from ngfsi.errors import CaseError
from ngfsi.mesh.domain import Domain

Ends = Literal["roller", "clamped", "guided", "free"]
BLOCKS = ("d", "w", "p", "e")

ENDS = ("tissue_top", "tissue_bottom", "wall_top", "wall_bottom", "inlet", "outlet")

ACROSS_AXIS = {2: ("dirichlety",), 3: ("dirichletx", "dirichlety")}
"""Conditions that leave motion along the axis: z in space, x in the plane."""

SAME_HEIGHT = 1e-9
"""Points closer (m) to an end lie on it."""

Numbers = NDArray[np.int64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Unknowns:
    """Product space of (m, w, p), or of m alone where there is no fluid.

    Attributes:
        space: the NGSolve space.
        blocks: name -> numbers of the unknowns.
        inlet: numbers of the relative velocity's unknowns on the inlet, prescribed there (on its rim, which may stick
            to a rigid boundary, it is zero).
        order: polynomial order k.
        solvable: mask of the unknowns that no condition prescribes. The space's own `FreeDofs` is wrong:
            `Compress` forgets conditions on single components (`dirichletz`).
        equations: number of the test function whose equation is that of each unknown. The balance of momentum is
            tested with all functions of m, the mesh motion with those of w: so the traction of the blood acts on the
            solids, and the mesh motion cannot disturb it. Hence w and e, of equal functions, exchange their equations.
    """

    space: Any
    blocks: dict[str, Numbers]
    inlet: Numbers
    order: int
    solvable: Mask
    equations: Numbers

    @classmethod
    def build(
        cls, domain: Domain, order: int, ends: Ends, *, inflow: bool = True, plane_stress: Sequence[str] = (),
        moved: Sequence[str] = (),
    ) -> Unknowns:  # fmt: skip
        """Return the unknowns of polynomial order k: m and w of order k and p of order k - 1.

        Roller: the end faces slide in their plane; clamped: they are fixed; guided: they move along the axis alone;
        free: they carry no load.
        Bones are fixed; without bones, rollers leave the rigid motions in the plane free, and three components of
        two points of the skin are held, which carry no force in balance.

        Args:
            inflow: whether the velocity is prescribed on the inlet.
            plane_stress: regions of a plane solid whose stretch across the plane is unknown.
            moved: boundaries whose displacement is prescribed.

        Raises:
            CaseError: neither bones nor ends hold the segment, or a plane geometry is to have rollers.
        """
        fluid = domain.geometry.fluid
        motion, held = _motion(domain, order, ends, moved)
        if fluid is None:
            return cls._of_solids(domain, order, motion, held, plane_stress)
        held_at = "|".join([*(["inlet"] if inflow else []), *domain.geometry.rigid_names])
        sticks = {"dirichlet": held_at} if held_at else {}
        velocity = ng.VectorH1(domain.mesh, order=order, definedon=fluid, **sticks)
        pressure = ng.H1(domain.mesh, order=order - 1, definedon=fluid)
        inside = velocity.GetDofs(domain.materials(fluid))
        if domain.has_boundary("interface"):
            inside &= ~velocity.GetDofs(domain.boundaries("interface"))
        space = ng.FESpace([motion, ng.Compress(velocity, inside), ng.Compress(pressure)])
        in_m, in_w, in_p = (np.arange(space.Range(i).start, space.Range(i).stop) for i in range(3))
        inner = same_functions(domain, space.components[1], space.components[0], domain.fluid)
        if np.any(inner < 0):
            raise RuntimeError("the space of the relative velocity has functions that the mesh motion lacks")
        blocks = {"d": np.delete(in_m, inner), "w": in_w, "p": in_p, "e": in_m[inner]}
        equations = np.arange(space.ndof)
        equations[blocks["w"]], equations[blocks["e"]] = blocks["e"], blocks["w"]
        on_inlet = _mask(space.components[1].GetDofs(domain.boundaries("inlet"))) & inflow
        solvable = np.concatenate([held, _mask(velocity.FreeDofs())[_mask(inside)], np.ones_like(in_p, dtype=bool)])
        return cls(space, blocks, in_w[on_inlet], order, solvable, equations)

    @classmethod
    def _of_solids(cls, domain: Domain, order: int, motion: Any, held: Mask, plane_stress: Sequence[str]) -> Unknowns:
        """Return the unknowns of solids alone, with a block s where there is plane stress.

        The change of the stretch across the plane is of the order of grad m, which in linear elasticity it follows.
        """
        parts = [motion]
        if plane_stress:
            parts.append(ng.Compress(ng.L2(domain.mesh, order=order - 1, definedon=domain.materials(*plane_stress))))
        space, none = ng.FESpace(parts), np.zeros(0, dtype=np.int64)
        blocks = {"d": np.arange(motion.ndof), "w": none, "p": none, "e": none}
        if plane_stress:
            blocks["s"] = np.arange(motion.ndof, space.ndof)
        free = np.concatenate([held, np.ones(space.ndof - motion.ndof, dtype=bool)])
        return cls(space, blocks, none, order, free, np.arange(space.ndof))

    @property
    def size(self) -> int:
        """Number of unknowns, prescribed ones included."""
        return int(self.space.ndof)

    def free(self, *names: str) -> Mask:
        """Mask of the unknowns to be solved for, of the named blocks or of all."""
        if not names:
            return self.solvable.copy()
        mask = np.zeros_like(self.solvable)
        for name in names:
            mask[self.blocks[name]] = self.solvable[self.blocks[name]]
        return mask


def _motion(domain: Domain, order: int, ends: Ends, moved: Sequence[str] = ()) -> tuple[Any, Mask]:
    """Return the space of the motion, and which of its unknowns are free."""
    rigid = list(domain.geometry.rigid_names)
    there = [name for name in ENDS if domain.has_boundary(name)]
    if ends in ("free", "guided") and not rigid and not moved:
        raise CaseError(f"conditions.ends = '{ends}' leaves a segment without bones adrift: use 'roller' or 'clamped'")
    if ends == "roller" and domain.mesh.dim == 2:
        raise CaseError("conditions.ends = 'roller' is for segments in space: use 'clamped' or 'free' in the plane")
    fixed = {"dirichlet": "|".join([*rigid, *moved, *(there if ends == "clamped" else [])])}
    if ends == "roller":
        fixed["dirichletz"] = "|".join(there)
    if ends == "guided":
        fixed |= dict.fromkeys(ACROSS_AXIS[domain.mesh.dim], "|".join(there))
    motion = ng.VectorH1(domain.mesh, order=order, **{key: names for key, names in fixed.items() if names})
    free = _mask(motion.FreeDofs())
    if ends == "roller" and not rigid:
        free[_against_rigid_motion(domain, motion)] = False
    return motion, free


def same_functions(domain: Domain, part: Any, whole: Any, region: str) -> Numbers:
    """Return for each unknown of a space of a region the one of another space with the same basis function, or -1."""
    same = np.full(part.ndof, -1)
    for element in domain.materials(region).Elements():
        here, there = np.array(part.GetDofNrs(element)), np.array(whole.GetDofNrs(element))
        same[here[here >= 0]] = there[here >= 0]
    found = same[same >= 0]
    if len(np.unique(found)) < len(found):
        raise RuntimeError(f"the functions of two spaces of '{region}' do not match")
    return same


def _against_rigid_motion(domain: Domain, motion: Any) -> list[int]:
    """Return both components in the plane of one vertex of the skin, and one of that opposite, across their line."""
    vertices = {v for element in domain.boundaries("skin").Elements() for v in element.vertices}
    points = {v: np.array(domain.mesh[v].point) for v in vertices if abs(domain.mesh[v].point[2]) < SAME_HEIGHT}
    first = min(points, key=lambda v: v.nr)
    other = max(points, key=lambda v: float(np.linalg.norm(points[v] - points[first])))
    along = points[other] - points[first]
    across = 1 if abs(along[0]) > abs(along[1]) else 0
    return [*motion.GetDofNrs(first)[:2], motion.GetDofNrs(other)[across]]


def _mask(bits: Any) -> Mask:
    return np.array(list(bits), dtype=bool)
