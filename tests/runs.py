"""Short runs for the tests, with everything measured after each step."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from ngfsi.case import Case
from ngfsi.errors import StoppedError
from ngfsi.measure.probe import Probe
from ngfsi.measure.quantities import columns
from ngfsi.run import resume, run
from ngfsi.run.interrupts import Stops
from ngfsi.solve.newton import Newton
from ngfsi.solve.time_loop import Step, TimeLoop
from ngfsi.store import open_run
from ngfsi.system.system import System
from tests.vein import steady

Array = NDArray[np.float64]


@dataclass
class Run:
    """A finished run.

    Attributes:
        rows: the quantities at the start and after each step.
        states: the vectors of unknowns at the same times.
    """

    system: System
    newton: Newton
    steps: list[Step]
    rows: list[dict[str, float]]
    states: list[Array]

    def __getitem__(self, column: str) -> Array:
        return np.array([row[column] for row in self.rows])


def row(probe: Probe) -> dict[str, float]:
    """Return all quantities of the present state by column."""
    return {column: evaluate() for column, evaluate in columns(probe).items()}


def computed(case: Case) -> Run:
    """Run a case without output."""
    system, newton = steady(case)
    probe = Probe(system)
    run = Run(system, newton, [], [], [])

    def record() -> None:
        probe.refresh()
        run.rows.append(row(probe))
        run.states.append(np.array(system.values))

    record()
    for step in TimeLoop(case, system, newton).run():
        run.steps.append(step)
        record()
    return run


def largest_change(one: Any, other: Any) -> float:
    """Largest relative difference of two arrays."""
    one, other = np.asarray(one), np.asarray(other)
    return float(np.max(np.abs(one - other)) / np.max(np.abs(other)))


def assert_resumed(case: Case, folder: Path, whole: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A run that is stopped after two steps and resumed has the series of one that never was, to the last bit."""
    asked = iter([None, None, StoppedError("stopped by the test"), *[None] * 99])
    monkeypatch.setattr(Stops, "request", lambda _: next(asked))
    with pytest.raises(StoppedError):
        run(case, folder, quiet=True)
    resume(folder, quiet=True)
    one, other = open_run(folder).series, open_run(whole).series
    for name, values in other.items():
        np.testing.assert_array_equal(one[name], values, err_msg=name)
