"""What ranks other than 0 do in a run: their partition of elements in residuals, linearisations, factors and measures.

Every rank has the whole mesh and room for whole vectors of unknowns, but integrals, matrices and factors only in part;
rank 0 also has the weak form's integrals on boundaries. It tells the others what has changed of the state, but for what
they have found with it.
"""

from __future__ import annotations

import pickle
import resource
import tomllib
from functools import partial
from importlib import import_module
from typing import Any

import ngsolve as ng
import numpy as np

from ngfsi import registry
from ngfsi.arrays import Array, Numbers
from ngfsi.case import Case
from ngfsi.errors import CaseError
from ngfsi.linear.backends import Name
from ngfsi.measure.probe import Probe
from ngfsi.mesh.domain import Domain
from ngfsi.mesh.generate import MeshReport, quiet
from ngfsi.parallel.ranks import Ranks
from ngfsi.parallel.stopwatch import Stopwatch
from ngfsi.run.observers import SharedFields
from ngfsi.solve.newton import Newton
from ngfsi.system.system import System

LIBRARIES = ("scipy.integrate", "scipy.interpolate", "scipy.sparse.linalg")
"""Those with which every run measures: half a second to load, for which a refused case need not wait."""


def load_libraries() -> None:
    """Load them, not within the seconds of measures and output, which are told and extrapolated."""
    for name in LIBRARIES:
        import_module(name)


def shared_system(case: Case, domain: Domain, watch: Stopwatch, ranks: Ranks) -> System:
    """Return the system of a case of which each rank has a partition; the others make theirs.

    Raises:
        CaseError: the other ranks are not workers.
        SolverError: a rank failed.
    """
    if ranks.size == 1:
        return System(case, domain, watch)
    if not ranks.workers_ready:
        raise CaseError(f"a script runs a case in one process, not in {ranks.size}: use `mpirun ngfsi run CASE.toml`")
    owners = partition(domain, ranks.size)
    mesh = partial(pickle.dumps, domain.mesh.ngmesh)
    with ranks.order("system", registry.plugins, case.to_toml, mesh, lambda: domain.report, lambda: owners):
        return ranks.together(lambda: System(case, domain, watch, ranks, _mine(owners, ranks)))


def shared_measures(system: System) -> tuple[Probe, SharedFields]:
    """Return measurements and fields of a system, of which each rank has those of its partition.

    Raises:
        SolverError: a rank failed.
    """
    with system.ranks.order("measures"):
        return system.ranks.together(lambda: (Probe(system), SharedFields(system)))


def work_of_ranks(watch: Stopwatch, ranks: Ranks) -> list[dict[str, Any]]:
    """Return of each rank the seconds of the processor by kind of work, without waiting, and its largest memory."""
    with ranks.order("report"):
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        return ranks.gather({"cpu_s": dict(watch.cpu_s), "peak_memory_MB": memory})


def partition(domain: Domain, count: int) -> Numbers:
    """Return the rank of each element: each region is cut into compact parts of the same number of elements."""
    elements = list(domain.mesh.Elements(ng.VOL))
    centres = np.array([np.mean([domain.mesh[v].point for v in e.vertices], axis=0) for e in elements])
    regions = np.array([e.mat for e in elements])
    owners = np.zeros(len(elements), dtype=np.int64)
    for region in domain.regions:
        numbers = np.flatnonzero(regions == region)
        owners[numbers] = _bisected(centres[numbers], count)
    return owners


def _bisected(centres: Array, count: int) -> Numbers:
    """Return the part of each point after recursive bisection across the longest extent (Berger and Bokhari, IEEE Trans
    Comput 36, 1987)."""
    if count == 1 or not len(centres):
        return np.zeros(len(centres), dtype=np.int64)
    axis = int(np.argmax(np.ptp(centres, axis=0)))
    order = np.argsort(centres[:, axis], kind="stable")
    left = count // 2
    lower, upper = np.split(order, [len(order) * left // count])
    parts = np.empty(len(centres), dtype=np.int64)
    parts[lower], parts[upper] = _bisected(centres[lower], left), left + _bisected(centres[upper], count - left)
    return parts


def _mine(owners: Numbers, ranks: Ranks) -> ng.BitArray:
    return ng.BitArray(list(owners == ranks.rank))


class Worker:
    """A rank other than 0: owns its partition of a system and the solvers that rank 0 has made of it."""

    def __init__(self, ranks: Ranks) -> None:
        self._ranks = ranks
        self._system: Any = None
        self._watch = Stopwatch(processor=ranks.processor_time)

    def work(self) -> None:
        """Serve the calls of rank 0 until it is done."""
        with ng.TaskManager():
            self._ranks.serve(
                {"system": self.system, "measures": self.measures, "newton": self.newton, "residual": self.residual,
                 "together": self.together, "report": self.report}
            )  # fmt: skip

    def system(self, plugins: tuple[str, ...], toml: str, mesh: bytes, report: MeshReport, owners: Numbers) -> None:
        """Make the system of a case (its file, read with plugins) on a mesh (Netgen's, as bytes)."""

        def make() -> System:
            load_libraries()
            registry.load(plugins)
            case = Case.from_dict(tomllib.loads(toml))
            with quiet():
                domain = Domain(ng.Mesh(pickle.loads(mesh)), case.geometry, report)
            return System(case, domain, self._watch, self._ranks, _mine(owners, self._ranks))

        with self._watch("set-up"):
            self._system = self._ranks.together(make)

    def measures(self) -> None:
        """Make what is measured and written of the system."""
        with self._watch("set-up"):
            shared_measures(self._system)

    def together(
        self, call: tuple[int, str, tuple[Any, ...], dict[str, Any], str], changed_state: dict[str, Any]
    ) -> None:
        """Call a method that is `together`, as a kind of work."""
        self._system.take(changed_state)
        number, name, args, named, work = call
        with self._watch(work):
            getattr(self._system.enrolled(number), name)(*args, **named)

    def report(self) -> None:
        """Say what this rank's work took."""
        work_of_ranks(self._watch, self._ranks)

    def newton(self, backend: Name, blocks: tuple[str, ...]) -> None:
        """Make a solver on some blocks of unknowns."""
        Newton(self._system, backend, *blocks)

    def residual(self, changed_state: dict[str, Any]) -> None:
        """Add to the residual."""
        self._system.take(changed_state)
        self._ranks.add(np.asarray(self._system.part_of_residual().FV().NumPy()))
