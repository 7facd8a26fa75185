"""Strong and weak scaling of runs on several processes, and what a model fitted to them says of many.

    python -m ngfsi_studies.scaling docs/scaling.json --ranks 1 2

takes the interpreter of `make mpi`, prints the tables of docs/parallel.md and stores what was measured.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from math import log
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from ngfsi.case import Case
from ngfsi.errors import SolverError
from ngfsi.parallel.ranks import threads
from ngfsi.report.tables import markdown_table
from ngfsi.store.disk import replace_file
from ngfsi.store.stored import open_run
from ngfsi_studies.speed import CASES

PYTHON = Path(__file__).parents[2] / ".venv-mpi" / "bin" / "python"
STEPS = 5
SHARED = ("residuals", "assembly", "factorisation", "solves")
"""Kinds of work of which all ranks do their part."""
MEASURED = ("measures", "output")
"""Those of which all ranks do a part, and rank 0 the rest."""
SURFACE = 6.0
"""Unknowns on the surface of a part over the power 2/3 of those within: of a cube."""
BANDWIDTH = 1e9
"""B/s between two machines, of 10 Gb/s Ethernet."""


def case(layers: int) -> Case:
    """Return the straight vein of `ngfsi bench` with so many elements along it."""
    return CASES["vein"].replace(
        **{"geometry.mesh.axial_layers": layers, "time.end": STEPS * CASES["vein"].time.step, "solver.linear": "mumps"}
    )


SIZES = {layers: case(layers) for layers in (6, 12)}


@dataclass(frozen=True)
class Measured:
    """A run.

    Attributes:
        work: of each rank the seconds of the processor by kind of work, without waiting for other ranks but where
            PETSc does.
        memory: largest of each rank (MB).
    """

    layers: int
    ranks: int
    unknowns: int
    iterations: int
    work: list[dict[str, float]]
    memory: list[float]

    def slowest(self, kind: str) -> float:
        """Return the seconds of a kind of work on the rank that takes longest."""
        return max(of_rank.get(kind, 0.0) for of_rank in self.work)

    @property
    def measuring(self) -> float:
        """Seconds of measures and output, on the mean of the ranks other than 0, or on rank 0 if it is alone."""
        others = self.work[1:] or self.work
        return float(np.mean([sum(of_rank.get(kind, 0.0) for kind in MEASURED) for of_rank in others]))

    @property
    def alone(self) -> float:
        """Seconds of rank 0 alone, without the mesh; of one rank without measures and output."""
        first = self.work[0]
        of_measures = sum(first.get(kind, 0.0) for kind in MEASURED) - self.measuring
        kinds = set(first) - {*SHARED, *MEASURED, "mesh"}
        return sum(first[kind] for kind in kinds) + max(of_measures, 0.0)

    @property
    def total(self) -> float:
        """Seconds without the mesh."""
        return self.alone + self.measuring + sum(map(self.slowest, SHARED))


def measure(layers: int, ranks: int) -> Measured:
    """Run a size on some ranks, each with one thread.

    Raises:
        SolverError: the run failed; says why.
    """
    with TemporaryDirectory() as scratch:
        file, folder = Path(scratch) / "case.toml", Path(scratch) / "run"
        file.write_text(SIZES[layers].to_toml(), encoding="utf-8")
        launch = ["mpirun", "--allow-run-as-root", "--oversubscribe", "-np", str(ranks), str(PYTHON), "-m", "ngfsi.cli"]
        ended = subprocess.run(
            [*launch, "run", str(file), "--output", str(folder), "--quiet"], capture_output=True, text=True,
            check=False, env=os.environ | threads(1),
        )  # fmt: skip
        if ended.returncode:
            raise SolverError(f"the run on {ranks} ranks failed: {ended.stderr.strip()}")
        run = open_run(folder)
        iterations = int(np.sum(run.costs["iterations"]))
        of_ranks = run.manifest["work_of_ranks"]
        return Measured(layers, ranks, run.manifest["unknowns"], iterations, [one["cpu_s"] for one in of_ranks],
                        [one["peak_memory_MB"] for one in of_ranks])  # fmt: skip


class Model:
    """Seconds of each kind of work as c N^a / P^b of unknowns and ranks, and the traffic between them."""

    def __init__(self, runs: Sequence[Measured]) -> None:
        """Fit by least squares of the logarithms; what rank 0 does alone has b = 0, and none has b < 0 or b > 1."""
        self._iterations = float(np.mean([run.iterations for run in runs]))
        self.powers = {name: self._fit(runs, [run.slowest(name) for run in runs]) for name in SHARED}
        self.powers["measures, output"] = self._fit(runs, [run.measuring for run in runs])
        several = [run for run in runs if run.ranks > 1]
        self.powers["rank 0 alone"] = (*self._fit(several, [run.alone for run in several])[:2], 0.0)

    @staticmethod
    def _fit(runs: Sequence[Measured], seconds: Sequence[float]) -> tuple[float, float, float]:
        ranks = [log(run.ranks) for run in runs]
        columns = np.column_stack([np.ones(len(runs)), [log(run.unknowns) for run in runs], ranks])
        if not any(ranks):
            columns = columns[:, :2]
        found = np.linalg.lstsq(columns, np.log(seconds), rcond=None)[0]
        return float(found[0]), float(found[1]), float(np.clip(-found[2], 0.0, 1.0)) if len(found) > 2 else 0.0

    def seconds(self, unknowns: float, ranks: int) -> dict[str, float]:
        """Return the estimated seconds by kind of work."""
        found = {
            name: float(np.exp(c) * unknowns**a / ranks**b) for name, (c, a, b) in self.powers.items()
        }  # fmt: skip
        # in an iteration the next state comes to all ranks, and in place of a residual and an update what ranks share
        values = unknowns + 2 * SURFACE * (unknowns / ranks) ** (2 / 3)
        found["traffic"] = self._iterations * 8 * values / BANDWIDTH if ranks > 1 else 0.0
        return found


def tables(runs: Sequence[Measured], unknowns: float = 1e6, many: Sequence[int] = (1, 2, 64, 1024)) -> str:
    """Return what was measured and what the model says, in Markdown."""
    rows = [
        [f"{run.unknowns:,}", str(run.ranks), *(f"{run.slowest(name):.2f}" for name in SHARED), f"{run.measuring:.2f}",
         f"{run.alone:.2f}", f"{run.total:.2f}", ", ".join(f"{memory:,.0f}" for memory in run.memory)]
        for run in runs
    ]  # fmt: skip
    head = ["unknowns", "ranks", *SHARED, "measures, output", "rank 0 alone", "sum", "MB"]
    measured = markdown_table(head, rows)
    model = Model(runs)
    powers = [[name, f"{a:.2f}", f"{b:.2f}"] for name, (_, a, b) in model.powers.items()]
    fitted = markdown_table(["work", "power of unknowns", "power of 1 / ranks"], powers)
    kinds = list(model.seconds(unknowns, 1))
    estimates = {ranks: model.seconds(unknowns, ranks) for ranks in many}
    said = [[str(p), *(f"{e[kind]:.0f}" for kind in kinds), f"{sum(e.values()):.0f}"] for p, e in estimates.items()]
    return "\n".join([measured, fitted, markdown_table(["ranks", *kinds, "sum"], said)])


def main() -> None:
    """Measure, store and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("output", type=Path)
    parser.add_argument("--ranks", type=int, nargs="+", default=[1, 2])
    chosen = parser.parse_args()
    runs = [measure(layers, ranks) for layers in SIZES for ranks in chosen.ranks]
    replace_file(chosen.output, (json.dumps([asdict(run) for run in runs], indent=1) + "\n").encode())
    print(tables(runs))


if __name__ == "__main__":
    main()
