"""The figure of one trial's posterior, from draws of known Gaussians.

The figure of ranks and coverage, from tables whose answers are known.
"""

import dataclasses
import itertools
import math

import matplotlib.patches
import numpy as np
import pandas as pd
import pytest
from scipy import stats

from study import style
from study.fits import Status
from study.simulation.experiment.config import ChainStatus
from study.simulation.figures import fig_calibration, fig_posterior

NAMES = ["mle", "gdke", "ugdk"]
DRAWS = 500
RADIUS = 2.0
MEAN = np.array([0.03, -0.01, 0.0, 0.02])
SD = np.array([0.12, 0.03, 0.04, 0.1])
CORRELATION = {1: 0.3, 2: -0.2, 3: -0.8}
"""Of the first component with the others, the last of which is the radius."""


def covariance():
    """Of (c, r), in the unit of the points."""
    matrix = np.diag(SD**2)
    for i, value in CORRELATION.items():
        matrix[0, i] = matrix[i, 0] = value * SD[0] * SD[i]
    return matrix


def chain(cell, trial, likelihood="geometric", noise_is="known", **columns):
    """A row of the posterior table."""
    key = {"cell": cell, "trial": trial, "likelihood": likelihood, "noise_is": noise_is}
    conditions = {"samples": 100, "noise": 0.1, "angle": 60.0, "radius": RADIUS, "flatness": 0.01}
    bounds = {f"bound_{e}": 0.9 * sd for e, sd in zip(("1", "2", "3", "radius"), SD, strict=True)}
    bounds |= {f"bound_with_{e}": CORRELATION[i + 1] for i, e in enumerate(("2", "3", "radius"))}
    return key | conditions | bounds | {"status": int(ChainStatus.OK), "draws": 812.4} | columns


def cloud(row, seed=1, count=DRAWS, center=MEAN):
    """Its draws."""
    values = np.random.default_rng(seed).multivariate_normal(center, covariance(), count)
    names = ["error_1", "error_2", "error_3", "radius_error"]
    frame = pd.DataFrame(dict(zip(names, values.T, strict=True)))
    return frame.assign(**{key: row[key] for key in ("cell", "trial", "likelihood", "noise_is")}, noise=0.1)


@pytest.fixture
def tables(make_rows, make_tables):
    """Tables of a run with these chains, the draws of those that are kept, and three trials of each cell."""

    def make(chains, kept=None, change=lambda errors: errors, count=DRAWS):
        rng = np.random.default_rng(4)
        parts = []
        for cell, name in itertools.product(dict.fromkeys(row["cell"] for row in chains), NAMES):
            error, of_radius = 0.05 * rng.normal(size=(3, 3)), 0.05 * rng.normal(size=3)
            parts.append(make_rows(cell, name, error, radius=RADIUS, radius_error=of_radius))
        base = make_tables(change(pd.concat(parts, ignore_index=True)), "grid")
        draws = [cloud(row, seed, count) for seed, row in enumerate(chains if kept is None else kept)]
        nothing = cloud(chains[0]).iloc[:0]
        drawn = pd.concat([nothing, *draws], ignore_index=True)
        return dataclasses.replace(base, posterior=pd.DataFrame(chains), draws=drawn)

    return make


PLANES = [("error_2", 1), ("radius_error", 3)]


def test_shares(tables):
    """A place's share is that of the draws with more density, by a sum over the draws written out here."""
    made = tables([chain("c", 1)])
    rng = np.random.default_rng(2)
    for view, (column, _) in zip(fig_posterior.prepare(made).views, PLANES, strict=True):
        cloud = made.draws[["error_1", column]].to_numpy() / RADIUS
        width = np.cov(cloud.T) * (1.25 * DRAWS ** (-1.0 / 6.0)) ** 2
        inverse = np.linalg.inv(width)

        def density(place, cloud=cloud, inverse=inverse):
            away = cloud - place
            return np.exp(-0.5 * np.einsum("ni,ij,nj->n", away, inverse, away)).sum()

        at_draws = np.array([density(draw) for draw in cloud])
        assert view.share.max() == 1.0
        for i, j in rng.integers(0, len(view.x), (40, 2)):
            share = np.mean(at_draws > density([view.x[i], view.y[j]]))
            assert view.share[j, i] == pytest.approx(share, abs=1.5 / DRAWS)


def test_views(tables):
    """Both planes are of the axis and another parameter, in radii, with all draws, answers and the bound in view."""
    made = tables([chain("c", 1)])
    frame = fig_posterior.prepare(made)
    assert frame.names == NAMES
    errors = made.errors[made.errors["trial"] == 1]
    for view, (column, other) in zip(frame.views, PLANES, strict=True):
        np.testing.assert_allclose(view.answers, errors[["error_1", column]] / RADIUS)
        part = (0.9**2) * covariance()[np.ix_([0, other], [0, other])] / RADIUS**2
        np.testing.assert_allclose(view.bound, part, rtol=1e-12)
        reach = math.sqrt(stats.chi2.ppf(0.95, 2)) * np.sqrt(np.diag(part))
        for axis, name, size in ((view.x, "error_1", reach[0]), (view.y, column, reach[1])):
            shown = [*(made.draws[name] / RADIUS), *(errors[name] / RADIUS), size, -size]
            assert axis[0] < min(shown)
            assert max(shown) < axis[-1]
    assert frame.views[0].words != frame.views[1].words == "radius"


def test_words(tables):
    """The caption has the conditions of the trial, the stamp its name and how many independent draws there are."""
    frame = fig_posterior.prepare(tables([chain("c", 1, samples=1000)]))
    assert frame.caption == "$N$ = 1,000, $σ$ = 0.05 $r$, $φ$ = 60°"
    assert frame.stamp == "test-0123456789, cell c, trial 1; 812 independent draws"


def test_the_flattest_cap_is_shown(tables):
    """Of chains that are ok and kept the one with the greatest σ²/v, and of equals that with the fewest samples."""
    chains = [
        chain("a", 0, flatness=0.010, samples=100),
        chain("b", 0, flatness=0.015, samples=300),
        chain("b", 1, flatness=0.015, samples=100),
        chain("b", 2, flatness=0.015, samples=200),
        chain("a", 1, flatness=0.9, status=int(ChainStatus.AT_PRIOR)),
        chain("c", 0, flatness=0.5),  # whose draws were not kept
        chain("c", 1, flatness=0.9, likelihood="whole_sphere"),
        chain("c", 2, flatness=0.9, noise_is="unknown"),
    ]
    made = tables(chains, kept=[row for row in chains if (row["cell"], row["trial"]) != ("c", 0)])
    assert "cell b, trial 1;" in fig_posterior.prepare(made).stamp


def test_only_draws_of_the_chain_itself_count(tables):
    """Other likelihoods, other noise, other trials and cells of the same tables are not mixed in."""
    mine = chain("c", 1, flatness=0.1)
    others = [chain("c", 1, "whole_sphere"), chain("c", 1, noise_is="unknown"), chain("c", 2), chain("d", 1)]
    alone, among = (fig_posterior.prepare(tables(chains)) for chains in ([mine], [mine, *others]))
    for one, other in zip(alone.views, among.views, strict=True):
        np.testing.assert_array_equal(one.share, other.share)
        np.testing.assert_array_equal(one.x, other.x)


def test_fits_that_failed_are_not_shown(tables):
    """An answer that is not ok, or no number, is left out with its name."""

    def spoil(errors):
        errors.loc[errors["estimator"] == "gdke", "status"] = int(Status.AT_BOUND)
        errors.loc[errors["estimator"] == "ugdk", ["error", "error_1"]] = np.nan
        return errors

    frame = fig_posterior.prepare(tables([chain("c", 1)], change=spoil))
    assert frame.names == ["mle"]
    assert all(len(view.answers) == 1 for view in frame.views)
    fig_posterior.draw(frame).draw_without_rendering()


def test_reasons(tables, refused):
    """Each thing that is missing is told, with the command that makes posteriors."""
    made = tables([chain("c", 1)])
    words = r"needs posteriors: \[posterior\] in the config, then `study posterior"
    for name in ("posterior", "draws"):
        refused(fig_posterior, made, words, **{name: None})
    missing = "needs a geometric chain with σ known that converged and whose draws were kept"
    for other in ({"status": int(ChainStatus.NOT_CONVERGED)}, {"likelihood": "whole_sphere"}, {"noise_is": "unknown"}):
        refused(fig_posterior, tables([chain("c", 1, **other)]), missing)
    refused(fig_posterior, tables([chain("c", 1)], kept=[]), missing)


def test_a_trial_that_no_estimator_answers(tables):
    """A chain may be ok where no fit is: its posterior is shown without answers."""
    frame = fig_posterior.prepare(
        tables([chain("c", 1)], change=lambda errors: errors.assign(status=int(Status.SINGULAR)))
    )
    assert frame.names == []
    fig_posterior.draw(frame).draw_without_rendering()


def test_drawn(tables):
    """Two panels: the shares' areas, the bound's 95 % ellipse about the truth, and a mark per estimator; one legend."""
    frame = fig_posterior.prepare(tables([chain("c", 1)]))
    figure = fig_posterior.draw(frame)
    assert len(figure.axes) == 2
    for ax, view in zip(figure.axes, frame.views, strict=True):
        (ellipse,) = [patch for patch in ax.patches if isinstance(patch, matplotlib.patches.Ellipse)]
        assert ellipse.get_center() == (0.0, 0.0)
        rim = ellipse.get_patch_transform().transform(matplotlib.path.Path.unit_circle().vertices)
        square = np.einsum("ni,ij,nj->n", rim, np.linalg.inv(view.bound), rim)
        ends = np.abs(square - stats.chi2.ppf(0.95, 2)) < 1e-6  # vertices between them control the curve
        assert ends.sum() >= 8
        assert np.ptp(rim[ends], axis=0).min() > 0.0
        (truth,) = [line for line in ax.lines if line.get_label() == "truth"]
        assert truth.get_xydata().tolist() == [[0.0, 0.0]]
        for name, place in zip(NAMES, view.answers, strict=True):
            (mark,) = [line for line in ax.lines if line.get_label() == style.label(name)]
            np.testing.assert_allclose(mark.get_xydata()[0], place)
            assert (mark.get_color(), mark.get_marker()) == (style.color(name), style.marker(name))
        (contours,) = [c for c in ax.collections if hasattr(c, "levels")]
        assert list(contours.levels) == [0.0, 0.68, 0.95]
        assert all(len(path.vertices) > 0 for path in contours.get_paths())
    assert figure.axes[0].get_xlabel() == figure.axes[1].get_xlabel()
    assert "axis" in figure.axes[0].get_xlabel()
    assert "across" in figure.axes[0].get_ylabel()
    assert "radius" in figure.axes[1].get_ylabel()
    assert figure.axes[0].get_title(loc="left") == frame.caption
    (legend,) = figure.legends
    words = [text.get_text() for text in legend.get_texts()]
    assert words == ["posterior, 68 %", "posterior, 95 %", "bound, 95 %", "truth", *map(style.label, NAMES)]
    assert [text.get_text() for text in figure.texts] == [frame.stamp]


def test_shades_of_the_legend_are_those_of_the_areas(tables):
    """What the legend calls 68 % has the colour of the inner area, and the inner area is the darker one."""
    figure = fig_posterior.draw(fig_posterior.prepare(tables([chain("c", 1)])))
    ax = figure.axes[0]
    (contours,) = [c for c in ax.collections if hasattr(c, "levels")]
    faces = [patch.get_facecolor() for patch in ax.patches if patch.get_label().startswith("posterior")]
    np.testing.assert_allclose(contours.get_facecolor(), faces)
    assert faces[0][0] < faces[1][0] < 1.0


BOTH = ("known", "unknown")


@pytest.fixture
def small(make_rows, make_tables, chains, beside, as_stored):
    """Tables of so many trials of two cells, the second of which may be too flat; ranks and levels are uniform."""

    def make(count=30, likelihoods=("geometric",), noises=("known",), flat=0.001, change=lambda p: p, **columns):
        rng = np.random.default_rng(3)
        words = {"likelihoods": likelihoods, "noises": noises, "ranks": ("1", "2", "3", "radius")}
        cells = [{"cell": "a", "flatness": 0.001}, {"cell": "b", "flatness": flat}]
        parts = [chains(rng, count, **words, **cell | columns) for cell in cells]
        posterior = pd.concat(parts, ignore_index=True)
        base = make_tables(make_rows("a", "mle", rng.normal(size=(4, 3))), "grid")
        tables = {"posterior": as_stored(change(posterior)), "answers": as_stored(beside(rng, posterior))}
        return dataclasses.replace(base, **tables)

    return make


def test_curves(small):
    """A curve per kind of chain and parameter, of the ranks in order; σ has one where it is not known."""
    tables = small(noises=BOTH, likelihoods=("geometric", "whole_sphere"))
    frame = fig_calibration.prepare(tables)
    kinds = {(c.likelihood, c.noise_is, c.parameter) for c in frame.curves}
    every = itertools.product(("geometric", "whole_sphere"), BOTH, ("1", "2", "radius", "noise"))
    assert kinds == {kind for kind in every if kind[1:] != ("known", "noise")}
    assert len(frame.curves) == 14
    for curve in frame.curves:
        found = tables.posterior
        some = found[(found["likelihood"] == curve.likelihood) & (found["noise_is"] == curve.noise_is)]
        np.testing.assert_array_equal(curve.ranks, np.sort(some[f"rank_{curve.parameter}"]))
    assert frame.trials == 60


def test_flat_caps_do_not_count(small):
    """Chains with σ²/v from 0.02 on are in no curve, no coverage and no count."""
    frame = fig_calibration.prepare(small(flat=0.02))
    assert frame.trials == 30
    assert set(frame.coverage["trials"]) == {30}
    assert all(len(curve.ranks) == 30 for curve in frame.curves)


def spoiled(rows):
    """A change of a posterior table: chains of these rows are not ok."""

    def change(posterior):
        posterior.loc[rows, "status"] = int(ChainStatus.NOT_CONVERGED)
        return posterior

    return change


def test_chains_that_are_not_ok(small):
    """They are in no curve and outside of every set, and the stamp tells how many they are."""
    frame = fig_calibration.prepare(small(change=spoiled(slice(0, 6))))
    assert (frame.trials, set(frame.coverage.query("method == 'posterior'")["failed"])) == (53, {7})
    assert "7 chains not ok" in frame.stamp


def test_stamp(small):
    """The run's name and how many trials are behind a curve; nothing of failures where there is none."""
    assert fig_calibration.prepare(small(count=1000)).stamp == "test-0123456789 · 2,000 trials behind each curve"


def test_reasons_of_calibration(small, refused):
    """Each thing that is missing is told in a sentence that names the remedy, or the number."""
    made = small()
    words = r"needs posteriors: \[posterior\] in the config, then `study posterior"
    for name in ("posterior", "answers"):
        refused(fig_calibration, made, words, **{name: None})
    refused(fig_calibration, made, 'independent of each other: draws = "independent" in the config', independent=False)
    few = "needs at least 20 chains of each kind with σ²/v < 0.02, not"
    refused(fig_calibration, small(count=9), f"{few} 18")
    refused(fig_calibration, small(count=9, flat=0.5), f"{few} 9")
    refused(fig_calibration, small(count=9, flat=0.5, change=lambda p: p.assign(flatness=0.5)), f"{few} 0")
    assert fig_calibration.prepare(small(count=10)).trials == 20


def test_each_kind_needs_enough(small, refused):
    """Twenty chains of one kind do not stand for those of the other."""

    def drop(posterior):
        return posterior[(posterior["noise_is"] == "known") | (posterior["trial"] < 9)].reset_index(drop=True)

    refused(fig_calibration, small(noises=BOTH, change=drop), "not 18")


def test_chains_of_which_few_are_ok(small, refused):
    """One is drawn; a run whose chains did not converge is no failure of the figure."""
    refused(fig_calibration, small(change=spoiled(slice(None))), "needs chains that are ok: none is")
    frame = fig_calibration.prepare(small(change=spoiled(slice(1, None))))
    assert frame.trials == 1
    fig_calibration.draw(frame).draw_without_rendering()


@pytest.mark.parametrize("likelihoods", [("geometric",), ("geometric", "whole_sphere")])
def test_drawn_curves_and_shares(small, likelihoods):
    """Left: every curve over the band of Kolmogorov's 95 %; right: a row per method with share, interval and levels."""
    frame = fig_calibration.prepare(small(noises=BOTH, likelihoods=likelihoods))
    figure = fig_calibration.draw(frame)
    left, right = figure.axes
    (band,) = left.patches
    reach = stats.kstwo.ppf(1 - 0.05 / len(frame.curves), frame.trials)
    corners = band.get_path().transformed(band.get_patch_transform()).get_extents()
    assert (corners.y0, corners.y1) == pytest.approx((-reach, reach))
    lines = [line for line in left.lines if len(line.get_xdata()) > 2]
    assert len(lines) == len(frame.curves)
    for line, curve in zip(lines, frame.curves, strict=True):
        x, y = line.get_xdata(), line.get_ydata()
        # just below and at each rank, the share of ranks below it
        shares = np.array([np.mean(curve.ranks < value) for value in curve.ranks])
        np.testing.assert_allclose(y[1:-1:2], shares - curve.ranks, atol=1e-12)
        np.testing.assert_allclose(y[2:-1:2], shares + 1.0 / len(curve.ranks) - curve.ranks, atol=1e-12)
        assert (x[0], x[-1], y[0], y[-1]) == (0.0, 1.0, 0.0, 0.0)
        assert left.get_ylim()[0] < y.min() < y.max() < left.get_ylim()[1]
        assert line.get_linestyle() == ("-" if curve.noise_is == "known" else "--")
    names = [text.get_text() for text in right.get_yticklabels()]
    posteriors = ["posterior"] if len(likelihoods) == 1 else ["posterior (geometric)", "posterior (whole sphere)"]
    assert sorted(names) == sorted([*posteriors, style.label("mle"), style.label("gdke")])
    thin = [line for line in right.lines if line.get_linewidth() == 1.0 == line.get_zorder() / 3]
    spans = sorted(tuple(line.get_xdata()) for line in thin)
    told = sorted(zip(frame.coverage["low"], frame.coverage["high"], strict=True))
    np.testing.assert_allclose([s for s in spans if len(s) == 2], told)
    assert right.get_xlim()[0] < frame.coverage["low"].min() < 1.0 <= right.get_xlim()[1]
    assert right.get_ylim()[0] > right.get_ylim()[1]  # from above to below
    (legend,) = figure.legends
    words = [text.get_text() for text in legend.get_texts()]
    assert words[-3:] == ["σ known", "σ unknown", "95 of 100 if calibrated"]
    assert len(words) == 4 * len(likelihoods) + 3
    assert [text.get_text() for text in figure.texts] == [frame.stamp]


def test_every_row_is_under_its_own_name(small):
    """The marks at the height of a method's name are its shares."""
    frame = fig_calibration.prepare(small(noises=BOTH))
    ax = fig_calibration.draw(frame).axes[1]
    labels = {"posterior": "posterior", "mle": style.label("mle"), "gdke": style.label("gdke")}
    for place, text in zip(ax.get_yticks(), ax.get_yticklabels(), strict=True):
        method = next(m for m, label in labels.items() if label == text.get_text())
        marks = [line for line in ax.lines if len(line.get_xdata()) == 1]
        near = [mark.get_xdata()[0] for mark in marks if abs(mark.get_ydata()[0] - place) < 0.5]
        told = frame.coverage.loc[frame.coverage["method"] == method, "share"]
        np.testing.assert_allclose(sorted(near), sorted(told))
