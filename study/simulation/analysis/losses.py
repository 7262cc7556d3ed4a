"""Losses that methods are ranked by: those of a run, of any table of errors, or of a run beside the archive.

A table of errors is a CSV or Parquet file with a row per mechanism, cell, trial and method. The archive is a folder of
such tables, one for each mechanism of the benchmark, with its config in the metadata of the file; SHA256SUMS beside
them has their digests. A new method is run alone, and joins the others of a mechanism cell by cell. In each cell an
estimator that both have proves that the sets of points are the same: its errors are equal in all trials.
"""

import json
import re
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from study.arrays import Floats
from study.files import RunError, of_file, regular
from study.fits import registry
from study.simulation.analysis.error_table import Grouped
from study.simulation.analysis.regret import check_comparable, each_cell
from study.simulation.experiment.config import parse, shipped_configs
from study.simulation.experiment.measures import jaccard_index
from study.simulation.runs import runner
from study.simulation.runs.run_folder import Run
from study.text import listed
from study.toml import toml_tables

WORDS: dict[str, str] = {
    "center": "error of the centre",
    "radius": "error of the radius",
    "disc": "1 - Jaccard index of the fitted and the true disc",
}
"""The errors that estimators may be ranked by, besides the numbers of a study's measures."""
GIVEN: dict[str, str] = {"points": "points alone", "noise": "given the noise", "law": "given bounds or laws"}
"""What methods are given, in words."""
ARCHIVE = "archive"
"""Name of the archive that comes with the source."""
SUMS = "SHA256SUMS"
REFERENCE = "taubin"
"""Estimator that is run beside a new method: every mechanism of the archive has it, and it takes a microsecond."""
_NEEDED = {"mechanism": str, "cell": str, "trial": int, "method": str, "error": float}
_SAME = 1e-6
"""Largest relative difference of errors on the same points, which machines round differently."""


@dataclass(frozen=True)
class Losses:
    """The losses of a mechanism's methods.

    Attributes:
        name: of the mechanism.
        methods: their names.
        parts: cell, trial, estimator and error, which is the loss of a fit; in parts of whole cells.
        draws: name of the random signs; equal for the same sets of points.
        dimension: 2 for circles, 3 for spheres, 0 if it is not known.
        kind: of the data, such as clutter; empty if it is not known.
        given: what a method is given, a key of `GIVEN`, by method; empty if it is not known.
        seconds: per fit, by method.
    """

    name: str
    methods: Sequence[str]
    parts: Iterable[pd.DataFrame]
    draws: str = ""
    dimension: int = 0
    kind: str = ""
    given: Mapping[str, str] = field(default_factory=dict)
    seconds: Mapping[str, float] = field(default_factory=dict)


def disc_loss(distance: Floats, radius: Floats, true_radius: Floats) -> Floats:
    """One less the area of the intersection of two discs over that of their union; infinite without a radius.

    Args:
        distance: of the centres.
        radius: of the fitted disc, not a number or infinite where there is none.
        true_radius: of the true disc.
    """
    a, r, s = np.asarray(distance, dtype=float), np.asarray(radius, dtype=float), np.asarray(true_radius, dtype=float)
    known = np.isfinite(a) & np.isfinite(r) & (r > 0.0)
    a, r = np.where(known, a, 0.0), np.where(known, r, s)
    return np.where(known, 1.0 - jaccard_index(a, r, s, 2), np.inf)


def rankings(run: Run) -> list[str]:
    """Losses by which a run's estimators may be ranked: errors, and columns of numbers of the study's measures."""
    return [*WORDS, *(column.name for column in run.study.measured() if column.kind is float)]


def _columns(by: str) -> list[str]:
    """Columns of an error table that a loss is made of."""
    return ["error", "radius_error", "radius"] if by in WORDS else [by]


def _with_loss(errors: pd.DataFrame, by: str) -> pd.DataFrame:
    """An error table whose ``error`` is the loss of each row."""
    if by == "center" or by not in WORDS:
        values = errors["error" if by == "center" else by].to_numpy(dtype=float)
    else:
        away, radius = errors["radius_error"].to_numpy(dtype=float), errors["radius"].to_numpy(dtype=float)
        values = np.abs(away) if by == "radius" else disc_loss(errors["error"].to_numpy(float), radius + away, radius)
    if np.any(values < 0.0):
        least, words = int(np.nanargmin(values)), "losses are 0 or more, and the least is the best"
        raise RunError(f"{by} = {values[least]:g} in cell {errors['cell'].iloc[least]}: {words}")
    return errors.assign(error=values)


def of_run(run: Run, by: str = "center") -> Losses:
    """The losses of a finished run.

    Raises:
        RunError: if the run is not a grid of several estimators with its errors, or not of circles for discs, or a
            measure is negative.
        ValueError: if errors cannot be ranked by that.
    """
    if by not in (known := rankings(run)):
        raise ValueError(f"by = {by!r}: errors are ranked by {', '.join(map(repr, known))}")
    check_comparable(run, "a ranking")
    study = run.study
    if by == "disc" and study.dimension != 2:
        raise RunError(f"{run.folder}: dimension = {study.dimension}: discs are of circles; rank by center or radius")
    parts = (_with_loss(part, by) for part in Grouped(run).cells(["cell", "trial", "estimator", *_columns(by)]))
    timings = run.table("timings", ["step", "fits", "seconds"]).astype({"step": str})
    seconds = (timings["seconds"] / timings["fits"]).groupby(timings["step"]).median()  # one may have waited
    draws = f"{study.name}-{study.seed}"
    of_method = {str(step): float(value) for step, value in seconds.items()}
    return Losses(study.run_name(), study.estimators, parts, draws, study.dimension, seconds=of_method)


class Table:
    """The errors of a mechanism's methods from a file.

    Attributes:
        name: of the mechanism.
        rows: cell, trial, estimator and error, and the columns that the file has besides.
        config: text of the mechanism's config; empty if it is not known.
        place: the file.
        methods, dimension, kind, draws, given, seconds: see `Losses`.
        seed: of the config.
    """

    def __init__(self, name: str, rows: pd.DataFrame, config: str, place: Path) -> None:
        self.name, self.rows, self.config, self.place = name, rows, config, place
        self.methods = [*dict.fromkeys(rows["estimator"])]
        firsts = rows.drop_duplicates("estimator")
        columns = {name: firsts[name] if name in rows else () for name in ("given", "seconds")}
        self.given: dict[str, str] = dict(zip(self.methods, columns["given"], strict=False))
        self.seconds: dict[str, float] = dict(zip(self.methods, columns["seconds"], strict=False))
        self.dimension = int(rows["dimension"].iloc[0]) if "dimension" in rows else 0
        self.kind = str(rows["kind"].iloc[0]) if "kind" in rows else ""
        entries = toml_tables(config, name) if config else {}
        self.draws = f"{entries['name']}-{entries['seed']}" if config else name
        self.seed = entries.get("seed")

    def losses(self, by: str = "center", own: Run | None = None) -> Losses:
        """The losses of the methods, and of those of a run that are new.

        Args:
            by: column of the loss, or one of `WORDS`.
            own: a run of the same sets of points.

        Raises:
            RunError: if the file has not the columns, or the run has no new method or other sets of points.
        """
        if missing := [name for name in _columns(by) if name not in self.rows and (name == by or by != "center")]:
            raise RunError(f"{self.place}: no column {listed(missing)}, of which `--by {by}` is made")
        if by == "disc" and self.dimension == 3:
            raise RunError(f"{self.place}: dimension = 3: discs are of circles; rank by center or radius")
        parts, methods, given, seconds = [self.rows], self.methods, self.given, self.seconds
        if own is not None:
            mine = of_run(own, by)
            new = self._new(own)
            parts, methods = list(self._joined(own, new, _columns(by))), [*methods, *new]
            given = given | {name: registry.ESTIMATORS[name].needs or "points" for name in new}
            seconds = seconds | {name: mine.seconds[name] for name in new}
        losses = (_with_loss(part, by) for part in parts)
        return Losses(self.name, methods, losses, self.draws, self.dimension, self.kind, given, seconds)

    def _new(self, run: Run) -> list[str]:
        """Estimators of a run that the table has not."""
        new = [name for name in run.study.estimators if name not in self.methods]
        if len(new) == len(run.study.estimators):
            words = (
                "none of its estimators is in the archive; its config must name one, such as taubin, whose errors show"
            )
            raise RunError(f"{run.folder}: {words} that the sets of points are the same")
        if not new:
            raise RunError(f"{run.folder}: the archive has {listed(run.study.estimators)}; give yours another name")
        return new

    def _joined(self, run: Run, new: Sequence[str], columns: Sequence[str]) -> Iterator[pd.DataFrame]:
        """The rows of each cell with those of a run's new methods; a RunError unless all have the same points."""
        cells = dict(iter(self.rows.groupby("cell", sort=False)))
        wanted, count = ["cell", "trial", "estimator", *dict.fromkeys(["error", *columns])], 0
        for cell, part in each_cell(Grouped(run).cells(wanted)):
            fault = f"the archive has no such cell of {self.name}"
            if cell in cells:
                theirs = cells[cell]
                mine = part[part["trial"].isin(theirs["trial"])].astype({"estimator": str})
                fault = self._other_points(run, mine, theirs)
            if fault:
                raise RunError(f"{run.folder}: cell {cell} is not ranked beside the archive: {fault}")
            count += 1
            yield pd.concat([theirs[theirs["trial"].isin(mine["trial"])], mine[mine["estimator"].isin(new)]])
        if count < len(cells):
            raise RunError(f"{run.folder}: {count} cells, the archive has {len(cells)} of {self.name}; run all of them")

    def _other_points(self, run: Run, mine: pd.DataFrame, theirs: pd.DataFrame) -> str:
        """The reason why a cell of a run has other sets of points than the archive; empty if they are the same."""
        shared = [name for name in run.study.estimators if name in self.methods]
        for name in shared:
            both = [part[part["estimator"] == name].set_index("trial")["error"] for part in (mine, theirs)]
            one, other = both[0].to_numpy(), both[1].reindex(both[0].index).to_numpy()
            if np.isfinite(one).any() and np.allclose(one, other, rtol=_SAME, atol=0.0, equal_nan=True):
                return ""
        if run.study.seed != self.seed:
            return f"seed = {run.study.seed}, there {self.seed}"
        return f"errors of {listed(shared)} are others there: another law, or version of it or of them"


def read_tables(path: Path) -> list[Table]:
    """The mechanisms of a table of errors, or of a folder of them.

    Args:
        path: a .csv or .parquet file, or a folder of .parquet files; `ARCHIVE` is the one that the source has.

    Raises:
        RunError: if it is not there, is damaged, or is no table of errors.
    """
    if path == Path(ARCHIVE) and not path.exists():
        path = Path(str(resources.files("study"))).parent / "benchmarks" / ARCHIVE
        if not path.is_dir():
            raise RunError("archive: an installed package has none; give the folder benchmarks/archive of the source")
    files = sorted(path.glob("*.parquet")) if path.is_dir() else [path]
    if not files:
        raise RunError(f"{path}: has no .parquet file, so it is no archive")
    return [table for file in files for table in _read(file)]


def _read(path: Path) -> Iterator[Table]:
    """The mechanisms of a file."""
    sums = path.with_name(SUMS)
    known = dict(line.split()[::-1] for line in sums.read_text().splitlines()) if sums.is_file() else {}
    if path.name in known and of_file(path) != known[path.name]:
        raise RunError(f"{path}: damaged: its SHA-256 is not the one in {SUMS}; take it from the source again")
    config = ""
    try:
        if path.suffix == ".parquet":
            stored = pq.read_table(regular(path))
            config = (stored.schema.metadata or {}).get(b"config", b"").decode()
            rows = stored.to_pandas()
        else:
            rows = pd.read_csv(regular(path), dtype={name: str for name, kind in _NEEDED.items() if kind is str})
    except (OSError, UnicodeDecodeError, pa.ArrowException, ValueError) as error:
        words = " ".join(str(getattr(error, "strerror", None) or error).split())
        raise RunError(f"{path}: cannot be read: {words}; give a table of errors, .csv or .parquet") from None
    if missing := [name for name in _NEEDED if name not in rows]:
        raise RunError(f"{path}: no table of errors: has no column {listed(missing)}; it needs {', '.join(_NEEDED)}")
    try:
        rows = rows.astype(_NEEDED).rename(columns={"method": "estimator"})
    except (ValueError, TypeError) as error:
        raise RunError(f"{path}: {error}: trials are whole numbers, and errors numbers") from None
    key = ["mechanism", "cell", "trial", "estimator"]
    if (twice := rows.duplicated(key)).any():
        raise RunError(f"{path}: {', '.join(map(str, rows.loc[twice, key].iloc[0]))}: given twice")
    yield from (Table(str(name), part, config, path) for name, part in rows.groupby("mechanism", sort=False))


def beside(run: Run, tables: Sequence[Table], by: str = "center") -> Losses:
    """The losses of a run's new methods beside those of the mechanism of an archive that has its cells.

    Raises:
        RunError: if none has them, or see `Table.losses`.
    """
    cells = {cell.name for group in run.study.groups() for cell in group.cells}
    best = max(tables, key=lambda table: len(cells.intersection(table.rows["cell"])))
    return best.losses(by, run)


def entered(
    file: Path, tables: Sequence[Table], results: Path, say: Callable[[str], None]
) -> Iterator[tuple[Table, Run]]:
    """Run the methods of a file in every mechanism of an archive.

    Args:
        file: registers the methods.
        tables: the archive's.
        results: folder of the runs; what is there already is not computed again.
        say: called with a line for each mechanism.

    Yields:
        A mechanism, and the run of the methods that can fit its points, beside `REFERENCE`.
    """
    for config in list(shipped_configs().values())[:1]:
        registry.load(config.parent / "benchmark" / "laws.py")
    names = registry.load(file)
    for table in tables:
        faults = {name: registry.faults_of(name).get(table.dimension) for name in names}
        for name in filter(faults.get, names):
            say(f"{table.name}: without {name}, which fails there: {faults[name]}")
        if able := [name for name in names if not faults[name]]:
            chosen = f"estimators = {json.dumps([REFERENCE, *able])}"
            text = re.sub(r"^estimators = \[[^]]*\]", chosen, table.config, flags=re.MULTILINE)
            study = parse(text, table.name)
            begun = time.monotonic()
            run = runner.run(study, text, results / study.run_name(), warn=say)
            say(f"{table.name}: {time.monotonic() - begun:.1f} s")
            yield table, run
