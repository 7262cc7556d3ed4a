import numpy as np
from scipy.spatial.transform import Rotation

from study import mgdk
from study.mocap.geometry.skin_response import Cluster, MarkerResponse, image_skin, pair_skin, sphere_skin

ARMS = np.array([[0.0, 0.05, -0.2], [0.06, 0.0, -0.3], [-0.05, -0.04, -0.25]])
FRAME = np.array([[0.1, 0.1, 0.0], [0.1, -0.1, 0.0], [-0.1, 0.05, 0.02], [-0.1, -0.05, 0.02]])


def motion(frames=500):
    """Rotation vectors of mean zero, of some 10°."""
    t = np.arange(frames) / frames * 2 * np.pi
    return 0.2 * np.stack([np.sin(2 * t), 0.6 * np.sin(3 * t + 1), 0.5 * np.sin(5 * t + 2)])


def response(angles, z):
    """Response of a fit to three markers with weights 1/r²."""
    r = np.linalg.norm(ARMS, axis=1)
    normal = sum(each @ each.T / each.shape[1] / r[j] ** 2 for j, each in enumerate(z))
    slopes = np.array([each @ angles.T / each.shape[1] / r[j] for j, each in enumerate(z)])
    return MarkerResponse(np.linalg.inv(normal), slopes, ARMS / r[:, None], ARMS)


def test_spheres_against_refits():
    """The covariance is that of MGDK's centre over 400 bodies with skin of 5 mm/rad, half of it common to the markers.

    Each of three variances is from 400 draws: relative standard error .07; four of these, and 8 % of nonlinearity.
    """
    rng, angles = np.random.default_rng(4), motion()
    rotation = Rotation.from_rotvec(angles.T).as_matrix()
    clean = np.einsum("tij,mj->mit", rotation, ARMS)
    z = clean - clean.mean(axis=2, keepdims=True)
    stated = sphere_skin(response(angles, z), Cluster(FRAME, np.ones(4, dtype=bool)), 0.005**2, 0.0)
    centers = []
    for _ in range(400):
        common, own = np.sqrt(0.5) * 0.005 * rng.standard_normal((2, 3, 3, 3))
        moved = np.einsum("mij,jt->mit", own + common[:1], angles)
        y = np.einsum("tij,mjt->mit", rotation, ARMS[:, :, None] + moved)
        centers.append(mgdk([each.T for each in y]).center)
    found = np.cov(np.array(centers).T)
    np.testing.assert_allclose(np.diag(stated), np.diag(found), rtol=4 * 0.07 + 0.08)
    assert 1.0 < np.sqrt(np.linalg.eigvalsh(stated)[-1]) / 0.005 < 4.0  # about β metres, whatever the range


def test_common_skin_shifts_an_image_as_a_whole():
    """The pose's skin moves a point by its mean and by its rotation; a joint among the points is not on skin."""
    place = np.array([0.0, 0.1, -0.2])
    np.testing.assert_allclose(image_skin(Cluster(FRAME, np.ones(4, dtype=bool)), place, 0.0), np.eye(3))
    middle = image_skin(Cluster(FRAME, np.ones(4, dtype=bool)), FRAME.mean(axis=0), 1.0)
    np.testing.assert_allclose(middle, np.eye(3) / 4, atol=1e-12)
    three = Cluster(FRAME, np.array([False, True, True, True]))
    assert np.trace(image_skin(three, place, 1.0)) < np.trace(image_skin(Cluster(FRAME, np.ones(4, bool)), place, 1.0))


def test_pairs_against_least_squares():
    """The covariance is that of the point that minimises |Eθ + θ × dc|², for drawn E."""
    rng, angles = np.random.default_rng(5), motion()
    second = angles @ angles.T / angles.shape[1]
    cross = np.array([[[0, -c, b], [c, 0, -a], [-b, a, 0]] for a, b, c in angles.T]).reshape(-1, 3)
    shifts = [
        np.linalg.lstsq(cross, -(0.01 * rng.standard_normal((3, 3)) @ angles).T.ravel(), rcond=None)[0]
        for _ in range(1000)
    ]
    stated = pair_skin(second, np.eye(3), 0.01**2 * np.eye(3))
    np.testing.assert_allclose(np.diag(stated), np.var(shifts, axis=0), rtol=4 * np.sqrt(2 / 1000))
