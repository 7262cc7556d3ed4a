"""Tests of draw all."""

import builtins
import hashlib
import itertools
import os
import subprocess
import sys
from concurrent.futures import wait
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from matplotlib.figure import Figure

from study import style
from study.fits import ESTIMATORS
from study.simulation import figures
from study.simulation.figures import FIGURES, Tables, fig_misfit
from study.simulation.runs.workers import Processes
from tests.configs import config

REDRAW = """
import sys
from pathlib import Path
from study.simulation.figures import FIGURES, draw_all
from study.simulation.runs.run_folder import Run
for number, folder in enumerate(sys.argv[2:]):
    draw_all([Run.open(Path(folder))], Path(sys.argv[1]), FIGURES, ("png", "svg") if number else ())
sys.exit("pyplot is not needed" if "matplotlib.pyplot" in sys.modules else 0)
"""


@pytest.fixture(scope="module")
def runs(circles, random, make_run):
    """Runs that between them have every figure."""
    two, cells = ["mle", "gdke"], {"trials": 30, "samples": 50, "angle": [45, 180]}
    arcs = {"dimension": 2, "estimators": ["als"], "keep_points": 20}
    chains = {"dimension": 2, "estimators": two, "posterior": {"trials": 20, "noise": "known", "walkers": 32}}
    short, level = {"estimators": two, "keep": "summary"}, {"noise_over_radius": 0.02}
    laws = {"law": ["normal", "student(3)", "laplace"], "outlier_share": [0, 0.1, 0.3]}
    structured = {"law": ["normal", "memory(0.9)", "form(0.4, 1)"], "directions": ["area", "path"]}
    apart = {"trials": 20, "draws": "independent"}
    texts = {
        "markers": config(arcs, samples=30, noise=0.02, angle=60, radius=[2.0, 1.2], **apart),
        "noises": config({"estimators": [*two, "als"]}, noise_over_radius=[1e-3, 1e-2, 1e-1, 1], **cells),
        "laws": config(short, **cells, **level, **laws),
        "misfits": config(short, **cells, **level, **structured),
        "intervals": config(
            {"estimators": two, "measures": ["interval", "own_errors", "ends"]}, trials=30, angle=[45, 180]
        ),
        "moments": config({"estimators": two}, trials=300, samples=100, noise=[0.01, 0.02], angle=[60, 180]),
        "posteriors": config(chains, samples=20, noise=0.05, angle=120, **apart),
    }
    return {"circles": circles, **{kind: make_run(text) for kind, text in texts.items()}, "random": random}


@pytest.fixture(scope="module")
def elsewhere(runs, tmp_path_factory):
    """Another process that draws all of them meanwhile, with another hash seed and user settings, and its folder."""
    folder = tmp_path_factory.mktemp("elsewhere")
    (folder / "matplotlibrc").write_text("font.size: 20\nsavefig.dpi: 30\n", encoding="utf-8")
    environment = {**os.environ, "PYTHONHASHSEED": "7", "MATPLOTLIBRC": str(folder)}
    command = [sys.executable, "-c", REDRAW, str(folder / "two"), *(str(store.folder) for store in runs.values())]
    with subprocess.Popen(command, env=environment) as process:
        yield process, folder / "two"


@pytest.fixture(scope="module")
def drawn(runs, tmp_path_factory):
    """What each of them said that it drew, and did not, into one folder below another that is not there.

    Of the first run also as PDF.
    """
    folder = tmp_path_factory.mktemp("figures")
    return {
        kind: figures.draw_all([store], folder / "a" / "b", FIGURES, () if kind == "circles" else style.KINDS)
        for kind, store in runs.items()
    }


@pytest.fixture(scope="module")
def sources(drawn):
    """The first run that each figure is drawn from, by the figure's name."""
    return {path.stem: kind for kind, (paths, _) in reversed(drawn.items()) for path in paths}


@pytest.fixture(scope="module")
def frames(runs, sources):
    """What each figure shows, prepared once."""
    return {name: FIGURES[name].prepare(Tables(runs[kind])) for name, kind in sources.items()}


HAS = {
    "circles": ["fig3_gdke_ellipse", "fig4_ugdk_ellipse", "fig5_methods", "fig7_power_law"],
    "markers": ["fig6_mgdk"],
    "noises": ["fig_efficiency", "fig_regret", "fig_map"],
    "laws": ["fig_robustness"],
    "misfits": ["fig_misfit"],
    "posteriors": ["fig_posterior", "fig_calibration"],
    "random": ["fig2_error"],
}
"""Figures that each run is known to feed. A new one need not be here: it is tested on the first run that feeds it."""

KNOWN = {name for names in HAS.values() for name in names}


@pytest.mark.parametrize("name", FIGURES)
def test_every_figure_is_drawn_from_some_run(drawn, sources, name):
    """The runs here feed all that is registered."""
    reasons = {kind: undrawn[name] for kind, (_, undrawn) in drawn.items() if name in undrawn}
    assert name in sources, f"no run of this file feeds it, add a config that does to `runs`; or it fails: {reasons}"


@pytest.mark.parametrize("kind", HAS)
def test_draws_what_applies_and_says_why_the_rest_does_not(drawn, kind):
    """Circles have figures 3, 4, 5 and 7, two markers figure 6, a random design figure 2; the rest has reasons."""
    paths, reasons = drawn[kind]
    names = [name for name in FIGURES if name in HAS[kind] or (name not in KNOWN and name not in reasons)]
    suffixes = (*style.KINDS, "pdf") if kind == "circles" else style.KINDS
    assert [path.name for path in paths] == [f"{name}.{suffix}" for name in names for suffix in suffixes]
    assert all(path.stat().st_size > 5000 for path in paths)
    assert list(reasons) == [name for name in FIGURES if name not in names]
    assert not [reason for reason in reasons.values() if reason.startswith("failed") or not reason]
    if kind == "circles":
        assert "random design" in reasons["fig2_error"]
        assert "two radii" in reasons["fig6_mgdk"]
        assert "levels of noise" in reasons["fig_efficiency"]
        assert "[posterior]" in reasons["fig_posterior"]
        assert "3 values of law in the grid, with normal among them" in reasons["fig_robustness"]


def test_several_runs_feed_a_figure_each(runs, drawn, tmp_path):
    """A figure comes from the first run that has the tables for it; where none has them, each run's reason is told."""
    names, kinds = ["fig5_methods", "fig_misfit", "fig6_mgdk", "fig_posterior"], ("misfits", "circles")
    paths, reasons = figures.draw_all([runs[kind] for kind in kinds], tmp_path, names, style.KINDS)
    alone = {path.name: path.read_bytes() for kind in kinds for path in drawn[kind][0]}
    assert [path.stem for path in paths[::2]] == names[:2]
    assert all(path.read_bytes() == alone[path.name] for path in paths)
    assert {path.name for path in tmp_path.iterdir()} == {path.name for path in paths}
    assert list(reasons) == names[2:]
    apart = [f"{drawn[kind][1]['fig6_mgdk']} ({Tables(runs[kind]).name})" for kind in kinds]
    assert reasons["fig6_mgdk"] == "; ".join(apart)
    assert reasons["fig_posterior"] == drawn["misfits"][1]["fig_posterior"] == drawn["circles"][1]["fig_posterior"]


def test_pictures_go_to_the_run_that_fed_them(runs, copied):
    """Without a folder each run's own has its pictures."""
    one, two = copied(runs["laws"]), copied(runs["misfits"], "other")
    paths, _ = figures.draw_all([one, two], None, ["fig_robustness", "fig_misfit"])
    assert [path.parent for path in paths[::3]] == [one.folder / "figures", two.folder / "figures"]


def test_workers_draw_the_same_bytes(circles, random, monkeypatch):
    """Pictures, and reasons why a figure is not drawn, are those of this process, which draws none of them here."""
    names, of_runs = ["fig5_methods", "fig_map", "fig_zip", "fig2_error"], [Tables(circles), Tables(random)]
    monkeypatch.setattr(figures, "_SHARE", 3)
    alone, gallery = (figures.gallery(names, jobs=jobs) for jobs in (1, 2))
    alone.draw(of_runs)
    with gallery.ahead(of_runs):
        wait(gallery._sent.values())
        monkeypatch.setattr(figures, "_drawn", None)
        gallery.draw(of_runs)
    assert list(gallery.drawings) == list(alone.drawings) == ["fig5_methods", "fig2_error"]
    assert [one.pictures for one in gallery.drawings.values()] == [one.pictures for one in alone.drawings.values()]
    assert gallery.undrawn == alone.undrawn


def test_a_figure_that_fails_in_a_worker_is_told(circles, copied, monkeypatch):
    """Its reason is the one of this process, and the other figures are drawn."""
    tables = Tables(copied(circles))
    tables.run.path("points").unlink()
    names = ["fig5_methods", "fig7_power_law", "fig_map", "fig_zip", "fig_bias", "fig_nested"]
    monkeypatch.setattr(figures, "_SHARE", 3)
    alone, gallery = (figures.gallery(names, ["png"], jobs) for jobs in (1, 2))
    alone.draw([tables])
    with gallery.ahead([tables]):
        wait(gallery._sent.values())
        monkeypatch.setattr(figures, "_drawn", None)
        gallery.draw([tables])
    assert list(gallery.failures()) == ["fig5_methods"]
    assert gallery.failures()["fig5_methods"].startswith("failed: RunError")
    assert gallery.undrawn == alone.undrawn
    assert "fig7_power_law" in gallery.drawings


def test_figures_of_a_worker_that_died_are_drawn_here(circles, monkeypatch):
    """A worker that ends, as one without memory does, costs no picture."""
    names = ["fig5_methods", "fig_map", "fig6_mgdk", "fig_zip", "fig_posterior", "fig7_power_law"]
    monkeypatch.setattr(figures, "_SHARE", 3)
    alone, gallery = (figures.gallery(names, ["png"], jobs) for jobs in (1, 2))
    alone.draw([Tables(circles)])
    monkeypatch.setattr(Processes, "submit", lambda self, _, *arguments: self.executor.submit(os._exit, 1))
    with gallery.ahead([Tables(circles)]):
        wait(gallery._sent.values())
        gallery.draw([Tables(circles)])
    assert {name: one.pictures for name, one in gallery.drawings.items()} == {
        name: one.pictures for name, one in alone.drawings.items()
    }


@pytest.mark.slow
def test_files_are_equal_to_the_byte(elsewhere, drawn):
    """Another process, with another hash seed, font cache in use and user settings, writes the same bytes."""
    paths = [path for paths, _ in drawn.values() for path in paths]
    assert {path.stem for path in paths} == set(FIGURES)
    process, folder = elsewhere
    assert process.wait() == 0
    for path in paths:
        digests = [hashlib.sha256(each.read_bytes()).digest() for each in (path, folder / path.name)]
        assert digests[0] == digests[1], path.name


@pytest.mark.parametrize("name", FIGURES)
def test_drawing_reads_no_files_and_names_the_run(runs, drawn, sources, frames, name, monkeypatch):
    """All that is drawn is in the frame; the stamp has the run and the number of trials, or which one is shown."""

    def refuse(*args, **kwargs):
        raise AssertionError(f"opened {args[0]}")

    monkeypatch.setattr(builtins, "open", refuse)
    monkeypatch.setattr(Path, "open", refuse)
    figure = FIGURES[name].draw(frames[name])  # fonts are looked up: all have been drawn
    assert isinstance(figure, Figure)
    study = runs[sources[name]].study
    (stamp,) = [text.get_text() for text in figure.texts]
    assert study.run_name() in stamp
    said = stamp.replace(study.run_name(), "")
    assert ("trial 0;" if name == "fig_posterior" else str(study.design.trials)) in said


@pytest.mark.parametrize("name", FIGURES)
def test_every_figure_offers_prepare_and_draw_alone(name):
    """Two public functions, whether it is a module or an object, and a docstring that says what to look at."""
    figure = FIGURES[name]
    place = getattr(figure, "__module__", None) or figure.__name__
    own = [n for n in dir(figure) if getattr(getattr(figure, n), "__module__", None) == place]
    assert {n for n in own if n[0].islower() and callable(getattr(figure, n))} == {"prepare", "draw"}
    assert "Look at" in figure.__doc__, 'the last paragraph of its docstring is to say "Look at: …"'


def test_numbers_of_samples_are_whole(frames, runs, sources):
    """The caption of figure 6 has the number of samples as the config has it."""
    (samples,) = {int(n) for n in runs[sources["fig6_mgdk"]].table("summary")["samples"]}
    assert f"$N$ = {samples} each" in frames["fig6_mgdk"].caption


@pytest.mark.parametrize("name", ["fig4_ugdk_ellipse", "fig7_power_law"])
def test_tables_are_left_alone(circles, name):
    """A figure changes none of the tables that the next one is drawn from."""
    tables = Tables(circles)
    points, summary = tables.points.copy(), tables.summary.copy()
    FIGURES[name].draw(FIGURES[name].prepare(tables)).draw_without_rendering()
    assert tables.points.equals(points)
    assert tables.summary.equals(summary)


def test_a_figure_that_fails_is_not_tried_again(circles, random, tmp_path, monkeypatch):
    """Its failure is told though another run could feed it: else a fault would show by the order of the runs alone."""

    class Broken:
        def prepare(self, tables):
            if tables.design == "grid":
                raise ZeroDivisionError("no such luck")
            return tables

    monkeypatch.setattr(figures, "FIGURES", {"broken": Broken()})
    paths, reasons = figures.draw_all([circles, random], tmp_path)
    assert paths == []
    assert reasons["broken"].startswith("failed: ZeroDivisionError")
    assert reasons["broken"].endswith(f"({Tables(circles).name})")


def test_every_estimator_has_a_color_of_its_own():
    """No two estimators, a user's own among them, are as near in colour as the eye would confuse."""
    names = [*ESTIMATORS, *style._LOOKS, "my_own", "another"]
    rgb = {name: np.array(matplotlib.colors.to_rgb(style.color(name))) for name in names}
    for one, other in itertools.combinations(rgb, 2):
        assert np.linalg.norm(rgb[one] - rgb[other]) > 0.1, f"{one} and {other}"


LESS_RED = np.array([[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]])
LESS_GREEN = np.array(
    [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
)
"""Linear RGB as a protanope and a deuteranope see it (Machado, Oliveira & Fernandes 2009, severity 1)."""


def lab(color, seen):
    """A colour in CIE L*a*b*, white D65, as somebody sees it."""
    rgb = np.array(matplotlib.colors.to_rgb(color))
    linear = seen @ np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    to_xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
    xyz = to_xyz @ np.clip(linear, 0.0, 1.0) / [0.9505, 1.0, 1.089]
    x, y, z = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16.0 / 116.0)
    return np.array([116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)])


@pytest.mark.parametrize("seen", [np.eye(3), LESS_RED, LESS_GREEN], ids=["all", "protanope", "deuteranope"])
def test_the_colour_blind_tell_estimators_apart(seen):
    """Those that figures compare are 10 steps of CIE 1976 apart, several times what an eye can just tell."""
    variants = {name for name in style._LOOKS if "_" in name or name == "hinge"}
    for one, other in itertools.combinations(set(style._LOOKS) - variants, 2):
        away = np.linalg.norm(lab(style.color(one), seen) - lab(style.color(other), seen))
        assert away > 10.0, f"{one} and {other}"


def test_shades_go_from_light_to_dark():
    """Each number of samples is darker than the one before, by as much."""
    for count in (1, 2, 7):
        light = [lab(color, np.eye(3))[0] for color in style.shades(count)]
        assert len(light) == count
        assert np.all(np.diff(light) < -5.0)


@pytest.mark.parametrize(
    ("law", "words"),
    [("normal", "white"), ("radial", "radial"), ("memory(0.9)", "AR(1), 0.9"), ("form(0.4, 1)", "form, 0.4, 1 σ")],
)
def test_laws_in_words(law, words):
    """The labels of the figure on misfits."""
    assert fig_misfit._named(law) == words


def test_every_registered_estimator_has_a_fixed_look():
    """A registered estimator without a line in the style would be drawn as a user's own."""
    missing = sorted(set(ESTIMATORS) - set(style._LOOKS))
    assert not missing, f"without a line in _LOOKS of study/style.py: {missing}"


def test_unknown_estimator_looks_the_same_in_every_process():
    """The colour of a user's own estimator comes from its name, not from Python's randomised hash."""
    code = "from study import style; print(style.color('my_own'))"
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip()
    assert told == style.color("my_own")
    assert style.label("my_own") == "my_own"


def test_settings_do_not_leak(monkeypatch):
    """The journal style holds inside only, and a user's own settings do not reach into it."""
    monkeypatch.setitem(matplotlib.rcParams, "font.size", 31.0)
    with style.journal():
        assert matplotlib.rcParams["font.size"] == 8.0
        assert matplotlib.rcParams["svg.fonttype"] == "path"
    assert matplotlib.rcParams["font.size"] == 31.0


def test_spread_keeps_labels_apart_and_inside():
    """Labels do not overlap, keep their order, and stay within the axis."""
    wanted, heights = [0.02, 0.5, 0.51, 0.0, 0.98], [0.1, 0.1, 0.2, 0.1, 0.1]
    placed = style.spread(wanted, heights)
    order = np.argsort(wanted)
    gaps = np.diff(placed[order])
    needed = 0.5 * (np.array(heights)[order][1:] + np.array(heights)[order][:-1])
    assert (gaps >= needed - 1e-12).all()
    assert placed.min() >= 0.05 - 1e-12
    assert placed.max() <= 0.95 + 1e-12


def test_spread_leaves_labels_that_have_room():
    """A label that overlaps none stays where it belongs."""
    np.testing.assert_allclose(style.spread([0.8, 0.2, 0.5], [0.1] * 3), [0.8, 0.2, 0.5])


@pytest.mark.parametrize(
    ("value", "text"), [(0.5284, "0.528"), (-0.0276, "−0.0276"), (1e-5, "1 × $10^{-5}$"), (2.5e13, "2.5 × $10^{13}$")]
)
def test_number(value, text):
    """Three digits, powers of ten in words that a paper would print; minus zero is zero."""
    assert style.number(value) == text
    assert [style.decimals(number, 2) for number in (-0.0004, -0.516)] == ["0.00", "−0.52"]


def test_joined_breaks_between_names_only():
    """A name of two words is not torn apart at a line's end."""
    text = style.joined(["lls", "lls_nr_raw", "gdke"], ": 1", width=12).replace("\xa0", " ")
    assert text.split("\n") == ["LLS =", "LLS (NR, raw)", "= GDKE: 1"]


def test_saved_files_carry_no_date_and_no_software(tmp_path):
    """Neither the clock nor the version of the plotting library is in the files."""
    figure = Figure(figsize=(2, 2))
    figure.subplots().plot([0, 1], [0, 1])
    png, svg = style.save(figure, tmp_path / "name.with.dots")
    assert [png.name, svg.name] == ["name.with.dots.png", "name.with.dots.svg"]
    assert b"Software" not in png.read_bytes()
    text = svg.read_text(encoding="utf-8")
    assert "dc:date" not in text
    assert "dc:creator" not in text
