"""Calls of an estimator in which an exception, or an exit, costs the trials that raise it, and no others."""

from collections.abc import Sequence

import numpy as np

from study.estimators import ESTIMATORS, Estimates, Samples, Status
from study.estimators.estimates import blank
from study.estimators.own.simple_form import SimpleForm
from study.experiment.designs.cells import Batch, Cell
from study.experiment.errors import Columns

_LONGEST_MESSAGE = 500


def attempt(name: str, samples: Samples) -> tuple[Estimates, dict[int, str]]:
    """Call an estimator; a trial on which it raises has the status FAILED.

    Returns:
        The estimates, and the messages of exceptions by the number of the trial, from 0.
    """
    b, d, _ = samples.shape
    if isinstance(function := ESTIMATORS[name].function, SimpleForm):
        return function.attempt(samples)
    try:
        return _called(name, samples), {}
    except (Exception, SystemExit):  # trying each trial by itself shows which of them raise
        fit = blank(b, d)
    raised = {}
    for trial in range(b):
        try:
            one = _called(name, samples.only(trial))
        except (Exception, SystemExit) as error:
            raised[trial] = f"{type(error).__name__}: {error}"[:_LONGEST_MESSAGE]
            fit.status[trial] = Status.FAILED
            continue
        for whole, part in zip(fit, one, strict=True):
            whole[trial] = part[0]
    return fit, raised


def _called(name: str, samples: Samples) -> Estimates:
    """Call an estimator; ValueError if it does not answer once for each set of points."""
    fit, (b, d, _) = ESTIMATORS[name](samples), samples.shape
    for field in Estimates._fields:
        expected, shape = (b, d) if field == "center" else (b,), getattr(fit, field).shape
        if shape != expected:
            raise ValueError(f"{field} has shape {shape}, expected {expected}")
    return fit


class Failures:
    """Fits that failed, as rows in the order of the error table's.

    Args:
        estimators: names, in the order of the study.
        cause: the cause of all of them, exception or worker.
    """

    def __init__(self, estimators: Sequence[str], cause: str = "exception") -> None:
        self._places = {name: place for place, name in enumerate(estimators)}
        self._cause = cause
        self._found: list[tuple[int, int, int, int, Cell, str, str]] = []

    def note(self, name: str, cells: Sequence[int], batches: Sequence[Batch], raised: dict[int, str]) -> None:
        """Note the exceptions of an estimator.

        Args:
            name: the estimator's.
            cells: places, in their batches, of the cells that were fitted.
            batches: the batches that were fitted, their trials one after the other.
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
