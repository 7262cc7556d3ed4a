r"""Tables of the documents that are made from stored tables; see `tools/bound_numbers.py`.

A section ``[made.x]`` of `tools/numbers.toml` describes table x:

- ``table``, ``rows``, ``sort``: a stored table, the query and the order of its rows;
- ``cells``: for each column its title, and its cell with expressions of columns in braces and their formats. A title
  with a place of its own makes one column for each of its values; rows that are alike in the other cells are one row;
- ``words``: what the format ``word`` makes of a value, with places again if need be;
- ``more``: rows below.

In cells, ``{value ± error}`` rounds to the error, a format in parentheses makes nothing of 0, and what is not a number
is a dash. Tables that need more are functions here: each takes the stored tables by their names, and yields the titles
of the columns, then the cells of each row; a text is a paragraph below the table.
"""

import math
import re
import tomllib
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import pandas as pd

from study.simulation.claims.claim import OTHER_CAUSE
from study.simulation.claims.readings import Readings
from study.simulation.claims.readings import read as read_readings
from study.simulation.figures.fig_coverage import BAND

WORDS = ["none", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve"]
PLACE = re.compile(r"\{([^{}:]+)(?::([^{}]*))?\}")
BARE = re.compile(r"(?<![\w.\\])\.(?=\d)")
"""The point of a decimal that has no zero before it."""
Tables = Callable[[str], pd.DataFrame]
Rows = Iterator[list[str] | str]


def markdown(rows: Iterable[list[str] | str]) -> str:
    """Rows as a table of Markdown, the titles first, and paragraphs; decimals get their zeros, those of texts too."""
    lines: list[str] = []
    for row in rows:
        if isinstance(row, str):
            words = BARE.sub("0.", row)
            lines += ["", words] if lines else [words]
            continue
        lines.append("| " + " | ".join(re.sub(r"(?<!\\)\|", r"\\|", BARE.sub("0.", cell)) for cell in row) + " |")
        lines += ["| " + " | ".join(["---"] * len(row)) + " |"] * (len(lines) == 1)
    return "\n".join(lines)


def described(form: dict[str, object], tables: Tables) -> Rows:
    """The rows of a table from its description."""
    frame = tables(form["table"])
    frame = frame.query(form["rows"], engine="python") if "rows" in form else frame
    frame = frame.sort_values(form["sort"], kind="stable") if "sort" in form else frame
    words = form.get("words", {})
    columns = [[filled(text, frame, words) for text in column] for column in form["cells"].items()]
    alike = [cells for title, (_, cells) in zip(form["cells"], columns, strict=True) if not PLACE.search(title)]
    rows: dict[tuple[str, ...], dict[str, str]] = {}
    for place in range(len(frame)):
        row = rows.setdefault(tuple(cells[place] for cells in alike), {})
        row |= {titles[place]: cells[place] for titles, cells in columns}
    titles = list(dict.fromkeys(title for row in rows.values() for title in row))
    yield titles
    yield from ([row.get(title, "-") for title in titles] for row in rows.values())
    yield from form.get("more", [])


def filled(cell: str, frame: pd.DataFrame, words: dict[str, str]) -> list[str]:
    """A cell with its expressions evaluated, for each row of a table."""
    literals, columns = PLACE.split(cell)[::3], []
    for expression, spec in PLACE.findall(cell):
        values = zip(*(frame.eval(part, engine="python") for part in expression.split("±")), strict=True)
        if spec == "word":
            texts = [words.get(str(value), "-") for (value,) in values]
            columns.append([filled(text, frame.iloc[[place]], {})[0] for place, text in enumerate(texts)])
        else:
            columns.append([with_error(*value) if len(value) > 1 else formatted(*value, spec) for value in values])
    rows = zip(*columns, strict=True) if columns else [()] * len(frame)
    return ["".join(part for pair in zip(literals, [*row, ""], strict=True) for part in pair) for row in rows]


def formatted(value: float | str, spec: str) -> str:
    """A number as a text has it.

    Args:
        value: the number; a text is taken as it is.
        spec: Python's format, or ``w`` (a word), ``.0%`` or ``.0p``; in parentheses, with a unit if need be, for what
            is left out where it is 0.
    """
    if isinstance(value, str) or value != value:
        return value if isinstance(value, str) else "-"
    if spec.startswith("("):
        inner, _, unit = spec[1:-1].partition(" ")
        return f" ({formatted(value, inner)} {unit})" if value else ""
    if spec == "w":
        return WORDS[round(value)] if round(value) < len(WORDS) else str(round(value))
    if spec.endswith("p"):
        return format(100.0 * value, f"{spec[:-1]}f")
    if spec.endswith("d"):
        return format(round(value), spec)
    return format(value, spec).replace("%", " %")


def with_error(value: float, error: float) -> str:
    """A number with its Monte-Carlo error, to one digit of the error, or two if it begins with a one."""
    if value != value:
        return "-"
    place = math.floor(math.log10(error))
    digits = max(0, -place + (error < 2.0 * 10.0**place))
    return f"{value:.{digits}f} ± {error:.{digits}f}"


def findings(claims: pd.DataFrame) -> pd.DataFrame:
    """The numbers in the findings of claims.

    Args:
        claims: the table that `study claims` stores.

    Returns:
        A row for each number: ``claim`` (its name), ``verdict``, ``quantity``, ``value`` and ``error``.
    """
    rows = []
    for name, verdict, finding in claims[["name", "verdict", "finding"]].itertuples(index=False):
        for line in finding.splitlines():
            quantity, _, numbers = line.rpartition(": ")
            value, _, error = numbers.partition(" ± ")
            if re.fullmatch(r"[-\d.e+]+", value):
                rows.append((name, verdict, quantity, float(value), float(error or "nan")))
    return pd.DataFrame(rows, columns=["claim", "verdict", "quantity", "value", "error"])


def certified(sets: pd.DataFrame) -> pd.DataFrame:
    """Largest errors of the certified fits, of sets that double precision tells and of the others."""
    largest = {"sets": ("center", "size"), "center": ("center", "max"), "radius": ("radius", "max")}
    return sets.groupby(["estimator", "told"], sort=False).agg(**largest).reset_index()


def coverage_short(cells: pd.DataFrame) -> pd.DataFrame:
    """Coverage of the radius by each method: the least over all kinds of data; the mean and the least of ok fits."""
    least = cells.query("sigma <= .5").groupby("method", sort=False)["radius"].min()
    often = cells.query("ok >= .2 and sigma < .35").groupby("method")["radius_ok"].agg(["mean", "min"])
    return often.join(least).loc[["interval", "corrected", "als", "mle"]].reset_index()


def radial(readings: pd.DataFrame) -> pd.DataFrame:
    """The numbers in the findings of claims under radial noise, as `findings` has them."""
    rows = readings.query("choice == 'noise-law' and reading == 'radial'")
    return findings(rows.assign(name=rows["claim"], finding=rows["finding"].str.replace("; ", "\n")))


DERIVED = {"findings": findings, "radial": radial, "certified": certified, "coverage_short": coverage_short}
"""Tables that are made from a stored one when it is read, by their names in ``[tables]``."""


def share_of(claim: Any) -> str:
    """Share of a claim's conditions in which it holds, with an error of a thousandth or more; a dash for none."""
    if claim.value != claim.value:
        return "–"
    return f"{claim.value:.3f}" + (f" ± {claim.error:.3f}" if claim.error >= 0.0005 else "")


def claim_studies(tables: Tables) -> Rows:
    """For each claim its studies, their seconds, the share of its conditions in which it holds, and the verdict."""
    yield ["claim", "§", "studies", "seconds", "share that holds", "verdict"]
    seconds = tables("studies").set_index("study")["seconds"]
    for row in tables("verdicts").itertuples():
        needed = dict.fromkeys(part.split("/")[0] for part in row.reads.split(", "))
        studies = [name for name in needed if name in seconds] or ["paper"] * ("cost" in needed)
        took = f"{seconds[studies].sum():.0f}" if studies else "-"
        words = ", ".join([*studies, *(name for name in ("cost", "case-study") if name in needed)])
        share = share_of(row) if studies else "needs a recording"
        yield [f"{row.number} {row.name}", row.section, words, took, share, row.verdict]


def _readings(tables: Tables) -> Readings:
    return Readings(read_readings(Path(__file__).parents[1] / "configs" / "readings.toml"), tables("readings"))


def choices(tables: Tables) -> Rows:
    """What the paper leaves open, with the readings, the one that is used bold, and the claims that each changes."""
    yield ["§", "choice", "readings, the one used in bold", "why", "claims that change"]
    judged = _readings(tables)
    for choice in judged.choices:
        letters = {one.name: judged.letters[choice.name, one.name] for one in choice.reading}
        ways = [(one.name, f"**{one.words}**" if one.name == choice.used else one.words) for one in choice.reading]
        moved = judged.changed.query(f"choice == '{choice.name}'").groupby("reading", sort=False)["number"]
        changes = [f"{letters[name]}: {', '.join(map(str, part))}" for name, part in moved]
        words = "; ".join(f"{letters[name]} {way}" for name, way in ways)
        yield [choice.section, choice.issue, words, choice.why, "; ".join(changes) or "-"]


def readings(tables: Tables) -> Rows:
    """Verdicts on the claims under each reading; those that differ from the used one are bold."""
    verdicts = {
        "reproduced": "yes",
        "mostly": "mostly",
        "in part": "part",
        "not reproduced": "no",
        "not evaluated": "–",
    }
    short = {"": "·"} | verdicts | {f"{verdict}{OTHER_CAUSE}": words for verdict, words in verdicts.items()}
    judged = _readings(tables)
    yield ["claim", "used", *(judged.letters[key] for key in judged.others)]
    for row in tables("verdicts").itertuples():
        verdicts = [judged.verdict(row.name, *key) for key in judged.others]
        cells = [f"**{short[one]}**" if one and one != row.verdict else short[one] for one in verdicts]
        yield [f"{row.number} {row.name}", short[row.verdict], *cells]


def readings_changed(tables: Tables) -> Rows:
    """Verdicts that another reading changes, with the share of conditions behind each, and the claims that stand."""
    yield ["claim", "verdict", "reading", "share"]
    judged, numbers = _readings(tables), tables("verdicts").set_index("name")["number"]
    for row in judged.changed.itertuples():
        before, after = str(row.used), str(row.verdict)
        if before.endswith(OTHER_CAUSE) and after.endswith(OTHER_CAUSE):
            before, after = before.removesuffix(OTHER_CAUSE), after.removesuffix(OTHER_CAUSE)
        yield [f"{row.number} {row.claim}", f"{before} → {after}", judged.reading(row).clause, share_of(row)]
    stand = ", ".join(str(number) for number in sorted(numbers[name] for name in judged.standing))
    yield f"Under every reading stand {len(judged.standing)} verdicts: claims {stand}."


def coverage_summary(tables: Tables) -> Rows:
    """Coverage by each method over all cells."""
    cells = tables("coverage")
    for number, (name, part) in enumerate(cells.groupby("method", sort=False)):
        little, moderate = part[part["sigma"] < 0.2], part[part["sigma"] <= 0.5]
        often = part[(part["ok"] >= 0.2) & (part["sigma"] < 0.35)]
        clear = little[(little["kappa"] == 100.0) & (little["samples"] >= 40)]["width_attainable"]
        low, high = BAND
        row = {
            "method": "interval" if name == "interval" else f"{name} ± t s.e.",
            "σ < 0.2 r: mean": f"{little['radius'].mean():.3f}",
            f"within {low:.3g}-{high:.3g}": f"{100.0 * little['radius'].between(low, high).mean():.0f} %",
            "least": f"{little['radius'].min():.3f}",
            "σ ≤ 0.5 r: least": f"{moderate['radius'].min():.3f}",
            "centre: least": f"{moderate[['axis', 'across']].min(axis=None):.3f}",
            "ok fits: mean": f"{often['radius_ok'].mean():.3f}",
            "ok fits: least": f"{often['radius_ok'].min():.3f}",
            "width at κ=100, N ≥ 40": f"{clear.min():.2f}-{clear.max():.2f}",
        }
        if number == 0:
            yield list(row)
        yield list(row.values())


def speed(tables: Tables) -> Rows:
    """Ratios of the stored benchmarks, in the order of their description."""
    yield ["what", "beside", "ratio"]
    table, naive = tables("bench").set_index(["group", "what"])["ratio"], "as one would first write it in NumPy"
    text = Path(__file__).with_name("numbers.toml").read_text(encoding="utf-8")
    for what, beside, group, names, words in tomllib.loads(text)["made"]["speed"]["ratios"]:
        ratios = [table[group.format(name), naive if "{}" in group else name] for name in names]
        yield [what, beside, " / ".join(f"{r:.0f}" if r >= 10 else f"{r:.2g}" for r in ratios) + words]


def _ranking(table: pd.DataFrame, whole: str, kinds: dict[str, str]) -> Rows:
    """The methods that are given points alone, over all kinds of data and over each.

    Methods with the same numbers share a row; those that may be the best are bold.

    Args:
        table: the stored ranking.
        whole: name of the ranking over all kinds.
        kinds: titles, and the rankings that they are of.
    """
    yield ["method", "median", "root mean square", *kinds]
    points = table[table["given"] == "points"].set_index(["run", "estimator"])
    rows: dict[tuple[str, ...], list[str]] = {}
    for name in points.loc[whole].index:
        columns = [(whole, "median"), (whole, "rms"), *((run, "median") for run in kinds.values())]
        texts = []
        for run, loss in columns:
            row = points.loc[(run, name)]
            error = row[f"{loss}_error"] if run == whole else 0.0
            text = with_error(row[loss], error) if error > 0.0 else f"{row[loss]:.3g}"
            texts.append(f"**{text}**" if row[f"{loss}_best"] else text)
        rows.setdefault(tuple(texts), []).append(f"`{name}`")
    yield from ([", ".join(names), *cells] for cells, names in rows.items())


def benchmark(tables: Tables) -> Rows:
    """The ranking of circles by methods that are given points alone."""
    kinds = {"clutter": "clutter, circles", "near noise": "near noise, circles", "clean arc": "semicircle"}
    yield from _ranking(tables("benchmark"), "all, circles", kinds)


def benchmark_spheres(tables: Tables) -> Rows:
    """The ranking of spheres by methods that are given points alone."""
    kinds = {"clutter": "sphere-clutter", "near noise": "lesouple-spheres"}
    kinds |= {"clean sphere": "sphere-tumbling", "clean cap": "sphere-caps"}
    yield from _ranking(tables("benchmark"), "all, spheres", kinds)


def benchmark_published(tables: Tables) -> Rows:
    """How many published numbers of each method agree with those of our sets, by mechanism."""
    table = tables("benchmark_published")
    mechanisms = list(table["mechanism"].unique())
    yield ["method", *(f"`{name}`" for name in mechanisms), "largest difference in errors"]
    for method, part in table.groupby("method", sort=False):
        near = (part["deviation"].abs() <= 3.0).groupby(part["mechanism"])
        cells = [f"{near.sum()[name]} of {near.size()[name]}" if name in near.size() else "-" for name in mechanisms]
        yield [str(method), *cells, f"{part['deviation'].abs().max():.1f}"]
