"""Typeset the replication report: `make article` writes results/article.pdf, a supplement, metadata, codecheck.yml.

The text is article/article.typ, whose numbers tools/bound_numbers.py compares with the stored tables first. Its tables
are made here from the same stored tables. No file is fetched: the compiler of Typst and its fonts come with the Python
package. `metadata.yaml` has the fields of ReScience C, and `codecheck.yml` those of CODECHECK 2.0, as far as a program
knows them. What only a person can give is left out, and printed.
"""

import json
import re
import sys
import tomllib
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import bound_numbers
import pandas as pd
import typst
import yaml
from number_tables import share_of

from study.simulation.report.material import answer
from study.simulation.runs.provenance import swhids

ROOT = Path(__file__).resolve().parents[1]
TEXT, SUPPLEMENT = "article/article.typ", "article/supplement.typ"
DOCUMENTS = ["published", "grid", "regret", "choices", "readings", "readings_changed"]
"""Tables that are made as those of the documents are; all but ``readings`` stand there, too."""
FIGURES = ["fig2_error", "fig3_gdke_ellipse", "fig4_ugdk_ellipse", "fig_efficiency"]
"""Figures of the report."""
DEPOSIT = tomllib.loads((ROOT / "article" / "deposit.toml").read_text(encoding="utf-8"))
"""Words of the metadata, files to check, and what only a person can give."""
as_yaml = partial(yaml.safe_dump, sort_keys=False, allow_unicode=True, width=120)


def claims(table: pd.DataFrame) -> Iterator[list[str]]:
    """Statements, the sentence that answers each, and verdicts."""
    yield ["", "§", "statement", "answer", "share", "verdict"]
    for row in table.itertuples():
        said = answer(row.name, row.verdict, row.finding) if row.value == row.value else "It needs a recording."
        yield [str(row.number), row.section, row.statement, said, share_of(row), row.verdict]


def tables(bound: bound_numbers.Bound) -> dict[str, object]:
    """Everything that the text takes from stored tables, by name."""
    rows = {name: [row for row in bound.rows(name) if not isinstance(row, str)] for name in DOCUMENTS}
    run = json.loads((ROOT / "results" / "paper" / "manifest.json").read_text(encoding="utf-8"))["software"]
    source = f"Main study: sphere-fit-study {run['study']}, commit {run['commit'][:10]}, Python {run['python']}."
    drawn = {name: f"/figures/{name}.svg" for name in FIGURES}
    figures = {name: path if (ROOT / path[1:]).exists() else f"/figures/{name}.png" for name, path in drawn.items()}
    return rows | {"claims": list(claims(bound.table("verdicts"))), "source": source, "figures": figures}


def title(text: str) -> str:
    """The title of the report."""
    return re.search(r'#let title = "(.*)"', text)[1]


def metadata(text: str) -> str:
    """The fields of ReScience C, from the report's text."""
    words = re.search(r"\*Abstract\.\* (.*?)\n\]", text, re.DOTALL)[1]
    code = [{"swh": identifier} for identifier in swhids().values() if identifier]
    entries = {"title": title(text), "authors": DEPOSIT["authors"], "keywords": DEPOSIT["keywords"], "code": code}
    entries |= {"replication": [DEPOSIT["paper"]], "abstract": " ".join(words.split()), "type": "Replication"}
    return as_yaml(entries | {"domain": DEPOSIT["domain"], "language": "Python"})


def codecheck(text: str) -> str:
    """The file by which CODECHECK finds what to compare."""
    paper = {"title": title(text), "authors": DEPOSIT["authors"], "reference-other": [DEPOSIT["paper"]["url"]]}
    manifest = [{"file": file, "comment": comment} for file, comment in DEPOSIT["checked"].items()]
    return "---\n" + as_yaml({"version": DEPOSIT["specification"], "paper": paper, "manifest": manifest})


def main() -> None:
    """Check the numbers, make the tables, typeset, and say what is open."""
    bound, text = bound_numbers.Bound(), (ROOT / TEXT).read_text(encoding="utf-8")
    faults, _ = bound.faults(TEXT, text)
    if faults:
        sys.exit("\n".join(map(str, faults)))
    results = ROOT / "results"
    (results / "article").mkdir(parents=True, exist_ok=True)
    made = json.dumps(tables(bound), ensure_ascii=False, indent=1)
    (results / "article" / "tables.json").write_text(made, encoding="utf-8")
    for name in (TEXT, SUPPLEMENT):
        (results / f"{Path(name).stem}.pdf").write_bytes(typst.compile(ROOT / name, root=ROOT))
    (results / "metadata.yaml").write_text(metadata(text), encoding="utf-8")
    (ROOT / "codecheck.yml").write_text(codecheck(text), encoding="utf-8")
    print("results/article.pdf, results/supplement.pdf, results/metadata.yaml, codecheck.yml\nLeft to a person:")
    print("\n".join(f"  {words}" for words in DEPOSIT["open"]))


if __name__ == "__main__":
    main()
