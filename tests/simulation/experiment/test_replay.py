"""A trial that is drawn again has the points, the bound and the fits of the run, to the last bit."""

import numpy as np
import pytest

import study
from study.fits import Status
from study.simulation.experiment import replay
from study.simulation.experiment.compute import compute, stack
from study.simulation.experiment.replay import ReplayError, all_trials, find
from tests.configs import log_uniform, uniform

KEPT = 3

GRID = {"trials": 5, "samples": [6, 40], "noise": [0.05, 0.5], "angle": [60, 180], "radius": 2.0, "center": 3.0}

RANDOM = {"kind": "random", "trials": 30, "samples": log_uniform(5, 60), "noise": log_uniform(1e-6, 2)}
RANDOM |= {"angle": uniform(0, 180), "radius": uniform(0, 37), "center": uniform(0, 2)}

DESIGNS = {"shared": GRID, "independent": GRID | {"draws": "independent"}, "random": RANDOM}

SHAPES = {2: [[4.0, 1.0], [1.0, 2.0]], 3: [[4.0, 1.0, 0.0], [1.0, 2.0, 0.5], [0.0, 0.5, 1.0]]}


@pytest.fixture(scope="module", params=list(DESIGNS))
def design(request):
    """Entries of a grid whose cells share draws, of one whose cells do not, and of a random design."""
    return DESIGNS[request.param]


@pytest.fixture(scope="module", params=["plain 2", "plain 3", "shaped 2", "shaped 3"])
def made(request, design, make_study):
    """A study of all estimators, and its error and point rows as a worker computes them, batch by batch."""
    kind, d = request.param.split()
    d = int(d)
    names = [n for n in study.ESTIMATORS if kind == "plain" or n != "hinge"]  # which takes no covariance
    top = {"dimension": d, "keep_points": KEPT, "estimators": names}
    with pytest.MonkeyPatch.context() as patch:  # several batches per cell
        patch.setattr("study.simulation.experiment.designs.BLOCK_TRIALS", 2)
        made = make_study(top | ({"noise_shape": SHAPES[d]} if kind == "shaped" else {}), **design)
        results = [compute(made, unit) for unit in made.units()]
        yield made, stack([r.errors for r in results]), stack([r.points for r in results if r.points])


def chosen(table, **values):
    """Rows of a table with these values."""
    use = np.ones(len(table["trial"]), dtype=bool)
    for name, value in values.items():
        use &= table[name] == value
    return {name: column[use] for name, column in table.items()}


def test_the_points_are_the_stored_ones(made):
    """Each stored trial of each cell has its stored points and true sphere, to the last bit, in the stored order."""
    made, _, points = made
    cells = dict.fromkeys(points["cell"])
    seen = 0
    for cell in cells:
        for trial in range(KEPT):
            kept = chosen(points, cell=cell, trial=trial)
            if not len(kept["trial"]):
                continue  # of a random design, where each cell has one trial
            again = find(made, cell, trial)
            frame = replay.points(again)
            names = [f"x_{i + 1}" for i in range(made.dimension)]
            assert list(frame.columns) == names
            np.testing.assert_array_equal(frame.to_numpy(), np.column_stack([kept[name] for name in names]))
            assert again.cell.center == tuple(kept[f"center_{i + 1}"][0] for i in range(made.dimension))
            assert (again.cell.name, again.cell.radius, again.trial) == (cell, kept["radius"][0], trial)
            seen += 1
    assert seen == (KEPT if made.design.kind == "random" else 8 * KEPT)


def test_the_answers_are_the_error_tables_rows(made):
    """Error, its part along the axis, radius error, noise, condition and steps are equal; the status is in words."""
    made, errors, _ = made
    texts = {status.text: int(status) for status in Status}
    for cell in list(dict.fromkeys(errors["cell"]))[::7]:
        for trial in np.unique(chosen(errors, cell=cell)["trial"])[-2:].tolist():
            again = find(made, cell, trial)
            found, told = replay.fit_table(made, again), chosen(errors, cell=cell, trial=trial)
            assert list(found["estimator"]) == list(told["estimator"]) == list(made.estimators)
            same = {"error": "error", "axis": "error_1", "radius_error": "radius_error", "condition": "condition"}
            for mine, theirs in (same | {"iterations": "iterations"}).items():
                np.testing.assert_array_equal(found[mine], told[theirs], err_msg=f"{mine} of {cell}, {trial}")
            np.testing.assert_array_equal(found["noise"], np.sqrt(told["noise_variance"]))
            assert [texts[text] for text in found["status"]] == list(told["status"])
            np.testing.assert_allclose(found["over_bound"], told["error"] / told["bound"], rtol=1e-14)
            variances = again.cell.noise**2 * np.diag(again.unit_bound)
            np.testing.assert_allclose(np.sqrt(variances[-1]), told["radius_bound"], rtol=1e-14)


def test_every_trial_is_listed(made):
    """The trials are the error table's cells and trials, in its order, each once; each is found by its name.

    Within a batch a cell's trials stand together, and cells come in the order of the error table.
    """
    made, errors, _ = made
    rows = chosen(errors, estimator="mle")
    found = list(all_trials(made))
    assert sorted((a.cell.name, a.trial) for a in found) == sorted(zip(rows["cell"], rows["trial"], strict=True))
    assert len({(a.cell.name, a.trial) for a in found}) == len(found)
    assert list(dict.fromkeys(a.cell.name for a in found)) == list(dict.fromkeys(errors["cell"]))
    for trial in found[::17]:
        assert find(made, trial.cell.name, trial.trial) == trial


def test_the_trials_of_a_cell_that_a_random_design_drew_several_times(make_study):
    """If choices repeat, a cell's trials have gaps; the message lists them without those of other cells."""
    made = make_study(kind="random", trials=30, noise={"law": "choice", "values": [0.1, 0.2]})
    trials = {}
    for trial in all_trials(made):
        trials.setdefault(trial.cell.name, []).append(trial.trial)
    assert len(trials) == 2
    for name, numbers in trials.items():
        assert all(find(made, name, trial).trial == trial for trial in numbers)
        other = next(t for t in range(min(numbers), max(numbers)) if t not in numbers)
        with pytest.raises(ReplayError, match=f"^trial {other}: cell {name} has trial {', '.join(map(str, numbers))}$"):
            find(made, name, other)


@pytest.mark.parametrize("d", [2, 3])
def test_what_is_printed(make_study, d):
    """A line of the trial, three of its truth, and a table of a line per estimator with the answers' digits."""
    made = make_study({"dimension": d, "estimators": ["mle", "lls", "ugdk"]}, center=6.0, radius=2.0, samples=5)
    trial = next(all_trials(made))
    lines = list(replay.printed(made, trial))
    assert lines[0] == f"{made.run_name()}, cell {trial.cell.name}, trial 0"
    assert lines[1] == "  N = 5, σ = 0.1 (0.05 r), φ = 90°"
    assert lines[2] == f"  true centre ({', '.join([f'{6.0 / d**0.5:.9g}'] * d)}), radius 2"
    errors = 0.1 * np.sqrt(np.diag(trial.unit_bound))
    whole = np.sqrt(np.sum(errors[:d] ** 2))
    told = f"  bound: {whole:.3g} for the centre ({errors[0]:.3g} along the axis), {errors[d]:.3g} for the radius"
    assert lines[3] == told
    assert lines[4].split()[:4] == ["estimator", "error", "over", "bound"]
    assert len(lines) == 8
    for line, row in zip(lines[5:], replay.fit_table(made, trial).to_dict("records"), strict=True):
        cells = line.split()
        numbers = [row[name] for name in ("error", "over_bound", "axis", "radius_error", "noise", "condition")]
        assert cells[0] == row["estimator"]
        assert cells[1:7] == [f"{value:.3g}" if np.isfinite(value) else "-" for value in numbers]
        assert cells[7] == str(row["iterations"] or "-")
        assert line.endswith(row["status"])


def test_robust_is_settled_without_its_outliers(make_study):
    """A fit of a replayed trial has the status and the interval that `study.fit` gives its points."""
    made = make_study({"estimators": ["robust", "mle"]}, noise=0.001, samples=40, angle=60, radius=1.0, trials=1)
    trial = next(all_trials(made))
    trial.samples.x[0, :, :4] *= 5.0
    for name, found in replay.fits(made, trial).items():
        if name != "truth":
            own = study.fit(trial.samples.points[0], name)
            assert found.status == own.status, name
            np.testing.assert_array_equal(found.interval("radius"), own.interval("radius"))
