"""Files that are there whole or not at all: written beside their place, synced, then renamed."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ngfsi.errors import OutputError

UNFINISHED = ".part"


@contextmanager
def explained(path: Path, doing: str = "written") -> Iterator[None]:
    """Turn an error of the operating system inside the block into an OutputError that names the file."""
    try:
        yield
    except OSError as error:
        raise OutputError(f"'{path}' cannot be {doing}: {error.strerror or error}") from error


def replace_file(path: Path, content: bytes) -> None:
    """Put a file with this content in place of whatever is there, so that a crash leaves the old or the new one.

    Folders that are not there are made.

    Raises:
        OutputError: the file cannot be written; the old one is as it was.
    """
    partial = path.with_name(path.name + UNFINISHED)
    with explained(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            partial.write_bytes(content)
            move_into_place(partial, path)
        except OSError:
            partial.unlink(missing_ok=True)
            raise


def move_into_place(partial: Path, path: Path) -> None:
    """Give a written file its name once it is on the disk."""
    with partial.open("rb") as file:
        os.fsync(file.fileno())
    partial.replace(path)
    with suppress(OSError):  # not every file system can sync a folder's entries
        number = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(number)
        finally:
            os.close(number)
