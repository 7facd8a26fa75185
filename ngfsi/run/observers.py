"""What is written while a run is computed: each observer looks at the state after accepted steps when it is due.

What a model does not have, its observers leave out: a rigid vessel has no stability, solids alone have no wall shear.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import ngsolve as ng

from ngfsi.arrays import Array
from ngfsi.case import Case
from ngfsi.errors import SolverError
from ngfsi.measure.points import joined
from ngfsi.measure.probe import Probe
from ngfsi.measure.quantities import columns
from ngfsi.measure.scalars import Scalars
from ngfsi.measure.shape import Shape
from ngfsi.parallel.stopwatch import Stopwatch
from ngfsi.physics.fields import MOTION
from ngfsi.solve.time_loop import Step
from ngfsi.store.fields import COLLAPSE, DEFORMATION, STRESS, FieldWriter, NodeValues
from ngfsi.store.folder import RunFolder, outline_rows
from ngfsi.system.system import System
from ngfsi.system.together import OnAllRanks, together

if TYPE_CHECKING:
    from ngfsi.measure.stability import Softness, Stability

WALL_REFINEMENT = 3
"""Points along each side of an interface element in the written wall fields."""


class Observer:
    """Base of the observers."""

    name = ""
    every = 1
    """Steps between two looks; the last step is looked at in any case."""

    def look(self, time: float, step: Step | None) -> None:
        """Write what is to be written of the state at a time (s), after a step; None: at the start."""

    def looked_at(self, _time: float) -> bool:
        """Whether the state at a time (s) has been written."""
        return True

    def state_arrays(self) -> dict[str, Array]:
        """Return what later looks depend on, for `restore_state`."""
        return {}

    def restore_state(self, arrays: Mapping[str, Array]) -> None:
        """Take what `state_arrays` returned; the system may be left in another state."""


class Series(Observer):
    """Quantities and costs of each step, and warnings of what is close to failing."""

    def __init__(self, probe: Probe, folder: RunFolder, watch: Stopwatch) -> None:
        self._probe, self._folder, self._watch = probe, folder, watch
        self._columns = columns(probe)

    def look(self, time: float, step: Step | None) -> None:
        with self._watch("measures"):
            self._probe.refresh()
            row = {column: evaluate() for column, evaluate in self._columns.items()}
            self._folder.append("series", {"time_s": time, "step_s": step.size if step else 0.0, **row})
            if step:
                self._folder.append("costs", step.cost())
                for warning in self._probe.deformation.approaching():
                    self._folder.log(f"t = {time:.6g} s: {warning}")


class Carrying(Observer):
    """Takes along what the blood carries: before what is measured of it is written."""

    name = "scalars"

    def __init__(self, scalars: Scalars, watch: Stopwatch) -> None:
        self._scalars, self._watch = scalars, watch

    def look(self, time: float, _step: Step | None) -> None:
        with self._watch("scalars"):
            self._scalars.advance(time)

    def state_arrays(self) -> dict[str, Array]:
        return self._scalars.state_arrays()

    def restore_state(self, arrays: Mapping[str, Array]) -> None:
        self._scalars.restore_state(arrays)


class WallFields(Observer):
    """The vessels' inner walls with their wall shear stress."""

    def __init__(self, probe: Probe, writer: FieldWriter, watch: Stopwatch, every: int) -> None:
        self._probe, self._writer, self._watch, self.every = probe, writer, watch, every

    def look(self, time: float, _step: Step | None) -> None:
        with self._watch("output"):
            vessels = self._probe.vessels.values()
            self._writer.write_wall(time, *(vessel.wall.sample(WALL_REFINEMENT) for vessel in vessels))

    def looked_at(self, time: float) -> bool:
        return time in self._writer.times["wall"]


class VolumeFields(Observer):
    """Fields of the whole domain, outlines and shapes of cross-sections, and the stability of the vein."""

    name = "stability"

    def __init__(
        self, probe: Probe, writer: FieldWriter, folder: RunFolder, watch: Stopwatch, every: int,
        stability: Stability | Softness | None,
    ) -> None:  # fmt: skip
        self._probe, self._writer, self._folder, self._watch, self.every = probe, writer, folder, watch, every
        self._stability = stability

    def look(self, time: float, _step: Step | None) -> None:
        """Write; where the stability cannot be determined, the log says why."""
        if self._stability:
            with self._watch("stability"):
                try:
                    self._folder.append("stability", self._stability.refresh().row(time))
                except SolverError as error:
                    self._folder.log(f"t = {time:.6g} s: no stability: {error}")
        with self._watch("output"):
            if self._probe.scalars:
                self._probe.scalars.refresh_fields()
            self._writer.write(time)
            for number, vessel in enumerate(self._probe.vessels.values()):
                for branch, along in enumerate(vessel.branches.values()):
                    of = {"time_s": time, **self._numbers(number, branch)}
                    along.outlines.refresh()
                    self._folder.append("outlines", *outline_rows(of, along.outlines.rings))
                    self._folder.append("shape", *Shape.of(along.outlines, cut=True).rows(of))

    def _numbers(self, vessel: int, branch: int) -> dict[str, float]:
        """Return the columns that tell vessels and their centrelines apart, where there are several."""
        vessels = self._probe.vessels.values()
        of_vessel: dict[str, float] = {"vessel": vessel} if len(vessels) > 1 else {}
        return of_vessel | ({"branch": branch} if any(len(one.branches) > 1 for one in vessels) else {})

    def looked_at(self, time: float) -> bool:
        return time in self._writer.times["volume"]

    def state_arrays(self) -> dict[str, Array]:
        return self._stability.arrays() if self._stability else {}

    def restore_state(self, arrays: Mapping[str, Array]) -> None:
        if self._stability:
            self._stability.restore(arrays)


def observers_of(
    case: Case, system: System, probe: Probe, folder: RunFolder, watch: Stopwatch, until: float,
    fields: SharedFields | None = None,
) -> list[Observer]:  # fmt: skip
    """Return the observers of a run.

    Args:
        fields: those written, which all ranks have made; default: made here.
        until: time (s) up to which the folder's fields are kept.
    """
    stability = _stability(system) if case.output.stability and system.solids else None
    more, scalars = {COLLAPSE: stability.mode} if stability and stability.mode else {}, probe.scalars
    more |= scalars.fields() if scalars else {}
    shared = fields or SharedFields(system)
    writer = FieldWriter(folder.path, system.domain, more, until, given=shared.values)
    found: list[Observer] = [Carrying(scalars, watch)] if scalars else []
    found.append(Series(probe, folder, watch))
    if probe.vessels:
        found.append(WallFields(probe, writer, watch, case.output.wall_every))
    return [*found, VolumeFields(probe, writer, folder, watch, case.output.fields_every, stability)]


def _stability(system: System) -> Stability | Softness:
    from ngfsi.measure.stability import Softness, Stability  # with solvers of eigenvalues, which most do without

    return Softness(system) if system.domain.mesh.dim == 2 else Stability(system)


class SharedFields(OnAllRanks):
    """Values of the fields written for ParaView at the nodes of the volume cells, of which each rank finds its own."""

    def __init__(self, system: System) -> None:
        super().__init__(system)
        self._nodes = NodeValues(system.domain, volume_fields(system), system.mine(ng.VOL))

    @together
    def values(self) -> dict[str, Array]:
        """Return the present values at the nodes of all cells by name, on rank 0."""
        mine = self._nodes.mine
        return {name: joined(self.system.ranks.collect((mine, one))) for name, one in self._nodes.values().items()}


def volume_fields(system: System) -> dict[str, ng.CoefficientFunction]:
    """Return the fields written for ParaView, defined on the whole domain: zero where they do not exist."""
    domain, mesh = system.domain, system.domain.mesh
    state, history = system.named(system.state), system.named(system.velocity_history)
    everywhere: dict[str, Any] = dict.fromkeys(system.solids, system.new_weight * state[MOTION] + history[MOTION])
    found: dict[str, Any] = {"displacement_m": _in_3d(system.motion)}
    vessels = [vessel for vessel in domain.vessels if vessel.lumen]
    if vessels:
        everywhere |= dict.fromkeys(domain.lumens, system.fields().velocity)
        pressures = {str(vessel.lumen): system.blood_pressure(vessel.name) for vessel in vessels}
        found["pressure_Pa"] = mesh.MaterialCF(pressures, default=0)
    found["velocity_m_s"] = _in_3d(mesh.MaterialCF(everywhere))
    if system.solids:
        F, none = system.deformation_gradient_3d(), dict.fromkeys(domain.lumens, ng.CF((0,) * 9, dims=(3, 3)))
        stress = {name: system.cauchy_stress(name).Compile() for name in system.solids}
        found[STRESS] = mesh.MaterialCF({**stress, **none})
        found[DEFORMATION] = mesh.MaterialCF({**F, **none})
    return found


def _in_3d(vector: Any) -> Any:
    """Return a vector field with three components, of which files of the plane have them, too."""
    return vector if vector.dim == 3 else ng.CF((vector[0], vector[1], 0))
