"""How many runs at a time, with how many threads each, finish most runs on this machine.

Equal runs of the short straight vein of `ngfsi bench`, computed anew for each split of the processors.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping
from pathlib import Path
from time import perf_counter

from ngfsi.case import Case
from ngfsi.errors import SolverError
from ngfsi.report.tables import markdown_table
from ngfsi.store.disk import replace_file
from ngfsi.store.provenance import versions
from ngfsi.study import run_cases
from ngfsi_studies.speed import CASES

STEPS = {"demo": 3, "paper": 20, "fine": 20}
"""Of each run."""

Split = tuple[int, int]
"""Processes side by side, and threads of each."""


def splits(processors: int) -> list[Split]:
    """Return the ways to share out the processors without rest, the fewest processes first."""
    return [(n, processors // n) for n in range(1, processors + 1) if processors % n == 0]


def study(level: str, folder: Path, quiet: bool = False) -> Path:
    """Measure every split and return the report's path.

    Raises:
        OutputError: the folder cannot be written.
        SolverError: a run failed, so that its seconds mean nothing.
    """
    vein = CASES["vein"]
    case = vein.replace(**{"time.end": STEPS[level] * vein.time.step})
    processors = os.cpu_count() or 1
    # as many runs as fill each split evenly, twice
    cases = {f"run{number}": case for number in range(2 * processors)}
    seconds = {split: measured(cases, folder / "runs", split[0], quiet=quiet) for split in splits(processors)}
    page = folder / "report.md"
    replace_file(page, report(seconds, len(cases)).encode())
    return page


def measured(cases: Mapping[str, Case], folder: Path, processes: int, *, quiet: bool) -> float:
    """Return the seconds that the cases take, so many at a time; nothing is kept."""
    began = perf_counter()
    outcomes = run_cases(cases, folder, processes=processes, quiet=quiet)
    took = perf_counter() - began
    shutil.rmtree(folder)
    if failed := [outcome.failure for outcome in outcomes.values() if outcome.failure]:
        raise SolverError(f"with {processes} processes a run failed: {failed[0]}")
    return took


def report(seconds: Mapping[Split, float], runs: int) -> str:
    """Return the page."""
    best = min(seconds.values())
    rows = [[str(n), str(t), f"{took:.0f}", f"{took / best:.2f}"] for (n, t), took in seconds.items()]
    programs = ", ".join(f"{name} {version}" for name, version in versions().items() if name in ("ngfsi", "ngsolve"))
    return "\n".join(
        (
            f"# {runs} equal runs on {max(n * t for n, t in seconds)} processors\n",
            markdown_table(["processes", "threads each", "seconds in all", "of the best"], rows),
            f"Measured by `ngfsi study splits`, {programs}. Other work on the machine falsifies it.\n",
        )
    )
