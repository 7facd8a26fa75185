"""Parameters of a case from values measured over time: runs as a model of `identify.least_squares`.

Slopes come from whichever takes less: one more run for each parameter, as forward differences, or one sweep of the
adjoint for each measured value. A sweep takes as long as 1.4 runs, and in a series of states at rest touches that of
its value alone: few values over time, or one at each of many pressures, and many parameters are the case for it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import MappingProxyType

import ngsolve as ng
import numpy as np

from ngfsi.arrays import Array
from ngfsi.case import Case
from ngfsi.config.columns import all_columns
from ngfsi.errors import CaseError, unknown
from ngfsi.gradient.adjoint import Adjoint, StoredStates, same_mesh
from ngfsi.gradient.parameters import Parameter, bounds_of, changed, parameters_of
from ngfsi.gradient.window import Window, wanted
from ngfsi.identify.least_squares import Fit, Unknown, fit
from ngfsi.mesh.domain import Domain
from ngfsi.solve.initial import Say, silent
from ngfsi.units import SAME_TIME, SI_SUFFIX, SUFFIXES, from_si

KINDS = ("change", "loss")
"""What may be made of a quantity, other than its value at the time."""
TIME, PRESSURE, HEIGHT, AREA, ERROR = "time", "skin_pressure", "height", "area", "_error"
SAME_PRESSURE = 1e-9
"""Relative difference of pressures that are one."""
SWEEP, PARAMETER = 1.4, 0.03
"""Runs that a sweep takes over all states, and each parameter more (docs/gradients.md)."""
FORWARD = 10
"""Step of differences of runs over that of residuals: 1e-4 of the parameter, for the runs are solved to 1e-9."""


@dataclass(frozen=True)
class Datum:
    """A measured value.

    Attributes:
        name: of its column.
        quantity, window: what it is of the run.
        value, error: with its standard error (SI), in the SI `unit`.
    """

    name: str
    quantity: str
    window: Window
    value: float
    error: float
    unit: str

    @property
    def time(self) -> float:
        """When it was measured (s)."""
        return self.window.end


def read_data(path: Path, case: Case) -> list[Datum]:
    """Return the measured values of a CSV file.

    Rows are of a `time`, or of a `skin_pressure`, for which the time is that when the case has it first. Columns are
    those of series.csv, or these with `_loss` or `_change` since the start, each with one of standard errors, as
    `area_z05_mm2` and `area_z05_error_mm2`; cells may be empty. With a column `height` the column `area` is that of
    the lumen at that height along the centreline.

    Raises:
        CaseError: a column is missing, an error is not positive, or a time or pressure is not in the run.
        OutputError: the file cannot be read.
    """
    columns = all_columns(path)
    when, found = _times(columns, case, path), []
    for name, (unit, values) in columns.items():
        if name in (TIME, PRESSURE, HEIGHT) or name.endswith(ERROR):
            continue
        of_error, errors = columns.get(f"{name}{ERROR}", ("", values))
        si = SI_SUFFIX[SUFFIXES[unit].dimension]
        if not of_error or SUFFIXES[of_error].dimension != SUFFIXES[unit].dimension:
            raise CaseError(f"'{path}': '{name}' has no standard errors: add a column {name}{ERROR}_{unit}")
        quantity, kind = wanted(name, KINDS)
        for row in np.flatnonzero(~np.isnan(values)):
            if not errors[row] > 0:
                raise CaseError(f"'{path}': the standard error of '{name}' in row {row + 1} is not above 0")
            here = quantity
            if HEIGHT in columns and quantity.endswith(AREA):
                here = f"{quantity}_at_{from_si(float(columns[HEIGHT][1][row]), 'mm'):.9g}mm"
            window = Window(kind, end=float(when[row]))
            found.append(Datum(here if kind == "end" else f"{here}_{kind}", here, window, float(values[row]),
                               float(errors[row]), si))  # fmt: skip
    if not found:
        raise CaseError(f"'{path}' holds no measured values")
    return found


def _times(columns: Mapping[str, tuple[str, Array]], case: Case, path: Path) -> Array:
    """Return the times of rows (s)."""
    for name, dimension in {TIME: "time", PRESSURE: "pressure", HEIGHT: "length"}.items():
        if name in columns and SUFFIXES[columns[name][0]].dimension != dimension:
            raise CaseError(f"'{path}': the column '{name}' has no unit of {dimension}")
    if (TIME in columns) == (PRESSURE in columns):
        raise CaseError(f"'{path}' needs one column, time_s or skin_pressure_mmHg, that says when rows were measured")
    times = columns[TIME][1] if TIME in columns else np.array([_time_of(p, case, path) for p in columns[PRESSURE][1]])
    if not len(times) or np.isnan(times).any() or times.min() < 0 or times.max() > case.time.end + SAME_TIME:
        raise CaseError(f"'{path}': each row needs a time within the run, from 0 to {case.time.end:g} s")
    return times


def _time_of(pressure: float, case: Case, path: Path) -> float:
    """Return the first time at which a case has a pressure on the skin, linear between its steps."""
    times = np.linspace(0.0, case.time.end, case.time.steps + 1)
    known = np.array([case.loads.skin_pressure(t) for t in times])
    if abs(known[0] - pressure) <= SAME_PRESSURE * np.abs(known).max():
        return 0.0
    for n in range(case.time.steps):
        low, high = sorted(known[n : n + 2])
        if low <= pressure <= high and high > low:
            return float(times[n] + (pressure - known[n]) / (known[n + 1] - known[n]) * (times[n + 1] - times[n]))
    raise CaseError(f"'{path}': the case has no pressure of {pressure:g} Pa on the skin: its steps have "
                    f"{known.min():g} to {known.max():g} Pa")  # fmt: skip


class Runs:
    """The measured values as a function of parameters of the case.

    Attributes:
        runs, sweeps: that it took.
    """

    def __init__(
        self, case: Case, parameters: Sequence[Parameter], data: Sequence[Datum], say: Say = silent,
        domain: Domain | None = None, folder: Path | None = None,
    ) -> None:  # fmt: skip
        """Prepare; `domain`: of the case, default: it is made; `folder`: as of `StoredStates`.

        Raises:
            CaseError: the case chooses its steps.
            MeshError: as for a run.
        """
        if case.time.error_tolerance is not None:
            raise CaseError("calibration compares runs with the same steps: leave time.error_tolerance out")
        self.case, self.parameters, self.data = case, tuple(parameters), tuple(data)
        self.domain = domain or Domain.build(case.geometry)
        self._say, self._folder = say, folder
        self._quantities = list(dict.fromkeys(one.quantity for one in data))
        self._last: tuple[Array, StoredStates, Array, list[Array]] | None = None
        self.runs = self.sweeps = 0

    def case_of(self, values: Array) -> Case:
        """Return the case with values of the parameters (SI)."""
        case = self.case
        for one, value in zip(self.parameters, values, strict=True):
            case = changed(case, one.path, float(value))
        return case

    def values(self, values: Array) -> Array:
        """Return what the run gives in place of the data.

        Raises:
            CaseError, MaterialError, SolverError: there is no such run.
        """
        if self._last is not None and np.array_equal(self._last[0], values):
            return self._last[2]
        found = self._run(values)
        self._last = (np.array(values), *found)
        words = ", ".join(f"{one.name} = {value:.6g}" for one, value in zip(self.parameters, values, strict=True))
        gaps = [(mine - one.value) / one.error for mine, one in zip(found[1], self.data, strict=True)]
        self._say(f"run {self.runs}: {words}: mean square of gaps over errors {np.mean(np.square(gaps)):.4g}")
        return found[1]

    def _run(self, values: Array, beside: Domain | None = None) -> tuple[StoredStates, Array, list[Array]]:
        """Compute a run; `beside`: whose elements its mesh must have, for differences."""
        case, domain = self.case_of(values), beside or self.domain
        for one in self.parameters:
            if one.path[0] == "geometry":
                try:
                    domain = same_mesh(case, domain, one.name)
                except CaseError:
                    if beside is not None:
                        raise
                    # far from the first trial the mesh may be another one, near which there is a derivative again
                    domain = self.domain = Domain.build(case.geometry)
                break
        with ng.TaskManager():
            run = StoredStates(case, domain, silent, self._quantities, self._folder)
            over_time, times = run.values(), run.times
        self.runs += 1
        pairs = [run.measured[one.quantity].made(one.window, times, over_time[one.quantity]) for one in self.data]
        return run, np.array([value for value, _ in pairs]), [weights for _, weights in pairs]

    def slopes(self, values: Array) -> Array:
        """Return the derivatives (data, parameters) by the parameters."""
        self.values(values)
        assert self._last is not None
        _, run, present, weights = self._last
        if self.sweeps_cost < len(self.parameters):
            return self.by_sweeps(run, weights)
        return self.by_differences(np.asarray(values), present, run.domain)

    @cached_property
    def sweeps_cost(self) -> float:
        """Runs that sweeps for all data take."""
        assert self._last is not None
        _, run, _, weights = self._last
        at_rest = run.case.time.scheme == "static"
        touched = sum(np.count_nonzero(one) if at_rest else np.flatnonzero(one)[-1] + 1 for one in weights)
        return float(touched / len(run.times) * (SWEEP + PARAMETER * len(self.parameters)))

    def by_sweeps(self, run: StoredStates, weights: Sequence[Array]) -> Array:
        """Return the derivatives by the adjoint of a run; `weights`: of its accepted states in each datum."""
        with ng.TaskManager():
            adjoint = Adjoint(run, self._parameters_of(run.case))
            rows = [adjoint.derivatives({one.quantity: slopes})
                    for one, slopes in zip(self.data, weights, strict=True)]  # fmt: skip
        self.sweeps += len(rows)
        return np.array(rows)

    def by_differences(self, values: Array, present: Array, domain: Domain | None = None) -> Array:
        """Return the derivatives by forward differences of runs; `present`: what the run gives for the values, on a
        domain."""
        columns = []
        for place, one in enumerate(self._parameters_of(self.case_of(values))):
            step = FORWARD * one.step
            step = step if values[place] + step < bounds_of(self.case, one)[1] else -step
            moved = values + step * (np.arange(len(values)) == place)
            columns.append((self._run(moved, domain)[1] - present) / step)
        return np.column_stack(columns)

    def _parameters_of(self, case: Case) -> list[Parameter]:
        """Return the parameters with the values of a case, and steps by their sizes."""
        return parameters_of(case, [one.name for one in self.parameters])


Pairs = Mapping[str, tuple[float, float]]
"""Two numbers by the name of a parameter."""


def calibrate(runs: Runs, bounds: Pairs = MappingProxyType({}), priors: Pairs = MappingProxyType({})) -> Fit:
    """Find the parameters with which the runs fit the data best; they begin with those of the case.

    Args:
        bounds: by the name of a parameter (SI), within those of its own definition, which are the default.
        priors: mean and standard deviation by the name of a parameter (SI).

    Raises:
        MaterialError: the data do not tell the parameters; says which.
        CaseError: bounds do not hold the first trial, or a prior or a bound is of no parameter.
        SolverError: the first run fails, or the search does not end.
    """
    unknowns, names = [], [one.name for one in runs.parameters]
    for name in (*bounds, *priors):
        if name not in names:
            raise CaseError(f"bounds or prior of {name}: {unknown('parameter of --by', name, names)}")
    for one in runs.parameters:
        least, most = bounds_of(runs.case, one)
        low, high = bounds.get(one.name, (least, most))
        mean, sd = priors.get(one.name, (0.0, np.inf))
        unknowns.append(Unknown(one.name, one.value, max(low, least), min(high, most), mean, sd))
    measured, errors = (np.array([getattr(one, name) for one in runs.data]) for name in ("value", "error"))
    return fit(unknowns, measured, errors, runs.values, runs.slopes)
