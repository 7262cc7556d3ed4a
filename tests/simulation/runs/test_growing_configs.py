"""A config that is changed line by line and run again and again: every run has the bytes of one from nothing."""

import contextlib

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from study.simulation.experiment.conditions import SILENT
from study.simulation.experiment.config import Study, parse
from study.simulation.experiment.designs import GridDesign, RandomDesign
from study.simulation.runs import runner
from study.toml import ConfigError
from tests.configs import log_uniform, uniform

pytestmark = pytest.mark.usefixtures("same_software", "small_units", "raises")

SEQUENCES = 20
"""Number of sequences, of which `make test` tries a quarter; 250 of them, drawn anew, take some two minutes."""
SHAPE = [[4.0, 1.0, 0.0], [1.0, 2.0, 0.5], [0.0, 0.5, 1.0]]
TOP = {
    "name": ["test", "other"],
    "seed": [1, 2],
    "dimension": [None, 2],
    "estimators": [["mle", "lls"], ["lls", "mle"], ["lls", "ugdk", "mle"], ["lls"], ["raises", "mle"]],
    "noise_shape": [None, SHAPE],
    "keep_points": [None, 2, 5],
    "tolerate_failures": [None, 1.0],
    "route": [None, "moments"],
    "keep": [None, "summary"],
    "measures": [None, ["interval"], ["jaccard", "own_errors"]],
    "posterior": [None, {"where": {"samples": 6}, "trials": 1}],
    "precision": [None, {"relative_target": 0.9, "first": 100}],
}
GRID = {
    "kind": ["grid"],
    "trials": [6, 3, 7, 13],
    "samples": [[6, 40], [40, 6], [6, 20, 40], [6]],
    "noise": [[0.05, 0.5], [0.5, 0.05], [0.01, 0.05, 0.5], [0.5], None],
    "noise_over_radius": [None, [0.05, 0.5], [0.5, 0.1, 0.05]],
    "kappa": [None, [30.0, 100.0], [300.0, 100.0]],
    "most_noise": [None, 0.3],
    "angle": [[60], [60, 90], [90, 45, 60]],
    "radius": [None, [1.0], [1.0, 2.0], [10.0, 1.0]],
    "center": [None, [0.0, 3.0], [3.0]],
    "draws": [None, "independent"],
    "most_samples": [None, 200],
}
RANDOM = {
    "kind": ["random"],
    "trials": [30, 12, 55],
    "samples": [{"law": "choice", "values": [6, 40]}, {"law": "choice", "values": [40, 6]}],
    "noise": [log_uniform(0.01, 1), {"law": "constant", "value": 0.1}, None],
    "noise_over_radius": [None, {"law": "constant", "value": 0.1}],
    "angle": [uniform(20, 180), {"law": "constant", "value": 60}],
    "radius": [None, {"law": "choice", "values": [1.0, 10.0]}],
    "center": [None, {"law": "constant", "value": 3.0}],
}
NUMBERS = (0.1, 0.5, 3.0, 5.0)
WORDS = {
    "law": ("laplace", "student(5)", "radial"),
    "directions": ("polar", "spaced", "path"),
    "outlier_law": ("along_radius(5, 20)", "any_direction(3)", "along_radius(1, 2)"),
    "coordinates": ("rounded(0.1)", "rounded(0.5)", "rounded(2)"),
}


def values_of(condition):
    """Three values that a condition may have besides its default."""
    allowed = [v for v in WORDS.get(condition.name, NUMBERS) if v != condition.default and condition.allowed(v)]
    return allowed[0], allowed[len(allowed) // 2], allowed[-1]


for silent in SILENT:
    default, (one, two, three) = silent.default, values_of(silent)
    if silent.axis:
        GRID[silent.name] = [None, [default, two], [three, two, default], [one]]
    if silent.law and silent.kind is str:
        RANDOM[silent.name] = [None, three]
    elif silent.law:
        constants = [{"law": "constant", "value": value} for value in (default, one)]
        RANDOM[silent.name] = [None, {"law": "choice", "values": [default, two]}, *constants]
TOGETHER = {"noise": "noise_over_radius", "noise_over_radius": "noise"}
"""Keys of which a config has one: the other is left out where one is given, and the reverse."""


def edits(design):
    """Edits of a config: one to three keys and their new values, and true for a run that is interrupted once."""
    keys = [*TOP, *(key for key, values in design.items() if len(values) > 1)]
    keys += [condition.name for condition in SILENT if condition.name in design] * 2
    one = st.sampled_from(keys).flatmap(lambda key: st.tuples(st.just(key), st.sampled_from((TOP | design)[key])))
    return st.tuples(st.lists(one, min_size=1, max_size=3), st.booleans())


def edited(config, changes):
    """The config after changes of some keys."""
    config = dict(config)
    for key, value in changes:
        config[key] = value
        if key in TOGETHER:
            other = TOGETHER[key]
            config[other] = config["_either"] if value is None else None
    return config


def tables(run):
    """Bytes of all tables but the times, and what the manifest says of them."""
    said = {key: run.manifest()[key] for key in ("run", "cells", "fits", "failures", "lost", "estimators")}
    stored = {path.name: path.read_bytes() for path in run.folder.glob("*.parquet") if path.stem != "timings"}
    return said | stored


def test_every_key_is_edited():
    """The values above are of every key that a config knows."""
    assert set(TOP) | {"design"} == set(Study.model_fields)
    assert set(GRID) == set(GridDesign.model_fields)
    assert set(RANDOM) == set(RandomDesign.model_fields)


@pytest.mark.parametrize("design", [GRID, RANDOM], ids=["grid", "random"])
def test_any_sequence_of_edits(make_text, tmp_path_factory, part_of, design):
    """After any edits, interrupted or not, a run has the bytes of the same config in an empty folder.

    Each config runs beside the runs of the earlier ones; edits whose entries do not go together are left out.
    """
    known = {}  # tables of runs from nothing, by the digest of the config

    def tables_of(made, text, folder, **options):
        return tables(runner.run(made, text, folder / made.run_name(), 1, warn=str, **options))

    @settings(
        max_examples=part_of(SEQUENCES),
        derandomize=True,
        deadline=None,
        database=None,
        suppress_health_check=HealthCheck,
    )
    @given(st.lists(edits(design), min_size=2, max_size=6))
    def try_sequence(steps):
        config = {key: values[0] for key, values in (TOP | design).items()} | {"_either": design["noise"][0]}
        folder = tmp_path_factory.mktemp("runs")
        for changes, stopped in [((), False), *steps]:
            changed = edited(config, changes)
            text = make_text({key: changed[key] for key in TOP}, **{key: changed[key] for key in design})
            try:
                made = parse(text)
            except ConfigError:
                assert changes
                continue
            config = changed
            if stopped:  # as soon as the first fits are done
                with contextlib.suppress(ZeroDivisionError):
                    tables_of(made, text, folder, progress=lambda *numbers: 1 / 0)
            grown = tables_of(made, text, folder)
            if made.digest() not in known:
                known[made.digest()] = tables_of(made, text, tmp_path_factory.mktemp("runs"))
            assert grown == known[made.digest()], text

    try_sequence()
