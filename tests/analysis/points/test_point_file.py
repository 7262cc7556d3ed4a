"""Point files that can be read: every kind gives exactly the numbers that were written."""

import io
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as some

from study.analysis.points import source
from study.analysis.points.point_file import read_points
from study.analysis.points.source import PointFileError

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
    points, names, _ = read_points(written(tmp_path, "\n".join(lines(POINTS[:, :d], mark, header)) + "\n"))
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
    points, names, _ = read_points(written(tmp_path, text, "points.csv"))
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
    points, names, _ = read_points(path)
    assert names == ["x", "y"]
    np.testing.assert_array_equal(points, [[1.0, 2.5]] * 3)


def test_infinite_and_scientific_numbers(tmp_path):
    """Exponents, signs, bare points and infinities are numbers."""
    points, *_ = read_points(written(tmp_path, "1e3 -2.5E-4\n+.5 5.\ninf -Infinity\n007 1e-320\n"))
    np.testing.assert_array_equal(points, [[1e3, -2.5e-4], [0.5, 5.0], [np.inf, -np.inf], [7.0, 1e-320]])


def test_header_cells(tmp_path):
    """A quoted name may hold the delimiter; a column without a name is called by its number."""
    _, names, _ = read_points(written(tmp_path, '"x, mm", ,z\n' + "\n".join(lines(POINTS, ","))))
    assert names == ["x, mm", "2", "z"]


@pytest.mark.parametrize("columns", [["x", "z"], ["2", "4"], [" x", "4 "]], ids=str)
def test_columns(tmp_path, columns):
    """Columns are chosen by name or number, in the given order; the others may hold anything."""
    rows = lines(POINTS, ",")
    text = "\n".join(["label,x,y,z", *(f"m {i}_a,{row}" for i, row in enumerate(rows))])
    points, names, _ = read_points(written(tmp_path, text), columns)
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
    points, names, _ = read_points(tmp_path / "points.npy")
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
    points, found, _ = read_points(tmp_path / f"p{suffix}", dimension=4)
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
    monkeypatch.setattr(source, "_MOST_BYTES", 1000)
    with open("/dev/zero", "rb") as endless:
        monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(endless))
        with pytest.raises(PointFileError, match="more than 1,000 bytes"):
            read_points(Path("-"))
