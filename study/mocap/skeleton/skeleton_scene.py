"""The scene of a skeleton: its joints with their errors, and the reasons to doubt some of them."""

import numpy as np

from study.mocap.geometry.convex_hull import hull_distances
from study.mocap.io.recording import Recording
from study.mocap.joints.estimates import USABLE
from study.mocap.skeleton.draw_skeleton import Skeleton
from study.mocap.skeleton.make_scene import SceneJoint, make_scene
from study.mocap.skeleton.scene import Scene
from study.mocap.skeleton.subject_check import check_subject


def skeleton_scene(skeleton: Skeleton, recording: Recording) -> Scene:
    """Make the scene of a skeleton.

    Joints that are not reliable carry the reason, those far outside the markers' hull among them. A skeleton drawn with
    another subject's calibration says so, too.

    Args:
        skeleton: of phase 2.
        recording: that it was drawn from.

    Raises:
        RecordingError: if none of its joints is known in any frame.
    """
    check, calibration = check_subject(skeleton), skeleton.calibration
    own = calibration.source == skeleton.name
    source = "joints found in this recording" if own else f"joints found in {calibration.source}"
    joints = []
    hull = hull_distances(recording.positions, skeleton.centers)
    for place, center, flags, distance in zip(calibration.joints, skeleton.centers, skeleton.flags, hull, strict=True):
        reasons = [] if place.status in USABLE else [place.reason]
        reasons += [distance.doubt] if distance.doubt else []
        reasons += [] if check.same else ["another subject's calibration"]
        joints.append(
            SceneJoint(
                name=place.joint.name,
                parent=place.joint.parent,
                child=place.joint.child,
                center=center,
                rotation=skeleton.rotation(place.joint.parent),
                covariance=place.covariance,
                axis=None if np.isnan(place.axis_in_parent).any() else place.axis_in_parent,
                flags=flags,
                doubt="; ".join(reasons),
            )
        )
    notes = [*recording.notes, *([] if check.same and not check.misfits else [check.text])]
    return make_scene(recording, calibration.markerset, joints, source, notes)
