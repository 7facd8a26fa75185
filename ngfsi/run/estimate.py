"""Errors of a finished run from space and from time apart.

From space: the states at the start and at the end are solved for again in elements of one order more on the same mesh
(finer.py), with the rates that they have. The estimate is `MORE` times what changes. Where that cannot be, a companion
with elements of one order less (of order 3 where the run's is 2, the lowest) is computed, and the difference is taken.

From time: a companion has steps of double size, and the tolerance of their error that belongs to it. The difference is
divided by 2^(p/2) - 1 for a scheme of order p, if that is more than 1. Where it has reached its order the run's error
is smaller, the difference over 2^p - 1; where waves after a kink are not resolved it is about the difference itself:
that is between (docs/theory.md, "Estimated errors").
"""

from __future__ import annotations

from typing import Any, TypeAlias

import ngsolve as ng
import numpy as np

from ngfsi.arrays import Array
from ngfsi.case import Case
from ngfsi.errors import CaseError, MeshError, OutputError, SolverError
from ngfsi.measure.probe import Probe
from ngfsi.measure.quantities import columns as columns_of
from ngfsi.mesh.domain import Domain
from ngfsi.run.computation import finished, fitting_backend
from ngfsi.run.finer import Finer, has_finer
from ngfsi.run.interrupts import time_left
from ngfsi.solve.initial import Say, initial_state, silent
from ngfsi.solve.newton import Newton
from ngfsi.store.folder import ERRORS
from ngfsi.store.stored import StoredRun
from ngfsi.store.table import write_rows
from ngfsi.system.schemes import STAGES
from ngfsi.system.system import System
from ngfsi.units import SAME_TIME, unit_of

LOSSES = {"lumen_volume_m3": "loss of volume", "lumen_area_m2": "loss of area"}
QUANTITIES = LOSSES | {"sawss_Pa": "SAWSS", "wss_max_Pa": "largest wall shear stress"}
"""Ends of the columns whose errors are estimated, of each vessel; volume and area of plane sections as their losses."""
TIMES_TOLERANCE = 8.0
"""Factor on the tolerance of the error of a step, of third order, whose size is doubled."""
MORE = 2.0
"""Error over the change by one order more. It is 1 where errors fall fast with the order; where they fall with the
power 1.4 of it, as on even layers at clamped ends, it is 2.3 at order 2 and 3.0 at order 3."""
ORDERS = {"backward_euler": 1, "bdf2": 2, **{name: tableaus[0].order for name, tableaus in STAGES.items()}}
"""Of the errors of the time schemes."""
WHEN = ("end", "largest")
Errors: TypeAlias = dict[tuple[str, str], float]
"""By column and one of `WHEN`, relative."""
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
    """Estimate the errors of a run, compute its companions in its folder, write errors.csv there, and return its rows.

    Each row has a quantity, its `value` at the end and the suffix of its `unit` (SI), and from space and from time the
    error at the `end`, over the largest loss or the mean of the shear in time; of companions also the `largest` one at
    the times that both have. A companion that is there already is taken, or goes on; what fails leaves its columns out.

    Args:
        max_wall: seconds on the clock within which to stop.
        say: takes the reasons of what fails.
        resumed_by: the command that goes on; default: `ngfsi resume FOLDER --error`.

    Raises:
        OutputError: the run has no vessel, or no error could be estimated.
        StoppedError, Interrupted: as of `run`; to be gone on with by the same call.
    """
    left = time_left(max_wall)
    if not _columns(found):
        raise OutputError(f"the run '{found.case.name}' has none of {', '.join(QUANTITIES)}: no error can be estimated")
    errors, failures = dict[str, Errors](), list[str]()
    command = resumed_by or f"ngfsi resume {found.path} --error"

    def compared(name: str, over: float = 1.0) -> Errors:
        return differences(found, companion(found, name, quiet=quiet, max_wall=left(), resumed_by=command), over)

    for name in reversed(companions(found.case)):  # what can be gone on with comes first
        try:
            if name == "time":
                errors[name] = compared(name, surplus(found.case.time.scheme))
            else:
                changes = _changes(found)
                errors[name] = {key: MORE * value for key, value in changes.items()} or compared(name)
        except (CaseError, MeshError, OutputError, SolverError) as error:
            failures.append(f"no error from {name}: {error}")
    if not errors:
        raise OutputError("; ".join(failures))
    for failure in failures:
        say(failure)
    rows = [
        _row(column, found) | {f"{name}_{when}_1": errors[name][column, when] for name in companions(found.case)
                               for when in WHEN if (column, when) in errors.get(name, {})}
        for column in _columns(found)
    ]  # fmt: skip
    write_rows(found.path / ERRORS, rows)
    return rows


def companion(found: StoredRun, name: str, **how: Any) -> StoredRun:
    """Return a companion of a run, one of `companions`, in the run's folder; `how` as of `run`."""
    return finished(companions(found.case)[name], found.path / f"companion_{name}", **how)


def at_end(found: StoredRun) -> list[dict[str, float | str]]:
    """Return the rows of `estimate` without errors: quantity, value at the end and unit; none without blood."""
    return [_row(column, found) for column in _columns(found)]


def _columns(found: StoredRun) -> list[str]:
    return [name for name in found.series if name.endswith(tuple(QUANTITIES))]


def _row(column: str, found: StoredRun) -> dict[str, float | str]:
    unit = "1" if _is_loss(column) else unit_of(column)
    return {"quantity": _title(column), "value": float(_shown(column, found)[-1]), "unit": unit}


def _changes(found: StoredRun) -> Errors:
    """Return what changes at the end in elements of one order more; nothing where there is no such state."""
    columns, end, case = _columns(found), found.case.time.end, found.case
    with ng.TaskManager():
        domain = Domain.build(case.geometry)
        system = System(case, domain)
        if not has_finer(system):
            return {}
        at_end = found.end(domain.fingerprint)
        finer = Finer(system)
        probe = Probe(finer.system)
        measures = columns_of(probe)

        def measured(time: float) -> dict[str, float]:
            finer.take(time)
            probe.refresh()
            return {column: measures[column]() for column in columns}

        initial_state(system, Newton(system, fitting_backend(system)[0], *system.unknowns.to_solve))
        first = measured(0.0)
        system.restore(at_end)
        last = measured(end)
    values = {column: 1 - last[column] / first[column] if _is_loss(column) else last[column] for column in columns}
    return {(column, "end"): abs(_shown(column, found)[-1] - value) / _size(column, found)
            for column, value in values.items()}  # fmt: skip


def surplus(scheme: str) -> float:
    """Return by what the difference to steps of double size is divided, in a time scheme."""
    return max(1.0, 2 ** (ORDERS[scheme] / 2) - 1)


def differences(found: StoredRun, other: StoredRun, over: float = 1.0) -> Errors:
    """Return the differences of a run and its companion, divided by a number."""
    errors: Errors = {}
    for column in _columns(found):
        here, there = _common(found.series["time_s"], other.series["time_s"], found.case.time.step)
        apart = np.abs(_shown(column, found)[here] - _shown(column, other)[there]) / _size(column, found) / over
        errors |= {(column, "end"): float(apart[-1]), (column, "largest"): float(apart.max())}
    return errors


def _is_loss(column: str) -> bool:
    return column.endswith(tuple(LOSSES))


def _size(column: str, found: StoredRun) -> float:
    """Return what errors are relative to: the largest loss, or the mean of the shear in time."""
    values = _shown(column, found)
    return float(np.max(np.abs(values)) if _is_loss(column) else np.mean(values))


def _shown(column: str, found: StoredRun) -> Array:
    """Return a column, of a volume or an area the part that is lost since t = 0."""
    values = np.asarray(found.series[column])
    return 1 - values / values[0] if _is_loss(column) else values


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
