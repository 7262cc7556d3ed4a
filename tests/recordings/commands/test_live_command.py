"""`study live` as a process: standard input, datagrams of this machine, Ctrl-C."""

import json
import os
import re
import signal
import socket
import subprocess
import sys

import numpy as np
import pytest

from study.recordings import live_commands
from tests.recordings.hips import CENTRE, PELVIS, hip_motion

JOINT = ("live", "--parent", "A,B,C,D", "--child", "E,F,G")


def lines(count=250):
    """Frames as lines, in millimetres: a thigh that rotates about a pelvis at rest."""
    positions, _, _ = hip_motion(count, still=True)
    for frame in (1000 * positions).round(3).transpose(2, 0, 1):
        yield json.dumps(dict(zip("ABCDEFG", frame.tolist(), strict=True)))


@pytest.fixture
def start():
    """Start the command; what is left of it at the end is killed."""
    started = []

    def run(*arguments, closed=False):
        pipe = subprocess.PIPE
        command = [sys.executable, "-m", "study.cli", *map(str, arguments)]
        command = ["sh", "-c", 'exec "$@" <&-', "sh", *command] if closed else command
        started.append(subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, text=True))
        return started[-1]

    yield run
    for process in started:
        process.kill()
        process.communicate()


def is_right(line):
    """Assert that a line has the true centre, from the mean of the pelvis."""
    x, y, z, error = map(float, re.search(r"\(([-\d.]+), ([-\d.]+), ([-\d.]+)\) ± ([\d.]+) mm", line).groups())
    assert np.abs([x, y, z] - 1000 * (CENTRE - PELVIS.mean(axis=0))).max() < 3.0
    assert error < 2.0
    return True


@pytest.mark.parametrize(("unit", "told"), [("mm", "so its unit is hardly mm: with --unit m they are 0."), ("m", "")])
def test_a_unit_that_cannot_be_right_is_named(live, unit, told):
    """Positions in metres, taken for millimetres, are a body of half a millimetre: said once, with the unit."""
    metres = [json.dumps({k: [x / 1000 for x in v] for k, v in json.loads(line).items()}) for line in lines(60)]
    complained = live("\n".join(metres), *JOINT[1:], "--unit", unit)[2]
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
    """The port is free and named before the first datagram; an empty one ends the stream, without a standard input."""
    process = start(*JOINT, "--udp", 0, "--every", 1000, closed=True)
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
def live(call):
    """Run the command on a text as standard input; exit code, standard output and standard error come back."""
    return lambda text, *arguments: call("live", *arguments, stdin=text)


def test_answers_as_lines_of_json(live):
    """Each answer is a line with the centre, and with the places of the parent's markers in its axes."""
    code, said, _ = live("\n".join(lines(250)), *JOINT[1:], "--json")
    rows = [json.loads(line, parse_constant=pytest.fail) for line in said.splitlines()]
    assert code == 0
    assert [row["frame"] for row in rows] == [100, 200, 250]
    assert rows[-1]["axes_frame"] == 1
    shape = np.array([rows[-1]["parent_markers"][label] for label in "ABCD"])
    np.testing.assert_allclose(shape, PELVIS - PELVIS.mean(axis=0), atol=0.004)
    np.testing.assert_allclose(rows[-1]["center"], CENTRE - PELVIS.mean(axis=0), atol=0.003)
    _, said, _ = live('{"A": [1, 2, 3]}', *JOINT[1:], "--json")
    (row,) = map(json.loads, said.splitlines())
    assert (row["ok"], row["center"], row["parent_markers"], row["axes_frame"]) == (False, None, None, None)


def test_a_stream_without_lines_is_refused(start):
    """As soon as it has more than a frame can have, not when it has filled the memory."""
    live = start(*JOINT)
    said, complained = live.communicate("0" * (1 << 21))
    assert (live.returncode, said) == (2, "")
    assert complained == "standard input: a line of 1,048,576 bytes or more: give each frame a line of its own\n"


def test_a_joint_that_is_not_known(live):
    """A stream that ends too early has code 3."""
    code, said, complained = live('{"LASI": [1, 2, 3]}\n', "--markerset", "cast")
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
def test_labels_that_never_come(live, parent, child, code, words):
    """They are told once, after the frames of the first answer, with the nearest label; the rest goes on."""
    found, said, complained = live("\n".join(lines()), "--parent", parent, "--child", child)
    assert (found, complained) == (code, f"no marker of this name in 100 frames: {words}\n")
    assert len(said.splitlines()) == 3


@pytest.mark.skipif(os.name == "nt", reason="Windows has no SIGINT to send to a process")
def test_ctrl_c_after_the_last_frame(live, monkeypatch):
    """Where Ctrl-C ends the sender of the frames first, its own interrupt does not take the last answer."""

    def interrupted(joints, as_json):
        os.kill(os.getpid(), signal.SIGINT)
        printed(joints, as_json)

    printed, before = live_commands._print, signal.getsignal(signal.SIGINT)
    monkeypatch.setattr(live_commands, "_print", interrupted)
    code, said, complained = live('{"LASI": [1, 2, 3]}\n', "--markerset", "cast")
    assert code == 3
    assert "Traceback" not in complained
    assert "frame 1: left_hip" in said
    assert signal.getsignal(signal.SIGINT) is before


def test_a_first_frame_of_zeros_and_a_spike(live):
    """Both are said once, on standard error, and the joint is found."""
    given = list(lines())
    given[0] = json.dumps({marker: [0, 0, 0] for marker in "ABCDEFG"})
    given[60] = json.dumps(json.loads(given[60]) | {"E": [9e3, 0, 0], "F": [0, 0, 0.0]})
    code, said, complained = live("\n".join(given), *JOINT[1:])
    assert code == 0
    assert complained.splitlines() == [
        "frame 1: A, B, C, D, E, F, G at exactly (0, 0, 0): taken for missing, there and later",
        "1 time a marker jumped; what it made wrong is left out",
    ]
    assert is_right(said.splitlines()[-1])


def test_segments_of_two_markers_hold_no_joint(live):
    """Their joints are left out of a stream, with a word."""
    _, said, complained = live("{}\n", "--markerset", "plug-in-gait")
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
def test_mistakes(refused, arguments, words):
    """A word, and code 2."""
    refused("live", *arguments, says=words)
