"""Verification of a run: every table by its digest, and a share of its numbers by computing them again."""

from collections.abc import Iterator
from dataclasses import dataclass

from threadpoolctl import threadpool_limits

from study.analysis.verification.derived import recompute_chains, recompute_summary
from study.analysis.verification.units import Recomputed, recompute_units
from study.runs.provenance import other_version
from study.runs.storage import schemas
from study.runs.storage.atomic_write import RunError
from study.runs.storage.run_folder import Run
from study.text.columns import columns

DIGEST_ONLY = {
    "timings": "measured times cannot be computed again",
    "precision": "written while trials were added; the numbers of trials are checked with the errors",
    "claims": "depends on all the runs that `study claims` was given",
}


@dataclass(frozen=True)
class Verification:
    """The result of verifying a run.

    Attributes:
        run: the run.
        digests: for each table, its fault in words, or None if its digest and its columns are right.
        counts: numbers of the manifest that are not those of the config and the tables, in words.
        again: for each table of which something was computed again, the result.
        remark: warning about the software; None if it is this one.
    """

    run: Run
    digests: dict[str, str | None]
    counts: list[str]
    again: dict[str, Recomputed]
    remark: str | None

    @property
    def faults(self) -> list[str]:
        """Everything that is wrong, a line each."""
        found = [fault for fault in self.digests.values() if fault] + self.counts
        for name, result in self.again.items():
            found += [f"{self.run.path(name)}: {fault}" for fault in result.faults]
        return found


def verify(run: Run, share: float = 0.01) -> Verification:
    """Check all tables of a finished run by their digests, and compute a share of its numbers again.

    The units, rows of the summary and chains that are computed again follow from the digest of the manifest.

    Args:
        run: the run.
        share: of all units, rows and chains, in [0, 1]; at least one of each, unless it is 0.

    Raises:
        RunError: if the run is not finished, or its manifest is damaged.
    """
    manifest = run.manifest()
    if run.study.keep not in manifest["tables"]:
        raise RunError(f"{run.folder}: not finished, so there is nothing to verify; {run.again()} finishes it")
    declared = schemas.declared(run.study.dimension, run.study.conditions())
    stored = [name for name in declared if run.has(name) or name in manifest["tables"]]
    digests = {name: _fault(run, name) for name in stored}
    good = [name for name, fault in digests.items() if fault is None]
    seed = str(manifest["digest"])
    again: dict[str, Recomputed] = {}
    if share > 0.0:
        with threadpool_limits(limits=1):
            again |= recompute_units(run, good, seed, share) if _countable(run, good) else {}
            if {"errors", "summary"} <= set(good):
                again["summary"] = recompute_summary(run, seed, share)
            again |= recompute_chains(run, good, seed, share)
    return Verification(run, digests, _wrong_counts(run, good), again, other_version(run.maker()))


def _fault(run: Run, name: str) -> str | None:
    try:
        if not run.has(name):
            return f"{run.path(name)}: missing; {run.again(name)} makes it again"
        run.check(name)
    except RunError as error:
        return str(error)
    return None


def _wrong_counts(run: Run, good: list[str]) -> list[str]:
    """Compare the manifest's numbers with the config and the table of failures, unless that is damaged."""
    manifest, counts = run.manifest(), {"cells": run.study.cells()}
    if "failures" in good or not (run.has("failures") or "failures" in manifest["tables"]):
        causes = run.arrow("failures")["cause"].to_pylist() if "failures" in good else []
        counts |= {"failures": len(causes), "lost": causes.count("worker")}
    path = run.folder / "manifest.json"
    wrong = [name for name, count in counts.items() if manifest[name] != count]
    return [f"{path}: {name} = {manifest[name]:,}, where the tables have {counts[name]:,}" for name in wrong]


def _countable(run: Run, good: list[str]) -> bool:
    """True if the trials of each cell are known: an adaptive run has them in its precision table."""
    return run.study.precision is None or "precision" in good


def printed(found: Verification) -> Iterator[str]:
    """A verification for a terminal: a line for each table, the faults, and the verdict."""
    run = found.run
    yield f"{run.folder}: {run.study.run_name()}"
    rows = []
    for name, fault in found.digests.items():
        result = found.again.get(name)
        words = DIGEST_ONLY.get(name, "")
        if result is not None:
            count = f"{result.done:,} of {result.total:,} {result.unit} computed again"
            words = f"{count}: {'different' if result.faults else 'equal to the bit' if result.done else 'none'}"
        rows.append([name, "SHA-256 as written" if fault is None else "damaged", words])
    yield from columns(rows, indent=2)
    if found.remark is not None:
        yield f"  {found.remark}"
    for fault in found.faults[:10]:
        yield f"  {fault}"
    if found.faults:
        count = f"{len(found.faults):,} faults" if len(found.faults) > 1 else "1 fault"
        odd = [run.path(name).name for name, result in found.again.items() if result.faults]
        odd += ["manifest.json"] * bool(found.counts)
        remedy = f"; remove {', '.join(odd)}, and {run.again()} makes it again" if odd else ""
        yield f"not verified: {count}{remedy}"
    elif not any(result.done for result in found.again.values()):
        yield f"not verified: {len(found.digests):,} tables are as written, but nothing was computed again"
    else:
        done = [f"{r.done:,} of {r.total:,} {r.unit}" for r in found.again.values() if r.done]
        equal = ", ".join(dict.fromkeys(done))
        yield f"verified: {len(found.digests):,} tables are as written; {equal}, computed again, are equal to the bit"
