"""A figure that fails: its place in the code on standard error, exit code 1, and the other figures all the same."""

import inspect

import pytest
from matplotlib.figure import Figure

from study import figures
from study.figures import inputs

HERE = __name__.rpartition(".")[2] + ".py"


class Drawable:
    """The half of a figure that does not fail."""

    def draw(self, frame):
        return Figure()


class Outside(Drawable):
    """A figure that fails in its own code, which is not the package's."""

    def prepare(self, tables):
        return tables.stamp


class Inside(Drawable):
    """A figure that fails in a function of the package, one call further in."""

    def prepare(self, tables):
        return inputs.at_first(None, [])


class Whole(Drawable):
    """A figure that can be drawn."""

    def prepare(self, tables):
        return tables.name


def line_of(where, text):
    """Number of the line of a function or class that holds a text."""
    lines, first = inspect.getsourcelines(where)
    (found,) = [first + index for index, line in enumerate(lines) if text in line]
    return found


PLACES = {
    Outside: f"AttributeError(\"'Tables' object has no attribute 'stamp'\") at {HERE}, "
    f"line {line_of(Outside, 'tables.stamp')}, in prepare",
    Inside: f"at study/figures/inputs.py, line {line_of(inputs.at_first, 'condition.name in table and')}, in at_first",
}


@pytest.mark.parametrize("broken", PLACES, ids=lambda each: each.__name__)
def test_a_figure_that_fails(finished, call_here, tmp_path, monkeypatch, broken):
    """Exception, file and line are told in one line; the next figure is drawn, and the exit code is 1."""
    monkeypatch.setattr(figures, "FIGURES", {"broken": broken(), "whole": Whole()})
    code, said, complained = call_here(finished[0], "figures", "out", "--out", tmp_path / "drawn")
    assert code == 1
    assert [line.rpartition("/")[2] for line in said.splitlines()] == ["whole.png", "whole.svg"]
    (line,) = complained.splitlines()
    assert line.startswith("broken: failed: ")
    assert line.endswith(PLACES[broken])


def test_a_figure_that_does_not_apply_is_no_failure(finished, call_here, tmp_path):
    """A run that cannot feed a figure is code 0 and a reason."""
    code, _, complained = call_here(finished[0], "figures", "out", "fig2_error", "--out", tmp_path / "drawn")
    assert code == 0
    assert complained.startswith("fig2_error: not drawn: ")


def test_figures_of_several_runs(finished, call_here, tmp_path):
    """Runs and figures are told apart by the figures' names; a name that is neither, or no run, is refused."""
    code, said, complained = call_here(finished[0], "figures", "out", "out", "fig2_error", "--out", tmp_path / "drawn")
    assert (code, said) == (0, "")
    assert complained.startswith("fig2_error: not drawn: ")
    code, _, complained = call_here(finished[0], "figures", "out", "fig_eficiency")
    assert code == 2
    assert "fig_eficiency: unknown; did you mean 'fig_efficiency'?" in " ".join(complained.split())
    code, _, complained = call_here(finished[0], "figures", "fig_efficiency")
    assert code == 2
    assert "no run is given" in complained


def test_a_file_in_place_of_the_folder(finished, call_here, tmp_path):
    """A file, or a path below one, is refused in one line, and stays as it is."""
    (tmp_path / "mine").write_text("text")
    for path, words in [("mine", "is a file, not a folder; choose another with --out"), ("mine/below", "cannot be")]:
        code, said, complained = call_here(finished[0], "figures", "out", "fig2_error", "--out", tmp_path / path)
        assert (code, said, len(complained.splitlines())) == (1, "", 1)
        assert complained.startswith(f"{tmp_path / path}: {words}")
    assert (tmp_path / "mine").read_text() == "text"
