"""One centre from several markers seen from a moving frame: MGDK with the noise that the frame really has.

With noise of covariance I it is `study.mgdk` (paper eq. 22, corrected), size of the noise found as `als` does, weights
1/r̂²; here the covariance is that of `carried.py`, another for each sample (`pool.py`). Where markers move in planes, as
about a hinge, the direction across them is dropped.

The covariance is the sandwich of the estimating functions of (c, η), frame by frame, in its long-run form
(`timeseries.py`): it holds whatever the residuals are - correlated in time and between markers, larger here than there
- as long as there are many times more frames than their autocorrelation time.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from study.mocap.geometry.long_run_covariance import long_run
from study.mocap.joints.marker_moments import scores, seen
from study.mocap.joints.pooled_moments import TINY, Pool
from study.mocap.joints.pose_noise import CarriedNoise
from study.sphere.types import Bools, Floats

_PART = 600
"""Frames that suffice for a first idea of the noise."""
_CHANCE = 3.0
"""Standard errors within which a direction's extent, or what it explains, is no more than noise."""
_ROUND = 5.0
"""Least radius, in standard deviations of the noise, of markers that say where a centre is."""
_WORSE = 1.5
"""Growth of the noise's size, from what it was or should be, above which a direction cannot be done without."""
LIMIT = 0.999
"""A condition ρ above this is one at its limit of 1."""


@dataclass(frozen=True)
class Marker:
    """A marker as seen from a frame: y (3, frames), which samples count (frames,), variance of its own noise, m²."""

    y: Floats
    used: Bools
    own: float


@dataclass(frozen=True)
class Center:
    """A centre in a frame's axes.

    Attributes:
        center: ĉ (3,), metres. Along a dropped axis it is the mean of the markers' centroids.
        radii: r̂ of each marker (M,), metres, across the axis if one is dropped; NaN where none is real.
        noise: standard deviation of the residuals' noise along the radius, metres, noise of the frame included.
        size: η, the noise variance in units of what was expected.
        condition: ρ, the share of the least extent that is noise; below 1 for a centre to exist.
        covariance: of ĉ (3, 3), m², without the dropped axis.
        frames: how many took part; ``worth``: as many independent ones as these are worth.
        axis: direction that was dropped (3,), or None.
        least: direction in which the markers moved least (3,), dropped or not.
        flat: standard errors by which the extent along the least direction, dropped or not, exceeds noise.
        swing: root mean square angle by which the markers moved about the centre, along their principal directions
            (3,), ascending, radians; noise taken off.
    """

    center: Floats
    radii: Floats
    noise: float
    size: float
    condition: float
    covariance: Floats
    frames: int
    worth: float
    axis: Floats | None
    least: Floats
    flat: float
    swing: Floats

    @property
    def round(self) -> bool:
        """Whether any radius is several times the noise: a cloud of noise is not the sphere that it looks like."""
        return bool(np.nanmax(self.radii, initial=0.0) > _ROUND * self.noise)


def center(
    markers: Sequence[Marker], carried: CarriedNoise, hinge: bool | None = None, size: float | None = None
) -> Center | None:
    """Fit one centre.

    The direction of least extent is dropped, as for a hinge, if its extent is within noise, if it explains nothing of
    the residuals of the fit without it (`roots.hinge` asks the same two), and if that fit is no worse.

    Args:
        markers: at least one.
        carried: noise of the frame that they are seen from.
        hinge: whether a direction is dropped, if that is known already.
        size: of the noise, if that is known already; 0 gives GDKE's centre, which is drawn to the markers.

    Returns:
        None if the samples are too few, or lie on a line.
    """
    given, basis = size, np.eye(3)
    pool = _begun(markers, carried, given)
    if pool is None:
        return None
    size, middle = pool.solve(basis, given)
    present = [markers[k] for k in pool.present]
    score = _scores(present, carried, pool, size, middle, basis)
    covariance, worth = _covariance(score, pool, size, middle, basis)
    frames = int((score != 0.0).any(axis=0).sum())
    flat, axis = pool.flat(size, worth * frames, basis), None
    if hinge is None and pool.rounded():
        hinge = True
    least, across = pool.least(size)
    if hinge or (flat < _CHANCE and hinge is None):
        reduced = pool.solve(across, given)
        other = _scores(present, carried, pool, *reduced, across)
        # sizes, not residuals: moving the centre to where the frame itself turns least makes any residual smaller
        before = size if size < LIMIT * pool.top(np.eye(3)) else 0.0
        no_worse = reduced[0] < _WORSE * max(before, 1.0)
        if hinge or (
            no_worse and pool.flat(reduced[0], worth * frames, across) > _CHANCE and _by_chance(least @ other[:3])
        ):
            (size, middle), basis, axis = reduced, across, least
            covariance, worth = _covariance(other, pool, size, middle, basis)
        else:
            pool.weigh(middle, basis)
    radii = np.full(len(markers), np.nan)
    squares = pool.square_radii(middle, size, basis)
    radii[pool.present] = np.sqrt(np.where(squares > 0.0, squares, np.nan))
    return Center(
        center=middle, radii=radii, noise=pool.noise(size, middle, basis), size=size,
        condition=size / max(pool.top(basis), 1e-300), covariance=covariance, frames=frames, worth=worth * frames,
        axis=axis, least=least, flat=flat, swing=pool.swing(size),
    )  # fmt: skip


def middle_of(
    markers: Sequence[Marker], carried: CarriedNoise, hinge: bool = False, size: float | None = None
) -> Floats | None:
    """The centre alone (3,), as `center` finds it where it is known whether a direction is dropped."""
    pool = _begun(markers, carried, size)
    if pool is None:
        return None
    found, middle = pool.solve(np.eye(3), size)
    return pool.solve(pool.least(found)[1], size)[1] if hinge else middle


def _begun(markers: Sequence[Marker], carried: CarriedNoise, given: float | None) -> Pool | None:
    """Moments freed from what noise of the given size does to them; of one found in a part of the frames, if None."""
    size = 1.0 if given is None else given
    if given is None:  # what the noise draws in depends on its size, of which a first idea will do
        step = max(len(carried.pattern) // _PART, 1)
        some = [Marker(np.ascontiguousarray(m.y[:, ::step]), m.used[::step], m.own) for m in markers]
        pool = _pooled(some, carried.every(step), size)
        size = pool.solve(np.eye(3))[0] if pool is not None else size
    return _pooled(markers, carried, size)


def _pooled(markers: Sequence[Marker], carried: CarriedNoise, size: float) -> Pool | None:
    """Moments of the markers with two samples or more; None if they are too few, or lie on a line."""
    moments = [seen(m.y, m.used & (carried.pattern >= 0), carried, m.own, size) for m in markers]
    present = [k for k, each in enumerate(moments) if each.count >= 2]
    if sum(moments[k].count for k in present) < 3 + len(present):
        return None
    pool = Pool([moments[k] for k in present], present)
    return pool if pool.spread()[1] > TINY * pool.spread()[2] else None


def _by_chance(score: Floats) -> bool:
    """Whether scores (frames,) add up to no more than chance would have them."""
    return bool(score.sum() ** 2 < _CHANCE**2 * long_run(score[None])[0][0, 0])


def _scores(
    markers: Sequence[Marker], carried: CarriedNoise, pool: Pool, size: float, middle: Floats, basis: Floats
) -> Floats:
    """Estimating functions of (c, η) frame by frame (4, frames)."""
    result = np.zeros((4, len(carried.pattern)))
    within = basis @ basis.T
    for marker, moments, weight in zip(markers, pool.moments, pool.w / pool.n, strict=True):
        used = marker.used & (carried.pattern >= 0)
        scores(moments, used, carried, marker.own, size, middle, within, weight, result)
    return result


def _covariance(score: Floats, pool: Pool, size: float, middle: Floats, basis: Floats) -> tuple[Floats, float]:
    """Covariance of ĉ (3, 3), and what a frame is worth in independent ones."""
    d = basis.shape[1]
    inflated, instant = long_run(np.concatenate([basis.T @ score[:3], score[3:]]))
    inverse = np.linalg.pinv(pool.slopes(size, middle, basis))[:d]
    covariance = basis @ inverse @ inflated @ inverse.T @ basis.T
    plain = basis @ inverse @ instant @ inverse.T @ basis.T
    total = float(np.trace(covariance))
    return covariance, min(float(np.trace(plain)) / total, 1.0) if total > 0.0 else 1.0
