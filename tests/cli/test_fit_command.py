"""`study fit` and `study estimators`: what a user types, sees and is refused.

Most commands run in this process, which is what a second process would print; a few run through a pipe.
"""

import contextlib
import csv
import io
import json
import os
import re
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

import study
from study import cli
from study.sphere.jit import COMPILING


@pytest.fixture
def say(monkeypatch, capsys, tmp_path):
    """Run a command in an empty folder: exit code, standard output, standard error."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["study", *map(str, arguments)])
        with pytest.raises(SystemExit) as end:
            cli.main()
        said = capsys.readouterr()
        return end.value.code, said.out, said.err

    return run


@pytest.fixture
def cap(rng, on_cap, tmp_path):
    """A file of 200 points on a cap, and the points."""
    points, _ = on_cap(rng, 200, angle=60.0, noise=0.02, center=5.0, radius=2.0)
    np.savetxt(tmp_path / "cap.csv", points, delimiter=",", header="x,y,z", comments="", fmt="%.17g")
    return points


def rows_of(said):
    """The first table's cells by estimator, and the header's."""
    head, *lines = (re.split(r" {2,}", line) for line in said.partition("\n\n")[0].splitlines())
    return head, {cells[0]: cells[1:] for cells in lines if len(cells) == len(head)}


@pytest.mark.parametrize("d", [2, 3])
def test_fit(say, rng, on_cap, tmp_path, d):
    """The printed centre and radius are study.fit's to the second digit of their standard errors."""
    points, _ = on_cap(rng, 90, angle=80.0, d=d, noise=0.02, center=5.0)
    np.save(tmp_path / "p.npy", points)
    code, said, complained = say("fit", "p.npy")
    assert (code, complained) == (0, "")
    head, rows = rows_of(said)
    assert head == ["estimator", *"123"[:d], "radius", "noise", "rms", "ρ", "samples", "status"]
    fit = study.fit(points)
    for cell, value, error in zip(rows["corrected"], [*fit.center, fit.radius], fit.standard_errors, strict=False):
        printed, its_error = map(float, cell.split(" ± "))
        assert abs(its_error / error - 1.0) <= 0.05
        assert abs(printed - value) <= 0.05 * error
    assert rows["corrected"][-2:] == ["90", "ok"]
    title, form, intervals, note = said.splitlines()[3:]
    assert intervals.startswith("95 % intervals: radius ")
    assert re.split(r" {2,}", title) == ["estimator", "diameter", "form error", "largest deviation"]
    name, diameter, form_error, deviation = re.split(r" {2,}", form)
    assert name == "corrected"
    assert float(diameter.split(" ± ")[0]) == pytest.approx(2.0 * fit.radius, abs=0.1 * fit.standard_errors[-1])
    distance = np.linalg.norm(points - fit.center, axis=1)
    assert float(form_error) == pytest.approx(np.ptp(distance), rel=0.01)
    assert float(deviation) == pytest.approx(np.abs(distance - fit.radius).max(), rel=0.01)
    assert note == "± is one standard uncertainty"


def test_all_with_and_without_noise(say, cap):
    """Without the noise, all is all that can do without; with it, the whole registry."""
    _, rows = rows_of(say("fit", "cap.csv", "--estimator", "all")[1])
    assert list(rows) == [name for name, entry in study.ESTIMATORS.items() if entry.needs != "noise"]
    code, said, complained = say("fit", "cap.csv", "-e", "all", "--noise", "0.02")
    fits = [study.fit(cap, name, 0.02) for name in study.ESTIMATORS]
    assert (code, complained) == (0 if all(fit.ok for fit in fits) else 3, "")
    assert list(rows_of(said)[1]) == list(study.ESTIMATORS)
    assert all(f"{entry.caution}" in said for entry in study.ESTIMATORS.values())


def test_columns_and_missing_rows(say, cap, tmp_path):
    """Chosen columns head the table, and rows that miss a coordinate are not counted."""
    lines = (tmp_path / "cap.csv").read_text().splitlines()
    lines[7] = "nan,1,2"
    lines[9] = ",1,2"
    (tmp_path / "gaps.csv").write_text("\n".join(lines))
    head, rows = rows_of(say("fit", "gaps.csv", "--columns", "z, x,2")[1])
    assert head[1:4] == ["z", "x", "y"]
    assert rows["corrected"][-2] == "198"
    used = np.delete(cap, [6, 8], axis=0)[:, [2, 0, 1]]
    assert abs(float(rows["corrected"][0].split()[0]) - study.fit(used).center[0]) < 0.01


def test_many_rows(say, cap, tmp_path):
    """A file of 200 000 rows is fitted, and its picture drawn with fewer of them."""
    block = "\n".join(",".join(map(repr, row)) for row in cap.tolist())
    (tmp_path / "big.csv").write_text("\n".join([block] * 1000))
    code, said, complained = say("fit", "big.csv", "--plot", "big.png")
    assert (code, complained) == (0, "")
    cells = rows_of(said)[1]["corrected"]
    assert cells[-2:] == ["200000", "ok"]
    assert abs(float(cells[3].split()[0]) - study.fit(cap).radius) < 1e-3
    assert (tmp_path / "big.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("none.csv", "none.csv: cannot be read: No such file or directory"),
        (".", ".: cannot be read: "),
        ("cap.csv --columns x,y,w", "cap.csv: no column 'w'"),
        ("cap.csv --columns x,y,y", "cap.csv: column y is given twice"),
        ("cap.csv --noise 0", "--noise 0: "),
        ("cap.csv --noise -0.1", "--noise -0.1: "),
        ("cap.csv --noise nan", "--noise nan: "),
        ("cap.csv -e taubim", "--estimator taubim: unknown; did you mean 'taubin'?"),
        ("cap.csv -e Als", "--estimator Als: unknown; did you mean 'als'?"),
        ("cap.csv -e ugdk --noise 1e-300", "--noise 1e-300: "),
        ("/dev/zero", "/dev/zero: not a regular file"),
        ("cap.csv -e ugdk", "--estimator ugdk: needs the noise level"),
        ("bad.csv", "bad.csv: row 3, column 2: 'four' is not a number"),
    ],
)
def test_refusals(say, cap, tmp_path, arguments, words):
    """Code 2, one line that names what is wrong, nothing on standard output, and no picture."""
    (tmp_path / "bad.csv").write_text("x,y\n1,2\n3,four\n5,6\n7,8\n")
    code, said, complained = say("fit", *arguments.split(), "--plot", "out.png")
    assert (code, said) == (2, "")
    assert len(complained.splitlines()) == 1
    assert complained.startswith(words)
    assert not (tmp_path / "out.png").exists()


def test_usage(say, cap):
    """A noise that is no number is refused with the option's name, and so is an unknown option."""
    for arguments in (["cap.csv", "--noise", "low"], ["cap.csv", "--nois", "1"], []):
        code, said, complained = say("fit", *arguments)
        assert (code, said) == (2, "")
        assert "Usage: " in complained


@pytest.mark.parametrize("suffix", ["png", "svg", "pdf"])
def test_plot(say, cap, tmp_path, suffix):
    """The picture is of the kind that its name says, in a folder that is made."""
    assert say("fit", "cap.csv", "--plot", f"new/folder/out.{suffix}")[0] == 0
    data = (tmp_path / "new" / "folder" / f"out.{suffix}").read_bytes()
    assert {"png": b"\x89PNG", "svg": b"<?xml", "pdf": b"%PDF"}[suffix] == data[: 5 if suffix == "svg" else 4]


@pytest.mark.parametrize("estimator", ["corrected", "all"])
def test_coplanar_points_are_drawn(say, rng, tmp_path, estimator):
    """Points without noise in a plane: statuses, the exit code of fits that are not ok, a picture of the points."""
    t = rng.uniform(-1, 1, 50)
    np.save(tmp_path / "arc.npy", np.column_stack([np.cos(t), np.sin(t), np.zeros(50)]))
    code, said, complained = say("fit", "arc.npy", "-e", estimator, "--plot", "arc.png")
    assert (code, complained) == (3, "")
    assert "see below" in said
    assert "they leave the centre undetermined" in said
    assert np.asarray(Image.open(tmp_path / "arc.png").convert("L")).std() > 5  # not blank


@pytest.mark.parametrize("plot", ["cap.csv/out.png", "out.xyz", "."])
def test_a_picture_that_cannot_be_written(say, cap, tmp_path, plot):
    """A folder that is a file, an unknown format, a folder: one line that names the picture, no traceback."""
    try:
        code, _, complained = say("fit", "cap.csv", "--plot", plot)
    except (OSError, ValueError) as error:
        pytest.fail(f"traceback: {error!r}")
    assert code in (1, 2)
    assert len(complained.splitlines()) == 1
    assert plot in complained


def test_columns_by_name(say, cap, tmp_path):
    """x, y and z are taken by name, and the columns that are left out are named."""
    rows = (tmp_path / "cap.csv").read_text().splitlines()[1:]
    (tmp_path / "wide.csv").write_text("\n".join(["id,X [mm],Y [mm],Z [mm],t"] + [f"p,{row},0" for row in rows]))
    code, said, complained = say("fit", "wide.csv")
    assert (code, complained) == (0, "")
    assert rows_of(said)[0][1:4] == ["X [mm]", "Y [mm]", "Z [mm]"]
    assert "columns left out: id, t\n" in said
    assert rows_of(said)[1]["corrected"] == rows_of(say("fit", "cap.csv")[1])[1]["corrected"]


def test_several_files(say, cap, tmp_path):
    """Each file is a line of one table; what ± is, is said once."""
    np.save(tmp_path / "half.npy", cap[:100])
    code, said, complained = say("fit", "cap.csv", "half.npy")
    assert (code, complained) == (0, "")
    head, *lines = (re.split(r" {2,}", line) for line in said.splitlines()[:-1])
    axes = ["center 1", "center 2", "center 3"]  # one file calls them x, y, z, the other 1, 2, 3
    assert head == ["file", "estimator", *axes, "radius", "noise", "samples", "remarks", "status"]
    for line, name, points in zip(lines, ["cap.csv", "half.npy"], [cap, cap[:100]], strict=True):
        assert (line[:2], line[-3:]) == ([name, "corrected"], [str(len(points)), "-", "ok"])
        assert float(line[5].split(" ± ")[0]) == pytest.approx(study.fit(points).radius, abs=1e-2)
    assert said.count("standard uncertainty") == 1
    assert say("fit", "cap.csv", "half.npy", "--plot", "out.png")[:2] == (2, "")


def test_a_file_that_cannot_be_read(say, cap, tmp_path):
    """One of 20 costs one line on standard error, in every form of output; the exit code is 2."""
    names = [f"p{i}.npy" for i in range(19)]
    for name in names:
        np.save(tmp_path / name, cap)
    (tmp_path / "bad.csv").write_text("x,y,z\n1,2,3\n4,five,6\n")
    for form, lines in (("--json", None), ("--csv", 20), ("", 21)):
        code, said, complained = say("fit", *names[:7], "bad.csv", *names[7:], *filter(None, [form]))
        assert (code, complained) == (2, "bad.csv: row 3, column 2: 'five' is not a number\n")
        assert len(json.loads(said)) == 19 if form == "--json" else len(said.splitlines()) == lines
    assert say("fit", "none.csv", "bad.csv")[:2] == (2, "")


def test_a_table_of_fits_that_are_not_ok(say, cap, tmp_path):
    """Statuses stand in a word and are explained once below; remarks on points are counted; the exit code is 3."""
    flat = np.column_stack([np.arange(9.0), np.arange(9.0) ** 2, np.zeros(9)])
    for name in ("a", "b"):
        np.save(tmp_path / f"{name}.npy", flat)
    np.save(tmp_path / "twice.npy", np.concatenate([cap, cap[:5]]))
    np.save(tmp_path / "circle.npy", cap[:, :2])
    code, said, _ = say("fit", "a.npy", "b.npy", "twice.npy", "circle.npy", "cap.csv")
    assert code == 3
    rows = [re.split(r" {2,}", line) for line in said.splitlines()[1:6]]
    assert [row[-1] for row in rows[:3]] == ["singular", "singular", "ok"]
    assert rows[2][-2] == "2"
    assert rows[3][4] == "-"
    assert said.count(f"singular: {study.Status.SINGULAR.text}\n") == 1
    assert "\nstudy fit with one of the files prints the remarks on it" in said


def test_names_that_would_be_formulas(say, cap, tmp_path):
    """Cells of names that begin like a formula get an apostrophe; numbers below zero stay numbers."""
    (tmp_path / "cap.csv").rename(tmp_path / "=1+1.csv")
    np.save(tmp_path / "@x.npy", -cap)
    code, said, _ = say("fit", "=1+1.csv", "@x.npy", "--csv")
    rows = list(csv.DictReader(io.StringIO(said)))
    assert (code, [row["file"] for row in rows]) == (0, ["'=1+1.csv", "'@x.npy"])
    assert float(rows[1]["center_1"]) < 0.0


def test_escape_sequences_are_shown(command, cap, tmp_path):
    """Columns and files cannot send a terminal anything: an escape is printed as four characters."""
    words, environment = command
    evil = "\x1b]0;owned\x07\x1b[2J"
    rows = (tmp_path / "cap.csv").read_text().splitlines()[1:]
    (tmp_path / f"{evil}.csv").write_text("\n".join([f"x,y,z,{evil}\x9b", *(f"{row},0" for row in rows)]))
    for names, code in ([f"{evil}.csv"], 0), ([f"{evil}.csv", f"{evil}.csv"], 0), ([f"{evil}.txt"], 2):
        parent, child = os.openpty()
        done = subprocess.Popen([*words, "fit", *names], cwd=tmp_path, env=environment, stdout=child, stderr=child)
        os.close(child)
        said = b""
        with contextlib.suppress(OSError):  # the end, on a pseudo-terminal
            while data := os.read(parent, 65536):
                said += data
        os.close(parent)
        assert done.wait() == code
        assert b"\x1b" not in said
        assert b"\x07" not in said
        assert "\x9b" not in said.decode()
        assert b"\\x1b]0;owned\\x07\\x1b[2J" in said


def test_outliers_and_copies(say, rng, on_cap, tmp_path):
    """Outliers are named by their rows, counted from 1 with the missing ones, copies are counted; none is no word."""
    points, _ = on_cap(rng, 36, angle=120.0, noise=0.01)
    np.save(tmp_path / "clean.npy", points)
    assert "outlier" not in (clean := say("fit", "clean.npy")[1])
    assert "repeat" not in clean
    points[[4, 16, 21]] += 5.0
    points[8] = np.nan
    np.save(tmp_path / "p.npy", np.concatenate([points, points[30:34]]))
    code, said, _ = say("fit", "p.npy")
    assert code == 3
    assert "\n1 of 40 rows lack a coordinate and are left out\n" in said
    named = "3 of 39 points are outliers (rows 5, 17, 22): the fit "
    assert f"\n{named}uses them; -e robust leaves them out\n" in said
    assert "\n4 of 39 rows repeat earlier ones; if they are no new measurement, every ± is too small\n" in said
    code, said, _ = say("fit", "p.npy", "-e", "robust")
    assert code == 0
    assert f"\n{named}leaves them out\n" in said
    found = json.loads(say("fit", "p.npy", "--json")[1])[0]
    assert (found["outliers"], found["copies"]) == ([4, 16, 21], 4)


def test_what_is_not_used_or_may_be_meant_otherwise(say, rng, on_cap, tmp_path):
    """A noise that no estimator uses is named; four columns without names are refused, unless all are asked for."""
    points, _ = on_cap(rng, 36, angle=120.0, noise=0.01)
    np.save(tmp_path / "p.npy", points)
    told = "--noise 0.3 is not used by corrected: the noise is found in the points"
    assert told in say("fit", "p.npy", "--noise", "0.3")[1]
    assert "--noise" not in say("fit", "p.npy", "--noise", "0.3", "-e", "mle")[1]
    np.save(tmp_path / "timed.npy", np.column_stack([np.arange(36) / 100.0, points]))
    code, said, complained = say("fit", "timed.npy")
    assert (code, said) == (2, "")
    assert complained.endswith(": choose, as with --columns 1,2,3, or fit all with --dimension 4\n")
    assert say("fit", "timed.npy", "--columns", "2,3,4")[0] == 0
    assert rows_of(say("fit", "timed.npy", "--dimension", "4")[1])[0][1:5] == list("1234")


def test_json(say, cap, tmp_path):
    """An object per file and estimator with the library's numbers, to the last bit; null where there is none."""
    (tmp_path / "flat.csv").write_text("id,x,y,z\n" + "\n".join(f"{i},{i},{i * i},0" for i in range(9)))
    code, said, complained = say("fit", "cap.csv", "flat.csv", "-e", "all", "--json")
    assert (code, complained) == (3, "")
    found = {(each["file"], each["estimator"]): each for each in json.loads(said)}
    fit, als = study.fit(np.loadtxt(tmp_path / "cap.csv", delimiter=",", skiprows=1), "als"), found["cap.csv", "als"]
    assert als["ok"] is True
    assert (als["status"], als["samples"], als["coordinates"]) == ("ok", 200, ["x", "y", "z"])
    assert [*als["center"], als["radius"]] == [*fit.center, fit.radius]
    assert [*als["center_errors"], als["radius_error"]] == [*fit.standard_errors]
    for name in ("diameter", "sigma", "residual_rms", "form_error", "largest_deviation", "condition"):
        assert als[name] == getattr(fit, name), name
    flat = found["flat.csv", "als"]
    assert (flat["ok"], flat["status"], flat["radius"], flat["center"]) == (False, "singular", None, [None] * 3)
    assert flat["columns_left_out"] == ["id"]


def test_csv(say, cap, tmp_path):
    """A row per file and estimator, that a program reads back to the last bit."""
    code, said, complained = say("fit", "cap.csv", "-e", "all", "--csv")
    assert (code, complained) == (3, "")
    table = {row["estimator"]: row for row in csv.DictReader(io.StringIO(said))}
    fit = study.fit(np.loadtxt(tmp_path / "cap.csv", delimiter=",", skiprows=1), "mle")
    assert float(table["mle"]["center_z"]) == fit.center[2]
    assert float(table["mle"]["radius_error"]) == fit.standard_errors[-1]
    assert {row["file"] for row in table.values()} == {"cap.csv"}
    assert say("fit", "cap.csv", "--csv", "--json")[0] == 2


def test_standard_input(command, cap, tmp_path):
    """A dash stands for standard input."""
    words, environment = command
    with open(tmp_path / "cap.csv", "rb") as file:
        done = subprocess.run([*words, "fit", "-"], stdin=file, env=environment, capture_output=True)
    assert (done.returncode, done.stderr.decode().removeprefix(f"{COMPILING}\n")) == (0, "")
    assert b"  200      ok" in done.stdout


def test_estimators(say):
    """`study estimators` has a line for each registered one."""
    code, said, complained = say("estimators")
    assert (code, complained) == (0, "")
    assert [line.split()[0] for line in said.splitlines()[1:]] == list(study.ESTIMATORS)


@pytest.mark.parametrize("encoding", ["ascii", "latin-1"])
def test_output_to_a_pipe(command, cap, tmp_path, encoding):
    """Greek letters do not stop the output where the reader is no terminal and the encoding has none.

    Latin-1 stands for Windows' code page 1252.
    """
    words, environment = command
    done = subprocess.run(
        [*words, "fit", "cap.csv", "--estimator", "all", "--noise", "0.02"],
        cwd=tmp_path,
        env={**environment, "PYTHONIOENCODING": encoding},
        capture_output=True,
    )
    assert done.stderr.decode().removeprefix(f"{COMPILING}\n") == ""
    assert done.returncode == 3  # one of them starts beyond the points, and ends at the bound
    assert len(done.stdout.splitlines()) >= 1 + len(study.ESTIMATORS)
    assert b"\x1b" not in done.stdout  # no colours
