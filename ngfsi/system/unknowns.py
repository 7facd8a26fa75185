"""The unknowns of the coupled problem, split so that the interface conditions hold by construction.

Fields, by name (`ngfsi.physics.fields`):
motion    displacement of the mesh: of the solids, and by arbitrary extension of the lumens;
velocity  of the blood relative to the mesh, zero on the interface: u = w + dm/dt equals the wall's velocity there;
pressure  of the blood;
stretch   in plane stress, where there is no fluid, the change of the stretch across the plane;
and numbers that conditions add, e.g. the pressure behind an opening.

The unknowns of the motion are two blocks: d, those of the solids, interface included, whose basis functions reach one
element layer into the lumen; and e, those inside of the lumen. The others are w, p, s, and one block for each number.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import ngsolve as ng
import numpy as np

from ngfsi.arrays import Array, Mask, Numbers
from ngfsi.conditions.condition import Condition
from ngfsi.errors import CaseError
from ngfsi.mesh.domain import Domain
from ngfsi.physics.fields import MOTION, PRESSURE, STRETCH, VELOCITY

BLOCKS = ("d", "w", "p", "e")
NAMES = {"d": "displacement of the solids", "w": "velocity", "p": "blood pressure", "e": "mesh motion",
         "s": "stretch across the plane"}  # fmt: skip
"""What blocks are, for sentences; a condition's own number is called by its name."""


class Within(NamedTuple):
    """A space of some of the fields on some regions.

    Attributes:
        here, there: of each field numbers of its functions, and those of the same among the unknowns; others are held
            at zero.
    """

    space: Any
    here: list[Numbers]
    there: list[Numbers]


@dataclass(frozen=True)
class Unknowns:
    """Product space of the fields.

    Attributes:
        space: the NGSolve space.
        fields: names of its components, in order.
        blocks: name -> numbers of the unknowns.
        on_opening: opening -> numbers of the relative velocity's unknowns that are prescribed there (on its rim, which
            may stick to a rigid boundary, it is zero).
        order: polynomial order k.
        solvable: mask of the unknowns that no condition prescribes. The space's own `FreeDofs` is wrong:
            `Compress` forgets conditions on single components (`dirichletz`).
        equations: number of the test function whose equation is that of each unknown. The balance of momentum is
            tested with all functions of the motion, the mesh motion with those of the velocity: so the traction of the
            blood acts on the solids, and the mesh motion cannot disturb it. Hence w and e, of equal functions, exchange
            their equations.
        less: unknowns from whose equations, so exchanged, those of as many others are taken. A medium that moves the
            mesh is part of the balance of momentum, by which it acts on the wall. Inside of the lumen it is in
            equilibrium; where openings hold it in their plane it is not, and would press on the blood.
        scales: of the conditions' own numbers.
        mesh_follows: whether the mesh motion follows from the solids' alone, and nothing but the error of the elements
            from where inside of the lumen it puts them: not where a medium that moves the mesh acts on the wall.
    """

    space: Any
    fields: tuple[str, ...]
    blocks: dict[str, Numbers]
    on_opening: dict[str, Numbers]
    order: int
    solvable: Mask
    equations: Numbers
    less: tuple[Numbers, Numbers]
    scales: dict[str, float]
    mesh_follows: bool

    @classmethod
    def build(
        cls, domain: Domain, order: int, conditions: Sequence[Condition], plane_stress: Sequence[str] = ()
    ) -> Unknowns:
        """Return the unknowns of polynomial order k: motion and velocity of order k and pressure of order k - 1.

        Args:
            conditions: say what is prescribed, and what numbers they add.
            plane_stress: regions of a plane solid whose stretch across the plane is unknown. It is of the order of the
                motion's gradient, which in linear elasticity it follows.

        Raises:
            CaseError: nothing holds the solids, or plane stress is asked for in 3-D.
        """
        if plane_stress and domain.mesh.dim == 3:
            raise CaseError("conditions.plane_stress is for plane solids: regions in 3-D have all their stresses")
        motion, held = _motion(domain, order, conditions)
        parts: dict[str, Any] = {MOTION: motion}
        masks = [held]
        lumens = domain.lumens
        if lumens:
            given = [name for condition in conditions for name in condition.velocity_on()]
            velocity, inside = _velocity(domain, order, given)
            pressure = ng.H1(domain.mesh, order=order - 1, definedon=domain.materials(*lumens))
            parts |= {VELOCITY: ng.Compress(velocity, inside), PRESSURE: ng.Compress(pressure)}
            masks.append(_mask(velocity.FreeDofs())[_mask(inside)])
        if plane_stress:
            parts[STRETCH] = ng.Compress(ng.L2(domain.mesh, order=order - 1, definedon=domain.materials(*plane_stress)))
        scales = {name: scale for condition in conditions for name, scale in condition.own_unknowns().items()}
        parts |= {name: ng.NumberSpace(domain.mesh) for name in scales}
        space = ng.FESpace(list(parts.values()))
        place = {name: np.arange(space.Range(i).start, space.Range(i).stop) for i, name in enumerate(parts)}
        none = np.zeros(0, dtype=np.int64)
        blocks = {"d": place[MOTION], "w": none, "p": none, "e": none}
        equations = np.arange(space.ndof)
        on_opening, less, follows = {}, (none, none), bool(lumens)
        if lumens:
            # `Compress` keeps the order of the functions, and takes ten times as long to be asked for them
            inner = same_functions(domain, velocity, space.components[0], *lumens)[_mask(inside)]
            if np.any(inner < 0):
                raise RuntimeError("the space of the relative velocity has functions that the mesh motion lacks")
            blocks = {"d": np.delete(place[MOTION], inner), "w": place[VELOCITY], "p": place[PRESSURE],
                      "e": place[MOTION][inner]}  # fmt: skip
            equations[blocks["w"]], equations[blocks["e"]] = blocks["e"], blocks["w"]
            for name in given:
                on = _mask(space.components[1].GetDofs(domain.boundaries(name)))
                on_opening[name] = place[VELOCITY][on]
            if any(condition.moves_mesh() for condition in conditions):
                follows = False
                openings = domain.boundaries(*(name for vessel in domain.vessels for name in vessel.openings))
                at_openings = place[VELOCITY][_mask(space.components[1].GetDofs(openings))]
                less = at_openings, equations[at_openings]
        if STRETCH in parts:
            blocks["s"] = place[STRETCH]
        blocks |= {name: place[name] for name in scales}
        free = np.concatenate(masks)
        solvable = np.concatenate([free, np.ones(space.ndof - len(free), dtype=bool)])
        return cls(space, tuple(parts), blocks, on_opening, order, solvable, equations, less, scales, follows)

    @property
    def size(self) -> int:
        """Number of unknowns, prescribed ones included."""
        return int(self.space.ndof)

    @property
    def to_solve(self) -> tuple[str, ...]:
        """Names of the blocks that are solved for: all, but none of the motion where there are no solids."""
        still = () if len(self.blocks["d"]) and np.any(self.solvable[self.blocks["d"]]) else ("d", "e")
        return tuple(name for name, part in self.blocks.items() if len(part) and name not in still)

    def arranged(self, values: Array) -> Array:
        """Return values of the rows of a form with the equation of each unknown in its place."""
        found: Array = values[self.equations]
        found[self.less[0]] -= found[self.less[1]]
        return found

    def test(self, multipliers: Array, functions: Array) -> None:
        """Write multipliers of the equations, each in the place of its unknown, as weights of the test functions."""
        given, (lessened, others) = multipliers.copy(), self.less
        given[others] -= multipliers[lessened]
        functions[self.equations] = given

    def place(self, field: str) -> int:
        """Return the number of a field among the components of the space."""
        return self.fields.index(field)

    def named(self, components: Sequence[Any]) -> dict[str, Any]:
        """Return components of the space, or of a grid function or proxies of it, by the names of the fields."""
        return dict(zip(self.fields, components, strict=True))

    @property
    def partner(self) -> Numbers:
        """The unknown of the relative velocity with the function of each one of the motion, or -1; the last is of what
        is none."""
        found = np.full(self.size + 1, -1)
        found[self.blocks["e"]] = self.equations[self.blocks["e"]]
        return found

    def within(self, domain: Domain, regions: Sequence[str], fields: Sequence[str], vectors: int = 0) -> Within:
        """Return a space of fields on regions alone, of the same functions there.

        Args:
            fields: the motion first; the pressure only on all lumens.
            vectors: number of further components, each like the motion.
        """
        spaces = []
        for name in [*fields, *vectors * [MOTION]]:
            make, order = (ng.H1, self.order - 1) if name == PRESSURE else (ng.VectorH1, self.order)
            spaces.append(make(domain.mesh, order=order, definedon=domain.materials(*regions)))
        here, there = [], []
        moved = same_functions(domain, spaces[0], self.space.components[0], *regions)
        for i, name in enumerate(fields):
            if name == PRESSURE:  # of all functions there are, in their order
                used = np.flatnonzero(_mask(spaces[i].GetDofs(domain.materials(*regions))))
                numbers = self.blocks["p"]
            else:
                same = moved if name == MOTION else self.partner[moved]
                used = np.flatnonzero((moved >= 0) & (same >= 0))
                numbers = same[used]
            here.append(sum(one.ndof for one in spaces[:i]) + used)
            there.append(numbers)
        return Within(ng.FESpace(spaces) if len(spaces) > 1 else spaces[0], here, there)

    def free(self, *names: str) -> Mask:
        """Mask of the unknowns to be solved for, of the named blocks or of all."""
        if not names:
            return self.solvable.copy()
        mask = np.zeros_like(self.solvable)
        for name in names:
            mask[self.blocks[name]] = self.solvable[self.blocks[name]]
        return mask


def _motion(domain: Domain, order: int, conditions: Sequence[Condition]) -> tuple[Any, Mask]:
    """Return the space of the motion, and which of its unknowns are free."""
    fixed: dict[str, list[str]] = {}
    for condition in conditions:
        for component, names in condition.fixes().items():
            fixed.setdefault(component, []).extend(names)
    options = {f"dirichlet{component}": "|".join(names) for component, names in fixed.items() if names}
    motion = ng.VectorH1(domain.mesh, order=order, **options)
    free = _mask(motion.FreeDofs())
    if domain.geometry.solids and not any(condition.supports() for condition in conditions):
        points = [number for condition in conditions for number in condition.points(motion)]
        if not points:
            raise CaseError(_adrift(domain))
        free[points] = False
    return motion, free


def _adrift(domain: Domain) -> str:
    others = 'or move a boundary: [[loads.further]] with kind = "displacement"'
    if domain.ends:
        return f"conditions.ends leaves solids without bones adrift: use 'roller' or 'clamped', {others}"
    return f"nothing holds the solids of {type(domain.geometry).__name__}: name ends such as tissue_bottom, {others}"


def _velocity(domain: Domain, order: int, given: Sequence[str]) -> tuple[Any, Any]:
    """Return the space of the relative velocity, and its unknowns that are not zero on an interface."""
    held = "|".join([*given, *domain.geometry.rigid_names])
    sticks = {"dirichlet": held} if held else {}
    lumens = domain.materials(*domain.lumens)
    velocity = ng.VectorH1(domain.mesh, order=order, definedon=lumens, **sticks)
    inside = velocity.GetDofs(lumens)
    walls = [v.interface for v in domain.vessels if v.lumen and domain.has_boundary(v.interface)]
    if walls:
        inside &= ~velocity.GetDofs(domain.boundaries(*walls))
    return velocity, inside


def same_functions(domain: Domain, part: Any, whole: Any, *regions: str) -> Numbers:
    """Return for each unknown of a space of regions the one of another space with the same basis function, or -1."""
    same = np.full(part.ndof, -1)
    for element in domain.materials(*regions).Elements():
        here, there = np.array(part.GetDofNrs(element)), np.array(whole.GetDofNrs(element))
        same[here[here >= 0]] = there[here >= 0]
    found = same[same >= 0]
    if len(np.unique(found)) < len(found):
        raise RuntimeError(f"the functions of two spaces of {', '.join(regions)} do not match")
    return same


def _mask(bits: Any) -> Mask:
    return np.array(list(bits), dtype=bool)
