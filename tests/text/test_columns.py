"""Columns of plain text: alignment, indentation, wrapping, and widths of characters."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from study.text.columns import columns


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
