"""The page: its sections and their order."""

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import pandas as pd
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from study.figures.failure import gathered
from study.report.blocks import Block, Folded, Items, Section, Text, coded
from study.report.claims import claims_section, tally
from study.report.explorer import explorer_section
from study.report.explorer.section import digests
from study.report.material import Material
from study.report.overview import overview_section
from study.report.posterior import posterior_section
from study.report.results import run_section
from study.report.speed import speed_section
from study.report.words import count
from study.runs.storage.atomic_write import RunError, write
from study.runs.storage.run_folder import Run


def figures_section(material: Material) -> Iterable[Section]:
    """Section of figures, each once, with the reasons for those that are missing."""
    content: list[Block] = list(material.pictures.values())
    if not content:
        content.append(Text("These runs can feed none of the figures."))
    if material.undrawn:
        runs = len(material.records)
        reasons = [f"{name}: {gathered(reasons, runs)}" for name, reasons in material.undrawn.items()]
        some = f"{len(reasons)} figure{'s' * (len(reasons) > 1)} not drawn, and why"
        content.append(Folded(some, Items(reasons)))
    yield Section("Figures", "figures", content)


def run_sections(material: Material) -> Iterable[Section]:
    """Sections of each run: results and provenance."""
    return (run_section(record) for record in material.records)


SECTIONS: list[Callable[[Material], Iterable[Section]]] = [
    claims_section,
    explorer_section,
    figures_section,
    posterior_section,
    speed_section,
    overview_section,
    run_sections,
]
"""The page, in order. Each entry gives one section, several, or none where the runs have nothing for it."""


def render(runs: Sequence[Run], claims: pd.DataFrame, bench: pd.DataFrame | None = None, jobs: int = 1) -> str:
    """Write the page about runs: one HTML document that needs no other file.

    Args:
        runs: finished runs, at least one, no two of the same name.
        claims: the claims table; columns as `study.runs.storage.schemas.CLAIMS`, perhaps without rows.
        bench: the table that `make bench` stores, if it is to be shown; see `study.report.speed`.
        jobs: number of processes; in the second one figures are drawn.

    Returns:
        The document. The same runs and claims give the same bytes.

    Raises:
        RunError: if a run did not finish, is given twice, or a table cannot be read.
    """
    material = Material.of(runs, claims, bench, jobs)
    sections = [section for make in SECTIONS for section in make(material)]
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent, encoding="utf-8"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters["coded"] = coded
    return environment.get_template("template.html").render(
        names=", ".join(record.name for record in material.records),
        sets=count(sum(record.trials for record in material.records)),
        findings=material.findings,
        tally=tally(claims) if len(claims) else None,
        lead=material.lead,
        sections=sections,
        digests=Markup(digests()),
    )


def save(page: str, path: Path) -> Path:
    """Write a page to a file, whole or not at all.

    Returns:
        The path.

    Raises:
        RunError: if it cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write(path, page.encode("utf-8", "replace"))  # a folder's name may hold bytes that are not text
    except OSError as error:
        raise RunError(f"{path}: cannot be written: {error.strerror or error}") from None
    return path
