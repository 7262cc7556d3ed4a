"""The choice of workers: threads, processes of this machine, or a Dask cluster."""

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass

from study.runs.storage.atomic_write import RunError
from study.runs.workers.backend import Backend
from study.runs.workers.dask_cluster import DaskCluster
from study.runs.workers.processes import Processes
from study.runs.workers.threads import Threads


@dataclass(frozen=True)
class Workers:
    """The workers that compute a run.

    Attributes:
        backend: threads, loky (processes) or dask.
        jobs: number of threads or processes; a cluster has as many as it has.
        scheduler: address of a cluster's scheduler.
        task: seconds of work from which a cluster's task takes no more units; None for a fifth of a second.
    """

    backend: str = "threads"
    jobs: int = 2
    scheduler: str | None = None
    task: float | None = None

    @contextlib.contextmanager
    def open(self) -> Iterator[Backend]:
        """Start the workers, and end them.

        Raises:
            RunError: if there is no such backend, or its cluster cannot be reached.
        """
        if (self.backend == "dask") != (self.scheduler is not None):
            raise RunError("--scheduler: give the address of a scheduler with --backend dask, and only then")
        if self.task is not None and self.scheduler is None:
            raise RunError("--task: goes with --backend dask, and only with it")
        if self.backend not in ("threads", "loky", "dask"):
            raise RunError(f"--backend {self.backend}: known are threads, loky and dask")
        if self.scheduler is not None:
            backend: Backend = DaskCluster(self.scheduler, self.task)
        else:
            backend = Threads(self.jobs) if self.backend == "threads" else Processes(self.jobs)
        with contextlib.closing(backend):
            yield backend
