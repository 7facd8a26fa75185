"""Pressures on the skin that make a quantity of a vein at rest large: many free values by their gradient.

A sequence of linear programmes: within a trust region the quantity is as its gradient says, and the pressures are those
of the linear programme, whose limits hold exactly. A step that gives less than a part of what it promised, or for which
there is no equilibrium, is taken back and the region made smaller (R. Fletcher, Practical Methods of Optimization,
1987, section 14.5): what best presses a vein lies at limits, where methods of second order are not better.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import pi

import ngsolve as ng
import numpy as np
from scipy.optimize import linprog

from ngfsi.arrays import Array
from ngfsi.case import Case, Cuff
from ngfsi.conditions.loads import SKIN
from ngfsi.config.functions import PressureConstant
from ngfsi.errors import CaseError, MaterialError, SolverError
from ngfsi.gradient.adjoint import Adjoint, StoredStates
from ngfsi.gradient.parameters import parameters_of
from ngfsi.mesh.domain import Domain
from ngfsi.solve.initial import Say, silent

EDGE = 20e-3
"""Over which the pressure of a cuff falls off, at most (m): meshes must resolve it."""
KEPT, GOOD = 0.1, 0.75
"""Fraction of the promised gain from which on a step is taken, and from which on the next may be longer."""
SHORTER, LONGER = 1 / 3, 1.5
ENOUGH = 2e-3
"""Relative gain that is promised within the whole region, below which the search ends."""
SMALLEST = 0.01
"""Smallest region, over the first."""
EXCESS = 0.01
"""By which the loss may be larger than its limit, for steps are linear."""


@dataclass(frozen=True)
class Limits:
    """What pressures may be.

    Attributes:
        mean: over the skin (Pa), at most.
        low, high: of each (Pa).
        jump: of neighbours (Pa); infinite: any.
        loss: largest fraction of the lumen's volume that is lost against the shape without loads.
    """

    mean: float
    high: float
    low: float = 0.0
    jump: float = np.inf
    loss: float = 1.0


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
        """Return a layout on the skin of a domain."""
        heights = [domain.mesh[vertex].point[2] for element in domain.boundaries(SKIN).Elements()
                   for vertex in element.vertices]  # fmt: skip
        return cls(rings, sectors, min(heights), max(heights))

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
        cuffs = self.cuffs(np.zeros(self.rings * self.sectors))
        return np.array([ng.Integrate(one.weight() * skin, domain.mesh) / area for one in cuffs])


@dataclass
class Designed:
    """Pressures found.

    Attributes:
        pressures: (rings * sectors,) Pa.
        value, loss: of the quantity (SI) and of the volume.
        history: value of each accepted step, the first with the mean everywhere.
        runs, sweeps: that it took.
    """

    case: Case
    layout: Layout
    pressures: Array
    value: float
    loss: float
    history: list[float] = field(default_factory=list)
    runs: int = 0
    sweeps: int = 0


class Pressed:
    """A vein at rest under pressures."""

    def __init__(self, case: Case, quantity: str, layout: Layout, domain: Domain) -> None:
        self.quantity, self.layout, self.domain = quantity, layout, domain
        (vessel, *_) = domain.vessels
        self._volume = "_".join(filter(None, (vessel.name, "lumen_volume")))
        self._without_loads = float(ng.Integrate(ng.CF(1) * domain.dx(str(vessel.lumen)), domain.mesh))
        self._case = case.replace(**{
            "loads.skin_pressure": PressureConstant(value=0.0), "time.scheme": "static", "time.step": 1.0,
            "time.end": 1.0,
        })  # fmt: skip
        self.runs = self.sweeps = 0

    def case(self, pressures: Array) -> Case:
        """Return the case under pressures (Pa)."""
        return self._case.replace(**{"loads.cuffs": self.layout.cuffs(pressures)})

    def solve(self, pressures: Array) -> tuple[StoredStates, float, float]:
        """Return the run, its quantity (SI) and the loss of volume.

        Raises:
            CaseError, MaterialError, SolverError: there is no such equilibrium.
        """
        self.runs += 1
        with ng.TaskManager():
            run = StoredStates(self.case(pressures), self.domain, silent, [self.quantity, self._volume])
            values = run.values()
        return run, float(values[self.quantity][-1]), float(1 - values[self._volume][-1] / self._without_loads)

    def slopes(self, run: StoredStates) -> Array:
        """Return the derivatives (2, cuffs) of quantity and loss by the pressures, at a run."""
        names = [f"loads.cuffs.{number}.pressure.value" for number in range(len(run.case.loads.cuffs))]
        with ng.TaskManager():
            adjoint = Adjoint(run, parameters_of(run.case, names))
            last = np.eye(len(run.times))[-1]
            of_value = adjoint.derivatives({self.quantity: last})
            of_loss = adjoint.derivatives({self._volume: -last / self._without_loads})
        self.sweeps += 2
        return np.array([of_value, of_loss])


def improve(
    case: Case, quantity: str, layout: Layout, limits: Limits, domain: Domain, say: Say = silent, most: int = 30
) -> Designed:
    """Return the pressures of cuffs that make a quantity of the vein at rest largest.

    Args:
        layout: of the cuffs, which take the place of all pressures on the skin.
        most: steps.

    Raises:
        CaseError: the limits leave nothing, or the quantity has no gradient.
        MeshError, SolverError: as for a run, under the mean pressure everywhere.
    """
    if not limits.low <= limits.mean <= limits.high:
        raise CaseError(f"a mean pressure of {limits.mean:g} Pa is not between {limits.low:g} and {limits.high:g} Pa")
    pressed, weights = Pressed(case, quantity, layout, domain), layout.weights(domain)
    here = np.full(layout.rings * layout.sectors, limits.mean)
    run, value, loss = pressed.solve(here)
    if loss > limits.loss:
        raise CaseError(
            f"under {limits.mean:g} Pa everywhere {loss:.3g} of the volume is lost, the limit is {limits.loss:g}"
        )
    history, region = [value], min(limits.mean - limits.low, limits.high - limits.mean) or limits.high - limits.low
    smallest = SMALLEST * region
    say(f"{limits.mean:g} Pa everywhere: {quantity} {value:.5g}, loss {loss:.3f}")
    while len(history) <= most and region > smallest:
        slopes, taken = pressed.slopes(run), False
        while region > smallest and not taken:
            step = _step(here, slopes, loss, weights, layout.neighbours(), limits, region)
            promised = float(slopes[0] @ step)
            if promised < ENOUGH * abs(value):
                region = 0.0
                break
            try:
                new_run, new, new_loss = pressed.solve(here + step)
            except (CaseError, MaterialError, SolverError):
                region *= SHORTER
                continue
            taken = new - value > KEPT * promised and new_loss <= limits.loss + EXCESS
            region *= SHORTER if not taken else LONGER if new - value > GOOD * promised else 1.0
            if taken:
                run, here, value, loss = new_run, here + step, new, new_loss
                history.append(value)
                say(f"step {len(history) - 1}: {quantity} {value:.5g}, loss {loss:.3f}, {pressed.runs} runs")
    return Designed(pressed.case(here), layout, here, value, loss, history, pressed.runs, pressed.sweeps)


def _step(
    here: Array, slopes: Array, loss: float, weights: Array, neighbours: Sequence[tuple[int, int]], limits: Limits,
    region: float,
) -> Array:  # fmt: skip
    """Return the step of the linear programme."""
    rows, most = [weights, slopes[1]], [limits.mean * weights.sum() - weights @ here, max(limits.loss - loss, 0.0)]
    if np.isfinite(limits.jump):
        for one, other in neighbours:
            for sign in (1.0, -1.0):
                row = np.zeros(len(here))
                row[one], row[other] = sign, -sign
                rows.append(row)
                most.append(limits.jump - sign * (here[one] - here[other]))
    low, high = np.maximum(limits.low - here, -region), np.minimum(limits.high - here, region)
    sizes = np.array([1 / max(np.abs(row).max(), 1e-300) for row in rows])
    found = linprog(
        -slopes[0] / np.abs(slopes[0]).max(), sizes[:, None] * np.array(rows), sizes * np.array(most),
        bounds=np.column_stack((low, high)),
    )  # fmt: skip
    return np.zeros_like(here) if found.x is None else np.asarray(found.x)
