"""Claims on several markers: the verdicts follow from the stored points, and change with them."""

import math

import numpy as np
import pytest

from study.simulation.claims.claim import Verdict

EQUAL = (1.0, 1.0001, 1.0002)
APART = (0.1, 0.5, 2.0)


@pytest.fixture(scope="module")
def circles(marker_tables):
    """The run of figure 6, smaller."""
    errors, points = marker_tables(1, (0.6, 1.0), (0.05,), trials=40, samples=60, angle=40.0, d=2)
    return {"mgdk/errors": errors, "mgdk/points": points}


@pytest.fixture(scope="module")
def averaged(find, marker_tables, circles):
    """Judge whether bad markers are averaged out, by markers of these radii under these noises."""

    def run(radii, noises, **options):
        errors, points = marker_tables(2, radii, noises, **options)
        return find("markers-averaged", {"markers/errors": errors, "markers/points": points, **circles})

    return run


def test_equal_markers_are_averaged(averaged):
    """Three markers alike and little noise: errors are Gaussian and equal, so their mean is 1/√3 of each.

    4.5 standard errors are exceeded in 7 of 10⁶ cases; the best of three like medians is lower by chance, by less
    than one standard error in the mean.
    """
    found = averaged(EQUAL, (0.01, 0.02))
    assert abs(found.numbers[0].value - 1 / math.sqrt(3)) < 4.5 * found.numbers[0].error < 0.25
    assert found.verdict is Verdict.REPRODUCED


def test_the_outermost_marker_is_heard_alone(averaged):
    """Eq. 22 weighs errors by r²: with radii .1, .5, 2 the joint error is √(Σr⁴)/Σr² = .94 of the outermost's.

    That is within 4.5 standard errors (7 false alarms in 10⁶); the innermost does not matter. By weights 1/r̂² it is
    1/√3 where the noise is small.
    """
    found = averaged(APART, (0.001, 0.002))
    assert found.numbers[0].value == pytest.approx(0.94, abs=4.5 * found.numbers[0].error)
    assert found.numbers[2].value == pytest.approx(1.0, abs=0.05)
    assert found.numbers[3].value == pytest.approx(1 / math.sqrt(3), abs=4.5 * found.numbers[3].error)
    assert found.numbers[3].error < 0.1


def test_drowned_inner_markers_do_no_harm(averaged):
    """If noise hides the inner markers, the fit to all is as good as the outermost: part of the claim, not all."""
    assert averaged(APART, (0.01, 0.1, 0.3)).verdict is Verdict.PARTLY


def test_a_failing_joint_fit_counts_as_computed(averaged):
    """Told a noise that the outermost marker bears and the sum does not, eq. 22 is far off, and not infinitely."""
    noise = math.sqrt(0.6 * 4.0 * 0.0208)  # σ² = .6 v of the outermost, v = r² K_a (theory §3); the sum needs < v/3
    found = averaged((0.1, 0.11, 2.0), (0.01,), trials=50, told=noise / 0.01)
    assert 1.0 < found.numbers[0].value < math.inf
    assert found.verdict in {Verdict.PARTLY, Verdict.NOT_REPRODUCED}


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
        ((0.01, 0.1, 1.0), 1.0, Verdict.PARTLY),
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
    values = [n.value for n in found.numbers]
    assert values[0] == 1.0
    assert found.numbers[0].trials == np.sum(sound) > 0
    assert values[1] == pytest.approx(np.mean(sound))
    assert values[2:5] == pytest.approx([min(shares), np.mean(shares), np.mean(singles)])
    assert values[5] == pytest.approx(np.mean(smallest[-1] > 0))  # the last noise has the least share
