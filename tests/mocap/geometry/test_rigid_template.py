import numpy as np
import pytest
from scipy.spatial.distance import pdist
from scipy.spatial.transform import Rotation

from study.mocap.geometry.rigid_template import fit_template

SHAPE = np.array([[0.1, 0.12, 0.02], [0.1, -0.11, 0.0], [-0.12, 0.06, 0.01], [-0.1, -0.05, 0.06]])


@pytest.fixture
def seen(rng):
    """Make a shape in random poses (m, 3, frames), with noise and gaps."""

    def make(shape=SHAPE, frames=300, noise=0.0, gaps=0.0):
        turns = Rotation.random(frames, rng=rng).as_matrix()
        x = np.einsum("tij,mj->mit", turns, shape) + rng.normal(size=(3, frames))
        x += noise * rng.standard_normal(x.shape)
        x[np.broadcast_to(rng.random((len(shape), 1, frames)) < gaps, x.shape)] = np.nan
        return x

    return make


def proper(found, shape):
    """Largest coordinate difference of two shapes after the best proper rotation."""
    a, b = found - found.mean(axis=0), shape - shape.mean(axis=0)
    turn, _ = Rotation.align_vectors(a, b)
    return np.abs(a - turn.apply(b)).max()


@pytest.mark.parametrize("gaps", [0.0, 0.3])
def test_the_shape_comes_back(seen, gaps):
    """Without noise the shape, and not its mirror image, comes back to rounding, with gaps or without."""
    found = fit_template(seen(gaps=gaps))
    assert proper(found.points, SHAPE) < 1e-6
    assert not found.outliers.any()


def test_noise_averages_out(seen):
    """With noise of 2 mm and 2000 frames the shape's error is 2/√2000 mm per coordinate and a small bias.

    The largest of 12 deviates beyond 5 standard deviations: 7 in 10⁶; the bias is of second
    order, (σ/size)² of the size, 0.04 mm.
    """
    assert proper(fit_template(seen(frames=2000, noise=0.002)).points, SHAPE) < 5 * 0.002 / np.sqrt(2000) + 5e-5


def test_swapped_markers_are_found(seen):
    """Two markers exchanged in some frames are outliers in these frames alone, and the shape is as before."""
    x = seen(frames=500, noise=0.001)
    x[[0, 2], :, 100:130] = x[[2, 0], :, 100:130]
    found = fit_template(x)
    wrong = np.zeros((4, 500), dtype=bool)
    wrong[[0, 2], 100:130] = True
    assert (found.outliers[:, 100:130].sum(axis=0) >= 2).all()
    assert not found.outliers[:, ~wrong.any(axis=0)].any()
    assert proper(found.points, SHAPE) < 1e-3


def test_one_stray_marker(seen):
    """Of four markers, the displaced one is an outlier and no other."""
    x = seen(frames=400, noise=0.001)
    x[3, :, 50:60] += 0.2
    found = fit_template(x)
    assert found.outliers[3, 50:60].all()
    assert found.outliers.sum() == 10
    np.testing.assert_array_equal(found.good, ~found.outliers)


def test_two_markers(seen):
    """Of two markers both are outliers where their distance is wrong, for either may be."""
    x = seen(SHAPE[:2], frames=200, noise=0.001)
    x[1, :, 20:25] += 0.3
    found = fit_template(x)
    assert found.outliers[:, 20:25].all()
    assert found.outliers.sum() == 10
    np.testing.assert_allclose(pdist(found.points), pdist(SHAPE[:2]), atol=1e-3)


def test_marker_apart_from_the_others(seen):
    """A marker that no frame shows with the others has no place; the others have."""
    x = seen()
    x[3] = np.nan
    found = fit_template(x)
    assert np.isnan(found.points[3]).all()
    assert proper(found.points[:3], SHAPE[:3]) < 1e-6


def test_nothing_seen():
    """Without samples there is no shape, and no warning."""
    found = fit_template(np.full((3, 3, 10), np.nan))
    assert np.isnan(found.points).all()
    assert not found.good.any()
