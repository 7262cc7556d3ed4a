"""Estimators of one's own on the command line: the page about them holds, in threads and in processes."""

import hashlib
import json
import re
from pathlib import Path

import pandas as pd
import pytest

from study.estimators.own import plugin_file

PAGE = (Path(__file__).parents[2] / "docs" / "own-estimators.md").read_text(encoding="utf-8")
PLUGIN, CONFIG = (re.search(rf"```{kind}\n(.*?)```", PAGE, re.DOTALL)[1] for kind in ("python", "toml"))


@pytest.fixture
def folder(tmp_path):
    """A folder with the page's file and config; what was loaded is forgotten afterwards."""
    (tmp_path / "my.py").write_text(PLUGIN, encoding="utf-8")
    (tmp_path / "own.toml").write_text(CONFIG, encoding="utf-8")
    yield tmp_path
    for path, _ in plugin_file.loaded():
        plugin_file.unload(path)


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
    for path, _ in plugin_file.loaded():
        plugin_file.unload(path)
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
    for loaded, _ in plugin_file.loaded():
        plugin_file.unload(loaded)
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
    monkeypatch.setattr(plugin_file, "LIMIT", 0.5)
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
