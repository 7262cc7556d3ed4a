"""Certified pairs: solved again by mpmath, met by the fits, noticed when mutated, and refused when malformed."""

import mpmath
import numpy as np
import pytest

from study.fits import certify

PAIRS = {name: list(certify.reference_pairs(name)) for name in certify.CERTIFIED}
EVERY_FIFTH = [(name, k) for name, pairs in PAIRS.items() for k in range(2, len(pairs), 5)]


@pytest.fixture(autouse=True)
def digits():
    """Mpmath computes with 80 digits."""
    with mpmath.workdps(80):
        yield


def exact(pair):
    """Points (list of lists), centre and radius of a pair as numbers of mpmath."""
    *center, radius = (mpmath.mpf(str(value)) for value in pair.sphere)
    return pair.points.tolist(), center, radius


def distances(points, center):
    return [mpmath.sqrt(sum((mpmath.mpf(a) - b) ** 2 for a, b in zip(row, center, strict=True))) for row in points]


def least_squares_gradient(points, center):
    """½∇F of F(c) = Σ(|x - c| - mean)²."""
    lengths = distances(points, center)
    mean = mpmath.fsum(lengths) / len(lengths)
    pairs = list(zip(points, lengths, strict=True))
    along = [mpmath.fsum((r - mean) * (b - mpmath.mpf(x[i])) / r for x, r in pairs) for i, b in enumerate(center)]
    return along, mean


@pytest.mark.parametrize(("name", "k"), EVERY_FIFTH)
def test_another_solver_agrees(name, k):
    """Mpmath's own solvers, with other equations, give the certified sphere to 50 digits."""
    pair = PAIRS[name][k]
    points, center, radius = exact(pair)
    if name == "mle":
        start = [b + radius * mpmath.mpf(10) ** -12 for b in center]
        other = mpmath.findroot(lambda *c: least_squares_gradient(points, c)[0], start)
        answer = [*other, least_squares_gradient(points, list(other))[1]]
    elif name == "gdke":  # |x|² = 2 x·c + k by orthogonal factors, not by normal equations
        near = [mpmath.mpf(float(value)) for value in pair.sphere[:-1]]  # its rows have no zero, which qr_solve needs
        rows = [[mpmath.mpf(a) - b for a, b in zip(row, near, strict=True)] for row in points]
        design = mpmath.matrix([[*(2 * value for value in row), 1] for row in rows])
        *shift, rest = mpmath.qr_solve(design, mpmath.matrix([sum(v**2 for v in row) for row in rows]))[0]
        answer = [a + b for a, b in zip(shift, near, strict=True)]
        answer.append(mpmath.sqrt(rest + sum(value**2 for value in shift)))
    else:
        lengths = distances(points, center)
        answer = [*center, (max(lengths) + min(lengths)) / 2]
    for one, other in zip(answer, [*center, radius], strict=True):
        assert abs(one - other) < radius * mpmath.mpf(10) ** -50


@pytest.mark.parametrize("k", range(0, len(PAIRS["minimum_zone"]), 3))
def test_a_zone_is_the_narrowest(k):
    """D + 2 points touch the zone, all others lie inside, and multipliers of both sides prove that it is a minimum."""
    pair = PAIRS["minimum_zone"][k]
    points, center, radius = exact(pair)
    lengths = distances(points, center)
    residuals = [r - radius for r in lengths]
    half = max(map(abs, residuals))
    touching = [i for i, value in enumerate(residuals) if abs(abs(value) - half) < radius * mpmath.mpf(10) ** -50]
    d = pair.points.shape[1]
    assert len(touching) == d + 2
    assert max(abs(residuals[i]) for i in range(len(points)) if i not in touching) < 0.95 * half
    units = np.array([[float((a - b) / lengths[i]) for a, b in zip(points[i], center, strict=True)] for i in touching])
    sides = np.array([1.0 if residuals[i] > 0 else -1.0 for i in touching])
    multipliers = np.linalg.svd(np.column_stack([units, np.ones(d + 2)]).T)[2][-1] * sides
    assert (multipliers > 0).all() or (multipliers < 0).all()


@pytest.mark.parametrize("name", certify.CERTIFIED)
def test_the_fits_meet_the_pairs(name):
    """Every set that double precision can tell is met to 1e-9 of the radius; the others to what their digits tell."""
    results = [certify.certificate(pair, name) for pair in PAIRS[name]]
    told = [one for one in results if one.is_told(1e-9)]
    assert len(results) >= 60
    assert len(told) >= 45
    assert max(one.error for one in told) < 1e-9
    assert all(one.passes(1e-9) for one in results)


def test_half_a_unit_of_the_last_place(rng):
    """Random shifts of half a unit in the last place move the answer by the stated resolution, within a third.

    300 shifts: the root mean square has an error of 4 %, and of few points a little more.
    """
    for k in (2, 41, 76):
        pair = PAIRS["mle"][k]
        stated = certify.certificate(pair, "mle").resolution
        half = 0.5 * np.spacing(np.abs(pair.points))
        units = pair.points - np.array([float(value) for value in pair.sphere[:-1]])
        units /= np.linalg.norm(units, axis=1)[:, None]
        base = np.column_stack([units, np.ones(len(units))])
        moved = [np.linalg.lstsq(base, (units * half * rng.choice([-1, 1], half.shape)).sum(1))[0] for _ in range(300)]
        seen = np.sqrt((np.array(moved) ** 2).sum(1).mean()) / float(pair.sphere[-1])
        assert stated == pytest.approx(seen, rel=0.34)


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    """A folder with six good pairs of least squares."""
    folder = tmp_path_factory.mktemp("pairs")
    near = [pair for pair in PAIRS["mle"] if "offset0-" in pair.name and "cap002" not in pair.name]
    certify.write_pairs(near[::4], folder)
    return folder


def test_files_keep_every_digit(good):
    """Points are read back exactly, and spheres to 59 digits."""
    known = {pair.name: pair for pair in PAIRS["mle"]}
    files = certify.pair_files(good)
    assert len(files) == 6
    for path in files:
        pair = certify.read_pair(path)
        np.testing.assert_array_equal(pair.points, known[pair.name].points)
        for one, other in zip(pair.sphere, known[pair.name].sphere, strict=True):
            assert abs(one - other) <= abs(other) * certify.Decimal("1e-58")


@pytest.mark.parametrize("place", range(6))
@pytest.mark.parametrize("kind", ["center", "diameter", "point"])
def test_a_mutated_pair_is_noticed(good, tmp_path, place, kind):
    """One number that is off by a millionth of the radius makes its set fail, and no other."""
    pairs = list(certify.read_pairs([good], []))
    pair = pairs[place]
    sphere, points = list(pair.sphere), pair.points.copy()
    if kind == "point":
        points[3] += 1e-6 * (points[3] - np.array([float(value) for value in sphere[:-1]]))
    else:
        sphere[0 if kind == "center" else -1] += sphere[-1] * certify.Decimal("1e-6")
    pairs[place] = certify.ReferencePair(pair.name, points, tuple(sphere))
    certify.write_pairs(pairs, tmp_path)
    results = [certify.certificate(pair, "mle") for pair in certify.read_pairs([tmp_path], [])]
    assert [one.name for one in results if not one.passes(1e-9)] == [pair.name]


FIT = "0\n0\n0\n2\n"
BAD = {
    "words": ({"a.ds": "1 2 three\n" * 5, "a.fit": FIT}, "a.ds: line 1"),
    "ragged": ({"a.ds": "1 2 3\n" * 4 + "1 2\n", "a.fit": FIT}, "point 5 has 2 numbers"),
    "few points": ({"a.ds": "1 2 3\n" * 3, "a.fit": FIT}, "3 points of 3 coordinates"),
    "no answer": ({"a.ds": "1 2 3\n" * 5}, "a.fit: no such file"),
    "empty": ({"a.ds": "", "a.fit": FIT}, "a.ds: holds no numbers"),
    "another shape": ({"a.ds": "1 2 3\n" * 5, "a.fit": "0\n0\n0\n0\n0\n1\n2\n"}, "a.fit: 7 numbers"),
    "negative": ({"a.ds": "1 2 3\n" * 5, "a.fit": "0\n0\n0\n-2\n"}, "the diameter is -2"),
    "infinite": ({"a.ds": "1 2 inf\n" * 5, "a.fit": FIT}, "expected finite numbers"),
    "too large": ({"a.ds": "1 2 1e999\n" * 5, "a.fit": FIT}, "expected finite numbers"),
    "bytes": ({"a.ds": b"\xff\xfe\x00\x01", "a.fit": FIT}, "not a text of numbers"),
    "one column": ({"a.ds": "1\n" * 5, "a.fit": "0\n2\n"}, "5 points of 1 coordinates"),
    "nothing": ({"readme.txt": "1"}, "holds no .ds file"),
}


@pytest.mark.parametrize("kind", BAD)
def test_malformed_folders(tmp_path, kind):
    """Each is one line that names the file; the pairs of other folders are read."""
    files, words = BAD[kind]
    for name, content in files.items():
        (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    complaints = []
    assert list(certify.read_pairs([tmp_path], complaints)) == []
    (line,) = complaints
    assert words in line
    assert str(tmp_path) in line
    assert "\n" not in line


def test_points_without_a_fit(tmp_path):
    """Points of a line have no sphere: the set fails, in words."""
    (tmp_path / "a.ds").write_text("".join(f"{k} {2 * k} {3 * k}\n" for k in range(6)))
    (tmp_path / "a.fit").write_text(FIT)
    (pair,) = certify.read_pairs([tmp_path], [])
    one = certify.certificate(pair, "gdke")
    assert not one.passes(1e-9)
    assert list(certify.printed({"gdke": [one]}, 1e-9))[-1].startswith("a: gdke")


def test_a_sphere_elsewhere(tmp_path):
    """A centre that is far out of the range of the points, or of numbers, is a failure and no error of arithmetic."""
    for number, sphere in enumerate(("1e200 0 0 2", "0 0 0 1e-300", "1e300 1e300 1e300 1e-300")):
        (tmp_path / f"{number}.ds").write_text("1 0 0\n0 1 0\n0 0 1\n-1 0 0\n0 -1 0\n")
        (tmp_path / f"{number}.fit").write_text(sphere.replace(" ", "\n"))
    for pair in certify.read_pairs([tmp_path], []):
        assert not certify.certificate(pair, "mle").passes(1e-9)
