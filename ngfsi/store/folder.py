"""RunFolder: writes the folder of a run, so that whatever happens what was computed so far can be read.

    case.toml       the case with every value resolved; `ngfsi run case.toml` repeats the run
    manifest.json   status, versions, commit, machine, mesh, unknowns, timings
    series.csv      one row of quantities per step, SI units in the column names, `_1` for pure numbers
    costs.csv       iterations, factorisations and seconds of each step: what differs between two equal runs
    outlines.csv    cross-sections of the deformed lumen; of several vessels with their number in a column `vessel`, of
                    branched ones with that of the centreline in a column `branch`
    shape.csv       their area, perimeter, axes ... perpendicular to the vein (see measure/shape.py)
    stability.csv   smallest eigenvalue and critical pressure, if asked for (see measure/stability.py)
    volume.pvd, wall.pvd, fields/   fields for ParaView (see fields.py)
    errors.csv      estimated errors, if asked for, and the runs that tell them: companion_time/, companion_space/
    end.npz         the state at the end of a run that is complete, and the fingerprint of its mesh
    refined_1/ ...  the same case on refined meshes, and refined_1.msh ... where they are in files, if asked for
    run.log         what happened, with the seconds since the start
    checkpoints/    from which `ngfsi resume` goes on (see checkpoint.py), until the run is complete
    STOP            not written: a file of this name ends the run after the step under way

`open_run` (stored.py) reads it.
"""

from __future__ import annotations

import fcntl
import json
import time
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from typing import IO, Any, Literal, Self

import numpy as np

from ngfsi.arrays import Array
from ngfsi.case import Case
from ngfsi.errors import OutputError
from ngfsi.store.disk import explained, replace_file
from ngfsi.store.provenance import commit, machine, now, versions
from ngfsi.store.table import TableWriter

CASE, MANIFEST, LOG, ERRORS = "case.toml", "manifest.json", "run.log", "errors.csv"
END, MESH = "end.npz", "mesh"
TABLES = ("series", "costs", "outlines", "shape", "stability")
"""Tables with a column time_s, each a file NAME.csv that is there once it has a row."""
CHECKPOINTS, STOP = "checkpoints", "STOP"

Status = Literal["running", "completed", "failed", "interrupted"]


class RunFolder:
    """The folder of a run while it is computed."""

    def __init__(self, path: Path, manifest: dict[str, Any]) -> None:
        self.path = path
        self._manifest = manifest
        self._log = _locked(path)
        self._start = time.perf_counter()
        self._tables = {name: TableWriter(path / f"{name}.csv") for name in TABLES}

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
        replace_file(path / CASE, case.to_toml().encode())
        folder = cls(path, {})
        folder._begin(case)
        return folder

    @classmethod
    def reopen(cls, path: Path, case: Case, until: float | None) -> Self:
        """Return the folder of an unfinished run of the case, to go on after time `until` (s); later rows are removed.

        Args:
            until: None: nothing is to be kept, and the run begins anew.

        Raises:
            OutputError: another process writes there, or a file cannot be read or written.
        """
        folder = cls(path, _manifest_in(path))
        (path / STOP).unlink(missing_ok=True)
        if until is None:
            folder._begin(case)
        last = -np.inf if until is None else until
        folder._tables = {name: TableWriter.continued(path / f"{name}.csv", last) for name in TABLES}
        again = {"at": now(), "from_s": until, "versions": versions(), "commit": commit()}
        folder.update_manifest(status="running", reason="", resumed=[*folder._manifest.get("resumed", []), again])
        return folder

    def _begin(self, case: Case) -> None:
        self._manifest |= {"case": case.name, "case_digest": case.digest}
        self.update_manifest(status="running", started=now(), versions=versions(), commit=commit(), machine=machine())

    def append(self, table: str, *rows: Mapping[str, float]) -> None:
        """Append rows to one of the `TABLES` and wait until they are on the disk.

        Raises:
            ValueError: a row has other columns than the first one.
            OutputError: the file cannot be written.
        """
        self._tables[table].append(*rows)

    def write_end(self, state: Mapping[str, Array], mesh: str) -> None:
        """Keep the state at the end, named arrays that belong to the mesh of a fingerprint.

        Raises:
            OutputError: the file cannot be written.
        """
        packed = BytesIO()
        np.savez(packed, **state, **{MESH: np.array(mesh)})  # type: ignore[arg-type] # of mypy's view of **
        replace_file(self.path / END, packed.getvalue())

    def log(self, text: str) -> None:
        """Append a line to run.log, with the seconds since the start."""
        with explained(self.path / LOG):
            self._log.write(f"[{time.perf_counter() - self._start:9.2f} s] {text}\n")
            self._log.flush()

    def update_manifest(self, **entries: Any) -> None:
        """Set entries of the manifest (tables are merged) and replace the file in one step."""
        for key, value in entries.items():
            old = self._manifest.get(key)
            self._manifest[key] = {**old, **value} if isinstance(old, dict) and isinstance(value, dict) else value
        text = json.dumps(self._manifest, indent=2, default=_plain) + "\n"
        replace_file(self.path / MANIFEST, text.encode())

    def finish(self, status: Literal["completed", "failed", "interrupted"], reason: str = "") -> None:
        """Note in manifest and log how the run ended, and let others write here."""
        elapsed = self._manifest.get("elapsed_s", 0.0) + time.perf_counter() - self._start
        self.update_manifest(status=status, reason=reason, ended=now(), elapsed_s=elapsed)
        self.log(f"{status}: {reason}" if reason else status)
        self._log.close()


def outline_rows(of: Mapping[str, float], rings: Array) -> list[dict[str, float]]:
    """Return the rows of outlines.csv for points (stations, points, 3) [m] around cross-sections, in order, each row
    beginning with the columns `of`."""
    return [
        {**of, "station": station, "point": point, "x_m": x, "y_m": y, "z_m": z}
        for (station, point), (x, y, z) in zip(np.ndindex(rings.shape[:2]), rings.reshape(-1, 3), strict=True)
    ]


def _locked(path: Path) -> IO[str]:
    """Return the log of a run, open; the system frees its lock when the process ends, however it does.

    Raises:
        OutputError: another process holds the lock.
    """
    with explained(path / LOG, "opened"):
        log = (path / LOG).open("a", encoding="utf-8")
    try:
        fcntl.flock(log, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        log.close()
        raise OutputError(f"the run in '{path}' is being computed by another process: wait for it to end") from None
    except OSError:  # a file system without locks
        pass
    return log


def _manifest_in(path: Path) -> dict[str, Any]:
    """Return the manifest in a folder; empty when there is none that can be read."""
    try:
        found = json.loads((path / MANIFEST).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def _plain(value: Any) -> Any:
    """Return NumPy's scalars and arrays as what JSON knows."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} cannot be written to {MANIFEST}")
