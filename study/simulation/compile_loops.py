"""Compile the loops that studies and claims use, so that none waits for the compiler: once after an installation.

``python -m study.simulation.compile_loops CONFIG…``. Numba keeps the compiled code beside the sources. A plan of a
study computes a few of its trials, and so compiles what its run needs.
"""

import logging
import sys
from pathlib import Path
from time import perf_counter

from study import instruction_set

_PAUSE = 5.0
"""Seconds between two lines where standard error is no terminal."""


class Progress(logging.Handler):
    """Count loops as they are compiled: a line that changes on a terminal, elsewhere one line every few seconds."""

    def __init__(self) -> None:
        from rich.console import Console

        super().__init__(logging.DEBUG)
        self.console = Console(stderr=True, highlight=False, soft_wrap=True)
        self.status = self.console.status("")  # shows nothing where there is no terminal
        self.task, self.loops = "", 0
        self.start = self.last = perf_counter()

    def begin(self, task: str) -> None:
        """Show a task that may compile loops."""
        self.task = task
        self._show()

    def emit(self, record: logging.LogRecord) -> None:
        """Count a loop."""
        if record.levelno == logging.DEBUG:
            self.loops += 1
            self._show()

    def _show(self) -> None:
        now = perf_counter()
        words = f"compiling: {self.task}, {self.loops} loops so far, {now - self.start:.0f} s"
        self.status.update(words)
        if not self.console.is_terminal and now - self.last >= _PAUSE:
            self.console.print(words)
            self.last = now


def compile_loops(configs: list[Path]) -> None:
    """Compile the loops of studies, and of fits in two and three dimensions with their intervals.

    Args:
        configs: files of the studies.
    """
    import numpy as np

    from study.fits import fit
    from study.simulation.experiment.config import load
    from study.simulation.runs.plan import extremes, plan

    progress, log = Progress(), logging.getLogger("study.fits.jit")
    log.addHandler(progress)
    log.setLevel(logging.DEBUG)
    log.propagate = False
    with progress.status:
        for number, config in enumerate(configs, start=1):
            progress.begin(f"{config} ({number} of {len(configs)})")
            for part in extremes(load(config)).values():
                plan(part, 1)
        for dimension in (2, 3):
            progress.begin(f"fits in {dimension} dimensions")
            points = np.cos(np.arange(60.0 * dimension) ** 2).reshape(2, 30, dimension)
            points /= np.linalg.norm(points, axis=2, keepdims=True)
            for answer in (fit(points, "ugdk", noise=0.01), fit(points[0]), fit(points[0], noise=0.01)):
                str(answer)  # computes the intervals
    progress.console.print(f"compiled {progress.loops} loops in {perf_counter() - progress.start:.0f} s")


if __name__ == "__main__":
    instruction_set.fix()
    compile_loops([Path(name) for name in sys.argv[1:]])
