"""What is made of a quantity over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ngfsi.arrays import Array
from ngfsi.errors import CaseError
from ngfsi.units import SAME_TIME


@dataclass(frozen=True)
class Window:
    """What is made of a quantity over time: its mean over a window, or its change from the start to the end.

    Attributes:
        start, end: s; the end at infinity is that of the run.
        kind: mean, or least of the means of parts: of values that are linear between steps; end: the value at the end;
            change: that less the first; loss: the fraction of the first that is lost.
    """

    kind: str = "end"
    start: float = 0.0
    end: float = np.inf

    def weights(self, times: Array, values: Array) -> tuple[float, Array]:
        """Return the number that is made of values at times, and its derivatives by them."""
        slopes = np.zeros(len(times))
        if self.kind in ("mean", "least"):
            start, end = max(self.start, times[0]), min(self.end, times[-1])
            if start > end + SAME_TIME:
                raise CaseError(f"--window {self.start:g},{self.end:g} holds no time of the run, which ends at "
                                f"{times[-1]:g} s")  # fmt: skip
            if end - start > SAME_TIME:
                sizes, ends = np.diff(times), np.clip(times, start, end)
                inside, middle = np.diff(ends) / (end - start), (ends[:-1] + ends[1:]) / 2
                slopes[:-1] += inside * (times[1:] - middle) / sizes
                slopes[1:] += inside * (middle - times[:-1]) / sizes
                return float(slopes @ values), slopes
        after = min(max(int(np.searchsorted(times, self.end - SAME_TIME)), 1), len(times) - 1)
        done = min(max((self.end - times[after - 1]) / (times[after] - times[after - 1]), 0.0), 1.0)
        slopes[after - 1], slopes[after] = 1.0 - done, done
        first, last = values[0], slopes @ values
        if self.kind in ("end", "mean", "least"):
            return float(last), slopes
        if self.kind == "change":
            slopes[0] -= 1.0
            return float(last - first), slopes
        slopes /= -first
        slopes[0] += last / first**2
        return float(1 - last / first), slopes


def wanted(of: str, kinds: Sequence[str]) -> tuple[str, str]:
    """Return the quantity that a name means, and what is made of it."""
    name, _, kind = of.rpartition("_")
    return (name, kind) if name and kind in kinds else (of, "end")
