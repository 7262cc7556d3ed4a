"""Figures are drawn by a second process as they are by the first."""

import os
from types import SimpleNamespace

import pytest

from study.report import pictures
from study.report.drawing import Artist, artist
from study.report.page import render


def test_a_second_process_draws_the_same_page(circles, random, claims):
    """A page has the same bytes however many processes draw its figures."""
    assert render([random, circles], claims, jobs=2) == render([random, circles], claims)


def mine(number):
    """The process that is asked."""
    return number, os.getpid()


def end(parent):
    """End the process at once, as the system does for want of memory, unless it is the parent."""
    if os.getpid() != parent:
        os._exit(1)
    return "drawn"


def test_another_process_does_the_work():
    """With two jobs the calls are not of this process, with one they are."""
    for jobs, here in ((1, True), (2, False)):
        with artist(jobs) as worker:
            number, process = worker.begin(mine, 7)()
        assert number == 7
        assert (process == os.getpid()) is here


def test_a_process_that_dies_costs_no_picture():
    """What it did not draw is drawn here."""
    with artist(2) as worker:
        drawing, after = worker.begin(end, os.getpid()), worker.begin(end, os.getpid())
        assert [drawing(), after()] == ["drawn", "drawn"]


def test_a_figure_that_fails_when_it_is_drawn(random, claims, monkeypatch, read):
    """Its place in the code is said, and the others are drawn."""

    def draw(frame):
        raise ZeroDivisionError("no ink")

    broken = SimpleNamespace(prepare=lambda tables: 1, draw=draw)
    monkeypatch.setattr(pictures, "FIGURES", {"broken": broken, "fig2_error": pictures.FIGURES["fig2_error"]})
    document = read(render([random], claims))
    assert "broken: failed: ZeroDivisionError('no ink') at " in document.text
    assert [tag["id"] for tag in document.of("figure")] == ["fig2_error"]


def test_nothing_is_drawn_twice():
    """A result may be asked for again."""
    calls = []
    drawing = Artist(None).begin(calls.append, 1)
    drawing()
    drawing()
    assert calls == [1]


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_failure_ends_the_work(jobs):
    """An exception of the caller is not held up by pictures that nobody will see."""
    with pytest.raises(KeyError), artist(jobs):
        raise KeyError
