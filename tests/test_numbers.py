"""Numbers of the documents: each is the one of its table, and a table that changes is noticed where it is quoted."""

import importlib.util
import re
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from study.simulation.runs.run_folder import Run

ROOT = Path(__file__).parents[1]
spec = importlib.util.spec_from_file_location("bound_numbers", ROOT / "docs" / "bound_numbers.py")
bound_numbers = importlib.util.module_from_spec(spec)
sys.modules["bound_numbers"] = bound_numbers
spec.loader.exec_module(bound_numbers)

CHANGED = "verdict != used and verdict != 'not evaluated' and used != 'not evaluated'"
SKIN = ["covered", "covered_hinges", "undoubted", "undoubted_far", "without_estimate", "median_off_mm"]
QUOTED = {
    "claim_commands": ("verdicts", "value > 0", ["value"], True),
    "criteria": ("verdicts", "", ["number"], True),
    "published": ("published", "published > 0", ["mse", "mse_error", "bias", "published"], True),
    "choices": ("readings", CHANGED, [], True),
    "readings": ("readings", "", [], True),
    "readings_changed": ("readings", CHANGED, [], True),
    "certify": ("certify", "", ["center"], False),
    "cluster": ("cluster", "", ["parent_mib", "finish_mib"], True),
    "cluster_study": ("cluster_study", "", ["seconds"], True),
    "skin": ("skin", "", SKIN, False),
    "coverage_short": ("coverage", "method == 'mle' and ok >= .2 and sigma < .35", ["radius_ok"], False),
    "coverage_summary": ("coverage", "method == 'als' and sigma < .2", ["radius", "radius_ok"], False),
    "coverage_cells": ("coverage", "method != 'corrected'", ["radius"], True),
    "coverage_few": ("coverage_limits", "kind == 'few'", ["ok", "radius", "radius_ok"], True),
    "coverage_belts": ("coverage_limits", "kind == 'belt'", ["across"], True),
    "decades": ("paper", "decade in [-13, -9, -5, -3, -2, -1] ", ["ratio_median"], True),
    "em_vmf": ("em_vmf", "noise_over_radius == .1 and estimator != 'als' and angle < 180", ["ratio_median"], True),
    "outliers": ("robustness", "law == 'normal' and estimator in ['mle', 'als', 'gdke']", ["ratio_median"], True),
    "outliers_robust": ("robust", "law == 'normal' and estimator == 'robust'", ["ratio_median"], True),
    "laws": ("robustness", "outlier_share == 0 and estimator == 'als'", ["ratio_median"], True),
    "false_alarms": ("false_alarms", "dimension == 3 and samples <= 1000", ["share"], True),
    "regret": ("regret", "samples == 0 and estimator in ['als', 'mle', 'gdke']", ["median", "q95", "q95_error"], True),
    "speed": ("bench", "what.str.contains('in a loop')", ["ratio"], True),
    "stopping": ("stopping", "", ["value"], True),
    "forms": (
        "misfit_errors",
        "best_seen == best_seen",
        ["ok", "covers_white", "covers_or_doubted", "best_seen"],
        True,
    ),
}
"""Tables of documents: the stored table, rows and columns that are quoted, and if each row is quoted by itself."""
PAGES = {name: path for path in ROOT.glob("**/*.md") for name in re.findall(r"<!-- table: (\w+)", path.read_text())}


@pytest.fixture(scope="module")
def bound():
    return bound_numbers.Bound()


def faults(bound, path):
    return bound.faults(path, (ROOT / path).read_text(encoding="utf-8"))[0]


def changed(bound, table, rows, columns, one):
    """The same numbers over a table of which one value of these rows, or one column of all of them, is another."""
    copy = bound_numbers.Bound()
    frame = bound.table(table).copy()
    index = (frame.query(rows, engine="python") if rows else frame).index
    index = [np.random.default_rng(len(table) + len(rows)).choice(index)] if one else index
    if not columns:
        frame = frame.drop(index[:1])
    for column in columns[:1]:
        frame[column] = frame[column].astype(float)
        frame.loc[index, column] = 1.37 * frame.loc[index, column] + 0.37
    copy.table = lambda name: frame if name == table else bound.table(name)
    return copy


def test_the_reference_run_is_whole():
    """Its manifest and its tables have the digests that were stored with them: `make paper` compares with it."""
    run = Run.open(ROOT / "results" / "paper")
    assert run.manifest()["run"] == "paper-8689e37964"
    assert len(run.table("summary")) > 100
    assert len(run.table("claims")) == 28


def test_every_number_is_that_of_its_table(bound):
    """No text and table differ; nothing that looks measured is bound to no table."""
    assert [str(fault) for path in bound.texts() for fault in faults(bound, path)] == []
    assert set(bound.numbers) == bound.used


def test_every_table_of_the_pages_is_tried():
    """The mutants below cover each table that the pages have."""
    assert set(PAGES) == set(QUOTED)


def places():
    """Each number in a phrase: the text, its name."""
    bound = bound_numbers.Bound()
    for path, phrases in bound.phrases.items():
        for phrase in phrases:
            for name, _ in bound_numbers.PLACE.findall(phrase):
                yield path, name


@pytest.mark.parametrize(("path", "name"), list(places()))
def test_a_changed_value_is_noticed_where_a_phrase_has_it(bound, path, name):
    """The fault names the text, the line and the number."""
    table, rows, expression = bound.numbers[name]
    columns = [word for word in re.findall(r"\w+", expression) if word in bound.table(table)]
    mutant, text = changed(bound, table, rows, columns, False), (ROOT / path).read_text(encoding="utf-8")
    mutant.phrases = {path: [phrase for phrase in bound.phrases[path] if f"{{{name}:" in phrase]}
    named, _ = mutant.faults(path, text.replace("<!-- end", "<!-- last"))  # tables have mutants of their own
    mine = [fault for fault in named if f"({name})" in fault.words]
    assert mine
    line = text.splitlines()[mine[0].line - 1]
    assert mine[0].words.split(" ")[0] in line


@pytest.mark.parametrize("name", QUOTED)
def test_a_changed_value_is_noticed_in_a_table(bound, name):
    """The fault names the text, the line and the cell."""
    table, rows, columns, one = QUOTED[name]
    path = PAGES[name].relative_to(ROOT).as_posix()
    for column in columns:
        found = faults(changed(bound, table, rows, [column], one), path)
        mine = [fault for fault in found if fault.words.startswith(f"table {name}: ")]
        assert mine, column
        line = (ROOT / path).read_text(encoding="utf-8").splitlines()[mine[0].line - 1]
        assert line.startswith("|")


@pytest.mark.parametrize(
    ("value", "spec", "text"),
    [
        (0.9304, ".3s", ".930"),
        (-0.502, ".3s", "-.502"),
        (1.0458, ".3f", "1.046"),
        (0.057, ".0%", "6 %"),
        (0.9304, ".0p", "93"),
        (10.33, "w", "ten"),
        (26, "d", "26"),
        (244000.0, ",d", "244,000"),
    ],
)
def test_formats(value, spec, text):
    """Numbers are written as the documents write them."""
    assert bound_numbers.formatted(value, spec) == text


def test_the_numbers_of_findings():
    """Findings of claims are split into quantity, value and error; lines without a number are left out."""
    finding = "share, φ = 20°: 0.5 ± 0.01\nneeds: more\nat 3: -2e-06"
    claims = pd.DataFrame({"name": ["a"], "verdict": ["partly"], "finding": [finding]})
    table = bound_numbers.findings(claims)
    assert list(table["quantity"]) == ["share, φ = 20°", "at 3"]
    assert list(table["value"]) == [0.5, -2e-06]
    assert table["error"].iloc[0] == 0.01
    assert np.isnan(table["error"].iloc[1])


def test_what_looks_measured_must_be_bound(bound):
    """A number with an error, a percentage or a factor is found in prose; in blocks and commands it is not."""
    text = "It takes 12 % more, `13 %`.\n\n    14 %\n\n```text\n15 %\n```\n\nor 3.5 ± .2, 7 times.\n"
    found = [fault.words.split(" looks")[0] for fault in bound.faults("docs/new.md", text)[0]]
    assert found == ["12 %", "3.5 ± .2", "7 times"]
