"""Checkpoints: named arrays from which a computation goes on, kept so that no crash and no bad disk goes unnoticed.

One is a file `step-000012.npz` of the arrays and of what they belong to, without pickle, so that nothing in it can
execute, with the SHA-256 of all before it at its end. It is there whole or not at all (disk.py); the last two are kept.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from hashlib import sha256
from io import BytesIO
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np
from numpy.typing import NDArray

from ngfsi.arrays import Array
from ngfsi.errors import OutputError
from ngfsi.store.disk import UNFINISHED, explained, replace_file

FORMAT = 2
KEPT = 2
SUFFIX, RECORD = ".npz", "record"
DIGITS = 64
"""Of the SHA-256, which stands at the end of the file as a zip file's comment."""

Arrays = dict[str, Array]


@dataclass(frozen=True)
class Checkpoint:
    """What was read: arrays, small numbers stored beside them, and why newer checkpoints could not be used."""

    arrays: Arrays
    facts: dict[str, Any]
    damaged: tuple[str, ...] = ()


class Checkpoints:
    """The checkpoints of one computation."""

    def __init__(self, folder: Path, identity: Mapping[str, Any]) -> None:
        """Name a folder, made when the first one is written, and plain values in which one must agree to be used."""
        self.folder = folder
        self._identity = json.loads(json.dumps({"format": FORMAT, **identity}))

    def write(self, number: int, arrays: Mapping[str, NDArray[Any]], **facts: Any) -> None:
        """Store arrays as the checkpoint after step `number`, and remove all but the last two.

        Raises:
            OutputError: the file cannot be written; earlier checkpoints are as they were.
        """
        packed = BytesIO()
        record = json.dumps({"identity": self._identity, "facts": facts})
        np.savez(packed, **arrays, **{RECORD: np.array(record)})  # type: ignore[arg-type] # of mypy's view of **
        with ZipFile(packed, "a") as file:
            file.comment = bytes(DIGITS)
        content = packed.getvalue()[:-DIGITS]
        replace_file(self.folder / f"step-{number:06d}{SUFFIX}", content + _digest(content))
        with explained(self.folder, "tidied"):
            for old in self._files()[KEPT:]:
                old.unlink(missing_ok=True)

    def latest(self) -> Checkpoint | None:
        """Return the newest checkpoint that is whole; None: there never was one.

        Raises:
            OutputError: it belongs to something else, naming in what; or none of those there is whole.
        """
        damaged: list[str] = []
        for path in self._files():
            try:
                content = path.read_bytes()
            except OSError as error:
                damaged.append(f"'{path}' cannot be read: {error.strerror or error}")
                continue
            if _digest(content[:-DIGITS]) != content[-DIGITS:]:
                damaged.append(f"'{path}' is not as it was written")
                continue
            with np.load(BytesIO(content), allow_pickle=False) as stored:
                arrays = dict(stored)
            record = json.loads(str(arrays.pop(RECORD)))
            self._refuse_strangers(path, record["identity"])
            return Checkpoint(arrays, record["facts"], tuple(damaged))
        if damaged:
            raise OutputError(f"no checkpoint can be used: {'; '.join(damaged)}")
        return None

    def clear(self) -> None:
        """Remove everything."""
        if not self.folder.is_dir():
            return
        with explained(self.folder, "removed"):
            for path in (*self._files(), *self.folder.glob(f"*{UNFINISHED}")):
                path.unlink(missing_ok=True)
            if not any(self.folder.iterdir()):
                self.folder.rmdir()

    def _files(self) -> list[Path]:
        """Return the checkpoints, newest first."""
        return sorted(self.folder.glob(f"step-*{SUFFIX}"), reverse=True)

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


def _digest(content: bytes) -> bytes:
    return sha256(content).hexdigest().encode()
