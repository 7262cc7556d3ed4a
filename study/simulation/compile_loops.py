"""Compile the loops that studies and claims use, so that none waits for the compiler: once after an installation.

Numba keeps the compiled code beside the sources. A few trials of a study and a chain of its posteriors compile what
its run needs. Two processes compile, each function once (`study.fits.loops.jit`).
"""

import logging
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from logging.handlers import QueueHandler, QueueListener
from multiprocessing import get_context
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from multiprocessing.queues import Queue

_PROCESSES = 2
_PAUSE = 5.0
"""Seconds between two lines where standard error is no terminal."""


class Progress(logging.Handler):
    """Count loops as they are compiled: a line that changes on a terminal, elsewhere one line every few seconds."""

    def __init__(self) -> None:
        from rich.console import Console

        super().__init__(logging.DEBUG)
        self.console = Console(stderr=True, highlight=False, soft_wrap=True)
        self.status = self.console.status("")  # shows nothing where there is no terminal
        self.loops = 0
        self.start = self.last = perf_counter()

    def emit(self, record: logging.LogRecord) -> None:
        """Count a loop."""
        if record.levelno == logging.DEBUG:
            self.loops += 1
            now = perf_counter()
            self.status.update(self.words(now))
            if not self.console.is_terminal and now - self.last >= _PAUSE:
                self.console.print(self.words(now))
                self.last = now

    def words(self, now: float) -> str:
        """Loops and seconds so far."""
        return f"compiled {self.loops} loops in {now - self.start:.0f} s"


def compile_loops(configs: list[Path], circles: bool = False, costs: bool = False) -> None:
    """Compile the loops of studies; without any, those of fits in three dimensions with their intervals.

    Args:
        configs: files of the studies, most of which need no intervals.
        circles: true to compile those of fits in three and in two dimensions, too; else the first fit takes longer.
        costs: true to compile vector and scalar code for the table of costs, too.
    """
    from study.simulation.analysis.cost import timed, timed_scalar

    context, progress = get_context("spawn"), Progress()
    records: Queue[logging.LogRecord] = context.Queue()
    tasks: list[Callable[[], object]] = [partial(timed_scalar, 3, 20), partial(timed, 3, 20)] if costs else []
    dimensions = (3, 2) if circles else () if configs else (3,)
    tasks += [*(partial(_fit, d) for d in dimensions), *(partial(_begin, path) for path in configs)]
    listener = QueueListener(records, progress)
    listener.start()
    with progress.status, ProcessPoolExecutor(_PROCESSES, context, _report_to, (records,)) as pool:
        for done in [pool.submit(task) for task in tasks]:
            done.result()
    listener.stop()
    progress.console.print(progress.words(perf_counter()))


def _report_to(records: "Queue[logging.LogRecord]") -> None:
    """Send the name of each compiled function to the first process."""
    log = logging.getLogger("study.fits.loops.jit")
    log.addHandler(QueueHandler(records))
    log.setLevel(logging.DEBUG)
    log.propagate = False


def _begin(config: Path) -> None:
    """Compute a few trials of a study, and a chain if it has posteriors."""
    from study.simulation.experiment.config import load
    from study.simulation.posterior.run import chain_tasks
    from study.simulation.runs.plan import extremes, plan

    for part in extremes(study := load(config)).values():
        plan(part, 1)
    for task in chain_tasks(study)[:1]:
        task.compute()


def _fit(dimension: int) -> None:
    """Fit points, with intervals."""
    import numpy as np

    from study.fits import fit
    from study.fits.loops.jit import always_compiled

    # few points with noise, one of them far away: their shape is tested, and outliers are searched for
    points = np.cos(np.arange(60.0 * dimension) ** 2).reshape(2, 30, dimension)
    points *= (1.0 + 0.01 * np.sin(np.arange(60.0).reshape(2, 30, 1))) / np.linalg.norm(points, axis=2, keepdims=True)
    points[:, 0] *= 1.5
    with always_compiled():
        for answer in (fit(points, "ugdk", 0.01), fit(points[0], "robust"), fit(points[0]), fit(points[0], noise=0.01)):
            str(answer)  # computes the intervals
