"""Point files that can be read: every kind gives exactly the numbers that were written.

Point files that cannot be read: one line, with the file, and the row and column as an editor shows them.
"""

import io
import itertools
import os
import re
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
from hypothesis.extra.numpy import arrays

import study
from study.fits.points import point_files
from study.fits.points.point_files import read_points
from study.fits.points.point_formats import PointFileError

POINTS = np.random.default_rng(1).normal(300.0, 80.0, (12, 3))

NAMES = ["x", "y", "z"]


def lines(points, mark, header=None):
    """A file's lines, with numbers that round-trip."""
    rows = [mark.join(repr(float(value)) for value in row) for row in points]
    return [mark.join(header), *rows] if header else rows


def written(folder, text, name="points.txt"):
    """A file of this text."""
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


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
    rows = [["x", "y"], *[["1", "2,5"]] * 3]
    points, names, *_ = read_points(written(tmp_path, "\n".join([first, *map(mark.join, rows)]), "points.csv"))
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
    points, read, *_ = read_points(tmp_path / f"p{suffix}", dimension=4)
    expected = np.column_stack([POINTS, [1.0, np.nan] * 6])
    expected[3, 1] = np.nan
    np.testing.assert_array_equal(points, np.delete(expected, 5, axis=0))
    assert read == [*names, "k"]
    assert read_points(tmp_path / f"p{suffix}", ["c", "a"])[1] == ["c", "a"]


FINITE = st.floats(allow_nan=False, allow_infinity=False)


@settings(max_examples=100, deadline=None, derandomize=True)
@given(
    points=arrays(float, st.tuples(st.integers(5, 9), st.integers(2, 4)), elements=FINITE),
    mark=st.sampled_from([",", "\t", ";", "|", "   "]),
    named=st.booleans(),
)
def test_any_numbers_round_trip(points, mark, named, tmp_path_factory):
    """Whatever doubles are written with their shortest digits, between any delimiters, are read to the last bit.

    Columns have the names of the header, or numbers.
    """
    d = points.shape[1]
    names = list("abcd"[:d]) if named else ["1", "2", "3", "4"][:d]
    path = written(tmp_path_factory.mktemp("any"), "\n".join(lines(points, mark, named and names)) + "\n")
    table = read_points(path, dimension=d)
    np.testing.assert_array_equal(table.points, points)
    assert table.names == names


@pytest.mark.parametrize(
    ("header", "chosen"),
    [
        ("z,id,Y,X", "XYz"),
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
    assert refusal(written(tmp_path, text.replace('"a, 2"', "a,b"))) == "row 4 has 6 columns, the first has 5"


SAVE = {
    "csv": lambda array, names, file: pd.DataFrame(array, columns=names).to_csv(file, index=False),
    "npy": lambda array, names, file: np.save(file, array),
    "parquet": lambda array, names, file: pd.DataFrame(array, columns=names).to_parquet(file),
}


@pytest.mark.parametrize("kind", SAVE)
def test_standard_input(monkeypatch, kind):
    """It may be of any kind, which its first bytes tell."""
    contents = io.BytesIO()
    SAVE[kind](POINTS, NAMES, contents)
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
TABLE = "\n".join(ROWS)


def refusal(path, columns=None):
    """What is said of a file that is refused: one line that begins with its name; the words after it."""
    with pytest.raises(PointFileError) as caught:
        read_points(path, columns)
    said = str(caught.value)
    assert said.startswith(f"{path}: ")
    assert "\n" not in said
    assert len(said) < len(str(path)) + 200
    return said.removeprefix(f"{path}: ")


SPELLINGS = ["x_in,y_in,z_inch", "x [mm],y [millimeter],z (millimetres)", "x µm,y μm,z um"]


@pytest.mark.parametrize("header", SPELLINGS)
def test_one_unit_may_be_spelt_in_several_ways(tmp_path, header):
    (tmp_path / "p.csv").write_text(f"{header}\n{TABLE}")
    assert read_points(tmp_path / "p.csv").points.shape[1] == 3


FAULTS = [
    *((text, "empty") for text in ("", "\n\n", "# a comment\n  # another\n", b"\xef\xbb\xbf")),
    ("# mine\nx,y,z\n\n", "a header and no row"),
    ("x,y,z\n1.5,2,3", "1 points of 3 coordinates; a sphere needs at least 4"),
    ("x,y,z\n1.5,2,3\n4,5,7\n7,8,1", "3 points of 3 coordinates; a sphere needs at least 4"),
    ("1.5,2,3\n4,5,7\n7,8,1\nnan,1,2\n1,,2\n1,2,inf", "3 points"),  # those that miss one, or are infinite, do not count
    ("1,5;2,5\n3;4\n5.5;6\n7;8", "row 3, column 1: '5.5' is not a number; decimals are commas in this file"),
    ("1,5;2,5\n3;4\n1.234,5;6\n7;8", "row 3, column 1: '1.234,5' is not a number"),
    ("x,y,z\n1,5,2,1,3,0\n", "row 2 has 6 columns, the first has 3; where decimals are commas, columns need"),
    (f'1.5,2,3\n4,5,7\n1,"2,3\n{TABLE}', "row 3 has 2 columns"),  # an open quote swallows its own row at most
    ("x [mm],y [m],z [mm]\n1,2,3", "the header: coordinates in m and mm; convert them to one"),
    ("x\n1\n2\n3\n4\n", "1 column (x); a point needs at least 2 coordinates"),
    ("x,y,z\n1.5,2,-\n4,5,-\n7,8,-\n2,9,-\n3,3,-", "column z has no number in it"),
    (f"x,y,x\n{TABLE}", "two columns are called 'x'"),
    (f'{TABLE}\n"{200_000 * "1"}",2,3', "field larger than field limit"),
]


@pytest.mark.parametrize(("text", "words"), FAULTS, ids=[words for _, words in FAULTS])
def test_faults(tmp_path, text, words):
    """What is wrong with a text."""
    assert words in refusal(written(tmp_path, text))


@pytest.mark.parametrize("header", [0, 1])
@pytest.mark.parametrize("place", [0, 2, 4])
@pytest.mark.parametrize(("row", "count"), [("1,2,3,4", 4), ("1,2", 2), ("1", 1), ("1,2,3,", 4)])
def test_wrong_number_of_cells(tmp_path, header, place, row, count):
    """Too many and too few cells, in the first, a middle and the last row."""
    rows = [*["x,y,z"] * header, *ROWS]
    rows[header + place] = row
    words = refusal(written(tmp_path, "\n".join(rows)))
    if place or header:
        assert words == f"row {header + place + 1} has {count} column{'s' * (count > 1)}, the first has 3"
    else:  # then it is the second row that is unlike the first
        assert words == f"row 2 has 3 columns, the first has {count}"


@pytest.mark.parametrize("cell", ["abc", "1.2.3", "1 2", "12,5", "0x10", "1_000", "True", "1e", "--1", "½"])
def test_a_cell_that_is_no_number(tmp_path, cell):
    """Its row, its column and what is in it, in the first, a middle and the last row."""
    for place, column in itertools.product((0, 2, 4), (0, 2)):
        rows = [row.split(",") for row in ROWS]
        rows[place][column] = f'"{cell}"'
        words = refusal(written(tmp_path, "\n".join(",".join(row) for row in rows)))
        assert words == f"row {place + 1}, column {column + 1}: {cell!r} is not a number"


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"], ids=["LF", "CRLF", "CR"])
def test_rows_are_counted_as_an_editor_does(tmp_path, end):
    """Comments, blank lines and the header count; a form feed and Unicode's separators do not break a line."""
    rows = ["# page\x0cbreak\x0b\u2028here\x85\x1c", "", "x,y,z", *ROWS[:2], "   ", "# more", "4,five,6", *ROWS]
    assert refusal(written(tmp_path, end.join(rows))) == "row 8, column 2: 'five' is not a number"


FORMATS = ["points.csv", "points.npy", "points.parquet"]


@pytest.mark.parametrize("name", [*FORMATS, "points"])
@pytest.mark.parametrize(
    "data",
    [bytes(range(256)) * 20, b"PK\x03\x04" + b"\xff" * 90, b"\x00" * 500, b"PAR1PAR1PAR1", "é,1\n".encode("cp1252")],
)
def test_garbage(tmp_path, name, data):
    """Binary garbage, whatever it is called."""
    refusal(written(tmp_path, data, name))


@pytest.mark.parametrize("name", FORMATS)
def test_what_is_not_there_or_may_never_end(tmp_path, name):
    """A missing file, an empty one, a folder; a pipe is not opened, which could wait for ever, nor is a device."""
    assert refusal(tmp_path / name) == "cannot be read: No such file or directory"
    (tmp_path / "folder" / name).mkdir(parents=True)
    words = refusal(tmp_path / "folder" / name)
    assert words.startswith("cannot be read")
    assert "directory" in words or os.name == "nt"
    refusal(written(tmp_path, b"", name))
    if not hasattr(os, "mkfifo"):
        pytest.skip("no pipes in this file system")
    os.mkfifo(tmp_path / f"pipe {name}")
    words = "not a regular file; for a pipe, give - and let it be standard input"
    assert refusal(tmp_path / f"pipe {name}") == words
    (tmp_path / "device").symlink_to("/dev/zero")
    assert refusal(tmp_path / "device").startswith("not a regular file")


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
    assert word in refusal(tmp_path / "points.npy")


def test_an_archive_and_a_torn_array(tmp_path):
    """An archive called .npy, of which it is not clear which array is meant, and a file that ends too early."""
    path = tmp_path / "points.npy"
    with open(path, "wb") as file:
        np.savez(file, a=np.ones((5, 3)), b=np.ones((5, 3)))
    assert "an archive of a, b" in refusal(path)
    np.save(path, np.ones((50, 3)))
    assert "not a NumPy array of numbers" in refusal(written(tmp_path, path.read_bytes()[:-9], path.name))


def test_an_array_that_claims_too_much(tmp_path):
    """A header that claims 10¹² rows is refused before memory is taken for them, and so is one that is no header."""
    for version, size in ((1, "<H"), (2, "<I")):
        header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000, 3), }"
        start = b"\x93NUMPY" + bytes([version, 0]) + struct.pack(size, len(header))
        for text, words in (
            (header + b"\0" * 240, "claims shape (1000000000000, 3), the file is shorter"),
            (header.replace(b"'shape'", b"'shap'"), "not a NumPy array of numbers that can be read"),
        ):
            assert words in refusal(written(tmp_path, start + text, "points.npy"))


def test_parquet_that_has_no_points(tmp_path):
    """Words alone, no row, two columns of one name, broken metadata of pandas, and a file that ends too early."""
    path = tmp_path / "points.parquet"
    pd.DataFrame({"a": ["x", "y"]}).to_parquet(path)
    assert "no numeric column" in refusal(path)
    pd.DataFrame({"a": np.ones(0), "b": np.ones(0)}).to_parquet(path)
    assert "no row" in refusal(path)
    columns = [pa.array(np.arange(5.0) ** i) for i in (1, 2, 3)]
    pq.write_table(pa.Table.from_arrays(columns[:2], names=["x", "x"]), path)
    assert "two columns are called 'x'" in refusal(path)
    table = pa.Table.from_arrays(columns, names=list("xyz"))
    for told in (b"{", b"[]", b"\xff", b'{"index_columns": 3}'):
        pq.write_table(table.replace_schema_metadata({b"pandas": told}), path)
        assert "pandas metadata cannot be read" in refusal(path)
    assert "not a parquet file" in refusal(written(tmp_path, path.read_bytes()[:-30], path.name))


def test_columns_that_cannot_be_chosen(tmp_path):
    """A name or number that is not there, a column given twice, two of one name, a single one."""
    path = written(tmp_path, "x,y,z\n" + TABLE)
    for column in ("w", "0", "4", "-1", "", "²"):
        assert refusal(path, ["x", column]) == f"no column {column!r}; known are x, y, z (or 1 to 3)"
    for last in ("x", "1"):
        assert refusal(path, ["x", "y", last]) == "column x is given twice"
    assert "1 column (y)" in refusal(path, ["2"])
    path = written(tmp_path, "x,y,x\n" + TABLE)
    assert "give the number" in refusal(path, ["x", "y"])
    assert read_points(path, ["2", "3"])[1] == ["y", "x"]


@pytest.mark.parametrize("kind", SAVE)
def test_too_many_dimensions(tmp_path, kind):
    """More than twenty columns are no coordinates, unless fewer are chosen; so are more than three without names."""
    path, array = tmp_path / f"points.{kind}", np.random.default_rng(1).standard_normal((30, 500))
    SAVE[kind](array, [f"c{i}" for i in range(500)], path)
    assert refusal(path).startswith("500 columns, and no names say which are x, y and z: choose")
    many = [str(i) for i in range(1, 22)]
    assert refusal(path, many).startswith("21 columns; points may have 20 coordinates at most")
    np.testing.assert_array_equal(read_points(path, ["2", "400", "500"]).points, array[:, [1, 399, 499]])


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
    path = written(tmp_path, "\n".join(["x,y,z,sx,sy,sz,w", *lines(rows, ",")]))
    words = "sy = -1 at point 4: a standard deviation must be positive and finite; an empty cell"
    assert words in refusal(path)


@pytest.mark.parametrize("columns", ["c,a,b", ["c", "a", "b"], [4, 2, 3], ("4", "2", " b")])
def test_ways_to_name_columns(tmp_path, columns):
    """Columns are named one by one, by name or number, or as the command takes them."""
    table = np.column_stack([np.arange(12.0), POINTS])
    path = written(tmp_path, "\n".join(lines(table, ",", ["t", "a", "b", "c"])))
    for name in (path, str(path)):
        np.testing.assert_array_equal(read_points(name, columns).points, POINTS[:, [2, 0, 1]])


@pytest.mark.parametrize("suffix", ["csv", "npy", "parquet"])
def test_a_fit_takes_a_file(tmp_path, suffix):
    """The name of a file stands for its points, as text or as a path, and so does what was read from it."""
    path = tmp_path / f"points.{suffix}"
    SAVE[suffix](POINTS, NAMES, path)
    expected = study.fit(POINTS)
    for source in (path, str(path), read_points(path)):
        np.testing.assert_array_equal(study.fit(source).center, expected.center)


def test_a_fit_takes_the_noise_of_a_file(tmp_path):
    """A column sigma is the noise, in place of the noise that is given, as in the command."""
    sigma = np.linspace(1.0, 30.0, 12)
    path = written(tmp_path, "\n".join(lines(np.column_stack([POINTS, sigma]), ",", [*NAMES, "sigma"])))
    expected, plain = study.fit(POINTS, noise=sigma).center, study.fit(POINTS, noise=2.0).center
    for source in (path, study.read_points(path)):
        for noise in (None, 2.0):
            np.testing.assert_array_equal(study.fit(source, noise=noise).center, expected)
    assert not np.allclose(expected, plain, rtol=1e-3)
    chosen = study.read_points(path, "x,y,z")
    np.testing.assert_array_equal(study.fit(chosen.points, noise=2.0).center, plain)
    np.testing.assert_array_equal(study.fit(tuple(map(tuple, POINTS)), noise=2.0).center, plain)


def test_a_fit_says_why_a_file_is_not_read(tmp_path):
    """The error is the command's, one line with the file, and a ValueError; what is no path is none."""
    path = written(tmp_path, "x,y,z\n1,2,3\n4,five,6\n", "bad.csv")
    for call in (study.fit, study.read_points):
        with pytest.raises(ValueError, match=rf"^{re.escape(str(path))}: row 3, column 2: 'five' is not a number$"):
            call(path)
        with pytest.raises(ValueError, match=r"^nowhere.ply: cannot be read: No such file"):
            call("nowhere.ply")
    with pytest.raises(TypeError, match=r"path = \[1, 2\]: expected the name of a file; study.fit takes points"):
        study.read_points([1, 2])
