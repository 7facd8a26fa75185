"""Tables of numbers in CSV: one header, rows appended one by one, each of them safe on the disk before going on."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Self

import numpy as np

from ngfsi.arrays import Array
from ngfsi.errors import OutputError
from ngfsi.store.disk import explained, replace_file

TIME = "time_s"


class TableWriter:
    """Appends rows to a CSV file; the keys of the first row are the columns."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._columns: tuple[str, ...] = ()

    @classmethod
    def continued(cls, path: Path, until: float) -> Self:
        """Return the writer of a table of which the rows later than `until` (s, column time_s) are removed.

        Raises:
            OutputError: the file cannot be read or written, or has no column time_s.
        """
        writer = cls(path)
        if not path.exists():
            return writer
        with explained(path, "read"):
            lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
        whole = [line for line in lines if line.endswith("\n")]
        table = read_table(path)
        if whole and TIME not in table:
            raise OutputError(f"'{path}' has no column {TIME}")
        kept = whole[:1] + [line for line, time in zip(whole[1:], table.get(TIME, ()), strict=True) if time <= until]
        replace_file(path, "".join(kept).encode())
        writer._columns = tuple(table)
        return writer

    def append(self, *rows: Mapping[str, float]) -> None:
        """Append rows with the same columns as the first one and wait until they are on the disk.

        Floats are written with as many digits as give the same float back.

        Raises:
            ValueError: a row has other columns.
            OutputError: the file cannot be written.
        """
        new = not self._columns
        self._columns = self._columns or tuple(rows[0])
        for row in rows:
            if set(row) != set(self._columns):
                raise ValueError(f"{self.path.name} has the columns {self._columns}, the row has {tuple(row)}")
        lines = [[_number(row[column]) for column in self._columns] for row in rows]
        with explained(self.path), self.path.open("w" if new else "a", encoding="utf-8", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerows([self._columns, *lines] if new else lines)
            file.flush()
            os.fsync(file.fileno())


def write_rows(path: Path, rows: Sequence[Mapping[str, float | str]]) -> None:
    """Write a whole table of numbers and words; the keys of the first row are the columns.

    Raises:
        OutputError: the file cannot be written.
    """
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    replace_file(path, text.getvalue().encode())


def read_rows(path: Path) -> list[dict[str, float | str]]:
    """Return the rows of a table that `write_rows` wrote; none when it does not exist.

    Raises:
        OutputError: the file cannot be read.
    """
    if not path.exists():
        return []
    with explained(path, "read"):
        text = path.read_text(encoding="utf-8")
    return [{name: _read(cell) for name, cell in row.items()} for row in csv.DictReader(io.StringIO(text))]


def write_parquet(path: Path, rows: Sequence[Mapping[str, float | str]]) -> bool:
    """Write such a table as Parquet if pyarrow is installed, empty words as missing values; return whether it is.

    Raises:
        OutputError: the file cannot be written.
    """
    if find_spec("pyarrow") is None:
        return False
    import pyarrow
    from pyarrow import parquet

    columns = {}
    for name in rows[0]:
        values = [None if row[name] == "" else row[name] for row in rows]
        kind = pyarrow.string() if any(isinstance(value, str) for value in values) else pyarrow.float64()
        columns[name] = pyarrow.array(values, kind)
    content = io.BytesIO()
    parquet.write_table(pyarrow.table(columns), content)
    replace_file(path, content.getvalue())
    return True


def read_table(path: Path) -> dict[str, Array]:
    """Return the columns of a CSV file; empty when it does not exist. A last line cut short by a crash is left out.

    Raises:
        OutputError: the file cannot be read or holds something else than numbers.
    """
    if not path.exists():
        return {}
    with explained(path, "read"):
        text = path.read_text(encoding="utf-8")
    header, *lines = [line for line in text.splitlines(keepends=True) if line.endswith("\n")] or [""]
    columns = header.strip().split(",") if header else []
    try:
        values = np.loadtxt(lines, delimiter=",", ndmin=2) if lines else np.empty((0, len(columns)))
    except ValueError as error:
        raise OutputError(f"'{path}' is not a table of numbers: {error}") from None
    if values.shape[1] != len(columns):
        raise OutputError(f"'{path}' has {len(columns)} column names, but {values.shape[1]} columns of numbers")
    return {name: values[:, number] for number, name in enumerate(columns)}


def _read(cell: str) -> float | str:
    try:
        return float(cell)
    except ValueError:
        return cell


def _number(value: float) -> str:
    return str(value) if isinstance(value, int) else repr(float(value))
