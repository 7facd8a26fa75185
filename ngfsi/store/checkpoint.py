"""Checkpoints: named arrays from which a computation goes on, kept so that no crash and no bad disk goes unnoticed.

    step-000012.npz    the arrays, without pickle: nothing in it can execute
    step-000012.json   of what it is, and the SHA-256 of the arrays and of this record itself

The record is written last; both files are there whole or not at all (disk.py). The last two checkpoints are kept.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from hashlib import sha256
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ngfsi.errors import OutputError
from ngfsi.store.disk import UNFINISHED, explained, replace_file

FORMAT = 1
KEPT = 2
ARRAYS, RECORD, CHECK = ".npz", ".json", "sha256"

Arrays = dict[str, NDArray[np.float64]]


@dataclass(frozen=True)
class Checkpoint:
    """A checkpoint that was read.

    Attributes:
        facts: small numbers that were stored beside the arrays.
        damaged: why newer checkpoints could not be used.
    """

    arrays: Arrays
    facts: dict[str, Any]
    damaged: tuple[str, ...] = ()


class Checkpoints:
    """The checkpoints of one computation."""

    def __init__(self, folder: Path, identity: Mapping[str, Any]) -> None:
        """Name them.

        Args:
            folder: made when the first one is written.
            identity: tables of plain values in which a checkpoint must agree to be used.
        """
        self.folder = folder
        self._identity = json.loads(json.dumps({"format": FORMAT, **identity}))

    def write(self, number: int, arrays: Mapping[str, NDArray[Any]], **facts: Any) -> None:
        """Store arrays as the checkpoint after step `number`, and remove all but the last two.

        Raises:
            OutputError: the files cannot be written; earlier checkpoints are as they were.
        """
        with explained(self.folder, "made"):
            self.folder.mkdir(parents=True, exist_ok=True)
        packed = BytesIO()
        np.savez(packed, **arrays)  # type: ignore[arg-type] # of mypy's view of **
        path = self.folder / f"step-{number:06d}{RECORD}"
        record = {"identity": self._identity, "facts": facts, "arrays": sha256(packed.getbuffer()).hexdigest()}
        text = json.dumps({**record, CHECK: _digest(record)}, indent=1)
        replace_file(path.with_suffix(ARRAYS), packed.getvalue())
        replace_file(path, text.encode())
        with explained(self.folder, "tidied"):
            for old in self._records()[KEPT:]:
                _remove(old)

    def latest(self) -> Checkpoint | None:
        """Return the newest checkpoint that is whole; None: there never was one.

        Raises:
            OutputError: it belongs to something else, naming in what; or none of those there is whole.
        """
        damaged: list[str] = []
        for path in self._records():
            try:
                record = _checked_record(path)
                self._refuse_strangers(path, record["identity"])
                return Checkpoint(_checked_arrays(path, record), record["facts"], tuple(damaged))
            except _DamagedError as error:
                damaged.append(f"'{path}' {error}")
        if damaged:
            raise OutputError(f"no checkpoint can be used: {'; '.join(damaged)}")
        return None

    def clear(self) -> None:
        """Remove everything."""
        if not self.folder.is_dir():
            return
        with explained(self.folder, "removed"):
            for path in (*self._records(), *self.folder.glob(f"step-*{ARRAYS}"), *self.folder.glob(f"*{UNFINISHED}")):
                _remove(path)
            if not any(self.folder.iterdir()):
                self.folder.rmdir()

    def _records(self) -> list[Path]:
        """Return the records, newest first."""
        return sorted(self.folder.glob(f"step-*{RECORD}"), reverse=True)

    def _refuse_strangers(self, path: Path, found: Mapping[str, Any]) -> None:
        if differing := differences(found, self._identity):
            key, (there, here) = next(iter(differing.items()))
            more = f" (and {len(differing) - 1} more)" if len(differing) > 1 else ""
            raise OutputError(
                f"the checkpoint '{path}' is of something else: {key} is {there} there, {here} here{more}"
            )


def differences(one: Any, other: Any, prefix: str = "") -> dict[str, tuple[Any, Any]]:
    """Return dotted key -> the two values, where nested tables differ; None for what is missing."""
    if not isinstance(one, Mapping) or not isinstance(other, Mapping):
        return {} if one == other else {prefix: (one, other)}
    found: dict[str, tuple[Any, Any]] = {}
    for key in dict.fromkeys((*one, *other)):
        found |= differences(one.get(key), other.get(key), f"{prefix}.{key}" if prefix else key)
    return found


class _DamagedError(Exception):
    """A checkpoint is not as it was written."""


def _checked_record(path: Path) -> dict[str, Any]:
    try:
        record = json.loads(path.read_bytes())
        check = record.pop(CHECK)
        if check != _digest(record):
            raise ValueError
    except OSError as error:
        raise _DamagedError(f"cannot be read: {error.strerror or error}") from None
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise _DamagedError("is not as it was written") from None
    return dict(record)


def _checked_arrays(path: Path, record: Mapping[str, Any]) -> Arrays:
    try:
        content = path.with_suffix(ARRAYS).read_bytes()
    except OSError as error:
        raise _DamagedError(f"has no arrays: {error.strerror or error}") from None
    if sha256(content).hexdigest() != record["arrays"]:
        raise _DamagedError("has arrays that are not as they were written")
    with np.load(BytesIO(content), allow_pickle=False) as stored:
        return dict(stored)


def _digest(record: Mapping[str, Any]) -> str:
    return sha256(json.dumps(record, sort_keys=True).encode()).hexdigest()


def _remove(record: Path) -> None:
    """Remove a checkpoint, the record first: arrays without one are none."""
    record.unlink(missing_ok=True)
    record.with_suffix(ARRAYS).unlink(missing_ok=True)
