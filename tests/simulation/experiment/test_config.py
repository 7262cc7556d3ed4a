"""Configs that are right: what they mean, and that equal meaning has an equal digest.

The sections ``[precision]`` and ``[posterior]``: their defaults, their meaning, and their effect on a run's name.

Shipped configs are found by name from any folder, in a checkout and in an installed package.
"""

import dataclasses
import json
import math
import re
from importlib import resources
from pathlib import Path

import numpy as np
import pytest

import study
from study.simulation.experiment import config
from study.simulation.experiment.config import WITH_ERROR, Posterior, Precision, Study, load, parse
from study.simulation.experiment.designs import Cell
from study.simulation.runs import schemas

FOLDER = Path(study.__file__).parents[1] / "configs"
OTHERS = {"readings.toml"}  # a config of another kind, which has its own reader
CONFIGS = sorted(path for path in FOLDER.glob("*.toml") if path.name not in OTHERS)
BASE = """name = "test"
seed = 1
estimators = ["lls"]
[design]
kind = "grid"
trials = 2
samples = [10, 20, 30]
noise = [0.1, 0.2, 0.3]
angle = 90
"""
RANDOM = BASE.replace("grid", "random").replace("[10, 20, 30]", "10").replace("[0.1, 0.2, 0.3]", "0.1")


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.name)
def test_shipped_configs_parse(path):
    """Every config in configs/ is a study, named like its file."""
    made, text = config.read(path)
    assert made.name == path.stem
    assert made == load(path) == parse(text)
    assert {"paper.toml", "sweep.toml", "smoke.toml"} <= {path.name for path in CONFIGS}


def test_ranges(make_study):
    """Linspace and logspace give numpy's values, both ends among them, to 12 digits; whole numbers occur once each.

    A logspace over decades is the list of its powers of ten, to the bit.
    """
    design = make_study(angle={"linspace": [0.1, 0.7, 7]}, noise={"logspace": [1e-6, 10.0, 8]}).design
    np.testing.assert_allclose(design.angle, np.linspace(0.1, 0.7, 7), rtol=1e-12)
    np.testing.assert_allclose(design.noise, 10.0 ** np.linspace(-6, 1, 8), rtol=1e-11)
    assert (design.angle[0], design.angle[-1], design.noise[0], design.noise[-1]) == (0.1, 0.7, 1e-6, 10.0)
    assert make_study(samples={"logspace": [4, 8, 20]}).design.samples == (4, 5, 6, 7, 8)
    assert make_study(samples={"logspace": [10, 100_000, 5]}).design.samples == (10, 100, 1000, 10_000, 100_000)
    listed = [float(f"1e{k}") for k in range(-13, 15)]
    assert make_study(noise=listed).digest() == make_study(noise={"logspace": [1e-13, 1e14, 28]}).digest()


@pytest.mark.parametrize(
    "change",
    [
        ("[10, 20, 30]", "{ linspace = [10, 30, 3] }"),
        ("[10, 20, 30]", "[10.0, 2e1, 3_0]"),
        ("[0.1, 0.2, 0.3]", "{ linspace = [0.1, 0.3, 3] }"),
        ("[0.1, 0.2, 0.3]", "[\n  1e-1, # one\n  2e-1,\n  3e-1,\n]"),
        ("angle = 90", "angle = [90.0]"),
        ("angle = 90", "angle = { linspace = [90, 90, 1] }"),
        ("angle = 90", "radius = 1\ncenter = 0\ndraws = 'shared'\nangle = 90"),
        ("angle = 90", "center = -0.0\nangle = 90"),
        ("seed = 1\nestimators", "keep_points = 0\ndimension = 3\nseed = 1\nestimators"),
        ("seed = 1\n", 'seed = 1\nroute = "points"\nkeep = "errors"\n'),
        ('name = "test"\nseed = 1\n', 'seed = 1\nname = "test"  # another order\n\n'),
        ("kind", "# a comment\nkind"),
    ],
    ids=lambda change: change[1].replace("\n", " "),
)
def test_equal_meaning_equal_digest(change):
    """Spelling, order, comments and defaults do not count."""
    assert change[0] in BASE
    assert parse(BASE.replace(*change)).digest() == parse(BASE).digest()


@pytest.mark.parametrize(
    "change",
    [
        ('"test"', '"other"'),
        ("seed = 1", "seed = 2"),
        ("trials = 2", "trials = 3"),
        ('["lls"]', '["lls", "mle"]'),
        ("[10, 20, 30]", "[10, 20]"),
        ("0.3]", "0.30000000000000004]"),
        ("noise", "noise_over_radius"),
        ("angle = 90", "angle = 91"),
        ("angle = 90", "angle = 90\nradius = 2"),
        ("angle = 90", "angle = 90\ncenter = 2"),
        ("angle = 90", 'angle = 90\ndraws = "independent"'),
        ("angle = 90", "angle = 90\nmost_samples = 5000"),
        ("seed = 1\n", "seed = 1\nkeep_points = 1\n"),
        ("seed = 1\n", "seed = 1\ndimension = 2\n"),
        ('["lls"]', '["gdke"]\nroute = "moments"'),
        ("seed = 1\n", 'seed = 1\nkeep = "summary"\n'),
        ("seed = 1\n", "seed = 1\nnoise_shape = [[2, 0, 0], [0, 1, 0], [0, 0, 1]]\n"),
    ],
    ids=lambda change: change[1].strip().replace("\n", " "),
)
def test_other_meaning_other_digest(change):
    """A change of any number of the run, down to the last bit, changes the digest."""
    others = [parse(text).digest() for text in (BASE, BASE.replace("lls", "gdke"))]
    assert parse(BASE.replace(*change)).digest() not in others


def test_names_and_canonical_forms():
    """A run's folder is the name, a dash and ten hexadecimal digits; the canonical JSON is read back as the same study.

    Entries at their defaults are not in it, so configs from before keep their names.
    """
    name, digest = parse(BASE).run_name().rsplit("-", 1)
    assert name == "test"
    assert re.fullmatch("[0-9a-f]{10}", digest)
    for text in (BASE, RANDOM):
        made = parse(text)
        assert Study.model_validate_json(made.model_dump_json()) == made
        assert not {"route", "keep", "precision", "posterior"} & set(json.loads(made.canonical()))
        assert "most_samples" not in json.loads(made.canonical())["design"]
    old = {"paper": "8689e37964", "ellipse": "26be580da7", "mgdk": "fef748cb88", "power-law": "a5b1568c08"}
    assert {name: load(FOLDER / f"{name}.toml").digest() for name in old} == old


@pytest.mark.parametrize(("limit", "expected"), [(5000, {10: 500, 100: 50, 1000: 5}), (500, {10: 50, 100: 5, 1000: 1})])
def test_cells_of_many_samples_have_fewer_trials(make_study, limit, expected):
    """At most 5000 samples a cell: 500 trials of 10, 50 of 100, 5 of 1000; at least one."""
    found = dict.fromkeys(expected, 0)
    for unit in make_study(trials=1000, samples=[10, 100, 1000], most_samples=limit).units():
        for batch in unit.parts(0):
            found[batch.group.samples] += batch.trials
    assert found == expected


def with_section(name, *lines):
    """A config of many trials with these lines in a section."""
    return parse("\n".join([BASE.replace("trials = 2", "trials = 4000"), f"[{name}]", *lines]) + "\n")


def test_defaults_of_sections():
    """Half of [precision] is the target; an empty [posterior] asks for four trials of every cell, σ known and not."""
    made = with_section("precision", "target = 0.01").precision
    assert (made.measure, made.estimators, made.first, made.seconds) == ("ratio_median_ok", None, 250, None)
    assert (made.target, made.relative_target) == (0.01, None)
    made = with_section("posterior").posterior
    assert (made.trials, made.where, made.noise, made.likelihood) == (4, (), ("known", "unknown"), ("geometric",))
    assert (made.box, made.walkers, made.max_steps, made.keep_draws) == (10.0, 64, 20_000, 1)


def test_measures_are_those_of_the_summary():
    """The names that a config may give are those of the summary's columns that have an error beside them."""
    names = [column.name for column in schemas.summary()]
    assert set(WITH_ERROR) == {name.removesuffix("_error") for name in names if name.endswith("_error")}


def test_sections_and_the_name_of_a_run():
    """Every entry of [precision] but the budget changes a run's name; [posterior], which may come later, does not."""
    plain = with_section("precision", "target = 0.1")
    bare = with_section("posterior").model_copy(update={"posterior": None})
    for line in ("measure = 'far_all'", "estimators = ['lls']", "first = 500"):
        assert with_section("precision", "target = 0.1", line).digest() != plain.digest(), line
    assert with_section("precision", "target = 0.2").digest() != plain.digest() != bare.digest()
    assert with_section("precision", "target = 0.1", "seconds = 3.5").digest() == plain.digest()
    assert plain.stem() == bare.stem()
    assert Study.model_validate_json(plain.canonical()) == plain
    for lines in ([], ["trials = 2", 'noise = "known"'], ["box = 3.0", "walkers = 128", "keep_draws = 7"]):
        other = with_section("posterior", *lines)
        assert other.posterior is not None
        assert (other.run_name(), other.canonical()) == (bare.run_name(), bare.canonical())


@pytest.mark.parametrize(("cap", "points"), [(250, [250]), (251, [250, 251]), (1000, [250, 500, 1000]), (40, [40])])
def test_checkpoints(cap, points):
    """The first, doubled up to the cap; a cell that may have fewer than the first has one."""
    assert Precision(target=1.0).checkpoints(cap) == points


def test_reached():
    """At the target is enough; what is infinite or not a number never is, also beside an infinite measure."""
    absolute, relative = Precision(target=0.5), Precision(relative_target=0.25)
    assert absolute.reached(9.0, 0.5)
    assert not absolute.reached(9.0, 0.5000001)
    assert relative.reached(-2.0, 0.5)
    assert not relative.reached(-2.0, 0.51)
    assert not relative.reached(math.inf, math.inf)
    assert not absolute.reached(math.nan, math.nan)


def test_one_value_stands_for_a_list_of_one():
    """Noise, likelihood and the values of a condition may be written without brackets, conditions as a table."""
    bare = ('noise = "known"', 'likelihood = "geometric"', "where = { angle = 90, samples = 20 }")
    listed = ('noise = ["known"]', 'likelihood = ["geometric"]', "where = { angle = [90], samples = [20] }")
    table = ('noise = "known"', "[posterior.where]", "angle = 90", "samples = 20")
    assert with_section("posterior", *bare) == with_section("posterior", *listed) == with_section("posterior", *table)


CELL = Cell(samples=20, noise=0.1, angle=60.0, radius=2.0, center=(3.0, 0.0, 0.0))
VALUES = {"samples": 20, "noise": 0.1, "noise_over_radius": 0.05, "angle": 60.0, "radius": 2.0, "center": 3.0}


def test_chooses():
    """A cell is chosen if each condition has one of its values, to nine digits; without where, every cell is."""
    assert Posterior().chooses(CELL)
    for name, value in VALUES.items():
        assert Posterior(where={name: [value * (1.0 + 1e-12), 7e9]}).chooses(CELL)
        assert not Posterior(where={name: [value * (1.0 + 1e-6), 7e9]}).chooses(CELL)
    both = Posterior(where={"angle": 60, "radius": 1.0})
    assert not both.chooses(CELL)
    assert both.chooses(dataclasses.replace(CELL, radius=1.0))


def test_independence():
    """Cells are independent if each has its own draws or there is only one; those of a shared grid are not."""
    one = BASE.replace("[10, 20, 30]", "10")
    assert parse(RANDOM).independent()
    assert parse(one.replace("[0.1, 0.2, 0.3]", "0.1")).independent()
    assert parse(BASE + 'draws = "independent"\n').independent()
    assert not parse(BASE).independent()
    assert not parse(one).independent()


def test_the_shipped_config_asks_for_posteriors_that_the_theory_can_judge():
    """The shipped config has chains of both kinds of noise, independent cells and a hundred samples at least."""
    made = load(FOLDER / "posterior.toml")
    assert set(made.posterior.noise) == {"known", "unknown"}
    assert "geometric" in made.posterior.likelihood
    assert made.design.draws == "independent"
    assert min(made.design.samples) >= 100


def test_all_begin_with_a_sentence():
    """Every config begins with a comment of one sentence."""
    for path in config.shipped_configs().values():
        assert re.fullmatch(r"(?!.*\. ).{20,100}\.", config.summary_line(path)), path


def test_those_of_an_installed_package(monkeypatch, tmp_path):
    """Configs inside the package come before a folder beside it, which may be anybody's."""
    package = tmp_path / "study"
    for folder, name in ((package / "configs", "inside"), (tmp_path / "configs", "beside")):
        folder.mkdir(parents=True)
        (folder / f"{name}.toml").write_text("")
    monkeypatch.setattr(resources, "files", lambda name: package)
    for folder, names in ((package, ["inside"]), (tmp_path, ["beside"])):
        assert list(config.shipped_configs()) == names
        (folder / "configs" / f"{names[0]}.toml").unlink()
        (folder / "configs").rmdir()
    assert config.shipped_configs() == {}


def test_the_file_that_is_meant(monkeypatch, tmp_path):
    """A file is itself, also one without a suffix; a name with a suffix is a file, whether there or not."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "paper").write_text("")
    assert config.config_file(Path("paper")) == Path("paper")
    (tmp_path / "paper").unlink()
    assert config.config_file(Path("paper")) == config.shipped_config("paper")
    assert config.config_file(Path("paper.toml")) == Path("paper.toml")
