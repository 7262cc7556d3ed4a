import numpy as np

from study.mocap.io.recording import Recording
from study.mocap.joints.fit_joints import find_joints
from study.mocap.joints.method_agreement import METHODS, agreement_table
from study.mocap.markersets.set_file import load_markerset
from study.mocap.synthetic.recipe import Recipe
from study.mocap.synthetic.synthesize import synthesize

CMU41 = load_markerset("cmu41")


def test_without_noise_all_methods_agree():
    """With 0.1 mm of noise methods agree to 2 mm, images of a joint coincide, and ranges of motion are the body's."""
    recording, _ = synthesize(Recipe(frames=600, noise=1e-4))
    table = agreement_table(find_joints(CMU41, recording), recording).set_index("joint")
    balls = table.drop([name for name in table.index if "elbow" in name or "knee" in name])
    for name in ("mgdk", "gdke", "ugdk", "mle"):
        assert balls[f"from_{name}"].max() < 2e-3, name
    assert table["from_two_sided"].max() < 1e-3
    assert table["gap"].max() < 2e-3
    assert 20 < table.loc["left_knee", "turn"] < 60
    assert 30 < table.loc["left_hip", "cap"] < 90
    assert np.isnan(table.loc["left_wrist", "turn"])  # a hand of one marker has no frame
    assert table.loc["left_wrist", "radii"][0] > 0.05


def test_without_noise_there_is_an_answer():
    """Where all that is left is rounding, distances are numbers or NaN, and nothing fails."""
    recording, _ = synthesize(Recipe(frames=200, noise=0.0))
    assert len(agreement_table(find_joints(CMU41, recording), recording)) == 14


def test_nothing_found():
    """Without samples every distance is NaN, and nothing warns."""
    empty = Recording("empty", CMU41.markers(), np.full((41, 3, 20), np.nan), 100.0)
    table = agreement_table(find_joints(CMU41, empty), empty)
    assert len(table) == 14
    assert table[[f"from_{name}" for name in METHODS]].isna().all(axis=None)
