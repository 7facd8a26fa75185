"""Errors of a finished run from space and from time apart, each estimated by a cheaper companion of it.

The companion in space has elements of one order less on the same mesh (of order 3 where the run's is 2, the lowest),
that in time steps of double size, and the tolerance of their error that belongs to it. The estimate is the difference
of the two runs, as it is: where both have reached their order the run's own error is smaller, by 2^p - 1 in time; where
waves after a kink or layers at clamped ends are not resolved it is about as large (docs/theory.md, "Estimated errors").
"""

from __future__ import annotations

from time import perf_counter
from typing import Any

import numpy as np

from ngfsi.arrays import Array
from ngfsi.case import Case
from ngfsi.errors import CaseError, MeshError, OutputError, SolverError
from ngfsi.run.computation import finished
from ngfsi.solve.initial import Say, silent
from ngfsi.store.folder import ERRORS
from ngfsi.store.stored import StoredRun
from ngfsi.store.table import write_rows
from ngfsi.units import SAME_TIME, unit_of

QUANTITIES = {"lumen_volume_m3": "loss of volume", "sawss_Pa": "SAWSS", "wss_max_Pa": "largest wall shear stress"}
"""Ends of the columns whose errors are estimated, of each vessel; the volume's as that of its loss."""
TIMES_TOLERANCE = 8.0
"""Factor on the tolerance of the error of a step, of third order, whose size is doubled."""
NO_OUTPUT = {"output.fields_every": 0, "output.wall_every": 1_000_000, "output.stability": False}


def companions(case: Case) -> dict[str, Case]:
    """Return the cases of the companions by what they tell: "space", and "time" unless there are no two steps of double
    size, or the run is static."""
    order, time = case.discretisation.order, case.time
    found = {"space": case.replace(**{"discretisation.order": order - 1 if order > 2 else order + 1, **NO_OUTPUT})}
    if time.scheme != "static" and 4 * time.step <= time.end * (1 + SAME_TIME):
        changes: dict[str, float] = {"time.step": 2 * time.step}
        if time.error_tolerance is not None:
            changes["time.error_tolerance"] = min(0.99, TIMES_TOLERANCE * time.error_tolerance)
        found["time"] = case.replace(**changes, **NO_OUTPUT)
    return found


def estimate(
    found: StoredRun, *, quiet: bool = False, max_wall: float | None = None, say: Say = silent, resumed_by: str = ""
) -> list[dict[str, float | str]]:
    """Run the companions of a run in its folder, write errors.csv there, and return its rows.

    Each row has a quantity, its `value` at the end and the suffix of its `unit` (SI), and for each companion the
    difference at the `end` and the `largest` one at the times that both have, over the largest loss or the mean of the
    shear in time. A companion that is there already is taken, or goes on; one that fails leaves its columns out.

    Args:
        max_wall: seconds on the clock within which to stop.
        say: takes the reasons of companions that fail.
        resumed_by: the command that goes on; default: `ngfsi resume FOLDER --error`.

    Raises:
        OutputError: the run has no vessel with blood, or no companion came to its end.
        StoppedError, Interrupted: as of `run`; to be gone on with by the same call.
    """
    began = perf_counter()
    columns = _columns(found)
    if not columns:
        raise OutputError(f"the run '{found.case.name}' has none of {', '.join(QUANTITIES)}: no error can be estimated")
    others, failures = {}, []
    command = resumed_by or f"ngfsi resume {found.path} --error"
    for name in companions(found.case):
        try:
            left = None if max_wall is None else max(0.0, max_wall - (perf_counter() - began))
            others[name] = companion(found, name, quiet=quiet, max_wall=left, resumed_by=command)
        except (CaseError, MeshError, SolverError) as error:
            failures.append(f"no error from {name}: {error}")
    if not others:
        raise OutputError("; ".join(failures))
    for failure in failures:
        say(failure)
    rows = [_row(column, found, others) for column in columns]
    write_rows(found.path / ERRORS, rows)
    return rows


def companion(found: StoredRun, name: str, **how: Any) -> StoredRun:
    """Return a companion of a run, one of `companions`, in the run's folder; `how` as of `run`."""
    return finished(companions(found.case)[name], found.path / f"companion_{name}", **how)


def at_end(found: StoredRun) -> list[dict[str, float | str]]:
    """Return the rows of `estimate` without errors: quantity, value at the end and unit; none without blood."""
    return [_row(column, found, {}) for column in _columns(found)]


def _columns(found: StoredRun) -> list[str]:
    return [name for name in found.series if name.endswith(tuple(QUANTITIES))]


def _row(column: str, found: StoredRun, others: dict[str, StoredRun]) -> dict[str, float | str]:
    values = _shown(column, found)
    lost = column.endswith("lumen_volume_m3")
    size = np.max(np.abs(values)) if lost else np.mean(values)
    row: dict[str, float | str] = {"quantity": _title(column), "value": float(values[-1]),
                                   "unit": "1" if lost else unit_of(column)}  # fmt: skip
    for name, other in others.items():
        here, there = _common(found.series["time_s"], other.series["time_s"], found.case.time.step)
        differences = np.abs(values[here] - _shown(column, other)[there]) / size
        row |= {f"{name}_end_1": float(differences[-1]), f"{name}_largest_1": float(differences.max())}
    return row


def _shown(column: str, found: StoredRun) -> Array:
    """Return a column, of a volume the part that is lost since t = 0."""
    values = np.asarray(found.series[column])
    return 1 - values / values[0] if column.endswith("lumen_volume_m3") else values


def _title(column: str) -> str:
    """Return what a column's error is of; columns of further vessels begin with their name."""
    end = next(one for one in QUANTITIES if column.endswith(one))
    vessel = column.removesuffix(end).strip("_")
    return f"{QUANTITIES[end]}{f', {vessel}' if vessel else ''}"


def _common(times: Array, others: Array, step: float) -> tuple[list[int], list[int]]:
    """Return the places of the times (s) that two runs have in common, in either."""
    pairs = [(int(np.argmin(np.abs(times - t))), j) for j, t in enumerate(others)]
    near = [(i, j) for i, j in pairs if abs(times[i] - others[j]) <= SAME_TIME * step]
    return [i for i, _ in near], [j for _, j in near]
