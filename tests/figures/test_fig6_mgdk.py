import dataclasses
import hashlib

import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import to_hex
from matplotlib.patches import Circle

import study
from study.estimators import mgdk
from study.figures import style
from study.figures.inputs import NotApplicable
from study.figures.paper import fig6_mgdk
from study.sphere.cap import sample_cap
from study.statistics.measures import quantile

CENTER = np.array([3.0, -4.0])
RADII = {"inner": 1.2, "outer": 2.0}
TRIALS, N, NOISE = 61, 40, 0.05


def kept(rng, cell, radius, trials=TRIALS, noise=NOISE, n=N):
    """Rows of a points table, in an order of their own, and the points (trials, n, 2)."""
    points = CENTER + radius * sample_cap(rng, trials * n, np.radians(50.0), 2).reshape(trials, n, 2)
    points += noise * rng.normal(size=points.shape)
    rows = pd.DataFrame(
        {"cell": cell, "trial": np.repeat(np.arange(trials), n), "sample": np.tile(np.arange(n), trials)}
    )
    rows[["x_1", "x_2"]] = points.reshape(-1, 2)
    rows[["center_1", "center_2", "radius"]] = [*CENTER, radius]
    return rows.sample(frac=1.0, random_state=1), points


@pytest.fixture
def markers(make_rows, make_tables):
    """Tables of a run with two markers, and the points of the inner and the outer one."""

    def make(cells, seed=1):
        rng = np.random.default_rng(seed)
        errors, tables, sets = [], [], []
        for cell, radius, columns in cells:
            rows, points = kept(rng, cell, radius, noise=columns.get("noise", NOISE))
            conditions = {"noise": NOISE, "samples": N, "angle": 50.0} | columns
            errors.append(make_rows(cell, "als", rng.normal(size=(TRIALS, 2)), radius=radius, center=5.0, **conditions))
            tables.append(rows)
            sets.append(points)
        return make_tables(pd.concat(errors, ignore_index=True), "grid", pd.concat(tables, ignore_index=True)), sets

    return make


@pytest.fixture
def two(markers):
    return markers([(name, radius, {}) for name, radius in RADII.items()])


def distances(inner, outer):
    """Errors of the outer marker alone, the inner one and both, one set after the other."""
    fits = [
        (study.fit(b, "als").center, study.fit(a, "als").center, mgdk([a, b]).center)
        for a, b in zip(inner, outer, strict=True)
    ]
    return np.linalg.norm(np.array(fits) - CENTER, axis=2).T


def test_medians(two):
    """The medians are those of fits made one by one, and their errors those of the quantile."""
    tables, (inner, outer) = two
    frame = fig6_mgdk.prepare(tables)
    expected = distances(inner, outer)
    np.testing.assert_allclose(frame.distances, expected, rtol=1e-9)
    np.testing.assert_allclose([median.value for median in frame.medians], np.median(expected, axis=1), rtol=1e-9)
    np.testing.assert_allclose([m.error for m in frame.medians], [quantile(row, 0.5).error for row in expected])


def test_the_joint_fit_is_better_by_as_much_as_theory_says(markers):
    """Little noise: each alone is at the same bound, which has no radius in it, and both together have half of it.

    The ratio of medians is 1/√2 within 4.5 Monte-Carlo errors (7 in 10⁶; more seldom, as the fits are correlated).
    """
    tables, _ = markers([("a", 1.2, {"noise": 1e-3}), ("b", 2.0, {"noise": 1e-3})])
    outer, inner, joint = fig6_mgdk.prepare(tables).medians
    for alone in (outer, inner):
        error = np.hypot(joint.error, alone.error / np.sqrt(2))
        assert abs(joint.value - alone.value / np.sqrt(2)) < 4.5 * error
        assert error < 0.25 * joint.value


def test_the_data_set_is_typical(two):
    """It is the trial whose worst ratio to a median is least, and its points and circles are that trial's."""
    tables, (inner, outer) = two
    frame = fig6_mgdk.prepare(tables)
    errors = distances(inner, outer)
    ratio = errors / np.median(errors, axis=1)[:, None]
    trial = int(np.argmin(np.maximum(ratio, 1.0 / ratio).max(axis=0)))
    np.testing.assert_allclose(frame.points[0], outer[trial] - CENTER)
    np.testing.assert_allclose(frame.points[1], inner[trial] - CENTER)
    joint = mgdk([inner[trial], outer[trial]])
    np.testing.assert_allclose(frame.centers[2], joint.center - CENTER, atol=1e-9)
    np.testing.assert_allclose(frame.radii[2], joint.radii[::-1])
    np.testing.assert_allclose(frame.radii[:2], [study.fit(each[trial], "als").radius for each in (outer, inner)])
    assert frame.true_radii == (2.0, 1.2)
    assert f"trial {trial} of {TRIALS}" in frame.stamp


def test_other_axes_stay_at_their_first_value(markers, two):
    """Cells of another noise, angle, centre or number of samples do not mix in."""
    cells = [(name, radius, {}) for name, radius in RADII.items()]
    more = [
        (f"{n}-{k}", r, c)
        for n, r, _ in cells
        for k, c in enumerate(({"noise": 0.3}, {"angle": 90.0}, {"samples": 99}))
    ]
    tables, _ = markers([*cells, *more])
    np.testing.assert_array_equal(fig6_mgdk.prepare(tables).distances, fig6_mgdk.prepare(two[0]).distances)
    assert "$σ$ = 0.05" in fig6_mgdk.prepare(tables).caption


def test_a_fit_without_a_number_counts_as_worst(two):
    """A set on a line has no centre: its error is infinite, the medians are of all trials, and it is drawn."""
    tables, _ = two
    points = tables.points
    flat = (points["trial"] == 5) & (points["cell"] == "inner")
    points.loc[flat, "x_1"] = points.loc[flat, "x_2"] = points.loc[flat, "sample"].astype(float)
    frame = fig6_mgdk.prepare(tables)
    assert np.isinf(frame.distances[1]).sum() == 1
    assert frame.medians[1].value == np.median(frame.distances[1])
    fig6_mgdk.draw(frame).draw_without_rendering()


def test_a_method_without_an_answer_chooses_no_trial():
    """Where most errors of a method are infinite, the trial is that which is typical of the others."""
    distances = np.array([[1.0, 2.0, 4.0], [np.inf, np.inf, 1.0], [1.0, 2.1, 4.0]])
    assert fig6_mgdk._typical(distances) == 1


def test_reasons(two, markers, power_tables, circle_tables):
    """Each thing that is missing is told in a sentence that names the remedy."""
    tables, _ = two
    replace = dataclasses.replace
    with pytest.raises(NotApplicable, match="dimension = 2"):
        fig6_mgdk.prepare(power_tables)
    with pytest.raises(NotApplicable, match="a grid of two radii"):
        fig6_mgdk.prepare(replace(tables, design="random"))
    with pytest.raises(NotApplicable, match="set keep_points"):
        fig6_mgdk.prepare(replace(tables, points=None))
    with pytest.raises(NotApplicable, match="two markers: two radii"):
        fig6_mgdk.prepare(circle_tables)
    relative, _ = markers([("a", 1.2, {"noise": 0.06}), ("b", 2.0, {"noise": 0.1})])
    with pytest.raises(NotApplicable, match="same noise: noise in the config, not noise_over_radius"):
        fig6_mgdk.prepare(relative)
    few = replace(tables, points=tables.points[tables.points["trial"] < 19])
    with pytest.raises(NotApplicable, match="at least 20 trials with points kept, not 19"):
        fig6_mgdk.prepare(few)


def test_shared_draws_are_refused(two):
    """Markers with the same directions and the same noise, c + r u + σ z, have nothing to add to each other."""
    tables, (inner, _) = two
    points = tables.points
    rng = np.random.default_rng(1)
    directions = sample_cap(rng, TRIALS * N, np.radians(50.0), 2)  # as the fixture drew them for the inner marker
    noise = inner.reshape(-1, 2) - CENTER - 1.2 * directions
    assert noise.std() == pytest.approx(NOISE, rel=0.1)
    shared = points[points["cell"] == "inner"].sort_values(["trial", "sample"]).assign(cell="outer", radius=2.0)
    shared[["x_1", "x_2"]] = CENTER + 2.0 * directions + noise
    both = pd.concat([points[points["cell"] == "inner"], shared], ignore_index=True)
    with pytest.raises(NotApplicable, match='draws = "independent"'):
        fig6_mgdk.prepare(dataclasses.replace(tables, points=both))


def test_drawn_circles(two):
    """Outer red, inner blue, joint green twice, each where its fit is, in lines of their own; the truth is faint."""
    frame = fig6_mgdk.prepare(two[0])
    figure = fig6_mgdk.draw(frame)
    whole, zoom = figure.axes
    circles = [patch for patch in whole.patches if isinstance(patch, Circle)]
    fitted = [c for c in circles if to_hex(c.get_edgecolor()) in fig6_mgdk._COLORS]
    found = [(to_hex(c.get_edgecolor()), *c.center, c.radius) for c in fitted]
    both = frame.radii[2]
    told = [
        (fig6_mgdk.OUTER, *frame.centers[0], frame.radii[0]),
        (fig6_mgdk.INNER, *frame.centers[1], frame.radii[1]),
        (fig6_mgdk.JOINT, *frame.centers[2], both[0]),
        (fig6_mgdk.JOINT, *frame.centers[2], both[1]),
    ]
    assert found == told
    assert len({str(c.get_linestyle()) for c in fitted}) == 3
    assert sorted(c.radius for c in circles if c not in fitted) == [1.2, 2.0]
    for line, distance in zip(zoom.lines, frame.distances, strict=False):
        np.testing.assert_array_equal(line.get_xdata(), np.sort(distance))
    words = "\n".join(text.get_text() for text in zoom.get_legend().get_texts())
    assert all(f"{median.value:.3f} ± {median.error:.3f}" in words for median in frame.medians)


def test_equal_bytes_twice(two, tmp_path):
    """The same tables, whatever the order of their rows, give the same files."""
    tables, _ = two
    other = dataclasses.replace(tables, points=tables.points.sample(frac=1.0, random_state=9))
    digests = []
    for place, given in enumerate((tables, other)):
        paths = style.save(fig6_mgdk.draw(fig6_mgdk.prepare(given)), tmp_path / str(place))
        digests.append([hashlib.sha256(path.read_bytes()).hexdigest() for path in paths])
    assert digests[0] == digests[1]
