"""Figure 1: choice of the frame and direction, labels without overlap, and equal bytes."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from study.figures.style import save
from study.mocap.io.recording import RecordingError
from study.mocap.skeleton.scene import Flag
from study.mocap.view.fig1_skeleton import draw, prepare


@pytest.fixture(scope="module")
def frame(scene):
    """The chosen frame and direction."""
    return prepare(scene)


def test_the_pose_is_complete(scene, frame):
    """The chosen frame has the fewest missing markers and joints."""
    bad = (scene.flags != Flag.SEEN).sum(axis=0) + np.isnan(scene.places[:, 0]).sum(axis=0)
    assert bad[frame.frame] == bad.min()


def test_the_view_is_the_widest(scene, frame):
    """Joints appear farther apart from the chosen direction than from others."""
    apart = []
    for azimuth in (frame.camera.azimuth, *range(0, 360, 45)):
        seen = prepare(scene, frame.frame, float(azimuth)).camera.project(scene.points[:, :, frame.frame])[:, :2]
        i, j = np.triu_indices(len(seen), 1)
        apart.append(np.log(np.linalg.norm(seen[i] - seen[j], axis=1) + 0.02).mean())
    assert apart[0] == max(apart)


def test_words(scene):
    """A label gives a joint's largest standard error, and marks bridged and doubtful joints."""
    words = dict(zip(scene.joints, prepare(scene, 45).labels, strict=True))
    assert words["left_hip"] == "left hip 3.0 mm"
    assert words["neck"] == "neck 3.0 mm*"
    assert words[scene.joints[3]].endswith("(bridged)")
    unknown = replace(scene, errors=np.full_like(scene.errors, np.nan))
    assert prepare(unknown, 45).labels[scene.joints.index("left_hip")] == "left hip"


@pytest.mark.parametrize("number", [-1, 90])
def test_no_such_frame(scene, number):
    """A frame out of range is refused."""
    with pytest.raises(RecordingError, match=f"no frame {number}; there are 0 to 89"):
        prepare(scene, number)


@pytest.mark.parametrize("number", [0, 45, None])
def test_nothing_is_covered(scene, number):
    """No text covers another, and all are within the picture."""
    figure = draw(prepare(scene, number))
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    texts = [*figure.texts, *figure.axes[0].texts, *figure.legends[0].get_texts()]
    boxes = [text.get_window_extent() for text in texts]
    whole = figure.bbox
    for i, box in enumerate(boxes):
        assert whole.x0 <= box.x0 + 1, texts[i]
        assert box.x1 - 1 <= whole.x1, texts[i]
        assert not any(box.shrunk(0.95, 0.8).overlaps(other.shrunk(0.95, 0.8)) for other in boxes[:i]), texts[i]


def test_equal_bytes(scene, tmp_path):
    """Drawn twice, the figure is the same file."""
    one, two = (save(draw(prepare(scene)), tmp_path / name) for name in ("one", "two"))
    for a, b in zip(one, two, strict=True):
        assert a.read_bytes() == b.read_bytes()


def test_little_is_known(scene):
    """With one joint, no markers and no errors there is still a figure."""
    one = replace(
        scene,
        markers=(),
        places=np.empty((0, 3, 90)),
        joints=scene.joints[:1],
        centers=scene.centers[:1],
        tips=(),
        ends=np.empty((0, 3, 90)),
        bones=(),
        flags=scene.flags[:1],
        doubts=("",),
        errors=np.full((1, 3), np.nan),
        orientations=np.full((1, 90, 4), np.nan),
    )
    FigureCanvasAgg(draw(prepare(one))).draw()
