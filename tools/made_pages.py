"""Parts of the documents that are made from the package: tables of config keys, conditions, estimators, figures, names.

`tools/run_blocks.py` puts what a function here yields between the marks of that name, and fails if it is out of date.
Like those of `tools/number_tables.py`, functions yield rows and paragraphs.
"""

import inspect
import json
import math
import re
import sys
from functools import cache, partial
from pathlib import Path
from typing import Any, get_args

import griffe
from number_tables import Rows
from pydantic import BaseModel

import study
from study.fits.points.samples import Status
from study.fits.registry import ESTIMATORS
from study.simulation.experiment.conditions import CONDITIONS, Choice, Constant, LogUniform, Uniform
from study.simulation.experiment.config import (
    ChainStatus,
    Posterior,
    Precision,
    Study,
    parse,
    shipped_configs,
    summary_line,
)
from study.simulation.experiment.designs import GridDesign, RandomDesign
from study.simulation.experiment.measures import MEASURES as FIT_MEASURES
from study.simulation.figures import FIGURES
from study.simulation.runs import schemas
from study.text import paragraphs

MEDIAN_VARIANCES = (0.316, 1.36)
"""n times the squared relative error of a median of n trials, for |z| of a normal z in three dimensions and in one."""
OWN_READERS = ("readings",)
"""Configs that are no studies."""


def config_laws() -> Rows:
    """The laws that a random design draws conditions from."""
    yield ["law", "a number drawn"]
    for law in (Constant, Choice, Uniform, LogUniform):
        (kind,) = get_args(law.model_fields["law"].annotation)
        written = ", ".join([f'law = "{kind}"', *(f"{key} = …" for key in law.model_fields if key != "law")])
        yield [f"`{{ {written} }}`", paragraphs(law)[0]]


def studies() -> Rows:
    """The shipped studies: conditions, trials, and the Monte-Carlo error of a median of so many trials."""
    yield ["study", "question", "conditions", "trials of each", "error of a median, %"]
    for name, path in shipped_configs().items():
        if name in OWN_READERS:
            continue
        config = parse(path.read_text(encoding="utf-8"))
        random = config.design.kind == "random"
        sizes = [(1 if random else group.width, config.trials_of(group)) for group in config.groups()]
        least, most = min(count for _, count in sizes), max(count for _, count in sizes)
        trials = f"{least:,}" + (f" to {most:,}" if least < most else "")
        cells = "drawn in each trial" if random else f"{sum(width for width, _ in sizes):,}"
        errors = " to ".join(f"{100.0 * math.sqrt(variance / least):.1f}" for variance in MEDIAN_VARIANCES)
        link, words = f"[`{name}`](../configs/{name}.toml)", summary_line(path).removesuffix(".")
        yield [link, words, cells, trials, errors]


def conditions() -> Rows:
    """The conditions of an experiment."""
    yield ["key", "symbol", "meaning", "values", "default", "design"]
    for name, one in CONDITIONS.items():
        default = "required" if one.default is None else f"`{one.default}`"
        default = f"this or `{one.alternative}`" if one.alternative else default
        where = "grid" if not one.law else "random" if not one.axis else "both"
        yield [f"`{name}`", one.symbol, one.in_full or one.meaning, one.must_be, default, where]


def estimators() -> Rows:
    """The shipped estimators."""
    yield ["name", "what it is, or its source", "needs", "FLOPs per sample, 3-D"]
    for name, entry in ESTIMATORS.items():
        flops = f"{entry.flops(3):g} {entry.flops_of}".strip() if entry.flops else "-"
        yield [f"`{name}`", entry.reference, "the noise" if entry.needs else "-", flops]


def fit_measures() -> Rows:
    """The shipped measures of fits with their columns."""
    yield ["measure", "column", "type", "meaning"]
    for name, measure in FIT_MEASURES.items():
        for column, (kind, meaning) in measure.columns.items():
            words = "truth value" if kind is bool else "number"
            yield [f"`{name}`", f"`{name}_{column}`", words, meaning.format("i")]


def statuses() -> Rows:
    """The statuses of a fit."""
    yield ["number", "status", "text"]
    yield from ([str(int(status)), f"`{status.name}`", status.text] for status in Status)


_WORDS = {"double": "number", "string": "text", "dictionary<values=string, indices=int32, ordered=0>": "text, coded"}
"""Words for types of columns; those of whole numbers are as they are, such as int64."""
_SHARED = [
    (r"(\d+ = .*?; )+\d+ = .*", "[status code](#status-codes)"),
    (r"^fits with the status: .*", "fits with this status"),
    (r"^Monte-Carlo standard error of (\w+)$", r"\1"),
    (r", of all fits(?: as computed, whatever their status; one without a number counts as infinite"
     r"|, with those that are not ok counted as infinite)$", ""),
    (r", of the estimator's own ok fits, so not of the same trials as another's$", ""),
    (r",? of (?:the centre's component \d|the radius|σ(?:; not a number where it is known)?)$", ""),
    (r"\b(component|coordinate) \d\b(?! with)", r"\1 1, 2, 3"),
    (r"^[\d.]+ % quantile less", "quantile (q025: 2.5 %) less"),
]  # fmt: skip
"""What makes one meaning of those of several columns, which differ by a component, a status or a kind of fits."""


def _columns(name: str) -> Rows:
    """The columns of a table of spheres, without conditions that have a column only where a config gives them.

    Columns that mean the same, of several things, are one row; a measure's Monte-Carlo error stands beside the measure.
    """
    yield ["columns", "type", "unit", "meaning"]
    rows: dict[tuple[str, ...], list[str]] = {}
    place: dict[str, tuple[str, ...]] = {}
    for column in schemas.declared(3)[name]:
        kind, meaning = _WORDS.get(str(column.type), str(column.type)), column.meaning
        for pattern, shared in _SHARED:
            meaning = re.sub(pattern, shared, meaning)
        row = place.get(meaning, (kind, column.unit, meaning))
        if column.name in CONDITIONS and name != "draws":  # there, noise is a draw
            row = ("number", "", "[conditions](config.md#conditions)")
        place[column.name] = row
        rows.setdefault(row, []).append(f"`{column.name}`")
    yield from ([", ".join(names), *row] for row, names in rows.items())


table_errors, table_summary = partial(_columns, "errors"), partial(_columns, "summary")
table_failures, table_timings = partial(_columns, "failures"), partial(_columns, "timings")
table_points, table_precision = partial(_columns, "points"), partial(_columns, "precision")
table_posterior, table_answers = partial(_columns, "posterior"), partial(_columns, "answers")
table_draws, table_claims = partial(_columns, "draws"), partial(_columns, "claims")
"""The columns of each table."""


def chain_statuses() -> Rows:
    """The statuses of a chain."""
    yield ["number", "status", "text"]
    yield from ([str(int(status)), f"`{status.name}`", status.text] for status in ChainStatus)


def figures() -> Rows:
    """A section for each figure: its picture, its title and what to look at; its module says the rest."""
    for name, module in FIGURES.items():
        title, *_, advice = inspect.cleandoc(module.__doc__ or "").split("\n\n")
        first = " ".join(re.split(r"(?<=[.:])\s+(?=[A-Z])", advice)[:2])  # two sentences; the report has them all
        yield f"## {name}\n\n![{name}](../figures/{name}.png)\n\n**{title}**\n\n{first}"


def names() -> Rows:
    """The public names of the package, each with the beginning of its docstring."""
    yield ["name", ""]
    for name in sorted(set(study.__all__) - {"__version__"}, key=study.__all__.index):
        words = paragraphs(getattr(study, name))[0]
        yield [
            f"`study.{name}`",
            re.split(r"[,:;.](?: |$)(?![^(]*\))| to each | as `| and their | of one's own", words)[0],
        ]


def _keys(model: type[BaseModel], without: set[str] = frozenset()) -> Rows:  # type: ignore[assignment]
    """The keys of a section of a config: type, limits and default of the schema, meaning of the docstrings."""
    yield ["key", "meaning", "values", "default"]
    described = _described(model)
    for key, entry in model.model_json_schema()["properties"].items():
        if key not in without:
            default = f"`{json.dumps(entry['default'])}`" if entry.get("default") not in (None, []) else "-"
            default = "required" if model.model_fields[key].is_required() else default
            yield [f"`{key}`", described.get(key, ""), _allowed(entry), default]


def _allowed(entry: dict[str, Any]) -> str:
    """The values of a key in words, from its entry in the JSON schema."""
    if "anyOf" in entry:
        return " or ".join(_allowed(part) for part in entry["anyOf"] if part.get("type") != "null")
    if "const" in entry or "enum" in entry:
        return ", ".join(f'`"{value}"`' for value in entry.get("enum", [entry.get("const")]))
    if entry.get("type") == "array":
        return f"list of {_allowed(entry['items'])}" if entry.get("items") else "list"
    words = {"integer": "whole number", "number": "number", "string": "text", "object": "table"}
    signs = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<"}
    limits = ", ".join(f"{sign} {entry[key]:g}" for key, sign in signs.items() if key in entry)
    return f"{words.get(entry.get('type', ''), 'any')} {limits}".strip()


@cache
def _parsed(module: str) -> griffe.Module:
    """The source of a module (griffe's `load` would read the whole package)."""
    path = Path(sys.modules[module].__file__ or "")
    return griffe.visit(module, path, path.read_text(encoding="utf-8"))


def _described(model: type[BaseModel]) -> dict[str, str]:
    """Meanings of the fields of a model, from docstrings below them or the list of attributes."""
    meanings: dict[str, str] = {}
    for kind in reversed(model.__mro__):
        if kind.__module__.startswith("study.") and "create_model" not in kind.__qualname__:
            try:
                source = _parsed(kind.__module__)[kind.__qualname__]
            except KeyError:  # a model that is made from the table of conditions
                continue
            for section in source.docstring.parse("google") if source.docstring else []:
                if section.kind.value == "attributes":
                    meanings |= {field.name: field.description for field in section.value}
            meanings |= {name: field.docstring.value for name, field in source.attributes.items() if field.docstring}
    return {name: " ".join(text.split()) for name, text in meanings.items()}


config_study = partial(_keys, Study, {"design", "posterior", "precision"})
"""The keys at the top of a config."""
config_grid, config_random = (partial(_keys, design, set(CONDITIONS)) for design in (GridDesign, RandomDesign))
"""The keys of a design besides its conditions."""
config_precision, config_posterior = partial(_keys, Precision), partial(_keys, Posterior)
"""The keys of the other sections."""
