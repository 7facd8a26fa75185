"""The page of a study: what it found, which runs failed, and how to repeat it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from ngfsi.store.disk import replace_file
from ngfsi.study.engine import Outcome


def write_page(
    folder: Path, study: str, level: str, parts: Sequence[str], outcomes: Mapping[str, Outcome] | None = None
) -> Path:
    """Write report.md of a study that was run at a level, and return its path.

    Args:
        parts: paragraphs in Markdown, each with a line end.
        outcomes: the runs of which the page says which failed, and why; none: `parts` say it.
    """
    failures = [f"- {key}: {outcome.failure}" for key, outcome in (outcomes or {}).items() if outcome.failure]
    failed = ["## Failed\n", "\n".join(failures) + "\n"] if failures else []
    path = folder / "report.md"
    repeat = f"## To repeat it\n\n    ngfsi study {study} --level {level}\n"
    replace_file(path, "\n".join([*parts, *failed, repeat]).encode())
    return path
