"""Tables of the documents that are made from stored tables; see `docs/bound_numbers.py`.

Each function takes the stored tables by their names in `docs/numbers.toml`. It yields the titles of the columns, then
the cells of each row; a text is a paragraph below the table.
"""

import math
import re
import tomllib
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import pandas as pd

from study.simulation import coverage
from study.simulation.claims.readings import Readings
from study.simulation.claims.readings import read as read_readings

MANY_POINTS = 10_000
"""From here on false alarms were measured in a few cells only."""
DECADES = {-13: "10⁻¹³", -9: "10⁻⁹", -5: "10⁻⁵", -3: "10⁻³", -2: "10⁻²", -1: "10⁻¹", 0: "1", 2: "100"}
"""Decades of noise that are shown, by their exponents."""
Tables = Callable[[str], pd.DataFrame]
Rows = Iterator[list[str] | str]

TITLES = tomllib.loads(Path(__file__).with_name("numbers.toml").read_text(encoding="utf-8"))["titles"]
"""For each table the words of its rows."""
PLAIN = ["mle", "corrected", "als", "taubin", "gdke"]
"""Least-squares estimators; `lls` is `gdke`."""


def markdown(rows: Iterable[list[str] | str]) -> str:
    """Rows as a table of Markdown, the titles first, and paragraphs."""
    lines: list[str] = []
    for row in rows:
        if isinstance(row, str):
            lines += ["", row] if lines else [row]
            continue
        lines.append("| " + " | ".join(re.sub(r"(?<!\\)\|", r"\\|", cell) for cell in row) + " |")
        lines += ["| " + " | ".join(["---"] * len(row)) + " |"] * (len(lines) == 1)
    return "\n".join(lines)


def regret(tables: Tables) -> Rows:
    """Regret of the estimators over all cells in space, the least median first."""
    yield ["estimator", "median error", "95 % quantile", "take it"]
    whole = tables("regret").query("samples == 0 and estimator in @TITLES['regret']")
    for row in whole.sort_values("median", kind="stable").itertuples():
        take = TITLES["regret"][row.estimator].format(worst=row.median_worst)
        pairs = ((row.median, row.median_error), (row.q95, row.q95_error))
        yield [f"`{row.estimator}`", *(f"{value:.3f} ± {_short(error, 3)}" for value, error in pairs), take]
    yield ["`robust`", "-", "-", "with outliers: least trimmed squares, then `mle` of the rest"]


def certify(tables: Tables) -> Rows:
    """Largest errors of the certified fits, of sets that double precision tells and of the others."""
    yield ["fit", "sets", "centre", "radius", "µm on a sphere of 100 mm"]
    for (name, told), part in tables("certify").groupby(["estimator", "told"], sort=False):
        center, radius = part["center"].max(), part["radius"].max()
        numbers = [str(len(part)), f"{center:.1e}", f"{radius:.1e}", f"{5e4 * max(center, radius):.0e}"]
        yield [f"`{name}`, {'told' if told else 'not told'}", *numbers]


def claim_commands(tables: Tables) -> Rows:
    """For each claim the command that judges it, the seconds of its studies, and the number to expect."""
    yield ["", "§", "quantity", "commands", "seconds", "expected", "verdict"]
    seconds = tables("studies").set_index("study")["seconds"]
    for row in tables("verdicts").itertuples():
        needed = dict.fromkeys(part.split("/")[0] for part in row.reads.split(", "))
        cost = "cost" in needed
        studies = [name for name in needed if name in seconds] or ["paper"] * cost
        commands, took = ["study claims RUN --recording DIR"], "-"
        if studies:
            claims = ["study claims", *(f"results/{name}-*" for name in studies), *["--cost cost.parquet"] * cost]
            cost_first = ["study cost --out cost.parquet"] * cost
            commands = ["study run " + " ".join(studies), *cost_first, " ".join(claims)]
            took = f"{seconds[studies].sum():.0f}"
        expected = (
            f"{row.value:.4g}" + (f" ± {row.error:.2g}" if row.error > 0 else "") if studies else "needs a recording"
        )
        words = "; ".join(f"`{command}`" for command in commands)
        yield [str(row.number), row.section, row.quantity, words, took, expected, row.verdict]


def criteria(tables: Tables) -> Rows:
    """The criterion of each verdict."""
    yield ["", "statement", "criterion"]
    yield from ([str(row.number), row.statement, row.criterion] for row in tables("verdicts").itertuples())


def published(tables: Tables) -> Rows:
    """Mean squared errors of others beside those of the same fits here."""
    yield ["theirs", "here", "published", "here, 10⁴ MSE", "difference in errors", "10² bias"]
    for row in tables("published").itertuples():
        far, known = (row.mse - row.published) / row.mse_error, row.published == row.published
        theirs, apart = (f"{row.published:.4f}", f"{far:.1f}") if known else ("-", "-")
        ours, bias = _with_error(row.mse, row.mse_error), _with_error(row.bias, row.bias_error)
        yield [TITLES["published"][row.estimator], f"`{row.estimator}`", theirs, ours, apart, bias]


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
    short = {"reproduced": "yes", "partly": "part", "not reproduced": "no", "not evaluated": "–", "": "·"}
    judged = _readings(tables)
    yield ["claim", "used", *(judged.letters[key] for key in judged.others)]
    for row in tables("verdicts").itertuples():
        verdicts = [judged.verdict(row.name, *key) for key in judged.others]
        cells = [f"**{short[one]}**" if one and one != row.verdict else short[one] for one in verdicts]
        yield [f"{row.number} {row.name}", short[row.verdict], *cells]


def readings_changed(tables: Tables) -> Rows:
    """Verdicts that another reading changes, with the first numbers behind them, and the claims that stand."""
    yield ["claim", "verdict", "reading", "numbers"]
    judged, numbers = _readings(tables), tables("verdicts").set_index("name")["number"]
    for row in judged.changed.itertuples():
        first = "; ".join(str(row.finding).split("; ")[:2])
        yield [f"{row.number} {row.claim}", f"{row.used} → {row.verdict}", judged.reading(row).clause, first]
    stand = ", ".join(f"{numbers[name]} {name}" for name in sorted(judged.standing, key=numbers.get))
    yield f"Under every reading stand {len(judged.standing)} verdicts: {stand}."


def coverage_short(tables: Tables) -> Rows:
    """Coverage of the radius: the least over all kinds of data, and the mean and the least of ok fits."""
    yield ["interval", "all fits: least over all kinds", "ok fits: mean", "ok fits: least"]
    methods = {name: f"`{name}` ± t standard errors" for name in ("corrected", "als", "mle")}
    for method, title in {"interval": '`fit.interval("radius")`', **methods}.items():
        part = tables("coverage").query(f"method == '{method}'")
        often = part.query("ok >= .2 and sigma < .35")["radius_ok"]
        yield [title, *map(_short, (part.query("sigma <= .5")["radius"].min(), often.mean(), often.min()))]


def coverage_summary(tables: Tables) -> Rows:
    """Coverage by each method over all cells."""
    table = tables("coverage")
    rows = [coverage.summary(table, name) for name in table["method"].unique()]
    yield from (list(rows[0]), *(list(row.values()) for row in rows))


def coverage_cells(tables: Tables) -> Rows:
    """Coverage in every cell, by three methods."""
    yield from coverage.by_cell(tables("coverage"), ["mle", "als", "interval"])


def decades(tables: Tables) -> Rows:
    """Median error over the bound in some decades of noise, in the paper's own design."""
    yield ["σ/r from", "MLE", "LLS", "GDKE", "UGDK"]
    table = tables("paper").set_index(["decade", "estimator"])
    for decade, title in DECADES.items():
        rows = [table.loc[decade, name] for name in ("mle", "lls", "gdke", "ugdk")]
        yield [title, *(_with_error(row.ratio_median, row.ratio_median_error) + _failed(row, 0) for row in rows)]


def em_vmf(tables: Tables) -> Rows:
    """EM with a von Mises-Fisher law beside others: median error over the bound."""
    yield ["σ/r, cap", "attainable", "`mle`", "`corrected`", "`em_vmf`"]
    table = tables("em_vmf").set_index(["noise_over_radius", "angle", "estimator"])
    for noise, angle in [(0.03, 45), (0.1, 45), (0.1, 90), (0.2, 90), (0.3, 90), (0.3, 180)]:
        rows = [table.loc[noise, angle, name] for name in ("mle", "corrected", "em_vmf")]
        cells = [f"{row.ratio_median:.2f} ± {_short(row.ratio_median_error)}{_failed(row, 1)}" for row in rows]
        yield [f"{noise:g}, {angle:g}°", f"{rows[0].median_attainable:.2f}", *cells]


def outliers(tables: Tables) -> Rows:
    """Error against the share of outliers, of the estimators that are not robust."""
    head, *rows = _outliers(tables("robustness"), PLAIN)
    model = [f"{(1.0 + share * 10.0**2 / 3.0) ** 0.5:.3g}" for share in tables("robustness")["outlier_share"].unique()]
    yield from (head, ["taken for noise: √(1 + p s²/d)", *model], *rows)


def outliers_robust(tables: Tables) -> Rows:
    """Error against the share of outliers, with the robust fit."""
    yield from _outliers(tables("robust"), ["mle", "corrected", "robust"])


def _outliers(table: pd.DataFrame, estimators: list[str]) -> Rows:
    shares = list(table["outlier_share"].unique())
    yield ["share of outliers", *(f"{100 * share:g} %" if share else "0" for share in shares)]
    yield from _by_angle(table.query("law == 'normal'"), "outlier_share", shares, estimators)


def forms(tables: Tables) -> Rows:
    """Errors of form: what is seen and covered, beside the most powerful test that knows the form."""
    yield [
        "cap",
        "length",
        "size",
        "doubted",
        "white noise covers",
        "covers, or doubted",
        "best test sees",
        "unseen cover",
    ]
    for row in tables("misfit_errors").dropna(subset="best_seen").itertuples():
        angle, length, size = re.findall(r"[\d.]+", row.name)
        shares = (1.0 - row.ok, row.covers_white, row.covers_or_doubted, row.best_seen)
        unseen = "-" if row.best_seen > 0.995 else _short(row.best_unseen_covers)
        yield [f"{angle}°", length, f"{size} σ", *map(_short, shares), unseen]


def laws(tables: Tables) -> Rows:
    """Error under laws of other tails."""
    yield ["law (excess kurtosis)", *TITLES["laws"].values()]
    yield from _by_angle(tables("robustness").query("outlier_share == 0"), "law", [*TITLES["laws"]], PLAIN)


def _by_angle(table: pd.DataFrame, key: str, values: list[float] | list[str], estimators: list[str]) -> Rows:
    """Median error in units of an efficient estimator's with normal noise; a column per value of the key."""
    for angle, part in table.groupby("angle"):
        for name in estimators:
            title = "`gdke`, `lls`" if name == "gdke" else f"`{name}`"
            rows = part[part["estimator"] == name].set_index(key).loc[values]
            ratios = rows["ratio_median"] / rows["median_cramer_rao"]
            yield [f"**{angle:g}°** {title}" if name == "mle" else title, *map("{:.2f}".format, ratios)]


def coverage_few(tables: Tables) -> Rows:
    """Fits of few points: the share that is ok, and how often the radius is held, over all and among the ok ones."""
    table = tables("coverage_limits").query("kind == 'few'").sort_values(["samples", "angle", "noise_over_radius"])
    kinds = table[["angle", "noise_over_radius"]].drop_duplicates()
    yield ["N", *(f"{angle:g}°, σ = {_short(noise)} r" for angle, noise in kinds.to_numpy())]
    for n, part in table.groupby("samples"):
        cells = ([_short(number, 3) for number in row] for row in part[["ok", "radius", "radius_ok"]].to_numpy())
        yield [str(n), *(f"{ok} {radius}/{radius_ok}" for ok, radius, radius_ok in cells)]


def coverage_belts(tables: Tables) -> Rows:
    """Belts: how often the interval of the centre across the belt holds it, by the standard error there."""
    table = tables("coverage_limits").query("kind == 'belt'").pivot_table("across", "ratio", ["samples", "angle"])
    yield ["standard error", *(f"N = {n}, ±{angle:g}°" for n, angle in table)]
    yield from ([_short(ratio, 1), *(_short(share, 3) for share in row)] for ratio, row in table.iterrows())


def false_alarms(tables: Tables) -> Rows:
    """Share of clean data sets in space in which the outlier rule names a point, in per cent, by number of points."""
    table = tables("false_alarms").query("dimension == 3 and samples < @MANY_POINTS").sort_values("samples")
    yield ["cap, σ/r", *(f"N = {n}" for n in table["samples"].unique())]
    for (angle, noise), part in table.groupby(["angle", "noise_over_radius"]):
        shares = (100 * part[["share", "share_error"]]).to_numpy()
        yield [f"{angle:g}°, {_short(noise)}", *(f"{share:.2f} ± {_short(error)}" for share, error in shares)]


def stopping(tables: Tables) -> Rows:
    """Coverage of the numbers of adaptive runs, on two laws with known medians."""
    yield ["", "normal", "Cauchy"]
    table = tables("stopping").pivot(index="law", columns="quantity", values="value").loc[["normal", "cauchy"]]
    for title, names in TITLES["stopping"].items():
        if names[0].startswith("spread"):
            cells = [" to ".join(f"{number:.2f}" for number in row) for row in table[names].to_numpy()]
        else:
            cells = [" / ".join(f"{100 * number:.1f}" for number in row) + " %" for row in table[names].to_numpy()]
        yield [title, *cells]


def skin(tables: Tables) -> Rows:
    """Errors of joints where skin moves the markers of synthetic bodies."""
    head = ["skin", "motion", "covered", "knees, elbows", "undoubted", "undoubted, > 2 cm off"]
    yield [*head, "no estimate", "off / stated"]
    for row in tables("skin").itertuples():
        shares = map(_short, (row.covered, row.covered_hinges, row.undoubted))
        far, off = _short(row.undoubted_far, 3), f"{row.median_off_mm:.1f} / {row.median_error_mm:.1f}"
        yield [TITLES["skin"][row.skin], row.motion, *shares, far, _short(row.without_estimate), off]


def cluster(tables: Tables) -> Rows:
    """A simulated cluster: how busy its workers are, and what the scheduler and the parent take."""
    head = ["workers", "task", "at most", "efficiency here", "scheduler / parent, a task", "sent / back"]
    yield [*head, "parent's peak, computing / joining"]
    for row in tables("cluster").itertuples():
        scheduler, parent = 1e3 * row.scheduler_cpu / row.tasks, 1e3 * row.parent_cpu / row.tasks
        most = min(1.0, 1e3 * row.task_seconds / max(scheduler, parent) / row.workers)
        shares = [f"{100 * most:.0f} %", f"{100 * row.efficiency:.0f} %", f"{scheduler:.1f} / {parent:.1f} ms"]
        sizes = [f"{row.sent_kb:.0f} / {row.came_kb:.0f} kB", f"{row.parent_mib:.0f} / {row.finish_mib:.0f} MiB"]
        yield [f"{row.workers:,}", f"{row.task_seconds:.1f} s", *shares, *sizes]


def cluster_study(tables: Tables) -> Rows:
    """The study of 10¹³ samples: its time by the number of workers."""
    yield ["workers", "time", "efficiency"]
    for row in tables("cluster_study").itertuples():
        yield [f"{row.workers:,}", f"{row.seconds / 60:.0f} min", f"{100 * row.efficiency:.0f} %"]


def speed(tables: Tables) -> Rows:
    """Ratios of the stored benchmarks."""
    yield ["what", "beside", "ratio"]
    table, naive = tables("bench").set_index(["group", "what"])["ratio"], "as one would first write it in NumPy"
    for what, beside, group, names, words in TITLES["speed"]:
        ratios = [table[group.format(name), naive if "{}" in group else name] for name in names]
        yield [what, beside, " / ".join(f"{r:.0f}" if r >= 10 else f"{r:.2g}" for r in ratios) + words]


def _failed(row: pd.Series, digits: int) -> str:
    """The share of fits that failed, in brackets; nothing if none did."""
    share = 100.0 * (1.0 - row["ok"] / row["planned"])
    return f" ({_short(share, digits)} %)" if share else ""


def _with_error(value: float, error: float) -> str:
    """A number with its Monte-Carlo error, to one digit of the error, or two if it begins with a one."""
    place = math.floor(math.log10(error))
    digits = max(0, -place + (error < 2.0 * 10.0**place))
    return f"{_short(value, digits)} ± {_short(error, digits)}"


def _short(value: float, digits: int = 2) -> str:
    """A number without the zero before its point."""
    return re.sub(r"^(-?)0\.", r"\1.", f"{value:.{digits}f}")
