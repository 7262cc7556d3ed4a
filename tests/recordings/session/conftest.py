"""Trials of one pelvis with two thighs, and of a whole body, each trial moving other joints."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from study.recordings.markersets import Joint, MarkerSet, Segment
from study.recordings.recording import Recording
from study.recordings.synthetic.make import PARTS, Recipe, body, draw_motion, marker_noise, skin_motion

PELVIS = {
    "LASI": (0.12, 0.13, 0.0),
    "RASI": (0.12, -0.13, 0.0),
    "LPSI": (-0.1, 0.05, 0.02),
    "RPSI": (-0.1, -0.05, 0.02),
}
HIPS = {"left": np.array([0.02, 0.09, -0.1]), "right": np.array([0.02, -0.09, -0.1])}
CLUSTER = np.array([[0.08, 0.02, -0.15], [0.06, -0.05, -0.25], [-0.05, 0.05, -0.3]])
"""Markers of a thigh, from its hip; for a right thigh y has the other sign."""
SIDES = {"left": ("LTH1", "LTH2", "LTH3"), "right": ("RTH1", "RTH2", "RTH3")}


@pytest.fixture(scope="session")
def markerset():
    """The marker set of the trials."""
    thighs = tuple(Segment(name=f"{side}_thigh", markers=SIDES[side], parent="pelvis") for side in SIDES)
    joints = tuple(Joint(name=f"{side}_hip", parent="pelvis", child=f"{side}_thigh") for side in SIDES)
    return MarkerSet(name="hips", segments=(Segment(name="pelvis", markers=tuple(PELVIS)), *thighs), joints=joints)


@pytest.fixture(scope="session")
def trial():
    """A function for a trial: its name, the range of each hip in radians, the size of the body, the markers it has."""

    def make(name, left=0.0, right=0.0, size=1.0, lacking=(), seed=0, frames=600, noise=0.001):
        rng = np.random.default_rng(seed)

        def swing(sweep):
            """Smooth rotation vectors (frames, 3) with this range: sums of slow sines of random phase."""
            t = np.linspace(0, 2 * np.pi, frames)[:, None]
            phase = rng.uniform(0, 2 * np.pi, (2, 3))
            return sweep * (0.7 * np.sin(3 * t * [1, 1.3, 0.8] + phase[0]) + 0.3 * np.sin(7 * t + phase[1]))

        body, shift = Rotation.from_rotvec(swing(0.2)), rng.normal(0.0, 1.0, 3)
        labels, local = list(PELVIS), [np.tile(size * np.array(place), (frames, 1)) for place in PELVIS.values()]
        for side, sweep in (("left", left), ("right", right)):
            turn = Rotation.from_rotvec(swing(sweep))
            for label, place in zip(SIDES[side], CLUSTER * [1, 1 if side == "left" else -1, 1], strict=True):
                labels.append(label)
                local.append(size * (HIPS[side] + turn.apply(place)))
        x = np.stack([body.apply(each) + shift for each in local]).transpose(0, 2, 1)
        x = x + noise * rng.normal(size=x.shape)
        rows = [row for row, label in enumerate(labels) if label not in lacking]
        return Recording(name, tuple(labels[row] for row in rows), x[rows], 100.0)

    return make


def placed(places, true, point):
    """A point beside true places of markers, in the axes in which these are at other places."""
    turn, _ = Rotation.align_vectors(places - places.mean(axis=0), true - true.mean(axis=0))
    return turn.apply(point - true.mean(axis=0)) + places.mean(axis=0)


@pytest.fixture(scope="session")
def in_axes():
    """The function `placed`."""
    return placed


@pytest.fixture(scope="session")
def in_pelvis():
    """A function for a hip's true place in a calibration's pelvis, by the pelvis's markers."""

    def place(calibration, side):
        shape = calibration.shape("pelvis")
        return placed(shape.places, np.array([PELVIS[marker] for marker in shape.markers]), HIPS[side])

    return place


@pytest.fixture(scope="session")
def body_trial():
    """A function for a trial of a synthetic body with the markers of `rizzoli`, in which only the named joints move.

    The others sway by the share ``still`` of their ranges. ``who`` is the subject, whose skin moves alike in all of
    its trials; ``replaced`` how far markers are from their places, root mean square, metres.
    """

    def make(name, moving, seed, who=0, still=0.1, skin="mixed", tissue=0.004, frames=1000, reach=0.8, replaced=0.0):
        recipe = Recipe(frames=frames, rate=100.0, seed=who, soft_tissue=tissue, skin=skin, markers="rizzoli")
        reaches = dict.fromkeys(moving, reach)
        motions = {r: draw_motion(frames, 100.0, seed, height=1.75, reach=r, style="smooth") for r in (still, reach)}
        rows = {part.name: row for row, part in enumerate(PARTS)}
        rotations, origins, quiet = (array.copy() for array in motions[still])
        phases = still * quiet
        for row, part in enumerate(PARTS[1:], start=1):
            parent, one = rows[part.parent], motions[reaches.get(part.joint, still)][0]
            rotations[row] = rotations[parent] @ np.swapaxes(one[parent], 1, 2) @ one[row]
            origins[row] = origins[parent] + rotations[parent].dot(1.75 * np.array(part.at)).T
            phases[row] = reaches.get(part.joint, still) * quiet[row]
        parts = body("rizzoli")
        segments = np.array([row for row, part in enumerate(parts) for _ in part.markers])
        offsets = 1.75 * np.array([place for part in parts for place in part.markers.values()])
        offsets = offsets + replaced / np.sqrt(3) * np.random.default_rng(seed).standard_normal(offsets.shape)
        local = offsets[:, :, None] + skin_motion(recipe, rotations, phases, segments)
        x = np.einsum("mtij,mjt->mit", rotations[segments], local) + origins[segments]
        x = x + marker_noise(x.shape, 0.001, seed)
        return Recording(name, tuple(label for part in parts for label in part.markers), x, 100.0)

    return make


@pytest.fixture(scope="session")
def body_session(body_trial):
    """A function for the trials of one subject: left hip, right hip, knees; and a static one."""

    def make(who, **options):
        moving = {"left": ["left_hip"], "right": ["right_hip"], "knees": ["left_knee", "right_knee"]}
        numbered = enumerate(moving.items(), 1000 * who + 1)
        trials = [body_trial(name, joints, number, who, **options) for number, (name, joints) in numbered]
        return trials, body_trial("static", [], 1000 * who + 4, who, **options | {"still": 0.02, "frames": 200})

    return make


@pytest.fixture(scope="session")
def true_place():
    """A function for a joint's true place in a calibration's axes of its parent, by the parent's markers (3,)."""

    def place(calibration, joint):
        part = next(part for part in PARTS if part.joint == joint)
        own, shape = next(one for one in body("rizzoli") if one.name == part.parent), calibration.shape(part.parent)
        true = 1.75 * np.array([own.markers[marker] for marker in shape.markers])
        return placed(shape.places, true, 1.75 * np.array(part.at))

    return place
