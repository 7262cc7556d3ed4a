"""Configs that tests write: TOML of plain values."""

import json


def toml(value):
    """A value as TOML; dictionaries become inline tables."""
    if isinstance(value, dict):
        words = ((key if key.isascii() and key.isidentifier() else toml(key), toml(v)) for key, v in value.items())
        return "{" + ", ".join(f"{key} = {v}" for key, v in words) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(toml, value)) + "]"
    return repr(value) if isinstance(value, float) else json.dumps(value, ensure_ascii=False)


def uniform(low, high):
    """A law of a random design."""
    return {"law": "uniform", "low": low, "high": high}


def log_uniform(low, high):
    """A law of a random design that is even in the logarithm."""
    return {"law": "log_uniform", "low": low, "high": high}


def config(top=None, **design):
    """A small grid, whose entries the arguments replace: those named go into the design, ``top`` has what stands above.

    None leaves an entry out; a section is an entry of ``top`` that is a dictionary.
    """
    head = {"name": "test", "seed": 1, "estimators": ["lls"]} | (top or {})
    noise = None if "noise_over_radius" in design else 0.1
    body = {"kind": "grid", "trials": 2, "samples": 10, "noise": noise, "angle": 90} | design
    lines = [f"{key} = {toml(value)}" for key, value in head.items() if value is not None]
    lines += ["[design]", *(f"{key} = {toml(value)}" for key, value in body.items() if value is not None)]
    return "\n".join(lines) + "\n"
