"""How long a run may go on handing out work."""

import math
import time
from collections.abc import Callable


class Budget:
    """Seconds from now; what is spent stays spent.

    Args:
        seconds: how many; None for no end.
        clock: tells the time.
    """

    def __init__(self, seconds: float | None = None, clock: Callable[[], float] = time.monotonic) -> None:
        self.seconds = seconds
        self._clock = clock
        self._end = math.inf if seconds is None else clock() + seconds
        self._spent = False

    def spent(self) -> bool:
        """Whether they are over."""
        self._spent = self._spent or self._clock() >= self._end
        return self._spent
