"""The paper's precision study (§9.1): the scatter of joint centres that are fitted to parts of a recording.

There are four data sets, each a random half of the frames; a quarter of the subsets comes from each. A centre is MGDK's
in the parent's axes (paper eq. 22, corrected), with the noise that the whole recording shows, as in UGDK. A hinge has
two centres: with its axis, and without the direction across which its markers did not move.

Random subsets of one recording scatter about the centre of the whole recording as independent frames would, whatever
the error of that centre is; N of T frames scatter less by √(1 - N/T), which is divided out. Consecutive frames are what
a shorter recording has, and they scatter more. With an autocorrelation time of τ frames (`long_run_covariance.py`) the
effective number of independent frames in all T is T/τ, and the mean of N random frames has the variance

    σ² / N_eff,    N_eff = N / (1 + (N - 1) (τ - 1)/(T - 1)),

about the truth: N_eff is at most T/τ, for any N. The error over this axis is the scatter of the subsets and the
standard error of the whole recording's centre together.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullFormatter

from study import style
from study.arrays import Floats, Ints
from study.fits.loops.random import stream
from study.recordings.joints.estimate import USABLE, Estimate
from study.recordings.joints.find import Calibration
from study.recordings.recording import Recording, RecordingError
from study.recordings.rigid import across, cap_angle

_LEAST = 50
"""Smallest number of frames for the power law: with fewer, fits fail or have no finite variance."""
_BOOTSTRAPS = 400
_SMALL_CAP = 30.0
"""Half-angle of a cap below which the range of motion is small, degrees."""
_HIDDEN = 0.3
"""ρ above which the noise hides the motion."""
_WIDE = 2.0
"""A joint is an outlier if it scatters more than the median joint by this factor."""
_ALONG = 0.6
"""Share of the scatter along a hinge's axis above which the hinge is its reason."""
_EXPLAINED = 0.5
"""Share of an outlier's scatter above which what the noise explains of it is its reason."""


def without_hinge_axes(scatter: pd.DataFrame) -> pd.DataFrame:
    """The rows that drop the axis of a hinge, and all rows of the other joints."""
    hinges = set(scatter.loc[scatter["dropped"], "joint"])
    return scatter[scatter["dropped"] == scatter["joint"].isin(hinges)]


def power_law(scatter: pd.DataFrame, axis: str) -> dict[str, object]:
    """Exponent of the scatter over the number of frames: the median over joints, so that all count alike.

    Args:
        scatter: of a case study.
        axis: ``raw``, random frames over N; ``window``, consecutive frames over N; or ``effective``, random frames with
            the error of the whole recording's centre over the effective number of independent frames.

    Returns:
        The axis, the exponent, ends of a 95 % bootstrap interval over joints, and the number of joints.
    """
    way = "window" if axis == "window" else "random"
    x, y = ("effective", "error") if axis == "effective" else ("samples", "median")
    part = without_hinge_axes(scatter)
    part = part[(part["way"] == way) & (part["samples"] >= _LEAST) & np.isfinite(part["median"]) & (part["median"] > 0)]
    groups = [group for _, group in part.groupby("joint", sort=False) if group[x].nunique() > 1]
    exponents = np.array([np.polyfit(np.log(group[x]), np.log(group[y]), 1)[0] for group in groups])
    count = len(exponents)
    if not count:
        return {"axis": axis, "exponent": np.nan, "low": np.nan, "high": np.nan, "joints": 0}
    rng = stream(0, "case study", "law", axis, count)
    medians = np.median(exponents[rng.integers(0, count, (_BOOTSTRAPS, count))], axis=1)
    low, high = map(float, np.quantile(medians, [0.025, 0.975]))
    return {"axis": axis, "exponent": float(np.median(exponents)), "low": low, "high": high, "joints": count}


def with_outliers(joints: pd.DataFrame, scatter: pd.DataFrame) -> pd.DataFrame:
    """The table of joints with the columns ``median``, ``outlier`` and ``reason``.

    Outliers are counted as in the paper: at the largest N, with the axis of each hinge kept. Markers that leave their
    spheres by σ, root mean square, while a joint rotates by θ about the axis that moves least, scatter its centre by
    σ/(θ √N), where all of them leave their spheres alike, as with skin.
    """
    largest = scatter["samples"].max()
    rows = scatter[(scatter["way"] == "random") & ~scatter["dropped"] & (scatter["samples"] == largest)]
    medians = rows.set_index("joint")["median"].reindex(joints["joint"]).to_numpy()
    outliers, reasons = medians > _WIDE * np.nanmedian(medians), []
    for row, median, outlier in zip(joints.to_dict("records"), medians, outliers, strict=True):
        along, cap, condition, noise, moved = (row[key] for key in ("along", "cap", "condition", "noise", "moved"))
        expected = noise / (np.radians(moved) * np.sqrt(largest)) if moved > 0.0 else 0.0
        leaves = (
            f"its markers leave their spheres by {1000 * noise:.1f} mm, and it moves by {moved:.1f}° about one axis"
        )
        causes = {
            f"a hinge: {along:.0%} of the scatter is along its axis": row["hinge"] and along > _ALONG,
            f"its range of motion is small: {cap:.0f}°": cap < _SMALL_CAP,
            f"ρ = {condition:.2f}: noise hides the motion in one direction": condition > _HIDDEN,
            f"{leaves}: a scatter of {1000 * expected:.0f} mm": outlier and expected > _EXPLAINED * median,
        }
        reasons.append("; ".join(words for words, holds in causes.items() if holds))
    return joints.assign(median=medians, outlier=outliers, reason=reasons)


SETS = 4
"""Number of data sets, each a random half of the frames, from which random subsets come."""
_MOST = 0.9
"""Largest share of the smallest eigenvalue that is subtracted as noise."""


class JointSamples:
    """The samples of a joint's markers, with the noise variance and the weights that the whole recording shows.

    Args:
        estimate: the joint from the whole recording, by spheres in its parent's axes.
        recording: with its markers.

    Attributes:
        noise_variance: σ² of a coordinate; ``weights``: 1/r² of each marker (M,), as in ALS and MGDK.
        condition: ρ, the share of the smallest extent that is noise.
        hinge: True for a hinge; ``least``: its axis, or the direction in which the markers moved least (3,).
        effective_frames: effective number of independent frames; ``autocorrelation_time``: τ, in frames.
        error: standard error of the whole recording's centre, metres.
    """

    def __init__(self, estimate: Estimate, recording: Recording) -> None:
        self.estimate, self.used, self.frames = estimate, estimate.used, recording.frames
        y = np.stack([estimate.poses.to_local(recording.of(marker)) for marker in estimate.markers])
        self.y = np.where(self.used[:, None], y, 0.0)
        self._find_noise_and_weights()
        values, vectors = np.linalg.eigh(self._pool(np.arange(self.frames)[None])[0][0])
        self.condition = float(self.noise_variance / max(values[0] + self.noise_variance, 1e-300))
        self.hinge = estimate.axis is not None
        self.least = np.asarray(vectors[:, 0] if estimate.axis is None else estimate.axis)
        self.effective_frames = max(estimate.fit.effective_frames, 1.0)
        self.autocorrelation_time = max(float(self.used.any(axis=0).sum()) / self.effective_frames, 1.0)
        self.error = float(np.sqrt(max(np.trace(estimate.fit.covariance), 0.0)))

    def _find_noise_and_weights(self) -> None:
        """Find the noise variance from the residuals of the whole recording, and the weights 1/r², by iteration."""
        self.noise_variance, self.weights = 0.0, np.ones(len(self.y))
        every_frame = np.arange(self.frames)[None]
        count = self.used.sum(axis=1)
        for _ in range(20):
            center = self.centers(every_frame, None)[0]
            away = ((self.y - center[None, :, None]) ** 2).sum(axis=1)
            mean = np.where(self.used, away, 0.0).sum(axis=1) / np.maximum(count, 1)
            variance = (np.where(self.used, away - mean[:, None], 0.0) ** 2).sum(axis=1) / np.maximum(count, 1)
            self.weights = np.where(count > 1, 1.0 / np.maximum(mean, 1e-300), 0.0)
            before, share = self.noise_variance, self.weights * count
            self.noise_variance = 0.0
            least = float(np.linalg.eigvalsh(self._pool(every_frame)[0][0])[0])
            # if noise of the residuals' size would hide the motion, only so much is subtracted that a centre remains
            self.noise_variance = min(float((share @ variance) / (4.0 * (share @ mean))), _MOST * least)
            if abs(self.noise_variance - before) <= 1e-9 * self.noise_variance:
                break

    def causes(self, centers: Floats) -> dict[str, object]:
        """The row of `CaseStudy.joints` for this joint, with what explains its scatter.

        Args:
            centers: from random subsets, with every axis kept (B, 3).
        """
        pairs, estimate = zip(self.y, self.used, strict=True), self.estimate
        caps = [cap_angle(y, used, estimate.center) for y, used in pairs if used.any()]
        medians = [np.median(part[np.isfinite(part[:, 0])], axis=0) for part in np.split(centers, SETS)]
        apart = float(max(np.linalg.norm(a - b) for a in medians for b in medians))
        spread = np.nanvar(centers, axis=0).sum()
        along = np.nanvar(centers @ self.least) / spread if spread > 0 else np.nan
        row: dict[str, object] = {"cap": float(np.degrees(max(caps))), "condition": self.condition, "hinge": self.hinge}
        row |= {"noise": float(np.sqrt(self.noise_variance)), "moved": float(np.degrees(estimate.fit.rms_angles.min()))}
        row |= {"memory": self.autocorrelation_time, "effective_frames": self.effective_frames}
        return row | {"sets": apart, "along": float(along)}

    def centers(self, index: Ints, axis: Floats | None) -> Floats:
        """Centres by MGDK (B, 3) from the frames of each subset (B, N); NaN where not positive definite.

        With an axis (3,) the fit gives the centre across it, and the mean of the samples the centre along it.
        """
        left, right = self._pool(index)
        basis = across(axis)
        reduced = basis.T @ left @ basis
        values = np.linalg.eigvalsh(reduced)
        fine = values[:, 0] > 0.0
        reduced[~fine] = np.eye(basis.shape[1])
        middle = self._mean(index) @ (np.zeros((3, 3)) if axis is None else np.outer(axis, axis))
        shifted = right - np.einsum("bij,bj->bi", left, middle)
        centers = middle + np.linalg.solve(reduced, (shifted @ basis)[:, :, None])[:, :, 0] @ basis.T
        centers[~fine] = np.nan
        return np.asarray(centers)

    def effective(self, number: int) -> float:
        """N_eff of this many random frames."""
        return float(number / (1.0 + (number - 1) * (self.autocorrelation_time - 1.0) / max(self.frames - 1, 1)))

    def _mean(self, index: Ints) -> Floats:
        """Mean of the samples of all markers (B, 3)."""
        count = self.used[:, index].sum(axis=(0, 2))
        return np.asarray(self.y[:, :, index].sum(axis=(0, 3)).T / np.maximum(count, 1)[:, None])

    def _pool(self, index: Ints) -> tuple[Floats, Floats]:
        """Σ w n (C - σ²I) / Σ w n (B, 3, 3), and the same of (C - σ²I) x̄ + ½S (B, 3), for frames (B, N)."""
        left, right, total = np.zeros((len(index), 3, 3)), np.zeros((len(index), 3)), np.zeros(len(index))
        for y, used, weight in zip(self.y, self.used, self.weights, strict=True):
            chosen = used[index]
            count = chosen.sum(axis=1)
            w = np.where(count > 1, weight * count, 0.0)  # one sample has no extent
            x = np.where(chosen, np.take(y, index, axis=1), 0.0)  # (3, B, N)
            mean = x.sum(axis=2) / np.maximum(count, 1)
            z = np.where(chosen, x - mean[:, :, None], 0.0).swapaxes(0, 1)
            share = 1.0 / np.maximum(count - 1, 1)
            c = share[:, None, None] * z @ z.swapaxes(1, 2) - self.noise_variance * np.eye(3)
            s = share[:, None] * (z @ (z**2).sum(axis=1)[:, :, None])[:, :, 0]
            left += w[:, None, None] * c
            right += w[:, None] * (np.einsum("bij,jb->bi", c, mean) + 0.5 * s)
            total += w
        total = np.maximum(total, 1e-300)
        return left / total[:, None, None], right / total[:, None]


def subset_frames(way: str, seen: Ints, number: int, subsets: int, rng: np.random.Generator) -> Ints:
    """Choose the frames of each subset (subsets, N).

    Args:
        way: ``random``, for random frames of a random half, or ``window``, for consecutive ones.
        seen: the frames to choose from.
        number: N; at most half of them.
        subsets: number of subsets.
        rng: the generator.
    """
    number = min(number, len(seen) // 2) or 1
    if way == "window":
        starts = rng.integers(0, len(seen) - number + 1, subsets)
        return np.asarray(seen[starts[:, None] + np.arange(number)])
    parts = []
    for _ in range(SETS):
        half = rng.permutation(seen)[: max(len(seen) // 2, number)]
        parts += [rng.choice(half, number, replace=False) for _ in range(subsets // SETS)]
    return np.stack(parts)


NEAR = 0.01
"""The paper's centimetre, metres."""
_NUMBERS = (20, 50, 100, 200, 500, 1000, 2000, 5000)
_PIECES = 8
"""Number of pieces in which the subsets of one size are fitted, to save memory."""
_MEDIAN_TO_RMS = 0.9
"""The median length of a Gaussian vector in three dimensions, about, in units of its root mean square."""


@dataclass(frozen=True)
class CaseStudy:
    """The tables of a precision study; lengths in metres.

    Attributes:
        recording: name of the recording.
        frames: its number of frames.
        subsets: number of subsets of each size.
        scatter: a row per joint, way of taking frames (``random``, or ``window``: consecutive), whether the axis of a
            hinge is dropped, and N. ``mean_x, …`` and ``sd_x, …``: mean and standard deviation of the centre in the
            parent's axes, over fits that are ok; ``sd``: root of the summed variances; ``median``: median distance
            from the whole recording's centre, where a failed fit counts as farther than any other; ``near``: share
            within a centimetre; ``failed``: share of fits that are not positive definite; ``effective``: N_eff;
            ``error``: the scatter and the standard error of the whole recording's centre together; ``doubted``: whether
            phase 1 doubts the joint.
        joints: a row per joint. ``cap``: half-angle of the largest cap, degrees; ``condition``: ρ; ``hinge``;
            ``noise``: of the markers' coordinates about their spheres; ``moved``: least rms angle, degrees;
            ``memory``: τ in frames; ``effective_frames``: T/τ; ``sets``: largest distance between the medians of
            two data sets at the middle N; ``along``: share of the scatter in the direction in which the markers moved
            least; ``median``: scatter at the largest N; ``outlier``: whether that is more than twice the median
            joint's; ``reason``.
        laws: a row per axis (``raw``, ``window``, ``effective``): the exponent, the median over joints, with the ends
            ``low`` and ``high`` of a 95 % interval over joints.
        skipped: joints without a sphere in their parent's axes, each with the reason.
    """

    recording: str
    frames: int
    subsets: int
    scatter: pd.DataFrame
    joints: pd.DataFrame
    laws: pd.DataFrame
    skipped: dict[str, str]

    def data(self) -> dict[str, object]:
        """``recording``, ``frames``, ``subsets``, ``laws``, ``joints`` and ``skipped``, tables as lists of rows."""
        names = ("recording", "frames", "subsets", "laws", "joints", "skipped")
        values = {name: getattr(self, name) for name in names}
        return {k: v.to_dict("records") if isinstance(v, pd.DataFrame) else v for k, v in values.items()}


def case_study(
    joints: Calibration, recording: Recording, subsets: int = 400, seed: int = 1, numbers: Sequence[int] = _NUMBERS
) -> CaseStudy:
    """Fit each joint to many parts of a recording.

    Args:
        joints: the fitted joints (phase 1).
        recording: the recording that they were fitted to.
        subsets: number of subsets of each size, a multiple of four.
        seed: of the subsets.
        numbers: sizes of the subsets, in frames; those above a quarter of the recording are left out.

    Raises:
        RecordingError: if the recording is too short, no joint has a sphere, or ``subsets`` is not a multiple of four.
    """
    sizes = [n for n in numbers if n <= recording.frames // SETS]
    if len(sizes) < 2:
        least = SETS * sorted(numbers)[1]
        raise RecordingError(f"{recording.name}: {recording.frames} frames; a case study needs at least {least}")
    if subsets < SETS or subsets % SETS:
        raise RecordingError(f"subsets = {subsets}; give a multiple of {SETS}: they come from four data sets")
    rows, about, skipped = [], [], {}
    for place in joints.joints:
        name = place.joint.name
        # the child's markers in the parent's axes
        sphere = next((e for e in place.estimates if e.side == "parent" and e.sphere is not None), None)
        if sphere is None:
            skipped[name] = f"no sphere in its parent's axes ({place.reason})"
            continue
        samples = JointSamples(sphere, recording)
        joint_rows, centers = _scatter_of(samples, name, sizes, subsets, seed)
        rows += [row | {"doubted": place.status not in USABLE} for row in joint_rows]
        about.append({"joint": name} | samples.causes(centers["random", False, sizes[len(sizes) // 2]]))
    if not rows:
        raise RecordingError(f"{recording.name}: none of its joints has a sphere in its parent's axes")
    scatter = pd.DataFrame(rows)
    table = with_outliers(pd.DataFrame(about), scatter)
    laws = pd.DataFrame([power_law(scatter, axis) for axis in ("raw", "window", "effective")])
    return CaseStudy(recording.name, recording.frames, subsets, scatter, table, laws, skipped)


def _scatter_of(
    samples: JointSamples, name: str, sizes: Sequence[int], subsets: int, seed: int
) -> tuple[list[dict[str, object]], dict[tuple[str, bool, int], Floats]]:
    """Rows of the scatter of one joint, and its centres by way, dropped axis and N."""
    rows: list[dict[str, object]] = []
    centers: dict[tuple[str, bool, int], Floats] = {}
    seen = np.flatnonzero(samples.used.any(axis=0))
    for way, number in itertools.product(("random", "window"), sizes):
        index = subset_frames(way, seen, number, subsets, stream(seed, "case study", name, way, number))
        for dropped in (False, True) if samples.hinge else (False,):
            axis = samples.least if dropped else None
            places = np.concatenate([samples.centers(piece, axis) for piece in np.array_split(index, _PIECES)])
            centers[way, dropped, number] = places
            away = places - samples.centers(seen[None], axis)[0]
            if axis is not None:
                away = away - np.outer(away @ axis, axis)
            row: dict[str, object] = {"joint": name, "way": way, "dropped": dropped, "samples": number}
            ok = places[np.isfinite(places).all(axis=1)]
            mean, sd = (ok.mean(axis=0), ok.std(axis=0)) if len(ok) else (np.full(3, np.nan),) * 2
            row |= {f"mean_{a}": float(v) for a, v in zip("xyz", mean, strict=True)}
            row |= {f"sd_{a}": float(v) for a, v in zip("xyz", sd, strict=True)} | {"sd": float(np.sqrt((sd**2).sum()))}
            rows.append(row | _distances(samples, np.linalg.norm(away, axis=1), number, way))
    return rows, centers


def _distances(samples: JointSamples, distance: Floats, number: int, way: str) -> dict[str, object]:
    """Summary of the distances (B,) from the whole recording's centre; NaN for a fit that is not ok."""
    ranked = np.where(np.isfinite(distance), distance, np.inf)
    # N random frames of T scatter about the whole recording's centre by √(1 - N/T) less than independent ones
    share = np.sqrt(max(1.0 - number / samples.frames, 1e-12)) if way == "random" else 1.0
    median = error = float(np.sort(ranked)[len(ranked) // 2]) / share
    effective = max(number / samples.autocorrelation_time, 1.0)
    if way == "random":
        error, effective = float(np.hypot(median * share, _MEDIAN_TO_RMS * samples.error)), samples.effective(number)
    near, failed = float((ranked <= NEAR).mean()), float(np.isinf(ranked).mean())
    return {"median": median, "near": near, "failed": failed, "effective": effective, "error": error}


_GREY, _OUT = "0.6", "#c1272d"
_PANELS = {
    "raw": ("random", "samples", "median", "#1f5fa8", "o", "random"),
    "effective": ("random", "effective", "error", "#1f5fa8", "o", "random"),
    "window": ("window", "effective", "median", "#d98c1f", "s", "consecutive, of $N$"),
}
"""Of each law: the way of taking frames, the columns of its axes, its colour and mark, and its name in the figure."""


@style.journal()
def draw(case: CaseStudy) -> Figure:
    """Draw figure 7 of a recording: scatter of joint centres over the number of frames that they are fitted to.

    Left, as in the paper: random subsets, and their scatter about the whole recording's centre. Right: the effective
    number of independent frames, and an error that includes the standard error of the whole recording's centre. Beside
    it are consecutive frames, which a shorter recording would have. Look at the slopes, printed with their intervals,
    and at the outliers, named with their reasons.
    """
    figure = style.Picture(figsize=(style.PAGE, 4.6), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    plain = case.scatter[(case.scatter["way"] == "random") & ~case.scatter["dropped"]]
    outliers = set(case.joints.loc[case.joints["outlier"], "joint"])
    left.set_yscale("log")
    for joint, curve in plain.groupby("joint", sort=False):
        known = curve[np.isfinite(curve["median"])]
        color, order = (_OUT, 3) if joint in outliers else (_GREY, 2)
        left.plot(known["samples"], 100 * known["median"], color=color, linewidth=0.8, zorder=order)
    for number, share in plain.groupby("samples", sort=True)["near"].mean().items():
        text = left.text(float(str(number)), 0.98, f"{100 * share:.0f} %", ha="center", va="top", fontsize=style.SMALL)
        text.set_transform(left.get_xaxis_transform())
    _draw_laws(left, case, ("raw",), f"as in the paper; at the top the share within {100 * NEAR:g} cm")
    _draw_laws(right, case, ("effective", "window"), "with the error of the whole recording's centre")
    left.set_xlabel("number of frames $N$, taken at random")
    left.set_ylabel("median distance from the whole recording's centre, cm")
    right.set_xlabel("effective number of independent frames")
    shown = 100 * plain.loc[np.isfinite(plain["median"]), "median"]
    left.set_ylim(0.5 * shown.min(), min(2.0 * shown.max(), 60.0))
    joints = ((_GREY, "a joint"), (_OUT, "an outlier"))
    handles = [Line2D([], [], color=color, linewidth=0.8, label=label) for color, label in joints]
    for axis, label in (("raw", "random subsets, median joint"), ("window", "consecutive frames")):
        color, mark = _PANELS[axis][3:5]
        handles.append(Line2D([], [], color=color, marker=mark, markersize=4, label=label))
    figure.legend(handles=handles, loc="outside upper left", ncols=4, columnspacing=1.6)
    figure.supxlabel("\n".join(_outliers(case)), fontsize=style.SMALL, x=0.01, ha="left", color=_OUT)
    style.stamp(figure, f"{case.recording} · {case.frames:,} frames · {case.subsets} subsets per point")
    return figure


def _draw_laws(ax: Axes, case: CaseStudy, axes: Sequence[str], title: str) -> None:
    """Draw medians over joints, centimetres, and print their exponents with intervals."""
    rows, lines = without_hinge_axes(case.scatter), []
    for axis in axes:
        way, x, y, color, mark, name = _PANELS[axis]
        middle = rows[rows["way"] == way].groupby("samples", sort=True)[[x, y]].median()
        middle = middle[np.isfinite(middle[y])]  # infinite if more than half of the fits failed
        ax.plot(middle[x], 100 * middle[y], color=color, marker=mark, markersize=4, linewidth=1.6, zorder=5)
        law = case.laws[case.laws["axis"] == axis].iloc[0]
        if np.isfinite(law["exponent"]):
            exponent, low, high = (style.decimals(law[key], 2) for key in ("exponent", "low", "high"))
            lines.append(f"{name}: exponent {exponent} ({low} to {high})")
    ax.set_xscale("log")
    if (span := ax.get_xlim())[1] < 100.0 * span[0]:  # else powers of ten are enough, and more would not fit
        ax.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        ax.xaxis.set_major_formatter("{x:,.0f}")
    ax.xaxis.set_minor_formatter(NullFormatter())
    ax.axhline(100 * NEAR, color="black", linewidth=0.6, linestyle=(0, (2, 2)))
    ax.set_title(title, loc="left", fontsize=style.SMALL + 1)
    ax.text(0.02, 0.02, "\n".join(lines), transform=ax.transAxes, va="bottom", fontsize=style.SMALL)


def _outliers(case: CaseStudy) -> list[str]:
    """A line for each joint that scatters more than others, with the reason."""
    rows = case.joints[case.joints["outlier"]].to_dict("records")
    return [f"{str(row['joint']).replace('_', ' ')}: {row['reason'] or 'not explained'}" for row in rows]


def printed(case: CaseStudy) -> list[str]:
    """The results of a case study in lines of text."""
    lines = [f"{case.recording}: {case.subsets} subsets of each size, a quarter from each of {SETS} data sets"]
    for law in case.laws.to_dict("records"):
        exponent = f"{law['exponent']:.3f} ({law['low']:.3f} to {law['high']:.3f})"
        lines.append(f"exponent, {law['axis']}: {exponent}, {law['joints']} joints")
    skipped = [f"{joint.replace('_', ' ')} left out: {why}" for joint, why in case.skipped.items()]
    return [*lines, *_outliers(case), *skipped]
