"""Readings of the paper: their config, the studies that they change, the rules, and three verdicts by other code."""

import math
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.optimize import least_squares

import study
from study.files import RunError
from study.simulation.claims import CLAIMS
from study.simulation.claims.claim import NAMED, Evidence, Rules, Verdict, evaluate, exponent, rows_of
from study.simulation.claims.readings import COLUMNS, OpenChoice, Readings, judge, own_configs, read
from study.simulation.experiment.config import load, parse, shipped_config
from study.simulation.runs import runner
from study.toml import ConfigError
from tests.configs import config

ROOT = Path(study.__file__).parents[1]
SHIPPED = ROOT / "configs" / "readings.toml"


@pytest.fixture(scope="module")
def choices():
    return read(SHIPPED)


@pytest.fixture(scope="module")
def stored(choices):
    return Readings.load(ROOT / "docs" / "assets" / "tables" / "readings.csv")


def test_the_shipped_choices(choices):
    """At least ten choices, each with a reading that is used and changes nothing, and others that change something."""
    assert len(choices) >= 10
    for choice in choices:
        for reading in choice.reading:
            assert (reading.name == choice.used) is not any(map(reading.concerns, CLAIMS))
            assert reading.clause or reading.name == choice.used


def test_a_reading_changes_what_it_says_alone(choices):
    """Its studies are the shipped ones but for its entries, and for estimators that no claim names."""
    for reading in (one for choice in choices for one in choice.reading):
        for name in reading.runs:
            ours, theirs = map(tomllib.loads, (reading.config(name), shipped_config(name).read_text("utf-8")))
            assert ours.pop("design") == {**theirs.pop("design"), **reading.design}
            named = [other for other in theirs.pop("estimators") if other in NAMED]
            assert ours.pop("estimators") == [reading.estimators.get(other, other) for other in named]
            assert ours == theirs


def test_the_used_reading_is_the_study(choices):
    """Without changes a config is the shipped one."""
    assert parse(choices[0].reading[0].config("paper")) == load(shipped_config("paper"))


GOOD = """[[choice]]
name = "law"
issue = "Law"
section = "5"
says = "Gaussian."
used = "a"
why = "So."
[[choice.reading]]
name = "a"
words = "one"
[[choice.reading]]
name = "b"
words = "other"
clause = "if other"
runs = ["bias"]
design = { law = "laplace" }
"""


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('used = "a"', 'used = "c"', r"line 6: choice\[0\]\.used = 'c': is no reading; known are"),
        ('name = "b"', 'name = "a"', r"is that of another reading"),
        ('clause = "if other"\n', "", r"line 11: .*\.reading\[1\]\.clause: required for a reading that is not used"),
        ('words = "one"', 'words = "one"\nrules = { far = 3.0 }', "is the one used, and must change nothing"),
        ('runs = ["bias"]\n', "", "must change runs or rules"),
        ('law = "laplace"', 'law = "lapalce"', "law read as b: bias.*design.law = 'lapalce'"),
        ('words = "one"', 'word = "one"', r"line 10: .*\.reading\[0\]\.word = 'one': unknown key; did you mean 'wor"),
        ('["bias"]', '["bais"]', "bais: neither a file nor a shipped config; did you mean"),
    ],
)
def test_faults(tmp_path, old, new, message):
    """Each fault of a config names its place and its remedy."""
    path = tmp_path / "readings.toml"
    path.write_text(GOOD, encoding="utf-8")
    assert len(read(path)) == 1
    assert GOOD.count(old) == 1
    path.write_text(GOOD.replace(old, new), encoding="utf-8")
    with pytest.raises(ConfigError, match="(?s)" + message):
        read(path)


def test_rules(error_rows, scores):
    """Medians or means, the outlier's factor, and trials in which all fits are ok."""
    from tests.simulation.claims.conftest import Stored  # the stand-in for a run

    spread = np.exp(0.5 * scores(400))
    rows = [error_rows(name, spread * n**-0.5, samples=n) for n in (30, 300, 3000) for name in ("ugdk", "mle")]
    table = pd.concat(rows, ignore_index=True)
    bad = (table["estimator"] == "ugdk") & (table["trial"] < 40)
    table = table.assign(status=np.where(bad, 3, 0))

    def evidence(**rules):
        return Evidence([Stored("power-law", {"errors": table}, set())], rules=Rules(**rules))

    errors = evidence().errors("power-law")
    assert len(rows_of(errors, "mle")) == 1200
    left = evidence(fits="ok").errors("power-law")
    assert len(rows_of(left, "mle")) == len(rows_of(left, "ugdk")) == 3 * 360
    values = np.concatenate([spread, [1e9]])
    assert evidence().average(values).value == pytest.approx(1.0, rel=0.01)
    assert evidence(average="mean").average(values).value == pytest.approx(values.mean())
    at = errors["samples"].to_numpy(dtype=float)
    slope = exponent("", at, errors["error"].to_numpy(), at, evidence(average="mean").average)
    assert slope.value == pytest.approx(-0.5, abs=1e-6)


def test_judge(tmp_path, monkeypatch):
    """A reading's studies are run and kept, and the claims that read them are judged again, those alone."""
    path = tmp_path / "bias.toml"
    text = config({"name": "bias", "estimators": ["gdke", "ugdk"]}, trials=300, samples=[40, 80, 160])
    path.write_text(text, encoding="utf-8")
    monkeypatch.setattr("study.simulation.claims.readings.shipped_config", lambda name: path)
    own = runner.run(parse(text), text, tmp_path / "own")
    used = {"name": "a", "words": "one"}
    other = {"name": "b", "words": "other", "clause": "if other", "runs": ("bias",), "design": {"law": "laplace"}}
    words = {"name": "law", "issue": "Law", "section": "5", "says": "Gaussian.", "used": "a", "why": "So."}
    choice = OpenChoice.model_validate(words | {"reading": [used, other]})
    said = []
    table = judge([choice], [own], tmp_path / "readings", progress=said.append)
    assert said == ["Law: other"]
    assert list(table.columns) == list(COLUMNS)
    assert list(table["claim"]) == ["ugdk-bias"]
    made = tmp_path / "readings" / "law-b" / "bias"
    assert load(made / "config.toml").design.given()["law"] == ("laplace",)
    (again,) = evaluate([claim for claim in CLAIMS if claim.name == "ugdk-bias"], Evidence([own]))
    assert table["used"].item() == str(again.verdict)
    assert "laplace" not in (tmp_path / "own" / "config.toml").read_text(encoding="utf-8")


def made(*rows):
    """A table of readings of these claims, readings and verdicts."""
    keys = ("choice", "reading", "number", "claim", "verdict", "used")
    return pd.DataFrame(rows, columns=keys).assign(value=0.5, error=0.1, trials=9, finding="a: 0.5 ± 0.1")


def test_what_changes(choices):
    """Changed verdicts are told with their reading; verdicts that were not evaluated change nothing."""
    table = made(
        ("noise-law", "radial", 2, "ugdk-closest", "reproduced", "not reproduced"),
        ("noise-law", "radial-third", 2, "ugdk-closest", "in part", "not reproduced"),
        ("noise-law", "radial", 1, "one-line", "in part", "in part"),
        ("noise-law", "radial", 23, "recordings-within-1-cm", "not evaluated", "not evaluated"),
        ("noise-law", "unheard-of", 1, "one-line", "reproduced", "in part"),
    )
    found = Readings(choices, table)
    assert found.otherwise("one-line") == ""
    assert found.otherwise("ugdk-closest") == (
        " as eq. 9 is read; it holds if the noise is along the radius; it holds in part if the noise is along the "
        "radius and Σ̂ has its trace"
    )
    assert found.standing == ["one-line"]
    assert found.verdict("ugdk-closest", "noise-law", "radial") == "reproduced"
    assert found.verdict("ugdk-closest", "arc", "wide") == ""
    lines = list(found.printed())
    assert lines[-1].endswith("other readings: 1 verdicts stand under all, 1 change under some")
    assert "not reproduced → reproduced" in lines[1]


@pytest.mark.parametrize("text", ["", "a,b\n1,2\n"])
def test_a_table_that_is_none(tmp_path, text):
    """A file that is no table of readings is refused with the command that makes one."""
    path = tmp_path / "readings.csv"
    for content in (None, text):
        if content is not None:
            path.write_text(content, encoding="utf-8")
        with pytest.raises(RunError, match=r"readings\.csv: [^\n]*study readings --out"):
            Readings.load(path)


def test_the_stored_table(stored, choices):
    """Every reading has a row for each claim that it may change, and the claims are those of today."""
    expected = {
        (choice.name, one.name, claim.name)
        for choice in choices
        for one in choice.reading
        for claim in CLAIMS
        if one.name != choice.used and one.concerns(claim)
    }
    table = stored.table
    rows = set(zip(table["choice"], table["reading"], table["claim"], strict=True))
    assert rows == expected, "docs/assets/tables/readings.csv is of other claims: `make tables` computes it again"
    assert not table["error"].isna().all()
    assert {Verdict(verdict) for verdict in table["verdict"]} <= set(Verdict)
    assert set(own_configs()) >= {name for choice in choices for one in choice.reading for name in one.runs}


# cells of the matrix by other code: another generator, the closed form of eqs 4 and 17, SciPy's least squares ---------


def on_cap(rng, samples, angle):
    """Directions uniform by area within an angle of the first axis."""
    height = 1.0 - rng.random(samples) * (1.0 - math.cos(angle))
    turn, across = rng.uniform(0.0, 2.0 * math.pi, samples), np.sqrt(1.0 - height**2)
    return np.stack([height, across * np.cos(turn), across * np.sin(turn)], axis=1)


def closed_form(x, sigma=0.0):
    """GDKE, or with the noise's σ UGDK: x̄ + ½ (C - σ² I)⁻¹ S."""
    centred = x - x.mean(axis=0)
    c = centred.T @ centred / (len(x) - 1) - sigma**2 * np.eye(x.shape[1])
    s = (centred * np.sum(centred**2, axis=1, keepdims=True)).sum(axis=0) / (len(x) - 1)
    return x.mean(axis=0) + 0.5 * np.linalg.solve(c, s)


def nearest_sphere(x, start):
    """The centre of least squares of the distances from the sphere."""

    def residuals(p):
        return np.linalg.norm(x - p[:3], axis=1) - p[3]

    def slopes(p):
        away = p[:3] - x
        return np.hstack([away / np.linalg.norm(away, axis=1, keepdims=True), np.full((len(x), 1), -1.0)])

    first = [*start, np.linalg.norm(x - start, axis=1).mean()]
    return least_squares(residuals, first, slopes, method="lm").x[:3]


@pytest.mark.parametrize(("radial", "sign"), [(True, 1.0), (False, -1.0)])
def test_the_main_claim_turns_with_the_law_of_the_noise(stored, radial, sign):
    """Where σ is 3 to 300 times r UGDK is clearly nearer than GDKE and MLE if the noise is radial, and else farther.

    The rule is the claim's: three standard errors of the sign test, ties of 1 % left out; by chance 1 in 700.
    """
    rng, errors = np.random.default_rng(1_000 + radial), []
    for _ in range(60):
        samples, sigma = int(np.exp(rng.uniform(math.log(10), math.log(600)))), 3.0 * 10.0 ** rng.uniform(0.0, 2.0)
        u = on_cap(rng, samples, rng.uniform(0.1, math.pi))
        x = u + sigma * (u * rng.standard_normal((samples, 1)) if radial else rng.standard_normal(u.shape))
        gdke = closed_form(x)
        errors.append([np.linalg.norm(c) for c in (closed_form(x, sigma), gdke, nearest_sphere(x, gdke))])
    ugdk, *others = np.array(errors).T
    for other in others:
        nearer, farther = np.sum(ugdk < 0.99 * other), np.sum(other < 0.99 * ugdk)
        assert sign * (nearer - farther) / math.sqrt(nearer + farther) > 3.0
    row = stored.table.query("claim == 'ugdk-closest' and choice == 'noise-law' and reading == 'radial'").iloc[0]
    assert (row["verdict"] if radial else row["used"]) == ("in part" if radial else "not reproduced")
    closest, farther = (value_of(stored, "noise-law", "radial", "ugdk-closest", place)[0] for place in (4, 5))
    assert closest > 0.4 > farther == 0.0  # of the paper's decades, under the radial law


def value_of(stored, choice, reading, claim, place=1):
    """A number of the finding of a cell, with its Monte-Carlo error."""
    at = stored.table.query("choice == @choice and reading == @reading and claim == @claim")
    value, _, error = at["finding"].item().split("; ")[place].rpartition(": ")[2].partition(" ± ")
    return float(value), float(error or 0.0)


@pytest.mark.parametrize(("reading", "angle"), [("wide", 45.0), ("half-circle", 90.0)])
def test_gdkes_bias_on_other_arcs(stored, reading, angle):
    """GDKE's bias over its standard deviation on arcs of 45° and 90°: 3000 circles of 100 points with noise .05.

    A ratio b of n trials has the standard error √((1 + b²/2)/n); 4.5 of both together miss in 7 of 10⁶ seeds.
    """
    rng = np.random.default_rng(2_000)
    turn = rng.uniform(-math.radians(angle), math.radians(angle), (3000, 100))
    points = np.stack([np.cos(turn), np.sin(turn)], axis=2) + 0.05 * rng.standard_normal((3000, 100, 2))
    along = np.array([closed_form(x)[0] for x in points])
    ratio = along.mean() / along.std(ddof=1)
    value, error = value_of(stored, "arc", reading, "gdke-bias-stays")
    assert abs(ratio - value) < 4.5 * math.hypot(error, math.sqrt((1.0 + 0.5 * ratio**2) / 3000))


def test_definite_sums_with_radial_noise(stored):
    """Share of trials in which every marker's C - Σ̂ is positive definite, and the sum's, by NumPy's covariances.

    600 trials at each noise; off by 4.5 binomial standard errors of both in 7 of 10⁶ seeds each.
    """
    rng, every, summed = np.random.default_rng(3_000), [], []
    for sigma in (0.003, 0.01, 0.03, 0.1, 0.3, 1.0):
        for _ in range(600):
            lengths = [r + sigma * rng.standard_normal((100, 1)) for r in (0.1, 0.5, 2.0)]
            points = [on_cap(rng, 100, math.radians(60.0)) * length for length in lengths]
            matrices = [np.cov(x.T) - sigma**2 * np.eye(3) for x in points]
            every.append(min(np.linalg.eigvalsh(m)[0] for m in matrices) > 0.0)
            summed.append(np.linalg.eigvalsh(np.sum(matrices, axis=0))[0] > 0.0)
    for place, values in ((2, every), (0, summed)):
        value, error = value_of(stored, "noise-law", "radial", "markers-positive-definite", place)
        ours = np.mean(values)
        assert abs(ours - value) < 4.5 * math.hypot(error, math.sqrt(max(ours * (1 - ours), 1e-3) / len(values)))
