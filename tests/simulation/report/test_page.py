import base64
import contextlib
import hashlib
import itertools
import os
import re
import shutil
import subprocess
import sys

import pandas as pd
import pytest

from study.files import RunError
from study.fits import Status
from study.simulation.claims.claim import Verdict
from study.simulation.claims.readings import COLUMNS, Readings
from study.simulation.claims.readings import read as read_choices
from study.simulation.experiment.config import shipped_config
from study.simulation.figures import FIGURES, NotApplicable, Tables, gallery
from study.simulation.report import html
from study.simulation.report.material import Material
from study.simulation.report.page import render, save
from study.simulation.report.words import timed
from study.simulation.runs.run_folder import Run
from tests.configs import config

LEAST = {"fig2_error", "fig3_gdke_ellipse", "fig4_ugdk_ellipse", "fig5_methods", "fig7_power_law"}


@pytest.fixture(scope="module")
def feeds(circles, random):
    """For each figure that these runs can feed the name of the first that can, in the registry's order."""
    found = {}
    for name, figure in ((name, FIGURES[name]) for name in gallery().undrawn):
        for run in (circles, random):
            with contextlib.suppress(NotApplicable):
                figure.prepare(Tables(run))
                found.setdefault(name, run.study.run_name())
    assert set(found) >= LEAST
    assert set(found) < set(FIGURES)
    return found


@pytest.fixture
def no_figures(monkeypatch):
    """Draw none, where they are not what is tested."""
    monkeypatch.setattr("study.simulation.figures.FIGURES", {})


def test_one_well_formed_document(document):
    """Every tag is closed where it was opened, no paragraph holds a block, ids are there once, links have places."""
    assert document.faults == []
    ids = document.ids()
    assert len(set(ids)) == len(ids)
    links = {tag["href"] for tag in document.of("a")}
    assert links
    assert links <= {f"#{place}" for place in ids}


def test_needs_nothing_else(page, document):
    """No frame, and nothing that would be fetched: what is referred to is in the page."""
    assert not document.of("iframe", "object", "embed", "base", "form")
    sources = [tag[key] for _, tag in document.tags for key in ("src", "href") if key in tag]
    assert all(source.startswith(("data:", "#")) for source in sources)
    assert not [tag for _, tag in document.tags if any(key.startswith("on") or key == "srcset" for key in tag)]
    style = page[page.index("<style>") : page.index("</style>")]
    assert not re.findall(r"url\(|@import", style)
    (policy,) = [tag["content"] for tag in document.of("meta") if "http-equiv" in tag]
    assert policy.startswith("default-src 'none'")
    run = [text for kind, text in re.findall(r"<script( [^>]*)?>(.*?)</script>", page, re.DOTALL) if not kind]
    hashed = [base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in run]
    assert policy.endswith("; script-src " + " ".join(f"'sha256-{text}'" for text in hashed))
    assert len(run) == 2  # the library and the explorer; nothing else may run


def test_can_be_read_by_ear(document):
    """A language, one h1, no heading level left out, scopes on headers, names for boxes, words for pictures."""
    assert document.of("html") == [{"lang": "en"}]
    levels = [int(tag[1]) for tag, _ in document.tags if re.fullmatch("h[1-6]", tag)]
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(later <= earlier + 1 for earlier, later in itertools.pairwise(levels))
    assert {tag["scope"] for tag in document.of("th")} == {"col", "row"}
    boxes = [tag for tag in document.of("div") if tag.get("class") == "scroll"]
    assert all(tag["role"] == "region" and tag["tabindex"] == "0" for tag in boxes)
    names = [tag["aria-label"] for tag in boxes]
    assert len(set(names)) == len(names) > 10
    for picture in document.of("img"):
        assert len(picture["alt"]) > 40
        assert int(picture["width"]) > int(picture["height"]) > 100


def test_what_was_run(document):
    """Design, numbers of trials and samples, seed, estimators, machine and time, for each run."""
    assert "circles in the plane; 4 cells of 60 trials, all from the same draws: N = 20, 40, 80, 160" in document.text
    assert "spheres in space; 60 trials, each with conditions of its own: N log-uniform from 4 to 100" in document.text
    assert "MLE, LLS, GDKE, UGDK 240 18,000 3 " in document.text  # 60 · (20 + 40 + 80 + 160) samples
    assert re.search(r"MLE, GDKE, UGDK 60 [\d,]+ 2009 ", document.text)


def test_sections_in_order(document, circles, random):
    """The contents list every section but those of runs, which the table of runs links to; headings are in order."""
    first, second = circles.study.run_name(), random.study.run_name()
    expected = ["claims", "explorer", "figures", "runs", f"run-{first}", f"run-{second}"]
    assert [tag["id"] for tag in document.of("h2")] == expected
    links = [tag["href"] for tag in document.of("a")]
    start = links.index("#claims")
    assert links[start : start + 4] == [f"#{name}" for name in expected[:4]]
    assert not [link for link in links[: start + 4] if link.startswith("#run-")]
    assert {f"#run-{first}", f"#run-{second}"} <= set(links[start + 4 :])


def test_figures(document, page, feeds):
    """Each figure once, in the registry's order, from the first run that can feed it, with what it says of itself."""
    assert [tag["id"] for tag in document.of("figure")] == list(feeds)
    assert len(document.of("img")) == page.count("data:image/png;base64,") == len(feeds)
    for name, run in feeds.items():
        assert f"{name}, run {run}" in document.text
    assert "Look at: above, the straight line over most decades" in document.text
    assert "Figure 7: median error against the number of samples, with the exponent" in document.text
    assert "The paper's figure 7 plots" not in document.text


def test_figures_not_drawn(document, circles, random, feeds):
    """For the others every run's reason is given, once where it is the same."""
    assert f"{len(gallery().undrawn) - len(feeds)} figures not drawn, and why" in document.text
    assert "fig6_mgdk: needs " in document.text
    assert f"not 1 ({circles.study.run_name()}); needs many trials of each condition" in document.text
    assert f'kind = "grid" in the config ({random.study.run_name()})' in document.text


def test_claims(document):
    """Verdicts are counted, in their order; numbers are a reader's; the unevaluated stand apart with their reasons."""
    counted = "5 claims: 2 reproduced 1 mostly 1 not reproduced 1 not evaluated 1 of these with another cause"
    assert counted in document.text
    badges = [tag["class"] for tag in document.of("span") if "badge" in tag.get("class", "")]
    tally = ["good", "partly", "bad", "untested", "untested"]
    judged = ["good", "partly", "bad", "good"]
    assert badges == [f"badge {look}" for look in tally + judged]
    assert "statement 3 of the <paper>" in document.text
    assert "the median; all fits: (−1.200 ± 0.030) × 10⁻⁵ the other, of N = 20: 0.990 ± 0.012" in document.text
    assert "at least 40 behind each number" in document.text
    assert "a remark of its own" in document.text
    assert document.text.count("Remark") == 1  # what is empty is not shown
    assert "1 claim not evaluated, and why" in document.text
    missing = (
        "Missing are runs of configs/mgdk.toml, and what study cost writes, given by --cost, and what study case-study "
        "writes, given by --recording."
    )
    assert missing in document.text
    assert "needs a run of configs/mgdk.toml; study run makes one" in document.text


def test_claims_link_to_what_is_on_the_page(document, page, circles):
    """Figures and runs that are here are links, others are names."""
    assert '<a href="#fig7_power_law">fig7_power_law</a>' in page
    assert "#fig6_mgdk" not in page
    assert "fig6_mgdk" in document.text
    assert f'<a href="#run-{circles.study.run_name()}">' in page[page.index('id="claim-1"') :]
    assert "other-0123456789" in document.text
    assert {f"claim-{i}" for i in (1, 2, 3, 5)} <= set(document.ids())


@pytest.mark.usefixtures("no_figures")
def test_no_claims(random, make_claims, read):
    """Without claims, or without one that could be judged, the page says what would feed them."""
    document = read(render(Material([random], make_claims())))
    assert "No claim of the paper was judged" in document.text
    rows = [(Verdict.NOT_EVALUATED, {"reads": f"{name}/errors"}) for name in ("paper", "mgdk", "random", "paper")]
    document = read(render(Material([random], make_claims(*rows))))
    words = "These runs can judge none of the claims. Missing are runs of configs/paper.toml, configs/mgdk.toml."
    assert words in document.text
    assert "4 not evaluated" not in document.text


@pytest.mark.usefixtures("no_figures")
def test_a_page_about_other_questions(make_run, make_claims, read):
    """Without a verdict the heading is the config's name, then its own sentence; the best estimators come first.

    An estimator and its copy are not told apart; what the claims need is the last section.
    """
    text = config({"name": "ball-bar", "estimators": ["gdke", "lls", "mle"]}, trials=300, samples=100, angle=[40, 180])
    run = make_run("# Which fit for our ball bar?\n" + text)
    page = render(Material([run], make_claims((Verdict.NOT_EVALUATED, {"reads": "paper/errors"}))))
    document = read(page)
    assert "<h1>ball-bar</h1>" in page
    assert "Knight" not in document.text.split("Words and symbols")[0]
    opening = document.text.split("Explore every number")[0]
    assert opening.index("Which fit for our ball bar?") < opening.index("Best over all conditions: MLE.")
    bests = re.findall(r"φ = \d+°: ([^;.]*)[;.]", opening)
    assert len(bests) == 2
    assert all(("LLS" in best) == ("GDKE" in best) for best in bests)
    assert "Not ok by their own status:" in opening
    assert document.text.rindex("These runs can judge none of the claims.") > document.text.rindex("Provenance")


@pytest.mark.usefixtures("no_figures")
def test_a_long_list_of_estimators_is_cut(make_run, make_claims, read):
    """A finding names six estimators in a row at most, and says how many more there are, and how far they are off."""
    names = ["gdke", "lls", "lls_nr", "mle", "als", "fuller", "taubin", "pratt", "hyper", "ugdk_cov", "corrected"]
    text = config({"name": "ball-bar", "estimators": names}, trials=300, samples=1000, angle=[20, 50], noise=0.02)
    opening = read(render(Material([make_run(text)], make_claims()))).text.split("Explore every number")[0]
    rows = re.findall(r"(?:Best over all conditions|φ = \d+°): ([^;.]*)[;.]", opening)
    rows += re.findall(r"of all estimators, [\d.]+ times at worst; (.*?)\. [A-Z]", opening)
    assert len(rows) == 4
    for row in rows:
        named = len(re.split(r", (?!up|which)|; | or ", row))
        more = re.search(r"(\d+) more", row)
        assert named == 6 if more else named <= 6
    assert any("more" in row for row in rows)


@pytest.mark.usefixtures("no_figures")
def test_an_unknown_verdict_is_shown_as_it_is(random, make_claims, read):
    """A verdict that a later version adds has a badge too."""
    document = read(render(Material([random], make_claims(("hardly", {})))))
    assert "1 claim: 1 hardly" in document.text


def section(document, run, name):
    """The words of a part of a run's section."""
    titles = ["Error against the bound", "How the fits ended", "The worst trials", "Time", "Provenance", "Run "]
    text = document.text.split(f"Run {run.study.run_name()}")[-1]
    return text[text.index(titles[name]) : text.index(titles[name + 1])] if name < 4 else text[text.index(titles[4]) :]


def test_efficiency(document, circles, random):
    """Medians of the summary, with errors and what is not ok; fixed conditions are said once."""
    frame = circles.table("summary")
    text = section(document, circles, 0)
    assert "At least 60 trials a row, all at σ/r = 0.025, φ = 40°, r = 2, |c| = 1." in text
    row = frame[(frame["samples"] == 80) & (frame["estimator"] == "mle")].iloc[0]
    assert f"{row['ratio_median']:.2f}"[:3] in text
    assert text.count("±") >= 1 + len(frame)
    text = section(document, random, 0)
    assert "σ/r from trials MLE GDKE UGDK " in text
    assert "% not ok" in text
    assert "100 % not ok" in text.replace("\u00a0", " ")


def test_statuses(document, circles, random):
    """Counts of what was planned, ok, and anything else that occurs, in words."""
    frame = random.table("summary")
    failed = int(frame["not_positive_definite"].sum())
    assert failed > 0
    text = section(document, random, 1)
    assert f"covariance minus noise is not positive definite: the noise hides the sphere's extent 0 0 {failed} " in text
    assert Status.SINGULAR.text not in text
    assert "planned 240 240 240 240 ok 240 240 240 240 " in section(document, circles, 1)


def test_worst_trials(document, circles):
    """The worst first, each with the command that draws it again, quoted for a shell."""
    worst = circles.table("errors").query("status == 0").assign(ratio=lambda t: t["error"] / t["bound"])
    first = worst.sort_values("ratio").iloc[-1]
    text = section(document, circles, 2)
    assert text.count("study replay") == 5
    assert f"study replay {circles.folder} {first['cell']} {first['trial']}" in text
    assert text.index(str(first["cell"])) < text.index("study replay")


def test_times(document, circles):
    """Every step of the timing table, with what it costs per sample."""
    text = section(document, circles, 3)
    frame = circles.table("timings")
    mle = frame[frame["step"] == "mle"]
    per_sample = 1e9 * mle["seconds"].sum() / (mle["fits"] * mle["samples"]).sum()
    assert " ".join(f"MLE 240 {timed(mle['seconds'].sum())} {timed(per_sample)} ".split()) in text
    assert "moments, shared by all estimators" in text
    assert "Nanoseconds per sample, by the number of samples" in text


def test_provenance(document, page, circles, random):
    """Versions, commit, machine, threads, digest, the config as it is, and how to run it again."""
    manifest = circles.manifest()
    text = section(document, random, 4)
    for words in (
        manifest["software"]["commit"] or "not run from a checkout",
        f"numpy {manifest['software']['packages']['numpy']}",
        manifest["machine"]["processor"],
        manifest["machine"]["system"],
        random.study.digest(),
        f"study run {random.folder}/config.toml --jobs 1 --out {random.folder}-again",
    ):
        assert str(words) in text
    config = (random.folder / "config.toml").read_text(encoding="utf-8")
    assert config.startswith("\n")  # which a reader of HTML drops, directly after <pre>
    assert f"<pre>\n{config.replace(chr(34), '&#34;')}</pre>" in page


def test_what_a_user_wrote_is_text(document, page):
    """A script in a comment is shown, and is none."""
    assert """# a config with <script>alert("1 < 2 && 'x'")</script> & more""" in document.text
    assert not re.search(r"<script[^>]*>alert", page)
    assert "&lt;script&gt;alert" in page


@pytest.mark.usefixtures("no_figures")
def test_folders_of_any_name(make_run, circles, claims, tmp_path, read):
    """Names with spaces, quotes and tags are quoted for the shell and for the page."""
    folder = tmp_path / "a b; <b>'s"
    shutil.copytree(circles.folder, folder)
    page = render(Material([Run.open(folder)], claims))
    document = read(page)
    assert document.faults == []
    assert not document.of("b")
    assert f"""study replay '{tmp_path}/a b; <b>'"'"'s' """ in document.text
    assert """--out '""" in document.text


@pytest.mark.usefixtures("no_figures")
def test_many_conditions(many, claims, read):
    """A table longer than a page is folded, and not printed."""
    page = render(Material([many], claims))
    document = read(page)
    assert document.faults == []
    assert "The table of all 44 conditions" in document.text
    assert '<details class="screen">' in page
    assert "ALS (Fuller)" in document.text


@pytest.mark.usefixtures("no_figures")
def test_more_conditions_than_a_page_can_hold(circles, claims, monkeypatch, read):
    """Then the file is named that has them."""
    monkeypatch.setattr("study.simulation.report.runs._TOO_LONG", 3)
    document = read(render(Material([circles], claims)))
    assert "too many conditions for a table; summary.parquet has them" in document.text


AGAIN = """
import sys
from pathlib import Path
import pandas as pd
from study.simulation import figures
from study.simulation.report.material import Material
from study.simulation.report.page import render, save
from study.simulation.runs.run_folder import Run
figures.FIGURES = {"fig5_methods": figures.FIGURES["fig5_methods"]}
folder, claims, out = map(Path, sys.argv[1:])
save(render(Material([Run.open(folder)], pd.read_pickle(claims))), out)
"""


def test_equal_runs_equal_bytes(circles, claims, tmp_path, monkeypatch):
    """Another process, with another hash seed, time zone, language and a user's own plot settings, writes the same.

    One figure is enough here: `test_draw_all` has all of them by another process.
    """
    monkeypatch.setattr("study.simulation.figures.FIGURES", {"fig5_methods": FIGURES["fig5_methods"]})
    claims.to_pickle(tmp_path / "claims")
    (tmp_path / "matplotlibrc").write_text("font.size: 20\nsavefig.dpi: 30\n", encoding="utf-8")
    changed = {"PYTHONHASHSEED": "7", "TZ": "Asia/Tokyo", "LC_ALL": "C", "MATPLOTLIBRC": str(tmp_path)}
    arguments = [circles.folder, tmp_path / "claims", tmp_path / "page.html"]
    command = [sys.executable, "-W", "error", "-c", AGAIN, *map(str, arguments)]
    subprocess.run(command, check=True, env={**os.environ, **changed})
    assert (tmp_path / "page.html").read_bytes() == render(Material([circles], claims)).encode()


@pytest.mark.usefixtures("no_figures")
@pytest.mark.parametrize("name", ["errors", "summary", "timings", "points"])
def test_a_table_that_is_missing(circles, claims, tmp_path, name):
    """A run that did not finish has no page; the message says what is missing, in one line."""
    shutil.copytree(circles.folder, tmp_path / "half")
    (tmp_path / "half" / f"{name}.parquet").unlink()
    with pytest.raises(RunError, match=rf"half/{name}\.parquet: missing; finish the run with `study run .*`$"):
        render(Material([Run.open(tmp_path / "half")], claims))


def test_save(tmp_path):
    """A page is written whole, folders are made, and names that are no text do no harm."""
    path = tmp_path / "a" / "b.html"
    assert save("± \udcff", path) == path
    assert path.read_text(encoding="utf-8") == "± ?"
    assert [file.name for file in path.parent.iterdir()] == ["b.html"]


def test_a_row_that_does_not_fit():
    """A table's row with a cell too few is refused, instead of shifting columns."""
    with pytest.raises(ValueError, match="numbers: a row has not 2 cells"):
        html.table("numbers", "", ["a", "b"], [["1"]])


def test_what_is_no_markup_is_escaped():
    """In text, in names of places and in cells; markup stays as it is, and braces are text."""
    text = html.paragraph(["<b> & {} ", html.link("<a>", '"x"')])
    assert text == '<p>&lt;b&gt; &amp; {} <a href="#&#34;x&#34;">&lt;a&gt;</a></p>'
    table = html.table('"n"', "<c>", ["<h>"], [["<r>"]], ids=["<i>"], look="stacked")
    for text in ('aria-label="&#34;n&#34;"', "&lt;c&gt;", "&lt;h&gt;", "&lt;r&gt;", 'id="&lt;i&gt;"'):
        assert text in table
    assert not re.findall("<[chri]>", table)


def rows_of(text, label):
    """Texts of the cells of a table of the page, row by row."""
    part = text.split(f'aria-label="{label}"')[1].split("</table>")[0]
    rows = re.findall(r"<tr.*?</tr>", part, re.DOTALL)
    cells = [re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row, re.DOTALL) for row in rows]
    return [[re.sub(r"<[^>]*>", "", cell) for cell in row] for row in cells]


def test_readings(circles, make_claims, no_figures):
    """Every claim has a row, every other reading a column; what changes is framed and told with the claim."""
    main = {
        "name": "ugdk-closest",
        "finding": "share: 0\nlevel: 0.5\nover: 0.5\nworst: 26 ± 7\ncloser: 0\nfarther: 0.46",
    }
    claims = make_claims((Verdict.NOT_REPRODUCED, main), (Verdict.IN_PART, {"name": "one-line"}))
    choices = read_choices(shipped_config("readings"))
    table = pd.DataFrame(
        [
            ("noise-law", "radial", 1, "ugdk-closest", "reproduced", "not reproduced", 0.5, 0.0, 9, "a share: 0.46"),
            ("noise-law", "radial", 2, "one-line", "in part", "in part", 0.5, 0.1, 9, "an exponent: 1 ± 0.1"),
        ],
        columns=list(COLUMNS),
    )
    text = render(Material([circles], claims, readings=Readings(choices, table)))
    assert "1 verdicts stand under every reading, 1 change under some." in text
    assert "Read otherwise: it holds if the noise is along the radius." in text
    head, *lines = rows_of(text, "Claims under each reading")
    assert len(head) == sum(len(choice.reading) - 1 for choice in choices) + 2
    assert [line[:3] for line in lines] == [["1 ugdk-closest", "no", "yes"], ["2 one-line", "part", "part"]]
    assert set(lines[0][3:]) == {"·"}
    _, first, *others = rows_of(text, "Choices that the paper leaves open")
    assert len(others) == len(choices) - 1
    assert "1b: along the radius alone" in first[3]
    assert "The paper read otherwise" not in render(Material([circles], claims))
