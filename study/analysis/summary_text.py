"""The summary of a run for a terminal: median errors in units of the bound."""

from collections.abc import Iterator

import numpy as np

from study.analysis.medians_at_bounds import has_bounds, medians_at_bounds
from study.experiment.conditions import NOISE_OVER_RADIUS, Condition, RowValues, bound_law, distinguishing
from study.runs.storage.run_folder import Run
from study.text.columns import columns


def printed(run: Run) -> Iterator[str]:
    """The medians of error over bound of a run.

    Yields:
        A title, a header, and a line per group: for each estimator the median error of the ok fits over the bound
        with its Monte-Carlo error, and in brackets the share of fits that are not ok, if there are any. Before them
        stand the medians of estimators with Gaussian errors at the two bounds, where the cells have them.
    """
    frame = run.table("summary")
    bound = bound_law(frame.columns) or "Cramér-Rao bound"
    yield f"{run.study.run_name()}: median error of the centre over the {bound} ± its Monte-Carlo error"
    yield "Fits that are not ok are left out; brackets give their share."
    if frame.empty:
        yield "no cell has a trial yet"
        return
    named, bounded = distinguishing(frame), has_bounds(run.study)
    if bounded:
        yield "CRLB and attainable: what Gaussian errors at the Cramér-Rao and at the attainable bound would have."
    rows = []
    for _, part in frame.groupby("group", sort=False):
        fits = part.to_dict("records")
        bounds = [f"{value:.3g}" for value in medians_at_bounds(run.study, fits[0])] if bounded else []
        rows.append([_conditions(fits[0], named), *bounds, *map(_median, fits)])
    yield from columns(rows, ["", *(["CRLB", "attainable"] if bounded else []), *dict.fromkeys(frame["estimator"])])


def _conditions(row: RowValues, named: list[Condition]) -> str:
    """The conditions of a group."""
    if np.isfinite(row["decade"]):
        return f"{NOISE_OVER_RADIUS.symbol} = 1e{int(row['decade']):+03d} …"
    return ", ".join(condition.label(row) for condition in named)


def _median(row: RowValues) -> str:
    if row["ok"] == 0:
        return "none ok"
    failed = 1.0 - row["ok"] / row["planned"]
    text = f"{row['ratio_median_ok']:.3g} ± {row['ratio_median_ok_error']:.2g}"
    return text + (f" ({failed:.1%})" if failed > 0 else "")
