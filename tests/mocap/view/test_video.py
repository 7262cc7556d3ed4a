"""The video: its frames, its speed, and refusals in one line."""

import subprocess
import sys

import numpy as np
import pytest

from study.mocap.io.recording import RecordingError
from study.mocap.view.video import write_video


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


def test_it_starts_at_once(ffmpeg, scene, tmp_path):
    """The index comes before the pictures, so that a browser plays it while it loads."""
    data = write_video(scene.part(slice(0, 6)), tmp_path / "motion.mp4").read_bytes()
    assert 0 < data.index(b"moov") < data.index(b"mdat")


def test_without_the_library(scene, tmp_path, monkeypatch):
    """Without imageio-ffmpeg one line says how to get it, and nothing is written."""
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(RecordingError, match=r"a video needs imageio-ffmpeg: pip install '\.\[mocap\]'"):
        write_video(scene, tmp_path / "new" / "motion.mp4")
    assert list(tmp_path.iterdir()) == []


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
