"""Claims on UGDK: each verdict follows from its tables, and changes with them.

Claims on several markers: the verdicts follow from the stored points, and change with them.

Joints of several markers: stored points are put together again as drawn, and fitted as the library does.
"""

import itertools
import math

import numpy as np
import pandas as pd
import pytest

from study.fits import Status, fit, mgdk
from study.simulation.claims.claim import Verdict, joint_markers, point_sets
from study.simulation.claims.ugdk import fit_joints

SAMPLES = [40, 80, 160, 320]


@pytest.fixture
def bias(error_rows, scores):
    """Errors along the axis with means -n^e for exponents e of each estimator, and deviation 1/√n."""

    def make(trials=4000, **exponents):
        parts = []
        for name, exponent in exponents.items():
            for n in SAMPLES:
                along = scores(trials) / math.sqrt(n) - float(n) ** exponent
                parts.append(error_rows(name, np.abs(along), error_1=along, samples=n, cell=str(n)))
        return {"bias/errors": pd.concat(parts)}

    return make


@pytest.mark.parametrize(
    ("ugdk", "gdke", "verdict"),
    [
        (-1.0, 0.0, Verdict.REPRODUCED),
        (-1.0, -1.0, Verdict.IN_PART),
        (-0.4, 0.0, Verdict.IN_PART),
        (0.0, -0.2, Verdict.NOT_REPRODUCED),
    ],
)
def test_bias(find, bias, ugdk, gdke, verdict):
    """The exponents are found, and the verdict is about them. Means are exact here, so that nothing is by chance."""
    found = find("ugdk-bias", bias(ugdk=ugdk, gdke=gdke))
    assert [n.value for n in found.numbers[1:3]] == pytest.approx([ugdk, gdke], abs=1e-9)
    assert found.numbers[3].value == pytest.approx(-(320.0 ** (1.0 + ugdk)), rel=1e-9)
    assert found.verdict is verdict


def test_share_of_fits_that_are_not_ok(find, bias):
    """One trial of twenty has another status, of UGDK alone."""
    errors = bias(ugdk=-1.0, gdke=0.0)["bias/errors"].reset_index(drop=True)
    errors.loc[(errors["estimator"] == "ugdk") & (errors["trial"] % 20 == 0), "status"] = int(Status.INSIGNIFICANT)
    share = find("ugdk-bias", {"bias/errors": errors}).numbers[4]
    assert "not ok" in share.words
    assert share.value == pytest.approx(0.05)


def test_bias_needs_means_that_exist(find, bias):
    """With a tail of 1/x, as UGDK's error has where the noise is not small, there is no mean and no verdict."""
    tables = bias(ugdk=-1.0, gdke=0.0)
    errors = tables["bias/errors"].reset_index(drop=True)
    tail = 1.0 / (np.arange(4000) + 0.5)
    errors.loc[(errors["estimator"] == "ugdk") & (errors["samples"] == 80), "error"] = tail
    found = find("ugdk-bias", {"bias/errors": errors})
    assert found.verdict is Verdict.NOT_EVALUATED
    assert "UGDK's bias" in found.reason


def test_bias_of_few_trials_is_no_verdict(find, bias):
    """Below 200 trials nothing says whether a mean exists."""
    assert find("ugdk-bias", bias(trials=100, ugdk=-1.0, gdke=0.0)).verdict is Verdict.NOT_EVALUATED


@pytest.fixture
def growth(error_rows, scores):
    """A grid with errors ∝ n^e, and a random design with ∝ σ^s/√n below σ = r, ∝ σ n^f from there on."""

    def make(exponent=-0.5, noise_exponent=1.0, beyond=-0.5):
        spread = np.exp(0.3 * scores(200))
        grid = [error_rows("ugdk", spread * float(n) ** exponent, samples=n, noise=0.02) for n in SAMPLES]
        noise, samples = (a.ravel() for a in np.meshgrid(np.logspace(-6, 5, 45), [10, 100, 1000, 10_000]))
        noise, samples = np.tile(noise, 15), np.tile(samples, 15)
        factor = np.exp(0.3 * np.random.default_rng(3).permuted(scores(noise.size)))
        small = noise**noise_exponent / np.sqrt(samples)
        error = factor * np.where(noise < 1.0, small, noise * samples**beyond)
        paper = error_rows("ugdk", error, samples=samples, noise=noise, bound=noise / np.sqrt(samples))
        return {"power-law/errors": pd.concat(grid), "paper/errors": paper}

    return make


@pytest.mark.parametrize(
    ("changed", "verdict"),
    [
        ({}, Verdict.REPRODUCED),
        ({"beyond": 0.0}, Verdict.IN_PART),
        ({"exponent": 0.0}, Verdict.REPRODUCED),
        ({"noise_exponent": 1.5}, Verdict.NOT_REPRODUCED),
    ],
)
def test_error(find, growth, changed, verdict):
    """Exponents are found, within 4.5 of their errors (false alarm: 7 in 10⁶ each); the decades of noise decide."""
    found = find("ugdk-error", growth(**changed))
    expected = {"exponent": -0.5, "noise_exponent": 1.0, "beyond": -0.5} | changed
    expected["noise_exponent"] -= 1.0  # of the error over the bound
    for number, value in zip(found.numbers[1:], expected.values(), strict=False):
        assert abs(number.value - value) < 4.5 * number.error < 0.1
    assert found.verdict is verdict


def test_error_counts_failures(find, growth):
    """If most fits of some N have no number, the median is infinite and has no exponent, whatever the other N."""
    tables = growth()
    grid = tables["power-law/errors"]
    failed = (grid["samples"] == 40) & (grid["trial"] < 120)
    tables["power-law/errors"] = grid.assign(error=grid["error"].where(~failed))
    assert find("ugdk-error", tables).numbers[1].value == math.inf


@pytest.fixture
def circles(error_rows, scores):
    """Trials of figure 4 with ρ spread about a middle, and a share of errors put far outside."""

    def make(middle=0.56, far=0.0):
        n = 1000
        rng = np.random.default_rng(4)
        errors = rng.permuted(np.stack([scores(n), 2.0 * scores(n)], axis=1), axis=0)
        errors[: int(far * n)] *= 100.0
        condition = middle + 0.08 * scores(n)
        rows = error_rows("ugdk", np.zeros(n), error_1=errors[:, 0], error_2=errors[:, 1], condition=condition)
        return {"ellipse/errors": rows.drop(columns="error_3")}

    return make


def test_figure_4(find, circles):
    """Gaussian errors are in their 95 % ellipse 95 times of 100 (4.5 binomial errors: 7 false alarms in 10⁶)."""
    found = find("figure-4-setting", circles())
    assert found.verdict is Verdict.REPRODUCED
    assert found.numbers[1].value == pytest.approx(0.486, abs=0.001)  # Φ((.557238 - .56)/.08)
    assert found.numbers[3].value == pytest.approx(0.95, abs=4.5 * math.sqrt(0.95 * 0.05 / 1000))


def test_figure_4_verdict_follows(find, circles):
    """ρ elsewhere is not the figure's setting; ρ above 1, failures, or a truth outside, leave part of the claim."""
    name = "figure-4-setting"
    assert find(name, circles(middle=0.8)).verdict is Verdict.NOT_REPRODUCED
    table = circles()["ellipse/errors"]
    failed = table.assign(**{name: table[name].where(table["trial"] >= 600) for name in ("error_1", "error_2")})
    assert find(name, {"ellipse/errors": failed}).numbers[0].value == pytest.approx(0.38, abs=0.02)  # .95 of 400
    above = table.assign(condition=np.where(table["trial"] >= 800, 1.1, table["condition"]))
    assert find(name, {"ellipse/errors": above}).verdict is Verdict.IN_PART


@pytest.fixture
def noises(error_rows, scores, on_cap, kept_points):
    """Noise estimated by ALS over the truth, and errors of UGDK with estimated Σ over UGDK with known Σ."""

    def make(found=1.0, loss=1.1):
        spread = np.exp(0.3 * scores(300))
        variances = {noise: found * noise**2 * spread for noise in (0.01, 0.03, 0.3)}
        cells = itertools.product(variances.items(), (45.0, 90.0))
        efficiency = [error_rows("als", spread, noise=n, angle=a, noise_variance=v) for (n, v), a in cells]
        factors = {"ugdk": 1.0, "ugdk_cov": loss, "als": 8.0}
        cells = itertools.product(factors.items(), (1000, 20_000), (45.0, 90.0))
        several = [error_rows(name, factor * spread, samples=n, angle=a) for (name, factor), n, a in cells]
        rng = np.random.default_rng(5)
        cells, points = [], []
        for cell, radius in (("a", 0.5), ("b", 2.0)):
            x, _ = on_cap(rng, 50, 90.0, noise=0.05, radius=radius, sets=4)
            cells.append(error_rows("ugdk", np.zeros(4), cell=cell, radius=radius, angle=90.0, samples=50))
            points.append(kept_points(cell, x, radius))
        markers = {"markers/errors": pd.concat(cells), "markers/points": pd.concat(points)}
        return markers | {"efficiency/errors": pd.concat(efficiency), "anisotropic/errors": pd.concat(several)}

    return make


@pytest.mark.parametrize(
    ("changed", "verdict"),
    [
        ({}, Verdict.REPRODUCED),
        ({"loss": 3.0}, Verdict.REPRODUCED),
        ({"found": 1.2}, Verdict.NOT_REPRODUCED),
        ({"found": 0.8, "loss": 3.0}, Verdict.NOT_REPRODUCED),
    ],
)
def test_noise(find, noises, changed, verdict):
    """The trace can be found or not; that the whole Σ can be found too is no part of the claim, nor eq. 19's fault."""
    found = find("noise-from-the-points", noises(**changed))
    expected = {"found": 1.0, "loss": 1.1} | changed
    assert [n.value for n in found.numbers[1:3]] == pytest.approx(list(expected.values()), rel=1e-3)
    assert found.numbers[3].value == pytest.approx(8.0)
    assert found.verdict is verdict
    assert found.other_cause  # eq. 19 returns what it is given


def test_noise_counts_failures(find, noises):
    """If most fits that find Σ have no number, Σ is not found; a status alone changes nothing."""
    tables = noises()
    several = tables["anisotropic/errors"]
    failed = (several["estimator"] == "ugdk_cov") & (several["angle"] == 45.0) & (several["trial"] < 200)
    tables["anisotropic/errors"] = several.assign(status=np.where(failed, Status.NOT_POSITIVE_DEFINITE, Status.OK))
    assert find("noise-from-the-points", tables).numbers[2].value == pytest.approx(1.1)
    tables["anisotropic/errors"] = several.assign(error=several["error"].where(~failed))
    assert find("noise-from-the-points", tables).numbers[2].value == math.inf


def test_equation_19_returns_what_it_is_told(find, noises):
    """Eq. 19 with UGDK's own sphere gives (N - 1)/N of the noise that UGDK was given (theory §2)."""
    found = find("noise-from-the-points", noises())
    assert [n.value for n in found.numbers[-2:]] == pytest.approx([49 / 50] * 2, rel=1e-9)


EQUAL = (1.0, 1.0001, 1.0002)
APART = (0.1, 0.5, 2.0)


@pytest.fixture(scope="module")
def figure_6(marker_tables):
    """The run of figure 6, smaller."""
    errors, points = marker_tables(1, (0.6, 1.0), (0.05,), trials=40, samples=60, angle=40.0, d=2)
    return {"mgdk/errors": errors, "mgdk/points": points}


@pytest.fixture(scope="module")
def averaged(find, marker_tables, figure_6):
    """Judge whether bad markers are averaged out, by markers of these radii under these noises."""

    def run(radii, noises, **options):
        errors, points = marker_tables(2, radii, noises, **options)
        return find("markers-averaged", {"markers/errors": errors, "markers/points": points, **figure_6})

    return run


def test_equal_markers_are_averaged(averaged):
    """Three markers alike and little noise: errors are Gaussian and equal, so their mean is 1/√3 of each.

    4.5 standard errors are exceeded in 7 of 10⁶ cases; the best of three like medians is lower by chance, by less
    than one standard error in the mean.
    """
    found = averaged(EQUAL, (0.01, 0.02))
    assert abs(found.numbers[1].value - 1 / math.sqrt(3)) < 4.5 * found.numbers[1].error < 0.25
    assert found.numbers[0].value > 0.7


def test_the_outermost_marker_is_heard_alone(averaged):
    """Eq. 22 weighs errors by r²: with radii .1, .5, 2 the joint error is √(Σr⁴)/Σr² = .94 of the outermost's.

    That is within 4.5 standard errors (7 false alarms in 10⁶); the innermost does not matter. By weights 1/r̂² it is
    1/√3 where the noise is small.
    """
    found = averaged(APART, (0.001, 0.002))
    assert found.numbers[1].value == pytest.approx(0.94, abs=4.5 * found.numbers[1].error)
    assert found.numbers[2].value == pytest.approx(1.0, abs=0.05)
    assert found.numbers[3].value == pytest.approx(1 / math.sqrt(3), abs=4.5 * found.numbers[3].error)
    assert found.numbers[3].error < 0.1


def test_drowned_inner_markers_do_no_harm(averaged):
    """If noise hides the inner markers, the fit to all is as good as the outermost: part of the claim, not all."""
    found = averaged(APART, (0.01, 0.1, 0.3))
    assert found.verdict is Verdict.IN_PART
    assert found.numbers[1].value == pytest.approx(1.0, abs=0.1)


def test_a_failing_joint_fit_counts_as_computed(averaged):
    """Told a noise that the outermost marker bears and the sum does not, eq. 22 is far off, and not infinitely."""
    noise = math.sqrt(0.6 * 4.0 * 0.0208)  # σ² = .6 v of the outermost, v = r² K_a (theory §3); the sum needs < v/3
    found = averaged((0.1, 0.11, 2.0), (0.01,), trials=50, told=noise / 0.01)
    assert 1.0 < found.numbers[1].value < math.inf


def test_averaging_needs_two_markers(averaged):
    """One radius is no joint: there are no numbers, and no verdict."""
    found = averaged((1.0,), (0.01,), trials=20)
    assert found.verdict is Verdict.NOT_EVALUATED
    assert found.reason


@pytest.fixture(scope="module")
def definite(find, marker_tables):
    """Judge whether summed matrices stay positive definite; the tables come along."""

    def run(radii, noises, **options):
        errors, points = marker_tables(3, radii, noises, **options)
        return find("markers-positive-definite", {"markers/errors": errors, "markers/points": points}), points

    return run


@pytest.mark.parametrize(
    ("noises", "told", "verdict"),
    [
        ((0.003, 0.01), 1.0, Verdict.REPRODUCED),
        ((0.01, 0.1, 1.0), 1.0, Verdict.MOSTLY),
        ((0.01,), 22.3, Verdict.NOT_REPRODUCED),  # as above: the outermost alone is definite, the sum never
    ],
)
def test_definite(definite, noises, told, verdict):
    """Small noise leaves every sum definite, large noise most, too much noise none; the theorem is never wrong."""
    found, _ = definite(APART, noises, told=told)
    assert found.verdict is verdict


def test_shares_by_hand(definite):
    """Shares are those of NumPy's own covariances, and a sum of definite matrices is definite."""
    found, points = definite(APART, (0.05, 1.0), trials=60)
    shares, singles, sound = [], [], []
    for noise in (0.05, 1.0):
        every = []
        for radius in APART:
            mine = points[points["cell"] == f"{noise:g}, {radius:g}"]
            sets = mine[["x_1", "x_2", "x_3"]].to_numpy().reshape(60, 100, 3)
            every.append([np.cov(x.T) - noise**2 * np.eye(3) for x in sets])
        smallest = np.linalg.eigvalsh(np.array(every))[..., 0]
        total = np.linalg.eigvalsh(np.sum(every, axis=0))[:, 0]
        shares.append(np.mean(total > 0))
        singles.append(np.mean(smallest > 0))
        sound.append((smallest > 0).all(axis=0))
    values = [n.value for n in found.numbers[1:]]
    assert values[0] == 1.0
    assert found.numbers[1].trials == np.sum(sound) > 0
    assert values[1] == pytest.approx(np.mean(sound))
    assert values[2:4] == pytest.approx([min(shares), np.mean(singles)])
    assert found.numbers[0].value == pytest.approx(np.mean(shares))
    assert values[4] == pytest.approx(np.mean(smallest[-1] > 0))  # the last noise has the least share


@pytest.fixture
def tables():
    """Errors and points of cells (noise, radius), shuffled, with a centre that is not the origin."""

    def make(cells, samples=5, trials=(3, 3, 3, 3)):
        rng = np.random.default_rng(1)
        errors, points, truth = [], [], {}
        for k, ((noise, radius), count) in enumerate(zip(cells, trials, strict=False)):
            x = rng.standard_normal((count, samples, 2))
            truth[noise, radius] = x
            base = {"cell": f"c{k}", "trial": np.repeat(np.arange(count), samples)}
            base |= {"sample": np.tile(np.arange(samples), count), "radius": radius}
            axes = {"x_1": x[..., 0].ravel() + 2.0, "x_2": x[..., 1].ravel() - 1.0, "center_1": 2.0, "center_2": -1.0}
            points.append(pd.DataFrame(base | axes))
            conditions = {"noise": noise, "radius": radius, "samples": samples, "angle": 60.0, "center": 5**0.5}
            errors.append(pd.DataFrame({"cell": [f"c{k}"] * count} | conditions))
        shuffled = pd.concat(points).sample(frac=1.0, random_state=2)
        return pd.concat(errors).astype({"cell": "category"}), shuffled.astype({"cell": "category"}), truth

    return make


def test_joints(tables):
    """A joint per noise, ascending, its markers by ascending radius, points in the order of trial and sample."""
    errors, points, truth = tables([(0.2, 2.0), (0.1, 0.5), (0.2, 1.0), (0.1, 3.0)])
    found = list(joint_markers(errors, points))
    assert [joint.sigma for joint in found] == [0.1, 0.2]
    assert [list(joint.radii) for joint in found] == [[0.5, 3.0], [1.0, 2.0]]
    for joint in found:
        for radius, marker in zip(joint.radii, joint.markers, strict=True):
            np.testing.assert_allclose(marker, truth[joint.sigma, radius], atol=1e-14)


def test_markers_with_fewer_trials_bound_the_others(tables):
    """All markers of a joint have as many trials as the one with the fewest."""
    errors, points, _ = tables([(0.1, 1.0), (0.1, 2.0)], trials=(4, 2))
    (joint,) = joint_markers(errors, points)
    assert [len(marker) for marker in joint.markers] == [2, 2]


def test_a_cell_without_points(tables):
    """A cell of which no points are stored has no sets."""
    _, points, _ = tables([(0.1, 1.0)])
    assert point_sets(points, "other").size == 0


@pytest.mark.parametrize("noise", [0.01, 0.1, 0.6])
@pytest.mark.parametrize("weighted", [False, True])
def test_fits_are_those_of_the_library(on_cap, noise, weighted):
    """Centres, radii and own statuses of `study.mgdk`, in noise that hides two of three, too."""
    rng = np.random.default_rng(4)
    markers = [on_cap(rng, n, 60.0, 3, noise, radius, sets=20)[0] for n, radius in ((40, 0.1), (60, 0.5), (50, 2.0))]
    center, squares, definite = fit_joints(markers, noise, weighted)
    each = [mgdk(sets, noise=noise, weighted=weighted) for sets in zip(*markers, strict=True)]
    np.testing.assert_allclose(center, [f.center for f in each], rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(definite, [f.own_status == Status.OK for f in each])
    radii = np.sqrt(np.where(squares >= 0.0, squares, np.nan))
    np.testing.assert_allclose(radii.T, [f.radii for f in each], rtol=1e-7)


@pytest.mark.parametrize("noise", [0.05, 0.4])
def test_one_marker_is_fitted_by_ugdk(on_cap, noise):
    """Eq. 22 of one marker is eqs 15 to 21, and errors are those of UGDK, whatever it says of them."""
    points, _ = on_cap(np.random.default_rng(5), 50, 50.0, 3, noise, 1.0, sets=40)
    (center, _, definite), expected = fit_joints([points], noise), fit(points, "ugdk", noise=noise)
    np.testing.assert_allclose(center, expected.center, rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(definite, expected.estimates.status == Status.OK)
