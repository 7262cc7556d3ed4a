"""Noise of another shape than expected, and noise that is slow."""

import numpy as np
import pytest
from scipy.signal import lfilter

from study.mocap.geometry.pose_noise import PoseNoise
from study.mocap.joints.center import LocalMarker, fit_center
from study.mocap.joints.fit_joints import find_joints
from study.mocap.joints.marker_moments import marker_moments
from study.mocap.joints.pooled_moments import SHAPE_ERROR, PooledMoments
from study.mocap.markersets.set_file import load_markerset
from study.mocap.synthetic.recipe import Recipe
from study.mocap.synthetic.synthesize import synthesize

RADIUS, SIGMA = 0.1, 0.002
ARMS = np.array([[0.0, 0.0, -0.1], [0.06, 0.0, -0.08], [0.02, 0.05, -0.12]])


def exact_pose(frames):
    """A pose without noise."""
    none = np.zeros((1, 3, 3))
    return PoseNoise(np.zeros(frames, dtype=np.int64), np.zeros((1, 3)), none, none, none)


def swinging(rng, frames, slow, arms=ARMS[:1]):
    """Markers about a joint at the origin, with noise of which ``slow`` is the correlation of successive frames."""
    angles = np.radians(12.0) * np.sin(
        rng.uniform(0, 2 * np.pi, (3, 1)) + np.outer([0.11, 0.071, 0.053], np.arange(frames))
    )
    noise = lfilter([np.sqrt(1 - slow**2)], [1, -slow], rng.standard_normal((len(arms), 3, frames)), axis=2)
    y = arms[:, :, None] + np.cross(angles[None], arms[:, :, None], axis=1)
    y *= np.linalg.norm(arms, axis=1)[:, None, None] / np.linalg.norm(y, axis=1)[:, None]
    return [LocalMarker(each, np.ones(frames, dtype=bool), SIGMA**2) for each in y + SIGMA * noise]


def pooled(markers):
    """Moments of markers in the axes of an exact pose."""
    pose = exact_pose(markers[0].y.shape[1])
    return PooledMoments([marker_moments(m.y, m.used, pose, m.own, 1.0) for m in markers], list(range(len(markers))))


@pytest.mark.parametrize("slow", [0.0, 0.5, 0.9])
def test_slow_share(rng, slow):
    """The correlation of successive residuals is that of the noise, to 4 standard errors of 8000 frames.

    Its standard error is at most √((1 + φ²)/(1 - φ²)/n); the residual is linear in the noise along the radius.
    """
    found = pooled(swinging(rng, 8000, slow)).slow_share(np.zeros(3))
    assert found == pytest.approx(slow, abs=4 * np.sqrt((1 + slow**2) / (1 - slow**2) / 8000) + 0.002)


def test_a_frame_without_a_neighbour_shows_no_slow_share(rng):
    """Where each second sample is missing, no pair is left, and the share is 0."""
    (marker,) = swinging(rng, 200, 0.9)
    assert pooled([LocalMarker(marker.y, np.arange(200) % 2 == 0, marker.own)]).slow_share(np.zeros(3)) == 0.0


def test_slow_noise_hides_a_small_cap(rng):
    """The same extent that exceeds white noise may be tissue that slides along one line, if the noise is slow."""
    white, slow = (fit_center(swinging(rng, 4000, each), exact_pose(4000)) for each in (0.0, 0.95))
    assert white.significance > 4 * slow.significance > 0.0
    assert np.trace(slow.shape) > 10 * np.trace(white.shape)


def test_shape_covariance_is_what_noise_of_another_shape_does(rng):
    """It is the shift of the centre where the noise along a principal direction is larger, summed over directions.

    The refit with moments of such noise is independent of the Jacobian; weights that follow the centre, which the
    Jacobian leaves out, make up to a tenth.
    """
    moments = pooled(swinging(rng, 4000, 0.0, ARMS))
    size, center = moments.solve(np.eye(3))
    found = moments.shape_covariance(size, center, np.eye(3), SHAPE_ERROR)
    share, expected = 1e-3, np.zeros((3, 3))
    stacked = moments.stacked
    for e in np.linalg.eigh(moments.matrix(size, np.eye(3)))[1].T:
        along = np.einsum("i,pij,j->p", e, stacked.f, e)
        more = share * along[:, None, None] * np.outer(e, e)
        extent = np.einsum("i,pij,j->p", e, stacked.c, e)
        moments.stacked = stacked._replace(
            f=stacked.f + more, shift=stacked.shift + more, zfz=stacked.zfz + share * along * extent
        )
        shift = (moments.solve(np.eye(3))[1] - center) * SHAPE_ERROR / share
        expected += np.outer(shift, shift)
    assert np.linalg.norm(found - expected) < 0.1 * np.linalg.norm(expected)


def test_noise_along_the_radius_of_one_marker_is_measured(rng):
    """One marker's residual is the noise along its radius, so that an error of that moves no centre."""
    moments = pooled(swinging(rng, 4000, 0.0))
    size, center = moments.solve(np.eye(3))
    error = np.sqrt(np.diag(moments.shape_covariance(size, center, np.eye(3), SHAPE_ERROR)))
    extent = np.linalg.eigvalsh(moments.matrix(0.0, np.eye(3)))[0] / moments.w.sum()
    correction = RADIUS * size * SIGMA**2 / (extent - size * SIGMA**2)  # that part of the radius is due to it
    assert error[2] < 0.2 * SHAPE_ERROR * correction


def test_a_joint_adds_no_noise_to_the_poses_that_rest_on_it():
    """A joint's error is the same in every frame, so thighs and shanks show the markers' noise, 1 mm, to 6 %.

    Three residuals of a frame and 600 frames know it to 1.7 %: a false alarm in 2000 for one segment.
    """
    recording, _ = synthesize(Recipe(frames=600, rate=50.0, seed=3, noise=0.001, gait=True))
    found = find_joints(load_markerset("cmu41"), recording)
    for side in ("left", "right"):
        for segment in ("thigh", "shank", "upper_arm"):
            assert found.poses[f"{side}_{segment}"].sigma == pytest.approx(0.001, rel=0.06)
