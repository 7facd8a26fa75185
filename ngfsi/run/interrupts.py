"""Requests to end a run early: signals, a limit on the clock, a file. A run heeds them between two steps.

Before the first step, where there is nothing to keep, and when a signal comes again, it ends at once.
"""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from time import perf_counter
from types import FrameType
from typing import Any, Self

from ngfsi.errors import Interrupted, StoppedError

SIGNALS = {signal.SIGINT: "by Ctrl-C", signal.SIGTERM: "by SIGTERM"}


def time_left(max_wall: float | None) -> Callable[[], float | None]:
    """Return what tells how many of the seconds on the clock, from now on, are left; None: there is no limit."""
    began = perf_counter()
    return lambda: None if max_wall is None else max(0.0, max_wall - (perf_counter() - began))


class Stops:
    """Context manager that hears requests to end.

    Attributes:
        patient: whether a first signal waits until the run asks `request`; otherwise it interrupts at once.
    """

    def __init__(self, file: Path, max_wall: float | None = None) -> None:
        """Hear a file that asks to end when it exists, and a limit: seconds on the clock from now on; None: any."""
        self.patient = False
        self._file, self._max_wall = file, max_wall
        self._began = perf_counter()
        self._latest, self._longest = self._began, 0.0
        self._heard: signal.Signals | None = None
        self._before: dict[signal.Signals, Any] = {}

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():  # Python hears signals nowhere else
            self._before = {number: signal.signal(number, self._on_signal) for number in SIGNALS}
        return self

    def __exit__(self, _kind: object, error: object, _trace: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
        if isinstance(error, KeyboardInterrupt) and not isinstance(error, Interrupted):  # at once
            raise self._interruption() from None

    def _on_signal(self, number: int, _frame: FrameType | None) -> None:
        again, self._heard = self._heard is not None, signal.Signals(number)
        if again or not self.patient:
            raise KeyboardInterrupt
        print("ngfsi: ends after this step; the same again ends it at once", file=sys.stderr, flush=True)

    def request(self) -> Interrupted | StoppedError | None:
        """Return what asks the run to end now, to be raised, after each step; None: nothing does."""
        now = perf_counter()
        self._longest, self._latest = max(self._longest, now - self._latest), now
        if self._heard is not None:
            return self._interruption()
        if self._file.exists():
            self._file.unlink(missing_ok=True)
            return StoppedError(f"stopped by the file {self._file.name}")
        # a step more would not fit
        if self._max_wall is not None and now + self._longest > self._began + self._max_wall:
            return StoppedError(f"stopped before the {self._max_wall:g} s of --max-wall are over")
        return None

    def _interruption(self) -> Interrupted:
        heard = self._heard or signal.SIGINT
        return Interrupted(f"interrupted {SIGNALS[heard]}", 128 + heard)
