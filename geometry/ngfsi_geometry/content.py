"""What files hold, for cases that belong to the content of a file."""

from __future__ import annotations

import hashlib
from pathlib import Path

from ngfsi.errors import GeometryError


def digest(path: str, what: str) -> str:
    """Return the SHA-256 of a file, or of all files of a folder, and of those in it, in the order of their names.

    Raises:
        GeometryError: it cannot be read; `what` says what it should be.
    """
    place, found = Path(path), hashlib.sha256()
    try:
        for file in [f for f in sorted(place.rglob("*")) if f.is_file()] if place.is_dir() else [place]:
            found.update(file.read_bytes())
    except OSError as error:
        raise GeometryError(f"the {what} '{path}' cannot be read: {error.strerror or error}") from None
    return found.hexdigest()


def check_digest(path: str, what: str, expected: str) -> None:
    """Refuse a file that is not the one of the case.

    Raises:
        GeometryError: it cannot be read, or its content has another SHA-256.
    """
    if digest(path, what) != expected:
        raise GeometryError(f"'{path}' is not the file of this case, it has changed: leave out sha256 to accept it")
