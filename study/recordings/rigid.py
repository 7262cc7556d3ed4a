"""Rigid bodies: their poses from points, rotations, and angles between two of them.

Angles of a joint over time are rotation vectors about its mean position. They come from the rotations of one segment in
the other's axes; or, where only one segment has a pose, from the markers of the other about the joint's centre, to
first order.

Poses. Kabsch's fit is the rotation and translation that take a rigid template nearest to its points, in every video
frame. The rotation is Markley's closed form, which needs one root of a quartic and no eigenvectors. It takes points in
a plane, as three always are, without a special case, and never takes a mirror image for a rotation. Points that are
missing in a frame do not enter the fit. A frame of four points takes a quarter of a microsecond. Points of unequal
noise, such as a joint beside markers, have weights.

Source: Kabsch 1976, 1978; Markley 1993, J. Astronaut. Sci. 41(2), 261-280.
"""

import math

import numpy as np
from scipy.spatial.transform import Rotation

from study.arrays import Bools, Floats
from study.fits.loops.jit import compiled, squared

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
    a, b, c = np.moveaxis(x - origins, -2, 0)[..., None, :]  # coordinates (…, 1, frames)
    return np.ascontiguousarray(rotations[0] * a + rotations[1] * b + rotations[2] * c)


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


def quaternions(rotations: Floats) -> Floats:
    """Quaternions x, y, z, w (frames, 4) of rotations (frames, 3, 3), without jumps of sign."""
    turns = Rotation.from_matrix(rotations).as_quat()
    signs = np.where((turns[1:] * turns[:-1]).sum(axis=1) < 0.0, -1.0, 1.0)
    return np.asarray(turns * np.cumprod([1.0, *signs])[:, None])


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
    with np.errstate(invalid="ignore"):
        return [(turning[k] > 0.0, turning[k] < 0.0) for k in (2, 1)[:most] if values[k] > 0.0]


_THIN = 0.03
"""Least extent of points across their main line, as a share of that along it, that fixes the rotation about it."""

_MOST_STEPS = 60
"""Steps of Newton's method: mostly 6 to 10 do; where two roots are nearly equal, each halves the distance."""


@compiled
def best_rotation(h: Floats, cofactors: Floats, square: Floats, rotation: Floats) -> bool:
    """Find the rotation R (3, 3) that maximises λ = Tr(RᵀH) for H = Σ x aᵀ (Markley 1993).

    λ is the largest root of (λ² - ‖H‖²)² - 8 λ det H - 4 ‖adj H‖², found by Newton's method from above.
    ``cofactors`` and ``square`` (3, 3) are scratch. Returns False, with ``rotation`` undefined, if several rotations
    are as good: if H has rank one, or is that of a mirror image with two equal extents or more.
    """
    norm = minors = det = 0.0
    for i in range(3):
        for j in range(3):
            k, m, p, q = (i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3
            cofactors[i, j] = h[k, p] * h[m, q] - h[k, q] * h[m, p]
            square[i, j] = h[0, i] * h[0, j] + h[1, i] * h[1, j] + h[2, i] * h[2, j]
            norm += squared(h[i, j])
            minors += squared(cofactors[i, j])
    for j in range(3):
        det += h[0, j] * cofactors[0, j]
    trace, step = math.sqrt(3.0 * norm), 0.0
    for _ in range(_MOST_STEPS):
        over = squared(trace) - norm
        step = 0.25 * (squared(over) - 8.0 * trace * det - 4.0 * minors) / (trace * over - 2.0 * det)
        trace -= step
        if not step > 1e-15 * trace:
            break
    kappa = 0.5 * (squared(trace) - norm)
    zeta = kappa * trace - det  # (s1 + s2)(s2 + s3)(s3 + s1), of the singular values, s3 with the sign of det H
    if not (zeta > squared(_THIN) * trace * trace * trace and abs(step) < 1e-9 * trace):  # H holds squares of extents
        return False
    for i in range(3):
        for j in range(3):
            cubic = h[i, 0] * square[0, j] + h[i, 1] * square[1, j] + h[i, 2] * square[2, j]
            rotation[i, j] = ((kappa + norm) * h[i, j] + trace * cofactors[i, j] - cubic) / zeta
    return True


@compiled
def _means(places: Floats, weights: Floats, x: Floats, used: Bools, t: int, a: Floats, b: Floats) -> None:
    """Put the weighted means of the places and of x over the points used in frame t into a and b (3,)."""
    a[:], b[:], total = 0.0, 0.0, 0.0
    for k in range(used.shape[0]):
        if used[k, t]:
            total += weights[k]
            for i in range(3):
                a[i] += weights[k] * places[k, i]
                b[i] += weights[k] * x[k, i, t]
    share = 1.0 / total
    for i in range(3):
        a[i], b[i] = share * a[i], share * b[i]


@compiled
def _stray(places: Floats, x: Floats, used: Bools, t: int, limits: Floats) -> int:
    """Find which of three points is off: both of its distances to the others are wrong.

    A fit to three points shares the error among them, so that the largest residual may be another's.
    """
    worst, which = -1.0, -1
    for k in range(used.shape[0]):
        if used[k, t] and limits[k] < math.inf:
            off = 0.0
            for j in range(used.shape[0]):
                if used[j, t]:
                    wanted = away = 0.0
                    for i in range(3):
                        wanted += squared(places[k, i] - places[j, i])
                        away += squared(x[k, i, t] - x[j, i, t])
                    off += abs(math.sqrt(away) - math.sqrt(wanted))
            if off > worst:
                worst, which = off, k
    return which


Poses = tuple[Floats, Floats, Bools, Bools, Floats]
"""Poses over time, as `fit_poses_to` returns them."""


@compiled
def _fit_frames(places: Floats, weights: Floats, limits: Floats, x: Floats, poses: Poses) -> None:
    """Compiled part of `fit_poses_to`."""
    rotation, origin, fitted, used, square = poses
    m, n = used.shape
    a, b, o = np.empty(3), np.empty(3), np.empty(3)
    cross, cofactors, scratch, r = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    for t in range(n):
        count = used[:, t].sum()
        while count >= 3:
            _means(places, weights, x, used, t, a, b)
            cross[:] = 0.0  # Σ w (x - b)(place - a)ᵀ
            for k in range(m):
                if used[k, t]:
                    for i in range(3):
                        for j in range(3):
                            cross[i, j] += weights[k] * (x[k, i, t] - b[i]) * (places[k, j] - a[j])
            if not best_rotation(cross, cofactors, scratch, r):
                break
            for i in range(3):
                o[i] = b[i] - r[i, 0] * a[0] - r[i, 1] * a[1] - r[i, 2] * a[2]
            worst, which, total = 0.0, -1, 0.0
            for k in range(m):
                if used[k, t]:
                    far, (p0, p1, p2) = 0.0, (places[k, 0], places[k, 1], places[k, 2])
                    for i in range(3):
                        far += squared(x[k, i, t] - o[i] - r[i, 0] * p0 - r[i, 1] * p1 - r[i, 2] * p2)
                    total += far
                    if far > worst * squared(limits[k]):
                        worst, which = far / squared(limits[k]), k
            if worst > 1.0:
                if count == 3:
                    which = _stray(places, x, used, t, limits)
                used[which, t] = False
                count -= 1
                continue
            fitted[t], square[t] = True, total / count
            rotation[:, :, t], origin[:, t] = r, o
            break


def fit_poses_to(
    places: Floats, x: Floats, limits: Floats, weights: Floats | None = None, used: Bools | None = None
) -> Poses:
    """Fit the pose of a rigid body to points of it in every video frame, by weighted least squares.

    Three points fix it. Of points that are too far from their places the farthest is rejected and the rest are fitted
    again. Time is proportional to the number of points.

    Args:
        places: of its points in its axes (m, 3), metres.
        x: the points in the world (m, 3, frames), metres; NaN where missing.
        limits: largest distance of each from its place (m,), metres.
        weights: of the points (m,), as 1/σ² of each; equal if None.
        used: samples to use (m, frames); all that are there, if None.

    Returns:
        Rotations R (3, 3, frames) and origins o (3, frames), metres, with x ≈ R a + o, NaN where unknown; the frames in
        which they are known (frames,); the samples used (m, frames); and the mean square distance of these from their
        places (frames,), m², NaN where the pose is unknown.
    """
    n, present = x.shape[2], np.asarray(~np.isnan(x).any(axis=1))
    chosen = present if used is None else present & used
    poses: Poses = np.full((3, 3, n), np.nan), np.full((3, n), np.nan), np.zeros(n, bool), chosen, np.full(n, np.nan)
    same = np.ones(len(x)) if weights is None else weights
    _fit_frames(np.ascontiguousarray(places), same, limits, np.ascontiguousarray(x), poses)  # one layout to compile
    return poses


def fit_rigid_motion(template: Floats, x: Floats, used: Bools | None = None) -> tuple[Floats, Floats, Bools]:
    """Fit the pose of a rigid template in every video frame, by least squares, whatever its points' distances.

    Args:
        template: points in the body's own axes (m, 3), metres.
        x: the same points in the world (m, 3, frames), metres; NaN where missing.
        used: samples to use (m, frames); all that are there, if None.

    Returns:
        Rotations R (3, 3, frames) and origins o (3, frames) with x ≈ R a + o, NaN where unknown; and the frames in
        which they are known (frames,), which have three points or more that do not lie on a line.
    """
    return fit_poses_to(template, x, np.full(len(template), np.inf), used=used)[:3]


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


def implied_angles(values: Floats) -> Floats:
    """Root mean square angles about three axes (3,), radians, by the singular values of the mean of rotations (3,).

    Rotation about one axis shrinks the mean in the directions of the other two.
    """
    s = values
    squares = [s[0] - s[1] - s[2] + 1.0, s[1] - s[0] - s[2] + 1.0, s[2] - s[0] - s[1] + 1.0]
    return np.asarray(np.sqrt(np.maximum(squares, 0.0)))


def rms_rotation(rotation: Floats) -> Floats:
    """Root mean square angles of rotations (3, 3, frames) about three axes (3,), radians; NaN without a known one."""
    known = rotation[:, :, ~np.isnan(rotation[0, 0])]
    if not known.shape[2]:
        return np.full(3, np.nan)
    return implied_angles(np.linalg.svd(known.mean(axis=2), compute_uv=False))


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
