"""Recordings in Python, as the commands treat them: from a file to joints, and to a skeleton in every frame."""

from collections.abc import Iterable, Sequence
from pathlib import Path

from study.recordings.export.tree import LARGEST_ANGLE_ERROR, ExportedMotion
from study.recordings.formats.read import read_recording
from study.recordings.gait import Gait, gait_of
from study.recordings.joints.find import Calibration
from study.recordings.one_joint import OneJoint, find_clusters, fit_one_joint
from study.recordings.recording import Recording, RecordingError
from study.recordings.session import fit_session
from study.recordings.skeleton import draw
from study.recordings.skeleton.anatomy import Hips
from study.recordings.skeleton.calibrate import require_same_subject, with_joints
from study.recordings.skeleton.gate import gated
from study.recordings.skeleton.scene import skeleton_scene

Source = str | Path | Recording
"""A recording, or its file."""


def find_joints(
    recording: Source | Sequence[Source],
    markerset: str | None = None,
    *,
    static: Source | None = None,
    hips: Hips = "motion",
    segments: str = "",
) -> Calibration:
    """Find the joints of a recording, or of several trials of one session: phase 1, as `study joints` does.

    Args:
        recording: a `Recording` or its file; or several, of the same subject with the same markers: each joint then
            comes from the trials that moved it.
        markerset: name or file of a marker set; the shipped one that fits best if None.
        static: a trial that gives the shapes of the segments, and their anatomical axes.
        hips: "regression" for hips that motion leaves in doubt by the pelvis' width and depth (Harrington 2007), or
            from the file's own LHJC and RHJC; their status is ``REGRESSION``.
        segments: names of the segments to use with commas between them, or "legs" for pelvis and legs; all if "".

    Returns:
        The joints by their names, ``joints["left_hip"]``, and all in ``joints.joints``. Each has a ``status`` and the
        ``reason`` for it in words, its place ``in_parent`` and ``in_child`` (3,), metres, in the axes of its two
        segments, the ``covariance`` (3, 3) of the place, m², and its largest ``standard_error``, metres.
        `draw_skeleton` draws other recordings of the subject with them.

    Raises:
        RecordingError: if a recording cannot be read, or trials seem to show different subjects.
        MarkerSetError: if the marker set cannot be read, or no joint can be found with it.

    Examples:
        A body of random motion, whose joints are known:

        >>> import numpy as np, study
        >>> from study.recordings.synthetic.make import Recipe, synthesize
        >>> recording, truth = synthesize(Recipe(frames=500, noise=0.001))
        >>> joints = study.find_joints(recording)
        >>> hip = joints["left_hip"]
        >>> hip.status.name, hip.joint.parent, hip.joint.child
        ('OK', 'pelvis', 'left_thigh')
        >>> bool(hip.standard_error < 0.001)
        True
    """
    trials = _several(recording)
    every = [_read(trial) for trial in [*trials, *([] if static is None else [static])]]
    if not every:
        raise RecordingError("no recording is given; give one, or several of one session")
    if len(every) == 1:
        return with_joints(every[0], None, markerset, hips, segments)[1]
    return fit_session(every, static is not None, markerset, hips, segments)[1].calibration


def find_joint(
    recording: Source, parent: Sequence[str], child: Sequence[str], *, hinge: bool = False, across: Sequence[str] = ()
) -> OneJoint:
    """Find one joint, from the markers of its two segments, as `study joint` does.

    Args:
        recording: a `Recording` or its file.
        parent: labels of three or more markers of the parent segment.
        child: labels of markers of the child segment, which rotates about the joint.
        hinge: True if the joint is a hinge, such as a knee or an elbow.
        across: labels of the lateral and the medial point midway between which a hinge lies along its axis.

    Returns:
        The joint: ``ok``; ``doubts``, the reasons not to rely on it; its largest standard ``error``, metres; its mean
        place ``in_recording`` (3,), metres; and more. One that cannot be found has NaN for its place.

    Raises:
        RecordingError: if the recording cannot be read, or its markers cannot fix a joint.

    Examples:
        A thigh that rotates about a point 0.4 m below the origin, before a pelvis at rest:

        >>> import numpy as np, study
        >>> from scipy.spatial.transform import Rotation
        >>> rng = np.random.default_rng(1)
        >>> pelvis = np.array([[0.1, 0.1, 0], [-0.1, 0.1, 0], [0, -0.1, 0]])
        >>> thigh = np.array([[0.05, 0, -0.2], [-0.05, 0, -0.3], [0, 0.05, -0.4]])
        >>> turns = Rotation.from_rotvec(rng.uniform(-0.5, 0.5, (300, 3))).as_matrix()
        >>> moved = [0, 0, -0.4] + np.einsum("tij,mj->mti", turns, thigh)
        >>> rest = np.repeat(pelvis[:, None], 300, axis=1)
        >>> positions = np.swapaxes(np.concatenate([rest, moved]), 1, 2) + rng.normal(0, 0.001, (6, 3, 300))
        >>> recording = study.Recording("arrays", ("P1", "P2", "P3", "T1", "T2", "T3"), positions, rate=100)
        >>> joint = study.find_joint(recording, ["P1", "P2", "P3"], ["T1", "T2", "T3"])
        >>> joint.ok, joint.doubts
        (True, ())
        >>> np.round(joint.in_recording, 2) + 0.0
        array([ 0. ,  0. , -0.4])
    """
    source = _read(recording)
    return fit_one_joint(source, find_clusters(source, ",".join(parent), ",".join(child), ",".join(across), hinge))


def draw_skeleton(
    recording: Source,
    joints: Calibration | str | Path | None = None,
    *,
    markerset: str | None = None,
    segments: str = "",
    force: bool = False,
    largest_error: float = draw.LARGEST_ERROR,
) -> draw.Skeleton:
    """Draw the skeleton of a recording in every frame: phase 2, as `study skeleton` does.

    Args:
        recording: a `Recording` or its file.
        joints: of the same subject with the same markers, as `find_joints` returns them or in a calibration.json; found
            in this recording if None.
        markerset: for joints that are found here; the shipped one that fits best if None.
        segments: as in `find_joints`.
        force: True to use ``joints`` even if they seem to be another subject's.
        largest_error: standard error above which a joint is unknown in a frame, metres.

    Returns:
        The skeleton: ``center("left_hip")`` is a joint's centre (3, frames), metres, NaN where unknown, ``flags``
        (joints, frames) tell if markers show it, and ``rotation("left_thigh")`` is the rotation of a segment (3, 3,
        frames). ``barred`` is what no body can do, with the reason; it is missing.

    Raises:
        RecordingError: if the recording cannot be read, or the joints seem to be another subject's.
        MarkerSetError: if the marker set cannot be read, or no joint can be found with it.

    Examples:
        >>> import numpy as np, study
        >>> from study.recordings.synthetic.make import Recipe, synthesize
        >>> recording, truth = synthesize(Recipe(frames=500, noise=0.001))
        >>> skeleton = study.draw_skeleton(recording)
        >>> skeleton.center("left_hip").shape
        (3, 500)
        >>> off = skeleton.center("left_hip") - truth.centers[truth.joints.index("left_hip")]
        >>> bool(np.linalg.norm(off, axis=0).max() < 0.01)
        True
    """
    placed, calibration = with_joints(_read(recording), joints, markerset, segments=segments)
    require_same_subject(calibration, placed.recording, force=force)
    return gated(draw.draw_skeleton(calibration, placed.recording, largest_error=largest_error), placed.source)


def find_gait(
    walks: Source | Sequence[Source],
    joints: Calibration | str | Path | None = None,
    markerset: str | None = None,
    *,
    static: Source | None = None,
    hips: Hips = "motion",
    force: bool = False,
    largest_angle_error: float = LARGEST_ANGLE_ERROR,
) -> Gait:
    """Find the gait cycles of walks, and the angles of hips, knees and ankles over them, as `study gait` does.

    Pelvis and legs alone are used: the rest of the body has no say.

    Args:
        walks: a `Recording` or its file; or several of one subject.
        joints: of the same subject with the same markers; found in the walks themselves if None.
        markerset: for joints that are found here; the shipped one that fits best if None.
        static: as in `find_joints`.
        hips: as in `find_joints`.
        force: True to use ``joints`` even if they seem to be another subject's.
        largest_angle_error: standard error above which an angle is missing in a frame, degrees.

    Returns:
        ``cycles``, a table with a row per cycle; ``curves``, the angles of each cycle at 0 to 100 %, with their errors;
        and ``means()``, their means and standard deviations over the cycles.

    Raises:
        RecordingError: if a recording cannot be read, the joints seem to be another subject's, or no walk has a cycle.
        MarkerSetError: if the marker set cannot be read, or no joint can be found with it.

    Examples:
        >>> import study
        >>> from study.recordings.synthetic.make import Recipe, synthesize
        >>> walk, truth = synthesize(Recipe(frames=600, gait=True, markers="rizzoli"))
        >>> gait = study.find_gait(walk)
        >>> sorted(gait.means()["joint"].unique())
        ['ankle', 'foot', 'hip', 'knee', 'pelvis']
    """
    every = [_read(walk) for walk in _several(walks)]
    if joints is None:
        joints = find_joints(every, markerset, static=static, hips=hips, segments="legs")
    motions = []
    for walk in every:
        placed, calibration = with_joints(walk, joints, None, segments="legs")
        require_same_subject(calibration, placed.recording, force=force)
        drawn = gated(draw.draw_skeleton(calibration, placed.recording), walk)
        scene = skeleton_scene(drawn, placed.recording)
        motions.append(ExportedMotion(drawn, walk, scene, largest_angle_error=largest_angle_error))
    return gait_of(motions)


def _several(recordings: Source | Sequence[Source]) -> list[Source]:
    """Recordings as a list; what is no sequence is one, and `_read` names it if it is no recording."""
    if isinstance(recordings, str | bytes | Path | Recording) or not isinstance(recordings, Iterable):
        return [recordings]
    return list(recordings)


def _read(recording: Source) -> Recording:
    return recording if isinstance(recording, Recording) else read_recording(recording)
