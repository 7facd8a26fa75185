"""Time by kind of work."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import perf_counter, process_time


class Stopwatch:
    """Adds up seconds; work inside of other work counts as itself alone, so that the sum is the time on the clock.

    Attributes:
        seconds: on the clock, by kind of work.
        cpu_s: of the processor, by kind of work.
    """

    def __init__(
        self, clock: Callable[[], float] = perf_counter, processor: Callable[[], float] = process_time
    ) -> None:
        """Begin.

        Args:
            processor: seconds of the processor, on several ranks without those of waiting for others.
        """
        self._clocks = clock, processor
        self.seconds: defaultdict[str, float] = defaultdict(float)
        self.cpu_s: defaultdict[str, float] = defaultdict(float)
        self._under_way: list[str] = []
        self._since = [0.0, 0.0]

    @property
    def work(self) -> str:
        """The kind of work that is under way; empty: none."""
        return self._under_way[-1] if self._under_way else ""

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
        now = [clock() for clock in self._clocks]
        if self._under_way:
            for taken, end, start in zip((self.seconds, self.cpu_s), now, self._since, strict=True):
                taken[self._under_way[-1]] += end - start
        self._since = now
