"""A claim of the paper, the tables it is judged by, the numbers behind it, and its verdict.

A `Claim` names the tables that it reads. Its ``measure`` turns them into numbers, each with its Monte-Carlo error. The
first is the share of the claim's conditions in which it holds, as its ``criterion`` states, and one rule turns every
share into a verdict (`Verdict.by`). No verdict is written down anywhere: it changes with the tables, and without them
there is none.

Measures and rules that several claims share stand below. Every fit counts with its error as computed, whatever its
status, and one without a number as infinite (`error_over`): so estimators are compared on the same trials, where a
status would select other trials for each of them. Medians have their Monte-Carlo errors, as have the power laws,
quotients and extremes that are made of them.
"""

import math
from collections.abc import Callable, Collection, Iterable, Iterator
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import scipy
from pandas.api import types
from pydantic import Field

from study.arrays import Bools, Floats, Ints
from study.files import RunError
from study.fits import Status
from study.simulation.experiment.conditions import RADIUS, STATED_VARIANCE, STORED
from study.simulation.runs import schemas
from study.simulation.runs.run_folder import Run
from study.simulation.statistics import FAR, UNKNOWN, Measure, mean, power_law, quantile, share
from study.text import one_line, paragraphs
from study.toml import Frozen

Average = Callable[[Floats, int], Measure]
"""Average of values, of which there must be at least so many, with its Monte-Carlo error."""

_OF_MLE, _OF_LLS = ("mle", "mle_centroid", "mle_mirror", "mle_early"), ("lls", "lls_nr", "lls_nr_raw", "lls_single")
NAMED = frozenset(("gdke", "ugdk", "ugdk_cov", "als", *_OF_MLE, *_OF_LLS))
"""Estimators that claims name. Rows of the others are not read: they are half of the largest table."""
_CONDITIONS = (condition.name for condition in STORED)
_COLUMNS = ("cell", "trial", *_CONDITIONS, "estimator", "error", "error_1", "error_2", "bound", "noise_variance")
_COLUMNS += ("status", "condition", "iterations")
"""Columns of an error table that claims use."""

_COSTS = ("flops_per_sample", "paper_flops", "scalar_seconds", "vector_seconds")
"""Columns of a cost table that hold numbers."""

LEAST = 20
"""Least number of data sets behind a median that is shown."""
WHOLE = 180.0
"""Half-angle of a cap that is the whole sphere."""


class TableMissing(Exception):  # noqa: N818  no error: most sets of runs lack some claim's tables
    """A table that a claim reads is missing; the message names it and the command that makes it."""


class Rules(Frozen):
    """Rules of judging that the paper leaves open.

    Attributes:
        average: the average of errors: their median, or their mean.
        far: an outlier's error over √tr CRLB is greater.
        cost: a fit's cost: operations counted here, the paper's formulas, or seconds in scalar code.
        fits: the fits that count: all, or those of trials in which every estimator that claims name is ok.
    """

    average: Literal["median", "mean"] = "median"
    far: Annotated[float, Field(gt=1.0)] = FAR
    cost: Literal["operations", "formulas", "seconds"] = "operations"
    fits: Literal["all", "ok"] = "all"


class JointMarkers(NamedTuple):
    """Markers about one centre, in many trials.

    Attributes:
        sigma: standard deviation of a coordinate that the fits are given, the same for all markers.
        radii: radius of each marker's sphere (M,), ascending.
        markers: points of each marker (trials, n, d), measured from the true centre.
    """

    sigma: float
    radii: Floats
    markers: list[Floats]


def point_sets(points: pd.DataFrame, cell: str) -> Floats:
    """Point sets (trials, n, d) of one cell, measured from the true centre."""
    mine = points[points["cell"] == cell].sort_values(["trial", "sample"])
    dimension = sum(name.startswith("center_") for name in points.columns)
    axes = range(1, dimension + 1)
    flat = np.stack([(mine[f"x_{i}"] - mine[f"center_{i}"]).to_numpy() for i in axes], axis=1)
    return flat.reshape(max(mine["trial"].nunique(), 1), -1, dimension)


def joint_markers(errors: pd.DataFrame, points: pd.DataFrame) -> Iterator[JointMarkers]:
    """The joints of a grid run with several radii, drawn independently, whose points were stored.

    Args:
        errors: the run's error table, for the conditions of its cells.
        points: its table of points.

    Yields:
        A joint per noise (ascending), number of samples, angle and centre, with a marker for each radius. Conditions
        with a single radius yield nothing.
    """
    cells = errors.drop_duplicates("cell").astype({"cell": str}).sort_values("radius")
    by_name = points.assign(cell=points["cell"].astype(str))
    others = [condition.name for condition in STORED if condition is not RADIUS and condition.name in cells]
    for _, mine in cells.groupby(others):
        if len(mine) > 1:
            sets = [point_sets(by_name, cell) for cell in mine["cell"]]
            count = min(map(len, sets))
            markers = [x[:count] for x in sets]
            stated = math.sqrt(mine[STATED_VARIANCE.name].iloc[0]) if STATED_VARIANCE.name in mine else 1.0
            yield JointMarkers(float(mine["noise"].iloc[0]) * stated, mine["radius"].to_numpy(), markers)


class Evidence:
    """The runs that claims are judged by; what is read of them is read once.

    Args:
        runs: runs of different configs.
        cost: the table of `study cost`, or None.
        recordings: spreads of joints from case studies, or None; columns as in
            `study.simulation.claims.recordings`.
        rules: the rules of judging.

    Attributes:
        runs: the runs by the name of their config: ``paper`` of configs/paper.toml.

    Raises:
        RunError: if two runs are of one config's name.
    """

    def __init__(
        self,
        runs: Iterable[Run],
        cost: pd.DataFrame | None = None,
        recordings: pd.DataFrame | None = None,
        rules: Rules | None = None,
    ) -> None:
        self.runs: dict[str, Run] = {}
        for run in runs:
            if other := self.runs.get(name := run.study.name):
                raise RunError(f"{other.folder} and {run.folder}: both are runs named {name!r}; give one of them")
            self.runs[name] = run
        self.cost, self.recordings, self.rules = cost, recordings, rules or Rules()
        self._read: dict[tuple[str, str], pd.DataFrame] = {}
        self._joints: dict[str, list[JointMarkers]] = {}

    def table(self, config: str, name: str) -> pd.DataFrame:
        """A table of the run of a config, read once.

        Raises:
            TableMissing: if there is no such run, or it did not finish.
        """
        if (config, name) not in self._read:
            self._read[config, name] = self._stored(config, name)
        return self._read[config, name]

    def errors(self, config: str) -> pd.DataFrame:
        """The error table of the run of a config: estimator by estimator of those that claims name, and cell by cell.

        Raises:
            TableMissing: as `table`.
        """
        if (config, "errors") not in self._read:
            table = self._stored(config, "errors", _COLUMNS, NAMED)
            if self.rules.fits == "ok":
                ok = table["status"] == Status.OK
                table = table[ok.groupby([table["cell"], table["trial"]], observed=True).transform("all")]
            self._read[config, "errors"] = table.sort_values(["estimator", "cell"], kind="stable", ignore_index=True)
        return self._read[config, "errors"]

    @property
    def fits(self) -> str:
        """The fits that count, in words."""
        return "all fits" if self.rules.fits == "all" else "fits of trials in which all are ok"

    def average(self, values: "Floats | pd.Series[float]", least: int = LEAST) -> Measure:
        """Average of errors, at least so many: by the rules their median, or their mean; with its Monte-Carlo error."""
        if self.rules.average == "mean" and len(values) >= least:
            return mean(np.asarray(values, dtype=float))
        return median(values, least)

    def _stored(self, config: str, name: str, *selection: Collection[str]) -> pd.DataFrame:
        if config not in self.runs:
            raise TableMissing(f"needs a run of configs/{config}.toml")
        try:
            return self.runs[config].table(name, *selection)
        except RunError as error:
            raise TableMissing(str(error)) from None

    def joints(self, config: str) -> list[JointMarkers]:
        """The joints of a run with several radii, from its errors and points.

        Raises:
            TableMissing: as `table`.
        """
        if config not in self._joints:
            self._joints[config] = list(joint_markers(self.errors(config), self.table(config, "points")))
        return self._joints[config]

    def costs(self) -> pd.DataFrame:
        """The cost table.

        Raises:
            TableMissing: if none was given.
        """
        if self.cost is None:
            raise TableMissing("needs the cost table: `study cost` makes it")
        return self.cost

    def spreads(self) -> pd.DataFrame:
        """Spreads of joints of recordings.

        Raises:
            TableMissing: if none were given.
        """
        if self.recordings is None:
            raise TableMissing("needs a recording: `study case-study FILE --out DIR`, then `--recording DIR` here")
        return self.recordings


def read_cost(path: Path | None) -> pd.DataFrame | None:
    """Read a cost table, if its file is given.

    Raises:
        RunError: if it cannot be read, or is no such table.
    """
    if path is None:
        return None
    remedy = "`study cost --out FILE.parquet` makes one"
    if not path.is_file():
        raise RunError(f"{path}: no cost table; {remedy}")
    try:
        table: pd.DataFrame = pq.read_table(path).to_pandas()
    except (OSError, pa.ArrowException, ValueError, KeyError, TypeError):  # the last two: garbled text on columns
        raise RunError(f"{path}: not a cost table: damaged, or not parquet; {remedy}") from None
    odd = [name for name in _COSTS if name not in table or not types.is_numeric_dtype(table[name])]
    if "estimator" not in table or odd:
        words = ", ".join(odd or ["estimator"])
        raise RunError(f"{path}: not a cost table: {words} missing or not numbers; {remedy}")
    return table


class Verdict(StrEnum):
    """The outcome of a claim, by the share of its conditions in which it holds.

    In a table ", another cause" may follow: the effect is there, and the paper's reason for it is not.
    """

    REPRODUCED = "reproduced"
    MOSTLY = "mostly"
    IN_PART = "in part"
    NOT_REPRODUCED = "not reproduced"
    NOT_EVALUATED = "not evaluated"

    @classmethod
    def by(cls, share: float) -> "Verdict":
        """Reproduced from .95 of the conditions on, mostly from .8, in part from .2, not reproduced below."""
        if share >= 0.95:
            return cls.REPRODUCED
        return cls.MOSTLY if share >= 0.8 else cls.IN_PART if share >= 0.2 else cls.NOT_REPRODUCED

    @classmethod
    def _missing_(cls, value: object) -> "Verdict | None":
        """The verdict of a text with another cause."""
        words, _, beside = str(value).partition(OTHER_CAUSE)
        return None if words == value or beside else cls(words)


OTHER_CAUSE = ", another cause"
"""End of a verdict on an effect for which the paper's reason fails."""


class Number(NamedTuple):
    """One number behind a verdict.

    Attributes:
        words: name of the quantity with its unit, for a reader: "GDKE's bias over its own standard deviation".
        value: the number.
        error: its Monte-Carlo standard error; 0 for a count, NaN if there is none.
        trials: the smallest number of data sets behind it; 0 if it comes from no trial.
    """

    words: str
    value: float
    error: float
    trials: int

    @classmethod
    def of(cls, words: str, measure: Measure, trials: int) -> "Number":
        """A measure with its name."""
        return cls(words, measure.value, measure.error, trials)

    @classmethod
    def share(cls, words: str, values: "Bools | Floats | pd.Series[bool]", least: int = 1) -> "Number":
        """Share of the data sets that are true, in part if values are between 0 and 1; unknown below so many."""
        total = int(np.size(values))
        return cls.of(words, share(float(np.sum(values)), total) if total >= least else UNKNOWN, total)

    @classmethod
    def unknown(cls, words: str) -> "Number":
        """A number that the tables do not allow."""
        return cls.of(words, UNKNOWN, 0)

    @property
    def measure(self) -> Measure:
        """The number with its error, without the name."""
        return Measure(self.value, self.error)

    def __str__(self) -> str:
        """The name, the number and its error."""
        if math.isnan(self.error) or self.error <= 1e-9 * abs(self.value):  # none, or rounding
            return f"{self.words}: {self.value:.4g}"
        return f"{self.words}: {self.value:.4g} ± {self.error:.2g}"


def only_known(*numbers: Number) -> list[Number]:
    """The numbers that are not NaN: for those that explain a verdict and do not enter it."""
    return [number for number in numbers if not math.isnan(number.value)]


class Claim:
    """One statement of the paper, its conditions, and when it holds in one.

    The docstring of a subclass is the paper's statement, in our words, and below it the remark: the source of the
    paper's number, the explanation of ours.

    Attributes:
        number: its number for good, by which texts cite it; a new claim takes the next free one.
        name: a word or two for it, in lower case with hyphens.
        section: section of the paper.
        quantity: the quantity that is measured.
        criterion: "share of …", the conditions that count and the tolerance to which the claim holds in one.
        answer: the page's sentence of answer, with a number in each place, "{0:times}" or "{last:share}", formatted as
            a ratio (times), a share or an exponent (power). Only the numbers depend on the tables.
        reads: tables, as "config/table"; "cost" for the cost table, "case-study" for those of recordings.
        figure: name of the figure that shows it, or "".
        heads: for a claim at the top of the page, its finding in a few words: if it is reproduced, partly, and not.
            "{otherwise}" stands for how it fares under other readings of the paper.
        story: the numbers behind that finding, formatted as those of ``answer``.
    """

    number: int
    name: str
    section: str
    quantity: str
    criterion: str
    answer: str
    reads: tuple[str, ...]
    figure: str = ""
    heads: tuple[str, ...] = ()
    story: str = ""

    def __init_subclass__(cls) -> None:
        """Join the lines of sentences that are given in several."""
        for name in ("quantity", "criterion", "answer", "story"):
            setattr(cls, name, one_line(getattr(cls, name, "")))

    def measure(self, evidence: Evidence) -> list[Number]:
        """Turn the tables into numbers; the first is the share of conditions that the criterion states."""
        raise NotImplementedError

    def other_cause(self, numbers: list[Number]) -> bool:
        """True if by these numbers the effect has another cause than the paper gives; by default it has not."""
        return False

    @property
    def statement(self) -> str:
        """The paper's statement, in our words."""
        return paragraphs(self)[0]

    @property
    def remark(self) -> str:
        """Background for a reader."""
        return " ".join(paragraphs(self)[1:])

    def head(self, verdict: str) -> str:
        """The finding at the top of the page; "" if the claim has none for this verdict."""
        if not self.heads or verdict == Verdict.NOT_EVALUATED:
            return ""
        place = {Verdict.REPRODUCED: 0, Verdict.NOT_REPRODUCED: 2}.get(Verdict(verdict), 1)
        return self.heads[1 if verdict == Verdict.REPRODUCED + OTHER_CAUSE else place]


class Finding(NamedTuple):
    """A claim's verdict and the numbers behind it, or the reason why it could not be evaluated."""

    claim: Claim
    verdict: Verdict
    numbers: list[Number]
    reason: str = ""
    other_cause: bool = False


_SHARE = "share of its conditions in which it holds"


def evaluate(claims: Iterable[Claim], evidence: Evidence) -> list[Finding]:
    """Judge claims by the tables at hand.

    Returns:
        A finding per claim. A claim is not evaluated if a table is missing, or holds too few trials or conditions for
        one of the claim's numbers; the finding gives the reason.
    """
    return [_judged(claim, evidence) for claim in claims]


def _judged(claim: Claim, evidence: Evidence) -> Finding:
    try:
        numbers = claim.measure(evidence)
    except TableMissing as missing:
        return Finding(claim, Verdict.NOT_EVALUATED, [], str(missing))
    if unknown := [number.words for number in numbers if math.isnan(number.value)]:
        reason = f"too few trials or conditions in the tables for: {'; '.join(unknown)}"
        return Finding(claim, Verdict.NOT_EVALUATED, numbers, reason)
    verdict, other_cause = Verdict.by(numbers[0].value), claim.other_cause(numbers)
    numbers[0] = numbers[0]._replace(words=_SHARE)  # the criterion says of what
    return Finding(claim, verdict, numbers, other_cause=other_cause)


def frame(findings: Iterable[Finding], evidence: Evidence) -> pd.DataFrame:
    """The claims table: a row per claim; columns as `study.simulation.runs.schemas.CLAIMS` declares them."""
    rows = []
    for claim, verdict, numbers, reason, other_cause in findings:
        head = numbers[0] if numbers else Number.unknown("")
        used = {config for config, _, table in (read.partition("/") for read in claim.reads) if table}
        rows.append(
            {
                "number": claim.number,
                "name": claim.name,
                "section": claim.section,
                "statement": claim.statement,
                "quantity": claim.quantity,
                "value": head.value,
                "error": head.error,
                "trials": min((n.trials for n in numbers[1:] if n.trials), default=head.trials),
                "verdict": f"{verdict}{OTHER_CAUSE * other_cause}",
                "finding": reason or "\n".join(map(str, numbers)),
                "criterion": claim.criterion,
                "remark": claim.remark,
                "reads": ", ".join(claim.reads),
                "runs": ", ".join(evidence.runs[name].study.run_name() for name in sorted(used & set(evidence.runs))),
                "figure": claim.figure,
            }
        )
    return pd.DataFrame(rows, columns=[column.name for column in schemas.CLAIMS])


# measures and rules that several claims share -------------------------------------------------------------------------


def within(number: Number, target: float, distance: float) -> bool:
    """True if a number and two standard errors on either side lie within a distance of a target.

    A number without an error, such as a time, is taken as exact.
    """
    error = 0.0 if math.isnan(number.error) else number.error
    return abs(number.value - target) + 2.0 * error <= distance


def holding(words: str, excesses: Iterable[Measure]) -> Number:
    """Share of conditions in which a claim holds.

    Each excess is how far a measure of one condition is beyond the tolerance: the claim holds if it is at most 0. The
    error is that of the count: each condition would be on its other side with the probability of a normal deviate, as
    if conditions did not share their draws.

    Args:
        words: the criterion.
        excesses: of all conditions, with their Monte-Carlo errors; those that are not numbers are left out.
    """
    known = [excess for excess in excesses if not math.isnan(excess.value)]
    if not known:
        return Number.unknown(words)
    values, errors = np.array(known, dtype=float).T
    pulls = np.abs(
        np.divide(values, errors, out=np.full(len(known), math.inf), where=np.isfinite(values) & (errors > 0))
    )
    turned = scipy.special.ndtr(-pulls)
    error = math.sqrt(float(np.sum(turned * (1.0 - turned)))) / len(known)
    return Number(words, float(np.mean(values <= 0.0)), error, len(known))


def above(measure: Measure, limit: float) -> Measure:
    """Excess of a measure over the greatest value to which a claim holds."""
    return Measure(measure.value - limit, measure.error)


def apart(measure: Measure, target: float, distance: float) -> Measure:
    """Excess of a measure over a distance from its target, on either side."""
    return Measure(abs(measure.value - target) - distance, measure.error)


def of_order(measure: Measure, unit: Measure) -> Measure:
    """Excess of a positive measure over a factor of two from a unit, on either side, in natural logarithms."""
    quotient = ratio(measure, unit)
    if not 0.0 < quotient.value < math.inf:
        return Measure(math.nan if math.isnan(quotient.value) else math.inf, math.nan)
    return apart(Measure(math.log(quotient.value), quotient.error / quotient.value), 0.0, math.log(2.0))


def rows_of(errors: pd.DataFrame, estimator: str) -> pd.DataFrame:
    """The rows of one estimator.

    Raises:
        LookupError: if the estimator is not in `NAMED`, so that its rows were not read.
    """
    if estimator not in NAMED:
        words = f"its rows are not read; a claim on it adds it to NAMED in {Path(__file__).name}"
        raise LookupError(f"{estimator}: {words}")
    return _together(errors, np.flatnonzero(errors["estimator"] == estimator))


def _together(table: pd.DataFrame, places: Ints) -> pd.DataFrame:
    """Rows at ascending places: without a copy if they are one after the other, as those of `Evidence.errors` are."""
    if len(places) and places[-1] - places[0] + 1 == len(places):
        return table.iloc[places[0] : places[-1] + 1]
    return table.iloc[places]


def has_estimators(errors: pd.DataFrame, *estimators: str) -> bool:
    """True if the table has rows of each of these estimators."""
    return all(len(rows_of(errors, name)) for name in estimators)


def cells(errors: pd.DataFrame, estimator: str) -> Iterator[tuple[float, float, pd.DataFrame]]:
    """Angle, σ/r and rows of an estimator in each condition of a grid, in the order of angle and σ/r."""
    rows = rows_of(errors, estimator)
    groups: Any = pd.Series(0, rows.index).groupby([rows["angle"], relative_noise(rows)]).indices
    for (angle, noise), places in sorted(groups.items()):
        yield float(angle), float(noise), _together(rows, places)


def relative_noise(errors: pd.DataFrame) -> Floats:
    """Relative noise σ/r of each row."""
    return np.asarray(errors["noise"] / errors["radius"], dtype=float)


def error_over(errors: pd.DataFrame, unit: str) -> Floats:
    """Error of each row over a column, ``radius`` or ``bound``; infinite if there is no number, or no finite bound."""
    over = errors[unit].to_numpy(dtype=float)
    with np.errstate(all="ignore"):
        ratio = errors["error"].to_numpy(dtype=float) / over
    return np.where(np.isfinite(over) & ~np.isnan(ratio), ratio, math.inf)


def by_estimator(errors: pd.DataFrame, values: "Floats | pd.Series[float]") -> pd.DataFrame:
    """Values as a table: a row per data set, in the order of the errors, and a column per estimator."""
    table = errors.assign(value=values).pivot(index=["cell", "trial"], columns="estimator", values="value")
    table.columns = [str(name) for name in table.columns]
    return table.sort_index(level="trial")


def in_large_groups(labels: Floats, least: int = LEAST) -> Bools:
    """True for each value whose group, named by its label, has at least this many values."""
    _, place, count = np.unique(labels, return_inverse=True, return_counts=True)
    return np.asarray(count[place] >= least)


def center_errors(rows: pd.DataFrame) -> Floats:
    """Error vectors of the centre (trials, d); rows with NaN are left out."""
    return rows[[name for name in rows.columns if name.startswith("error_")]].dropna().to_numpy()


def median(values: "Floats | pd.Series[float]", least: int = LEAST) -> Measure:
    """Median with its Monte-Carlo error; unknown below the least number of values."""
    return quantile(np.asarray(values, dtype=float), 0.5) if len(values) >= least else UNKNOWN


def exponent(words: str, x: Floats, values: Floats, groups: Floats, average: Average | None = None) -> Number:
    """Exponent of x in the power law of the groups' medians, or other averages.

    It is NaN with fewer than three groups, and infinite if an average is infinite.

    Args:
        words: name of the exponent.
        x: condition of each value.
        values: the values; some may be infinite.
        groups: group of each value; a group's x is its median.
        average: of a group's values; their median, if None.
    """
    labels = np.unique(groups)
    averages = [(average or median)(values[groups == label], 1) for label in labels]
    at = np.array([np.median(x[groups == label]) for label in labels])
    trials = min((int(np.sum(groups == label)) for label in labels), default=0)
    if any(m.value == math.inf for m in averages):
        return Number(words, math.inf, math.nan, trials)
    law = power_law(at, np.array([m.value for m in averages]), np.array([m.error for m in averages]))
    return Number.of(words, law[0], trials)


def ratio(above: Measure, below: Measure) -> Measure:
    """Quotient of two measures; its error is that of independent ones, too large if both are of the same data.

    An infinite measure over a finite one is infinite. The quotient is unknown if the lower measure is not finite and
    positive.
    """
    if not (math.isfinite(below.value) and below.value > 0.0) or math.isnan(above.value):
        return UNKNOWN
    value = above.value / below.value
    if value == math.inf:
        return Measure(value, math.nan)
    return Measure(value, math.hypot(above.error, value * below.error) / below.value)


def paired_ratio(one: Floats, other: Floats) -> Measure:
    """Quotient of two medians of the same trials.

    Medians of the same draws err alike: the share p of trials in which both errors are below their medians makes their
    errors correlated by 4p - 1.

    Args:
        one: values of each trial (trials,).
        other: those of the median below, likewise.
    """
    upper, lower = quantile(one, 0.5), quantile(other, 0.5)
    quotient = ratio(upper, lower)
    if not 0.0 < quotient.value < math.inf:
        return quotient
    alike = 4.0 * float(np.mean((one <= upper.value) & (other <= lower.value))) - 1.0
    a, b = upper.error / upper.value, lower.error / lower.value
    return Measure(quotient.value, quotient.value * math.sqrt(max(a * a + b * b - 2.0 * alike * a * b, 0.0)))


class CellMeasure(NamedTuple):
    """A measure in one condition of a grid: half-angle, σ/r, and the number of data sets behind it."""

    measure: Measure
    angle: float
    relative_noise: float
    trials: int

    def __str__(self) -> str:
        """The condition in words."""
        return f"φ = {self.angle:g}°, σ = {self.relative_noise:.2g} r"

    def number(self, words: str) -> Number:
        """The measure with its name."""
        return Number.of(words, self.measure, self.trials)


def in_cells(
    errors: pd.DataFrame, estimator: str, of: Callable[[pd.DataFrame, float, float], Measure]
) -> list[CellMeasure]:
    """A measure of an estimator's rows, angle and σ/r in each condition of a grid in which it is known."""
    conditions = cells(errors, estimator)
    results = [CellMeasure(of(rows, angle, noise), angle, noise, len(rows)) for angle, noise, rows in conditions]
    return [at for at in results if not math.isnan(at.measure.value)]


def greatest(results: Iterable[CellMeasure]) -> CellMeasure:
    """The condition with the greatest measure."""
    return max(results, key=lambda at: at.measure.value)


def furthest_from_one(words: str, results: Iterable[CellMeasure]) -> Number:
    """Of the conditions at the smallest noise, the measure that is furthest from 1."""
    most = min(results, key=lambda at: (at.relative_noise, -abs(at.measure.value - 1.0)))
    return most.number(f"{words}, σ = {most.relative_noise:.2g} r, at the angle where it is furthest from 1")
