"""What to cite, and the commands that repeat a run: carried out, they give the same bits."""

from __future__ import annotations

import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import ngfsi.run.computation
from ngfsi.materials import load_set
from ngfsi.report.citing import SOFTWARE, citations, repeat_commands
from ngfsi.store import open_run
from ngfsi.store.stored import StoredRun
from tests.output.fake import CASE as FAKE
from tests.output.fake import fake_run
from tests.test_resume import CASE, assert_same

SHORT = CASE.replace(**{"time.end": 0.1})


@pytest.fixture(scope="module")
def computed(tmp_path_factory: pytest.TempPathFactory) -> StoredRun:
    return ngfsi.run.computation.run(SHORT, tmp_path_factory.mktemp("a b") / "run", quiet=True)


def test_the_commands_repeat_the_run(computed: StoredRun) -> None:
    """In another process, by the last command as it is printed: the same to the last bit."""
    command = repeat_commands(computed)[-1].replace("ngfsi run", f"{shlex.quote(sys.executable)} -m ngfsi.cli run")
    threads = computed.manifest["threads"]
    done = subprocess.run(["/bin/sh", "-c", command], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    again = open_run(Path(f"{computed.path}-again"))
    assert again.manifest["threads"] == threads
    if threads == 1:
        assert_same(again.path, computed.path)
    for column, values in computed.series.items():
        np.testing.assert_allclose(again.series[column], values, rtol=0, atol=1e-9 * np.abs(values).max())


def test_checkpoints_do_not_change_the_results(computed: StoredRun, tmp_path: Path) -> None:
    often = ngfsi.run.computation.run(SHORT.replace(**{"output.checkpoint_every": 1}), tmp_path / "run", quiet=True)
    assert_same(often.path, computed.path)


def test_code_and_packages_are_named(tmp_path: Path) -> None:
    run = fake_run(tmp_path / "run")
    run.manifest["commit"] = {"id": "a" * 40, "dirty": True}
    checkout, remark, install, _ = repeat_commands(run)
    assert (checkout, remark) == (f"git checkout {'a' * 40}", "# the files differed from that commit")
    assert f"ngsolve=={run.manifest['versions']['ngsolve']}" in install
    assert "python==" not in install


def test_only_what_was_used_is_cited(tmp_path: Path) -> None:
    changed = {"conditions.initial_state": "prestress", "materials.wall": load_set("vein_wall_source", young_kPa=1)}
    run = fake_run(tmp_path / "run", FAKE.replace(**changed))
    run.manifest["linear_solver"] = "umfpack"
    found = citations(run)
    assert found["software"][1:] == list(SOFTWARE)
    text = "\n".join(found["methods"])
    assert ("Walker" in text, "Govindjee" in text, "UMFPACK" in text) == (True, True, True)
    assert ("PARDISO" in text, "Tezduyar" in text) == (False, False)
    assert any(line.startswith("tissue, law mooney_rivlin: M. Mooney") for line in found["materials"])
    assert any(line.startswith("wall: Y. Wang, PhD thesis") for line in found["materials"])
    plain = fake_run(tmp_path / "plain")
    assert "Govindjee" not in "\n".join(citations(plain)["methods"])


def test_the_citation_file_says_the_same() -> None:
    file = (Path(__file__).parents[2] / "CITATION.cff").read_text(encoding="utf-8")
    titles = [
        line.partition('title: "')[2].rstrip('"').partition(" (ASC")[0] for line in file.splitlines() if "title" in line
    ]
    assert len(titles) == 3
    assert all(title in reference for title, reference in zip(titles[1:], SOFTWARE, strict=True))
