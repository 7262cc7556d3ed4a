"""The cost of a fit as a table: operations counted and seconds measured, beside the paper's figures."""

import math
from collections.abc import Iterator

import pandas as pd

from study.analysis.cost import counted, timed, timed_scalar
from study.analysis.paper_cost import PAPER
from study.text.columns import columns

_COSTS = ("paper_flops", "flops_per_sample", "vector_seconds", "scalar_seconds")


def cost_table(dimension: int = 3, samples: int = 1000) -> pd.DataFrame:
    """The paper's costs beside what is counted and measured here.

    Returns:
        A row per estimator: FLOPs of a fit by the paper, FLOPs per sample here, seconds of a fit in vector and in
        scalar code, and each of them over GDKE's (``…_over_gdke``).
    """
    operations, vector, scalar = counted(dimension), timed(dimension, samples), timed_scalar(dimension, samples)
    rows = []
    for name, paper in PAPER.items():
        kernel = {"mle": "mle", "lls": "lls", "igdk": "igdk"}.get(name, "moments")
        rows.append(
            {
                "estimator": name,
                "samples": samples,
                "paper_flops": paper(samples, dimension),
                "flops_per_sample": operations[kernel],
                "flops_of": "a pass" if name == "mle" else "a fit",
                "vector_seconds": vector[name],
                "scalar_seconds": scalar[name],
            }
        )
    frame = pd.DataFrame(rows)
    base = frame[frame["estimator"] == "gdke"].iloc[0]
    for column in _COSTS:
        frame[f"{column}_over_gdke"] = frame[column] / base[column]
    return frame


def printed(frame: pd.DataFrame) -> Iterator[str]:
    """The cost table for a terminal."""
    yield f"cost of a fit of {frame['samples'].iloc[0]} samples in 3-D; × stands for times gdke's"
    rows = []
    for row in frame.to_dict("records"):
        rows.append([row["estimator"]])
        values = [
            f"{row['paper_flops']:,.0f}",
            f"{row['flops_per_sample']:g} {row['flops_of']}",
            *(f"{1e6 * row[name]:.2f} µs" for name in ("vector_seconds", "scalar_seconds")),
        ]
        for name, value in zip(_COSTS, values, strict=True):
            known = not math.isnan(row[name])
            rows[-1] += [value, f"{row[f'{name}_over_gdke']:.2f}×"] if known else ["-", ""]
    titles = ["", "paper FLOPs", "", "FLOPs per sample", "", "vector code", "", "scalar code", ""]
    yield from columns(rows, titles, "<>")
