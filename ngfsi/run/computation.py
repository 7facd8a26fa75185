"""One run, from a case to a folder of results: geometry, domain, system, initial state, time loop, measures, output."""

from __future__ import annotations

import os
import resource
from collections.abc import Sequence
from contextlib import suppress
from math import inf
from pathlib import Path
from time import perf_counter
from typing import Any

import ngsolve as ng

from ngfsi.arrays import part_of
from ngfsi.case import Case
from ngfsi.case.plausible import implausible
from ngfsi.errors import Interrupted, NgfsiError, OutputError, SolverError, StoppedError
from ngfsi.linear.backends import BACKENDS, Name, choose_backend, fitting
from ngfsi.measure.probe import Probe
from ngfsi.mesh.domain import Domain
from ngfsi.parallel.ranks import all_ranks
from ngfsi.parallel.stopwatch import Stopwatch
from ngfsi.run.interrupts import Stops
from ngfsi.run.observers import Observer, observers_of
from ngfsi.run.progress import Progress
from ngfsi.run.worker import load_libraries, shared_measures, shared_system, work_of_ranks
from ngfsi.solve.initial import initial_state
from ngfsi.solve.newton import Newton
from ngfsi.solve.time_loop import Step, TimeLoop
from ngfsi.store.checkpoint import Checkpoint, Checkpoints
from ngfsi.store.folder import CASE, CHECKPOINTS, MANIFEST, STOP, RunFolder
from ngfsi.store.provenance import versions
from ngfsi.store.stored import StoredRun, check_folder, open_run
from ngfsi.system.system import System

ROUNDED = 10_000
"""Unknowns from which factors of single precision are tried: in smaller systems residuals take most of the time, and
the case `tiny` of `ngfsi bench` needs 36 iterations with them in place of 30."""


def run(
    case: Case, folder: Path, *, quiet: bool = False, max_wall: float | None = None, resumed_by: str = ""
) -> StoredRun:
    """Compute a case and return its results.

    The folder holds what was computed up to any failure; its manifest says how the run ended.

    Args:
        folder: to be made; must not hold anything yet.
        max_wall: seconds on the clock within which to stop, so that `resume` can go on.
        resumed_by: the command that goes on, for who stops the run; default: `ngfsi resume FOLDER`.

    Raises:
        CaseError: a condition does not fit the geometry.
        OutputError: the folder cannot be used.
        MeshError: the geometry could not be meshed.
        SolverError: no solution; says at which time, why, and where the results are.
        StoppedError: by `max_wall`, or by a file STOP in the folder, after a checkpoint.
        Interrupted: a signal came (a KeyboardInterrupt); from the first step on after a checkpoint.
    """
    backend = choose_backend(case.solver.linear)
    checkpoints = _checkpoints(case, folder, backend)
    begun = Computation(case, RunFolder.create(folder, case), backend, checkpoints)
    return _finished(begun, quiet, max_wall, resumed_by)


def completed(folder: Path) -> StoredRun | None:
    """Return the run in a folder if it has come to its end.

    Raises:
        OutputError: what is there cannot be read.
    """
    found = open_run(folder) if (folder / MANIFEST).exists() else None
    return found if found and found.status == "completed" else None


def resume(folder: Path, *, quiet: bool = False, max_wall: float | None = None, resumed_by: str = "") -> StoredRun:
    """Go on with a run that did not reach its end, from its last checkpoint, and return its results.

    They are those of a run that was never stopped: to the last bit with one thread. Without a checkpoint the run
    begins anew.

    Args:
        quiet, max_wall, resumed_by: as for `run`.

    Raises:
        OutputError: there is no run, it is complete or being computed, or its checkpoints are damaged or of another
            case or version; says in what they differ.
        MeshError, SolverError, StoppedError, Interrupted: as for `run`.
    """
    check_folder(folder)
    if not (folder / CASE).exists():
        raise OutputError(f"the folder '{folder}' holds no run: {CASE} is expected in it")
    case = Case.from_toml(folder / CASE)
    if completed(folder):
        raise OutputError(f"the run in '{folder}' is complete: there is nothing to resume")
    backend = choose_backend(case.solver.linear)
    checkpoints = _checkpoints(case, folder, backend)
    start = checkpoints.latest()
    target = RunFolder.reopen(folder, case, start.facts["time_s"] if start else None)
    return _finished(Computation(case, target, backend, checkpoints, start), quiet, max_wall, resumed_by)


def finished(case: Case, folder: Path, **how: Any) -> StoredRun:
    """Return the run of a case in a folder: as it is there, after it has gone on, or begun; `how` as of `run`."""
    if found := completed(folder):
        return found
    return resume(folder, **how) if (folder / CASE).exists() else run(case, folder, **how)


def _checkpoints(case: Case, folder: Path, backend: str) -> Checkpoints:
    programs = {name: versions()[name] for name in ("ngfsi", "ngsolve")}
    return Checkpoints(folder / CHECKPOINTS, {"case": case.content, "version": programs, "linear_solver": backend})


def _finished(computation: Computation, quiet: bool, max_wall: float | None, resumed_by: str) -> StoredRun:
    """Compute, note how it ended and return the results."""
    target = computation.folder
    try:
        with Stops(target.path / STOP, max_wall) as stops:
            computation.run(stops, quiet=quiet)
    except BaseException as error:
        stopped = isinstance(error, StoppedError | Interrupted)
        reason = str(error) if stopped or isinstance(error, NgfsiError) else f"{type(error).__name__}: {error}"
        reason += computation.reached if stopped else ""
        with suppress(OutputError):  # a disk that does not take even that must not hide the reason
            target.finish("interrupted" if stopped else "failed", reason)
        if stopped:
            error.args = (f"{reason}: go on with `{resumed_by or f'ngfsi resume {target.path}'}`",)
        elif isinstance(error, SolverError):
            error.args = (f"{reason}; what was computed is in '{target.path}'",)
        raise
    target.finish("completed")
    computation.checkpoints.clear()
    return open_run(target.path)


def fitting_backend(system: System) -> tuple[Name, str]:
    """Return the linear solver of a system, and why, where the case leaves the choice: that fits its size if it has a
    solid that can be smoothed. Direct ones have factors of single precision if these can pay."""
    backend, why = choose_backend(system.case.solver.linear), ""
    if system.case.solver.linear != "auto" or system.ranks.size > 1:
        return backend, why
    if system.solids:
        memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9
        tetrahedra = all(element.type == ng.TET for element in system.domain.mesh.Elements())
        backend, why = fitting(
            backend, system.unknowns.size, system.case.discretisation.order, memory, tetrahedra=tetrahedra
        )
    single = BACKENDS[backend].single
    if single is None or system.unknowns.size < ROUNDED:
        return backend, why
    return single, f"{why}; {single} while that converges" if why else ""


class Computation:
    """A run under way: owns the pieces and the order in which they work."""

    def __init__(
        self, case: Case, folder: RunFolder, backend: Name, checkpoints: Checkpoints,
        start: Checkpoint | None = None,
    ) -> None:  # fmt: skip
        """Begin, or go on from the checkpoint `start`."""
        self.case, self.folder, self.backend = case, folder, backend
        self.checkpoints, self.start = checkpoints, start
        self.watch = Stopwatch(processor=all_ranks().processor_time)
        self._factorisations = start.facts["factorisations"] if start else 0
        self._time = 0.0
        self._checkpoint_time: float | None = None
        self._checkpoint_clock = perf_counter()

    @property
    def reached(self) -> str:
        """How far the run came, for a sentence."""
        if self._checkpoint_time is None:
            return ""
        return f" at t = {self._time:.6g} s, checkpoint at t = {self._checkpoint_time:.6g} s"

    def run(self, stops: Stops, *, quiet: bool) -> None:
        """Compute everything, until the end or until `stops` wants."""
        if self.start is None:
            for sentence in (*implausible(self.case), *getattr(self.case.geometry, "remarks", ())):
                self.folder.log(sentence)
        with self.watch("mesh"):
            domain = Domain.build(self.case.geometry)
            self._mesh = domain.fingerprint
            self.folder.update_manifest(mesh=domain.statistics())
        if self.start and self.start.facts["mesh"] != self._mesh:
            raise OutputError(f"the checkpoint in '{self.folder.path}' is of another mesh: run the case anew")
        load_libraries()
        try:
            with ng.TaskManager():
                self._solve(domain, stops, quiet=quiet)
                self.folder.update_manifest(work_of_ranks=work_of_ranks(self.watch, all_ranks()))
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
            self.backend, why = fitting_backend(system)
            if why:
                self.folder.log(why)
            newton = Newton(system, self.backend, *system.unknowns.to_solve)
        with self.watch("initial state"):
            if self.start is None:
                self._factorisations += initial_state(system, newton, self.folder.log)
        with self.watch("set-up"):
            probe, fields = shared_measures(system)
            self._note(system, probe)
        shape = probe.deformation
        loop = TimeLoop(self.case, system, newton, shape.inversion, self.folder.log, explain=shape.diagnose_failure)
        until = self.start.facts["time_s"] if self.start else -inf
        observers = observers_of(self.case, system, probe, self.folder, self.watch, until, fields)
        if self.start:
            self._restore(loop, observers)
        stops.patient = True
        with Progress(self.case.name, end=self.case.time.end, steps=len(loop.milestones), quiet=quiet) as progress:
            if self.start is None:
                for observer in observers:
                    observer.look(0.0, None)
                self._write_checkpoint(loop, observers)
            self._march(loop, observers, progress, stops)

    def _restore(self, loop: TimeLoop, observers: Sequence[Observer]) -> None:
        """Go on from the checkpoint."""
        assert self.start is not None
        with self.watch("set-up"):
            for observer in observers:
                observer.restore_state(part_of(self.start.arrays, observer.name))
            loop.restore(self.start.arrays)
        self._time = self._checkpoint_time = loop.time
        for damage in self.start.damaged:
            self.folder.log(f"a checkpoint was passed over: {damage}")
        self.folder.log(f"resumed from t = {self._time:.6g} s")

    def _march(self, loop: TimeLoop, observers: Sequence[Observer], progress: Progress, stops: Stops) -> None:
        steps = loop.run()
        while True:
            if request := stops.request():
                self._write_checkpoint(loop, observers)
                raise request
            try:
                with self.watch("steps"):
                    step = next(steps, None)
            except SolverError:
                reached = loop.history.times[0]
                for observer in observers:  # the last good state, to see what happened
                    if not observer.looked_at(reached):
                        observer.look(reached, None)
                raise
            if step is None:
                with self.watch("output"):
                    self.folder.write_end(loop.system.snapshot(), self._mesh)
                return
            self._time = step.time
            self._factorisations += step.solution.factorisations
            for observer in observers:
                if step.time == loop.milestones[-1] or (observer.every > 0 and step.index % observer.every == 0):
                    observer.look(step.time, step)
            progress.advance(step.index, step.time, step.solution.iterations)
            if self._checkpoint_due(step):
                self._write_checkpoint(loop, observers)

    def _checkpoint_due(self, step: Step) -> bool:
        every = self.case.output.checkpoint_every
        by_clock = perf_counter() - self._checkpoint_clock > self.case.output.checkpoint_interval
        return by_clock or (every > 0 and step.index % every == 0)

    def _write_checkpoint(self, loop: TimeLoop, observers: Sequence[Observer]) -> None:
        """Write a checkpoint; one that cannot be written costs no results, and the run goes on."""
        self._checkpoint_clock = perf_counter()
        facts = {"time_s": self._time, "mesh": self._mesh, "factorisations": self._factorisations}
        try:
            with self.watch("checkpoints"):
                arrays = loop.arrays()
                for observer in observers:
                    arrays |= {f"{observer.name}.{key}": array for key, array in observer.state_arrays().items()}
                self.checkpoints.write(loop.history.accepted, arrays, **facts)
        except OutputError as error:
            self.folder.log(f"t = {self._time:.6g} s: no checkpoint: {error}")
        else:
            self._checkpoint_time = self._time

    def _note(self, system: System, probe: Probe) -> None:
        unknowns, domain = system.unknowns, system.domain
        reference = {f"{name or 'vein'}_volume_m3": domain.volume(name) for name in domain.lumens}
        self.folder.update_manifest(
            unknowns=unknowns.size,
            unknowns_by_block={name: len(part) for name, part in unknowns.blocks.items()},
            reference={"lumen_volume_m3": reference[next(iter(reference))]} if reference else {},
            vessels={name: vessel.summary() for name, vessel in probe.vessels.items()},
            linear_solver=self.backend,
            threads=ng.ngsglobals.numthreads,
            ranks=system.ranks.size,
        )
