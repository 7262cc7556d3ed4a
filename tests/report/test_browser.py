"""The page in a real browser: silent, complete, without a request, within its width on a desk, a phone and paper."""

import pytest

from study.report.page import render

WIDTHS = (1280, 768, 375)
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
def show(tab, tmp_path):
    """Show a page at a width, on a screen or as on paper; what the browser says of it, if anything, comes back."""
    said = []
    file = tmp_path / "page.html"
    listeners = {
        "console": lambda message: said.append(f"{message.type}: {message.text}"),
        "pageerror": lambda error: said.append(f"error: {error}"),
        "requestfailed": lambda request: said.append(f"failed: {request.url[:80]}"),
        "request": lambda request: (
            None if request.url.startswith((file.as_uri(), "data:")) else said.append(f"request: {request.url}")
        ),
    }
    for event, listener in listeners.items():
        tab.on(event, listener)

    def shown(text, width, media="screen"):
        file.write_text(text, encoding="utf-8")
        tab.set_viewport_size({"width": width, "height": 800})
        tab.emulate_media(media=media)
        tab.goto(file.as_uri())
        return said

    yield shown
    for event, listener in listeners.items():
        tab.remove_listener(event, listener)


@pytest.fixture
def look(tab, show):
    """All that is wrong with a page at a width, on a screen or on paper, with its details closed and open."""

    def problems(text, width, media="screen"):
        said = show(text, width, media)
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
    text = f"""name = "{name}"
seed = 1
estimators = ["mle", "corrected_01"]
[design]
kind = "random"
trials = 3
samples = 20
noise = 0.1
angle = {{ law = "choice", values = [{", ".join(str(angle) for angle in range(10, 180, 7))}] }}
"""
    run = make_run(text, tmp_path_factory.mktemp("long") / ("b" * 100) / name)
    words = dict.fromkeys(("section", "statement", "quantity", "finding", "criterion", "remark", "reads"), "w" * 150)
    claims = make_claims(("partly", words | {"figure": "f" * 80}), ("not evaluated", words | {"runs": name}))
    return render([run], claims)


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
    monkeypatch.setattr("study.report.pictures.FIGURES", {})
    monkeypatch.setattr("study.report.results._LONG", 1000)  # not folded, so that it is printed
    assert look(render([many], claims), width, media) == []


@pytest.mark.parametrize(("width", "media"), [(375, "screen"), (1280, "screen"), (PAPER, "print")])
def test_long_words(look, long_words, width, media):
    """Names, paths and words of any length stay within the page."""
    assert look(long_words, width, media) == []


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


@pytest.mark.parametrize(
    ("old", "new", "media", "complaint"),
    [
        ("data:image/png;base64,iVBOR", "data:image/png;base64,iVBOx", "screen", "broken picture: Figure"),
        ('id="figures"', 'id="pictures"', "screen", "no such place: #figures"),
        ('<a href="#figures"', '<a href="other.html"', "screen", "no such place: other.html"),
        (".scroll { overflow-x: auto;", ".scroll { overflow-x: visible;", "screen", "pixels too wide"),
        (".scroll { overflow-x: auto;", ".scroll { overflow-x: hidden;", "screen", "cut off:"),
        ('tabindex="0" aria-label="Error', 'aria-label="Error', "screen", "cut off:"),
        ("white-space: pre-wrap;", "white-space: pre;", "print", "pixels too wide"),
        (
            "img { display: block; width: 100%;",
            "img { display: block; width: 100%; height: 9px !important;",
            "screen",
            "shape",
        ),
        ("<main>", '<main><img alt="" src="https://example.invalid/a.png">', "screen", "error: "),
        (
            "<meta http-equiv=",
            '<link rel="stylesheet" href="https://example.invalid/a.css"><meta x=',
            "screen",
            "request: https",
        ),
        ("</main>", "</main>\n", "screen", None),
        ("<main>", "<main><script>1</script>", "screen", "error: "),
        (".note { display: block; color: #595959;", ".note { display: block; color: #999999;", "screen", "faint: "),
    ],
)
def test_the_checks_see(look, page, old, new, media, complaint):
    """Each fault made on purpose is complained of; a change that does no harm is not."""
    assert old in page
    said = look(page.replace(old, new, 1), 375 if media == "screen" else PAPER, media)
    if complaint is None:
        assert said == []
    else:
        assert any(complaint in line for line in said), said
