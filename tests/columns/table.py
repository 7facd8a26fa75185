"""The table of columns: what is measured of set states, and what each kind of column must be.

A source is one file of a run of one model, or one interface of Python: column -> number or array. Names of regions,
openings, vessels and outlines are left out of a column's kind, and so are numbers of stations: `area_z#_m2`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

Source = Callable[[], Mapping[str, Any]]
Exact = Callable[[], Mapping[str, Any]]


@dataclass(frozen=True)
class Entry:
    """What a kind of column must be.

    Attributes:
        exact: returns the columns of this kind, among others.
        rel: tolerance, relative to the largest of these columns.
    """

    exact: Exact
    rel: float


SOURCES: dict[str, Source] = {}
ENTRIES: dict[tuple[str, str], Entry | Callable[..., None]] = {}
"""(source, kind) -> entry, or the test of another file that holds it."""

DYNAMIC = (
    (r"(_(inlet|outlet)_\d+)?_z\d\d_", "_z#_"),
    (r"^detF_min_\w+_1$", "detF_min_REGION_1"),
    (r"^pressure_(inlet|outlet)(_\d+)?_Pa$", "pressure_OPENING_Pa"),
    (r"^flow_(inlet|outlet)(_\d+)?_m3_s$", "flow_OPENING_m3_s"),
    (r"^pressure_stored_(inlet|outlet)(_\d+)?_Pa$", "pressure_stored_OPENING_Pa"),
    (r"^pressure_(interface|lumen)\w*_Pa$", "pressure_HOLE_Pa"),
    (r"^(skin|lumen(_\d+)?)_area_m2$", "OUTLINE_area_m2"),
    (r"^(?!OUTLINE)\w+_area_m2$", "REGION_area_m2"),
)


def kind_of(column: str) -> str:
    """Return the kind of a column."""
    for pattern, kind in DYNAMIC:
        column = re.sub(pattern, kind, column)
    return column


def source(name: str) -> Callable[[Source], Source]:
    """Enter what returns the columns of a source."""

    def enter(columns: Source) -> Source:
        assert name not in SOURCES, name
        SOURCES[name] = cache(columns)
        return SOURCES[name]

    return enter


def entry(of: str, *kinds: str, rel: float = 1e-9) -> Callable[[Exact], Exact]:
    """Enter what returns the exact columns of kinds of a source, found to a relative tolerance."""

    def enter(exact: Exact) -> Exact:
        exact = cache(exact)
        for kind in kinds:
            assert (of, kind) not in ENTRIES, kind
            ENTRIES[of, kind] = Entry(exact, rel)
        return exact

    return enter


def held_by(test: Callable[..., None], of: str, *kinds: str) -> None:
    """Enter the test that holds kinds of columns of a source."""
    for kind in kinds:
        assert (of, kind) not in ENTRIES, kind
        ENTRIES[of, kind] = test
