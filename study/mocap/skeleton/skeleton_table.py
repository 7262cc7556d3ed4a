"""A skeleton over time as tables: joints in every frame, and the lengths of bones."""

from collections.abc import Iterator

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from study.mocap.geometry.convex_hull import hull_distances
from study.mocap.skeleton.bones import mirrored
from study.mocap.skeleton.plausibility import UNEVEN
from study.mocap.skeleton.scene import Flag, Scene
from study.sphere.types import Floats
from study.text.columns import columns
from study.text.numbers import number


def skeleton_table(scene: Scene) -> pd.DataFrame:
    """Tabulate joints, a row per frame and joint.

    Returns:
        Columns: frame, from 1; time, seconds; joint; x, y, z, metres, z up; known: "seen", "bridged" or "unknown";
        error_x, error_y, error_z, standard errors of the place along x, y and z in this frame, metres (see
        `frame_errors`).
    """
    errors = frame_errors(scene)
    count, frames = len(scene.joints), scene.frames
    words = np.array([flag.name.lower() for flag in Flag])
    return pd.DataFrame(
        {
            "frame": np.repeat(np.arange(1, frames + 1), count),
            "time": np.repeat(np.arange(frames) / scene.rate, count),
            "joint": np.tile(np.array(scene.joints), frames),
            **{axis: scene.centers[:, i].T.ravel() for i, axis in enumerate("xyz")},
            "known": words[scene.flags.T.ravel()],
            **{f"error_{axis}": errors[:, i].T.ravel() for i, axis in enumerate("xyz")},
        }
    )


def frame_errors(scene: Scene) -> Floats:
    """Standard errors of the joints along the world's axes in each frame (joints, 3, frames), metres.

    They are those of the joint's place in its parent, rotated with the parent; of a hinge, of the part across its axis.
    NaN in frames in which the joint is bridged or unknown: nothing shows the error of a pose that was not seen.
    """
    errors = np.full(scene.centers.shape, np.nan)
    squares = np.nan_to_num(scene.errors) ** 2
    for joint, (turns, flags) in enumerate(zip(scene.orientations, scene.flags, strict=True)):
        shown = (flags == Flag.SEEN) & ~np.isnan(turns[:, 0])
        if shown.any() and not np.isnan(scene.errors[joint]).all():
            axes = Rotation.from_quat(turns[shown]).as_matrix()
            errors[joint][:, shown] = np.sqrt((axes**2 @ squares[joint]).T)
    return errors


def bone_table(scene: Scene) -> pd.DataFrame:
    """Tabulate bones, a row per bone between two joints.

    Returns:
        Columns: start, end; length, its median over time, and spread, its standard deviation (metres); error, upper
        bound of the length's standard error from those of its joints (metres); uneven, difference from the other
        side's length, relative to their mean; NaN where there is no other side.
    """
    worst = np.array([np.nanmax(row) if not np.isnan(row).all() else np.nan for row in scene.errors])
    rows = []
    for i, j in scene.bones:
        if max(i, j) >= len(scene.joints):
            continue
        length = np.linalg.norm(scene.centers[i] - scene.centers[j], axis=0)
        length = length[~np.isnan(length)]
        if len(length):
            names = {"start": scene.joints[i], "end": scene.joints[j]}
            error = float(np.hypot(worst[i], worst[j]))
            rows.append({**names, "length": np.median(length), "spread": length.std(), "error": error})
    table = pd.DataFrame(rows, columns=["start", "end", "length", "spread", "error"])
    pairs = [frozenset(pair) for pair in zip(table["start"], table["end"], strict=True)]
    lengths = dict(zip(pairs, table["length"], strict=True))
    across = [frozenset(map(mirrored, pair)) for pair in pairs]
    other = [lengths.get(b, np.nan) if a != b else np.nan for a, b in zip(pairs, across, strict=True)]
    table["uneven"] = (table["length"] - other) / (0.5 * (table["length"] + other))
    return table


def skeleton_lines(scene: Scene) -> Iterator[str]:
    """Lay out bones, distances of joints from the markers' hull, shares of bridged frames, and reasons to doubt."""
    bones = [
        [
            f"{row['start']} - {row['end']}",
            f"{row['length']:.3f} m",
            _millimetres(row["error"]),
            _millimetres(row["spread"]),
            "" if np.isnan(row["uneven"]) else f"{round(100 * row['uneven'], 1) + 0.0:+.1f} %",  # no minus before zero
            "uneven" if abs(row["uneven"]) > UNEVEN else "",
        ]
        for row in bone_table(scene).to_dict("records")
    ]
    yield from columns(bones, ["bone", "length", "error", "varies", "left to right"], "<>>>><")
    hulls = [
        [name, number(hull.share_outside, ".0%"), _millimetres(hull.distance) if hull.distance > 0.0 else "-"]
        for name, hull in zip(scene.joints, hull_distances(scene.places, scene.centers), strict=True)
    ]
    yield from columns(hulls, ["joint", "outside", "by"], "<>")
    yield "outside: share of frames outside the markers' hull; by: 95 % quantile of the distance outside it"
    for name, flags in zip(scene.joints, scene.flags, strict=True):
        shares = [(flag, (flags == flag).mean()) for flag in Flag if flag != Flag.SEEN]
        lacking = [f"{flag.name.lower()} in {share:.1%} of the frames" for flag, share in shares if share]
        if lacking:
            yield f"{name}: {', '.join(lacking)}"
    for name, doubt in zip(scene.joints, scene.doubts, strict=True):
        if doubt:
            yield f"{name}: not reliable: {doubt}"
    yield from (f"note: {note}" for note in scene.notes)


def _millimetres(metres: float) -> str:
    return "-" if np.isnan(metres) else f"{1000 * metres:.1f} mm"
