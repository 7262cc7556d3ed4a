"""Runs that are killed again and again, with damaged parts and full disks, end with the tables of an unbroken run."""

import json
import os
import random
import signal
import subprocess
import sys
from pathlib import Path

import pytest

import study
from study.simulation.experiment.config import parse
from study.simulation.runs.parts import DAMAGED, Layout, Parts
from study.simulation.runs.run_folder import Run
from tests.configs import config

TOP = {"name": "fragile", "seed": 5, "estimators": ["mle", "lls", "ugdk"], "keep_points": 40}
CONFIG = config(TOP, trials=960, samples=[300, 1000], noise=[0.05, 0.5], angle=[60, 180])
OF_THE_PARENT = 18
FULL = 3


@pytest.fixture(scope="module")
def serve():
    """Make a run with faults; see `crashing.py`."""
    paths = [str(Path(study.__file__).parents[1]), os.environ.get("PYTHONPATH", "")]
    command = [sys.executable, str(Path(__file__).with_name("crashing.py"))]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths))}
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "encoding": "utf-8"}
    process = subprocess.Popen(command, env=environment, **pipes)

    def ask(folder, **request):
        process.stdin.write(json.dumps({"config": CONFIG, "folder": str(folder)} | request) + "\n")
        process.stdin.flush()
        return json.loads(process.stdout.readline())

    yield ask
    process.stdin.close()
    assert process.wait(timeout=60) == 0
    process.stdout.close()


def committed(folder):
    """Keys of the rows in undamaged files of a run that is not finished."""
    parts, study = Parts(folder, "units"), parse(CONFIG)
    parts.load(set_aside=False)
    keys = {Layout(study).task(unit).key for unit in study.units()}
    return {key for key in keys if parts.outputs(key)}


def damage(folder, chance):
    """Truncate some parts and flip a bit in others; return the keys that are lost, and the names of the files."""
    before = committed(folder)
    paths = chance.sample(sorted((folder / "parts").glob("*.part")), 5)
    for place, path in enumerate(paths):
        data = bytearray(path.read_bytes())
        if place % 2:
            data = data[: chance.randrange(len(data))]
        else:
            data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
        path.write_bytes(data)
    return before - committed(folder), {path.name for path in paths}


def test_many_kills_damage_and_a_full_disk(serve, small_disk, tables, tmp_path, monkeypatch):
    """The bytes are those of an unbroken run after 18 kills of it, damage to 5 parts and a full disk.

    What was committed before a kill is never computed again, unless its part was damaged.
    """
    monkeypatch.setattr("study.simulation.experiment.designs._SAMPLES_PER_UNIT", 500)  # as the other process does
    took = serve(tmp_path / "whole")
    folder, fill, empty = small_disk
    chance = random.Random(20)
    safe = set()

    def attempt(**request):
        answer = serve(folder, **request)
        assert not safe & set(answer["computed"])
        if answer["code"] != 0:
            assert safe <= committed(folder)
            safe.update(committed(folder))
        return answer

    assert attempt(backend="loky", kill_at=200)["signal"] == signal.SIGKILL
    assert len(safe) > 14  # some 25 parts
    for number in range(1, OF_THE_PARENT):
        answer = attempt(kill_at=chance.randrange(1, took["steps"] // 22))
        assert answer["signal"] == signal.SIGKILL, number
        if number == OF_THE_PARENT // 4:
            request = {} if fill() else {"full_at": 12}
            assert attempt(**request)["code"] == FULL
            empty()
        if number == OF_THE_PARENT // 2:
            gone, harmed = damage(folder, chance)
            assert len(gone) == 5
            safe -= gone
    assert {path.name for path in (folder / "parts" / DAMAGED).iterdir()} == harmed
    assert attempt()["code"] == 0
    run = Run.open(folder)
    assert tables(run) == tables(Run.open(tmp_path / "whole"))
    assert not run.has("failures")
