import sys

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from study.mocap.io.reading import read_recording
from study.mocap.io.recording import RecordingError

MARKERS = ("LFHD", "RFHD", "C7", "LFIN", "RTOE")
FACTOR = {"mm": 1000.0, "cm": 100.0, "m": 1.0}


def as_c3d(path, labels, points, unit, write_c3d):
    return write_c3d(path / "walk.c3d", labels, points, unit=unit)


def as_trc(path, labels, points, unit, write_c3d):
    count = points.shape[2]
    lines = ["PathFileType\t4\t(X/Y/Z)\twalk.trc", "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits"]
    lines += [f"100\t100\t{count}\t{len(labels)}\t{unit}", "Frame#\tTime\t" + "\t\t\t".join(labels) + "\t\t", "\t\tX1"]
    for i in range(count):
        cells = ["" if np.isnan(x) else repr(float(x)) for x in points[:, :, i].ravel()]
        lines.append("\t".join([str(i + 1), f"{i / 100}", *cells]))
    (path / "walk.trc").write_text("\n".join(lines))
    return path / "walk.trc"


def as_csv(path, labels, points, unit, write_c3d):
    lines = ["# rate: 100", f"# unit: {unit}", ",".join(f"{label}_{axis}" for label in labels for axis in "XYZ")]
    for i in range(points.shape[2]):
        lines.append(",".join("" if np.isnan(x) else repr(float(x)) for x in points[:, :, i].ravel()))
    (path / "walk.csv").write_text("\n".join(lines) + "\n")
    return path / "walk.csv"


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    order=st.permutations(range(len(MARKERS))),
    prefix=st.sampled_from(["", "male:", "Subject 1:", "60-08:", "a:b:"]),
    unit=st.sampled_from(sorted(FACTOR)),
    form=st.sampled_from([as_c3d, as_trc, as_csv]),
)
def test_order_prefix_unit_and_format_do_not_matter(tmp_path, write_c3d, order, prefix, unit, form):
    """The same motion in two formats is the same recording."""
    rng = np.random.default_rng(11)
    positions = np.round(rng.normal(size=(len(MARKERS), 3, 6)), 4)
    positions[2, :, 1:3] = np.nan
    labels = [prefix + MARKERS[i] for i in order]
    path = form(tmp_path, labels, positions[list(order)] * FACTOR[unit], unit, write_c3d)
    found = read_recording(path)
    assert found.markers == tuple(MARKERS[i] for i in order)
    assert (found.name, found.rate, found.notes) == ("walk", 100.0, ())
    # C3D files hold single precision
    np.testing.assert_allclose(found.select(MARKERS).positions, positions, rtol=2e-7 if form is as_c3d else 1e-13)


def test_a_name_that_no_recording_has(tmp_path):
    with pytest.raises(RecordingError, match=r"walk.bvh: a recording is a file whose name ends in .c3d, .csv, .trc"):
        read_recording(tmp_path / "walk.bvh")


@pytest.mark.parametrize("name", ["walk.c3d", "walk.csv", "walk.trc"])
def test_a_file_that_is_not_there(tmp_path, name):
    with pytest.raises(RecordingError, match=f"{name}: cannot be read: No such file"):
        read_recording(tmp_path / name)
    (tmp_path / name).mkdir()
    with pytest.raises(RecordingError, match=f"{name}: cannot be read: Is a directory"):
        read_recording(tmp_path / name)


def test_options_reach_every_format(tmp_path, write_c3d):
    """Unit, rate and subject of the caller override the file."""
    points = np.ones((3, 3, 4))
    labels = ["a:A", "a:B", "b:A"]
    for form in (as_c3d, as_trc, as_csv):
        path = form(tmp_path, labels, points, "mm", write_c3d)
        with pytest.raises(RecordingError, match=r"2 subjects: a \(2 markers\), b"):
            read_recording(path)
        found = read_recording(path, subject="a", unit="m", rate=60.0)
        assert (found.markers, found.rate, found.of("A")[0, 0]) == (("A", "B"), 60.0, 1.0)


def test_the_extra_that_is_not_installed(tmp_path, monkeypatch):
    """The message has the command that installs the missing library."""
    monkeypatch.delitem(sys.modules, "study.mocap.io.c3d_file", raising=False)
    monkeypatch.setitem(sys.modules, "ezc3d", None)
    (tmp_path / "walk.c3d").write_bytes(b"\x02\x50")
    with pytest.raises(RecordingError, match=r"reading it needs ezc3d: pip install '.\[mocap\]'"):
        read_recording(tmp_path / "walk.c3d")
