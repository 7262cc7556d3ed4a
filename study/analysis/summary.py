"""The summary table: per cell, or per decade of relative noise, and estimator.

Failures count: every quantile comes twice, of the fits whose status is ok (``_ok``) and of all planned fits with the
others counted as worse than any (``_all``). Nothing is left out silently.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from study.analysis.measures import (
    UNKNOWN,
    Measure,
    mean,
    moments_exist,
    quantile,
    root_mean_square,
    share,
    tail_index,
)
from study.estimators import Status
from study.experiment.conditions import RandomDesign
from study.runs import tables
from study.runs.store import Run

_CONDITIONS = ["samples", "noise", "angle", "radius", "center"]
FAR = 10.0
"""Error over √tr CRLB beyond which a fit is an outlier."""


def summarise(run: Run) -> pd.DataFrame:
    """Summarise a run's error table, store the summary beside it, and return it."""
    errors = run.table("errors")
    frame = summary(errors, by_decade=isinstance(run.study.design, RandomDesign))
    columns = tables.summary()
    metadata = {"study.config": run.study.canonical()}
    data = {column.name: frame[column.name].to_numpy() for column in columns}
    run.save("summary", tables.table(columns, data).replace_schema_metadata(metadata))
    return frame


def summary(errors: pd.DataFrame, by_decade: bool) -> pd.DataFrame:
    """Performance measures of an error table.

    Args:
        errors: the error table.
        by_decade: group by decade of σ/r (a random design) instead of by cell (a grid).

    Returns:
        A row per group and estimator, in the order of the table; columns as `tables.summary` declares them.
    """
    if by_decade:
        lower = decade(errors["noise"] / errors["radius"]).astype(int)
        errors = errors.assign(group=[f"1e{power:+03d}" for power in lower], decade=lower)
        errors = errors.sort_values("decade", kind="stable")
    else:
        errors = errors.assign(group=errors["cell"].astype(str), decade=np.nan)
    groups = errors.groupby(["group", "estimator"], sort=False, observed=True)
    rows = [{"group": group, "estimator": estimator, **_row(part)} for (group, estimator), part in groups]
    return pd.DataFrame(rows)


def decade(values: ArrayLike) -> NDArray[np.float64]:
    """Lower end of the decade that each value lies in, as a power of ten; what rounding put just below it is in it."""
    return np.asarray(np.floor(np.log10(values) + 1e-9))


def _row(part: pd.DataFrame) -> dict[str, Any]:
    """One group of one estimator."""
    status = part["status"].to_numpy()
    ok = status == Status.OK
    row: dict[str, Any] = {"decade": part["decade"].iloc[0], "planned": len(part)}
    row |= {name: part[name].iloc[0] if part[name].nunique() == 1 else np.nan for name in _CONDITIONS}
    row |= {s.name.lower(): int(np.sum(status == s)) for s in Status}
    over_radius = (part["error"] / part["radius"]).to_numpy()
    # where the directions do not determine the centre, the bound is infinite and says nothing: worse than any
    over_bound = (part["error"] / part["bound"]).where(np.isfinite(part["bound"]), np.inf).to_numpy()
    for name, values in (("relative", over_radius), ("ratio", over_bound)):
        for label, p in (("median", 0.5), ("q05", 0.05), ("q95", 0.95)):
            row |= _pair(f"{name}_{label}_ok", quantile(values[ok], p))
            row |= _pair(f"{name}_{label}_all", quantile(np.where(ok, values, np.inf), p))
    far = over_bound > FAR
    row |= _pair("far_ok", share(int(np.sum(far & ok)), int(np.sum(ok))))
    row |= _pair("far_all", share(int(np.sum(far | ~ok)), len(ok)))
    row |= _pair("axis_median_ok", quantile((part["error_1"] / part["bound"]).to_numpy()[ok], 0.5))
    index = tail_index(over_bound[ok])
    safe = moments_exist(index)
    row |= _pair("tail_index", index)
    row |= _pair("bias", mean((part["error_1"] / part["bound"]).to_numpy()[ok]) if safe else UNKNOWN)
    row |= _pair("rmse", root_mean_square(over_bound[ok]) if safe else UNKNOWN)
    return row


def _pair(name: str, measure: Measure) -> dict[str, float]:
    return {name: measure.value, f"{name}_error": measure.error}


def printed(run: Run) -> Iterator[str]:
    """The summary in short, for a terminal.

    Yields:
        A title, a header, and a line per group: for each estimator the median error over the bound with its
        Monte-Carlo error, of the fits that are ok, and the share of those that are not.
    """
    frame = run.table("summary")
    estimators = list(dict.fromkeys(frame["estimator"]))
    groups = list(frame.groupby("group", sort=False))
    varying = [name for name in ("radius", "center") if frame[name].nunique() > 1]
    labels = [_label(part.iloc[0], varying) for _, part in groups]
    wide = max(map(len, labels))
    yield f"{run.study.run_name()}: median error of the centre over the Cramér-Rao bound ± Monte-Carlo error (not ok)"
    yield " " * wide + "".join(f"  {name:<26}" for name in estimators).rstrip()
    for text, (_, part) in zip(labels, groups, strict=True):
        yield f"{text:<{wide}}" + "".join(f"  {_short(row):<26}" for _, row in part.iterrows()).rstrip()


def _label(row: "pd.Series[Any]", varying: list[str]) -> str:
    """What a group is, in words."""
    if np.isfinite(row["decade"]):
        return f"σ/r = 1e{int(row['decade']):+03d} …"
    parts = [f"N = {row['samples']:g}", f"σ/r = {row['noise'] / row['radius']:.3g}", f"φ = {row['angle']:.4g}°"]
    return ", ".join([*parts, *(f"{'r' if name == 'radius' else '|c|'} = {row[name]:g}" for name in varying)])


def _short(row: "pd.Series[Any]") -> str:
    if row["ok"] == 0:
        return "none ok"
    failed = 1.0 - row["ok"] / row["planned"]
    text = f"{row['ratio_median_ok']:.3g} ± {row['ratio_median_ok_error']:.2g}"
    return text + (f" ({failed:.1%})" if failed > 0 else "")
