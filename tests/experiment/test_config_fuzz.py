"""Any TOML at all: a study or a `ConfigError`, never anything else."""

import json
import math

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from study.experiment.config import ConfigError, Study, parse

KEYS = ["name", "seed", "dimension", "estimators", "noise_shape", "keep_points", "precision", "design"]
KEYS += ["kind", "trials", "samples", "noise", "noise_over_radius", "angle", "radius", "center", "draws"]
KEYS += ["law", "value", "values", "low", "high", "linspace", "logspace", "grid", "random", "uniform", "constant"]
KEYS += ["target", "relative_target", "measure", "first", "seconds"]
WORDS = ["grid", "random", "uniform", "log_uniform", "choice", "constant", "shared", "lls", "mle", "test", "", "a.b"]

texts = st.sampled_from(WORDS) | st.text(st.characters(codec="utf-8", exclude_categories=["C"]), max_size=5)
numbers = (
    st.integers(-5, 2000)
    | st.sampled_from([0, 3, 4, 90, 180, 10**8, -(10**30), 10**308, 10**400])
    | st.floats()
    | st.sampled_from([0.0, -0.0, 0.1, 4.5, 180.0, 1e-320, 1e308, math.inf, math.nan])
)
values = st.recursive(
    numbers | texts | st.booleans(),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(st.sampled_from(KEYS) | texts, inner, max_size=4)
        | st.fixed_dictionaries({"law": texts}, optional=dict.fromkeys(("low", "high", "value", "values"), inner))
        | st.fixed_dictionaries({}, optional={k: st.lists(numbers, max_size=4) for k in ("linspace", "logspace")})
    ),
    max_leaves=6,
)


def toml(value):
    """A value as TOML; dictionaries become inline tables."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(k, ensure_ascii=False)} = {toml(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml, value)) + "]"
    return repr(value) if isinstance(value, float) else json.dumps(value, ensure_ascii=False)


def outcome(data):
    """Parse a dictionary written as TOML; what is no study is a message of several parts."""
    text = "\n".join(f"{json.dumps(key, ensure_ascii=False)} = {toml(value)}" for key, value in data.items())
    try:
        study = parse(text, "x.toml")
    except ConfigError as error:
        assert str(error).startswith("x.toml: ")  # noqa: PT017
        return None
    assert isinstance(study, Study)
    assert Study.model_validate_json(study.model_dump_json()).digest() == study.digest()
    return study


@settings(max_examples=150, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
@given(st.dictionaries(st.sampled_from(KEYS) | texts, values, max_size=8))
def test_arbitrary_toml(data):
    """Any small document is a study or a fault."""
    outcome(data)


@settings(max_examples=400, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
@given(
    kind=st.sampled_from(["grid", "random"]),
    head=st.dictionaries(st.sampled_from(KEYS[:7]) | texts, values, max_size=2),
    body=st.dictionaries(st.sampled_from(KEYS[8:17]) | texts, numbers | values, max_size=2),
)
def test_almost_right(kind, head, body):
    """A good config with up to four keys replaced by anything is a study or a fault."""
    design = {"kind": kind, "trials": 2, "samples": 10, "noise": 0.1, "angle": 90.0}
    good = {"name": "test", "seed": 1, "dimension": 3, "estimators": ["lls"]}
    assert outcome(good | {"design": design}) is not None
    outcome(good | head | {"design": design | body})
