"""The command `study joint`, as a user calls it."""

import json
import sys

import pytest

from study import cli
from study.mocap.io.writing import write_recording
from study.mocap.synthetic.recipe import Recipe
from study.mocap.synthetic.synthesize import synthesize

NECK = ("--parent", "C7,CLAV,STRN,T10", "--child", "LFHD,RFHD,LBHD,RBHD")


@pytest.fixture
def call(monkeypatch, capsys, tmp_path):
    """Run the command in a folder of its own; exit code, standard output and standard error come back."""

    def run(*arguments):
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(sys, "argv", ["study", "joint", *map(str, arguments)])
        with pytest.raises(SystemExit) as end:
            cli.main()
        return end.value.code, *capsys.readouterr()

    return run


@pytest.fixture(scope="module")
def body(tmp_path_factory):
    """A recording of a synthetic body as a file."""
    recording, _ = synthesize(Recipe(frames=500, noise=0.001))
    return write_recording(recording, tmp_path_factory.mktemp("body") / "body.c3d")


def test_one_line_and_no_files(call, body, tmp_path):
    code, said, complained = call(body, *NECK)
    assert (code, complained) == (0, "")
    (line,) = said.splitlines()
    assert line.startswith("body: ok; centre (")
    assert list(tmp_path.iterdir()) == []


def test_json(call, body):
    code, said, complained = call(body, *NECK, "--json")
    assert (code, complained) == (0, "")
    values = json.loads(said)
    assert (values["recording"], values["ok"], values["kind"], values["frames"] > 400) == ("body", True, "ball", True)


def test_a_joint_that_is_not_ok(call, body):
    """The exit code is 3, and the reason stands in the line: within the pelvis nothing moves."""
    code, said, complained = call(body, "--parent", "LFWT,RFWT,LBWT", "--child", "RBWT")
    assert (code, complained) == (3, "")
    assert "doubts: " in said
    code, said, _ = call(body, "--parent", "LFWT,RFWT,LBWT", "--child", "RBWT", "--json")
    assert (code, json.loads(said)["ok"]) == (3, False)


def test_a_wrong_label(call, body):
    code, said, complained = call(body, "--parent", "C77,CLAV,STRN", "--child", "LFHD")
    assert (code, said, len(complained.splitlines())) == (2, "", 1)
    assert "did you mean 'C7'" in complained
