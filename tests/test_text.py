"""Columns of plain text: alignment, indentation, wrapping, and widths of characters.

The nearest known name, and the words that offer it.

Numbers in tables for a terminal.
"""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from study.text import columns, did_you_mean, duration, nearest, number, size


def test_alignment():
    """Columns are as wide as their widest text, titles included, and the last mark serves the rest."""
    found = list(columns([["a", "1.5", "10"], ["long name", "2", "3"]], ["name", "value", "n"], "<>"))
    assert found == ["name       value   n", "a            1.5  10", "long name      2   3"]


def test_indent_and_short_rows():
    """Lines start after the indentation, have no spaces at their end, and may lack their last columns."""
    assert list(columns([["a"], ["b", "c"]], indent=4)) == ["    a", "    b  c"]


def test_wrapping():
    """The last column alone is wrapped, between words, and goes on below itself."""
    found = list(columns([["name", "one two three"]], width=14))
    assert found == ["name  one two", "      three"]


def test_a_word_is_never_cut():
    """What does not fit stays whole: a name that is cut cannot be copied."""
    assert list(columns([["name", "one indivisible"]], width=10)) == ["name  one", "      indivisible"]


def test_accents_take_no_place():
    """σ̂ is two characters in one place of a terminal."""
    assert list(columns([["σ̂", "1"], ["σσ", "2"]])) == ["σ̂   1", "σσ  2"]


def test_nothing():
    """No rows and no header make no line; a header alone makes one."""
    assert list(columns([])) == []
    assert list(columns([], ["a", "b"])) == ["a  b"]


def test_a_terminal_changes_nothing(monkeypatch):
    """The lines are the same in a narrow terminal and in one with colours."""
    rows = [["x" * 60, "[bold]y[/bold] " * 20]]
    before = list(columns(rows))
    for name, value in {"COLUMNS": "20", "FORCE_COLOR": "1", "TERM": "xterm-256color"}.items():
        monkeypatch.setenv(name, value)
    assert list(columns(rows)) == before == ["x" * 60 + "  " + ("[bold]y[/bold] " * 20).rstrip()]


WORDS = st.text(st.characters(codec="ascii", categories=["L", "N"]), min_size=1, max_size=12)


@given(st.integers(1, 5).flatmap(lambda n: st.lists(st.lists(WORDS, min_size=n, max_size=n), min_size=1, max_size=6)))
def test_texts_come_back(rows):
    """Split at its spaces, every line gives its row back."""
    assert [line.split() for line in columns(rows)] == rows


@pytest.mark.parametrize("mark", ["<", ">"])
def test_columns_line_up(mark):
    """All texts of a column begin, or end, at one place."""
    names = ["a", "bb", "ccc"]
    lines = list(columns([[name, "x"] for name in names], align=mark))
    places = [line.index(name) + (len(name) if mark == ">" else 0) for line, name in zip(lines, names, strict=True)]
    assert len(set(places)) == 1


KNOWN = ("mle", "lls", "ugdk", "gdke")


def test_nearest():
    """A misspelt name finds its own; one that is like none finds none."""
    assert nearest("ugdkk", KNOWN) == "ugdk"
    assert nearest("lsl", iter(KNOWN)) == "lls"
    assert nearest("zzz", KNOWN) is None
    assert nearest("x", []) is None


def test_capitals():
    """A name that differs in capitals alone is the nearest, whatever else is like it."""
    assert nearest("Als", ["lls", "als"]) == "als"
    assert nearest("FIG2", ["fig2_error", "fig_map"]) == "fig2_error"
    assert nearest("cmu", ["CMU41", "other"]) == "CMU41"


def test_the_beginning_of_a_name():
    """It finds the only name that begins so."""
    known = ["fig2_error", "fig5_methods", "fig_map", "fig_posterior"]
    assert nearest("fig2", known) == "fig2_error"
    assert nearest("f", known) is None
    assert nearest("", ["a"]) is None


def test_did_you_mean():
    """The nearest is offered first; all are listed, in their order."""
    assert did_you_mean("lsl", KNOWN) == "did you mean 'lls'? Known are mle, lls, ugdk, gdke"
    assert did_you_mean("zzz", iter(KNOWN)) == "known are mle, lls, ugdk, gdke"


def test_several_names():
    """Each unknown name that is like a known one is answered, and the list comes once."""
    assert did_you_mean(["lsl", "zzz", "gdkee"], KNOWN) == (
        "did you mean 'lls' and 'gdke'? Known are mle, lls, ugdk, gdke"
    )


def test_numbers():
    """Three digits, or what a format says; a dash where there is no number."""
    assert number(1234.5678) == "1.23e+03"
    assert number(0.0156, ".1%") == "1.6%"
    assert number(math.nan) == "-"
    assert number(math.inf, ".0f") == "inf"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (duration(0.04), "0.0 s"),
        (duration(119.0), "119.0 s"),
        (duration(2 * 60.0), "2.0 min"),
        (duration(36 * 3600.0), "36.0 h"),
        (duration(8 * 86_400.0), "8.0 days"),
        (duration(3e9), "95.1 years"),  # 3e9 / 31 557 600, the seconds of a Julian year
        (duration(3e14), "9,506,426.3 years"),
        (size(3e5), "0.3 MB"),
        (size(1.999e9), "1,999.0 MB"),
        (size(5.1e10), "51.0 GB"),
        (size(5.1e13), "51.0 TB"),
        (size(5.1e20), "510.0 EB"),
    ],
)
def test_units(text, expected):
    """Times and sizes are in units that a reader can picture."""
    assert text == expected
