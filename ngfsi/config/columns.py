"""Columns of measured numbers from CSV files, whose heads carry the unit: `x_mm`, `stress_kPa`, `time_s`."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ngfsi.arrays import Array
from ngfsi.errors import OutputError
from ngfsi.units import suffixes, to_si, unit_of


def read_columns(path: Path, wanted: Mapping[str, str]) -> dict[str, Array]:
    """Return columns of a CSV file in SI, by the name without unit; other columns are left alone.

    Args:
        wanted: name -> dimension of ngfsi.units, e.g. {"x": "length"} for a column `x_mm`.

    Raises:
        OutputError: the file cannot be read, lacks a column or holds something else than finite numbers.
    """
    head, body = _read(path)
    found: dict[str, Array] = {}
    for name, dimension in wanted.items():
        known = {f"{name}_{unit}": unit for unit in suffixes(dimension)}
        here = [column for column in head if column in known]
        if not here:
            listed = ", ".join(known)
            raise OutputError(f"'{path}' has no column of '{name}': name it one of {listed}; there are {head}")
        values = _numbers(path, head, body, head.index(here[0]))
        found[name] = np.array([to_si(value, known[here[0]]) for value in values])
    return found


def first_columns(path: Path, count: int) -> list[tuple[str, list[float]]]:
    """Return of the first columns of a CSV file, whatever their names, the unit and the numbers in that unit.

    Raises:
        OutputError: the file cannot be read, lacks a column or a unit, or holds something else than finite numbers.
    """
    head, body = _read(path)
    units = [unit_of(column) for column in head[:count]]
    if len(units) < count or not all(units):
        raise OutputError(
            f"'{path}' needs {count} columns below a head with units, e.g. time_s,flow_ml_s; there are {head}"
        )
    return [(unit, _numbers(path, head, body, place)) for place, unit in enumerate(units)]


def all_columns(path: Path) -> dict[str, tuple[str, Array]]:
    """Return the unit of each column of a CSV file, and its numbers in SI, by the name without unit; NaN in empty ones.

    Raises:
        OutputError: the file cannot be read, a column has no unit, or a cell holds something else than a finite number.
    """
    head, body = _read(path)
    found: dict[str, tuple[str, Array]] = {}
    for place, column in enumerate(head):
        unit = unit_of(column)
        if not unit:
            raise OutputError(
                f"'{path}': the column '{column}' has no unit: name it {column}_mm2, or whatever its unit is"
            )
        values = _numbers(path, head, body, place, empty=np.nan)
        found[column.removesuffix(f"_{unit}")] = unit, np.array([to_si(value, unit) for value in values])
    return found


def _read(path: Path) -> tuple[list[str], list[list[str]]]:
    """Return the head of a CSV file, and the rows below."""
    try:
        rows = list(csv.reader(path.read_text(encoding="utf-8-sig").splitlines()))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise OutputError(f"'{path}' cannot be read as CSV: {getattr(error, 'strerror', None) or error}") from None
    head, *body = [[cell.strip() for cell in row] for row in rows if row] or [[]]
    return head, body


def _numbers(path: Path, head: list[str], body: list[list[str]], place: int, empty: float | None = None) -> list[float]:
    """Return the numbers of a column; `empty`: what stands for an empty cell, default: it is refused."""
    values = []
    for line, row in enumerate(body, start=2):
        text = row[place] if place < len(row) else ""
        if empty is not None and not text:
            values.append(empty)
            continue
        try:
            values.append(float(text))
        except ValueError:
            values.append(np.nan)
        if not np.isfinite(values[-1]):
            raise OutputError(f"'{path}', line {line}: '{text}' in column '{head[place]}' is not a finite number")
    return values
