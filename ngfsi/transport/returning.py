"""What has left through an opening, and comes back first when the flow turns."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ngfsi.arrays import Array


class Returning:
    """Blood beyond an opening, in the order in which it left: it waits there unmixed.

    Attributes:
        parcels: (volume m3, amount of the scalar, time at which it left s), the last to leave at the end.
    """

    def __init__(self, fresh: bool, most: float, outside: Callable[[float], float]) -> None:
        """Prepare.

        Args:
            fresh: whether blood beyond what has left brings nothing of the scalar; otherwise it is not known.
            most: volume (m3) that is remembered.
            outside: by how much the scalar grows in a time (s) outside.
        """
        self._fresh, self._most, self._outside = fresh, most, outside
        self.parcels: list[tuple[float, float, float]] = []

    def entering(self, volume: float, now: float) -> float | None:
        """Return the mean of the scalar in a volume (m3) that comes back; None: it is not known."""
        taken, amount, _ = self._next(volume, now)
        if self._fresh:
            return amount / volume if volume > 0 else 0.0
        return amount / taken if taken > 0 else None

    def turn(self, back: float, out: float, amount: float, now: float) -> None:
        """Take note of the volumes (m3) that came back and left, and of the amount that left."""
        self.parcels = self._next(back, now)[2]
        if out > 0:
            self.parcels.append((out, amount, now))
        surplus = sum(volume for volume, _, _ in self.parcels) - self._most
        while surplus > 0 and self.parcels:
            volume, held, since = self.parcels.pop(0)
            if volume > surplus:
                self.parcels.insert(0, (volume - surplus, held * (1 - surplus / volume), since))
            surplus -= volume

    def _next(self, volume: float, now: float) -> tuple[float, float, list[tuple[float, float, float]]]:
        """Return how much of a volume is there, the amount in it, and what would stay outside."""
        rest, taken, amount = list(self.parcels), 0.0, 0.0
        while rest and taken < volume:
            size, held, since = rest.pop()
            part = min(size, volume - taken)
            taken += part
            amount += part * (held / size + self._outside(now - since))
            if part < size:
                rest.append((size - part, held * (1 - part / size), since))
        return taken, amount, rest

    def array(self) -> Array:
        """Return the parcels (n, 3), for `restore`."""
        return np.array(self.parcels).reshape(-1, 3)

    def restore(self, parcels: Array) -> None:
        """Take what `array` returned."""
        self.parcels = [(float(a), float(b), float(c)) for a, b, c in parcels]
