"""Hooks of the site: add what pages show and link that lies outside of docs/, and typeset formulas."""

import os
import posixpath
import re
from pathlib import Path

from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

DOCS = Path(__file__).resolve().parents[1] / "docs"
ROOT = DOCS.parent
SHOWN = ["figures/*.png", "configs/*.toml", "CONTRIBUTING.md", "CODE_OF_CONDUCT.md", "CHANGELOG.md"]
"""Files outside of docs/ that the site has, under the same names."""
LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\((?!\w+:|#)([^)\s#]+)(#[^)\s]*)?\)")
FORMULA = re.compile(r"^```math\n(.*?)^```$", re.MULTILINE | re.DOTALL)
ELSEWHERE = re.compile(r"<(?:script|img|iframe|source|link)\b[^>]*?(?:src|href)=[\"']?(?:https?:)?//[^>]*>")
"""Tags by which a page would ask another server."""
INLINE = re.compile(r"(^```.*?^```$|`[^`\n]*`)|\$([^$]+)\$", re.MULTILINE | re.DOTALL)
"""Code, which stays as it is, or a formula in the text."""
MOVED = {
    "report": "rerun.html#the-report",
    "own-estimators": "own.html#an-estimator",
    "own-laws": "own.html#a-law",
    "own-measures": "own.html#a-measure",
    "trades": "gallery.html",
    "ask": "sweep.html#ask-without-a-run",
    "precision": "cluster.html#adaptive-numbers-of-trials",
    "platforms": "speed.html#where-it-runs",
    "certify": "speed.html#certified-fits",
    "stability": "api.html#what-is-promised-to-stay",
    "weakly-identified": "sphere.html#weakly-identified",
}
"""Pages that are parts of others now, and their places there; their old addresses lead on."""
_COMMAND = []


def on_startup(command: str, dirty: bool) -> None:
    """Note the command: `mkdocs serve` names its own address in each page."""
    _COMMAND[:] = [command]


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add files of the repository that pages show or link."""
    for path in sorted(path for pattern in SHOWN for path in ROOT.glob(pattern)):
        name = path.relative_to(ROOT).as_posix()
        files.append(File.generated(config, name, abs_src_path=str(path)))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Turn links within the repository into links within the site; one to a file that the site lacks becomes text."""
    outside = page.file.src_uri in ("CONTRIBUTING.md", "CODE_OF_CONDUCT.md", "CHANGELOG.md")
    base = "" if outside else "docs"

    def within(link: re.Match[str]) -> str:
        mark, text, target, anchor = link.groups(default="")
        place = posixpath.normpath(posixpath.join(base, target))
        name = place.removeprefix("docs/")
        if files.get_file_from_path(name) is not None:
            return f"{mark}[{text}]({name}{anchor})"
        return text if os.path.exists(ROOT / place) else link[0]

    text = LINK.sub(within, markdown)
    if page.file.src_uri == "theory.md":
        text = FORMULA.sub(_typeset, INLINE.sub(_inline, text))
    names = re.findall(r"^\| `(study\.(?!ESTIMATORS)\w+)`", markdown, re.M) if page.file.src_uri == "api.md" else []
    return text + "".join(f"\n\n::: {name}\n" for name in names)  # the docstring of each name that the page lists


def on_post_page(output: str, page: Page, config: MkDocsConfig) -> str:
    """Refuse a page that would ask another server: the site is read from a folder, without a network."""
    if _COMMAND == ["build"] and (asked := ELSEWHERE.search(output)):
        raise PluginError(f"{page.file.src_uri}: asks another server: {asked[0]}")
    return output


def on_post_build(config: MkDocsConfig) -> None:
    """Write a page at each old address that leads to the new one, and fail if that place is not there."""
    for name, target in MOVED.items():
        file, _, anchor = target.partition("#")
        if f'id="{anchor}"' not in (Path(config.site_dir) / file).read_text(encoding="utf-8") and anchor:
            raise PluginError(f"{name}.html leads to {target}, which is not there")
        link = f'<a href="{target}">{target}</a>'
        head = f'<!doctype html><meta charset="utf-8"><meta http-equiv="refresh" content="0; url={target}">'
        (Path(config.site_dir) / f"{name}.html").write_text(f"{head}<title>Moved</title>{link}\n", encoding="utf-8")


def _typeset(formula: re.Match[str]) -> str:
    """The rows of a displayed formula as MathML, with their numbers; no script is needed to show it."""
    lines = []
    for row in re.sub(r"\\(?:begin|end)\{gather\*\}\n", "", formula[1]).split("\\\\\n"):
        tag = re.search(r"\\tag\{(.*?)\}", row)
        shown = convert(row.replace(tag[0], "") if tag else row.strip(), display="block")
        lines.append(f"<div>{shown}<span>{f'({tag[1]})' if tag else ''}</span></div>")
    return f'<div class="formula">{"".join(lines)}</div>'


def _inline(part: re.Match[str]) -> str:
    """A formula of the text as MathML; in a span, as Markdown takes a line that begins with `<math` for a block."""
    return part[1] or f"<span>{convert(part[2])}</span>"
