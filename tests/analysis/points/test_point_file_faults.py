"""Point files that cannot be read: one line, with the file, and the row and column as an editor shows them."""

import os
import struct

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from study.analysis.points.point_file import read_points
from study.analysis.points.source import PointFileError

ROWS = ["1.5,2,3", "4,5,7", "7,8,1", "2,9,4", "3,3,8"]


def refused(path, *words, columns=None):
    """Assert a refusal of one line that names the file and has some words; the words after the file's name."""
    with pytest.raises(PointFileError) as caught:
        read_points(path, columns)
    said = str(caught.value)
    assert said.startswith(f"{path}: ")
    assert "\n" not in said
    assert len(said) < len(str(path)) + 200
    assert all(word in said for word in words), said
    return said.removeprefix(f"{path}: ")


def written(folder, text, name="points.csv"):
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


@pytest.mark.parametrize("text", ["", "\n\n", "# a comment\n  # another\n", b"\xef\xbb\xbf"], ids=repr)
def test_empty(tmp_path, text):
    """No row at all, or comments alone."""
    refused(written(tmp_path, text), "empty")


def test_a_header_alone(tmp_path):
    """A header and nothing below."""
    refused(written(tmp_path, "# mine\nx,y,z\n\n"), "a header and no row")


@pytest.mark.parametrize(("rows", "found"), [(1, 1), (3, 3)])
def test_too_few_points(tmp_path, rows, found):
    """Fewer than d + 1 points."""
    words = refused(written(tmp_path, "x,y,z\n" + "\n".join(ROWS[:rows])))
    assert words == f"{found} points of 3 coordinates; a sphere needs at least 4"


def test_too_few_complete_points(tmp_path):
    """Points that miss a coordinate, or have an infinite one, do not count."""
    words = refused(written(tmp_path, "\n".join([*ROWS[:3], "nan,1,2", "1,,2", "1,2,inf"])))
    assert words.startswith("3 points")


@pytest.mark.parametrize("header", [0, 1])
@pytest.mark.parametrize("place", [0, 2, 4])
@pytest.mark.parametrize(("row", "count"), [("1,2,3,4", 4), ("1,2", 2), ("1", 1), ("1,2,3,", 4)])
def test_wrong_number_of_cells(tmp_path, header, place, row, count):
    """Too many and too few cells, in the first, a middle and the last row."""
    rows = [*["x,y,z"] * header, *ROWS]
    rows[header + place] = row
    words = refused(written(tmp_path, "\n".join(rows)))
    if place or header:
        assert words == f"row {header + place + 1} has {count} column{'s' * (count > 1)}, the first has 3"
    else:  # then it is the second row that is unlike the first
        assert words == f"row 2 has 3 columns, the first has {count}"


@pytest.mark.parametrize("cell", ["abc", "1.2.3", "1 2", "12,5", "0x10", "1_000", "True", "1e", "--1", "½"])
@pytest.mark.parametrize("place", [0, 2, 4])
@pytest.mark.parametrize("column", [0, 2])
def test_a_cell_that_is_no_number(tmp_path, cell, place, column):
    """Its row, its column and what is in it, in the first, a middle and the last row."""
    rows = [row.split(",") for row in ROWS]
    rows[place][column] = f'"{cell}"'
    words = refused(written(tmp_path, "\n".join(",".join(row) for row in rows)))
    assert words == f"row {place + 1}, column {column + 1}: {cell!r} is not a number"


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"], ids=["LF", "CRLF", "CR"])
def test_rows_are_counted_as_an_editor_does(tmp_path, end):
    """Comments, blank lines and the header count; a form feed and Unicode's separators do not break a line."""
    rows = ["# page\x0cbreak\x0b\u2028here\x85\x1c", "", "x,y,z", *ROWS[:2], "   ", "# more", "4,five,6", *ROWS]
    words = refused(written(tmp_path, end.join(rows)))
    assert words == "row 8, column 2: 'five' is not a number"


def test_decimal_points_among_decimal_commas(tmp_path):
    """A file has one decimal mark; 1.234,5 is no number."""
    rows = ["1,5;2,5", "3;4", "5.5;6", "7;8"]
    words = refused(written(tmp_path, "\n".join(rows)))
    assert words == "row 3, column 1: '5.5' is not a number; decimals are commas in this file"
    rows[2] = "1.234,5;6"
    refused(written(tmp_path, "\n".join(rows)), "row 3, column 1")


def test_decimal_commas_between_commas(tmp_path):
    """Twice as many cells as names in the header are told to be decimal commas, with the remedy."""
    path = tmp_path / "points.csv"
    path.write_text("x,y,z\n1,5,2,1,3,0\n")
    with pytest.raises(PointFileError, match="the first has 3; where decimals are commas, columns need"):
        read_points(path)


def test_a_quote_that_does_not_end(tmp_path):
    """An unclosed quote swallows its own row at most, and the message names the row."""
    refused(written(tmp_path, "\n".join([*ROWS[:2], '1,"2,3', *ROWS])), "row 3 has 2 columns")


def test_a_single_column(tmp_path):
    """One coordinate is no point."""
    assert refused(written(tmp_path, "x\n1\n2\n3\n4\n")) == "1 column (x); a point needs at least 2 coordinates"
    refused(written(tmp_path, "\n".join(ROWS)), "1 column (2)", columns=["2"])


def test_a_column_without_numbers(tmp_path):
    """A column of nothing would make each point incomplete; a delimiter at the end of each row makes no column."""
    path = written(tmp_path, "\n".join(["x,y,z", *(row.rpartition(",")[0] + ",-" for row in ROWS)]))
    assert refused(path) == "column z has no number in it"
    assert read_points(written(tmp_path, "\n".join(f"{row}," for row in ROWS))).points.shape == (5, 3)


@pytest.mark.parametrize("name", ["points.csv", "points.npy", "points.parquet", "points"])
@pytest.mark.parametrize(
    "data",
    [bytes(range(256)) * 20, b"PK\x03\x04" + b"\xff" * 90, b"\x00" * 500, b"PAR1PAR1PAR1", "é,1\n".encode("cp1252")],
)
def test_garbage(tmp_path, name, data):
    """Binary garbage, whatever it is called."""
    refused(written(tmp_path, data, name))


@pytest.mark.parametrize("name", ["points.csv", "points.npy", "points.parquet"])
def test_what_is_not_there(tmp_path, name):
    """A missing file, an empty one and a folder."""
    assert refused(tmp_path / name) == "cannot be read: No such file or directory"
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / name).mkdir()
    refused(tmp_path / "folder" / name, "cannot be read", "directory" if os.name != "nt" else "")
    refused(written(tmp_path, b"", name))


ARRAYS = {
    "1-D": (np.arange(12.0), "shape (12,)"),
    "3-D": (np.ones((2, 3, 4)), "shape (2, 3, 4)"),
    "no point": (np.ones((0, 3)), "shape (0, 3)"),
    "complex": (np.ones((5, 3), dtype=complex), "complex128"),
    "words": (np.array([["a", "b"]] * 5), "<U1"),
    "flags": (np.ones((5, 2), dtype=bool), "bool"),
    "object": (np.array([[1, None]] * 5, dtype=object), "not a NumPy array of numbers"),
    "structured": (np.ones(5, dtype=[("x", float), ("y", float)]), "shape (5,)"),
}


@pytest.mark.parametrize(("array", "word"), ARRAYS.values(), ids=ARRAYS)
def test_arrays_that_are_no_points(tmp_path, array, word):
    """The type or the shape that was found."""
    np.save(tmp_path / "points.npy", array)
    refused(tmp_path / "points.npy", word)


def test_an_archive_and_a_torn_array(tmp_path):
    """An archive called .npy, of which it is not clear which array is meant, and a file that ends too early."""
    np.savez(tmp_path / "points.npz", a=np.ones((5, 3)), b=np.ones((5, 3)))
    (tmp_path / "points.npz").rename(tmp_path / "points.npy")
    refused(tmp_path / "points.npy", "an archive of a, b")
    np.save(tmp_path / "points.npy", np.ones((50, 3)))
    data = (tmp_path / "points.npy").read_bytes()
    refused(written(tmp_path, data[:-9], "points.npy"), "not a NumPy array of numbers")


def test_parquet_without_numbers(tmp_path):
    """Words alone, no row, and a file that ends too early."""
    path = tmp_path / "points.parquet"
    pd.DataFrame({"a": ["x", "y"]}).to_parquet(path)
    refused(path, "no numeric column")
    pd.DataFrame({"a": np.ones(0), "b": np.ones(0)}).to_parquet(path)
    refused(path, "no row")
    pd.DataFrame(np.ones((5, 3)), columns=list("xyz")).to_parquet(path)
    refused(written(tmp_path, path.read_bytes()[:-30], path.name), "not a parquet file")


def test_columns_that_cannot_be_chosen(tmp_path):
    """A name or number that is not there, a column given twice, two of one name."""
    path = written(tmp_path, "x,y,z\n" + "\n".join(ROWS))
    for column in ("w", "0", "4", "-1", "", "²"):
        assert refused(path, columns=["x", column]) == f"no column {column!r}; known are x, y, z (or 1 to 3)"
    assert refused(path, columns=["x", "y", "x"]) == "column x is given twice"
    assert refused(path, columns=["x", "y", "1"]) == "column x is given twice"
    path = written(tmp_path, "x,y,x\n" + "\n".join(ROWS))
    assert refused(path) == "two columns are called 'x'"
    assert "give the number" in refused(path, columns=["x", "y"])
    assert read_points(path, ["2", "3"])[1] == ["y", "x"]
    twins = pa.Table.from_arrays([pa.array([1.0, 2, 3, 4])] * 2, names=["x", "x"])
    pq.write_table(twins, tmp_path / "twins.parquet")
    refused(tmp_path / "twins.parquet", "two columns are called 'x'")


def test_an_array_that_claims_too_much(tmp_path):
    """A header that claims 10¹² rows is refused before memory is taken for them, and so is one that is no header."""
    for version, size in ((1, "<H"), (2, "<I")):
        header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000, 3), }"
        start = b"\x93NUMPY" + bytes([version, 0]) + struct.pack(size, len(header))
        path = written(tmp_path, start + header + b"\0" * 240, "points.npy")
        refused(path, "claims shape (1000000000000, 3), the file is shorter")
        refused(written(tmp_path, start + header.replace(b"'shape'", b"'shap'"), "points.npy"), "header cannot be read")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes in this file system")
@pytest.mark.parametrize("name", ["points.csv", "points.npy", "points.parquet"])
def test_what_may_never_end(tmp_path, name):
    """A pipe is not opened, which could wait for ever; nor is a device."""
    os.mkfifo(tmp_path / name)
    assert refused(tmp_path / name) == "not a regular file; for a pipe, give - and let it be standard input"
    (tmp_path / "device").symlink_to("/dev/zero")
    refused(tmp_path / "device", "not a regular file")


@pytest.mark.parametrize("kind", ["csv", "npy", "parquet"])
def test_too_many_dimensions(tmp_path, kind):
    """More than twenty columns are no coordinates, unless fewer are chosen; so are more than three without names."""
    path, array = tmp_path / f"points.{kind}", np.random.default_rng(1).standard_normal((30, 500))
    frame = pd.DataFrame(array, columns=[f"c{i}" for i in range(500)])
    {"csv": lambda: frame.to_csv(path, index=False), "npy": lambda: np.save(path, array)}.get(
        kind, lambda: frame.to_parquet(path)
    )()
    assert refused(path).startswith("500 columns, and no names say which are x, y and z: choose")
    many = [str(i) for i in range(1, 22)]
    assert refused(path, columns=many).startswith("21 columns; points may have 20 coordinates at most")
    np.testing.assert_array_equal(read_points(path, ["2", "400", "500"]).points, array[:, [1, 399, 499]])


def test_a_field_beyond_the_limit(tmp_path):
    """A quoted field that is longer than the csv module takes is refused in a line."""
    text = "\n".join([*ROWS, '"' + "1" * 200_000 + '",2,3'])
    refused(written(tmp_path, text), "field larger than field limit")


@pytest.mark.parametrize("told", [b"{", b"[]", b"\xff", b'{"index_columns": 3}'])
def test_metadata_that_cannot_be_read(tmp_path, told):
    """A parquet file whose metadata of pandas is broken."""
    columns = [pa.array(np.arange(5.0) ** i) for i in (1, 2, 3)]
    table = pa.Table.from_arrays(columns, names=list("xyz")).replace_schema_metadata({b"pandas": told})
    pq.write_table(table, tmp_path / "points.parquet")
    refused(tmp_path / "points.parquet", "pandas metadata cannot be read")
