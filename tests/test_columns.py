"""Every column of a run and every derived quantity has an exact value in a state that tells it from its neighbours."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from ngfsi import registry
from ngfsi.measure.quantities import Quantity
from ngfsi.store.fields import GRIDS
from ngfsi.store.folder import TABLES
from tests.columns import branched, derived, models, vessel  # noqa: F401 - they enter
from tests.columns.table import ENTRIES, SOURCES, Entry, kind_of

CHECKED = [key for key, entry in ENTRIES.items() if isinstance(entry, Entry)]


def test_every_column_has_an_entry() -> None:
    kinds = {(of, kind_of(column)) for of, columns in SOURCES.items() for column in columns()}
    assert kinds == set(ENTRIES)


def test_every_quantity_and_every_file_is_a_source() -> None:
    """All that ngfsi registers is among the columns of the states, and all that is written to a folder is read."""
    columns = {
        kind_of(column) for of, columns in SOURCES.items() if of.startswith("series.csv") for column in columns()
    }
    for point in registry.installed("ngfsi.quantities"):
        found = point.load()
        assert {kind_of(one.column()) for one in ([found] if isinstance(found, Quantity) else found)} <= columns
    files = {of.split(".")[0] for of in SOURCES}
    assert {*TABLES, *GRIDS} <= files


@pytest.mark.parametrize(("of", "kind"), CHECKED, ids=map(": ".join, CHECKED))
def test_column(of: str, kind: str) -> None:
    """And no other column of the source could be taken for it."""
    entry: Any = ENTRIES[of, kind]
    columns = SOURCES[of]()
    exact = {name: np.asarray(values) for name, values in entry.exact().items() if kind_of(name) == kind}
    assert exact.keys() == {name for name in columns if kind_of(name) == kind} != set()
    allowed = entry.rel * max(np.abs(values).max() for values in exact.values())
    for name, values in exact.items():
        assert off(columns[name], values) < allowed, name
        for other, found in columns.items():
            if other != name and found is not None and np.shape(found) == np.shape(columns[name]):
                assert min(off(found, values), off(found, -values)) > allowed, (name, other)


def off(found: Any, exact: Any) -> float:
    return float(np.abs(np.asarray(found) - exact).max())
