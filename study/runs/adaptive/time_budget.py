"""A time budget: seconds after which a run starts no new work."""

import math
import time
from collections.abc import Callable


class TimeBudget:
    """Seconds from now; once spent, it stays spent.

    Args:
        seconds: how many; None for no limit.
        clock: gives the time in seconds.
    """

    def __init__(self, seconds: float | None = None, clock: Callable[[], float] = time.monotonic) -> None:
        self.seconds = seconds
        self._clock = clock
        self._end = math.inf if seconds is None else clock() + seconds
        self._spent = False

    def spent(self) -> bool:
        """Tell whether the time is over."""
        self._spent = self._spent or self._clock() >= self._end
        return self._spent
