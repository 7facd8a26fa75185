"""Scalars carried by the blood: taken along after each accepted step, since they do not act on the flow."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import ngsolve as ng
import numpy as np

from ngfsi.arrays import Array
from ngfsi.errors import CaseError
from ngfsi.mesh.geometry import Vessel
from ngfsi.system.system import System
from ngfsi.transport.cells import Cells
from ngfsi.transport.models import ScalarModel, Washout
from ngfsi.transport.returning import Returning
from ngfsi.transport.scheme import Scheme, Transported
from ngfsi.transport.state import SAMPLED, BloodState
from ngfsi.units import SAME_TIME


class Carried:
    """A scalar of a run.

    Attributes:
        values: by block (c, n), coefficients of the present values.
        returning: by opening, what has left there.
        marked: by lumen, the amount at the start (unit times m3).
        since: when it began (s).
        washed_out: by lumen, how long it took until what is to leave had left (s); NaN: it has not.
    """

    def __init__(self, model: ScalarModel, values: list[Array], returning: dict[str, Returning]) -> None:
        self.model, self.values, self.returning = model, values, returning
        self.marked: dict[str, float] = {}
        self.washed_out: dict[str, float] = {}
        self.since = 0.0


class Scalars:
    """All scalars of a run: `advance` after each accepted step.

    Attributes:
        carried: by name.
        blood: the last state; None before the first one.
        substeps: of the last step.
    """

    def __init__(self, system: System) -> None:
        domain, order = system.domain, system.unknowns.order
        if domain.mesh.dim != 3:
            raise CaseError(f"scalars are carried by blood in 3-D: {type(domain.geometry).__name__} is plane")
        self.system, self.cells = system, Cells(domain, order)
        self._scheme = Scheme(self.cells)
        f = system.fields()
        self._sampled = ng.CF(tuple(getattr(f, name) for name in SAMPLED))
        self.blood: BloodState | None = None
        self.substeps = 0
        volume = domain.volume(*domain.lumens)
        inlets = {name for vessel in domain.vessels for name in vessel.inlets}
        self.carried = {
            model.label: Carried(model, [], {name: Returning(name in inlets, volume, model.outside)
                                             for name in self.cells.openings})
            for model in system.case.scalars
        }  # fmt: skip
        self._fields: dict[str, ng.GridFunction] = {}
        self._projections: list[tuple[Array, Array]] = []

    def advance(self, time: float) -> None:
        """Take the scalars along to the present state of the system, at a time (s)."""
        old, new = self.blood, self._state(time, self._samples())
        self.blood = new
        # what is marked later is marked anew until then
        waiting = [one for one in self.carried.values() if old is None or old.time < one.model.since - SAME_TIME]
        if old is not None and len(waiting) < len(self.carried):
            self._step(old, new, [one for one in self.carried.values() if one not in waiting])
        for one in waiting:
            self._begin(one, time)

    def _begin(self, one: Carried, since: float) -> None:
        assert self.blood is not None
        one.values = [at @ projection for at, projection in zip(one.model.begin(self.blood), self._onto, strict=True)]
        one.since = since
        one.marked = {name: self._amount(one, name) for name in self.cells.lumens}
        one.washed_out = dict.fromkeys(self.cells.lumens, float("nan"))

    @property
    def _onto(self) -> list[Array]:
        """What makes coefficients of values at the points (q, n)."""
        return [block.element.weights[:, None] * block.element.values for block in self.cells.blocks]

    def _step(self, old: BloodState, new: BloodState, moving: list[Carried]) -> None:
        size, middle = new.time - old.time, (old.time + new.time) / 2
        flow = self._scheme.balanced(size, old.flow, new.flow)
        volumes = {name: size * flow.through[there] for name, there in self.cells.openings.items()}
        back = {name: -float(np.minimum(each, 0).sum()) for name, each in volumes.items()}
        out = {name: float(np.maximum(each, 0).sum()) for name, each in volumes.items()}
        left = [{name: self._amount(one, name, old) for name in self.cells.lumens} for one in moving]
        going = []
        for one in moving:
            before, after = one.model.source(old), one.model.source(new)
            source = [(a + b) / 2 for a, b in zip(before, after, strict=True)]
            entering = {name: there.entering(back[name], middle) for name, there in one.returning.items()}
            bounds = partial(_bounds, one.model, old.time, new.time)
            going.append(Transported(one.values, source, entering, bounds, one.model.diffusivity))
        self.substeps = self._scheme.step(size, old.flow, new.flow, flow, going)
        for one, scalar, amounts in zip(moving, going, left, strict=True):
            one.values = scalar.values
            for name, there in one.returning.items():
                brought = scalar.entering[name]
                if brought is None:
                    there.turn(back[name], max(out[name] - back[name], 0.0), max(scalar.left[name], 0.0), middle)
                else:
                    there.turn(back[name], out[name], scalar.left[name] + brought * back[name], middle)
            if isinstance(one.model, Washout):
                self._time_washout(one, one.model.washed_out, amounts, old.time, new.time)

    def _time_washout(self, one: Carried, wanted: float, before: Mapping[str, float], start: float, end: float) -> None:
        for name, marked in one.marked.items():
            limit, now = (1 - wanted) * marked, self._amount(one, name)
            if np.isnan(one.washed_out[name]) and now <= limit < before[name]:
                part = (before[name] - limit) / (before[name] - now)
                one.washed_out[name] = start + part * (end - start) - one.since

    def _samples(self) -> dict[str, list[Array]]:
        sampled = self.cells.sample(self._sampled)
        # contiguous, as restored ones are: sums are taken in an order that depends on it
        return {name: [np.ascontiguousarray(one[..., 3 * k : 3 * k + 3]) for one in sampled]
                for k, name in enumerate(SAMPLED)}  # fmt: skip

    def _state(self, time: float, fields: dict[str, list[Array]]) -> BloodState:
        diffusive = any(model.diffusivity for model in self.system.case.scalars)
        return BloodState(self.cells, self.system.blood, time, fields, diffusive=diffusive)

    # ---------------------------------------------------------------- what is measured

    def _amount(self, one: Carried, lumen: str, blood: BloodState | None = None) -> float:
        """Return the amount in a lumen, in the last state of the blood or another one."""
        blood = blood or self.blood
        assert blood is not None
        return self._scheme.amount(blood.flow.volumes, one.values, lumen)

    def columns(self) -> dict[str, Callable[[], float]]:
        """Return what measures the columns of series.csv."""
        found: dict[str, Callable[[], float]] = {}
        for label, one in self.carried.items():
            for vessel in self.system.domain.vessels:
                if not vessel.lumen:
                    continue
                name, unit = f"{vessel.name}_{label}".strip("_"), one.model.unit
                found[f"{name}_mean_{unit}"] = partial(self.mean, label, vessel)
                found[f"{name}_max_{unit}"] = partial(self.largest, label, vessel)
                found[f"{name}_outlet_{unit}"] = partial(self.leaving, label, vessel)
                if isinstance(one.model, Washout):
                    found[f"{name}_left_1"] = partial(self.left, label, vessel)
                    found[f"{name}_time_s"] = partial(self.time_of_washout, label, vessel)
        return found

    def _in_lumen(self, label: str, vessel: Vessel) -> tuple[Array, Array]:
        """Return volumes and shown values at the points of a lumen."""
        assert self.blood is not None
        one, inside = self.carried[label], np.zeros(self.cells.count, dtype=bool)
        inside[self.cells.lumens[str(vessel.lumen)]] = True
        volumes, values = [], []
        for block, v, c in zip(self.cells.blocks, self.blood.flow.volumes, one.values, strict=True):
            here = inside[block.cells]
            volumes.append(v[here].ravel())
            values.append(one.model.shown(c[here] @ block.element.values.T).ravel())
        return np.concatenate(volumes), np.concatenate(values)

    def mean(self, label: str, vessel: Vessel) -> float:
        """Return the mean over the lumen of a vessel."""
        volumes, values = self._in_lumen(label, vessel)
        return float(volumes @ values / volumes.sum())

    def largest(self, label: str, vessel: Vessel) -> float:
        """Return the largest value at an integration point of the lumen of a vessel."""
        return float(self._in_lumen(label, vessel)[1].max())

    def leaving(self, label: str, vessel: Vessel) -> float:
        """Return the mean over what leaves a vessel through its outlets; NaN where nothing does."""
        assert self.blood is not None
        one, flow = self.carried[label], self.blood.flow
        traces = self._traces(one)
        there = np.concatenate([self.cells.openings[name] for name in vessel.outlets])
        out = np.maximum(flow.through[there], 0.0)
        return float(out @ one.model.shown(traces[there]) / out.sum()) if out.sum() > 0 else float("nan")

    def _traces(self, one: Carried) -> Array:
        return np.concatenate([(c @ block.element.face_values.T).ravel()
                               for block, c in zip(self.cells.blocks, one.values, strict=True)])  # fmt: skip

    def left(self, label: str, vessel: Vessel) -> float:
        """Return what is left of the marked blood in a vessel, over what there was."""
        one = self.carried[label]
        marked = one.marked[str(vessel.lumen)]
        return self._amount(one, str(vessel.lumen)) / marked if marked else float("nan")

    def time_of_washout(self, label: str, vessel: Vessel) -> float:
        """Return how long it took until the part that is to leave had left (s); NaN: it has not yet."""
        return self.carried[label].washed_out[str(vessel.lumen)]

    # ---------------------------------------------------------------- fields and storage

    def fields(self) -> dict[str, Any]:
        """Return the fields for ParaView by name with unit; `refresh_fields` gives them the present values."""
        if not self._fields:
            mesh, lumens = self.system.domain.mesh, self.system.domain.materials(*self.system.domain.lumens)
            space = ng.L2(mesh, order=self.cells.order, definedon=lumens)
            self._fields = {f"{label}_{one.model.unit}": ng.GridFunction(space) for label, one in self.carried.items()}
            self._projections = [self._projection(space, block) for block in self.cells.blocks]
        return dict(self._fields)

    def refresh_fields(self) -> None:
        """Give the fields the present values."""
        for field, one in zip(self._fields.values(), self.carried.values(), strict=True):
            vector = field.vec.FV().NumPy()
            for (numbers, projection), block, c in zip(self._projections, self.cells.blocks, one.values, strict=True):
                values = one.model.shown(c @ block.element.values.T)
                vector[numbers] = np.einsum("cnq,cq->cn", projection, values)

    @staticmethod
    def _projection(space: Any, block: Any) -> tuple[Array, Array]:
        """Return the numbers (c, n) of NGSolve's functions in cells, and what makes coefficients of values there."""
        root = np.sqrt(block.element.weights)
        numbers, found = [], []
        for number in block.numbers:
            place = ng.ElementId(ng.VOL, int(number))
            element = space.GetFE(place)
            values = np.array([list(element.CalcShape(*point)) for point in block.element.points.tolist()])
            numbers.append(space.GetDofNrs(place))
            found.append(np.linalg.pinv(root[:, None] * values) * root)
        return np.array(numbers), np.array(found)

    def state_arrays(self) -> dict[str, Array]:
        """Return all that steps to come depend on."""
        assert self.blood is not None
        arrays = {f"{name}.{k}": one for name, parts in self.blood.fields.items() for k, one in enumerate(parts)}
        arrays["time"] = np.array([self.blood.time])
        for label, one in self.carried.items():
            arrays |= {f"of {label}.{k}": values for k, values in enumerate(one.values)}
            arrays |= {f"of {label}.beyond {name}": there.array() for name, there in one.returning.items()}
            arrays[f"of {label}.washout"] = np.array([[one.since, one.marked[name], one.washed_out[name]]
                                                      for name in self.cells.lumens])  # fmt: skip
        return arrays

    def restore_state(self, arrays: Mapping[str, Array]) -> None:
        """Take what `state_arrays` returned."""
        blocks = range(len(self.cells.blocks))
        fields = {name: [arrays[f"{name}.{k}"] for k in blocks] for name in SAMPLED}
        self.blood = self._state(float(arrays["time"][0]), fields)
        for label, one in self.carried.items():
            one.values = [arrays[f"of {label}.{k}"] for k in blocks]
            for name, there in one.returning.items():
                there.restore(arrays[f"of {label}.beyond {name}"])
            rows = arrays[f"of {label}.washout"]
            one.since = float(rows[0, 0])
            one.marked, one.washed_out = (
                {name: float(row[k]) for name, row in zip(self.cells.lumens, rows, strict=True)} for k in (1, 2)
            )


def _bounds(model: ScalarModel, start: float, end: float, part: float) -> tuple[float, float]:
    """Return the bounds of a scalar at a part, from 0 to 1, of a step between two times (s)."""
    return model.bounds(start + part * (end - start))
