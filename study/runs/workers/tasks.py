"""Tasks: items of work put together until they weigh enough to be sent, the heaviest in sight first."""

import heapq
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import count
from typing import Generic, TypeVar

T = TypeVar("T")
_WINDOW = 1024
"""Items in sight, of which the heaviest goes first."""


@dataclass(frozen=True)
class WorkerTask(Generic[T]):
    """Items that one worker computes.

    Attributes:
        items: the items.
        tries: how often they have been sent, this time included.
    """

    items: tuple[T, ...]
    tries: int = 1

    def alone(self) -> list["WorkerTask[T]"]:
        """Make a task of each item, for another try."""
        return [WorkerTask((item,), self.tries + 1) for item in self.items]


def cut(items: Iterable[T], weigh: Callable[[T], float], enough: float) -> Iterator[WorkerTask[T]]:
    """Put items together to tasks.

    Args:
        items: the work; taken as needed.
        weigh: gives the weight of an item.
        enough: weight from which a task takes no more items.
    """
    number = count()
    source = ((-weigh(item), next(number), item) for item in items)
    sight: list[tuple[float, int, T]] = []
    together: list[T] = []
    load = 0.0
    while True:
        while len(sight) < _WINDOW and (entry := next(source, None)) is not None:
            heapq.heappush(sight, entry)
        if not sight:
            break
        lightness, _, item = heapq.heappop(sight)
        together.append(item)
        load -= lightness
        if load >= enough:
            yield WorkerTask(tuple(together))
            together, load = [], 0.0
    if together:
        yield WorkerTask(tuple(together))
