"""Studies from Python: `study.run` and `study.read_run` do what the commands do, and exports have the same numbers."""

import re
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

import study
from study.files import RunError
from study.fits import registry
from study.simulation.analysis import regret
from study.simulation.experiment.config import config_file, parse, read
from study.simulation.library import complete_share, merge, workers_of
from study.simulation.runs import schemas
from study.simulation.runs.parts import Share
from study.simulation.runs.run_folder import Run
from study.toml import ConfigError
from tests.configs import config, uniform

OWN = """
import study
study.register("middle", lambda points: (points.mean(axis=0), 1.0))
"""


@pytest.fixture(scope="module")
def text():
    """A grid of eight cells with 40 trials each."""
    top = {"estimators": ["mle", "gdke"]}
    return config(top, trials=40, samples=[6, 20], noise_over_radius=[0.01, 0.1], angle=[60, 180], radius=3.0)


@pytest.fixture(scope="module")
def folder(text, tmp_path_factory):
    """A folder with its config."""
    folder = tmp_path_factory.mktemp("library")
    (folder / "mine.toml").write_text(text)
    return folder


@pytest.fixture(scope="module")
def run(folder):
    """Its run."""
    return study.run(folder / "mine.toml", folder=folder / "here")


def test_the_run_is_that_of_the_command(run, folder, well):
    """Errors and summary are those of `study run`, byte by byte; the command has nothing left to do in the folder."""
    well(folder, "run", "mine.toml", "--out", "there")
    for name in ("errors", "summary"):
        assert (folder / "here" / f"{name}.parquet").read_bytes() == (folder / "there" / f"{name}.parquet").read_bytes()
    before = (folder / "here" / "manifest.json").read_bytes()
    well(folder, "run", "mine.toml", "--out", "here")
    assert (folder / "here" / "manifest.json").read_bytes() == before


def test_the_default_folder(folder, monkeypatch):
    """Without a folder the run is in results/ under its name, where `read_run` finds it by its config."""
    monkeypatch.chdir(folder)
    run = study.run("mine.toml", jobs=1)
    assert run.folder == Path("results") / run.name
    for given in ("mine.toml", run.folder, str(run.folder)):
        assert study.read_run(given).folder == run.folder


def test_one_line_says_what_it_is(run):
    """The repr has the name, the folder, the number of cells and the estimators."""
    assert repr(run) == f"<StudyRun {run.name} in {run.folder}: 8 cells; mle, gdke>"
    assert re.fullmatch(r"test-[0-9a-f]{10}", run.name)


def test_a_wrong_name_is_answered(run):
    """A missing attribute is answered with what there is."""
    with pytest.raises(AttributeError, match="did you mean 'errors'"):
        _ = run.error


def test_tables(run):
    """Errors are those of the file, read once; other tables have their names; what is unknown is refused."""
    pd.testing.assert_frame_equal(run.errors, pq.read_table(run.folder / "errors.parquet").to_pandas())
    assert run.errors is run.errors
    assert set(run.table("timings")["step"]) >= {"mle", "gdke"}
    with pytest.raises(ValueError, match="table 'error': unknown; did you mean 'errors'"):
        run.table("error")
    with pytest.raises(RunError, match=r"points\.parquet: missing"):
        run.table("points")


def test_the_errors_wait_until_they_are_asked_for(run):
    """A run is opened, and summed up, without its largest table."""
    again = study.read_run(run.folder)
    again.summary()
    assert "errors" not in vars(again)


def test_summary(run):
    """Cells and estimators are chosen by values; medians are those of the errors."""
    chosen = run.summary(["mle"], angle=60, samples=[6, 20], noise_over_radius=0.1)
    assert chosen["samples"].tolist() == [6, 20]
    errors = run.errors
    for _, row in chosen.iterrows():
        mine = errors[(errors["cell"] == row["group"]) & (errors["estimator"] == "mle")]
        assert row["ratio_median"] == pytest.approx(np.median(mine["error"] / mine["bound"]), rel=1e-12)
    assert len(run.summary()) == 16
    assert set(run.summary("gdke")["estimator"]) == {"gdke"}
    with pytest.raises(ValueError, match="no cell has it; there are 60"):
        run.summary(angle=45)


def test_regret_and_figures(run, well):
    """Regret is the command's table; a figure is drawn; one that the run cannot feed says what it needs."""
    folder = run.folder.parent
    well(folder, "regret", "here", "--csv", "regret.csv")
    pd.testing.assert_frame_equal(run.regret(), pd.read_csv(folder / "regret.csv"), check_exact=False)
    well(folder, "regret", "here", "--where", "samples=20,angle=60", "--csv", "some.csv")
    some = run.regret(samples=20, angle=60)
    pd.testing.assert_frame_equal(some, pd.read_csv(folder / "some.csv"), check_exact=False)
    errors = run.errors[(run.errors["samples"] == 20) & (run.errors["angle"] == 60)]
    whole = regret.regret(regret.by_cell([errors], list(run.errors["estimator"].unique())))
    pd.testing.assert_frame_equal(some, whole, check_exact=False)
    with pytest.raises(ValueError, match="no cell has it"):
        run.regret(samples=21)
    assert run.plot("fig_map").axes
    with pytest.raises(ValueError, match=r"fig6_mgdk of test-\w+: .*needs"):
        run.plot("fig6_mgdk")
    with pytest.raises(ValueError, match="figure 'fig_mop': unknown; did you mean 'fig_map'"):
        run.plot("fig_mop")


def test_files_of_ones_own(tmp_path):
    """Estimators of a file are known to the run, and to who reads it."""
    (tmp_path / "own.py").write_text(OWN)
    (tmp_path / "own.toml").write_text(config({"estimators": ["middle", "gdke"]}))
    try:
        made = study.run(tmp_path / "own.toml", folder=tmp_path / "run", plugins=[tmp_path / "own.py"])
        registry.unload(str(tmp_path / "own.py"))
        with pytest.raises(RunError, match=r"of own\.py: give --plugin own\.py$"):
            study.read_run(made.folder)
        again = study.read_run(made.folder, plugins=[tmp_path / "own.py"])
        assert set(again.errors["estimator"]) == {"middle", "gdke"}
    finally:
        registry.unload(str(tmp_path / "own.py"))


def test_what_is_refused(tmp_path):
    """Faults of a config are named, a folder without a run is, and a budget where cells have no target."""
    (tmp_path / "bad.toml").write_text(config(angle=450))
    with pytest.raises(ConfigError, match="450 not allowed"):
        study.run(tmp_path / "bad.toml", folder=tmp_path / "run")
    with pytest.raises(RunError, match="nowhere"):
        study.read_run(tmp_path / "nowhere")
    (tmp_path / "good.toml").write_text(config())
    with pytest.raises(ValueError, match=r"a budget is for a config with \[precision\]"):
        study.run(tmp_path / "good.toml", folder=tmp_path / "run", budget=1.0)


def test_a_budget_is_warned_of(tmp_path):
    """A run that its budget stopped is returned, with a warning that says how to resume it."""
    text = config(trials=400) + "[precision]\nrelative_target = 0.08\nfirst = 100\n"
    (tmp_path / "need.toml").write_text(text)
    with pytest.warns(UserWarning, match="stopped by its budget of 0 s") as said:
        stopped = study.run(tmp_path / "need.toml", folder=tmp_path / "run", budget=0.0)
    assert said[0].filename == __file__
    assert study.run(tmp_path / "need.toml", folder=stopped.folder).summary()["planned"].item() >= 100


def test_arrays(run):
    """Every error stands where its conditions, estimator and trial say; units and meanings are attributes."""
    pytest.importorskip("xarray")
    arrays = run.to_xarray()
    assert dict(arrays.sizes) == {"samples": 2, "noise_over_radius": 2, "angle": 2, "estimator": 2, "trial": 40}
    for _, row in run.errors.sample(50, random_state=1).iterrows():
        place = {name: row[name] for name in ("samples", "angle", "estimator", "trial")}
        at = arrays.sel(place, method=None).sel(noise_over_radius=row["noise"] / 3.0, method="nearest")
        assert (float(at["error"]), float(at["noise"])) == (row["error"], row["noise"])
    assert arrays["error"].attrs["units"] == "length"
    assert "radius" not in arrays.dims
    assert set(map(float, arrays["noise_over_radius"])) == {0.01, 0.1}


def test_arrays_of_a_random_design(tmp_path):
    """Conditions are arrays along the trials."""
    pytest.importorskip("xarray")
    (tmp_path / "random.toml").write_text(config(kind="random", trials=5, noise=uniform(0.01, 0.1)))
    arrays = study.run(tmp_path / "random.toml", folder=tmp_path / "run").to_xarray()
    assert dict(arrays.sizes) == {"estimator": 1, "trial": 5}
    assert len(np.unique(arrays["noise"])) == 5


def test_who_computes():
    """Processes compute what takes long, if there are several; threads all else, and what is asked for is done."""
    short, long = (parse(config({"estimators": ["robust"]}, trials=trials, samples=100)) for trials in (2, 20_000))
    kinds = {
        (name, jobs, asked): workers_of(made, jobs, asked).backend
        for name, made in (("short", short), ("long", long))
        for jobs in (1, 2)
        for asked in (None, "threads", "loky")
    }
    assert {key for key, kind in kinds.items() if kind == "loky"} == {
        ("long", 2, None),
        *((name, jobs, "loky") for name in ("short", "long") for jobs in (1, 2)),
    }


def test_shares_from_python(folder, run, monkeypatch):
    """Shares in their default folders, merged in the default folder, have the bytes of the run, and only these."""
    monkeypatch.chdir(folder / "here")
    config_of = read(config_file(folder / "mine.toml"))
    workers = workers_of(config_of[0], 1, None)
    shares = [complete_share(config_of, Share(number, 2), None, workers) for number in (1, 2)]
    assert [str(share.folder) for share in shares] == [f"results/{run.name}-part-{number}-of-2" for number in (1, 2)]
    given = [complete_share(config_of, Share(1, 1), Path("all"), workers).folder]
    for shares, place in ((), None), (given, Path("there")):
        merged, complaints = merge(config_of, shares, place, workers)
        assert complaints == []
        assert merged.folder == (place or Path("results") / run.name)
        for name in ("errors", "summary"):
            assert merged.path(name).read_bytes() == (run.folder / f"{name}.parquet").read_bytes()


def test_the_level_of_a_ranking_is_95_per_cent(run):
    """By default, as the page says; another level marks no fewer."""
    pd.testing.assert_frame_equal(run.rank(), run.rank("center", 0.95))
    assert (run.rank(level=0.999)["median_best"] >= run.rank(level=0.5)["median_best"]).all()


def test_exports(run, well):
    """The NetCDF file has the errors, the database all tables with comments; their numbers are the tables'."""
    xarray, duckdb = pytest.importorskip("xarray"), pytest.importorskip("duckdb")
    folder, paths = run.folder.parent, ["new/out/mine.nc", "new/out/mine.duckdb"]
    assert well(folder, "export", "here", "--xarray", paths[0], "--duckdb", paths[1]).split() == paths
    with xarray.open_dataset(folder / paths[0]) as arrays:
        np.testing.assert_array_equal(np.sort(arrays["error"].values.ravel()), np.sort(run.errors["error"]))
    with duckdb.connect(str(folder / paths[1]), read_only=True) as database:
        for name in Run.open(run.folder).manifest()["tables"]:
            stored = database.sql(f'from "{name}"').to_arrow_table().to_pandas()
            pd.testing.assert_frame_equal(stored, run.table(name), check_dtype=False, check_categorical=False)
        comments = database.execute(
            "select comment from duckdb_columns() where column_name = 'radius_error'"
        ).fetchall()
    (meaning,) = [column.meaning for column in schemas.errors(3) if column.name == "radius_error"]
    assert comments == [(f"{meaning}; unit: length",)]


def test_exports_that_cannot_be_made(run, call_here, monkeypatch):
    """Without the package, and without a file, one line says what to do; nothing is written."""
    folder = run.folder.parent
    code, said, complained = call_here(folder, "export", "here")
    assert (code, said) == (2, "")
    assert "give --xarray FILE or --duckdb FILE" in complained
    for package in ("xarray", "duckdb"):
        monkeypatch.setitem(sys.modules, package, None)
        code, said, complained = call_here(folder, "export", "here", f"--{package}", "file")
        assert (code, said, complained.count("\n")) == (1, "", 1)
        assert complained.startswith(f"file: {package} is not installed; pip install 'sphere-fit-study[export]'")
        assert not (folder / "file").exists()
    code, said, complained = call_here(folder, "export", "here", "--xarray", "mine.toml/file")
    assert (code, said, complained.count("\n")) == (1, "", 1)
    assert complained.startswith("mine.toml/file: cannot be written: ")
    assert "what was finished" not in complained  # nothing of a run is lost


def test_a_ranking_says_what_it_takes(run):
    """An error that nobody ranks by, and a level in per cent, are refused with the remedy, not taken for others."""
    with pytest.raises(ValueError, match=r"by = 'centre': errors are ranked by 'center', 'radius', 'disc'"):
        run.rank(by="centre")
    with pytest.raises(ValueError, match=r"level = 95: give a number between 0 and 1"):
        run.rank(level=95)


def test_one_plugin_is_a_list_of_one(tmp_path):
    """``plugins="my.py"`` is not taken for a file for each letter."""
    with pytest.raises(registry.PluginError, match=r"absent\.py"):
        study.read_run("smoke", plugins=str(tmp_path / "absent.py"))
