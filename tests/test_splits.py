"""Every split of the processors gets the same runs, each computed anew with its number of threads."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from ngfsi_studies import splits

from ngfsi.errors import SolverError
from ngfsi.study import engine as study


def test_every_split_computes_all_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[str, int]] = []

    def compute(_text: str, folder: Path, threads: int, *_: Any) -> tuple[int, str]:
        asked.append((folder.name, threads))
        return (0, "") if threads < 3 else (3, "too many threads")

    monkeypatch.setattr(study, "_compute", compute)
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    text = splits.study("demo", tmp_path, quiet=True).read_text(encoding="utf-8")
    assert sorted(asked) == sorted((f"run{number}", threads) for number in range(4) for threads in (1, 2))
    assert re.findall(r"\| (\d) \| (\d) \|", text) == [("1", "2"), ("2", "1")]
    assert "# 4 equal runs on 2 processors" in text
    monkeypatch.setattr("os.cpu_count", lambda: 3)
    with pytest.raises(SolverError, match="with 1 processes a run failed: too many threads"):
        splits.study("demo", tmp_path, quiet=True)


def test_splits_share_all_processors() -> None:
    assert splits.splits(4) == [(1, 4), (2, 2), (4, 1)]
    text = splits.report({(1, 2): 30.0, (2, 1): 20.0}, 4)
    assert "| 1 | 2 | 30 | 1.50 |\n| 2 | 1 | 20 | 1.00 |" in text
