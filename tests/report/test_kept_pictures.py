"""A figure is drawn once from the same tables: by the command or for the page, and again where a table has changed."""

import base64
import re
from types import ModuleType

import pytest

from study import figures
from study.figures import FIGURES, KeptPictures, style
from study.report.page import render
from study.runs import kept
from study.runs.storage.run_folder import Run


@pytest.fixture
def run(random, copied):
    """A run of its own, whose files a test may change."""
    return copied(random)


@pytest.fixture
def forbidden(monkeypatch):
    """Let nothing be drawn any more."""

    def forbid():
        def refuse(*_):
            raise AssertionError("drawn again")

        monkeypatch.setattr(style, "encode", refuse)

    return forbid


def on_page(run, claims):
    """PNGs on the page about a run, by the figure's name."""
    found = re.findall(r'<figure id="(\w+)".*?base64,([^"]*)"', render([run], claims), re.DOTALL)
    return {name: base64.b64decode(text) for name, text in found}


def test_the_page_has_the_pictures_of_the_command(run, claims, tmp_path, forbidden):
    """After the command nothing is drawn for the page, nor by the command again; the bytes are those of its files."""
    first, _ = figures.draw_all([run], tmp_path / "first")
    forbidden()
    again, _ = figures.draw_all([run], tmp_path / "again")
    assert [path.read_bytes() for path in first] == [path.read_bytes() for path in again]
    assert on_page(run, claims) == {path.stem: path.read_bytes() for path in first if path.suffix == ".png"}


def test_a_second_page_draws_nothing(run, claims, forbidden):
    """Two pages have the same bytes, and the second draws nothing."""
    first = render([run], claims)
    forbidden()
    assert render([run], claims) == first


def test_a_changed_table_is_drawn_again(run, claims):
    """The error of a trial is another: the picture is another, and so is the command's."""
    before = on_page(run, claims)
    table = run.arrow("errors")
    place = table.schema.get_field_index("error")
    run.save("errors", table.set_column(place, table.field(place), [[3.0, *table["error"].to_pylist()[1:]]]))
    after = on_page(Run.open(run.folder), claims)
    assert list(after) == list(before) == ["fig2_error"]
    assert after != before


def test_an_edited_picture_is_drawn_again(run, claims):
    """A kept picture whose bytes were changed is not shown."""
    before = on_page(run, claims)
    path = run.folder / kept.FOLDER / "fig2_error.png"
    path.write_bytes(path.read_bytes()[:-1] + b"x")
    assert on_page(run, claims) == before


def test_a_picture_that_is_removed_meanwhile(run, claims, monkeypatch):
    """A kept picture that was found is shown, though its file is gone before the page is written."""
    before, find = on_page(run, claims), kept.find

    def once(found_of, name, known):
        found = find(found_of, name, known)
        (found_of.folder / kept.FOLDER / name).unlink(missing_ok=True)
        return found

    monkeypatch.setattr(kept, "find", once)
    assert on_page(run, claims) == before


def test_only_figures_of_the_package_are_kept(run):
    """A figure whose source the key does not know is drawn each time."""
    pictures = KeptPictures(run)
    for mine in (object(), ModuleType("mine")):
        pictures.keep("mine", mine, {"png": b"picture"})
        assert pictures.find("mine", mine, ["png"]) is None
    pictures.keep("mine", FIGURES["fig_map"], {"png": b"picture"})
    assert pictures.find("mine", FIGURES["fig_map"], ["png"]) == {"png": b"picture"}
    assert pictures.find("mine", FIGURES["fig_map"]) is None  # the SVG is missing


def test_a_folder_that_cannot_be_written(run, claims, tmp_path):
    """The page and the pictures are made where nothing can be kept."""
    (run.folder / kept.FOLDER).write_text("a file in its place")
    assert len(figures.draw_all([run], tmp_path / "out")[0]) == 2
    assert list(on_page(run, claims)) == ["fig2_error"]
