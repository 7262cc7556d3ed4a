"""Provenance of a run: time, versions, machine, and the command that reproduces it."""

import shlex
from collections.abc import Callable

import numpy as np
import pandas as pd

from study.figures import style
from study.report import words
from study.report.blocks import Block, Content, Facts, Folded, InlineCode, Row, Table, Text, Verbatim
from study.report.material import Record
from study.runs.storage.manifest import plugins

_MANY_SAMPLES = 12
_STEPS = {
    "draw": "drawing directions and noise",
    "bound": "the Cramér-Rao bound",
    "points": "placing the points",
    "moments": "moments, shared by all estimators",
}


def times(record: Record) -> list[Block]:
    """Seconds of each step, and nanoseconds per sample, in all and by the number of samples."""
    frame = record.timings.assign(step=record.timings["step"].astype(str))
    frame = frame.assign(handled=frame["fits"] * frame["samples"])
    steps = list(dict.fromkeys(frame["step"]))
    rows = []
    for step, part in frame.groupby("step", sort=False):
        seconds = words.timed(float(part["seconds"].sum()))
        rows.append(Row([_step(str(step)), words.count(int(part["fits"].sum())), seconds, _per_sample(part)]))
    caption = (
        f"Seconds are of all workers together ({record.manifest.jobs}); the run took "
        f"{words.timed(record.manifest.seconds)} s by the clock, {words.timed(record.manifest.seconds_computing)} s of "
        "them computing. An estimator's time is without the moments."
    )
    head = ["Step", "Data sets", "Seconds", "ns per sample"]
    blocks: list[Block] = [Table(f"Time by step, {record.name}", caption, head, rows, numeric=frozenset({1, 2, 3}))]
    if frame["samples"].nunique() > 1:
        blocks.append(
            Folded("Nanoseconds per sample, by the number of samples", _by_samples(frame, steps, record.name))
        )
    return blocks


def _by_samples(frame: pd.DataFrame, steps: list[str], name: str) -> Table:
    """Table whose columns are numbers of samples, or their decades if there are many."""
    text: Callable[[int], str]
    if frame["samples"].nunique() > _MANY_SAMPLES:
        frame = frame.assign(level=np.floor(np.log10(frame["samples"]) + 1e-9).astype(int))
        caption, text = "By the decade of the number of samples N, from its lower end.", words.power_of_ten
    else:
        frame = frame.assign(level=frame["samples"])
        caption, text = "By the number of samples N.", words.count
    levels = sorted(set(frame["level"]))
    rows = []
    for step in steps:
        part = frame[frame["step"] == step]
        rows.append(Row([_step(step), *(_per_sample(part[part["level"] == level]) for level in levels)]))
    head = ["Step", *(text(int(level)) for level in levels)]
    numeric = frozenset(range(1, len(head)))
    return Table(f"Nanoseconds per sample, {name}", caption, head, rows, numeric=numeric)


def _per_sample(part: pd.DataFrame) -> str:
    handled = int(part["handled"].sum())
    return words.timed(1e9 * float(part["seconds"].sum()) / handled) if handled else "–"


def _step(name: str) -> str:
    return _STEPS.get(name, style.label(name))


def provenance(record: Record) -> list[Block]:
    """Facts on a run's origin, and the command that reproduces it."""
    manifest, folder = record.manifest, record.run.folder
    software, machine = manifest.software, manifest.machine
    commit: Content = "unknown: not run from a checkout"
    if software.commit:
        state = "with changes that were not committed" if software.dirty else "nothing uncommitted"
        commit = [InlineCode(software.commit), f", {state}"]
    packages = ", ".join(f"{name} {version}" for name, version in software.packages.items() if version)
    threads = ", ".join(f"{pool} {n}" for pool, n in machine.threads.items())
    facts: list[tuple[str, Content]] = [
        ("Version", f"sphere-fit-study {software.study}, Python {software.python}"),
        ("Commit", commit),
        ("Packages", packages),
        ("Machine", f"{machine.processor}, {machine.cores or 'unknown number of'} cores, {machine.system}"),
        ("Code generated for", software.code_generated_for),
        ("Threads of libraries", threads or "no limits"),
        ("Workers", str(manifest.jobs)),
        ("Started", words.moment(manifest.started)),
        ("Seed", str(record.run.study.seed)),
        ("Digest of the config", InlineCode(record.run.study.digest())),
        (f"SHA-256 of {record.main}.parquet", InlineCode(record.fingerprint)),
    ]
    command = ["study", "run", str(folder / "config.toml"), "--jobs", str(manifest.jobs), *plugins(record.run.own())]
    again = shlex.join(command)
    other = shlex.quote(f"{folder}-again")
    return [
        Facts(facts),
        Folded("The config, as it was given", Verbatim(record.config, f"Config of {record.name}")),
        Text("To run it again, into another folder; with the same versions the error table is equal to the byte:"),
        Verbatim(f"{again} --out {other}", f"Command that runs {record.name} again"),
        *([Text("The commit above does not hold all of the code that ran.")] if software.dirty else []),
    ]
