"""RunFolder: writes the folder of a run, so that whatever happens what was computed so far can be read.

    case.toml       the case with every value resolved; `ngfsi run case.toml` repeats the run
    manifest.json   status, versions, commit, machine, mesh, unknowns, timings
    series.csv      one row of quantities per step, SI units in the column names, `_1` for pure numbers
    costs.csv       iterations, factorisations and seconds of each step: what differs between two equal runs
    outlines.csv    cross-sections of the deformed lumen
    shape.csv       their area, perimeter, axes ... perpendicular to the vein (see measure/shape.py)
    volume.pvd, wall.pvd, fields/   fields for ParaView (see fields.py)
    run.log         what happened, with the seconds since the start

`open_run` (stored.py) reads it.
"""

from __future__ import annotations

import json
import os
import time
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

from ngfsi.case import Case
from ngfsi.errors import OutputError
from ngfsi.output.provenance import commit, machine, now, versions
from ngfsi.output.table import TableWriter, explained

CASE, MANIFEST, LOG = "case.toml", "manifest.json", "run.log"
SERIES, COSTS, OUTLINES, SHAPE = "series.csv", "costs.csv", "outlines.csv", "shape.csv"

Status = Literal["running", "completed", "failed", "interrupted"]


class RunFolder:
    """The folder of a run while it is computed.

    Attributes:
        path: the folder.
    """

    def __init__(self, path: Path, manifest: dict[str, Any]) -> None:
        self.path = path
        self._manifest = manifest
        self._start = time.perf_counter()
        self._series = TableWriter(path / SERIES)
        self._costs = TableWriter(path / COSTS)
        self._outlines = TableWriter(path / OUTLINES)
        self._shape = TableWriter(path / SHAPE)

    @classmethod
    def create(cls, path: Path, case: Case) -> Self:
        """Make the folder (and its parents) with the resolved case and a manifest of status "running".

        Raises:
            OutputError: the folder is not empty or cannot be made or written.
        """
        if path.is_dir() and any(path.iterdir()):
            holds = "holds a run" if (path / MANIFEST).exists() else "is not empty"
            raise OutputError(f"the folder '{path}' already {holds}: name another one with --output, or remove it")
        if path.exists() and not path.is_dir():
            raise OutputError(f"'{path}' is a file where the folder of the run should be: name another with --output")
        with explained(path, "made"):
            path.mkdir(parents=True, exist_ok=True)
        with explained(path / CASE):
            (path / CASE).write_text(case.to_toml(), encoding="utf-8")
        folder = cls(path, {"case": case.name, "case_digest": case.digest})
        folder.update_manifest(status="running", started=now(), versions=versions(), commit=commit(), machine=machine())
        return folder

    def record(self, row: dict[str, float]) -> None:
        """Append a row of quantities at one time to series.csv and wait until it is on the disk."""
        self._series.append(row)

    def record_cost(self, row: dict[str, float]) -> None:
        """Append a row of effort for one step to costs.csv."""
        self._costs.append(row)

    def record_outlines(self, time: float, rings: NDArray[np.float64]) -> None:
        """Append cross-sections at one time to outlines.csv.

        Args:
            time: s
            rings: points (stations, points, 3) [m] around each cross-section, in order.
        """
        rows: list[dict[str, float]] = []
        for (station, point), (x, y, z) in zip(np.ndindex(rings.shape[:2]), rings.reshape(-1, 3), strict=True):
            rows.append({"time_s": time, "station": station, "point": point, "x_m": x, "y_m": y, "z_m": z})
        self._outlines.append(*rows)

    def record_shape(self, rows: list[dict[str, float]]) -> None:
        """Append the shapes of cross-sections at one time to shape.csv."""
        self._shape.append(*rows)

    def log(self, text: str) -> None:
        """Append a line to run.log, with the seconds since the start."""
        with explained(self.path / LOG), (self.path / LOG).open("a", encoding="utf-8") as file:
            file.write(f"[{time.perf_counter() - self._start:9.2f} s] {text}\n")

    def update_manifest(self, **entries: Any) -> None:
        """Set entries of the manifest (tables are merged) and replace the file in one step."""
        for key, value in entries.items():
            old = self._manifest.get(key)
            self._manifest[key] = {**old, **value} if isinstance(old, dict) and isinstance(value, dict) else value
        target = self.path / MANIFEST
        partial = target.with_suffix(".json.part")
        text = json.dumps(self._manifest, indent=2, default=_plain) + "\n"
        with explained(target), partial.open("w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
            partial.replace(target)

    def finish(self, status: Literal["completed", "failed", "interrupted"], reason: str = "") -> None:
        """Note in manifest and log how the run ended."""
        elapsed = time.perf_counter() - self._start
        self.update_manifest(status=status, reason=reason, ended=now(), elapsed_s=elapsed)
        self.log(f"{status}: {reason}" if reason else status)


def _plain(value: Any) -> Any:
    """Return NumPy's scalars and arrays as what JSON knows."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} cannot be written to {MANIFEST}")
