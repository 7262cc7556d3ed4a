"""The page in a real browser: silent, complete, without a request, within its width on a desk, a phone and paper."""

import re

import pytest

from study.simulation.claims.claim import Verdict
from study.simulation.figures import FIGURES
from study.simulation.report.material import Material
from study.simulation.report.page import render
from tests.configs import config

WIDTHS = (1280, 768, 390, 375)
PHONE = 390
PAPER = 680  # the width between the margins of an A4 page, in pixels of 1/96 inch

OVERFLOW = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
PICTURES = "[...document.images].filter(i => !(i.complete && i.naturalWidth > 0)).map(i => i.alt)"
LINKS = """[...document.querySelectorAll('a, link')].map(a => a.getAttribute('href'))
    .filter(h => !h.startsWith('data:') && !(h.startsWith('#') && document.getElementById(h.slice(1))))"""
JUMPS = """[...document.images].filter(i => Math.abs(
    i.clientWidth / i.clientHeight - i.getAttribute('width') / i.getAttribute('height')) > 0.02).map(i => i.alt)"""
# what overflows must scroll, and be reached by keys; the heads of stacked tables are hidden on purpose
CUT = """[...document.body.querySelectorAll('*')].filter(e => e.checkVisibility() && !e.closest('thead')
    && e.scrollWidth > e.clientWidth + 1 && getComputedStyle(e).overflowX != 'visible'
    && !(['auto', 'scroll'].includes(getComputedStyle(e).overflowX) && e.tabIndex >= 0
        && e.getAttribute('tabindex') == '0')).map(e => e.textContent.trim().slice(0, 60))"""
# text against the nearest background that is not transparent, by the Web Content Accessibility Guidelines
FAINT = """(() => {
    const parse = c => (c.match(/[\\d.]+/g) || []).map(Number);
    const light = c => [0.2126, 0.7152, 0.0722].reduce((sum, w, i) => sum + w * (v => v <= 0.03928 ? v / 12.92
        : ((v + 0.055) / 1.055) ** 2.4)(c[i] / 255), 0);
    const behind = e => { for (; e; e = e.parentElement) { const c = parse(getComputedStyle(e).backgroundColor);
        if (c.length == 3 || c[3] > 0) return c; } return [255, 255, 255]; };
    return [...document.body.querySelectorAll('*')].filter(e => [...e.childNodes].some(n => n.nodeType == 3
        && n.textContent.trim())).filter(e => { const [a, b] = [light(parse(getComputedStyle(e).color)),
        light(behind(e))].sort((x, y) => y - x); return (a + 0.05) / (b + 0.05) < 4.5; })
        .map(e => e.textContent.slice(0, 60)); })()"""

QUESTIONS = {
    "broken picture": PICTURES,
    "no such place": LINKS,
    "another shape than said": JUMPS,
    "cut off": CUT,
    "faint": FAINT,
}


@pytest.fixture(scope="module")
def tab(new_tab):
    """A tab of it."""
    return new_tab()


@pytest.fixture
def show(tab, heard, tmp_path):
    """Show a page at a width, on a screen or as on paper; what the browser says of it, if anything, comes back."""
    file = tmp_path / "page.html"

    def shown(text, width, media="screen", scheme="light"):
        file.write_text(text, encoding="utf-8")
        tab.set_viewport_size({"width": width, "height": 800})
        tab.emulate_media(media=media, color_scheme=scheme)
        tab.goto(file.as_uri())
        return heard

    return shown


@pytest.fixture
def look(tab, show):
    """All that is wrong with a page at a width, on a screen or on paper, with its details closed and open."""

    def problems(text, width, media="screen", scheme="light"):
        said = show(text, width, media, scheme)
        for state in ("closed", "open"):
            tab.evaluate("state => document.querySelectorAll('details').forEach(d => d.open = state == 'open')", state)
            beyond = tab.evaluate(OVERFLOW)
            said += [f"{beyond} pixels too wide, {state}"] * (beyond > 0)
            said += [f"{words}: {found}" for words, question in QUESTIONS.items() for found in tab.evaluate(question)]
        return said

    return problems


@pytest.fixture(scope="module")
def long_words(make_run, make_claims, tmp_path_factory):
    """A page about a run with the longest name that a config can have, in a deep folder, and claims without a space."""
    name = "a" * 61
    angle = {"law": "choice", "values": list(range(10, 180, 7))}
    top = {"name": name, "estimators": ["mle", "corrected_01"]}
    text = config(top, kind="random", trials=3, samples=20, angle=angle)
    run = make_run(text, tmp_path_factory.mktemp("long") / ("b" * 100) / name)
    words = dict.fromkeys(("section", "statement", "quantity", "finding", "criterion", "remark", "reads"), "w" * 150)
    claims = make_claims(("mostly", words | {"figure": "f" * 80}), ("not evaluated", words | {"runs": name}))
    return render(Material([run], claims))


@pytest.mark.parametrize("width", WIDTHS)
def test_on_a_screen(look, page, width):
    """At the width of a desk, a tablet and a phone, with all details closed and open, nothing is wrong."""
    assert look(page, width) == []


def test_on_paper(look, page):
    """Printed on A4, nothing is wider than the paper."""
    assert look(page, PAPER, "print") == []


@pytest.mark.parametrize(("width", "media"), [(375, "screen"), (PAPER, "print")])
def test_wide_tables(look, many, claims, monkeypatch, width, media):
    """Nine estimators and 44 conditions scroll in their own box, on a phone, and fit on paper."""
    monkeypatch.setattr("study.simulation.figures.FIGURES", {})
    monkeypatch.setattr("study.simulation.report.runs._LONG", 1000)  # not folded ...
    monkeypatch.setattr("study.simulation.report.html.PRINTED", 1000)  # ... and printed
    assert look(render(Material([many], claims)), width, media) == []


@pytest.mark.parametrize(("width", "media"), [(375, "screen"), (1280, "screen"), (PAPER, "print")])
def test_long_words(look, long_words, width, media):
    """Names, paths and words of any length stay within the page."""
    assert look(long_words, width, media) == []


@pytest.mark.parametrize("width", [1280, PHONE])
def test_dark(tab, look, page, until, width):
    """For those who ask for dark pages it is dark, its text can be read, and pictures stand on white as on paper.

    The explorer's chart is dark, too.
    """
    assert look(page, width, scheme="dark") == []
    until(tab, "!document.getElementById('explorer-body').hidden")
    assert tab.evaluate(FAINT) == []  # the explorer's words, too
    behind = "e => getComputedStyle(e).backgroundColor"
    assert max(map(int, re.findall(r"\d+", tab.locator("html").evaluate(behind)))) < 40
    assert tab.locator("img").first.evaluate(behind) == "rgb(255, 255, 255)"
    assert tab.locator(".chart").evaluate(behind) == tab.locator(".chart svg").evaluate(behind) == "rgba(0, 0, 0, 0)"
    tab.emulate_media(media="print", color_scheme="dark")
    assert tab.locator("html").evaluate(behind) == "rgb(255, 255, 255)"


@pytest.fixture(scope="module")
def whole(circles, random, many, make_claims):
    """A page as long as that of the paper's study: 28 claims with texts as long as theirs, twelve figures."""
    words = "of the median error over the Cramér-Rao bound "
    finding = "\n".join(f"number {i} {words}: 0.25 ± 0.01" for i in range(6))
    said = {"finding": finding, "criterion": 7 * words, "remark": 7 * words, "quantity": words, "statement": 3 * words}
    claims = make_claims(*((Verdict.IN_PART, said) for _ in range(28)))
    with pytest.MonkeyPatch.context() as patch:
        figures = {f"figure_{i}": FIGURES["fig3_gdke_ellipse"] for i in range(12)}
        patch.setattr("study.simulation.figures.FIGURES", figures)
        return render(Material([circles, random, many], claims))


def test_claims_on_a_phone(tab, show, whole):
    """An answer has the width of the screen, not of a column; no claim, and not the page, is a scroll without end."""
    show(whole, PHONE)
    widths = tab.evaluate("[...document.querySelectorAll('[id^=claim-] td:last-child p')].map(p => p.clientWidth)")
    assert len(widths) >= 2 * 28
    assert min(widths) > 340
    assert max(tab.evaluate("[...document.querySelectorAll('[id^=claim-]')].map(r => r.clientHeight)")) < 400
    assert tab.evaluate("document.documentElement.scrollHeight") < 30_000


def test_figures_on_a_phone(tab, show, whole):
    """Letters of 8 points in a figure 6.8 inches wide are not shrunk below 7; its box scrolls."""
    show(whole, PHONE)
    shown = tab.evaluate("[...document.querySelectorAll('main figure img')].map(i => i.clientWidth / 96)")
    assert len(shown) == 12
    assert 8 * min(shown) / 6.8 > 7
    assert tab.evaluate("[...document.querySelectorAll('.framed')].every(e => e.clientWidth < 390)")


def test_pages_of_paper(tab, show, whole):
    """The study is printed on at most twenty pages of A4, claims with their numbers and rules."""
    show(whole, 1280)
    pdf = tab.pdf(format="A4", prefer_css_page_size=True)
    assert 10 < len(re.findall(rb"/Type\s*/Page\b", pdf)) <= 20


def test_details_on_paper(tab, show, page):
    """What is folded on a screen can be read on paper, without the marks that open it; contents are left out."""
    show(page, 1280)
    hidden = tab.locator("details p, details dd, details li, details td").first
    assert not hidden.is_visible()
    assert tab.locator("nav").is_visible()
    tab.emulate_media(media="print")
    assert hidden.is_visible()
    assert not tab.locator("nav").is_visible()
    assert tab.pdf(format="A4").startswith(b"%PDF")


def test_by_keyboard(tab, show, page, wait_for):
    """A box that scrolls can be reached and scrolled with keys alone."""
    show(page, 375)
    box = tab.locator(".scroll:has(table.plain)").first
    box.focus()
    assert box.evaluate("e => document.activeElement == e && e.scrollWidth > e.clientWidth")
    tab.keyboard.press("ArrowRight")
    wait_for(lambda: box.evaluate("e => e.scrollLeft") > 0, pause=lambda: tab.wait_for_timeout(20))
