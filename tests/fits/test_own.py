"""Files of one's own estimators: what they register, and one line for each way in which they cannot be used.

`study check`: estimators that violate one property each, and the sentence about it.

A user's own estimator: with a function and a line in the registry it works like any other.
"""

import numpy as np
import pytest
from scipy.optimize import minimize

import study
from study import Status
from study.fits.check import check_estimator, printed
from study.fits.points.samples import Samples, blank
from study.fits.registry import ORIGINS, PluginError, PluginFile, load, load_text, loaded, origins, remove, unload

MEAN = "def mean(points):\n    c = points.mean(axis=0)\n    return c, np.linalg.norm(points - c, axis=1).mean()\n"


@pytest.fixture(autouse=True)
def _registry():
    """Take out what a test registered."""
    yield
    for path, _ in loaded():
        unload(path)
    remove(list(ORIGINS))


@pytest.fixture
def write_plugin(tmp_path):
    """Write a file of estimators with NumPy and the package imported on its first two lines; its path."""

    def write(text):
        path = tmp_path / "my.py"
        path.write_text(f"import numpy as np\nimport study\n{text}\n", encoding="utf-8")
        return path

    return write


def test_a_file_registers(write_plugin, rng):
    """Its estimators are called by name; batches, a noise variance and statuses come for free."""
    path = write_plugin(MEAN + "study.register('mean', mean, reference='a book')")
    assert load(path) == ("mean",)
    points = rng.standard_normal((2, 3, 30, 3))
    fit = study.fit(points, "mean")
    np.testing.assert_allclose(fit.center, points.mean(axis=2), rtol=1e-12)
    residual = np.linalg.norm(points - fit.center[:, :, None], axis=3) - fit.radius[..., None]
    np.testing.assert_allclose(fit.estimates.noise_variance, (residual**2).sum(axis=2) / 26, rtol=1e-9)
    assert np.all(fit.estimates.status == Status.OK)
    assert study.ESTIMATORS["mean"].reference == "a book"


def test_a_file_that_changed_replaces_itself(write_plugin):
    """Loading it again does nothing; once it has changed, its old estimators go, and versions differ."""
    path = write_plugin(MEAN + "study.register('mean', mean)")
    load(path)
    first = study.ESTIMATORS["mean"]
    load(path)
    assert study.ESTIMATORS["mean"] is first
    write_plugin(MEAN + "study.register('mean', mean)\nstudy.register('other', mean)")
    assert load(path) == ("mean", "other")
    assert study.ESTIMATORS["mean"].version != first.version
    write_plugin(MEAN + "study.register('other', mean)")
    load(path)
    assert "mean" not in study.ESTIMATORS
    (origin,) = origins(["als", "other"])
    assert (origin["from"], origin["estimators"], len(origin["sha256"])) == ("my.py", ["other"], 64)


def test_a_worker_loads_the_text(tmp_path):
    """The text alone is enough: the file need not be there."""
    load_text(PluginFile(str(tmp_path / "gone.py"), f"import numpy as np, study\n{MEAN}study.register('mean', mean)"))
    assert "mean" in study.ESTIMATORS
    assert [path for path, _ in loaded()] == [str(tmp_path / "gone.py")]


TAKEN = r"ValueError: register\("
REFUSED = {
    "raises": ("1 / 0", "my.py: line 3: ZeroDivisionError: division by zero"),
    "no Python": ("def f(:", "my.py: line 3: SyntaxError: invalid syntax"),
    "exit": ("raise SystemExit(3)", "my.py: line 3: SystemExit: 3"),
    "nothing": ("x = 1", r"my.py: registers nothing; it should call study.register\(name, function\)"),
    "a taken name": (
        MEAN + "study.register('als', mean)",
        rf"line 6: {TAKEN}'als'\): .* a shipped estimator; choose an",
    ),
    "its own name": (
        MEAN + 2 * "study.register('mean', mean)\n",
        rf"line 7: {TAKEN}'mean'\): .* my.py; choose another",
    ),
    "no name": (MEAN + "study.register('My Mean', mean)", "line 6: ValueError: .* lower-case letters, digits and unde"),
    "no function": ("study.register('mean', 3)", r"line 3: TypeError: register\('mean'\): int is not a function"),
    "an unknown need": (MEAN + "study.register('mean', mean, needs='luck')", "line 6: ValueError: .* needs = 'luck'"),
}
FAILING = {
    "1 / 0": "ZeroDivisionError: division by zero",
    "(x, 1.0)": r"ValueError: returned a centre of shape \(20, 3\), expected \(3,\)",
    "(x[0], x[0])": r"ValueError: returned a radius of shape \(3,\), expected one number",
    "x[0]": r"TypeError: returned ndarray of shape \(3,\), expected a centre and a radius",
    "None, batched=True": "returned NoneType, expected a ",
    "study.fits.blank(len(x.x) + 1, 3), batched=True": r"center has shape \(3, 3\), expected \(2, 3\)",
}
for answer, words in FAILING.items():
    REFUSED[answer] = f"study.register('bad', lambda x: {answer})", f"my.py: bad: fails on 20 sound points: {words}"


@pytest.mark.parametrize("case", list(REFUSED))
def test_refused(write_plugin, one_line, case):
    """One line, with the file, the line or the estimator, and the reason; nothing stays registered."""
    text, words = REFUSED[case]
    before = dict(study.ESTIMATORS)
    with one_line(PluginError, words):
        load(write_plugin(text))
    assert before == study.ESTIMATORS
    assert not ORIGINS


def test_a_file_that_is_not_there(tmp_path):
    """So is a file that cannot be read."""
    with pytest.raises(PluginError, match=r"none.py: cannot be read: No such file or directory"):
        load(tmp_path / "none.py")


def test_what_goes_wrong_on_data_is_a_status(rng):
    """An exception is a failed fit, a number that is not finite one without a sphere; huge points are not passed on."""

    def picky(points):
        assert np.all(np.isfinite(points))
        if points[0, 0] > 0:
            raise ArithmeticError("no\nno")
        return points[0], np.nan

    study.register("picky", picky)
    points = rng.standard_normal((3, 9, 2))
    points[0, 0, 0], points[1, 0, 0], points[2, 0, 0] = 1.0, -1.0, 1e200
    fit = study.fit(points, "picky")
    assert fit.status.tolist() == [Status.FAILED, Status.SINGULAR, Status.NOT_FINITE]
    assert np.all(np.isnan(fit.radius))
    study.register("needy", lambda points, noise: (points[0], noise), needs="noise")
    with pytest.raises(ValueError, match="noise = None: this estimator needs the standard deviation"):
        study.fit(points, "needy")


def test_the_noise_is_passed_on(rng):
    """An estimator that needs it has σ, or the covariance, as its second argument; each set its own."""
    seen = []

    def needy(points, noise):
        seen.append(noise)
        points[:] = 0.0  # its own copy
        return points[0], 1.0

    study.register("needy", needy, needs="noise")
    points = rng.standard_normal((2, 9, 2))
    before = points.copy()
    study.fit(points, "needy", 0.3)
    study.ESTIMATORS["needy"](study.Samples(points.swapaxes(1, 2), np.array([0.1, 0.2])))
    study.fit(points[0], "needy", [[1.0, 0.0], [0.0, 4.0]])
    assert seen[:4] == [0.3, 0.3, 0.1, 0.2]
    np.testing.assert_array_equal(seen[4], [[1.0, 0.0], [0.0, 4.0]])
    np.testing.assert_array_equal(points, before)


def test_a_notebook_may_register_again():
    """A cell that is executed twice replaces its estimator; it has no place in worker processes."""
    for radius in (1.0, 2.0):
        study.register("mean", lambda points, radius=radius: (points.mean(axis=0), radius))
    assert study.fit(np.eye(4, 3), "mean").radius == 2.0


class Point:
    """An entry point of a package that is not installed."""

    dist, value = None, "package:f"

    def __init__(self, name, content):
        self.name, self.content = name, content

    def load(self):
        """The object, or its exception."""
        if isinstance(self.content, Exception):
            raise self.content
        return self.content


def test_installed_packages(monkeypatch):
    """Functions and estimators of packages are registered; one that cannot be loaded costs a warning, and no other."""
    from study.fits import registry

    points = [
        Point("bad", ImportError("no such thing")),
        Point("als", lambda points: (points[0], 1.0)),
        Point("first", lambda points: (points[0], 1.0)),
        Point("second", study.Estimator(study.ESTIMATORS["gdke"].function, "a book")),
    ]
    monkeypatch.setattr(registry, "entry_points", lambda group: points)
    with pytest.warns(UserWarning, match="is left out") as warned:
        registry.load_installed()
    taken = "register('als'): the name is taken by a shipped estimator; choose another"
    reasons = {"bad": "ImportError: no such thing", "als": f"ValueError: {taken}"}
    told = [f"estimator '{name}' of package:f is left out: {reason}" for name, reason in reasons.items()]
    assert [str(w.message) for w in warned] == told
    assert set(ORIGINS) == {"first", "second"}
    assert study.fit(np.eye(4, 3), "first").radius == 1.0


def sound(points):
    """Coope's fit, which has all properties: |x|² = 2c·x + k in least squares."""
    matrix = np.column_stack([2.0 * points, np.ones(len(points))])
    *center, k = np.linalg.lstsq(matrix, (points**2).sum(axis=1), rcond=None)[0]
    return np.array(center), np.sqrt(k + np.dot(center, center))


def coope(samples):
    """The same of a batch, without any care."""
    result = blank(samples.shape[0], samples.shape[1])
    for t, x in enumerate(samples.points):
        result.center[t], result.radius[t] = sound(x) if np.all(np.abs(x) < 1e50) else (np.nan, np.nan)
    result.noise_variance[:] = 0.0
    return result


def along_an_axis(c, r, x):
    """Noisy along the axes: the range of the residuals along the first one."""
    return c + np.ptp(np.linalg.norm(x - c, axis=1)) * np.eye(len(c))[0], r


def raising(fit, samples):
    """Raises where points are not finite."""
    if not np.all(np.isfinite(samples.points)):
        raise FloatingPointError("infinite")


def touching(fit, samples):
    """Changes the points."""
    samples.x[:, 0, 0] += 1.0


def negative(fit, samples):
    """A noise variance below 0."""
    fit.noise_variance[:] = -1.0


def neighbour(fit, samples):
    """Depends on the number of sets."""
    fit.radius[:] *= 1.0 + 0.001 * (len(fit.radius) - 1)


POINTWISE = {
    "larger": (
        lambda c, r, x: (c, 1.02 * r),
        "not exact without noise: the radius is 1.02 instead of 1 (d = 2, N = 7, ",
    ),
    "metric": (
        lambda c, r, x: (c, min(r, 100.0)),
        "depends on the unit of length: all lengths times 1000: the radius is 100 instead of ",
    ),
    "drunk": (
        lambda c, r, x: (c, r * (1.0 + 1e-9 * np.random.default_rng().random())),
        "another answer for the same points: use no random numbers but those of a fixed seed (d = 2, N = 7, seed 0)",
    ),
    "first": (
        lambda c, r, x: sound(np.vstack([x[:1], x])),
        "depends on the order of the samples: in another order: the ",
    ),
    "pulled": (
        lambda c, r, x: (c * (1.0 - 0.1 * np.exp(-np.linalg.norm(c))) if np.linalg.norm(c) < 1e9 else c, r),
        "does not move with the points: shifted by ",
    ),
    "axes": (along_an_axis, "does not rotate with the points: rotated: the centre is "),
}
BATCHED = {
    negative: "the noise variance is -1, and should not be negative (d = 2, N = 7, seed 0)",
    neighbour: "differs in a batch: fitted alone and beside other sets: the radius is ",
    touching: "changes the points that it is given (d = 2, N = 7, seed 0)",
    raising: "raises on a point at infinity: FloatingPointError: infinite (d = 2)",
}


def report(function, batched=False, budget=1e9):
    """The lines that `study check` prints on a function."""
    study.register("mine", function, batched=batched)
    return list(printed([check_estimator("mine", budget=budget)]))


def test_a_sound_estimator():
    """Without violations there is one line, with the numbers of properties and data sets; without time that is said."""
    assert report(sound) == ["mine: all 9 properties hold on 12 data sets"]
    assert "the estimator is slow" in report(sound, budget=0.0)[-1]


@pytest.mark.parametrize("case", POINTWISE)
def test_a_violation_in_words(case):
    """The property that is violated is said in words, with the first data set that violates it."""
    change, words = POINTWISE[case]
    lines = report(lambda points: change(*sound(points), points))
    assert any(line.startswith(f"mine: {words}") for line in lines), lines


@pytest.mark.parametrize("change", BATCHED, ids=lambda change: change.__name__)
def test_a_violation_of_a_batch_in_words(change):
    """So are properties of a batch."""

    def function(samples):
        fit = coope(samples)
        change(fit, samples)
        return fit

    lines = report(function, batched=True)
    assert any(line.startswith(f"mine: {BATCHED[change]}") for line in lines), lines


def test_circles_alone():
    """An estimator of circles is checked in the plane; the rest is left out, with the reason."""

    def circle(points):
        if points.shape[1] != 2:
            raise ValueError("circles only")
        return sound(points)

    left_out = "mine: d = 3 is left out: ValueError: circles only"
    assert report(circle) == ["mine: all 9 properties hold on 6 data sets", left_out]


def test_shipped_estimators_pass():
    """The checks ask nothing that the shipped closed forms do not have."""
    for name in ("als", "gdke", "taubin"):
        assert check_estimator(name, budget=1e9).violations == ()


@pytest.mark.parametrize("d", [2, 3, pytest.param(5, marks=pytest.mark.plain)])
def test_through_the_library(rng, on_cap, d):
    """`study.fit` calls it by name, and adds batches, missing samples and errors, which it does not handle itself."""
    study.register("coope", coope, batched=True)
    points = on_cap(rng, 30, 100.0, d, 0.02, radius=2.0, center=1.0, sets=6)[0].reshape(2, 3, 30, d)
    points[1, 2, :4, 0] = np.nan
    mine, theirs = (study.fit(points, name, noise=0.02) for name in ("coope", "gdke"))
    np.testing.assert_allclose(mine.center, theirs.center, rtol=0, atol=1e-10)
    np.testing.assert_allclose(mine.radius, theirs.radius, rtol=0, atol=1e-10)
    np.testing.assert_allclose(mine.covariance, theirs.covariance, rtol=1e-8, atol=1e-14)
    np.testing.assert_allclose(mine.residual_rms, theirs.residual_rms, rtol=1e-8)
    np.testing.assert_array_equal(mine.count, theirs.count)
    assert np.all(mine.estimates.status == Status.OK)


@pytest.mark.parametrize("kappa", [0.0, 2.0])
def test_em_given_the_law_of_directions(rng, kappa):
    """It is the maximum of the likelihood of x = c + r u + σz, with ∫ exp(n·u) du = 4π sinh|n|/|n| over the directions.

    n = κμ + r (x - c)/σ²: the integral is that of a von Mises-Fisher law, in three dimensions.
    """
    import em_vmf

    mu, n = em_vmf.DIRECTION, 60
    points, truth = em_vmf.published_points(rng, kappa, 0.1, sets=1)
    x = points[0, :n]

    def cost(values):
        center, radius, variance = values[:3], values[3], np.exp(values[4])
        away = x - center
        size = np.linalg.norm(kappa * mu + radius * away / variance, axis=1)
        log_integral = size + np.log1p(-np.exp(-2.0 * size)) - np.log(size)
        squares = ((away**2).sum(axis=1) + radius**2) / (2.0 * variance)
        return (squares - log_integral).sum() + 1.5 * n * values[4]

    start = np.append(truth[0], np.log(0.1))
    best = minimize(cost, start, method="Nelder-Mead", options={"xatol": 1e-7, "fatol": 1e-10, "maxiter": 20_000}).x
    (found,) = np.column_stack(em_vmf.given(kappa)(Samples(np.ascontiguousarray(x.T[None])))[:3])
    assert np.append(found[:4], np.log(found[4])) == pytest.approx(best, abs=1e-5)
