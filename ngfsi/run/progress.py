"""Progress on the terminal, of one run or of several; a few plain lines where nobody watches (no terminal, or CI)."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Self

from rich.console import Console
from rich.progress import BarColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.progress import Progress as Bar

from ngfsi.store.table import read_table

PLAIN_SHARE = 0.1
"""Part of the run between two plain lines."""
MOST_SHOWN = 12
"""Runs that have a line each; of more only those under way and those that failed are shown."""


class _Display:
    """Context manager of bars on a terminal; where standard error is none or `CI` is set, of plain lines."""

    def __init__(self, *, quiet: bool) -> None:
        console = Console(stderr=True)
        watched = console.is_terminal and not os.environ.get("CI")
        self._plain = not quiet and not watched
        self._bar = Bar(
            TextColumn("[bold]{task.description}"), BarColumn(), TextColumn("{task.fields[detail]}"),
            TimeElapsedColumn(), TextColumn("ETA"), TimeRemainingColumn(), console=console,
            disable=quiet or not watched,
        )  # fmt: skip

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()

    def _print(self, line: str) -> None:
        if self._plain:
            print(line, file=sys.stderr, flush=True)


class Progress(_Display):
    """Context manager that shows how far a run is; a plain line every tenth of the run."""

    def __init__(self, title: str, *, end: float, steps: int, quiet: bool = False) -> None:
        """Show a run up to a time [s], of so many steps as expected; quiet: show nothing at all."""
        super().__init__(quiet=quiet)
        self.title, self.end, self.steps = title, end, steps
        self._said = 0.0
        self._task = self._bar.add_task(title, total=end, detail="")

    def advance(self, step: int, time: float, iterations: int) -> None:
        """Show that step number `step` reached `time` [s] with this many Newton iterations."""
        detail = f"step {step}/{max(step, self.steps)}  t = {time:.4g} s  {iterations} iterations"
        self._bar.update(self._task, completed=time, detail=detail)
        done = time / self.end
        if done >= self._said + PLAIN_SHARE or done >= 1:
            self._said = done
            self._print(f"{self.title}: {done:4.0%}  {detail}")


class Watch(_Display):
    """Context manager that shows how far runs in other processes are, by what they stored, and how many are done."""

    def __init__(self, runs: Mapping[str, tuple[Path, float]], *, quiet: bool = False) -> None:
        """Show runs by title, each with its folder and the time at its end [s]; quiet: show nothing at all."""
        super().__init__(quiet=quiet)
        self._runs = runs
        self._ended: dict[str, bool] = {}
        """Title -> whether it failed."""
        self._few = len(runs) <= MOST_SHOWN
        self._all = self._bar.add_task("all cases", total=len(runs), detail=self._count, visible=len(runs) > 1)
        self._tasks = {
            key: self._bar.add_task(key, total=end, detail="waiting", start=False, visible=self._few)
            for key, (_, end) in runs.items()
        }

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
        said = "failed" if failure else "completed"
        self._bar.update(self._tasks[key], detail=said, visible=self._few or bool(failure))
        self._bar.stop_task(self._tasks[key])
        self._bar.update(self._all, completed=len(self._ended), detail=self._count)
        self._print(f"{key}: {said}{f': {failure}' if failure else ''} ({self._count})")
