"""Exports of scanners, spreadsheets and programs, written after the formats' own descriptions.

Each is read in three dimensions, to the digits that it holds, or refused with its name and a way out.
"""

import io
import re
import struct
import sys

import numpy as np
import pandas as pd
import pytest
import trimesh

import study
from study.fits.points.point_files import read_points
from study.fits.points.point_formats import PointFileError

_RNG = np.random.default_rng(32)
_AWAY = _RNG.normal(size=(40, 3))
POINTS = np.round([120.0, -40.0, 15.0] + (25.0 * _AWAY) / np.linalg.norm(_AWAY, axis=1)[:, None], 4)
INTENSITY = _RNG.integers(1, 255, 40)
COLOUR = _RNG.integers(0, 255, (40, 3))
LISTS = POINTS.tolist(), COLOUR.tolist(), INTENSITY.tolist()
NORMALS = _AWAY / np.linalg.norm(_AWAY, axis=1)[:, None]


def text(head, *columns, mark=",", end="\n", fmt="%.4f"):
    """A table as bytes: lines above it, then its columns."""
    out = io.StringIO()
    np.savetxt(out, np.column_stack(columns), delimiter=mark, fmt=fmt)
    return (head + out.getvalue()).replace("\n", end).encode()


def ply(kind):
    """A PLY of points with colours and faces, as Turk's description has it; ``<`` or ``>`` for binary, else text."""
    order = {"<": "binary_little_endian", ">": "binary_big_endian"}.get(kind, "ascii")
    properties = [f"property double {n}" for n in "xyz"] + [f"property uchar {n}" for n in ("red", "green", "blue")]
    head = ["ply", f"format {order} 1.0", "comment made by a test", "element vertex 40", *properties]
    head += ["property float intensity", "element face 1", "property list uchar int vertex_indices", "end_header", ""]
    start = "\n".join(head).encode()
    if order == "ascii":
        rows = [" ".join([*map(repr, p), *map(str, c), str(i)]) for p, c, i in zip(*LISTS, strict=True)]
        return start + "\n".join([*rows, "3 0 1 2", ""]).encode()
    rows = [struct.pack(f"{kind}3d3Bf", *p, *c, i) for p, c, i in zip(*LISTS, strict=True)]
    return start + b"".join(rows) + struct.pack(f"{kind}B3i", 3, 0, 1, 2)


def pcd(kind):
    """A PCD 0.7 file with intensity, as the Point Cloud Library describes it."""
    head = "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z intensity\nSIZE 4 4 4 4\n"
    head += "TYPE F F F F\nCOUNT 1 1 1 1\nWIDTH 40\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 40\n"
    head += f"DATA {kind}\n"
    if kind == "ascii":
        return text(head, POINTS, INTENSITY, mark=" ")
    return head.encode() + np.column_stack([POINTS, INTENSITY]).astype("<f4").tobytes()


def las():
    """A LAS 1.2 file of point format 0, as the ASPRS describes it, in integers of a tenth of a millimetre."""
    low, high = POINTS.min(axis=0), POINTS.max(axis=0)
    bounds = [end for pair in zip(high, low, strict=True) for end in pair]
    numbers = [0, 0, 0, 0, 0, b"", 1, 2, b"", b"", 1, 2026, 227, 227, 0, 0, 20, 40, 40, 0, 0, 0, 0]
    head = struct.pack("<4sHHIHH8sBB32s32sHHHIIBHI5I", b"LASF", *numbers)
    head += struct.pack("<12d", 1e-4, 1e-4, 1e-4, 0, 0, 0, *bounds)
    whole = zip(np.round(POINTS * 1e4).astype(int), INTENSITY, strict=True)
    return head + b"".join(struct.pack("<3iHBBbBH", *p, i, 9, 0, 0, 0, 0) for p, i in whole)


def saved(write, *arguments, **options):
    """Bytes that a function writes into a file."""
    out = io.BytesIO()
    write(out, *arguments, **options)
    return out.getvalue()


def xlsx(rows):
    """A workbook of one sheet."""
    return saved(pd.DataFrame(rows).to_excel, header=False, index=False)


def npz(**arrays):
    """An archive of arrays."""
    return saved(np.savez, **arrays)


X, Y, Z = POINTS.T
MESH = trimesh.Trimesh(POINTS, [[i, (i + 1) % 40, (i + 2) % 40] for i in range(40)], process=False)
SHEET = [["Ball bar, 3 March", "", "", ""], ["No", "X [mm]", "Y [mm]", "Z [mm]"]]
SHEET += [[float(i), *map(float, p)] for i, p in enumerate(POINTS)]
READ = {
    "cloudcompare.asc": text("//X Y Z R G B\n40\n", POINTS, COLOUR, mark=" "),
    "cloudcompare.csv": text("//X,Y,Z,Intensity\n", POINTS, INTENSITY),
    "leica.pts": text("40\n", POINTS, INTENSITY - 128, COLOUR, mark=" "),
    "two scans.pts": text("20\n", POINTS[:20], INTENSITY[:20], mark=" ")
    + text("20\n", POINTS[20:], INTENSITY[20:], mark=" "),
    "bare.pts": text("", POINTS, mark=" "),
    "plain.xyz": text("", POINTS, mark=" "),
    "named.xyz": text("X Y Z Nx Ny Nz\n", POINTS, NORMALS, mark=" "),
    "numpy.txt": text("# x y z intensity\n", POINTS, INTENSITY, mark=" "),
    "surveyor.csv": text("Point,Easting,Northing,Height,Code\n", np.arange(40), POINTS, INTENSITY),
    "enu.csv": text("t,e,n,u\n", np.arange(40), POINTS),
    "gnss.txt": text("East(m)\tNorth(m)\tUp(m)\tPDOP\n", POINTS, INTENSITY, mark="\t"),
    "elevation.csv": text("id,X,Y,Elevation\n", np.arange(40), POINTS),
    "robot.csv": text("time,Pos_X,Pos_Y,Pos_Z,Rot_A\n", np.arange(40), POINTS, INTENSITY),
    "tracker.csv": text("Frame,Position X,Position Y,Position Z,Error\n", np.arange(40), POINTS, INTENSITY),
    "paraview.csv": text('"Scalars","Points:0","Points:1","Points:2"\n', INTENSITY, POINTS),
    "cmm.csv": text("Nr;X [mm];Y [mm];Z [mm];Dev\n", np.arange(40), POINTS, INTENSITY, mark=";"),
    "units below.csv": text("n,x,y,z\n-,mm,mm,mm\n", np.arange(40), POINTS),
    "bracketed units.txt": text("x\ty\tz\tquality\n[mm]\t[mm]\t[mm]\t[-]\n", POINTS, INTENSITY, mark="\t"),
    "metre.csv": text("x(m),y(m),z(m),residual\n", POINTS, INTENSITY),
    "suffix.csv": text("X_mm,Y_mm,Z_mm,R\n", POINTS, INTENSITY),
    "preamble.csv": text("Instrument: arm 7\nOperator,M. Weber\n\nX,Y,Z,Temp\n", POINTS, INTENSITY),
    "german.csv": b"\xef\xbb\xbfPunkt;Rechtswert;Hochwert;H\xc3\xb6he\r\n"
    + text("", np.arange(40), POINTS, mark=";", end="\r\n").replace(b".", b","),
    "unicode.txt": b"\xff\xfe" + text("n\tX\tY\tZ\n", np.arange(40), POINTS, mark="\t").decode().encode("utf-16-le"),
    "sep.csv": b"sep=;\n" + text("X;Y;Z;I\n", POINTS, INTENSITY, mark=";"),
    "trailing.csv": text("x,y,z,\n", POINTS).replace(b"\n", b",\n").replace(b",,", b","),
    "matlab.txt": text("% exported by a script\n% x y z i\n", POINTS, INTENSITY, mark=" "),
    "text.ply": ply("text"),
    "little.ply": ply("<"),
    "big.ply": ply(">"),
    "text.pcd": pcd("ascii"),
    "binary.pcd": pcd("binary"),
    "mesh.obj": b"# a mesh\nmtllib m.mtl\no ball\n"
    + b"".join(b"v %.4f %.4f %.4f\n" % tuple(p) for p in POINTS)
    + b"vn 0 0 1\nf 1 2 3\n",
    "text.stl": MESH.export(file_type="stl_ascii").encode(),
    "binary.stl": MESH.export(file_type="stl"),
    "binary trimesh.ply": MESH.export(file_type="ply"),
    "trimesh.obj": MESH.export(file_type="obj").encode(),
    "airborne.las": las(),
    "sheet.xlsx": SHEET,
    "renamed.csv": SHEET[1:],
    "points.npz": npz(points=POINTS, intensity=INTENSITY),
    "columns.npz": npz(x=X, y=Y, z=Z, i=INTENSITY),
    "frame.parquet": saved(pd.DataFrame({"id": INTENSITY, "X": X, "Y": Y, "Z": Z}).to_parquet),
}
NEEDS = {".las": "laspy", ".xlsx": "openpyxl", "renamed.csv": "openpyxl"}
CHOOSE = "4 columns, and no names say which are x, y and z: choose, as with --columns 1,2,3, or fit all with --dimens"
NOT = "which is not read here"
XLS = b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + b"\0" * 90
REFUSED = {
    "nameless.csv": (text("", POINTS, INTENSITY), f"{CHOOSE}ion 4"),
    "nameless.xyz": (text("", POINTS, NORMALS, mark=" "), "6 columns, and no names say"),
    "decimal.csv": (text("", POINTS, INTENSITY, mark=";").replace(b".", b","), CHOOSE),
    "named otherwise.csv": (text("a,b,c,d\n", POINTS, INTENSITY), CHOOSE),
    "nameless.npz": (npz(scan=np.column_stack([POINTS, INTENSITY])), CHOOSE),
    "gps.csv": (text("lat,lon,height\n", POINTS), "columns lat and lon are angles, not lengths"),
    "two markers.csv": (text("A_x,A_y,A_z,B_x,B_y,B_z\n", POINTS, POINTS), "6 columns, and no names say"),
    "mixed units.csv": (text("x,y,z\nmm,mm,m\n", POINTS), "coordinates in m and mm; convert them to one"),
    "scan.e57": (b"ASTM-E57" + b"\0" * 40, f"an E57 point cloud, {NOT}: export it as text with columns x, y, z"),
    "scan.ptx": (text("40\n1\n", POINTS, INTENSITY), f"a PTX point cloud, {NOT}: export"),
    "scan.rcp": (b"recap", f"a ReCap project, {NOT}: export"),
    "compressed.pcd": (pcd("binary_compressed"), "pcl_convert_pcd_ascii_binary IN OUT 0"),
    "old.xls": (XLS, f"an Excel workbook that is old or has a password, {NOT}: save it as .xlsx"),
    "renamed old.csv": (XLS, "an Excel workbook that is old or has a password, which is not read"),
    "open.ods": (b"PK\x03\x04", "not a ZIP archive that can be read"),
    "lab.mat": (b"MATLAB 5.0 MAT-file" + b"\0" * 90, f"a MATLAB file, {NOT}: save the points with writematrix"),
    "lab.h5": (b"\x89HDF\r\n\x1a\n" + b"\0" * 90, f"an HDF5 file, {NOT}: save its points as .npy or CSV"),
    "model.step": (b"ISO-10303-21;", f"a STEP model, {NOT}: export its points"),
    "gait.c3d": (b"\x02P" + b"\0" * 90, f"a motion recording, {NOT}: study joint"),
    "points.csv.gz": (b"\x1f\x8b\x08" + b"\0" * 20, f"a compressed file, {NOT}: unpack it"),
    "many.npz": (npz(a=POINTS, b=POINTS), "an archive of a, b: save its points alone, or call them points"),
    "torn.ply": (ply("<")[:-600], "its header announces 40 points"),
    "torn.pcd": (pcd("binary")[:-20], "its header announces 40 points, 38 are there"),
    "empty.obj": (b"o nothing\n", "0 points"),
}


@pytest.mark.parametrize("name", READ)
def test_read(tmp_path, name):
    """The coordinates, to the digits written, and no other column; the fit is the ball's."""
    for end, library in NEEDS.items():
        if name.endswith(end):
            pytest.importorskip(library, reason=f"{library} is in the extra points")
    (tmp_path / name).write_bytes(xlsx(READ[name]) if isinstance(READ[name], list) else READ[name])
    table = read_points(tmp_path / name)
    np.testing.assert_allclose(table.points, POINTS, rtol=0.0, atol=2e-5 if "binary" in name else 1e-9)
    fit = study.fit(table.points)
    assert fit.ok
    assert fit.radius == pytest.approx(25.0, abs=1e-3)


@pytest.mark.parametrize("name", REFUSED)
def test_refused(tmp_path, one_line, name):
    """One line with the file, what it is, and a way out."""
    data, words = REFUSED[name]
    (tmp_path / name).write_bytes(data)
    with one_line(PointFileError, re.escape(words), start=f"{tmp_path / name}: "):
        read_points(tmp_path / name)


@pytest.mark.parametrize(("name", "library"), [("airborne.las", "laspy"), ("sheet.xlsx", "openpyxl")])
def test_a_library_that_is_not_installed(tmp_path, monkeypatch, name, library):
    """The command that installs it, and another way."""
    (tmp_path / name).write_bytes(las() if library == "laspy" else xlsx(SHEET))
    monkeypatch.setitem(sys.modules, library, None)
    words = rf"{library} is not installed: pip install 'sphere-fit-study\[points\]', or "
    with pytest.raises(PointFileError, match=words):
        read_points(tmp_path / name)


@pytest.mark.parametrize("name", [*(n for n in READ if n.split(".")[0] in ("little", "text", "binary")), "leica.pts"])
def test_damage_is_refused_in_one_line(tmp_path, name):
    """Two hundred files with a piece cut out or bytes changed: read or refused in a line, never another exception."""
    rng, data = np.random.default_rng(7), READ[name]
    said = []
    for _ in range(200):
        damaged = bytearray(data)
        start, length = rng.integers(len(data)), rng.integers(1, 60)
        damaged[start : start + length] = rng.bytes(rng.integers(0, 60))
        (tmp_path / name).write_bytes(damaged)
        try:
            read_points(tmp_path / name)
        except PointFileError as error:
            said.append(str(error))
    assert len(said) > 10
    assert not [words for words in said if "\n" in words]


@pytest.mark.plain
def test_frames():
    """`study.fit` takes the columns of a data frame by the same rule; more columns without names are refused."""
    frame = pd.DataFrame({"label": "a", "X [mm]": X, "Y [mm]": Y, "Z [mm]": Z, "intensity": INTENSITY})
    expected = study.fit(POINTS)
    for points in (frame, frame[frame.columns[::-1]], pd.DataFrame(POINTS, columns=list("abc"))):
        np.testing.assert_array_equal(study.fit(points).center, expected.center)
    nameless = pd.DataFrame(np.column_stack([POINTS, INTENSITY]))
    with pytest.raises(ValueError, match=r"points: 4 columns, and no names say .* frame.to_numpy\(\) for all 4"):
        study.fit(nameless)
    assert study.fit(nameless.to_numpy()).center.shape == (4,)
    with pytest.raises(ValueError, match="columns lat and lon are angles"):
        study.fit(pd.DataFrame(POINTS, columns=["lat", "lon", "h"]))
    assert study.fit(pd.DataFrame(POINTS[:, :2], columns=list("ab"))).center.shape == (2,)


def test_dimension(tmp_path):
    """All of four columns are coordinates where that is asked for; a number that does not fit is refused."""
    path = tmp_path / "four.csv"
    path.write_bytes(text("", POINTS, INTENSITY))
    assert read_points(path, dimension=4).points.shape == (40, 4)
    assert read_points(path, ["1", "2", "3"]).points.shape == (40, 3)
    assert read_points(path, ["4", "2", "3", "1"]).points.shape == (40, 4)
    with pytest.raises(PointFileError, match="4 columns, --dimension 3: name the 3 with --columns"):
        read_points(path, dimension=3)
    with pytest.raises(PointFileError, match="--dimension 3, but --columns has 2"):
        read_points(path, ["1", "2"], dimension=3)
    path.write_bytes(text("x,y,z,w\n", POINTS, INTENSITY))
    assert read_points(path, dimension=3).names == read_points(path).names == ["x", "y", "z"]
    assert read_points(path, dimension=4).names == list("xyzw")
