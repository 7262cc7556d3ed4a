"""The documents: their links lead somewhere, and the site lists every page; the examples of docstrings are run."""

import doctest
import inspect
import itertools
import json
import re
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

import study
from study.fits import registry
from study.fits.loops.jit import COMPILING
from study.simulation.library import Headway
from study.simulation.runs import schemas

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tools"))
import run_blocks  # noqa: E402
import sentences  # noqa: E402

sys.path.remove(str(ROOT / "tools"))
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/*.md")])
NAMES = [str(path.relative_to(ROOT)) for path in PAGES]
FENCED = re.compile(r"^```.*?^```", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\]\((?!\w+:)([^)\s#]*)(?:#([^)\s]*))?\)")


def anchors(path):
    """Anchors of a page's headings, as GitHub and the site make them."""
    text = FENCED.sub("", path.read_text(encoding="utf-8"))
    headings = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading).strip().lower().replace(" ", "-") for heading in headings}


def python_blocks(name):
    """The blocks of Python of a page."""
    return re.findall(r"^```python\n(.*?)^```$", (ROOT / name).read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)


def dead(path, text):
    """Links of a page that lead nowhere."""
    for target, anchor in LINK.findall(FENCED.sub("", text)):
        place = (path.parent / target).resolve() if target else path
        if not place.exists() or (anchor and place.suffix == ".md" and anchor not in anchors(place)):
            yield f"{target}#{anchor}"


@pytest.mark.parametrize("path", PAGES, ids=NAMES)
def test_links_lead_somewhere(path):
    """Every link from a document to a file of the repository, or to a heading, finds it."""
    assert list(dead(path, path.read_text(encoding="utf-8"))) == []


def test_dead_links_are_found():
    """The search finds a missing file and a missing heading, and leaves links to other sites alone."""
    page = ROOT / "docs" / "index.md"
    text = "[a](nowhere.md) [b](theory.md#nothing) [c](https://example.org/x) [d](theory.md)"
    assert list(dead(page, text)) == ["nowhere.md#", "theory.md#nothing"]


def test_what_contributing_names_is_there():
    """A file that it names exists, and a name of a class or a table stands in the code."""
    named = re.findall(r"`([^`\n]+)`", (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8"))
    files = [name for name in named if re.fullmatch(r"(study|tests|docs|configs|article)/[\w./-]*", name)]
    sources = [*ROOT.glob("study/**/*.py"), *ROOT.glob("tests/**/*.py")]
    code = "\n".join(path.read_text(encoding="utf-8") for path in sources)
    words = [name for name in named if re.fullmatch(r"_?[A-Z]\w+", name)]
    assert len(files) > 30
    assert len(words) > 10
    assert [name for name in files if not (ROOT / name).exists()] == []
    assert [name for name in words if not re.search(rf"\b{name}\b", code)] == []


def test_outputs_in_the_readme_are_those_of_a_page_that_is_run():
    """Each line that the README says a command prints stands in a page of the site, whose commands are run.

    The points of the README are those that the tutorial makes, in a file of the repository.
    """
    pages = "\n".join(path.read_text(encoding="utf-8") for path in ROOT.glob("docs/*.md"))
    blocks = re.findall(r"(?:^ {4}.*\n|^\n)+", (ROOT / "README.md").read_text(encoding="utf-8"), re.MULTILINE)
    shown = [line.strip() for block in blocks if "    $ " in block for line in block.splitlines() if line.strip()]
    assert len(shown) > 5
    assert [
        line for line in shown if line.replace("$ .venv/bin/", "$ ").replace("docs/points", "points") not in pages
    ] == []


def test_the_points_of_the_readme_are_those_of_the_tutorial(tmp_path, monkeypatch):
    """The first block of the tutorial writes the file that the repository has."""
    monkeypatch.chdir(tmp_path)
    exec(python_blocks("docs/fitting.md")[0], {})
    assert (tmp_path / "points.csv").read_bytes() == (ROOT / "docs" / "points.csv").read_bytes()


def test_the_python_of_the_readme_runs_as_printed(monkeypatch, capsys):
    """It fits the true sphere of the tutorial, centre (10, -4, 120) and radius 25, within three of its errors."""
    monkeypatch.chdir(ROOT)
    names = {}
    (block,) = python_blocks("README.md")
    exec(block, names)
    fit = names["fit"]
    off = [*fit.center - [10.0, -4.0, 120.0], fit.radius - 25.0] / fit.standard_errors
    assert abs(off).max() < 3.0
    assert "ok" in capsys.readouterr().out


TABLES = ROOT / "docs" / "tables.md"


def test_the_page_of_tables_has_them_all():
    """Every table that a run may have stands there, with its columns, which `tools/run_blocks.py` keeps up to date."""
    text = TABLES.read_text(encoding="utf-8")
    for name, columns in schemas.declared(3).items():
        (made,) = re.findall(rf"<!-- made: table_{name} -->\n(.*?)<!-- end -->", text, re.DOTALL)
        cells = re.findall(r"^\| (`.*?) \|", made, re.MULTILINE)
        assert sorted(re.findall(r"`(\w+)`", " ".join(cells))) == sorted(column.name for column in columns)
        assert f"`{name}.parquet`" in text


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    """A folder with the run of the page of tables."""
    folder = tmp_path_factory.mktemp("swept")
    (text,) = re.findall(r"^```toml\n(.*?)^```", TABLES.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    (folder / "mine.toml").write_text(text, encoding="utf-8")
    study.run(folder / "mine.toml", folder=folder / "results" / "mine-0")
    return folder


@pytest.mark.parametrize(("package", "language"), [("polars", "python"), ("duckdb", "sql")])
def test_other_programs_read_the_tables(swept, monkeypatch, package, language):
    """The page's lines for another program give the medians that pandas gives."""
    other = pytest.importorskip(package)
    blocks = re.findall(rf"^```{language}\n(.*?)^```", TABLES.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    (code,) = [block for block in blocks if f"import {package}" in block or language == "sql"]
    monkeypatch.chdir(swept)
    if language == "sql":
        rows = other.sql(code).fetchall()
    else:
        printed = []
        exec(code, {"print": printed.append})
        rows = printed[0].rows()
    errors = study.read_run("results/mine-0").errors
    ratio = (errors["error"] / errors["bound"]).fillna(np.inf)
    medians = ratio.groupby([errors["angle"], errors["estimator"].astype(str)]).median()
    assert {row[:2]: row[2] for row in rows} == pytest.approx(medians.to_dict(), rel=1e-12)


def test_what_commands_print_on_a_slow_machine_is_not_compared():
    """A line of progress comes once a minute, and one about the compiler once after an installation."""
    now = itertools.count(100.0, 70.0)  # each look at the clock is 70 s after the one before
    lines = []
    headway = Headway(lines.append, lambda: next(now))
    headway.add(0.25, 3, 1_200)
    headway.add(0.5)
    assert len(lines) == 2
    assert all(run_blocks.WAITING.match(f"mine-a998cf00cc: {line}") for line in lines)
    assert run_blocks.WAITING.match(COMPILING)
    assert not run_blocks.WAITING.match("mine-a998cf00cc: 4 cells, 200 trials")


def test_documents_without_a_fault_end_with_code_0(monkeypatch):
    """An empty text would be code 1."""
    monkeypatch.setattr(sys, "argv", ["run_blocks.py", "--made", str(ROOT / "docs" / "index.md")])
    with pytest.raises(SystemExit) as end:
        run_blocks.main()
    assert end.value.code is None


def test_the_site_lists_every_page():
    """Every page of docs/ stands in the navigation, and everything there is a page."""
    listed = set(re.findall(r": ([\w-]+\.md)$", (ROOT / "mkdocs.yml").read_text(encoding="utf-8"), re.MULTILINE))
    outside = {"CONTRIBUTING.md", "CODE_OF_CONDUCT.md", "CHANGELOG.md"}
    assert listed == {path.name for path in ROOT.glob("docs/*.md")} | outside


def test_the_readme_is_short_and_shows_a_picture_after_the_commands():
    """At most 900 words; the commands come before the only picture, and what was found after it."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len(text.split()) <= 900
    assert text.count("![") == 1
    commands = ["    make paper", "    make test", "    pip install .", "    study fit docs/points.csv"]
    order = [*commands, "![", "## What was found"]
    places = [text.find(part) for part in order]
    assert -1 not in places
    assert places == sorted(places)


def test_every_page_says_in_its_first_line_who_needs_it():
    """The line below the heading begins "For you if", in italics."""
    opens = re.compile(r"# .+\n\n\*For you if .+\*")
    assert [path.name for path in ROOT.glob("docs/*.md") if not opens.match(path.read_text(encoding="utf-8"))] == []


def test_the_documents_are_no_longer_than_they_need_to_be():
    """The pages of docs/ and the README, with tables and outputs: what is new takes the place of something old."""
    pages = [*ROOT.glob("docs/*.md"), ROOT / "README.md"]
    assert sum(sentences.length(path.read_text(encoding="utf-8")) for path in pages) <= 36_000


@pytest.mark.parametrize("path", sentences.paths(), ids=lambda path: path.name)
def test_sentences_are_short(path):
    """At most 20 words on average, and at most a tenth above 30; tools/sentences.py prints those."""
    page = sentences.page(path.read_text(encoding="utf-8"))
    assert len(page.sentences) > 5
    assert page.mean <= 20.0
    assert page.long <= 0.1


def test_sentences_are_counted_in_prose():
    """Not in blocks, tables, headings and pictures; a link counts by its words, an item of a list by itself."""
    long = " ".join(["word"] * 31)
    text = (
        "# A heading. Of two\n\nOne [link of words](a.md). A second, by Kåsa et al. 1976?\n\n"
        "```text\nA block. Of two.\n```\n\n| a table | of words |\n\n    printed. Twice.\n\n"
        f"- An item: 1.5 m\n- {long}.\n\n![A picture](b.png)\n<!-- table: x -->\n"
    )
    page = sentences.page(text)
    assert page.sentences[:3] == ["One link of words.", "A second, by Kåsa et al. 1976?", "- An item: 1.5 m"]
    assert [sentences.length(one) for one in page.sentences] == [4, 7, 4, 31]
    assert page.mean == (4 + 7 + 4 + 31) / 4
    assert page.long == 0.25
    assert page.words == len(text.split())


BARE = re.compile(r"(?<![\w.\\*\])}])\.\d")
"""A decimal without a zero before its point."""


@pytest.mark.parametrize("path", sentences.paths(), ids=lambda path: path.name)
def test_decimals_have_a_zero(path):
    """In prose and in tables; code and what commands print are as they are."""
    text = re.sub(r"^```(?!math).*?^```|^ {4}.*?$|`[^`\n]*`", "", path.read_text(encoding="utf-8"), flags=re.M | re.S)
    assert [text[one.start() - 20 : one.end() + 10] for one in BARE.finditer(text)] == []


def test_the_site_names_no_other_server():
    """Its settings take fonts, scripts and search from the site itself."""
    settings = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    assert re.findall(r"https?://\S+", settings) == []
    assert "font: false" in settings
    assert re.search(r"^ +- offline$", settings, re.MULTILINE)
    (script,) = re.findall(r"polyfills: \[(\S+)\]", settings)
    assert "iframe-worker" in script  # the offline plugin takes its own from a server unless one has this name
    assert (ROOT / "docs" / script).exists()


def test_displayed_formulas_of_theory_are_in_latex():
    """None is left as indented text; rows in gather* end in two backslashes, and no number stands twice."""
    text = (ROOT / "docs" / "theory.md").read_text(encoding="utf-8")
    assert re.findall(r"^    \S.*$", text, re.MULTILINE) == []
    formulas = re.findall(r"^```math\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    assert formulas
    for formula in formulas:
        first, *rows = formula.splitlines()
        if first == r"\begin{gather*}":
            assert rows[-1] == r"\end{gather*}"
            assert all(row.endswith(r"\\") for row in rows[:-2])
        else:
            assert rows == []
    numbers = re.findall(r"\\tag\{(.*?)\}", text)
    assert len(numbers) == len(set(numbers))


def test_formulas_in_the_text_of_theory_are_in_latex():
    """Between dollars, on one line; no index or exponent stands outside of them and of code."""
    text = FENCED.sub("", (ROOT / "docs" / "theory.md").read_text(encoding="utf-8"))
    text = re.sub(r"`[^`\n]*`", "", text)
    assert len(re.findall(r"\$[^$\n]+\$", text)) > 300
    rest = re.sub(r"\$[^$\n]+\$", "", text).replace("NOT_CONVERGED", "")
    assert re.findall(r".*[$_^\\].*", rest) == []


CALLED = (inspect.isclass, inspect.isfunction)
PUBLIC = [name for name in study.__all__ if any(is_kind(getattr(study, name)) for is_kind in CALLED)]
OPTIONS = doctest.NORMALIZE_WHITESPACE | doctest.DONT_ACCEPT_TRUE_FOR_1


def test_public_names():
    """Each is there, is offered before it is imported, and has a docstring, but for a table and the version."""
    assert set(study.__all__) - set(PUBLIC) == {"ESTIMATORS", "__version__"}
    assert "study.fit" in inspect.getdoc(study.ESTIMATORS)  # its own, not that of a dictionary
    assert set(study.__all__) <= set(dir(study))
    assert "import_module" not in dir(study)
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = study.nothing


@pytest.mark.parametrize("name", PUBLIC)
def test_example(name, monkeypatch, tmp_path):
    """The docstring of a name, or one of its public methods, has an example, and all of them are right.

    They stand below "Examples:"; the site shows others as quotations.
    """
    monkeypatch.chdir(tmp_path)
    examples = doctest.DocTestFinder(recurse=True).find(getattr(study, name), name, globs={})
    assert any(test.name == name and test.examples for test in examples)
    assert [
        test.name for test in examples if test.examples and "\nExamples:\n" not in inspect.cleandoc(test.docstring)
    ] == []
    lines = []
    for test in examples:
        doctest.DocTestRunner(optionflags=OPTIONS).run(test, out=lines.append)
    registry.remove(["centroid"])  # of the example of `study.register`
    assert "".join(lines) == ""


@pytest.mark.parametrize("name", ["points", "study"])
def test_notebooks_run(tmp_path, monkeypatch, capsys, name):
    """Their cells run one after the other, and print what is stored; pictures and tables are not compared."""
    (tmp_path / "docs").mkdir()
    (tmp_path / "examples").mkdir()
    shutil.copy(ROOT / "docs" / "points.csv", tmp_path / "docs")
    monkeypatch.chdir(tmp_path / "examples")
    names = {}
    for cell in json.loads((ROOT / "examples" / f"{name}.ipynb").read_text(encoding="utf-8"))["cells"]:
        if cell["cell_type"] == "code":
            exec("".join(cell["source"]), names)
            stored = ["".join(output["text"]) for output in cell["outputs"] if output["output_type"] == "stream"]
            assert capsys.readouterr().out == "".join(stored)
