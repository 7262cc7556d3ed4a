"""The summary table: measures per cell, or per decade of relative noise, and estimator; and the worst trials of a run.

The headline is ``ratio_median``, of all trials, so that columns of one row are of the same trials. For quantiles of the
fits whose status is ok (``_ok``), and with failures last (``_all``), see `study.simulation.statistics`. The error table
is read by group and estimator, a part at a time, so that any length fits in memory.
"""

from collections.abc import Collection, Iterable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import ArrayLike

from study.arrays import Floats
from study.files import RunError, writing
from study.fits import Status
from study.simulation.experiment.compute import Columns
from study.simulation.experiment.conditions import STORED, bound_law, named_in
from study.simulation.runs import schemas
from study.simulation.runs.run_folder import Run
from study.simulation.statistics import NEEDED, as_columns, row
from study.text import columns, did_you_mean

if TYPE_CHECKING:
    from pandas.core.groupby import DataFrameGroupBy

Key = tuple[str, str]
"""Names of a group and an estimator."""
ROWS = 1 << 20
"""Rows in memory at a time, or those of one group if it has more."""


def label(errors: pd.DataFrame, by_decade: bool) -> pd.DataFrame:
    """An error table with columns ``group``, whose words are coded, and ``decade``.

    Args:
        errors: the table, or some of its rows.
        by_decade: group by decade of σ/r (a random design) instead of by cell (a grid).
    """
    if not by_decade:
        return errors.assign(group=errors["cell"].astype("category"), decade=np.nan)
    lower = decade(errors["noise"] / errors["radius"]).astype(int)
    powers, codes = np.unique(lower, return_inverse=True)
    names = pd.Index([f"1e{power:+03d}" for power in powers])
    return errors.assign(group=pd.Categorical.from_codes(codes, categories=names), decade=lower)


def decade(values: ArrayLike) -> Floats:
    """Exponent of ten at the lower end of each value's decade; a value just below it by rounding counts as in it."""
    return np.asarray(np.floor(np.log10(values) + 1e-9))


class Grouped:
    """A stored error table, by group and estimator.

    Args:
        run: the finished run.

    Attributes:
        by_decade: true if a group is a decade of σ/r, false if it is a cell.
        counts: rows of each group and estimator, in the order of a summary.

    Raises:
        RunError: if the table is missing or cannot be read.
    """

    def __init__(self, run: Run) -> None:
        self._file: pq.ParquetFile = run.read("errors", pq.ParquetFile)
        self.by_decade = run.study.design.one_trial_a_cell
        self.counts: dict[Key, int] = {}
        self._where: dict[Key, tuple[int, int]] = {}
        for index in range(self._file.num_row_groups):
            sizes: dict[Key, int] = dict(self._groups(self._rows([index], [])).size())
            for key, rows in sizes.items():
                self.counts[key] = self.counts.get(key, 0) + rows
                self._where[key] = self._where.get(key, (index, index))[0], index
        if self.by_decade:
            self.counts = dict(sorted(self.counts.items(), key=lambda item: int(item[0][0][2:])))

    def batches(self, keys: Collection[Key] | None = None) -> Iterator[list[Key]]:
        """Keys in batches that can be read together.

        Args:
            keys: the keys to go through; all if None.
        """
        batch: list[Key] = []
        rows = 0
        for key in self.counts if keys is None else keys:
            if batch and rows + self.counts[key] > ROWS:
                yield batch
                batch, rows = [], 0
            batch.append(key)
            rows += self.counts[key]
        if batch:
            yield batch

    def read(self, keys: Collection[Key], columns: list[str]) -> dict[Key, Columns]:
        """Rows of some groups and estimators, in the order of the table.

        Args:
            keys: names of groups and estimators; one that is not in the table has no entry in the result.
            columns: columns of the error table; ``decade`` is added.

        Returns:
            The columns of each group and estimator, words as objects.
        """
        wanted = [key for key in keys if key in self.counts]
        if not wanted:
            return {}
        first, last = min(self._where[key][0] for key in wanted), max(self._where[key][1] for key in wanted)
        rows = self._rows(range(first, last + 1), columns)
        values, groups = {name: rows[name].to_numpy() for name in (*columns, "decade")}, self._groups(rows).indices
        return {key: {name: column[groups[key]] for name, column in values.items()} for key in wanted}

    def _rows(self, row_groups: Iterable[int], columns: list[str]) -> pd.DataFrame:
        """Rows of the table with their group and decade."""
        named = dict.fromkeys([*columns, *(["noise", "radius"] if self.by_decade else ["cell"]), "estimator"])
        table = self._file.read_row_groups(list(row_groups), columns=list(named))
        return label(table.to_pandas(split_blocks=True, self_destruct=True), self.by_decade)

    @staticmethod
    def _groups(rows: pd.DataFrame) -> "DataFrameGroupBy[Any, Any]":
        return rows.groupby(["group", "estimator"], sort=False, observed=True)


def stored_summary(run: Run) -> pd.DataFrame:
    """Read the summary of a run, with the measures of all trials even if an earlier version stored it without them.

    They are computed from the errors. Without errors they are those with failures last where every fit is ok, and
    elsewhere not a number.
    """
    stored = run.table("summary")
    missing = [name for name in schemas.OF_ALL_TRIALS if name not in stored]
    if not missing:
        return stored
    if run.has("errors"):
        errors = run.table("errors", ["cell", "estimator", *(c.name for c in STORED), *NEEDED])
        computed = summary(errors, run.study.design.one_trial_a_cell)
        return computed[[c.name for c in schemas.summary([c for c in STORED if c.name in stored])]]
    # the column of a measure with failures last, or of its Monte-Carlo error
    known = {name: f"{name.removesuffix('_error')}_all" + "_error" * name.endswith("_error") for name in missing}
    all_ok = stored["ok"] == stored["planned"]
    return stored.assign(
        **{name: stored[other].where(all_ok) if other in stored else np.nan for name, other in known.items()}
    )


def up_to_date(run: Run) -> bool:
    """True if the summary of a finished run need not be made from its errors again."""
    if not run.valid("summary"):
        return False
    stored = pq.read_schema(run.path("summary")).names
    return run.study.keep == "summary" or set(schemas.OF_ALL_TRIALS) <= set(stored)


def summarise(run: Run) -> None:
    """Summarise a run's error table and store the summary beside it, with few groups in memory at a time."""
    columns, grouped = schemas.summary(run.study.conditions()), Grouped(run)
    with writing(run.folder):
        run.join("summary", columns, rows_of_groups(run, grouped), {"study.config": run.study.canonical()})
        run.record("summary")


def rows_of_groups(run: Run, grouped: Grouped, keys: Collection[Key] | None = None) -> Iterator[pa.Table]:
    """Compute rows of a run's summary from its error table, some at a time.

    Args:
        run: the run.
        grouped: its error table.
        keys: groups and estimators; all if None.
    """
    conditions = run.study.conditions()
    columns, needed = schemas.summary(conditions), [*(condition.name for condition in conditions), *NEEDED]
    for batch in grouped.batches(keys):
        fits = grouped.read(batch, needed)
        yield schemas.table(columns, as_columns([row(*key, fits[key]) for key in batch]))


def summary(errors: pd.DataFrame, by_decade: bool) -> pd.DataFrame:
    """Performance measures of an error table.

    Args:
        errors: the error table.
        by_decade: group by decade of σ/r (a random design) instead of by cell (a grid).

    Returns:
        A row per group and estimator, in the order of the table; columns as `study.simulation.runs.schemas.summary`
        declares them.
    """
    errors = label(errors, by_decade)
    if by_decade:
        errors = errors.sort_values("decade", kind="stable")
    needed = [*(condition.name for condition in STORED if condition.name in errors), *NEEDED, "decade"]
    groups = errors.groupby(["group", "estimator"], sort=False, observed=True)
    parts = (((str(g), str(e)), {name: part[name].to_numpy() for name in needed}) for (g, e), part in groups)
    return pd.DataFrame([row(*key, columns) for key, columns in parts])


_GROUPS = 8
"""Row groups of an error table in memory at a time: a million rows."""


def worst(errors: pd.DataFrame, count: int = 5, estimator: str | None = None) -> pd.DataFrame:
    """The trials with the largest error over the bound, among the fits that are ok.

    A trial counts once, with the estimator that errs most on it: LLS and GDKE are the same fit, and would list every
    trial twice. Trials whose directions do not determine the centre have an infinite bound and are left out.

    Args:
        errors: the error table.
        count: number of trials.
        estimator: the estimator whose fits are used; all estimators if None.

    Returns:
        At most ``count`` rows of the error table, the worst first, with a column ``ratio``, error over bound, and an
        index from 0. Equal ratios are in the order of cell, trial and estimator by name.
    """
    ratio = _ratios(errors)
    if estimator is not None:
        ratio[(errors["estimator"] != estimator).to_numpy()] = np.nan
    # a trial has a row per estimator: among so many rows are the trials asked for, and those as bad as the last
    most = min(count * max(1, errors["estimator"].nunique()), int(np.sum(~np.isnan(ratio))))
    least = np.partition(ratio[~np.isnan(ratio)], -most)[-most] if most else np.inf
    where = np.flatnonzero(ratio >= least)
    # sorted by name, not by the code of a dictionary
    rows = errors.iloc[where].assign(ratio=ratio[where]).astype({"cell": str, "estimator": str})
    rows = rows.sort_values(["ratio", "cell", "trial", "estimator"], ascending=[False, True, True, True])
    return rows.drop_duplicates(["cell", "trial"]).head(count).reset_index(drop=True)


def worst_of_groups(errors: pd.DataFrame, by_decade: bool) -> pd.DataFrame:
    """The trial with the largest error over the bound of each group and estimator, among the fits that are ok.

    Args:
        errors: the error table.
        by_decade: group by decade of σ/r (a random design) instead of by cell (a grid), as the summary does.

    Returns:
        A row per group and estimator that has such a trial: ``group``, ``estimator``, ``cell``, ``trial`` and
        ``ratio``, error over bound. Of equal ratios the first of the table counts.
    """
    ratio = pd.Series(_ratios(errors)).dropna()
    groups = decade(errors["noise"] / errors["radius"]) if by_decade else pd.factorize(errors["cell"])[0]
    keys = [groups[ratio.index], pd.factorize(errors["estimator"])[0][ratio.index]]
    where = ratio.groupby(keys, sort=True).idxmax().to_numpy()
    named = errors[["cell", "trial", "estimator", "noise", "radius"]].iloc[where]
    rows = label(named, by_decade).astype({"group": str, "cell": str, "estimator": str})
    return rows.assign(ratio=ratio[where].to_numpy())[["group", "estimator", "cell", "trial", "ratio"]]


def _ratios(errors: pd.DataFrame) -> Floats:
    """Error over bound of each row; NaN where the fit is not ok or there is no finite bound."""
    bound = errors["bound"].to_numpy()
    use = (errors["status"] == Status.OK).to_numpy() & np.isfinite(bound)
    with np.errstate(all="ignore"):
        return np.where(use, errors["error"].to_numpy() / bound, np.nan)


def of_run(run: Run, count: int, estimator: str | None = None) -> pd.DataFrame:
    """The worst trials of a run, as `worst` finds them in its error table.

    Raises:
        RunError: if the run did not finish, or does not have the estimator.
    """
    known = run.study.estimators
    if estimator is not None and estimator not in known:
        raise RunError(f"{run.folder}: no estimator {estimator!r} in this run; {did_you_mean(estimator, known)}")
    return worst(pd.concat([worst(part, count, estimator) for part in _parts(run)], ignore_index=True), count)


def worst_of_run(run: Run, count: int = 5) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Find the worst trials, and the worst of each group and estimator, in one pass through a run's error table.

    Returns:
        The tables of `worst` and `worst_of_groups`.

    Raises:
        RunError: if the run did not finish.
    """
    by_decade = run.study.design.one_trial_a_cell
    parts = [(worst(part, count), worst_of_groups(part, by_decade)) for part in _parts(run)]
    trials, groups = (pd.concat(tables, ignore_index=True) for tables in zip(*parts, strict=True))
    first = groups.groupby(["group", "estimator"], sort=False)["ratio"].idxmax()
    return worst(trials, count), groups.loc[first]


def _parts(run: Run) -> Iterator[pd.DataFrame]:
    """A run's error table, some rows at a time: new memory for millions of rows takes longer than reading them."""
    conditions = [condition.name for condition in run.study.conditions()]
    columns = ["cell", "trial", *conditions, "estimator", "error", "bound", "status"]
    file: pq.ParquetFile = run.read("errors", pq.ParquetFile)
    for first in range(0, max(1, file.num_row_groups), _GROUPS):  # a table without rows is a part without rows
        groups = range(first, min(first + _GROUPS, file.num_row_groups))
        yield file.read_row_groups(list(groups), columns=columns).to_pandas()


def as_data(run: Run, trials: pd.DataFrame) -> dict[str, object]:
    """The worst trials for other programs: the run's name, the bound in words, and a mapping per trial."""
    conditions = [condition.name for condition in run.study.conditions()]
    rows = [
        {
            "name": f"{row['cell']}/{row['trial']}",
            **{name: row[name] for name in ("cell", "trial", "estimator", "ratio", "error", "bound", *conditions)},
        }
        for row in trials.to_dict("records")
    ]
    return {"run": run.study.run_name(), "bound": bound_law(conditions) or "Cramér-Rao bound", "trials": rows}


def printed(run: Run, trials: pd.DataFrame) -> Iterator[str]:
    """The worst trials for a terminal, each by the name that `study replay RUN NAME` takes."""
    conditions = [condition.name for condition in run.study.conditions()]
    shown = named_in(conditions)
    bound = bound_law(conditions) or "Cramér-Rao bound"
    yield f"{run.study.run_name()}: the largest errors over the {bound} of fits that are ok"
    rows = [
        [
            f"{row['cell']}/{row['trial']}",
            row["estimator"],
            f"{row['ratio']:.4g}",
            f"{row['error'] / row['radius']:.3g}",
            *(condition.written(condition.of(row)) for condition in shown),
        ]
        for row in trials.to_dict("records")
    ]
    titles = ["trial", "estimator", "over bound", "error/r", *(condition.symbol for condition in shown)]
    yield from columns(rows, titles, "<<>")
    if len(trials):
        yield f"to see the first: study replay {run.folder} {trials['cell'][0]}/{trials['trial'][0]} --plot worst.png"
