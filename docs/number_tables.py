"""Tables of the documents that are made from stored tables; see `docs/bound_numbers.py`.

Each function takes the stored tables by their names in `docs/numbers.toml`, and returns Markdown.
"""

import math
import tomllib
from collections.abc import Callable
from pathlib import Path

import pandas as pd

from study.simulation import coverage
from study.simulation.claims.readings import Readings
from study.simulation.claims.readings import read as read_readings

MANY_POINTS = 10_000
"""From here on false alarms were measured in a few cells only."""
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
Tables = Callable[[str], pd.DataFrame]

with open(Path(__file__).with_name("numbers.toml"), "rb") as _file:
    TITLES = tomllib.load(_file)["titles"]
"""For each table the words of its rows."""
PLAIN = ["mle", "corrected", "als", "taubin", "gdke"]
"""Least-squares estimators; `lls` is `gdke`."""


def regret(tables: Tables) -> str:
    """Regret of the estimators over all cells in space, the least median first."""
    table = tables("regret")
    whole = table[(table["samples"] == 0) & table["estimator"].isin(list(TITLES["regret"]))]
    rows = []
    for row in whole.sort_values("median", kind="stable").to_dict("records"):
        name = row["estimator"]
        numbers = [f"{row[key]:.3f} ± {_short(row[f'{key}_error'], 3)}" for key in ("median", "q95")]
        rows.append([f"`{name}`", *numbers, TITLES["regret"][name].format(worst=row["median_worst"])])
    rows.append(["`robust`", "-", "-", "with outliers: least trimmed squares, then `mle` of the rest"])
    return _markdown(["estimator", "median error", "95 % quantile", "take it"], rows)


def certify(tables: Tables) -> str:
    """Largest errors of the certified fits, of sets that double precision tells and of the others."""
    rows = []
    for (name, told), part in tables("certify").groupby(["estimator", "told"], sort=False):
        size = 5e4 * max(part["center"].max(), part["radius"].max())
        told_or_not = "told" if told else "not told"
        rows.append([f"`{name}`, {told_or_not}", str(len(part)), f"{part['center'].max():.1e}"])
        rows[-1] += [f"{part['radius'].max():.1e}", f"{size:.0e}"]
    return _markdown(["fit", "sets", "centre", "radius", "µm on a sphere of 100 mm"], rows)


def claim_commands(tables: Tables) -> str:
    """For each claim the command that judges it, the seconds of its studies, and the number to expect."""
    seconds, rows = tables("studies").set_index("study")["seconds"], []
    for row in tables("verdicts").to_dict("records"):
        needed = dict.fromkeys(part.split("/")[0] for part in row["reads"].split(", "))
        studies = [name for name in needed if name in seconds] or ["paper"] * ("cost" in needed)
        words = ["study run " + " ".join(studies)] if studies else []
        words += ["study cost --out cost.parquet"] if "cost" in needed else []
        words.append(" ".join(["study claims", *(f"results/{name}-*" for name in studies)]))
        words[-1] += " --cost cost.parquet" if "cost" in needed else ""
        took = f"{sum(seconds[name] for name in studies):.0f}"
        expected = f"{row['value']:.4g}" + (f" ± {row['error']:.2g}" if row["error"] > 0 else "")
        if not studies:
            words, took, expected = ["study claims RUN --recording DIR"], "-", "needs a recording"
        commands = "; ".join(f"`{each}`" for each in words)
        rows.append([str(row["number"]), row["section"], row["quantity"], commands, took, expected, row["verdict"]])
    return _markdown(["", "§", "quantity", "commands", "seconds", "expected", "verdict"], rows)


def criteria(tables: Tables) -> str:
    """The criterion of each verdict."""
    table = tables("verdicts").to_dict("records")
    return _markdown(
        ["", "statement", "criterion"], [[str(r["number"]), r["statement"], r["criterion"]] for r in table]
    )


def published(tables: Tables) -> str:
    """Mean squared errors of others beside those of the same fits here."""
    names = TITLES["published"]
    rows = []
    for row in tables("published").to_dict("records"):
        far = (row["mse"] - row["published"]) / row["mse_error"]
        theirs = [f"{row['published']:.4f}", f"{far:.1f}"] if math.isfinite(far) else ["-", "-"]
        ours = [_with_error(row["mse"], row["mse_error"]), _with_error(row["bias"], row["bias_error"])]
        rows.append([names[row["estimator"]], f"`{row['estimator']}`", theirs[0], ours[0], theirs[1], ours[1]])
    return _markdown(["theirs", "here", "published", "here, 10⁴ MSE", "difference in errors", "10² bias"], rows)


def _readings(tables: Tables) -> Readings:
    return Readings(read_readings(Path(__file__).parents[1] / "configs" / "readings.toml"), tables("readings"))


def choices(tables: Tables) -> str:
    """What the paper leaves open, with the readings, the one that is used bold, and the claims that each changes."""
    rows, found = [], _readings(tables)
    letters = found.letters
    for choice in found.choices:
        ways = [
            f"{letters[choice.name, one.name]} " + (f"**{one.words}**" if one.name == choice.used else one.words)
            for one in choice.reading
        ]
        moved = found.changed[found.changed["choice"] == choice.name].groupby("reading", sort=False)["number"]
        changes = [f"{letters[choice.name, str(name)]}: {', '.join(map(str, part))}" for name, part in moved]
        rows.append([choice.section, choice.issue, "; ".join(ways), choice.why, "; ".join(changes) or "-"])
    return _markdown(["§", "choice", "readings, the one used in bold", "why", "claims that change"], rows)


def readings(tables: Tables) -> str:
    """Verdicts on the claims under each reading; those that differ from the used one are bold."""
    short = {"reproduced": "yes", "partly": "part", "not reproduced": "no", "not evaluated": "–"}
    found = _readings(tables)
    rows = []
    for row in tables("verdicts").to_dict("records"):
        cells = []
        for key in found.others:
            verdict = found.verdict(row["name"], *key)
            words = short[verdict] if verdict else "·"
            cells.append(f"**{words}**" if verdict and verdict != row["verdict"] else words)
        rows.append([f"{row['number']} {row['name']}", short[row["verdict"]], *cells])
    return _markdown(["claim", "used", *(found.letters[key] for key in found.others)], rows)


def readings_changed(tables: Tables) -> str:
    """Verdicts that another reading changes, with the first numbers behind them, and the claims that stand."""
    found = _readings(tables)
    numbers = tables("verdicts").set_index("name")["number"]
    stand = ", ".join(f"{numbers[name]} {name}" for name in sorted(found.standing, key=numbers.get))
    rows = []
    for row in found.changed.itertuples():
        numbers = "; ".join(str(row.finding).split("; ")[:2])
        rows.append([f"{row.number} {row.claim}", f"{row.used} → {row.verdict}", found.reading(row).clause, numbers])
    table = _markdown(["claim", "verdict", "reading", "numbers"], rows)
    return f"{table}\n\nUnder every reading stand {len(found.standing)} verdicts: {stand}."


def coverage_short(tables: Tables) -> str:
    """Coverage of the radius: the least over all kinds of data, and the mean and the least of ok fits."""
    names = {"interval": '`fit.interval("radius")`'}
    names |= {name: f"`{name}` ± t standard errors" for name in ("corrected", "als", "mle")}
    rows = []
    for method, title in names.items():
        part = tables("coverage").query(f"method == '{method}'")
        often = part.query("ok >= .2 and sigma < .35")
        least = part.query("sigma <= .5")["radius"].min()
        rows.append([title, *map(_short, (least, often["radius_ok"].mean(), often["radius_ok"].min()))])
    head = ["interval", "all fits: least over all kinds", "ok fits: mean", "ok fits: least"]
    return _markdown(head, rows)


def coverage_summary(tables: Tables) -> str:
    """Coverage by each method over all cells."""
    table = tables("coverage")
    methods = list(dict.fromkeys(table["method"]))
    return _markdown(coverage.TITLES, [coverage.summary(table, name) for name in methods])


def coverage_cells(tables: Tables) -> str:
    """Coverage in every cell, by three methods."""
    head, *rows = coverage.by_cell(tables("coverage"), ["mle", "als", "interval"])
    return _markdown(head, rows)


def decades(tables: Tables) -> str:
    """Median error over the bound in some decades of noise, in the paper's own design."""
    table, rows = tables("paper"), []
    for decade in (-13, -9, -5, -3, -2, -1, 0, 2):
        title = {0: "1", 2: "100"}.get(decade, f"10{str(decade).translate(RAISED)}")
        part = table[table["decade"] == decade].set_index("estimator")
        cells = []
        for name in ("mle", "lls", "gdke", "ugdk"):
            row = part.loc[name]
            failed = 1.0 - row["ok"] / row["planned"]
            share = f" ({100 * failed:.0f} %)" if failed else ""
            cells.append(_with_error(row["ratio_median"], row["ratio_median_error"]) + share)
        rows.append([title, *cells])
    return _markdown(["σ/r from", "MLE", "LLS", "GDKE", "UGDK"], rows)


def em_vmf(tables: Tables) -> str:
    """EM with a von Mises-Fisher law beside others: median error over the bound."""
    table, rows = tables("em_vmf"), []
    for noise, angle in [(0.03, 45), (0.1, 45), (0.1, 90), (0.2, 90), (0.3, 90), (0.3, 180)]:
        part = table[(table["noise_over_radius"] == noise) & (table["angle"] == angle)].set_index("estimator")
        cells = []
        for name in ("mle", "corrected", "em_vmf"):
            row = part.loc[name]
            failed = 100.0 * (1.0 - row["ok"] / row["planned"])
            share = f" ({failed:.1f} %)".replace("(0.", "(.") if failed else ""
            cells.append(f"{row['ratio_median']:.2f} ± {_short(row['ratio_median_error'])}{share}")
        rows.append([f"{noise:g}, {angle:g}°", f"{part['median_attainable'].iloc[0]:.2f}", *cells])
    return _markdown(["σ/r, cap", "attainable", "`mle`", "`corrected`", "`em_vmf`"], rows)


def outliers(tables: Tables) -> str:
    """Error against the share of outliers, of the estimators that are not robust."""
    table = tables("robustness")
    shares = sorted(table["outlier_share"].unique())
    model = [f"{(1.0 + share * 10.0**2 / 3.0) ** 0.5:.3g}" for share in shares]
    rows = [["taken for noise: √(1 + p s²/d)", *model]]
    return _by_angle(table, "outlier_share", shares, PLAIN, rows)


def outliers_robust(tables: Tables) -> str:
    """Error against the share of outliers, with the robust fit."""
    table = tables("robust")
    shares = sorted(table["outlier_share"].unique())
    return _by_angle(table, "outlier_share", shares, ["mle", "corrected", "robust"], [])


def coverage_few(tables: Tables) -> str:
    """Fits of few points: the share that is ok, and how often the radius is held, over all and among the ok ones."""
    kinds = dict(list(tables("coverage_limits").query("kind == 'few'").groupby(["angle", "noise_over_radius"])))
    rows = [[str(n)] for n in sorted(tables("coverage_limits").query("kind == 'few'")["samples"].unique())]
    for part in kinds.values():
        for row, cell in zip(rows, part.sort_values("samples").to_dict("records"), strict=True):
            ok, radius, radius_ok = (_short(cell[name], 3) for name in ("ok", "radius", "radius_ok"))
            row.append(f"{ok} {radius}/{radius_ok}")
    return _markdown(["N", *(f"{angle:g}°, σ = {_short(noise)} r" for angle, noise in kinds)], rows)


def coverage_belts(tables: Tables) -> str:
    """Belts: how often the interval of the centre across the belt holds it, by the standard error there."""
    table = tables("coverage_limits").query("kind == 'belt'")
    kinds = {(n, angle): part.set_index("ratio") for (n, angle), part in table.groupby(["samples", "angle"])}
    rows = []
    for ratio in sorted(table["ratio"].unique()):
        rows.append([_short(ratio, 1), *(_short(part.loc[ratio, "across"], 3) for part in kinds.values())])
    return _markdown(["standard error", *(f"N = {n}, ±{angle:g}°" for n, angle in kinds)], rows)


def false_alarms(tables: Tables) -> str:
    """Share of clean data sets in space in which the outlier rule names a point, in per cent, by number of points."""
    table = tables("false_alarms").query("dimension == 3 and samples < @MANY_POINTS")
    numbers = sorted(table["samples"].unique())
    rows = []
    for (angle, noise), part in table.groupby(["angle", "noise_over_radius"]):
        cells = part.set_index("samples")
        shares = [f"{100 * cells.share[n]:.2f} ± {_short(100 * cells.share_error[n])}" for n in numbers]
        rows.append([f"{angle:g}°, {_short(noise)}", *shares])
    return _markdown(["cap, σ/r", *[f"N = {n}" for n in numbers]], rows)


def laws(tables: Tables) -> str:
    """Error under laws of other tails."""
    table = tables("robustness")
    made = _by_angle(table, "law", list(TITLES["laws"]), PLAIN, [])
    return made.replace(made.split("\n")[0], "| law (excess kurtosis) | " + " | ".join(TITLES["laws"].values()) + " |")


def stopping(tables: Tables) -> str:
    """Coverage of the numbers of adaptive runs, on two laws with known medians."""
    table = tables("stopping").pivot(index="quantity", columns="law", values="value")
    rows = []
    for title, names in TITLES["stopping"].items():
        cells = []
        for law in ("normal", "cauchy"):
            numbers = [table.loc[name, law] for name in names]
            if names[0].startswith("spread"):
                cells.append(" to ".join(f"{number:.2f}" for number in numbers))
            else:
                cells.append(" / ".join(f"{100 * number:.1f}" for number in numbers) + " %")
        rows.append([title, *cells])
    return _markdown(["", "normal", "Cauchy"], rows)


def skin(tables: Tables) -> str:
    """Errors of joints where skin moves the markers of synthetic bodies."""
    rows = []
    for row in tables("skin").to_dict("records"):
        shares = [_short(row[key]) for key in ("covered", "covered_hinges", "undoubted")]
        off = f"{row['median_off_mm']:.1f} / {row['median_error_mm']:.1f}"
        far, without = _short(row["undoubted_far"], 3), _short(row["without_estimate"])
        rows.append([TITLES["skin"][row["skin"]], row["motion"], *shares, far, without, off])
    head = ["skin", "motion", "covered", "knees, elbows", "undoubted", "undoubted, > 2 cm off"]
    head += ["no estimate", "off / stated"]
    return _markdown(head, rows)


def cluster(tables: Tables) -> str:
    """A simulated cluster: how busy its workers are, and what the scheduler and the parent take."""
    rows = []
    for row in tables("cluster").to_dict("records"):
        busy = {name: 1e3 * row[f"{name}_cpu"] / row["tasks"] for name in ("scheduler", "parent")}
        most = min(1.0, 1e3 * row["task_seconds"] / max(busy.values()) / row["workers"])
        rows.append([f"{row['workers']:,}", f"{row['task_seconds']:.1f} s", f"{100 * most:.0f} %"])
        rows[-1] += [f"{100 * row['efficiency']:.0f} %", "{scheduler:.1f} / {parent:.1f} ms".format(**busy)]
        rows[-1] += [f"{row['sent_kb']:.0f} / {row['came_kb']:.0f} kB"]
        rows[-1] += [f"{row['parent_mib']:.0f} / {row['finish_mib']:.0f} MiB"]
    head = ["workers", "task", "at most", "efficiency here", "scheduler / parent, a task", "sent / back"]
    return _markdown([*head, "parent's peak, computing / joining"], rows)


def cluster_study(tables: Tables) -> str:
    """The study of 10¹³ samples: its time by the number of workers."""
    rows = [
        [f"{row['workers']:,}", f"{row['seconds'] / 60:.0f} min", f"{100 * row['efficiency']:.0f} %"]
        for row in tables("cluster_study").to_dict("records")
    ]
    return _markdown(["workers", "time", "efficiency"], rows)


def speed(tables: Tables) -> str:
    """Ratios of the stored benchmarks."""
    table, rows = tables("bench").set_index(["group", "what"])["ratio"], []
    for what, beside, group, names, words in TITLES["speed"]:
        naive = "as one would first write it in NumPy"
        ratios = [table[group.format(name), naive if "{}" in group else name] for name in names]
        shown = [f"{ratio:.0f}" if ratio >= 10 else f"{ratio:.2g}" for ratio in ratios]
        rows.append([what, beside, " / ".join(shown) + words])
    return _markdown(["what", "beside", "ratio"], rows)


def _by_angle(table: pd.DataFrame, key: str, values: list[float], names: list[str], rows: list[list[str]]) -> str:
    """Median error in units of an efficient estimator's with normal noise; a column per value of the key."""
    other = {"law": "outlier_share", "outlier_share": "law"}[key]
    plain = table[table[other] == {"law": "normal", "outlier_share": 0.0}[other]]
    for angle in sorted(plain["angle"].unique()):
        for name in names:
            title = "`gdke`, `lls`" if name == "gdke" else f"`{name}`"
            part = plain[(plain["angle"] == angle) & (plain["estimator"] == name)].set_index(key)
            ratio = part["ratio_median"] / part["median_cramer_rao"]
            numbers = [f"{ratio[value]:.2f}" for value in values]
            rows.append([f"**{angle:g}°** {title}" if name == "mle" else title, *numbers])
    if key == "outlier_share":
        return _markdown(["share of outliers", *(f"{100 * value:g} %" if value else "0" for value in values)], rows)
    return _markdown([key, *map(str, values)], rows)


def _with_error(value: float, error: float) -> str:
    """A number with its Monte-Carlo error, to one digit of the error, or two if it begins with a one."""
    place = math.floor(math.log10(error))
    digits = max(0, -place + (error < 2.0 * 10.0**place))
    if digits == 0:
        return f"{value:.0f} ± {error:.0f}"
    return f"{_short(value, digits)} ± {_short(error, digits)}"


def _short(value: float, digits: int = 2) -> str:
    """A share without the zero before its point."""
    return f"{value:.{digits}f}".removeprefix("0").replace("-0.", "-.")


def _markdown(head: list[str], rows: list[list[str]]) -> str:
    return "\n".join("| " + " | ".join(cells) + " |" for cells in [head, ["---"] * len(head), *rows])
