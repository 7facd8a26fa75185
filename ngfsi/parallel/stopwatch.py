"""Wall time by kind of work."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import perf_counter


class Stopwatch:
    """Adds up seconds; work inside of other work counts as itself alone, so that the sum is the time on the clock."""

    def __init__(self, clock: Callable[[], float] = perf_counter) -> None:
        """Begin.

        Args:
            clock: that on the wall, or `time.process_time` on a machine with other work.
        """
        self._clock = clock
        self.seconds: defaultdict[str, float] = defaultdict(float)
        self._under_way: list[str] = []
        self._since = 0.0

    @contextmanager
    def __call__(self, work: str) -> Iterator[None]:
        """Time the block as a kind of work."""
        self._book()
        self._under_way.append(work)
        try:
            yield
        finally:
            self._book()
            self._under_way.pop()

    def _book(self) -> None:
        now = self._clock()
        if self._under_way:
            self.seconds[self._under_way[-1]] += now - self._since
        self._since = now
