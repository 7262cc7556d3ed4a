"""The replication report: tables follow the stored ones, it is typeset, and its metadata keep the rules.

Its numbers have mutants in `test_numbers`, with those of all documents.
"""

import importlib
import json
import re
import sys
from pathlib import Path

import pytest

import study
from study.simulation.analysis import archive

yaml = pytest.importorskip("yaml", reason="PyYAML reads the metadata")
typst = pytest.importorskip("typst", reason="Typst typesets the report")
ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def article():
    """The script that makes the report, and the numbers of the documents."""
    sys.path.insert(0, str(ROOT / "tools"))
    try:
        return importlib.import_module("make_article")
    finally:
        sys.path.remove(str(ROOT / "tools"))


@pytest.fixture(scope="module")
def bound(article):
    return article.bound_numbers.Bound()


@pytest.fixture(scope="module")
def text(article):
    return (ROOT / article.TEXT).read_text(encoding="utf-8")


def test_what_looks_measured_is_bound(article, bound, text):
    """A further number in the text is found."""
    faults, _ = bound.faults(article.TEXT, text + "\nThe error is 3.5 ± 0.2, or 12 % more.\n")
    assert [re.search(r": (.*) looks", fault)[1] for fault in faults] == ["3.5 ± 0.2", "12 %"]
    assert bound.faults(article.TEXT, text)[0] == []


@pytest.mark.parametrize(
    ("table", "column", "name"),
    [
        ("verdicts", "finding", "claims"),
        ("published", "mse", "published"),
        ("efficiency", "ratio_median", "grid"),
        ("regret", "median", "regret"),
    ],
)
def test_tables_follow_the_stored_ones(article, bound, table, column, name):
    """A changed value is another cell of the report's table."""
    frame = bound.table(table).copy()
    frame[column] = frame[column].str.replace("0.", "7.") if column == "finding" else 1.37 * frame[column]
    copy = article.bound_numbers.Bound()
    copy.table = lambda other: frame if other == table else bound.table(other)
    before, after = article.tables(bound), article.tables(copy)
    assert [key for key in before if before[key] != after[key]] == [name]


def test_it_is_typeset(article, bound, tmp_path):
    """Ten pages or fewer, and a supplement, as images of the pages, from a copy of what the text reads."""
    for name in ("article", "figures"):
        (tmp_path / name).symlink_to(ROOT / name)
    (tmp_path / "results" / "article").mkdir(parents=True)
    (tmp_path / "results" / "article" / "tables.json").write_text(json.dumps(article.tables(bound)))
    for name, least, most in ((article.TEXT, 6, 10), (article.SUPPLEMENT, 2, 8)):
        source = (ROOT / name).read_text(encoding="utf-8")
        (tmp_path / "text.typ").write_text(source.replace('"references.yml"', '"/article/references.yml"'))
        pages = typst.compile(tmp_path / "text.typ", root=tmp_path, format="png", ppi=30)
        assert least <= len(pages) <= most
        assert all(page.startswith(b"\x89PNG") for page in pages)


def test_version_title_and_authors_agree(article, text):
    """The citation, the package, the report and its metadata have one version, one group of authors and one paper."""
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert citation["version"] == study.__version__
    assert [author["name"] for author in citation["authors"]] == [
        author["name"] for author in article.DEPOSIT["authors"]
    ]
    assert article.DEPOSIT["authors"][0]["name"] in text
    paper = citation["preferred-citation"]
    assert article.title(text) == f"[Re] {paper['title']}"
    assert paper["url"] == article.DEPOSIT["paper"]["url"]
    assert citation["title"].partition(":")[0] == "sphere-fit-study"
    assert archive.citation() == (ROOT / "CITATION.cff").read_text(encoding="utf-8")


def fields(value):
    """Every text in a YAML document."""
    if isinstance(value, dict | list):
        for entry in value.values() if isinstance(value, dict) else value:
            yield from fields(entry)
    else:
        yield str(value)


def test_codecheck(article, text):
    """The stored file is what the script writes, and keeps the rules of CODECHECK 2.0 that a program can keep.

    Rules: CC-CFG-001 to 007, 014 to 019, 023, 027 to 030; CC-BUN-001.
    """
    stored = (ROOT / "codecheck.yml").read_text(encoding="utf-8")
    assert stored == article.codecheck(text)
    assert stored.startswith("---\n")
    told = yaml.safe_load(stored)
    assert told["version"] == "https://codecheck.org.uk/spec/config/2.0/"
    assert told["paper"]["title"]
    assert all(author["name"] for author in told["paper"]["authors"])
    assert all(url.startswith("https://") for url in told["paper"]["reference-other"])
    for entry in told["manifest"]:
        assert not Path(entry["file"]).is_absolute()
        assert (ROOT / entry["file"]).is_file()
        assert entry["comment"]
    assert not [words for words in fields(told) if re.search("FIXME|TODO|XXX", words)]
    assert not {"codechecker", "report", "summary", "certificate"} & set(told)  # the checker's


def test_nothing_is_invented(article, text):
    """No ORCID and no DOI is in the metadata; the script says what is left to a person."""
    for words in (article.codecheck(text), article.metadata(text), (ROOT / "CITATION.cff").read_text()):
        assert not re.search(r"\d{4}-\d{4}-\d{4}-\d{3}[\dX]|10\.\d{4,}/", words)
        assert yaml.safe_load(words)
    open_items = " ".join(article.DEPOSIT["open"])
    for rule in ("CC-CFG-020", "CC-CFG-021", "ORCID", "DOI"):
        assert rule in open_items


def test_metadata(article, text, monkeypatch):
    """ReScience C's fields: the title says it is a replication, the code has its identifiers, the abstract is whole."""
    ids = {"revision": f"swh:1:rev:{'a' * 40}", "directory": f"swh:1:dir:{'b' * 40}"}
    monkeypatch.setattr(article, "swhids", lambda: ids)
    told = yaml.safe_load(article.metadata(text))
    assert re.match(r"\[(Re|¬Re)\] ", told["title"])
    assert told["type"] == "Replication"
    assert [code["swh"] for code in told["code"]] == list(ids.values())
    assert told["abstract"].startswith("Knight and Semwal")
    assert told["abstract"].endswith(".")
