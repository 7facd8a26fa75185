"""Benchmarks: found, computed, and held against their references.

A benchmark is a module, registered in the group `ngfsi.benchmarks`, that exports CASE (a `Benchmark`), LEVELS and
REFERENCES. LEVELS gives for each level and each series (e.g. a polynomial order) the settings to compute, from coarse
to fine; the finest is held against the references, and the last two give the observed order of convergence.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from math import log
from pathlib import Path
from time import perf_counter
from types import ModuleType
from typing import Any, ClassVar

import numpy as np

from ngfsi import registry
from ngfsi.arrays import Array
from ngfsi.errors import NgfsiError, OutputError
from ngfsi.solve.initial import Say, silent

Setting = Mapping[str, Any]
"""What a computation of a series is made with; `h`, the size that is refined, is for the order of convergence."""
Values = dict[str, float]
Levels = Mapping[str, Mapping[str, Sequence[Setting]]]

GROUP = "ngfsi.benchmarks"
ORDER_SLACK = 0.3
"""An observed order may be this much below the expected one: levels are few and coarse."""


class VerificationError(NgfsiError):
    """A benchmark could not be computed, or failed."""

    exit_code: ClassVar[int] = 3


@dataclass(frozen=True)
class Signals:
    """What a computation recorded over time: rows (n, columns), below names with units, the first `time_s`."""

    columns: tuple[str, ...]
    rows: Array

    def write(self, path: Path) -> None:
        """Store as CSV."""
        np.savetxt(path, self.rows, delimiter=",", header=",".join(self.columns), comments="", fmt="%.6g")

    @classmethod
    def read(cls, path: Path) -> Signals:
        """Return stored signals."""
        with path.open(encoding="utf-8") as file:
            return cls(tuple(file.readline().strip().split(",")), np.loadtxt(file, delimiter=",", ndmin=2))


@dataclass(frozen=True)
class Benchmark:
    """What is computed.

    Attributes:
        title: of table and page.
        solves: what is solved, and with which part of ngfsi.
        exact: what it is held against.
        compute: setting -> quantities, in the units of the references, and signals if there are any to show.
    """

    title: str
    solves: str
    exact: str
    compute: Callable[[Setting], Values | tuple[Values, Signals]]


@dataclass(frozen=True)
class Reference:
    """What a quantity must be.

    Attributes:
        quantity: name of the quantity.
        value: what it must be, of all series or by series (others have no such quantity); 0 for errors, which are
            held against the tolerance as they are.
        unit: of the value; "1" for pure numbers.
        tolerance: largest relative error (absolute where `value` is 0), of all series or by series.
        source: where the value comes from.
        order: expected order of convergence, of all series or by series; None: not asked.
    """

    quantity: str
    value: float | Mapping[str, float]
    unit: str
    tolerance: float | Mapping[str, float]
    source: str
    order: float | Mapping[str, float] | None = None

    def holds(self, series: str) -> bool:
        """Whether there is such a quantity in a series."""
        return not isinstance(self.value, Mapping) or series in self.value


@dataclass(frozen=True)
class Row:
    """One quantity of one series: computed, reference, error, observed order and whether both are good enough."""

    series: str
    quantity: str
    unit: str
    computed: float
    reference: float
    error: float
    tolerance: float
    order: float | None
    expected_order: float | None
    source: str
    sizes: tuple[float, ...]
    errors: tuple[float, ...]

    @property
    def passed(self) -> bool:
        """Whether error and order are good enough."""
        good = self.error <= self.tolerance
        if self.expected_order is None:
            return good
        return good and self.order is not None and self.order >= self.expected_order - ORDER_SLACK


@dataclass(frozen=True)
class Result:
    """A benchmark at a level."""

    name: str
    level: str
    title: str
    solves: str
    exact: str
    seconds: float
    rows: tuple[Row, ...]
    signals: Mapping[str, Signals] = field(default_factory=dict, compare=False)
    """Of the finest computation of each series that has any."""

    @property
    def passed(self) -> bool:
        """Whether all rows passed."""
        return all(row.passed for row in self.rows)

    def write(self, folder: Path) -> None:
        """Store the result as JSON, and signals as CSV, in place of an older result."""
        folder.mkdir(parents=True, exist_ok=True)
        for ending in ("csv", "png", "pdf"):
            for old in folder.glob(f"{self.name}-*.{ending}"):
                old.unlink()
        for series, signals in self.signals.items():
            signals.write(self.file(folder, series, "csv"))
        data = asdict(replace(self, signals={})) | {"signals": list(self.signals)}
        (folder / f"{self.name}.json").write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")

    def file(self, folder: Path, series: str, ending: str) -> Path:
        """Return the path of a series' signals or their figure."""
        return folder / f"{self.name}-{re.sub('[^a-z0-9]+', '-', series.lower())}.{ending}"

    @classmethod
    def read(cls, path: Path) -> Result:
        """Return a stored result."""
        data = json.loads(path.read_text(encoding="utf-8"))
        rows = (Row(**row | {key: tuple(row[key]) for key in ("sizes", "errors")}) for row in data.pop("rows"))
        series = data.pop("signals", ())
        result = cls(**data, rows=tuple(rows))
        return replace(result, signals={one: Signals.read(result.file(path.parent, one, "csv")) for one in series})


def not_verified() -> str:
    """Return what the benchmarks leave open, as each package that registers some says it."""
    return " ".join(registry.everything("ngfsi.not_verified", "sentence on what is not verified").values())


def chosen(names: Iterable[str]) -> dict[str, ModuleType]:
    """Return the named benchmarks, or all that are registered.

    Raises:
        OutputError: a name is unknown.
    """
    chosen = list(names) or registry.names(GROUP)
    return {name: registry.find(GROUP, name, "benchmark", OutputError) for name in chosen}


def verify(name: str, module: ModuleType, level: str, say: Say = silent) -> Result:
    """Compute a benchmark at a level and hold it against its references.

    Args:
        say: takes a line before each computation.

    Raises:
        VerificationError: a computation failed, or gave no value for a reference.
    """
    case: Benchmark = module.CASE
    levels: Levels = module.LEVELS
    started, rows, signals = perf_counter(), [], {}
    for series, settings in levels[level].items():
        computed = []
        for setting in settings:
            say(f"{name}, {series}: {', '.join(f'{key} {value}' for key, value in setting.items())}")
            try:
                found = case.compute(setting)
            except NgfsiError as error:
                raise VerificationError(f"benchmark '{name}', {series}, {dict(setting)}: {error}") from error
            if isinstance(found, tuple):
                found, signals[series] = found
            computed.append(found)
        sizes = tuple(float(setting.get("h", 0)) for setting in settings)
        rows += [_row(reference, series, sizes, computed) for reference in module.REFERENCES if reference.holds(series)]
    return Result(name, level, case.title, case.solves, case.exact, perf_counter() - started, tuple(rows), signals)


def _row(reference: Reference, series: str, sizes: tuple[float, ...], computed: Sequence[Values]) -> Row:
    quantity = reference.quantity
    if any(quantity not in values for values in computed):
        raise VerificationError(f"'{quantity}' was not computed: {sorted(computed[-1])}")
    exact = _of_series(reference.value, series)
    errors = tuple(abs(values[quantity] - exact) / (abs(exact) or 1.0) for values in computed)
    order = None
    if len(errors) > 1 and sizes[-2] > sizes[-1] > 0 and min(errors[-2:]) > 0:
        order = log(errors[-2] / errors[-1]) / log(sizes[-2] / sizes[-1])
    return Row(
        series=series, quantity=quantity, unit=reference.unit, source=reference.source, sizes=sizes, errors=errors,
        computed=computed[-1][quantity], reference=exact, error=errors[-1],
        tolerance=_of_series(reference.tolerance, series), order=order,
        expected_order=None if reference.order is None else _of_series(reference.order, series),
    )  # fmt: skip


def _of_series(value: float | Mapping[str, float], series: str) -> float:
    return value[series] if isinstance(value, Mapping) else value
