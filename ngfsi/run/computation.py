"""One run, from a case to a folder of results: geometry, domain, system, initial state, time loop, measures, output."""

from __future__ import annotations

import resource
from collections.abc import Iterator
from contextlib import suppress
from importlib import import_module
from math import inf
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Literal

import ngsolve as ng

from ngfsi.case import Case
from ngfsi.errors import CaseError, Interrupted, NgfsiError, OutputError, SolverError, StoppedError
from ngfsi.linear.backends import Name, choose_backend
from ngfsi.measure.probe import Probe
from ngfsi.measure.quantities import row
from ngfsi.measure.shape import Shape
from ngfsi.mesh.domain import Domain
from ngfsi.parallel.ranks import all_ranks
from ngfsi.parallel.stopwatch import Stopwatch
from ngfsi.physics import terms
from ngfsi.physics.kinematics import Kinematics
from ngfsi.run.interrupts import Stops
from ngfsi.run.progress import Progress
from ngfsi.solve.initial import initial_state
from ngfsi.solve.newton import Newton, part_of
from ngfsi.solve.time_loop import Step, TimeLoop
from ngfsi.solve.worker import shared_system
from ngfsi.store.checkpoint import Checkpoint, Checkpoints
from ngfsi.store.fields import COLLAPSE, DEFORMATION, STRESS, FieldWriter
from ngfsi.store.folder import CASE, CHECKPOINTS, MANIFEST, STOP, RunFolder, outline_rows
from ngfsi.store.provenance import versions
from ngfsi.store.stored import StoredRun, check_folder, open_run
from ngfsi.system.system import System, Vector

if TYPE_CHECKING:
    from ngfsi.measure.stability import Stability

STAGE = "stability"
"""Of the names of arrays in checkpoints."""
LIBRARIES = ("pyvista", "scipy.integrate", "scipy.interpolate")
"""Those with which every run measures and writes: a second to load, for which a refused case need not wait."""
WALL_REFINEMENT = 3
"""Points along each side of an interface element in the written wall fields."""


def run(case: Case, folder: Path, *, quiet: bool = False, max_wall: float | None = None) -> StoredRun:
    """Compute a case and return its results.

    The folder holds what was computed up to any failure; its manifest says how the run ended.

    Args:
        folder: to be made; must not hold anything yet.
        quiet: show no progress.
        max_wall: seconds on the clock within which to stop, so that `resume` can go on.

    Raises:
        CaseError: the geometry is no vein in tissue.
        OutputError: the folder cannot be used.
        MeshError: the geometry could not be meshed.
        SolverError: no solution; says at which time, why, and where the results are.
        StoppedError: by `max_wall`, or by a file STOP in the folder, after a checkpoint.
        Interrupted: a signal came (a KeyboardInterrupt); from the first step on after a checkpoint.
    """
    _refuse_what_cannot_be_measured(case)
    backend = choose_backend(case.solver.linear)
    checkpoints = _checkpoints(case, folder, backend)
    return _finished(Computation(case, RunFolder.create(folder, case), backend, checkpoints), quiet, max_wall)


def resume(folder: Path, *, quiet: bool = False, max_wall: float | None = None) -> StoredRun:
    """Go on with a run that did not reach its end, from its last checkpoint, and return its results.

    They are those of a run that was never stopped: to the last bit with one thread. Without a checkpoint the run
    begins anew.

    Args:
        quiet, max_wall: as for `run`.

    Raises:
        OutputError: there is no run, it is complete or being computed, or its checkpoints are damaged or of another
            case or version; says in what they differ.
        MeshError, SolverError, StoppedError, Interrupted: as for `run`.
    """
    check_folder(folder)
    if not (folder / CASE).exists():
        raise OutputError(f"the folder '{folder}' holds no run: {CASE} is expected in it")
    case = Case.from_toml(folder / CASE)
    _refuse_what_cannot_be_measured(case)
    if (folder / MANIFEST).exists() and open_run(folder).status == "completed":
        raise OutputError(f"the run in '{folder}' is complete: there is nothing to resume")
    backend = choose_backend(case.solver.linear)
    checkpoints = _checkpoints(case, folder, backend)
    start = checkpoints.latest()
    target = RunFolder.reopen(folder, case, start.facts["time_s"] if start else None)
    return _finished(Computation(case, target, backend, checkpoints, start), quiet, max_wall)


def _checkpoints(case: Case, folder: Path, backend: str) -> Checkpoints:
    content = {key: value for key, value in case.to_toml_dict().items() if key != "name"}
    programs = {name: versions()[name] for name in ("ngfsi", "ngsolve")}
    return Checkpoints(folder / CHECKPOINTS, {"case": content, "version": programs, "linear_solver": backend})


def _finished(computation: Computation, quiet: bool, max_wall: float | None) -> StoredRun:
    """Compute, note how it ended and return the results."""
    target = computation.folder
    try:
        with Stops(target.path / STOP, max_wall) as stops:
            try:
                computation.run(stops, quiet=quiet)
            except Interrupted:
                raise
            except KeyboardInterrupt:  # at once
                raise stops.interruption() from None
    except (StoppedError, Interrupted) as error:
        sentence = f"{error}{computation.reached}: go on with `ngfsi resume {target.path}`"
        _note_end(target, "interrupted", f"{error}{computation.reached}")
        raise (
            StoppedError(sentence) if isinstance(error, StoppedError) else Interrupted(sentence, error.exit_code)
        ) from None
    except SolverError as error:
        _note_end(target, "failed", str(error))
        raise SolverError(f"{error}; what was computed is in '{target.path}'") from error
    except NgfsiError as error:
        _note_end(target, "failed", str(error))
        raise
    except BaseException as error:
        _note_end(target, "failed", f"{type(error).__name__}: {error}")
        raise
    target.finish("completed")
    computation.checkpoints.clear()
    return open_run(target.path)


def is_measurable(case: Case) -> bool:
    """Return whether a case has the vein that a run measures."""
    return {"tissue", "wall"} <= set(case.geometry.solids) and hasattr(case.geometry, "vein_centre")


def _refuse_what_cannot_be_measured(case: Case) -> None:
    if not is_measurable(case):
        raise CaseError(
            f"a {type(case.geometry).__name__} can be solved by the benchmarks only: a run measures a vein with the "
            "regions tissue, wall and fluid, as of ngfsi_geometry.calf:CalfSegment or ngfsi_geometry.tube:TubeSegment"
        )


def _note_end(target: RunFolder, status: Literal["failed", "interrupted"], reason: str) -> None:
    """Note how a run ended early; a disk that does not take even that must not hide the reason."""
    with suppress(OutputError):
        target.finish(status, reason)


class Computation:
    """A run under way: owns the pieces and the order in which they work."""

    def __init__(
        self, case: Case, folder: RunFolder, backend: Name, checkpoints: Checkpoints,
        start: Checkpoint | None = None,
    ) -> None:  # fmt: skip
        """Prepare.

        Args:
            start: from which to go on; None: from the beginning.
        """
        self.case, self.folder, self.backend = case, folder, backend
        self.checkpoints, self.start = checkpoints, start
        self.watch = Stopwatch()
        self._stability: Stability | None = None
        self._factorisations = start.facts["factorisations"] if start else 0
        self._time = 0.0
        self._checkpoint_time: float | None = None
        self._checkpoint_clock = perf_counter()

    @property
    def reached(self) -> str:
        """How far the run came, for a sentence."""
        return (
            ""
            if self._checkpoint_time is None
            else f" at t = {self._time:.6g} s, checkpoint at t = {self._checkpoint_time:.6g} s"
        )

    def run(self, stops: Stops, *, quiet: bool) -> None:
        """Compute everything, until the end or until `stops` wants."""
        with self.watch("mesh"):
            domain = Domain.build(self.case.geometry)
            self._mesh = domain.fingerprint
            self.folder.update_manifest(mesh=domain.statistics())
        if self.start and self.start.facts["mesh"] != self._mesh:
            raise OutputError(f"the checkpoint in '{self.folder.path}' is of another mesh: run the case anew")
        for name in LIBRARIES:  # not within the seconds of measures and output, which are told and extrapolated
            import_module(name)
        try:
            with ng.TaskManager():
                self._solve(domain, stops, quiet=quiet)
        finally:
            used = resource.getrusage(resource.RUSAGE_SELF)
            self.folder.update_manifest(
                seconds=dict(self.watch.seconds),
                cpu_s=used.ru_utime + used.ru_stime,
                peak_memory_MB=used.ru_maxrss / 1024,
                factorisations=self._factorisations,
            )

    def _solve(self, domain: Domain, stops: Stops, *, quiet: bool) -> None:
        with self.watch("set-up"):
            system = shared_system(self.case, domain, self.watch, all_ranks())
            self._note_system(system)
            newton = Newton(system, self.backend)
        with self.watch("initial state"):
            if self.start is None:
                self._factorisations += initial_state(system, newton, self.folder.log)
        with self.watch("measures"):
            probe = Probe(system)
            if self.case.output.stability:
                from ngfsi.measure.stability import Stability  # with solvers of eigenvalues, which most runs do without

                self._stability = Stability(system)
        shape = probe.deformation
        loop = TimeLoop(self.case, system, newton, shape.inversion, self.folder.log, explain=shape.diagnose_failure)
        until = self._restore(loop) if self.start else -inf
        stops.patient = True
        fields = volume_fields(system) | ({COLLAPSE: self._stability.mode} if self._stability else {})
        writer = FieldWriter(self.folder.path, domain, fields, until)
        with Progress(self.case.name, end=self.case.time.end, steps=loop.steps, quiet=quiet) as progress:
            if self.start is None:
                self._record(0.0, 0.0, probe)
                self._write_wall(0.0, probe, writer)
                self._write(0.0, probe, writer)
                self._write_checkpoint(loop)
            self._march(loop, probe, writer, progress, stops)

    def _restore(self, loop: TimeLoop) -> float:
        """Go on from the checkpoint; return its time (s)."""
        assert self.start is not None
        with self.watch("set-up"):
            if self._stability:
                self._stability.restore(part_of(self.start.arrays, STAGE))
            loop.restore(self.start.arrays)
        self._time = self._checkpoint_time = loop.history.times[0]
        for damage in self.start.damaged:
            self.folder.log(f"a checkpoint was passed over: {damage}")
        self.folder.log(f"resumed from t = {self._time:.6g} s")
        return self._time

    def _march(self, loop: TimeLoop, probe: Probe, writer: FieldWriter, progress: Progress, stops: Stops) -> None:
        steps = self._timed(loop.run())
        while True:
            if request := stops.request():
                self._write_checkpoint(loop)
                raise request
            try:
                if (step := next(steps, None)) is None:
                    return
            except SolverError:
                self._write_what_is_not(probe, writer)
                raise
            self._time = step.time
            self._record(step.time, step.size, probe)
            self._note_cost(step)
            for warning in probe.deformation.approaching():
                self.folder.log(f"t = {step.time:.6g} s: {warning}")
            if self._is_due(step, loop, self.case.output.wall_every):
                self._write_wall(step.time, probe, writer)
            if self._is_due(step, loop, self.case.output.fields_every):
                self._write(step.time, probe, writer)
            progress.advance(step.index, step.time, step.solution.iterations)
            if self._checkpoint_due(step):
                self._write_checkpoint(loop)

    def _write_what_is_not(self, probe: Probe, writer: FieldWriter) -> None:
        """Write the last good state, to see what happened."""
        if self._time not in writer.times["wall"]:
            self._write_wall(self._time, probe, writer)
        if self._time not in writer.times["volume"]:
            self._write(self._time, probe, writer)

    @staticmethod
    def _is_due(step: Step, loop: TimeLoop, every: int) -> bool:
        return step.time == loop.end or (every > 0 and step.index % every == 0)

    def _checkpoint_due(self, step: Step) -> bool:
        every = self.case.output.checkpoint_every
        by_clock = perf_counter() - self._checkpoint_clock > self.case.output.checkpoint_interval
        return by_clock or (every > 0 and step.index % every == 0)

    def _write_checkpoint(self, loop: TimeLoop) -> None:
        """Write a checkpoint; one that cannot be written costs no results, and the run goes on."""
        self._checkpoint_clock = perf_counter()
        facts = {"time_s": self._time, "mesh": self._mesh, "factorisations": self._factorisations}
        try:
            with self.watch("checkpoints"):
                self.checkpoints.write(loop.history.accepted, loop.arrays() | self._stages(), **facts)
        except OutputError as error:
            self.folder.log(f"t = {self._time:.6g} s: no checkpoint: {error}")
        else:
            self._checkpoint_time = self._time

    def _stages(self) -> dict[str, Vector]:
        """Return what the stability at later times depends on."""
        arrays = self._stability.arrays() if self._stability else {}
        return {f"{STAGE}.{name}": part for name, part in arrays.items()}

    def _timed(self, steps: Iterator[Step]) -> Iterator[Step]:
        """Pass steps on, timing what is done inside the loop."""
        while True:
            with self.watch("steps"):
                step = next(steps, None)
            if step is None:
                return
            yield step

    def _record(self, time: float, size: float, probe: Probe) -> None:
        with self.watch("measures"):
            probe.refresh()
            self.folder.append("series", {"time_s": time, "step_s": size, **row(probe)})

    def _note_cost(self, step: Step) -> None:
        self._factorisations += step.solution.factorisations
        self.folder.append("costs", step.cost())

    def _record_stability(self, time: float) -> None:
        """Note the stability; where it cannot be determined, the log says why."""
        if self._stability is None:
            return
        with self.watch("stability"):
            try:
                self.folder.append("stability", self._stability.refresh().row(time))
            except SolverError as error:
                self.folder.log(f"t = {time:.6g} s: no stability: {error}")

    def _write(self, time: float, probe: Probe, writer: FieldWriter) -> None:
        self._record_stability(time)
        with self.watch("output"):
            writer.write(time)
            sections = probe.outlines
            sections.refresh()
            self.folder.append("outlines", *outline_rows(time, sections.rings))
            self.folder.append("shape", *Shape.of(sections, cut=True).rows(time))

    def _write_wall(self, time: float, probe: Probe, writer: FieldWriter) -> None:
        with self.watch("output"):
            writer.write_wall(time, probe.wall.sample(WALL_REFINEMENT))

    def _note_system(self, system: System) -> None:
        unknowns = system.unknowns
        self.folder.update_manifest(
            unknowns=unknowns.size,
            unknowns_by_block={name: len(part) for name, part in unknowns.blocks.items()},
            reference={"lumen_volume_m3": system.domain.volume(system.domain.fluid)},
            linear_solver=self.backend,
            threads=ng.ngsglobals.numthreads,
            ranks=system.ranks.size,
        )


def volume_fields(system: System) -> dict[str, ng.CoefficientFunction]:
    """Return the fields written for ParaView, defined on the whole domain: zero where they do not exist."""
    domain = system.domain
    fields = system.fields(system.state.components)
    fluid = domain.fluid
    solid_velocity = system.new_weight * system.state.components[0] + system.velocity_history.components[0]
    everywhere = {name: solid_velocity for name in domain.geometry.solids} | {fluid: fields.velocity}
    relaxation, strain = system.stress_free_gradient(), Kinematics(fields.grad_motion).F
    strain = strain if relaxation is None else strain * relaxation
    stress = {name: terms.cauchy_stress(law, strain).Compile() for name, law in system.solids.items()}
    none = ng.CF((0,) * 9, dims=(3, 3))
    return {
        "displacement_m": fields.motion,
        "velocity_m_s": domain.mesh.MaterialCF(everywhere),
        "pressure_Pa": domain.mesh.MaterialCF({fluid: fields.pressure}, default=0),
        STRESS: domain.mesh.MaterialCF({**stress, fluid: none}),
        DEFORMATION: domain.mesh.MaterialCF({**dict.fromkeys(stress, strain), fluid: none}),
    }
