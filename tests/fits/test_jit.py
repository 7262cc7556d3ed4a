"""Compiled code in the cache never outlives a change in its sources, and computes the bits of code just compiled.

The same sums to the bit wherever points lie in memory.
"""

import ast
import os
import platform
import re
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from filelock import FileLock, Timeout
from numba import njit
from numba.core.caching import IndexDataCacheFile

import study
from study.fits import ESTIMATORS, Estimates, Samples
from study.fits.loops.jit import BLOCK, COMPILING, LOCK, always_compiled, compiled, squared
from study.fits.points.information import crlb
from study.fits.points.moments import Moments
from study.simulation.experiment.measures import MEASURES, Truth, attempt

PROGRAM = """
import numpy as np
from study.fits.points.information import scatter_all, weighted_scatter
from study.fits.loops.jit import always_compiled
with always_compiled():
    sums, _, _ = weighted_scatter(np.ones((1, 2, 4)), np.ones((1, 4)))
print(sums[0], sum(scatter_all.dispatcher.stats.cache_hits.values()))
"""

TWO_LOOPS = """
import numpy as np
from study.fits.loops.jit import always_compiled, fill, total
with always_compiled():
    fill(np.ones(2), 0.0), total(np.ones(2))
print(*(sum(loop.dispatcher.stats.cache_hits.values()) for loop in (fill, total)))
"""

FITS = """
import hashlib
import numpy as np
from study.fits import ESTIMATORS, Samples
from study.fits.loops.jit import always_compiled
rng, answers = np.random.default_rng(3), []
with always_compiled():
    for n in (5, 10, 20, 100):
        x = rng.standard_normal((300, 3, n))
        x /= np.linalg.norm(x, axis=1, keepdims=True)
        samples = Samples(x + 0.1 * rng.standard_normal(x.shape), 0.1)
        answers += [ESTIMATORS[name](samples) for name in NAMES]
print(hashlib.sha256(b"".join(f.center.tobytes() + f.noise_variance.tobytes() for f in answers)).hexdigest())
"""

VERSIONS = """
import gc, sys
from contextlib import suppress
from pathlib import Path
from study import instruction_set
instruction_set.fix()
import numpy as np
import study
from study.cli import main
from study.fits.loops.jit import Loop, always_compiled
from study.simulation.compile_loops import _begin, _fit

def versions():
    loops = [thing for thing in gc.get_objects() if isinstance(thing, Loop)]
    return {f"{loop.__module__} {loop.__qualname__} {types}" for loop in loops for types in loop.dispatcher.signatures}
"""

RUN = """
sys.argv[1:] = ["run", "chains.toml", "--jobs", "1"]
with suppress(SystemExit):
    main()
"""

ANSWERS = """
rng = np.random.default_rng(1)
with always_compiled():
    for moved in (1.0, 1.5):
        points = rng.standard_normal((50, 3))
        points *= (1.0 + 0.02 * rng.standard_normal((50, 1))) / np.linalg.norm(points, axis=1, keepdims=True)
        points[0] *= moved
        for known in ({}, {"noise": 0.02}):
            fit = study.fit(points, **known)
            print(fit, fit.outliers.sum(), fit.goodness.in_words())
"""

CHAINS = """
name = "chains"
seed = 1
dimension = 3
estimators = ["gdke"]
design = { kind = "grid", trials = 2, samples = [100], noise_over_radius = [0.01], angle = [90] }
posterior = { trials = 1, noise = ["unknown"], max_steps = 200 }
"""


@pytest.fixture
def package(tmp_path):
    """A copy of the package, without its caches, and a way to run a program with it in a new process."""
    copy = tmp_path / "study"
    shutil.copytree(Path(study.__file__).parent, copy, ignore=shutil.ignore_patterns("__pycache__"))
    environment = {key: value for key, value in os.environ.items() if not key.startswith(("NUMBA", "PYTHON"))}
    environment["PYTHONPATH"] = str(tmp_path)

    def run(program=PROGRAM):
        command = [sys.executable, "-W", "error", "-c", program]
        done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        warnings.append(done.stderr)
        return done.stdout.split()

    warnings = run.warnings = []
    run.environment = environment
    return copy, run


@pytest.mark.slow
@pytest.mark.parametrize("kept", ["NUMBA_CACHE_DIR", "XDG_CACHE_HOME"])
def test_change_reaches_callers_wherever_compiled_code_lies(package, kept, tmp_path):
    """In a folder that the user names, and in the user's own where the installation cannot be written to."""
    copy, run = package
    if kept == "XDG_CACHE_HOME":
        for folder in ("loops", "points"):
            (copy / "fits" / folder / "__pycache__").touch()  # no folder can be made there, not even by root
    run.environment[kept] = str(tmp_path / "kept")
    assert run() == ["4.0", "0"]
    assert run() == ["4.0", "1"]
    source = copy / "fits" / "loops" / "jit.py"
    source.write_text(source.read_text().replace("result += row[k]", "result += 3.0 * row[k]"))
    assert run() == ["12.0", "0"]
    assert list((tmp_path / "kept").rglob("information.scatter_all-*.nbi"))
    assert not list(copy.rglob("*.nbi"))


def test_code_is_compiled_anew_after_a_change_in_what_it_calls(package):
    """And after a change in what its file imports, and after no other; going back finds the old code.

    `scatter_all` inlines `total`, whose change it has to follow.
    """
    copy, run = package
    assert run() == ["4.0", "0"]
    for path in (copy / "fits" / "registry.py", copy / "recordings" / "rigid.py"):
        path.write_bytes(path.read_bytes() + b"# changed\n")
    assert run() == ["4.0", "1"]
    imported = copy / "fits" / "loops" / "linalg.py"
    before = imported.read_bytes()
    imported.write_bytes(before + b"# changed\n")
    assert run() == ["4.0", "0"]
    imported.write_bytes(before)
    assert run() == ["4.0", "1"]
    source = copy / "fits" / "loops" / "jit.py"
    text = source.read_text()
    assert text.count("result += row[k]") == 1
    source.write_text(text.replace("result += row[k]", "result += 3.0 * row[k]"))
    assert run() == ["12.0", "0"]


def test_code_of_older_sources_goes(package):
    """The code of the last sources of a file stays, and no more; that of other files is left alone."""
    copy, run = package
    run(TWO_LOOPS)
    folder, source = copy / "fits" / "loops" / "__pycache__", copy / "fits" / "loops" / "jit.py"
    (now,) = folder.glob("jit-*")
    old = [folder / f"jit-{k:016x}" for k in range(4)] + [folder / f"jit-other-{0:016x}"]
    for k, path in enumerate(old):
        path.mkdir()
        os.utime(path, (k, k))
    source.write_text(source.read_text() + "# changed\n")
    run(TWO_LOOPS)
    left = set(folder.glob("jit-*"))
    assert left >= {now, old[3], old[4]}
    assert not left & set(old[:3])
    assert len(left) == 4


@pytest.mark.parametrize("names", [["lls"], pytest.param(["ugdk"], marks=pytest.mark.slow)])
def test_code_just_compiled_and_code_from_the_cache_have_the_same_bits(package, names):
    """LLS in the process that compiled it once differed in the last bit from LLS in all others."""
    _, run = package
    program = f"NAMES = {names}{FITS}"
    assert run(program) == run(program)


def test_the_library_and_the_commands_share_the_cache_and_compilation_is_announced_once(package):
    """Two functions are compiled with one line on standard error; the other kind of program finds both, and is silent.

    A program that wants no such line sets its logs up.
    """
    _, run = package
    command = f"from study import instruction_set\ninstruction_set.fix()\n{TWO_LOOPS}"
    assert run(command) == ["0", "0"]
    assert run(TWO_LOOPS) == ["1", "1"]
    assert run.warnings == [f"{COMPILING}\n", ""]


def test_of_two_processes_one_compiles_a_function(package):
    """The other waits, and reads the code: whichever comes first, each of two functions is compiled once."""
    _, run = package
    with ThreadPoolExecutor(2) as pool:
        hits = list(pool.map(run, [TWO_LOOPS, TWO_LOOPS]))
    assert [int(one) + int(other) for one, other in zip(*hits, strict=True)] == [1, 1]


def test_a_process_that_is_a_fork_compiles(package):
    """A lock that its parent had made was refused, and with it the fit."""
    _, run = package
    run.environment["OPENBLAS_NUM_THREADS"] = "1"  # newer Pythons warn of a fork beside threads
    fork = (
        "import os, sys\nimport study.fits.loops.jit\nif child := os.fork():\n    sys.exit(os.waitpid(child, 0)[1])\n"
    )
    assert run(fork + TWO_LOOPS) == ["0", "0"]


def test_a_program_can_silence_the_compiler(package):
    """The line is a warning of the log `study`."""
    _, run = package
    assert run(f"import logging\nlogging.getLogger('study').setLevel('ERROR')\n{TWO_LOOPS}") == ["0", "0"]
    assert run.warnings == [""]


@pytest.mark.parametrize(
    ("set_up", "program", "called"),
    [
        ("_begin(Path('chains.toml'))", RUN, "study.simulation.posterior"),
        ("_fit(3)", ANSWERS, "study.fits.estimators.robust"),
    ],
    ids=["a run", "fits"],
)
def test_nothing_is_compiled_that_set_up_could(tmp_path, set_up, program, called):
    """A program calls no version of a loop that set-up did not call before.

    A run first compiled its chains, and a fit the search for outliers and the test of neighbours.
    """
    (tmp_path / "chains.toml").write_text(CHAINS)
    steps = [
        VERSIONS,
        set_up,
        "begun = versions()",
        program,
        "print(sorted(begun))",
        "print(sorted(versions() - begun))",
    ]
    command = [sys.executable, "-W", "error", "-c", "\n".join(steps)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    begun, further = done.stdout.splitlines()[-2:]
    assert called in begun
    assert further == "[]"


def test_two_threads_that_call_first_get_one_answer():
    """A function is compiled once, answers as Python does, and keeps its name and its text."""

    @compiled
    def twice(x: float) -> float:
        """Double a number."""
        return 2.0 * x

    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(always_compiled()(twice), [float(k) for k in range(8)])) == [2.0 * k for k in range(8)]
    assert len(twice.dispatcher.signatures) == 1
    assert (twice.__name__, twice.__doc__) == ("twice", "Double a number.")


def test_one_process_at_a_time_stores_a_version(monkeypatch):
    """Of two processes that stored versions of a function at once, one gave the other's file to a third."""
    save, held = IndexDataCacheFile.save, []

    def watched(file: IndexDataCacheFile, key: object, code: object) -> None:
        try:
            with FileLock(Path(file._cache_path).parent / LOCK, blocking=False, is_singleton=False):
                held.append(False)
        except Timeout:
            held.append(True)
        save(file, key, code)

    monkeypatch.setattr(IndexDataCacheFile, "save", watched)
    monkeypatch.setattr(IndexDataCacheFile, "load", lambda file, key: None)  # else an earlier test run has stored both

    @compiled
    def thrice(x: float) -> float:
        """Three times a number."""
        return 3.0 * x

    assert (thrice(1.0), thrice(2)) == (3.0, 6)
    assert held == [True, True]


def test_each_version_of_a_function_has_a_turn_of_its_own(monkeypatch):
    """Two processes that compiled a function for two and for three dimensions waited for each other."""
    taken = []

    def refuse(lock, *_, **__):
        taken.append(Path(lock.lock_file).name)
        raise OSError

    monkeypatch.setattr(FileLock, "acquire", refuse)
    monkeypatch.setattr(IndexDataCacheFile, "load", lambda file, key: None)  # else an earlier test run has stored both

    @compiled
    def fivefold(x: float) -> float:
        """Five times a number."""
        return 5.0 * x

    assert (fivefold(1.0), fivefold(2)) == (5.0, 10)
    turns = [name for name in taken if "fivefold" in name]
    assert len(turns) == len(set(turns)) == 2


def test_no_compiled_function_has_a_whole_power():
    """Numba compiles x ** 2 once for all functions of a process, without fastmath if the first one has none.

    Then the last bit of a fit hung on which function was compiled before it, of ours or a user's. Powers that are no
    whole number call the mathematical library, and share nothing.
    """
    powers, functions = [], 0
    for path in Path(study.__file__).parent.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            words = " ".join(map(ast.unparse, getattr(node, "decorator_list", ())))
            if not re.search(r"\b(compiled|compiled_as_written|njit|overload|register_jitable)\b", words):
                continue
            functions += 1
            for part in ast.walk(node):
                if isinstance(getattr(part, "op", None), ast.Pow):
                    exponent = part.right if isinstance(part, ast.BinOp) else part.value
                    broken = any(isinstance(getattr(number, "value", None), float) for number in ast.walk(exponent))
                    powers += [] if broken else [f"{path.name}: {node.name}: {ast.unparse(part)}"]
    assert functions > 100
    assert powers == []


def test_a_users_power_takes_nothing_from_squares(monkeypatch):
    """After a user's function that has x ** 2 and no fastmath, squares in ours are still reordered and contracted."""
    monkeypatch.setattr(IndexDataCacheFile, "load", lambda file, key: None)  # else an earlier test run has stored it

    @njit(error_model="numpy")
    def of_a_user(x):
        return x**2

    @compiled
    def ours(x: float) -> float:
        return squared(x)

    assert of_a_user(1.5) == ours(1.5) == 2.25
    (code,) = ours.dispatcher.inspect_llvm().values()
    assert "fmul reassoc nsz arcp contract double" in code


@pytest.mark.parametrize("refusal", [OSError("no locks available"), NotImplementedError("no flock")])
def test_a_version_that_cannot_be_stored_is_used(monkeypatch, refusal):
    """Where a file system has no locks, a function is compiled all the same."""
    monkeypatch.setattr(FileLock, "acquire", Mock(side_effect=refusal))
    monkeypatch.setattr(IndexDataCacheFile, "load", lambda file, key: None)

    @compiled
    def fourfold(x: float) -> float:
        """Four times a number."""
        return 4.0 * x

    assert fourfold(1.5) == 6.0


@pytest.mark.parametrize("d", [2, 3, pytest.param(5, marks=pytest.mark.slow)])
@pytest.mark.parametrize("n", [6, 31, 33, 700, BLOCK, 2 * BLOCK + 300])
def test_sums_do_not_depend_on_where_points_are(rng, on_cap, d, n):
    """Moments and fits are the same, bit for bit, in any layout."""
    points = np.ascontiguousarray(on_cap(rng, n, 70.0, d, 0.1, sets=6)[0].swapaxes(1, 2))
    views = [np.repeat(points, 2, axis=2)[:, :, ::2], points[::-1][::-1], np.asfortranarray(points)]
    if d == 2:  # points that cannot be written have loops of their own
        views.append(frozen := points.copy())
        frozen.flags.writeable = False
    for other in (*views, np.ascontiguousarray(points.swapaxes(1, 2)).swapaxes(1, 2)):
        for one, two in zip(Moments.of(points), Moments.of(other), strict=True):
            np.testing.assert_array_equal(one, two)
        for estimator in ("mle", "mle_mirror", "lls", "lls_single", "ugdk"):
            fits = [ESTIMATORS[estimator](Samples(x, 0.1)) for x in (points, other)]
            for name, one, two in zip(Estimates._fields, *fits, strict=True):
                np.testing.assert_array_equal(one, two, err_msg=name)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("n", [20, 700])
def test_every_estimator_and_measure_has_one_layout(rng, on_cap, estimator, d, n):
    """Whatever the order of the points in memory, small (copied) or large (read as they are): the same bits."""
    points = np.ascontiguousarray(on_cap(rng, n, 120.0, d, 0.1, sets=6)[0].swapaxes(1, 2))
    directions = points / np.linalg.norm(points, axis=1, keepdims=True)
    truth = Truth(np.zeros(d), 1.0, 0.1, crlb(directions.swapaxes(1, 2), 0.1))
    answers = []
    for x in (points, np.asfortranarray(points), np.ascontiguousarray(points.swapaxes(1, 2)).swapaxes(1, 2)):
        fits = ESTIMATORS[estimator](Samples(x, 0.1))
        measures = (attempt(name, Samples(x), fits, estimator, truth) for name in MEASURES)
        answers.append(fits._asdict() | {k: v for values, _ in measures for k, v in values.items()})
    for other in answers[1:]:
        for name, values in answers[0].items():
            np.testing.assert_array_equal(values, other[name], err_msg=name)


COMMON = "('x86_64-unknown-linux-gnu', 'x86-64-v3', '')"

COMPILED_FOR = """
from numba.core.registry import cpu_target
print(cpu_target.target_context.codegen().magic_tuple())
"""

COMMAND = "from study import instruction_set\ninstruction_set.fix()\n"

LIBRARY = "import numpy, os\nbefore = dict(os.environ)\nfrom study.fits.loops.jit import total\ntotal(numpy.ones(2))\n"

LIBRARY += "assert os.environ == before\n"

NUMBA_BEFORE = "import numba\nnumba.njit(lambda x: x)(1)\n"

X86 = pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="other processors have one kind of code")


def target(code):
    """Name and features of the processor that a program's code is generated for."""
    unset = {"NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES", "OPENBLAS_CORETYPE", "NPY_DISABLE_CPU_FEATURES"}
    environment = {name: value for name, value in os.environ.items() if name not in unset}
    command = [sys.executable, "-c", code + COMPILED_FOR]
    return subprocess.run(command, capture_output=True, text=True, env=environment, check=True).stdout.strip()


@X86
@pytest.mark.parametrize("code", [COMMAND, LIBRARY], ids=["command", "library"])
def test_compiled_code_knows_nothing_of_the_processor_at_hand(code):
    """Neither its name nor its features: with AVX-512 among them, the same run had other bytes elsewhere.

    A program that fits has the same code, without a change in its environment, so that one cache serves both.
    """
    assert target(code) == COMMON


@X86
def test_a_program_that_compiled_before_keeps_its_code():
    """Its functions, compiled before and after the first fit, are for the processor at hand."""
    assert target(NUMBA_BEFORE + LIBRARY) == target(NUMBA_BEFORE) != COMMON


NUMPY = """
import hashlib
import numpy as np
from study.simulation.runs.provenance import fingerprint
x = np.random.default_rng(1).uniform(0.1, 10.0, 100_000)
every = [np.exp(x), np.log(x), np.tan(x), np.arcsin(0.1 * x), np.arctan2(x, 3.0), x**2.7]
print(hashlib.sha256(b"".join(numbers.tobytes() for numbers in every)).hexdigest(), fingerprint()["NumPy code for"])
"""


def numpy_code(setting, code=COMMAND):
    """Digest of functions of NumPy, and the instructions that it uses by the fingerprint; no warning is given."""
    environment = {name: value for name, value in os.environ.items() if name != "NPY_DISABLE_CPU_FEATURES"}
    command, environment = [sys.executable, "-W", "error", "-c", code + NUMPY], environment | setting
    environment.pop("NUMBA_CPU_NAME", None)
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout.split(maxsplit=1)


@X86
def test_numpy_uses_the_common_instructions():
    """Those of AVX-512 are not used by commands, and the fingerprint says so; other settings are seen in it."""
    assert "AVX512" not in numpy_code({})[-1]
    assert "X86_V4" not in numpy_code({})[-1]
    assert numpy_code({"NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR"})[1:] != numpy_code({})[1:]


CPU = Path("/proc/cpuinfo")


@pytest.mark.skipif(not CPU.exists() or "avx512f" not in CPU.read_text(), reason="this processor has no AVX-512")
def test_numpy_has_the_same_bits_with_and_without_wider_instructions():
    """On a processor with AVX-512 a command computes what one without would; a library's user is told otherwise."""
    without = numpy_code({"NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR"}, "")
    assert numpy_code({}) == without
    assert numpy_code({}, "")[1] != without[1]
