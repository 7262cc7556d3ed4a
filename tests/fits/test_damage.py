"""Damaged point files, and headers that claim more than their files hold.

Each is read, or refused in one line: no other exception, no warning, and no memory for what is only claimed.
"""

import re
import struct
import zipfile
from functools import partial
from io import BytesIO

import numpy as np
import pandas as pd
import pytest

from study.fits.points.point_files import read_points
from study.fits.points.point_formats import PointFileError
from tests.fits.test_exports import POINTS, READ, las, ply, saved, xlsx

SPARE = {".las": "laspy", ".laz": "laspy", ".xlsx": "openpyxl"}
"""Formats whose libraries are in the extra points."""


@pytest.fixture
def refusal(tmp_path, one_line):
    """Assert that a file of these bytes is refused in one line with words (a pattern)."""

    def check(name, data, words):
        (tmp_path / name).write_bytes(data)
        with one_line(PointFileError, words, start=f"{tmp_path / name}: "):
            read_points(tmp_path / name)

    return check


def npy(header, version=1, size=None):
    """An array's file with this header, whose length may be another than it says, and no data."""
    start = struct.pack("<H" if version == 1 else "<I", len(header) if size is None else size)
    return b"\x93NUMPY" + bytes([version, 0]) + start + header.encode()


def laz():
    """The file of `las`, packed."""
    laspy = pytest.importorskip("laspy", reason="laspy is in the extra points")
    return saved(partial(laspy.read(BytesIO(las())).write, do_compress=True))


def workbook(fill):
    """A workbook whose sheet a function fills."""
    openpyxl = pytest.importorskip("openpyxl", reason="openpyxl is in the extra points")
    book = openpyxl.Workbook()
    fill(book.active)
    return saved(book.save)


FLIPPED = {name: data for name, data in READ.items() if name.rpartition(".")[0] in ("text", "binary", "big", "points")}
FLIPPED |= {name: READ[name] for name in ("leica.pts", "cmm.csv", "unicode.txt", "mesh.obj", "airborne.las")}
FLIPPED |= {name: READ[name] for name in ("sheet.xlsx", "frame.parquet")}
FLIPPED |= {
    "array.npy": saved(np.save, POINTS),
    "packed.npz": saved(np.savez_compressed, points=POINTS),
    "cloud.laz": laz,
}


@pytest.mark.parametrize("name", FLIPPED)
def test_bytes_that_changed(tmp_path, name):
    """Six bytes changed, thirty times a format, ten of a LAZ file, each of which another process reads."""
    for end, library in SPARE.items():
        if name.endswith(end):
            pytest.importorskip(library, reason=f"{library} is in the extra points")
    rng, data = np.random.default_rng(47), FLIPPED[name]
    data = xlsx(data) if isinstance(data, list) else data() if callable(data) else data
    said = []
    for _ in range(10 if name.endswith("laz") else 30):
        damaged = np.frombuffer(data, np.uint8).copy()
        damaged[rng.integers(len(data), size=6)] = rng.integers(256, size=6)
        (tmp_path / name).write_bytes(damaged.tobytes())
        try:
            assert read_points(tmp_path / name).points.shape[1] > 1
        except PointFileError as error:
            said.append(str(error).removeprefix(f"{tmp_path / name}: "))
    assert not [words for words in said if "\n" in words or len(words) > 300]


def test_a_packed_cloud(tmp_path):
    """The points of a LAZ file are those of the LAS file, to a tenth of a millimetre."""
    (tmp_path / "cloud.laz").write_bytes(laz())
    np.testing.assert_allclose(read_points(tmp_path / "cloud.laz").points, POINTS, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("place", [-1, 0], ids=["last", "first"])
@pytest.mark.parametrize("method", [99, None], ids=["unknown", "encrypted"])
@pytest.mark.parametrize("name", ["sheet.xlsx", "points.npz"])
def test_archives_that_cannot_be_unpacked(refusal, name, method, place):
    """A member that is encrypted, or packed by a method that is not known."""
    data = bytearray(xlsx(READ[name]) if name.endswith("xlsx") else READ[name])
    with zipfile.ZipFile(BytesIO(data)) as archive:
        members = [m for m in archive.infolist() if "sheet1" in m.filename or name.endswith("npz")]
        member = members[place]
    entry = data.rindex(b"PK\1\2", 0, data.rindex(member.filename.encode()))
    for start, flags in ((member.header_offset, 6), (entry, 8)):  # the member's own header, and that in the directory
        if method is None:
            data[start + flags] |= 1
        else:
            data[start + flags + 2] = method
    refusal(name, data, "not (an Excel workbook|a NumPy array of numbers) that can be read: ")


CLAIMS = {
    "an array's header": ("a.npy", npy("{", 2, 2**32 - 1), r"its header claims 4,294,967,295 bytes, the file has 13"),
    "a truth value as a length": (
        "a.npy",
        npy("{'descr': '<f8', 'fortran_order': False, 'shape': (9, True)}") + bytes(72),
        r"shape \(9, True\)",
    ),
    "a negative length": (
        "a.npy",
        npy("{'descr': '<f8', 'fortran_order': False, 'shape': (-9, 3)}"),
        r"shape \(-9, 3\)",
    ),
    "numbers of a point": (
        "a.pcd",
        b"FIELDS x y z w\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 1000000000\nPOINTS 5\nDATA ascii\n1 2 3 4\n",
        "its header announces 1,000,000,003 numbers a point, 8 bytes are there",
    ),
    "no numbers of a point": (
        "a.pcd",
        b"FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 0 0 0\nPOINTS 5\nDATA ascii\n1 2 3\n",
        "COUNT is 0; save it again",
    ),
    "points": ("a.ply", ply("<").replace(b"vertex 40", b"vertex 4000000000"), "announces 4000000000 points, 40 are"),
}


@pytest.mark.parametrize("case", CLAIMS)
def test_claims(refusal, case):
    """What a header claims is compared with the file's length."""
    refusal(*CLAIMS[case])


def test_an_archive_that_claims_too_much(refusal):
    """A member that claims 10¹² rows."""
    out = BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("points.npy", npy("{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000, 3)}"))
    refusal("a.npz", out.getvalue(), r"claims shape \(1000000000000, 3\), the file is shorter")


@pytest.mark.parametrize("place", [100, 107], ids=["records", "points"])
def test_a_cloud_that_claims_too_much(refusal, place):
    """A LAS header of 2³² - 1 records, or points; the places are those of the ASPRS's description."""
    pytest.importorskip("laspy", reason="laspy is in the extra points")
    data = bytearray(las())
    data[place : place + 4] = b"\xff" * 4
    refusal("a.las", data, "its header claims .*4,294,967,295 .* and it is shorter")


@pytest.mark.parametrize("value", [None, 7.0], ids=["empty", "number"])
def test_a_cell_at_the_end_of_a_sheet(tmp_path, value):
    """One cell far away costs no walk over the 1.7·10¹⁰ cells before it; one that only has a format is nothing."""

    def fill(sheet):
        for row in [["x", "y", "z"], *POINTS.tolist()]:
            sheet.append(row)
        sheet.cell(1_048_576, 16_384, value).number_format = "0.00"

    (tmp_path / "far.xlsx").write_bytes(workbook(fill))
    table = read_points(tmp_path / "far.xlsx")
    np.testing.assert_array_equal(table.points[:40], POINTS)
    assert np.isnan(table.points[40:]).all()  # the row of the far cell has no coordinates
    assert len(table.points) == (40 if value is None else 41)


def test_too_many_cells(refusal, monkeypatch):
    """A sheet with more cells than fit is refused, however they are spread."""
    monkeypatch.setattr("study.fits.points.point_formats._MOST_CELLS", 500)
    wide = workbook(lambda sheet: [sheet.cell(i, 50, 1.0) for i in range(1, 41)])
    refusal("wide.xlsx", wide, "more than 500 cells; save the columns x, y and z alone")
    diagonal = workbook(lambda sheet: [sheet.cell(i, i, 1.0) for i in range(1, 30)])
    refusal("diagonal.xlsx", diagonal, "29 rows of 29 columns; save the columns x, y and z alone")


@pytest.mark.parametrize("word", ["#DIV/0!", "#N/A", "#NAME?", "#VALUE!", "#¡VALOR!", "#NV"])
def test_an_error_in_the_first_cell(tmp_path, refusal, word):
    """A spreadsheet's error is a cell without a number, also where it begins a row; a comment stays one."""
    rows = [["x", "y", "z"], *POINTS.tolist()]
    text = "\n".join(",".join(map(str, row)) for row in rows)
    (tmp_path / "comment.csv").write_text(f"{text}\n# {word}, 2, 3\n#later,2,3\n", encoding="utf-8")
    np.testing.assert_array_equal(read_points(tmp_path / "comment.csv").points, POINTS)
    words = f"row 4, column 1: {re.escape(repr(word))} is not a number"
    for place in (1, 3):  # right below the header, and below numbers
        lines = text.split("\n")
        lines.insert(place, f"{word},2,3")
        refusal("error.csv", "\n".join(lines).encode(), words.replace("row 4", f"row {place + 1}"))
    refusal("error.txt", "\n".join([*text.replace(",", " ").split("\n")[:3], f"{word} 2 3"]).encode(), words)
    rows.insert(3, [word, 2.0, 3.0])
    refusal("error.xlsx", workbook(lambda sheet: [sheet.append(row) for row in rows]), words)


@pytest.mark.parametrize("word", ["# later", "// later", "% later"])
def test_a_workbook_has_no_comments(refusal, word):
    """A row is a row, whatever it begins with."""
    rows = [["x", "y", "z"], *POINTS.tolist(), [word, 1.0, 2.0]]
    refusal("sheet.xlsx", workbook(lambda sheet: [sheet.append(row) for row in rows]), f"row 42, column 1: '{word}' is")


def test_a_minus_sign(tmp_path):
    """Typeset minus signs (U+2212) are those of programs, in text, in workbooks and in clouds of points."""
    typeset = [[str(v).replace("-", "\N{MINUS SIGN}") for v in row] for row in POINTS.tolist()]
    lines = [" ".join(row) for row in typeset]
    head = "ply\nformat ascii 1.0\nelement vertex 40\n" + "".join(f"property double {n}\n" for n in "xyz")
    contents = {
        "a.csv": "\n".join(lines).replace(" ", ",").encode(),
        "a.ply": "\n".join([head + "end_header", *lines]).encode(),
        "a.xlsx": workbook(lambda sheet: [sheet.append(row) for row in typeset]),
    }
    assert POINTS.min() < 0.0
    for name, data in contents.items():
        (tmp_path / name).write_bytes(data)
        np.testing.assert_array_equal(read_points(tmp_path / name).points, POINTS)


@pytest.mark.parametrize("row", [";", ";;", ";;;", ";;;;"])
def test_a_table_of_semicolons(refusal, row):
    """Rows of empty cells have no number."""
    refusal("a.csv", "\n".join([row] * 20).encode(), "empty|has no number in it|name")
    refusal("a.csv", "\n".join(["x;y;z", *["1;2;3"] * 4, ";"]).encode(), "row 6 has 2 columns, the first has 3")


def test_a_row_that_is_shorter_after_all(refusal):
    """Where every row ends with the delimiter, one that has nothing else is no row of three."""
    refusal("a.csv", b"1;2;3;\n4;5;6;\n;\n7;8;1;\n2;9;4;\n", "row 3 has . columns?, the first has 3")


@pytest.mark.parametrize("value", ["inf", "-1", "0"])
def test_noise_that_is_none(refusal, value):
    """A standard deviation that is no positive number is refused with its file and point."""
    rows = [",".join(map(str, [*p, value if i == 2 else 0.1])) for i, p in enumerate(POINTS)]
    words = f"sigma = {value} at point 3: a standard deviation must be positive and finite"
    refusal("a.csv", "\n".join(["x,y,z,sigma", *rows]).encode(), words)


@pytest.mark.parametrize("name", ["copies.parquet", "copies.npz"])
def test_a_short_file_of_many_points(refusal, tmp_path, monkeypatch, name):
    """Copies of a point pack into almost nothing: they are counted by the header, before memory is taken for them."""
    monkeypatch.setattr("study.fits.points.point_formats._MOST_NUMBERS", 150_000)
    many = np.ones((100_000, 3))
    if name.endswith("parquet"):
        pd.DataFrame(many, columns=list("xyz")).to_parquet(tmp_path / "made")
        data = (tmp_path / "made").read_bytes()
    else:
        data = saved(np.savez_compressed, points=many)
    assert len(data) < 30_000
    refusal(name, data, r"[\d,]+ bytes pack 300,000 numbers, more than 150,000; leave out copies")
    monkeypatch.setattr("study.fits.points.point_formats._PACKED", 300)
    (tmp_path / name).write_bytes(data)
    assert len(read_points(tmp_path / name).points) == 100_000


def test_a_packed_cloud_of_many_points(refusal):
    """They are counted by the header, too."""
    data = bytearray(laz())
    data[107:111] = b"\xff" * 4
    refusal("a.laz", data, "pack 12,884,901,885 numbers, more than 30,000,000")


def test_arrays_that_are_many_together(refusal, monkeypatch):
    """An archive is counted whole."""
    monkeypatch.setattr("study.fits.points.point_formats._MOST_NUMBERS", 150_000)
    data = saved(np.savez_compressed, **{name: np.ones(60_000) for name in "xyz"})
    refusal("a.npz", data, "pack 180,000 numbers, more than 150,000")
