"""The processes (ranks) of one run under mpirun, of which rank 0 leads and the others are its workers.

Only rank 0 runs the program: it alone reads, decides, measures and writes. The others wait for its calls (`serve`), of
which each is a piece of work that all ranks do together. So no rank can come to another decision than the others, and
without mpirun the same code runs without workers.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from time import process_time
from typing import TYPE_CHECKING, Any, TypeVar

from ngfsi.errors import CaseError, SolverError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

LAUNCHERS = {"OMPI_COMM_WORLD_RANK": "OMPI_COMM_WORLD_SIZE", "PMI_RANK": "PMI_SIZE"}
"""Variables by which Open MPI, and MPICH and its kin, tell a process which it is, and how many there are."""
THREADS = ("NGS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
"""Variables from which NGSolve and MKL take the number of threads as they are loaded: this module loads neither."""
END = "end"

T = TypeVar("T")
Handler = Callable[..., None]


def threads(count: int) -> dict[str, str]:
    """Return the environment of a process with so many threads."""
    return dict.fromkeys(THREADS, str(count))


class Ranks:
    """The ranks, `size` of them, of which this process is number `rank`, and 0 leads; or this process alone.

    Attributes:
        workers_ready: whether the other ranks wait for calls.
    """

    def __init__(self, communicator: Any = None) -> None:
        """Take an mpi4py communicator; None: this process is alone."""
        self._comm = communicator
        self.rank: int = communicator.rank if communicator else 0
        self.size: int = communicator.size if communicator else 1
        self.workers_ready = False
        self._under_way = False
        self._waiting = 0.0

    @property
    def leads(self) -> bool:
        """Whether this process is rank 0."""
        return self.rank == 0

    def processor_time(self) -> float:
        """Return the seconds of the processor so far without those of exchanges with other ranks, in which a rank that
        waits takes them, too. What PETSc exchanges by itself is not known here."""
        return process_time() - self._waiting

    def _exchange(self, exchange: Callable[..., Any], *data: Any) -> Any:
        """Return what an exchange with the other ranks returns."""
        start = process_time()
        try:
            return exchange(*data)
        finally:
            self._waiting += process_time() - start

    @contextmanager
    def order(self, name: str, *data: Callable[[], Any]) -> Iterator[None]:
        """Have the other ranks, if there are any, do what this one does in the block.

        Within a piece of work that is under way they come to the block by themselves.

        Args:
            data: each returns an argument for the others; called only if there are others.
        """
        part_of_another = self._under_way
        if self.size > 1 and self.leads and not part_of_another:
            self._exchange(self._comm.bcast, (name, [make() for make in data]))
            self._under_way = True
        try:
            yield
        except SolverError:  # of all ranks
            self._under_way = part_of_another
            raise
        self._under_way = part_of_another

    def serve(self, handlers: dict[str, Handler]) -> None:
        """Serve the calls of rank 0 until it shuts the workers down.

        What fails in a part of the work that ranks do by themselves, rank 0 knows and judges; anything else ends all.
        """
        while True:
            name, data = self._exchange(self._comm.bcast, None)
            if name == END:
                return
            try:
                handlers[name](*data)
            except SolverError:
                continue
            except Exception as error:
                print(f"ngfsi: rank {self.rank} failed, {type(error).__name__}: {error}", file=sys.stderr, flush=True)
                self._comm.Abort(1)

    def shutdown(self) -> None:
        """Shut the workers down; if they are in the midst of a piece of work, end all."""
        if self._under_way:
            sys.stderr.flush()
            self._comm.Abort(1)
        with self.order(END):
            self.workers_ready = False

    def together(self, work: Callable[[], T]) -> T:
        """Do each rank's own part of a piece of work, before one that needs all of them.

        Raises:
            SolverError: on all ranks, if any of them failed, with what the first of those said.
        """
        if self.size == 1:
            return work()
        failure, result = "", None
        try:
            result = work()
        except Exception as error:
            failure = f"{error}" if isinstance(error, SolverError) else f"{type(error).__name__}: {error}"
        said = self._exchange(self._comm.allgather, failure)
        if any(said):
            rank = next(rank for rank, sentence in enumerate(said) if sentence)
            raise SolverError(f"{said[rank]} (on rank {rank} of {self.size})")
        return result  # type: ignore[return-value] # where there is no failure there is a result

    def add(self, values: NDArray[np.float64]) -> None:
        """Replace values by their sum over all ranks."""
        if self.size > 1:
            from mpi4py import MPI

            self._exchange(self._comm.Allreduce, MPI.IN_PLACE, values)

    def smallest(self, values: NDArray[np.float64], *more: NDArray[np.float64]) -> list[NDArray[np.float64]]:
        """Return the smallest of each of some values over all ranks, NaN before all, and what belongs to those.

        Args:
            values: (n,)
            more: (n, ...) of this rank's values.
        """
        import numpy as np

        if self.size == 1:
            return [values, *more]
        of_ranks = [np.stack(each) for each in zip(*self.gather((values, *more)), strict=True)]
        where = np.argmin(of_ranks[0], axis=0)
        return [each[where, np.arange(len(values))] for each in of_ranks]

    def collect(self, mine: T) -> list[T]:
        """Return on rank 0 what each rank has, in the order of the ranks, and nothing on the others."""
        if self.size == 1:
            return [mine]
        return self._exchange(self._comm.gather, mine) or []

    def gather(self, mine: T) -> list[T]:
        """Return what each rank has, in the order of the ranks."""
        found: list[T] = self._exchange(self._comm.allgather, mine) if self.size > 1 else [mine]
        return found

    def gather_entries(self, mine: NDArray[np.float64], counts: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the entries of all ranks, one rank after the other, each with a number of them."""
        import numpy as np

        if self.size == 1:
            return mine
        found = np.empty(int(counts.sum()))
        self._exchange(self._comm.Allgatherv, mine, (found, counts))
        return found

    def lowest(self, count: int, mine: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return for each of `count` things the lowest rank that has it among its own, or their number if none has."""
        import numpy as np  # not before the number of its threads is known

        found = np.full(count, self.size)
        found[mine] = self.rank
        if self.size > 1:
            from mpi4py import MPI

            self._exchange(self._comm.Allreduce, MPI.IN_PLACE, found, MPI.MIN)
        return found


class Distribution:
    """Which entries of a vector are whose: each is the lowest rank's that touches it, and rank 0's if none does.

    Attributes:
        mine: the numbers of this rank's, ascending.
    """

    def __init__(self, ranks: Ranks, count: int, touched: NDArray[np.int64]) -> None:
        """Distribute.

        Args:
            touched: numbers of the entries that this rank touches.
        """
        import numpy as np

        owner = ranks.lowest(count, touched)
        owner[owner == ranks.size] = 0
        self._ranks, self.mine = ranks, np.flatnonzero(owner == ranks.rank)
        self._order, self._counts = np.argsort(owner, kind="stable"), np.bincount(owner, minlength=ranks.size)

    def whole(self, mine: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return on all ranks the whole of a vector of which each has its own entries."""
        import numpy as np

        found = np.empty(len(self._order))
        found[self._order] = self._ranks.gather_entries(mine, self._counts)
        return found

    def collected(self, mine: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return on rank 0 the whole of some vectors (..., entries), of which each rank has its own entries."""
        import numpy as np

        parts = self._ranks.collect(mine)
        found = np.empty((*mine.shape[:-1], len(self._order)))
        if parts:
            found[..., self._order] = np.concatenate(parts, axis=-1)
        return found


SERIAL = Ranks()
"""This process, whatever others there are."""


def launched() -> tuple[int, int]:
    """Return number and count of the processes that a launcher started, 0 and 1 without one."""
    for rank, size in LAUNCHERS.items():
        if size in os.environ:
            return int(os.environ.get(rank, "0")), int(os.environ[size])
    return 0, 1


def _stay_within_processors() -> None:
    """Start no more threads than this process has processors: NGSolve counts all, mpirun and Slurm bind it to some."""
    if hasattr(os, "sched_getaffinity") and (mine := len(os.sched_getaffinity(0))) < (os.cpu_count() or 1):
        os.environ.setdefault("NGS_NUM_THREADS", str(mine))


@cache
def all_ranks() -> Ranks:
    """Return the ranks that a launcher started; each takes one thread unless the environment says otherwise.

    A process alone takes as many threads as it has processors.

    Raises:
        CaseError: they cannot work together.
    """
    _, size = launched()
    if size == 1:
        _stay_within_processors()
        return SERIAL
    for name, count in threads(1).items():
        os.environ.setdefault(name, count)
    missing = [name for name in ("mpi4py", "petsc4py") if find_spec(name) is None]
    if missing:
        raise CaseError(
            f"{size} processes were started, which need {' and '.join(missing)} to work together: see 'Several "
            "processes' in docs/using.md, or start one"
        )
    from mpi4py import MPI

    if MPI.COMM_WORLD.size != size:
        raise CaseError(
            f"{size} processes were started, but mpi4py sees {MPI.COMM_WORLD.size}: it was built for another MPI than "
            "the mpirun that started them"
        )
    import_module("petsc4py.PETSc")  # which begins on all ranks together
    return Ranks(MPI.COMM_WORLD)
