"""Progress of a run: units and times in words, a line a minute, a bar in a terminal. The clock is the test's."""

import contextlib
import os
import re
import subprocess

import pytest

from study.simulation.library import Headway


@pytest.fixture
def clock():
    """A clock that stands at ``clock.now``."""

    def read():
        return read.now

    read.now = 100.0
    return read


@pytest.mark.parametrize(
    ("share", "units", "passed", "words"),
    [
        (0.25, (3, 12), 10.0, "3/12 units, 0:10 passed, about 0:30 left"),  # a quarter in 10 s, the rest in 30 s
        (0.1, (1_200, 40_000), 7200.0, "1,200/40,000 units, 2:00:00 passed, about 18:00:00 left"),
        (0.5, (), 61.0, "50%, 1:01 passed, about 1:01 left"),
        (1.0, (12, 12), 59.7, "12/12 units, 1:00 passed, about 0:00 left"),
        (0.0, (0, 12), 5.0, "0/12 units, 0:05 passed"),
    ],
)
def test_the_times_are_named(clock, share, units, passed, words):
    """What is left takes as long as the work before did, by its weight and not by its number of units."""
    headway = Headway(clock=clock)
    clock.now += passed
    headway.add(share, *units)
    assert headway.words() == words


def test_time_goes_on_between_units(clock):
    """The time passes, and what is left becomes less and never negative; the next unit tells better."""
    headway = Headway(clock=clock)
    assert headway.words() == "begun, 0:00 passed"
    clock.now += 20.0
    assert headway.words() == "begun, 0:20 passed"
    headway.add(0.5, 1, 4)
    clock.now += 15.0
    assert headway.words() == "1/4 units, 0:35 passed, about 0:05 left"
    clock.now += 15.0
    assert headway.words() == "1/4 units, 0:50 passed, about 0:00 left"
    headway.add(0.125, 2, 4)
    assert headway.words() == "2/4 units, 0:50 passed, about 0:30 left"


def test_a_line_a_minute(clock):
    """Without a terminal a line is said when a minute has passed since the last one, and none in a short run."""
    lines = []
    headway = Headway(lines.append, clock)
    for unit in range(1, 21):  # seven seconds each
        clock.now += 7.0
        headway.add(0.05, unit, 20)
    assert lines == ["9/20 units, 1:03 passed, about 1:17 left", "18/20 units, 2:06 passed, about 0:14 left"]


def test_a_unit_of_many_minutes(clock):
    """The line comes when the unit has ended, and only one."""
    lines = []
    headway = Headway(lines.append, clock)
    clock.now += 600.0
    headway.add(0.5, 1, 2)
    clock.now += 59.0
    headway.add(0.25, 2, 3)
    assert len(lines) == 1


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such terminals")
def test_a_bar_in_a_terminal(command, config, tmp_path):
    """The bar ends with all units and both times; standard output has the folder alone."""
    (tmp_path / "tiny.toml").write_text(config)
    reader, writer = os.openpty()
    words, environment = command
    line = [*words, "run", "tiny.toml", "--out", "out"]
    environment = environment | {"TERM": "xterm", "COLUMNS": "120"}
    process = subprocess.Popen(line, cwd=tmp_path, env=environment, stdout=subprocess.PIPE, stderr=writer)
    os.close(writer)
    shown = b""
    with contextlib.suppress(OSError):  # Linux has this end where the other is closed
        while piece := os.read(reader, 1 << 16):
            shown += piece
    os.close(reader)
    assert (process.communicate(timeout=300)[0], process.returncode) == (b"out\n", 0)
    assert re.search(rb"2/2 units, \S+ passed, about 0:00 left", shown)
