import itertools
import subprocess
import sys

import matplotlib
import numpy as np
import pytest
from matplotlib.figure import Figure

from study.estimators import ESTIMATORS
from study.figures import style


def test_every_estimator_has_a_color_of_its_own():
    """No two estimators, a user's own among them, are as near in colour as the eye would confuse."""
    names = [*ESTIMATORS, *style._LOOKS, "my_own", "another"]
    rgb = {name: np.array(matplotlib.colors.to_rgb(style.color(name))) for name in names}
    for one, other in itertools.combinations(rgb, 2):
        assert np.linalg.norm(rgb[one] - rgb[other]) > 0.1, f"{one} and {other}"


def test_every_registered_estimator_has_a_fixed_look():
    """A registered estimator without a line in the style would be drawn as a user's own."""
    assert set(ESTIMATORS) <= set(style._LOOKS)


def test_unknown_estimator_looks_the_same_in_every_process():
    """The colour of a user's own estimator comes from its name, not from Python's randomised hash."""
    code = "from study.figures import style; print(style.color('my_own'))"
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip()
    assert told == style.color("my_own")
    assert style.label("my_own") == "my_own"


def test_settings_do_not_leak(monkeypatch):
    """The journal style holds inside only, and a user's own settings do not reach into it."""
    monkeypatch.setitem(matplotlib.rcParams, "font.size", 31.0)
    with style.journal():
        assert matplotlib.rcParams["font.size"] == 8.0
        assert matplotlib.rcParams["svg.fonttype"] == "path"
    assert matplotlib.rcParams["font.size"] == 31.0


def test_spread_keeps_labels_apart_and_inside():
    """Labels do not overlap, keep their order, and stay within the axis."""
    wanted, heights = [0.02, 0.5, 0.51, 0.0, 0.98], [0.1, 0.1, 0.2, 0.1, 0.1]
    placed = style.spread(wanted, heights)
    order = np.argsort(wanted)
    gaps = np.diff(placed[order])
    needed = 0.5 * (np.array(heights)[order][1:] + np.array(heights)[order][:-1])
    assert (gaps >= needed - 1e-12).all()
    assert placed.min() >= 0.05 - 1e-12
    assert placed.max() <= 0.95 + 1e-12


def test_spread_leaves_labels_that_have_room():
    """A label that overlaps none stays where it belongs."""
    np.testing.assert_allclose(style.spread([0.8, 0.2, 0.5], [0.1] * 3), [0.8, 0.2, 0.5])


@pytest.mark.parametrize(
    ("value", "text"), [(0.5284, "0.528"), (-0.0276, "−0.0276"), (1e-5, "1 × $10^{-5}$"), (2.5e13, "2.5 × $10^{13}$")]
)
def test_number(value, text):
    """Three digits, powers of ten in words that a paper would print."""
    assert style.number(value) == text


def test_decimals_has_no_negative_zero():
    """Minus zero is zero."""
    assert style.decimals(-0.0004, 2) == "0.00"
    assert style.decimals(-0.516, 2) == "−0.52"


def test_joined_breaks_between_names_only():
    """A name of two words is not torn apart at a line's end."""
    text = style.joined(["lls", "lls_nr_raw", "gdke"], ": 1", width=12).replace("\xa0", " ")
    assert text.split("\n") == ["LLS =", "LLS (NR, raw)", "= GDKE: 1"]


def test_saved_files_carry_no_date_and_no_software(tmp_path):
    """Neither the clock nor the version of the plotting library is in the files."""
    figure = Figure(figsize=(2, 2))
    figure.subplots().plot([0, 1], [0, 1])
    png, svg = style.save(figure, tmp_path / "name.with.dots")
    assert [png.name, svg.name] == ["name.with.dots.png", "name.with.dots.svg"]
    assert b"Software" not in png.read_bytes()
    text = svg.read_text(encoding="utf-8")
    assert "dc:date" not in text
    assert "dc:creator" not in text
