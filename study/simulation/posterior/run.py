"""The posterior tables of a run: chains computed by workers, stored as they finish, joined at the end, and calibrated.

A chain is named by its cell, trial, likelihood and whether the noise is known, and draws from a stream of that name. So
its numbers depend neither on the number of workers nor on an interruption, and more trials or cells leave the other
chains as they are. Its tables are the posterior in numbers, each estimator's fit, and stored draws.

Simulation-based calibration tests posteriors and the estimators' own covariances over many trials. For a correct
posterior the rank of the truth is uniform (Cook, Gelman & Rubin 2006; Talts et al. 2018), and sets of nominal level p
contain the truth in a share p of the trials. An estimator is tested in the same way: its rank is the distribution
function of its error law at the truth, its level that of the ellipsoid through the truth. In a grid the truth is fixed,
in a random design it is drawn. The priors are flat where the posterior is, so both must give uniform ranks up to terms
of the order of σ²/v, if the likelihood is that of the data.
"""

import hashlib
import json
import math
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, reduce
from itertools import product
from operator import and_
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
import scipy
from scipy import special
from threadpoolctl import threadpool_limits

from study.arrays import Floats
from study.files import RunError, writing
from study.fits import ESTIMATORS, Samples, Status
from study.fits.loops.jit import always_compiled
from study.fits.loops.random import old_stream, stream
from study.fits.points.cap import cap_moments
from study.fits.registry import fit_samples
from study.simulation.experiment.conditions import STORED, named_in
from study.simulation.experiment.config import ChainStatus, Posterior, Study
from study.simulation.experiment.designs import Cell
from study.simulation.experiment.replay import Trial, all_trials
from study.simulation.runs import schemas
from study.simulation.runs.parts import Packet, Parts
from study.simulation.runs.run_folder import Run
from study.simulation.runs.workers import Dispatch, Workers
from study.text import columns, number

if TYPE_CHECKING:
    from study.simulation.posterior.sampler import Chain, Prior

KEYS = ["cell", "trial", "likelihood", "noise_is"]
_KIND = ["cell", "likelihood", "noise_is"]
_METHOD = ["likelihood", "noise_is", "method"]
LEVELS = (0.68, 0.95)
_NAMED = 3
"""Chains without an answer that are named for each reason."""
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
        the bound's, the largest ``tau``, and the largest ``rhat``.
    """
    endings = [name.removeprefix("away_") for name in answers.columns if name.startswith("away_")]
    mle = answers[answers["estimator"] == "mle"].set_index(KEYS)[[f"away_{e}" for e in endings]]
    shift = mle.abs().max(axis=1).reindex(posterior.set_index(KEYS).index)
    ratio = posterior[[f"sd_{e}" for e in endings]].to_numpy() / posterior[[f"bound_{e}" for e in endings]].to_numpy()
    result = posterior.assign(shift=shift.to_numpy(), least=ratio.min(axis=1), most=ratio.max(axis=1))
    result = result.assign(rhat=result.get("rhat", math.nan))
    conditions = [condition.name for condition in STORED if condition.name in result]
    ok = result[result["status"] == ChainStatus.OK].groupby(_KIND, sort=False, observed=True)
    largest = {name: (name, "max") for name in ("shift", "tau", "rhat", "most")}
    numbers = ok.agg(ok=("status", "size"), least=("least", "min"), **largest)
    cells = result.drop_duplicates(_KIND).set_index(_KIND)[[*conditions, "flatness"]]
    cells = cells.assign(chains=result.groupby(_KIND, sort=False, observed=True).size()).join(numbers)
    return cells.assign(ok=cells["ok"].fillna(0).astype(int)).reset_index()


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


def coverage(result: pd.DataFrame) -> pd.DataFrame:
    """Share of trials in which a method's sets of nominal level contain the truth.

    Args:
        result: rows as `trials` gives them.

    Returns:
        A row per likelihood, ``noise_is``, method and nominal level: ``trials``, ``failed`` (those not ok, which
        count as not containing the truth), ``share`` that contains it, ``low`` and ``high`` of its exact 95 % binomial
        interval, and ``p`` of the exact binomial test of the nominal level.
    """
    rows = []
    for keys, part in result.groupby(_METHOD, sort=False, observed=True):
        inside, ok = part["level"].to_numpy(), part["ok"].to_numpy()
        for level in LEVELS:
            test = scipy.stats.binomtest(int(np.sum(ok & (inside < level))), len(part), level)
            low, high = test.proportion_ci(0.95, method="exact")
            row: dict[str, object] = dict(zip(_METHOD, keys, strict=True))
            row |= {"level": level, "trials": len(part), "failed": int(np.sum(~ok)), "share": test.statistic}
            rows.append(row | {"low": low, "high": high, "p": test.pvalue})
    return pd.DataFrame(rows)


def uniformity(result: pd.DataFrame) -> pd.DataFrame:
    """Kolmogorov and Smirnov's test that ranks are uniform, parameter by parameter.

    Args:
        result: rows as `trials` gives them; only ok rows are used.

    Returns:
        A row per likelihood, ``noise_is``, method and parameter: ``trials``, ``mean`` of the ranks (0.5 if they are
        uniform), ``distance`` from the uniform distribution, and its ``p``.
    """
    rows = []
    for keys, part in result[result["ok"]].groupby(_METHOD, sort=False, observed=True):
        for name in [name for name in result.columns if name.startswith("rank_")]:
            ranks = part[name].dropna().to_numpy()
            if len(ranks) < 2:
                continue
            test = scipy.stats.kstest(ranks, "uniform")
            row: dict[str, object] = dict(zip(_METHOD, keys, strict=True))
            row |= {"parameter": name.removeprefix("rank_"), "trials": len(ranks), "mean": float(ranks.mean())}
            rows.append(row | {"distance": float(test.statistic), "p": float(test.pvalue)})
    return pd.DataFrame(rows)


Row = dict[str, Any]

STORED_DRAWS = 2000
"""Largest number of draws that are stored of a chain."""


def rows(task: "ChainTask", chain: "Chain") -> dict[str, pa.Table]:
    """Rows of the three tables for one chain.

    Args:
        task: the chain's name, and the data set, whose study has the estimators that are compared with the chain.
        chain: the posterior of its sphere.

    Returns:
        Tables ``posterior`` (one row), ``answers`` (a row per estimator) and ``draws`` (empty if they are not stored).
    """
    from study.simulation.posterior.sampler import likelihood_rank  # here and below, since it loads emcee: 0.6 s

    trial, key, known, walkers = task.trial, task.key, task.noise_is == "known", task.asked.walkers
    d, study = trial.samples.x.shape[1], trial.study
    truth = np.array([*trial.cell.center, trial.cell.radius, trial.cell.noise])
    draws = chain.flat - truth[: d + 2 - known]
    fits = [key | _answer(trial, name, draws, known) for name in study.estimators]
    walker_by_walker = np.arange(len(draws)).reshape(-1, walkers).T.ravel()
    chosen = np.linspace(0, len(draws) - 1, min(len(draws), STORED_DRAWS)).round().astype(int)
    thinned = draws[walker_by_walker[chosen]] if len(draws) else draws
    noise = np.append(np.zeros(len(thinned)) if known else thinned[:, d + 1], 0.0) + trial.cell.noise
    rank = likelihood_rank(task.likelihood, trial.samples.x[0], truth[: d + 1], thinned[:, : d + 1], noise)
    stored, noise = (thinned, noise[:-1]) if task.keeps_draws else (thinned[:0], noise[:0])
    posterior = _posterior(trial, chain, draws, walkers) | {"rank_likelihood": rank}
    columns = {f"error_{i + 1}": stored[:, i] for i in range(d)} | {"radius_error": stored[:, d], "noise": noise}
    return {
        "posterior": _table(schemas.posterior(d, study.conditions()), [key | posterior]),
        "answers": _table(schemas.answers(d), fits),
        "draws": schemas.table(schemas.draws(d), {k: [v] * len(stored) for k, v in key.items()} | columns),
    }


def _table(columns: list[schemas.Column], result: list[Row]) -> pa.Table:
    return schemas.table(columns, {column.name: [row[column.name] for row in result] for column in columns})


def names(dimension: int) -> list[str]:
    """Endings of the columns that exist once per parameter."""
    return [*(str(i + 1) for i in range(dimension)), "radius", "noise"]


def _posterior(trial: Trial, chain: "Chain", draws: Floats, walkers: int) -> Row:
    """The row of the posterior table; draws (n, parameters) are differences from the truth."""
    cell, d = trial.cell, trial.samples.x.shape[1]
    extent = cell.radius**2 * cap_moments(math.radians(cell.angle), d).along
    row: Row = cell.values | {"flatness": cell.noise**2 / extent}
    row |= {"status": int(chain.status), "tau": chain.tau, "acceptance": chain.acceptance}
    row |= {"rhat": chain.rhat, "difference": chain.difference, "checked": chain.checked}
    row |= {"steps": chain.steps, "walkers": walkers, "draws": len(draws) / chain.tau}
    unit = np.sqrt(np.diag(trial.unit_bound))
    row |= {f"bound_{name}": cell.noise * unit[i] for i, name in enumerate(names(d)[: d + 1])}
    correlation = trial.unit_bound[0] / unit / unit[0]
    row |= {f"bound_with_{name}": correlation[i] for i, name in enumerate(names(d)[: d + 1]) if i}
    row |= {"trace": math.nan, "level": math.nan}
    for i, name in enumerate(names(d)):
        known = i < draws.shape[1] and len(draws) > 0
        values = draws[:, i] if known else np.full(1, math.nan)
        row |= {f"mean_{name}": values.mean(), f"sd_{name}": values.std()}
        quantiles = np.quantile(values, list(schemas.POSTERIOR_QUANTILES.values()))
        row |= {f"{label}_{name}": q for label, q in zip(schemas.POSTERIOR_QUANTILES, quantiles, strict=True)}
        row[f"rank_{name}"] = float(np.mean(values < 0.0)) if known else math.nan
    if len(draws):
        center, covariance = draws[:, :d].mean(axis=0), np.cov(draws[:, :d].T)
        squares = _squares(draws[:, :d] - center, covariance)
        row["trace"] = float(np.trace(covariance))
        row["level"] = float(np.mean(squares < _squares(center[None], covariance)))
    return row


def _answer(trial: Trial, name: str, draws: Floats, known: bool) -> Row:
    """An estimator's row: its distance from the posterior mean, and the truth's quantiles in its own distribution."""
    d = trial.samples.x.shape[1]
    given = known or ESTIMATORS[name].needs == "noise"
    samples = Samples(trial.samples.x, trial.samples.noise if given else None)
    fit = fit_samples(samples, name)
    answer = np.append(fit.center[0] - np.array(trial.cell.center), fit.radius[0] - trial.cell.radius)
    error = fit.standard_errors[0]
    spare = samples.x.shape[2] - d - 1
    given = samples.noise is not None and ESTIMATORS[name].covariance is None
    known_law = given or spare > 0
    row: Row = {"estimator": name, "status": int(fit.estimates.status[0]), "distance": math.nan, "level": math.nan}
    mean, sd = np.full(d + 1, math.nan), np.full(d + 1, math.nan)
    if len(draws):
        mean, sd = draws[:, : d + 1].mean(axis=0), draws[:, : d + 1].std(axis=0)
        square = _squares((answer - mean)[None, :d], np.cov(draws[:, :d].T))
        row["distance"] = float(np.sqrt(square[0]))
    with np.errstate(all="ignore"):  # a fit may have no number, or no error
        away, spread, ranks = (answer - mean) / sd, error / sd, -answer / error
    for i, ending in enumerate(names(d)[: d + 1]):
        row |= {f"away_{ending}": away[i], f"spread_{ending}": spread[i]}
        rank = special.ndtr(ranks[i]) if given else special.stdtr(spare, ranks[i]) if known_law else math.nan
        row[f"rank_{ending}"] = float(rank)
    covariance = fit.covariance[0, :d, :d]
    if known_law and np.isfinite(covariance).all() and np.isfinite(answer[:d]).all():
        square = _squares(answer[None, :d], covariance)[0]
        row["level"] = float(special.chdtr(d, square) if given else special.fdtr(d, spare, square / d))
    return row


def _squares(vectors: Floats, covariance: Floats) -> Floats:
    """Squared Mahalanobis distances of vectors (n, d)."""
    values, axes = np.linalg.eigh(covariance)
    with np.errstate(all="ignore"):
        return np.asarray((((vectors @ axes) ** 2) / values).sum(axis=1))


FORMAT = 4
"""Version of the sampler; a chain of another version is computed again."""


@dataclass(frozen=True)
class ChainTask:
    """One chain to run.

    Attributes:
        trial: the data set.
        asked: the section of the config that asks for it.
        likelihood: name of the likelihood.
        noise_is: "known" or "unknown".
    """

    trial: Trial
    asked: Posterior
    likelihood: str
    noise_is: str

    @property
    def key(self) -> Row:
        """The columns that identify the chain in every table."""
        names = self.trial.cell.name, self.trial.trial, self.likelihood, self.noise_is
        return dict(zip(KEYS, names, strict=True))

    @property
    def keeps_draws(self) -> bool:
        """True if its draws are stored."""
        return self.trial.trial < self.asked.keep_draws

    @cached_property
    def part(self) -> str:
        """Name of the chain's part: a digest of all that determines it."""
        study, asked = self.trial.study, self.asked
        settings = (asked.box, asked.walkers, asked.max_steps, self.keeps_draws)
        content = repr((FORMAT, study.seed, study.dimension, study.estimators, settings, self.key, self.trial.cell))
        return hashlib.sha256(content.encode()).hexdigest()[:20]

    def of(self, table: pa.Table) -> pa.Table:
        """The chain's rows of a table of many."""
        return table.filter(reduce(and_, (pc.field(column) == value for column, value in self.key.items())))

    @always_compiled()
    def compute(self) -> dict[str, pa.Table]:
        """Run the chain; returns its rows of the posterior tables."""
        from study.simulation.posterior.marginal import Streams, sample_checked

        trial, asked = self.trial, self.asked
        prior = prior_of(trial.cell, asked, self.noise_is == "known")
        seed, name = trial.study.seed, ("posterior", *self.key.values())
        streams = Streams(stream(seed, "marginal", *name), old_stream(seed, *name), old_stream(seed, *name, "second"))
        limits = asked.walkers, asked.max_steps
        return rows(self, sample_checked(trial.samples, prior, self.likelihood, streams, *limits))


def prior_of(cell: Cell, posterior: Posterior, known: bool) -> "Prior":
    """The prior of a cell's trials: a box about the true centre, and any radius that a centre in it can have."""
    from study.simulation.posterior.sampler import Prior

    center, width = np.array(cell.center), posterior.box * cell.radius
    return Prior(center, width, 2.0 * cell.radius + len(center) ** 0.5 * width, cell.noise, known)


def chain_tasks(study: Study) -> list[ChainTask]:
    """Every chain that a config asks for, in the order of the tables; none without a [posterior]."""
    if (posterior := study.posterior) is None:
        return []
    chosen = (trial for trial in all_trials(study, posterior.trials) if posterior.chooses(trial.cell))
    return [ChainTask(*task) for task in product(chosen, [posterior], posterior.likelihood, posterior.noise)]


def printed(run: Run) -> Iterator[str]:
    """The posterior tables in short.

    Yields:
        A title, a header, a line per cell and kind of chain (see `by_cell`), a line per reason why chains have no
        answer, and then the calibration of all chains if they are independent of each other.
    """
    result, fits = run.table("posterior"), run.table("answers")
    yield f"{run.study.run_name()}: posteriors; shift of the mean from the MLE in sd, largest over the parameters"
    conditions, rows = named_in(result), []
    for row in by_cell(result, fits).to_dict("records"):
        values = [condition.written(condition.of(row)) for condition in conditions]
        rows.append([*values, row["likelihood"], row["noise_is"], f"{row['ok']}/{row['chains']}"])
        if row["ok"]:
            ratio = f"{row['least']:.2f} … {row['most']:.2f}"
            rows[-1] += [number(row["shift"], ".2f"), ratio, f"{row['tau']:.0f}", number(row["rhat"], ".3f")]
    symbols = [condition.symbol for condition in conditions]
    titles = [*symbols, "likelihood", "noise", "ok", "shift", "sd over bound", "τ", "R̂"]
    yield from columns(rows, titles, ">" * len(symbols) + "<<>")
    yield from _reasons(result)
    if run.study.independent():
        yield from printed_calibration(trials(result, fits))


def without_answer(posterior: pd.DataFrame) -> pd.DataFrame:
    """Rows of the posterior table whose chain has no answer: its status is not ok."""
    return posterior[posterior["status"] != ChainStatus.OK]


def _reasons(posterior: pd.DataFrame) -> Iterator[str]:
    """A line per reason for which chains have no answer, with the first of these chains."""
    failed = without_answer(posterior)
    for status in (status for status in ChainStatus if (failed["status"] == status).any()):
        part = failed[failed["status"] == status]
        names = [f"{row.cell}/{row.trial} {row.likelihood} {row.noise_is}" for row in part.head(_NAMED).itertuples()]
        which = ", ".join(names) + (" …" if len(part) > len(names) else "")
        yield f"{len(part)} of {len(posterior)} chains have no answer: {status.text} ({which})"


def printed_calibration(result: pd.DataFrame) -> Iterator[str]:
    """Coverage and uniformity of ranks, of the chains whose likelihood is nearly quadratic.

    Args:
        result: rows as `study.simulation.posterior.run.trials` gives them.

    Yields:
        A title, a header, and a line per method; nothing if no chain is nearly quadratic.
    """
    curved = result[result["flatness"] < FLAT]
    if curved.empty:
        return
    yield f"calibration of {len(curved[curved['method'] == 'posterior'])} chains, those with σ²/v < {FLAT}:"
    uniform = uniformity(curved).to_dict("records")
    ranks = {tuple(row[key] for key in (*_METHOD, "parameter")): row["p"] for row in uniform}
    parameters = list(dict.fromkeys(row["parameter"] for row in uniform))
    rows = []
    for key, part in coverage(curved).groupby(_METHOD, sort=False, observed=True):
        shares = [f"{row['share']:.1%} ({row['low']:.1%} … {row['high']:.1%})" for _, row in part.iterrows()]
        tests = [number(ranks.get((*key, name), math.nan), ".2g") for name in parameters]
        rows.append([*map(str, key), *shares, *tests])
    titles = [*(f"{level:.0%} set" for level in LEVELS), *(f"p of {name}" for name in parameters)]
    yield from columns(rows, ["likelihood", "noise", "method", *titles], "<<<>")
    yield "p: probability of ranks at least so far from uniform, by Kolmogorov and Smirnov's test, if they were uniform"


_OUTPUTS = ("chain",)
_HEAVY = 1e8
"""Weight of a chain per sample, so large that each chain is sent to a worker alone."""


def compute(run: Run, jobs: Workers | int = 2, progress: Callable[[float], None] | None = None) -> None:
    """Compute the posterior tables that a run's config asks for; finished chains are not computed again.

    Args:
        run: the run; only its config is used.
        jobs: number of workers, or the workers. Processes take the place of threads, because emcee's steps hold the
            interpreter's lock.
        progress: called after each chain with its share of the work.

    Raises:
        RunError: if the config asks for none, chooses no cell, or the folder cannot be written.
    """
    workers = Workers(jobs=jobs) if isinstance(jobs, int) else jobs
    study, posterior = run.study, run.study.posterior
    if posterior is None:
        raise RunError(f"{run.folder}: its config has no [posterior]; add one, as in configs/posterior.toml")
    todo = {task.part: task for task in chain_tasks(study)}
    if not todo:
        raise RunError(f"{run.folder}: [posterior] where = {dict(posterior.where)} chooses none of its cells")
    metadata = {"study.config": study.canonical(), "study.posterior": json.dumps(list(todo))}
    d = study.dimension
    stored = {"answers": schemas.answers(d), "draws": schemas.draws(d)}
    stored["posterior"] = schemas.posterior(d, study.conditions())
    usable = all(map(run.valid, stored))
    if usable and run.metadata("posterior").get("study.posterior") == metadata["study.posterior"]:
        return
    if workers.backend == "threads" and workers.jobs > 1:
        workers = replace(workers, backend="loky")
    with workers.open() as backend, threadpool_limits(limits=1), writing(run.folder):
        parts = Parts(run.folder, "chains")
        parts.load()
        for name in parts.damaged:
            print(f"{parts.folder / name}: damaged; moved to parts/damaged and computed again", file=sys.stderr)
        if usable:
            _keep_finished(run, parts, todo, list(stored))
        run.forget(*stored)
        missing = [task for part, task in todo.items() if not parts.outputs(part)]
        lost: list[str] = []

        def ended(tasks: tuple[ChainTask, ...], failure: str) -> None:
            if failure:
                lost.append(failure)
            if progress is not None:
                progress(len(tasks) / len(missing))

        dispatch = Dispatch(backend, _chains, None, parts)
        dispatch.compute(missing, lambda task: _HEAVY * task.trial.cell.samples, ended)
        if lost:
            raise RunError(f"{run.folder}: {len(lost)} chains could not be run: {lost[0]}; the others are stored")
        for name, columns in stored.items():
            result = (schemas.completed(table, columns) for part in todo for _, _, table in parts.tables(part, name))
            run.join(name, columns, result, metadata)
        made = {"chains": len(todo), "seconds": round(parts.seconds, 3), "jobs": workers.jobs}
        run.record(*stored, posterior=made)
        parts.remove()


def _keep_finished(run: Run, parts: Parts, wanted: dict[str, ChainTask], names: list[str]) -> None:
    """Reuse chains of finished tables that were made for other settings, so that only new chains are computed."""
    held = set(json.loads(run.metadata("posterior").get("study.posterior", "[]"))) & set(wanted)
    stored = {name: run.arrow(name) for name in names} if held else {}
    for part in held:
        rows_of = {name: wanted[part].of(table) for name, table in stored.items()}
        parts.add(Packet.of([(part, _OUTPUTS)], [rows_of]))
    parts.commit()


def _chains(shared: None, tasks: tuple[ChainTask, ...]) -> Packet:
    """Run chains, in a worker."""
    return Packet.of([(task.part, _OUTPUTS) for task in tasks], [task.compute() for task in tasks])
