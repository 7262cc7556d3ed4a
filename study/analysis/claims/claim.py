"""A claim of the paper, the numbers behind it, and its verdict.

A `Claim` names the tables that it reads. Its ``measure`` turns them into numbers, each with its Monte-Carlo error, and
its ``judge`` turns the numbers into a verdict by the rule that ``criterion`` states. No verdict is written down
anywhere: it changes with the tables, and without them there is none.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

from study.analysis.claims.evidence import Evidence
from study.statistics.measures import UNKNOWN, Measure


class Verdict(StrEnum):
    """The outcome of a claim."""

    REPRODUCED = "reproduced"
    PARTLY = "partly"
    NOT_REPRODUCED = "not reproduced"
    NOT_EVALUATED = "not evaluated"


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
    def unknown(cls, words: str) -> "Number":
        """A number that the tables do not allow."""
        return cls.of(words, UNKNOWN, 0)

    def __str__(self) -> str:
        """The name, the number and its error."""
        if math.isnan(self.error) or self.error <= 1e-9 * abs(self.value):  # none, or rounding
            return f"{self.words}: {self.value:.4g}"
        return f"{self.words}: {self.value:.4g} ± {self.error:.2g}"


def only_known(numbers: Iterable[Number]) -> list[Number]:
    """The numbers that are not NaN: for those that explain a verdict and do not enter it."""
    return [number for number in numbers if not math.isnan(number.value)]


@dataclass(frozen=True)
class Claim:
    """One statement of the paper and the rule by which it is judged.

    Attributes:
        name: a word or two for it, in lower case with hyphens.
        section: section of the paper.
        statement: the paper's statement, in our words.
        quantity: the quantity that is measured.
        criterion: the rule from the numbers to the verdict, in words; it says what ``judge`` does.
        reads: tables, as "config/table"; "cost" for the cost table, "case-study" for those of recordings.
        measure: function from the tables to numbers, the headline first.
        judge: function from these numbers, in that order, to a verdict. It sees nothing else.
        figure: name of the figure that shows it, or "".
        remark: background for a reader: the source of the paper's number, the explanation of ours.
    """

    name: str
    section: str
    statement: str
    quantity: str
    criterion: str
    reads: tuple[str, ...]
    measure: Callable[[Evidence], list[Number]]
    judge: Callable[[list[Number]], Verdict]
    figure: str = ""
    remark: str = ""
