"""Comparison of two runs: identical, the same within Monte-Carlo error, or different.

Each group and estimator is one comparison, by the strongest test that the stored tables allow:

- Both runs have error tables and share their draws: the sign test. If neither run is better, the number of data sets
  on which its error is the larger one is binomial.
- The draws differ: Mann & Whitney's test on errors over bound.
- One run has only its summary: medians are compared by their Monte-Carlo errors, shares of ok fits by Fisher's exact
  test.

All trials count, and those whose fit is not ok as worse than any other, so that a changed status is a difference, too.
Runs are called different if any comparison is less probable than
one in a thousand divided by the number of comparisons (Bonferroni). So equal runs are called different at most once in
a thousand times, whatever the dependence between the comparisons.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pandas as pd
import scipy

from study.arrays import Floats
from study.files import RunError
from study.fits import Status
from study.simulation.analysis.summary import Grouped, Key
from study.simulation.experiment.conditions import label
from study.simulation.runs.provenance import described
from study.simulation.runs.run_folder import Run
from study.text import columns

FALSE_ALARM = 1e-3
"""Largest probability with which two equal runs are called different."""
_COLUMNS = ["cell", "trial", "error", "radius_error", "bound", "status"]
_ROUNDING = 1e-6
"""Errors of the same fit on another machine may differ by this share of the bound."""


@dataclass(frozen=True)
class Comparison:
    """The comparison of one group and estimator.

    Attributes:
        group, estimator: their names.
        conditions: the group's conditions in words.
        measure: name of the measure that is compared.
        first, second: the measure in the two runs.
        chance: probability of so large a difference between equal runs.
        trials: the smaller of the two numbers of trials.
        equal: true if all numbers of the trials that both runs have are the same to the bit.
        same_trials: true if both runs have the same trials; of summaries, as many.
    """

    group: str
    estimator: str
    conditions: str
    measure: str
    first: float
    second: float
    chance: float
    trials: int
    equal: bool
    same_trials: bool

    @property
    def deviation(self) -> float:
        """The difference in standard errors: the normal deviate that is as improbable."""
        size = float(scipy.stats.norm.isf(0.5 * max(self.chance, 1e-300)))
        change = self.second - self.first
        return math.copysign(size, change) if math.isfinite(change) else size


class Difference:
    """The comparison of two runs, by their error tables if both have them, else by their summaries.

    Args:
        one: the first run.
        other: the second.

    Attributes:
        runs: the two runs.
        how: the test that was used, in words.
        comparisons: one or two comparisons per group and estimator.
        only: number of pairs of group and estimator that only the first run has, and only the second.

    Raises:
        RunError: if a run has neither, or they have nothing in common.
    """

    def __init__(self, one: Run, other: Run) -> None:
        tables = one.has("errors") and other.has("errors")
        self.runs = one, other
        self.comparisons, self.only, self.how = _by_errors(one, other) if tables else _by_summary(one, other)
        if not self.comparisons:
            raise RunError(f"{one.folder} and {other.folder}: no cell and estimator is in both")

    @property
    def threshold(self) -> float:
        """The chance below which a comparison makes runs different."""
        return FALSE_ALARM / len(self.comparisons)

    @property
    def different(self) -> bool:
        """True if any comparison is too improbable for equal runs."""
        return any(row.chance < self.threshold for row in self.comparisons)

    @property
    def verdict(self) -> str:
        """The result in words."""
        if not self.identical:
            return "different" if self.different else "the same within Monte-Carlo error"
        return "identical" if self.whole else "identical in the trials that both have"

    @property
    def identical(self) -> bool:
        """True if everything that both runs have is the same to the bit."""
        return all(row.equal for row in self.comparisons)

    @property
    def whole(self) -> bool:
        """True if the runs have the same groups, estimators and trials."""
        return self.only == (0, 0) and all(row.same_trials for row in self.comparisons)


def _by_errors(one: Run, other: Run) -> tuple[list[Comparison], tuple[int, int], str]:
    a, b = Grouped(one), Grouped(other)
    if a.by_decade != b.by_decade:
        raise RunError(f"{one.folder} and {other.folder}: a grid and a random design have no groups in common")
    paired = one.study.stem() == other.study.stem() and _draws(one) == _draws(other)
    shared = [key for key in a.counts if key in b.counts]
    columns = [*_COLUMNS, *(condition.name for condition in one.study.conditions())]
    comparisons = []
    for keys in a.batches(shared):
        mine, theirs = a.read(keys, columns), b.read(keys, _COLUMNS)
        comparisons += [_paired(key, pd.DataFrame(mine[key]), pd.DataFrame(theirs[key]), paired) for key in keys]
    only = len(a.counts) - len(shared), len(b.counts) - len(shared)
    return comparisons, only, "errors, trial by trial" if paired else "errors over bound; the draws are not shared"


def _draws(run: Run) -> str:
    """The way in which cells share draws: runs have the same data sets only if they agree in it."""
    return getattr(run.study.design, "draws", run.study.design.kind)


def _paired(key: Key, one: pd.DataFrame, other: pd.DataFrame, paired: bool) -> Comparison:
    """Compare a group by fits of the same data sets, or by its distributions if there are none."""
    both = one.merge(other, on=["cell", "trial"], suffixes=("_a", "_b")) if paired else one.iloc[:0]
    words = _words(one.iloc[0], key)
    values = [_over_bound(frame, suffix) for frame, suffix in ((one, ""), (other, ""))]
    first, second = (float(np.median(v)) if len(v) else math.nan for v in values)
    trials, measure = min(len(one), len(other)), "median over bound"
    if not len(both):
        differ = len(np.unique(np.concatenate(values))) > 1
        chance = scipy.stats.mannwhitneyu(values[0], values[1]).pvalue if differ else 1.0
        return Comparison(*key, words, measure, first, second, float(chance), trials, False, False)
    columns = ("error", "radius_error", "status")
    same = all(both[f"{name}_a"].equals(both[f"{name}_b"].rename(f"{name}_a")) for name in columns)
    one_ratio, other_ratio = _over_bound(both, "_a"), _over_bound(both, "_b")
    with np.errstate(invalid="ignore"):
        rounding = (np.abs(one_ratio - other_ratio) <= _ROUNDING) | (one_ratio == other_ratio)
    worse = int(np.sum(other_ratio[~rounding] > one_ratio[~rounding]))
    better = int(np.sum(other_ratio[~rounding] < one_ratio[~rounding]))
    chance = scipy.stats.binomtest(worse, worse + better).pvalue if worse + better else 1.0
    first, second = float(np.median(one_ratio)), float(np.median(other_ratio))
    whole = len(both) == len(one) == len(other)
    return Comparison(*key, words, measure, first, second, float(chance), len(both), same, whole)


def _over_bound(frame: pd.DataFrame, suffix: str) -> Floats:
    """Errors over the bound; infinite for fits that are not ok, and where the bound is infinite."""
    error, bound = frame[f"error{suffix}"].to_numpy(), frame[f"bound{suffix}"].to_numpy()
    ok = (frame[f"status{suffix}"] == Status.OK).to_numpy() & np.isfinite(bound)
    with np.errstate(all="ignore"):
        return np.where(ok, error / bound, np.inf)


def _by_summary(one: Run, other: Run) -> tuple[list[Comparison], tuple[int, int], str]:
    frames = [run.table("summary").astype({"estimator": str}).set_index(["group", "estimator"]) for run in (one, other)]
    a, b = frames
    shared = [key for key in a.index if key in b.index]
    columns = [name for name in a.columns if name in b.columns]
    comparisons = []
    for key in shared:
        mine, theirs = a.loc[key], b.loc[key]
        equal = bool(mine[columns].equals(theirs[columns]))
        words, trials = _words(mine, key), int(min(mine["planned"], theirs["planned"]))
        whole = bool(mine["planned"] == theirs["planned"])
        counts = [[int(row["ok"]), int(row["planned"] - row["ok"])] for row in (mine, theirs)]
        chance = float(scipy.stats.fisher_exact(counts)[1])
        shares = mine["ok"] / mine["planned"], theirs["ok"] / theirs["planned"], chance
        for measure, (x, y, p) in (("share ok", shares), ("median over bound", _medians(mine, theirs))):
            comparisons.append(Comparison(key[0], key[1], words, measure, x, y, p, trials, equal, whole))
    return comparisons, (len(a) - len(shared), len(b) - len(shared)), "summaries; one run has no error table"


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


def _words(row: "pd.Series[float]", key: Key) -> str:
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
    names = ("group", "estimator", "conditions", "measure", "first", "second", "deviation", "chance")
    comparisons = [
        {name: getattr(row, name) for name in (*names, "trials", "equal", "same_trials")}
        | {"different": row.chance < difference.threshold}
        for row in difference.comparisons
    ]
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
    count, equal = len(difference.comparisons), sum(row.equal for row in difference.comparisons)
    yield f"  compared: {difference.how}; {count:,} comparisons, {equal:,} of them equal to the bit"
    if difference.identical:
        return
    limit = float(scipy.stats.norm.isf(0.5 * difference.threshold))
    beyond = sum(row.chance < difference.threshold for row in difference.comparisons)
    yield f"  {beyond:,} deviate by more than {limit:.2f} standard errors (marked !), which makes runs different;"
    yield f"  equal runs deviate so far at most once in {1 / FALSE_ALARM:g} times"
    rows = []
    for row in sorted(difference.comparisons, key=lambda c: (c.chance, c.group, c.estimator))[:most]:
        rows.append(["!" * (row.chance < difference.threshold), f"{row.conditions}, {row.estimator}", row.measure])
        rows[-1] += [f"{row.first:.4g}", f"{row.second:.4g}", f"{row.deviation:+.2f}", f"{row.trials:,}"]
    titles = ["", "group and estimator", "measure", "first run", "second run", "standard errors", "trials"]
    yield from columns(rows, titles, "<<<>", indent=2)
