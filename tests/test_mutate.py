"""The mutants that `make mutate` plants: what is changed, and what is left alone."""

from __future__ import annotations

from tests.mutate import mutants_of

SOURCE = '''\
"""A page: 1 + 1."""
def area(radius: float = 2.0, unit: str = "kPa") -> float:
    """3 + 3."""
    if radius < 0 and not unit:
        raise ValueError(f"{1 + 2} is negative: {radius}")
    note(radius, level=1)
    return max(radius, 0.5) ** 2
'''

CHANGES = {
    "2.0 -> 2.2",
    "'kPa' -> 'mmHg'",
    "radius < 0 and not unit -> (radius < 0 or not unit)",
    "radius < 0 -> (radius >= 0)",
    "0 -> 1",
    "not unit -> (unit)",
    "note(radius, level=1) -> pass",
    "note(radius, level=1) -> note(radius)",
    "1 -> 2",
    "max(radius, 0.5) ** 2 -> (max(radius, 0.5) * 2)",
    "max -> min",
    "0.5 -> 0.55",
    "2 -> 3",
}


def test_what_is_changed() -> None:
    mutants = list(mutants_of("page.py", SOURCE))
    assert {mutant.change.replace('"', "'") for mutant in mutants} == CHANGES
    assert len(mutants) == len(CHANGES)
    for mutant in mutants:
        planted = mutant.planted(SOURCE.encode()).decode()
        assert planted != SOURCE
        compile(planted, "page.py", "exec")
        assert planted.splitlines()[: mutant.line - 1] == SOURCE.splitlines()[: mutant.line - 1]
