"""Every key of a case changes what it should, by as much as it should: one entry for each key, and none without."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from tests.settings import carried, contract, geometry, numerics, physics  # noqa: F401 - they enter
from tests.settings.table import ENTRIES, Outcome, all_keys


def test_every_key_has_an_entry() -> None:
    assert all_keys() == set(ENTRIES)


def test_defaults_and_limits_are_those_that_case_files_rest_on() -> None:
    assert contract.lines() == contract.FILE.read_text(encoding="utf-8").splitlines(), contract.__doc__


SHOWN = {shows: rel for shows, rel in ENTRIES.values()}


@pytest.mark.parametrize("shows", SHOWN, ids=[shows.__name__.strip("_") for shows in SHOWN])
def test_effect(shows: Callable[[], Outcome]) -> None:
    found, expected = shows()
    if isinstance(expected, np.ndarray):
        assert np.linalg.norm(np.asarray(found) - expected) < SHOWN[shows] * np.linalg.norm(expected)
    elif any(isinstance(value, float) for value in (expected if isinstance(expected, list) else [expected])):
        assert found == pytest.approx(expected, rel=SHOWN[shows], abs=0)
    else:
        assert found == expected
