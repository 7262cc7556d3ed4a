"""Tests of write."""

import sys
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from types import SimpleNamespace

import numpy as np
import pytest

from study.recordings.formats.read import read_recording
from study.recordings.formats.write import CMU, WRITERS, DownloadError, fetch, write_recording
from study.recordings.recording import Recording, RecordingError
from study.recordings.synthetic.make import Recipe, synthesize


@pytest.fixture
def server(monkeypatch):
    """A library on this machine: its address, its responses, and the requests that it got."""
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")
    monkeypatch.setattr("study.recordings.formats.write._TIMEOUT", 600.0)  # a busy machine may answer late
    answers = SimpleNamespace(asked=[], status=200, body=b"", promised=None)

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):
            answers.asked.append(self.path)
            self.send_response(answers.status)
            if answers.promised is not None:
                self.send_header("Content-Length", str(answers.promised))
            self.end_headers()
            self.wfile.write(answers.body)

        def log_message(self, *_):
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as listening:
        answers.base = f"http://127.0.0.1:{listening.server_address[1]}/subjects"
        thread = threading.Thread(target=listening.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        yield answers
        listening.shutdown()
        thread.join()


@pytest.fixture
def body(tmp_path_factory, small):
    """Bytes of a C3D file."""
    return write_recording(small(frames=200), tmp_path_factory.mktemp("library") / "a.c3d").read_bytes()


def get(server, folder, name="60_08"):
    return fetch("cmu", name, base=server.base, folder=folder)


def test_a_recording_is_fetched_once(server, tmp_path, small, body):
    """A recording is in the folder of its subject; the second time it comes from the cache."""
    server.body = body
    path = get(server, tmp_path / "cache")
    assert path == tmp_path / "cache" / "60_08.c3d"
    np.testing.assert_array_equal(read_recording(path).seen(), small(frames=200).seen())
    assert get(server, tmp_path / "cache") == path
    assert server.asked == ["/subjects/60/60_08.c3d"]
    assert [found.name for found in (tmp_path / "cache").iterdir()] == ["60_08.c3d"]


@pytest.mark.parametrize(
    ("name", "place"),
    [
        ("60_08", "60/60_08.c3d"),
        ("2_1", "02/02_01.c3d"),
        ("02-01", "02/02_01.c3d"),
        ("135_02.c3d", "135/135_02.c3d"),
        ("085_02", "85/85_02.c3d"),
    ],
)
def test_names_of_the_library(server, tmp_path, body, name, place):
    server.body = body
    fetch("cmu", name, base=server.base + "/", folder=tmp_path)
    assert server.asked == [f"/subjects/{place}"]


def test_the_environments_address_and_the_users_cache_folder(server, tmp_path, body, monkeypatch):
    assert CMU == "http://mocap.cs.cmu.edu/subjects"
    server.body = body
    monkeypatch.setenv("STUDY_CMU_URL", server.base)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert fetch("cmu", "01_01") == tmp_path / "sphere-fit-study" / "cmu" / "01_01.c3d"


@pytest.mark.parametrize(
    "name", ["salsa", "60", "60_08_01", "../60_08", "60_08/..", "", "6000_08", "60_08.bvh", "٦٠_٠٨"]
)
def test_a_name_that_no_recording_has(server, tmp_path, name):
    with pytest.raises(RecordingError, match="cannot be a recording of cmu; give a name such as 60_08"):
        get(server, tmp_path, name)
    assert server.asked == []


@pytest.mark.parametrize(
    ("status", "words"),
    [(404, "there is no recording 60_08"), (500, "the server answered 500; try again later"), (403, "answered 403")],
)
def test_the_server_refuses(server, tmp_path, status, words):
    """A missing recording is a mistake in its name; other failures may pass."""
    server.status = status
    refused(server, tmp_path, words, kind=RecordingError if status == 404 else DownloadError)


def test_the_server_sends_something_else(server, tmp_path, body):
    """A download that is cut short, with its length in the header and without; a web page, as of a hotel's network."""
    other = "the server sent something else than a recording: "
    server.body, server.promised = body[:5000], len(body)
    refused(server, tmp_path, "the server cannot be reached, or broke off")
    server.promised = None
    refused(server, tmp_path, rf"{other}the file is cut short: \d+ of 200 frames")
    server.body = b"<html>Please log in</html>"
    refused(server, tmp_path, f"{other}not a C3D file")


def refused(server, folder, words, kind=DownloadError):
    """The message is one line that begins with the address; the cache stays empty."""
    with pytest.raises(RecordingError, match=words) as caught:
        get(server, folder / "cache")
    assert type(caught.value) is kind
    assert str(caught.value).startswith(f"{server.base}/60/60_08.c3d: ")
    assert "\n" not in str(caught.value)
    assert not (folder / "cache").exists() or not list((folder / "cache").iterdir())


def test_a_cache_that_cannot_be_written(server, tmp_path, body):
    server.body = body
    (tmp_path / "file").write_text("")
    with pytest.raises(DownloadError, match="cannot be written to"):
        get(server, tmp_path / "file" / "cache")


@pytest.mark.parametrize(
    ("ending", "tolerance"),
    # single precision of metres up to 4; half of the last decimal of a millimetre
    [("c3d", 3e-7), ("CSV", 0.5000001e-6), ("trc", 0.5000001e-7)],
)
def test_there_and_back(tmp_path, ending, tolerance):
    """Positions, gaps, labels, their order and the rate are the same after writing and reading."""
    recording, _ = synthesize(Recipe(frames=400, rate=59.94, gaps=0.15, seed=4))
    path = write_recording(recording, tmp_path / "new" / f"walk.{ending}")
    found = read_recording(path)
    assert (found.name, found.markers, found.notes) == ("walk", recording.markers, ())
    assert found.rate == pytest.approx(59.94, rel=1e-7)
    np.testing.assert_array_equal(np.isnan(found.positions), np.isnan(recording.positions))
    np.testing.assert_allclose(found.positions, recording.positions, rtol=0, atol=tolerance)
    before = path.read_bytes()
    assert write_recording(recording, path).read_bytes() == before


def test_the_residual_of_a_missing_sample(tmp_path, small):
    """In the bytes it is -1, beside zeros; readers that go by residuals would take anything else for a place."""
    recording = small()
    data = write_recording(recording, tmp_path / "a.c3d").read_bytes()
    start = 512 * (int.from_bytes(data[16:18], "little") - 1)
    samples = np.frombuffer(data, "<f4", 4 * recording.seen().size, start).reshape(recording.frames, -1, 4)
    np.testing.assert_array_equal(samples[:, :, 3].T, np.where(recording.seen(), 0.0, -1.0))
    assert not samples[~recording.seen().T][:, :3].any()


def test_a_table_for_people(tmp_path):
    recording = Recording("walk", ("A",), np.array([[[1.0, np.nan], [2.0, np.nan], [-0.5, np.nan]]]), 100.0)
    text = write_recording(recording, tmp_path / "walk.csv").read_text()
    assert text == "# rate: 100.0\n# unit: mm\nframe,A_X,A_Y,A_Z\n1,1000.000,2000.000,-500.000\n2,,,\n"


def test_where_nothing_can_be_written(tmp_path, small):
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(RecordingError, match="cannot be written: Is a directory"):
        write_recording(small(), tmp_path / "folder.csv")


def test_a_file_that_was_there_stays_if_the_new_one_fails(tmp_path, small, monkeypatch):
    """A missing library, and a writer that breaks off, leave the old file and nothing else."""
    path = write_recording(small(), tmp_path / "walk.c3d")
    before = path.read_bytes()
    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, "ezc3d", None)
        with pytest.raises(RecordingError, match="writing it needs ezc3d"):
            write_recording(small(seed=4), path)

    def breaks_off(recording, path):
        path.write_bytes(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setitem(WRITERS, ".c3d", breaks_off)
    with pytest.raises(RecordingError, match="cannot be written: No space left on device"):
        write_recording(small(seed=4), path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]
