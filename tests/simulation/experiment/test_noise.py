"""Noise that is not normal: each law has its distribution and the covariance I, outliers their share, size and way.

Every Gaussian law: its draws have its covariance, estimators get it in the right form, and its bound holds.
"""

import mpmath
import numpy as np
import pytest
from scipy import stats
from scipy.spatial.distance import pdist, squareform

from study.fits import fit
from study.fits.loops.random import lanes
from study.fits.points import cap
from study.simulation.experiment import laws
from study.simulation.experiment.compute import Draws, compute, draw
from study.simulation.experiment.designs import Batch, Group
from study.simulation.experiment.laws import LAWS, cell_noise, changed, freedom, has_equal_covariance, is_law
from study.simulation.experiment.noise import GaussianNoise, Trials, gaussian
from study.simulation.experiment.replay import all_trials
from study.simulation.runs import schemas
from tests.configs import uniform

MARGINALS = {
    "student(3)": stats.t(3, scale=np.sqrt(1 / 3)),
    "student(5)": stats.t(5, scale=np.sqrt(3 / 5)),
    "student(12.5)": stats.t(12.5, scale=np.sqrt(10.5 / 12.5)),
    "laplace": stats.laplace(scale=np.sqrt(1 / 2)),
    "uniform": stats.uniform(-np.sqrt(3), 2 * np.sqrt(3)),
}
"""The distribution of a coordinate at σ = 1, by textbooks: variance 1."""
WITH_DIRECTION = {"radial", "rim", "memory", "form"}
"""Laws in which a sample's noise depends on its direction or on its neighbours."""

MIXED = {"law": ["normal", "student(3)", "laplace"], "outlier_share": [0.0, 0.2], "noise": [0.1, 0.2]}


def numbers_of(seed, first, last):
    """Further random numbers of the trials from first to before last of a block of eight."""
    return Draws(Batch(Group(("test",), 8, ()), first, last), seed, None, None, None).further


def drawn(conditions, d=3, n=40_000, trials=2):
    """Normal noise, and what the conditions make of it (trials, d, n)."""
    normals = np.random.default_rng(20260).standard_normal((trials, d, n))
    return normals, cell_noise(Trials(normals, np.zeros_like(normals), np.pi, numbers_of(8, 0, trials)), conditions)


def test_every_law_is_tested():
    """The laws of covariance σ² I are those above; the others depend on the direction or on neighbours."""
    stated = {word.partition("(")[0] for word in MARGINALS} | WITH_DIRECTION
    known = {name for name, law in LAWS.items() if law.kind == laws.NOISE}
    assert stated == known, "a law has its distribution in MARGINALS, or its name in WITH_DIRECTION"
    assert all(map(has_equal_covariance, MARGINALS))
    assert not any(map(has_equal_covariance, ["radial", "rim(3)", "memory(0.9)", "form(0.4, 1)"]))


@pytest.mark.parametrize("law", MARGINALS)
def test_a_coordinate_has_the_law(law):
    """Kolmogorov and Smirnov's test of 80 000 coordinates, at a false alarm rate of 1e-6 for each axis and law.

    Mean and covariance of the samples are 0 and I, within 5 standard errors (false alarm below 1e-5 a law). Student's
    law of ν = 3 has no fourth moment, so that a covariance has no standard error: its marginal and its radial law are
    tested instead.
    """
    assert MARGINALS[law].var() == pytest.approx(1.0, rel=1e-12)
    assert law == "student(3)" or laws.excess_kurtosis(law) == pytest.approx(MARGINALS[law].stats("k"))
    noise = np.concatenate(list(drawn({"law": law})[1]), axis=1)
    for axis in range(3):
        assert stats.kstest(noise[axis], MARGINALS[law].cdf).pvalue > 1e-6
    assert np.all(np.abs(noise.mean(axis=1)) < 5 / np.sqrt(noise.shape[1]))
    if law != "student(3)":
        assert_second_moments(noise, np.eye(3))


def assert_second_moments(vectors, expected):
    """Second moments of vectors (d, n) are those expected, within 5 standard errors."""
    products = vectors[:, None] * vectors[None]
    error = products.std(axis=2) / np.sqrt(vectors.shape[1])
    assert np.all(np.abs(products.mean(axis=2) - expected) < 5 * error)


@pytest.mark.parametrize("d", [2, 3, 5])
def test_student_is_the_same_in_every_direction(d):
    """|z|²/d, rescaled by ν/(ν - 2), has Fisher's F distribution of d and ν degrees of freedom (p > 1e-6)."""
    _, noise = drawn({"law": "student(5)"}, d=d)
    square = (noise**2).sum(axis=1).ravel() / d * 5 / 3
    assert stats.kstest(square, stats.f(d, 5).cdf).pvalue > 1e-6


def test_transforms_are_quantiles():
    """Laplace and uniform numbers are the normal ones' quantiles, by SciPy's distributions, also far in the tails."""
    z = np.linspace(0.0, 35.0, 71)[None, None]
    for law in ("laplace", "uniform"):
        expected = MARGINALS[law].isf(stats.norm.sf(z))
        upper, lower = (changed(laws.NOISE, law, Trials(values, z, np.pi, None)) for values in (z, -z))
        np.testing.assert_allclose(upper, expected, rtol=1e-12, atol=1e-15)
        np.testing.assert_array_equal(lower, -upper)


def test_outliers():
    """Their number is binomial (p > 1e-6), their displacement as long as said, its direction uniform; others stay.

    The mean direction and its second moments I/d are within 5 standard errors of those of the uniform law.
    """
    normals, noise = drawn({"outlier_share": 0.1, "outlier_size": 7.0})
    away = np.concatenate(list(noise - normals), axis=1)
    length = np.linalg.norm(away, axis=0)
    hit = length > 0
    assert stats.binomtest(int(hit.sum()), hit.size, 0.1).pvalue > 1e-6
    np.testing.assert_allclose(length[hit], 7.0, rtol=1e-12)
    direction = away[:, hit] / 7.0
    assert np.all(np.abs(direction.mean(axis=1)) < 5 * np.sqrt(1 / 3 / hit.sum()))
    assert_second_moments(direction, np.eye(3) / 3)


def test_outliers_of_a_smaller_share_are_among_those_of_a_larger_one():
    """Shares and sizes have common random numbers: displaced in the same direction, by the size in question."""
    few, many = (drawn({"outlier_share": share, "outlier_size": size}) for share, size in ((0.05, 10.0), (0.3, 5.0)))
    short, long = many[1] - many[0], few[1] - few[0]
    hit = np.broadcast_to((long != 0).any(axis=1, keepdims=True), long.shape)
    np.testing.assert_allclose(long[hit], 2 * short[hit], rtol=0, atol=1e-13)
    assert (short != 0).sum() > 5 * (long != 0).sum()


def test_outliers_along_the_radius():
    """Displacements are along u, inwards in half of the samples, as long as a uniform number (p > 1e-6).

    The outliers are those that any other law of them has.
    """
    u = placed("area", angle=np.pi)
    normals = np.random.default_rng(3).standard_normal(u.shape)
    heights = u.copy()
    heights[:, 0] = 1.0 - u[:, 0]
    trials = Trials(normals, heights, np.pi, numbers_of(8, 0, 2))
    away = cell_noise(trials, {"outlier_share": 0.2, "outlier_law": "along_radius(5, 20)"}) - normals
    usual = cell_noise(trials, {"outlier_share": 0.2}) - normals
    hit = (away != 0).any(axis=1)
    np.testing.assert_array_equal(hit, (usual != 0).any(axis=1))
    along = (away * u).sum(axis=1)
    np.testing.assert_allclose(away, along[:, None] * u, atol=1e-12)
    assert stats.kstest(np.abs(along[hit]), "uniform", (5.0, 15.0)).pvalue > 1e-6
    assert stats.binomtest(int((along[hit] > 0).sum()), int(hit.sum())).pvalue > 1e-6
    np.testing.assert_array_equal(
        cell_noise(trials, {"outlier_share": 0.2, "outlier_law": "any_direction(10)"}), usual + normals
    )


def test_rounded_coordinates(make_study):
    """Points differ by whole steps of the grid, the error is uniform in a step (p > 1e-6); the grid's place is random.

    With no noise to speak of, each coordinate is rounded by at most half a step of 0.25 r.
    """
    design = {"trials": 40, "samples": 500, "radius": 2.0, "center": 3.0, "noise": 1e-9}
    exact, rounded = (
        [trial.samples.points[0] for trial in all_trials(make_study(**design, coordinates=word))]
        for word in ("exact", "rounded(0.25)")
    )
    for points in rounded:
        steps = (points - points[0]) / 0.5
        np.testing.assert_allclose(steps, np.round(steps), atol=1e-12)
    error = (np.array(rounded) - np.array(exact)) / 0.5
    assert np.abs(error).max() <= 0.5 + 1e-8
    assert stats.kstest(error[:, 0].ravel() + 0.5, "uniform").pvalue > 1e-6
    places = np.array(rounded)[:, 0] % 0.5
    assert len(np.unique(places.round(9))) > 100


def test_both():
    """Outliers of noise of another law: displaced from where that law put the sample."""
    _, laplace = drawn({"law": "laplace"})
    _, both = drawn({"law": "laplace", "outlier_share": 0.5})
    length = np.linalg.norm(both - laplace, axis=1)
    np.testing.assert_allclose(length[length > 1e-9], 10.0, rtol=1e-12)


def test_names_of_laws():
    """A law has one name; what is none, or has no covariance, is refused."""
    assert freedom("student(2.5)") == 2.5
    known = ["normal", *MARGINALS, "radial", "rim(3)", "rim(0.5)", "memory(0.9)", "form(0.4, 1)", "form(1e-05, 20)"]
    assert all(is_law(laws.NOISE, word) for word in known)
    assert not any(is_law(laws.DIRECTIONS, word) for word in known)
    for words in (
        ("student", "student()", "student(2)", "student(5.0)", "student(05)", "student(e)", "cauchy", "Normal"),
        ("radial(1)", "rim", "rim(0)", "rim(-1)", "rim(1, 2)", "memory(1)", "memory(.5)", "form(1)", "form(1,2)"),
    ):
        assert not any(is_law(laws.NOISE, word) for word in words)


@pytest.fixture
def errors_of(rows):
    """Errors of a study, by the cell's σ, laws and share, and the trial."""

    def make(study):
        found = rows(study)
        keys = [found[key] for key in ("noise", "law", "directions", "outlier_share", "trial") if key in found]
        return dict(zip(zip(*keys, strict=True), found["error"], strict=True))

    return make


def test_normal_cells_are_those_of_a_study_without(make_study, errors_of):
    """Cells at the defaults have the same draws and the same errors, to the bit, as in a study that names no law."""
    plain = errors_of(make_study({"estimators": ["gdke"]}, trials=5, samples=20, noise=[0.1, 0.2]))
    mixed = errors_of(make_study({"estimators": ["gdke"]}, trials=5, samples=20, **MIXED))
    assert len(mixed) == 6 * len(plain)
    assert all(mixed[sigma, "normal", 0.0, trial] == error for (sigma, trial), error in plain.items())
    assert len(set(mixed.values())) == len(mixed)


def test_a_trial_is_drawn_again(make_study):
    """Replayed alone, a trial of any law has the same points, to the bit, as among others; another seed has others."""
    study = make_study({"keep_points": 99}, trials=7, samples=12, **MIXED)
    for unit in study.units():
        columns = compute(study, unit).points
        for trial in all_trials(study):
            rows = (columns["cell"] == trial.cell.name) & (columns["trial"] == trial.trial)
            kept = np.stack([columns[f"x_{i + 1}"][rows] for i in range(3)], axis=-1)
            np.testing.assert_array_equal(trial.samples.points[0], kept)


def test_the_bound_is_gaussian(make_study):
    """The bound does not depend on the law, and the tables say of which it is; those of other studies do not change."""
    study = make_study(trials=3, **MIXED)
    batch = next(next(study.units()).parts(0))
    draws = draw(study, batch)
    np.testing.assert_array_equal(draws.unit_bound(), draws.law.unit_bound(draws.directions))
    for conditions, said in ((study.conditions(), True), (make_study().conditions(), False)):
        columns = [*schemas.errors(3, conditions), *schemas.summary(conditions)]
        words = {c.name: c.meaning for c in columns}
        for name in ("bound", "radius_bound", "ratio_median_ok", "far_all", "rmse"):
            assert words[name].endswith("Gaussian bound at the same σ") == said
        assert "Gaussian" not in words["error"] + words["relative_median_ok"]


def test_outliers_go_with_noise_of_any_covariance(make_study, errors_of):
    """Fits of anisotropic noise with outliers are numbers; another law has no shape (see the faults of configs)."""
    top = {"noise_shape": [[4.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], "estimators": ["gdke"]}
    assert np.all(np.isfinite(list(errors_of(make_study(top, outlier_share=0.1)).values())))


def placed(conditions, d=3, angle=2.0, n=30_000):
    """Directions of a law (2, d, n), with 1 - u₁ turned into u₁, after directions by area."""
    directions = np.empty((2, d, n))
    cap.draw(lanes(3, "test"), angle, directions, np.empty_like(directions))
    directions = changed(laws.DIRECTIONS, conditions, Trials(directions, directions, angle, numbers_of(8, 0, 2)))
    directions[:, 0] = 1.0 - directions[:, 0]
    return directions


def test_radial_noise_is_along_the_radius():
    """It is the component of isotropic noise along the direction: a standard normal number times u (p > 1e-6).

    Its covariance over the whole sphere is I/3, within 5 standard errors of each of six moments.
    """
    u = placed("area", angle=np.pi)
    noise, normals = structured("radial", u, np.pi, seed=5)
    along = (noise * u).sum(axis=1)
    np.testing.assert_allclose(noise, along[:, None] * u, atol=1e-14)
    np.testing.assert_allclose(along, (normals * u).sum(axis=1), atol=1e-14)
    assert stats.kstest(along.ravel(), "norm").pvalue > 1e-6
    assert_second_moments(noise.swapaxes(0, 1).reshape(3, -1), np.eye(3) / 3)


def structured(law, u, angle, seed=1):
    """Noise of a law for directions u (b, d, n) on a cap, and the normal numbers behind it."""
    normals = np.random.default_rng(seed).standard_normal(u.shape)
    heights = u.copy()
    heights[:, 0] = 1.0 - u[:, 0]
    return changed(laws.NOISE, law, Trials(normals, heights, angle, numbers_of(4, 0, len(u)))), normals


def test_noise_grows_to_the_rim():
    """Over 1 + 3 (1 - cos θ)/(1 - cos φ) the noise is standard normal (p > 1e-6); within 1 % of the rim it is ~ 4 σ.

    At the pole and at the rim the mean square is 1 and 16, within 5 standard errors and the growth over the zone.
    """
    u = placed("area", angle=2.0)
    noise, _ = structured("rim(4)", u, 2.0)
    share = (1 - u[:, 0]) / (1 - np.cos(2.0))
    assert stats.kstest((noise / (1 + 3 * share)[:, None]).ravel(), "norm").pvalue > 1e-6
    for zone, least, most in ((share < 0.01, 1.0, 1.0609), (share > 0.99, 15.76, 16.0)):
        square = noise.swapaxes(0, 1)[:, zone] ** 2
        error = 5 * square.std() / np.sqrt(square.size)
        assert least - error < square.mean() < most + error


def test_noise_that_remembers():
    """It is yᵢ = ρ yᵢ₋₁ + √(1 - ρ²) zᵢ from y₀ = z₀ on, so that correlations of any lag are ρ^lag, and variances 1."""
    u = placed("spaced", 3, 1.0, 12)
    noise, normals = structured("memory(0.8)", u, 1.0)
    expected = normals.copy()
    for i in range(1, 12):
        expected[:, :, i] = 0.8 * expected[:, :, i - 1] + 0.6 * normals[:, :, i]
    np.testing.assert_allclose(noise, expected, atol=1e-12)


def test_form_is_a_smooth_function_of_the_direction():
    """Over trials, displacements are along u, normal (p > 1e-6), of covariance s² exp(-|u - v|²/2l²) within 5 errors.

    The kernel is computed from all pairs of 8 directions; l is .4 half-angles of the cap, s is 1.5 σ.
    """
    angle = 1.2
    u = placed("spaced", 3, angle, 8)[:1].repeat(6000, axis=0)
    noise, normals = structured("form(0.4, 1.5)", u, angle)
    form = noise - normals
    along = np.einsum("bdn,bdn->bn", form, u)
    np.testing.assert_allclose(form, along[:, None] * u, atol=1e-12)
    products = along[:, :, None] * along[:, None]
    distance = squareform(pdist(u[0].T))
    expected = 1.5**2 * np.exp(-(distance**2) / (2 * (0.4 * angle) ** 2))
    assert np.all(np.abs(products.mean(axis=0) - expected) < 5 * products.std(axis=0) / np.sqrt(len(products)))
    assert all(stats.kstest(along[:, k] / 1.5, "norm").pvalue > 1e-6 for k in range(8))


@pytest.mark.parametrize("d", [2, 3])
def test_a_path_swings_from_rim_to_rim(d):
    """It stays within the cap, comes near the pole and the rim, and no step is longer than the swings ask for."""
    angle, n = 0.6, 400
    u = placed("path", d, angle, n)[0]
    away = np.arccos(u[0])
    assert away.max() <= angle * (1 + 1e-12)
    assert away.max() > 0.999 * angle
    assert away.min() < 0.05 * angle
    steps = np.linalg.norm(np.diff(u, axis=1), axis=0)
    assert steps.max() < 2 * np.pi * 3 / n * angle * 1.05
    assert {tuple(np.sign(w)) for w in u[1:].T[:: n // 12]} >= ({(1.0,), (-1.0,)} if d == 2 else {(1.0, 1.0)})


def test_the_bound_holds_for_radial_noise(make_study, rows):
    """Variances of MLE's centre and radius over the bound are 1 within 5 standard errors: σ = .003, 3000 trials."""
    study = make_study({"estimators": ["mle"]}, trials=3000, samples=60, angle=90, noise=0.003, law="radial")
    found = rows(study)
    for error, bound in (("error", "bound"), ("radius_error", "radius_bound")):
        ratio = (found[error] / found[bound]) ** 2
        assert abs(ratio.mean() - 1.0) < 5 * ratio.std() / np.sqrt(ratio.size)


@pytest.mark.parametrize("d", [2, 3, 5])
def test_polar_directions(d):
    """The angle to the axis is uniform, the rest uniform about it: first coordinate across by its law (p > 1e-6)."""
    u = placed("polar", d)
    np.testing.assert_allclose((u**2).sum(axis=1), 1.0, rtol=1e-13)
    assert stats.kstest(np.arccos(u[:, 0]).ravel() / 2.0, "uniform").pvalue > 1e-6
    across = (u[:, 1] / np.linalg.norm(u[:, 1:], axis=1)).ravel()
    if d == 2:
        assert stats.binomtest(int((across > 0).sum()), across.size).pvalue > 1e-6
    else:  # (1 + w)/2 of a point of the sphere in d - 1 dimensions has a beta law
        assert stats.kstest((1 + across) / 2, stats.beta((d - 2) / 2, (d - 2) / 2).cdf).pvalue > 1e-6


def test_spaced_directions_of_an_arc():
    """They divide the arc with both ends, and the whole circle without doubling its end; all trials have the same."""
    u = placed("spaced", 2, np.pi / 2, 100)
    expected = np.linspace(-np.pi / 2, np.pi / 2, 100)
    np.testing.assert_allclose(u[0], [np.cos(expected), np.sin(expected)], atol=1e-15)
    np.testing.assert_array_equal(u[0], u[1])
    angle = np.sort(np.arctan2(*placed("spaced", 2, np.pi, 12)[0][::-1]) % (2 * np.pi))
    np.testing.assert_allclose(np.diff(angle), 2 * np.pi / 12, atol=1e-14)


@pytest.mark.parametrize("angle", [0.3, 2.0, np.pi])
def test_spaced_directions_of_a_cap(angle):
    """Every zone has its share, moments are the cap's to 1/n, and no two are nearer than half of what is usual.

    The usual distance is that of a square lattice of the cap's area.
    """
    n = 500
    u = placed("spaced", 3, angle, n)[0].T
    heights = (1 - u[:, 0]) / (1 - np.cos(angle))
    np.testing.assert_allclose(np.sort(heights), (np.arange(n) + 0.5) / n, atol=1e-12)
    moments = cap.cap_moments(angle, 3)
    assert abs(u[:, 0].mean() - moments.mean) < 1 / n
    np.testing.assert_allclose(np.cov(u.T, ddof=0), np.diag([moments.along, *[moments.across] * 2]), atol=2 / n)
    lattice = np.sqrt(2 * np.pi * (1 - np.cos(angle)) / n)
    assert pdist(u).min() > 0.5 * lattice


def test_directions_have_their_own_draws_and_bound(make_study, rows):
    """Cells by area are those of a study without other laws, to the bit; the bound is of the realised directions."""
    plain = rows(make_study({"estimators": ["gdke"]}, trials=4, samples=20))
    study = make_study({"estimators": ["gdke"]}, trials=4, samples=20, directions=["polar", "area", "spaced"])
    found = rows(study)
    law = found["directions"]
    np.testing.assert_array_equal(found["error"][law == "area"], plain["error"])
    for trial in all_trials(study):
        u = trial.samples.points[0] - np.array(trial.cell.center)
        assert trial.cell.directions == dict(trial.cell.further).get("directions", "area")
        assert np.linalg.norm(u, axis=1).mean() == pytest.approx(trial.cell.radius, rel=0.1)
    bounds = [found["bound"][law == word] for word in ("area", "spaced")]
    assert np.ptp(bounds[0]) > 0.0
    np.testing.assert_array_equal(bounds[1], bounds[1][0])


def test_moments_know_the_directions(make_study, errors_of):
    """The route through joint moments has the errors of the route through points, to rounding, for each law."""
    design = {"trials": 6, "samples": 30, "directions": ["polar", "spaced"], "noise": 0.1}
    made = [make_study({"estimators": ["gdke"], "route": route}, **design) for route in ("points", "moments")]
    np.testing.assert_allclose(*(list(errors_of(study).values()) for study in made), rtol=1e-9)


def test_estimators_get_the_stated_variance(make_study):
    """UGDK subtracts what it is told: σ²/3 is the fit at σ/√3; the points and the bound do not change."""
    study = make_study({"estimators": ["ugdk"]}, trials=5, samples=30, noise=0.3, stated_variance=[1, 1 / 3])
    for trial in all_trials(study):
        share = dict(trial.cell.further).get("stated_variance", 1.0)
        assert trial.samples.noise == pytest.approx(0.3 * np.sqrt(share), rel=1e-15)
    columns = compute(study, next(study.units())).errors
    first = columns["stated_variance"] == 1.0
    np.testing.assert_array_equal(columns["bound"][first], columns["bound"][~first])
    trial = next(all_trials(study))
    told = fit(trial.samples.points[0], "ugdk", noise=0.3 / np.sqrt(3))
    np.testing.assert_allclose(np.linalg.norm(told.center - trial.cell.center), columns["error"][~first][0], rtol=1e-12)


@pytest.mark.parametrize(
    "more",
    [
        {"law": "radial", "directions": "polar", "stated_variance": 0.25},
        {"outlier_share": uniform(0.0, 0.3)},
    ],
    ids=["words", "outliers"],
)
def test_random_designs(make_study, more):
    """A word is the same for all trials of a random design, a number is drawn from its law.

    The other conditions are those that are drawn without them; a default in words is as if it were left out.
    """
    with_more, plain = (
        [next(unit.parts(0)).cells[0] for unit in make_study(kind="random", trials=9, samples=50, **given).units()]
        for given in (more, {})
    )
    assert all(set(dict(cell.further)) == set(more) for cell in with_more)
    for name in set(more) - {"outlier_share"}:
        assert {dict(cell.further)[name] for cell in with_more} == {more[name]}
    assert [(c.center, c.noise) for c in with_more] == [(c.center, c.noise) for c in plain]
    assert make_study(kind="random", law="normal", directions="area").digest() == make_study(kind="random").digest()


SHAPE = ((1.63, 0.41, 0.38), (0.41, 0.78, 0.48), (0.38, 0.48, 0.59))


@pytest.mark.parametrize(
    "law",
    [GaussianNoise(2), GaussianNoise(3), gaussian(((4, 0, 0), (0, 1, 0), (0, 0, 0.25)), 3), gaussian(SHAPE, 3)],
    ids=["isotropic in the plane", "isotropic in space", "unequal", "correlated"],
)
def test_a_gaussian_law(law):
    """Estimators get σ, or a covariance in proportion to σ²."""
    unit, given = law.covariance(1.0), law.given(0.3)
    np.testing.assert_allclose(law.covariance(0.3), 0.09 * unit, rtol=1e-14)
    np.testing.assert_array_equal(unit, np.eye(law.dimension) if law.isotropic else law.shape)
    np.testing.assert_array_equal(given, 0.3 if law.isotropic else law.covariance(0.3))


def exact_variances(directions, covariance):
    """Diagonal of the inverse of J = Σ w wᵀ/(uᵀΣu), w = (u, 1), in sixty digits (theory 3.1)."""
    d, n = directions.shape
    with mpmath.workdps(60):
        information, covariance = mpmath.zeros(d + 1), mpmath.matrix(covariance.tolist())
        for k in range(n):
            u = mpmath.matrix([mpmath.mpf(float(v)) for v in directions[:, k]])
            u[0] = 1 - u[0]
            w = mpmath.matrix([*u, 1])
            information += w * w.T / (u.T * covariance * u)[0]
        inverse = information**-1
        return np.array([float(inverse[i, i]) for i in range(d + 1)])


@pytest.mark.parametrize("shaped", [False, True])
@pytest.mark.parametrize("d", [2, 3, 5])
@pytest.mark.parametrize("angle", [1e-4, 1e-2, 1.0, 60.0])
def test_bound_is_exact_at_tiny_angles(make_study, d, angle, shaped):
    """Variances of centre and radius agree with sixty-digit arithmetic to 1e-8, down to 1e-4 degrees."""
    shape = (np.diag(np.arange(0.7, d)) + 0.3).tolist() if shaped else None
    made = make_study({"dimension": d, "noise_shape": shape}, angle=angle, samples=20, trials=3)
    draws = draw(made, next(next(made.units()).parts(0)))
    bound = draws.unit_bound()
    for trial in range(3):
        expected = exact_variances(draws.directions[trial], draws.law.covariance(1.0))
        np.testing.assert_allclose(np.diag(bound[trial]), expected, rtol=1e-8)


def test_a_shape_of_the_identity_is_isotropic():
    """The law of no shape and of the identity is the same; any other shape has a law of its own."""
    unit = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    assert gaussian(None, 3) == gaussian(unit, 3) == GaussianNoise(3)
    assert gaussian(SHAPE, 3) == GaussianNoise(3, SHAPE)
