"""What all ranks do together beside solving: methods that rank 0 calls and each rank runs on its own elements."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from ngfsi.system.system import System

Method = TypeVar("Method", bound=Callable[..., Any])


class OnAllRanks:
    """Base of objects of a system that all ranks make by the same calls, and whose `together` methods they all run.

    Attributes:
        system: this rank's.
    """

    def __init__(self, system: System) -> None:
        self.system = system
        self._number = system.enrol(self)


def together(method: Method) -> Method:
    """Have all ranks run a method of `OnAllRanks` in the present state when rank 0 calls it.

    It must come to the same exchanges between the ranks on all of them: it depends on its arguments, the system's state
    and what such methods have left alone, and calls no other code than ngfsi's.
    """

    @wraps(method)
    def run(self: OnAllRanks, *args: Any, **named: Any) -> Any:
        system = self.system
        with system.ranks.order(
            "together", lambda: (self._number, method.__name__, args, named, system.watch.work), system.changed_state
        ):
            return method(self, *args, **named)

    return run  # type: ignore[return-value] # with the same arguments and result
