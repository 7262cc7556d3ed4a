"""The explorer in a real browser, and the numbers that travel in the page: each control, keys, files, the address."""

import base64
import csv
import gzip
import io
import json
import math
import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from study import style
from study.fits import Status
from study.simulation.figures import Tables
from study.simulation.report.material import Material
from study.simulation.report.page import packed, render
from study.simulation.statistics import PERFORMANCE
from tests.configs import config

POINTS = """document.querySelector('#explorer-chart [aria-label="dot"]').querySelectorAll('path, circle').length"""
ERRORS = """document.querySelectorAll('#explorer-chart [aria-label="link"] path').length"""
READY = "!document.getElementById('explorer-body').hidden && !!document.querySelector('#explorer-chart svg')"
KEY = "[...document.querySelectorAll('#explorer-chart [aria-label=legend] path')]"
SVG = "{http://www.w3.org/2000/svg}"


def unpacked(run):
    """The numbers of a run, as a browser reads them."""
    text = gzip.decompress(base64.b64decode(packed(Tables(run)))).decode()
    return json.loads(text)


@pytest.mark.parametrize("name", ["circles", "random"])
def test_numbers_are_those_of_the_summary(name, request):
    """Every row, measure and error, to five digits and three; conditions and counts exactly."""
    run = request.getfixturevalue(name)
    data, frame = unpacked(run), run.table("summary")
    labels = [data["estimators"][code]["name"] for code in data["estimator"]]
    assert labels == frame["estimator"].astype(str).tolist()
    assert [data["groups"][code] for code in data["group"]] == frame["group"].tolist()
    assert data["trials"] == frame["planned"].tolist()
    assert data["ok"] == frame["ok"].tolist()
    failed = {entry["words"]: sum(entry["counts"]) for entry in data["failed"]}
    assert sum(failed.values()) == (frame["planned"] - frame["ok"]).sum()
    (condition,) = data["conditions"]
    expected = frame["samples"] if name == "circles" else 10.0 ** frame["decade"]
    assert np.allclose([condition["values"][code] for code in condition["codes"]], expected, rtol=1e-6)
    measures = {entry["name"]: entry for entry in data["measures"]}
    assert set(measures) >= {m for m in PERFORMANCE if frame[m].notna().any()}
    for name, entry in measures.items():
        if name in PERFORMANCE:
            for column, values, digits in ((name, "values", 1e-4), (f"{name}_error", "errors", 1e-2)):
                found = [math.nan if value is None else value for value in entry[values]]
                assert np.allclose(found, frame[column], rtol=digits, equal_nan=True)


def test_measures_of_the_study_can_be_explored(make_run, make_claims):
    """Columns of a measure are there with their errors; the report says for which of them trials were added."""
    asked = '[precision]\nmeasure = "own_errors_radius"\ntarget = 0.05\nfirst = 100\n'
    top = {"estimators": ["lls", "als"], "measures": ["own_errors"], "dimension": 2}
    run = make_run(config(top, trials=100, samples=[10, 30], noise=0.1, angle=90) + asked)
    measures = {entry["name"]: entry for entry in unpacked(run)["measures"]}
    frame = run.table("summary")
    for name in ("own_errors_radius", "own_errors_width_median"):
        assert np.allclose(measures[name]["values"], frame[name], rtol=1e-4)
        assert np.allclose(measures[name]["errors"], frame[f"{name}_error"], rtol=1e-2)
    assert "error of this column of a measure (<code>own_errors_radius</code>)" in render(
        Material([run], make_claims())
    )


@pytest.mark.parametrize("name", ["circles", "random"])
def test_worst_trials_are_those_of_the_errors(name, request):
    """For each row the trial whose error over a finite bound is the largest among the fits that are ok."""
    run = request.getfixturevalue(name)
    data, errors = unpacked(run), run.table("errors")
    errors = errors[(errors["status"] == Status.OK) & np.isfinite(errors["bound"])]
    errors = errors.assign(ratio=errors["error"] / errors["bound"], name=errors["cell"].astype(str))
    ratios = errors.set_index(["estimator", "name", "trial"])["ratio"].to_dict()
    for place, (worst, ratio) in enumerate(zip(data["worst"], data["ratio"], strict=True)):
        if worst is None:
            assert data["ok"][place] == 0 or ratio is None
            continue
        estimator = data["estimators"][data["estimator"][place]]["name"]
        cell, trial = worst.split("/")
        assert ratios[estimator, cell, int(trial)] == pytest.approx(ratio, rel=0.01)
        if name == "circles":
            mine = errors[(errors["name"] == cell) & (errors["estimator"] == estimator)]
            assert mine["ratio"].max() == pytest.approx(ratio, rel=0.01)


@pytest.fixture(scope="module")
def file(circles, random, many, claims, tmp_path_factory):
    """The page about three runs; the third is a grid of three conditions and nine estimators."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("study.simulation.figures.FIGURES", {})
        text = render(Material([circles, random, many], claims))
    path = tmp_path_factory.mktemp("explorer") / "page.html"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def tab(new_tab):
    """A tab that takes downloads."""
    return new_tab(accept_downloads=True, viewport={"width": 1280, "height": 900})


@pytest.fixture
def opened(tab, heard, file, until):
    """Open the explorer at an address; at the end nothing was asked of a network and nothing complained."""

    def open_at(address="", width=1280):
        tab.set_viewport_size({"width": width, "height": 900})
        tab.emulate_media(media="screen")
        tab.goto("about:blank")
        tab.goto(file.as_uri() + address)
        until(tab, READY)
        return tab

    yield open_at
    assert heard == []


def hash_of(tab):
    """The state in the address."""
    return tab.evaluate("Object.fromEntries(new URLSearchParams(location.hash.slice('#explorer?'.length)))")


def test_the_first_view(opened, circles):
    """Every row of the first run is a point, with its Monte-Carlo error; the address is as it was."""
    tab = opened()
    assert tab.evaluate("location.hash") == ""
    frame = circles.table("summary")
    assert tab.evaluate(POINTS) == len(frame)
    assert tab.evaluate(ERRORS) == np.isfinite(frame["ratio_median_error"]).sum()
    assert tab.inner_text("#explorer-count") == f"{len(frame)} rows"
    assert tab.locator("#explorer-table tbody tr").count() == len(frame)


def test_each_control(opened, many):
    """Run, measure, axis, colour, panels, scales and filters change the chart, the table and the address."""
    tab = opened()
    tab.select_option("#explorer-run", many.study.run_name())
    tab.wait_for_selector("#explorer-filters summary:has-text('φ: all 2')")
    assert tab.evaluate(POINTS) <= 9 * 11 * 2  # one number of samples, two panels
    assert hash_of(tab)["is.samples"] == "50"
    tab.select_option("#explorer-y", "relative_median_all")
    tab.select_option("#explorer-x", "angle")
    tab.select_option("#explorer-colour", "noise_over_radius")
    tab.select_option("#explorer-facet", "")
    state = hash_of(tab)
    assert (state["y"], state["x"]) == ("relative_median_all", "angle")
    assert (state["colour"], state["facet"]) == ("noise_over_radius", "")
    legend = tab.locator("#explorer-chart [aria-label=legend] text").all_text_contents()
    assert legend[0] == "Median of error over radius, not ok as infinite"
    assert len(legend) == 12  # the measure, and eleven levels of noise
    tab.uncheck("#explorer-ylog") if tab.is_checked("#explorer-ylog") else tab.check("#explorer-ylog")
    assert ("y" in hash_of(tab)["log"]) == tab.is_checked("#explorer-ylog")
    before = tab.evaluate(POINTS)
    tab.click("#explorer-filters summary:has-text('estimator')")
    tab.click("#explorer-filters .filter:has-text('estimator') button:has-text('none')")
    assert "No number to draw." in tab.inner_text("#explorer-chart")
    tab.check("#explorer-filters label:has-text('UGDK (Σ̂)') input")
    tab.check("#explorer-filters label:text-is('MLE') input")
    assert 0 < tab.evaluate(POINTS) < before
    assert hash_of(tab)["is.estimator"] == "MLE|UGDK (Σ̂)"
    tab.click("#explorer-reset")
    tab.wait_for_selector("#explorer-filters summary:has-text('estimator: all 9')")


def test_a_view_can_be_linked(opened, many):
    """An address brings its view, in a fresh page; what the run lacks is left out."""
    name = many.study.run_name()
    address = f"#explorer?run={name}&y=far_all&x=noise_over_radius&colour=angle&facet=samples&log=x"
    tab = opened(f"{address}&is.estimator=ALS|nobody&is.angle=45&q=als&sort=-value")
    assert tab.input_value("#explorer-run") == name
    assert tab.input_value("#explorer-y") == "far_all"
    assert not tab.is_checked("#explorer-ylog")
    assert tab.evaluate(POINTS) == 22
    assert tab.inner_text("#explorer-count") == "22 rows"
    title = tab.locator("#explorer-table th[aria-sort=descending]").inner_text()
    assert title.startswith("Share beyond 10 bounds or not ok")
    assert tab.evaluate("document.getElementById('explorer').getBoundingClientRect().top") < 900
    tab = opened("#explorer?run=gone&y=gone&x=gone&facet=gone")
    assert tab.evaluate(POINTS) > 0


def test_pointing_tells_the_cell(opened, circles):
    """The cell, its trials, its failures and the command for its worst trial, in the chart and below it."""
    tab = opened()
    point = tab.locator("#explorer-chart [aria-label=dot]").first.locator("path, circle").first
    point.hover(force=True)
    tip = tab.locator("#explorer-chart [aria-label=tip] text")
    tip.wait_for()
    for words in (tip.text_content(), tab.inner_text("#explorer-detail")):
        assert "60 trials" in words
        assert "none failed" in words
        assert "study replay" in words
    command = tab.inner_text("#explorer-detail code")
    assert command in tip.text_content().replace("\n", "")
    assert command in {f"study replay {circles.folder} {name}" for name in unpacked(circles)["worst"]}


def test_the_table(opened, random):
    """It is searched by words, sorted by any column, both ways, and a row tells its cell."""
    tab = opened(f"#explorer?run={random.study.run_name()}")
    everything = tab.inner_text("#explorer-count")
    tab.fill("#explorer-search", "ugdk 1e-05")
    rows = tab.locator("#explorer-table tbody tr")
    assert rows.count() == 1
    assert tab.inner_text("#explorer-count") == "1 row"
    tab.fill("#explorer-search", "no such row")
    assert rows.count() == 0
    tab.fill("#explorer-search", "")
    assert tab.inner_text("#explorer-count") == everything
    tab.click("[data-sort=trials]")
    column = tab.locator("#explorer-table thead th").all_inner_texts().index("trials")
    numbers = [int(row.locator("th, td").nth(column).inner_text()) for row in rows.all()]
    assert numbers == sorted(numbers)
    tab.click("[data-sort=trials]")
    most = random.table("summary")["planned"].max()
    assert int(rows.first.locator("th, td").nth(column).inner_text()) == most
    rows.first.locator("th button").click()
    assert f"{most} trials" in tab.inner_text("#explorer-detail")


def test_files(opened, random):
    """The chart as SVG, well formed, with its legend and without a script; the rows as CSV, with every number."""
    tab = opened(f"#explorer?run={random.study.run_name()}&is.estimator=UGDK")
    with tab.expect_download() as download:
        tab.click("#explorer-svg")
    assert download.value.suggested_filename == f"{random.study.run_name()}-ratio_median.svg"
    root = ET.parse(download.value.path()).getroot()
    assert root.tag == f"{SVG}svg"
    texts = ["".join(text.itertext()) for text in root.iter(f"{SVG}text")]
    assert "UGDK" in texts
    assert any(random.study.run_name() in text for text in texts)
    assert not list(root.iter(f"{SVG}script"))
    with tab.expect_download() as download:
        tab.click("#explorer-csv")
    rows = list(csv.DictReader(io.StringIO(download.value.path().read_text(encoding="utf-8"))))
    frame = random.table("summary").query("estimator == 'ugdk'")
    assert [row["group"] for row in rows] == frame["group"].tolist()
    assert [int(row["ok"]) for row in rows] == frame["ok"].tolist()
    found = [float(row["ratio_median_all"] or "nan") for row in rows]
    assert np.allclose(found, frame["ratio_median_all"], rtol=1e-4, equal_nan=True)


def test_marks_are_those_of_the_figures(opened, many):
    """Each estimator has its colour and a mark of its own letter, in the chart as in the key."""
    tab = opened(f"#explorer?run={many.study.run_name()}&x=noise_over_radius&facet=")
    drawn = tab.evaluate(
        "[...document.querySelectorAll('#explorer-chart [aria-label=legend] path')].map(p => p.getAttribute('d'))"
    )
    letters = [style.marker(name) for name in Tables(many).estimators]
    assert len(drawn) == len(letters)
    for letter, outline in zip(letters, drawn, strict=True):
        assert {other for other, same in zip(letters, drawn, strict=True) if same == outline} == {letter}
    corners = {letter: outline.count("L") + 1 for letter, outline in zip(letters, drawn, strict=True) if letter != "o"}
    assert corners.items() <= {"s": 4, "^": 3, "D": 4, "d": 4, "p": 5, "v": 3, "<": 3, ">": 3, "H": 6}.items()


def test_an_axis_has_one_notation(opened, random, many):
    """Ticks are decimals or powers of ten, not both, linear or logarithmic."""
    for name, log in ((random.study.run_name(), "xy"), (many.study.run_name(), "x"), (many.study.run_name(), "")):
        tab = opened(f"#explorer?run={name}&log={log}")
        for axis in ("x-axis tick label", "y-axis tick label"):
            words = tab.locator(f"#explorer-chart [aria-label='{axis}'] text").all_text_contents()
            powers = [any(digit in word for digit in "⁻⁰¹²³⁴⁵⁶⁷⁸⁹") for word in words if word != "0"]
            assert len(words) > 1
            assert len(set(powers)) == 1


def test_colours_are_seen_on_black(opened, many, until):
    """On a dark page marks have three times the light of what is behind them; a saved chart is for white paper."""
    tab = opened(f"#explorer?run={many.study.run_name()}")
    fills = f"{KEY}.map(p => getComputedStyle(p).fill)"
    on_white = tab.evaluate(f"{fills}.join()")
    tab.emulate_media(color_scheme="dark")
    until(tab, f"{fills}.join() !== '{on_white}'")
    behind = tab.evaluate("getComputedStyle(document.documentElement).backgroundColor")
    assert len(tab.evaluate(fills)) == 9
    assert min(contrast(fill, behind) for fill in tab.evaluate(fills)) > 3.0
    with tab.expect_download() as download:
        tab.click("#explorer-svg")
    saved = download.value.path().read_text(encoding="utf-8")
    assert all(style.color(name) in saved for name in Tables(many).estimators)
    tab.emulate_media(color_scheme="light")


def contrast(one, other):
    """Ratio of two colours' luminance by WCAG 2.1."""
    light = []
    for colour in (one, other):
        parts = np.array([int(part) for part in re.findall(r"\d+", colour)[:3]]) / 255.0
        linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
        light.append(linear @ [0.2126, 0.7152, 0.0722] + 0.05)
    return max(light) / min(light)


def test_keys_alone(opened):
    """Every control is reached by the tab key, in order; arrow keys step through the points."""
    tab = opened()
    tab.focus("#explorer-run")
    reached = []
    for _ in range(24):
        tab.keyboard.press("Tab")
        reached.append(tab.evaluate("document.activeElement.id || document.activeElement.tagName"))
    wanted = ["y", "x", "colour", "facet", "xlog", "ylog", "chart", "svg", "csv", "reset", "search"]
    names = [name for name in reached if name.startswith("explorer-")]
    assert names[: len(wanted)] == [f"explorer-{name}" for name in wanted]
    assert "SUMMARY" in reached
    tab.focus("#explorer-chart")
    told = []
    for key in ("ArrowRight", "ArrowRight", "ArrowLeft", "End", "Home"):
        tab.keyboard.press(key)
        told.append(tab.inner_text("#explorer-detail"))
        assert tab.locator("#explorer-chart .picked").count() == 1
    assert told[0] == told[2] == told[4] != told[1]
    assert told[3] not in told[:3]


@pytest.mark.parametrize("width", [390, 1280])
def test_widths(opened, width):
    """The chart follows the width, and nothing is wider than the page."""
    tab = opened(width=width)
    beyond = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
    assert tab.evaluate(beyond) <= 0
    assert abs(tab.locator("#explorer-chart svg").bounding_box()["width"] - (tab.evaluate("innerWidth"))) < 130
    tab.click("#explorer-filters summary >> nth=0")
    assert tab.evaluate(beyond) <= 0


def test_on_paper(opened):
    """What needs a reader's hand is left out."""
    tab = opened()
    tab.emulate_media(media="print")
    assert not tab.locator("#explorer").is_visible()
    assert not tab.locator("#explorer-chart svg").is_visible()
    assert tab.locator("#figures").is_visible()
    assert tab.locator("header .unprinted").is_visible()
    assert tab.pdf(format="A4").startswith(b"%PDF")
