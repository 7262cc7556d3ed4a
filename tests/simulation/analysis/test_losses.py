"""Losses of tables and archives: a method that is run alone has the place that it has in a whole run."""

import hashlib
import shutil

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import study
from study.files import RunError
from study.simulation.analysis import losses, rank
from tests.configs import config

DESIGN = config({"dimension": 2, "estimators": ["gdke", "taubin", "mle"]}, trials=30, samples=[10, 20], angle=[90, 180])
OWN = """
import numpy as np
import study

def middle(points):
    if points.shape[1] == 3:
        raise ValueError("circles alone")
    return points.mean(axis=0), 1.0

study.register("middle", middle)
"""


def with_estimators(text, *names):
    """The config with other estimators."""
    return text.replace('["gdke", "taubin", "mle"]', str(list(names)).replace("'", '"'))


def table_of(run, config="", **columns):
    """A table of errors of a run, as Arrow has it."""
    rows = run.errors[["cell", "trial", "estimator", "error", "radius_error", "radius"]]
    rows = rows.astype({"cell": str, "estimator": str}).rename(columns={"estimator": "method"})
    table = pa.Table.from_pandas(rows.assign(mechanism="m", **columns), preserve_index=False)
    return table.replace_schema_metadata({"config": config})


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """An archive of two estimators, and runs of the third: alone with one of these, and with both."""
    folder, found = tmp_path_factory.mktemp("runs"), {}
    for name, chosen in {
        "kept": ("gdke", "taubin"),
        "own": ("taubin", "mle"),
        "whole": ("gdke", "taubin", "mle"),
    }.items():
        (folder / f"{name}.toml").write_text(with_estimators(DESIGN, *chosen))
        found[name] = study.run(folder / f"{name}.toml", folder=folder / name)
    (folder / "archive").mkdir()
    text = with_estimators(DESIGN, "gdke", "taubin")
    given = {"kind": "arc", "given": "points", "seconds": 0.5, "dimension": 2}
    pq.write_table(table_of(found["kept"], text, **given), folder / "archive" / "m.parquet")
    return folder, found


@pytest.mark.parametrize("by", ["center", "radius", "disc"])
def test_a_method_run_alone_has_its_place_in_a_whole_run(runs, by):
    """Losses, their errors, marks and failures are those of a run of all methods, to the last bit."""
    folder, found = runs
    beside = found["own"].rank(by, against=folder / "archive").set_index("estimator")
    whole = found["whole"].rank(by).set_index("estimator")
    columns = [name for name in whole if name not in ("run", "seconds")]
    pd.testing.assert_frame_equal(beside.loc[whole.index, columns], whole[columns], check_exact=True)
    assert beside["seconds"].to_dict() == {
        "gdke": 0.5,
        "taubin": 0.5,
        "mle": found["own"].rank().set_index("estimator").loc["mle", "seconds"],
    }


def test_other_points_are_refused(runs, tmp_path):
    """Another seed, another law, other cells, or no estimator that both have: the message says which."""
    folder, _ = runs
    for number, (text, words) in enumerate(
        [
            (DESIGN.replace("seed = 1", "seed = 2"), "seed = 2, there 1"),
            (DESIGN.replace("[10, 20]", "[10, 30]"), "no such cell of m"),
            (DESIGN.replace("[10, 20]", "10"), "2 cells, the archive has 4 of m; run all of them"),
            (with_estimators(DESIGN, "mle", "als"), "name one, such as taubin"),
            (with_estimators(DESIGN, "gdke", "taubin"), "the archive has gdke, taubin; give yours another name"),
        ]
    ):
        (tmp_path / f"{number}.toml").write_text(text)
        run = study.run(tmp_path / f"{number}.toml", folder=tmp_path / str(number))
        with pytest.raises(RunError, match=words):
            run.rank(against=folder / "archive")
    changed = pq.read_table(folder / "archive" / "m.parquet").to_pandas()
    changed.loc[changed["trial"] == 7, "error"] *= 1.00001  # one trial of 30
    (tmp_path / "other").mkdir()
    table = pa.Table.from_pandas(changed).replace_schema_metadata({"config": DESIGN})
    pq.write_table(table, tmp_path / "other" / "m.parquet")
    with pytest.raises(RunError, match="errors of taubin are others there: another law"):
        study.read_run(folder / "own").rank(against=tmp_path / "other")


def test_a_file_of_a_method_and_its_place(runs, tmp_path, call_here):
    """The method is run in each mechanism whose dimension it fits; page, table and terminal say its place."""
    folder, _ = runs
    archive = tmp_path / "kept"
    shutil.copytree(folder / "archive", archive)
    space = with_estimators(config({"estimators": ["gdke", "taubin"], "name": "space"}, trials=20), "gdke", "taubin")
    (tmp_path / "space.toml").write_text(space)
    spheres = table_of(study.run(tmp_path / "space.toml", folder=tmp_path / "space"), space, dimension=3)
    place = spheres.schema.get_field_index("mechanism")
    spheres = spheres.set_column(place, "mechanism", pa.array(["s"] * len(spheres)))
    pq.write_table(spheres, archive / "s.parquet")
    (tmp_path / "own.py").write_text(OWN)
    options = ["--against", "kept", "--out", "page.html", "--table", "all.csv"]
    code, said, progress = call_here(tmp_path, "rank", "own.py", *options)
    assert code == 0
    assert "s: without middle, which fails there: ValueError: circles alone" in progress
    table = pd.read_csv(tmp_path / "all.csv")
    assert set(table["run"]) == {"m"}
    medians = table.set_index("estimator")["median"]
    place = 1 + (medians < medians["middle"]).sum()
    assert f"{place} of 3" in said.splitlines()[-1]
    page = (tmp_path / "page.html").read_text()
    assert page.count("<h2") == 2
    assert "Place of middle" in page
    code, _, complained = call_here(tmp_path, "rank", "own.py")
    assert (code, "give --against archive" in complained) == (2, True)


def test_any_table(runs, tmp_path, well):
    """A CSV file of somebody's errors has the losses of the run that they are from."""
    _, found = runs
    needed = ["mechanism", "cell", "trial", "method", "error"]
    table_of(found["whole"]).to_pandas()[needed].to_csv(tmp_path / "errors.csv", index=False)
    well(tmp_path, "rank", "errors.csv", "--table", "ranking.csv")
    mine = pd.read_csv(tmp_path / "ranking.csv").set_index("estimator")
    whole = found["whole"].rank().set_index("estimator")
    for loss in ("median", "rms"):
        assert mine[loss].to_dict() == pytest.approx(whole[loss].to_dict())
    assert mine["seconds"].isna().all()


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.csv", "mechanism,cell,trial,method\nm,c,0,a\n", "has no column error; it needs mechanism, cell, trial"),
        ("a.csv", "mechanism,cell,trial,method,error\nm,c,0,a,1\nm,c,0,a,2\n", "m, c, 0, a: given twice"),
        ("a.csv", "mechanism,cell,trial,method,error\nm,c,x,a,1\n", "trials are whole numbers, and errors numbers"),
        ("a.csv", "mechanism,cell,trial,method,error\nm,c,0,a,-1\n", "center = -1 in cell c: losses are 0 or more"),
        ("a.parquet", "no Parquet", "cannot be read: "),
        ("b.csv", None, "cannot be read: No such file"),
    ],
)
def test_tables_that_are_refused(tmp_path, one_line, name, text, words):
    """A table that cannot be ranked is refused with its fault in one line."""
    if text is not None:
        (tmp_path / name).write_text(text)
    with one_line(RunError, words):
        [rank.compared(one.losses()) for one in losses.read_tables(tmp_path / name)]


def test_a_damaged_archive_is_refused(runs, tmp_path):
    """A file whose digest is not the one in SHA256SUMS is not read, nor is a folder without tables."""
    folder, _ = runs
    shutil.copy(folder / "archive" / "m.parquet", tmp_path / "m.parquet")
    data = (tmp_path / "m.parquet").read_bytes()
    (tmp_path / "SHA256SUMS").write_text(f"{hashlib.sha256(data).hexdigest()}  m.parquet\n")
    assert [one.name for one in losses.read_tables(tmp_path)] == ["m"]
    (tmp_path / "m.parquet").write_bytes(data[:-9] + b"x" + data[-8:])
    with pytest.raises(RunError, match=r"m\.parquet: damaged: its SHA-256 is not the one in SHA256SUMS"):
        losses.read_tables(tmp_path)
    (tmp_path / "empty").mkdir()
    with pytest.raises(RunError, match=r"has no \.parquet file, so it is no archive"):
        losses.read_tables(tmp_path / "empty")


def test_methods_that_are_given_more_stand_apart():
    """Each class has its own best, over all and in each cell; kinds of data count the same, whatever their number."""
    rng, mechanisms = np.random.default_rng(9), []
    scales = {"a": 2.0, "b": 3.0, "c": 1.0, "d": 4.0}
    given = {"a": "points", "b": "points", "c": "noise", "d": "noise"}
    for name, kind, factor in (("x", "clutter", 1.0), ("y", "clutter", 1.0), ("z", "arc", 8.0)):
        values = np.abs(rng.standard_normal(40))
        rows = [
            ("c0", t, m, v * s * (factor if m == "b" else 1.0)) for m, s in scales.items() for t, v in enumerate(values)
        ]
        part = pd.DataFrame(rows, columns=["cell", "trial", "estimator", "error"])
        mechanisms.append(rank.compared(losses.Losses(name, list(scales), [part], kind=kind, given=given)))
    table = rank.ranked(mechanisms).set_index(["run", "estimator"])
    assert list(table.index.get_level_values("run").unique()) == ["x", "y", "z", "clutter", "all"]
    assert table.loc["all", "median"].to_dict() == pytest.approx({"a": 1.0, "b": 1.5 * 8**0.5, "c": 1.0, "d": 4.0})
    assert table.loc["clutter", "median"].to_dict() == pytest.approx({"a": 1.0, "b": 1.5, "c": 1.0, "d": 4.0})
    assert table["median_best"].to_dict() == {key: key[1] in "ac" for key in table.index}
    assert table.loc["all", "median_alone"].to_dict() == {"a": 3, "b": 0, "c": 3, "d": 0}
