"""Claims of sections 6, 10 and 11 on UGDK: its bias, its error, the setting of figure 4, and the noise it is told."""

import math

import numpy as np
import pandas as pd

from study.analysis.claims.claim import Claim, Evidence, Number, Verdict
from study.analysis.claims.shared_measures import failures_last, formed, law, level, of, over, ratio, vectors, within
from study.analysis.error_groups import decade
from study.analysis.kept_markers import joints
from study.estimators import Status, fit
from study.statistics.measures import (
    UNKNOWN,
    inside,
    mean,
    moments_exist,
    power_law,
    quantile,
    robust_sd,
    share,
    tail_index,
)

PAPER_CONDITION = 0.557238
"""ρ(Σ̂C⁻¹) of figure 4: "the spectral radius in question", §6."""
_LEVEL = 0.95


def _bias_exponent(errors: pd.DataFrame, estimator: str) -> Number:
    """Exponent of N in the mean error along the cap's axis; unknown where a mean cannot be shown."""
    words = f"exponent of N in {estimator.upper()}'s bias (mean of ok fits)"
    rows = []
    for samples, part in of(errors, estimator).groupby("samples"):
        ok = part[part["status"] == Status.OK]
        if not moments_exist(tail_index(ok["error"].to_numpy())):
            return Number.unknown(words)
        rows.append((samples, *mean(ok["error_1"].to_numpy()), len(ok)))
    if not rows:
        return Number.unknown(words)
    n, bias, error, trials = np.array(rows, dtype=float).T
    found = power_law(n, np.abs(bias), error)
    return Number(words, found.exponent, found.error, int(trials.min()))


def _measure_bias(evidence: Evidence) -> list[Number]:
    errors = evidence.table("bias", "errors")
    ugdk = of(errors, "ugdk")
    last = ugdk[ugdk["samples"] == ugdk["samples"].max()]
    ok = last[last["status"] == Status.OK]
    bias = mean((ok["error_1"] * ok["samples"] / ok["radius"]).to_numpy())
    failed = int(np.sum(ugdk["status"] != Status.OK))
    return [
        _bias_exponent(errors, "ugdk"),
        _bias_exponent(errors, "gdke"),
        Number.of("UGDK's bias times N over r at the largest N", bias, len(ok)),
        Number.of("share of UGDK's fits that are not ok", share(failed, len(ugdk)), len(ugdk)),
    ]


def _judge_bias(numbers: list[Number]) -> Verdict:
    ugdk, gdke = numbers[:2]
    falls = ugdk.value + 2.0 * ugdk.error
    if falls < -0.75 and gdke.value - 2.0 * gdke.error > -0.25:
        return Verdict.REPRODUCED
    return Verdict.PARTLY if falls < -0.25 else Verdict.NOT_REPRODUCED


def _measure_error(evidence: Evidence) -> list[Number]:
    grid, paper = of(evidence.table("power-law", "errors"), "ugdk"), of(evidence.table("paper", "errors"), "ugdk")
    relative = level(paper).to_numpy()
    small, large = relative < 0.01, relative >= 1.0
    samples = paper["samples"].to_numpy(dtype=float)
    as_computed = (paper["error"] / paper["noise"]).fillna(math.inf).to_numpy()
    at = grid["samples"].to_numpy(dtype=float)
    ok = int(np.sum(paper["status"].to_numpy()[large] == Status.OK))
    return [
        law("exponent of N in the median error of all fits, σ = .02 r", at, failures_last(grid, grid["error"]), at),
        law(
            "exponent of σ in the median of error over √tr CRLB, all fits, σ < .01 r",
            relative[small],
            failures_last(paper, over(paper, "bound"))[small],
            decade(relative[small]),
        ),
        law(
            "exponent of N in the median of error over σ, answers as computed, σ ≥ r",
            samples[large],
            as_computed[large],
            decade(samples[large]),
        ),
        Number.of("share of fits that are ok, σ ≥ r", share(ok, int(large.sum())), int(large.sum())),
    ]


def _judge_error(numbers: list[Number]) -> Verdict:
    with_samples, with_noise, beyond = numbers[:3]
    if not (within(with_samples, -0.5, 0.1) and within(with_noise, 0.0, 0.1)):
        return Verdict.NOT_REPRODUCED
    return Verdict.REPRODUCED if within(beyond, -0.5, 0.1) else Verdict.PARTLY


def _measure_condition(evidence: Evidence) -> list[Number]:
    cell = of(evidence.table("ellipse", "errors"), "ugdk")
    condition, trials = cell["condition"].to_numpy(), len(cell)
    errors = vectors(cell[cell["status"] == Status.OK])
    held = int(np.sum(inside(errors, np.array([robust_sd(e) for e in errors.T]), _LEVEL)))
    return [
        Number.of(
            f"share of trials with a smaller ρ than {PAPER_CONDITION}",
            share(int(np.sum(condition < PAPER_CONDITION)), trials),
            trials,
        ),
        Number.of("share of trials with ρ < 1", share(int(np.sum(condition < 1.0)), trials), trials),
        Number.of("share of all trials whose 95 % ellipse holds the true centre", share(held, trials), trials),
        Number.of("median of ρ", quantile(condition, 0.5), trials),
    ]


def _judge_condition(numbers: list[Number]) -> Verdict:
    rank, sound, held = (number.value for number in numbers[:3])
    if not 0.05 <= rank <= 0.95:
        return Verdict.NOT_REPRODUCED
    return Verdict.REPRODUCED if sound >= 0.99 and held > 0.5 else Verdict.PARTLY


def _measure_noise(evidence: Evidence) -> list[Number]:
    isotropic = of(evidence.table("efficiency", "errors"), "als")
    anisotropic = evidence.table("anisotropic", "errors")
    relative = level(isotropic)
    isotropic = isotropic[(relative >= 0.03) & (relative < 0.05)]  # one level: the others are of the same draws
    many = anisotropic[anisotropic["samples"] == anisotropic["samples"].max()]
    return [
        _furthest("noise variance found by ALS over the true one, σ = .03 r", isotropic),
        _greatest("median error of UGDK that finds Σ, over UGDK that is told Σ", many, "ugdk_cov"),
        *formed(
            [
                _greatest("median error of ALS, for which noise is isotropic, over UGDK that is told Σ", many, "als"),
                _furthest("trace of Σ found by UGDK_COV over the true one", of(many, "ugdk_cov")),
                *(_fed_back(evidence, factor) for factor in (0.5, 2.0)),
            ]
        ),
    ]


def _furthest(words: str, part: pd.DataFrame) -> Number:
    """The median of the found over the true noise variance at the angle where it is furthest from 1; ok fits."""
    ok = part[part["status"] == Status.OK]
    found = [
        (quantile((p["noise_variance"] / p["noise"] ** 2).to_numpy(), 0.5), len(p)) for _, p in ok.groupby("angle")
    ]
    worst, trials = max(found, key=lambda f: abs(f[0].value - 1.0), default=(UNKNOWN, 0))
    return Number.of(f"{words}; median, furthest of the angles", worst, trials)


def _greatest(words: str, errors: pd.DataFrame, estimator: str) -> Number:
    """Greatest ratio over the angles of an estimator's median error to that of UGDK; all fits."""
    found = []
    for _, part in errors.groupby("angle"):
        rows = [of(part, name) for name in (estimator, "ugdk")]
        above, below = (quantile(failures_last(row, row["error"]), 0.5) for row in rows)
        found.append((ratio(above, below), min(map(len, rows))))
    greatest, trials = max(found, key=lambda f: (math.isnan(f[0].value), f[0].value), default=(UNKNOWN, 0))
    return Number.of(f"{words}; greatest of the angles, all fits", greatest, trials)


def _fed_back(evidence: Evidence, factor: float) -> Number:
    """Eq. 19 with UGDK's own centre and radius, where UGDK was told a wrong noise variance, over what it was told."""
    words = f"trace by eq. 19 with the fitted sphere over the trace told, which was {factor:g} times the true one"
    known = list(joints(evidence.table("markers", "errors"), evidence.table("markers", "points")))
    if not known:
        return Number.unknown(words)
    sigma, _, markers = known[0]
    told, x = sigma * math.sqrt(factor), markers[-1]
    found = fit(x, "ugdk", noise=told)
    squares = np.sum((x - found.center[:, None, :]) ** 2, axis=2).mean(axis=1)
    trace = squares - found.radius**2
    return Number.of(words, quantile(trace[found.status == Status.OK] / (x.shape[2] * told**2), 0.5), len(x))


def _judge_noise(numbers: list[Number]) -> Verdict:
    trace, whole = numbers[:2]
    if not within(trace, 1.0, 0.05):
        return Verdict.NOT_REPRODUCED
    return Verdict.PARTLY if within(whole, 0.0, 2.0) else Verdict.REPRODUCED


CLAIMS: tuple[Claim, ...] = (
    Claim(
        name="ugdk-bias",
        section="6",
        statement="UGDK is asymptotically unbiased: its bias falls as 1/N, which GDKE's does not.",
        quantity="mean error along the cap's axis against N",
        criterion="Reproduced if the exponent of N in UGDK's bias is below -.75 by two standard errors, and that in "
        "GDKE's above -.25; partly if only UGDK's is below -.25; not reproduced otherwise.",
        reads=("bias/errors",),
        measure=_measure_bias,
        judge=_judge_bias,
        remark="Strictly UGDK has no mean at any N: its error has a tail of 1/x. Here, at v/σ² = 8, the tail lies too "
        "far out for any trial to meet it; means are shown only where Hill's index of the trials allows them. GDKE's "
        "bias settles at (C₀ + Σ)⁻¹Σ(c₀ - μ̄).",
    ),
    Claim(
        name="ugdk-error",
        section="6, 10",
        statement="UGDK converges to the true centre with an error of the order of σ/√N.",
        quantity="exponents of N and σ in UGDK's median error",
        criterion="Reproduced if, two standard errors included, the exponent of N at σ = .02 r is within .1 of -½, "
        "that of σ in error over bound (∝ σ/√N) below .01 r within .1 of 0, and that of N in error over σ from σ = r "
        "on within .1 of -½; partly if all but the last; not reproduced otherwise.",
        reads=("power-law/errors", "paper/errors"),
        measure=_measure_error,
        judge=_judge_error,
        figure="fig7_power_law",
        remark="The error is of order σ/√N as long as (v/σ²)√(N/2) is well above 3, v being the points' variance along "
        "the cap's axis. Beyond, C - Σ̂ is mostly not positive definite and the error is of order σ, for any N.",
    ),
    Claim(
        name="figure-4-setting",
        section="6",
        statement="For 100 points with noise 0.05 the spectral radius is 0.557238, so that the Leontief condition ρ < "
        "1 holds, and UGDK's error ellipse has the true centre inside.",
        quantity="ρ(Σ̂C⁻¹) and coverage over repetitions of the figure's data",
        criterion="Reproduced if .557238 is among the middle 90 % of the trials' ρ, ρ < 1 in at least 99 % of them, "
        "and more than half of all ellipses hold the true centre; partly if only the first; not reproduced otherwise.",
        reads=("ellipse/errors",),
        measure=_measure_condition,
        judge=_judge_condition,
        figure="fig4_ugdk_ellipse",
        remark="The paper does not give the arc. Its half-angle here, 31.7° at r = 1, was chosen so that ρ is typical: "
        "that ρ fits is no test, that all else then follows is. The ellipse is that of the scatter over all trials; "
        "UGDK's tails are longer than a Gaussian's.",
    ),
    Claim(
        name="noise-from-the-points",
        section="11",
        statement="UGDK must be told the noise. The trace of the noise covariance can be estimated, the whole matrix "
        "could not be, which is left as an open question.",
        quantity="noise found in the points that are fitted, over the true noise; centres with Σ found and with Σ told",
        criterion="Reproduced if ALS finds the variance of isotropic noise within 5 %, two standard errors included, "
        "and UGDK that finds the whole Σ does not err less than twice as far as UGDK that is told it; partly if it "
        "does, so that the open question has an answer; not reproduced otherwise.",
        reads=("efficiency/errors", "anisotropic/errors", "markers/errors", "markers/points"),
        measure=_measure_noise,
        judge=_judge_noise,
        remark="The residuals' variance gives the noise level, their moments the whole Σ. The paper's own eq. 19 gives "
        "nothing: with the fitted centre and radius it returns (N - 1)/N times whatever UGDK was told.",
    ),
)
