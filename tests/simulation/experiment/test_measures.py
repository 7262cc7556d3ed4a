"""Measures of fits: what the shipped ones say, columns in the tables, and measures of one's own."""

import math
import re

import numpy as np
import pandas as pd
import pytest
from scipy import stats

import study
from study.fits import Estimates, registry
from study.fits.answers.answer import white_covariance
from study.fits.registry import PluginError, load
from study.simulation.analysis.compare import Difference
from study.simulation.analysis.summary import summarise
from study.simulation.analysis.verify import Verification
from study.simulation.experiment import measures
from study.simulation.experiment.compute import compute, lost
from study.simulation.experiment.conditions import STORED
from study.simulation.experiment.config import parse
from study.simulation.experiment.measures import FIRST_WORDS, MEASURES, Truth, attempt
from study.simulation.experiment.replay import all_trials
from study.simulation.runs import runner, schemas
from study.simulation.runs.workers import Workers
from study.toml import ConfigError
from tests.configs import config

pytestmark = pytest.mark.usefixtures("forgotten")
NEAR = """
import numpy as np
import study

def near(samples, fit, truth):
    "Distance of the fitted from the true centre, in radii."
    away = np.linalg.norm(fit.center - truth.center, axis=1) / truth.radius
    return {"center": away < 0.1, "distance": away, "side_i": fit.center > truth.center}

study.register_measure("near", near, {
    "center": (bool, "within 0.1 radii"), "distance": (float, "over the radius"), "side_i": (bool, "beyond, axis {}"),
})
"""
BODY = (
    "import numpy as np\nimport study\ndef f(samples, fit, truth):\n    'A measure.'\n    return {}\n"
    "study.register_measure('own', f, {})\n"
)
FLOAT = "{'a': (float, 'a number')}"


@pytest.fixture
def near(tmp_path):
    """A file with a measure, which is loaded."""
    path = tmp_path / "my.py"
    path.write_text(NEAR)
    assert load(path) == ()
    return path


@pytest.fixture
def start(tmp_path):
    """Run a config, and return the run with what it warned of."""

    def run(text, folder="run", **workers):
        made, said = parse(text), []
        done = runner.run(made, text, tmp_path / folder / made.run_name(), Workers(**workers), warn=said.append)
        if made.keep == "errors":
            summarise(done)
        return done, said

    return run


def errors_of(text):
    """Errors of a study, unit by unit."""
    made = parse(text)
    parts = [compute(made, unit).errors for unit in made.units()]
    return pd.DataFrame({name: np.concatenate([part[name] for part in parts]) for name in parts[0]})


def test_intervals_hold_the_truth_in_95_per_cent():
    """By theory: the noise is small, so the score's T is Student's; each column of 4000 trials has p > 1e-6.

    The intervals and what they hold are the same for each estimator, as they come from the points alone.
    """
    top = {"estimators": ["mle", "gdke"], "measures": ["interval"]}
    errors = errors_of(config(top, trials=4000, samples=20, noise=0.001, angle=180))
    of_each = [part.filter(like="interval").reset_index(drop=True) for _, part in errors.groupby("estimator")]
    pd.testing.assert_frame_equal(*of_each)
    for name in ("radius", "center_1", "center_2", "center_3"):
        held = int(of_each[0][f"interval_{name}"].sum())
        assert stats.binomtest(held, 4000, 0.95).pvalue > 1e-6, name
    assert of_each[0]["interval_identified"].all()


def test_width_is_that_of_the_bound():
    """If the noise is small, the estimated σ alone makes the width differ: s/σ, s² by χ² of n - 4 = 16 numbers.

    Its mean square is 1; of 4000 trials within 5 standard errors, √(2/16/4000) each: false alarms 6e-7.
    """
    top = {"estimators": ["mle"], "measures": ["own_errors", "interval"]}
    errors = errors_of(config(top, trials=4000, samples=20, noise=0.001, angle=180))
    for name in ("own_errors_width", "interval_width"):
        assert (errors[name] ** 2).mean() == pytest.approx(1.0, abs=5 * math.sqrt(2 / 16 / 4000))


def test_own_errors_are_those_of_the_fit():
    """The truth lies within ± t of `study.fit`'s own standard errors where the column says so, trial by trial."""
    text = config(
        {"estimators": ["mle", "corrected"], "measures": ["own_errors"]}, trials=60, samples=12, noise=0.3, center=2.0
    )
    errors, t = errors_of(text), stats.t.ppf(0.975, 12 - 4)
    for trial in all_trials(parse(text)):
        for name in ("mle", "corrected"):
            row = errors[(errors["trial"] == trial.trial) & (errors["estimator"] == name)].iloc[0]
            with np.errstate(invalid="ignore"):
                half = t * np.sqrt(np.diag(white_covariance(study.fit(trial.samples.points[0], name))))
            away = np.array([*(row[f"error_{i + 1}"] for i in range(3)), row["radius_error"]])
            held = [row[f"own_errors_{column}"] for column in ("center_1", "center_2", "center_3", "radius")]
            np.testing.assert_array_equal(held, np.abs(away) <= half)
    assert 0 < errors["own_errors_radius"].sum() < len(errors)


@pytest.mark.parametrize("d", [2, 3])
def test_every_column_of_the_intervals(rng, on_cap, d):
    """Ends, widths and truth values are those of `study.fit`'s intervals and of SciPy's t and normal quantiles.

    Nine points: a degree of freedom more or less changes t by 3 %. `lls` finds σ itself; `ugdk` takes it, so has z.
    """
    center = np.arange(1.0, d + 1.0)
    points, u = on_cap(rng, 9, 120.0, d, noise=0.06, radius=2.0, center=center, sets=40)
    samples = study.Samples(points.swapaxes(1, 2).copy(), 0.06)
    design = np.concatenate([u, np.ones((*u.shape[:2], 1))], axis=2)
    bound = 0.06**2 * np.linalg.inv(np.einsum("bni,bnj->bij", design, design))
    truth, t = Truth(center, 2.0, 0.06, bound), stats.t.ppf(0.975, 9 - d - 1)
    alone = study.fit(points)
    for name, quantile in (("lls", t), ("ugdk", stats.norm.ppf(0.975))):
        estimates = study.ESTIMATORS[name](samples)
        columns = {}
        for measure in ("interval", "own_errors", "ends"):
            values, faults = attempt(measure, samples, estimates, name, truth)
            assert faults == {}
            columns |= values
        fit = study.Fit(estimates, samples, name)
        half = quantile * np.sqrt(np.einsum("bii->bi", white_covariance(fit)))
        own = np.column_stack([fit.center, fit.radius])[..., None] + half[..., None] * [-1.0, 1.0]
        known = np.concatenate([alone.interval("center"), alone.interval("radius")[:, None]], axis=1)
        for kind, ends, factor, stem in (("interval", known, t, ""), ("own_errors", own, quantile, "own_")):
            held = (ends[:, :, 0] <= [*center, 2.0]) & ([*center, 2.0] <= ends[:, :, 1])
            for i in range(d):
                np.testing.assert_array_equal(columns[f"{kind}_center_{i + 1}"], held[:, i])
            np.testing.assert_array_equal(columns[f"{kind}_radius"], held[:, -1])
            width = np.ptp(ends[:, -1], axis=1) / (2.0 * factor * np.sqrt(bound[:, -1, -1]))
            np.testing.assert_allclose(columns[f"{kind}_width"], width, rtol=1e-9)
            for side, word in enumerate(("low", "high")):
                np.testing.assert_allclose(columns[f"ends_{stem}{word}"], ends[:, -1, side] / 2.0, rtol=1e-9)
            assert held.any()


def index(d, radius, apart):
    """The Jaccard index of a ball and the unit ball, whose centres are apart."""
    estimates = Estimates(apart * np.eye(d)[:1], np.array([radius]), *np.zeros((4, 1)))
    samples = study.Samples(np.zeros((1, d, 4)))
    columns, raised = attempt("jaccard", samples, estimates, "als", Truth(np.zeros(d), 1.0, 0.1, np.zeros(0)))
    assert raised == {}
    return columns["jaccard_index"][0]


@pytest.mark.parametrize("d", [2, 3, 4])
@pytest.mark.parametrize(("radius", "apart"), [(1.0, 0.5), (0.7, 0.9), (2.0, 1.5), (0.4, 0.9)])
def test_jaccard_counts_points(d, radius, apart):
    """It is the share of points in both balls among those in either; 10⁵ points, 5 standard errors: 6e-7."""
    points = np.random.default_rng(d).uniform(-4.0, 4.0, (400_000, d))
    one = np.linalg.norm(points, axis=1) < 1.0
    other = np.linalg.norm(points - np.eye(d)[0] * apart, axis=1) < radius
    count, both = int((one | other).sum()), int((one & other).sum())
    expected = index(d, radius, apart)
    assert abs(both / count - expected) < 5 * math.sqrt(max(expected * (1 - expected), 1e-3) / count)


def test_jaccard_by_hand():
    """Equal balls 1, apart 0, one within the other the ratio of volumes; two unit discs 1 apart by the lens's area."""
    assert index(3, 1.0, 0.0) == pytest.approx(1.0)
    assert index(2, 1.0, 2.5) == 0.0
    assert index(3, 0.5, 0.2) == pytest.approx(1 / 8)
    assert index(2, 3.0, 1.0) == pytest.approx(1 / 9)
    lens = 2 * math.pi / 3 - math.sqrt(3) / 2
    assert index(2, 1.0, 1.0) == pytest.approx(lens / (2 * math.pi - lens))
    assert math.isnan(index(3, math.nan, 0.2))


def test_no_unit():
    """Spheres of radius 1, 4 and 40, with the same σ/r, have the same columns: the draws are shared, d = 2."""
    names = list(MEASURES)
    text = config(
        {"dimension": 2, "measures": names}, trials=50, noise_over_radius=0.05, radius=[1.0, 4.0, 40.0], center=3.0
    )
    errors = errors_of(text)
    columns = [column.name for column in parse(text).measured()]
    assert [name for name in columns if "center" in name] == [
        f"{measure}_center_{i}" for measure in ("interval", "own_errors") for i in (1, 2)
    ]
    first, *others = (part[columns].to_numpy(dtype=float) for _, part in errors.groupby("radius"))
    for other in others:
        np.testing.assert_allclose(other, first, rtol=1e-8)


def test_names_of_columns_never_meet():
    """No measure may begin as a column of the tables does, so none can take the name of one."""
    columns = [*schemas.errors(3, STORED), *schemas.summary(STORED)]
    words = {column.name.partition("_")[0] for column in columns if "_" in column.name}
    assert words == FIRST_WORDS
    assert not words & {name.partition("_")[0] for name in MEASURES}


def test_tables_without_measures_are_as_before():
    """Neither the columns nor the digests know of measures that a config has not; an empty list is none."""
    plain, empty = parse(config()), parse(config({"measures": []}))
    assert plain.digest() == empty.digest()
    assert "measures" not in plain.canonical() + plain.stem()
    assert schemas.declared(*plain.columns()) == schemas.declared(3, plain.conditions())
    measured = parse(config({"measures": ["jaccard"]}))
    assert measured.digest() != plain.digest()
    assert "jaccard@1" in measured.stem()


def test_the_run(near, start):
    """Columns are stored, summarised, verified, diffed, and equal to the byte with processes and grown from fewer."""
    top = {"estimators": ["mle", "gdke"], "measures": ["near", "jaccard"], "seed": 2}
    run, _ = start(config(top | {"estimators": ["mle"]}, trials=60, noise=0.3))
    assert run.manifest()["measures"] == {"near": measures.ORIGINS["near"].digest[:10], "jaccard": 1}
    assert run.manifest()["own_measures"][0]["measures"] == ["near"]
    grown, said = start(config(top, trials=150, noise=0.3))
    assert "are taken from" in said[0]
    other, _ = start(config(top, trials=150, noise=0.3), "processes", backend="loky")
    for table in ("errors", "summary"):
        assert grown.path(table).read_bytes() == other.path(table).read_bytes()
    assert Verification(grown, 1.0).faults == []
    errors, summary = grown.table("errors"), grown.table("summary")
    np.testing.assert_allclose(errors["near_distance"], errors["error"] / errors["radius"], rtol=1e-12)
    np.testing.assert_array_equal(errors["near_side_2"], errors["error_2"] > 0)
    for (_, fits), (_, row) in zip(errors.groupby("estimator", sort=False), summary.iterrows(), strict=True):
        held, n = fits["near_center"].sum(), len(fits)
        wider = (held + 2) / (n + 4)  # Agresti & Coull 1998
        assert row["near_center"] == held / n
        assert row["near_center_error"] == pytest.approx(math.sqrt(wider * (1 - wider) / (n + 4)))
        assert row["near_distance_mean"] == pytest.approx(fits["near_distance"].mean())
        assert row["near_distance_mean_error"] == pytest.approx(fits["near_distance"].sem())
        assert row["near_distance_median"] == pytest.approx(fits["near_distance"].median())
    same = Difference(grown, other)
    assert same.identical
    assert {"median over bound", "share of near_center", "median of near_distance"} <= set(same.comparisons["measure"])
    kept, _ = start(config(top | {"keep": "summary"}, trials=150, noise=0.3))
    pd.testing.assert_frame_equal(kept.table("summary"), summary)
    plain, _ = start(config({"estimators": ["mle"], "seed": 2}, trials=150, noise=0.3))
    assert Difference(grown, plain).verdict == "identical in the trials that both have"
    near.write_text(NEAR.replace("< 0.1", "< 0.5"))
    load(near)
    less = Difference(grown, start(config(top, trials=150, noise=0.3), "changed")[0]).comparisons
    assert set(less.loc[less["different"], "measure"]) == {"share of near_center"}
    assert set(less.loc[~less["equal"], "measure"]) == {"share of near_center"}


def test_a_measure_that_changes(near, start):
    """Changed code is known: the run is computed again, and without its file no run of it is read."""
    text = config({"measures": ["near"]}, trials=20)
    first, _ = start(text)
    near.write_text(NEAR.replace("< 0.1", "< 0.0"))
    load(near)
    again, said = start(text)
    assert not again.table("errors")["near_center"].any()
    assert not any("are taken from" in line for line in said)
    assert first.folder == again.folder


def test_a_measure_that_raises(tmp_path, start):
    """It costs the fits on which it raises, each of which is named with its cell and trial; all others are stored."""
    late = (
        "    if samples.shape[2] == 10 and (abs(samples.x[:, 0, 0]) < 0.3).any():\n        raise ValueError('near 0')\n"
    )
    (tmp_path / "my.py").write_text(NEAR.replace("    away", late + "    away"))
    load(tmp_path / "my.py")
    text = config({"estimators": ["mle", "gdke"], "measures": ["near", "jaccard"]}, trials=50, angle=180)
    run, _ = start(text)
    bad = {trial.trial for trial in all_trials(run.study) if abs(trial.samples.x[0, 0, 0]) < 0.3}
    errors, failures = run.table("errors"), run.table("failures")
    assert 0 < len(bad) < 50
    assert set(zip(failures["trial"], failures["estimator"], strict=True)) == {
        (t, e) for t in bad for e in ("mle", "gdke")
    }
    assert set(failures["message"]) == {"measure near: my.py, line 8: ValueError: near 0"}
    assert set(failures["name"]) == {f"{errors['cell'][0]}/{trial}" for trial in bad}
    lacking = errors["trial"].isin(bad)
    assert errors["near_distance"].isna().equals(lacking)
    assert not errors.loc[lacking, "near_center"].any()
    assert errors[["error", "jaccard_index"]].notna().all().all()
    assert (
        f"the first of them {failures['name'][0]} by mle: measure near: my.py, line 8: ValueError"
        in runner.failure_message(run)
    )
    assert Verification(run, 1.0).faults == []


def test_an_estimator_that_raises_is_told_first(monkeypatch):
    """A fit has one line among the failures: that of its estimator, whatever its measures do after it."""
    monkeypatch.setitem(MEASURES, "bad", measures.FitMeasure(lambda *_: 1 / 0, "Bad.", {"a": (float, "a")}))
    study.register("raises", lambda points: 1 / 0)
    try:
        made = parse(config({"estimators": ["raises", "lls"], "measures": ["bad"]}))
        result = compute(made, next(made.units()))
        messages = dict(zip(result.failures["estimator"], result.failures["message"], strict=True))
        assert len(result.failures["message"]) == 4
        assert messages["raises"].startswith("ZeroDivisionError")
        assert re.fullmatch(r"measure bad: test_measures.py, line \d+: ZeroDivisionError: .*", messages["lls"])
        assert np.isnan(lost(made, next(made.units()), "died").errors["bad_a"]).all()
    finally:
        registry.remove(["raises"])


def test_a_measure_that_writes_into_what_it_gets():
    """Errors and points are those of a study without it, to the bit, at all levels of a trial."""

    def measure(samples, fit, truth):
        """A measure, with a {brace} in its meaning."""
        fit.center[:], samples.x[:], truth.bound[:], truth.center[:] = 0.0, 1.0, 0.0, 0.0
        return {"a": fit.radius / truth.radius}

    study.register_measure("own", measure, {"a": (float, "a {brace} here")})
    top, design = {"estimators": ["mle", "gdke"], "keep_points": 3}, {"trials": 5, "noise": [0.1, 0.2], "center": 2.0}
    plain, made = parse(config(top, **design)), parse(config(top | {"measures": ["own"]}, **design))
    for unit in made.units():
        mine, other = compute(made, unit), compute(plain, unit)
        for name in ("errors", "points"):
            for column, values in getattr(other, name).items():
                np.testing.assert_array_equal(getattr(mine, name)[column], values)


REFUSED = {
    "no dictionary": (BODY.format("1", FLOAT), "returned int, expected a dictionary of a"),
    "other columns": (BODY.format("{'b': 1}", FLOAT), "returned b, expected a dictionary of a"),
    "another shape": (BODY.format("{'a': 1.0}", FLOAT), r"a has shape \(\), expected \(2,\)"),
    "no truth values": (
        BODY.format("{'a': fit.radius}", FLOAT.replace("float", "bool")),
        "a has type float64, expected bool",
    ),
    "raises": (BODY.format("1 / 0", FLOAT), "ZeroDivisionError: division by zero"),
    "no columns": (BODY.format("{}", "{}"), "columns = {}: give at least one"),
    "no meaning": (BODY.format("{}", "{'a': float}"), "column 'a' = <class 'float'>: give bool or float, and its"),
    "another type": (BODY.format("{}", "{'a': (int, 'a')}"), "give bool or float"),
    "a column's name": (BODY.format("{}", "{'A b': (bool, 'a')}"), "column 'A b': a name has lower-case"),
    "no sentence": (BODY.format("{}", FLOAT).replace("'A measure.'", "0"), "give the function a docstring"),
    "a taken name": (BODY.format("{}", FLOAT).replace("'own'", "'interval'"), "the name is taken by a shipped measure"),
    "a column's beginning": (BODY.format("{}", FLOAT).replace("'own'", "'radius'"), "the name is taken"),
}


@pytest.mark.parametrize("case", list(REFUSED))
def test_refused(tmp_path, one_line, case):
    """A file whose measure cannot be used is refused with one line, and nothing of it stays."""
    text, words = REFUSED[case]
    (tmp_path / "my.py").write_text(text)
    before = dict(MEASURES)
    with one_line(PluginError, f"my.py: .*{words}"):
        load(tmp_path / "my.py")
    assert before == MEASURES
    assert not measures.ORIGINS


def test_faults_in_a_config(near, tmp_path):
    """An unknown measure is answered with the nearest; one that the study cannot have is a fault with its line."""
    flat = BODY.format("{'a': fit.radius} if samples.shape[1] == 2 else {}", FLOAT).replace("'own'", "'flat'")
    (tmp_path / "flat.py").write_text(flat)
    load(tmp_path / "flat.py")
    for top, words in (
        ({"measures": ["intervall"]}, r"line 4: measures = .*'intervall' unknown; did you mean 'interval'\? Known are"),
        ({"measures": ["interval", "interval"]}, "given more than once"),
        (
            {"measures": ["near", "flat"]},
            r"line 4: measures: flat fails on 20 sound points: ValueError: returned no column",
        ),
        ({"measures": ["near"], "route": "moments"}, 'measures: the route "moments" forms no points'),
    ):
        with pytest.raises(ConfigError, match=words):
            parse(config(top))
    parse(config({"measures": ["near", "flat"], "dimension": 2}))


def test_two_measures_with_one_column():
    """Columns of two measures that have the same name in the tables are a fault of the config."""

    def measure(samples, fit, truth):
        """A measure."""
        return {"b_c": fit.radius, "c": fit.radius}

    study.register_measure("a", measure, {"b_c": (float, "one"), "c": (float, "another")})
    study.register_measure("a_b", measure, {"b_c": (float, "one"), "c": (float, "another")})
    with pytest.raises(ConfigError, match="two measures have a column a_b_c: leave one of them out"):
        parse(config({"measures": ["a", "a_b"]}))


def test_processes_know_no_measure_of_the_program(start):
    """A measure of the program alone is refused by processes."""

    def measure(samples, fit, truth):
        """A measure."""
        return {"a": fit.radius / truth.radius}

    study.register_measure("own", measure, {"a": (float, "radius over radius")})
    with pytest.raises(study.files.RunError, match="own: registered by this program alone, which loky workers do not"):
        start(config({"measures": ["own"]}), backend="loky")


def test_check(near, well, call_here, tmp_path):
    """The command says what a measure is, and which property it violates; code 1 then."""
    assert "near: measure. Distance of the fitted from the true centre, in radii." in well(tmp_path, "check", "my.py")
    for body, words in (
        ("{'a': fit.radius}", "own_a: depends on the unit: divide lengths by truth.radius (d = 2)"),
        ("{'a': np.random.default_rng().random(len(fit.radius))}", "own_a: another answer for the same fits (d = 3)"),
        ("{'a': fit.radius / fit.radius.mean()}", "own_a: a fit differs alone and beside others (d = 3)"),
    ):
        (tmp_path / "bad.py").write_text(BODY.format(body, FLOAT))
        code, said, _ = call_here(tmp_path, "check", "bad.py")
        assert code == 1
        assert words in said


def test_the_list_and_the_table(near, start, well, tmp_path):
    """Every measure is listed with its columns; `study summary --measure` prints one, or the nearest name."""
    said = well(tmp_path, "measures", "--plugin", "my.py")
    for name, measure in MEASURES.items():
        assert any(line.split()[0] == name and line.endswith(measure.sentence) for line in said.splitlines())
        assert all(f"  {column.name}" in said for column in measures.stored([name], 3))
    run, _ = start(config({"measures": ["near"]}, trials=80, noise=0.3))
    share = run.table("summary")["near_center"][0]
    printed = well(tmp_path, "summary", run.folder, "--measure", "near_center", "--plugin", "my.py")
    assert "share of all fits; near: within 0.1 radii" in printed
    assert f"{share:.3g} ±" in printed


def test_measures_see_a_missing_fit():
    """Of a fit without numbers nothing holds, and the widths are infinite."""
    samples = registry.sound_samples(3)
    fits = study.ESTIMATORS["als"](samples)
    fits.center[1], fits.radius[1] = np.nan, np.nan
    truth = Truth(np.zeros(3), 1.0, 0.01, np.tile(np.eye(4), (2, 1, 1)))
    samples = study.Samples(samples.x)
    columns, raised = attempt("own_errors", samples, fits, "als", truth)
    assert raised == {}
    assert not any(columns[f"own_errors_{name}"][1] for name in ("radius", "center_1", "center_2", "center_3"))
    assert np.isinf(columns["own_errors_width"][1])
    assert np.isfinite(columns["own_errors_width"][0])
