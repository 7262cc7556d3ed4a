"""Check of one's own estimators: every property on every data set, and a report in words."""

import contextlib
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from time import perf_counter

from study.estimators.answer.fit import Fit
from study.estimators.own.check_cases import NOISE, degenerate_sets, sound_cases
from study.estimators.own.check_properties import PROPERTIES, degenerate
from study.estimators.own.plugin_file import LIMIT, OvertimeError, faults_of, in_time, load, sound_samples
from study.estimators.own.simple_form import one_line
from study.estimators.registry import fit
from study.sphere.types import Floats

BUDGET = 20.0
"""Seconds after which no new data set is taken, of all estimators of a file."""


@dataclass(frozen=True)
class CheckReport:
    """Result of a check.

    Attributes:
        estimator: its name.
        violations: a sentence for each violated property, of the first data set that violates it.
        sets: number of sound data sets that were used.
        remarks: what was left out, in words.
    """

    estimator: str
    violations: tuple[str, ...]
    sets: int
    remarks: tuple[str, ...]


def check_file(path: Path, budget: float = BUDGET, limit: float = LIMIT) -> list[CheckReport]:
    """Check the estimators that a file registers.

    Args:
        path: the file.
        budget: seconds after which no new data set is taken; each estimator has its share of them.
        limit: seconds in which a single fit should be done.

    Raises:
        PluginError: if the file cannot be used.
    """
    names = load(path)
    fit(sound_samples(2).points, noise=NOISE)  # compiled code is loaded now, which is not the estimators' time
    with contextlib.redirect_stdout(sys.stderr):
        return [check_estimator(name, budget / len(names), limit) for name in names]


def check_estimator(name: str, budget: float = BUDGET, limit: float = LIMIT) -> CheckReport:
    """Check a registered estimator; see `check_file`."""
    broken: dict[str, str] = {}
    sets, remarks, place = 0, [], ""
    unable = faults_of(name)
    end = perf_counter() + budget

    def fitted(points: Floats, noise: float) -> Fit:
        try:
            with in_time(limit):
                return fit(points, name, noise, copy=False)  # so that changed points show
        except SystemExit as end:
            raise RuntimeError(one_line(end)) from None

    try:
        for d in (2, 3):
            if d in unable:
                remarks.append(f"d = {d} is left out: {unable[d]}")
                continue
            for case in sound_cases(d):
                if perf_counter() > end:
                    remarks.append(f"stopped after {budget:.3g} s at {case}: the estimator is slow")
                    break
                sets, place = sets + 1, str(case)
                for key, holds in PROPERTIES.items():
                    if key not in broken and (words := _guarded(partial(holds, fitted, case))):
                        broken[key] = f"{words} ({place})"
            for kind, points in degenerate_sets(d):
                if perf_counter() > end:
                    break
                place = f"{kind}, d = {d}"
                if "degenerate" not in broken and (words := degenerate(fitted, kind, points)):
                    broken["degenerate"] = f"{words} (d = {d})"
    except OvertimeError as error:  # every further data set might cost as much
        broken["time"] = f"{error} ({place}); the check ends here"
    return CheckReport(name, tuple(broken.values()), sets, tuple(remarks))


def printed(reports: list[CheckReport]) -> Iterator[str]:
    """The reports for a terminal: a line per violation, or one that says that there is none."""
    for report in reports:
        for words in report.violations:
            yield f"{report.estimator}: {words}"
        if not report.violations:
            count = len(PROPERTIES) + 1
            yield f"{report.estimator}: all {count} properties hold on {report.sets} data sets"
        for words in report.remarks:
            yield f"{report.estimator}: {words}"


def _guarded(call: "partial[str]") -> str:
    """Words of a property, or those of the exception that the estimator raised."""
    try:
        return call()
    except Exception as error:
        line = str(error).split("\n")[0]
        return f"raises on sound points: {type(error).__name__}: {line}"
