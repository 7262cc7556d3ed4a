"""The coverage study: its config, its shares and their errors, its figure, and independence of workers."""

import io
import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from study.cli import app
from study.fits.cap import sample_cap
from study.simulation.coverage import _outcome, _row, band, draw, least_variance, measure, printed, read_design, summary
from study.toml import ConfigError

SHIPPED = Path(__file__).parents[2] / "configs" / "coverage.toml"
SMALL = """
name = "small"
seed = 3
estimators = ["mle", "als"]
angle = [5, 60]
samples = [40]
kappa = [1, 100]
trials = 400
"""


@pytest.fixture(scope="module")
def design(tmp_path_factory):
    """Four cells of 400 trials."""
    path = tmp_path_factory.mktemp("coverage") / "small.toml"
    path.write_text(SMALL, encoding="utf-8")
    return read_design(path)


@pytest.fixture(scope="module")
def table(design):
    """Their measured coverage."""
    return measure(design, 2)


def test_shipped_config():
    """The shipped design has every cap, number and κ of the study, none with σ above .9 r, and 4000 trials a cell."""
    design = read_design(SHIPPED)
    cells = design.cells()
    assert {cell.angle for cell in cells} == {2, 5, 20, 45, 90, 180}
    assert {cell.samples for cell in cells} == {10, 40, 200, 1000, 10_000}
    assert max(cell.sigma for cell in cells) <= 0.9
    assert {cell.trials for cell in cells} == {4000}


@pytest.mark.parametrize("angle", [5.0, 70.0, 150.0, 180.0])
def test_least_variance(angle):
    """It is the least eigenvalue of the covariance of directions, to 4.5 standard errors of 10⁵ of them (3e-5)."""
    directions = sample_cap(np.random.default_rng(2), 100_000, math.radians(angle))
    assert np.linalg.eigvalsh(np.cov(directions.T))[0] == pytest.approx(least_variance(angle), rel=4.5 * 0.006)


def test_faults(tmp_path):
    """A config that cannot be used is refused with every fault and its line."""
    path = tmp_path / "wrong.toml"
    path.write_text(SMALL.replace("als", "alz").replace("= 400", "= 4"), encoding="utf-8")
    with pytest.raises(ConfigError, match=r"2 faults\n  line 4: .* mean 'als'.*\n  line 8: "):
        read_design(path)


@pytest.mark.parametrize(
    ("line", "other", "words"),
    [
        ('"als"', '"ugdk"', r"line 4: estimators = .*: 'ugdk': needs the noise, .*; leave it out"),
        ("angle = [5, 60]", "angle = [5, 270]", r"line 5: angle\[1\] = 270: .* less than or equal to 180"),
        ("[40]", "[40, 50, 40]", r"line 6: samples = .*: 40 given more than once; give each value once"),
        ("kappa = [1, 100]", "kappa = [inf]", r"line 7: kappa\[0\] = inf: .* finite"),
        ("kappa = [1, 100]", "kappa = [1e-6]", r"largest_noise = 0\.9: leaves no cell, .*; raise it, or kappa"),
        ("[40]", "[40, 9000]\nmost_samples = 10_000", r"line 7: .* 1 of the 20 tr.* N = 9,000 .* at least 180,000"),
        ("[40]", "[40, 20_000]\nmost_samples = 10_000", r"most_samples = 10000: is enough for 0 of the 20 trials"),
    ],
)
def test_designs_that_cannot_be_measured(tmp_path, line, other, words):
    """Entries that would end in no table are refused with their value, their place and a remedy."""
    path = tmp_path / "wrong.toml"
    path.write_text(SMALL.replace(line, other), encoding="utf-8")
    with pytest.raises(ConfigError, match=rf"1 fault\n.*{words}"):
        read_design(path)


def test_shares_by_hand(design):
    """Coverage counts ends that hold the truth; a missing end holds nothing; a share's error is binomial."""
    ends = np.array([[[-1.0, 1.0], [-1.0, 1.0], [0.5, 1.0], [0.9, 1.2]]] * 8)
    ends[0, 3] = 1.1, 1.2  # the radius is missed
    ends[1, 3] = np.nan
    ends[2, 3] = 0.5, np.inf
    ends[3:5, 0] = 0.1, 1.0  # the centre's first coordinate is missed
    ok = np.array([True, True, False, True, True, True, True, False])
    row = _row(design.cells()[0], "interval", _outcome(ends, ok, np.full(8, 0.3)))
    assert (row["radius"], row["axis"], row["across"]) == (6 / 8, 6 / 8, 1.0)
    assert (row["ok"], row["radius_ok"], row["open"]) == (6 / 8, 4 / 6, 1 / 8)
    assert row["radius_error"] == pytest.approx(math.sqrt(0.75 * 0.25 / 8))
    assert row["across_error"] == pytest.approx(math.sqrt(0.5 / 8 * (1 - 0.5 / 8) / 8))  # not 0
    assert row["width"] == pytest.approx(1.0)


def test_table(design, table):
    """Far from the noise every method covers in 95 %; where curvature is lost the interval alone does.

    Within 4.5 standard errors of 400 trials, and .015 for what the methods are off by; false alarms 1e-4.
    """
    assert len(table) == len(design.cells()) * 3
    error = 4.5 * math.sqrt(0.05 * 0.95 / 400) + 0.015
    far = table[table["kappa"] == 100]
    assert (far["radius"] - 0.95).abs().max() < error
    assert far["width"].between(0.9, 1.2).all()
    lost = table[table["kappa"] == 1].set_index("method")
    assert (lost.loc["interval", "radius"] - 0.95).abs().max() < error
    assert lost.loc["als", "radius"].max() < 0.95 - error / 2
    assert (lost.loc["interval", "open"] > 0.1).all()
    pd.testing.assert_frame_equal(measure(design, 1), table)  # one thread has the numbers of two


def test_figure_and_text(table):
    """The figure is drawn to equal bytes twice; the text has a line per cell and method."""
    files = []
    for _ in range(2):
        buffer = io.BytesIO()
        draw(table, "small").savefig(buffer, format="png", metadata={"Software": None})
        files.append(buffer.getvalue())
    assert files[0] == files[1]
    lines = list(printed(table))
    assert sum(line.startswith("40") for line in lines) == 2
    assert [line.split()[0] for line in lines[-3:]] == ["mle", "als", "interval"]


def test_command(tmp_path):
    """`study coverage` writes the table and its figure, and prints the coverages."""
    config = tmp_path / "small.toml"
    config.write_text(SMALL.replace("angle = [5, 60]", "angle = [60]").replace("400", "100"), encoding="utf-8")
    done = CliRunner().invoke(app, ["coverage", str(config), "--out", str(tmp_path / "out")], catch_exceptions=False)
    assert done.exit_code == 0
    names = ["coverage.csv", "coverage.parquet", "fig_coverage.png", "fig_coverage.svg"]
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == names
    assert len(pd.read_parquet(tmp_path / "out" / "coverage.parquet")) == 6
    assert "Coverage of the radius over all fits: mle / als / interval" in done.output


def test_band_follows_the_level(table):
    """The band is 0.93 to 0.97 at 0.95; at 0.5 as many standard errors of a share: 0.02 √(0.25/0.0475) either way."""
    assert band(0.95) == pytest.approx((0.93, 0.97), abs=1e-12)
    assert band(0.5) == pytest.approx((0.4541, 0.5459), abs=1e-4)
    assert band(0.999)[1] == 1.0
    assert "within 0.93-0.97" in summary(table, "interval")
    assert "within 0.454-0.546" in summary(table, "interval", 0.5)
