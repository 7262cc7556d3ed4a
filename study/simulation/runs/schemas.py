"""Schemas of the stored tables: each column with its type, unit and meaning, which are stored in the file too."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import pyarrow as pa

from study.fits import Status
from study.simulation.experiment.conditions import COLUMNS, CONDITIONS, Condition, bound_law
from study.simulation.experiment.config import ChainStatus
from study.simulation.experiment.measures import MeasureColumn
from study.simulation.statistics import PERFORMANCE, of_column


class Column(NamedTuple):
    """One column of a table."""

    name: str
    type: pa.DataType
    unit: str
    meaning: str


_WORD = pa.dictionary(pa.int32(), pa.string())
_STATUSES = "; ".join(f"{status.value} = {status.text}" for status in Status)
_STATUS_COLUMNS = frozenset(status.name.lower() for status in Status)
"""Columns of the summary that count the fits of each status."""
OF_ALL_TRIALS = tuple(f"{name}{end}" for name in PERFORMANCE if f"{name}_ok" in PERFORMANCE for end in ("", "_error"))
"""Columns of the summary with a measure of all trials, which an earlier version did not store."""
NEWER = frozenset(OF_ALL_TRIALS) | _STATUS_COLUMNS - {Status.OK.name.lower()}
NEWER |= {"rank_likelihood", "rhat", "difference", "checked"}
"""Columns that a table, or some of its rows, may lack because they are older."""
_CHAIN_STATUSES = "; ".join(f"{status.value} = {status.text}" for status in ChainStatus)


def _per_axis(name: str, dimension: int, unit: str, meaning: str) -> list[Column]:
    return [Column(f"{name}_{i + 1}", pa.float64(), unit, meaning.format(i + 1)) for i in range(dimension)]


def _conditions(conditions: Iterable[Condition], in_full: bool = False) -> list[Column]:
    """A column for each condition of a cell."""
    kinds = {int: pa.int64(), float: pa.float64(), str: _WORD}
    return [Column(c.name, kinds[c.kind], c.unit, (in_full and c.in_full) or c.meaning) for c in conditions]


def _bound_law(conditions: Iterable[Condition]) -> str:
    """Words for the law of noise that the bound assumes; empty if the study's noise is normal."""
    law = bound_law([c.name for c in conditions])
    return f"; {law}" if law else ""


def errors(
    dimension: int, conditions: Sequence[Condition] = COLUMNS, measured: Sequence[MeasureColumn] = ()
) -> list[Column]:
    """The error table: a row per cell, trial and estimator.

    Args:
        dimension: d.
        conditions: those that have a column in the study's tables.
        measured: columns of the study's measures.
    """
    law = _bound_law(conditions)
    return [
        Column("cell", _WORD, "", "name of the condition, a digest of its values"),
        Column("trial", pa.int64(), "", "number of the data set"),
        *_conditions(conditions, in_full=True),
        Column("estimator", _WORD, "", "name of the estimator"),
        *_per_axis("error", dimension, "length", "estimated minus true centre, component {}; 1 is the cap's axis"),
        Column("error", pa.float64(), "length", "distance from the estimated to the true centre"),
        Column("radius_error", pa.float64(), "length", "estimated minus true radius"),
        Column("bound", pa.float64(), "length", f"√tr CRLB of the centre, for the realised directions{law}"),
        Column("radius_bound", pa.float64(), "length", f"√CRLB of the radius, for the realised directions{law}"),
        Column("noise_variance", pa.float64(), "length²", "noise variance of a coordinate, as given or estimated"),
        Column("status", pa.int8(), "", _STATUSES),
        Column("condition", pa.float64(), "", "ρ(Σ̂C⁻¹), the Leontief condition; NaN if nothing is subtracted"),
        Column("iterations", pa.int32(), "", "steps of an iteration; 0 for a closed form"),
        *(Column(name, pa.bool_() if kind is bool else pa.float64(), "", words) for name, kind, words in measured),
    ]


_DATA_SET = [
    Column("cell", _WORD, "", "name of the condition"),
    Column("trial", pa.int64(), "", "number of the data set"),
]
FAILURES = [
    *_DATA_SET,
    Column("estimator", _WORD, "", "name of the estimator"),
    Column("name", pa.string(), "", "the data set, as `study replay RUN NAME` draws it again"),
    Column("cause", _WORD, "", "exception, raised by the estimator; or worker, which died twice of the whole unit"),
    Column("message", pa.string(), "", "message of the exception, or how the worker ended"),
]

TIMINGS = [
    Column("step", _WORD, "", "draw (one level: and points), bound, points, moments, or an estimator (moments apart)"),
    Column("samples", pa.int64(), "", "number of samples N"),
    Column("fits", pa.int64(), "", "data sets handled"),
    Column("seconds", pa.float64(), "s", "time spent in them"),
]


def points(dimension: int) -> list[Column]:
    """The points table: a row per sample of the trials whose points are kept."""
    return [
        *_DATA_SET,
        Column("sample", pa.int64(), "", "number of the sample"),
        *_per_axis("x", dimension, "length", "coordinate {} as the estimators saw it"),
        *_per_axis("center", dimension, "length", "coordinate {} of the true centre"),
        Column("radius", pa.float64(), "length", "true radius"),
    ]


def _varying(condition: Condition) -> Column:
    """The column of a condition in the summary, where it may vary within a group."""
    if condition.kind is str:
        return Column(condition.name, pa.string(), "", f"{condition.meaning}; empty where it varies")
    return Column(condition.name, pa.float64(), condition.unit, f"{condition.meaning}; not a number where it varies")


def summary(conditions: Sequence[Condition] = COLUMNS, measured: Sequence[MeasureColumn] = ()) -> list[Column]:
    """The summary table: a row per group, a cell or a decade of σ/r, and estimator; for the arguments see `errors`."""
    columns = [
        Column("group", pa.string(), "", "name of the cell, or the decade of σ/r by its lower end"),
        Column("estimator", _WORD, "", "name of the estimator"),
        Column("decade", pa.float64(), "", "floor of log10 σ/r; not a number for a cell"),
        *map(_varying, conditions),
        Column("planned", pa.int64(), "", "fits planned; none is ever drawn again or left out"),
        *(Column(s.name.lower(), pa.int64(), "", f"fits with the status: {s.text}") for s in Status),
    ]

    law = _bound_law(conditions)
    meanings = {name: measure.meaning for name, measure in PERFORMANCE.items()}
    meanings |= {name: meaning for column in measured for name, (meaning, _) in of_column(column).items()}
    for name, meaning in meanings.items():
        of_bound = "bound" in meaning or "CRLB" in meaning
        columns.append(Column(name, pa.float64(), "", meaning + law * of_bound))
        columns.append(Column(f"{name}_error", pa.float64(), "", f"Monte-Carlo standard error of {name}"))
    return columns


def _per_parameter(name: str, dimension: int, unit: str, meaning: str, noise: bool = True) -> list[Column]:
    """A column for each parameter of a posterior: the centre's components, the radius and perhaps σ."""
    columns = _per_axis(name, dimension, unit, meaning + " of the centre's component {}")
    columns.append(Column(f"{name}_radius", pa.float64(), unit, meaning + " of the radius"))
    if noise:
        columns.append(Column(f"{name}_noise", pa.float64(), unit, meaning + " of σ; not a number where it is known"))
    return columns


_CHAIN = [
    *_DATA_SET,
    Column("likelihood", _WORD, "", "geometric or whole_sphere"),
    Column("noise_is", _WORD, "", "known, or unknown: one more parameter of the chain"),
]

POSTERIOR_QUANTILES = {"q025": 0.025, "q16": 0.16, "q50": 0.5, "q84": 0.84, "q975": 0.975}


def posterior(dimension: int, conditions: Sequence[Condition] = COLUMNS) -> list[Column]:
    """The posterior table: a row per chain. Means and quantiles are less the truth."""
    return [
        *_CHAIN,
        *_conditions(conditions, in_full=True),
        Column("flatness", pa.float64(), "", "σ²/v, noise over the points' variance along the cap's axis, by theory"),
        Column("status", pa.int8(), "", _CHAIN_STATUSES),
        *_per_parameter("mean", dimension, "length", "posterior mean less the truth,"),
        *_per_parameter("sd", dimension, "length", "posterior standard deviation"),
        *(
            column
            for name, p in POSTERIOR_QUANTILES.items()
            for column in _per_parameter(name, dimension, "length", f"{100.0 * p:g} % quantile less the truth,")
        ),
        Column("trace", pa.float64(), "length²", "trace of the centre's posterior covariance"),
        *_per_parameter("bound", dimension, "length", "√CRLB at the true σ, realised directions,", noise=False),
        *_per_axis("bound_with", dimension, "", "correlation of component 1 with {} in the bound")[1:],
        Column("bound_with_radius", pa.float64(), "", "correlation of component 1 with the radius in the bound"),
        *_per_parameter("rank", dimension, "", "share of the draws below the truth,"),
        Column("rank_likelihood", pa.float64(), "", "share of the draws with a lower likelihood than the truth"),
        Column("level", pa.float64(), "", "share of the draws that are nearer to the mean than the true centre"),
        Column("rhat", pa.float64(), "", "largest R̂ of the chain and of draws of the centre's marginal density"),
        Column("difference", pa.float64(), "", "largest difference of a mean, sd or quantile from these draws', in sd"),
        Column("checked", pa.float64(), "", "effective size of these draws"),
        Column("tau", pa.float64(), "step", "largest integrated autocorrelation time"),
        Column("draws", pa.float64(), "", "effective sample size: draws kept over tau"),
        Column("acceptance", pa.float64(), "", "share of proposals accepted"),
        Column("steps", pa.int64(), "", "length of the chain, the first fifth of which is not used"),
        Column("walkers", pa.int64(), "", "walkers of the ensemble"),
    ]


def answers(dimension: int) -> list[Column]:
    """The table of fits beside the posterior: a row per chain and estimator."""
    return [
        *_CHAIN,
        Column("estimator", _WORD, "", "name of the estimator; it is given σ where σ is known or needed"),
        Column("status", pa.int8(), "", _STATUSES),
        *_per_parameter("away", dimension, "", "answer less posterior mean, in posterior sd,", noise=False),
        Column("distance", pa.float64(), "", "Mahalanobis distance of the centre from the posterior mean"),
        *_per_parameter("spread", dimension, "", "own standard error over posterior sd,", noise=False),
        *_per_parameter("rank", dimension, "", "own distribution function at the truth,", noise=False),
        Column("level", pa.float64(), "", "level of its confidence ellipsoid on whose surface the true centre lies"),
    ]


def draws(dimension: int) -> list[Column]:
    """The draws table: a row per draw of the chains whose draws are kept, thinned, less the truth."""
    return [
        *_CHAIN,
        *_per_axis("error", dimension, "length", "component {} of the centre, less the truth"),
        Column("radius_error", pa.float64(), "length", "radius less the truth"),
        Column("noise", pa.float64(), "length", "σ"),
    ]


CLAIMS = [
    Column("number", pa.int16(), "", "the claim's number"),
    Column("name", pa.string(), "", "a word or two for the claim"),
    Column("section", pa.string(), "", "section of the paper"),
    Column("statement", pa.string(), "", "what the paper says, in our words"),
    Column("quantity", pa.string(), "", "what is measured"),
    Column("value", pa.float64(), "", "share of the conditions in which it holds; not a number where there is none"),
    Column("error", pa.float64(), "", "its Monte-Carlo standard error; 0 for what is counted"),
    Column("trials", pa.int64(), "", "smallest number of data sets behind any of the numbers"),
    Column(
        "verdict",
        pa.string(),
        "",
        "reproduced, mostly, in part, not reproduced, or not evaluated; perhaps of another cause",
    ),
    Column("finding", pa.string(), "", "numbers with their Monte-Carlo errors, one a line, or why there are none"),
    Column("criterion", pa.string(), "", "the conditions, and when the claim holds in one"),
    Column("remark", pa.string(), "", "where the paper's number comes from, what explains ours"),
    Column("reads", pa.string(), "", "tables that the claim reads, as config/table"),
    Column("runs", pa.string(), "", "names of the runs that were read"),
    Column("figure", pa.string(), "", "the figure that shows it"),
]

_PRECISION = [
    Column("trials", pa.int64(), "", "data sets that the cell has; 0 if the budget ended before its first checkpoint"),
    Column("checkpoints", pa.int64(), "", "number of checkpoints that the cell reached"),
    Column("estimator", _WORD, "", "of those that the target is for, the one that is farthest from it"),
    Column("value", pa.float64(), "", "the measure of that estimator, at the last checkpoint"),
    Column("error", pa.float64(), "", "its Monte-Carlo standard error, which decided"),
    Column("goal", pa.float64(), "", "what that had to reach: target, or relative_target times |value|"),
    Column("reason", _WORD, "", "why it has no more trials: target, cap (of design.trials), or budget (of time)"),
]


def precision(conditions: Sequence[Condition] = COLUMNS) -> list[Column]:
    """The precision table of an adaptive run: a row per cell; for the argument see `errors`."""
    return [Column("cell", _WORD, "", "name of the condition"), *_conditions(conditions), *_PRECISION]


def of_units(
    dimension: int, conditions: Sequence[Condition] = COLUMNS, measured: Sequence[MeasureColumn] = ()
) -> dict[str, list[Column]]:
    """Columns of the tables that units fill, by table: errors or, in a study that keeps nothing else, the summary."""
    return {
        "errors": errors(dimension, conditions, measured),
        "timings": TIMINGS,
        "points": points(dimension),
        "failures": FAILURES,
        "summary": summary(conditions, measured),
    }


def declared(
    dimension: int, conditions: Sequence[Condition] = COLUMNS, measured: Sequence[MeasureColumn] = ()
) -> dict[str, list[Column]]:
    """Columns of all tables of a run, by table."""
    return of_units(dimension, conditions, measured) | {
        "precision": precision(conditions),
        "posterior": posterior(dimension, conditions),
        "answers": answers(dimension),
        "draws": draws(dimension),
        "claims": CLAIMS,
    }


def fault(stored: pa.Schema, columns: list[Column]) -> str | None:
    """The first declared column that a stored table lacks, or has with another type; None if there is none.

    Counts of statuses and measures of all trials may be missing: a table may be older than they are.
    """
    for column in columns:
        if stored.get_field_index(column.name) < 0:
            if column.name in NEWER:
                continue
            return f"not a table of this version: no column {column.name!r}"
        if (kind := stored.field(column.name).type) != column.type:
            return f"not a table of this version: column {column.name!r} is of type {kind}, not {column.type}"
    return None


def schema(columns: list[Column], metadata: Mapping[str, str] | None = None) -> pa.Schema:
    """Make the Arrow schema of a table, with units and meanings as metadata of its columns."""
    fields = [
        pa.field(name, kind, metadata={"unit": unit, "meaning": meaning}) for name, kind, unit, meaning in columns
    ]
    return pa.schema(fields, metadata=dict(metadata) if metadata else None)


def table(columns: list[Column], data: Mapping[str, object]) -> pa.Table:
    """Make an Arrow table of arrays; ValueError if they are not the columns declared."""
    names = [column.name for column in columns]
    if set(names) != set(data):
        raise ValueError(f"columns {sorted(set(names) ^ set(data))} are declared but not computed, or the reverse")
    return pa.table([pa.array(data[c.name], type=c.type) for c in columns], schema=schema(columns))


def completed(table: pa.Table, columns: Sequence[Column]) -> pa.Table:
    """Give rows the columns declared, in their order: a missing condition has its default, further ones are left out.

    A column that the rows lack because they are older than it is not a number.

    Args:
        table: rows of a study with other silent conditions, or of an earlier version.
        columns: those declared.
    """
    names = [column.name for column in columns]
    if table.schema.names == names:
        return table
    for column in columns:
        if column.name not in table.schema.names:
            default = CONDITIONS[column.name].default if column.name in CONDITIONS else math.nan
            table = table.append_column(column.name, pa.array([default] * table.num_rows, type=column.type))
    return table.select(names)
