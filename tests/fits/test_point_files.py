"""Point files that can be read: every kind gives exactly the numbers that were written.

Point files that cannot be read: one line, with the file, and the row and column as an editor shows them.
"""

import io
import os
import struct
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as some

from study.fits import point_files
from study.fits.point_files import read_points
from study.fits.point_formats import PointFileError

POINTS = np.random.default_rng(1).normal(300.0, 80.0, (12, 3))

NAMES = ["x", "y", "z"]

MARKS = {"comma": ",", "tab": "\t", "semicolon": ";", "bar": "|", "blanks": "   "}


def lines(points, mark, header=None):
    """A file's lines, with numbers that round-trip."""
    rows = [mark.join(repr(float(value)) for value in row) for row in points]
    return [mark.join(header), *rows] if header else rows


def written(folder, text, name="points.txt"):
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


@pytest.mark.parametrize("header", [None, NAMES], ids=["bare", "header"])
@pytest.mark.parametrize("mark", MARKS.values(), ids=MARKS)
@pytest.mark.parametrize("d", [2, 3])
def test_delimiters(tmp_path, mark, header, d):
    """Each delimiter, with a header or none: the same numbers, and the columns' names or numbers."""
    header = header and header[:d]
    points, names, *_ = read_points(written(tmp_path, "\n".join(lines(POINTS[:, :d], mark, header)) + "\n"))
    np.testing.assert_array_equal(points, POINTS[:, :d])
    assert names == (header or ["1", "2", "3"][:d])


@pytest.mark.parametrize("mark", [";", "\t", "|"])
@pytest.mark.parametrize("header", [None, ["x, mm", "y, mm", "z, mm"]], ids=["bare", "header"])
def test_decimal_commas(tmp_path, mark, header):
    """Decimals may be commas where the delimiter is not."""
    rows = lines(POINTS, mark)
    text = "\n".join(([mark.join(header)] if header else []) + [row.replace(".", ",") for row in rows])
    np.testing.assert_array_equal(read_points(written(tmp_path, text))[0], POINTS)


@pytest.mark.parametrize("place", [0, 1, 3])
def test_a_single_decimal_comma(tmp_path, place):
    """One decimal comma in a file of integers is found in any row: the first row is no header."""
    values = np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0], [7.0, 9.0]])
    values[place] += 0.5
    text = "\n".join(";".join(f"{v:g}".replace(".", ",") for v in row) for row in values)
    np.testing.assert_array_equal(read_points(written(tmp_path, text))[0], values)


DECORATIONS = {
    "comments": lambda rows: ["# made by hand", *rows[:3], "  # half-time", *rows[3:], "#"],
    "blank lines": lambda rows: ["", *rows[:2], "", "   ", *rows[2:], "", ""],
    "quotes": lambda rows: [",".join(f'"{cell}"' for cell in row.split(",")) for row in rows],
    "quotes after blanks": lambda rows: [", ".join(f'"{cell}"' for cell in row.split(",")) for row in rows],
    "blanks around": lambda rows: ["  " + row.replace(",", " ,  ") + " " for row in rows],
}


@pytest.mark.parametrize("decorate", DECORATIONS.values(), ids=DECORATIONS)
@pytest.mark.parametrize("end", ["\n", "\r\n"], ids=["LF", "CRLF"])
@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"], ids=["plain", "BOM"])
def test_decorations(tmp_path, decorate, end, mark):
    """Comments, blank lines, quotes, blanks, a byte-order mark and Windows' line ends change nothing."""
    text = mark + end.join(decorate(lines(POINTS, ",", NAMES))).encode()
    points, names, *_ = read_points(written(tmp_path, text, "points.csv"))
    np.testing.assert_array_equal(points, POINTS)
    assert names == NAMES


@pytest.mark.parametrize("word", ["", "nan", "NaN", "NAN", "-nan", "NA", "N/A", "null", "None", "-", " "])
def test_missing_cells(tmp_path, word):
    """An empty cell, NaN and what programs write for it is a missing coordinate, at its place."""
    rows = [row.split(",") for row in lines(POINTS, ",", NAMES)]
    rows[1][0] = rows[5][2] = word
    points, *_ = read_points(written(tmp_path, "\n".join(",".join(row) for row in rows)))
    expected = POINTS.copy()
    expected[0, 0] = expected[4, 2] = np.nan
    np.testing.assert_array_equal(points, expected)


@pytest.mark.parametrize("first", ["sep=;", '"sep=;"', "sep=\t"])
def test_a_spreadsheets_first_line(tmp_path, first):
    """The line by which a spreadsheet names the delimiter is no row."""
    mark = "\t" if "\t" in first else ";"
    path = tmp_path / "points.csv"
    path.write_text("\n".join([first, *(mark.join(row) for row in (["x", "y"], *(["1", "2,5"],) * 3))]))
    points, names, *_ = read_points(path)
    assert names == ["x", "y"]
    np.testing.assert_array_equal(points, [[1.0, 2.5]] * 3)


def test_infinite_and_scientific_numbers(tmp_path):
    """Exponents, signs, bare points and infinities are numbers."""
    points, *_ = read_points(written(tmp_path, "1e3 -2.5E-4\n+.5 5.\ninf -Infinity\n007 1e-320\n"))
    np.testing.assert_array_equal(points, [[1e3, -2.5e-4], [0.5, 5.0], [np.inf, -np.inf], [7.0, 1e-320]])


def test_header_cells(tmp_path):
    """A quoted name may hold the delimiter; a column without a name is called by its number."""
    _, names, *_ = read_points(written(tmp_path, '"x, mm", ,z\n' + "\n".join(lines(POINTS, ","))))
    assert names == ["x, mm", "2", "z"]


@pytest.mark.parametrize("columns", [["x", "z"], ["2", "4"], [" x", "4 "]], ids=str)
def test_columns(tmp_path, columns):
    """Columns are chosen by name or number, in the given order; the others may hold anything."""
    rows = lines(POINTS, ",")
    text = "\n".join(["label,x,y,z", *(f"m {i}_a,{row}" for i, row in enumerate(rows))])
    points, names, *_ = read_points(written(tmp_path, text), columns)
    np.testing.assert_array_equal(points, POINTS[:, [0, 2]])
    assert names == ["x", "z"]
    swapped, *_ = read_points(tmp_path / "points.txt", columns[::-1])
    np.testing.assert_array_equal(swapped, POINTS[:, [2, 0]])


@pytest.mark.parametrize("kind", ["float64", "float32", "int32", "uint8"])
@pytest.mark.parametrize("order", ["C", "F"])
def test_npy(tmp_path, kind, order):
    """Arrays of any real type and layout, as float64; columns go by number."""
    array = np.asarray(np.abs(POINTS) % 200, dtype=kind, order=order)
    np.save(tmp_path / "points.npy", array)
    points, names, *_ = read_points(tmp_path / "points.npy")
    np.testing.assert_array_equal(points, array)
    assert (points.dtype, names) == (np.float64, ["1", "2", "3"])
    np.testing.assert_array_equal(read_points(tmp_path / "points.npy", ["3", "1"])[0], array[:, [2, 0]])


@pytest.mark.parametrize("suffix", [".parquet", ".pq", ".PARQUET"])
def test_parquet(tmp_path, suffix):
    """Numeric columns, nulls as missing; words, flags and the index of a data frame are no coordinates."""
    names = ["a", "b", "c"]
    frame = pd.DataFrame(POINTS, columns=names).assign(label="a", good=True, k=pd.array([1, None] * 6, dtype="Int64"))
    frame.loc[3, "b"] = None
    frame[frame.index != 5].to_parquet(tmp_path / f"p{suffix}")
    points, found, *_ = read_points(tmp_path / f"p{suffix}", dimension=4)
    expected = np.column_stack([POINTS, [1.0, np.nan] * 6])
    expected[3, 1] = np.nan
    np.testing.assert_array_equal(points, np.delete(expected, 5, axis=0))
    assert found == [*names, "k"]
    assert read_points(tmp_path / f"p{suffix}", ["c", "a"])[1] == ["c", "a"]


@settings(max_examples=60, deadline=None)
@given(
    points=some.arrays(
        np.float64,
        st.tuples(st.integers(5, 9), st.integers(2, 4)),
        elements=st.floats(allow_nan=False, allow_infinity=False),
    ),
    mark=st.sampled_from(list(MARKS.values())),
)
def test_any_numbers_round_trip(points, mark, tmp_path_factory):
    """Whatever doubles are written with their shortest digits are read to the last bit."""
    path = written(tmp_path_factory.mktemp("any"), "\n".join(lines(points, mark)))
    np.testing.assert_array_equal(read_points(path, dimension=points.shape[1])[0], points)


@pytest.mark.parametrize(
    ("header", "chosen"),
    [
        ("id,x,y,z", "xyz"),
        ("z,id,Y,X", "XYz"),
        ("id,t,x [mm],y [mm],z [mm]", "xyz"),
        ("X(m),Y(m),Z(m),quality", "XYZ"),
        ("x_mm,y_mm,z_mm,residual", "xyz"),
        ("frame,x mm,y mm,z mm", "xyz"),
        ("n,x/cm,y/cm", "xy"),
        ("x,y,w,v", "xy"),
    ],
)
def test_coordinates_by_name(tmp_path, header, chosen):
    """Columns called x, y and z, in capitals or with a unit, are the coordinates; the others are named."""
    names = header.split(",")
    values = np.random.default_rng(5).normal(10.0, 3.0, (9, len(names)))
    table = read_points(written(tmp_path, "\n".join([header, *lines(values, ",")])))
    places = [next(i for i, name in enumerate(names) if name.startswith(letter)) for letter in chosen]
    np.testing.assert_array_equal(table.points, values[:, places])
    assert table.names == [names[i] for i in places]
    assert table.left == [name for i, name in enumerate(names) if i not in places]


@pytest.mark.parametrize("header", ["a,b,c", "xs,ys,zs", "x,z,t", "x,x [mm],y", "max,y,z", "x_dot,y_dot,z_dot"])
def test_names_that_are_no_coordinates(tmp_path, header):
    """Where x and y are not there once each, all of three columns are coordinates."""
    table = read_points(written(tmp_path, "\n".join([header, *lines(POINTS, ",")])))
    np.testing.assert_array_equal(table.points, POINTS)
    assert table.names == header.split(",")
    assert table.left == []


def test_words_beside_coordinates(tmp_path):
    """Columns that are left out may hold words, quotes and nothing, and rows are still counted."""
    rows = [f'"a, {i}",{row},' for i, row in enumerate(lines(POINTS, ","))]
    text = "\n".join(["name,x,y,z,note", *rows])
    np.testing.assert_array_equal(read_points(written(tmp_path, text)).points, POINTS)
    with pytest.raises(PointFileError, match="row 4 has 6 columns, the first has 5"):
        read_points(written(tmp_path, text.replace('"a, 2"', "a,b")))


@pytest.mark.parametrize("kind", ["csv", "npy", "parquet"])
def test_standard_input(monkeypatch, kind):
    """It may be of any kind, which its first bytes tell."""
    contents, frame = io.BytesIO(), pd.DataFrame(POINTS, columns=list("xyz"))
    save = {"csv": lambda: frame.to_csv(contents, index=False), "npy": lambda: np.save(contents, POINTS)}
    save.get(kind, lambda: frame.to_parquet(contents))()
    contents.seek(0)
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(contents))
    np.testing.assert_array_equal(read_points(Path("-")).points, POINTS)


def test_endless_standard_input(monkeypatch):
    """It is read up to a limit, beyond which it is refused."""
    monkeypatch.setattr(point_files, "_MOST_BYTES", 1000)
    with open("/dev/zero", "rb") as endless:
        monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(endless))
        with pytest.raises(PointFileError, match="more than 1,000 bytes"):
            read_points(Path("-"))


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


def written_of_point_file_faults(folder, text, name="points.csv"):
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


@pytest.mark.parametrize("text", ["", "\n\n", "# a comment\n  # another\n", b"\xef\xbb\xbf"], ids=repr)
def test_empty(tmp_path, text):
    """No row at all, or comments alone."""
    refused(written_of_point_file_faults(tmp_path, text), "empty")


def test_a_header_alone(tmp_path):
    """A header and nothing below."""
    refused(written_of_point_file_faults(tmp_path, "# mine\nx,y,z\n\n"), "a header and no row")


@pytest.mark.parametrize(("rows", "found"), [(1, 1), (3, 3)])
def test_too_few_points(tmp_path, rows, found):
    """Fewer than d + 1 points."""
    words = refused(written_of_point_file_faults(tmp_path, "x,y,z\n" + "\n".join(ROWS[:rows])))
    assert words == f"{found} points of 3 coordinates; a sphere needs at least 4"


def test_too_few_complete_points(tmp_path):
    """Points that miss a coordinate, or have an infinite one, do not count."""
    words = refused(written_of_point_file_faults(tmp_path, "\n".join([*ROWS[:3], "nan,1,2", "1,,2", "1,2,inf"])))
    assert words.startswith("3 points")


@pytest.mark.parametrize("header", [0, 1])
@pytest.mark.parametrize("place", [0, 2, 4])
@pytest.mark.parametrize(("row", "count"), [("1,2,3,4", 4), ("1,2", 2), ("1", 1), ("1,2,3,", 4)])
def test_wrong_number_of_cells(tmp_path, header, place, row, count):
    """Too many and too few cells, in the first, a middle and the last row."""
    rows = [*["x,y,z"] * header, *ROWS]
    rows[header + place] = row
    words = refused(written_of_point_file_faults(tmp_path, "\n".join(rows)))
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
    words = refused(written_of_point_file_faults(tmp_path, "\n".join(",".join(row) for row in rows)))
    assert words == f"row {place + 1}, column {column + 1}: {cell!r} is not a number"


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"], ids=["LF", "CRLF", "CR"])
def test_rows_are_counted_as_an_editor_does(tmp_path, end):
    """Comments, blank lines and the header count; a form feed and Unicode's separators do not break a line."""
    rows = ["# page\x0cbreak\x0b\u2028here\x85\x1c", "", "x,y,z", *ROWS[:2], "   ", "# more", "4,five,6", *ROWS]
    words = refused(written_of_point_file_faults(tmp_path, end.join(rows)))
    assert words == "row 8, column 2: 'five' is not a number"


def test_decimal_points_among_decimal_commas(tmp_path):
    """A file has one decimal mark; 1.234,5 is no number."""
    rows = ["1,5;2,5", "3;4", "5.5;6", "7;8"]
    words = refused(written_of_point_file_faults(tmp_path, "\n".join(rows)))
    assert words == "row 3, column 1: '5.5' is not a number; decimals are commas in this file"
    rows[2] = "1.234,5;6"
    refused(written_of_point_file_faults(tmp_path, "\n".join(rows)), "row 3, column 1")


def test_decimal_commas_between_commas(tmp_path):
    """Twice as many cells as names in the header are told to be decimal commas, with the remedy."""
    path = tmp_path / "points.csv"
    path.write_text("x,y,z\n1,5,2,1,3,0\n")
    with pytest.raises(PointFileError, match="the first has 3; where decimals are commas, columns need"):
        read_points(path)


def test_a_quote_that_does_not_end(tmp_path):
    """An unclosed quote swallows its own row at most, and the message names the row."""
    refused(written_of_point_file_faults(tmp_path, "\n".join([*ROWS[:2], '1,"2,3', *ROWS])), "row 3 has 2 columns")


def test_a_single_column(tmp_path):
    """One coordinate is no point."""
    assert (
        refused(written_of_point_file_faults(tmp_path, "x\n1\n2\n3\n4\n"))
        == "1 column (x); a point needs at least 2 coordinates"
    )
    refused(written_of_point_file_faults(tmp_path, "\n".join(ROWS)), "1 column (2)", columns=["2"])


def test_a_column_without_numbers(tmp_path):
    """A column of nothing would make each point incomplete; a delimiter at the end of each row makes no column."""
    path = written_of_point_file_faults(
        tmp_path, "\n".join(["x,y,z", *(row.rpartition(",")[0] + ",-" for row in ROWS)])
    )
    assert refused(path) == "column z has no number in it"
    assert read_points(written_of_point_file_faults(tmp_path, "\n".join(f"{row}," for row in ROWS))).points.shape == (
        5,
        3,
    )


@pytest.mark.parametrize("name", ["points.csv", "points.npy", "points.parquet", "points"])
@pytest.mark.parametrize(
    "data",
    [bytes(range(256)) * 20, b"PK\x03\x04" + b"\xff" * 90, b"\x00" * 500, b"PAR1PAR1PAR1", "é,1\n".encode("cp1252")],
)
def test_garbage(tmp_path, name, data):
    """Binary garbage, whatever it is called."""
    refused(written_of_point_file_faults(tmp_path, data, name))


@pytest.mark.parametrize("name", ["points.csv", "points.npy", "points.parquet"])
def test_what_is_not_there(tmp_path, name):
    """A missing file, an empty one and a folder."""
    assert refused(tmp_path / name) == "cannot be read: No such file or directory"
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / name).mkdir()
    refused(tmp_path / "folder" / name, "cannot be read", "directory" if os.name != "nt" else "")
    refused(written_of_point_file_faults(tmp_path, b"", name))


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
    refused(written_of_point_file_faults(tmp_path, data[:-9], "points.npy"), "not a NumPy array of numbers")


def test_parquet_without_numbers(tmp_path):
    """Words alone, no row, and a file that ends too early."""
    path = tmp_path / "points.parquet"
    pd.DataFrame({"a": ["x", "y"]}).to_parquet(path)
    refused(path, "no numeric column")
    pd.DataFrame({"a": np.ones(0), "b": np.ones(0)}).to_parquet(path)
    refused(path, "no row")
    pd.DataFrame(np.ones((5, 3)), columns=list("xyz")).to_parquet(path)
    refused(written_of_point_file_faults(tmp_path, path.read_bytes()[:-30], path.name), "not a parquet file")


def test_columns_that_cannot_be_chosen(tmp_path):
    """A name or number that is not there, a column given twice, two of one name."""
    path = written_of_point_file_faults(tmp_path, "x,y,z\n" + "\n".join(ROWS))
    for column in ("w", "0", "4", "-1", "", "²"):
        assert refused(path, columns=["x", column]) == f"no column {column!r}; known are x, y, z (or 1 to 3)"
    assert refused(path, columns=["x", "y", "x"]) == "column x is given twice"
    assert refused(path, columns=["x", "y", "1"]) == "column x is given twice"
    path = written_of_point_file_faults(tmp_path, "x,y,x\n" + "\n".join(ROWS))
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
        path = written_of_point_file_faults(tmp_path, start + header + b"\0" * 240, "points.npy")
        refused(path, "claims shape (1000000000000, 3), the file is shorter")
        refused(
            written_of_point_file_faults(tmp_path, start + header.replace(b"'shape'", b"'shap'"), "points.npy"),
            "header cannot be read",
        )


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
    refused(written_of_point_file_faults(tmp_path, text), "field larger than field limit")


@pytest.mark.parametrize("told", [b"{", b"[]", b"\xff", b'{"index_columns": 3}'])
def test_metadata_that_cannot_be_read(tmp_path, told):
    """A parquet file whose metadata of pandas is broken."""
    columns = [pa.array(np.arange(5.0) ** i) for i in (1, 2, 3)]
    table = pa.Table.from_arrays(columns, names=list("xyz")).replace_schema_metadata({b"pandas": told})
    pq.write_table(table, tmp_path / "points.parquet")
    refused(tmp_path / "points.parquet", "pandas metadata cannot be read")


def test_noise_of_each_point(tmp_path):
    """A column sigma, or columns sx, sy, sz, are the noise of each point, and no longer left out; others stay so."""
    rows = np.column_stack([POINTS, np.arange(1.0, len(POINTS) + 1)[:, None] * [1.0, 2.0, 3.0], POINTS[:, :1]])
    text = "\n".join(["x,y,z,sx,sy,sz,w", *lines(rows, ",")])
    table = read_points(written(tmp_path, text))
    np.testing.assert_array_equal(table.noise, rows[:, 3:6])
    assert table.left == ["w"]
    table = read_points(written(tmp_path, text.replace("sy", "sigma")))
    np.testing.assert_array_equal(table.noise, rows[:, 4])
    assert table.left == ["sx", "sz", "w"]
    assert read_points(written(tmp_path, text.replace("sy", "other"))).noise is None
    rows[3, 4] = -1.0
    with pytest.raises(
        PointFileError, match="sy = -1 at point 4: a standard deviation must be positive; an empty cell"
    ):
        read_points(written(tmp_path, "\n".join(["x,y,z,sx,sy,sz,w", *lines(rows, ",")])))
