"""Numerical errors of a level of compare_tissues.py, measured against its level `fine` and kept in docs/accuracy.toml.

    python -m studies.tissue_accuracy LEVEL FOLDER FINE_FOLDER

The folders are those of the studies, e.g. runs/compare_tissues-demo and runs/compare_tissues-fine.
"""

from __future__ import annotations

import sys
import tomllib
from pathlib import Path

import numpy as np
import tomli_w

from ngfsi.output.stored import StoredRun, open_run
from studies.compare_tissues import MAIN
from studies.tissue_findings import ACCURACY, SAME_TIME


def measure(level: str, folder: Path, fine_folder: Path, target: Path = ACCURACY) -> dict[str, float]:
    """Write the largest errors of the main runs of a level [%] to a TOML file and return them."""
    errors = [compare(open_run(folder / key), open_run(fine_folder / key)) for key in MAIN]
    worst = {name: float(f"{max(error[name] for error in errors):.2g}") for name in errors[0]}
    known = tomllib.loads(target.read_text(encoding="utf-8")) if target.exists() else {}
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text(tomli_w.dumps({**known, level: worst}), encoding="utf-8")
    return worst


def compare(coarse: StoredRun, fine: StoredRun) -> dict[str, float]:
    """Return by how many percent volume and SAWSS differ from a finer run, at the end of the ramp and at most."""
    errors: dict[str, float] = {}
    times = coarse.series["time_s"]
    row = int(np.searchsorted(times, max(coarse.case.loads.skin_pressure.breakpoints) + SAME_TIME)) - 1
    for name, column in (("volume", "lumen_volume_m3"), ("sawss", "sawss_Pa")):
        exact = np.interp(times, fine.series["time_s"], fine.series[column])
        error = 100 * abs(coarse.series[column] / exact - 1)
        errors |= {f"{name}_percent": float(error[row]), f"{name}_percent_at_most": float(error.max())}
    return errors


if __name__ == "__main__":
    for name, value in measure(sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3])).items():
        print(f"{name} {value:g}")
