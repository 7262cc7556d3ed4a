"""`study fit` and `study estimators`: what a user types, sees and is refused.

Most commands run in this process, which is what a second process would print; a few run through a pipe.

Estimators of one's own on the command line: the page about them holds, in threads and in processes.
"""

import contextlib
import csv
import hashlib
import io
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from PIL import Image

import study
from study import cli
from study.fits import registry
from study.fits.jit import COMPILING


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
    assert "along its axis the centre is unknown" in said
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


PAGE = (Path(__file__).parents[2] / "docs" / "own-estimators.md").read_text(encoding="utf-8")

PLUGIN, CONFIG = (re.search(rf"```{kind}\n(.*?)```", PAGE, re.DOTALL)[1] for kind in ("python", "toml"))


@pytest.fixture
def folder(tmp_path):
    """A folder with the page's file and config; what was loaded is forgotten afterwards."""
    (tmp_path / "my.py").write_text(PLUGIN, encoding="utf-8")
    (tmp_path / "own.toml").write_text(CONFIG, encoding="utf-8")
    yield tmp_path
    for path, _ in registry.loaded():
        registry.unload(path)


def test_the_page(call, folder):
    """Its example is checked, run, summarised, drawn and fitted as it says, without a line changed in the package."""
    code, said, complained = call(folder, "check", "my.py")
    assert (code, said, complained) == (0, "coope: all 9 properties hold on 12 data sets\n", "")
    code, said, complained = call(folder, "run", "own.toml", "--plugin", "my.py", "--backend", "loky")
    assert (code, complained) == (0, "")
    run = folder / said.strip()
    errors = pd.read_parquet(run / "errors.parquet")
    mine, theirs = (errors[errors["estimator"] == name]["error"].to_numpy() for name in ("coope", "gdke"))
    assert len(mine) == 800
    assert abs(mine - theirs).max() < 1e-9  # Coope's fit is Kåsa's
    (origin,) = json.loads((run / "manifest.json").read_text())["own_estimators"]
    digest = hashlib.sha256(PLUGIN.encode()).hexdigest()
    assert origin == {"from": "my.py", "sha256": digest, "estimators": ["coope"]}
    code, said, complained = call(folder, "figures", "own.toml", "fig_efficiency", "--plugin", "my.py")
    assert (code, complained) == (0, "")
    assert len(said.splitlines()) == 2


def test_in_this_process(call_here, folder):
    """Reading and replaying a run needs the file; a file that changed has its rows computed again."""
    assert call_here(folder, "run", "own.toml", "--plugin", "my.py", "--out", "out")[0] == 0
    for words in (("summary", "out"), ("status", "out"), ("worst", "out"), ("plan", "own.toml"), ("estimators",)):
        code, said, complained = call_here(folder, *words, "--plugin", "my.py")
        assert (code, complained) == (0, "")
    assert "coope" in said
    cell = str(pd.read_parquet(folder / "out" / "errors.parquet")["cell"].iloc[0])
    code, said, complained = call_here(folder, "replay", "out", f"{cell}/3", "--plugin", "my.py", "--out", "points.csv")
    assert (code, complained) == (0, "")
    assert "coope" in said
    code, said, complained = call_here(folder, "fit", "points.csv", "-e", "my.py:coope")
    assert (code, complained) == (0, "")
    before = pd.read_parquet(folder / "out" / "errors.parquet")
    (folder / "my.py").write_text(PLUGIN.replace("return center, ", "return center, 1.5 * "), encoding="utf-8")
    assert call_here(folder, "run", "own.toml", "--plugin", "my.py", "--out", "out")[0] == 0
    after = pd.read_parquet(folder / "out" / "errors.parquet")
    changed = (after["radius_error"] != before["radius_error"]).groupby(after["estimator"], observed=True).mean()
    assert dict(changed) == {"coope": 1.0, "gdke": 0.0, "als": 0.0}


def test_without_the_file(call_here, folder):
    """A name that nobody registered is a fault of the config; a finished run names the file that has it."""
    code, said, complained = call_here(folder, "run", "own.toml")
    assert (code, said) == (2, "")
    assert "estimators = " in complained
    assert "'coope' unknown" in complained
    assert sorted(path.name for path in folder.iterdir()) == ["my.py", "own.toml"]
    call_here(folder, "run", "own.toml", "--plugin", "my.py", "--out", "out")
    for path, _ in registry.loaded():
        registry.unload(path)
    code, said, complained = call_here(folder, "summary", "out")
    assert (code, said) == (1, "")
    assert "it was made with estimators of my.py: give --plugin FILE" in complained


def test_the_commands_that_make_a_run_again(call_here, folder):
    """A message and the report name the file, so that the command in them works as it stands."""
    call_here(folder, "run", "own.toml", "--plugin", "my.py", "--out", "out")
    assert call_here(folder, "report", "out", "--plugin", "my.py")[0] == 0
    page = (folder / "out" / "report.html").read_text(encoding="utf-8")
    assert "study run out/config.toml --jobs 2 --plugin my.py --out out-again" in page
    (folder / "out" / "errors.parquet").unlink()
    command = call_here(folder, "worst", "out", "--plugin", "my.py")[2].split("`")[1]
    assert command == "study run out/config.toml --out out --plugin my.py"
    path = folder / "out" / "manifest.json"
    path.write_text(path.read_text(encoding="utf-8").replace('"jobs": 2', '"jobs": 3'), encoding="utf-8")
    assert command in call_here(folder, "verify", "out", "--plugin", "my.py")[2]
    path.unlink()
    assert command in call_here(folder, "verify", "out", "--plugin", "my.py")[2]
    for loaded, _ in registry.loaded():
        registry.unload(loaded)
    assert call_here(folder, *command.split()[1:])[0] == 0


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("raise RuntimeError('no')", "bad.py: line 1: RuntimeError: no"),
        ("import study\nstudy.register('als', len)", "bad.py: line 2: ValueError: register('als'): the name is taken"),
        ("import study\nstudy.register('mine', len)", "bad.py: mine: fails on 20 sound points: TypeError: "),
    ],
)
@pytest.mark.parametrize("verb", ["run", "check", "fit"])
def test_refused(call_here, folder, verb, text, words):
    """A file that cannot be used is code 2 and one line, and nothing is written."""
    (folder / "bad.py").write_text(text, encoding="utf-8")
    (folder / "points.csv").write_text("x,y\n1,0\n0,1\n-1,0\n0,-1\n", encoding="utf-8")
    before = sorted(folder.iterdir())
    arguments = {
        "run": ["own.toml", "--plugin", "bad.py"],
        "check": ["bad.py"],
        "fit": ["points.csv", "-e", "bad.py:mine"],
    }
    code, said, complained = call_here(folder, verb, *arguments[verb])
    assert (code, said) == (2, "")
    assert complained.startswith(words)
    assert len(complained.splitlines()) == 1
    assert sorted(folder.iterdir()) == before


def test_a_violation_is_code_1(call_here, folder):
    """A violated property is said in words, and the command's exit code is 1."""
    (folder / "my.py").write_text(PLUGIN.replace("return center, ", "return center, 1.02 * "), encoding="utf-8")
    code, said, complained = call_here(folder, "check", "my.py")
    assert (code, complained) == (1, "")
    assert said == "coope: not exact without noise: the radius is 1.02 instead of 1 (d = 2, N = 7, seed 0)\n"


ALS = "import sys, time\nimport numpy as np\nimport study\n\ndef mine(points):\n{body}"

ALS += "\n    fit = study.fit(points, 'gdke')\n    return fit.center, fit.radius\n\nstudy.register('mine', mine)\n"

FEW = "    if len(points) == 7: {words}"
"""Words that stand only in fits of seven points, so that the file is loaded."""


@pytest.mark.parametrize(
    ("body", "options", "line"),
    [
        (FEW.format(words="sys.exit(0)"), [], "mine: no answer on sound points: the estimator raised"),
        (
            FEW.format(words="\n        while True: pass"),
            ["--limit", "0.5"],
            "mine: has not returned after 0.5 s (d = 2, N = 7, seed 0); the check ends here",
        ),
        ("    print('a fit'); sys.stdout.write('again')", [], "mine: all 9 properties hold on 12 data sets"),
    ],
    ids=["exit", "loop", "prints"],
)
def test_check_tells_an_exit_a_loop_and_prints_from_results(call_here, folder, body, options, line):
    """An exit and a loop are violations that are named (code 1); prints go to standard error."""
    (folder / "my.py").write_text("print('loaded')\n" + ALS.format(body=body), encoding="utf-8")
    code, said, complained = call_here(folder, "check", "my.py", *options)
    assert code == (0 if "all 9" in line else 1)
    assert said.startswith(line)
    assert "loaded" not in said
    assert "a fit" not in said
    assert "again" not in said
    assert complained.startswith("loaded\n")


@pytest.mark.parametrize("text", ["while True: pass\n", ALS.format(body="    while True: pass")], ids=["file", "fit"])
def test_a_loop_on_the_first_call_is_refused(call_here, folder, monkeypatch, text):
    """A file, or an estimator, that does not return on sound points is refused in one line by every command."""
    monkeypatch.setattr(registry, "LIMIT", 0.5)
    (folder / "bad.py").write_text(text, encoding="utf-8")
    for words in (["check", "bad.py"], ["run", "own.toml", "--plugin", "bad.py"]):
        code, said, complained = call_here(folder, *words)
        assert (code, said) == (2, "")
        assert "has not returned after 0.5 s" in complained
        assert len(complained.splitlines()) == 1


@pytest.mark.parametrize("backend", ["threads", "loky"])
def test_a_run_survives_an_exit_and_prints(call, folder, backend):
    """Fits that exit are failed fits with a message, in threads and in processes; prints do not mix with the folder."""
    body = "    print('a fit')\n    if len(points) != 20 and points[0, 0] > points[1, 0]: sys.exit(3)"
    (folder / "my.py").write_text(ALS.format(body=body).replace("'mine', mine", "'coope', mine"), encoding="utf-8")
    code, said, complained = call(folder, "run", "own.toml", "--plugin", "my.py", "--out", "out", "--backend", backend)
    assert said == "out\n"
    assert "a fit" in complained
    failures = pd.read_parquet(folder / "out" / "failures.parquet")
    assert set(failures["message"]) == {"SystemExit: 3"}
    errors = pd.read_parquet(folder / "out" / "errors.parquet")
    assert 0.2 < len(failures) / (errors["estimator"] == "coope").sum() < 0.8
    assert code == 3  # more failures than the config tolerates
    assert f"{len(failures)} of 2,400 fits raised an exception" in complained


def test_prints_do_not_mix_with_json(call_here, folder):
    """`study fit --json` prints an object and nothing else."""
    (folder / "my.py").write_text(ALS.format(body="    print('a fit')"), encoding="utf-8")
    (folder / "points.csv").write_text("x,y\n1,0\n0,1\n-1,0\n0,-1.1\n0.7,0.7\n", encoding="utf-8")
    code, said, complained = call_here(folder, "fit", "points.csv", "-e", "my.py:mine", "--json")
    assert code == 0
    assert json.loads(said)
    assert "a fit" in complained


def test_certify(call_here, tmp_path):
    """Pairs are written and read back; a mutated one is code 1, one that cannot be read code 2, a wrong name a line."""
    code, said, complained = call_here(tmp_path, "certify", "-e", "gdke", "--out", "pairs", "--table", "errors.csv")
    assert (code, complained) == (0, "")
    assert "gdke *" in said
    assert len((tmp_path / "errors.csv").read_text().splitlines()) == 91
    assert call_here(tmp_path, "certify", "pairs/gdke", "-e", "gdke")[:2] == (0, said)
    name = "sphere-cap180-offset0-form0.05"
    fit = tmp_path / "pairs" / "gdke" / f"{name}.fit"
    *center, diameter = fit.read_text().split()
    fit.write_text("\n".join([*center, f"{float(diameter) * 1.000001!r}"]))
    code, said, complained = call_here(tmp_path, "certify", "pairs/gdke", "--estimator", "gdke")
    assert (code, complained) == (1, "")
    assert said.splitlines()[-1].startswith(f"{name}: gdke differs by 1.00e-06 of the radius")
    fit.unlink()
    code, said, complained = call_here(tmp_path, "certify", "pairs/gdke", "-e", "gdke")
    assert code == 2
    assert complained.splitlines() == [
        f"{fit.relative_to(tmp_path)}: no such file; a pair is NAME.ds and NAME.fit in one folder"
    ]
    code, said, complained = call_here(tmp_path, "certify", "-e", "corrected")
    assert (code, said) == (2, "")
    assert "known are mle, gdke, minimum_zone" in complained
    assert call_here(tmp_path, "certify", "--limit", "0")[0] == 2


def test_fit_with_a_known_radius(say, cap):
    """The centre is that of the library, the radius has no error, and a line says whether the points agree with it."""
    code, out, _ = say("fit", "cap.csv", "--radius", "2")
    assert code == 0
    assert rows_of(out)[1]["corrected"][3] == "2"
    assert "radius 2 is given; with a free one the points have" in out
    found = json.loads(say("fit", "cap.csv", "--radius", "2", "--json")[1])[0]
    np.testing.assert_allclose(found["center"], study.fit(cap, radius=2.0).center, rtol=1e-12)
    assert "the points do not agree with it" in say("fit", "cap.csv", "--radius", "2.1")[1]
    code, _, err = say("fit", "cap.csv", "--radius", "2", "-e", "robust")
    assert (code, err.count("\n")) == (2, 1)
    assert "takes no known radius; corrected, mle, als, ugdk and gdke do" in err


def test_fit_with_noise_for_each_point(say, cap, rng, tmp_path):
    """A column sigma is used and not left out; --scale estimated takes its ratios alone; a value of 0 is refused."""
    sigma = rng.uniform(0.019, 0.021, 200)
    table = np.column_stack([cap, sigma])
    np.savetxt(tmp_path / "uneven.csv", table, delimiter=",", header="x,y,z,sigma", comments="", fmt="%.17g")
    code, out, _ = say("fit", "uneven.csv")
    assert code == 0
    assert "columns left out" not in out
    assert "each point has a noise of its own" in out
    for scale in ("given", "estimated"):
        found = json.loads(say("fit", "uneven.csv", "--scale", scale, "--json")[1])[0]
        np.testing.assert_allclose(found["center"], study.fit(cap, noise=sigma, scale=scale).center, rtol=1e-9)
    code, _, err = say("fit", "cap.csv", "--scale", "estimated")
    assert (code, err) == (2, "scale = 'estimated' needs a noise for each point: (n,), (n, d) or (n, d, d)\n")


def test_plan_fit(say):
    """The plan is the library's; two of three are needed."""
    arguments = ("plan-fit", "--noise", "0.1", "--radius", "50")
    code, out, _ = say(*arguments, "--error", "0.02", "--angle", "60")
    plan = study.plan_fit(0.1, 50.0, 0.02, angle=60.0)
    assert code == 0
    assert f"{plan.points:,} points on a cap of 60°" in out
    found = json.loads(say(*arguments, "--points", "400", "--angle", "60", "--json")[1])
    assert found == study.plan_fit(0.1, 50.0, points=400, angle=60.0)._asdict()
    code, _, err = say(*arguments)
    assert code == 2
    assert "a plan needs two of error=, angle= and points=" in " ".join(err.split())
