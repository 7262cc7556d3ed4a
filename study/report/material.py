"""Content of the page: each run's tables, read once, and the figures that they can feed."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import pandas as pd
from pydantic import BaseModel, ValidationError

from study.analysis.worst import worst_of_run
from study.figures import KeptPictures, Tables
from study.report.blocks import Picture
from study.report.drawing import artist
from study.report.findings import Headline, findings
from study.report.pictures import Gallery
from study.runs.storage.run_folder import Run, RunError


class Software(BaseModel):
    """Versions and commit, as in `study.runs.provenance.software`."""

    study: str
    commit: str | None
    dirty: bool
    python: str
    packages: dict[str, str | None]
    code_generated_for: str


class Machine(BaseModel):
    """Machine, as in `study.runs.provenance.machine`."""

    system: str
    processor: str
    cores: int | None
    threads: dict[str, int]


class Manifest(BaseModel):
    """Fields of a run's manifest that the page shows."""

    started: str
    seconds_computing: float
    seconds: float
    jobs: int
    software: Software
    machine: Machine

    @classmethod
    def of(cls, run: Run) -> Self:
        """Read a run's manifest.

        Raises:
            RunError: if it is not there, because the run did not finish, or is of another version.
        """
        try:
            return cls.model_validate(run.manifest())
        except ValidationError as error:
            first = error.errors()[0]
            where = ".".join(map(str, first["loc"]))
            path = run.folder / "manifest.json"
            fault = f"{path}: not a manifest of this version: {where}: {first['msg']}"
            raise RunError(f"{fault}; remove it, and {run.again()} writes it again") from None


@dataclass(frozen=True)
class Record:
    """One run's tables and facts for the page.

    Attributes:
        run: the folder; what else is stored in it can be read from there.
        name: its name.
        manifest: what ran on what.
        config: the config, as it was given.
        estimators: names, in the config's order.
        trials, samples: data sets of all cells, and the points in them.
        summary, timings: the stored tables.
        worst: the worst trials; see `study.analysis.worst`. None where the study kept its summary alone.
        worst_of_groups: the worst trial of each group of the summary and estimator, likewise.
        main: name of the table that the study kept: errors, or else summary.
        fingerprint: SHA-256 of that table's file, which equal runs have in common.
    """

    run: Run
    name: str
    manifest: Manifest
    config: str
    estimators: list[str]
    trials: int
    samples: int
    summary: pd.DataFrame
    timings: pd.DataFrame
    worst: pd.DataFrame | None
    worst_of_groups: pd.DataFrame | None
    main: str
    fingerprint: str

    @classmethod
    def of(cls, run: Run, tables: Tables) -> Self:
        """Read what else is stored of a run whose tables are loaded.

        Raises:
            RunError: if something is missing.
        """
        one = tables.summary[tables.summary["estimator"] == tables.estimators[0]]
        samples = int((one["planned"] * one["samples"]).sum())
        if tables.design == "random" and "errors" in tables.stored:  # a row of the summary has many numbers of samples
            samples = int(tables.some_errors(["samples"], tables.estimators[:1])["samples"].sum())
        main, found = run.study.keep, worst_of_run(run) if "errors" in tables.stored else None
        return cls(
            run=run,
            name=tables.name,
            manifest=Manifest.of(run),
            config=(run.folder / "config.toml").read_text(encoding="utf-8"),
            estimators=tables.estimators,
            trials=int(one["planned"].sum()),
            samples=samples,
            summary=tables.summary,
            timings=run.table("timings"),
            worst=None if found is None else found.trials,
            worst_of_groups=None if found is None else found.of_groups,
            main=main,
            fingerprint=run.fingerprint(main) or "",
        )


@dataclass(frozen=True)
class Material:
    """Input of all sections.

    Attributes:
        records: the runs, in the order given.
        claims: the claims table; columns as `study.runs.storage.schemas.CLAIMS`, perhaps without rows.
        pictures: each figure that some run can feed, by name.
        undrawn: for each other figure the runs' reasons, by the run's name.
        lead: the picture at the top of the page, if some run can feed it.
        findings: the findings at the top of the page.
        bench: the table that `make bench` stores, if it is given.
    """

    records: list[Record]
    claims: pd.DataFrame
    pictures: dict[str, Picture]
    undrawn: dict[str, dict[str, str]]
    lead: Picture | None
    findings: list[Headline]
    bench: pd.DataFrame | None = None

    @classmethod
    def of(cls, runs: Sequence[Run], claims: pd.DataFrame, bench: pd.DataFrame | None = None, jobs: int = 1) -> Self:
        """Read runs, one after the other, so that no two error tables are in memory together.

        With two jobs, and runs, figures are drawn in a second process meanwhile.

        Raises:
            RunError: if a run did not finish, or is given twice.
        """
        records: list[Record] = []
        with artist(min(jobs, len(runs))) as drawn_by:
            gallery = Gallery(drawn_by)
            for run in runs:
                tables = Tables.of(run)
                if tables.name in {record.name for record in records}:
                    raise RunError(f"{run.folder}: {tables.name} is given twice")
                gallery.add(tables, KeptPictures(run))
                records.append(Record.of(run, tables))
            found = findings(claims, gallery.efficiency)
            pictures, lead = gallery.finish()
        return cls(records, claims, pictures, gallery.undrawn, lead, found, bench)
