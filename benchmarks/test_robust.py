"""A fit of contaminated points beside RANSAC of two packages, on the same points: time, and error.

Of 100 points 30 are gross outliers, spread over ten radii; the rest have noise of .01 r. RANSAC is told the noise,
ours is not. Errors are medians over sets, over those of the fit of the good points alone: they stand behind each name.
"""

import numpy as np
import peers
import pytest

import study

SETS, SAMPLES, BAD, SIGMA = 200, 100, 30, 0.01
FEW = 40


def contaminated(d):
    """Sets (200, 100, d) on half a sphere about the origin, the last 30 points of each anywhere within ten radii."""
    rng = np.random.default_rng(d)
    x = peers.half_sphere(rng, (SETS, SAMPLES, d), SIGMA)
    x[:, -BAD:] = rng.uniform(-10.0, 10.0, (SETS, BAD, d))
    return x


def words(name, centers, good):
    """The name, and the error beside that of the good points' own fit."""
    own = np.linalg.norm(study.fit(good, "corrected").center, axis=1)
    ratio = np.median(np.linalg.norm(centers, axis=1)) / np.median(own)
    return f"{name} (error {ratio:.2f})"


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("name", ["study", *peers.ROBUST])
def test_contaminated(timed, name, d):
    """Median error at most 1.3 of that of the good points alone, in the time that one RANSAC takes or less."""
    x = contaminated(d)
    good = x[:, :-BAD]
    group = f"30 gross outliers of 100 points, {d}-D, per fit"
    if name == "study":
        what = words("study.fit, two hundred at once, robust", study.fit(x, "robust").center, good)
        timed(group, what, study.fit, x, "robust", items=SETS, unit=True)
        return
    if d != peers.ROBUST[name][2]:
        pytest.skip(f"{name} does not fit {d} dimensions")
    fit = peers.fit_of(name, peers.ROBUST, SIGMA)
    what = words(f"{name} RANSAC, in a loop", np.array([fit(part) for part in x[:FEW]]), good[:FEW])
    timed(group, what, peers.one_by_one, fit, x[:FEW], items=FEW, aim="≥ 1", rounds=3)
