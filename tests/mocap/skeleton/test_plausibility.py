from dataclasses import replace

import numpy as np
import pytest

from study.mocap.joints.joint_table import joint_table
from study.mocap.skeleton.calibrate import calibration_from
from study.mocap.skeleton.calibration_file import load_calibration, save_calibration
from study.mocap.skeleton.draw_skeleton import draw_skeleton
from study.mocap.skeleton.plausibility import plausibility


def moved(calibration, name, in_parent):
    """The calibration with a joint at another place in its parent's axes."""
    joints = (replace(p, in_parent=np.array(in_parent)) if p.joint.name == name else p for p in calibration.joints)
    return replace(calibration, joints=tuple(joints))


def warned(calibration, recording):
    return plausibility(calibration, draw_skeleton(calibration, recording), recording)


def test_a_body_raises_no_warning(figure_calibration, figure):
    """The synthetic body's hips are .71 of its front waist markers apart, and its sides are equal."""
    assert warned(figure_calibration, figure[0]) == {}


@pytest.mark.parametrize(("factor", "warns"), [(0.85, True), (0.95, False), (1.65, False), (1.8, True)])
def test_hips(figure_calibration, figure, factor, warns):
    """Hip to hip over the spines' markers is plausible from .65 to 1.2; the body's is .05/.07 = .714."""
    hips = [figure_calibration[f"{side}_hip"].in_parent for side in ("left", "right")]
    middle = (hips[0] + hips[1]) / 2
    wide = figure_calibration
    for side, at in zip(("left", "right"), hips, strict=True):
        wide = moved(wide, f"{side}_hip", middle + factor * (at - middle))
    found = warned(wide, figure[0])
    assert any("hip to hip is" in words for words in found.get("left_hip", ())) == warns
    assert ("left_hip" in found) == ("right_hip" in found)


def test_bones_of_unequal_length(figure_calibration, figure):
    """A thigh that is a fifth longer than the other is named on both of its joints, on either side."""
    knee = figure_calibration["left_knee"].in_parent
    hip = figure_calibration["left_hip"].in_child
    found = warned(moved(figure_calibration, "left_knee", hip + 1.2 * (knee - hip)), figure[0])
    assert {"left_hip", "left_knee", "right_hip", "right_knee"} <= set(found)
    assert "its bone left_hip - left_knee is 51" in found["left_knee"][0]
    assert "left_elbow" not in found


def test_a_joint_outside_the_hull(figure_calibration, figure):
    """A hip three metres in front of the body is outside in nearly all frames."""
    found = warned(moved(figure_calibration, "left_hip", [3.0, 0.0, 0.0]), figure[0])
    assert any("outside the markers' hull in" in words for words in found["left_hip"])


def test_both_phases_say_the_same(figure, tmp_path):
    """Error, floor and warnings are the same in the table of phase 1 and in a calibration that is read again."""
    recording, _, found = figure
    calibration = load_calibration(save_calibration(calibration_from(found, recording), tmp_path / "calibration.json"))
    table = joint_table(found).set_index("joint")
    for place in calibration.joints:
        assert place.standard_error == table.loc[place.joint.name, "error"]
        assert place.floor == table.loc[place.joint.name, "floor"]
        assert 0.001 < place.floor < 0.05
        assert place.warnings == ()
    lines = list(calibration.lines())
    assert len(lines) == 1 + len(calibration.joints)
    neck = table.loc["neck"]
    row = next(line for line in lines if line.startswith("neck")).split()
    assert row == ["neck", "ok", f"{1000 * neck['error']:.1f}", f"{1000 * neck['floor']:.1f}"]


def test_older_calibrations_are_read(figure_calibration, tmp_path):
    """A file without floor and warnings is read; the floor is then not known."""
    path = save_calibration(figure_calibration, tmp_path / "calibration.json")
    text = path.read_text()
    assert '"warnings": []' in text
    lines = [line for line in text.splitlines() if '"floor"' not in line and '"warnings"' not in line]
    path.write_text("\n".join(lines).replace("],\n  }", "]\n  }").replace("],\n  },", "]\n  },"))
    assert np.isnan(load_calibration(path)["neck"].floor)
