"""Runs that several tests look at, computed once."""

from __future__ import annotations

import os
from pathlib import Path

from ngfsi.parallel.ranks import threads

# before NumPy and NGSolve are loaded: with one thread alone runs are the same to the last bit; children inherit it
os.environ.update(threads(1))
# child processes find the project's modules wherever they are started, and no packages of this Python: that with mpi4py
# has its own
os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, (str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH"))))

import pytest

from ngfsi.config.functions import PressureConstant, PressureRamp
from tests.runs import Run, computed
from tests.vein import BONED, case_of

SQUEEZED = case_of(
    BONED,
    **{"loads.skin_pressure": PressureRamp(final=3000.0, duration=0.2), "time.step": 0.1, "time.end": 0.3},
)
"""A vein beside a bone that loses a tenth of its lumen within 0.2 s, while its ends slide on rollers."""


@pytest.fixture(scope="session")
def squeezed() -> Run:
    return computed(SQUEEZED)


@pytest.fixture(scope="session")
def squeezed_finely() -> Run:
    """With cubic displacements."""
    geometry = BONED.replace(**{"mesh.curving_order": 3})
    return computed(SQUEEZED.replace(geometry=geometry, **{"discretisation.order": 3, "time.end": 0.1}))


@pytest.fixture(scope="session", params=["preload", "prestress"])
def held(request: pytest.FixtureRequest) -> Run:
    """All loads held, with pressure on the skin from the start."""
    changes = {"loads.skin_pressure": PressureConstant(value=500.0), "conditions.initial_state": request.param}
    return computed(SQUEEZED.replace(**changes))
