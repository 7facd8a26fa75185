"""Errors of the package: each text is one sentence that says what was asked, what exists and what to do.

The command line prints `str(error)` alone and ends with `exit_code`; nothing else is shown to the user.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from difflib import get_close_matches
from typing import ClassVar

LONG_WORD = r"\S{400,}"


class NgfsiError(Exception):
    """Base of every error this package raises on purpose."""

    exit_code: ClassVar[int] = 2

    def __str__(self) -> str:
        """One line fit for a terminal, whatever the user's file put into it."""
        shortened = re.sub(LONG_WORD, lambda word: f"{word[0][:60]}...", super().__str__())
        return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in shortened)


class CaseError(NgfsiError):
    """A case file, or a value in it, cannot be used."""


class GeometryError(NgfsiError):
    """The dimensions of a geometry contradict each other."""


class MeshError(NgfsiError):
    """The mesher failed, or its mesh is not what the geometry promised."""


class RegionError(NgfsiError):
    """A region or boundary of that name does not exist."""


class MaterialError(NgfsiError):
    """A material law or a parameter set is unknown or not physical."""


class OutputError(NgfsiError):
    """Results cannot be written or read."""


class SolverError(NgfsiError):
    """The equations could not be solved; what was computed before is kept."""

    exit_code: ClassVar[int] = 3


class StoppedError(NgfsiError):
    """A run ended early as it was asked to; `ngfsi resume` goes on."""

    exit_code: ClassVar[int] = 4


class Interrupted(KeyboardInterrupt):
    """A signal ended the run; no NgfsiError, so that a loop over runs that goes on after those ends as well."""

    def __init__(self, sentence: str, exit_code: int) -> None:
        super().__init__(sentence)
        self.exit_code = exit_code


def suggestion(given: str, known: Iterable[str]) -> str:
    """Return `did you mean 'x'? ` (with the trailing blank) for the known name nearest to `given`, else nothing."""
    candidates = sorted(known)
    folded = {name.casefold(): name for name in candidates}
    near = get_close_matches(given.casefold(), folded, n=1, cutoff=0.6)
    return f"did you mean '{folded[near[0]]}'? " if near else ""


def unknown(what: str, given: str, known: Iterable[str]) -> str:
    """Return the sentence for an unknown name: what it is, the nearest known one and all known ones."""
    names = sorted(known)
    listed = ", ".join(names) if names else "none"
    return f"'{given}' is not a known {what}: {suggestion(given, names)}known are {listed}"
