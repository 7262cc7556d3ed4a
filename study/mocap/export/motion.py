"""A skeleton over time as it is handed to the writers of files."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from study.mocap.export.rest_pose import RestPose, rest_rotations
from study.mocap.io.recording import Recording
from study.mocap.skeleton.draw_skeleton import Skeleton
from study.mocap.skeleton.scene import Scene
from study.mocap.skeleton.upright import upright_rotation
from study.sphere.types import Floats


@dataclass(frozen=True, eq=False)
class ExportedMotion:
    """A skeleton with all that is known of it.

    Attributes:
        skeleton: of phase 2, in the recording's axes.
        recording: the whole recording that it was drawn from; its axes, labels and markers are the file's.
        scene: the same skeleton with z up, with errors and doubts.
        source: the recording's file, or None.
        rest: the pose in which files with a hierarchy have no rotations.
    """

    skeleton: Skeleton
    recording: Recording
    scene: Scene
    source: Path | None = None
    rest: RestPose = RestPose.T_POSE

    @cached_property
    def upright(self) -> Floats:
        """Rotation (3, 3) of the recording's axes after which z points up."""
        return upright_rotation(self.recording)

    @cached_property
    def rest_rotations(self) -> dict[str, Floats]:
        """Rotation (3, 3) of each segment's axes in the pose without rotations, z up."""
        return rest_rotations(self.skeleton.calibration, self.upright, self.rest)

    def joint_labels(self) -> tuple[str, ...]:
        """Labels of the joints as points beside the markers: their names, ``_joint`` added where a marker has one."""
        taken = {marker.lower() for marker in self.recording.markers}
        return tuple(name + "_joint" * (name.lower() in taken) for name in self.skeleton.joints)

    def with_joints(self) -> Recording:
        """The recording with the joint centres as points behind its markers, in its own axes; NaN where unknown."""
        known = np.flatnonzero(~np.isnan(self.skeleton.centers[:, 0]).all(axis=1))
        labels = tuple(self.joint_labels()[number] for number in known)
        points = np.concatenate([self.recording.positions, self.skeleton.centers[known]])
        return Recording(self.recording.name, (*self.recording.markers, *labels), points, self.recording.rate)
