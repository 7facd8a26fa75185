"""Pressures on the skin that make a quantity of a vein at rest large: many free values by their gradient.

A sequence of linear programmes: within a trust region the quantity and the losses are as their gradients say, and the
pressures are those of the linear programme. What losses are beyond their limits costs, so much that none is better (an
exact penalty: R. Fletcher, Practical Methods of Optimization, 1987, section 14.5), and pressures that lose too much can
be begun with. A step that gives less than a part of what it promised, or for which there is no equilibrium, is taken
back and the region made smaller: what best presses a vein lies at limits, where methods of second order are not better.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import pi
from pathlib import Path
from typing import ClassVar

import ngsolve as ng
import numpy as np
from scipy.optimize import linprog

from ngfsi.arrays import Array
from ngfsi.case import Case, Cuff
from ngfsi.conditions.loads import SKIN, PressureOn
from ngfsi.config.functions import PressureConstant
from ngfsi.errors import CaseError, MaterialError, SolverError, unknown
from ngfsi.gradient.adjoint import Acting, Adjoint, StoredStates
from ngfsi.measure.sections import STATIONS
from ngfsi.mesh.domain import Domain
from ngfsi.solve.initial import Say, silent
from ngfsi.units import in_unit

EDGE = 20e-3
"""Over which the pressure of a cuff falls off, at most (m): meshes must resolve it."""
KEPT, GOOD = 0.1, 0.75
"""Fraction of the promised gain from which on a step is taken, and from which on the next may be longer."""
SHORTER, LONGER = 1 / 3, 1.5
ENOUGH = 2e-3
"""Relative gain that is promised within the whole region, below which the search ends."""
SMALLEST = 0.01
"""Smallest region, over the first."""
EXCESS = 1e-3
"""By which a loss may be larger than its limit in the end."""
COST = 20.0
"""Of all of a volume or of a section that is lost beyond its limit, over the value begun with: ten times what a loss
brings at constant flow, area to the power of -1.5."""
LEAST = "_least"
"""What ends the name of the least of a quantity at the stations."""
FAR, HALF = 2.0, 0.5
"""Times the least above which a station is not looked at in a step, and part of its limit below which a loss is not."""


@dataclass(frozen=True)
class Limits:
    """What pressures may be.

    Attributes:
        mean: over the skin (Pa), at most.
        low, high: of each (Pa).
        jump: of neighbours (Pa); infinite: any.
        loss: largest fraction of the lumen's volume that is lost against the shape without loads.
        section_loss: the same of the area of each station.

    Raises:
        CaseError: they leave nothing.
    """

    mean: float
    high: float
    low: float = 0.0
    jump: float = np.inf
    loss: float = 1.0
    section_loss: float = 1.0

    def __post_init__(self) -> None:
        low, mean, high = (in_unit(one, "mmHg", ".4g") for one in (self.low, self.mean, self.high))
        if not self.low <= self.mean <= self.high:
            raise CaseError(
                f"a mean pressure of {mean} is not between {low} and {high}, the bounds of each: change one"
            )
        if self.jump < 0:
            jump = in_unit(self.jump, "mmHg", ".4g")
            raise CaseError(
                f"neighbours cannot differ by {jump} at most: write 0 or more, 0 for one pressure everywhere"
            )


@dataclass(frozen=True)
class Layout:
    """Cuffs in rings along the segment, each of sectors around it, which together cover the skin.

    Attributes:
        bottom, top: of the skin (m).
    """

    rings: int
    sectors: int
    bottom: float
    top: float

    @classmethod
    def on(cls, domain: Domain, rings: int, sectors: int) -> Layout:
        """Return a layout on the skin of a domain.

        Raises:
            CaseError: it is plane, or without a vein.
        """
        if domain.mesh.dim < 3 or not domain.vessels:
            raise CaseError("a design is for a segment in 3-D with a vein or a hole in it, as `ngfsi new calf` writes")
        heights = [domain.mesh[vertex].point[2] for element in domain.boundaries(SKIN).Elements()
                   for vertex in element.vertices]  # fmt: skip
        return cls(rings, sectors, min(heights), max(heights))

    @property
    def count(self) -> int:
        """Of cuffs."""
        return self.rings * self.sectors

    def cuffs(self, pressures: Array) -> tuple[Cuff, ...]:
        """Return them under pressures (rings * sectors,) [Pa], by ring and sector."""
        height = (self.top - self.bottom) / self.rings
        edge, found = min(EDGE, 0.8 * height), []
        for place, pressure in enumerate(pressures):
            ring, sector = divmod(place, self.sectors)
            # the outer edges lie outside of the segment, so that its ends are pressed in full
            found.append(Cuff(
                pressure=PressureConstant(value=float(pressure)), edge=edge,
                start=self.bottom + ring * height - (edge / 2 if ring == 0 else 0),
                end=self.bottom + (ring + 1) * height + (edge / 2 if ring == self.rings - 1 else 0),
                direction=self.direction(sector), half_width=pi / self.sectors if self.sectors > 1 else None,
            ))  # fmt: skip
        return tuple(found)

    def begun(self, mean: float, low: float, high: float) -> Array:  # noqa: ARG002 - cycles begin with a wave
        """Return pressures (Pa) to begin with: the mean everywhere."""
        return np.full(self.count, mean)

    def direction(self, sector: int) -> float:
        """Return the middle of a sector (rad)."""
        return -pi + (sector + 0.5) * 2 * pi / self.sectors

    def neighbours(self) -> list[tuple[int, int]]:
        """Return pairs of cuffs beside each other."""
        found = []
        for ring in range(self.rings):
            for sector in range(self.sectors):
                here = ring * self.sectors + sector
                if ring + 1 < self.rings:
                    found.append((here, here + self.sectors))
                if self.sectors > 1:
                    found.append((here, ring * self.sectors + (sector + 1) % self.sectors))
        return found

    def weights(self, domain: Domain) -> Array:
        """Return the part of the skin on which each acts."""
        skin = domain.ds(SKIN)
        area = ng.Integrate(ng.CF(1) * skin, domain.mesh)
        cuffs = self.cuffs(np.zeros(self.count))
        return np.array([ng.Integrate(one.weight() * skin, domain.mesh) / area for one in cuffs])


@dataclass
class Designed:
    """Pressures found.

    Attributes:
        pressures: (rings * sectors,) Pa.
        value, loss: of the quantity (SI) and of the volume.
        section_loss: of the station that loses most; nan: no limit asked for it.
        history: value of each accepted step, the first with the pressures begun with.
        runs, sweeps: that it took.
        mean: over the skin (Pa), of the pressures found.
        region, promised: pressure (Pa) by which a cuff may change, and the fraction of the value that the gradients at
            the pressures found then promise: none at an optimum.
    """

    case: Case
    layout: Layout
    pressures: Array
    value: float
    loss: float
    section_loss: float = np.nan
    history: list[float] = field(default_factory=list)
    runs: int = 0
    sweeps: int = 0
    mean: float = 0.0
    region: float = 0.0
    promised: float = np.nan


@dataclass(frozen=True)
class Equilibrium:
    """A vein under pressures.

    Attributes:
        aims: of which the least is to be large (SI).
        losses: fractions lost, of the volume and then of the stations.
    """

    run: StoredStates
    aims: Array
    losses: Array


class Pressed:
    """A vein at rest under any pressures of a layout."""

    whole: ClassVar[Mapping[str, tuple[str, str]]] = {}
    """Quantities of another name: what they are of, and what is made of it over time."""

    def __init__(
        self, case: Case, quantity: str, layout: Layout, domain: Domain, limits: Limits, folder: Path | None = None
    ) -> None:
        """Prepare; `quantity`: one with a gradient, or the least of those at the stations, NAME_least; `folder`: as of
        `StoredStates`."""
        self.layout, self.domain, self._folder = layout, domain, folder
        prefix, *others = (f"{one.name}_" if one.name else "" for one in domain.vessels)
        least, stations = quantity.endswith(LEAST) and quantity not in self.whole, range(STATIONS)
        if least and quantity not in (
            known := [f"{name}{of}{LEAST}" for name in (prefix, *others) for of in ("area", "sawss")]
        ):
            raise CaseError(unknown("quantity at stations", quantity, known))
        named = quantity if quantity not in self.whole else self.whole[quantity][0]
        self.aims = [f"{quantity.removesuffix(LEAST)}_z{n:02d}" for n in stations] if least else [named]
        sections = [f"{prefix}area_z{n:02d}" for n in stations] if limits.section_loss < 1 else []
        self.sizes = [f"{prefix}lumen_volume", *sections]
        self.most = np.array([limits.loss, *(limits.section_loss for _ in sections)])
        self._without_loads: Array | None = None
        self._acting: Acting | None = None
        self._case = self._case_of(case)
        self.runs = self.sweeps = 0

    def _case_of(self, case: Case) -> Case:
        """Return a case whose cuffs are all that presses the skin."""
        return case.replace(**{
            "loads.skin_pressure": PressureConstant(value=0.0), "time.scheme": "static", "time.step": 1.0,
            "time.end": 1.0,
        })  # fmt: skip

    def case(self, pressures: Array) -> Case:
        """Return the case under pressures (Pa)."""
        return self._case.replace(**{"loads.cuffs": self.layout.cuffs(pressures)})

    def solve(self, pressures: Array) -> Equilibrium:
        """Return the equilibrium.

        Raises:
            CaseError, MaterialError, SolverError: there is none.
        """
        with ng.TaskManager():
            run, without_loads = self._computed(pressures)
            run.show(len(run.moments) - 1)
            aims, sizes = ([run.measured[name].value() for name in names] for names in (self.aims, self.sizes))
        return Equilibrium(run, np.array(aims), 1 - np.array(sizes) / without_loads)

    def _computed(self, pressures: Array) -> tuple[StoredStates, Array]:
        """Return a run under pressures, and the volume and areas without any load."""
        self.runs += 1
        run = StoredStates(self.case(pressures), self.domain, silent, [*self.aims, *self.sizes], self._folder)
        if self._without_loads is None:
            run.system.values[:] = 0.0
            self._without_loads = np.array([run.measured[name].value() for name in self.sizes])
        return run, self._without_loads

    def slopes(self, at: Equilibrium, least: float) -> tuple[Array, Array]:
        """Return the derivatives (aims, cuffs) and (losses, cuffs) by the pressures, nan where they do not count: of
        aims far above the least of all, and losses far below their limits."""
        assert self._without_loads is not None
        aims, losses = at.aims < FAR * least, at.losses > HALF * self.most
        losses[0] = True
        names = [name for name, counts in zip((*self.aims, *self.sizes), (*aims, *losses), strict=True) if counts]
        with ng.TaskManager():
            by_pressure = self._by_pressure(at, names)
        self.sweeps += len(names)
        found = np.full((len(aims) + len(losses), by_pressure.shape[1]), np.nan)
        found[np.concatenate([aims, losses])] = by_pressure
        return found[: len(aims)], -found[len(aims) :] / self._without_loads[:, None]

    def _by_pressure(self, at: Equilibrium, names: list[str]) -> Array:
        """Return the derivatives (names, pressures) of quantities."""
        last = len(at.run.moments) - 1
        return -Adjoint(at.run, []).of_state(last, names) @ self._forces(at.run, last).T

    def _forces(self, run: StoredStates, number: int) -> Array:
        """Return the residual (cuffs, unknowns) at a moment of a pascal of each, in which residuals are linear."""
        self._acting = self._acting or Acting(run.case, self.domain)
        system = self._acting
        run.show(number, system)
        cuffs = [one for one in system.conditions.values() if isinstance(one, PressureOn) and one.on_skin][1:]

        def residual() -> Array:
            return np.array(system.unknowns.arranged(system.apply()))

        for one in cuffs:
            one.value.Set(0.0)
        without, found = residual(), []
        for one in cuffs:
            one.value.Set(1.0)
            found.append(residual() - without)
            one.value.Set(0.0)
        return np.array(found)


@dataclass(frozen=True)
class Veins:
    """Several veins under the same pressures: of one leg, or of an ensemble of which the worst counts."""

    members: Sequence[Pressed]
    equilibria: Sequence[Equilibrium]

    @classmethod
    def under(cls, pressures: Array, members: Sequence[Pressed]) -> Veins:
        """Solve for all.

        Raises:
            CaseError, MaterialError, SolverError: one of them has no equilibrium.
        """
        return cls(members, [one.solve(pressures) for one in members])

    @property
    def aims(self) -> Array:
        """Those of all."""
        return np.concatenate([one.aims for one in self.equilibria])

    @property
    def losses(self) -> Array:
        """Those of all."""
        return np.concatenate([one.losses for one in self.equilibria])

    @property
    def value(self) -> float:
        """The least of the aims."""
        return float(self.aims.min())

    def slopes(self) -> tuple[Array, Array]:
        """Return those of aims and losses, as `Pressed.slopes` does."""
        pairs = [one.slopes(at, self.value) for one, at in zip(self.members, self.equilibria, strict=True)]
        return np.vstack([aims for aims, _ in pairs]), np.vstack([losses for _, losses in pairs])


def improve(
    case: Case, quantity: str, layout: Layout, limits: Limits, domain: Domain, say: Say = silent, most: int = 30,
    others: Sequence[tuple[Case, Domain]] = (), start: Array | None = None, folder: Path | None = None,
    of: type[Pressed] = Pressed,
) -> Designed:  # fmt: skip
    """Return the pressures of cuffs that make a quantity of the vein largest.

    Args:
        quantity: one with a gradient, or NAME_least: the least of NAME_z00 to NAME_z10.
        layout: of the cuffs, which take the place of all pressures on the skin.
        most: steps.
        others: further cases that are to bear the same pressures: the least of all is made largest.
        start: pressures to begin with (of the layout's count) [Pa]; default: the layout's own.
        folder: as of `StoredStates`.
        of: how the vein is pressed: at rest, or in the cycles of a layout of these.

    Raises:
        CaseError: the limits leave nothing, or the quantity has no gradient.
        MeshError, SolverError: as for a run, under the pressures begun with.
    """
    members = [of(one, quantity, layout, its, limits, folder) for one, its in ((case, domain), *others)]
    weights, allowed = layout.weights(domain), np.concatenate([one.most for one in members])
    here = np.clip(
        layout.begun(limits.mean, limits.low, limits.high) if start is None else start, limits.low, limits.high
    )
    at = Veins.under(here, members)
    history, cost = [at.value], COST * abs(at.value)
    first = region = min(limits.mean - limits.low, limits.high - limits.mean) or limits.high - limits.low
    say(f"begun with: {quantity} {at.value:.5g}, loss {at.losses[0]:.3f}")

    def worth(value: float, losses: Array) -> float:
        return value - cost * max(float((losses - allowed).max()), 0.0)

    left = np.nan
    while len(history) <= most and region > SMALLEST * first:
        slopes, taken = at.slopes(), False
        whole = worth(at.value, at.losses)
        while region > SMALLEST * first and not taken:
            step = _step(here, at.aims, at.losses, slopes, allowed, weights, layout.neighbours(), limits, region, cost)
            losses = at.losses + np.nan_to_num(slopes[1]) @ step
            promised = worth(float(np.nanmin(at.aims + slopes[0] @ step)), losses) - whole
            left = promised / abs(at.value)
            if promised < ENOUGH * abs(at.value):
                break
            try:
                new = Veins.under(here + step, members)
            except (CaseError, MaterialError, SolverError):
                region *= SHORTER
                continue
            gain = worth(new.value, new.losses) - whole
            taken = gain > KEPT * promised
            word = "step" if taken else "no step"
            say(
                f"{word} of {in_unit(region, 'mmHg', '.3g')}: {quantity} {new.value:.5g}, losses {new.losses[0]:.3f} "
                f"and {new.losses.max():.3f}, {gain / promised:.2f} of what was promised"
            )
            if taken:
                at, here = new, here + step
                history.append(at.value)
                left = np.nan
            region *= SHORTER if not taken else LONGER if gain > GOOD * promised else 1.0
        if not taken:
            break
    if np.any(over := at.losses > allowed + EXCESS):
        number = int(np.argmax(np.where(over, at.losses - allowed, 0.0)))
        name = members[0].sizes[number % len(members[0].sizes)]
        raise CaseError(f"{at.losses[number]:.3g} of {name} is lost under the best that was found, the limit is "
                        f"{allowed[number]:g}: take a smaller mean, more steps or a larger limit")  # fmt: skip
    if weights @ here > (limits.mean + EXCESS * limits.high) * weights.sum():
        raise CaseError("the mean of the pressures begun with is larger than that allowed: begin with smaller ones")
    by_section = np.concatenate([one.losses[1:] for one in at.equilibria])
    return Designed(members[0].case(here), layout, here, at.value, max(float(one.losses[0]) for one in at.equilibria),
                    float(by_section.max()) if len(by_section) else np.nan, history,
                    sum(one.runs for one in members), sum(one.sweeps for one in members),
                    float(weights @ here / weights.sum()), region, left)  # fmt: skip


def _step(
    here: Array, aims: Array, losses: Array, slopes: tuple[Array, Array], most: Array, weights: Array,
    neighbours: Sequence[tuple[int, int]], limits: Limits, region: float, cost: float,
) -> Array:  # fmt: skip
    """Return the step of the linear programme, of which the least of the aims is one more unknown, below each of them,
    and what the losses are beyond their limits another, which costs."""
    (by_aims, by_losses), size = slopes, np.nanmax(np.abs(slopes[0]))
    rows, bounds, beyond = [weights], [limits.mean * weights.sum() - weights @ here], [0.0]
    for loss, row, limit in zip(losses, by_losses, most, strict=True):
        if not np.isnan(row).any():
            rows.append(row)
            bounds.append(limit - loss)
            beyond.append(1.0)
    if np.isfinite(limits.jump):
        for one, other in neighbours:
            for sign in (1.0, -1.0):
                row = np.zeros(len(here))
                row[one], row[other] = sign, -sign
                rows.append(row)
                bounds.append(limits.jump - sign * (here[one] - here[other]))
                beyond.append(0.0)
    sizes = np.array([1 / (np.abs(row).max() or 1.0) for row in rows])
    known = ~np.isnan(by_aims).any(axis=1)
    free = -sizes * np.array(beyond) * size / cost
    matrix = np.vstack([
        np.column_stack([sizes[:, None] * np.array(rows), np.zeros(len(rows)), free]),
        np.column_stack([-by_aims[known] / size, np.ones(known.sum()), np.zeros(known.sum())]),
    ])  # fmt: skip
    right = np.concatenate([sizes * np.array(bounds), (aims[known] - aims.min()) / size])
    low, high = np.maximum(limits.low - here, -region), np.minimum(limits.high - here, region)
    of_cuffs = [*zip(np.minimum(low, high), high, strict=True)]
    found = linprog([*np.zeros(len(here)), -1.0, 1.0], matrix, right, bounds=[*of_cuffs, (None, None), (0, None)])
    return np.zeros_like(here) if found.x is None else np.asarray(found.x[:-2])
