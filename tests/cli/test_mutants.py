"""Mutants of a finished run's folder: every damaged file is named or repaired, none believed, without a traceback.

The commands run within this process, so that an exception which is not caught fails the test.
"""

import functools
import hashlib
import json
import os
import shutil
import zlib

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from study.files import RunError
from study.simulation.analysis.summary import summarise
from study.simulation.claims import judge_all, save
from study.simulation.experiment.config import parse
from study.simulation.posterior.run import compute
from study.simulation.runs import provenance, runner
from study.simulation.runs.run_folder import Run
from tests.configs import config

POSTERIOR = {"trials": 1, "walkers": 16, "max_steps": 100, "noise": "known", "where": {"samples": 20, "noise": 0.1}}
TOP = {"name": "tiny", "estimators": ["lls", "gdke"], "keep_points": 1, "posterior": POSTERIOR}
CONFIG = config(TOP, trials=5, samples=[6, 20], noise=[0.01, 0.1])
TABLES = ["errors", "timings", "points", "summary", "posterior", "answers", "draws", "claims"]
SAME_BYTES = ["errors", "points", "summary", "posterior", "answers", "draws"]


def cut(share):
    """Cut a file to a share of its length."""
    return lambda data: data[: int(share * len(data))]


def flipped(number):
    """Flip one bit; the place follows from the data and the number."""

    def change(data):
        place = zlib.crc32(bytes([number])) % len(data)
        return data[:place] + bytes([data[place] ^ 1 << number % 7]) + data[place + 1 :]

    return change


BYTES = {
    **{f"cut to {share:g}": cut(share) for share in (0.0, 0.1, 0.5, 0.9, 0.999)},
    **{f"bit {number}": flipped(number) for number in range(6)},
    "zeros": lambda data: bytes(len(data)),
    "twice": lambda data: data + data,
}


def of_a_float(change):
    """A change of the last column of numbers, which names no row; claims have none, and get a column less."""

    def apply(table):
        floats = [i for i, field in enumerate(table.schema) if pa.types.is_floating(field.type)]
        if not floats:
            return table.remove_column(0)
        return table.set_column(floats[-1], table.schema.names[floats[-1]], change(table.column(floats[-1])))

    return apply


COLUMNS = {
    "renamed": lambda table: table.rename_columns([f"{name}_" for name in table.schema.names]),
    "one renamed": lambda table: table.rename_columns(["other", *table.schema.names[1:]]),
    "strings": of_a_float(lambda column: pa.array([str(value) for value in column.to_pylist()])),
    "dropped": lambda table: table.remove_column(table.num_columns - 1),
}
VALUES = {
    "scaled": of_a_float(lambda column: pa.array(column.to_numpy() * 0.1)),
    "not numbers": of_a_float(lambda column: pa.array(np.full(len(column), np.nan))),
    "a row less": lambda table: table.slice(1),
    "in reverse": lambda table: table.take(np.arange(table.num_rows)[::-1].copy()),
}


def pairs(names, *changes):
    """Every change of the first table, and the last one of each of the others."""
    return [*((names[0], change) for change in changes), *((name, changes[-1]) for name in names[1:])]


@pytest.fixture(scope="module", autouse=True)
def _quick():
    """Find the commit once, and do not wait for the disk."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(provenance, "_git", functools.cache(provenance._git))
        patch.setattr(os, "fsync", lambda handle: None)
        yield


@pytest.fixture(scope="module")
def finished_runs(tmp_path_factory):
    """A folder with a finished run in ``good``, one of another seed in ``other``, and their configs."""
    folder = tmp_path_factory.mktemp("mutants")
    for name, text in (("good", CONFIG), ("other", CONFIG.replace("seed = 1", "seed = 2"))):
        (folder / f"{name}.toml").write_text(text)
        run = runner.run(parse(text), text, folder / name, 1)
        summarise(run)
        compute(run, 1)
        save(run, judge_all([run]))
    return folder


@pytest.fixture
def mutant(finished_runs, tmp_path):
    """A copy of the finished run in ``out`` beside its config, to be altered; the folder."""
    shutil.copytree(finished_runs / "good", tmp_path / "out")
    (tmp_path / "good.toml").write_text(CONFIG)
    return tmp_path


@pytest.fixture
def repaired(call_here, mutant):
    """Run the config again, which repairs the run, so that it verifies; the words on standard error."""

    def run():
        code, _, complained = call_here(mutant, "run", "good.toml", "--out", "out", "--jobs", "1")
        assert (code, call_here(mutant, "verify", "out", "--share", "0")[0]) == (0, 0)
        return complained

    return run


@pytest.fixture
def named(mutant):
    """Assert that a file is refused with one line that names it and a command, and is set aside by the next run."""

    def check(file):
        run, told = Run.open(mutant / "out"), []
        for name in TABLES if file == "manifest.json" else [file.removesuffix(".parquet")]:
            with pytest.raises(RunError, match=rf"out/{file}: [^\n]*`study [^\n]*`[^\n]*$"):
                run.table(name)
            assert not run.valid(name)
        run.set_damaged_aside(told.append)
        assert len(told) == 1 + (file == "manifest.json")  # claims are left, for which no manifest vouches
        assert f"out/{file}: " in told[0]
        assert "damaged" in told[0]
        assert not (mutant / "out" / file).exists()
        assert (mutant / "out" / "parts" / "damaged" / file).exists()

    return check


@pytest.fixture
def survive(call_here, finished_runs, mutant, repaired):
    """Assert that no command believes a damaged file, and that `study run` repairs it."""
    good = Run.open(finished_runs / "good")

    def check(file):
        for words in (["verify", "out", "--share", "0"], ["status", "out"]):
            code, said, complained = call_here(mutant, *words)
            name = file.replace(".parquet", " (damaged)") if words[0] == "status" else file
            assert name in said + complained
            assert code == 1 or words[0] == "status"
        for words, reads in (("summary", "summary"), ("diff", "errors"), ("worst", "errors")):
            code, said, complained = call_here(mutant, words, "out", *[good.folder] * (words == "diff"))
            assert code == (file in ("manifest.json", f"{reads}.parquet"))
            if code:
                assert (said, complained.count("\n"), f"out/{file}: " in complained) == ("", 1, True)
        assert f"out/{file}: damaged" in repaired()
        run = Run.open(mutant / "out")
        assert [name for name in SAME_BYTES if run.fingerprint(name) != good.fingerprint(name)] == []

    return check


def alter(path, change):
    """Change a file's bytes, or the table in it."""
    if change in BYTES:
        path.write_bytes(BYTES[change](path.read_bytes()))
    else:
        pq.write_table({**COLUMNS, **VALUES}[change](pq.read_table(path)), path)


@pytest.mark.parametrize(("name", "change"), pairs(TABLES, *BYTES, *COLUMNS, *VALUES))
def test_tables_are_named(mutant, named, name, change):
    """A table that is cut, flipped, emptied, or has other columns or values, is not read."""
    alter(mutant / "out" / f"{name}.parquet", change)
    named(f"{name}.parquet")


@pytest.mark.parametrize(
    ("name", "change"),
    pairs(["errors", "summary", "answers", "claims"], "cut to 0.5", "bit 1", "one renamed", "scaled"),
)
def test_tables_are_made_again(mutant, survive, name, change):
    """Commands name it, and `study run` makes it again to the same bytes."""
    alter(mutant / "out" / f"{name}.parquet", change)
    survive(f"{name}.parquet")


@pytest.mark.parametrize("change", BYTES)
def test_bytes_of_manifests(mutant, named, change):
    """A manifest that is cut or flipped is named."""
    alter(mutant / "out" / "manifest.json", change)
    named("manifest.json")


def forged(name):
    """A change of a manifest's content and of a table, whose new digest the manifest gets."""

    def change(content, folder):
        alter(folder / f"{name}.parquet", "in reverse")
        content["tables"][name] = hashlib.sha256((folder / f"{name}.parquet").read_bytes()).hexdigest()

    return change


WITHOUT_DIGEST = {
    "as it was": lambda content, folder: None,
    "no tables": lambda content, folder: content.update(tables={}),
    "not even a format": lambda content, folder: content.pop("format"),
    "an empty object": lambda content, folder: content.clear(),
    "without a table": lambda content, folder: content["tables"].pop("errors"),
    "an odd field": lambda content, folder: content.update(failures=-1),
    **{f"forged {name}": forged(name) for name in ("errors", "summary")},
}
READING = [f"{verb} out" for verb in ("summary", "figures", "claims", "report", "archive", "verify", "worst", "regret")]
READING += ["diff out out"]


@pytest.mark.parametrize("change", WITHOUT_DIGEST)
def test_manifests_without_a_digest(refused, well, mutant, change):
    """Every command that reads a run's tables names such a manifest in one line, believes nothing, writes nothing."""
    path = mutant / "out" / "manifest.json"
    content = json.loads(path.read_text(encoding="utf-8"))
    del content["digest"]
    WITHOUT_DIGEST[change](content, mutant / "out")
    path.write_text(json.dumps(content, indent=2), encoding="utf-8")
    told = "out/manifest.json: damaged: no field 'digest'"
    for command in READING:
        refused(mutant, 1, f" ... {told} ... `study run out/config.toml --out out` makes it again", *command.split())
    assert told in well(mutant, "status", "out")


def test_manifests_are_made_again(finished_runs, mutant, survive):
    """Commands name the manifest of another run, and one with a field changed; `study run` makes it again."""
    path = mutant / "out" / "manifest.json"
    good = path.read_text(encoding="utf-8")
    for text in ((finished_runs / "other" / path.name).read_text(encoding="utf-8"), good.replace("tiny", "tino")):
        path.write_text(text, encoding="utf-8")
        survive(path.name)


@pytest.mark.parametrize("text", ["", "seed = ", "\0", CONFIG[:100], CONFIG.replace("seed = 1", "seed = 9")], ids=len)
def test_configs(refused, repaired, mutant, text):
    """A changed config does not read another run's tables, and is written again by the config that it was made of."""
    path = mutant / "out" / "config.toml"
    path.write_text(text)
    for words in (["verify", "out"], ["summary", "out"], ["diff", "out", "out"], ["worst", "out"], ["report", "out"]):
        refused(mutant, 1, " ... config ... `study run CONFIG --out out`", *words)
    assert repaired() == "out/config.toml: not the config that the run was made of; written again\n"
    assert path.read_text() == CONFIG


@pytest.mark.parametrize(("name", "change"), pairs(TABLES, *COLUMNS))
def test_other_columns_with_the_right_digest(mutant, call_here, repaired, name, change):
    """A table of another version, whose digest the manifest has, is refused by its columns."""
    run = Run.open(mutant / "out")
    pq.write_table(COLUMNS[change](pq.read_table(run.path(name))), run.path(name))
    run.record(name)
    assert not run.valid(name)
    with pytest.raises(RunError, match=rf"{name}\.parquet: not a table of this version: [^\n]*; `study [^\n]*$"):
        run.table(name)
    assert call_here(mutant, "verify", "out", "--share", "0")[0] == 1
    for words in (["summary", "out"], ["diff", "out", "out"], ["worst", "out"]):
        code, said, complained = call_here(mutant, *words)
        assert code == 0 or (said == "" and len(complained.splitlines()) == 1 and f"{name}.parquet" in complained)
    assert f"out/{name}.parquet: damaged" in repaired()
