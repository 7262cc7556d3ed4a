"""The figure of ranks and coverage, from tables whose answers are known."""

import dataclasses
import itertools

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from study import style
from study.simulation.experiment.config import ChainStatus
from study.simulation.figures import fig_calibration

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


def test_reasons(small, refused):
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
def test_drawn(small, likelihoods):
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
    assert words[-2:] == ["σ known", "σ unknown"]
    assert len(words) == 4 * len(likelihoods) + 2
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
