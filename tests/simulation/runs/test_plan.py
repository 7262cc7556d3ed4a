"""The counts of a plan are those of the run; the calibration gives seconds between and beyond measured sizes."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from study.files import RunError
from study.simulation.experiment.compute import compute
from study.simulation.experiment.config import parse
from study.simulation.runs import parts
from study.simulation.runs import plan as module
from study.simulation.runs.parts import Layout
from study.simulation.runs.plan import Pace, measure, plan
from tests.configs import log_uniform, uniform

pytestmark = pytest.mark.usefixtures("same_software")

PLANS = {
    "grid": {},
    "relative": {"noise": None, "noise_over_radius": [0.1, 0.2, 0.4], "radius": [1, 2]},
    "independent": {"draws": "independent", "center": [0, 1]},
    "five dimensions": {"top": {"dimension": 5}},
    "random": {
        "kind": "random",
        "trials": 60,
        "samples": log_uniform(4, 500),
        "noise": log_uniform(1e-3, 10),
        "angle": uniform(0, 180),
    },
}


@pytest.mark.parametrize("name", list(PLANS))
def test_counts_are_those_of_the_run(start, make_text, name):
    """Cells, trials, fits, samples, draws and units are those of the run; the study is left as it was.

    Seconds and bytes are finite and above 0, and every line has a label and a value.
    """
    entries = {**PLANS[name]}
    entries["top"] = {"estimators": ["lls", "ugdk"], "keep_points": 1} | entries.get("top", {})
    study = parse(make_text(**entries))
    before = study.model_dump_json()
    made = plan(study, 2)
    assert study.model_dump_json() == before
    assert 0.0 < made.seconds < math.inf
    assert 0.0 < made.bytes < math.inf
    lines = dict(made.lines())
    assert (lines["cells"], lines["fits"]) == (f"{made.cells:,}", f"{made.fits:,}")
    assert all(lines.values())
    run = start(**entries)
    errors, timings = run.table("errors"), run.table("timings")
    one = errors[errors["estimator"] == "lls"]
    assert made.cells == errors["cell"].nunique()
    assert made.fits == len(errors)
    assert made.trials == len(one)
    assert made.samples == one["samples"].sum()
    drawn = timings[timings["step"] == "draw"]
    assert made.draws == (drawn["samples"] * drawn["fits"]).sum()
    assert made.units == len(list(study.units()))


def test_units_of_equal_size_are_counted_at_once(make_text):
    """A last unit that is smaller than the others is one more; the sums are those over all units."""
    study = parse(make_text({"estimators": ["lls"]}, samples=[5, 400], trials=12_345))
    made, every = plan(study, 1), [batch for unit in study.units() for batch in unit.parts(0)]
    assert made.units == len(list(study.units())) > 2
    assert made.draws == sum(batch.trials * batch.group.samples for batch in every)
    assert made.samples == sum(batch.trials * batch.group.samples * len(batch.cells) for batch in every)


def test_no_piece_takes_long(make_text):
    """Robust fits are cut to half a second by their weight; workers differ by that, and a stop comes after it."""
    design = {"trials": 1000, "samples": [20, 300], "noise": [0.01, 0.1], "angle": 90}
    made = parse(make_text({"estimators": ["robust"]}, **design))
    layout = Layout(made)
    weights = [layout.task(piece).weight for piece in layout.pieces()]
    least = 1000 * 2 * ((1e5 + 20 * 1e3) + (1e5 + 300 * 1e3))  # two levels of each number of samples
    assert least < sum(weights) < 1.01 * least
    assert 0.8 * parts._PIECE < min(weights) <= max(weights) < 1.01 * parts._PIECE
    cheap = parse(make_text({"estimators": ["mle"]}, **design))
    assert list(Layout(cheap).pieces()) == list(cheap.units())


def test_pieces_are_counted(make_text, dear, monkeypatch):
    """Counts are those of the units, their number is that of the pieces, and many workers share the time of one."""
    pace = SimpleNamespace(of=lambda samples, levels: 1.0, summary=0.0)
    monkeypatch.setattr("study.simulation.runs.plan.measure", lambda *_: pace)
    made = parse(make_text({"estimators": ["lls"]}, samples=6, trials=300, noise=0.1, angle=90))
    whole = plan(made, 100)
    dear()
    cut = plan(made, 100)
    assert (whole.units, cut.units) == (1, math.ceil(300 / 3.5))  # so many trials are heavy enough for a piece
    assert (cut.draws, cut.samples, cut.trials, cut.fits) == (whole.draws, whole.samples, whole.trials, whole.fits)
    assert whole.seconds == pytest.approx(300.0, abs=0.1)
    assert cut.seconds == pytest.approx(4.0 + module._START_SECONDS, abs=0.1)


@pytest.mark.parametrize(("top", "rows"), [({}, 4 * 2), ({"keep": "summary"}, 0)], ids=["errors", "summary"])
def test_the_summary_of_many_cells_takes_time(make_text, monkeypatch, top, rows):
    """Each of its rows is counted, unless the workers make it."""
    pace = SimpleNamespace(of=lambda samples, levels: 1.0, summary=0.0)
    monkeypatch.setattr("study.simulation.runs.plan.measure", lambda *_: pace)
    names = {"estimators": ["lls", "als"]}
    made = parse(make_text(names | top, samples=[6, 40], trials=70, noise=[0.1, 0.2], angle=90))
    before = plan(made, 1).seconds
    monkeypatch.setattr(module, "_GROUP_SECONDS", module._GROUP_SECONDS + 5.0)
    assert plan(made, 1).seconds - before == pytest.approx(5.0 * rows)


@pytest.mark.parametrize("most", [4, 70 * 4])
def test_a_summary_that_is_cut(make_text, monkeypatch, most):
    """Units of some cells of a group make its draws again; each of them fits its own cells alone."""
    made = parse(make_text({"keep": "summary"}, samples=[6, 40], trials=70, noise=[0.1, 0.2, 0.3], angle=90))
    whole = plan(made, 1)
    monkeypatch.setattr("study.simulation.experiment.config._FITS_IN_MEMORY", most)
    cut = plan(made, 1)
    assert (whole.units, cut.units, cut.draws) == (2, 6, 3 * whole.draws)
    assert (cut.samples, cut.trials, cut.fits) == (whole.samples, whole.trials, whole.fits)
    assert whole.samples == 3 * 70 * (6 + 40)


def test_a_study_of_millions_of_units(make_text, monkeypatch):
    """The counts are those of arithmetic: eight million samples and more are a unit, at three levels of noise here."""
    pace = SimpleNamespace(of=lambda samples, levels: 1.0, summary=0.0)
    monkeypatch.setattr("study.simulation.runs.plan.measure", lambda *_: pace)
    made = plan(parse(make_text(samples=1_000_000, trials=10_000_000, noise=[0.1, 0.2, 0.3], angle=90)), 2)
    assert made.draws == 10**13
    assert made.samples == 3 * 10**13
    assert made.units == math.ceil(10**7 / 3)


def test_bytes_are_of_the_right_size(start, make_text):
    """The predicted storage is that of the stored tables within a factor of two, for 10⁵ rows and points."""
    entries = {"top": {"estimators": ["lls", "ugdk"], "keep_points": 50}, "trials": 5000, "draws": "independent"}
    predicted = plan(parse(make_text(**entries)), 2).bytes
    run = start(**entries)
    stored = sum((run.folder / f"{name}.parquet").stat().st_size for name in ("errors", "points"))
    assert 0.5 < predicted / stored < 2.0


def test_designs_of_millions_of_cells(make_text, monkeypatch):
    """A random design is extrapolated from its first trials, to the same sizes; a grid is refused with one line."""
    laws = {"samples": uniform(5, 9), "noise": 0.1, "angle": 90}
    made = parse(make_text(kind="random", trials=400, **laws))
    counted = plan(made, 1)
    grid = parse(make_text(trials=1, noise={"logspace": [0.01, 1, 101]}))
    monkeypatch.setattr("study.simulation.runs.plan._MOST_COUNTED", 399)
    found = plan(made, 1)
    assert (found.cells, found.trials, found.fits) == (counted.cells, counted.trials, counted.fits)
    assert found.samples == pytest.approx(counted.samples, rel=0.4)  # 39 trials of 5 to 9 samples
    assert found.bytes == pytest.approx(counted.bytes)
    with pytest.raises(RunError, match="404 cells are too many to plan; at most 399 are counted; plan it with fewer"):
        plan(grid, 1)


PACE = Pace(np.array([10.0, 110.0, 1000.0]), np.array([1.0, 2.0, 4.0]), np.array([0.5, 1.5, 2.5]), 0.0)


@pytest.mark.parametrize(
    ("samples", "levels", "seconds"),
    [
        (10, 1, 1.5),  # as measured
        (60, 3, 1.5 + 3 * 1.0),  # halfway between two sizes
        (5, 2, 2.0),  # below the first a call costs what it costs
        (4000, 1, 4 * 6.5),  # beyond the last in proportion
    ],
)
def test_seconds(samples, levels, seconds):
    """A trial costs its draw and its levels, linear between the sizes."""
    assert math.isclose(PACE.of(samples, levels), seconds, rel_tol=1e-12)


def test_sizes_are_the_studys(make_text):
    """The study's own numbers of samples are measured, or seven of them, and every one takes time."""
    for samples, expected in (([10, 20, 300], [10, 20, 300]), (list(range(10, 210, 10)), 7)):
        study = parse(make_text({"estimators": ["gdke"]}, samples=samples))
        cells = [cell for unit in study.units() for batch in unit.parts(0) for cell in batch.cells]
        pace = measure(study, cells, 2)
        assert (len(pace.samples) == expected) if isinstance(expected, int) else (list(pace.samples) == expected)
        assert pace.samples[0] == samples[0]
        assert pace.samples[-1] == samples[-1]
        assert np.all(pace.draw > 0.0)
        assert np.all(pace.level > 0.0)


def test_the_first_measurement_does_not_count_alone(make_text, monkeypatch):
    """A first call of ten seconds, which loads compiled code, leaves the pace at the tenth of one of the others."""
    study = parse(make_text({"estimators": ["gdke"]}, samples=[10]))
    cells = [cell for unit in study.units() for batch in unit.parts(0) for cell in batch.cells]
    calls = [0.0]

    def slow_at_first(study, unit):
        calls.append(calls[-1] + (10.0 if len(calls) == 1 else 0.1))
        return compute(study, unit)

    monkeypatch.setattr(module, "compute", slow_at_first)
    monkeypatch.setattr(module, "perf_counter", lambda: calls[-1])
    pace = measure(study, cells, 1)
    assert pace.level[0] * study.design.trials_of(10) < 0.11
