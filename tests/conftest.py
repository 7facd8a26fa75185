"""Runs that several tests look at, computed once."""

from __future__ import annotations

import os
import pickle
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ngfsi.parallel.ranks import threads

# before NumPy and NGSolve are loaded: with one thread alone runs are the same to the last bit; children inherit it
os.environ.update(threads(1))
# child processes find the project's modules wherever they are started, and no packages of this Python: that with mpi4py
# has its own
os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, (str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH"))))

import pytest

from ngfsi.case import Case
from ngfsi.config.functions import PressureConstant, PressureRamp
from ngfsi.errors import NgfsiError
from ngfsi.mesh import generate
from tests.runs import Run, computed
from tests.vein import BONED, case_of

SQUEEZED = case_of(
    BONED,
    **{"loads.skin_pressure": PressureRamp(final=3000.0, duration=0.2), "time.step": 0.1, "time.end": 0.3},
)
"""A vein beside a bone that loses a tenth of its lumen within 0.2 s, while its ends slide on rollers."""


@pytest.fixture(scope="session", autouse=True)
def one_processor() -> Iterator[None]:
    """Studies start one run at a time, with one thread: the other processors are busy with other tests."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "cpu_count", lambda: 1)
        yield


IN_A_CHILD = generate._run_child


def _here(geometry: Any, attempt: int, work: Path, _timeout: float) -> str | None:
    """Mesh into `work` in this process, by the same file of the request; return None, or how it failed."""
    (work / generate.REQUEST_FILE).write_bytes(pickle.dumps((geometry, attempt)))
    try:
        generate.main(str(work))
    except Exception as error:
        return f"failed: {error}"
    return None


@pytest.fixture(scope="session", autouse=True)
def meshed_here() -> Iterator[None]:
    """No process of its own for each mesh, which would be half of the time of a test that makes one."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(generate, "_run_child", _here)
        yield


@pytest.fixture
def guarded_mesher(monkeypatch: pytest.MonkeyPatch) -> None:
    """Meshes are made as for users, in a process that may crash or hang."""
    monkeypatch.setattr(generate, "_run_child", IN_A_CHILD)


@pytest.fixture
def runs_here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Studies compute their cases in this process: another one each takes seconds to start."""
    from ngfsi.run import run
    from ngfsi.study import engine

    def compute(text: str, folder: Path, *_: Any) -> tuple[int, str]:
        try:
            run(Case.from_dict(tomllib.loads(text)), folder, quiet=True)
        except NgfsiError as error:
            return error.exit_code, str(error)
        return 0, ""

    monkeypatch.setattr(engine, "_compute", compute)


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
