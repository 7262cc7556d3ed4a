"""What the tests of the page share: a large run, made-up claims, the page, and a reader of its HTML."""

import html.parser
import math

import pandas as pd
import pytest

from study.simulation.claims.claim import OTHER_CAUSE, Verdict
from study.simulation.report.material import Material
from study.simulation.report.page import render
from study.simulation.runs import schemas
from tests.configs import config


@pytest.fixture(scope="session")
def many(make_run):
    """A grid of more cells than a page shows at once, with many estimators."""
    names = ["mle", "gdke", "ugdk", "als", "fuller", "taubin", "pratt", "hyper", "ugdk_cov"]
    design = {"samples": [20, 50], "noise_over_radius": {"logspace": [1e-4, 1, 11]}, "angle": [45, 180]}
    return make_run(config({"name": "many", "seed": 3, "estimators": names}, trials=3, **design))


def claim(number, verdict, **columns):
    """A row of the claims table."""
    row = {
        "number": number,
        "name": f"claim-{number}",
        "section": "4.1",
        "statement": f"statement {number} of the <paper>",
        "quantity": "a median",
        "value": math.nan,
        "error": math.nan,
        "trials": 40,
        "verdict": str(verdict),
        "finding": "the median; all fits: -1.2e-05 ± 3e-07\nthe other, of N = 20: 0.99 ± 0.012",
        "criterion": "reproduced if it is below three Monte-Carlo errors",
        "remark": "",
        "reads": "circles/errors",
        "runs": "",
        "figure": "",
    }
    return row | columns


@pytest.fixture(scope="session")
def make_claims():
    """A claims table from rows of (verdict, columns)."""

    def make(*rows):
        frame = [claim(number, verdict, **columns) for number, (verdict, columns) in enumerate(rows, start=1)]
        return pd.DataFrame(frame, columns=[column.name for column in schemas.CLAIMS])

    return make


@pytest.fixture(scope="session")
def claims(make_claims, circles):
    """A claim of every verdict, and two of one."""
    name = circles.study.run_name()
    return make_claims(
        (Verdict.REPRODUCED, {"figure": "fig7_power_law", "runs": f"{name}, other-0123456789"}),
        (f"{Verdict.MOSTLY}{OTHER_CAUSE}", {"figure": "fig6_mgdk"}),
        (Verdict.NOT_REPRODUCED, {"remark": "a remark of its own"}),
        (
            Verdict.NOT_EVALUATED,
            {
                "finding": "needs a run of configs/mgdk.toml; `study run` makes one",
                "reads": "mgdk/points, circles/errors, cost, case-study",
            },
        ),
        (Verdict.REPRODUCED, {}),
    )


@pytest.fixture(scope="session")
def page(circles, random, claims):
    """The page about two runs."""
    return render(Material([circles, random], claims))


class Document(html.parser.HTMLParser):
    """A page as its tags; complains of what is not closed or stands where it may not."""

    VOID = frozenset({"meta", "link", "img", "br", "input"})
    BLOCKS = frozenset({"p", "div", "ul", "dl", "table", "details", "figure", "section", "pre", "h1", "h2", "h3"})

    APART = frozenset({"p", "td", "th", "tr", "li", "dt", "dd", "summary", "h1", "h2", "h3", "pre"})

    def __init__(self, page):
        super().__init__()
        self.tags, self.open, self.faults, self.words = [], [], [], []
        self.feed(page)
        self.close()
        self.faults += [f"{tag} is not closed" for tag in self.open]

    def handle_starttag(self, tag, attributes):
        if "p" in self.open and tag in self.BLOCKS:
            self.faults.append(f"{tag} within p")
        self.tags.append((tag, dict(attributes)))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        if tag in self.APART:
            self.words.append(" ")
        if not self.open or self.open.pop() != tag:
            self.faults.append(f"/{tag} out of place")

    def handle_data(self, data):
        if not {"style", "script"} & set(self.open):
            self.words.append(data)

    @property
    def text(self):
        """All words, with plain and single spaces."""
        return " ".join("".join(self.words).split())

    def of(self, *names):
        """The attributes of all tags of these names."""
        return [attributes for tag, attributes in self.tags if tag in names]

    def ids(self):
        """All ids."""
        return [attributes["id"] for _, attributes in self.tags if "id" in attributes]


@pytest.fixture(scope="session")
def read():
    """Read a page's HTML."""
    return Document


@pytest.fixture(scope="session")
def document(page):
    """The page about two runs, read."""
    return Document(page)


def is_of_the_page(request):
    """True for the page itself and for what is in it."""
    return request.is_navigation_request() or request.url.startswith(("data:", "blob:"))


@pytest.fixture
def heard(tab):
    """What a tab complains of, and what it asks of others than the page's own file, while a test runs."""
    said = []
    listeners = {
        "console": lambda message: said.append(f"{message.type}: {message.text}"),
        "pageerror": lambda error: said.append(f"error: {error}"),
        "requestfailed": lambda request: said.append(f"failed: {request.url[:80]}"),
        "request": lambda request: is_of_the_page(request) or said.append(f"request: {request.url}"),
    }
    for event, listener in listeners.items():
        tab.on(event, listener)
    yield said
    for event, listener in listeners.items():
        tab.remove_listener(event, listener)
