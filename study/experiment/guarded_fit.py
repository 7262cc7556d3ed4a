"""An estimator called so that what it raises costs the trials on which it raises, and no others."""

from collections.abc import Sequence

import numpy as np

from study.estimators import ESTIMATORS, Fit, Samples, Status
from study.estimators.fit import blank
from study.experiment.design import Batch, Cell
from study.experiment.errors import Columns

_LONGEST_MESSAGE = 500


def attempt(name: str, samples: Samples) -> tuple[Fit, dict[int, str]]:
    """Call an estimator. What it raises becomes a status of those trials alone on which it raises, and a message.

    Returns:
        The fit, and by the number of the trial, from 0, what was raised.
    """
    b, d, _ = samples.shape
    try:
        return _called(name, samples), {}
    except Exception:  # by which of the trials, is found by trying each
        fit = blank(b, d)
    raised = {}
    for trial in range(b):
        try:
            one = _called(name, samples.only(trial))
        except Exception as error:
            raised[trial] = f"{type(error).__name__}: {error}"[:_LONGEST_MESSAGE]
            fit.status[trial] = Status.FAILED
            continue
        for whole, part in zip(fit, one, strict=True):
            whole[trial] = part[0]
    return fit, raised


def _called(name: str, samples: Samples) -> Fit:
    """An estimator's answer; ValueError if it is not one answer for each set of points."""
    fit, (b, d, _) = ESTIMATORS[name](samples), samples.shape
    for field, expected in zip(Fit._fields, blank(b, d), strict=True):
        if getattr(fit, field).shape != expected.shape:
            raise ValueError(f"{field} has shape {getattr(fit, field).shape}, expected {expected.shape}")
    return fit


class Failures:
    """Fits that failed, as rows in the order of the error table's.

    Args:
        estimators: names, in the order of the study.
        cause: of all of them: exception or worker.
    """

    def __init__(self, estimators: Sequence[str], cause: str = "exception") -> None:
        self._places = {name: place for place, name in enumerate(estimators)}
        self._cause = cause
        self._found: list[tuple[int, int, int, int, Cell, str, str]] = []

    def note(self, name: str, cells: Sequence[int], batches: Sequence[Batch], raised: dict[int, str]) -> None:
        """Note what an estimator raised.

        Args:
            name: the estimator's.
            cells: places of the cells, in their batches, that its answers are of.
            batches: what it was given: their trials, one after the other.
            raised: messages by the number of the trial, from 0.
        """
        if not raised:
            return
        start = 0
        for batch in batches:
            for trial in range(batch.trials):
                if (message := raised.get(start + trial)) is not None:
                    for cell in cells:
                        place = (batch.first, cell, self._places[name], batch.first + trial)
                        self._found.append((*place, batch.cells[cell], name, message))
            start += batch.trials

    def columns(self) -> Columns:
        """The rows; no columns if there are none."""
        if not self._found:
            return {}
        self._found.sort(key=lambda row: row[:4])
        *_, trials, cells, names, messages = zip(*self._found, strict=True)
        return {
            "cell": np.array([cell.name for cell in cells], dtype=object),
            "trial": np.array(trials, dtype=np.int64),
            "estimator": np.array(names, dtype=object),
            "name": np.array([f"{c.name}/{t}" for c, t in zip(cells, trials, strict=True)], dtype=object),
            "cause": np.full(len(names), self._cause, dtype=object),
            "message": np.array(messages, dtype=object),
        }
