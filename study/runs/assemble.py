"""Assembly of tables: the stored rows of each unit, however it was cut, in the order of the tables."""

from collections.abc import Iterable, Iterator

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from study.experiment.config import Study
from study.experiment.designs.groups import Span
from study.runs.jobs import POINTS, Jobs, estimators_of
from study.runs.layout import Layout
from study.runs.storage import schemas
from study.runs.storage.atomic_write import RunError
from study.runs.storage.parts import Parts
from study.sphere.types import Ints


def rows(study: Study, parts: Parts, layout: Layout, name: str) -> Iterator[pa.Table]:
    """Read a table's rows, unit by unit.

    Args:
        study: the config.
        parts: the stored rows.
        layout: the units, and how each is cut.
        name: the table: errors, points, failures, timings or summary.

    Raises:
        RunError: if rows are missing.
    """
    jobs = Jobs(study)
    if not parts.holds(name):
        return
    for span in layout.units():
        found: list[pa.Table] = []
        first: tuple[str, ...] = ()
        datasets = 0
        for piece in layout.cut(span):
            datasets += piece.rows
            for outputs, table in stored_rows(jobs, parts, piece, name):
                first = first or outputs
                found.append(table)
        expected = {"errors": datasets, "summary": len(span.group.cells)}.get(name, 0) * len(study.estimators)
        if expected and sum(table.num_rows for table in found) != expected:
            raise RunError(f"{parts.folder}: rows of trials {span.first} to {span.last - 1} are missing; run again")
        whole = len(found) == 1 and (name == "points" or estimators_of(first) == study.estimators)
        if whole or (found and name == "timings"):
            yield from found
        elif found:
            table = pa.concat_tables(found)
            yield table.take(order(study.estimators, span, table))


def stored_rows(jobs: Jobs, parts: Parts, piece: Span, name: str) -> Iterator[tuple[tuple[str, ...], pa.Table]]:
    """Read the stored rows of a piece, without those of outputs that the study does not have.

    Rows that were taken from another study's run have its columns. They get those of this one: a condition that it did
    not give is at its default, and one that this study does not give is left out.

    Args:
        jobs: the study's.
        parts: the stored rows.
        piece: of a unit.
        name: the table.

    Yields:
        Outputs, and their rows.
    """
    job, study = jobs.job(piece), jobs.study
    columns = schemas.of_units(study.dimension, study.conditions())[name]
    for outputs, fresh, table in parts.tables(job.key, name):
        wanted = tuple(output for output in fresh if output in job.outputs)
        if not wanted or (name == "points" and not any(o.startswith(POINTS) for o in wanted)):
            continue
        if wanted != outputs and name in ("errors", "failures", "summary"):
            table = table.filter(pc.is_in(_words(table, "estimator"), pa.array(estimators_of(wanted))))
        yield wanted, schemas.completed(table, columns)


def order(estimators: tuple[str, ...], span: Span, table: pa.Table) -> Ints:
    """The order of a unit's rows in the table.

    Args:
        estimators: their names, in the order of the config.
        span: the unit.
        table: its rows, of errors, failures, points or summary, in any order.
    """
    if "group" in table.schema.names:  # a summary, of the cells of a grid
        cells = _places(table, "group", [cell.name for cell in span.group.cells])
        return np.lexsort([_places(table, "estimator", estimators), cells])
    trial = table["trial"].to_numpy()
    keys = [trial]
    if "estimator" in table.schema.names:
        keys.append(_places(table, "estimator", estimators))
    if span.group.cells:
        keys.append(_places(table, "cell", [cell.name for cell in span.group.cells]))
    return np.lexsort([*keys, trial // span.group.size])  # the last counts most


def _places(table: pa.Table, column: str, words: Iterable[str]) -> Ints:
    """Place of each row's word among others."""
    return np.asarray(pc.index_in(_words(table, column), pa.array(list(words))).to_numpy())


def _words(table: pa.Table, column: str) -> pa.ChunkedArray:
    """A column of words, without its dictionary."""
    return table[column].cast(pa.string())
