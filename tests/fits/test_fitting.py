"""A user's points fitted: the answers are those of the library, and what is printed of them is true.

Remarks on fitted points, in words and as numbers.
"""

import decimal
import itertools
import math
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

import study
from study.fits import Status, fitting
from study.fits.answers.answer import visible_moves
from study.fits.fitting import (
    choose,
    doubts,
    fit_all,
    fit_rows,
    intervals_in_words,
    noise_law_in_words,
    printed,
    visible_in_words,
)
from study.fits.points.point_files import PointTable
from study.simulation import commands

BIASED = {"lls", "lls_nr", "lls_nr_raw", "lls_single", "gdke", "igdk"}

FREE = [name for name, entry in study.ESTIMATORS.items() if entry.needs != "noise"]


def shown(points, estimators=FREE, noise=None, names="xyz"):
    """The table's rows by estimator, and the lines below it, as a user gets them."""
    names = list(names[: points.shape[1]])
    fits = fit_all(points, list(estimators), noise)
    head, *lines = printed(fit_rows(fits, names), names)
    assert re.split(r" {2,}", head) == ["estimator", *names, "radius", "noise", "rms", "ρ", "samples", "status"]
    rows = {cells[0]: cells[1:] for cells in (re.split(r" {2,}", line) for line in lines[: len(fits)])}
    assert list(rows) == list(estimators)
    empty, title, *form = lines[len(fits) : 2 * len(fits) + 2]
    assert empty == ""
    assert re.split(r" {2,}", title) == ["estimator", "diameter", "form error", "largest deviation"]
    assert [line.split()[0] for line in form] == list(estimators)
    return rows, lines[2 * len(fits) + 2 :]


@pytest.mark.parametrize(
    ("d", "noise"),
    [
        *itertools.product((2, 3), (None, 0.05)),
        pytest.param(4, 0.05, marks=[pytest.mark.plain, pytest.mark.slow]),
    ],
)
def test_answers_are_the_librarys(rng, on_cap, d, noise):
    """Each number of the table is that of study.fit on the same array."""
    points, _ = on_cap(rng, 60, angle=70.0, d=d, noise=0.05, center=3.0)
    points[4, 1] = np.nan
    names = list("abcd"[:d])
    table = pd.DataFrame(fit_rows(fit_all(points, choose("all", noise), noise), names)).set_index("estimator")
    every = FREE if noise is None else list(study.ESTIMATORS)
    assert list(table.index) == [name for name in every if name not in ("lls_single", "mle_mirror")]
    for name, row in table.iterrows():
        fit = study.fit(points, name, noise)
        np.testing.assert_array_equal([row[f"center_{c}"] for c in names] + [row["radius"]], [*fit.center, fit.radius])
        errors = [row[f"error_{c}"] for c in names] + [row["radius_error"]]
        np.testing.assert_array_equal(errors, fit.standard_errors)
        np.testing.assert_allclose(row["noise"] ** 2, fit.estimates.noise_variance)
        distance = np.linalg.norm(np.delete(points, 4, axis=0) - fit.center, axis=1)
        np.testing.assert_allclose(row["residual_rms"], np.sqrt(np.mean((distance - fit.radius) ** 2)))
        np.testing.assert_allclose(row["form_error"], np.ptp(distance), rtol=1e-10)
        np.testing.assert_allclose(row["largest_deviation"], np.abs(distance - fit.radius).max(), rtol=1e-10)
        assert (row["diameter"], row["diameter_error"]) == (2 * row["radius"], 2 * row["radius_error"])
        assert row["samples"] == 59


def test_columns_may_have_any_name(rng, on_cap):
    """A coordinate called radius, noise or x_error takes no other number's place."""
    points, _ = on_cap(rng, 50, noise=0.01, center=7.0, radius=2.0)
    for names in map(str.split, ("radius noise status", "x x_error error_x", "samples center_radius estimator")):
        (row,) = fit_rows(fit_all(points, ["als"], None), names)
        assert row["estimator"] == "als"
        np.testing.assert_allclose([row[f"center_{name}"] for name in names], 7.0, atol=0.05)
        np.testing.assert_allclose([row["radius"], row["noise"]], [2.0, 0.01], rtol=0.5)
        assert row["samples"] == 50


def with_error(value, error):
    """Value and error as they are printed for a coordinate."""
    row = {"estimator": "als", "center_x": value, "error_x": error, "radius": 1.0, "radius_error": 0.1}
    row |= {"noise": 1.0, "residual_rms": 1.0, "condition": 0.1, "samples": 9, "status": Status.OK.text}
    row |= dict.fromkeys(["diameter", "diameter_error", "form_error", "largest_deviation"], 1.0)
    _, line, *_ = printed([row], ["x"])
    return re.split(r" {2,}", line)[1]


@given(st.floats(-1e7, 1e7), st.floats(1e-8, 1e6))
def test_two_digits_of_the_error(value, error):
    """The error has two significant digits, rounded by decimal arithmetic; the value ends at the same place."""
    two = decimal.Context(prec=2, rounding=decimal.ROUND_HALF_EVEN).create_decimal(decimal.Decimal(error))
    said = re.fullmatch(r"(-?\d+)(\.\d+)? ± (\d+)(\.\d+)?", with_error(value, error))
    assert decimal.Decimal(said[3] + (said[4] or "")) == two
    assert len(said[2] or "") == len(said[4] or "") == max(0, 1 - two.adjusted()) + (two.adjusted() < 1)
    place = decimal.Decimal(1).scaleb(two.adjusted() - 1)
    assert abs(decimal.Decimal(said[1] + (said[2] or "")) - decimal.Decimal(value)) <= place / 2


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (1.23456, 0.0996, "1.23 ± 0.10"),
        (1.23456, 9.96, "1 ± 10"),
        (12345.0, 678.0, "12340 ± 680"),
        (-0.004, 0.12, "0.00 ± 0.12"),
        (math.pi, math.nan, "3.14159 ± ?"),
        (math.pi, math.inf, "3.14159 ± ?"),
        (math.pi, 0.0, "3.14159"),
        (math.nan, 0.1, "-"),
    ],
)
def test_values_with_errors(value, error, text):
    """Rounding that carries, tens, no minus zero, and what has no error or no value."""
    assert with_error(value, error) == text


def test_ok_fits_have_nothing_below_but_cautions(rng, on_cap):
    """On a good set every status is ok; those that the noise biases are named below, and no other."""
    rows, below = shown(on_cap(rng, 300, angle=90.0, noise=0.02)[0])
    assert {cells[-1] for cells in rows.values()} == {"ok"}
    (caution,) = below
    named, words = caution.split(": ")
    assert set(named.split(", ")) == BIASED
    assert "biased towards the points" in words
    assert shown(on_cap(rng, 300, noise=0.02)[0], ["als", "mle"])[1] == []


def test_the_caution_is_true(rng, on_cap):
    """The biased are off the truth, towards the points, by more than five of their standard errors; als is not.

    One set of 20 000 points; als is beyond 4.5 in 7 of 10⁶ sets.
    """
    points, _ = on_cap(rng, 20_000, angle=50.0, noise=0.05)
    for name in [*BIASED, "als"]:
        fit = study.fit(points, name)
        pull = fit.center[0] / fit.standard_errors[0]
        assert (pull > 5.0) if name in BIASED else (abs(pull) < 4.5), name


def test_statuses_are_explained_once(rng, on_cap):
    """Each status that is not ok is a line with all estimators that ended so, in the library's words."""
    points, _ = on_cap(rng, 100, angle=60.0, d=2, noise=0.01)
    hinge = np.column_stack([points, 0.01 * rng.normal(size=100)])
    rows, below = shown(hinge)
    told = {name: words for names, words in (line.split(": ", 1) for line in below) for name in names.split(", ")}
    found = {}
    for name, cells in rows.items():
        status = Status(int(study.fit(hinge, name).status))
        assert cells[-1] == ("ok" if status == Status.OK else "see below")
        if status != Status.OK:
            found.setdefault(status, []).append(name)
            assert name in BIASED or told[name] == status.text
    assert set(found[Status.HINGE]) == {*rows}
    for status, names in found.items():
        assert below.count(f"{', '.join(names)}: {status.text}") == 1


@pytest.mark.parametrize("kind", ["plane", "arc", "line", "point"])
def test_flat_sets_without_noise(rng, kind):
    """Coplanar points have no sphere: statuses and dashes, no numbers made up, no warning."""
    t = rng.uniform(-1, 1, 40)
    arc, line = np.column_stack([np.cos(t), np.sin(t)]), np.outer(t, [1, 2])
    flat = {"plane": rng.normal(size=(40, 2)), "arc": arc, "line": line}
    points = np.column_stack([flat.get(kind, np.ones((40, 2))), np.full(40, 3.0)])
    rows, below = shown(points)
    for name, cells in rows.items():
        if study.fit(points, name).status != Status.OK:
            assert cells[-1] == "see below"
        assert all("nan" not in cell for cell in cells)
    assert rows["als"][:4] == ["-"] * 4
    status = Status.HINGE if kind == "arc" else Status.SINGULAR
    assert any(line.endswith(status.text) for line in below)


def test_the_least_number_of_points(rng, on_cap):
    """As few as d + 1 points leave no noise to estimate: values without errors, and no noise."""
    rows, _ = shown(on_cap(rng, 4, noise=0.01)[0], ["mle", "gdke", "als"])
    for cells in rows.values():
        assert all(cell.endswith("± ?") or cell == "-" for cell in cells[:4])
        assert cells[4] == "-"
        assert cells[7] == "4"


def test_the_list_of_estimators_is_the_registry(capsys):
    """A line per registered estimator: its name, cost, what it needs and where it is from."""
    commands.estimators()
    head, *lines = capsys.readouterr().out.splitlines()
    assert head.split()[0] == "estimator"
    assert [line.split()[0] for line in lines] == list(study.ESTIMATORS)
    for line, entry in zip(lines, study.ESTIMATORS.values(), strict=True):
        assert line.endswith(entry.reference)
        assert ("  noise  " in line) == (entry.needs == "noise")
        assert entry.flops is None or f" {entry.flops(3):g} " in line


@pytest.fixture
def cap(rng, on_cap):
    """40 points on a cap of 60°, with noise of .01 r."""
    points, _ = on_cap(rng, 40, 60.0, 3, 0.01)
    return points


def test_intervals_in_words(cap):
    """One line with the radius and each coordinate, whose ends are those of the fit to the digits shown."""
    fit = study.fit(cap)
    (line,) = intervals_in_words(fit, ["x", "y", "z"])
    words = line.split(": ", 1)[1].split(", ")
    assert line.startswith("95 % intervals: radius ")
    assert [part.split()[0] for part in words] == ["radius", "x", "y", "z"]
    ends = np.array([[float(part.split()[1]), float(part.split()[3])] for part in words])
    wanted = np.vstack([fit.interval("radius"), fit.interval("center")])
    widths = wanted[:, 1:] - wanted[:, :1]
    np.testing.assert_array_less(np.abs(ends - wanted), np.broadcast_to(0.01 * widths, ends.shape))
    (numbers,) = fit_rows({"corrected": fit}, ["x", "y", "z"])
    assert numbers["radius_low"] == wanted[0, 0]
    assert numbers["center_z_high"] == wanted[3, 1]


def test_another_shape_is_named():
    """Ellipsoids and ellipses are named; spheres are not, nor points whose outliers are named already."""
    rng = np.random.default_rng(11)
    for d, name in ((2, "circle"), (3, "sphere")):
        u = rng.normal(size=(300, d))
        u /= np.linalg.norm(u, axis=1)[:, None]
        noise = 0.01 * rng.normal(size=u.shape)
        (line,) = doubts(study.fit(u * np.linspace(1.0, 0.9, d) + noise))
        assert line.startswith(f"not a {name} with white noise (shape, p < 1e-9): another shape")
        assert list(doubts(study.fit(u + noise))) == []  # p is .1 or more; a clean set is named in one of a hundred
        noise[3] += 0.5
        assert not any("white noise" in line for line in doubts(study.fit(u + noise)))


def test_an_open_interval_in_words(rng, on_cap):
    """Points that do not bound the radius are told so, with what they say of it."""
    points, _ = on_cap(rng, 40, 2.0, 3, 0.01)
    (line,) = intervals_in_words(study.fit(points), ["x", "y", "z"])
    assert "do not bound it" in line
    assert "radius at least" in line


def test_outliers_and_copies(cap):
    """Both are named; `robust` says that it left outliers out."""
    assert list(doubts(study.fit(cap))) == []
    wrong = cap.copy()
    wrong[7] += 0.5
    said = "1 of 40 points is an outlier (row 8): the fit "
    line = next(doubts(study.fit(wrong)))
    assert line.startswith(f"{said}uses it; -e robust leaves it out; without it it moves by ")
    assert float(line.split()[-2]) > 10.0  # half a radius is fifty times the noise
    assert list(doubts(study.fit(wrong, "robust"))) == [f"{said}leaves it out"]
    twice = np.repeat(cap, 5, axis=0)
    assert list(doubts(study.fit(twice))) == [
        "160 of 200 rows repeat earlier ones; if they are no new measurement, every ± is too small",
        "for the intervals, rows that repeat an earlier one count once",
    ]


@pytest.mark.parametrize("n", [5, 6])
def test_points_too_few_to_tell_are_not_ok(on_cap, n):
    """Five or six points cannot tell a sphere from another shape, and the fit says so."""
    fit = study.fit(on_cap(np.random.default_rng(3), n, 180.0, noise=1e-4)[0])
    assert fit.status == Status.UNTESTED
    assert fit.goodness.in_words()["shape"] == "not tested: the points are too few to tell"


def test_the_form_that_is_just_seen_is_told(on_cap):
    """Few points say what they could hide, and what would settle it; enough points what they would have seen."""
    few, enough = (study.fit(on_cap(np.random.default_rng(3), n, 180.0, noise=1e-4)[0]) for n in (9, 40))
    assert few.status == Status.UNTESTED
    hidden, remedy = visible_in_words(few)
    assert hidden.startswith("9 points would often hide a form of 3.4 σ; it")
    assert "moves the radius by" in hidden
    assert remedy.startswith("to settle it: 15 points or more, or the noise (--noise), or --assume sphere")
    (line,) = visible_in_words(enough)
    assert line.startswith("the test of shape sees a form of 0.8")
    assert study.fit(few.samples.points[0], noise=1e-4).ok


def test_moves_of_a_form_that_is_just_seen(on_cap):
    """They are those of 2000 random forms of that size, by least squares of NumPy, to a tenth."""
    rng = np.random.default_rng(5)
    points = on_cap(rng, 30, 60.0, noise=1e-3)[0]
    fit = study.fit(points)
    away = points - fit.center
    e = away / np.linalg.norm(away, axis=1, keepdims=True)
    matrices = rng.normal(size=(2000, 3, 3))
    matrices = matrices + matrices.swapaxes(1, 2) - np.einsum("bii->b", matrices)[:, None, None] * np.eye(3) / 1.5
    form, X = np.einsum("ni,bij,nj->bn", e, matrices, e), np.column_stack([e, np.ones(30)])
    moved = np.linalg.pinv(X) @ form.T
    size = np.mean((form.T - X @ moved) ** 2) ** 0.5
    expected = np.sqrt((moved**2).mean(axis=1)) / size * fit.goodness.visible_form * fit.sigma / fit.standard_errors
    np.testing.assert_allclose(visible_moves(fit), expected, rtol=0.1)
    assert fit.to_dict()["visible_moves"] == visible_moves(fit).tolist()


def test_infinite_rows(cap):
    """A coordinate that is not finite is told with its row."""
    cap[[6, 20], 1] = np.inf
    assert next(doubts(study.fit(cap))) == "not finite in 2 of 40 rows, the first of which is row 7"


@pytest.mark.parametrize(("width", "expected"), [(5.0, Status.HINGE), (25.0, Status.OK)])
def test_belts(width, expected):
    """Points about an equator, whose centre is as uncertain as they are high, are a hinge; wide belts are not."""
    rng = np.random.default_rng(4)
    z, turn = np.sin(np.radians(width)) * rng.uniform(-1, 1, 40), rng.uniform(0, 2 * np.pi, 40)
    across = np.sqrt(1 - z**2)
    points = np.column_stack([across * np.cos(turn), across * np.sin(turn), z]) + 0.02 * rng.standard_normal((40, 3))
    fit = study.fit(points)
    assert fit.status == expected
    assert any("centre may be anywhere on that axis" in line for line in doubts(fit)) == (expected == Status.HINGE)


@pytest.mark.parametrize("along", [True, False])
def test_noise_along_the_radius_alone(rng, on_cap, along):
    """To leading order `mle` is d - 1 times ½σ²/r above `corrected`: .0036 here, 3.8 ± of σ/√N. The line names both.

    With 100 points that is .6 ±, and there is no line.
    """
    directions, _ = on_cap(rng, 4000, angle=180.0, noise=0.0)
    noise = rng.normal(0.0, 0.06, (4000, 1)) * directions if along else rng.normal(0.0, 0.06, (4000, 3))
    points = directions + noise
    one, other = (study.fit(points, name) for name in ("corrected", "mle"))
    assert float(other.radius - one.radius) == pytest.approx(0.06**2, rel=0.2)
    (line,) = noise_law_in_words(one, other, ["x", "y", "z"])
    assert float(line.split()[1]) == pytest.approx(float(one.radius), abs=1e-5)
    assert float(re.search(r"by corrected, ([\d.]+) by mle: ", line)[1]) == pytest.approx(float(other.radius), abs=1e-5)
    few = [study.fit(points[:100], name) for name in ("corrected", "mle")]
    assert list(noise_law_in_words(*few, ["x", "y", "z"])) == []


@pytest.mark.parametrize("ok", [True, False])
def test_the_line_on_the_noise_is_computed_for_ok_fits_alone(rng, on_cap, monkeypatch, ok):
    """A second fit, by `mle`, is made for it: not where the fit is not ok, which says so itself."""
    points, _ = on_cap(rng, 60, angle=90.0 if ok else 3.0, noise=0.02)
    first, made = study.fit(points), []
    assert bool(first.ok) == ok
    monkeypatch.setattr(fitting, "fit", lambda x, name: made.append(name) or study.fit(x, name))
    list(
        fitting.as_text(
            [fitting.FileFits(Path("x.csv"), PointTable(points, ["x", "y", "z"], []), {"corrected": first})]
        )
    )
    assert made == ["mle"] * ok
