"""A run that is killed again and again at random moments, resumed each time, and held against one that was not.

    python -m tests.soak PAGE [KILLS]

Writes what happened to PAGE and fails when a resume fails, or a number of the run's results differs. The moments are
seeded; where in the work they fall depends on the machine. At most half an hour.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic, sleep

import numpy as np

from ngfsi.output.provenance import now, versions
from tests.test_resume import CASE, assert_same

LONGER = CASE.replace(**{"time.step": 0.01, "time.end": 1.0, "output.fields_every": 10, "output.checkpoint_every": 5})
LIMIT = 1800.0
"""Seconds within which all is over."""


def start(*arguments: str) -> subprocess.Popen[str]:
    environment = os.environ | dict.fromkeys(("NGS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"), "1")
    command = [sys.executable, "-m", "ngfsi.cli", *arguments, "--quiet"]
    return subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True)


def where(folder: Path) -> str:
    """Say how far a run was when it was killed."""
    if not (folder / "series.csv").exists():
        return "before the first step"
    return "while a checkpoint was written" if list(folder.glob("checkpoints/*.part")) else "between the steps"


def kill_until_done(case: Path, folder: Path, most: int, longest: float, rng: np.random.Generator) -> list[str]:
    """Run a case in a folder, killed at most so often within `longest` seconds each; return where it was then."""
    places: list[str] = []
    while True:
        resumed = (folder / "manifest.json").exists()
        process = start("resume", str(folder)) if resumed else start("run", str(case), "--output", str(folder))
        if len(places) < most:
            while not (folder / "manifest.json").exists() and process.poll() is None:
                sleep(0.01)
            sleep(rng.uniform(0.0, longest))
            process.kill()
        said = process.communicate(timeout=LIMIT)[1]
        if process.returncode == 0:
            return places
        if process.returncode != -signal.SIGKILL:
            raise SystemExit(f"a run failed after {len(places)} kills with exit code {process.returncode}: {said}")
        places.append(where(folder))


def soak(page: Path, kills: int) -> None:
    """Kill, resume, compare and write the page."""
    began, rng = monotonic(), np.random.default_rng(20)
    places: list[str] = []
    runs = 0
    with TemporaryDirectory(prefix="ngfsi-soak-") as scratch:
        case, whole = Path(scratch) / "case.toml", Path(scratch) / "whole"
        case.write_text(LONGER.to_toml())
        kill_until_done(case, whole, 0, 0.0, rng)
        took = monotonic() - began
        while len(places) < kills and monotonic() - began < LIMIT - 2 * took:
            folder = Path(scratch) / f"killed{runs}"
            places += kill_until_done(case, folder, kills - len(places), took / 2, rng)
            assert_same(folder, whole)
            runs += 1
    counts = ", ".join(f"{places.count(place)} {place}" for place in dict.fromkeys(places))
    lines = [
        "# A run that was killed again and again\n",
        f"Written by `make soak` on {now()}, in {monotonic() - began:.0f} s, with ngfsi {versions()['ngfsi']} and "
        f"NGSolve {versions()['ngsolve']}.\n",
        f"{runs} runs of {LONGER.time.steps} steps were killed with SIGKILL {len(places)} times at random moments "
        f"(seed 20) and resumed each time: {counts}. Series, cross-sections, fields and the counts of iterations and "
        "factorisations are those of the run that was never killed, to the last bit.",
    ]
    page.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    soak(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 20)
