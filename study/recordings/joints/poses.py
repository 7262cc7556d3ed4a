"""Poses of each segment over time, from a rigid template of its markers, and the noise of markers and poses.

Outliers. A distance between two markers of a rigid segment does not depend on its pose, and its median over time is not
moved by some wrong frames. A sample whose distances to the other markers are far from their medians is a swapped marker
or a stray one.

Shapes. Classical scaling turns the median distances between markers into a shape. Generalised Procrustes analysis
refines it on the frames without outliers: fit the shape to each frame, take the mean of the markers in the shape's
axes, repeat.

Poses. Three markers fix a pose. A segment with two gets its third point from a joint that is known already, as a thigh
does from its hip: the joint is fixed in both of its segments. The distances of markers from the rigid template show the
markers' noise, soft-tissue artefact included. A displacement that all markers of a segment share does not show.

A pose fitted to noisy markers is displaced by ε̄ and rotated by a small angle δ. Let a point be at v from the centroid
of the pose's markers, with noise ε of its own, of variance s² per axis; [v] w = v × w. Its error in the segment's axes
is ε - ε̄ + v × δ, of covariance

    F(v) = s² I + Cov ε̄ + [v] Cov δ [v]ᵀ - [v] Cov(δ, ε̄) - (…)ᵀ,                                               (*)

and to second order its mean place is (I - B) v, nearer to the centroid, with B = ½ (Tr Cov δ - Cov δ). F and B depend
on the shape of the template alone, and scale with the variance of the noise. The noise is neither isotropic nor the
same for all samples. Four markers on a pelvis rotate a marker of the thigh by a tenth of a degree per tenth of a
millimetre, and three in a thin triangle rotate it far more about the long side. A sphere fit that takes this noise for
isotropic is biased by centimetres at the knee. The moments of a marker are corrected for it sample by sample.

Frames of a recording follow each other within milliseconds, and soft tissue that is displaced in one still is in the
next. So the covariance of a fit must count effectively independent frames. The score of a frame, which is its part of
the estimating equations, carries what is needed: errors common to markers, unequal noise, correlation in time. The
variance of the sum of scores is their spectrum at frequency zero. It is estimated by the mean over the lowest
frequencies, up to a fraction of 1/τ, with τ = 1 + 2 Σ ρ(k) summed up to the first lag of at least 5τ.

Source: Torgerson 1952 (scaling); Gower 1975 (Procrustes), without change of size; Sokal 1997 (τ); Lazarus, Lewis, Stock
& Watson 2018 (equal weights on the lowest frequencies).
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import fft

from study.arrays import Bools, Floats, Ints
from study.recordings.markersets import MarkerSet
from study.recordings.recording import Recording
from study.recordings.rigid import fit_rigid_motion, skew, to_local, to_world

_FAR = 6.0
"""A distance this many robust standard deviations from its median is wrong..."""
_SLACK = 0.1
"""...if it is also this share of the median away from it: on a stiff segment distances scatter by next to nothing."""


def distance_outliers(x: Floats) -> tuple[Floats, Bools]:
    """Find the usual distances between markers, and the samples whose distances to the other markers are wrong.

    In each frame the marker with the most wrong distances is rejected, then the next, until the rest agree; of two
    markers with equally many, the one with the larger deviations. Of two markers alone either may be wrong, so both
    are rejected.

    Args:
        x: markers of one segment (m, 3, frames), metres; NaN where missing.

    Returns:
        Median distance between each two markers (m, m), metres, NaN for those that no frame shows together; and the
        samples to reject (m, frames).
    """
    m = len(x)
    middle, off = np.full((m, m), np.nan), np.zeros((m, m, x.shape[2]))  # off: deviations, in units of the limit
    np.fill_diagonal(middle, 0.0)
    for i, j in itertools.combinations(range(m), 2):
        distance = np.sqrt(((x[i] - x[j]) ** 2).sum(axis=0))
        known = distance[~np.isnan(distance)]
        if len(known):
            middle[i, j] = middle[j, i] = np.median(known)
            spread = 1.4826 * np.median(np.abs(known - middle[i, j]))  # 1 for a Gaussian of deviation 1
            limit = max(_FAR * spread, _SLACK * middle[i, j])
            with np.errstate(invalid="ignore", divide="ignore"):
                off[i, j] = off[j, i] = np.nan_to_num(np.abs(distance - middle[i, j]) / limit)
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
    return middle, result


_EXCHANGE = 0.01
"""Metres: least distance between the places of two markers, as the others show them, that tells them apart."""
_BETTER = 0.5
"""Misfit with two labels exchanged, as a share of that without, below which a frame has them exchanged."""
_OFTEN = 0.05
"""Share of the frames from which an exchange is no stray outlier."""


def exchanged_labels(x: Floats) -> tuple[int, int, Bools] | None:
    """Find the two markers of a rigid segment whose labels are exchanged in a part of the frames.

    The two markers have different distances to the other markers. In a minority of frames each shows the distances of
    the other: their labels are exchanged. These frames must outnumber the unclear ones, so that a segment that bends is
    not taken for an exchange.

    Args:
        x: markers of one segment (m, 3, frames), metres; NaN where missing.

    Returns:
        The two markers' numbers, and the frames in which their labels are exchanged (frames,); None if no two are
        exchanged in more than a twentieth of the frames that show all markers.
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
    middle, outliers = distance_outliers(x)
    good, points = seen & ~outliers, np.full((m, 3), np.nan)
    if m < 3:  # along the first axis, about their middle
        points = np.zeros((m, 3))
        points[:, 0] = [-0.5 * middle[0, 1], 0.5 * middle[0, 1]] if m == 2 else 0.0
        return points, good, outliers
    # markers of which each two share a frame; those that lack the most partners are left out first
    pairs, whole = np.isfinite(middle), list(range(m))
    while not pairs[np.ix_(whole, whole)].all():
        del whole[int(pairs[np.ix_(whole, whole)].sum(axis=1).argmin())]
    if len(whole) >= 3:  # classical scaling: a shape with nearly these distances, or its mirror image
        centring = np.eye(len(whole)) - 1.0 / len(whole)
        values, vectors = np.linalg.eigh(-0.5 * centring @ middle[np.ix_(whole, whole)] ** 2 @ centring)
        start = vectors[:, -3:] * np.sqrt(np.maximum(values[-3:], 0.0))
        points[whole] = _refine(start, x[whole], good[whole])
    return points, good, outliers


def _refine(points: Floats, x: Floats, good: Bools) -> Floats:
    """Procrustes mean, started from the given shape or its mirror image, whichever is nearer to the frames."""
    enough = np.flatnonzero(good.sum(axis=0) >= 3)
    if not len(enough):
        return np.full_like(points, np.nan)
    chosen = enough[np.linspace(0, len(enough) - 1, min(len(enough), _ENOUGH)).astype(int)]
    part, used = np.ascontiguousarray(x[:, :, chosen]), np.ascontiguousarray(good[:, chosen])

    def fitted(shape: Floats) -> tuple[Floats, Bools]:
        """The markers in the axes of a shape fitted to each frame, and the samples of those that it fits."""
        rotations, origins, known = fit_rigid_motion(shape, part, used)
        return to_local(rotations, origins, part), used & known

    def misfit(shape: Floats) -> float:
        """Mean square distance of the markers from a shape fitted to each frame, m²; infinite if it fits none."""
        y, counted = fitted(shape)
        square = ((y - shape[:, :, None]) ** 2).sum(axis=1)
        return float(square[counted].mean()) if counted.any() else np.inf

    points = min(points, points * np.array([1.0, 1.0, -1.0]), key=misfit)
    size = np.sqrt((points**2).sum())
    for _ in range(_ROUNDS):
        y, counted = fitted(points)
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = np.where(counted[:, None], y, 0.0).sum(axis=2) / counted.sum(axis=1)[:, None]
        following = mean - mean.mean(axis=0)
        change = np.abs(following - points).max()
        points = following if np.isfinite(change) else points  # points on a line fit no frame: keep the shape
        if not change > _CONVERGED * size:
            break
    return points


_WINDOW = 5.0
"""Autocorrelations are summed up to a lag of this many τ."""
_WIDTH = 10.0
"""The spectrum is averaged up to the frequency 1/(10 τ)..."""
_FEWEST = 8
"""...but over no fewer frequencies than these."""


def autocorrelation_time(series: Floats) -> Floats:
    """Integrated autocorrelation times of series of mean 0.

    Args:
        series: (k, frames). A frame without a value is 0 in it and adds nothing to the sum.

    Returns:
        Times (k,), in frames; at least 1, and 1 for a series of zeros.
    """
    n = series.shape[1]
    if n < 2:
        return np.ones(len(series))
    size = fft.next_fast_len(2 * n, real=True)
    spectrum = fft.rfft(series, size, axis=1)
    covariance = fft.irfft(spectrum.real**2 + spectrum.imag**2, size, axis=1)
    correlation = covariance[:, 1:n] / np.where(covariance[:, :1] > 0.0, covariance[:, :1], np.inf)
    sums = 1.0 + 2.0 * np.cumsum(correlation, axis=1)  # up to each lag
    wide = np.arange(1, n) >= _WINDOW * sums
    last = np.where(wide.any(axis=1), wide.argmax(axis=1), n - 2)
    return np.asarray(np.maximum(sums[np.arange(len(series)), last], 1.0))


def long_run_covariance(scores: Floats) -> tuple[Floats, Floats]:
    """Estimate the covariance of a sum over correlated frames.

    Args:
        scores: contribution of each frame to the sums (k, frames), of mean 0.

    Returns:
        Covariance of the sums (k, k), in no direction below that of independent frames; and the covariance for
        independent frames (k, k).
    """
    n = scores.shape[1]
    independent = scores @ scores.T
    scale = np.sqrt(np.maximum(np.diag(independent), 1e-300))
    scaled = scores / scale[:, None]
    tau = float(autocorrelation_time(scaled).max())
    count = int(min(max(n / (_WIDTH * tau), _FEWEST), (n - 1) // 2))
    if count < 1:
        return independent, independent
    lowest = fft.rfft(scaled, axis=1)[:, 1 : count + 1]
    spectrum = (lowest @ lowest.conj().T).real / count
    # ratio to the covariance for independent frames, direction by direction
    values, vectors = np.linalg.eigh(independent / np.outer(scale, scale))
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    inverse = np.linalg.pinv(root)
    ratios, axes = np.linalg.eigh(inverse @ spectrum @ inverse.T)
    inflated = root @ (axes * np.maximum(ratios, 1.0)) @ axes.T @ root.T
    return inflated * np.outer(scale, scale), independent


@dataclass(frozen=True)
class PoseNoise:
    """Noise of points fixed in the world, or in another segment, when they are expressed in a segment's axes.

    It is equal in all frames whose poses were fitted to the same set of points. Such a set is a *pattern*.

    Attributes:
        pattern: number of each frame's pattern (frames,); -1 where the pose is unknown.
        centroid: of the points in each pattern (patterns, 3), metres, in the segment's axes.
        shift: covariance of ε̄ (patterns, 3, 3), m².
        tilt: covariance of δ (patterns, 3, 3), rad².
        cross: covariance of δ with ε̄ (patterns, 3, 3), rad m.
    """

    pattern: Ints
    centroid: Floats
    shift: Floats
    tilt: Floats
    cross: Floats

    @classmethod
    def of(
        cls, template: Floats, noise: Floats, used: Bools, known: Bools, weights: Floats | None = None
    ) -> "PoseNoise":
        """Propagate the noise of a template's points to its fitted pose.

        Args:
            template: points (m, 3), metres.
            noise: covariance of each point's own noise (m, 3, 3), m², in the segment's axes.
            used: samples that the pose was fitted to (m, frames).
            known: frames in which the pose is known (frames,).
            weights: of the points in the fit (m,); equal if None.
        """
        w = np.ones(len(template)) if weights is None else weights
        bits = (np.where(used, 1, 0) << np.arange(len(template))[:, None]).sum(axis=0)
        distinct, where = np.unique(bits[known], return_inverse=True)
        pattern = np.full(used.shape[1], -1)
        pattern[known] = where
        masks = (distinct[:, None] >> np.arange(len(template))) & 1 == 1
        parts = zip(*(_first_order(template[mask], noise[mask], w[mask]) for mask in masks), strict=True)
        none = np.empty((0, 3)), *[np.empty((0, 3, 3))] * 3
        return cls(pattern, *(map(np.array, parts) if len(masks) else none))

    def covariance_at(self, point: Floats) -> Floats:
        """Mean over frames of the covariance (3, 3), m², that the pose gives to a point fixed in the segment (3,)."""
        weights = np.bincount(self.pattern[self.pattern >= 0], minlength=len(self.centroid))
        return np.asarray(np.einsum("k,kij->ij", weights / max(weights.sum(), 1), self.covariances_at(point)))

    def covariances_at(self, point: Floats) -> Floats:
        """Covariance (patterns, 3, 3), m², that the pose of each pattern gives to a point fixed in the segment (3,)."""
        k = skew(np.asarray(point) - self.centroid)
        mixed = k @ self.cross
        return self.shift + k @ self.tilt @ k.swapaxes(1, 2) - mixed - mixed.swapaxes(1, 2)

    def expansion(self, size: float = 1.0) -> Floats:
        """I + B (patterns, 3, 3) for noise of variance ``size``: undoes the mean contraction towards the centroid."""
        trace = np.trace(self.tilt, axis1=1, axis2=2)[:, None, None]
        return np.asarray(np.eye(3) + 0.5 * size * (trace * np.eye(3) - self.tilt))

    def mean_shift(self, size: float = 1.0) -> Floats:
        """Mean of δ × ε̄ (patterns, 3), metres: the mean displacement of points for noise of variance ``size``."""
        c = self.cross
        parts = [c[:, 1, 2] - c[:, 2, 1], c[:, 2, 0] - c[:, 0, 2], c[:, 0, 1] - c[:, 1, 0]]
        return size * np.stack(parts, axis=1)

    def corrected(self, y: Floats, frames: Bools, size: float) -> Floats:
        """Undo the mean effects of noise of variance ``size`` on a marker.

        Args:
            y: its places in the segment's axes (3, n), metres.
            frames: its frames (frames,), n of them, in which the pose is known.
            size: variance of the noise over the variance that is assumed here.
        """
        expansion, centroid, shift = self.mean_effects(frames, size)
        return centroid - shift + times(expansion, y - centroid)

    def mean_effects(self, frames: Bools, size: float) -> tuple[Floats, Floats, Floats]:
        """`expansion` (3, 3, n), centroid (3, n) and `mean_shift` (3, n) in n frames, for noise of this variance."""
        expansion, shift = self.in_patterns_of(self.expansion(size), frames), self.mean_shift(size)
        return expansion, self.in_patterns_of(self.centroid, frames), self.in_patterns_of(shift, frames)

    def covariances(self, y: Floats, frames: Bools, own: float) -> Floats:
        """Covariance F (3, 3, n), m², of a marker by (*), for each of n samples.

        Args:
            y: its places in the segment's axes (3, n), metres.
            frames: its frames (frames,), n of them, in which the pose is known.
            own: variance s² of its own noise, m².
        """
        shift = self.in_patterns_of(self.shift + own * np.eye(3), frames)
        if not self.tilt.any():  # an exact pose
            return np.broadcast_to(shift, (3, 3, y.shape[1]))
        v, cross = y - self.in_patterns_of(self.centroid, frames), self.in_patterns_of(self.cross, frames)
        tilted = _crossed(v, self.in_patterns_of(self.tilt, frames))
        half = _crossed(v, 0.5 * tilted.swapaxes(0, 1) - cross)  # ½ [v] Cov δ [v]ᵀ - [v] Cov(δ, ε̄)
        return shift + half + half.swapaxes(0, 1)

    def in_patterns_of(self, values: Floats, frames: Bools) -> Floats:
        """Values of the patterns (patterns, …) in frames (frames,), as (…, n); (…, 1) if there is one pattern."""
        values = values.T if values.ndim < 3 else values.transpose(1, 2, 0)
        return values if values.shape[-1] == 1 else np.take(values, self.pattern[frames], axis=-1)

    def in_frames(self, frames: Ints | slice) -> "PoseNoise":
        """The same noise in some of the frames."""
        return replace(self, pattern=self.pattern[frames])

    @property
    def removed(self) -> "PoseNoise":
        """The noise of an exact pose: only the isotropic noise of the markers themselves is left."""
        none = np.zeros_like(self.tilt)
        return replace(self, shift=none, tilt=none, cross=none)

    @property
    def worst_angles(self) -> Floats:
        """Standard deviation of the pose's rotation about its worst axis in each pattern (patterns,), radians."""
        return np.asarray(np.sqrt(np.maximum(np.linalg.eigvalsh(self.tilt)[:, -1], 0.0)))


def times(matrix: Floats, v: Floats) -> Floats:
    """Matrices (3, 3, n or 1) times vectors (3, n)."""
    return np.asarray(matrix[:, 0] * v[0] + matrix[:, 1] * v[1] + matrix[:, 2] * v[2])


def _crossed(v: Floats, m: Floats) -> Floats:
    """[v] m for vectors v (3, n) and matrices m (3, 3, n or 1)."""
    return np.array([v[1] * m[2] - v[2] * m[1], v[2] * m[0] - v[0] * m[2], v[0] * m[1] - v[1] * m[0]])


def _first_order(points: Floats, noise: Floats, weights: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Centroid, Cov ε̄, Cov δ and Cov(δ, ε̄) of Kabsch's fit to points (k, 3) of weights w (k,).

    To first order, δ = I⁻¹ Σ w a × ε and ε̄ = Σ w ε / Σ w.
    """
    share = weights / weights.sum()
    centroid = share @ points
    k = skew(points - centroid)
    inverse = np.linalg.pinv(np.einsum("m,mij,mkj->ik", share, k, k))
    rotated = share[:, None, None] * np.einsum("ij,mjk->mik", inverse, k)
    shift = np.einsum("m,mij->ij", share**2, noise)
    tilt = np.einsum("mij,mjk,mlk->il", rotated, noise, rotated)
    cross = np.einsum("mij,mjk,m->ik", rotated, noise, share)
    return centroid, shift, tilt, cross


def rigid_residual_operator(points: Floats) -> Floats:
    """Projection I - A A⁺ (3m, 3m) of stacked noise (m, 3) on what a rigid fit to points (m, 3) leaves of it."""
    k = skew(points - points.mean(axis=0))
    design = np.concatenate([np.broadcast_to(np.eye(3), k.shape), -k], axis=2).reshape(-1, 6)
    return np.asarray(np.eye(len(design)) - design @ np.linalg.pinv(design))


_LEAST_SIGMA = 1e-9
"""Metres: least noise, so that the shape of its covariance is defined where there is none."""
_LOOSE = 0.35
"""Radians (20°): a pose whose rotation about some axis has a larger standard deviation is not used."""


@dataclass(frozen=True)
class SegmentPoses:
    """Poses of one segment over time, and their noise.

    Attributes:
        segment: name of the segment.
        points: names of the points that the poses are fitted to: markers, and joints where markers are too few.
        template: their places in the segment's axes (m, 3), metres.
        rotation: R (3, 3, frames), NaN where unknown.
        origin: o (3, frames), metres, with x = R a + o; NaN where unknown.
        known: frames in which the pose is known (frames,).
        good: samples that the poses are fitted to (m, frames).
        outliers: samples that contradict the others, as after a swap of markers (m, frames).
        scatter: root mean square distance of each point from its place in the template (m,), metres.
        sigma: standard deviation of one coordinate of a marker's own noise, metres.
        noise: noise of the poses.
    """

    segment: str
    points: tuple[str, ...]
    template: Floats
    rotation: Floats
    origin: Floats
    known: Bools
    good: Bools
    outliers: Bools
    scatter: Floats
    sigma: float
    noise: PoseNoise

    def to_local(self, x: Floats) -> Floats:
        """Express points of the world (…, 3, frames) in the segment's axes, metres."""
        return to_local(self.rotation, self.origin, x)

    def to_world(self, point: Floats) -> Floats:
        """Express a point fixed in the segment's axes (3,) in the world (3, frames), metres."""
        return to_world(self.rotation, self.origin, point)

    def mean_place(self, x: Floats) -> Floats:
        """Mean place in the segment's axes (3,), metres, of a point of the world (3, frames) fixed in the segment.

        It is corrected for the mean effects of the poses' noise; NaN for a point that is always missing.
        """
        y = self.to_local(x)
        used = self.known & ~np.isnan(y[0])
        if not used.any():
            return np.full(3, np.nan)
        return np.asarray(self.noise.corrected(y.compress(used, axis=1), used, 1.0).mean(axis=1))

    def in_frames(self, frames: Ints) -> "SegmentPoses":
        """The same segment in some of the frames."""
        cut = {name: getattr(self, name)[..., frames] for name in ("rotation", "origin", "known", "good", "outliers")}
        return replace(self, noise=self.noise.in_frames(frames), **cut)

    def world_covariance(self, point: Floats) -> Floats:
        """Covariance in the world of a point fixed in the segment (3,), metres, from the poses' noise.

        Returns:
            One for each frame (3, 3, frames), m².
        """
        fixed = self.noise.covariance_at(point)
        return np.asarray(np.einsum("ijt,jk,lkt->ilt", self.rotation, fixed, self.rotation, optimize=True))


def fit_poses(
    segment: str, names: Sequence[str], places: Sequence[Floats], joint: Floats | None = None, reference: int = 0
) -> SegmentPoses | str:
    """Fit the poses of a segment to three points or more that are fixed in it.

    Args:
        segment: its name.
        names: of the points: markers, or a joint and markers.
        places: of each point in the world (3, frames), metres; NaN where missing.
        joint: covariance of the noise of the first point, if that is a joint, in the world's axes, one for each frame
            (3, 3, frames), m². The noise of markers is found from the residuals.
        reference: number of the frame in which the segment's axes are the world's, or the nearest one with a pose.

    Returns:
        The poses; or the reason why there are none, for a user.
    """
    listed = ", ".join(names) or "none"
    if len(names) < 3:
        return f"{segment} has {len(names)} point{'s' * (len(names) != 1)} ({listed}); its pose needs 3"
    x = np.stack(places)
    points, good, outliers = fit_template(x)
    if np.isnan(points).any():
        apart = [name for name, row in zip(names, points, strict=True) if np.isnan(row).any()]
        return f"{segment}: {', '.join(apart)} never seen together with the others"
    rotation, origin, known = fit_rigid_motion(points, x, good)
    if known.sum() < 2:
        return f"{segment}: its points ({listed}) lie on a line, or three are never seen at once"
    start = np.flatnonzero(known)[np.abs(np.flatnonzero(known) - reference).argmin()]
    first = rotation[:, :, start].copy()
    rotation, points = np.einsum("ijt,kj->ikt", rotation, first), points @ first.T
    residual = to_local(rotation, origin, x) - points[:, :, None]
    counted = good & known
    square = np.where(counted, (residual**2).sum(axis=1), 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        scatter = np.sqrt(square.sum(axis=1) / counted.sum(axis=1))
    given = None
    if joint is not None:  # in the segment's axes, the mean over the frames
        both = known & ~np.isnan(joint[0, 0])
        r, w = rotation[:, :, both], joint[:, :, both]
        given = np.einsum("jit,jkt,klt->il", r, w, r, optimize=True) / max(both.sum(), 1)
    sigma = _marker_sigma(points, square, counted, given)
    covariance = np.repeat(sigma**2 * np.eye(3)[None], len(points), axis=0)
    if given is not None:
        covariance[0] = given
    noise = PoseNoise.of(points, covariance, good, known)
    loose = noise.worst_angles > _LOOSE
    if loose[noise.pattern[known]].all():
        angle = np.degrees(noise.worst_angles.max())
        words = f"its points ({listed}) lie nearly on a line: the rotation about it is known to {angle:.0f}° only"
        return f"{segment}: {words}"
    known = known & ~np.where(known, loose[noise.pattern], False)
    rotation, origin = (np.where(known, part, np.nan) for part in (rotation, origin))
    noise = replace(noise, pattern=np.where(known, noise.pattern, -1))  # unknown in the frames of loose poses
    poses = rotation, origin, known, good & known, outliers
    return SegmentPoses(segment, tuple(names), points, *poses, scatter, sigma, noise)


def poses_from_markers(markerset: MarkerSet, recording: Recording, reference: int = 0) -> dict[str, SegmentPoses | str]:
    """Fit each segment's poses to its own markers alone; for a segment without any, the reason why."""
    paths = [(s, [recording.of(marker) for marker in s.markers]) for s in markerset.segments]
    return {s.name: fit_poses(s.name, s.markers, x, reference=reference) for s, x in paths}


def reference_frame(recording: Recording) -> int:
    """Number of the first frame with the most markers: the segments' axes are the world's there."""
    return int(recording.seen().sum(axis=0).argmax())


def _marker_sigma(points: Floats, square: Floats, counted: Bools, joint: Floats | None) -> float:
    """Standard deviation of a marker's coordinate that explains the residuals of the rigid fits.

    Args:
        points: template (m, 3).
        square: squared residuals (m, frames), m².
        counted: samples of the fits (m, frames).
        joint: covariance of the noise of the first point, if that is a joint (3, 3), m².
    """
    whole = counted.all(axis=0)
    if not whole.any():  # never all at once: each frame has six fewer residuals than coordinates
        spare = (3 * counted.sum(axis=0) - 6)[counted.sum(axis=0) >= 3].sum()
        return max(float(np.sqrt(square.sum() / max(spare, 1))), _LEAST_SIGMA)
    left = rigid_residual_operator(points)
    of_markers, of_joint = np.eye(len(left)), np.zeros_like(left)
    if joint is not None:
        of_markers[:3, :3], of_joint[:3, :3] = 0.0, joint
    expected, known = np.trace(left @ of_markers), np.trace(left @ of_joint)
    mean_square = float(square[:, whole].sum(axis=0).mean())
    # if the joint's noise alone explains the residuals: a tenth of the variance that they give without a joint
    least = 0.1 * mean_square / np.trace(left)
    return max(float(np.sqrt(max((mean_square - known) / expected, least))), _LEAST_SIGMA)
