"""A run that is killed again and again at random moments, resumed each time, and held against one that was not.

    python -m tests.soak PAGE [KILLS]

Writes what happened to PAGE and fails when a resume fails, or a number of the run's results differs. The moments are
seeded: by the clock, where they fall in the work depends on the machine; or counted in the work itself, so that they
fall within the solution of a step, or before a file is on the disk. At most half an hour.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic, sleep
from typing import Any

import numpy as np

from ngfsi import cli
from ngfsi.parallel.ranks import threads
from ngfsi.solve.time_loop import TimeLoop
from ngfsi.store.provenance import now, versions
from ngfsi.system.system import System
from tests.test_resume import CASE, assert_same, counted_on_disk, dying

LONGER = CASE.replace(**{"time.step": 0.01, "time.end": 1.0, "output.fields_every": 10, "output.checkpoint_every": 5})
LIMIT = 1800.0
"""Seconds within which all is over."""


MOMENTS = {"by the clock": 0, "within the solution of a step": 200, "before a file is on the disk": 100}
"""Kind of moment -> largest count of what is counted for it: residuals of the steps; syncs and renames."""


def counted_in_steps(count: int) -> None:
    """Let this process end before it evaluates the so-manieth residual of its steps."""
    attempt, residual = TimeLoop._attempt, System.residual
    deadly = dying(iter(range(count, -1, -1)), residual)

    def watched(self: TimeLoop, time: float, size: float) -> Any:
        System.residual = deadly  # type: ignore[method-assign]
        try:
            return attempt(self, time, size)
        finally:
            System.residual = residual  # type: ignore[method-assign]

    TimeLoop._attempt = watched  # type: ignore[method-assign]


def start(moment: str, count: int, *arguments: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "tests.soak", "--doomed", moment, str(count), *arguments, "--quiet"]
    return subprocess.Popen(command, env=os.environ | threads(1), stderr=subprocess.PIPE, text=True)


def kill_until_done(case: Path, folder: Path, most: int, longest: float, rng: np.random.Generator) -> list[str]:
    """Run a case in a folder, killed so often, by the clock within `longest` seconds; return at what moments."""
    moments: list[str] = []
    while True:
        resumed = (folder / "manifest.json").exists()
        moment = str(rng.choice(list(MOMENTS))) if len(moments) < most else ""
        count = int(rng.integers(1, MOMENTS.get(moment, 0) or 2))
        what = ("resume", str(folder)) if resumed else ("run", str(case), "--output", str(folder))
        process = start(moment, count, *what)
        if moment == "by the clock":
            while not (folder / "manifest.json").exists() and process.poll() is None:
                sleep(0.01)
            sleep(rng.uniform(0.0, longest))
            process.kill()
        said = process.communicate(timeout=LIMIT)[1]
        if process.returncode == 0:
            return moments
        if process.returncode != -signal.SIGKILL:
            raise SystemExit(f"a run failed after {len(moments)} kills with exit code {process.returncode}: {said}")
        moments.append(moment)


def soak(page: Path, kills: int) -> None:
    """Kill, resume, compare and write the page."""
    began, rng = monotonic(), np.random.default_rng(20)
    moments: list[str] = []
    runs = 0
    with TemporaryDirectory(prefix="ngfsi-soak-") as scratch:
        case, whole = Path(scratch) / "case.toml", Path(scratch) / "whole"
        case.write_text(LONGER.to_toml())
        kill_until_done(case, whole, 0, 0.0, rng)
        took = monotonic() - began
        while len(moments) < kills and monotonic() - began < LIMIT - 2 * took:
            folder = Path(scratch) / f"killed{runs}"
            moments += kill_until_done(case, folder, kills - len(moments), took / 2, rng)
            assert_same(folder, whole)
            runs += 1
    counts = ", ".join(f"{moments.count(moment)} {moment}" for moment in MOMENTS)
    lines = [
        "# A run that was killed again and again\n",
        f"Written by `make soak` on {now()}, in {monotonic() - began:.0f} s, with ngfsi {versions()['ngfsi']} and "
        f"NGSolve {versions()['ngsolve']}.\n",
        f"{runs} runs of {LONGER.time.steps} steps were killed with SIGKILL {len(moments)} times at random moments "
        f"(seed 20) and resumed each time: {counts}. Series, cross-sections, fields and the counts of iterations and "
        "factorisations are those of the run that was never killed, to the last bit.",
    ]
    page.write_text("\n".join(lines) + "\n", encoding="utf-8")


def doomed(moment: str, count: int, arguments: list[str]) -> None:
    """Do what the command line would, and be killed at a moment, if it comes."""
    if moment == "within the solution of a step":
        counted_in_steps(count)
    elif moment == "before a file is on the disk":
        counted_on_disk(count)
    cli.main(arguments)


if __name__ == "__main__":
    if sys.argv[1] == "--doomed":
        doomed(sys.argv[2], int(sys.argv[3]), sys.argv[4:])
    else:
        soak(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 20)
