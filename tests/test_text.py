"""Columns of plain text: alignment, indentation, wrapping, and widths of characters.

The nearest known name, and the words that offer it.

Numbers in tables for a terminal.

What leaves the program: control characters are shown, cells of CSV are inert, and a pipe is no table.
"""

import io
import math
import os

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from study import files
from study.files import RunError, save_frame
from study.options import shown, unchanged
from study.recordings.formats.read import read_recording
from study.recordings.recording import RecordingError
from study.simulation.report.page import read_bench
from study.text import columns, did_you_mean, duration, inert, inert_frame, listed, nearest, number, size


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        # as wide as their widest text, titles included; the last mark serves the rest
        (
            ([["a", "1.5", "10"], ["long name", "2", "3"]], ["name", "value", "n"], "<>"),
            ["name       value   n", "a            1.5  10", "long name      2   3"],
        ),
        (([["a"], ["b", "c"]], (), "<", 4), ["    a", "    b  c"]),  # no spaces at a line's end, short rows
        (([["name", "one two three"]], (), "<", 0, 14), ["name  one two", "      three"]),
        (([["name", "one indivisible"]], (), "<", 0, 10), ["name  one", "      indivisible"]),  # no name is cut
        (([["σ̂", "1"], ["σσ", "2"]],), ["σ̂   1", "σσ  2"]),  # accents take no place
        (([],), []),
        (([], ["a", "b"]), ["a  b"]),
    ],
)
def test_columns(arguments, expected):
    """Alignment, indentation, wrapping of the last column between words, and nothing."""
    assert list(columns(*arguments)) == expected


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


KNOWN = ("mle", "lls", "ugdk", "gdke")


FIGURES = ["fig2_error", "fig5_methods", "fig_map", "fig_posterior"]


@pytest.mark.parametrize(
    ("name", "known", "expected"),
    [
        ("ugdkk", KNOWN, "ugdk"),
        ("lsl", iter(KNOWN), "lls"),
        ("zzz", KNOWN, None),
        ("x", [], None),
        ("", ["a"], None),
        ("Als", ["lls", "als"], "als"),  # capitals alone differ
        ("FIG2", ["fig2_error", "fig_map"], "fig2_error"),
        ("cmu", ["CMU41", "other"], "CMU41"),
        ("fig2", FIGURES, "fig2_error"),  # the only one that begins so
        ("f", FIGURES, None),
    ],
)
def test_nearest(name, known, expected):
    """A misspelt name, other capitals and the beginning of a name find their own; one that is like none finds none."""
    assert nearest(name, known) == expected


@pytest.mark.parametrize(
    ("names", "words"),
    [
        ("lsl", "did you mean 'lls'? Known are mle, lls, ugdk, gdke"),
        ("zzz", "known are mle, lls, ugdk, gdke"),
        (["lsl", "zzz", "gdkee"], "did you mean 'lls' and 'gdke'? Known are mle, lls, ugdk, gdke"),
    ],
)
def test_did_you_mean(names, words):
    """Each unknown name that is like a known one is answered; all are listed once, in their order."""
    assert did_you_mean(names, iter(KNOWN)) == words


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


def test_control_characters():
    """All of ASCII and Latin-1 but tab and line feed, and marks that turn a text around; letters stay."""
    below = io.StringIO()
    stream = shown(below)
    assert shown(stream) is stream
    assert unchanged(stream) is unchanged(below) is below
    print("ρ ± µ\tα", file=stream)
    stream.writelines(["\x1b[2J\r", "\x9b\x7f\u202e"])
    assert below.getvalue() == "ρ ± µ\tα\n\\x1b[2J\\x0d\\x9b\\x7f\\u202e"
    every = "".join(map(chr, range(256)))
    stream.write(every)
    left = {c for c in below.getvalue() if not c.isprintable()}
    assert left <= {"\t", "\n", "\xa0", "\xad"}
    assert not hasattr(stream, "buffer")


@pytest.mark.parametrize("text", ["=1+1", "+1", "-1", "@sum", "\t=1", "\r=1"])
def test_formulas(text):
    """Texts that begin like a formula get an apostrophe; numbers, other texts and single marks stay."""
    assert inert(text) == f"'{text}"
    frame = pd.DataFrame({text: [-1.0, 2.0], "name": [text, "plain"], "kind": pd.Categorical([text, None])})
    made = inert_frame(frame)
    assert list(made.columns) == [f"'{text}", "name", "kind"]
    assert list(made["name"]) == [f"'{text}", "plain"]
    assert made["kind"].iloc[0] == f"'{text}"
    assert made.iloc[0, 0] == -1.0
    assert list(frame["name"]) == [text, "plain"]


@pytest.mark.parametrize("cell", ["plain", "-", "", "a=b", -1, -2.5, None])
def test_other_cells(cell):
    """Cells that are no formulas stay as they are."""
    assert inert(cell) == cell


def test_tables_of_a_users_choice(tmp_path):
    """`save_frame` writes inert CSV, and parquet as it is."""
    frame = pd.DataFrame({"name": ["=1+1", "b"], "value": np.array([-1.0, 2.0])})
    save_frame(frame, tmp_path / "t.csv")
    save_frame(frame, tmp_path / "t.parquet")
    assert (tmp_path / "t.csv").read_text() == "name,value\n'=1+1,-1.0\nb,2.0\n"
    pd.testing.assert_frame_equal(pd.read_parquet(tmp_path / "t.parquet"), frame)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes in this file system")
def test_pipes(tmp_path):
    """A pipe that nobody writes to is refused where a table or a recording is asked for, and not waited for."""
    os.mkfifo(tmp_path / "table.csv")
    for read, error in ((read_recording, RecordingError), (read_bench, RunError), (files.of_file, RunError)):
        with pytest.raises(error, match=r"table\.csv: cannot be read: not a regular file"):
            read(tmp_path / "table.csv")


def test_lists_of_names_are_bounded():
    """Forty names of forty characters each, and how many more there are."""
    assert listed(["kasa", "lls"]) == "kasa, lls"
    assert listed(map(str, range(41))) == f"{', '.join(map(str, range(40)))}, and 1 more"
    assert listed(["x" * 41]) == "x" * 37 + "..."
    many = [f"column {i} of a wide table, with a long name" for i in range(5000)]
    assert len(did_you_mean(many, many)) < 2000
