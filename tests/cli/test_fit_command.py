"""`study fit` and `study estimators`: what a user types and sees. What is refused stands in `test_mistakes`.

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
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from PIL import Image

import study
from study.fits import registry
from study.fits.fitting import (
    answers_in_words,
    expanded_in_words,
    fit_all,
    fit_rows,
    intervals_in_words,
    printed,
    visible_in_words,
)


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
def test_fit(well, rng, on_cap, tmp_path, d):
    """The library's table of the fit, its form, its intervals, and what ± is."""
    points, _ = on_cap(rng, 90, angle=80.0, d=d, noise=0.02, center=5.0)
    np.save(tmp_path / "p.npy", points)
    fits, names = fit_all(points, ["corrected"], None), ["1", "2", "3"][:d]
    table = [*printed(fit_rows(fits, names), names), *intervals_in_words(fits["corrected"], names)]
    table += expanded_in_words(fits["corrected"], names)
    table.append(answers_in_words(fits["corrected"]))
    assert table[-1].startswith("tests: passed shape, unequal noise, tails, memory, ")
    table += visible_in_words(fits["corrected"])
    assert well(tmp_path, "fit", "p.npy").splitlines() == [*table, "± is one standard uncertainty"]
    assert table[1].split()[-2:] == ["90", "ok"]


def test_all_with_and_without_noise(call_here, tmp_path, cap):
    """Without the noise, all is all that can do without; with it, the whole registry; two variants are left out."""
    whole = {name: entry for name, entry in study.ESTIMATORS.items() if name not in ("lls_single", "mle_mirror")}
    _, rows = rows_of(call_here(tmp_path, "fit", "cap.csv", "--estimator", "all")[1])
    assert list(rows) == [name for name, entry in whole.items() if entry.needs != "noise"]
    code, said, complained = call_here(tmp_path, "fit", "cap.csv", "-e", "all", "--noise", "0.02")
    fits = [study.fit(cap, name, 0.02) for name in whole]
    assert (code, complained) == (0 if all(fit.ok for fit in fits) else 3, "")
    assert list(rows_of(said)[1]) == list(whole)
    assert all(f"{entry.caution}" in said for entry in whole.values())


def test_many_rows(well, cap, tmp_path):
    """A file of 200 000 rows is fitted, and its picture drawn with fewer of them."""
    block = "\n".join(",".join(map(repr, row)) for row in cap.tolist())
    (tmp_path / "big.csv").write_text("\n".join([block] * 1000))
    said = well(tmp_path, "fit", "big.csv", "--plot", "big.png")
    cells = rows_of(said)[1]["corrected"]
    assert cells[-2:] == ["200000", "ok"]
    assert abs(float(cells[3].split()[0]) - study.fit(cap).radius) < 1e-3
    assert (tmp_path / "big.png").stat().st_size > 10_000


@pytest.mark.parametrize(("suffix", "start"), [("png", b"\x89PNG"), ("svg", b"<?xml"), ("pdf", b"%PDF")])
def test_plot(well, cap, tmp_path, suffix, start):
    """The picture is of the kind that its name says, in a folder that is made."""
    well(tmp_path, "fit", "cap.csv", "--plot", f"new/folder/out.{suffix}")
    assert (tmp_path / "new" / "folder" / f"out.{suffix}").read_bytes().startswith(start)


@pytest.mark.parametrize("estimator", ["corrected", "all"])
def test_coplanar_points_are_drawn(call_here, rng, tmp_path, estimator):
    """Points without noise in a plane: statuses, the exit code of fits that are not ok, a picture of the points."""
    t = rng.uniform(-1, 1, 50)
    np.save(tmp_path / "arc.npy", np.column_stack([np.cos(t), np.sin(t), np.zeros(50)]))
    code, said, complained = call_here(tmp_path, "fit", "arc.npy", "-e", estimator, "--plot", "arc.png")
    assert (code, complained) == (3, "")
    assert "see below" in said
    assert "along its axis the centre is unknown" in said
    assert np.asarray(Image.open(tmp_path / "arc.png").convert("L")).std() > 5  # not blank


def test_columns_and_missing_rows(well, cap, tmp_path):
    """x, y and z are taken by name, or as they are chosen; what is left out is named, rows that miss one too."""
    lines = (tmp_path / "cap.csv").read_text().splitlines()[1:]
    (tmp_path / "wide.csv").write_text("\n".join(["id,X [mm],Y [mm],Z [mm],t"] + [f"p,{line},0" for line in lines]))
    said = well(tmp_path, "fit", "wide.csv")
    assert rows_of(said)[0][1:4] == ["X [mm]", "Y [mm]", "Z [mm]"]
    assert "columns left out: id, t\n" in said
    assert rows_of(said)[1]["corrected"] == rows_of(well(tmp_path, "fit", "cap.csv"))[1]["corrected"]
    lines[6], lines[8] = "nan,1,2", ",1,2"
    (tmp_path / "gaps.csv").write_text("\n".join(["x,y,z", *lines]))
    head, rows = rows_of(well(tmp_path, "fit", "gaps.csv", "--columns", "z, x,2"))
    assert (head[1:4], rows["corrected"][-2]) == (["z", "x", "y"], "198")
    used = np.delete(cap, [6, 8], axis=0)[:, [2, 0, 1]]
    assert abs(float(rows["corrected"][0].split()[0]) - study.fit(used).center[0]) < 0.01


def test_several_files(well, cap, tmp_path):
    """Each file is a line of one table; what ± is, is said once."""
    np.save(tmp_path / "half.npy", cap[:100])
    said = well(tmp_path, "fit", "cap.csv", "half.npy")
    head, *lines = (re.split(r" {2,}", line) for line in said.splitlines()[:-1])
    axes = ["center 1", "center 2", "center 3"]  # one file calls them x, y, z, the other 1, 2, 3
    assert head == ["file", "estimator", *axes, "radius", "noise", "samples", "remarks", "status"]
    for line, name, points in zip(lines, ["cap.csv", "half.npy"], [cap, cap[:100]], strict=True):
        assert (line[:2], line[-3:]) == ([name, "corrected"], [str(len(points)), "-", "ok"])
        assert float(line[5].split(" ± ")[0]) == pytest.approx(study.fit(points).radius, abs=1e-2)
    assert said.count("standard uncertainty") == 1


def test_a_file_that_cannot_be_read(call_here, cap, tmp_path):
    """One of 20 costs one line on standard error, in every form of output; the exit code is 2."""
    names = [f"p{i}.npy" for i in range(19)]
    for name in names:
        np.save(tmp_path / name, cap)
    (tmp_path / "bad.csv").write_text("x,y,z\n1,2,3\n4,five,6\n")
    for form, lines in (("--json", None), ("--csv", 20), ("", 21)):
        code, said, complained = call_here(tmp_path, "fit", *names[:7], "bad.csv", *names[7:], *filter(None, [form]))
        assert (code, complained) == (2, "bad.csv: row 3, column 2: 'five' is not a number\n")
        assert len(json.loads(said)) == 19 if form == "--json" else len(said.splitlines()) == lines


def test_a_table_of_fits_that_are_not_ok(call_here, cap, tmp_path):
    """Statuses stand in a word and are explained once below; remarks on points are counted; the exit code is 3."""
    flat = np.column_stack([np.arange(9.0), np.arange(9.0) ** 2, np.zeros(9)])
    files = {"a.npy": flat, "b.npy": flat, "twice.npy": np.concatenate([cap, cap[:5]]), "circle.npy": cap[:, :2]}
    for name, points in files.items():
        np.save(tmp_path / name, points)
    code, said, _ = call_here(tmp_path, "fit", *files, "cap.csv")
    assert code == 3
    rows = [re.split(r" {2,}", line) for line in said.splitlines()[1:6]]
    assert [row[-1] for row in rows[:3]] == ["singular", "singular", "ok"]
    assert rows[2][-2] == "2"
    assert rows[3][4] == "-"
    assert said.count(f"singular: {study.Status.SINGULAR.text}\n") == 1
    assert "\nstudy fit with one of the files prints the remarks on it" in said


def test_names_that_would_be_formulas(well, cap, tmp_path):
    """Cells of names that begin like a formula get an apostrophe; numbers below zero stay numbers."""
    (tmp_path / "cap.csv").rename(tmp_path / "=1+1.csv")
    np.save(tmp_path / "@x.npy", -cap)
    rows = list(csv.DictReader(io.StringIO(well(tmp_path, "fit", "=1+1.csv", "@x.npy", "--csv"))))
    assert [row["file"] for row in rows] == ["'=1+1.csv", "'@x.npy"]
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
        assert not {"\x1b", "\x07", "\x9b"} & set(said.decode())
        assert b"\\x1b]0;owned\\x07\\x1b[2J" in said


def test_outliers_and_copies(call_here, rng, on_cap, tmp_path):
    """Outliers are named by their rows, counted from 1 with the missing ones; copies are counted."""
    points, _ = on_cap(rng, 36, angle=120.0, noise=0.01)
    points[[4, 16, 21]] += 5.0
    points[8] = np.nan
    np.save(tmp_path / "p.npy", np.concatenate([points, points[30:34]]))
    code, said, _ = call_here(tmp_path, "fit", "p.npy")
    assert code == 3
    assert "\n1 of 40 rows lack a coordinate and are left out\n" in said
    line = next(line for line in said.splitlines() if line.startswith("3 of 39 points are outliers"))
    assert "(rows 5, 17, 22): the fit uses them; -e robust leaves them out; without them it moves by " in line
    assert "\n4 of 39 rows repeat earlier ones; if they are no new measurement, every ± is too small\n" in said
    told = json.loads(call_here(tmp_path, "fit", "p.npy", "--json")[1])[0]
    assert (told["outliers"], told["copies"]) == ([4, 16, 21], 4)


def test_what_may_be_meant_otherwise(call_here, well, rng, on_cap, tmp_path):
    """A noise that is given is named; four columns without names are refused, unless all are asked for."""
    points, _ = on_cap(rng, 36, angle=120.0, noise=0.01)
    np.save(tmp_path / "p.npy", points)
    told = "noise 0.01 is given, and the residuals are "
    assert told in well(tmp_path, "fit", "p.npy", "--noise", "0.01")
    assert "noise 0.3 is given" in call_here(tmp_path, "fit", "p.npy", "--noise", "0.3")[1]
    assert "--noise" not in well(tmp_path, "fit", "p.npy", "--noise", "0.3", "-e", "mle")
    np.save(tmp_path / "timed.npy", np.column_stack([np.arange(36) / 100.0, points]))
    well(tmp_path, "fit", "timed.npy", "--columns", "2,3,4")
    assert rows_of(well(tmp_path, "fit", "timed.npy", "--dimension", "4"))[0][1:5] == list("1234")


def test_json_and_csv(call_here, cap, tmp_path):
    """An object, or a row, per file and estimator with the library's numbers to the last bit; null where none is."""
    (tmp_path / "flat.csv").write_text("id,x,y,z\n" + "\n".join(f"{i},{i},{i * i},0" for i in range(9)))
    told = {form: call_here(tmp_path, "fit", "cap.csv", "flat.csv", "-e", "all", form) for form in ("--json", "--csv")}
    assert all((code, complained) == (3, "") for code, _, complained in told.values())
    fits = {(fit["file"], fit["estimator"]): fit for fit in json.loads(told["--json"][1])}
    fit, als = study.fit(np.loadtxt(tmp_path / "cap.csv", delimiter=",", skiprows=1), "als"), fits["cap.csv", "als"]
    assert als["ok"] is True
    assert (als["status"], als["samples"], als["coordinates"]) == ("ok", 200, ["x", "y", "z"])
    assert [*als["center"], als["radius"]] == [*fit.center, fit.radius]
    assert [*als["center_errors"], als["radius_error"]] == [*fit.standard_errors]
    sizes = {"diameter": 2 * fit.radius, "sigma": fit.sigma, "residual_rms": fit.residual_rms}
    sizes |= {"form_error": np.ptp(fit.residuals), "condition": fit.estimates.condition}
    assert {name: als[name] for name in sizes} == sizes
    assert als["largest_deviation"] == np.abs(fit.residuals).max()
    flat = fits["flat.csv", "als"]
    assert (flat["ok"], flat["status"], flat["radius"], flat["center"]) == (False, "singular", None, [None] * 3)
    assert flat["columns_left_out"] == ["id"]
    rows = {(row["file"], row["estimator"]): row for row in csv.DictReader(io.StringIO(told["--csv"][1]))}
    assert rows.keys() == fits.keys()
    row = rows["cap.csv", "als"]
    assert (float(row["center_z"]), float(row["radius_error"])) == (fit.center[2], fit.standard_errors[-1])


def test_standard_input(well, cap, tmp_path):
    """A dash stands for standard input."""
    assert "  200      ok" in well(tmp_path, "fit", "-", stdin=(tmp_path / "cap.csv").read_text())


@pytest.mark.parametrize("encoding", ["ascii", "latin-1"])
def test_output_to_a_pipe(call, command, cap, tmp_path, encoding):
    """Greek letters do not stop the output where the reader is no terminal and the encoding has none.

    Latin-1 stands for Windows' code page 1252.
    """
    environment = {**command[1], "PYTHONIOENCODING": encoding}
    code, said, complained = call(tmp_path, "fit", "cap.csv", env=environment, encoding=encoding)
    assert (code, complained, "\x1b" in said) == (0, "", False)  # no colours
    assert len(said.splitlines()) == 11


PAGE = (Path(__file__).parents[2] / "docs" / "own.md").read_text(encoding="utf-8")

PLUGIN, CONFIG = (re.search(rf"```{kind}\n(.*?)```", PAGE, re.DOTALL)[1] for kind in ("python", "toml"))


def forget():
    """Forget the files that were loaded."""
    for path, _ in registry.loaded():
        registry.unload(path)


@pytest.fixture
def folder(tmp_path):
    """A folder with the page's file and config; what was loaded is forgotten afterwards."""
    (tmp_path / "my.py").write_text(PLUGIN, encoding="utf-8")
    (tmp_path / "own.toml").write_text(CONFIG, encoding="utf-8")
    yield tmp_path
    forget()


def test_the_page(call, well, folder):
    """Its example is checked, run, summarised, drawn and fitted as it says, without a line changed in the package."""
    assert well(folder, "check", "my.py") == "coope: all 9 properties hold on 12 data sets\n"
    code, said, complained = call(folder, "run", "own.toml", "--plugin", "my.py", "--backend", "loky", "--jobs", "1")
    assert (code, complained) == (0, "")
    run = folder / said.strip()
    errors = pd.read_parquet(run / "errors.parquet")
    mine, theirs = (errors[errors["estimator"] == name]["error"].to_numpy() for name in ("coope", "gdke"))
    assert len(mine) == 800
    assert abs(mine - theirs).max() < 1e-9  # Coope's fit is Kåsa's
    origin = {"from": "my.py", "sha256": hashlib.sha256(PLUGIN.encode()).hexdigest(), "estimators": ["coope"]}
    assert json.loads((run / "manifest.json").read_text())["own_estimators"] == [origin]
    assert len(well(folder, "figures", "own.toml", "fig_efficiency", "--plugin", "my.py").splitlines()) == 3


def test_in_this_process(well, call_here, folder):
    """Reading and replaying a run needs the file; a file that changed has its rows computed again."""
    well(folder, "run", "own.toml", "--plugin", "my.py", "--out", "out")
    for words in (("summary", "out"), ("status", "out"), ("worst", "out"), ("plan", "own.toml"), ("estimators",)):
        said = well(folder, *words, "--plugin", "my.py")
    assert "coope" in said
    cell = str(pd.read_parquet(folder / "out" / "errors.parquet")["cell"].iloc[0])
    assert "coope" in well(folder, "replay", "out", f"{cell}/3", "--plugin", "my.py", "--out", "points.csv")
    well(folder, "fit", "points.csv", "-e", "my.py:coope")
    before = pd.read_parquet(folder / "out" / "errors.parquet")
    (folder / "my.py").write_text(PLUGIN.replace("return center, ", "return center, 1.5 * "), encoding="utf-8")
    call_here(folder, "run", "own.toml", "--plugin", "my.py", "--out", "out")
    after = pd.read_parquet(folder / "out" / "errors.parquet")
    (folder / "my.py").write_text(PLUGIN.replace("return center, ", "return center, 2.0 * "), encoding="utf-8")
    forget()
    said = call_here(folder, "verify", "out", "--share", "1", "--plugin", "my.py")[1]
    assert "my.py: changed since the run was made: numbers computed now may differ" in said
    assert "not verified" in said
    changed = (after["radius_error"] != before["radius_error"]).groupby(after["estimator"], observed=True).mean()
    assert dict(changed) == {"coope": 1.0, "gdke": 0.0, "als": 0.0}


def test_the_commands_that_make_a_run_again(refused, well, call_here, folder):
    """A message and the report name the file, so that the command in them works as it stands; without it none reads."""
    call_here(folder, "run", "own.toml", "--plugin", "my.py", "--out", "out")
    well(folder, "report", "out", "--plugin", "my.py")
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
    forget()
    words = "out: ... was made with estimators, laws or measures of my.py: give --plugin my.py"
    refused(folder, 1, words, "status", "out")  # begun and not finished
    well(folder, *command.split()[1:])
    forget()
    refused(folder, 1, words, "summary", "out")
    refused(folder, 1, words, "status", "out")
    (folder / "out" / "own.json").unlink()  # a run of an older version, which says it in its manifest
    refused(folder, 1, words, "status", "out")


def test_a_violation_is_code_1(call_here, folder):
    """A violated property is said in words, and the command's exit code is 1."""
    (folder / "my.py").write_text(PLUGIN.replace("return center, ", "return center, 1.02 * "), encoding="utf-8")
    code, said, complained = call_here(folder, "check", "my.py")
    assert (code, complained) == (1, "")
    assert said == "coope: not exact without noise: the radius is 1.02 instead of 1 (d = 2, N = 7, seed 0)\n"


OWN = """import sys
import study
def mine(points):
    {body}
    fit = study.fit(points, 'gdke')
    return fit.center, fit.radius
study.register('mine', mine)
"""


@pytest.mark.parametrize(
    ("body", "code", "line"),
    [
        ("if len(points) == 7: sys.exit(0)", 1, "mine: no answer on sound points: the estimator raised"),
        ("while len(points) == 7: pass", 1, "mine: has not returned after 0.5 s (d = 2, N = 7, seed 0); the check e"),
        ("print('a fit'); sys.stdout.write('again')", 0, "mine: all 9 properties hold on 12 data sets"),
    ],
    ids=["exit", "loop", "prints"],
)
def test_check_tells_an_exit_a_loop_and_prints_from_results(call_here, folder, body, code, line):
    """An exit and a loop are violations that are named (code 1); prints go to standard error."""
    (folder / "my.py").write_text("print('loaded')\n" + OWN.format(body=body), encoding="utf-8")
    limit = ["--limit", "0.5"] if "while" in body else []
    end, said, complained = call_here(folder, "check", "my.py", *limit)
    assert (end, said.startswith(line)) == (code, True)
    assert not any(word in said for word in ("loaded", "a fit", "again"))
    assert complained.startswith("loaded\n")


@pytest.mark.parametrize("backend", ["threads", pytest.param("loky", marks=pytest.mark.slow)])
def test_a_run_survives_an_exit_and_prints(call, folder, backend):
    """Fits that exit are failed fits with a message, in threads and in processes; prints do not mix with the folder."""
    body = "print('a fit')\n    if len(points) != 20 and points[0, 0] > points[1, 0]: sys.exit(3)"
    (folder / "my.py").write_text(OWN.format(body=body).replace("'mine', mine", "'coope', mine"), encoding="utf-8")
    code, said, complained = call(folder, "run", "own.toml", "--plugin", "my.py", "--out", "out", "--backend", backend)
    assert (code, said) == (3, "out\n")  # more failures than the config tolerates
    assert "a fit" in complained
    failures = pd.read_parquet(folder / "out" / "failures.parquet")
    assert set(failures["message"]) == {"SystemExit: 3"}
    errors = pd.read_parquet(folder / "out" / "errors.parquet")
    assert 0.2 < len(failures) / (errors["estimator"] == "coope").sum() < 0.8
    assert f"{len(failures)} of 2,400 fits raised an exception" in complained


def test_prints_do_not_mix_with_json(call_here, folder):
    """`study fit --json` prints an object and nothing else."""
    (folder / "my.py").write_text(OWN.format(body="print('a fit')"), encoding="utf-8")
    (folder / "points.csv").write_text("x,y\n1,0\n0,1\n-1,0\n0,-1.1\n0.7,0.7\n-0.7,0.72\n", encoding="utf-8")
    code, said, complained = call_here(folder, "fit", "points.csv", "-e", "my.py:mine", "--json")
    assert (code, len(json.loads(said)), "a fit" in complained) == (3, 1, True)  # six points are untested


def test_certify(well, call_here, tmp_path):
    """Pairs are written and read back; a mutated one is code 1, one that cannot be read code 2."""
    said = well(tmp_path, "certify", "-e", "gdke", "--out", "pairs", "--table", "errors.csv")
    assert "gdke *" in said
    assert len((tmp_path / "errors.csv").read_text().splitlines()) == 91
    assert well(tmp_path, "certify", "pairs/gdke", "-e", "gdke") == said
    name = "sphere-cap180-offset0-form0.05"
    fit = tmp_path / "pairs" / "gdke" / f"{name}.fit"
    *center, diameter = fit.read_text().split()
    fit.write_text("\n".join([*center, f"{float(diameter) * 1.000001!r}"]))
    code, said, complained = call_here(tmp_path, "certify", "pairs/gdke", "--estimator", "gdke")
    assert (code, complained) == (1, "")
    assert said.splitlines()[-1].startswith(f"{name}: gdke differs by 1.00e-06 of the radius")
    fit.unlink()
    words = f"{fit.relative_to(tmp_path)}: no such file; a pair is NAME.ds and NAME.fit in one folder\n"
    assert call_here(tmp_path, "certify", "pairs/gdke", "-e", "gdke")[::2] == (2, words)


def test_numbers_for_a_report(tmp_path, well, cap):
    """Radius and diameter have an expanded uncertainty: the longer side of the interval, in the unit of the headers."""
    text = (tmp_path / "cap.csv").read_text(encoding="utf-8")
    (tmp_path / "mm.csv").write_text("X [mm],Y [mm],Z [mm]\n" + text.partition("\n")[2], encoding="utf-8")
    lines = well(tmp_path, "fit", "mm.csv").splitlines()
    fit = study.fit(cap)
    size = max(fit.interval("radius")[1] - fit.radius, fit.radius - fit.interval("radius")[0])
    for name, factor in (("radius", 1.0), ("diameter", 2.0)):
        (line,) = (line for line in lines if line.startswith(f"{name} ") and "U = " in line)
        value, expanded = (float(part) for part in re.findall(r"([\d.]+) mm", line))
        assert value == pytest.approx(factor * fit.radius, abs=0.01 * size)
        assert expanded == pytest.approx(factor * size, rel=0.06)  # two digits
        assert line.endswith(" mm (k = 2, by the interval)")


def test_fit_with_a_known_radius(tmp_path, well, call_here, cap):
    """The centre is that of the library, the radius has no error; a line and the exit code say if the points agree."""
    out = well(tmp_path, "fit", "cap.csv", "--radius", "2")
    assert rows_of(out)[1]["corrected"][3] == "2"
    assert "radius 2 is given; with a free one the points have" in out
    told = json.loads(well(tmp_path, "fit", "cap.csv", "--radius", "2", "--json"))[0]
    np.testing.assert_allclose(told["center"], study.fit(cap, radius=2.0).center, rtol=1e-12)
    code, said, _ = call_here(tmp_path, "fit", "cap.csv", "--radius", "2.1")
    assert (code, "the points do not agree with it" in said) == (3, True)


def test_fit_with_noise_for_each_point(well, cap, rng, tmp_path):
    """A column sigma is used and not left out; --scale estimated takes its ratios alone; a value of 0 is refused."""
    sigma = rng.uniform(0.019, 0.021, 200)
    table = np.column_stack([cap, sigma])
    np.savetxt(tmp_path / "uneven.csv", table, delimiter=",", header="x,y,z,sigma", comments="", fmt="%.17g")
    out = well(tmp_path, "fit", "uneven.csv")
    assert "columns left out" not in out
    assert "each point has a noise of its own" in out
    assert "--noise 0.3 is not used where columns" in well(tmp_path, "fit", "uneven.csv", "--noise", "0.3")
    for scale in ("given", "estimated"):
        told = json.loads(well(tmp_path, "fit", "uneven.csv", "--scale", scale, "--json"))[0]
        np.testing.assert_allclose(told["center"], study.fit(cap, noise=sigma, scale=scale).center, rtol=1e-9)


def test_plan_fit(well, tmp_path):
    """The plan is the library's."""
    words = ("plan-fit", "--noise", "0.1", "--radius", "50", "--angle", "60")
    plan = study.plan_fit(0.1, 50.0, 0.02, angle=60.0)
    assert f"{plan.points:,} points on a cap of 60°" in well(tmp_path, *words, "--error", "0.02")
    told = json.loads(well(tmp_path, *words, "--points", "400", "--json"))
    plan = study.plan_fit(0.1, 50.0, points=400, angle=60.0)
    found = told.pop("simulated") | {name: told.pop(name) for name in ("ok_share", "ok_error")}
    assert told == plan._asdict()
    assert found == plan.simulated()._asdict()


def test_a_radius_with_an_uncertainty_and_forms_that_move(well, call_here, rng, on_cap, tmp_path):
    """The command hands over what the library takes, and prints its numbers; what does not go together is refused."""
    points = on_cap(rng, 60, angle=80.0, noise=0.02)[0]
    np.save(tmp_path / "p.npy", points)
    stated = study.fit(points, radius=(1.0, 0.01))
    said = well(tmp_path, "fit", "p.npy", "--radius", "1", "--radius-error", "0.01", "--sensitivity")
    assert "radius 1.000 ± 0.010 is given" in said
    assert f"{float(stated.radius):.4f} ± {float(stated.standard_errors[3]):.4f}" in said
    for degree, sizes in zip((2, 3), stated.sensitivity(), strict=True):
        parts = [f"{name} {size:.2g} σ" for name, size in zip(["1", "2", "3", "radius"], sizes, strict=True)]
        line = f"form of degree {degree}, rms over the whole sphere, that moves a number by its ±: "
        assert f"\n{line}{', '.join(parts)}\n" in said
    for words, reason in (
        (["--radius-error", "0.1"], "--radius-error 0.1: give the radius too"),
        (["--sensitivity", "--json"], "--sensitivity prints lines about one file"),
        (["--law", "along"], "--law along: isotropic, or radial"),
        (["--law", "radial", "-e", "als"], "takes no law = 'radial'; mle and corrected do"),
        (["--radius", "1", "--radius-error", "-1"], "standard uncertainty must be positive"),
    ):
        code, _, complaint = call_here(tmp_path, "fit", "p.npy", *words)
        assert code == 2
        assert reason in " ".join(complaint.replace("│", " ").split())


def test_noise_along_the_radius_is_told(well, call_here, rng, on_cap, tmp_path):
    """With --law radial the radius is that of `mle`, and a line says so; of all estimators, those that take it fit."""
    u = on_cap(rng, 400, angle=150.0, noise=0.0)[0]
    points = u * (1.0 + 0.06 * rng.standard_normal((400, 1)))
    np.save(tmp_path / "p.npy", points)
    said = well(tmp_path, "fit", "p.npy", "--law", "radial")
    assert "\nthe noise is taken to be along the radius alone\n" in said
    told = json.loads(well(tmp_path, "fit", "p.npy", "--law", "radial", "-e", "all", "--json"))
    assert [one["estimator"] for one in told] == ["mle", "corrected"]
    for one in told:
        np.testing.assert_allclose(one["radius"], study.fit(points, "mle").radius, rtol=1e-7)
