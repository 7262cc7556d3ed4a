"""Looking at a scene: axes of the view, outlines of ellipsoids, how long half axes are.

Figure 1: choice of the frame and direction, labels without overlap, and equal bytes.

The video: its frames, its speed, and refusals in one line.
"""

import subprocess
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from study.recordings.recording import RecordingError
from study.recordings.skeleton.draw import Flag
from study.recordings.view.figure import (
    Camera,
    draw,
    exaggeration,
    half_axes,
    hinges,
    label,
    outlines,
    prepare,
    surface,
    write_video,
)
from study.style import save


@pytest.mark.parametrize(("azimuth", "elevation"), [(0, 0), (30, 10), (200, -40), (-75, 89)])
def test_axes(azimuth, elevation):
    """The axes of the view are a rotation; the first is horizontal, the third points to the viewer."""
    axes = Camera(azimuth, elevation).axes
    assert np.allclose(axes @ axes.T, np.eye(3))
    assert np.linalg.det(axes) == pytest.approx(1.0)
    assert axes[0, 2] == 0.0
    a, e = np.radians([azimuth, elevation])
    assert np.allclose(axes[2], [np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)])


@pytest.mark.parametrize("half", [(0.03, 0.02, 0.01), (0.03, 0.02, 0.0), (0.02, 0.02, 0.02), (0.0, 0.0, 0.0)])
def test_outlines(half):
    """An outline is as wide as the projected surface of the ellipsoid, in each direction."""
    camera, turn = Camera(40, 25), Rotation.random(rng=3).as_matrix()
    points = np.random.default_rng(1).normal(size=(20000, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    seen = camera.project((points * half) @ turn.T)[:, :2]
    outline = outlines(np.array([half]), turn[None], camera, corners=400)[0]
    directions = np.array([[np.cos(t), np.sin(t)] for t in np.linspace(0, np.pi, 30)])
    widths = (seen @ directions.T).max(axis=0)
    assert np.allclose((outline @ directions.T).max(axis=0), widths, atol=2e-3 * max(half) + 1e-12)


def test_half_axes_hold_as_often_as_they_say():
    """A normal error lies within the ellipsoid 95 % of the time: |z|² of k directions has the law of χ²."""
    assert [surface(k) for k in range(4)] == pytest.approx([0.0, *np.sqrt(chi2.ppf(0.95, [1, 2, 3]))])


def test_half_axes_of_a_scene(scene):
    """A hinge's ellipsoid is a disc, wider than its errors by the factor for two directions."""
    half, flat = half_axes(scene), hinges(scene)
    assert [scene.joints[i] for i in np.flatnonzero(flat)] == ["left_elbow", "left_knee", "right_elbow", "right_knee"]
    assert (half[flat, 2] == 0.0).all()
    assert np.allclose(half[flat, :2], surface(2) * scene.errors[flat, :2])
    assert np.allclose(half[~flat], surface(3) * scene.errors[~flat])


@pytest.mark.parametrize(("scale", "factor"), [(1.0, 5), (0.001, 100), (100.0, 1)])
def test_exaggeration(scene, scale, factor):
    """Ellipsoids are enlarged until the median one is visible, and never reduced."""
    assert exaggeration(replace(scene, errors=scale * scene.errors)) == factor
    long = scene.errors.copy()
    long[0] *= 0.06 / np.nanmax(long[0])  # one joint known to 6 cm, 17 cm with 95 %: no more than twice as large
    assert exaggeration(replace(scene, errors=long)) <= 2
    assert exaggeration(replace(scene, errors=np.full_like(scene.errors, np.nan))) == 1


@pytest.fixture(scope="module")
def frame(scene):
    """The chosen frame and direction."""
    return prepare(scene)


def test_the_pose_is_complete(scene, frame):
    """The chosen frame has the fewest missing markers and joints."""
    bad = (scene.flags != Flag.SEEN).sum(axis=0) + np.isnan(scene.places[:, 0]).sum(axis=0)
    assert bad[frame[0]] == bad.min()


def test_the_view_is_the_widest(scene, frame):
    """Joints appear farther apart from the chosen direction than from others."""
    apart = []
    number, chosen = frame
    for azimuth in (chosen.azimuth, *range(0, 360, 45)):
        camera = Camera(float(azimuth), chosen.elevation)
        seen = camera.project(scene.points[:, :, number])[:, :2]
        i, j = np.triu_indices(len(seen), 1)
        apart.append(np.log(np.linalg.norm(seen[i] - seen[j], axis=1) + 0.02).mean())
    assert apart[0] == max(apart)


def test_words(scene):
    """A label gives a joint's largest standard error, and marks bridged and doubtful joints."""
    words = {joint: label(scene, number, 45) for number, joint in enumerate(scene.joints)}
    assert words["left_hip"] == "left hip 3.0 mm"
    assert words["neck"] == "neck 3.0 mm*"
    assert words[scene.joints[3]].endswith("(bridged)")
    unknown = replace(scene, errors=np.full_like(scene.errors, np.nan))
    assert label(unknown, scene.joints.index("left_hip"), 45) == "left hip"


@pytest.mark.parametrize("number", [-1, 90])
def test_no_such_frame(scene, number):
    """A frame out of range is refused."""
    with pytest.raises(RecordingError, match=f"no frame {number}; there are 0 to 89"):
        prepare(scene, number)


@pytest.mark.parametrize("number", [0, 45, None])
def test_nothing_is_covered(scene, number):
    """No text covers another, and all are within the picture."""
    figure = draw(scene, number)
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
    one, two = (save(draw(scene), tmp_path / name) for name in ("one", "two"))
    for a, b in zip(one, two, strict=True):
        assert a.read_bytes() == b.read_bytes()


def test_little_is_known(scene):
    """With one joint, no markers and no errors there is still a figure."""
    parts = {name: getattr(scene, name)[:1] for name in ("joints", "centers", "flags", "posed")}
    parts |= {"places": np.empty((0, 3, 90)), "ends": np.empty((0, 3, 90)), "errors": np.full((1, 3), np.nan)}
    parts |= dict.fromkeys(("orientations", "anatomy"), np.full((1, 90, 4), np.nan))
    one = replace(scene, markers=(), tips=(), bones=(), doubts=("",), **parts)
    FigureCanvasAgg(draw(one)).draw()


@pytest.fixture(scope="module")
def ffmpeg():
    """The library that brings ffmpeg."""
    return pytest.importorskip("imageio_ffmpeg", reason="imageio-ffmpeg is not installed")


def frames(ffmpeg, path):
    """The output of ffmpeg about a video, and its pictures (frames, 720, 960, 3)."""
    words = [ffmpeg.get_ffmpeg_exe(), "-i", str(path), "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    done = subprocess.run(words, capture_output=True, check=True)
    return done.stderr.decode(), np.frombuffer(done.stdout, dtype=np.uint8).reshape(-1, 720, 960, 3)


def test_a_video(ffmpeg, scene, tmp_path):
    """The video has every third frame, bones in their colours, and motion; the folder has no other file."""
    done = []
    path = write_video(scene.part(slice(0, 36)), tmp_path / "new" / "motion.mp4", advance=done.append)
    said, pictures = frames(ffmpeg, path)
    assert all(words in said for words in ("Video: h264", "960x720", " 30 fps"))
    assert len(pictures) == 12
    assert sum(done) == pytest.approx(1.0)
    assert [p.name for p in path.parent.iterdir()] == ["motion.mp4"]
    red, green, blue = pictures[0].astype(int).transpose(2, 0, 1)
    assert ((blue > red + 80) & (blue > green + 30)).sum() > 200
    assert ((red > blue + 80) & (red > green + 50)).sum() > 200
    assert (abs(pictures[0].astype(int) - pictures[-1].astype(int)) > 100).sum() > 1000
    assert (pictures == 255).mean() > 0.5
    data = path.read_bytes()  # the index comes before the pictures, so that a browser plays it while it loads
    assert 0 < data.index(b"moov") < data.index(b"mdat")


def test_places_that_cannot_be(ffmpeg, scene, tmp_path):
    """Another ending, or a folder that is a file, is refused in a line, and nothing is left behind."""
    with pytest.raises(RecordingError, match=r"motion\.gif: a video is written to a file whose name ends in \.mp4"):
        write_video(scene, tmp_path / "motion.gif")
    (tmp_path / "file").write_text("")
    with pytest.raises(RecordingError, match="cannot be written"):
        write_video(scene.part(slice(0, 3)), tmp_path / "file" / "motion.mp4")
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_ffmpeg_that_stops(ffmpeg, scene, tmp_path, monkeypatch):
    """If ffmpeg ends early, one line says so, and the unfinished video is removed."""

    def stopping(path, *_, **__):
        with open(path, "wb") as file:
            file.write(b"half")
        yield
        raise OSError(32, "Broken pipe")

    monkeypatch.setattr(ffmpeg, "write_frames", stopping)
    with pytest.raises(RecordingError, match=r"motion\.mp4: cannot be written: Broken pipe"):
        write_video(scene.part(slice(0, 3)), tmp_path / "motion.mp4")
    assert list(tmp_path.iterdir()) == []
