"""Words and sentences of the documents, page by page.

    python tools/sentences.py                  # a line for each page
    python tools/sentences.py docs/sphere.md   # and the page's sentences of more than 30 words

`CONTRIBUTING.md` says how the documents are written. `tests/test_documents.py` sets the limits.
"""

import re
import sys
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
LONG = 30
"""Words above which a sentence is long."""
NO_PROSE = re.compile(
    r"^```.*?^```$|<!--.*?-->|^(?: {4}|\t)[^\n]*$|^\|[^\n]*$|^#+ [^\n]*$|!\[.*?\]\(.*?\)", re.M | re.S
)
"""Blocks, comments, tables, headings and pictures."""
BREAK = re.compile(r"\n\s*\n|\n\s*(?:[*-]|\d+\.) ")
"""Ends of paragraphs and of items of a list."""
STOP = re.compile(r"(?<!\bal\.)(?<!\beq\.)(?<!\beqs\.)(?<=[.!?])[\"*_)]*\s+(?=[^a-z])")
"""Ends of sentences."""


class Page(NamedTuple):
    """Size of a page.

    Attributes:
        words: all words of the file, as `wc -w` counts them.
        sentences: the sentences of its prose.
    """

    words: int
    sentences: list[str]

    @property
    def mean(self) -> float:
        """Mean number of words of a sentence."""
        return sum(map(length, self.sentences)) / max(1, len(self.sentences))

    @property
    def long(self) -> float:
        """Share of the sentences that have more than `LONG` words."""
        return sum(length(one) > LONG for one in self.sentences) / max(1, len(self.sentences))


def length(sentence: str) -> int:
    """Number of words: what has a letter or a digit."""
    return sum(bool(re.search(r"\w", word)) for word in sentence.split())


def page(text: str) -> Page:
    """Words and sentences of a text in Markdown."""
    prose = NO_PROSE.sub("\n", text)
    prose = re.sub(r"\[((?:[^\[\]]|\[[^\]]*\])*)\]\([^)]*\)", r"\1", prose)  # links as their words
    parts = [part for paragraph in BREAK.split(f"\n{prose}") for part in STOP.split(paragraph.strip())]
    return Page(len(text.split()), [part for part in parts if length(part) > 1])


def paths() -> list[Path]:
    """The documents, without the changelog and the code of conduct."""
    pages = [*ROOT.glob("*.md"), *ROOT.glob("docs/*.md")]
    return sorted(path for path in pages if path.name not in ("CHANGELOG.md", "CODE_OF_CONDUCT.md"))


def main() -> None:
    """Print the table, and the long sentences of the pages that are named."""
    named = [Path(name).resolve() for name in sys.argv[1:]]
    for path in named or paths():
        one = page(path.read_text(encoding="utf-8"))
        print(f"{path.relative_to(ROOT)!s:28} {one.words:6,} words  mean {one.mean:4.1f}  long {one.long:4.0%}")
        for sentence in one.sentences if named else []:
            if length(sentence) > LONG:
                print(f"    {length(sentence)}: {' '.join(sentence.split())}")


if __name__ == "__main__":
    main()
