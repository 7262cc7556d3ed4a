"""Claims of section 7 on several markers about one centre (MGDK), by the corrected eq. 22."""

import numpy as np

from study.arrays import Floats
from study.simulation.analysis.regret import JointMarkers, fit_joints
from study.simulation.claims.claim import Claim, Evidence, Number, Verdict, only_known, ratio
from study.simulation.statistics import Measure, quantile


def _alone(joint: JointMarkers) -> Floats:
    """UGDK's errors of each marker (M, trials), as computed."""
    return np.array([fit_joints([marker], joint.sigma).distances() for marker in joint.markers])


def _together(joint: JointMarkers, weighted: bool = False, first: int = 0) -> Floats:
    """MGDK's errors (trials,), as computed.

    Args:
        joint: the markers.
        weighted: weigh markers by 1/r̂².
        first: index of the innermost marker that is used.
    """
    return fit_joints(joint.markers[first:], joint.sigma, weighted).distances()


def _median(parts: list[Floats]) -> Measure:
    """Median over all parts."""
    return quantile(np.concatenate(parts) if parts else np.empty(0), 0.5)


def _weighted(noises: str, joint: list[Floats], best: list[Floats]) -> Number:
    words = f"median error of all fits: weights 1/r̂² over the best marker alone, σ {noises}"
    return Number.of(words, ratio(_median(joint), _median(best)), sum(map(len, joint)))


def _circles(known: list[JointMarkers]) -> Number:
    """Ratio of the median errors in the setting of figure 6: both circles over the better one."""
    words = "median error of all fits: eq. 22 over the better circle, in the setting of figure 6"
    if not known:
        return Number.unknown(words)
    best = min((quantile(each, 0.5) for each in _alone(known[0])), key=lambda m: m.value)
    joint = _together(known[0])
    return Number.of(words, ratio(quantile(joint, 0.5), best), len(joint))


class MarkersAveraged(Claim):
    """Several markers about one centre average out the errors of a marker that is too close to the centre or bad
    otherwise; in the example the fit improves dramatically on each circle alone.

    Eq. 22 as printed closes its sum before ½S_p, which is wrong; here it is corrected. It weighs markers by r²: an
    inner marker does no harm, but among good markers the outermost nearly decides alone. Weights 1/r̂² give a true
    average if the noise is small against every radius; otherwise a marker hidden by the noise spoils the fit.
    """

    name, section, figure = "markers-averaged", "7", "fig6_mgdk"
    reads = ("markers/errors", "markers/points", "mgdk/errors", "mgdk/points")
    quantity = "error of the fit to all markers over errors of single markers, at radii .1, .5 and 2 and several noises"
    answer = (
        "the fit to all markers errs {0:times} as far as the best marker alone, and less than the worst in "
        "{1:share} of the trials."
    )

    def measure(self, evidence: Evidence) -> list[Number]:
        known, circles = evidence.joints("markers"), evidence.joints("mgdk")
        trials = sum(len(joint.markers[0]) for joint in known)
        best, worst, both, outer = [], [], [], []
        little: tuple[list[Floats], list[Floats]] = ([], [])
        much: tuple[list[Floats], list[Floats]] = ([], [])
        for joint in known:
            alone, unit = _alone(joint), joint.sigma
            order = np.argsort([quantile(each, 0.5).value for each in alone])
            best.append(alone[order[0]] / unit)
            worst.append(alone[order[-1]] / unit)
            both.append(_together(joint) / unit)
            outer.append(_together(joint, first=1) / unit)
            side = little if joint.sigma <= 0.1 * joint.radii[0] else much if joint.sigma >= joint.radii[0] else None
            if side is not None:
                side[0].append(_together(joint, weighted=True) / unit)
                side[1].append(best[-1])
        nearer = np.concatenate([b < w for b, w in zip(both, worst, strict=True)] or [np.empty(0, dtype=bool)])
        without = ratio(_median(both), _median(outer))
        words = "median error of all fits: eq. 22 with all markers over"
        return [
            Number.of(f"{words} the best marker alone", ratio(_median(both), _median(best)), trials),
            Number.share("share of trials in which eq. 22 errs less than the worst marker alone", nearer),
            *only_known(
                Number.of(f"{words} eq. 22 without the innermost marker", without, trials),
                _weighted("at most a tenth of the innermost radius", *little),
                _weighted("at least the innermost radius", *much),
                _circles(circles),
            ),
        ]

    def judge(self, numbers: list[Number]) -> Verdict:
        """Two conditions. First: the fit to all markers errs less than the worst marker in more than half of
        the trials, by three standard errors. Second: its median error is below .9 of the best marker's, by two
        standard errors. Reproduced with both, partly with the first alone, not reproduced otherwise. All fits
        count as computed.
        """
        over_best, nearer = numbers[:2]
        mostly = nearer.value - 3.0 * nearer.error > 0.5
        return Verdict.graded(mostly and over_best.value + 2.0 * over_best.error <= 0.9, mostly)


class MarkersPositiveDefinite(Claim):
    """The matrix summed over markers is positive definite, as a sum of positive definite matrices, so that it has a
    Cholesky decomposition.

    The conclusion is a theorem. Its premise fails: C_p - Σ̂ is not positive definite where the noise hides the
    marker's extent. The noise of the sum grows as √M and its extent as Σ r². So the sum is positive definite more
    often than most markers' matrices, and less often than the outermost marker's.
    """

    name, section = "markers-positive-definite", "7"
    reads = ("markers/errors", "markers/points")
    quantity = "share of trials in which Σ_p (C_p - Σ̂) is positive definite, and in which every C_p - Σ̂ is"
    answer = (
        "where every marker's matrix is positive definite, the sum is in {0:share} of the trials; that premise "
        "holds in {1:share} of them, and the sum is positive definite in {3:share}."
    )

    def measure(self, evidence: Evidence) -> list[Number]:
        summed, single, names = [], [], []
        for sigma, _, markers in evidence.joints("markers"):
            summed.append(fit_joints(markers, sigma).definite)
            single.append(np.array([fit_joints([marker], sigma).definite for marker in markers]))
            names.append(f"σ = {sigma:g}")
        if not summed:
            return [Number.unknown("share of trials in which the sum of matrices is positive definite")]
        least = int(np.argmin([np.mean(definite) for definite in summed]))
        every, each_one = np.concatenate(summed), np.concatenate(single, axis=1)
        sound = each_one.all(axis=0)
        words = "share of positive definite matrices:"
        failed = f"{words} the sum, in trials where some marker's is not"
        theorem = Number.share(f"{words} the sum, in trials where every marker's is", every[sound])
        return [
            theorem if sound.any() else Number(theorem.words, 1.0, 0.0, 0),  # it holds where nothing contradicts it
            Number.share("share of trials in which every marker's matrix is positive definite", np.asarray(sound)),
            Number.share(f"{words} the sum, at the noise where it is smallest, {names[least]}", summed[least]),
            Number.share(f"{words} the sum, over all noises", every),
            Number.share(f"{words} a single marker's, over all noises", each_one),
            Number.share(f"{words} the outermost marker's, {names[least]}", single[least][-1]),
            *only_known(Number.share(failed, every[~sound])),
        ]

    def judge(self, numbers: list[Number]) -> Verdict:
        """Reproduced if the sum is positive definite in every trial in which each marker's matrix is, and that
        premise holds in at least 99 % of the trials, or the sum is in 99 % of them at every noise; partly if
        the first holds and the sum is positive definite in more than half of all trials, by two standard
        errors; not reproduced otherwise.
        """
        theorem, premise, least, summed = numbers[:4]
        holds = theorem.value >= 1.0 and summed.value - 2.0 * summed.error > 0.5
        return Verdict.graded(holds and (premise.value >= 0.99 or least.value >= 0.99), holds)


CLAIMS: tuple[Claim, ...] = (MarkersAveraged(), MarkersPositiveDefinite())
