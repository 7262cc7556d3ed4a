"""Compile the loops that studies and claims use, so that none waits for the compiler: once after an installation.

``python -m study.runs.compile_loops CONFIG…``. Numba keeps the compiled code beside the sources. A plan of a study
computes a few of its trials, and so compiles what its run needs.
"""

import sys
from pathlib import Path

from study.runs.workers import instruction_set


def compile_loops(configs: list[Path]) -> None:
    """Compile the loops of studies, and of fits in two and three dimensions with their intervals.

    Args:
        configs: files of the studies.
    """
    import numpy as np

    from study.estimators import fit
    from study.experiment.config import load
    from study.runs.plan import extremes, plan

    for config in configs:
        for part in extremes(load(config)).values():
            plan(part, 1)
    for dimension in (2, 3):
        points = np.cos(np.arange(60.0 * dimension) ** 2).reshape(2, 30, dimension)
        found = fit(points / np.linalg.norm(points, axis=2, keepdims=True), "ugdk", noise=0.01)
        found.status  # noqa: B018  computes the intervals


if __name__ == "__main__":
    instruction_set.fix()
    compile_loops([Path(name) for name in sys.argv[1:]])
