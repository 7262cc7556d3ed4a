"""What tests share: a seeded generator, points on spherical caps, a statistical assertion, small runs, a browser.

Factories are session fixtures that return functions, so that hypothesis tests can use them too.
"""

import contextlib
import io
import shutil
import sys
import time
from pathlib import Path

from study import instruction_set

# before numba is there: tests run the code that the command runs, and it is compiled once for both
instruction_set.fix()

import numpy as np  # noqa: E402
import pytest  # noqa: E402

import study  # noqa: E402
from study.fits.loops.jit import _WAY, always_compiled  # noqa: E402
from study.fits.points.cap import sample_cap  # noqa: E402
from study.simulation.runs.run_folder import Run  # noqa: E402
from tests.configs import config, log_uniform, uniform  # noqa: E402

PATIENCE = 600
"""Seconds after which a test that waits is taken to hang."""
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
FLAGS = ["--no-sandbox", "--no-first-run", "--disable-sync", "--disable-quic"]
FLAGS += ["--disable-background-networking", "--disable-component-update"]
FLAGS += ["--use-angle=swiftshader", "--enable-unsafe-swiftshader"]  # three dimensions without a graphics card


@pytest.fixture(scope="session", autouse=True)
def compiled_loops():
    """Compile every loop, so that all tests see the same bits; `test_plain.py` compares the two ways."""
    with always_compiled():
        yield


@pytest.fixture(autouse=True)
def plain_loops(request, monkeypatch):
    """Run the loops of a test that is marked `plain` as they are: what few points need takes less than compiling."""
    with contextlib.ExitStack() as stack:
        if request.node.get_closest_marker("plain"):
            monkeypatch.setattr(_WAY, "plain", True)
            stack.enter_context(np.errstate(all="ignore"))
        yield


@pytest.fixture
def copied(tmp_path):
    """A function that copies a run."""

    def copy(run, name="run"):
        return Run.open(shutil.copytree(run.folder, tmp_path / name))

    return copy


@pytest.fixture(scope="session")
def files_of():
    """All files under a folder with their bytes."""
    return lambda folder: {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


@pytest.fixture
def call_here(monkeypatch, capsys):
    """Run a command within this process, which takes no time: exit code and both outputs; what is not caught, fails."""
    from study import cli

    def run(folder, *arguments, stdin=""):
        monkeypatch.chdir(folder)
        monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(stdin.encode())))
        monkeypatch.setattr(sys, "argv", ["study", *map(str, arguments)])
        with pytest.raises(SystemExit) as end:
            cli.main()
        return end.value.code, *capsys.readouterr()

    return run


@pytest.fixture
def well(call_here):
    """Run a command within this process that ends with code 0 and complains of nothing; its output."""

    def run(folder, *arguments, **options):
        code, said, complained = call_here(folder, *arguments, **options)
        assert (code, complained) == (0, "")
        return said

    return run


@pytest.fixture(scope="session")
def one_line():
    """Assert that a block raises an exception of one line that begins with a text and has words (a pattern)."""

    @contextlib.contextmanager
    def check(kind, words, start=""):
        with pytest.raises(kind, match=words) as caught:
            yield
        assert str(caught.value).startswith(start)
        assert "\n" not in str(caught.value)

    return check


@pytest.fixture(scope="module")
def browser():
    """Chromium or Chrome, if the machine has one."""
    path = next(filter(None, map(shutil.which, BROWSERS)), None)
    if path is None:
        pytest.skip(f"no browser on this machine: none of {', '.join(BROWSERS)} is on the path")
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    with playwright.sync_playwright() as driver:
        launched = driver.chromium.launch(executable_path=path, args=FLAGS, timeout=1000 * PATIENCE)
        yield launched
        launched.close()


@pytest.fixture(scope="module")
def new_tab(browser):
    """Open a tab, in which nothing fails because it takes long."""

    def make(**options):
        tab = browser.new_page(**options)
        tab.set_default_timeout(1000 * PATIENCE)
        return tab

    return make


@pytest.fixture(scope="session")
def until(wait_for):
    """Wait until something holds in a tab; the page's policy forbids what would wait within it."""

    def wait(tab, holds):
        wait_for(lambda: tab.evaluate(holds), pause=lambda: tab.wait_for_timeout(20))

    return wait


@pytest.fixture(scope="session")
def held():
    """Path of `held.py`: a command whose workers stop at a gate."""
    return Path(__file__).with_name("held.py")


@pytest.fixture(scope="session")
def wait_for():
    """Wait until something holds, and return it."""

    def wait(holds, goes_on=lambda: True, pause=lambda: time.sleep(0.01)):
        last = time.monotonic() + PATIENCE
        while not (found := holds()):
            assert goes_on(), "it ended before"
            assert time.monotonic() < last, f"it has not come in {PATIENCE} s"
            pause()
        return found

    return wait


@pytest.fixture
def rng():
    """A generator with a fixed seed, fresh for each test."""
    return np.random.default_rng(20090901)


@pytest.fixture(
    params=[pytest.param(0.25, marks=pytest.mark.quarter), pytest.param(1.0, marks=pytest.mark.slow)],
    ids=["quarter", "all"],
)
def part_of(request):
    """Number of trials of a level or a coverage: a quarter of so many, and all of them in `make test-all`.

    The limits of such a test follow from the number, so that its rate of false alarms is the same.
    """
    return lambda trials: round(request.param * trials)


@pytest.fixture(scope="session")
def on_cap():
    """Make noisy points on a cap: (n, d), or (sets, n, d); the directions come along."""

    def make(rng, n, angle=180.0, d=3, noise=0.0, radius=1.0, center=0.0, sets=None, axis=None):
        shape = (n, d) if sets is None else (sets, n, d)
        directions = sample_cap(rng, n * (sets or 1), np.radians(angle), d, axis).reshape(shape)
        root = noise * np.eye(d) if np.ndim(noise) == 0 else np.linalg.cholesky(noise)
        points = np.asarray(center) + radius * directions + rng.standard_normal(shape) @ root.T
        return points, directions

    return make


@pytest.fixture(scope="session")
def cap_moments():
    """First moment m and covariance K of directions uniform on a cap about e₁, from theory §0 and (3.2)-(3.3)."""

    def compute(angle, d):
        phi = np.radians(angle)
        if d == 2:
            m1, m2 = np.sin(phi) / phi, 0.5 + np.sin(2 * phi) / (4 * phi)
        elif d == 3:
            m1, m2 = (1 + np.cos(phi)) / 2, (1 + np.cos(phi) + np.cos(phi) ** 2) / 3
        else:
            raise NotImplementedError(d)
        mean = np.zeros(d)
        mean[0] = m1
        return mean, np.diag([m2 - m1**2] + [(1 - m2) / (d - 1)] * (d - 1))

    return compute


@pytest.fixture(scope="session")
def random_rotation():
    """An orthogonal matrix uniform over the group, reflections included."""

    def make(rng, d):
        q, r = np.linalg.qr(rng.standard_normal((d, d)))
        return q * np.sign(np.diag(r))

    return make


@pytest.fixture(scope="session")
def assert_mean():
    """Assert that a sample (trials, …) has the expected mean, to k standard errors in every component.

    A normal deviate passes 4.5 in 7 of 10⁶ cases; the trials are thousands, so means are normal.
    """

    def check(sample, expected, k=4.5):
        error = sample.std(axis=0, ddof=1) / np.sqrt(len(sample))
        pull = (sample.mean(axis=0) - expected) / error
        assert np.all(np.abs(pull) < k), f"{pull} standard errors from the expected mean"

    return check


@pytest.fixture(scope="session", params=list(study.ESTIMATORS))
def estimator(request):
    """Each registered estimator by name."""
    return request.param


@pytest.fixture(scope="session")
def make_run(tmp_path_factory):
    """Run a config into a folder of its own, with its summary, and its posteriors if it asks for them."""
    from study.simulation.analysis.summary import summarise
    from study.simulation.experiment.config import parse
    from study.simulation.posterior.run import compute  # here, because tests of arrays do without all of this
    from study.simulation.runs.runner import run

    def make(text, folder=None):
        study = parse(text)
        store = run(study, text, folder or tmp_path_factory.mktemp("runs") / study.name, jobs=1)
        if study.keep == "errors":
            summarise(store)
        if study.posterior is not None:
            compute(store, jobs=1)
        return store

    return make


@pytest.fixture(scope="session")
def circles(make_run):
    """A grid of circles with figures 3, 4, 5 and 7, and a comment that would be a script."""
    comment = """\n# a config with <script>alert("1 < 2 && 'x'")</script> & more\n"""
    top = {"name": "circles", "seed": 3, "dimension": 2, "estimators": ["mle", "lls", "gdke", "ugdk"], "keep_points": 2}
    design = {"samples": [20, 40, 80, 160], "noise": 0.05, "angle": 40, "radius": 2.0, "center": 1.0}
    return make_run(comment + config(top, trials=60, **design))


@pytest.fixture(scope="session")
def random(make_run):
    """A random design with figure 2 and fits that are not ok."""
    laws = {"samples": log_uniform(4, 100), "noise": log_uniform(1e-9, 1e9), "angle": uniform(0, 180)}
    top = {"name": "random", "seed": 2009, "estimators": ["mle", "gdke", "ugdk"]}
    return make_run("\n" + config(top, kind="random", trials=60, **laws))
