"""Progress on the terminal, of one run or of several; a few plain lines where nobody watches (no terminal, or CI)."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.progress import BarColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.progress import Progress as Bar

from ngfsi.store.table import read_table

PLAIN_SHARE = 0.1
"""Part of the run between two plain lines."""


def _watched() -> bool:
    return Console(stderr=True).is_terminal and not os.environ.get("CI")


def _bar(*, hidden: bool) -> Bar:
    return Bar(
        TextColumn("[bold]{task.description}"),
        BarColumn(),
        TextColumn("{task.fields[detail]}"),
        TimeElapsedColumn(),
        TextColumn("ETA"),
        TimeRemainingColumn(),
        console=Console(stderr=True),
        disable=hidden,
    )


class Progress:
    """Context manager that shows how far a run is.

    A bar on a terminal; when standard error is no terminal or `CI` is set, a plain line every tenth of the run.
    """

    def __init__(self, title: str, *, end: float, steps: int, quiet: bool = False) -> None:
        """Prepare.

        Args:
            title: what runs.
            end: time at the end of the run [s].
            steps: expected number of steps.
            quiet: show nothing at all.
        """
        self.title, self.end, self.steps = title, end, steps
        self._plain = not quiet and not _watched()
        self._said = 0.0
        self._bar = _bar(hidden=quiet or not _watched())
        self._task = self._bar.add_task(title, total=end, detail="")

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bar.stop()

    def phase(self, name: str) -> None:
        """Say what is being done before the first step, e.g. "meshing"."""
        self._bar.update(self._task, detail=name)
        self._bar.refresh()

    def advance(self, step: int, time: float, iterations: int) -> None:
        """Show that step number `step` reached `time` [s] with this many Newton iterations."""
        detail = f"step {step}/{max(step, self.steps)}  t = {time:.4g} s  {iterations} iterations"
        self._bar.update(self._task, completed=time, detail=detail)
        done = time / self.end
        if self._plain and (done >= self._said + PLAIN_SHARE or done >= 1):
            self._said = done
            print(f"{self.title}: {done:4.0%}  {detail}", file=sys.stderr, flush=True)


MOST_SHOWN = 12
"""Runs that have a line each; of more only those under way and those that failed are shown."""


class Watch:
    """Context manager that shows how far runs in other processes are, by what they stored, and how many are done."""

    def __init__(self, runs: Mapping[str, tuple[Path, float]], *, quiet: bool = False) -> None:
        """Prepare.

        Args:
            runs: title -> (folder of the run, time at its end [s]).
            quiet: show nothing at all.
        """
        self._runs = runs
        self._ended: dict[str, bool] = {}
        """Title -> whether it failed."""
        self._plain = not quiet and not _watched()
        self._bar = _bar(hidden=quiet or not _watched())
        self._few = len(runs) <= MOST_SHOWN
        self._all = self._bar.add_task("all cases", total=len(runs), detail=self._count, visible=len(runs) > 1)
        self._tasks = {
            key: self._bar.add_task(key, total=end, detail="waiting", start=False, visible=self._few)
            for key, (_, end) in runs.items()
        }

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bar.stop()

    @property
    def _count(self) -> str:
        failed = sum(self._ended.values())
        return f"{len(self._ended)} of {len(self._runs)}" + (f", {failed} failed" if failed else "")

    def look(self) -> None:
        """Read how far the runs are."""
        for key, task in self._tasks.items():
            folder = self._runs[key][0]
            if key in self._ended or not folder.exists():
                continue
            self._bar.start_task(task)
            self._bar.update(task, visible=True)
            table = read_table(folder / "series.csv")
            if table and len(table["time_s"]):
                time = float(table["time_s"][-1])
                self._bar.update(task, completed=time, detail=f"t = {time:.4g} s")

    def finished(self, key: str, failure: str) -> None:
        """Show that a run ended, by itself or (`failure` not empty) with an error."""
        self._ended[key] = bool(failure)
        self._bar.update(
            self._tasks[key], detail="failed" if failure else "completed", visible=self._few or bool(failure)
        )
        self._bar.stop_task(self._tasks[key])
        self._bar.update(self._all, completed=len(self._ended), detail=self._count)
        if self._plain:
            said = f"failed: {failure}" if failure else "completed"
            print(f"{key}: {said} ({self._count})", file=sys.stderr, flush=True)
