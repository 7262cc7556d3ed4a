"""Configs that are right: what they mean, and that equal meaning has an equal digest."""

from pathlib import Path

import numpy as np
import pytest

from study.experiment.config import Study, load, parse, read
from study.experiment.distributions import Constant

OTHERS = {"coverage.toml"}  # configs of other studies, which have their own reader
CONFIGS = sorted(p for p in (Path(__file__).parents[2] / "configs").glob("*.toml") if p.name not in OTHERS)


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.name)
def test_shipped_configs_parse(path):
    """Every config in configs/ is a study, named like its file."""
    study, text = read(path)
    assert study.name == path.stem
    assert study == load(path) == parse(text)


def test_there_are_configs():
    """The test above has something to test."""
    assert {"paper.toml", "sweep.toml", "smoke.toml"} <= {path.name for path in CONFIGS}


def test_defaults(make_study):
    """By default a study is three-dimensional, isotropic, of radius 1 about the origin, and shares draws."""
    study = make_study({"dimension": None})
    design = study.design
    assert (study.dimension, study.noise_shape, study.keep_points) == (3, None, 0)
    assert (design.radius, design.center, design.draws) == ((1.0,), (0.0,), "shared")


def test_ranges_include_both_ends(make_study):
    """Linspace and logspace give numpy's values, both ends among them, to 12 digits."""
    design = make_study(angle={"linspace": [0.1, 0.7, 7]}, noise={"logspace": [1e-6, 10.0, 8]}).design
    np.testing.assert_allclose(design.angle, np.linspace(0.1, 0.7, 7), rtol=1e-12)
    np.testing.assert_allclose(design.noise, 10.0 ** np.linspace(-6, 1, 8), rtol=1e-11)
    assert (design.angle[0], design.angle[-1], design.noise[0], design.noise[-1]) == (0.1, 0.7, 1e-6, 10.0)


def test_sample_ranges_are_rounded_and_each_number_occurs_once(make_study):
    """A range of N gives whole numbers without repetitions, in order."""
    assert make_study(samples={"logspace": [4, 8, 20]}).design.samples == (4, 5, 6, 7, 8)
    assert make_study(samples={"logspace": [10, 100_000, 5]}).design.samples == (10, 100, 1000, 10_000, 100_000)


def test_study_is_frozen(make_study):
    """A config cannot be changed once it is read."""
    with pytest.raises(ValueError, match="frozen"):
        make_study().seed = 2


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
        ('name = "test"\nseed = 1\n', 'seed = 1\nname = "test"  # another order\n\n'),
        ("kind", "# a comment\nkind"),
    ],
    ids=lambda change: change[1].replace("\n", " "),
)
def test_equal_meaning_equal_digest(change):
    """Spelling, order, comments and defaults do not count."""
    assert change[0] in BASE
    assert parse(BASE.replace(*change)).digest() == parse(BASE).digest()


def test_powers_of_ten_as_list_or_logspace(make_study):
    """A logspace over decades is the list of its powers of ten, to the bit."""
    listed = [float(f"1e{k}") for k in range(-13, 15)]
    assert make_study(noise=listed).digest() == make_study(noise={"logspace": [1e-13, 1e14, 28]}).digest()


def test_constant_law_in_words_or_as_a_number():
    """In a random design, a number and the constant law are the same config."""
    spelled = RANDOM.replace("noise = 0.1", 'noise = { law = "constant", value = 0.1 }')
    assert parse(spelled).digest() == parse(RANDOM).digest()
    assert parse(RANDOM).design.noise == Constant(law="constant", value=0.1)


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
        ("seed = 1\n", "seed = 1\nkeep_points = 1\n"),
        ("seed = 1\n", "seed = 1\ndimension = 2\n"),
        ("seed = 1\n", "seed = 1\nnoise_shape = [[2, 0, 0], [0, 1, 0], [0, 0, 1]]\n"),
    ],
    ids=lambda change: change[1].strip().replace("\n", " "),
)
def test_other_meaning_other_digest(change):
    """A change of any number of the run, down to the last bit, changes the digest."""
    assert parse(BASE.replace(*change)).digest() != parse(BASE).digest()


def test_run_name_is_a_plain_folder_name():
    """A run's folder is the name, a dash and ten hexadecimal digits."""
    name, digest = parse(BASE).run_name().rsplit("-", 1)
    assert name == "test"
    assert len(digest) == 10
    int(digest, 16)


def test_config_survives_its_own_canonical_form():
    """The canonical JSON, which goes into the tables' metadata, is read back as the same study."""
    for text in (BASE, RANDOM):
        study = parse(text)
        assert Study.model_validate_json(study.model_dump_json()) == study
