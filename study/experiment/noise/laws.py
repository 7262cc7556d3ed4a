"""The laws of noise that a config may name, and the steps from normal noise to that of a cell."""

import math
import re
from collections.abc import Mapping
from typing import Any

from study.experiment.noise.departure import Departure
from study.experiment.noise.laplace import LaplaceNoise
from study.experiment.noise.outliers import Outliers
from study.experiment.noise.student import StudentNoise
from study.experiment.noise.uniform import UniformNoise

NORMAL = "normal"
LAWS: dict[str, Departure] = {"laplace": LaplaceNoise(), "uniform": UniformNoise()}
"""The laws without parameters, besides the normal one. All have the covariance σ² I."""

RULE = f"{NORMAL}, {', '.join(LAWS)} or student(ν) with ν above 2, such as student(5)"
SIZE = 10.0
"""Length of an outlier's displacement in units of σ, where a config gives none."""


def freedom(word: str) -> float | None:
    """The degrees of freedom ν of ``student(ν)``; None for another word, or if ν is not above 2.

    A number has one way of writing, so that a law has one name: ``student(5)``, not ``student(5.0)``.
    """
    number = re.fullmatch(r"student\(([0-9.e+]+)\)", word)
    try:
        value = float(number[1]) if number else math.nan
    except ValueError:
        return None
    return value if 2.0 < value < math.inf and number and f"{value:g}" == number[1] else None


def is_law(word: str) -> bool:
    """True if a word names a law."""
    return word == NORMAL or word in LAWS or freedom(word) is not None


def departures(conditions: Mapping[str, Any]) -> list[Departure]:
    """The steps that lead from normal noise to that of a cell: another law, then outliers; none for normal noise.

    Args:
        conditions: values of the conditions ``law``, ``outlier_share`` and ``outlier_size``, as far as they are not at
            their defaults; others do not matter.
    """
    law, share = conditions.get("law", NORMAL), conditions.get("outlier_share", 0.0)
    steps: list[Departure] = []
    if law != NORMAL:
        nu = freedom(law)
        steps.append(LAWS[law] if nu is None else StudentNoise(nu))
    if share > 0.0:
        steps.append(Outliers(share, conditions.get("outlier_size", SIZE)))
    return steps
