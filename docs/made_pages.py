"""Parts of the documents that are made from the package: tables of config keys, conditions, estimators, figures, names.

`docs/run_blocks.py` puts what a function here returns between the marks of that name, and fails if it is out of date.
"""

import inspect
import json
import math
import re
from typing import Any, get_args

import griffe
from pydantic import BaseModel

import study
from study.fits.samples import Status
from study.simulation.experiment.conditions import CONDITIONS, Choice, Constant, LogUniform, Uniform
from study.simulation.experiment.config import Posterior, Precision, Study, parse, shipped_configs, summary_line
from study.simulation.experiment.designs import GridDesign, RandomDesign
from study.simulation.experiment.sampling import groups, trials_of
from study.simulation.figures import FIGURES
from study.simulation.statistics import MEASURES

MEDIAN_VARIANCES = (0.316, 1.36)
"""n times the squared relative error of a median of n trials, for |z| of a normal z in three dimensions and in one."""
OWN_READERS = ("coverage", "readings")
"""Configs that are no studies."""


def config_study() -> str:
    """The keys at the top of a config."""
    return _keys(Study, {"design", "posterior", "precision"})


def config_grid() -> str:
    """The keys of a grid besides its conditions."""
    return _keys(GridDesign, set(CONDITIONS))


def config_random() -> str:
    """The keys of a random design besides its conditions."""
    return _keys(RandomDesign, set(CONDITIONS))


def config_precision() -> str:
    """The keys of ``[precision]``."""
    return _keys(Precision)


def config_posterior() -> str:
    """The keys of ``[posterior]``."""
    return _keys(Posterior)


def config_laws() -> str:
    """The laws that a random design draws conditions from."""
    rows = []
    for law in (Constant, Choice, Uniform, LogUniform):
        (kind,) = get_args(law.model_fields["law"].annotation)
        written = ", ".join([f'law = "{kind}"', *(f"{key} = …" for key in law.model_fields if key != "law")])
        rows.append([f"`{{ {written} }}`", _first(law)])
    return _table(["law", "a number drawn"], rows)


def studies() -> str:
    """The shipped studies: conditions, trials, fits, and the Monte-Carlo error of a median of so many trials."""
    rows = []
    for name, path in shipped_configs().items():
        if name in OWN_READERS:
            continue
        config = parse(path.read_text(encoding="utf-8"))
        random = config.design.kind == "random"
        sizes = [(1 if random else group.width, trials_of(config, group)) for group in groups(config)]
        trials = [count for _, count in sizes]
        each = f"{min(trials):,}" + (f" to {max(trials):,}" if min(trials) < max(trials) else "")
        fits = len(config.estimators) * sum(width * count for width, count in sizes)
        cells = "drawn in each trial" if random else f"{sum(width for width, _ in sizes):,}"
        errors = [f"{100.0 * math.sqrt(variance / min(trials)):.1f}" for variance in MEDIAN_VARIANCES]
        link, words = f"[`{name}`](../configs/{name}.toml)", summary_line(path).removesuffix(".")
        rows.append([link, words, cells, each, f"{fits:,}", " to ".join(errors)])
    return _table(["study", "question", "conditions", "trials of each", "fits", "error of a median, %"], rows)


def conditions() -> str:
    """The conditions of an experiment."""
    rows = []
    for name, each in CONDITIONS.items():
        default = "required" if each.default is None else f"`{each.default}`"
        default = f"this or `{each.alternative}`" if each.alternative else default
        where = "grid" if not each.law else "random" if not each.axis else "both"
        rows.append([f"`{name}`", each.symbol, each.in_full or each.meaning, each.rule, default, where])
    return _table(["key", "symbol", "meaning", "values", "default", "design"], rows)


def estimators() -> str:
    """The shipped estimators."""
    shipped = inspect.getmodule(study.fit).ESTIMATORS  # type: ignore[union-attr]
    rows = []
    for name, entry in shipped.items():
        flops = f"{entry.flops(3):g} {entry.flops_of}".strip() if entry.flops else "-"
        rows.append([f"`{name}`", entry.reference, "the noise" if entry.needs else "-", flops])
    return _table(["name", "what it is, or its source", "needs", "FLOPs per sample, 3-D"], rows)


def statuses() -> str:
    """The statuses of a fit."""
    return _table(["number", "status", "text"], [[str(int(s)), f"`{s.name}`", s.text] for s in Status])


def measures() -> str:
    """The performance measures of the summary table."""
    return _table(["column", "meaning"], [[f"`{name}`", measure.meaning] for name, measure in MEASURES.items()])


def figures() -> str:
    """A section for each figure: its picture and the text of its module."""
    parts = []
    for name, module in FIGURES.items():
        title, _, text = inspect.cleandoc(module.__doc__ or "").partition("\n\n")
        parts.append(f"## {name}\n\n![{title}](../figures/{name}.png)\n\n**{title}**\n\n{text}")
    return "\n\n".join(parts)


def names() -> str:
    """The public names of the package, each with the first sentence of its docstring."""
    package = griffe.load("study", resolve_aliases=True)
    rows = []
    for name in study.__all__:
        if not name.startswith("_"):
            found = package[name]
            found = found.final_target if found.is_alias else found
            words = found.docstring.value.split("\n")[0] if found.docstring else "Every estimator by its name."
            rows.append([f"`study.{name}`", words])
    return _table(["name", ""], rows)


def _first(thing: Any) -> str:
    return (inspect.getdoc(thing) or "").split("\n")[0]


def _keys(model: type[BaseModel], without: set[str] = frozenset()) -> str:  # type: ignore[assignment]
    """The keys of a section of a config: type, limits and default of the schema, meaning of the docstrings."""
    described = _described(model)
    rows = []
    for key, entry in model.model_json_schema()["properties"].items():
        if key not in without:
            default = f"`{json.dumps(entry['default'])}`" if entry.get("default") not in (None, []) else "-"
            default = "required" if model.model_fields[key].is_required() else default
            rows.append([f"`{key}`", described.get(key, ""), _allowed(entry), default])
    return _table(["key", "meaning", "values", "default"], rows)


def _allowed(entry: dict[str, Any]) -> str:
    """The values of a key in words, from its entry in the JSON schema."""
    if "anyOf" in entry:
        return " or ".join(_allowed(each) for each in entry["anyOf"] if each.get("type") != "null")
    if "const" in entry or "enum" in entry:
        return ", ".join(f'`"{each}"`' for each in entry.get("enum", [entry.get("const")]))
    if entry.get("type") == "array":
        inner = entry.get("items", {})
        return f"list of {_allowed(inner)}" if inner else "list"
    words = {"integer": "whole number", "number": "number", "string": "text", "object": "table"}
    limits = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<"}
    found = [f"{sign} {entry[key]:g}" for key, sign in limits.items() if key in entry]
    return " ".join([words.get(entry.get("type", ""), "any"), ", ".join(found)]).strip()


def _described(model: type[BaseModel]) -> dict[str, str]:
    """Meanings of the fields of a model, from docstrings below them or the list of attributes."""
    found: dict[str, str] = {}
    for kind in reversed(model.__mro__):
        if kind.__module__.startswith("study.") and "create_model" not in kind.__qualname__:
            try:
                source = griffe.load(kind.__module__)[kind.__qualname__]
            except KeyError:  # a model that is made from the table of conditions
                continue
            for section in source.docstring.parse("google") if source.docstring else []:
                if section.kind.value == "attributes":
                    found |= {each.name: each.description for each in section.value}
            for name, each in source.attributes.items():
                if each.docstring:
                    found[name] = each.docstring.value
    return {name: " ".join(text.split()) for name, text in found.items()}


def _table(head: list[str], rows: list[list[str]]) -> str:
    def line(cells: list[str]) -> str:
        return "| " + " | ".join(re.sub(r"(?<!\\)\|", r"\\|", cell) for cell in cells) + " |"

    return "\n".join([line(head), line(["---"] * len(head)), *map(line, rows)])
