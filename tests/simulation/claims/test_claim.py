"""The framework: what is missing is said in a line, verdicts come from judges alone, and texts are complete.

Verdicts are judged once by the same tables, and again where anything that they rest on has changed.
"""

import inspect
import itertools
import math
import shutil
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pandas as pd
import pytest

import study
from study.files import RunError, writing
from study.simulation import claims, commands
from study.simulation.claims import CLAIMS, judge_all, save
from study.simulation.claims import claim as module
from study.simulation.claims.claim import NAMED, Claim, Evidence, Number, Verdict, evaluate, ratio, within
from study.simulation.experiment.config import load, parse
from study.simulation.runs import runner, schemas
from study.simulation.runs.run_folder import Run
from study.simulation.statistics import UNKNOWN, Measure, quantile
from tests.configs import config

ROOT = Path(study.__file__).parents[1]

CONFIG = config({"name": "small", "estimators": ["gdke"]}, trials=3)


HOLDS = Number("share", 1.0, 0.0, 4)


def claim(measure, reads=("small/errors",), number=1):
    """A claim with this measure, which is Claim's docstring in all else."""
    made = Claim()
    made.name, made.section, made.quantity, made.answer, made.reads = "a", "1", "quantity", "answer", reads
    made.number, made.measure, made.criterion = number, measure, "share of something"
    return made


def of_small(evidence):
    """The number of rows of the small run."""
    return [HOLDS, Number("rows", float(len(evidence.table("small", "errors"))), 0.0, 3)]


def assert_no_verdict(finding, *words):
    """No verdict and no numbers, but a reason, in one line, with these words in it."""
    assert finding.verdict is Verdict.NOT_EVALUATED
    assert finding.numbers == []
    assert "\n" not in finding.reason
    for word in words:
        assert word in finding.reason


@pytest.fixture
def small(tmp_path):
    """A finished run."""
    return runner.run(parse(CONFIG), CONFIG, tmp_path / "run", 1, None)


def test_a_run_is_judged(small):
    """Numbers of a stored table come back with the verdict of the first, which is the share that holds."""
    (finding,) = evaluate([claim(of_small)], Evidence([small]))
    assert finding.verdict is Verdict.REPRODUCED
    assert finding.numbers == [("share of its conditions in which it holds", 1.0, 0.0, 4), ("rows", 3.0, 0.0, 3)]
    assert finding.reason == ""


@pytest.mark.parametrize(
    ("share", "verdict"),
    [
        (1.0, "reproduced"),
        (0.95, "reproduced"),
        (0.949, "mostly"),
        (0.8, "mostly"),
        (0.799, "in part"),
        (0.2, "in part"),
        (0.199, "not reproduced"),
        (0.0, "not reproduced"),
    ],
)
def test_one_rule_for_all(share, verdict):
    """A verdict is that of the share alone; another cause stands beside any of them, and is read back."""
    made = claim(lambda evidence: [Number("share", share, 0.0, 1)])
    made.other_cause = lambda numbers: True
    evidence = Evidence([])
    (text,) = module.frame(evaluate([made], evidence), evidence)["verdict"]
    assert text == f"{verdict}, another cause"
    assert Verdict(text) == Verdict(verdict) == verdict
    for other in ("partly", "another cause", f"{text}, or not"):
        with pytest.raises(ValueError, match="is not a valid"):
            Verdict(other)


def test_the_share_of_conditions_and_its_error():
    """Conditions at the tolerance, by a standard error, far off and without an error; unknown ones are left out.

    A count of independent conditions has the variance Σ p(1 - p), with p = ½ and Φ(-1) = .15866 for the first two.
    """
    excesses = [Measure(0.0, 0.1), Measure(-0.1, 0.1), Measure(5.0, 0.1), Measure(math.inf, math.nan), UNKNOWN]
    number = module.holding("", [*excesses, Measure(-1.0, math.nan)])
    assert (number.value, number.trials) == (3 / 5, 5)
    assert number.error == pytest.approx(math.sqrt(0.25 + 0.15866 * 0.84134) / 5, rel=1e-4)
    assert math.isnan(module.holding("", [UNKNOWN]).value)


def test_the_ratio_of_medians_of_the_same_draws():
    """Its error is the spread of the ratio over repetitions, of errors that go together to a degree.

    The scatter of 400 ratios has a relative error of 1/√800; the mean error of one is off by less than that, so that
    15 % are more than 4 of them.
    """
    rng = np.random.default_rng(9)
    ratios, errors = [], []
    for _ in range(400):
        shared = rng.standard_normal(400)
        one, other = (np.exp(0.3 * (shared + 0.5 * rng.standard_normal(400))) for _ in range(2))
        value, error = module.paired_ratio(one, other)
        ratios.append(value)
        errors.append(error)
    assert np.mean(errors) == pytest.approx(np.std(ratios), rel=0.15)
    alone = math.hypot(*(quantile(x, 0.5).error for x in (one, other)))
    assert np.mean(errors) < 0.85 * alone
    assert module.paired_ratio(one, one) == (1.0, 0.0)


def test_a_broken_table(small):
    """A table that cannot be read counts as missing."""
    (small.folder / "errors.parquet").write_bytes(b"not parquet")
    (finding,) = evaluate([claim(of_small)], Evidence([small]))
    assert_no_verdict(finding, "errors.parquet: damaged", "study run")


def test_the_cost_table(tmp_path):
    """The table is read from its file; a missing table has a reason; a file that is no cost table is an error."""
    measure = claim(lambda evidence: [HOLDS, Number("rows", float(len(evidence.costs())), 0.0, 0)], reads=("cost",))
    (finding,) = evaluate([measure], Evidence([]))
    assert_no_verdict(finding, "study cost")
    path = tmp_path / "cost.parquet"
    with pytest.raises(RunError, match="no cost table"):
        module.read_cost(path)
    path.mkdir()
    with pytest.raises(RunError, match="no cost table; `study cost"):
        module.read_cost(path)
    path.rmdir()
    path.write_bytes(b"not parquet")
    with pytest.raises(RunError, match="not a cost table: damaged, or not parquet; `study cost"):
        module.read_cost(path)
    columns = ["flops_per_sample", "paper_flops", "scalar_seconds", "vector_seconds"]
    for values in ({}, dict.fromkeys(columns, "fast")):
        pd.DataFrame({"estimator": ["gdke", "lls"]} | values).to_parquet(path)
        with pytest.raises(RunError, match=r"not a cost table: flops_per_sample, .* missing or not numbers; `study"):
            module.read_cost(path)
    pd.DataFrame({"estimator": ["gdke", "lls"]} | dict.fromkeys(columns, 1.0)).to_parquet(path)
    (finding,) = evaluate([measure], Evidence([], module.read_cost(path)))
    assert finding.numbers[1].value == 2.0


def test_numbers_that_cannot_be_formed():
    """An unknown number leaves no verdict, and the reason names the number."""
    numbers = [Number("first", 1.0, 0.1, 10), Number("second", math.nan, math.nan, 0)]
    (finding,) = evaluate([claim(lambda evidence: numbers)], Evidence([]))
    assert finding.verdict is Verdict.NOT_EVALUATED
    assert finding.numbers == numbers
    assert "second" in finding.reason
    assert "first" not in finding.reason


def test_other_exceptions_are_faults():
    """A measure that breaks is a fault of the program, not a missing table."""

    def broken(evidence):
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        evaluate([claim(broken)], Evidence([]))


def test_number():
    """A number prints with its error if it has one."""
    assert str(Number.of("bias", Measure(0.12345, 0.0123), 5)) == "bias: 0.1235 ± 0.012"
    assert str(Number("count", 35.0, 0.0, 0)) == "count: 35"
    assert str(Number("time", 1.5, math.nan, 0)) == "time: 1.5"


def test_only_known():
    """Numbers that are NaN are left out; an infinite one stays."""
    numbers = [Number(name, value, 0.0, 1) for name, value in (("a", 1.0), ("b", math.nan), ("c", math.inf))]
    assert [n.words for n in module.only_known(*numbers)] == ["a", "c"]


@pytest.mark.parametrize(
    ("value", "error", "inside"),
    [(1.0, 0.05, True), (1.05, 0.02, True), (1.05, 0.03, False), (0.89, 0.0, False), (1.0, math.inf, False)],
)
def test_within(value, error, inside):
    """Within a tenth of one, two standard errors included; without an error, by the value."""
    assert within(Number("", value, error, 1), 1.0, 0.1) is inside
    assert within(Number("", value, math.nan, 0), 1.0, 0.1) is (abs(value - 1.0) <= 0.1)


def test_every_fit_counts():
    """A status leaves no fit out; without a number, or a finite bound, an error is infinite."""
    part = pd.DataFrame({"status": [0, 1, 3, 0], "error": [1, 2, math.nan, 1], "bound": [2, 2, 2, math.inf]})
    assert list(module.error_over(part, "bound")) == [0.5, 1.0, math.inf, math.inf]


def test_ratio():
    """Errors add in relative squares; over nothing finite there is no ratio."""
    value, error = ratio(Measure(3.0, 0.3), Measure(2.0, 0.1))
    assert (value, error) == pytest.approx((1.5, 1.5 * math.hypot(0.1, 0.05)))
    assert ratio(Measure(math.inf, math.inf), Measure(2.0, 0.1)).value == math.inf
    for below in (math.inf, math.nan, 0.0):
        assert math.isnan(ratio(Measure(1.0, 0.1), Measure(below, 0.1)).value)


def test_frame(small):
    """The table has the declared columns, a row per claim with the number that it states, and can be stored."""
    missing = claim(lambda evidence: evidence.table("other", "errors"), reads=("other/errors", "small/errors", "cost"))
    numbers = [Number("share", 0.97, 0.5, 3), Number("a", 2.0, 0.5, 7), Number("b", 3.0, 0.0, 0)]
    several = claim(lambda evidence: [*numbers, Number("c", 4.0, 0.1, 5)])
    empty = claim(lambda evidence: [Number("share", 0.5, 0.0, 9)], reads=(), number=30)
    evidence = Evidence([small])
    table = module.frame(evaluate([several, missing, empty], evidence), evidence)
    assert list(table.columns) == [column.name for column in schemas.CLAIMS]
    assert list(table["number"]) == [1, 1, 30]
    assert list(table["verdict"]) == ["reproduced", "not evaluated", "in part"]
    first = table.iloc[0]
    assert (first["value"], first["error"], first["trials"]) == (0.97, 0.5, 5)
    words = "share of its conditions in which it holds: 0.97 ± 0.5"
    assert first["finding"] == f"{words}\na: 2 ± 0.5\nb: 3\nc: 4 ± 0.1"
    assert "configs/other.toml" in table["finding"][1]
    assert math.isnan(table["value"][1])
    assert list(table["runs"]) == [small.study.run_name(), small.study.run_name(), ""]
    stored = schemas.table(schemas.CLAIMS, {name: table[name].to_numpy() for name in table.columns})
    assert stored.num_rows == 3


def test_numbers_are_for_good():
    """No two claims have the same number or name, and each has the number under which its verdict was stored."""
    numbers = {claim.name: claim.number for claim in CLAIMS}
    assert len(numbers) == len(set(numbers.values())) == len(CLAIMS)
    assert list(numbers.values()) == sorted(numbers.values())
    stored = Run.open(ROOT / "results" / "paper").table("claims")
    assert len(stored) > 20
    assert stored.set_index("name")["number"].to_dict().items() <= numbers.items()


@pytest.mark.parametrize("claim", CLAIMS, ids=lambda claim: claim.name)
def test_texts(claim):
    """Every claim says what the paper says, what is measured, by what rule, and what a reader should know."""
    for name in ("section", "statement", "quantity", "criterion", "remark"):
        text = getattr(claim, name)
        assert text == text.strip() != "", f"{name}: empty, or with blanks at an end"
    assert claim.criterion.startswith("share of ")
    assert claim.statement.endswith(".")


@pytest.mark.parametrize("claim", CLAIMS, ids=lambda claim: claim.name)
def test_measures_know_no_verdict(claim):
    """A verdict is the rule's: no measure mentions one, and the test of another cause reads no table."""
    measure = inspect.getsource(claim.measure)
    assert "Verdict" not in measure
    assert not any(f'"{verdict}"' in measure for verdict in Verdict)
    assert "evidence" not in inspect.getsource(claim.other_cause)


@pytest.mark.parametrize("claim", CLAIMS, ids=lambda claim: claim.name)
def test_what_is_read_can_be_made(claim):
    """Tables are of shipped configs with the name that claims know them by, which keep points where these are read."""
    for read in claim.reads:
        config, _, table = read.partition("/")
        if read in ("cost", "case-study"):
            continue
        found = load(ROOT / "configs" / f"{config}.toml")
        assert found.name == config
        assert table in ("errors", "timings", "points")
        assert found.keep_points or table != "points"


@pytest.mark.parametrize("claim", CLAIMS, ids=lambda claim: claim.name)
def test_nothing_at_hand(claim):
    """Without any table a claim has no verdict, and one line says which of those that it reads it needs."""
    (finding,) = evaluate([claim], Evidence([]))
    assert_no_verdict(finding)
    needs = {
        "cost": "needs the cost table: `study cost` makes it",
        "case-study": "needs a recording: `study case-study FILE --out DIR`, then `--recording DIR` here",
    }
    configs = [read.partition("/")[0] for read in claim.reads]
    assert finding.reason in [needs.get(name, f"needs a run of configs/{name}.toml") for name in configs]


MANY = sorted(NAMED)
OF_ERRORS = [claim for claim in CLAIMS if all(read.endswith("/errors") for read in claim.reads)]
POOLED = {"troubles-beyond-radius", "figure-4-setting"}
"""Claims that pool cells, so that few trials of each are enough."""


@pytest.fixture(scope="module", params=[(MANY, 1), (MANY, 2), (["pratt"], 30), (["lls"], 30), (["gdke"], 30)])
def few(request, error_rows):
    """Names of estimators, and an error table of a few trials of theirs in some conditions."""
    (names, trials), parts = request.param, []
    for angle, noise, samples in itertools.product((20.0, 90.0, 180.0), (1e-8, 1e-4, 0.04, 0.3, 2.0, 1e11), (40, 400)):
        cell = {"cell": f"{angle} {noise} {samples}", "angle": angle, "noise": noise, "samples": samples}
        error = noise * (1.0 + np.arange(trials))
        parts += [error_rows(name, error, error_2=error**2, bound=noise, **cell) for name in names]
    return names, pd.concat(parts, ignore_index=True).drop(columns="error_3")


@pytest.mark.parametrize("claim", OF_ERRORS, ids=lambda claim: claim.name)
def test_too_few_trials_or_estimators(find, claim, few):
    """With a handful of trials, or of other estimators alone, there is no number to judge by, and so no verdict."""
    names, table = few
    if (names == MANY and claim.name in POOLED) or (names == ["gdke"] and claim.name == "gdke-even-data"):
        return
    cell = table[table["cell"] == table["cell"].iloc[0]]
    one_cell = ("ellipse/errors", "starts/errors")
    found = find(claim.name, {read: cell if read in one_cell else table for read in claim.reads})
    assert found.verdict is Verdict.NOT_EVALUATED
    assert found.reason.startswith("too few trials or conditions in the tables for: ")


def test_an_estimator_whose_rows_are_not_read_is_an_error(small):
    """A claim on an estimator that claims do not name fails with the remedy, instead of finding too few trials."""
    other = claim(lambda evidence: module.rows_of(evidence.errors("small"), "pratt"))
    with pytest.raises(LookupError, match=r"pratt: its rows are not read; a claim on it adds it to NAMED in claim\.py"):
        evaluate([other], Evidence([small]))


def test_verdicts_stay_where_no_claim_can_be_judged(tmp_path):
    """The reference run keeps its verdicts, but not its rows: judging it again changes none but damaged ones."""
    folder = shutil.copytree(ROOT / "results" / "paper", tmp_path / "paper")
    stored, run = (folder / "claims.parquet").read_bytes(), Run.open(folder)
    judged = judge_all([run])
    assert set(judged["verdict"]) == {"not evaluated"}
    save(run, judged)
    assert (folder / "claims.parquet").read_bytes() == stored
    (folder / "claims.parquet").write_bytes(stored[:-9])
    save(run, judged)
    assert set(run.table("claims")["verdict"]) == {"not evaluated"}


@pytest.fixture
def run(circles, copied):
    """A run of its own, whose files a test may change."""
    return copied(circles)


@pytest.fixture
def judged(run):
    """The run's verdicts, stored."""
    table = claims.judge_all([run])
    claims.save(run, table)
    return table


def test_the_page_judges_and_stores_when_asked(run, judged, monkeypatch, capsys, tmp_path, files_of):
    """The page's command prints and stores what `study claims` does; without the option it leaves the run alone."""
    monkeypatch.setattr("study.simulation.figures.FIGURES", {})
    table, page = run.path("claims").read_bytes(), tmp_path / "page.html"
    commands.claims([run.folder])
    said = capsys.readouterr().out
    run.remove("claims")
    before = files_of(run.folder)
    commands.report([run.folder], page)
    findings = capsys.readouterr().out.removesuffix(f"{page}\n")
    assert files_of(run.folder) == before
    commands.report([run.folder], page, claims=True)
    assert capsys.readouterr().out == f"{findings}{said}{page}\n"
    assert run.path("claims").read_bytes() == table
    run.remove("claims")
    with writing(run.folder), pytest.raises(RunError, match="is writing to it"):
        commands.report([run.folder], page, claims=True)
    assert capsys.readouterr().out == f"{findings}{said}{page}\n"  # the work is not lost


def test_verdicts_that_cannot_be_stored_are_printed(run, capsys, files_of, monkeypatch):
    """While another process writes to the folder, or the disk does not let it, the work is not lost."""
    with writing(run.folder):
        before = files_of(run.folder)
        with pytest.raises(RunError, match="is writing to it"):
            commands.claims([run.folder])
        assert files_of(run.folder) == before
    said = capsys.readouterr().out
    commands.claims([run.folder])
    assert capsys.readouterr().out == said != ""
    monkeypatch.setattr(Run, "join", Mock(side_effect=RunError("cannot be written: No space left")))
    with pytest.raises(RunError, match="No space"):
        claims.save(run, claims.judge_all([run]).assign(verdict="reproduced"))
    assert run.valid("claims")  # those stored before


@pytest.mark.parametrize("change", ["missing", "damaged"])
def test_nothing_is_stored_that_no_manifest_vouches_for(run, judged, change, files_of):
    """Without a sound manifest neither the command nor the function writes a table."""
    path = run.folder / "manifest.json"
    path.write_text(path.read_text(encoding="utf-8").replace("circles", "circle"), encoding="utf-8")
    if change == "missing":
        path.unlink()
    before = files_of(run.folder)
    with pytest.raises(RunError, match=f"manifest.json: {change}[^\n]*$"):
        commands.claims([run.folder])
    if change == "damaged":
        with pytest.raises(RunError, match=r"manifest\.json: damaged[^\n]*$"):
            claims.save(run, judged)
    assert files_of(run.folder) == before
