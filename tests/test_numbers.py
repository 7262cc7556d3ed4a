"""Numbers of the documents: each is the one of its table, and a table that changes is noticed where it is quoted."""

import copy
import re
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from study.simulation.runs.run_folder import Run

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tools"))
import bound_numbers  # noqa: E402
import number_tables  # noqa: E402

sys.path.remove(str(ROOT / "tools"))

CHANGED = "verdict != used and verdict != 'not evaluated' and used != 'not evaluated'"
QUOTED = {
    "claim_studies": ("verdicts", "value > 0", ["value"]),
    "readings_changed": ("readings", CHANGED, []),
    "coverage_summary": ("coverage", "method == 'als' and sigma < .2", ["radius", "radius_ok"]),
    "benchmark": ("benchmark", "run == 'all, circles' and given == 'points'", ["median", "rms"]),
    "benchmark_spheres": ("benchmark", "run == 'all, spheres' and given == 'points'", ["median", "rms"]),
    "benchmark_published": ("benchmark_published", "", ["deviation"]),
    "speed": ("bench", "what.str.contains('in a loop')", ["ratio"]),
}
"""Tables of documents that functions make: the stored table, rows and columns that are quoted."""
PAGES = {name: path for path in ROOT.glob("**/*.md") for name in re.findall(r"<!-- table: (\w+)", path.read_text())}


@pytest.fixture(scope="module")
def bound():
    return bound_numbers.Bound()


def faults(bound, path):
    return bound.faults(path, (ROOT / path).read_text(encoding="utf-8"))[0]


def changed(bound, table, rows, column):
    """The same numbers over a table in which these rows have another value in a column; or the first is left out."""
    mutant, frame = copy.copy(bound), bound.table(table).copy()
    index = (frame.query(rows, engine="python") if rows else frame).index
    if column:
        frame[column] = frame[column].astype(float)
        frame.loc[index, column] = 1.37 * frame.loc[index, column] + 0.37
    else:
        frame = frame.drop(index[:1])
    mutant.table = lambda name: frame if name == table else bound.table(name)
    return mutant


def test_the_reference_run_is_whole():
    """Its manifest and its tables have the digests that were stored with them: `make paper` compares with it."""
    run = Run.open(ROOT / "results" / "paper")
    assert run.manifest()["run"] == "paper-8689e37964"
    assert len(run.table("summary")) > 100
    assert len(run.table("claims")) == 27


def test_every_number_is_that_of_its_table(bound):
    """No text and table differ; nothing that looks measured is bound to no table; no description is left over."""
    assert [fault for path in bound.texts() for fault in faults(bound, path)] == []
    assert set(bound.numbers) == bound.used
    assert set(PAGES) == set(QUOTED) | set(bound.made)


def places():
    """Each number in a phrase: the text, its name."""
    for path, phrases in bound_numbers.Bound().phrases.items():
        for phrase in phrases:
            for name, _ in number_tables.PLACE.findall(phrase):
                yield path, name


@pytest.mark.parametrize(("path", "name"), list(places()))
def test_a_changed_value_is_noticed_where_a_phrase_has_it(bound, path, name):
    """The fault names the text, the line and the number."""
    table, rows, expression = bound.numbers[name]
    columns = [word for word in re.findall(r"\w+", expression) if word in bound.table(table)]
    mutant, text = changed(bound, table, rows, (columns or [""])[0]), (ROOT / path).read_text(encoding="utf-8")
    mutant.phrases = {path: [phrase for phrase in bound.phrases[path] if f"{{{name}:" in phrase]}
    named, _ = mutant.faults(path, text.replace("<!-- end", "<!-- last"))  # tables have mutants of their own
    mine = [fault for fault in named if f" ({name}, " in fault]
    _, line, words = mine[0].split(":", 2)
    assert words.split()[0] in text.splitlines()[int(line) - 1]


@pytest.mark.parametrize("name", PAGES)
def test_a_changed_value_is_noticed_in_a_table(bound, name):
    """Of a table that is described, every column of numbers that it quotes is changed."""
    table, rows, columns = QUOTED.get(name, ("", "", []))
    if name not in QUOTED:
        table, rows = bound.made[name]["table"], bound.made[name].get("rows", "")
        cells = str(number_tables.PLACE.findall(str(bound.made[name]["cells"])))
        columns = [word for word in bound.table(table).select_dtypes("number") if re.search(rf"\b{word}\b", cells)]
    text = re.search(rf"<!-- table: {name} -->.*?<!-- end -->", PAGES[name].read_text(encoding="utf-8"), re.DOTALL)[0]
    assert bound.faults("", text)[0] == []
    for column in columns or [""]:
        named, _ = changed(bound, table, rows, column).faults("", text)
        assert [fault for fault in named if fault.endswith(f"(table {name})")], column


def test_a_described_table():
    """Rows that are alike in the fixed cells are one, a title with a place is a column for each of its values."""
    frame = pd.DataFrame({"law": ["a", "a", "b"], "n": [10, 20, 10], "p": [0, 1, 2]})
    frame["x"], frame["e"] = [0.512, np.nan, 2.5], [0.013, 1.0, 0.4]
    form = {"table": "t", "sort": ["n"], "words": {"a": "law of {n:d}"}, "more": [["-", "c", "", ""]]}
    form["cells"] = {"": "{law:word}", "law": "`{law}`", "N = {n:d}": "{x:.2f}, {x ± e}{p:(.1f %)}"}
    assert list(number_tables.described(form, lambda name: frame)) == [
        ["", "law", "N = 10", "N = 20"],
        ["law of 10", "`a`", "0.51, 0.512 ± 0.013", "-"],
        ["-", "`b`", "2.50, 2.5 ± 0.4 (2.0 %)", "-"],
        ["law of 20", "`a`", "-", "-, - (1.0 %)"],
        ["-", "c", "", ""],
    ]


@pytest.mark.parametrize(
    ("value", "spec", "text"),
    [
        (0.9304, ".3f", "0.930"),
        (-0.502, ".3f", "-0.502"),
        (1.0458, ".3f", "1.046"),
        (0.057, ".0%", "6 %"),
        (0.9304, ".0p", "93"),
        (10.33, "w", "ten"),
        (26, "d", "26"),
        (244000.0, ",d", "244,000"),
        (0.0, "(.0f %)", ""),
    ],
)
def test_formats(value, spec, text):
    """Numbers are written as the documents write them."""
    assert number_tables.formatted(value, spec) == text


@pytest.mark.parametrize(
    ("number", "words"),
    [
        (["bench", "what == 'd = 4'", "speed"], "name 'speed' is not defined"),
        (["bench", "ratio > ", "ratio"], "invalid syntax"),
        (["bench", "group == 'none'", "ratio"], "no such rows in docs/assets/tables/bench.csv: group == 'none'"),
        (
            ["bench", "group == 'short commands'", "ratio"],
            "4 such rows in docs/assets/tables/bench.csv: group == 'short commands'",
        ),
        (["bench", "what == 'd = 4'", "ratio / 0"], "inf in docs/assets/tables/bench.csv"),
        (["banch", "", "ratio"], "there is no table 'banch' in [tables]"),
        (None, "there is no such number in [numbers]"),
    ],
)
def test_a_wrong_description_is_a_fault_at_its_place(number, words):
    """The message says which number, and what is wrong with it; other numbers are compared all the same."""
    bound = bound_numbers.Bound()
    bound.phrases = {"a.txt": ["is {x:.2f} long", "no {x:d} here"]}
    bound.numbers = {"x": number} if number else {}
    first, second = bound.faults("a.txt", "\nIt is\n3.00 long.")[0]
    assert first.startswith("a.txt:3: tools/numbers.toml: x")
    assert first.endswith(words)
    assert second == "a.txt:1: no such phrase (tools/numbers.toml): “no {x:d} here”"


def test_the_numbers_of_findings():
    """Findings of claims are split into quantity, value and error; lines without a number are left out."""
    finding = "share, φ = 20°: 0.5 ± 0.01\nneeds: more\nat 3: -2e-06"
    table = number_tables.findings(pd.DataFrame({"name": ["a"], "verdict": ["in part"], "finding": [finding]}))
    assert list(table["quantity"]) == ["share, φ = 20°", "at 3"]
    np.testing.assert_array_equal(table[["value", "error"]], [[0.5, 0.01], [-2e-06, np.nan]])


def test_what_looks_measured_must_be_bound(bound):
    """A number with an error, a percentage or a factor is found in prose; in blocks and commands it is not."""
    text = "It takes 12 % more, `13 %`.\n\n    14 %\n\n```text\n15 %\n```\n\nor 3.5 ± 0.2, 7 times.\n"
    known = [re.search(r": (.*) looks", fault)[1] for fault in bound.faults("docs/new.md", text)[0]]
    assert known == ["12 %", "3.5 ± 0.2", "7 times"]
