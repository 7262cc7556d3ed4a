"""Results of a run of the benchmarks as one table of ratios: printed, and stored beside the machine's name.

In each group one row is the unit, marked with ``extra_info["unit"]``; a row's ratio is its time per item over the
unit's, both the fastest of many rounds in the same run. ``extra_info["items"]`` says how many items a round has, and
``extra_info["aim"]`` what the ratio should be. No ratio fails a test: machines differ, and this one may be busy.
"""

import platform
from pathlib import Path

from study import instruction_set

# before numba and NumPy are there: what is timed is the code that the command runs, in each of its processes
instruction_set.fix()

import pandas as pd
import pytest

from study.simulation.runs.provenance import machine

STORED = Path(__file__).resolve().parents[1] / "docs" / "assets" / "tables" / "bench.csv"


@pytest.fixture
def timed(benchmark):
    """Time a function: ``timed(group, what, function, items=…, unit=…, aim=…)``; its result comes back."""

    def run(group, what, function, *arguments, items=1, unit=False, aim="", rounds=15, warmup=2, setup=None):
        benchmark.group = group
        benchmark.extra_info.update(what=what, items=items, unit=unit, aim=aim)
        return benchmark.pedantic(function, args=arguments, setup=setup, rounds=rounds, warmup_rounds=warmup)

    return run


def where():
    """What the numbers were measured on."""
    return "{processor}, {cores} cores, Python {python}".format(**machine(), python=platform.python_version())


def rows(benchmarks):
    """A row per benchmark that says what it is, in the order in which they ran."""
    cost = {b.fullname: 1e9 * b.stats.min / b.extra_info["items"] for b in benchmarks}
    unit = {b.group: cost[b.fullname] for b in benchmarks if b.extra_info["unit"]}
    for b in benchmarks:
        own = cost[b.fullname]
        row = {"group": b.group, "what": b.extra_info["what"], "cost": f"{own:.4g}", "measured": "ns"}
        row["ratio"] = f"{own / unit[b.group]:.3g}" if b.group in unit else ""
        yield row | {"aim": b.extra_info["aim"], "machine": where()}


def pytest_terminal_summary(terminalreporter, config):
    """Print the table, and store it if the whole of it was run."""
    session = getattr(config, "_benchmarksession", None)
    timed = [b for b in session.benchmarks if b.stats] if session else []
    if not timed:
        return
    table = pd.DataFrame(rows(timed))
    terminalreporter.section(f"ratios · {where()}")
    for group, part in table.groupby("group", sort=False):
        shown = part[["what", "cost", "measured", "ratio", "aim"]].to_string(index=False, header=False)
        terminalreporter.write_line(f"{group}\n{shown}")
    files = {b.fullname.partition("::")[0] for b in timed}
    if len(files) == len([*Path(__file__).parent.glob("test_*.py")]) and not config.option.keyword:
        STORED.parent.mkdir(exist_ok=True)
        table.to_csv(STORED, index=False, lineterminator="\n")
