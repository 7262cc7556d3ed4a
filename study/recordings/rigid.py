"""Rigid bodies from markers: wrong samples, the shape of a segment, its poses, and angles between two segments.

Outliers. A distance between two markers of a rigid segment does not depend on its pose, and its median over time is not
moved by some wrong frames. A sample whose distances to the other markers are far from their medians is a swapped marker
or a stray one.

Angles of a joint over time are rotation vectors about its mean position. They come from the rotations of one segment in
the other's axes; or, where only one segment has a pose, from the markers of the other about the joint's centre, to
first order.

Poses. Kabsch's fit is the rotation and translation that take a rigid template nearest to its points, in every video
frame. The rotation is built from the two leading singular directions; the third follows from right-handedness. So
points in a plane, as three always are, need no special case, and a mirror image is never taken for a rotation. Points
that are missing in a frame do not enter the fit. A frame of four points takes less than a microsecond.

The cross sums take any fixed point in place of the centroid, for fits about a joint.

Shapes. Classical scaling turns the median distances between markers into a shape. Generalised Procrustes analysis
refines it on the frames without outliers: fit the shape to each frame, take the mean of the markers in the shape's
axes, repeat.

Source: Kabsch 1976, 1978; Torgerson 1952 (scaling); Gower 1975 (Procrustes), without change of size.
"""

import itertools
import math

import numpy as np
from scipy.spatial.transform import Rotation

from study.arrays import Bools, Floats, Ints
from study.fits.jit import compiled
from study.fits.linalg import diagonalise

_FAR = 6.0
"""A distance this many robust standard deviations from its median is wrong..."""
_SLACK = 0.1
"""...if it is also this share of the median away from it: on a stiff segment distances scatter by next to nothing."""


def usual_distances(x: Floats) -> tuple[Floats, Floats]:
    """Median distance between each two markers, and the largest deviation from it that is accepted.

    Args:
        x: markers of one segment (m, 3, frames), metres; NaN where missing.

    Returns:
        Two arrays (m, m), metres; NaN for markers that no frame shows together.
    """
    m = len(x)
    middle, limit = np.full((m, m), np.nan), np.full((m, m), np.nan)
    np.fill_diagonal(middle, 0.0)
    for i in range(m):
        for j in range(i):
            distance = np.sqrt(((x[i] - x[j]) ** 2).sum(axis=0))
            distance = distance[~np.isnan(distance)]
            if len(distance):
                middle[i, j] = middle[j, i] = np.median(distance)
                spread = 1.4826 * np.median(np.abs(distance - middle[i, j]))  # 1 for a Gaussian of deviation 1
                limit[i, j] = limit[j, i] = max(_FAR * spread, _SLACK * middle[i, j])
    return middle, limit


def distance_outliers(x: Floats, middle: Floats, limit: Floats) -> Bools:
    """Find samples whose distances to the other markers of the frame are wrong.

    In each frame the marker with the most wrong distances is rejected, then the next, until the rest agree; of two
    markers with equally many, the one with the larger deviations. Of two markers alone either may be wrong, so both
    are rejected.

    Args:
        x: markers of one segment (m, 3, frames), metres; NaN where missing.
        middle: their usual distances (m, m).
        limit: largest accepted deviation from these (m, m).

    Returns:
        Samples to reject (m, frames).
    """
    m = len(x)
    off = np.zeros((m, m, x.shape[2]))
    for i in range(m):
        for j in range(i):
            distance = np.sqrt(((x[i] - x[j]) ** 2).sum(axis=0))
            with np.errstate(invalid="ignore", divide="ignore"):
                off[i, j] = off[j, i] = np.nan_to_num(np.abs(distance - middle[i, j]) / limit[i, j])
    result = np.zeros((m, x.shape[2]), dtype=np.bool_)
    suspect = np.flatnonzero((off > 1.0).any(axis=(0, 1)))
    part = off[:, :, suspect]
    for _ in range(m):
        wrong = (part > 1.0).sum(axis=1)  # (m, suspects)
        left = wrong.any(axis=0)
        if not left.any():
            break
        # the count decides; the size of the deviations breaks ties
        score = wrong + 1e-3 * np.minimum(part.sum(axis=1), 100.0)
        worst = score.argmax(axis=0)
        at = np.flatnonzero(left)
        rejected = np.zeros((m, len(suspect)), dtype=np.bool_)
        rejected[worst[at], at] = True
        last_two = (~result[:, suspect] & ~np.isnan(x[:, 0][:, suspect])).sum(axis=0) == 2
        rejected |= (wrong > 0) & (left & ((wrong > 0).sum(axis=0) == 2) & last_two)
        result[:, suspect] |= rejected
        part = np.where(rejected[:, None] | rejected[None], 0.0, part)
    return result


_EXCHANGE = 0.01
"""Metres: least distance between the places of two markers, as the others show them, that tells them apart."""
_BETTER = 0.5
"""Misfit with two labels exchanged, as a share of that without, below which a frame has them exchanged."""
_OFTEN = 0.05
"""Share of the frames from which an exchange is no stray outlier."""


def exchanged_labels(x: Floats) -> tuple[int, int, Bools] | None:
    """Find the two markers of a rigid segment whose labels are exchanged in a part of the frames.

    Distances to the other markers tell the two apart. In the frames of the smaller part they are those of the other.
    An exchange is clear in most frames, so it is not mistaken for a segment that bends.

    Args:
        x: markers of one segment (m, 3, frames), metres; NaN where missing.

    Returns:
        The two markers' numbers, and the frames in which their labels are exchanged (frames,); None if no two are in
        a twentieth of the frames that show all markers.
    """
    seen = ~np.isnan(x).any(axis=(0, 1))
    best, least = None, _OFTEN * max(seen.sum(), 1)
    between = np.linalg.norm(x[:, None] - x[None], axis=2)[:, :, seen]
    for i, j in itertools.combinations(range(len(x)), 2):
        others = [k for k in range(len(x)) if k not in (i, j)]
        one, two = between[i, others], between[j, others]
        apart = one - two
        if not apart.size or np.sqrt((apart**2).sum(axis=0).mean()) < _EXCHANGE:
            continue
        main = np.linalg.svd(apart, full_matrices=False)[2][0] > 0.0  # an exchange changes the sign of all differences
        main = main if 2 * main.sum() >= len(main) else ~main
        places = np.median(one[:, main], axis=1)[:, None], np.median(two[:, main], axis=1)[:, None]
        plain, crossed = (np.abs(one - a).sum(axis=0) + np.abs(two - b).sum(axis=0) for a, b in (places, places[::-1]))
        frames = crossed < _BETTER * plain
        unclear = ~frames & (plain > _BETTER * crossed)  # where skin moves as far as the two are apart
        if frames.sum() > max(least, unclear.sum()):
            best, least = (i, j, frames), frames.sum()
    if best is None:
        return None
    exchanged = np.zeros(x.shape[2], dtype=np.bool_)
    exchanged[seen] = best[2]
    return best[0], best[1], exchanged


_LOCKED = 1e-9
"""Sine of the angle between the first and the third axis below which they are one axis."""


def zxy_angles(r: Floats) -> Floats:
    """Angles about z, x and y (3, frames), radians, of rotations Rz Rx Ry (3, 3, frames), without jumps.

    Where z and y rotate about one axis, the angle about y is taken as 0.
    """
    tilt = np.arcsin(np.clip(r[2, 1], -1.0, 1.0))
    z, y = np.arctan2(-r[0, 1], r[1, 1]), np.arctan2(-r[2, 0], r[2, 2])
    locked = np.hypot(r[0, 1], r[1, 1]) < _LOCKED
    z, y = np.where(locked, np.arctan2(r[1, 0], r[0, 0]), z), np.where(locked, 0.0, y)
    return np.unwrap(np.stack([z, tilt, y]), axis=1)


def to_local(rotations: Floats, origins: Floats, x: Floats) -> Floats:
    """Express points of the world in moving axes: y = Rᵀ(x - o).

    Args:
        rotations: R (3, 3, frames).
        origins: o (3, frames).
        x: points (…, 3, frames).

    Returns:
        y, of the shape of x.
    """
    away = x - origins
    columns = [
        rotations[0, i] * away[..., 0, :] + rotations[1, i] * away[..., 1, :] + rotations[2, i] * away[..., 2, :]
        for i in range(3)
    ]
    return np.stack(columns, axis=-2)


def to_world(rotations: Floats, origins: Floats, point: Floats) -> Floats:
    """Express a point of moving axes in the world: R p + o.

    Args:
        rotations: R (3, 3, frames).
        origins: o (3, frames).
        point: p (3,), fixed in the moving axes, or one for each frame (3, frames).

    Returns:
        Places in the world (3, frames).
    """
    p = np.asarray(point)
    return np.asarray(rotations[:, 0] * p[0] + rotations[:, 1] * p[1] + rotations[:, 2] * p[2] + origins)


def relative_rotation(parent: Floats, child: Floats) -> Floats:
    """Rotations of one body in another's axes, R_PᵀR_Q (3, 3, frames), from both in the world (3, 3, frames)."""
    return np.asarray(np.einsum("jit,jkt->ikt", parent, child))


def mean_rotated_covariance(rotation: Floats, covariance: Floats) -> Floats:
    """Mean of R Σ Rᵀ (3, 3) over rotations (3, 3, frames), for a covariance Σ (3, 3)."""
    frames = rotation.shape[2]
    return np.asarray(np.einsum("ijt,jk,lkt->il", rotation, covariance, rotation, optimize=True) / frames)


def skew(v: Floats) -> Floats:
    """Matrices [v] (…, 3, 3) with [v] w = v × w."""
    result = np.zeros((*v.shape, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        result[..., k, j] = v[..., i]
        result[..., j, k] = -v[..., i]
    return result


def nearest_rotation(matrix: Floats) -> Floats:
    """Rotation (3, 3) nearest to a matrix (3, 3); for a sum of rotations it is their mean."""
    u, _, vt = np.linalg.svd(matrix)
    return np.asarray(u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt)


def across(axis: Floats | None) -> Floats:
    """Directions across an axis as columns (3, 2); all three (3, 3), if there is none."""
    return np.eye(3) if axis is None else np.asarray(np.linalg.svd(axis[None])[2][1:].T)


_NO_INERTIA = 1e-6
"""Share of markers' greatest moment of inertia below which they show no rotation about an axis."""


def rotation_vectors(rotation: Floats) -> Floats:
    """Rotation vectors about the mean rotation.

    Args:
        rotation: of one segment in another's axes (3, 3, frames); NaN where unknown.

    Returns:
        Vectors in the other's axes (3, frames), radians; NaN where unknown.
    """
    known = ~np.isnan(rotation[0, 0])
    vectors = np.full((3, rotation.shape[2]), np.nan)
    if known.any():
        matrices = np.moveaxis(rotation[:, :, known], 2, 0)
        mean = nearest_rotation(matrices.sum(axis=0))
        vectors[:, known] = Rotation.from_matrix(matrices @ mean.T).as_rotvec().T
    return vectors


def angles_about_center(y: Floats, used: Bools, center: Floats) -> Floats:
    """Rotation vectors of markers about a centre, to first order, from their mean places.

    About an axis along which all markers lie nothing shows, and the vector has no component.

    Args:
        y: markers in a segment's axes (M, 3, frames), metres.
        used: samples to use (M, frames).
        center: of the joint (3,), metres.

    Returns:
        Vectors (3, frames), radians, of mean zero; NaN where no marker is seen.
    """
    vectors = np.full((3, y.shape[2]), np.nan)
    seen = np.flatnonzero(used.any(axis=1))
    if not len(seen):
        return vectors
    y, used = y[seen], used[seen]
    shown = np.where(used[:, None], y, 0.0)
    mean = shown.sum(axis=2) / used.sum(axis=1)[:, None]
    arm = mean - center
    weight = 1.0 / np.maximum((arm**2).sum(axis=1), 1e-300)
    moment = np.cross(arm[:, :, None], np.where(used[:, None], y - mean[:, :, None], 0.0), axis=1)
    moment = np.einsum("m,mit->it", weight, moment)
    inertia = weight[:, None, None] * np.einsum("mij,mkj->mik", skew(arm), skew(arm))
    bits = (np.where(used, 1, 0) << np.arange(len(seen))[:, None]).sum(axis=0)
    for pattern in np.unique(bits[bits > 0]):
        frames = bits == pattern
        total = inertia[(pattern >> np.arange(len(seen))) & 1 == 1].sum(axis=0)
        vectors[:, frames] = np.linalg.pinv(total, rcond=_NO_INERTIA, hermitian=True) @ moment[:, frames]
    vectors -= np.nanmean(vectors, axis=1)[:, None]
    return vectors


def turning_ways(angles: Floats, lag: int, most: int) -> list[tuple[Bools, Bools]]:
    """Frames in which a joint rotates one way and the other, about each of the axes about which it rotates most.

    Args:
        angles: rotation vectors (3, frames), NaN where unknown.
        lag: the angles so many frames before and after decide the way, so that a frame's own noise does not.
        most: number of axes, one or two.

    Returns:
        The frames of each way (frames,), for each axis about which it rotates.
    """
    known = ~np.isnan(angles[0])
    if known.sum() < 2:
        return []
    values, axes = np.linalg.eigh(np.cov(angles[:, known]))
    difference = np.full(angles.shape, np.nan)
    difference[:, lag:-lag] = angles[:, 2 * lag :] - angles[:, : -2 * lag]
    turning = axes.T @ difference
    kept = [k for k in (2, 1)[:most] if values[k] > 0.0]
    with np.errstate(invalid="ignore"):
        return [(turning[k] > 0.0, turning[k] < 0.0) for k in kept]


_THIN = 0.03
"""Least extent of points across their main line, as a share of that along it, that fixes the rotation about it."""

Triple = tuple[float, float, float]
"""Three coordinates, as compiled code returns them."""


@compiled
def _times(matrix: Floats, vectors: Floats, column: int) -> Triple:
    """A matrix (3, 3) times a column of another."""
    a, b, c = vectors[0, column], vectors[1, column], vectors[2, column]
    return (
        matrix[0, 0] * a + matrix[0, 1] * b + matrix[0, 2] * c,
        matrix[1, 0] * a + matrix[1, 1] * b + matrix[1, 2] * c,
        matrix[2, 0] * a + matrix[2, 1] * b + matrix[2, 2] * c,
    )


@compiled
def _unit(v: Triple) -> Triple:
    size = 1.0 / math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    return size * v[0], size * v[1], size * v[2]


@compiled
def _cross(v: Triple, w: Triple) -> Triple:
    return v[1] * w[2] - v[2] * w[1], v[2] * w[0] - v[0] * w[2], v[0] * w[1] - v[1] * w[0]


@compiled
def best_rotation(cross: Floats, square: Floats, vectors: Floats, rotation: Floats) -> bool:
    """Find the rotation (3, 3) that maximises Tr(RᵀH) for ``cross`` = H = Σ x aᵀ: it takes a, b, a × b to p, q, p × q.

    a and b are the leading right singular vectors of H, p and q the left ones. ``square`` and ``vectors`` (3, 3) are
    scratch. Returns False, with ``rotation`` undefined, if H has rank one.
    """
    for i in range(3):
        for j in range(3):
            square[i, j] = cross[0, i] * cross[0, j] + cross[1, i] * cross[1, j] + cross[2, i] * cross[2, j]
    diagonalise(square, vectors)
    if not square[1, 1] > _THIN**4 * square[2, 2]:  # H holds squares of extents, and this is its square
        return False
    a = (vectors[0, 2], vectors[1, 2], vectors[2, 2])
    b = (vectors[0, 1], vectors[1, 1], vectors[2, 1])
    p, q = _unit(_times(cross, vectors, 2)), _times(cross, vectors, 1)
    along = p[0] * q[0] + p[1] * q[1] + p[2] * q[2]
    q = _unit((q[0] - along * p[0], q[1] - along * p[1], q[2] - along * p[2]))
    c, r = _cross(a, b), _cross(p, q)
    for i in range(3):
        for j in range(3):
            rotation[i, j] = p[i] * a[j] + q[i] * b[j] + r[i] * c[j]
    return True


@compiled
def centroids(template: Floats, x: Floats, used: Bools, t: int) -> tuple[int, Triple, Triple]:
    """Count the points used in frame t, and return the means of their template places (m, 3) and of x (m, 3, n)."""
    count, a0, a1, a2, x0, x1, x2 = 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(template.shape[0]):
        if used[k, t]:
            count += 1
            a0, a1, a2 = a0 + template[k, 0], a1 + template[k, 1], a2 + template[k, 2]
            x0, x1, x2 = x0 + x[k, 0, t], x1 + x[k, 1, t], x2 + x[k, 2, t]
    share = 1.0 / max(count, 1)
    return count, (share * a0, share * a1, share * a2), (share * x0, share * x1, share * x2)


@compiled
def cross_sums(template: Floats, x: Floats, used: Bools, t: int, a: Triple, b: Triple, cross: Floats) -> None:
    """Put Σ (x - b)(place - a)ᵀ over the points used in frame t into ``cross`` (3, 3)."""
    for i in range(3):
        for j in range(3):
            cross[i, j] = 0.0
    for k in range(template.shape[0]):
        if used[k, t]:
            d0, d1, d2 = template[k, 0] - a[0], template[k, 1] - a[1], template[k, 2] - a[2]
            e0, e1, e2 = x[k, 0, t] - b[0], x[k, 1, t] - b[1], x[k, 2, t] - b[2]
            cross[0, 0] += e0 * d0
            cross[0, 1] += e0 * d1
            cross[0, 2] += e0 * d2
            cross[1, 0] += e1 * d0
            cross[1, 1] += e1 * d1
            cross[1, 2] += e1 * d2
            cross[2, 0] += e2 * d0
            cross[2, 1] += e2 * d1
            cross[2, 2] += e2 * d2


@compiled
def _fit_frame(
    template: Floats, x: Floats, used: Bools, t: int, scratch: Floats, rotation: Floats, origin: Floats
) -> bool:
    """Fit a template (m, 3) to its points x (m, 3, n) in frame t; ``scratch`` is (3, 3, 3).

    Returns False, with ``rotation`` and ``origin`` undefined, if the points used do not fix them.
    """
    cross, square, vectors = scratch[0], scratch[1], scratch[2]
    count, a, b = centroids(template, x, used, t)
    if count < 3:
        return False
    cross_sums(template, x, used, t, a, b, cross)
    if not best_rotation(cross, square, vectors, rotation):
        return False
    for i in range(3):
        origin[i] = b[i] - rotation[i, 0] * a[0] - rotation[i, 1] * a[1] - rotation[i, 2] * a[2]
    return True


@compiled
def _fit_frames(template: Floats, x: Floats, used: Bools, rotations: Floats, origins: Floats, known: Bools) -> None:
    """Fit a template to every frame; see `fit_rigid_motion`."""
    n = x.shape[2]
    scratch, rotation, origin = np.empty((3, 3, 3)), np.empty((3, 3)), np.empty(3)
    for t in range(n):
        known[t] = _fit_frame(template, x, used, t, scratch, rotation, origin)
        for i in range(3):
            origins[i, t] = origin[i] if known[t] else math.nan
            for j in range(3):
                rotations[i, j, t] = rotation[i, j] if known[t] else math.nan


def fit_rigid_motion(template: Floats, x: Floats, used: Bools | None = None) -> tuple[Floats, Floats, Bools]:
    """Fit the pose of a rigid template in every video frame, by least squares.

    Args:
        template: points in the body's own axes (m, 3), metres.
        x: the same points in the world (m, 3, frames), metres; NaN where missing.
        used: samples to use (m, frames); all that are there, if None.

    Returns:
        Rotations R (3, 3, frames) and origins o (3, frames) with x ≈ R a + o, NaN where unknown; and the frames in
        which they are known (frames,), which have three points or more that do not lie on a line.
    """
    present = ~np.isnan(x).any(axis=1)
    n = x.shape[2]
    rotations, origins, known = np.empty((3, 3, n)), np.empty((3, n)), np.empty(n, dtype=np.bool_)
    chosen = present if used is None else present & used
    _fit_frames(np.ascontiguousarray(template), x, np.asarray(chosen), rotations, origins, known)
    return rotations, origins, known


_QUANTILE = 0.95
"""Share of the samples within the angle; the rest may be outliers."""


def cap_angle(y: Floats, used: Bools, center: Floats) -> float:
    """Half-angle of the cap about the mean direction that holds 95 % of a marker's samples.

    Args:
        y: the marker in the segment's axes (3, frames), metres.
        used: samples to use (frames,).
        center: centre of the joint (3,), metres.

    Returns:
        The angle, radians; NaN without samples.
    """
    away = y[:, used] - center[:, None]
    with np.errstate(invalid="ignore"):
        direction = away / np.sqrt((away**2).sum(axis=0))
    if not direction.size or np.isnan(direction).all():
        return float("nan")
    middle = np.nanmean(direction, axis=1)
    length = np.sqrt((middle**2).sum())
    if not length > 0.0:
        return float(np.pi)
    cosine = np.clip(middle @ direction / length, -1.0, 1.0)
    return float(np.nanquantile(np.arccos(cosine), _QUANTILE))


def rotation_range(rotation: Floats) -> float:
    """Angle about the mean orientation within which 95 % of rotations lie.

    Args:
        rotation: of one segment in another's axes (3, 3, frames), NaN where unknown.

    Returns:
        The angle, radians; NaN without a known rotation.
    """
    known = rotation[:, :, ~np.isnan(rotation[0, 0])]
    if not known.shape[2]:
        return float("nan")
    mean = nearest_rotation(known.mean(axis=2))
    trace = np.einsum("ij,ijt->t", mean, known)
    return float(np.quantile(np.arccos(np.clip((trace - 1.0) / 2.0, -1.0, 1.0)), _QUANTILE))


_ENOUGH = 500
"""Most frames that a shape is refined on, spread over the recording; more would not change it visibly."""
_ROUNDS = 30
_CONVERGED = 1e-7
"""Refinement ends after a round that changes the shape by less than this share of its size."""


def fit_template(x: Floats) -> tuple[Floats, Bools, Bools]:
    """Find the shape of the markers of one segment, and the samples that agree with it.

    Args:
        x: markers (m, 3, frames), metres; NaN where missing.

    Returns:
        The shape (m, 3), metres, about its centroid, with axes as in one frame of the recording; NaN for a marker that
        no frame shows together with the others. Samples that are present and whose distances to the other markers are
        right (m, frames); and those whose distances are wrong, as those of swapped markers (m, frames).
    """
    m, seen = len(x), ~np.isnan(x).any(axis=1)
    middle, limit = usual_distances(x)
    outliers = distance_outliers(x, middle, limit)
    good, points = seen & ~outliers, np.full((m, 3), np.nan)
    if m < 3:  # along the first axis, about their middle
        points = np.zeros((m, 3))
        points[:, 0] = [-0.5 * middle[0, 1], 0.5 * middle[0, 1]] if m == 2 else 0.0
    elif len(whole := _jointly_visible(np.isfinite(middle))) >= 3:
        points[whole] = _refine(_classical_scaling(middle[np.ix_(whole, whole)]), x[whole], good[whole])
    return points, good, outliers


def _jointly_visible(pairs: Bools) -> Ints:
    """Markers of which each two share a frame; those that lack the most partners are left out first."""
    chosen = list(range(len(pairs)))
    while not pairs[np.ix_(chosen, chosen)].all():
        del chosen[int(pairs[np.ix_(chosen, chosen)].sum(axis=1).argmin())]
    return np.array(chosen)


def _classical_scaling(distances: Floats) -> Floats:
    """Points (m, 3) with nearly these distances (m, m), or their mirror image."""
    m = len(distances)
    centring = np.eye(m) - 1.0 / m
    values, vectors = np.linalg.eigh(-0.5 * centring @ distances**2 @ centring)
    leading = np.sqrt(np.maximum(values[-3:], 0.0))
    return np.asarray(vectors[:, -3:] * leading)


def _refine(points: Floats, x: Floats, good: Bools) -> Floats:
    """Procrustes mean, started from the given shape or its mirror image, whichever is nearer to the frames."""
    enough = np.flatnonzero(good.sum(axis=0) >= 3)
    if not len(enough):
        return np.full_like(points, np.nan)
    chosen = enough[np.linspace(0, len(enough) - 1, min(len(enough), _ENOUGH)).astype(int)]
    part, used = np.ascontiguousarray(x[:, :, chosen]), np.ascontiguousarray(good[:, chosen])
    mirrored = points * np.array([1.0, 1.0, -1.0])
    points = min(points, mirrored, key=lambda shape: _mean_square_distance(shape, part, used))
    size = np.sqrt((points**2).sum())
    for _ in range(_ROUNDS):
        following = _mean_shape(points, part, used)
        change = np.abs(following - points).max()
        points = following if np.isfinite(change) else points  # points on a line fit no frame: keep the shape
        if not change > _CONVERGED * size:
            break
    return points


def _mean_shape(points: Floats, x: Floats, used: Bools) -> Floats:
    """Mean of the markers (m, 3) in the axes of a shape fitted to each frame, about its centroid."""
    rotations, origins, known = fit_rigid_motion(points, x, used)
    y = to_local(rotations, origins, x)
    count = (used & known).sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where((used & known)[:, None], y, 0.0).sum(axis=2) / count[:, None]
    return np.asarray(mean - mean.mean(axis=0))


def _mean_square_distance(points: Floats, x: Floats, used: Bools) -> float:
    """Mean square distance of the markers from a shape fitted to each frame, m²; infinite if it fits none."""
    rotations, origins, known = fit_rigid_motion(points, x, used)
    y = to_local(rotations, origins, x) - points[:, :, None]
    counted = used & known
    return float((y**2).sum(axis=1)[counted].mean()) if counted.any() else np.inf
