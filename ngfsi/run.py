"""One run, from a case to a folder of results: geometry, domain, system, initial state, time loop, measures, output."""

from __future__ import annotations

import resource
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import ngsolve as ng

from ngfsi.case import Case
from ngfsi.domain import Domain
from ngfsi.errors import CaseError, NgfsiError, SolverError
from ngfsi.measure.probe import Probe
from ngfsi.measure.quantities import row
from ngfsi.measure.shape import Shape
from ngfsi.output.fields import DEFORMATION, STRESS, FieldWriter
from ngfsi.output.folder import RunFolder
from ngfsi.output.progress import Progress
from ngfsi.output.stored import StoredRun, open_run
from ngfsi.physics import terms
from ngfsi.physics.kinematics import Kinematics
from ngfsi.solve.initial import initial_state
from ngfsi.solve.linear import choose_backend
from ngfsi.solve.newton import Newton
from ngfsi.solve.system import System
from ngfsi.solve.timeloop import Step, TimeLoop
from ngfsi.stopwatch import Stopwatch

WALL_REFINEMENT = 3
"""Points along each side of an interface element in the written wall fields."""


def run(case: Case, folder: Path, *, quiet: bool = False) -> StoredRun:
    """Compute a case and return its results.

    The folder holds what was computed up to any failure; its manifest says how the run ended.

    Args:
        folder: to be made; must not hold anything yet.
        quiet: show no progress.

    Raises:
        CaseError: the geometry is no vein in tissue.
        OutputError: the folder cannot be used.
        MeshError: the geometry could not be meshed.
        SolverError: no solution; says at which time, why, and where the results are.
        KeyboardInterrupt: after noting it in the manifest.
    """
    _refuse_what_cannot_be_measured(case)
    backend = choose_backend(case.solver.linear)
    target = RunFolder.create(folder, case)
    try:
        Computation(case, target, backend, quiet=quiet).run()
    except KeyboardInterrupt:
        target.finish("interrupted", "by the user")
        raise
    except SolverError as error:
        target.finish("failed", str(error))
        raise SolverError(f"{error}; what was computed is in '{folder}'") from error
    except NgfsiError as error:
        target.finish("failed", str(error))
        raise
    except BaseException as error:
        target.finish("failed", f"{type(error).__name__}: {error}")
        raise
    target.finish("completed")
    return open_run(folder)


def _refuse_what_cannot_be_measured(case: Case) -> None:
    geometry = case.geometry
    if not {"tissue", "wall"} <= set(geometry.solids) or not hasattr(geometry, "vein_centre"):
        raise CaseError(
            f"a {type(geometry).__name__} can be solved by the benchmarks only: a run measures a vein with the regions "
            "tissue, wall and fluid, as of geometry.calf:CalfSegment or geometry.tube:TubeSegment"
        )


class Computation:
    """A run under way: owns the pieces and the order in which they work."""

    def __init__(self, case: Case, folder: RunFolder, backend: Any, *, quiet: bool) -> None:
        self.case, self.folder, self.backend, self.quiet = case, folder, backend, quiet
        self.watch = Stopwatch()
        self._factorisations = 0

    def run(self) -> None:
        """Compute everything."""
        with self.watch("mesh"):
            domain = Domain.build(self.case.geometry)
            self.folder.update_manifest(mesh=domain.statistics())
        try:
            with ng.TaskManager():
                self._solve(domain)
        finally:
            self.folder.update_manifest(
                seconds=dict(self.watch.seconds),
                peak_memory_MB=resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
                factorisations=self._factorisations,
            )

    def _solve(self, domain: Domain) -> None:
        with self.watch("set-up"):
            system = System(self.case, domain, self.watch)
            self._note_system(system)
            newton = Newton(system, self.backend)
        with self.watch("initial state"):
            self._factorisations += initial_state(system, newton, self.folder.log)
        with self.watch("measures"):
            probe = Probe(system)
        loop = TimeLoop(self.case, system, newton, probe.deformation.inversion, self.folder.log)
        writer = FieldWriter(self.folder.path, domain, volume_fields(system))
        with Progress(self.case.name, end=self.case.time.end, steps=loop.steps, quiet=self.quiet) as progress:
            self._record(0.0, 0.0, probe)
            self._write_wall(0.0, probe, writer)
            self._write(0.0, probe, writer)
            latest: Step | None = None
            for latest in self._timed(loop.run()):
                self._record(latest.time, latest.size, probe)
                self._note_cost(latest)
                if latest.index % self.case.output.wall_every == 0:
                    self._write_wall(latest.time, probe, writer)
                if self._is_written(latest.index):
                    self._write(latest.time, probe, writer)
                progress.advance(latest.index, latest.time, latest.solution.iterations)
            if latest is not None and latest.index % self.case.output.wall_every:
                self._write_wall(latest.time, probe, writer)
            if latest is not None and not self._is_written(latest.index):
                self._write(latest.time, probe, writer)

    def _is_written(self, index: int) -> bool:
        every = self.case.output.fields_every
        return every > 0 and index % every == 0

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
            self.folder.record({"time_s": time, "step_s": size, **row(probe)})

    def _note_cost(self, step: Step) -> None:
        taken = step.solution
        self._factorisations += taken.factorisations
        self.folder.record_cost(
            {
                "step": step.index,
                "time_s": step.time,
                "wall_s": step.seconds,
                "iterations": taken.iterations,
                "factorisations": taken.factorisations,
            }
        )

    def _write(self, time: float, probe: Probe, writer: FieldWriter) -> None:
        with self.watch("output"):
            writer.write(time)
            sections = probe.outlines
            sections.refresh()
            self.folder.record_outlines(time, sections.rings)
            self.folder.record_shape(Shape.of(sections).rows(time))

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
