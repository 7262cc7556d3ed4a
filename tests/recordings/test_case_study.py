import itertools

import numpy as np
import pytest

from study.recordings.case_study import case_study, draw, printed
from study.recordings.joints.find import find_joints
from study.recordings.markersets import load_markerset
from study.recordings.recording import RecordingError
from study.recordings.synthetic.make import Recipe, synthesize

CMU41 = load_markerset("cmu41")


@pytest.fixture(scope="module")
def independent():
    """A case study of poses drawn anew in every frame."""
    recording, _ = synthesize(Recipe(frames=4000, independent=True, noise=0.001))
    return case_study(find_joints(CMU41, recording), recording, subsets=80, numbers=(50, 100, 200, 500, 1000))


@pytest.fixture(scope="module")
def few():
    """A few poses drawn anew, and their joints."""
    recording, _ = synthesize(Recipe(frames=400, independent=True))
    return recording, find_joints(CMU41, recording)


@pytest.fixture(scope="module")
def real(kata, kata_joints):
    """A case study of the kata."""
    return case_study(kata_joints, kata.recording, subsets=40)


def test_independent_poses_follow_the_root_law(independent):
    """The exponent is -0.5 ± 0.03 over N and over N_eff, which are nearly equal; τ is about one frame."""
    for axis in ("raw", "effective"):
        assert independent.laws.set_index("axis").loc[axis, "exponent"] == pytest.approx(-0.5, abs=0.03)
    assert independent.joints["memory"].max() < 1.2
    effective = independent.scatter[independent.scatter["way"] == "random"]
    assert (effective["effective"] > 0.9 * effective["samples"]).all()


def test_hinges_are_the_outliers_and_why(independent):
    """With every axis kept, the four hinges scatter most, along their axes; without, they scatter as the others."""
    table = independent.joints.set_index("joint")
    hinges = ["left_elbow", "right_elbow", "left_knee", "right_knee"]
    assert table.loc[hinges, "hinge"].all()
    assert (table.loc[hinges, "along"] > 0.9).all()
    assert {"left_knee", "right_knee", "left_elbow"} <= set(table.index[table["outlier"]]) <= set(hinges)
    assert table.loc[table["outlier"], "reason"].str.contains("a hinge").all()
    last = independent.scatter[independent.scatter["samples"] == 1000].query("way == 'random'")
    kept, dropped = (last[last["dropped"] == flag].set_index("joint")["median"] for flag in (False, True))
    assert (dropped[["left_knee", "right_knee"]] < 0.4 * kept[["left_knee", "right_knee"]]).all()


def test_the_table_is_the_papers(independent):
    """The table has mean and standard deviation of each centre; shares within a centimetre grow with N; sets agree."""
    part = independent.scatter.query("way == 'random' and not dropped and joint == 'left_hip'").set_index("samples")
    assert part[["mean_x", "mean_y", "mean_z", "sd_x", "sd_y", "sd_z"]].notna().all(axis=None)
    assert part["sd"].is_monotonic_decreasing
    assert part["near"].iloc[-1] == 1.0
    assert independent.joints.set_index("joint").loc["left_hip", "sets"] < 3 * part["sd"].iloc[2]


def test_real_frames_are_correlated(real):
    """τ is tens of frames; the exponent is near -0.5; most fits are within a centimetre at 200 frames."""
    assert (real.joints["memory"] > 10).all()
    assert real.joints["worth"].max() < 0.1 * real.frames
    for axis, low, high in (("raw", -0.65, -0.4), ("effective", -0.9, -0.3)):
        found = real.laws.set_index("axis").loc[axis]
        assert low < found["exponent"] < high
        assert found["low"] <= found["exponent"] <= found["high"]
    plain = real.scatter.query("way == 'random' and not dropped").groupby("samples")["near"].mean()
    assert plain[200] > 0.7
    assert plain[1000] > plain[50]
    # consecutive frames are far worse than as many random ones
    both = real.scatter.query("samples == 1000 and joint == 'left_hip'").set_index("way")["median"]
    assert both["window"] > 3 * both["random"]
    # effective numbers saturate: each is at most that of the whole recording
    scatter = real.scatter.query("way == 'random'").merge(real.joints[["joint", "worth"]], on="joint")
    assert (scatter["effective"] <= 1.05 * scatter["worth"]).all()
    assert np.all(np.diff(scatter.query("joint == 'left_hip'")["effective"]) > 0)


def test_outliers_of_a_real_recording_have_reasons(real):
    """All joints are in the table, and each outlier has a reason."""
    assert set(real.scatter["joint"]) | set(real.skipped) == {joint.name for joint in CMU41.joints}
    outliers = real.joints[real.joints["outlier"]]
    assert len(outliers)
    assert (outliers["reason"] != "").all()
    assert any("right ankle" in line for line in printed(real))


@pytest.mark.parametrize("numbers", [(20, 50, 100), (3, 10, 300)], ids=["less than two decades", "two decades"])
def test_labels_of_the_axes_do_not_overlap(few, numbers):
    """Numbers of frames have room beside each other, and there are two or more."""
    recording, joints = few
    figure = draw(case_study(joints, recording, subsets=8, numbers=numbers))
    figure.draw_without_rendering()
    for ax in figure.axes:
        labels = [*ax.get_xticklabels(), *ax.get_xticklabels(minor=True)]
        low, high = ax.get_window_extent().intervalx
        boxes = [label.get_window_extent() for label in labels if label.get_text()]
        boxes = sorted((box for box in boxes if low <= (box.x0 + box.x1) / 2 <= high), key=lambda box: box.x0)
        assert len(boxes) >= 2
        assert all(one.x1 < other.x0 for one, other in itertools.pairwise(boxes))


def test_the_same_seed_gives_the_same(few):
    recording, joints = few
    one, other = (case_study(joints, recording, subsets=8, numbers=(20, 50)) for _ in range(2))
    assert one.scatter.equals(other.scatter)


def test_the_figure_draws(independent):
    figure = draw(independent)
    texts = [text.get_text() for ax in figure.axes for text in ax.texts]
    assert any("exponent −0." in text for text in texts)


@pytest.mark.parametrize(("kwargs", "words"), [({"subsets": 6}, "multiple of 4"), ({}, "needs at least 200")])
def test_wrong_arguments(few, kwargs, words):
    recording, joints = few
    with pytest.raises(RecordingError, match=words):
        case_study(joints, recording if kwargs else recording.select(frames=slice(0, 100)), **kwargs)


def test_nothing_to_study():
    """A body that does not move gives one line."""
    recording, _ = synthesize(Recipe(frames=400, noise=0.0, reach=0.0))
    with pytest.raises(RecordingError, match="none of its joints"):
        case_study(find_joints(CMU41, recording), recording, numbers=(20, 50))
