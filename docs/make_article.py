"""Typeset the replication report: `make article` writes results/article.pdf, results/metadata.yaml and codecheck.yml.

The text is article/article.typ, whose numbers docs/bound_numbers.py compares with the stored tables first. Its tables
are made here from the same stored tables. No file is fetched: the compiler of Typst and its fonts come with the Python
package. `metadata.yaml` has the fields of ReScience C, and `codecheck.yml` those of CODECHECK 2.0, as far as a program
knows them. What only a person can give is left out, and printed.
"""

import json
import re
import sys
import tomllib
from pathlib import Path

import bound_numbers
import number_tables
import pandas as pd
import typst

from study.simulation.runs.provenance import swhids
from study.text import with_error

ROOT = Path(__file__).resolve().parents[1]
TEXT = "article/article.typ"
DOCUMENTS = ["published", "decades", "regret"]
"""Tables that the documents have, too."""
with open(ROOT / "article" / "deposit.toml", "rb") as _file:
    DEPOSIT = tomllib.load(_file)
"""Words of the metadata, files to check, and what only a person can give."""


def cells(markdown: str) -> list[list[str]]:
    """Cells of a table of Markdown, its title row first."""
    rows = [[cell.strip() for cell in line.strip().strip("|").split("|")] for line in markdown.strip().splitlines()]
    return rows[:1] + rows[2:]


def claims(table: pd.DataFrame) -> list[list[str]]:
    """Statements, the first quantity of each with its error, and verdicts."""
    rows = [["", "§", "statement", "found", "verdict"]]
    for row in table.to_dict("records"):
        found = with_error(row["value"], row["error"]) if row["error"] > 0 else f"{row['value']:.4g}"
        found = f"{row['quantity']}: {found}" if row["value"] == row["value"] else "needs a recording"
        rows.append([str(row["number"]), row["section"], row["statement"], found, row["verdict"]])
    return rows


def choices() -> list[list[str]]:
    """Choices of the replication, as article/choices.toml has them."""
    with open(ROOT / "article" / "choices.toml", "rb") as file:
        entries = tomllib.load(file)["choice"]
    keys = ["issue", "readings", "used", "why"]
    return [["issue", "readings", "chosen", "why"], *[[entry[key] for key in keys] for entry in entries]]


def tables(bound: bound_numbers.Bound) -> dict[str, object]:
    """Everything that the text takes from stored tables, by name."""
    found: dict[str, object] = {name: cells(getattr(number_tables, name)(bound.table)) for name in DOCUMENTS}
    made = json.loads((ROOT / "results" / "paper" / "manifest.json").read_text(encoding="utf-8"))["software"]
    source = f"Main study: sphere-fit-study {made['study']}, commit {made['commit'][:10]}, Python {made['python']}."
    return found | {"claims": claims(bound.table("verdicts")), "choices": choices(), "source": source}


def yaml(entries: dict[str, object]) -> str:
    """Entries as YAML; lists of mappings a line for each key. JSON's strings are YAML's."""
    lines = []
    for key, value in entries.items():
        if isinstance(value, list):
            lines.append(f"{key}:")
            for each in value:
                if isinstance(each, str):
                    lines.append(f"  - {json.dumps(each, ensure_ascii=False)}")
                    continue
                pairs = [f"{name}: {json.dumps(one, ensure_ascii=False)}" for name, one in each.items()]
                lines += [f"  - {pairs[0]}", *(f"    {pair}" for pair in pairs[1:])]
        elif isinstance(value, dict):
            lines += [f"{key}:", *("  " + line for line in yaml(value).splitlines())]
        else:
            lines.append(f"{key}: {json.dumps(value, ensure_ascii=False)}")
    return "\n".join(lines) + "\n"


def metadata(text: str) -> str:
    """The fields of ReScience C, from the report's text."""
    words = re.search(r"\*Abstract\.\* (.*?)\n\]", text, re.DOTALL)[1]
    code = [{"swh": identifier} for identifier in swhids().values() if identifier]
    entries = {"title": _title(text), "authors": DEPOSIT["authors"], "keywords": DEPOSIT["keywords"], "code": code}
    entries |= {"replication": [DEPOSIT["paper"]], "abstract": " ".join(words.split()), "type": "Replication"}
    return yaml(entries | {"domain": DEPOSIT["domain"], "language": "Python"})


def codecheck(text: str) -> str:
    """The file by which CODECHECK finds what to compare."""
    paper = {"title": _title(text), "authors": DEPOSIT["authors"], "reference-other": [DEPOSIT["paper"]["url"]]}
    manifest = [{"file": file, "comment": comment} for file, comment in DEPOSIT["checked"].items()]
    return "---\n" + yaml({"version": DEPOSIT["specification"], "paper": paper, "manifest": manifest})


def _title(text: str) -> str:
    return re.search(r'#let title = "(.*)"', text)[1]


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
    (results / "article.pdf").write_bytes(typst.compile(ROOT / TEXT, root=ROOT))
    (results / "metadata.yaml").write_text(metadata(text), encoding="utf-8")
    (ROOT / "codecheck.yml").write_text(codecheck(text), encoding="utf-8")
    print("results/article.pdf, results/metadata.yaml, codecheck.yml\nLeft to a person:")
    print("\n".join(f"  {words}" for words in DEPOSIT["open"]))


if __name__ == "__main__":
    main()
