"""The field's words are answered with what there is, and none of them works by itself."""

import pickle
import re

import numpy as np
import pytest

import study
from study import words
from study.fits.fitting import choose
from study.fits.points.point_formats import PointFileError
from study.simulation.experiment.config import parse
from study.toml import ConfigError
from tests.configs import config

POINTS = [[1, 0], [0, 1], [-1, 0], [0, -1.0], [0.6, 0.8]]


@pytest.mark.parametrize(
    ("word", "says"),
    [
        ("kasa", "use study.fit(points, 'gdke')"),
        ("Kåsa", "use study.fit(points, 'gdke')"),
        ("ransac", "use study.fit(points, 'robust')"),
        ("taubin", "use study.fit(points, 'taubin')"),
        ("fit_sphere", "use study.fit"),
        ("load", "use study.read_points"),
        ("read_recordings", "did you mean 'read_recording'? Known are ESTIMATORS, "),
    ],
)
def test_of_the_package(word, says):
    """A name that the package has not is answered by the one that it has."""
    with pytest.raises(AttributeError) as caught:
        getattr(study, word)
    assert str(caught.value).startswith(f"module 'study' has no attribute {word!r}: {says}")


@pytest.mark.parametrize(
    ("word", "says"),
    [
        ("centre", "use center"),
        ("conf_int", "use interval('radius') or interval('center')"),
        ("summary", "use print(fit) for a line, or to_frame() for all numbers"),
        ("predict", "use distance(points), the signed distances of points"),
        ("params", "use center and radius"),
        ("params_", "use center and radius"),
        ("resid", "use residuals"),
        ("radiuss", "did you mean 'radius'? Known are "),
    ],
)
@pytest.mark.parametrize("known", [{}, {"radius": 1.0}], ids=["Fit", "GivenFit"])
def test_of_a_fit(word, says, known):
    """An attribute that a fit has not is answered by the one that it has."""
    with pytest.raises(AttributeError) as caught:
        getattr(study.fit(POINTS, **known), word)
    kind = "Fit"
    assert str(caught.value).startswith(f"{kind!r} object has no attribute {word!r}: {says}")


@pytest.mark.parametrize(
    ("call", "failure"),
    [
        (lambda name: study.fit(POINTS, name), ValueError),
        (lambda name: study.fit_spheres(np.tile(POINTS, (2, 1)), 1, estimator=name), ValueError),
        (lambda name: choose(name, None), PointFileError),
    ],
    ids=["fit", "fit_spheres", "command"],
)
def test_of_estimators(call, failure):
    """Whatever takes the name of an estimator knows what the field calls it, and lists all names."""
    for word, own in (("geometric", "mle"), ("Delogne-Kåsa", "gdke"), ("RANSAC", "robust")):
        with pytest.raises(failure, match=rf"{word}.*: unknown; use '{own}' for '{word}'; known are mle, .*igdk"):
            call(word)


def test_an_estimator_that_is_not_known_is_not_named():
    """Where only some estimators are known, such as in a run, the others are no remedy."""
    assert words.estimator_remedy("kasa", ["mle", "als"]) == "known are mle, als"
    said = words.estimator_remedy(["kasa", "geometric"], ["mle", "gdke"])
    assert said == "use 'gdke' for 'kasa', 'mle' for 'geometric'; known are mle, gdke"


@pytest.mark.parametrize(
    ("argument", "says"),
    [
        ("method", "give estimator=, a name"),
        ("estimators", "did you mean 'estimator'"),
        ("weights", "give noise=, the standard deviation of each point"),
        ("x0", "leave it out; no fit needs a start"),
        ("residual_threshold", "give estimator='robust'"),
    ],
)
def test_of_arguments(argument, says):
    """An argument that a fit does not take is answered by the one that it takes."""
    with pytest.raises(TypeError, match=f"study.fit takes no {argument}=: {says}"):
        study.fit(POINTS, **{argument: "geometric"})


def test_the_tables_lead_to_what_is_there():
    """Every remedy is a name that works, and no word of the field is one."""
    assert set(words.ESTIMATORS.values()) | words._OWN <= set(study.ESTIMATORS)
    assert set(words.NAMES.values()) <= set(study.__all__)
    assert {own for own, _ in words.ANSWERS.values()} <= set(dir(study.Fit))
    assert not set(words.ESTIMATORS) & set(study.ESTIMATORS)
    assert not set(words.NAMES) & set(study.__all__)
    assert not set(words.ANSWERS) & set(dir(study.Fit))
    for table in (words.ESTIMATORS, words.NAMES, words.ANSWERS):
        assert [word for word in table if words._plain(word) != word] == []


def test_a_fit_is_still_an_object():
    """A fit can be asked for what it may not have, and copied; an error within a property is shown as it is."""
    fit = study.fit(POINTS)
    assert not hasattr(fit, "centre")
    assert not hasattr(fit, "__array__")
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(fit)).center, fit.center)

    class Broken(words.Hinting):
        @property
        def center(self):
            return np.nothing

    with pytest.raises(AttributeError, match="numpy"):
        _ = Broken().center


def test_all_leaves_out_variants():
    """`-e all` has neither lls_single nor mle_mirror; by their names they are taken."""
    assert set(study.ESTIMATORS) - set(choose("all", 0.1)) == {"lls_single", "mle_mirror"}
    for name in ("lls_single", "mle_mirror"):
        assert choose(name, None) == [name]


def test_other_answers_hint_as_a_fit_does():
    """The fit of several markers, spheres of a cloud and the minimum zone name what they have for the field's words."""
    rng = np.random.default_rng(12)
    ball = rng.normal(size=(200, 3))
    ball = ball / np.linalg.norm(ball, axis=1)[:, None] + rng.normal(0.0, 0.01, (200, 3))
    for one in (study.mgdk([ball, 2.0 * ball]), study.fit_spheres(ball, 1), study.minimum_zone(ball)):
        with pytest.raises(AttributeError, match="has no attribute 'centre': use center"):
            _ = one.centre
        with pytest.raises(AttributeError, match="_nothing"):
            _ = one._nothing
    with pytest.raises(AttributeError, match=r"'JointFit' object has no attribute 'stderr': use standard_errors"):
        _ = study.mgdk([ball, 2.0 * ball]).stderr


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("methods = ['mle']", "use 'estimators'"),
        ("random_seed = 3", "use 'seed'"),
        ("repetitions = 10", "use 'trials' in [design]"),
        ("sigma = [0.1]", "use 'noise_over_radius' in [design]"),
        ("samples = [10]", "use 'samples' in [design]"),
        ("seeed = 3", "did you mean 'seed'? Known are name, seed, "),
    ],
)
def test_of_keys(line, says):
    """A key that a table of a config has not is answered by the one that it has, or by the table that has it."""
    with pytest.raises(ConfigError, match=re.escape(f"{line.split()[0]} = ") + ".*unknown key; " + re.escape(says)):
        parse(f"{line}\n{config()}")
