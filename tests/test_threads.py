"""A run with several threads gives the results of one with a single thread, but for the order of sums."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from ngfsi.parallel.ranks import LAUNCHERS, SERIAL, all_ranks, threads
from ngfsi.run import run
from ngfsi.store import open_run
from tests.test_resume import CASE

SHORT = CASE.replace(**{"time.end": 0.05})


def test_two_threads_change_no_result(tmp_path: Path) -> None:
    """To 1e-9 of each column's largest value; the defect of mass, itself nothing but rounding, to that of the flow."""
    (tmp_path / "case.toml").write_text(SHORT.to_toml())
    command = [sys.executable, "-m", "ngfsi.cli", "run", str(tmp_path / "case.toml"), "--output", str(tmp_path / "two")]
    subprocess.run([*command, "--quiet"], env=os.environ | threads(2), check=True)
    one, two = run(SHORT, tmp_path / "one", quiet=True), open_run(tmp_path / "two")
    assert (one.manifest["threads"], two.manifest["threads"]) == (1, 2)
    assert list(two.series) == list(one.series)
    for name, column in one.series.items():
        scale = np.max(np.abs(one.series["flow_in_m3_s" if name == "mass_defect_m3_s" else name]))
        np.testing.assert_allclose(two.series[name], column, rtol=0, atol=1e-9 * scale, err_msg=name)


@pytest.mark.parametrize(
    ("mine", "said", "wanted"), [({1, 3}, None, "2"), ({1, 3}, "5", "5"), (set(range(8)), None, None)]
)
def test_no_more_threads_than_processors(
    monkeypatch: pytest.MonkeyPatch, mine: set[int], said: str | None, wanted: str | None
) -> None:
    """A process that mpirun or Slurm bound to some processors takes those, unless the environment says otherwise."""
    name = "NGS_NUM_THREADS"
    for variable in (name, *LAUNCHERS.values()):
        monkeypatch.setenv(variable, "")  # so that what the test makes of it is taken back
        monkeypatch.delenv(variable)
    if said:
        monkeypatch.setenv(name, said)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: mine, raising=False)
    monkeypatch.setattr(os, "cpu_count", lambda: 8)
    all_ranks.cache_clear()
    assert all_ranks() is SERIAL
    assert os.environ.get(name) == wanted
