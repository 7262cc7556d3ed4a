"""Claims of section 7 on several markers about one centre (MGDK), with eq. 22 as it must have been meant."""

import math

import numpy as np

from study.analysis.claims.claim import Claim, Evidence, Number, Verdict
from study.analysis.claims.shared_measures import formed, ratio
from study.analysis.kept_markers import Joint, joints
from study.estimators import Status, fit, mgdk
from study.sphere.moments import Moments
from study.sphere.types import Bools, Floats
from study.statistics.measures import Measure, quantile, share


def _alone(joint: Joint) -> Floats:
    """UGDK's errors of each marker (M, trials), infinite for fits that are not ok."""
    fits = [fit(marker, "ugdk", noise=joint.noise) for marker in joint.markers]
    return np.array([np.where(f.status == Status.OK, np.linalg.norm(f.center, axis=1), np.inf) for f in fits])


def _together(joint: Joint, weighted: bool = False, first: int = 0) -> Floats:
    """MGDK's errors (trials,), infinite for fits that are not ok, of the markers from a place on."""
    fits = [mgdk(sets, noise=joint.noise, weighted=weighted) for sets in zip(*joint.markers[first:], strict=True)]
    return np.array([np.linalg.norm(f.center) if f.status == Status.OK else np.inf for f in fits])


def _median(parts: list[Floats]) -> Measure:
    """Median of all parts together."""
    return quantile(np.concatenate(parts) if parts else np.empty(0), 0.5)


def _measure_averaging(evidence: Evidence) -> list[Number]:
    known = list(joints(evidence.table("markers", "errors"), evidence.table("markers", "points")))
    circles = list(joints(evidence.table("mgdk", "errors"), evidence.table("mgdk", "points")))
    trials = sum(len(joint.markers[0]) for joint in known)
    best, worst, both, outer = [], [], [], []
    little: tuple[list[Floats], list[Floats]] = ([], [])
    much: tuple[list[Floats], list[Floats]] = ([], [])
    for joint in known:
        alone, unit = _alone(joint), joint.noise
        order = np.argsort([quantile(each, 0.5).value for each in alone])
        best.append(alone[order[0]] / unit)
        worst.append(alone[order[-1]] / unit)
        both.append(_together(joint) / unit)
        outer.append(_together(joint, first=1) / unit)
        side = little if joint.noise <= 0.1 * joint.radii[0] else much if joint.noise >= joint.radii[0] else None
        if side is not None:
            side[0].append(_together(joint, weighted=True) / unit)
            side[1].append(best[-1])
    nearer = int(sum(np.sum(b < w) for b, w in zip(both, worst, strict=True)))
    without = ratio(_median(both), _median(outer))
    words = "median error, all fits: "
    return [
        Number.of(f"{words}all markers (eq. 22) over the best one", ratio(_median(both), _median(best)), trials),
        Number.of("share of trials in which eq. 22 is nearer than the worst marker", share(nearer, trials), trials),
        *formed(
            [
                Number.of(f"{words}eq. 22 over itself without the innermost", without, trials),
                _weighted("at most a tenth of the inner radius", *little),
                _weighted("the inner radius and more", *much),
                _circles(circles),
            ]
        ),
    ]


def _weighted(noises: str, joint: list[Floats], best: list[Floats]) -> Number:
    words = f"median error, all fits: weights 1/r̂² over the best one, noise {noises}"
    return Number.of(words, ratio(_median(joint), _median(best)), sum(map(len, joint)))


def _circles(known: list[Joint]) -> Number:
    """The setting of figure 6."""
    words = "median error, all fits: eq. 22 over the better of figure 6's circles"
    if not known:
        return Number.unknown(words)
    best = min((quantile(each, 0.5) for each in _alone(known[0])), key=lambda m: m.value)
    joint = _together(known[0])
    return Number.of(words, ratio(quantile(joint, 0.5), best), len(joint))


def _judge_averaging(numbers: list[Number]) -> Verdict:
    over_best, nearer = numbers[:2]
    if nearer.value - 3.0 * nearer.error <= 0.5:
        return Verdict.NOT_REPRODUCED
    return Verdict.REPRODUCED if over_best.value + 2.0 * over_best.error <= 0.9 else Verdict.PARTLY


def _definite(matrices: Floats) -> Bools:
    return np.asarray(np.linalg.eigvalsh(matrices)[..., 0] > 0.0)


def _measure_definite(evidence: Evidence) -> list[Number]:
    summed, single, names = [], [], []
    for noise, _, markers in joints(evidence.table("markers", "errors"), evidence.table("markers", "points")):
        covariances = np.stack([Moments.of(np.ascontiguousarray(m.swapaxes(1, 2))).covariance for m in markers])
        less = covariances - noise**2 * np.eye(markers[0].shape[2])
        summed.append(_definite(less.sum(axis=0)))
        single.append(_definite(less))
        names.append(f"σ = {noise:g}")
    if not summed:
        return [Number.unknown("share of trials whose summed matrix is positive definite")]
    shares = [_share(each) for each in summed]
    least = int(np.argmin([s.value for s in shares]))
    every, each_one = np.concatenate(summed), np.concatenate(single, axis=1)
    sound = each_one.all(axis=0)
    outermost = _share(single[least][-1])
    trials = len(summed[least])
    words = "share positive definite: "
    return [
        Number.of(f"{words}the sum, at the noise where it is least, {names[least]}", shares[least], trials),
        Number.of(f"{words}the sum, over all noises", _share(every), len(every)),
        Number.of(f"{words}a single marker's matrix, over all noises", _share(each_one), len(every)),
        Number.of(f"{words}the outermost marker's alone, {names[least]}", outermost, trials),
        *formed(
            [
                Number.of(f"{words}the sum, where every single one is", _share(every[sound]), int(sound.sum())),
                Number.of(f"{words}the sum, where some single one is not", _share(every[~sound]), int((~sound).sum())),
            ]
        ),
    ]


def _share(values: Bools) -> Measure:
    return share(int(np.sum(values)), values.size)


def _judge_definite(numbers: list[Number]) -> Verdict:
    least, summed, single = numbers[:3]
    if least.value >= 0.99:
        return Verdict.REPRODUCED
    safer = summed.value - single.value > 3.0 * math.hypot(summed.error, single.error)
    return Verdict.PARTLY if safer else Verdict.NOT_REPRODUCED


CLAIMS: tuple[Claim, ...] = (
    Claim(
        name="markers-averaged",
        section="7",
        statement="Several markers about one centre average out the errors of one that is too close to the centre or "
        "bad otherwise; the example improves dramatically on each circle alone.",
        quantity="error of the joint fit over those of its markers, at radii .1, .5 and 2 and several noises",
        criterion="Reproduced if the joint fit is nearer to the truth than the worst marker in more than half of the "
        "trials, by three standard errors, and its median error is below .9 of the best marker's, by two; partly if "
        "only the first; not reproduced otherwise.",
        reads=("markers/errors", "markers/points", "mgdk/errors", "mgdk/points"),
        measure=_measure_averaging,
        judge=_judge_averaging,
        figure="fig6_mgdk",
        remark="As printed, eq. 22 closes its sum before ½S_p and is wrong; here it is corrected. It weighs markers by "
        "r², so that an inner one does no harm, but of good ones it hears the outermost nearly alone. Weights 1/r̂² "
        "average truly while the noise is small against every radius, and let a drowned marker spoil the rest.",
    ),
    Claim(
        name="markers-positive-definite",
        section="7",
        statement="The matrix summed over markers is still positive definite, as a sum of positive definite matrices, "
        "so that Cholesky's decomposition serves.",
        quantity="share of trials in which Σ_p (C_p - Σ̂) is positive definite",
        criterion="Reproduced if the summed matrix is positive definite in at least 99 % of the trials at every noise; "
        "partly if it is so more often than a single marker's, by three standard errors; not reproduced otherwise.",
        reads=("markers/errors", "markers/points"),
        measure=_measure_definite,
        judge=_judge_definite,
        remark="The premise fails before the conclusion does: each C_p - Σ̂ must be positive definite, and is not "
        "where the noise hides the marker's extent. The noise of the sum grows as √M, its extent as Σ r²: it is safer "
        "than most of its markers, not than the outermost one.",
    ),
)
