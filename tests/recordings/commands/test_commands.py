"""The commands on recordings, as a user calls them: options, output, files and refusals."""

import inspect
import json
import os
import shutil
import sys
from pathlib import Path
from typing import get_args

import numpy as np
import pandas as pd
import pytest

from study import cli
from study.recordings.commands import results_folder
from study.recordings.commands.skeleton import synthetic
from study.recordings.formats.read import read_recording
from study.recordings.formats.write import write_recording
from study.recordings.markersets import load_markerset, shipped
from study.recordings.recording import Recording, RecordingError
from study.recordings.synthetic.make import SKIN, Recipe, synthesize

FILES = ["angles.parquet", "bones.parquet", "calibration.json", "fig1_skeleton.png", "fig1_skeleton.svg", "motion.json"]

FILES += ["skeleton.bvh", "skeleton.parquet", "viewer.html"]


@pytest.fixture
def call(monkeypatch, capsys, tmp_path):
    """Run a command in a folder of its own; exit code, standard output and standard error come back."""

    def run(*arguments):
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(sys, "argv", ["study", *map(str, arguments)])
        with pytest.raises(SystemExit) as end:
            cli.main()
        return end.value.code, *capsys.readouterr()

    return run


@pytest.fixture(scope="module")
def body(tmp_path_factory):
    """A recording of a synthetic body as a file, and the truth about it."""
    recording, truth = synthesize(Recipe(frames=500, gaps=0.05))
    return write_recording(recording, tmp_path_factory.mktemp("body") / "body.c3d"), truth


@pytest.fixture(scope="module")
def drawn(body, tmp_path_factory):
    """A folder with the body's skeleton."""
    folder = tmp_path_factory.mktemp("drawn")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["study", "skeleton", str(body[0]), "--out", str(folder / "out")])
        with pytest.raises(SystemExit) as end:
            cli.main()
    assert end.value.code == 0
    return folder / "out"


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no file names but of text")
def test_a_file_name_that_is_no_text(call, body, tmp_path):
    """An old name, whose é is one byte, is read as it was meant; every file is written."""
    shutil.copy(body[0], tmp_path / os.fsdecode(b"h\xe9.c3d"))
    code, _, complained = call("skeleton", os.fsdecode(b"h\xe9.c3d"), "--out", "out", "--write", "trc,mot")
    assert (code, complained) == (0, "")
    assert sorted(each.name for each in (tmp_path / "out").iterdir()) == sorted([*FILES, "hé.trc", "hé.mot"])
    assert (tmp_path / "out" / "hé.trc").read_text(encoding="utf-8").splitlines()[0].endswith("\thé.trc")
    assert json.loads((tmp_path / "out" / "motion.json").read_text(encoding="utf-8"))["name"] == "hé"


def refused(result, *words, code=2):
    """Assert a refusal in one line."""
    found, said, complained = result
    assert (found, said) == (code, ""), complained
    assert len(complained.splitlines()) == 1, complained
    assert all(word in complained for word in words), complained


def test_synthetic(call, tmp_path):
    """A recording is written with the truth beside it; the same seed gives the same bytes."""
    code, said, complained = call("synthetic", "--frames", 30, "--seed", 4)
    assert (code, complained) == (0, "")
    paths = [tmp_path / line for line in said.splitlines()]
    assert [path.name for path in paths] == [
        f"synthetic-4{end}" for end in (".c3d", ".joints.parquet", ".truth.parquet")
    ]
    assert paths[0].parent == tmp_path / "results" / "recordings" / "synthetic-4"
    before = paths[0].read_bytes()
    assert call("synthetic", "--frames", 30, "--seed", 4, "--out", "again.c3d")[0] == 0
    assert (tmp_path / "again.c3d").read_bytes() == before


def test_recording(call, body):
    """The contents of a recording are printed, with the marker set that fits."""
    code, said, complained = call("recording", body[0])
    assert (code, complained) == (0, "")
    assert said.startswith("body: 41 markers, 500 frames at 120 Hz, 4.16 s, 5.0% of the samples missing\n")
    assert all(f"\n{marker}" in said for marker in ("LFHD", "RTOE"))
    assert "marker set cmu41: 41 of the recording's 41 markers belong to it, 14 of 14 joints can be found" in said


def test_a_recording_of_something_else(call, tmp_path, small):
    """A recording that no marker set fits can be described, but has no joints."""
    path = write_recording(small(("a", "b", "c")), tmp_path / "other.csv")
    code, said, complained = call("recording", path)
    assert (code, complained) == (0, "")
    assert "no marker set fits: with none of cast, cgm2, cmu41, " in said
    refused(call("joints", path), "other: no marker set fits", "study markersets cmu41 > mine.toml")


def test_markersets(call, tmp_path):
    """The shipped sets are listed; one that is printed into a file is the shipped one, and serves as a user's own."""
    code, said, complained = call("markersets")
    assert (code, complained) == (0, "")
    assert [line.split()[0] for line in said.splitlines()] == shipped()
    assert "cmu41                  41 markers  14 joints  41 markers of the CMU" in said
    code, said, complained = call("markersets", "cmu41")
    assert (code, complained) == (0, "")
    (tmp_path / "mine.toml").write_text(said, encoding="utf-8")
    assert load_markerset(tmp_path / "mine.toml") == load_markerset("cmu41")
    refused(
        call("markersets", "cmu42"),
        f"no marker set 'cmu42': did you mean 'cmu41'? Known are {', '.join(shipped())}; `study",
    )


def test_joints(call, body, tmp_path):
    """A line and a row per joint; a hinge's axis within 2° of the truth."""
    path, truth = body
    code, said, complained = call("joints", path)
    assert (code, complained) == (0, "")
    lines = said.splitlines()
    table = pd.read_parquet(tmp_path / lines[-2])
    assert set(table["joint"]) == set(truth.joints)
    for joint in truth.joints:
        assert any(line.startswith(f"{joint} ") for line in lines)
    assert (table.loc[table["joint"] == "left_knee", "kind"] == "hinge").all()
    assert {"from_gdke", "from_ugdk", "from_mle", "from_two_sided"} <= set(table.columns)
    assert lines[-1] == "results/recordings/body/calibration.json"
    assert (tmp_path / lines[-1]).is_file()


def test_trials_of_one_session(call, body, tmp_path):
    """Two recordings of one body give one calibration; one of another body is refused, or merged by force."""
    same = write_recording(synthesize(Recipe(frames=300, seed=2))[0], tmp_path / "same.c3d")
    code, said, complained = call("joints", body[0], same)
    assert (code, complained) == (0, "")
    assert said.splitlines()[-2:] == [
        f"results/recordings/body-same/{name}" for name in ("joints.parquet", "calibration.json")
    ]
    assert any(
        line.startswith("waist ") and line.endswith(("  body, same", "  same, body")) for line in said.splitlines()
    )
    table = pd.read_parquet(tmp_path / "results" / "recordings" / "body-same" / "joints.parquet")
    assert list(table.groupby("recording").size()) == [14, 14]
    code, said, complained = call("skeleton", same, "--calibration", "results/recordings/body-same", "--refit")
    assert (code, complained) == (0, "")
    other = write_recording(synthesize(Recipe(frames=60, seed=2, height=1.5))[0], tmp_path / "other.c3d")
    code, _, complained = call("joints", body[0], "--static", other)
    assert (code, len(complained.splitlines())) == (2, 1)
    assert "other does not show the subject calibrated in body" in complained
    code, said, complained = call("joints", body[0], "--static", other, "--force", "--out", "forced")
    assert (code, complained) == (0, "")
    assert "--force overrules: other does not show the subject calibrated in body" in said
    assert "nothing to overrule" in call("joints", body[0], "--force")[2]
    assert "no shapes to refit" in call("skeleton", body[0], "--refit")[2]


def test_skeleton(body, drawn):
    """Every file is there; joints have their true places, and bones their true lengths."""
    truth = body[1]
    assert sorted(path.name for path in drawn.iterdir()) == FILES
    table = pd.read_parquet(drawn / "skeleton.parquet")
    assert len(table) == 500 * 14
    places = table.pivot_table(index="joint", columns="frame", values=["x", "y", "z"], dropna=False)
    for number, joint in enumerate(truth.joints):
        away = np.stack([places.loc[joint, axis] for axis in "xyz"]) - truth.centers[number]
        if not np.isnan(truth.axes[number]).any():  # the data do not place a hinge along its axis
            turns = truth.rotations[truth.segments.index(truth.parents[number])]
            axes = (turns @ truth.axes[number]).T
            away -= axes * (axes * away).sum(axis=0)
        assert np.nanmedian(np.linalg.norm(away, axis=0)) < 0.006, joint
    bones = pd.read_parquet(drawn / "bones.parquet").set_index(["start", "end"])
    found, true = bones.loc[("neck", "waist"), "length"], truth.bones["waist", "neck"]
    assert found == pytest.approx(true, abs=0.006)
    assert bones["spread"].max() < 0.01  # in some frames their ends are shown by their other segments
    assert bones["spread"].min() < 1e-9  # else bones keep their lengths
    assert set(table["known"]) <= {"seen", "bridged", "unknown"}


def test_output_of_skeleton(call, body, drawn):
    """Bone lengths, bridged joints, and the written files are printed."""
    code, said, complained = call("skeleton", body[0], "--calibration", drawn, "--out", "again")
    assert (code, complained) == (0, "")
    assert "left_hip - left_knee" in said
    assert "bridged in" in said
    written = [f"again/{name}" for name in FILES if name != "calibration.json"]
    assert sorted(said.splitlines()[-8:]) == written


def test_files_for_other_programs(call, body, drawn, tmp_path):
    """Files of all formats, by name or by the ends of names; their readers are in tests/mocap/export."""
    command = ("skeleton", body[0], "--calibration", drawn, "--out", "again")
    code, said, complained = call(*command, "--write", "new/joints.c3d,trc,glb,bvh,mot,csv", "--rest", "recorded")
    assert (code, complained) == (0, "")
    wanted = ["new/joints.c3d", *(f"again/body.{ending}" for ending in ("trc", "glb", "bvh", "mot", "csv"))]
    assert said.splitlines()[-6:] == wanted
    assert all((tmp_path / name).stat().st_size > 1000 for name in wanted)
    assert (tmp_path / "again/body.bvh").read_bytes() == (tmp_path / "again/skeleton.bvh").read_bytes()
    assert (tmp_path / "again/body.bvh").read_bytes() != (drawn / "skeleton.bvh").read_bytes()  # another pose
    code, said, _ = call("recording", "new/joints.c3d")
    assert said.startswith("joints: 55 markers, 500 frames at 120 Hz")


def test_files_that_are_refused(call, body, drawn, tmp_path):
    """Another end of a name, or the recording itself, is refused before anything is written."""
    command = ("skeleton", body[0], "--calibration", drawn, "--out", "out", "--write")
    refused(
        call(*command, "walk.fbx"), "--write walk.fbx: the end of a file's name", ".trc (markers and joint centres)"
    )
    before = body[0].read_bytes()
    refused(call(*command, f"trc,{body[0]}"), "is the recording itself, which is not overwritten")
    assert body[0].read_bytes() == before
    assert not (tmp_path / "out").exists()


def test_a_skeleton_without_its_root(call, drawn, tmp_path):
    """Without a pelvis there is no hierarchy, but all else."""
    recording = synthesize(Recipe(frames=60, seed=2))[0]
    rest = recording.select([marker for marker in recording.markers if marker[1:] not in ("FWT", "BWT")])
    path = write_recording(rest, tmp_path / "rest.c3d")
    code, said, complained = call("skeleton", path, "--calibration", drawn)
    assert code == 0
    assert complained.startswith("results/recordings/rest/skeleton.bvh is not written: ")
    assert "its pelvis is known in no frame" in complained
    assert "results/recordings/rest/viewer.html" in said


def test_skeleton_as_json(call, body, drawn):
    """The same numbers as in the tables, and the files."""
    code, said, complained = call("skeleton", body[0], "--calibration", drawn, "--out", "again", "--json")
    assert (code, complained) == (0, "")
    found = json.loads(said)
    assert (found["recording"], found["frames"], found["source"]) == ("body", 500, "joints found in this recording")
    table = pd.read_parquet(drawn / "skeleton.parquet")
    for joint in found["joints"]:
        rows = table[table["joint"] == joint["joint"]]
        assert joint["seen"] == pytest.approx((rows["known"] == "seen").mean())
    bones = pd.read_parquet(drawn / "bones.parquet")
    assert [bone["length"] for bone in found["bones"]] == pytest.approx(list(bones["length"]))
    assert sorted(found["files"]) == [f"again/{name}" for name in FILES if name != "calibration.json"]


def test_errors_in_each_frame(drawn):
    """The joint's errors along the world's axes: as a whole those of the joint, more where it is bridged."""
    table = pd.read_parquet(drawn / "skeleton.parquet")
    errors = table[["error_x", "error_y", "error_z"]]
    assert errors[table["known"] == "unknown"].isna().all().all()
    assert errors[table["known"] == "seen"].notna().all().all()
    for _, rows in errors.groupby(table["joint"]):
        total = (rows**2).sum(axis=1)[rows["error_x"].notna()]  # rotations do not change the sum of the squares
        assert np.isclose(total, total.median(), rtol=1e-9).mean() > 0.7
        assert (total > total.median() * (1 - 1e-9)).all()
    thigh = errors[(table["joint"] == "left_knee") & (table["known"] == "seen")]
    assert thigh.std().min() > 0  # but they change its parts


def test_another_recording_of_the_subject(call, drawn, tmp_path):
    """A calibration draws another recording of the same body; of another body it is refused."""
    same = write_recording(synthesize(Recipe(frames=60, seed=2))[0], tmp_path / "same.c3d")
    code, said, _ = call("skeleton", same, "--calibration", drawn / "calibration.json")
    assert code == 0
    assert "results/recordings/same/viewer.html" in said
    other = write_recording(synthesize(Recipe(frames=60, seed=2, height=1.5))[0], tmp_path / "other.c3d")
    code, said, complained = call("skeleton", other, "--calibration", drawn)
    assert code == 2
    assert len(complained.splitlines()) == 1
    assert "other does not show the subject calibrated in body" in complained
    assert not (tmp_path / "results" / "recordings" / "other").exists()
    near = write_recording(synthesize(Recipe(frames=60, seed=2, height=1.68))[0], tmp_path / "near.c3d")
    assert call("skeleton", near, "--calibration", drawn)[0] == 2
    code, said, complained = call("skeleton", near, "--calibration", drawn, "--force")
    assert (code, complained) == (0, "")
    assert "--force overrules: near does not show the subject calibrated in body" in said
    code, _, complained = call("skeleton", other, "--force")
    assert code == 2
    assert "nothing to overrule without --calibration" in complained


def test_a_calibration_that_cannot_be_used(call, body, tmp_path):
    """Another file, none at all, or a marker set beside it is refused."""
    (tmp_path / "text.json").write_text("{}")
    refused(call("skeleton", body[0], "--calibration", "text.json"), "text.json: not a calibration")
    refused(call("skeleton", body[0], "--calibration", "none.json"), "none.json: cannot be read")
    refused(call("skeleton", body[0], "--calibration", tmp_path), "calibration.json: cannot be read")
    code, said, complained = call("skeleton", body[0], "--calibration", "text.json", "--markerset", "cmu41")
    assert (code, said) == (2, "")
    assert "a calibration has its own marker set" in complained


def test_video(call, drawn, tmp_path):
    """With --video there is a video."""
    pytest.importorskip("imageio_ffmpeg", reason="imageio-ffmpeg is not installed")
    same = write_recording(synthesize(Recipe(frames=9, seed=2))[0], tmp_path / "same.c3d")
    code, said, complained = call("skeleton", same, "--calibration", drawn, "--video")
    assert (code, complained) == (0, "")
    assert said.endswith("results/recordings/same/motion.mp4\n")
    assert b"ftyp" in (tmp_path / "results/recordings/same/motion.mp4").read_bytes()[:12]


@pytest.mark.parametrize(("module", "arguments"), [("imageio_ffmpeg", ["--video"]), ("ezc3d", [])])
def test_without_the_extra(call, body, monkeypatch, module, arguments):
    """A missing library is named, with the command that installs it."""
    monkeypatch.setitem(sys.modules, module, None)
    monkeypatch.delitem(sys.modules, "study.recordings.formats.c3d", raising=False)
    refused(call("skeleton", body[0], *arguments), "needs", "pip install '.[mocap]'")


@pytest.fixture(scope="module")
def bad(body, tmp_path_factory):
    """Files that cannot be used."""
    folder = tmp_path_factory.mktemp("bad")
    (folder / "cut.c3d").write_bytes(body[0].read_bytes()[:20000])
    (folder / "text.c3d").write_text("hello")
    (folder / "empty.c3d").write_bytes(b"")
    (folder / "one.csv").write_text("# rate: 100\n# unit: mm\nLFHD_X,LFHD_Y,LFHD_Z\n1,2,3\n")
    (folder / "nothing.csv").write_text("# rate: 100\n# unit: mm\nLFHD_X,LFHD_Y,LFHD_Z\n,,\n,,\n")
    (folder / "words.doc").write_text("hello")
    return folder


@pytest.mark.parametrize("verb", ["recording", "joints", "skeleton", "case-study"])
@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("cut.c3d", "the file is cut short"),
        ("text.c3d", "not a C3D file"),
        ("empty.c3d", "the file is empty"),
        ("none.c3d", "cannot be read: No such file"),
        ("one.csv", "1 frame in it; motion needs at least 2"),
        ("nothing.csv", "none of its 1 markers has a sample"),
        ("words.doc", "a recording is a file whose name ends in"),
        ("", "a recording is a file whose name ends in"),
    ],
)
def test_bad_files(call, bad, verb, name, words, tmp_path):
    """A file that cannot be used gives one line with the reason and code 2; nothing is written."""
    refused(call(verb, bad / name), words)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--markerset", "nothing"], "no marker set 'nothing': known are cast, cgm2, cmu41, "),
        (["--markerset", "none.toml"], "none.toml: cannot be read"),
        (["--unit", "furlong"], "its unit 'furlong' is not known"),
        (["--rate", "0"], "its rate in frames per second is 0"),
        (["--subject", "x"], "no subject 'x' in it"),
        (["--out", "file"], "file: is a file, not a folder"),
    ],
)
def test_bad_options(call, body, tmp_path, options, words):
    """An option that cannot be used gives one line and code 2."""
    (tmp_path / "file").write_text("")
    refused(call("joints", body[0], *options), words)


def test_nothing_moves(call, body, tmp_path):
    """For a body that stands still, joints have reasons instead of places, and there is no skeleton."""
    recording, _ = synthesize(Recipe(frames=30, noise=0.0))
    still = Recording("still", recording.markers, np.repeat(recording.positions[:, :, :1], 30, axis=2), 100.0)
    path = write_recording(still, tmp_path / "still.c3d")
    code, said, _ = call("joints", path)
    assert code == 0
    assert pd.read_parquet(tmp_path / "results/recordings/still/joints.parquet")["center_parent_x"].isna().all()
    assert said.count("did not move") + said.count(": no frame") > 0
    code, _, complained = call("skeleton", path)
    assert (code, len(complained.splitlines())) == (2, 1)
    assert "none of its joints is known in any frame" in complained


def test_a_name_stays_in_the_folder(call, tmp_path):
    """A file with a name like a folder above, or like code, has its results in the folder of results."""
    short = synthesize(Recipe(frames=60))[0]
    for name, folder in (("...c3d", "recording"), ("a b<i>.c3d", "a-b-i")):
        assert call("joints", write_recording(short, tmp_path / name))[0] == 0
        assert (tmp_path / "results" / "recordings" / folder / "joints.parquet").is_file()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["...c3d", "a b<i>.c3d", "results"]


def test_fetch(call, monkeypatch, tmp_path):
    """A wrong name or library gives code 2, a server out of reach code 1; each gives one line."""
    refused(call("fetch", "cmu", "../secret"), "'../secret' cannot be a recording of cmu", "60_08")
    refused(call("fetch", "nasa", "60_08"), "no library 'nasa': known are cmu")
    monkeypatch.setenv("STUDY_CMU_URL", "http://127.0.0.1:9")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    refused(call("fetch", "cmu", "60_08"), "the server cannot be reached", code=1)


@pytest.mark.parametrize(
    "options", [["--frames", "1"], ["--gaps", "2"], ["--noise", "-1"], ["--out", "x.txt"], ["--skin", "angle"]]
)
def test_a_body_that_cannot_be(call, options):
    """A setting out of its limits, or a law of skin that does not move, gives one line and code 2."""
    refused(call("synthetic", *options))


def test_case_study(call, body, tmp_path):
    """The precision study writes tables and figure 7, and prints exponents with their intervals."""
    code, said, complained = call("case-study", body[0], "--subsets", 8)
    assert (code, complained) == (0, "")
    folder = tmp_path / "results" / "recordings" / "body"
    tables = [f"case-study-{name}.parquet" for name in ("joints", "laws", "scatter")]
    assert sorted(path.name for path in folder.iterdir()) == [*tables, "fig7_case.png", "fig7_case.svg"]
    assert "exponent, raw: -" in said
    assert "exponent, effective: -" in said


NECK = ("--parent", "C7,CLAV,STRN,T10", "--child", "LFHD,RFHD,LBHD,RBHD")


@pytest.fixture(scope="module")
def whole_body(tmp_path_factory):
    """A recording of a synthetic body as a file, without gaps."""
    recording, _ = synthesize(Recipe(frames=500, noise=0.001))
    return write_recording(recording, tmp_path_factory.mktemp("whole") / "body.c3d")


def test_one_line_and_no_files(call, whole_body, tmp_path):
    code, said, complained = call("joint", whole_body, *NECK)
    assert (code, complained) == (0, "")
    (line,) = said.splitlines()
    assert line.startswith("body: ok; centre (")
    assert list(tmp_path.iterdir()) == []


def test_json(call, whole_body):
    code, said, complained = call("joint", whole_body, *NECK, "--json")
    assert (code, complained) == (0, "")
    values = json.loads(said)
    assert (values["recording"], values["ok"], values["kind"], values["frames"] > 400) == (
        "body",
        True,
        "ball",
        True,
    )


def test_a_joint_that_is_not_ok(call, whole_body):
    """The exit code is 3, and the reason stands in the line: within the pelvis nothing moves."""
    code, said, complained = call("joint", whole_body, "--parent", "LFWT,RFWT,LBWT", "--child", "RBWT")
    assert (code, complained) == (3, "")
    assert "doubts: " in said
    code, said, _ = call("joint", whole_body, "--parent", "LFWT,RFWT,LBWT", "--child", "RBWT", "--json")
    assert (code, json.loads(said)["ok"]) == (3, False)


def test_a_wrong_label(call, whole_body):
    code, said, complained = call("joint", whole_body, "--parent", "C77,CLAV,STRN", "--child", "LFHD")
    assert (code, said, len(complained.splitlines())) == (2, "", 1)
    assert "did you mean 'C7'" in complained


@pytest.mark.parametrize(
    ("name", "folder"),
    [
        ("walk 1", "walk-1"),
        ("..", "recording"),
        ("../../etc/passwd", "etc-passwd"),
        ("/", "recording"),
        (".hidden", "hidden"),
        ("größe", "größe"),
        ("a\x00b\n", "a-b"),
        ("x" * 300, "x" * 100),
        ("C:\\run", "C-run"),
        ("", "recording"),
    ],
)
def test_folders(name, folder):
    """For any name of a recording, its folder is directly below that of results."""
    assert results_folder(name) == Path("results/recordings") / folder
    assert results_folder(name, Path("mine")) == Path("mine")


def test_frames_are_chosen_by_every_command(call, body):
    """A range reads a part of the recording; one that it does not have is refused, and so is one for a session."""
    code, said, _ = call("recording", body[0], "--frames", "101-300")
    assert code == 0
    assert "200 frames" in said
    assert "note: frames 101-300 of 500: they count from 1 here" in said
    for command in ("recording", "joints", "skeleton", "case-study"):
        code, said, complained = call(command, body[0], "--frames", "400-900")
        assert (code, said) == (2, "")
        assert "--frames 400-900: give the first and the last of its 500 frames" in complained
    code, _, complained = call("joints", body[0], body[0], "--frames", "1-300")
    assert code == 2
    assert "a range is of one recording" in complained


def test_hips_by_regression(call, tmp_path):
    """The command tells of it where every hip is doubted, and does it when asked; table and print say so."""
    made, _ = synthesize(Recipe(400, 60.0, markers="rizzoli", gait=True, soft_tissue=0.02))
    walk = write_recording(made, tmp_path / "walk.c3d")
    _, said, _ = call("joints", walk)
    assert "every hip is doubted: --hips regression takes them from the pelvis' width and depth" in said
    code, said, _ = call("joints", walk, "--hips", "regression", "--out", "out")
    assert code == 0
    assert "left_hip: by regression on the pelvis' width and depth (Harrington 2007)" in said
    assert "every hip is doubted" not in said
    table = pd.read_parquet(tmp_path / "out" / "joints.parquet").set_index("joint")
    assert table.status[["left_hip", "right_hip"]].tolist() == ["regression"] * 2
    code, said, _ = call("skeleton", walk, "--calibration", "out", "--write", "walk.trc", "--out", "drawn")
    assert code == 0
    assert "left_hip: not reliable: by regression" in said
    markers = read_recording(tmp_path / "walk.trc").markers
    assert "left_hip_regression" in markers
    assert "left_knee" in markers
    code, _, complained = call("skeleton", walk, "--calibration", "out", "--hips", "regression")
    assert (code, "a calibration has its hips" in complained) == (2, True)
    assert call("joints", walk, "--hips", "guess")[0] == 2


def test_a_file_is_no_folder(tmp_path):
    """A file in the folder's place is refused."""
    (tmp_path / "file").write_text("")
    with pytest.raises(RecordingError, match="is a file, not a folder; choose another with --out"):
        results_folder("a", tmp_path / "file")


def test_options_of_a_synthetic_body():
    """The command has an option for each setting, with the same default, and its help names every law of the skin."""
    options = inspect.signature(synthetic).parameters
    assert {name: options[name].default for name in Recipe.__dataclass_fields__} == vars(Recipe())
    assert get_args(options["skin"].annotation)[1].help.endswith(f": {', '.join(SKIN)}")


def test_every_option_is_passed_on(call, tmp_path):
    """Each setting reaches the body: the recording is the one that the library makes of them."""
    given = Recipe(30, 60.0, 2, 0.002, 0.01, "angle", 0.1, 0.05, 1.6, 0.5, gait=True, markers="rizzoli")
    options = [f"--{name.replace('_', '-')}={value}" for name, value in vars(given).items() if type(value) is not bool]
    assert call("synthetic", *options, "--gait", "--out", "a.csv")[0] == 0
    write_recording(synthesize(given)[0], tmp_path / "b.csv")
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()
    options = ["--frames=30", "--independent", "--out", "c.csv"]
    assert call("synthetic", *options)[0] == 0
    write_recording(synthesize(Recipe(30, independent=True))[0], tmp_path / "d.csv")
    assert (tmp_path / "c.csv").read_bytes() == (tmp_path / "d.csv").read_bytes()
