"""Content of the page: its figures, its findings and answers, its tables of posteriors, ratios and numbers."""

import base64
import math
import re
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from study.files import RunError
from study.simulation import figures
from study.simulation.claims import CLAIMS, judge_all
from study.simulation.claims.claim import Number, Verdict
from study.simulation.experiment.config import parse
from study.simulation.figures.figure import Frame
from study.simulation.report import material, words
from study.simulation.report.html import coded
from study.simulation.report.material import Material, answer, draw_lead
from study.simulation.report.page import COLUMNS, printed, read_bench, render, speed_section
from study.simulation.report.runs import posterior_section
from study.simulation.statistics import PERFORMANCE
from tests.configs import config, log_uniform, uniform


def test_a_top_that_fails(circles, make_run, claims, monkeypatch, read):
    """The picture at the top costs neither the page nor the whole figure; its place in the code is said."""
    top = {"name": "noises", "estimators": ["mle", "gdke", "als"]}
    design = {"noise_over_radius": [1e-3, 1e-2, 1e-1, 1], "angle": [45, 180]}
    noises = make_run(config(top, trials=30, samples=50, **design))

    def broken(frame):
        raise ZeroDivisionError("no ink")

    monkeypatch.setattr(material, "draw_lead", broken)
    document = read(render(Material([noises], claims)))
    assert "lead: failed: ZeroDivisionError('no ink') at " in document.text
    assert "fig_efficiency" in [tag["id"] for tag in document.of("figure")]
    assert "lead" not in [tag["id"] for tag in document.of("figure")]


def test_the_page_has_the_pictures_that_are_written(random, claims, tmp_path):
    """Each figure is drawn once: the PNGs on the page are the bytes of the files, which `study figures` writes too."""
    gallery = figures.gallery()
    text = render(Material([random], claims, gallery=gallery))
    written = {path.name: path.read_bytes() for path in gallery.save(tmp_path / "page")}
    alone, _ = figures.draw_all([random], tmp_path / "alone")
    assert written == {path.name: path.read_bytes() for path in alone if path.suffix != ".pdf"}  # which a page has not
    shown = re.findall(r'<figure id="(\w+)".*?base64,([^"]*)"', text, re.DOTALL)
    assert {name: base64.b64decode(code) for name, code in shown} == {"fig2_error": written["fig2_error.png"]}


def finding(*values):
    """Lines of a claim's numbers, as the claims table has them."""
    return "\n".join(str(Number(f"a: number {i}", value, 0.1 * i, 7)) for i, value in enumerate(values))


def judged(name, verdict, *values, number=2):
    """A row of the claims table, as far as the findings read it."""
    return {"number": number, "name": name, "verdict": str(verdict), "finding": finding(*values)}


@pytest.fixture(scope="module")
def efficiency():
    """Three estimators on two caps: `als` twice as far as `mle` below the radius, much nearer beyond."""
    rows = [
        {"angle": angle, "estimator": name, "level": level, "ratio": ratio if level < 1 else 1 / ratio, "error": 0.01}
        for angle in (30.0, 60.0)
        for level in (0.1, 0.3, 10.0)
        for name, ratio in (("mle", 1.5), ("als", 3.0), ("ugdk", 6.0))
    ]
    reached = pd.DataFrame([{"angle": a, "level": n, "ratio": 2.0} for a in (30.0, 60.0) for n in (0.1, 0.3, 10.0)])
    marks = pd.DataFrame({"angle": [30.0, 60.0], "gdke": 0.1, "ugdk": 0.1, "fails": 0.1})
    curves = pd.DataFrame(rows).assign(trials=9)
    return Frame(curves=curves, attainable=reached, marks=marks, samples=100, stamp="made up")


@pytest.mark.parametrize("claim", CLAIMS, ids=[claim.name for claim in CLAIMS])
def test_answers_are_sentences(claim):
    """An answer begins with its verdict, has a number in it, and ends; it fits the numbers that the judge reads."""
    text = answer(claim.name, "in part, another cause", finding(0.25, 0.5, 0.75, 1.5, 2.5, 3.5))
    assert text.startswith("In part, of another cause: ")
    assert "number 0" not in text  # the first number stands in for a sentence that does not fit
    assert text.endswith(".")
    assert any(digits in text for digits in ("25", "50", "0.75", "1.5", "2.5"))


def test_answers_follow_the_verdict_and_the_numbers():
    """The same claim with other numbers."""
    none = answer("ugdk-closest", "not reproduced", finding(0.0, 0.5, 0.46, 25.96))
    assert none == (
        "No: UGDK's median error is the least in none of the cells of the grid, level with the least in 50\u00a0% and "
        "above it in 46\u00a0%; at worst it is 26\u00a0times the least."
    )
    most = answer("ugdk-closest", "mostly", finding(0.85, 0.0, 0.15, 1.5))
    assert most.startswith("Mostly: UGDK's median error is the least in 85\u00a0% of the cells")


@pytest.mark.parametrize("name", ["unheard-of", "one-line"])
def test_an_answer_without_its_numbers(name):
    """A claim of another version is answered by its first number."""
    assert answer(name, "reproduced", "an exponent: 2.5 ± 0.1\nanother: 3") == "Yes: an exponent: 2.50\u00a0±\u00a00.10"
    assert answer(name, "hardly", "no number") == "Hardly: no number"


def test_numbers_in_words():
    """Shares, ratios and exponents as a reader says them."""
    assert [words.share(share) for share in (0.0, 1.0, 0.1386, 0.996)] == ["none", "all", "14\u00a0%", "99.6\u00a0%"]
    assert [words.times(value) for value in (0.176, 1.0, 25.96, 1234.0)] == [
        "0.18\u00a0times",
        "1.0\u00a0times",
        "26\u00a0times",
        "1.23\u00a0×\u00a010³\u00a0times",
    ]
    assert words.power(-0.5022) == "−0.50"
    assert words.values(finding(1.5, math.nan, math.inf))[::2] == [1.5, math.inf]


def test_findings_for_a_terminal():
    """They are numbered, in lines of at most 100 characters, without the marks of code; without findings, no line."""
    found = [material.Headline("Use `als`.", "It " + "is good " * 30 + "`always`."), material.Headline("No.", "2 %.")]
    lines = list(printed(SimpleNamespace(findings=found)))
    assert lines[0].startswith("1  Use als. It is good ")
    assert lines[-1] == "2  No. 2\u00a0%."  # which no line ends between
    assert max(map(len, lines)) <= 100
    words = " ".join(" ".join(lines[:-1]).split())
    assert words == "1 Use als. It " + "is good " * 30 + "always."
    assert list(printed(SimpleNamespace(findings=[]))) == []


@pytest.mark.parametrize(
    ("verdict", "says"),
    [
        (Verdict.REPRODUCED, "The paper's main claim holds."),
        (Verdict.IN_PART, "The paper's main claim holds in part."),
        (Verdict.NOT_REPRODUCED, "The paper's main claim does not hold."),
    ],
)
def test_the_main_claim_comes_first(efficiency, verdict, says):
    """It is said first whether the claim holds, then which estimator to use; each by the numbers."""
    of_starts = judged("mle-outliers", "in part, another cause", 0.6, 0.04, 0.0)
    rows = [of_starts, judged("ugdk-closest", verdict, 0.25, 0.5, 0.2, 3.0, 0.1, 0.4)]
    claims = pd.DataFrame(rows)
    first, second, third, last = material.findings(claims, efficiency)
    assert (first.head, first.claim) == (says, 2)
    assert "in 25\u00a0% of the cells" in first.rest
    assert first.rest.endswith("and another method is clearly closer in 40\u00a0%.")
    assert second.head == "Use the estimator MLE instead."  # not ALS, which is the nearest beyond the radius alone
    assert "Over 4 conditions with 100 points" in second.rest
    assert "1.00 times the least of all estimators, UGDK's 4.00 times." in second.rest
    assert "noise of 0.3\u00a0r the attainable bound" in third.rest
    assert "is 2.0\u00a0times the Cramér-Rao bound; UGDK reaches 6.0\u00a0times." in third.rest
    assert last.head == "Most of MLE's outliers do not come from other minima."


def test_the_main_claim_names_its_readings(efficiency):
    """If the paper can be read otherwise, the head says as what it was read, and how the claim fares else."""
    claims = pd.DataFrame([judged("ugdk-closest", "not reproduced", 0.0, 0.5, 0.5, 26.0, 0.0, 0.46)])
    readings = SimpleNamespace(otherwise=lambda name: f" as {name} is read; it holds if the noise is radial")
    (first,) = material.findings(claims, None, readings)
    words = "as ugdk-closest is read; it holds if the noise is radial."
    assert first.head == f"The paper's main claim does not hold {words}"


def test_a_name_that_is_a_word_is_code(efficiency):
    """In the finding, and on the page between its own tags."""
    curves = efficiency.curves.assign(estimator=efficiency.curves["estimator"].replace("mle", "corrected"))
    claims = pd.DataFrame(columns=["number", "name", "verdict", "finding"])
    first, reached = material.findings(claims, Frame(**vars(efficiency) | {"curves": curves}))
    assert first.head == "Use the estimator `corrected` instead."
    assert "`corrected` reaches" in reached.rest
    assert coded(first.head) == "Use the estimator <code>corrected</code> instead."


def test_findings_without_tables(efficiency):
    """What the tables do not say is left out; nothing is said of claims that were not evaluated."""
    columns = ["number", "name", "verdict", "finding"]
    assert material.findings(pd.DataFrame(columns=columns), None) == []
    row = judged("ugdk-closest", Verdict.NOT_EVALUATED) | {"finding": "needs a run of configs/paper.toml"}
    assert material.findings(pd.DataFrame([row]), None) == []
    assert [f.head[:3] for f in material.findings(pd.DataFrame([row]), efficiency)] == ["Use", "Wha"]


def test_gdke_and_lls():
    """The words about them follow the numbers."""
    rows = [judged("gdke-bias-stays", "reproduced", 1, 10, 0, 1.1)]
    rows += [judged("lls-outliers-small", "reproduced", 1, 0, 0.14)]
    of_lls, of_gdke = material.findings(pd.DataFrame(rows), None)
    assert of_gdke.head == "GDKE is biased, and more points do not help."
    assert of_gdke.rest.startswith("The bias is 10\u00a0times its scatter, and none of its 95 % ellipses")
    assert of_lls.head == "LLS's outliers come from a cut of small singular values."
    rows[1] = judged("lls-outliers-small", "in part", 0.4, 0.2, 0.14)
    assert material.findings(pd.DataFrame(rows), None)[0].head == "LLS's outliers."


def test_the_picture_has_both_bounds(efficiency):
    """A curve for each estimator, the attainable bound where it is, the Cramér-Rao bound at 1."""
    (axes,) = draw_lead(efficiency).axes
    lines = {line.get_label(): np.asarray(line.get_ydata()) for line in axes.lines}
    assert list(lines) == ["UGDK", "MLE", "ALS", "attainable bound", "Cramér-Rao bound"]
    assert np.array_equal(lines["attainable bound"], [2.0, 2.0, 2.0])
    assert np.array_equal(lines["Cramér-Rao bound"], [1.0, 1.0])
    assert np.array_equal(lines["UGDK"], [6.0, 6.0, 1 / 6.0])


def test_a_table_without_rows():
    """A run whose table of posteriors has no row has no section."""
    run = SimpleNamespace(has=lambda name: True, table=lambda name: pd.DataFrame())
    material = SimpleNamespace(runs=[SimpleNamespace(run=run, name="empty")])
    assert list(posterior_section(material)) == []


ROWS = """group,what,cost,measured,ratio,aim,machine
"loop, per sample",filling memory,36.2,ns,1,,Some CPU
"loop, per sample",ours,33.7,ns,0.931,≤ 1,Some CPU
memory,one worker,512,MB,,< 1024,Some CPU
"""


@pytest.fixture
def stored(tmp_path):
    """A stored table."""
    (tmp_path / "bench.csv").write_text(ROWS, encoding="utf-8")
    return tmp_path / "bench.csv"


def cells(table):
    """The cells of a table's rows."""
    rows = re.findall("<tr>(.*)</tr>", table.partition("<tbody>")[2])
    return [re.findall("<t[hd][^>]*>(.*?)</t[hd]>", row) for row in rows]


def test_a_table_for_each_group(stored):
    """In the order of the file, cells as they are stored, the machine named."""
    (section,) = speed_section(Material([], pd.DataFrame(), read_bench(stored)))
    text, *tables = section.content
    assert "Some CPU" in text
    assert [re.findall('<p class="caption">(.*)</p>', table) for table in tables] == [["loop, per sample"], ["memory"]]
    assert cells(tables[0]) == [["filling memory", "36.2\u00a0ns", "1", ""], ["ours", "33.7\u00a0ns", "0.931", "≤ 1"]]


def test_costs_in_units_that_suit_them(tmp_path):
    """Nanoseconds become seconds where they are so many; other units stay."""
    times = (f"times,{n},{n},ns,{n},,Some CPU" for n in ("0.327", "5931", "5.584e+07", "5.2e+10"))
    lines = [ROWS.splitlines()[0], *times]
    (tmp_path / "bench.csv").write_text("\n".join([*lines, "times,memory,383.2,MB,,,Some CPU", ""]), encoding="utf-8")
    (section,) = speed_section(Material([], pd.DataFrame(), read_bench(tmp_path / "bench.csv")))
    rows = [[cell.replace("\u00a0", " ") for cell in row] for row in cells(section.content[1])]
    assert [row[1] for row in rows] == ["0.327 ns", "5.93 µs", "55.8 ms", "52.0 s", "383.2 MB"]
    assert [row[2] for row in rows] == ["0.327", "5931", "5.584 × 10⁷", "5.2 × 10¹⁰", ""]


@pytest.mark.parametrize("content", [None, "", "a,b\n1,2\n", ",".join(COLUMNS) + "\n", "\xff\xfe"])
def test_other_files(tmp_path, content):
    """A file that is none, or not this table, is named, with what writes one."""
    path = tmp_path / "other.csv"
    if content is not None:
        path.write_bytes(content.encode("latin-1"))
    with pytest.raises(RunError, match=r"other\.csv: .*make bench writes it"):
        read_bench(path)


def test_a_study_that_kept_its_summary_alone(make_run):
    """Has its page, too: trials and samples are counted from the summary, and what is not known is said."""
    top = {"name": "alone", "estimators": ["gdke", "ugdk"], "keep": "summary"}
    run = make_run(config(top, trials=30, samples=[10, 20], noise=0.05, angle=[60, 90]))
    page = render(Material([run], judge_all([run], None)))
    assert "which trials were worst is not known" in page
    assert "SHA-256 of summary.parquet" in page
    record = Material([run], judge_all([run], None)).runs[0]
    assert (record.trials, record.samples) == (120, 2 * 30 * (10 + 20))


def plain(text):
    """With plain spaces."""
    return text.replace("\u00a0", " ")


NUMBERS = [
    ("number", (0.0, "0"), (-1.23456, "−1.23"), (1234.0, "1.23 × 10³"), (1e-9, "10⁻⁹"), (-1e-9, "−1 × 10⁻⁹")),
    ("number", (math.nan, "–"), (math.inf, "∞")),
    ("timed", (1.7, "1.70"), (433.0, "433"), (1.5e-8, "1.50 × 10⁻⁸"), (12345.6, "12,300"), (999.7, "1,000")),
    ("timed", (2e6, "2.00 × 10⁶")),
    ("exactly", (123456.0, "123,456"), (1234567.0, "1,234,567"), (1.25e8, "1.25 × 10⁸"), (0.1, "0.1")),
    ("percent", (0, 9, "0 %"), (1, 9, "11.1 %"), (1, 9999, "< 0.1 %"), (9998, 9999, "> 99.9 %")),
    ("measured", (0.765232, 0.117134, "0.77 ± 0.12"), (-1.5, 0.25, "−1.50 ± 0.25"), (0.0, 0.012, "0 ± 0.012")),
    ("measured", (1.23456e7, 1.2e5, "(1.235 ± 0.012) × 10⁷"), (1.23456e-5, 3e-7, "(1.235 ± 0.030) × 10⁻⁵")),
    ("measured", (48.2, 4692.0, "48 ± 4,700"), (-0.0003419, 0.0032, "−0.00034 ± 0.0032")),
    ("measured", (1.0, 0.00035, "1.00000 ± 0.00035"), (3e8, 4e9, "3.0 × 10⁸ ± 4.0 × 10⁹")),
    ("measured", (0.123456789, 1e-12, "0.123457 ± 1.0 × 10⁻¹²"), (7.0, 0.0, "7"), (7.0, math.nan, "7")),
    ("measured", (225.4, math.inf, "225 ± ∞"), (math.inf, math.nan, "∞"), (math.nan, math.nan, "–")),
    ("readable", ("bias: -1.2e-05 ± 3e-07", "bias: (−1.200 ± 0.030) × 10⁻⁵"), ("at 1e+14: -3", "at 1 × 10¹⁴: −3")),
    (
        "readable",
        ("LLS's, σ ≥ .1 r: 27.41 ± 5.1; N = 3: 0 ± 0.00035", "LLS's, σ ≥ .1 r: 27.4 ± 5.1; N = 3: 0 ± 0.00035"),
    ),
    ("readable", *((words, words) for words in ("run paper-8689e37964, 10-fold", "in [0, 1]-free words"))),
]
"""A function of `words`, and cases of it: arguments, and the text."""


@pytest.mark.parametrize(
    ("function", "arguments", "expected"),
    [(function, arguments, text) for function, *cases in NUMBERS for *arguments, text in cases],
)
def test_numbers_for_a_reader(function, arguments, expected):
    """Three digits, a long minus, powers of ten; two digits of an error, and the number to the same place.

    A measured number keeps the zeros at its end, one of a config all digits; a share is neither rounded to none nor to
    all. Numbers in a program's text become a reader's; names stay as they are.
    """
    assert plain(getattr(words, function)(*arguments)) == expected


def test_a_number_breaks_before_its_error_alone():
    """Nowhere else may a line end within it."""
    assert words.measured(1.23456e7, 1.2e5).split(" ") == ["(1.235", "±\u00a00.012)\u00a0×\u00a010⁷"]
    assert words.count(1234567) == "1,234,567"
    assert " " not in words.count(1234567)


@pytest.mark.parametrize(
    ("design", "expected"),
    [
        (
            {"samples": 100_000, "noise": 0.125, "angle": 31.7},
            "one cell of 5 trials: N = 100,000; σ = 0.125; φ = 31.7°; r = 1; |c| = 0",
        ),
        (
            {"samples": [5, 20], "noise_over_radius": {"logspace": [1e-7, 1, 8]}},
            "16 cells of 5 trials, all from the same draws: N = 5, 20; σ/r = 10⁻⁷, 10⁻⁶, 10⁻⁵, …, 1 (8 values); "
            "φ = 90°; r = 1; |c| = 0",
        ),
        (
            {"kind": "random", "samples": log_uniform(4, 1_000_000), "noise": 1e-13, "radius": uniform(0, 37)}
            | {"angle": {"law": "choice", "values": [20, 45]}},
            "5 trials, each with conditions of its own: N log-uniform from 4 to 10⁶; σ = 10⁻¹³; "
            "φ one of 20°, 45°; r uniform from 0 to 37; |c| = 0",
        ),
    ],
    ids=["cell", "grid", "random"],
)
def test_design(design, expected):
    """A design in a sentence, with every quantity and its values as the config gives them."""
    assert plain(words.design(parse(config(trials=5, **design)))) == expected


def test_every_measure_has_a_heading():
    """In words, no two alike, and short enough for a column."""
    titles = [measure.title for measure in PERFORMANCE.values()]
    assert len(set(titles)) == len(titles)
    assert all("_" not in title and len(title) < 60 for title in titles)
