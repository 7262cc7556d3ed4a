"""What leaves the program: control characters are shown, cells of CSV are inert, and a pipe is no table."""

import io
import os

import numpy as np
import pandas as pd
import pytest

from study.mocap.io.reading import read_recording
from study.mocap.io.recording import RecordingError
from study.report.speed import read_bench
from study.runs.storage import digests
from study.runs.storage.atomic_write import RunError, save_frame
from study.text.shown_stream import shown, unchanged
from study.text.spreadsheet_cell import inert, inert_frame


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
    for read, error in ((read_recording, RecordingError), (read_bench, RunError), (digests.of_file, RunError)):
        with pytest.raises(error, match=r"table\.csv: cannot be read: not a regular file"):
            read(tmp_path / "table.csv")
