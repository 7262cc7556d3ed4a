"""`study live` as a process: standard input, datagrams of this machine, Ctrl-C.

`--json` of the commands on recordings: one object, with the numbers of the tables and the written files.
"""

import io
import json
import os
import re
import signal
import socket
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from study import cli
from study.recordings.commands import joints as live
from study.recordings.formats import write
from study.recordings.formats.write import write_recording
from study.recordings.markersets import load_markerset, shipped
from study.recordings.synthetic.make import Recipe, synthesize

PELVIS = {"A": (120, 100, 0), "B": (-120, 100, 0), "C": (50, -100, 20), "D": (-50, -100, 20)}

THIGH = {"E": (60, 50, -150), "F": (-40, 70, -200), "G": (20, -60, -280)}

JOINT = ("live", "--parent", "A,B,C,D", "--child", "E,F,G")


def lines(count=250, seed=2):
    """Frames as lines, in millimetres: a thigh that rotates about (10, 20, -80) of a pelvis at rest."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        turn = Rotation.from_rotvec(rng.uniform(-0.5, 0.5, 3))
        local = PELVIS | {label: np.add((10, 20, -80), turn.apply(place)) for label, place in THIGH.items()}
        yield json.dumps({k: (np.array(v) + rng.standard_normal(3)).round(3).tolist() for k, v in local.items()})


@pytest.fixture
def start():
    """Start the command; what is left of it at the end is killed."""
    started = []

    def run(*arguments):
        pipe = subprocess.PIPE
        command = [sys.executable, "-m", "study.cli", *map(str, arguments)]
        started.append(subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, text=True))
        return started[-1]

    yield run
    for process in started:
        process.kill()
        process.communicate()


def is_right(line):
    """Assert that a line has the true centre: less the mean of the pelvis, (0, 0, 10)."""
    x, y, z, error = map(float, re.search(r"\(([-\d.]+), ([-\d.]+), ([-\d.]+)\) ± ([\d.]+) mm", line).groups())
    assert np.abs([x - 10, y - 20, z + 90]).max() < 3.0
    assert error < 2.0
    return True


def test_a_unit_that_cannot_be_right_is_named(monkeypatch, capsys):
    """Positions in metres, taken for millimetres, are a body of half a millimetre: said once, with the unit."""
    metres = [json.dumps({k: [x / 1000 for x in v] for k, v in json.loads(line).items()}) for line in lines(60)]
    for unit, told in (("mm", "so its unit is hardly mm: with --unit m they are 0."), ("m", "")):
        monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO("\n".join(metres).encode())))
        monkeypatch.setattr(sys, "argv", ["study", *JOINT, "--unit", unit])
        with pytest.raises(SystemExit):
            cli.main()
        complained = capsys.readouterr().err
        assert told in complained
        assert complained.count("its unit is hardly") == bool(told)


@pytest.mark.skipif(os.name == "nt", reason="Windows has no SIGINT to send to another process")
def test_standard_input_until_ctrl_c(start):
    """Answers come every hundred frames and at the end; lines that are no frames are told and skipped."""
    process, given = start(*JOINT), list(lines())
    given[7:7] = ["nonsense", ""]
    process.stdin.write("\n".join([*given, '{"A": [1, 2]}']) + "\n")
    process.stdin.flush()
    complained = [process.stderr.readline(), process.stderr.readline()]  # by then all frames have been added
    assert complained == [
        "line 8 is skipped: no JSON\n",
        "line 253 is skipped: the position of 'A' is not three finite numbers\n",
    ]
    process.send_signal(signal.SIGINT)
    said, complained = process.communicate(timeout=600)
    assert (process.returncode, complained) == (0, "")
    assert [line.split(":")[0] for line in said.splitlines()] == ["frame 100", "frame 200", "frame 250"]
    assert is_right(said.splitlines()[-1])
    assert said.endswith("; ok\n")


def test_datagrams(start):
    """The port is free and named before the first datagram; an empty one ends the stream."""
    process = start(*JOINT, "--udp", 0, "--every", 1000)
    port = int(process.stderr.readline().removeprefix("listening on 127.0.0.1:"))
    given = list(lines())
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for first in range(0, len(given), 50):  # few and large ones, which no buffer drops
            sender.sendto("\n".join(given[first : first + 50]).encode(), ("127.0.0.1", port))
        sender.sendto(b"", ("127.0.0.1", port))
    said, complained = process.communicate(timeout=600)
    assert (process.returncode, complained) == (0, "")
    (line,) = said.splitlines()
    assert line.startswith("frame 250: ")
    assert is_right(line)


@pytest.fixture
def call(monkeypatch, capsys):
    """Run the command on a text as standard input; exit code, standard output and standard error come back."""

    def run(text, *arguments):
        monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(text.encode())))
        monkeypatch.setattr(sys, "argv", ["study", "live", *map(str, arguments)])
        with pytest.raises(SystemExit) as end:
            cli.main()
        return end.value.code, *capsys.readouterr()

    return run


def test_a_joint_that_is_not_known(call):
    """A stream that ends too early has code 3."""
    code, said, complained = call('{"LASI": [1, 2, 3]}\n', "--markerset", "cast")
    assert code == 3
    assert complained.startswith("no marker of this name in 1 frame: 'RASI', ")
    assert complained.endswith("; did you mean 'LASI'? Known are LASI\n")
    assert "frame 1: left_hip: no frame has all markers of its parent" in said


@pytest.mark.parametrize(
    ("parent", "child", "code", "words"),
    [
        ("A1,B,C,D", "E,F,G", 3, "'A1'; did you mean 'A'? Known are A, B, C, D, E, F, G"),
        ("A,B,C,D", "E,F,Q9", 0, "'Q9'; known are A, B, C, D, E, F, G"),
    ],
)
def test_labels_that_never_come(call, parent, child, code, words):
    """They are told once, after the frames of the first answer, with the nearest label; the rest goes on."""
    found, said, complained = call("\n".join(lines()), "--parent", parent, "--child", child)
    assert (found, complained) == (code, f"no marker of this name in 100 frames: {words}\n")
    assert len(said.splitlines()) == 3


@pytest.mark.skipif(os.name == "nt", reason="Windows has no SIGINT to send to a process")
def test_ctrl_c_after_the_last_frame(call, monkeypatch):
    """Where Ctrl-C ends the sender of the frames first, its own interrupt does not take the last answer."""

    def interrupted(joints):
        os.kill(os.getpid(), signal.SIGINT)
        printed(joints)

    printed, before = live._print, signal.getsignal(signal.SIGINT)
    monkeypatch.setattr(live, "_print", interrupted)
    code, said, complained = call('{"LASI": [1, 2, 3]}\n', "--markerset", "cast")
    assert code == 3
    assert "Traceback" not in complained
    assert "frame 1: left_hip" in said
    assert signal.getsignal(signal.SIGINT) is before


def test_a_first_frame_of_zeros_and_a_spike(call):
    """Both are said once, on standard error, and the joint is found."""
    given = list(lines())
    given[0] = json.dumps({marker: [0, 0, 0] for marker in PELVIS | THIGH})
    given[60] = json.dumps(json.loads(given[60]) | {"E": [9e3, 0, 0], "F": [0, 0, 0.0]})
    code, said, complained = call("\n".join(given), *JOINT[1:])
    assert code == 0
    assert complained.splitlines() == [
        "frame 1: A, B, C, D, E, F, G at exactly (0, 0, 0): taken for missing, there and later",
        "1 time a marker jumped; what it made wrong is left out",
    ]
    assert is_right(said.splitlines()[-1])


def test_segments_of_two_markers_hold_no_joint(call):
    """Their joints are left out of a stream, with a word."""
    _, said, complained = call("{}\n", "--markerset", "plug-in-gait")
    assert "left_knee is left out: its parent has 2 markers; its pose needs 3" in complained
    assert "left_knee" not in said
    assert "left_hip" in said


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "give --parent and --child for one joint, or --markerset"),
        (("--parent", "A,B", "--child", "C"), "--parent needs three markers"),
        (("--parent", "A,B,C", "--child", "C"), "C is named twice; name each marker once"),
        (("--parent", "A,B,C,A", "--child", "D"), "A is named twice; name each marker once"),
        (("--parent", "A,B,C"), "and --child one or more"),
        (("--markerset", "cast", "--unit", "furlong"), "--unit furlong: give one of"),
        (("--markerset", "cast", "--udp", "70000"), "--udp 70000: cannot be used: a port is a number from 0 to 65535"),
    ],
)
def test_mistakes(call, arguments, words):
    """A word, and code 2."""
    code, said, complained = call("", *arguments)
    assert (code, said) == (2, "")
    assert words in " ".join(complained.replace("│", " ").split())


@pytest.fixture
def read(monkeypatch, capsys, tmp_path):
    """Run a command with --json in a folder of its own; the object that it prints comes back."""

    def run(*arguments):
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(sys, "argv", ["study", *map(str, arguments), "--json"])
        with pytest.raises(SystemExit) as end:
            cli.main()
        said, complained = capsys.readouterr()
        assert (end.value.code, complained) == (0, "")
        return json.loads(said, parse_constant=lambda word: pytest.fail(f"{word} is not JSON"))

    return run


@pytest.fixture(scope="module")
def body(tmp_path_factory):
    """A recording of a synthetic body as a file."""
    recording, _ = synthesize(Recipe(frames=400, gaps=0.05))
    return write_recording(recording, tmp_path_factory.mktemp("body") / "body.c3d")


def test_recording(read, body, small, tmp_path):
    found = read("recording", body)
    assert (found["recording"], found["frames"], found["rate"], len(found["markers"])) == ("body", 400, 120.0, 41)
    assert found["missing"] == pytest.approx(sum(row["missing"] for row in found["markers"]) / 400 / 41)
    assert (found["markerset"]["name"], len(found["markerset"]["joints"])) == ("cmu41", 14)
    other = read("recording", write_recording(small(("a", "b", "c")), tmp_path / "other.csv"))
    assert other["markerset"] is None


def test_joints(read, body, tmp_path):
    found = read("joints", body)
    table = pd.read_parquet(tmp_path / found["files"][0])
    assert [row["joint"] for row in found["joints"]] == list(table["joint"])
    wanted = table["error"].astype(object).where(table["error"].notna(), None)
    assert [row["error"] for row in found["joints"]] == pytest.approx(list(wanted))
    assert [name.rpartition("/")[2] for name in found["files"]] == ["joints.parquet", "calibration.json"]
    assert found["markerset"]["name"] == "cmu41"


def test_case_study(read, tmp_path):
    whole, _ = synthesize(Recipe(frames=300))
    hips = whole.select([marker for marker in whole.markers if marker[1:] in ("FWT", "BWT", "THI", "KNE")])
    found = read("case-study", write_recording(hips, tmp_path / "hips.c3d"), "--subsets", 4)
    joints = pd.read_parquet(tmp_path / "results/recordings/hips/case-study-joints.parquet")
    assert [row["joint"] for row in found["joints"]] == list(joints["joint"])
    np.testing.assert_allclose([row["worth"] for row in found["joints"]], joints["worth"])
    assert all((tmp_path / name).is_file() for name in found["files"])
    assert (found["recording"], found["subsets"]) == ("hips", 4)


def test_markersets(read):
    assert [each["name"] for each in read("markersets")["markersets"]] == shipped()
    (one,) = read("markersets", "cmu41")["markersets"]
    assert type(load_markerset("cmu41")).model_validate(one) == load_markerset("cmu41")


def test_synthetic(read, tmp_path):
    found = read("synthetic", "--frames", 30)
    assert (found["recording"], found["frames"], found["rate"]) == ("synthetic-1", 30, 120.0)
    assert all((tmp_path / name).is_file() for name in found["files"])


def test_fetch(read, monkeypatch, tmp_path):
    monkeypatch.setattr(write, "fetch", lambda library, name: tmp_path / f"{name}.c3d")
    found = read("fetch", "cmu", "60_08")
    assert found == {
        "library": "cmu",
        "name": "60_08",
        "file": str(tmp_path / "60_08.c3d"),
        "terms": write.LIBRARIES["cmu"].terms,
    }


def test_every_command_on_recordings_has_it():
    """A new command has it, too."""
    import inspect

    from study.recordings.commands import joints, skeleton

    names = ["case_study", "fetch", "joint", "joints", "markersets", "recording", "skeleton", "synthetic"]
    for name in names:
        parameters = inspect.signature(getattr(joints, name, None) or getattr(skeleton, name)).parameters
        assert "as_json" in parameters, name
