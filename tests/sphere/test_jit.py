"""Compiled code in the cache never outlives a change in its sources, and computes the bits of code just compiled."""

import os
import pickle
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

import study
from study.sphere.jit import COMPILING, aligned, compiled, total

PROGRAM = """
import numpy as np
from study.sphere.bounds import _scatter, weighted_scatter
sums, _, _ = weighted_scatter(np.ones((1, 2, 4)), np.ones((1, 4)))
print(sums[0], sum(_scatter.code.stats.cache_hits.values()))
"""

TWO_LOOPS = """
import numpy as np
from study.sphere.jit import fill, total
fill(np.ones(2), 0.0), total(np.ones(2))
print(*(sum(loop.code.stats.cache_hits.values()) for loop in (fill, total)))
"""

FITS = """
import hashlib
import numpy as np
from study.estimators import ESTIMATORS, Samples
rng, answers = np.random.default_rng(3), []
for n in (5, 10, 20, 100):
    x = rng.standard_normal((300, 3, n))
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    samples = Samples(x + 0.1 * rng.standard_normal(x.shape), 0.1)
    answers += [ESTIMATORS[name](samples) for name in ("lls", "mle", "ugdk")]
print(hashlib.sha256(b"".join(f.center.tobytes() + f.noise_variance.tobytes() for f in answers)).hexdigest())
"""


@pytest.fixture
def package(tmp_path):
    """A copy of the package, without its caches, and a way to run a program with it in a new process."""
    copy = tmp_path / "study"
    shutil.copytree(Path(study.__file__).parent, copy, ignore=shutil.ignore_patterns("__pycache__"))
    environment = {key: value for key, value in os.environ.items() if not key.startswith(("NUMBA", "PYTHON"))}

    def run(program=PROGRAM):
        command = [sys.executable, "-W", "error", "-c", program]
        done = subprocess.run(
            command, cwd=tmp_path, env={**environment, "PYTHONPATH": str(tmp_path)}, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stderr
        warnings.append(done.stderr)
        return done.stdout.split()

    warnings = run.warnings = []
    return copy, run


def test_change_in_a_called_function_reaches_its_caller(package):
    """`_scatter` inlines `total`: it comes from the cache until `total` changes, and then is compiled anew."""
    copy, run = package
    assert run() == ["4.0", "0"]
    assert run() == ["4.0", "1"]
    source = copy / "sphere" / "jit.py"
    text = source.read_text()
    assert text.count("result += row[k]") == 1
    source.write_text(text.replace("result += row[k]", "result += 3.0 * row[k]"))
    assert run() == ["12.0", "0"]


@pytest.mark.parametrize(("changed", "discarded"), [("mocap/geometry/kabsch.py", True), ("report/page.py", False)])
def test_changes_that_discard_the_cache(package, changed, discarded):
    """A change in any folder with compiled code discards that of all such folders; a change elsewhere does not."""
    copy, run = package
    used = "from study.sphere.jit import total; import numpy; total(numpy.ones(2))"
    run(used)
    stale = copy / "mocap" / "geometry" / "__pycache__" / "kabsch.some_kernel.nbi"
    stale.parent.mkdir(exist_ok=True)
    stale.touch()
    run(used)
    assert stale.exists()
    with (copy / changed).open("a") as source:
        source.write("# changed\n")
    run(used)
    assert stale.exists() != discarded


def test_code_just_compiled_and_code_from_the_cache_have_the_same_bits(package):
    """LLS in the process that compiled it once differed in the last bit from LLS in all others."""
    _, run = package
    assert run(FITS) == run(FITS)


def test_the_library_and_the_commands_share_the_cache_and_compilation_is_announced_once(package):
    """Two functions are compiled with one line on standard error; the other kind of program finds both, and is silent.

    A program that wants no such line sets its logs up.
    """
    _, run = package
    command = f"from study.text import instruction_set\ninstruction_set.fix()\n{TWO_LOOPS}"
    assert run(command) == ["0", "0"]
    assert run(TWO_LOOPS) == ["1", "1"]
    assert run.warnings == [f"{COMPILING}\n", ""]


def test_a_program_can_silence_the_compiler(package):
    """The line is a warning of the log `study`."""
    _, run = package
    assert run(f"import logging\nlogging.getLogger('study').setLevel('ERROR')\n{TWO_LOOPS}") == ["0", "0"]
    assert run.warnings == [""]


def test_two_threads_that_call_first_share_one_compiled_function():
    """Every call before the compiler is loaded comes to the same function, which answers as Python does."""

    @compiled
    def twice(x: float) -> float:
        """Double a number."""
        return 2.0 * x

    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(twice, range(8))) == [2.0 * k for k in range(8)]
        assert len(set(pool.map(lambda _: id(twice.code), range(8)))) == 1
    assert (twice.__name__, twice.__doc__) == ("twice", "Double a number.")


@pytest.mark.parametrize("count", [1, 5, 256])
def test_aligned_memory_begins_with_a_cache_line(count):
    """Its address is a multiple of 64 bytes, and it has as many numbers as asked for, which are its own."""
    rows = [aligned(count) for _ in range(20)]
    assert all(row.ctypes.data % 64 == 0 and row.shape == (count,) and row.flags.c_contiguous for row in rows)
    for k, row in enumerate(rows):
        row[:] = k
    assert [row.sum() for row in rows] == [count * k for k in range(20)]


def test_kernels_are_pickled_by_name():
    """A worker process gets the function of its own package."""
    assert pickle.loads(pickle.dumps(total)) is total
