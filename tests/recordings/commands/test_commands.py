"""The commands on recordings, as a user calls them: options, output, files, objects of --json, and refusals."""

import inspect
import json
import os
import re
import shutil
import sys
from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np
import pandas as pd
import pytest

from study.recordings import commands
from study.recordings.formats import write
from study.recordings.formats.read import read_recording
from study.recordings.formats.write import write_recording
from study.recordings.joints.find import load_calibration
from study.recordings.markersets import load_markerset, shipped
from study.recordings.recording import Recording
from study.recordings.rigid import across
from study.recordings.synthetic.make import SKIN, Recipe, synthesize

FIGURES = ["fig1_skeleton.png", "fig1_skeleton.svg", "motion.json", "skeleton.bvh", "skeleton.parquet", "viewer.html"]
FILES = ["angles.parquet", "bones.parquet", "calibration.json", *FIGURES]
WRITTEN = [f"again/{name}" for name in FILES if name != "calibration.json"]
NECK = ("--parent", "C7,CLAV,STRN,T10", "--child", "LFHD,RFHD,LBHD,RBHD")
PELVIS = ("--parent", "LFWT,RFWT,LBWT", "--child", "RBWT")


@pytest.fixture(scope="module")
def drawn(body, tmp_path_factory):
    """A folder with the body's skeleton."""
    folder = tmp_path_factory.mktemp("drawn") / "out"
    commands.skeleton(body, out=folder)
    return folder


@pytest.fixture
def made(tmp_path):
    """Write the recording of a synthetic body to a file of this name."""
    return lambda name, frames=60, **changes: write_recording(
        synthesize(Recipe(frames, **{"seed": 2} | changes))[0], tmp_path / name
    )


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no file names but of text")
def test_a_file_name_that_is_no_text(works, body, tmp_path):
    """An old name, whose é is one byte, is read as it was meant; every file is written."""
    shutil.copy(body, tmp_path / os.fsdecode(b"h\xe9.c3d"))
    works("skeleton", os.fsdecode(b"h\xe9.c3d"), "--out", "out", "--write", "trc,mot")
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == sorted([*FILES, "hé.trc", "hé.mot"])
    assert (tmp_path / "out" / "hé.trc").read_text(encoding="utf-8").splitlines()[0].endswith("\thé.trc")
    assert json.loads((tmp_path / "out" / "motion.json").read_text(encoding="utf-8"))["name"] == "hé"


def test_synthetic(works, read, tmp_path):
    """A recording is written with the truth beside it; the same seed gives the same bytes."""
    paths = [tmp_path / line for line in works("synthetic", "--frames", 30, "--seed", 4).splitlines()]
    ends = (".c3d", ".joints.parquet", ".truth.parquet")
    assert [path.name for path in paths] == [f"synthetic-4{end}" for end in ends]
    assert paths[0].parent == tmp_path / "results" / "recordings" / "synthetic-4"
    found = read("synthetic", "--frames", 30, "--seed", 4, "--out", "again.c3d")
    assert (found["recording"], found["frames"], found["rate"]) == ("synthetic-4", 30, 120.0)
    assert all((tmp_path / name).is_file() for name in found["files"])
    assert (tmp_path / "again.c3d").read_bytes() == paths[0].read_bytes()


def test_recording(works, read, refused, body, tmp_path, small):
    """A recording's contents are printed, with the marker set that fits; where none does, it has no joints."""
    said = works("recording", body)
    assert said.startswith("body: 41 markers, 500 frames at 120 Hz, 4.16 s, 5.0% of the samples missing\n")
    assert all(f"\n{marker}" in said for marker in ("LFHD", "RTOE"))
    assert "marker set cmu41: 41 of the recording's 41 markers belong to it, 14 of 14 joints can be found" in said
    found = read("recording", body)
    assert (found["recording"], found["frames"], found["rate"], len(found["markers"])) == ("body", 500, 120.0, 41)
    assert found["missing"] == pytest.approx(sum(row["missing"] for row in found["markers"]) / 500 / 41)
    assert (found["markerset"]["name"], len(found["markerset"]["joints"])) == ("cmu41", 14)
    other = write_recording(small(("a", "b", "c")), tmp_path / "other.csv")
    assert "no marker set fits: with none of cast, cgm2, cmu41, " in works("recording", other)
    assert read("recording", other)["markerset"] is None
    refused("joints", other, says="other: no marker set fits")
    refused("joints", other, says="study markersets cmu41 > mine.toml")


def test_markersets(works, read, refused, tmp_path):
    """The shipped sets are listed; one that is printed into a file is the shipped one, and serves as a user's own."""
    said = works("markersets")
    assert [line.split()[0] for line in said.splitlines()] == shipped()
    assert "cmu41                  41 markers  14 joints  41 markers of the CMU" in said
    (tmp_path / "mine.toml").write_text(works("markersets", "cmu41"), encoding="utf-8")
    assert load_markerset(tmp_path / "mine.toml") == load_markerset("cmu41")
    known = f"no marker set 'cmu42': did you mean 'cmu41'? Known are {', '.join(shipped())}; `study"
    refused("markersets", "cmu42", says=known)
    assert [one["name"] for one in read("markersets")["markersets"]] == shipped()
    (one,) = read("markersets", "cmu41")["markersets"]
    assert type(load_markerset("cmu41")).model_validate(one) == load_markerset("cmu41")


def test_joints(works, read, body, tmp_path):
    """A line and a row per joint, and which way is up; the object has the table's numbers."""
    lines = works("joints", body).splitlines()
    assert any(line.startswith("note: up is z of the recording, in which ") for line in lines)
    table = pd.read_parquet(tmp_path / lines[-2])
    names = [joint.name for joint in load_markerset("cmu41").joints]
    assert sorted(table["joint"]) == sorted(names)
    assert all(any(line.startswith(f"{joint} ") for line in lines) for joint in names)
    assert (table.loc[table["joint"] == "left_knee", "kind"] == "hinge").all()
    assert {"from_gdke", "from_ugdk", "from_mle", "from_two_sided"} <= set(table.columns)
    assert lines[-1] == "results/recordings/body/calibration.json"
    assert (tmp_path / lines[-1]).is_file()
    found = read("joints", body)
    assert [row["joint"] for row in found["joints"]] == list(table["joint"])
    wanted = table["error"].astype(object).where(table["error"].notna(), None)
    assert [row["error"] for row in found["joints"]] == pytest.approx(list(wanted))
    assert [name.rpartition("/")[2] for name in found["files"]] == ["joints.parquet", "calibration.json"]
    assert found["markerset"]["name"] == "cmu41"


def test_trials_of_one_session(works, refused, made, body, tmp_path):
    """Two recordings of one body give one calibration; one of another body is refused, or merged by force."""
    same, folder = made("same.c3d", 300), "results/recordings/body-same"
    lines = works("joints", body, same).splitlines()
    assert lines[-2:] == [f"{folder}/joints.parquet", f"{folder}/calibration.json"]
    assert any(line.startswith("waist ") and line.endswith(("  body, same", "  same, body")) for line in lines)
    table = pd.read_parquet(tmp_path / folder / "joints.parquet")
    assert list(table.groupby("recording").size()) == [14, 14]
    works("skeleton", same, "--calibration", folder, "--refit")
    other = made("other.c3d", height=1.5)
    words = "other does not show the subject calibrated in body"
    refused("joints", body, "--static", other, says=words)
    assert f"--force overrules: {words}" in works("joints", body, "--static", other, "--force", "--out", "forced")
    refused("joints", body, "--force", says="nothing to overrule")
    refused("skeleton", body, "--refit", says="no shapes to refit")


def test_skeleton(drawn):
    """Every file is there, with a row for each joint and frame; bones have their true lengths."""
    _, truth = synthesize(Recipe(frames=500, gaps=0.05))
    assert sorted(path.name for path in drawn.iterdir()) == FILES
    table = pd.read_parquet(drawn / "skeleton.parquet")
    assert len(table) == 500 * 14
    bones = pd.read_parquet(drawn / "bones.parquet").set_index(["start", "end"])
    assert bones.loc[("neck", "waist"), "length"] == pytest.approx(truth.bones["waist", "neck"], abs=0.006)
    assert bones["spread"].max() < 0.01  # in some frames their ends are shown by their other segments
    assert bones["spread"].min() < 1e-9  # else bones keep their lengths
    assert set(table["known"]) <= {"seen", "bridged", "unknown"}


def test_output_of_skeleton(works, read, body, drawn):
    """Bone lengths, bridged joints and files are printed; the object has the numbers of the tables."""
    said = works("skeleton", body, "--calibration", drawn, "--out", "again")
    assert "left_hip - left_knee" in said
    assert re.search(r"^joint +status .* bridged +unknown$", said, re.MULTILINE)
    assert sorted(said.splitlines()[-8:]) == WRITTEN
    found = read("skeleton", body, "--calibration", drawn, "--out", "again")
    assert (found["recording"], found["frames"], found["source"]) == ("body", 500, "joints found in this recording")
    table = pd.read_parquet(drawn / "skeleton.parquet")
    for joint in found["joints"]:
        rows = table[table["joint"] == joint["joint"]]
        assert joint["seen"] == pytest.approx((rows["known"] == "seen").mean())
    bones = pd.read_parquet(drawn / "bones.parquet")
    assert [bone["length"] for bone in found["bones"]] == pytest.approx(list(bones["length"]))
    assert sorted(found["files"]) == WRITTEN


def test_files_for_other_programs(works, refused, body, drawn, tmp_path):
    """Files of all formats, by name or by the ends of names; what is refused is refused before any work."""
    command = ("skeleton", body, "--calibration", drawn, "--out", "again")
    said = works(*command, "--write", "new/joints.c3d,trc,glb,bvh,mot,csv", "--rest", "recorded")
    wanted = ["new/joints.c3d", *(f"again/body.{ending}" for ending in ("trc", "glb", "bvh", "mot", "csv"))]
    assert said.splitlines()[-6:] == wanted
    assert all((tmp_path / name).stat().st_size > 1000 for name in wanted)
    assert (tmp_path / "again/body.bvh").read_bytes() == (tmp_path / "again/skeleton.bvh").read_bytes()
    assert (tmp_path / "again/body.bvh").read_bytes() != (drawn / "skeleton.bvh").read_bytes()  # another pose
    assert works("recording", "new/joints.c3d").startswith("joints: 55 markers, 500 frames at 120 Hz")
    bare = works("skeleton", body, "--calibration", drawn, "--out", "other", "--write", "bare.trc")
    assert bare.splitlines()[-1] == "other/bare.trc"
    before = body.read_bytes()
    command = ("skeleton", body, "--calibration", drawn, "--out", "out", "--write")
    refused(*command, f"trc,{body}", says="is the recording itself, which is not overwritten")
    assert body.read_bytes() == before
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


def test_errors_in_each_frame(drawn):
    """The errors along the world's axes are at least those of the joint in its parent, and more where it is bridged."""
    table = pd.read_parquet(drawn / "skeleton.parquet")
    errors = table[["error_x", "error_y", "error_z"]]
    assert errors[table["known"] == "unknown"].isna().all().all()
    assert errors[table["known"] == "seen"].notna().all().all()
    joints = {place.joint.name: place for place in load_calibration(drawn / "calibration.json").joints}
    for name, rows in errors.groupby(table["joint"]):
        total = (rows**2).sum(axis=1)[rows["error_x"].notna()]  # rotations do not change the sum of the squares
        directions = across(joints[name].axis)
        least = np.trace(directions.T @ joints[name].covariance @ directions)
        assert (total > least * (1 - 1e-9)).all()
        assert (np.sqrt(total[table.loc[total.index, "known"] == "seen"]) < np.sqrt(least) + 0.015).all()
    bridged = table["known"] == "bridged"
    assert errors[bridged].max(axis=1).median() > 2 * errors[table["known"] == "seen"].max(axis=1).median()
    thigh = errors[(table["joint"] == "left_knee") & (table["known"] == "seen")]
    assert thigh.std().min() > 0  # but they change its parts


def test_another_recording_of_the_subject(works, refused, made, drawn, tmp_path):
    """A calibration draws another recording of the same body; of another body it is refused, or forced."""
    said = works("skeleton", made("same.c3d"), "--calibration", drawn / "calibration.json")
    assert "results/recordings/same/viewer.html" in said
    other, near = made("other.c3d", height=1.5), made("near.c3d", height=1.68)
    words = "does not show the subject calibrated in body"
    refused("skeleton", other, "--calibration", drawn, says=f"other {words}", silent=False)
    assert not (tmp_path / "results" / "recordings" / "other").exists()
    refused("skeleton", near, "--calibration", drawn, says=f"near {words}", silent=False)
    said = works("skeleton", near, "--calibration", drawn, "--force")
    assert f"--force overrules: near {words}" in said
    assert "its segments are 4% smaller" in said  # 1.68 m, not 1.75
    refused("skeleton", other, "--force", says="nothing to overrule without --calibration")


def test_a_calibration_that_cannot_be_used(refused, body, tmp_path):
    """Another file, none at all, or a marker set beside it is refused."""
    (tmp_path / "text.json").write_text("{}")
    refused("skeleton", body, "--calibration", "text.json", says="text.json: not a calibration")
    refused("skeleton", body, "--calibration", "none.json", says="none.json: cannot be read")
    refused("skeleton", body, "--calibration", tmp_path, says="calibration.json: cannot be read")
    command = ("skeleton", body, "--calibration", "text.json", "--markerset", "cmu41")
    refused(*command, says="a calibration has its own marker set")


def test_video(works, made, drawn, tmp_path):
    """With --video there is a video."""
    pytest.importorskip("imageio_ffmpeg", reason="imageio-ffmpeg is not installed")
    said = works("skeleton", made("same.c3d", 9), "--calibration", drawn, "--video")
    assert said.endswith("results/recordings/same/motion.mp4\n")
    assert b"ftyp" in (tmp_path / "results/recordings/same/motion.mp4").read_bytes()[:12]


@pytest.mark.parametrize(("name", "arguments"), [("imageio-ffmpeg", ["--video"]), ("ezc3d", [])])
def test_without_the_extra(refused, body, monkeypatch, name, arguments):
    """A missing library is named, with the command that installs it."""
    monkeypatch.setitem(sys.modules, name.replace("-", "_"), None)
    monkeypatch.delitem(sys.modules, "study.recordings.formats.c3d", raising=False)
    refused("skeleton", body, *arguments, says=f"needs {name}: pip install '.[mocap]'")


@pytest.fixture(scope="module")
def bad(body, tmp_path_factory):
    """Files that cannot be used."""
    folder, head = tmp_path_factory.mktemp("bad"), "# rate: 100\n# unit: mm\nLFHD_X,LFHD_Y,LFHD_Z\n"
    (folder / "cut.c3d").write_bytes(body.read_bytes()[:20000])
    (folder / "folder.csv").mkdir()
    for name, text in {"empty.c3d": "", "words.doc": "hello", "nothing.csv": f"{head},,\n,,\n"}.items():
        (folder / name).write_text(text)
    return folder


@pytest.mark.parametrize("verb", ["recording", "joints", "skeleton", "case-study"])
@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("cut.c3d", "the file is cut short"),
        ("empty.c3d", "the file is empty"),
        ("none.c3d", "cannot be read: No such file"),
        ("folder.csv", "cannot be read: Is a directory"),
        ("nothing.csv", "none of its 1 markers has a sample"),
        ("words.doc", "a recording is a file whose name ends in"),
        ("", "a recording is a file whose name ends in"),
    ],
)
def test_bad_files(refused, bad, verb, name, words, tmp_path):
    """A file that cannot be used gives one line with the reason and code 2; nothing is written."""
    refused(verb, bad / name, says=words)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("option", "value", "words"),
    [
        ("--markerset", "nothing", "no marker set 'nothing': known are cast, cgm2, cmu41, "),
        ("--markerset", "none.toml", "none.toml: cannot be read"),
        ("--unit", "furlong", "its unit 'furlong' is not known"),
        ("--rate", "0", "its rate in frames per second is 0"),
        ("--subject", "x", "no subject 'x' in it"),
        ("--out", "file", "file: is a file, not a folder; choose another with --out"),
        ("--hips", "guess", "'guess' is not one of"),
    ],
)
def test_bad_options(refused, body, tmp_path, option, value, words):
    """An option that cannot be used gives its reason and code 2."""
    (tmp_path / "file").write_text("")
    refused("joints", body, option, value, says=words)


def test_nothing_moves(works, refused, tmp_path):
    """For a body that stands still, joints have reasons instead of places, and there is no skeleton."""
    recording, _ = synthesize(Recipe(frames=30, noise=0.0))
    still = Recording("still", recording.markers, np.repeat(recording.positions[:, :, :1], 30, axis=2), 100.0)
    path = write_recording(still, tmp_path / "still.c3d")
    said = works("joints", path)
    assert pd.read_parquet(tmp_path / "results/recordings/still/joints.parquet")["center_parent_x"].isna().all()
    assert said.count("did not move") + said.count(": no frame") > 0
    refused("skeleton", path, says="none of its joints is known in any frame", silent=False)


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
    assert commands.results_folder(name) == Path("results/recordings") / folder
    assert commands.results_folder(name, Path("mine")) == Path("mine")


def test_fetch(read, refused, monkeypatch, tmp_path):
    """A wrong name or library gives code 2, a server out of reach code 1; each gives one line."""
    refused("fetch", "cmu", "../secret", says="'../secret' cannot be a recording of cmu; give a name such as 60_08")
    refused("fetch", "nasa", "60_08", says="no library 'nasa': known are cmu")
    monkeypatch.setenv("STUDY_CMU_URL", "http://127.0.0.1:9")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    refused("fetch", "cmu", "60_08", says="the server cannot be reached", code=1)
    monkeypatch.setattr(write, "fetch", lambda library, name: tmp_path / f"{name}.c3d")
    wanted = {"library": "cmu", "name": "60_08", "file": str(tmp_path / "60_08.c3d")}
    assert read("fetch", "cmu", "60_08") == wanted | {"terms": write.LIBRARIES["cmu"]}


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (["--frames=1"], "frames = 1 of a synthetic body must be from 2 to"),
        (["--noise=-0.001"], "noise = -0.001 of a synthetic body must be from 0"),
        (["--noise=nan"], "noise = nan"),
        (["--gaps=1.5"], "gaps = 1.5 of a synthetic body must be from 0 to 1"),
        (["--rate=0"], "rate = 0"),
        (["--seed=-1"], "seed = -1"),
        (["--height=0"], "height = 0"),
        (["--skin=loose"], "skin = loose of a synthetic body must be one of mixed, random, angle"),
        (["--skin=angle"], "skin"),
        (["--markers=cast"], "markers = cast of a synthetic body must be one of cmu41, rizzoli"),
        (["--independent", "--gait"], "independent and gait of a synthetic body exclude each other"),
        (["--out=x.txt"], "a recording is written to a file whose name ends in .c3d, .trc, .csv"),
    ],
)
def test_a_body_that_cannot_be(refused, settings, words):
    """A setting out of its limits, or a law of skin that does not move, gives one line and code 2."""
    refused("synthetic", *settings, says=words)


def test_case_study(works, read, body, tmp_path):
    """The precision study writes tables and figure 7, and prints exponents with their intervals."""
    said = works("case-study", body, "--subsets", 4)
    folder = tmp_path / "results" / "recordings" / "body"
    tables = [f"case-study-{name}.parquet" for name in ("joints", "laws", "scatter")]
    assert sorted(path.name for path in folder.iterdir()) == [*tables, "fig7_case.png", "fig7_case.svg"]
    assert "exponent, raw: -" in said
    assert "exponent, effective: -" in said
    whole, _ = synthesize(Recipe(frames=300))
    hips = whole.select([marker for marker in whole.markers if marker[1:] in ("FWT", "BWT", "THI", "KNE")])
    found = read("case-study", write_recording(hips, tmp_path / "hips.c3d"), "--subsets", 4)
    table = pd.read_parquet(tmp_path / "results/recordings/hips/case-study-joints.parquet")
    assert [row["joint"] for row in found["joints"]] == list(table["joint"])
    np.testing.assert_allclose([row["effective_frames"] for row in found["joints"]], table["effective_frames"])
    assert all((tmp_path / name).is_file() for name in found["files"])
    assert (found["recording"], found["subsets"]) == ("hips", 4)


def test_one_joint(call, works, read, refused, body, tmp_path):
    """One line and no files; of a joint that is not ok, the exit code is 3: within the pelvis nothing moves."""
    (line,) = works("joint", body, *NECK).splitlines()
    assert line.startswith("body: ok; centre (")
    assert list(tmp_path.iterdir()) == []
    values = read("joint", body, *NECK)
    assert (values["recording"], values["ok"], values["kind"]) == ("body", True, "ball")
    assert values["frames"] > 300
    assert f"± {1000 * values['error']:.1f} mm" in line
    assert ", ".join(f"{1000 * x:.1f}" for x in values["center"]) in line
    assert (values["status"], values["axis"], values["doubts"], values["compared"]) == ("ok", None, [], [])
    assert list(values["parent_markers"]) == NECK[1].split(",")
    code, said, complained = call("joint", body, *PELVIS)
    assert (code, complained) == (3, "")
    assert "doubts: " in said
    code, said, _ = call("joint", body, *PELVIS, "--json")
    assert (code, json.loads(said)["ok"]) == (3, False)
    refused("joint", body, "--parent", "C77,CLAV,STRN", "--child", "LFHD", says="did you mean 'C7'")


def test_frames_are_chosen_by_every_command(works, refused, body):
    """A range reads a part of the recording; one that it does not have is refused, and so is one for a session."""
    said = works("recording", body, "--frames", "101-300")
    assert "200 frames" in said
    assert "note: frames 101-300 of 500: they count from 1 here" in said
    for command in ("recording", "joints", "skeleton", "case-study"):
        words = "--frames 400-900: give the first and the last of its 500 frames"
        refused(command, body, "--frames", "400-900", says=words)
    refused("joints", body, body, "--frames", "1-300", says="a range is of one recording")


def test_hips_by_regression(works, refused, made, tmp_path):
    """The command tells of it where every hip is doubted, and does it when asked; table and print say so."""
    walk = made("walk.c3d", 400, rate=60.0, seed=1, markers="rizzoli", gait=True, soft_tissue=0.02)
    words = "every hip is doubted: --hips regression takes them from the pelvis' width and depth"
    assert words in works("joints", walk)
    said = works("joints", walk, "--hips", "regression", "--out", "out")
    assert "left_hip: by regression on the pelvis' width and depth (Harrington 2007)" in said
    assert "every hip is doubted" not in said
    table = pd.read_parquet(tmp_path / "out" / "joints.parquet").set_index("joint")
    assert table.status[["left_hip", "right_hip"]].tolist() == ["regression"] * 2
    said = works("skeleton", walk, "--calibration", "out", "--write", "walk.trc", "--out", "drawn")
    assert re.search(r"^left_hip +regression ", said, re.MULTILINE)
    assert "left_hip: not reliable" not in said  # a kind of placing, and no doubt
    labels = set(read_recording(tmp_path / "drawn" / "walk.trc").markers)
    assert {"left_hip_regression", "left_knee_landmark"} <= labels  # skin of 2 cm leaves both in doubt
    refused("skeleton", walk, "--calibration", "out", "--hips", "regression", says="a calibration has its hips")


def test_options_of_a_synthetic_body(works, tmp_path):
    """The command has an option for each setting, with its default, names every law of the skin, and passes all on."""
    options = inspect.signature(commands.synthetic).parameters
    assert {name: options[name].default for name in Recipe.__dataclass_fields__} == vars(Recipe())
    assert get_args(options["skin"].annotation)[1].help.endswith(f": {', '.join(SKIN)}")
    walk = Recipe(30, 60.0, 2, 0.002, 0.01, "angle", 0.1, 0.05, 1.6, 0.5, gait=True, markers="rizzoli")
    for recipe, flag in ((walk, "--gait"), (Recipe(30, independent=True), "--independent")):
        given = {name.replace("_", "-"): value for name, value in vars(recipe).items() if type(value) is not bool}
        works("synthetic", *(f"--{name}={value}" for name, value in given.items()), flag, "--out", "a.csv")
        write_recording(synthesize(recipe)[0], tmp_path / "b.csv")
        assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()


def test_all_subjects_of_a_file(works, call, refused, read, tmp_path):
    """Each has a folder of its own, with what it has if it is chosen; a calibration is that of the subject."""
    people = {name: synthesize(Recipe(120, 60.0, seed=seed))[0] for name, seed in (("Ann", 1), ("Bob", 2))}
    labels = tuple(f"{name}:{marker}" for name, one in people.items() for marker in one.markers)
    both = Recording("two", labels, np.concatenate([one.positions for one in people.values()]), 60.0)
    path = write_recording(both, tmp_path / "two.c3d")
    said = works("joints", path, "--subject", "all", "--out", "out")
    assert [line for line in said.splitlines() if line.startswith("subject ")] == ["subject Ann:", "subject Bob:"]
    for name in people:
        works("joints", path, "--subject", name, "--out", f"one-{name}")
        one, other = (tmp_path / folder / "calibration.json" for folder in (f"out/{name}", f"one-{name}"))
        assert one.read_bytes() == other.read_bytes()
    works("skeleton", path, "--subject", "all", "--calibration", "out", "--out", "drawn")
    assert {found.name for found in (tmp_path / "drawn").iterdir()} == set(people)
    for name in people:
        table = pd.read_parquet(tmp_path / "drawn" / name / "skeleton.parquet")
        assert len(table) == 120 * 14
    refused("joints", path, "--subject", "all", "--json", says="there is one JSON object for each subject")
    refused("joints", path, says="choose one with --subject, or --subject all")
    few = both.select([label for label in labels if label.startswith("Bob") or label in ("Ann:C7", "Ann:LSHO")])
    path = write_recording(replace(few, name="few"), tmp_path / "few.c3d")
    code, said, complained = call("joints", path, "--subject", "all", "--out", "few")
    assert code == 2
    assert "few: no marker set fits" in complained
    assert (tmp_path / "few" / "Bob" / "joints.parquet").is_file()
