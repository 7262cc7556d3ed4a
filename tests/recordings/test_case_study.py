import itertools

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from study.recordings.case_study import case_study, draw, printed, with_outliers
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
    assert real.joints["effective_frames"].max() < 0.1 * real.frames
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
    scatter = real.scatter.query("way == 'random'").merge(real.joints[["joint", "effective_frames"]], on="joint")
    assert (scatter["effective"] <= 1.05 * scatter["effective_frames"]).all()
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


def table_of(noise, median):
    """A joint whose markers leave their spheres by a noise, and moves by 4°, among five that scatter by 4 mm."""
    names = ["waist", *"abcde"]
    scatter = pd.DataFrame({"joint": names, "median": [median, *[0.004] * 5], "samples": 200, "way": "random"})
    joints = pd.DataFrame({"joint": names, "along": 0.3, "cap": 60.0, "condition": 0.1, "hinge": False, "moved": 4.0})
    return with_outliers(joints.assign(noise=[noise, *[0.002] * 5]), scatter.assign(dropped=False)).set_index("joint")


@pytest.mark.parametrize(("noise", "explained"), [(0.012, True), (0.004, False)])
def test_an_outlier_of_noise_and_little_motion(noise, explained):
    """12 mm over 4° and √200 are 12.2 mm, which explain a scatter of 11 mm; 4 mm do not. Others need no reason."""
    table = table_of(noise, 0.011)
    assert list(table.index[table["outlier"]]) == ["waist"]
    words = "its markers leave their spheres by 12.0 mm, and it moves by 4.0° about one axis: a scatter of 12 mm"
    assert table.loc["waist", "reason"] == (words if explained else "")
    assert (table.loc[list("abcde"), "reason"] == "").all()


def test_the_scatter_by_noise_is_that_of_fits():
    """Markers that leave a sphere together by σ, while it rotates by θ, scatter the centre by σ/(θ √N), within 15 %.

    A marker at the end of an arm, rotating about two axes, by 4° about one; 300 fits of 400 points. The standard error
    of their standard deviation is 4 %.
    """
    rng, theta, sigma = np.random.default_rng(3), np.radians(4.0), 0.004
    angles = rng.normal(0.0, [theta, 6 * theta], (300, 400, 2))
    arms = 0.3 * Rotation.from_rotvec(np.insert(angles.reshape(-1, 2), 2, 0.0, axis=1)).apply([0.0, 0.0, 1.0])
    points = arms.reshape(300, 400, 3) * (1.0 + rng.normal(0.0, sigma / 0.3, (300, 400, 1)))
    centers = np.array([np.linalg.lstsq(np.c_[2 * x, np.ones(400)], (x**2).sum(axis=1))[0][:3] for x in points])
    assert centers[:, 1].std() == pytest.approx(sigma / (theta * np.sqrt(400)), rel=0.15)


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
