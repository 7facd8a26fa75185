"""A few damaged mesh files; `python -m tests.hostile 500` tries more."""

from __future__ import annotations

from pathlib import Path

from tests.hostile import attack, originals, outcome


def test_damaged_files(tmp_path: Path) -> None:
    """Each is read or refused in one sentence; nothing is written; without damage all are read."""
    (tmp_path / "whole").mkdir()
    assert {outcome(*entry) for entry in originals(tmp_path / "whole").items()} == {"read"}
    counts, wrong = attack(66, 3, tmp_path)
    assert wrong == []
    assert counts["refused"] > 50
