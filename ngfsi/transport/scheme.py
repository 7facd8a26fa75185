"""Scalars carried by the blood through its moving cells: a discontinuous Galerkin method, explicit in time.

Conservative form on the reference elements, with the mesh moving along: d/dt int J c v = int c q . grad v + int J s v,
less c q . n v over the faces, with the flux q = J F^-1 w of the relative velocity and c on faces from upstream (B.
Cockburn, C.-W. Shu, J Sci Comput 16, 2001). What leaves a cell enters its neighbour: amounts are kept to rounding.

For a constant to stay one the discrete volumes must change by the discrete flux: d/dt int J v = int q . grad v, less
q . n v over the faces, for each polynomial v of each cell. The blood's velocity satisfies such balances in the mean
over several cells alone. Within a step volumes are therefore linear in time, and the mean flux of the step is
corrected: through faces by a potential with one number for each cell, and within cells by the gradient of a polynomial.
Both are of the size of the velocity's divergence times that of the cells: of the order of the velocity's own error.

Time: three stages of third order (S. Gottlieb, C.-W. Shu, E. Tadmor, SIAM Rev 43, 2001), in as many substeps as
stability asks for. After each stage a cell's deviation from its mean is scaled down where it exceeds the bounds of what
is possible (X. Zhang, C.-W. Shu, J Comput Phys 229, 2010), which keeps the amount, the order, and the bounds.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from math import ceil, inf
from typing import Any

import numpy as np

from ngfsi.arrays import Array
from ngfsi.transport.cells import Block, Cells, Flow, cofactors
from ngfsi.transport.elements import WIDTH

STAGES = ((0.0, 1.0), (3 / 4, 1 / 2), (1 / 3, 1.0))
"""Of each stage the weight of the state at the start, and the time at its end as a part of the step."""
REAL_STABILITY = 2.5
"""Of the stages: the largest real rate times the substep."""
BOUNDED = 6
"""At least so many substeps in the time in which the flow crosses a cell keep means of cells within the bounds."""


@dataclass
class Transported:
    """A scalar in a step.

    Attributes:
        values: by block (c, n), its coefficients; new ones when the step is done.
        source: by block (c, q), its rate at points for each volume (1/s times its unit).
        entering: what blood brings through an opening; None: what is inside of it.
        bounds: of what is possible, the least and the largest value, at a part of the step from 0 to 1.
        diffusivity: m2/s; on walls and openings nothing diffuses through.
        left: by opening, the amount that has left through it in the step (unit times m3).
    """

    values: list[Array]
    source: list[Array]
    entering: dict[str, float | None]
    bounds: Callable[[float], tuple[float, float]] = lambda _: (-inf, inf)
    diffusivity: float = 0.0
    left: dict[str, float] = field(default_factory=dict)


class Scheme:
    """Takes scalars through steps on the cells of the blood."""

    def __init__(self, cells: Cells) -> None:
        from scipy.sparse import coo_matrix  # take long to import
        from scipy.sparse.linalg import splu

        self.cells = cells
        self._pseudo = [np.linalg.pinv(block.element.stiffness, hermitian=True) for block in cells.blocks]
        at = [(block, block.element) for block in cells.blocks]
        sizes = [np.linalg.norm(np.einsum("cfij,fj->cfi", cofactors(block.face_slope), e.areas), axis=2).ravel()
                 for block, e in at]  # fmt: skip
        volume = np.concatenate([(np.abs(np.linalg.det(block.slope)) * e.weights).sum(axis=1) for block, e in at])
        size = np.concatenate(sizes)
        here, there = cells.cell, cells.cell[cells.partner]
        # of a point in the resistance of its face: area over the distance of the cells' centres
        area = np.bincount(cells.face, size)[cells.face]
        conductance = size * area / (volume[here] + np.where(cells.inner, volume[there], 0.0))
        self._conductance = np.where(cells.wall, 0.0, conductance)
        rows = [here, here[cells.inner]]
        columns = [here, there[cells.inner]]
        entries = [self._conductance, -self._conductance[cells.inner]]
        matrix = coo_matrix((np.concatenate(entries), (np.concatenate(rows), np.concatenate(columns))))
        self._potential: Any = splu(matrix.tocsc())
        self._known: list[Masses] = []

    def amount(self, volumes: Sequence[Array], values: Sequence[Array], lumen: str | None = None) -> float:
        """Return the integral of a scalar over the deformed blood, or one lumen of it (unit times m3)."""
        parts = [np.einsum("cq,qn,cn->c", v, block.element.values, c)
                 for block, v, c in zip(self.cells.blocks, volumes, values, strict=True)]  # fmt: skip
        whole = np.concatenate(parts)
        return float((whole if lumen is None else whole[self.cells.lumens[lumen]]).sum())

    def step(self, size: float, old: Flow, new: Flow, flow: Flow, scalars: Sequence[Transported]) -> int:
        """Take scalars from one state of the blood to another, after a time (s); return the number of substeps.

        Args:
            flow: `balanced` between the two.
        """
        first, last = self._matrices(old.volumes), self._matrices(new.volumes)
        fastest = self._fastest(flow, old, new)
        if diffusivity := max(scalar.diffusivity for scalar in scalars):
            fastest += diffusivity * max(self._stiffest(flow, first), self._stiffest(flow, last)) / REAL_STABILITY
        count = max(1, ceil(size * fastest - 1e-9))
        for scalar in scalars:
            scalar.left = dict.fromkeys(self.cells.openings, 0.0)
        masses = self._masses(first, last, 0.0)
        for k in range(count):
            times = (k / count, (k + 0.5) / count, (k + 1) / count)
            volumes = [_at(t, old.volumes, new.volumes) for t in times]
            three = [masses, *(self._masses(first, last, t) for t in times[1:])]
            for scalar in scalars:
                self._substep(size / count, flow, volumes, three, scalar, times)
            masses = three[-1]
        return count

    def _matrices(self, volumes: list[Array]) -> list[Array]:
        """Return the mass matrices (c, n, n) of the cells of each block."""
        return [(v @ block.element.products).reshape(len(v), block.element.values.shape[1], -1)
                for block, v in zip(self.cells.blocks, volumes, strict=True)]  # fmt: skip

    def _masses(self, old: list[Array], new: list[Array], time: float) -> list[Masses]:
        """Return mass matrices and their inverses at a time within the step, from 0 to 1."""
        found = _at(time, old, new)
        if not self._known or any(not np.array_equal(a, b.matrices) for a, b in zip(found, self._known, strict=True)):
            self._known = [Masses(matrices, np.linalg.inv(matrices)) for matrices in found]
        return self._known

    def _substep(
        self, size: float, flow: Flow, volumes: Any, masses: Any, scalar: Transported, times: Sequence[float]
    ) -> None:
        start = [mass.times(c) for mass, c in zip(masses[0], scalar.values, strict=True)]
        now, present = start, 0
        crossed = np.zeros(len(self.cells.openings))
        for kept, end in STAGES:
            there = round(2 * end)
            rates, out = self._rates(flow, volumes[present], scalar)
            # amounts that left go with the rates through all stages
            crossed = (1 - kept) * (crossed + size * out)
            now = [kept * a + (1 - kept) * (b + size * rate) for a, b, rate in zip(start, now, rates, strict=True)]
            values = [mass.over(b) for mass, b in zip(masses[there], now, strict=True)]
            scalar.values = self.limited(volumes[there], values, *scalar.bounds(times[there]))
            now = [mass.times(c) for mass, c in zip(masses[there], scalar.values, strict=True)]
            present = there
        for name, amount in zip(self.cells.openings, crossed, strict=True):
            scalar.left[name] += float(amount)

    def _rates(self, flow: Flow, volumes: Sequence[Array], scalar: Transported) -> tuple[list[Array], Array]:
        """Return the rate of each block's (c, n) amounts, and how fast amounts leave through each opening."""
        cells = self.cells
        traces = np.concatenate([(c @ block.element.face_values.T).ravel()
                                 for block, c in zip(cells.blocks, scalar.values, strict=True)])  # fmt: skip
        outside = traces[cells.partner]
        for name, there in cells.openings.items():
            if (given := scalar.entering.get(name)) is not None:
                outside[there] = given
        carried = flow.through * np.where(flow.through > 0, traces, outside)
        rates = []
        for block, v, q, s, c, out in zip(cells.blocks, volumes, flow.fluxes, scalar.source, scalar.values,
                                          cells.split(carried), strict=True):  # fmt: skip
            e = block.element
            inside = c @ e.values.T
            rate = (v * s) @ e.values - out @ e.face_values
            for along, slopes in zip(q, e.slopes_along, strict=True):
                rate += (along * inside) @ slopes
            rates.append(rate)
        if scalar.diffusivity:
            diffused = self._diffusion(flow, scalar.values, traces)
            rates = [rate + scalar.diffusivity * more for rate, more in zip(rates, diffused, strict=True)]
        return rates, np.array([carried[there].sum() for there in cells.openings.values()])

    def _diffusion(self, flow: Flow, values: Sequence[Array], traces: Array) -> list[Array]:
        """Return the rates (c, n) of amounts by diffusion of 1 m2/s: the symmetric interior penalty method (D. N.
        Arnold, SIAM J Numer Anal 19, 1982)."""
        cells, inner = self.cells, self.cells.inner
        assert flow.metrics is not None
        assert flow.normal_metrics is not None
        normal = np.concatenate([
            np.sum(n * gradient(block.element.face_slopes, c), axis=-1).ravel()
            for block, n, c in zip(cells.blocks, flow.normal_metrics, values, strict=True)
        ])  # fmt: skip
        jump = np.where(inner, traces - traces[cells.partner], 0.0)
        flux = np.where(inner, (normal - normal[cells.partner]) / 2, 0.0) - self._penalty(flow) * jump
        found = []
        for block, metric, n, c, through, half in zip(
            cells.blocks, flow.metrics, flow.normal_metrics, values, cells.split(flux), cells.split(jump / 2),
            strict=True,
        ):  # fmt: skip
            e = block.element
            inside = (metric @ gradient(e.slopes, c)[..., None])[..., 0]
            rate = through @ e.face_values
            for axis, slopes in enumerate(e.slopes_along):
                rate -= inside[..., axis] @ slopes
                rate += (half * n[..., axis]) @ e.face_slopes[..., axis]
            found.append(rate)
        return found

    def _penalty(self, flow: Flow) -> Array:
        """Return what holds the jumps at points on faces together, for a diffusion of 1 m2/s (m3/s)."""
        assert flow.normal_metrics is not None
        parts = []
        for block, n in zip(self.cells.blocks, flow.normal_metrics, strict=True):
            e = block.element
            across = e.areas / np.linalg.norm(e.areas, axis=1)[:, None]
            parts.append((np.sum(n * across, axis=-1) / min(WIDTH[e.kind])).ravel())
        both = np.concatenate(parts)
        return np.asarray((self.cells.order + 1) ** 2 * (both + both[self.cells.partner]))

    def _stiffest(self, flow: Flow, masses: Sequence[Array]) -> float:
        """Return a bound of the rates (1/s) of diffusion of 1 m2/s: twice that of one cell with its penalties."""
        assert flow.metrics is not None
        largest = 0.0
        for block, metric, penalty, mass in zip(self.cells.blocks, flow.metrics, self.cells.split(self._penalty(flow)),
                                                masses, strict=True):  # fmt: skip
            e = block.element
            along = np.einsum("cqij,qnj->cqni", metric, e.slopes)
            stiffness = np.einsum("cqni,qmi->cnm", along, e.slopes)
            stiffness += np.einsum("cf,fn,fm->cnm", penalty, e.face_values, e.face_values)
            root = np.linalg.inv(np.linalg.cholesky(mass))
            largest = max(largest, float(np.linalg.eigvalsh(root @ stiffness @ root.swapaxes(-1, -2)).max()))
        return 2 * largest

    def balanced(self, size: float, old: Flow, new: Flow) -> Flow:
        """Return the mean flow of a step with the corrections by which it agrees with the change of the volumes."""
        cells, flow = self.cells, old.between(new)
        lack = self._imbalance(size, old, new, flow)
        potential = self._potential.solve(-np.concatenate([r[:, 0] / e.values[0, 0] for r, e in lack]))
        beyond = np.where(cells.inner, potential[cells.cell[cells.partner]], 0.0)
        through = flow.through + self._conductance * (potential[cells.cell] - beyond)
        flow = replace(flow, through=through)
        fluxes = []
        for q, (r, e), inverse in zip(flow.fluxes, self._imbalance(size, old, new, flow), self._pseudo, strict=True):
            potential = r @ inverse
            fluxes.append(q + np.stack([e.weights * (potential @ slopes.T) for slopes in e.slopes_along]))
        return replace(flow, fluxes=fluxes)

    def _imbalance(self, size: float, old: Flow, new: Flow, flow: Flow) -> list[tuple[Array, Any]]:
        """Return for each block int (dJ/dt v - q . grad v) + q . n v (c, n), and its element."""
        found = []
        for block, before, after, q, out in zip(self.cells.blocks, old.volumes, new.volumes, flow.fluxes,
                                                self.cells.split(flow.through), strict=True):  # fmt: skip
            e = block.element
            lack = (after - before) / size @ e.values + out @ e.face_values
            for along, slopes in zip(q, e.slopes_along, strict=True):
                lack -= along @ slopes
            found.append((lack, e))
        return found

    def _fastest(self, flow: Flow, old: Flow, new: Flow) -> float:
        """Return how many substeps a second are needed."""
        most = max(2 * self.cells.order + 1, BOUNDED)
        parts = zip(self.cells.blocks, flow.fluxes, old.volumes, new.volumes, strict=True)
        return max(most * float(np.max(np.tensordot(1 / np.array(WIDTH[block.element.kind]), np.abs(q), 1)
                                       / np.minimum(a, b))) for block, q, a, b in parts)  # fmt: skip

    def limited(
        self, volumes: Sequence[Array], values: Sequence[Array], least: float = -inf, most: float = inf
    ) -> list[Array]:
        """Return coefficients with each cell's deviation from its mean scaled such that no value is out of bounds."""
        if least == -inf and most == inf:
            return list(values)
        return [_limited(block, v, c, least, most)
                for block, v, c in zip(self.cells.blocks, volumes, values, strict=True)]  # fmt: skip


def _limited(block: Block, volumes: Array, values: Array, least: float, most: float) -> Array:
    e = block.element
    inside, on_faces = values @ e.values.T, values @ e.face_values.T
    mean = np.sum(volumes * inside, axis=1) / volumes.sum(axis=1)
    low = np.minimum(inside.min(axis=1), on_faces.min(axis=1))
    high = np.maximum(inside.max(axis=1), on_faces.max(axis=1))
    part, under, over = np.ones(len(values)), low < least, high > most
    with np.errstate(divide="ignore"):  # where a mean itself is out of bounds by rounding, and all is alike
        part[under] = (mean[under] - least) / (mean[under] - low[under])
        part[over] = np.minimum(part[over], (most - mean[over]) / (high[over] - mean[over]))
    part = np.clip(part, 0.0, 1.0)
    limited = part[:, None] * values
    limited[:, 0] += (1 - part) * mean / e.values[0, 0]
    return np.asarray(limited)


def gradient(slopes: Array, coefficients: Array) -> Array:
    """Return the gradients (c, p, 3) at points of a field (c, n), by the coordinates of the elements."""
    points, number, _ = slopes.shape
    found = coefficients @ slopes.transpose(1, 0, 2).reshape(number, -1)
    return np.asarray(found.reshape(len(coefficients), points, 3))


def _at(time: float, old: list[Array], new: list[Array]) -> list[Array]:
    """Return what is linear in time between two ends, at a time from 0 to 1."""
    return [a + time * (b - a) for a, b in zip(old, new, strict=True)]


@dataclass(frozen=True)
class Masses:
    """Mass matrices of cells and their inverses, (c, n, n)."""

    matrices: Array
    inverses: Any

    def times(self, values: Array) -> Array:
        """Return the amounts (c, n) of coefficients (c, n)."""
        return np.asarray((self.matrices @ values[..., None])[..., 0])

    def over(self, amounts: Array) -> Array:
        """Return the coefficients (c, n) of amounts (c, n)."""
        return np.asarray((self.inverses @ amounts[..., None])[..., 0])
