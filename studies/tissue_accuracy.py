"""Numerical errors of the levels of compare_tissues.py, measured by refinement and kept in docs/accuracy.toml.

    python -m studies.tissue_accuracy FOLDER

Space and time are refined one at a time, for M with K 28.45 kPa: the meshes of the levels against that of `fine`, all
with the step of `demo`; and the steps of the levels against half the step of `paper`, all on the mesh of `demo`. The
error of a level is the sum of both. Runs in the folder that are finished are reused.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import tomli_w

from ngfsi.errors import NgfsiError
from ngfsi.output.stored import StoredRun
from ngfsi.study import run_cases
from studies.compare_tissues import LEVELS, MAIN, case
from studies.tissue_findings import ACCURACY, SAME_TIME, mean_sawss

DEMO, PAPER, FINE = (LEVELS[name] for name in ("demo", "paper", "fine"))
RUNS = {
    "demo_mesh": DEMO,
    "paper_mesh": PAPER._replace(step=DEMO.step, end=DEMO.end),
    "fine_mesh": FINE._replace(step=DEMO.step, end=DEMO.end),
    "paper_step": DEMO._replace(step=PAPER.step, compile=True),
    "half_step": DEMO._replace(step=PAPER.step / 2, compile=True),
}
PAIRS = {
    "demo": {"space": ("demo_mesh", "fine_mesh"), "time": ("demo_mesh", "half_step")},
    "paper": {"space": ("paper_mesh", "fine_mesh"), "time": ("paper_step", "half_step")},
}
"""Level -> what is refined -> run and finer run."""


def measure(folder: Path, target: Path = ACCURACY) -> dict[str, dict[str, float]]:
    """Compute the runs, write the errors of the levels [%] to a TOML file and return them.

    Raises:
        NgfsiError: a run failed.
    """
    outcomes = run_cases({key: case(MAIN[0], level) for key, level in RUNS.items()}, folder)
    runs: dict[str, StoredRun] = {}
    for key, outcome in outcomes.items():
        if outcome.run is None or outcome.failure:
            raise NgfsiError(f"the run '{key}' in '{folder}' failed: {outcome.failure}")
        runs[key] = outcome.run
    errors = {level: _sum({what: _difference(runs[a], runs[b]) for what, (a, b) in pairs.items()})
              for level, pairs in PAIRS.items()}  # fmt: skip
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text(tomli_w.dumps(errors), encoding="utf-8")
    return errors


def _difference(run: StoredRun, finer: StoredRun) -> dict[str, float]:
    """Return by how many percent the results at the end of the ramp differ."""
    exact = _at_ramp_end(finer)
    return {name: 100 * abs(value / exact[name] - 1) for name, value in _at_ramp_end(run).items()}


def _at_ramp_end(run: StoredRun) -> dict[str, float]:
    end = max(run.case.loads.skin_pressure.breakpoints)
    row = int(np.searchsorted(run.series["time_s"], end + SAME_TIME)) - 1
    volume, sawss = (float(run.series[column][row]) for column in ("lumen_volume_m3", "sawss_Pa"))
    return {"volume": volume, "sawss": sawss, "mean_sawss": mean_sawss(run, end)}


def _sum(parts: Mapping[str, Mapping[str, float]]) -> dict[str, float]:
    """Return each error and its parts, to two digits."""
    names = next(iter(parts.values()))
    errors = {f"{name}_percent": sum(part[name] for part in parts.values()) for name in names}
    errors |= {f"{name}_{what}_percent": part[name] for what, part in parts.items() for name in names}
    return {name: float(f"{error:.2g}") for name, error in errors.items()}


if __name__ == "__main__":
    for level, errors in measure(Path(sys.argv[1])).items():
        print(level, *(f"{name} {error:g}" for name, error in errors.items()), sep="\n  ")
