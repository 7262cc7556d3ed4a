"""First section of the page: the runs and the machines."""

from collections.abc import Iterable

from study.report import words
from study.report.blocks import InlineCode, Link, Note, Row, Section, Table, coded
from study.report.material import Material, Record

_HEAD = ["Run", "Design", "Estimators", "Trials", "Samples", "Seed", "Computed on", "Seconds", "Workers"]


def overview_section(material: Material) -> Iterable[Section]:
    """A row per run."""
    caption = "Trials are data sets, over all cells; samples are the points in them, each fitted by every estimator."
    rows = [_row(record) for record in material.records]
    table = Table("The runs", caption, _HEAD, rows, numeric=frozenset({3, 4, 5, 7, 8}), stacked=True)
    yield Section("What was run", "runs", [table])


def run_id(record: Record) -> str:
    """Anchor of a run's section."""
    return f"run-{record.name}"


def _row(record: Record) -> Row:
    study, manifest = record.run.study, record.manifest
    machine = manifest.machine
    cores = f", {machine.cores}\u00a0cores" if machine.cores else ""
    law = "" if study.noise_law.isotropic else f"; {study.noise_law.words}"
    return Row(
        [
            [Link(record.name, run_id(record)), Note(["of the config ", InlineCode(study.name)])],
            f"{words.dimension(study)}; {words.design(study)}{law}",
            coded(", ".join(map(words.estimator, record.estimators))),
            words.count(record.trials),
            words.count(record.samples) if record.samples < 1_000_000 else words.number(record.samples),
            str(study.seed),
            [f"{machine.processor}{cores}", Note(words.moment(manifest.started))],
            words.timed(manifest.seconds),
            str(manifest.jobs),
        ]
    )
