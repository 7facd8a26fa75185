"""Runs that are stopped, killed or lose their disk: what is resumed is what would have been computed without it."""

from __future__ import annotations

import errno
import multiprocessing
import os
import shutil
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ngfsi.case import Case
from ngfsi.config.functions import PressureRamp
from ngfsi.errors import OutputError, SolverError, StoppedError
from ngfsi.measure.deformation import Deformation
from ngfsi.run import resume, run
from ngfsi.run.interrupts import Stops
from ngfsi.solve.newton import Solution
from ngfsi.solve.time_loop import TimeLoop
from ngfsi.store import RunFolder, open_run
from ngfsi.transport.models import Age, Exposure, NearWall, Washout
from tests.vein import TUBE, case_of

CASE = case_of(
    TUBE,
    **{
        "loads.skin_pressure": PressureRamp(final=3000.0, duration=0.2),
        "time.step": 0.05,
        "time.end": 0.3,
        "output.fields_every": 3,
        "output.checkpoint_every": 2,
        "output.stability": True,
        "scalars": (Age(), Washout(start=0.1), Exposure(), NearWall(layer=1e-3)),
    },
)
STEPS = 6


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return run(CASE, tmp_path_factory.mktemp("whole") / "run", quiet=True).path


def assert_same(folder: Path, wanted: Path) -> None:
    """Every number, row and file of two runs is the same, and nothing but the record of how it went on differs."""
    assert open_run(folder).status == "completed"
    names = sorted(path.name for path in wanted.iterdir())
    assert sorted(path.name for path in folder.iterdir()) == names
    for name in {"series.csv", "outlines.csv", "stability.csv", "volume.pvd", "wall.pvd"} & {*names}:
        assert (folder / name).read_bytes() == (wanted / name).read_bytes(), name
    files = sorted(path.name for path in (wanted / "fields").iterdir())
    assert sorted(path.name for path in (folder / "fields").iterdir()) == files
    for file in files:
        assert (folder / "fields" / file).read_bytes() == (wanted / "fields" / file).read_bytes(), file
    one, other = open_run(folder), open_run(wanted)
    for column in set(other.costs) - {"wall_s"}:
        np.testing.assert_array_equal(one.costs[column], other.costs[column])
    assert one.manifest["factorisations"] == other.manifest["factorisations"]


def stop_after(monkeypatch: pytest.MonkeyPatch, steps: int) -> None:
    """Let runs be asked to stop when they have taken so many steps."""
    asked = iter([None] * steps)
    monkeypatch.setattr(Stops, "request", lambda _: next(asked, StoppedError("stopped by the test")))


def stopped_again_and_again(case: Case, folder: Path, monkeypatch: pytest.MonkeyPatch, after: tuple[int, ...]) -> None:
    """Run a case to its end, stopped after so many steps each time; 0: at the start."""
    with monkeypatch.context() as patch:
        for number, steps in enumerate(after):
            stop_after(patch, steps)
            with pytest.raises(StoppedError, match=rf"at t = .* s, .*: go on with `ngfsi resume {folder}`"):
                resume(folder, quiet=True) if number else run(case, folder, quiet=True)
            assert open_run(folder).status == "interrupted"
            assert len(open_run(folder).series["time_s"]) == sum(after[: number + 1]) + 1
    resume(folder, quiet=True)


def test_stopped_after_each_step(whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """To the last bit: BDF2 with two steps of history, the factors and what the mixing has learnt."""
    stopped_again_and_again(CASE, tmp_path / "run", monkeypatch, (0, 1, 1, 1, 1, 1))
    assert_same(tmp_path / "run", whole)


def test_stopped_between_the_steps_of_a_scheme_that_chooses_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Rows that are interpolated, too: the state at the end of the step is what goes on."""
    case = CASE.replace(**{"time.scheme": "esdirk3", "time.error_tolerance": 0.5, "time.step": 0.02, "time.end": 0.12,
                           "output.stability": False, "output.checkpoint_every": 1})  # fmt: skip
    wanted = run(case, tmp_path / "whole", quiet=True)
    # of the last step two rows are shown: within it, where the system is not where it goes on, and its end
    assert list(wanted.costs["iterations"] == 0) == [False, False, False, True, False, True]
    stopped_again_and_again(case, tmp_path / "run", monkeypatch, (1, 2, 1, 1))
    assert_same(tmp_path / "run", wanted.path)


def test_stopped_while_a_step_is_halved(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The step from 0.1 s fails until it is a quarter; the size grown to since then is part of a checkpoint."""
    attempt = TimeLoop._attempt

    def failing(self: TimeLoop, time: float, size: float) -> Solution:
        if abs(time - 0.1) < 1e-9 and size > 0.02:
            raise SolverError("told to fail")
        return attempt(self, time, size)

    monkeypatch.setattr(TimeLoop, "_attempt", failing)
    case = CASE.replace(**{"time.end": 0.2})
    wanted = run(case, tmp_path / "whole", quiet=True)
    assert wanted.series["step_s"][1:] == pytest.approx([0.05, 0.05, 0.0125, 0.01875, 0.01875, 0.05])
    stopped_again_and_again(case, tmp_path / "run", monkeypatch, (3, 1, 1))
    assert_same(tmp_path / "run", wanted.path)


def test_stopped_prestressed_with_another_solver(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    changes = {"conditions.initial_state": "prestress", "time.end": 0.1, "solver.linear": "umfpack"}
    case = CASE.replace(**changes)
    wanted = run(case, tmp_path / "whole", quiet=True)
    with monkeypatch.context() as patch:
        stop_after(patch, 1)
        with pytest.raises(StoppedError):
            run(case, tmp_path / "run", quiet=True)
    resume(tmp_path / "run", quiet=True)
    assert_same(tmp_path / "run", wanted.path)


# ---------------------------------------------------------------- killed


def killed(operation: int, work: Callable[..., Any], *arguments: Any) -> int:
    """Do work in a process that is killed just before its so-manieth sync or rename of a file; return its exit code."""
    child = multiprocessing.get_context("fork").Process(target=_until_killed, args=(operation, work, *arguments))
    child.start()
    child.join()
    assert child.exitcode is not None
    return child.exitcode


def _until_killed(operation: int, work: Callable[..., Any], *arguments: Any) -> None:
    counted_on_disk(operation)
    work(*arguments, quiet=True)


def counted_on_disk(operation: int) -> None:
    """Let this process end just before its so-manieth sync or rename of a file."""
    left = iter(range(operation, -1, -1))
    os.fsync, Path.replace = dying(left, os.fsync), dying(left, Path.replace)  # type: ignore[method-assign]


def dying(left: Iterator[int], real: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function that does the same, but kills the process when `left` has come to zero."""

    def call(*given: Any) -> Any:
        if next(left) == 0:
            os.kill(os.getpid(), signal.SIGKILL)
        return real(*given)

    return call


def test_killed_at_any_moment(whole: Path, tmp_path: Path) -> None:
    """Again and again in one run, between any two operations on the disk: neither gap, duplicate nor other number."""
    folder, moments = tmp_path / "run", np.random.default_rng(7)
    assert killed(15, run, CASE, folder) == -signal.SIGKILL
    kills = 1
    while killed(int(moments.integers(15, 80)), resume, folder) == -signal.SIGKILL:
        kills += 1
        assert kills < 100
    assert kills >= 3
    assert_same(folder, whole)
    assert len(open_run(folder).manifest["resumed"]) <= kills


def test_killed_before_the_first_checkpoint(whole: Path, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    assert killed(9, run, CASE, folder) == -signal.SIGKILL
    assert not list(folder.glob("checkpoints/*.npz"))
    assert open_run(folder).status == "running"
    resume(folder, quiet=True)
    assert_same(folder, whole)


# ---------------------------------------------------------------- checkpoints that cannot be used


@pytest.fixture(scope="module")
def stopped_once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("stopped") / "run"
    with pytest.MonkeyPatch.context() as patch:
        stop_after(patch, 5)
        with pytest.raises(StoppedError):
            run(CASE, folder, quiet=True)
    return folder


@pytest.fixture
def stopped(stopped_once: Path, tmp_path: Path) -> Path:
    """A run with checkpoints after 4 and 5 steps."""
    return shutil.copytree(stopped_once, tmp_path / "run")


def truncated(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-100])


def flipped(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 4
    path.write_bytes(content)


def test_a_damaged_checkpoint_is_passed_over(stopped: Path, whole: Path) -> None:
    newest = stopped / "checkpoints" / "step-000005.npz"
    flipped(newest)
    resume(stopped, quiet=True)
    log = (stopped / "run.log").read_text(encoding="utf-8")
    assert f"passed over: '{newest}' is not as it was written" in log
    manifest = open_run(stopped).manifest
    assert (manifest["resumed"][0]["from_s"], manifest["reason"]) == (0.2, "")
    assert_same(stopped, whole)


def emptied(path: Path) -> None:
    path.write_bytes(b"")


def unreadable(path: Path) -> None:
    path.unlink()
    path.mkdir()


def flipped_at_the_end(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-1] + b"x")


@pytest.mark.parametrize("damage", [truncated, flipped, flipped_at_the_end, emptied, unreadable])
def test_every_damage_is_seen(stopped: Path, damage: Callable[[Path], None]) -> None:
    """With no checkpoint left nothing is changed."""
    folder = stopped / "checkpoints"
    damage(folder / "step-000005.npz")
    flipped(folder / "step-000004.npz")
    before = {path: path.read_bytes() for path in stopped.rglob("*") if path.is_file()}
    said = r"no checkpoint can be used: .*step-000005\.npz' (is not|cannot be read: Is).*step-000004\.npz' is not as"
    with pytest.raises(OutputError, match=said):
        resume(stopped, quiet=True)
    assert {path: path.read_bytes() for path in stopped.rglob("*") if path.is_file()} == before


def test_other_case_version_and_mesh_are_refused(stopped: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = stopped / "case.toml"
    written = file.read_text(encoding="utf-8")
    file.write_text(CASE.replace(**{"materials.wall.young": 9e4, "loads.inlet_flow.value": 3e-6}).to_toml())
    with pytest.raises(OutputError, match=r"materials\.wall\.young_Pa is .* there, 90000\.0 here \(and 1 more\)"):
        resume(stopped, quiet=True)
    file.write_text(CASE.replace(name="renamed").to_toml())
    with monkeypatch.context() as patch:
        patch.setattr("ngfsi.__version__", "99")
        with pytest.raises(OutputError, match=r"of something else: version\.ngfsi is .* there, 99 here"):
            resume(stopped, quiet=True)
    with monkeypatch.context() as patch:
        patch.setattr("ngfsi.mesh.domain.Domain.fingerprint", "other")
        with pytest.raises(OutputError, match="is of another mesh"):
            resume(stopped, quiet=True)
    file.write_text(written)
    resume(stopped, quiet=True)


def test_runs_that_cannot_be_resumed(whole: Path, stopped: Path, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="is complete: there is nothing to resume"):
        resume(whole)
    with pytest.raises(OutputError, match="holds no run"):
        resume(tmp_path)
    with pytest.raises(OutputError, match=r"case\.toml' is no folder"):
        resume(stopped / "case.toml")
    under_way = RunFolder.reopen(stopped, CASE, 0.25)
    with pytest.raises(OutputError, match="is being computed by another process"):
        resume(stopped)
    under_way.finish("interrupted")
    resume(stopped, quiet=True)


# ---------------------------------------------------------------- disks


def test_a_checkpoint_that_cannot_be_written_costs_nothing(
    whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = Path.write_bytes

    def full(path: Path, content: bytes) -> int:
        real(path, content[: len(content) // 2])
        if "step-000004" in path.name:
            raise OSError(errno.EROFS, os.strerror(errno.EROFS))
        return real(path, content)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_bytes", full)
        stop_after(patch, 5)
        with pytest.raises(StoppedError):
            run(CASE, tmp_path / "run", quiet=True)
    kept = sorted(path.name for path in (tmp_path / "run" / "checkpoints").iterdir())
    assert kept == ["step-000002.npz", "step-000005.npz"]
    assert f"t = 0.2 s: no checkpoint: '{tmp_path}/run/checkpoints/step-000004.npz' cannot be written: " in (
        tmp_path / "run" / "run.log"
    ).read_text(encoding="utf-8")
    resume(tmp_path / "run", quiet=True)
    assert_same(tmp_path / "run", whole)


def test_a_full_disk_ends_the_run_in_a_sentence(whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing can be written any more, not even how it ended: what is there can be read, and resumed later."""
    left = iter([True] * 45)
    real = os.fsync

    def full(number: int) -> None:
        if not next(left, False):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        real(number)

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        with pytest.raises(OutputError, match=r"cannot be written: No space left on device"):
            run(CASE, tmp_path / "run", quiet=True)
    assert 2 < len(open_run(tmp_path / "run").series["time_s"]) <= STEPS
    resume(tmp_path / "run", quiet=True)
    assert_same(tmp_path / "run", whole)


def test_the_last_good_state_is_on_the_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a run that fails, with the velocity of that state and not of the attempt."""
    inspect = Deformation.inversion
    good = iter([True] * 4)
    monkeypatch.setattr(Deformation, "inversion", lambda self: inspect(self) if next(good, False) else "too far")
    with pytest.raises(SolverError, match=r"ended at t = 0\.2 s .* too far; .* what was computed is in"):
        run(CASE.replace(**{"time.smallest_step": 0.04, "output.fields_every": 0}), tmp_path / "failed", quiet=True)
    monkeypatch.undo()
    wanted = run(CASE.replace(**{"time.end": 0.2, "output.fields_every": 0}), tmp_path / "short", quiet=True)
    assert open_run(tmp_path / "failed").field_times() == [0.0, 0.2] == wanted.field_times()
    found, expected = (open_run(tmp_path / name).fields(0.2).point_data for name in ("failed", "short"))
    for name in ("velocity_m_s", "displacement_m", "pressure_Pa"):
        np.testing.assert_allclose(found[name], expected[name], rtol=0, atol=1e-6 * np.abs(expected[name]).max())
