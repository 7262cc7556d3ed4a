"""Laws of one's own: registered by a file or a program, drawn from streams of their own, and known by their code."""

import numpy as np
import pytest
from scipy import stats

import study
from study.files import RunError
from study.fits import registry
from study.fits.registry import PluginError, load
from study.simulation.analysis.summary import chosen_rows, printed
from study.simulation.experiment import laws
from study.simulation.experiment.compute import compute
from study.simulation.experiment.config import parse
from study.simulation.experiment.replay import all_trials
from study.simulation.runs import runner
from study.simulation.runs.run_folder import Run
from study.simulation.runs.workers import Workers
from study.toml import ConfigError
from tests.configs import config

pytestmark = pytest.mark.usefixtures("forgotten")
VON_MISES = """
import numpy as np
import study

def von_mises(trial, kappa):
    "Directions of a von Mises-Fisher law about the axis, in space."
    if kappa <= 0:
        raise ValueError("kappa must be above 0")
    n, d = trial.values.shape
    along = 1 + np.log(1 - trial.rng.random(n) * (1 - np.exp(-2 * kappa))) / kappa
    turn = trial.rng.uniform(0, 2 * np.pi, n)
    across = np.sqrt(1 - along**2)
    if d != 3:
        raise ValueError("in space alone")
    return np.column_stack([along, across * np.cos(turn), across * np.sin(turn)])

study.register_law("von_mises", von_mises, "directions", example=[2.0])
"""
BODY = (
    "import numpy as np\nimport study\ndef f(trial):\n    'A law.'\n    return {}\nstudy.register_law('own', f, {!r})\n"
)


@pytest.fixture
def von_mises(tmp_path):
    """A file with a law of directions, which is loaded."""
    path = tmp_path / "my.py"
    path.write_text(VON_MISES)
    assert load(path) == ()
    return path


def own(function, kind, name="own", **given):
    """Register a function with a sentence."""
    function.__doc__ = "A law."
    study.register_law(name, function, kind, **given)


def errors_of(text):
    """Errors of a study, unit by unit."""
    made = parse(text)
    parts = [compute(made, unit).errors for unit in made.units()]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def test_directions_have_the_law(von_mises):
    """The first coordinate has the distribution function (e^κw - e^-κ)/(e^κ - e^-κ), the others are uniform about it.

    Kolmogorov and Smirnov's test of 20,000 directions, p > 1e-6 each.
    """
    made = parse(config(trials=100, samples=200, angle=180, noise=1e-9, directions="von_mises(2)"))
    u = np.concatenate([trial.samples.points[0] for trial in all_trials(made)])
    assert stats.kstest(u[:, 0], lambda w: (np.exp(2 * w) - np.exp(-2)) / (np.exp(2) - np.exp(-2))).pvalue > 1e-6
    assert stats.kstest(np.arctan2(u[:, 2], u[:, 1]), "uniform", (-np.pi, 2 * np.pi)).pvalue > 1e-6


def test_no_other_number_changes(von_mises):
    """Cells by area have the rows of a study without the law, to the bit; its own levels share their random numbers."""
    plain = errors_of(config(trials=20))
    mixed = errors_of(config(trials=20, directions=["area", "von_mises(2)", "von_mises(8)"]))
    for name in ("error", "bound", "radius_error"):
        np.testing.assert_array_equal(mixed[name][mixed["directions"] == "area"], plain[name])
    assert len(np.unique(mixed["error"])) == 60


@pytest.mark.parametrize("kind", list(laws.PLAIN))
def test_a_law_that_changes_nothing(kind):
    """Values that are returned as they came make the fits of a study without the law; displacements are in σ."""
    condition = {"noise": "law", "directions": "directions", "outliers": "outlier_law", "coordinates": "coordinates"}
    own(lambda trial: trial.values if kind != "outliers" else np.zeros_like(trial.values), kind)
    design = {"trials": 20, "center": 3.0, "radius": 2.0} | ({"outlier_share": 0.5} if kind == "outliers" else {})
    plain, same = (
        errors_of(config(trials=20, center=3.0, radius=2.0)),
        errors_of(config(**design, **{condition[kind]: "own"})),
    )
    if kind == "directions":  # which have draws of their own
        assert np.median(same["error"] / same["bound"]) == pytest.approx(
            np.median(plain["error"] / plain["bound"]), rel=0.5
        )
    else:
        np.testing.assert_allclose(same["error"], plain["error"], rtol=1e-9)


def test_a_shipped_law_written_by_a_user():
    """Radial noise, as a law of one's own, has the errors of the shipped one to rounding; so have its outliers."""

    def along(trial):
        return (trial.values * trial.directions).sum(axis=1, keepdims=True) * trial.directions

    own(along, "noise")
    mixed = errors_of(config(trials=20, law=["radial", "own"]))
    np.testing.assert_allclose(*(mixed["error"][mixed["law"] == word] for word in ("radial", "own")), rtol=1e-9)
    own(lambda trial, size: size * trial.directions, "outliers", "outwards", example=[3.0])
    text = config(trials=5, samples=400, noise=0.1, outlier_share=0.5, outlier_law="outwards(7)", angle=180)
    for trial in all_trials(parse(text)):
        distance = np.linalg.norm(trial.samples.points[0], axis=1)
        assert stats.binomtest(int((distance > 1.35).sum()), 400).pvalue > 1e-6


def test_a_trial_is_drawn_again(von_mises):
    """Replayed alone, a trial has the points that it has among others, to the bit."""
    made = parse(config({"keep_points": 99}, trials=7, samples=12, directions="von_mises(2)"))
    for unit in made.units():
        columns = compute(made, unit).points
        for trial in all_trials(made):
            kept = np.stack([columns[f"x_{i + 1}"][columns["trial"] == trial.trial] for i in range(3)], axis=-1)
            np.testing.assert_array_equal(trial.samples.points[0], kept)


def test_a_file_that_changes(von_mises, tmp_path):
    """The same law's rows are taken from an earlier run, and those of changed code are computed anew.

    The manifest names the file and its digest, and processes have the bytes of threads.
    """

    def run(trials, folder, **workers):
        text = config(trials=trials, directions=["area", "von_mises(2)"])
        made, said = parse(text), []
        folder = tmp_path / folder / made.run_name()
        return runner.run(made, text, folder, Workers(**workers), warn=said.append), said

    first, _ = run(10, "a")
    (origin,) = first.manifest()["own_laws"]
    assert (origin["from"], origin["laws"]) == ("my.py", ["von_mises"])
    grown, said = run(20, "a")
    assert "are taken from" in said[0]
    other, _ = run(20, "b", backend="loky")
    assert grown.path("errors").read_bytes() == other.path("errors").read_bytes()
    before = grown.table("errors")
    von_mises.write_text(VON_MISES.replace("random(n)", "random(n) ** 2"))
    load(von_mises)
    again, said = run(20, "a")
    assert not any("are taken from" in line for line in said)
    after = again.table("errors")
    area = (after["directions"] == "area").to_numpy()
    assert np.array_equal(after["error"] == before["error"], area)
    registry.unload(str(von_mises))
    with pytest.raises(RunError, match=r"was made with estimators, laws or measures of my\.py: give --plugin my\.py$"):
        Run.open(again.folder)


REFUSED = {
    "another shape": (BODY.format("trial.values[0]", "noise"), r"returned shape \(3,\), expected \(20, 3\)"),
    "not a number": (BODY.format("np.nan * trial.values", "noise"), "returned a number that is not finite"),
    "no direction": (BODY.format("2 * trial.values", "directions"), "whose length differs from 1 by 1$"),
    "raises": (BODY.format("1 / 0", "outliers"), "ZeroDivisionError: division by zero"),
    "no kind": (BODY.format("0", "radius"), "kind = 'radius': must be noise, directions, outliers, coordinates"),
    "no sentence": (BODY.format("0", "noise").replace("'A law.'", "0"), "give the function a docstring"),
    "a taken name": (BODY.format("0", "noise").replace("'own'", "'student'"), "the name is taken by a shipped law"),
    "a plain name": (BODY.format("0", "noise").replace("'own'", "'area'"), "the name is taken by a shipped law"),
    "no example": (BODY.format("0", "noise").replace("(trial)", "(trial, size)"), "give a number for each of size"),
}


@pytest.mark.parametrize("case", list(REFUSED))
def test_refused(tmp_path, one_line, case):
    """A file whose law cannot be used is refused with one line, and nothing of it stays."""
    text, words = REFUSED[case]
    (tmp_path / "my.py").write_text(text)
    before = dict(laws.LAWS)
    with one_line(PluginError, f"my.py: .*{words}"):
        load(tmp_path / "my.py")
    assert before == laws.LAWS
    assert not laws.ORIGINS


def test_faults_in_a_config(von_mises):
    """Numbers that a law refuses, and a dimension in which it raises, are faults of the config, with their line."""
    for given, words in (
        (
            config(directions="von_mises(-1)"),
            r"line 10: design.directions = .* sound trials: my.py, line 8: ValueError: kappa must be",
        ),
        (config({"dimension": 2}, directions="von_mises(2)"), "ValueError: in space alone"),
        (
            config(directions="von_mises"),
            r"every value must be area; polar; .*von_mises\(kappa\), such as von_mises\(2\)",
        ),
        (config(law="von_mises(2)"), "'von_mises\\(2\\)' not allowed: every value must be normal"),
    ):
        with pytest.raises(ConfigError, match=words):
            parse(given)


def test_a_law_that_fails_in_a_run(tmp_path):
    """One line names the law and what it did; a law of the program alone is refused by processes."""

    def late(trial):
        return trial.values if len(trial.values) == 20 else trial.values[:1]

    own(late, "noise")
    text = config(law="own")
    with pytest.raises(RunError, match=r"law own: returned shape \(1, 3\), expected \(10, 3\): a row for each sample"):
        runner.run(parse(text), text, tmp_path / "run", 1)
    with pytest.raises(RunError, match="own: registered by this program alone, which loky workers do not know"):
        runner.run(parse(text), text, tmp_path / "other", Workers("loky"))


def test_check(von_mises, well, call_here, tmp_path):
    """The command says what a law is and its moments, and which property it violates; code 1 then.

    The mean of the first coordinate is coth κ - 1/κ = 0.537 in theory, within 5 standard errors of 10,000 draws.
    """
    said = well(tmp_path, "check", "my.py")
    assert "von_mises(2): directions. Directions of a von Mises-Fisher law about the axis, in space." in said
    assert "d = 2 is left out: my.py, line " in said
    assert "ValueError: in space alone" in said
    mean = float(said.splitlines()[-1].split("each coordinate ")[1].split()[0])
    assert abs(mean - (1 / np.tanh(2) - 0.5)) < 5 * 0.42 / np.sqrt(10_000)
    for d, other in ((2, 3), (3, 2)):
        answer = "np.random.default_rng().random(trial.values.shape)"
        body = f"{answer} if trial.values.shape[1] == {d} else 1 / 0"
        (tmp_path / "bad.py").write_text(BODY.format(body, "noise"))
        code, said, _ = call_here(tmp_path, "check", "bad.py")
        assert code == 1
        assert f"own: another answer for the same trial (d = {d}): take random numbers from trial.rng" in said
        assert f"d = {other} is left out: bad.py, line 5: ZeroDivisionError" in said


@pytest.mark.parametrize("law", ["spaced", "path"])
def test_laws_of_few_dimensions(law):
    """Even directions and paths are known on circles and spheres, and on no others."""
    for d in (2, 3):
        parse(config({"dimension": d}, directions=law))
    with pytest.raises(ConfigError, match="spaced and path are directions of circles and spheres, not of dimension 4"):
        parse(config({"dimension": 4}, directions=law))


def test_check_shows_what_coordinates_hide(well, tmp_path):
    """Noise along the radius that is not centred: its coordinates average to zero, its distances do not.

    Rayleigh's law has the mean √(π/2) = 1.253 and the standard deviation 0.655; within 5 errors of 4,000 draws.
    """
    text = "import numpy as np\nimport study\n\n\ndef off(trial):\n"
    text += (
        "    'Rayleigh noise.'\n    return trial.rng.rayleigh(size=len(trial.values))[:, None] * trial.directions\n\n\n"
    )
    (tmp_path / "off.py").write_text(text + "study.register_law('off', off, 'noise')\n", encoding="utf-8")
    for line in well(tmp_path, "check", "off.py").splitlines()[1:]:
        mean, spread = map(float, line.split("along the radius ")[1].split(" ± "))
        assert abs(mean - np.sqrt(np.pi / 2)) < 5 * 0.655 / np.sqrt(4000)
        assert abs(spread - np.sqrt(2 - np.pi / 2)) < 0.05


def test_the_list(well, tmp_path):
    """Every law stands there with its kind and its sentence."""
    said = well(tmp_path, "laws")
    for name, law in laws.LAWS.items():
        assert any(line.split()[0].startswith(name) or law.sentence in line for line in said.splitlines())
        assert law.sentence in said


def test_words_that_are_laws():
    """A number has one way of writing and lies within its law's limits, which the message about the kind names."""
    well = ["student(2.5)", "student(1e+06)", "rim(0.1)", "memory(0.5)", "form(0.4, 1)", "laplace"]
    ill = [
        "student(2)",
        "student(5.0)",
        "student",
        "student(5, 5)",
        "student()",
        "student(1e6)",
        "laplace(1)",
        "rim(0)",
    ]
    ill += ["rim(-1)", "memory(0)", "memory(1)", "memory(1.5)", "form(0.4,1)", "form(0.4)", "form(0, 1)", "form(1, 0)"]
    ill += ["polar", "Student(5)", "rim(1e)", "rim(nan)", "rim(inf)", "student(5) ", "area", ""]
    assert [word for word in (*well, *ill) if laws.is_law("noise", word)] == well
    assert laws.is_law("noise", "normal")
    assert laws.law_of("noise", "form(0.4, 1)") == (laws.LAWS["form"], [0.4, 1.0])
    assert laws.rule("noise") == (
        "normal; laplace; uniform; student(freedom) with freedom above 2, such as student(5); radial; rim(growth), "
        "such as rim(4); memory(correlation) with correlation below 1, such as memory(0.9) or form(length, size), "
        "such as form(0.4, 1)"
    )
    assert laws.rule("directions") == "area, polar, spaced or path"
    assert [laws.freedom(word) for word in ("student(3)", "student(2)", "laplace", "normal")] == [3.0, None, None, None]
    kurtosis = {"laplace": 3.0, "uniform": -1.2, "normal": 0.0, "student(4)": np.inf, "student(3)": np.inf}
    kurtosis |= {f"student({nu})": float(stats.t(nu).stats("k")) for nu in (5, 10, 4.5)}
    for word, value in kurtosis.items():
        assert laws.excess_kurtosis(word) == pytest.approx(value, rel=1e-12), word
        assert laws.has_equal_covariance(word)
    assert not any(map(laws.has_equal_covariance, ("radial", "rim(4)", "memory(0.9)", "form(0.4, 1)")))


def test_what_a_law_sees():
    """Rows are samples, turned back in the end; a trial's random numbers are its own, alone and beside others."""
    seen = []

    def look(trial, shift):
        seen.append(trial)
        first = trial.values[:, 0]
        return np.column_stack([first, np.sqrt(1.0 - first**2), 0.0 * first]) * (shift == 1.0)

    own(look, "directions", "looks", example=[1.0])
    seen.clear()
    trials = laws.sound_trials(3)
    answer = laws.LAWS["looks"].function(trials, 1.0)
    assert [trial.values.shape for trial in seen] == [(20, 3)] * 3
    assert len({trial.rng.random() for trial in seen}) == 3
    for t, trial in enumerate(seen):
        np.testing.assert_array_equal(trial.values, trials.directions[t].T)
        np.testing.assert_array_equal(answer[t, 0], 1.0 - trial.values[:, 0])
        np.testing.assert_array_equal(answer[t, 1], np.sqrt(1.0 - trial.values[:, 0] ** 2))
        assert trial.half_angle == np.pi
    with pytest.raises(RunError, match=r"law looks\(0\): returned directions whose length differs from 1 by 1$"):
        laws.LAWS["looks"].function(trials, 0.0)


def test_values_with_commas(make_run):
    """`--where` takes a law of two numbers; the legend says what a condition is that is called as its symbol."""
    run = make_run(config(trials=2, law=["normal", "form(0.4, 1)"], angle=[60, 90], directions=["area", "polar"]))
    chosen = chosen_rows(run, ["law=form(0.4, 1),angle=60"])
    assert (len(chosen), set(chosen["law"])) == (2, {"form(0.4, 1)"})
    assert "directions: law of the directions" in "\n".join(printed(run, chosen))
