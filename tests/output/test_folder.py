"""Run folders: written step by step, readable at any time, and refused where they cannot be."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest

import ngfsi
from ngfsi.errors import OutputError
from ngfsi.store import RunFolder, open_run
from ngfsi.store.folder import STOP, outline_rows
from ngfsi.store.provenance import commit
from ngfsi.store.table import TableWriter, read_table, write_parquet, write_rows
from tests.output.fake import CASE


def test_series_is_on_the_disk_after_each_row_and_exact(tmp_path: Path) -> None:
    folder = RunFolder.create(tmp_path / "a" / "b", CASE)
    rows = [{"time_s": 0.0, "sawss_Pa": 1 / 3}, {"time_s": 0.1 + 0.2, "sawss_Pa": np.float64(1e-300)}]
    for number, row in enumerate(rows, start=1):
        folder.append("series", dict(row))
        series = open_run(folder.path).series
        assert list(series) == ["time_s", "sawss_Pa"]
        assert [len(column) for column in series.values()] == [number, number]
    assert series["time_s"].tolist() == [0.0, 0.1 + 0.2]
    assert series["sawss_Pa"].tolist() == [1 / 3, 1e-300]
    assert (folder.path / "series.csv").read_text(encoding="utf-8").splitlines()[0] == "time_s,sawss_Pa"


def test_a_row_with_other_columns_is_a_mistake(tmp_path: Path) -> None:
    folder = RunFolder.create(tmp_path / "run", CASE)
    folder.append("series", {"time_s": 0.0, "sawss_Pa": 1.0})
    with pytest.raises(ValueError, match="sawss_Pa"):
        folder.append("series", {"time_s": 0.1})
    folder.append("series", {"sawss_Pa": 2.0, "time_s": 0.1})  # the order does not matter
    assert open_run(folder.path).series["sawss_Pa"].tolist() == [1.0, 2.0]


def test_a_line_cut_short_by_a_crash_is_left_out(tmp_path: Path) -> None:
    path = tmp_path / "series.csv"
    TableWriter(path).append({"time_s": 0.0, "x_1": 1.5}, {"time_s": 0.1, "x_1": 2.5})
    with path.open("a") as file:
        file.write("0.2,3")
    assert read_table(path)["x_1"].tolist() == [1.5, 2.5]
    path.write_text("time_s,x_1\n0.0,a\n")
    with pytest.raises(OutputError, match=r"series\.csv' is not a table of numbers"):
        read_table(path)
    path.write_text("time_s,x")  # cut within the header
    assert read_table(path) == {}


def test_outlines_return_the_rings_of_the_nearest_time(tmp_path: Path) -> None:
    folder = RunFolder.create(tmp_path / "run", CASE)
    rings = np.random.default_rng(0).random((3, 2, 7, 3))
    for time, ring in zip((0.0, 0.25, 0.5), rings, strict=True):
        folder.append("outlines", *outline_rows({"time_s": time}, ring))
    time, found = open_run(folder.path).outlines(0.3)
    assert time == 0.25
    np.testing.assert_array_equal(found, rings[1])


def test_manifest_merges_tables_and_keeps_a_readable_state(tmp_path: Path) -> None:
    folder = RunFolder.create(tmp_path / "run", CASE)
    started = open_run(folder.path)
    assert (started.status, started.series, started.costs) == ("running", {}, {})
    assert started.manifest["case_digest"] == CASE.digest
    assert {"ngfsi", "ngsolve", "numpy", "python"} <= set(started.manifest["versions"])
    assert {"started", "commit", "machine"} <= set(started.manifest)
    folder.update_manifest(mesh={"elements": np.int64(7)}, seconds={"mesh": 1.0})
    folder.update_manifest(seconds={"steps": np.float64(2.5)})
    folder.finish("failed", "it did not converge")
    ended = open_run(folder.path)
    assert (ended.status, ended.manifest["reason"]) == ("failed", "it did not converge")
    assert ended.manifest["seconds"] == {"mesh": 1.0, "steps": 2.5}
    assert ended.manifest["mesh"] == {"elements": 7}
    assert ended.case == CASE
    (folder.path / STOP).touch()
    again = open_run(RunFolder.reopen(folder.path, CASE, None).path)
    assert (again.status, again.manifest["reason"], (folder.path / STOP).exists()) == ("running", "", False)
    assert "failed: it did not converge" in (folder.path / "run.log").read_text(encoding="utf-8")
    assert sorted(path.name for path in folder.path.iterdir()) == ["case.toml", "manifest.json", "run.log"]


def test_folders_that_cannot_be_used(tmp_path: Path) -> None:
    RunFolder.create(tmp_path / "run", CASE)
    with pytest.raises(OutputError, match=r"run' already holds a run: name another one with --output"):
        RunFolder.create(tmp_path / "run", CASE)
    (tmp_path / "other").mkdir()
    RunFolder.create(tmp_path / "other", CASE)  # an empty folder is fine
    (tmp_path / "file").write_text("mine")
    with pytest.raises(OutputError, match="is a file where the folder of the run should be"):
        RunFolder.create(tmp_path / "file", CASE)
    with pytest.raises(OutputError, match="cannot be made: Not a directory"):
        RunFolder.create(tmp_path / "file" / "run", CASE)
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "letter.txt").write_text("mine")
    with pytest.raises(OutputError, match="full' already is not empty"):
        RunFolder.create(tmp_path / "full", CASE)
    assert (tmp_path / "full" / "letter.txt").read_text(encoding="utf-8") == "mine"


def test_a_disk_that_fails_is_named(tmp_path: Path) -> None:
    folder = RunFolder.create(tmp_path / "run", CASE)
    (folder.path / "series.csv").mkdir()
    with pytest.raises(OutputError, match=r"series\.csv' cannot be written: Is a directory"):
        folder.append("series", {"time_s": 0.0})


def test_folders_that_hold_no_run(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="nowhere' does not exist"):
        open_run(tmp_path / "nowhere")
    (tmp_path / "notes.txt").touch()
    with pytest.raises(OutputError, match=r"notes\.txt' is no folder: name the folder of a run"):
        open_run(tmp_path / "notes.txt")
    (tmp_path / "notes.txt").unlink()
    with pytest.raises(OutputError, match=r"holds no run: manifest\.json and case\.toml are expected"):
        open_run(tmp_path)
    RunFolder.create(tmp_path / "run", CASE)
    for content in ("{", json.dumps([1]), json.dumps({"x": 1})):
        (tmp_path / "run" / "manifest.json").write_text(content)
        with pytest.raises(OutputError, match=r"manifest\.json' is not the manifest of a run"):
            open_run(tmp_path / "run")


def test_reading_what_is_not_there_yet(tmp_path: Path) -> None:
    RunFolder.create(tmp_path / "run", CASE)
    run = open_run(tmp_path / "run")
    assert run.field_times() == []
    with pytest.raises(OutputError, match="holds no fields of the wall yet"):
        run.fields(0.0, "wall")
    with pytest.raises(OutputError, match="holds no cross-sections yet"):
        run.outlines(0.0)


def test_commit_is_that_of_the_clone_and_of_no_other_repository(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def git(*arguments: str) -> None:
        identity = ["-c", "user.name=a", "-c", "user.email=a@b"]
        subprocess.run(["git", "-C", str(tmp_path), *identity, *arguments], check=True, capture_output=True)

    package = tmp_path / "ngfsi"
    installed = tmp_path / ".venv" / "site-packages" / "ngfsi"
    for place in (package, installed):
        place.mkdir(parents=True)
        (place / "__init__.py").write_text("")
    git("init")
    git("add", ".")
    monkeypatch.setattr(ngfsi, "__file__", str(package / "__init__.py"))
    assert commit() is None  # nothing is committed yet
    git("commit", "-m", "first")
    found = commit()
    assert found is not None
    assert (len(found["id"]), found["dirty"]) == (40, False)
    (package / "__init__.py").write_text("changed")
    assert (commit() or {})["dirty"] is True
    monkeypatch.setattr(ngfsi, "__file__", str(installed / "__init__.py"))
    assert commit() is None


def test_a_whole_table_as_csv_and_parquet(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Both hold the floats to the last bit; what is missing is empty; without pyarrow there is no Parquet."""
    rows: list[dict[str, float | str]] = [
        {"case": 'a, "b"', "x_m": 1 / 3, "run": "0a"}, {"case": "c", "x_m": "", "run": "0b"}
    ]  # fmt: skip
    write_rows(tmp_path / "t.csv", rows)
    assert (tmp_path / "t.csv").read_text(encoding="utf-8") == f'case,x_m,run\n"a, ""b""",{1 / 3!r},0a\nc,,0b\n'
    assert write_parquet(tmp_path / "t.parquet", rows)
    found = pytest.importorskip("pyarrow.parquet").read_table(tmp_path / "t.parquet")
    assert found.to_pydict() == {"case": ['a, "b"', "c"], "x_m": [1 / 3, None], "run": ["0a", "0b"]}
    assert str(found.schema.field("x_m").type) == "double"
    monkeypatch.setattr("ngfsi.store.table.find_spec", lambda _: None)
    assert not write_parquet(tmp_path / "none.parquet", rows)
    assert not (tmp_path / "none.parquet").exists()
