"""The posterior tables for a terminal: posteriors beside the MLE and the bound, and their calibration."""

import math
from collections.abc import Iterator

import pandas as pd

from study.experiment.conditions import named_in
from study.posterior.calibration import FLAT, LEVELS, by_cell, coverage, trials, uniformity
from study.runs.storage.run_folder import Run
from study.text.columns import columns
from study.text.numbers import number


def printed(run: Run) -> Iterator[str]:
    """The posterior tables in short.

    Yields:
        A title, a header, a line per cell and kind of chain (see `by_cell`), and then the calibration of all chains if
        they are independent of each other.
    """
    found, beside = run.table("posterior"), run.table("answers")
    yield f"{run.study.run_name()}: posteriors; shift of the mean from the MLE in sd, largest over the parameters"
    conditions, rows = named_in(found), []
    for row in by_cell(found, beside).to_dict("records"):
        values = [condition.written(condition.of(row)) for condition in conditions]
        rows.append([*values, row["likelihood"], row["noise_is"], f"{row['ok']}/{row['chains']}"])
        if row["ok"]:
            ratio = f"{row['least']:.2f} … {row['most']:.2f}"
            rows[-1] += [number(row["shift"], ".2f"), ratio, f"{row['tau']:.0f}"]
    symbols = [condition.symbol for condition in conditions]
    titles = [*symbols, "likelihood", "noise", "ok", "shift", "sd over bound", "τ"]
    yield from columns(rows, titles, ">" * len(symbols) + "<<>")
    if run.study.independent():
        yield from printed_calibration(trials(found, beside))


def printed_calibration(found: pd.DataFrame) -> Iterator[str]:
    """Coverage and uniformity of ranks, of the chains whose likelihood is nearly quadratic.

    Args:
        found: rows as `study.posterior.calibration.trials` gives them.

    Yields:
        A title, a header, and a line per method; nothing if no chain is nearly quadratic.
    """
    curved = found[found["flatness"] < FLAT]
    if curved.empty:
        return
    yield f"calibration of {len(curved[curved['method'] == 'posterior'])} chains, those with σ²/v < {FLAT}:"
    keys = ["likelihood", "noise_is", "method"]
    ranks = {(*(row[key] for key in keys), row["parameter"]): row["p"] for row in uniformity(curved).to_dict("records")}
    parameters = list(dict.fromkeys(key[-1] for key in ranks))
    rows = []
    for key, part in coverage(curved).groupby(keys, sort=False, observed=True):
        shares = [f"{row['share']:.1%} ({row['low']:.1%} … {row['high']:.1%})" for _, row in part.iterrows()]
        rows.append(
            [*map(str, key), *shares, *(number(ranks.get((*key, name), math.nan), ".2g") for name in parameters)]
        )
    titles = [*(f"{level:.0%} set" for level in LEVELS), *(f"p of {name}" for name in parameters)]
    yield from columns(rows, ["likelihood", "noise", "method", *titles], "<<<>")
    yield "p: probability of ranks at least so far from uniform, by Kolmogorov and Smirnov's test, if they were uniform"
