"""Comparison of two runs: identical, the same within Monte-Carlo error, or different.

Each group and estimator is one comparison, by the strongest test that the stored tables allow:

- Both runs have error tables and share their draws: the sign test. If neither run is better, the number of data sets
  on which its error is the larger one is binomial.
- The draws differ: Mann & Whitney's test on errors over bound.
- Measures that both runs store are compared by the same two tests.
- One run has only its summary: medians are compared by their Monte-Carlo errors, shares of ok fits by Fisher's exact
  test.

All trials count, and those whose fit is not ok as worse than any other, so that a changed status is a difference, too.
Runs are called different if any comparison is less probable than
one in a thousand divided by the number of comparisons (Bonferroni). So equal runs are called different at most once in
a thousand times, whatever the dependence between the comparisons.
"""

import math
from collections.abc import Iterator
from functools import cache, partial
from typing import Any

import numpy as np
import pandas as pd
import scipy
from numpy.typing import NDArray

from study.arrays import Floats
from study.files import RunError
from study.fits import Status
from study.simulation.analysis.error_table import Grouped, Key
from study.simulation.experiment.compute import Columns
from study.simulation.experiment.conditions import RowValues, label
from study.simulation.experiment.measures import MeasureColumn
from study.simulation.runs.provenance import described
from study.simulation.runs.run_folder import Run
from study.text import columns

FALSE_ALARM = 1e-3
"""Largest probability with which two equal runs are called different."""
Row = dict[str, object]
_NAMES = ("group", "estimator", "conditions", "measure")
_VALUES = ("first", "second", "chance", "trials", "equal", "same_trials")
_COLUMNS = ["cell", "trial", "error", "radius_error", "bound", "status"]
_ROUNDING = 1e-6
"""Errors of the same fit on another machine may differ by this share of the bound."""


class Difference:
    """The comparison of two runs, by their error tables if both have them, else by their summaries.

    Args:
        one: the first run.
        other: the second.

    Attributes:
        runs: the two runs.
        how: the test that was used, in words.
        only: number of pairs of group and estimator that only the first run has, and only the second.
        comparisons: one or two rows per group and estimator: ``group``, ``estimator``, ``conditions`` of the group in
            words, ``measure``, its values in the ``first`` and the ``second`` run, their ``deviation`` in standard
            errors, which is the normal deviate that is as improbable, ``chance`` of so large a difference between equal
            runs, ``trials``, the smaller number, ``equal``, true if all numbers of the trials that both have are the
            same to the bit, ``same_trials``, true if both have the same trials (of summaries, as many), and
            ``different``, true if the chance is below the threshold.
        threshold: the chance below which a comparison makes runs different.
        identical: true if everything that both runs have is the same to the bit.
        different: true if any comparison is too improbable for equal runs.
        verdict: the result in words.

    Raises:
        RunError: if a run has neither, or they have nothing in common.
    """

    def __init__(self, one: Run, other: Run) -> None:
        compared = _by_errors if one.has("errors") and other.has("errors") else _by_summary
        self.runs, (rows, self.only, self.how) = (one, other), compared(one, other)
        if not rows:
            raise RunError(f"{one.folder} and {other.folder}: no cell and estimator is in both")
        frame, self.threshold = pd.DataFrame(rows), FALSE_ALARM / len(rows)
        size, change = -scipy.special.ndtri(0.5 * frame["chance"].clip(lower=1e-300)), frame["second"] - frame["first"]
        frame.insert(6, "deviation", np.where(np.isfinite(change), np.copysign(size, change), size))
        self.comparisons = frame.assign(different=frame["chance"] < self.threshold)
        self.identical, self.different = bool(frame["equal"].all()), bool(self.comparisons["different"].any())
        self.verdict = "different" if self.different else "the same within Monte-Carlo error"
        if self.identical:
            whole = self.only == (0, 0) and bool(frame["same_trials"].all())
            self.verdict = "identical" if whole else "identical in the trials that both have"


def _by_errors(one: Run, other: Run) -> tuple[list[Row], tuple[int, int], str]:
    a, b = Grouped(one), Grouped(other)
    if a.by_decade != b.by_decade:
        raise RunError(f"{one.folder} and {other.folder}: a grid and a random design have no groups in common")
    # runs have the same data sets only if their cells share draws in the same way
    draws = [getattr(run.study.design, "draws", run.study.design.kind) for run in (one, other)]
    stems = [run.study.model_copy(update={"measures": ()}).stem() for run in (one, other)]
    paired = stems[0] == stems[1] and draws[0] == draws[1]
    shared = [key for key in a.counts if key in b.counts]
    compared = [name for name in _COLUMNS if name != "cell" or a.by_decade]  # in a grid the cell is the group
    columns = [*compared, *(condition.name for condition in one.study.conditions())]
    measured = [column for column in one.study.measured() if column in other.study.measured()]
    further = [column.name for column in measured]
    rows: list[Row] = []
    words: dict[str, str] = {}
    larger = max((a, b), key=lambda table: sum(table.counts.values()))
    for keys in larger.batches([*columns, *further] * 2, shared):
        mine, theirs = a.read(keys, columns + further), b.read(keys, compared + further)
        for key in keys:
            if key[0] not in words:
                words[key[0]] = _words({name: values[0] for name, values in mine[key].items()}, key)
            both = _matched(mine[key], theirs[key]) if paired else None
            for column in (None, *measured):
                named = dict(zip(_NAMES, (*key, words[key[0]], _title(column)), strict=True))
                rows.append(named | _compared(mine[key], theirs[key], both, column))
    only = len(a.counts) - len(shared), len(b.counts) - len(shared)
    return rows, only, "errors, trial by trial" if paired else "errors over bound; the draws are not shared"


def _title(column: MeasureColumn | None) -> str:
    """The compared measure in words: a share of truth values, or a median."""
    if column is None:
        return "median over bound"
    return f"{'share' if column.kind is bool else 'median'} of {column.name}"


def _matched(one: Columns, other: Columns) -> tuple[Columns, Columns] | None:
    """The fits of two runs to the same data sets, in one order; None if there are none."""
    names = [name for name in ("cell", "trial") if name in one]
    if all(np.array_equal(one[name], other[name]) for name in names):
        return one, other
    keys = [pd.MultiIndex.from_arrays([fits[name] for name in names]) for fits in (one, other)]
    there = keys[1].get_indexer(keys[0])
    places = np.flatnonzero(there >= 0), there[there >= 0]
    if not len(places[0]):
        return None
    first, second = ({n: v[at] for n, v in fits.items()} for fits, at in zip((one, other), places, strict=True))
    return first, second


def _compared(
    one: Columns, other: Columns, both: tuple[Columns, Columns] | None, column: MeasureColumn | None = None
) -> Row:
    """Compare a group by fits of the same data sets, or by its distributions if there are none.

    Args:
        one: the first run's fits.
        other: the second's.
        both: those of the same data sets; None if there are none.
        column: the measure that is compared; None for the error over the bound.
    """
    values_of = _over_bound if column is None else partial(_measured, column.name)
    columns = ("error", "radius_error", "status") if column is None else (column.name,)
    equal = both is not None and all(_alike(both[0][name], both[1][name]) for name in columns)
    first, second = both or (one, other)
    a = values_of(first)
    b = a if equal and _alike(first["bound"], second["bound"]) else values_of(second)
    counts = len(one["trial"]), len(other["trial"])
    if both is not None:
        with np.errstate(invalid="ignore"):
            differ = ~((np.abs(a - b) <= _ROUNDING) | (a == b))
        worse, better = int(np.sum(differ & (b > a))), int(np.sum(differ & (b < a)))
        chance = _sign_test(worse, worse + better)
        trials, same = len(a), counts == (len(a), len(a))
    else:
        several = len(np.unique(np.concatenate([a, b]))) > 1
        chance = float(scipy.stats.mannwhitneyu(a, b).pvalue) if several else 1.0
        trials, same = min(counts), False
    middle = np.mean if column is not None and column.kind is bool else np.median
    of_first = float(middle(a)) if len(a) else math.nan
    of_second = of_first if b is a else float(middle(b)) if len(b) else math.nan
    return dict(zip(_VALUES, (of_first, of_second, chance, trials, equal, same), strict=True))


@cache
def _sign_test(worse: int, total: int) -> float:
    """Chance that so many of all that differ are worse or better; groups of many cells have the same few numbers."""
    return float(scipy.stats.binomtest(worse, total).pvalue) if total else 1.0


def _alike(one: NDArray[Any], other: NDArray[Any]) -> bool:
    """True if two columns are of one type and have the same values, where all that are not a number are the same."""
    return one.dtype == other.dtype and bool(np.all((one == other) | ((one != one) & (other != other))))


def _over_bound(fits: Columns) -> Floats:
    """Errors over the bound; infinite for fits that are not ok, and where the bound is infinite."""
    ok = (fits["status"] == Status.OK) & np.isfinite(fits["bound"])
    with np.errstate(all="ignore"):
        return np.where(ok, fits["error"] / fits["bound"], np.inf)


def _measured(name: str, fits: Columns) -> Floats:
    """Values of a measure; one that is not a number counts as infinite."""
    values = fits[name].astype(float)
    return np.where(np.isnan(values), np.inf, values)


def _by_summary(one: Run, other: Run) -> tuple[list[Row], tuple[int, int], str]:
    frames = [run.table("summary").astype({"estimator": str}).set_index(["group", "estimator"]) for run in (one, other)]
    a, b = frames
    shared = [key for key in a.index if key in b.index]
    columns = [name for name in a.columns if name in b.columns]
    rows: list[Row] = []
    for key in shared:
        mine, theirs = a.loc[key], b.loc[key]
        counts = [[int(row["ok"]), int(row["planned"] - row["ok"])] for row in (mine, theirs)]
        # equal shares need no test, and `scipy.stats` takes half a second to load
        chance = float(scipy.stats.fisher_exact(counts)[1]) if counts[0] != counts[1] else 1.0
        shares = mine["ok"] / mine["planned"], theirs["ok"] / theirs["planned"], chance
        last = int(min(mine["planned"], theirs["planned"])), bool(mine[columns].equals(theirs[columns]))
        for measure, compared in (("share ok", shares), ("median over bound", _medians(mine, theirs))):
            values = *key, _words(mine, key), measure, *compared, *last, bool(mine["planned"] == theirs["planned"])
            rows.append(dict(zip(_NAMES + _VALUES, values, strict=True)))
    return rows, (len(a) - len(shared), len(b) - len(shared)), "summaries; one run has no error table"


def _medians(one: "pd.Series[float]", other: "pd.Series[float]") -> tuple[float, float, float]:
    """Medians of all fits with failures last, and the probability of their difference.

    Their Monte-Carlo errors come from about √n order statistics, so the difference follows Student's t with √n degrees
    of freedom.
    """
    values = [float(row["ratio_median_all"]) for row in (one, other)]
    error = math.hypot(one["ratio_median_all_error"], other["ratio_median_all_error"])
    away = abs(values[1] - values[0])
    if not away > 0.0 or not math.isfinite(error):
        return values[0], values[1], 1.0
    freedom = math.sqrt(min(one["planned"], other["planned"]))
    return values[0], values[1], 2.0 * float(scipy.stats.t.sf(away / error, freedom)) if error > 0.0 else 0.0


def _words(row: RowValues, key: Key) -> str:
    """A group in words: a decade of σ/r, or a cell's conditions and its name."""
    if key[0].startswith(("1e+", "1e-")):  # a cell's name has no sign
        return f"σ/r = {key[0]} …"
    return f"{label(row)}, cell {key[0]}"


def as_data(difference: Difference) -> dict[str, object]:
    """A comparison for other programs: the verdict, the two runs, the test, and a mapping per comparison."""
    runs = [
        {"folder": run.folder, "run": run.study.run_name(), "made_by": run.maker(), "only_here": only}
        for run, only in zip(difference.runs, difference.only, strict=True)
    ]
    comparisons = difference.comparisons.to_dict("records")
    data = {"verdict": difference.verdict, "runs": runs, "test": difference.how, "threshold": difference.threshold}
    return {**data, "comparisons": comparisons}


def printed(difference: Difference, most: int = 5) -> Iterator[str]:
    """A comparison for a terminal: the verdict, the test, and the largest differences.

    Args:
        difference: the comparison.
        most: number of differences to list.
    """
    names = [str(run.folder) for run in difference.runs]
    yield f"{names[0]} and {names[1]}: {difference.verdict}"
    for name, run, only in zip(names, difference.runs, difference.only, strict=True):
        more = f"; {only:,} pairs of group and estimator are in this run only" if only else ""
        yield f"  {name}: {run.study.run_name()}, {described(run.maker())}{more}"
    frame = difference.comparisons
    count, equal, beyond = len(frame), int(frame["equal"].sum()), int(frame["different"].sum())
    yield f"  compared: {difference.how}; {count:,} comparisons, {equal:,} of them equal to the bit"
    if difference.identical:
        return
    limit = float(scipy.stats.norm.isf(0.5 * difference.threshold))
    yield f"  {beyond:,} deviate by more than {limit:.2f} standard errors (marked !), which makes runs different;"
    yield f"  equal runs deviate so far at most once in {1 / FALSE_ALARM:g} times"
    rows = []
    for row in frame.sort_values(["chance", "group", "estimator"], kind="stable").head(most).to_dict("records"):
        rows.append(["!" * row["different"], f"{row['conditions']}, {row['estimator']}", row["measure"]])
        numbers = [f"{row['first']:.4g}", f"{row['second']:.4g}", f"{row['deviation']:+.2f}", f"{row['trials']:,}"]
        rows[-1] += numbers
    titles = ["", "group and estimator", "measure", "first run", "second run", "standard errors", "trials"]
    yield from columns(rows, titles, "<<<>", indent=2)
