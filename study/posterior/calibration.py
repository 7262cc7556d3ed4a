"""Simulation-based calibration of posteriors and of the estimators' own covariances, over many trials.

For a correct posterior the rank of the truth is uniform (Cook, Gelman & Rubin 2006; Talts et al. 2018), and sets of
nominal level p contain the truth in a share p of the trials. An estimator is tested in the same way: its rank is the
distribution function of its error law at the truth, its level that of the ellipsoid through the truth.

In a grid the truth is fixed, in a random design it is drawn. The priors are flat where the posterior is, so both must
give uniform ranks up to terms of the order of σ²/v, if the likelihood is that of the data.
"""

import numpy as np
import pandas as pd
import scipy

from study.estimators import Status
from study.experiment.conditions import STORED
from study.experiment.posterior_config import ChainStatus

KEYS = ["cell", "trial", "likelihood", "noise_is"]
LEVELS = (0.68, 0.95)
FLAT = 0.02
"""σ²/v above which the posterior is skewed (docs/theory.md §6)."""


def by_cell(posterior: pd.DataFrame, answers: pd.DataFrame) -> pd.DataFrame:
    """Posteriors beside the MLE and the bound, cell by cell.

    Args:
        posterior: the posterior table.
        answers: the table of the estimators' answers.

    Returns:
        A row per cell, likelihood and ``noise_is``, with the cell's conditions: the numbers ``chains`` and ``ok``, and
        over the ok chains the largest ``shift`` of the posterior mean from the MLE in any component of (c, r), in
        posterior sd (NaN without ``mle`` among the estimators), the ``least`` and ``most`` ratio of a component's sd to
        the bound's, and the largest ``tau``.
    """
    endings = [name.removeprefix("away_") for name in answers.columns if name.startswith("away_")]
    mle = answers[answers["estimator"] == "mle"].set_index(KEYS)[[f"away_{e}" for e in endings]]
    shift = mle.abs().max(axis=1).reindex(posterior.set_index(KEYS).index)
    ratio = posterior[[f"sd_{e}" for e in endings]].to_numpy() / posterior[[f"bound_{e}" for e in endings]].to_numpy()
    found = posterior.assign(shift=shift.to_numpy(), least=ratio.min(axis=1), most=ratio.max(axis=1))
    rows = []
    conditions = [condition.name for condition in STORED if condition.name in found]
    kept = ["cell", "likelihood", "noise_is", *conditions, "flatness"]
    for _, part in found.groupby(["cell", "likelihood", "noise_is"], sort=False, observed=True):
        ok = part[part["status"] == ChainStatus.OK]
        row: dict[str, object] = {name: part[name].iloc[0] for name in kept}
        row |= {"chains": len(part), "ok": len(ok), "shift": ok["shift"].max(), "tau": ok["tau"].max()}
        rows.append(row | {"least": ok["least"].min(), "most": ok["most"].max()})
    return pd.DataFrame(rows)


def trials(posterior: pd.DataFrame, answers: pd.DataFrame) -> pd.DataFrame:
    """Ranks and levels of every method, a row per chain and method.

    Args:
        posterior: the posterior table.
        answers: the table of the estimators' answers.

    Returns:
        Columns ``method`` ("posterior" or an estimator), ``likelihood``, ``noise_is``, ``flatness``, ``ok``,
        ``level`` and ``rank_…``. With chains of two likelihoods, an estimator's rows are those beside the first, so
        that no fit counts twice.
    """
    ranks = [name for name in answers.columns if name.startswith("rank_")]
    chains = posterior.assign(method="posterior", ok=posterior["status"] == ChainStatus.OK)
    flatness = posterior.set_index(KEYS)["flatness"]
    first = str(posterior["likelihood"].iloc[0])
    fits = answers[answers["likelihood"] == first].assign(method=lambda f: f["estimator"].astype(str))
    fits = fits.assign(ok=fits["status"] == Status.OK, flatness=flatness.reindex(fits.set_index(KEYS).index).to_numpy())
    columns = ["method", "likelihood", "noise_is", "flatness", "ok", "level", *ranks]
    extra = [name for name in posterior.columns if name.startswith("rank_") and name not in ranks]
    return pd.concat([chains[columns + extra], fits[columns].reindex(columns=columns + extra)], ignore_index=True)


def coverage(found: pd.DataFrame) -> pd.DataFrame:
    """Share of trials in which a method's sets of nominal level contain the truth.

    Args:
        found: rows as `trials` gives them.

    Returns:
        A row per likelihood, ``noise_is``, method and nominal level: ``trials``, ``failed`` (those not ok, which
        count as not containing the truth), ``share`` that contains it, ``low`` and ``high`` of its exact 95 % binomial
        interval, and ``p`` of the exact binomial test of the nominal level.
    """
    rows = []
    for keys, part in found.groupby(["likelihood", "noise_is", "method"], sort=False, observed=True):
        inside, ok = part["level"].to_numpy(), part["ok"].to_numpy()
        for level in LEVELS:
            test = scipy.stats.binomtest(int(np.sum(ok & (inside < level))), len(part), level)
            low, high = test.proportion_ci(0.95, method="exact")
            row: dict[str, object] = dict(zip(["likelihood", "noise_is", "method"], keys, strict=True))
            row |= {"level": level, "trials": len(part), "failed": int(np.sum(~ok)), "share": test.statistic}
            rows.append(row | {"low": low, "high": high, "p": test.pvalue})
    return pd.DataFrame(rows)


def uniformity(found: pd.DataFrame) -> pd.DataFrame:
    """Kolmogorov and Smirnov's test that ranks are uniform, parameter by parameter.

    Args:
        found: rows as `trials` gives them; only ok rows are used.

    Returns:
        A row per likelihood, ``noise_is``, method and parameter: ``trials``, ``mean`` of the ranks (0.5 if they are
        uniform), ``distance`` from the uniform distribution, and its ``p``.
    """
    rows = []
    parameters = [name for name in found.columns if name.startswith("rank_")]
    for keys, part in found[found["ok"]].groupby(["likelihood", "noise_is", "method"], sort=False, observed=True):
        for name in parameters:
            ranks = part[name].dropna().to_numpy()
            if len(ranks) < 2:
                continue
            test = scipy.stats.kstest(ranks, "uniform")
            row: dict[str, object] = dict(zip(["likelihood", "noise_is", "method"], keys, strict=True))
            row |= {"parameter": name.removeprefix("rank_"), "trials": len(ranks), "mean": float(ranks.mean())}
            rows.append(row | {"distance": float(test.statistic), "p": float(test.pvalue)})
    return pd.DataFrame(rows)
