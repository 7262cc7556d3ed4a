"""No comparison of estimators is of different trials, tried on runs in which a status selects the easy ones.

The runs are computed, and then the status of some estimators is changed: it is not ok exactly where their error is
above its median. The errors stay. So a median of an estimator's own ok fits falls by a quarter, as if the estimator
were better, and whatever compares it with another one must give the numbers that it gave before.
"""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from study.fits import Status
from study.simulation.analysis.error_table import decade
from study.simulation.analysis.summary import as_data, chosen_rows, printed, summarise
from study.simulation.claims import CLAIMS
from study.simulation.claims.claim import Evidence, evaluate
from study.simulation.figures import FIGURES, Tables
from study.simulation.report.page import packed
from study.simulation.report.runs import efficiency
from study.simulation.runs import schemas
from study.simulation.runs.run_folder import Run
from tests.configs import config

CONFIGS = Path(__file__).parents[1] / "configs"
SELECTIVE = ("mle", "ugdk", "ugdk_cov", "als", "corrected")
"""Estimators whose status is changed; GDKE and LLS stay ok."""
TOP, AXES = {"estimators": ["mle", "gdke", "ugdk", "als", "corrected"]}, {"trials": 40}
GRID = config(TOP, **AXES, samples=[20, 40, 80, 160], noise_over_radius=[0.01, 0.05, 0.1, 0.2], angle=[45, 90])
LAWS = {"law": ["normal", "laplace", "uniform"], "outlier_share": [0.0, 0.1, 0.3]}
DEPARTURES = config(TOP, **AXES, samples=50, noise_over_radius=0.05, angle=[60, 180], **LAWS)
OF_ALL_TRIALS = [f"{error}_{measure}" for error in ("relative", "ratio") for measure in ("median", "q05", "q95")]
OF_ALL_TRIALS += ["far", "axis_median"]
"""Measures of all trials that are also given of an estimator's own ok fits."""
SMALL = {"paper": 400, "ellipse": 200, "power-law": 40, "efficiency": 40, "starts": 400, "bias": 400, "anisotropic": 40}
"""Trials of the configs that claims compare estimators in."""


def changed(run, folder, lost=False):
    """A run with the same errors, in which a status is not ok where the error is above its median.

    Args:
        run: the run.
        folder: where the other one goes.
        lost: such fits have no number, either.
    """
    other = Run.open(folder)
    table = other.arrow("errors")
    frame = table.select(["cell", "noise", "radius", "estimator", "error", "bound"]).to_pandas()
    group = decade(frame["noise"] / frame["radius"]) if run.study.design.one_trial_a_cell else frame["cell"]
    ratio = frame["error"] / frame["bound"]
    far = ratio > ratio.groupby([group, frame["estimator"]], observed=True).transform("median")
    chosen = (far & frame["estimator"].isin(SELECTIVE)).to_numpy()
    columns = {"status": np.where(chosen, Status.INSIGNIFICANT, table["status"].to_numpy()).astype(np.int8)}
    if lost:
        names = [name for name in table.column_names if name.startswith("error")]
        columns |= {name: np.where(chosen, np.nan, table[name].to_numpy()) for name in names}
    for name, values in columns.items():
        table = table.set_column(table.column_names.index(name), table.schema.field(name), pa.array(values))
    pq.write_table(table, other.path("errors"))
    other.record("errors")
    summarise(other)
    return other


@pytest.fixture(scope="module")
def pair(make_run, tmp_path_factory):
    """Make a run of a text, and the same with changed statuses; each is computed once."""
    known = {}

    def make(text):
        if text not in known:
            folder = tmp_path_factory.mktemp("pairs")
            one = make_run(text, folder / "one" / "run")
            known[text] = one, changed(one, make_run(text, folder / "other" / "run").folder)
        return known[text]

    return make


def shipped(name):
    """A shipped config with few trials."""
    text = (CONFIGS / f"{name}.toml").read_text(encoding="utf-8")
    return re.sub(r"(?m)^trials = [\d_]+", f"trials = {SMALL[name]}", text)


def test_the_trap_bites(pair):
    """The statuses select: medians of own ok fits fall far below those of all trials."""
    one, other = (run.table("summary").set_index(["group", "estimator"]) for run in pair(GRID))
    mle = other.index.get_level_values("estimator") == "mle"
    share = other["ratio_median_ok"][mle] / one["ratio_median"][mle]
    assert share.max() < 0.95
    assert share.median() < 0.75
    assert (other["ok"][mle] < 0.6 * other["planned"][mle]).all()


@pytest.mark.parametrize("text", [GRID, DEPARTURES, shipped("paper")])
def test_summaries_are_of_all_trials(pair, text):
    """Headline columns, and what is printed besides the shares that are not ok, do not depend on the status."""
    one, other = pair(text)
    names = [f"{name}{end}" for name in OF_ALL_TRIALS for end in ("", "_error")]
    pd.testing.assert_frame_equal(one.table("summary")[names], other.table("summary")[names])
    plain, bracketed = (list(printed(run, chosen_rows(run), every=True)) for run in (one, other))
    assert "(" in bracketed[-1]
    words = lambda line: re.sub(r" \([\d.]+%\)", "", line).split()  # noqa: E731
    assert [words(line) for line in plain] == [words(line) for line in bracketed]
    rows = [as_data(run, chosen_rows(run))["rows"] for run in (one, other)]
    assert [row["ratio_median"] for row in rows[0]] == [row["ratio_median"] for row in rows[1]]


def test_a_fit_without_a_number_is_infinitely_far(pair, make_run, tmp_path):
    """Where more than half of the fits have none, the median is printed as inf, beside the share that is not ok."""
    one, _ = pair(GRID)
    other = changed(one, make_run(GRID, tmp_path / "run").folder, lost=True)
    found = other.table("summary").astype({"estimator": str}).set_index(["group", "estimator"])
    mine = found.xs("mle", level="estimator")
    assert np.isinf(mine["ratio_q95"]).all()
    before = one.table("summary").astype({"estimator": str}).set_index(["group", "estimator"])["ratio_q05"]
    np.testing.assert_array_equal(found["ratio_q05"], before)
    table = other.arrow("errors")
    place = table.column_names.index("error")
    table = table.set_column(place, "error", pa.array(np.full(table.num_rows, np.nan)))
    pq.write_table(table, other.path("errors"))
    other.record("errors")
    summarise(other)
    lines = list(printed(other, chosen_rows(other), every=True))
    assert all(len(re.findall(r"\binf\b", line)) == 5 for line in lines[-32:])


@pytest.mark.parametrize(
    ("name", "text", "frames"),
    [
        ("fig2_error", shipped("paper"), ["panels", "medians", "bound"]),
        ("fig7_power_law", GRID, ["curves", "laws"]),
        ("fig_efficiency", GRID, ["curves"]),
        ("fig_map", GRID, ["ratios"]),
        ("fig_regret", GRID, ["cells", "means"]),
        ("fig_robustness", DEPARTURES, ["shares", "tails"]),
    ],
)
def test_figures_are_of_all_trials(pair, name, text, frames):
    """Curves, slopes and maps do not depend on the status; only counts of statuses do."""
    one, other = (FIGURES[name].prepare(Tables(run)) for run in pair(text))
    for frame in frames:
        tables = [getattr(data, frame).drop(columns="not_ok", errors="ignore") for data in (one, other)]
        pd.testing.assert_frame_equal(*tables)


def test_spreads_of_figures_3_and_4_are_of_all_trials(pair):
    """Ellipses of both estimators are of the same trials."""
    one, other = (FIGURES["fig4_ugdk_ellipse"].prepare(Tables(run)).data.spreads for run in pair(shipped("ellipse")))
    assert one == other


def test_claims_compare_the_same_trials(pair):
    """No number behind a verdict depends on a status, but those that count it, and UGDK's mean, which is paired.

    The share of the conditions in which UGDK's bias holds is of such means.
    """
    pairs = [pair(shipped(name)) for name in SMALL]
    one, other = (evaluate(CLAIMS, Evidence(runs)) for runs in zip(*pairs, strict=True))
    judged = [finding.claim.name for finding in one if finding.numbers]
    assert len(judged) >= 10
    for before, after in zip(one, other, strict=True):
        assert before.reason == after.reason
        for number, changed_to in zip(before.numbers, after.numbers, strict=True):
            if " ok" not in number.words and not (
                before.claim.name == "ugdk-bias" and number.words.startswith("share")
            ):
                assert number[1:] == pytest.approx(changed_to[1:], nan_ok=True), (before.claim.name, number.words)


def test_means_of_biases_are_paired(pair):
    """UGDK's bias has no mean over all trials: GDKE's, beside it, is of the trials in which UGDK is ok as well."""
    _, other = pair(shipped("bias"))
    (finding,) = evaluate([claim for claim in CLAIMS if claim.name == "ugdk-bias"], Evidence([other]))
    wide = other.table("errors").astype({"estimator": str, "cell": str})
    wide = wide.pivot(index=["samples", "trial"], columns="estimator", values=["error_1", "status"])
    both = wide[(wide["status"] == Status.OK).all(axis=1)]
    means = both["error_1"]["gdke"].groupby("samples").mean()
    assert len(both) < 0.6 * len(wide)
    slope = np.polyfit(np.log(means.index), np.log(means), 1)[0]
    assert finding.numbers[1].value == pytest.approx(slope, abs=3 * finding.numbers[1].error)
    paired = [number for number in finding.numbers if "UGDK and GDKE are ok" in number.words]
    assert paired
    assert {number.trials for number in paired} == {both.groupby("samples").size().min()}


def test_the_report_compares_the_same_trials(pair):
    """Medians in its table, and the first measures of its explorer, do not depend on the status."""
    medians, first = [], []
    for run in pair(GRID):
        record = Tables(run)
        (table,) = (part for part in efficiency(record) if "<table" in part)
        medians.append(re.sub(r'<span class="note">.*?</span>|<table class="\w+">', "", table.partition("<tbody>")[2]))
        first.append(unpacked(packed(record)))
    assert medians[0] == medians[1]
    assert first[0] == first[1]
    state = (Path(schemas.__file__).parents[1] / "report/assets/state.js").read_text(encoding="utf-8")
    assert 'const y = ["ratio_median", ' in state


def unpacked(text):
    """Values of the explorer's measures of all trials, by name."""
    import base64
    import gzip
    import json

    measures = json.loads(gzip.decompress(base64.b64decode(text)))["measures"]
    assert measures[0]["title"] == "Median of error over √tr CRLB"
    return {entry["name"]: entry["values"] for entry in measures if entry["name"] in OF_ALL_TRIALS}
