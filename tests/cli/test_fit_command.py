"""`study fit` and `study estimators`: what a user types, sees and is refused.

Most commands run in this process, which is what a second process would print; a few run through a pipe.
"""

import re
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

import study
from study import cli


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
    """The table's cells by estimator, and the header's."""
    head, *lines = (re.split(r" {2,}", line) for line in said.splitlines())
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
    for cell, value, error in zip(rows["als"], [*fit.center, fit.radius], fit.standard_errors, strict=False):
        printed, its_error = map(float, cell.split(" ± "))
        assert abs(its_error / error - 1.0) <= 0.05
        assert abs(printed - value) <= 0.05 * error
    assert rows["als"][-2:] == ["90", "ok"]
    assert len(said.splitlines()) == 2


def test_all_with_and_without_noise(say, cap):
    """Without the noise, all is all that can do without; with it, the whole registry."""
    _, rows = rows_of(say("fit", "cap.csv", "--estimator", "all")[1])
    assert list(rows) == [name for name, entry in study.ESTIMATORS.items() if entry.needs != "noise"]
    code, said, complained = say("fit", "cap.csv", "-e", "all", "--noise", "0.02")
    assert (code, complained) == (0, "")
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
    assert rows["als"][-2] == "198"
    used = np.delete(cap, [6, 8], axis=0)[:, [2, 0, 1]]
    assert abs(float(rows["als"][0].split()[0]) - study.fit(used).center[0]) < 0.01


def test_many_rows(say, cap, tmp_path):
    """A file of 200 000 rows is fitted, and its picture drawn with fewer of them."""
    block = "\n".join(",".join(map(repr, row)) for row in cap.tolist())
    (tmp_path / "big.csv").write_text("\n".join([block] * 1000))
    code, said, complained = say("fit", "big.csv", "--plot", "big.png")
    assert (code, complained) == (0, "")
    cells = rows_of(said)[1]["als"]
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


@pytest.mark.parametrize("estimator", ["als", "all"])
def test_coplanar_points_are_drawn(say, rng, tmp_path, estimator):
    """Points without noise in a plane: statuses, exit code 0, and a picture of the points."""
    t = rng.uniform(-1, 1, 50)
    np.save(tmp_path / "arc.npy", np.column_stack([np.cos(t), np.sin(t), np.zeros(50)]))
    code, said, complained = say("fit", "arc.npy", "-e", estimator, "--plot", "arc.png")
    assert (code, complained) == (0, "")
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
    assert done.stderr == b""
    assert done.returncode == 0
    assert len(done.stdout.splitlines()) >= 1 + len(study.ESTIMATORS)
    assert b"\x1b" not in done.stdout  # no colours
