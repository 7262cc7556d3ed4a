"""Skeletons to write."""

import numpy as np
import pytest

from study.recordings.export.tree import ExportedMotion
from study.recordings.recording import Recording
from study.recordings.skeleton.draw import draw_skeleton
from study.recordings.skeleton.scene import skeleton_scene


def export(recording, calibration, **options):
    """A skeleton of a recording, as the writers take it."""
    skeleton = draw_skeleton(calibration, recording)
    return ExportedMotion(skeleton, recording, skeleton_scene(skeleton, recording), **options)


def chain(motion):
    """Places of the joints of rigid bones (3, frames), z up: from the root, by each segment's rotation and its bones.

    A hierarchy keeps the lengths of its bones, so that its joints are as far from those of the markers as the gaps of
    the joints above add up to. NaN where a segment on the way is unknown.
    """
    skeleton, calibration = motion.skeleton, motion.skeleton.calibration
    rotations = dict(
        zip(skeleton.segments, np.einsum("ij,sjkt->sikt", motion.upright, skeleton.rotations), strict=True)
    )
    origins = dict(zip(skeleton.segments, np.einsum("ij,sjt->sit", motion.upright, skeleton.origins), strict=True))
    above, places = {place.joint.child: place for place in calibration.joints}, {}

    def place_of(segment):
        """Place of a point of a segment in the world, and that point in its axes."""
        own = above.get(segment)
        if own is None or not own.known or (calibration.shape(segment).has_own_pose and own.standard_error > 0.05):
            return origins[segment], np.zeros(3)
        return joint_of(own), own.in_child

    def joint_of(place):
        world, local = place_of(place.joint.parent)
        return world + np.einsum("ijt,j->it", rotations[place.joint.parent], place.in_parent - local)

    for place in calibration.joints:
        places[place.joint.name] = joint_of(place)
    return places


@pytest.fixture(scope="session")
def chained():
    """The function `chain`."""
    return chain


@pytest.fixture(scope="session")
def exported():
    """The function `export`."""
    return export


@pytest.fixture(scope="session")
def motion(figure, figure_calibration):
    """A synthetic body, 100 frames of its recording."""
    return export(figure[0].select(frames=slice(0, 100)), figure_calibration)


@pytest.fixture(scope="session")
def gappy(figure, figure_calibration):
    """The same, 300 frames; the head's markers are missing at the end, all others for some time in the middle."""
    recording = figure[0].select(frames=slice(0, 300))
    positions = recording.positions.copy()
    head = [recording.row(marker) for marker in ("LFHD", "RFHD", "LBHD", "RBHD")]
    positions[head, :, 100:] = np.nan
    positions[:, :, 40:50] = np.nan
    return export(Recording("gappy", recording.markers, positions, 60.0), figure_calibration)


@pytest.fixture(scope="session")
def y_up(figure):
    """A recording of the same body whose y points up, with its calibration."""
    from study.recordings.markersets import load_markerset
    from study.recordings.skeleton.calibrate import calibrate

    turn = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    whole = figure[0].select(frames=slice(0, 400))
    recording = Recording("y-up", whole.markers, turn @ whole.positions, whole.rate)
    return export(recording.select(frames=slice(0, 60)), calibrate(recording, load_markerset("cmu41")))
