"""Two runs compared: identical, the same within Monte-Carlo error, or different, and where.

Where both have their error tables and share their draws, fits of the same data set are compared with each other: how
often the error of one is larger than the other's is binomial if neither is better (the sign test). Where the draws
differ, the ranks of errors over bound are compared (Mann & Whitney's test). Failed fits count as worse than any. Where
one run has only its summary, medians are compared by their Monte-Carlo errors, and shares of ok fits by Fisher's exact
test. Each group and estimator is a comparison; runs are different if any is so far off that chance would do that to
one of them in one of a thousand comparisons of equal runs (Bonferroni), however the comparisons depend on each other.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
from scipy import stats

from study.analysis.error_groups import Grouped, Key
from study.estimators import Status
from study.experiment.conditions import label
from study.runs.provenance import described
from study.runs.storage.atomic_write import RunError
from study.runs.storage.run_folder import Run

FALSE_ALARM = 1e-3
"""How often two equal runs are called different, at most."""
_COLUMNS = ["trial", "error", "radius_error", "bound", "status"]
_ROUNDING = 1e-6
"""Of the bound: what errors of the same fit may differ by, on another machine."""


@dataclass(frozen=True)
class Comparison:
    """One group and estimator.

    Attributes:
        key: names of both.
        words: the group in words.
        measure: what is compared.
        one, other: its values in the two runs.
        chance: probability of so large a difference between equal runs.
        trials: smaller number of trials.
        equal: whether all numbers are the same to the bit.
    """

    key: Key
    words: str
    measure: str
    one: float
    other: float
    chance: float
    trials: int
    equal: bool

    @property
    def deviation(self) -> float:
        """The difference in standard deviations of a normal number that is so improbable."""
        size = float(stats.norm.isf(0.5 * max(self.chance, 1e-300)))
        return math.copysign(size, self.other - self.one) if math.isfinite(self.other - self.one) else size


@dataclass(frozen=True)
class Difference:
    """What a comparison of two runs found.

    Attributes:
        runs: the two.
        how: what was compared, in words.
        found: a comparison per group and estimator, or two.
        only: groups and estimators that one run alone has.
    """

    runs: tuple[Run, Run]
    how: str
    found: list[Comparison]
    only: tuple[int, int]

    @property
    def threshold(self) -> float:
        """The chance below which a comparison makes runs different."""
        return FALSE_ALARM / len(self.found)

    @property
    def different(self) -> bool:
        """Whether any comparison is too far off for chance."""
        return any(each.chance < self.threshold for each in self.found)

    @property
    def identical(self) -> bool:
        """Whether all that both have is the same, to the bit."""
        return all(each.equal for each in self.found)


def compare(one: Run, other: Run) -> Difference:
    """Compare two runs, by their error tables where both have them, else by their summaries.

    Raises:
        RunError: if a run has neither, or they have nothing in common.
    """
    tables = one.has("errors") and other.has("errors")
    found, only, how = _by_errors(one, other) if tables else _by_summary(one, other)
    if not found:
        raise RunError(f"{one.folder} and {other.folder}: no cell and estimator is in both")
    return Difference((one, other), how, found, only)


def _by_errors(one: Run, other: Run) -> tuple[list[Comparison], tuple[int, int], str]:
    a, b = Grouped(one), Grouped(other)
    if a.by_decade != b.by_decade:
        raise RunError(f"{one.folder} and {other.folder}: a grid and a random design have no groups in common")
    paired = one.study.stem() == other.study.stem() and _draws(one) == _draws(other)
    shared = [key for key in a.counts if key in b.counts]
    columns = [*_COLUMNS, *(condition.name for condition in one.study.conditions())]
    found = []
    for keys in a.batches(shared):
        mine, theirs = a.read(keys, columns), b.read(keys, _COLUMNS)
        found += [_paired(key, mine[key], theirs[key], paired) for key in keys]
    only = len(a.counts) - len(shared), len(b.counts) - len(shared)
    return found, only, "errors, trial by trial" if paired else "errors over bound, whose draws are not shared"


def _draws(run: Run) -> str:
    """How cells share draws: equal trials of equal cells are the same data sets only where that is the same."""
    return getattr(run.study.design, "draws", run.study.design.kind)


def _paired(key: Key, one: pd.DataFrame, other: pd.DataFrame, paired: bool) -> Comparison:
    """A group by fits of the same data sets, if it has some, else by its distributions."""
    both = one.merge(other, on=["cell", "trial"], suffixes=("_a", "_b")) if paired else one.iloc[:0]
    words = _words(one.iloc[0], key)
    values = [_over_bound(frame, suffix) for frame, suffix in ((one, ""), (other, ""))]
    medians = [float(np.median(v)) if len(v) else math.nan for v in values]
    blank = Comparison(key, words, "median over bound", medians[0], medians[1], 1.0, min(len(one), len(other)), False)
    if not len(both):
        chance = stats.mannwhitneyu(values[0], values[1]).pvalue if len(np.unique(np.concatenate(values))) > 1 else 1.0
        return replace(blank, chance=float(chance))
    same = len(both) == len(one) == len(other)
    for name in ("error", "radius_error", "status"):
        same = same and both[f"{name}_a"].equals(both[f"{name}_b"].rename(f"{name}_a"))
    first, second = _over_bound(both, "_a"), _over_bound(both, "_b")
    with np.errstate(invalid="ignore"):
        rounding = (np.abs(first - second) <= _ROUNDING) | (first == second)
    worse, better = int(np.sum(second[~rounding] > first[~rounding])), int(np.sum(second[~rounding] < first[~rounding]))
    chance = stats.binomtest(worse, worse + better).pvalue if worse + better else 1.0
    return replace(
        blank,
        one=float(np.median(first)),
        other=float(np.median(second)),
        chance=float(chance),
        trials=len(both),
        equal=same,
    )


def _over_bound(frame: pd.DataFrame, suffix: str) -> Any:
    """Errors over the bound; infinite for fits that are not ok, or where the bound says nothing."""
    error, bound = frame[f"error{suffix}"].to_numpy(), frame[f"bound{suffix}"].to_numpy()
    ok = (frame[f"status{suffix}"] == Status.OK).to_numpy() & np.isfinite(bound)
    with np.errstate(all="ignore"):
        return np.where(ok, error / bound, np.inf)


def _by_summary(one: Run, other: Run) -> tuple[list[Comparison], tuple[int, int], str]:
    frames = [run.table("summary").astype({"estimator": str}).set_index(["group", "estimator"]) for run in (one, other)]
    a, b = frames
    shared = [key for key in a.index if key in b.index]
    columns = [name for name in a.columns if name in b.columns]
    found = []
    for key in shared:
        mine, theirs = a.loc[key], b.loc[key]
        equal = bool(mine[columns].equals(theirs[columns]))
        words, trials = _words(mine, key), int(min(mine["planned"], theirs["planned"]))
        for measure, values in (("share ok", _shares(mine, theirs)), ("median over bound", _medians(mine, theirs))):
            found.append(Comparison(key, words, measure, *values, trials, equal))
    return found, (len(a) - len(shared), len(b) - len(shared)), "summaries: the errors of one are not there"


def _shares(one: Any, other: Any) -> tuple[float, float, float]:
    counts = [[int(row["ok"]), int(row["planned"] - row["ok"])] for row in (one, other)]
    return one["ok"] / one["planned"], other["ok"] / other["planned"], float(stats.fisher_exact(counts)[1])


def _medians(one: Any, other: Any) -> tuple[float, float, float]:
    """Medians of ok fits, and the chance of their difference.

    Their Monte-Carlo errors come from about √n order statistics, so the tail is that of Student's t with as many
    degrees of freedom, not a normal one.
    """
    values = [float(row["ratio_median_ok"]) for row in (one, other)]
    error = math.hypot(one["ratio_median_ok_error"], other["ratio_median_ok_error"])
    away = abs(values[1] - values[0])
    if not away > 0.0 or not math.isfinite(error):
        return values[0], values[1], 1.0
    freedom = math.sqrt(min(one["ok"], other["ok"]))
    return values[0], values[1], 2.0 * float(stats.t.sf(away / error, freedom)) if error > 0.0 else 0.0


def _words(row: Any, key: Key) -> str:
    """A group in words: a decade of σ/r, or a cell's conditions and its name."""
    if key[0].startswith("1e"):
        return f"σ/r = {key[0]} …"
    return f"{label(row)}, cell {key[0]}"


def printed(found: Difference, most: int = 5) -> Iterator[str]:
    """A comparison for a terminal: the verdict, what was compared, and where the largest differences are."""
    names = [str(run.folder) for run in found.runs]
    verdict = (
        "identical" if found.identical else "different" if found.different else "the same within Monte-Carlo error"
    )
    yield f"{names[0]} and {names[1]}: {verdict}"
    for name, run, only in zip(names, found.runs, found.only, strict=True):
        more = f"; {only:,} groups and estimators are in it alone" if only else ""
        yield f"  {name}: {run.study.run_name()}, {described(run.maker())}{more}"
    equal = sum(each.equal for each in found.found)
    yield f"  compared: {found.how}; {len(found.found):,} comparisons, {equal:,} of them equal to the bit"
    if found.identical:
        return
    yield f"  different is called what equal runs would show once in {1 / FALSE_ALARM:g} comparisons of runs, or less:"
    limit = float(stats.norm.isf(0.5 * found.threshold))
    beyond = sum(each.chance < found.threshold for each in found.found)
    yield f"  a deviation beyond {limit:.2f} standard errors; {beyond:,} are"
    for each in sorted(found.found, key=lambda c: (c.chance, c.key))[:most]:
        mark = "!" if each.chance < found.threshold else " "
        yield (
            f"  {mark} {each.words}, {each.key[1]}: {each.measure} {each.one:.4g} and {each.other:.4g}, "
            f"{each.deviation:+.2f} standard errors, {each.trials:,} trials"
        )
