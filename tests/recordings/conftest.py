"""Fixtures of the tests on recordings: small recordings, C3D files written by another library, real recordings."""

import warnings
from pathlib import Path

import c3d
import ezc3d
import numpy as np
import pytest

from study.recordings.formats.read import read_recording
from study.recordings.formats.write import write_recording
from study.recordings.joints.estimate import JointStatus
from study.recordings.joints.find import Calibration, JointPlace, SegmentShape, find_joints
from study.recordings.markersets import choose, load_markerset, match
from study.recordings.recording import Recording
from study.recordings.skeleton.calibrate import calibrate, with_checks
from study.recordings.skeleton.draw import Skeleton
from study.recordings.skeleton.scene import make_scene
from study.recordings.synthetic.make import Recipe, synthesize


def shared(name):
    """Path of a recording in the folder of shared data; the test is skipped if it is missing."""
    for folder in Path(__file__).resolve().parents:
        if (folder / "shared" / "data" / name).is_file():
            return folder / "shared" / "data" / name
    pytest.skip(f"needs {name} in the folder of shared data, which is not part of the project")


@pytest.fixture(scope="session")
def shared_file():
    """A function for the path of a recording of the shared data, by its name."""
    return shared


@pytest.fixture(scope="session")
def functional():
    """Two real recordings of one session, a functional trial of the hips and a walk, with the marker set of both."""
    whole = load_markerset(shared("functional_hips_markers.toml"))
    names = ("functional_hips.c3d", "gait_same_session.c3d")
    return [match(whole, read_recording(shared(name))) for name in names]


@pytest.fixture(scope="session")
def kata():
    """A real recording, a karate kata of 5202 frames, with the marker set that fits it."""
    return choose(read_recording(shared("cmu_135_02.c3d")))


@pytest.fixture(scope="session")
def kata_joints(kata):
    """Its joints."""
    return find_joints(kata.markerset, kata.recording)


@pytest.fixture(scope="session")
def kata_calibration(kata, kata_joints):
    """The calibration that they make."""
    return with_checks(kata_joints, kata.recording)


@pytest.fixture(scope="session")
def kata_halves(kata):
    """Its first and its second half, each with a calibration of its own."""
    half = kata.recording.frames // 2
    pieces = [kata.recording.select(frames=part) for part in (slice(0, half), slice(half, None))]
    return [(piece, calibrate(piece, kata.markerset)) for piece in pieces]


@pytest.fixture(scope="session")
def exact():
    """A synthetic body without noise, the truth about it, and its fitted joints."""
    recording, truth = synthesize(Recipe(frames=800, noise=1e-9))
    return recording, truth, find_joints(load_markerset("cmu41"), recording)


@pytest.fixture(scope="session")
def figure():
    """A synthetic body with 1 mm of noise, the truth about it, and its fitted joints."""
    recording, truth = synthesize(Recipe(frames=600, noise=0.001))
    return recording, truth, find_joints(load_markerset("cmu41"), recording)


@pytest.fixture(scope="session")
def figure_calibration(figure):
    """The calibration that they make."""
    return with_checks(figure[2], figure[0])


@pytest.fixture(scope="session")
def small():
    """A function for small recordings with gaps; millimetres to three decimals hold their numbers exactly."""

    def make(markers=("LFHD", "RFHD", "C7", "LFIN"), frames=12, rate=100.0, seed=3):
        rng = np.random.default_rng(seed)
        positions = np.round(rng.normal(size=(len(markers), 3, frames)), 4)
        hidden = rng.random((len(markers), frames)) < 0.2
        positions[np.broadcast_to(hidden[:, None], positions.shape)] = np.nan
        return Recording("small", tuple(markers), positions, rate)

    return make


@pytest.fixture(scope="session")
def write_c3d():
    """Write a C3D file with the library c3d: labels, points (markers, 3, frames), NaN as a residual of -1."""

    def write(path, labels, points, rate=100.0, scale=-1.0, unit="mm", residual=0.0, groups=()):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            writer = c3d.Writer(point_rate=rate, analog_rate=0, point_scale=scale)
            writer.set_point_labels(list(labels))
            writer.get("POINT").add_str("UNITS", "", unit, len(unit))
            for name, texts in groups:
                width = max(map(len, texts))
                writer.get("POINT").add_str(name, "", "".join(f"{text:{width}}" for text in texts), width, len(texts))
            table = np.nan_to_num(np.asarray(points, dtype=float)).transpose(2, 0, 1)
            flags = np.where(np.isnan(points).any(axis=1), -1.0, residual).T
            rows = np.concatenate([table, flags[:, :, None], np.zeros((*flags.shape, 1))], axis=2)
            writer.add_frames([(row, np.zeros((0, 0))) for row in rows])
            with open(path, "wb") as file:
                writer.write(file)
        return path

    return write


def write_rich_c3d(recording, path):
    """Write a C3D file of a recording with two analog channels, an event and a force plate's parameter, by ezc3d."""
    file = ezc3d.c3d(str(write_recording(recording, path)))
    analog = file["parameters"]["ANALOG"]
    analog["RATE"]["value"], analog["LABELS"]["value"] = [10 * recording.rate], ["Fz1", "EMG"]
    analog["UNITS"]["value"] = ["N", "V"]
    file["data"]["analogs"] = np.random.default_rng(1).normal(size=(1, 2, 10 * recording.frames))
    file.add_parameter("POINT", "LONG_FRAMES", [float(recording.frames)])
    file.add_parameter("EVENT", "LABELS", ["Foot Strike"])
    file.add_parameter("EVENT", "TIMES", np.array([[0.0], [0.31]]))
    file.add_parameter("FORCE_PLATFORM", "TYPE", [2])
    file.write(str(path))
    return path


@pytest.fixture(scope="session")
def write_rich():
    """The function `write_rich_c3d`."""
    return write_rich_c3d


def true_skeleton(recording, truth, joints=None, **changes):
    """A skeleton of a synthetic body's true joints (all, if none are named); ``changes`` are fields of each joint."""
    markerset, places = load_markerset("cmu41"), []
    declared = {joint.name: joint for joint in markerset.joints}
    names = truth.joints if joints is None else joints
    for name in names:
        number = truth.joints.index(name)
        parts = {"covariance": np.eye(3) * 1e-6, "in_parent": truth.in_parent[number]} | changes
        places.append(JointPlace(declared[name], JointStatus.OK, "", axis_in_parent=truth.axes[number], **parts))
    segments = [segment.name for segment in markerset.segments]
    shapes = tuple(SegmentShape(name, (), np.zeros((0, 3)), np.zeros(0), False, "") for name in segments)
    rows, frames = [truth.segments.index(name) for name in segments], recording.frames
    return Skeleton(
        name=recording.name,
        rate=recording.rate,
        calibration=Calibration("truth", frames, markerset, shapes, tuple(places)),
        rotations=truth.rotations[rows].transpose(0, 2, 3, 1),
        origins=truth.origins[rows],
        segment_flags=np.zeros((len(rows), frames), dtype=np.uint8),
        misfits=np.full(len(rows), np.nan),
        left_out=np.zeros(len(rows)),
        turning=np.zeros((len(rows), frames, 3, 3)),
        centers=truth.centers[[truth.joints.index(name) for name in names]].copy(),
        flags=np.zeros((len(names), frames), dtype=np.uint8),
        posed=np.zeros((len(names), 3, frames)),
        gaps=np.zeros(len(names)),
    )


@pytest.fixture(scope="session")
def of_truth():
    """The function `true_skeleton`."""
    return true_skeleton


@pytest.fixture(scope="session")
def scene():
    """A scene of a synthetic body with its true joints: some bridged, one doubtful, one never known."""
    recording, truth = synthesize(Recipe(frames=90, rate=90.0, gaps=0.05))
    skeleton = true_skeleton(recording, truth, covariance=np.diag([9e-6, 4e-6, 1e-6]))
    skeleton.flags[3, 40:50] = 1
    skeleton.center("right_wrist")[:] = np.nan
    doubts = ["moved too little" if name == "neck" else "" for name in truth.joints]
    return make_scene(skeleton, recording, doubts, "true joints")
