"""What `tests.mutate` adds to pytest: seconds and fixtures of each test; coverage by fixture, and of child processes.

A fixture that several tests share is set up within the first of them alone, yet its lines reach all of them.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import coverage
import pytest

FIXTURE = "fixture "
contexts = [""]


def _note(*words: object) -> None:
    with Path(os.environ["MUTATE_NOTES"]).open("a", encoding="utf-8") as file:
        print(*words, file=file)


@pytest.hookimpl(trylast=True)
def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    if "PYTEST_XDIST_WORKER" not in os.environ:
        _note("seconds", report.duration, report.nodeid)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Function) -> None:
    # not before: the workers of xdist themselves are covered by pytest-cov
    os.environ["COVERAGE_PROCESS_START"] = os.environ["MUTATE_CHILD"]
    contexts[0] = f"{item.nodeid}|setup"
    for name, definitions in item._fixtureinfo.name2fixturedefs.items():
        if definitions[-1].scope != "function":
            _note("uses", name, item.nodeid)


@pytest.hookimpl(wrapper=True)
def pytest_fixture_setup(fixturedef: pytest.FixtureDef[object]) -> Iterator[None]:
    measured = coverage.Coverage.current()
    if measured is None or fixturedef.scope == "function":
        return (yield)
    contexts.append(FIXTURE + fixturedef.argname)
    measured.switch_context(contexts[-1])
    try:
        return (yield)
    finally:
        contexts.pop()
        measured.switch_context(contexts[-1])
