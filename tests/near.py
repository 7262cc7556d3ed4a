"""Bits of fits as they are, and as if small arrays lay side by side in memory: they have to be the same.

A loop that stores to one array and reads another has two versions in compiled code: with vector instructions, and
without, for arrays so near to each other that a store could come before a read. A distance decides, where the program
runs. If the loop also carries a sum, its last bit depends on where small arrays happen to lie. Here the decision is
always "near". The code comes from the cache, so that it is the same but for this decision.

Not a test: a test starts it for some estimators. ``python tests/near.py 2 3 4 5 6 7 8`` compares all estimators,
measures and intervals in these dimensions, by hand; it takes minutes for each that has to be compiled.
"""

import io
import re
import subprocess
import sys
from pathlib import Path

from study import instruction_set

instruction_set.fix()

import llvmlite.binding as llvm  # noqa: E402
import numpy as np  # noqa: E402
from numba.core import codegen, event  # noqa: E402

import study  # noqa: E402
from study.fits import ESTIMATORS, Samples, mgdk  # noqa: E402
from study.fits.errors.intervals import intervals  # noqa: E402
from study.fits.loops.jit import always_compiled, compiled  # noqa: E402
from study.fits.points.information import crlb  # noqa: E402
from study.simulation.experiment.measures import MEASURES, Truth, attempt  # noqa: E402

NOISE = 0.1
PER_POINT = ("corrected", "mle", "als", "ugdk", "gdke")
"""Estimators that take the noise of each point."""

_NEARNESS = re.compile(r"(%diff\.check\S* = icmp )\w+ i64 .*")
"""LLVM's comparison of a distance with that of one vector instruction (or of some)."""
_BLOCK = re.compile(r"^(\S+):.*\n((?:  .*\n)+)", re.MULTILINE)
_TARGET = re.compile(r"label %([^\s,]+)")


@compiled
def stored_and_summed(source, target):
    """A loop that does both: what has to be noticed."""
    total = 0.0
    for i in range(source.size):
        half = 0.5 * source[i]
        target[i] = half
        total += half * half
    return total


def loops(code):
    """Names of vectorised loops that are chosen by nearness, store, and carry a floating sum, in LLVM's text."""
    for function in code.split("\ndefine ")[1:]:
        blocks = dict(_BLOCK.findall(function))
        for text in blocks.values():
            if "%diff.check" not in text:
                continue
            todo, done = set(_TARGET.findall(text)), set()
            while todo:
                name = todo.pop()
                done.add(name)
                body = blocks.get(name, "")
                if name in _TARGET.findall(body) and "store <" in body and re.search(r"phi <\d+ x double>", body):
                    yield re.search(r'@"?([^"(]+)', function).group(1)
                todo |= {n for n in _TARGET.findall(body) if n.startswith("vec")} - done


def answer_near(found):
    """Have code from the cache take the version for near arrays from now on; names of `loops` go into a list."""
    real = codegen.JITCodeLibrary._unserialize.__func__

    def unserialized(cls, owner, state):
        name, kind, (_, bitcode) = state
        assert kind == "object"
        code = str(llvm.parse_bitcode(bitcode))
        found.extend(loops(code))
        module = llvm.parse_assembly(_NEARNESS.sub(r"\1eq i64 0, 0", code))
        return real(cls, owner, (name, "bitcode", module.as_bitcode()))

    codegen.JITCodeLibrary._unserialize = classmethod(unserialized)


def points(d, n, sets):
    """Points on noisy spheres of radius 1, their directions, the same in every process."""
    rng = np.random.default_rng([d, n])
    u = rng.standard_normal((sets, n, d))
    u /= np.linalg.norm(u, axis=2, keepdims=True)
    return u + NOISE * rng.standard_normal(u.shape) + 1.0, u, rng


def estimates(d, names):
    """Fits of some estimators in d dimensions: names and arrays."""
    for n in (d + 4, 20, 300):
        x, _, _ = points(d, n, max(600 // n, 4))
        for name in names:
            fits = ESTIMATORS[name](Samples(np.ascontiguousarray(x.swapaxes(1, 2)), NOISE))
            yield from ((f"{name}.{field}", array) for field, array in zip(fits._fields, fits, strict=True))


def everything(d):
    """Fits of all estimators in d dimensions, measures, and intervals, with weights and with markers."""
    for n in (d + 4, 20, 300):
        x, u, _ = points(d, n, max(600 // n, 4))
        samples = Samples(np.ascontiguousarray(x.swapaxes(1, 2)), NOISE)
        bare = Samples(samples.x)
        truth = Truth(np.ones(d), 1.0, NOISE, crlb(u, NOISE))
        for name, entry in ESTIMATORS.items():
            fits = entry(samples)
            yield from ((f"{name}.{field}", array) for field, array in zip(fits._fields, fits, strict=True))
            for measure in MEASURES:
                yield from attempt(measure, bare, fits, name, truth)[0].items()
        yield from ((f"intervals {k}", array) for k, array in enumerate(intervals(bare)[:2]))
    x, _, rng = points(d, 20, 4)
    for noise in (NOISE, NOISE * rng.uniform(0.5, 2.0, x.shape[:2])):
        for radius in (None, 1.0, (1.0, 0.1)):
            for name in PER_POINT:
                fit = study.fit(x, name, noise, radius=radius)
                yield from ((f"{name} {of}", fit.interval(of)) for of in ("center", "radius"))
                yield from (
                    (f"{name} {of}", getattr(fit, of)) for of in ("center", "radius", "standard_errors", "status")
                )
    joint = mgdk(list(x), NOISE)
    yield from ((f"markers {of}", joint.interval(of)) for of in ("center", "radius"))
    yield from (("markers", np.r_[joint.center, joint.radii, joint.standard_errors]),)


def compute(near, *wanted):
    """Write numbers to standard output, in binary; what is compiled and not read from the cache is an error."""
    names = [word for word in wanted if not word.isdigit()]
    found, memory = [], np.zeros((200, 1000))
    if near:
        answer_near(found)
    with always_compiled(), event.install_recorder("numba:compile") as compilations:
        memory[:, :8] = np.random.default_rng(1).standard_normal((200, 8))
        known = [stored_and_summed(row[:8], row[500:508]) for row in memory]
        results = {"stored and summed": np.array(known)}
        for d in map(int, filter(str.isdigit, wanted)):
            made = enumerate(estimates(d, names) if names else everything(d))
            results |= {f"d = {d}, {k}: {name}": np.asarray(a) for k, (name, a) in made}
    assert not (near and compilations.buffer), "some code was not in the cache"
    np.savez(sys.stdout.buffer, loops=np.array(found, dtype=str), **results)


def compare(*wanted):
    """Compare dimensions, for some estimators if there are names, else for all and everything.

    Names of arrays and counts of numbers whose bits differ; names of `loops`; how many numbers were compared.
    """
    command, made = [sys.executable, "-W", "ignore", __file__], []
    for kind in ("as it is", "near"):
        done = subprocess.run([*command, kind, *map(str, wanted)], cwd=Path(__file__).parents[1], stdout=-1, check=True)
        made.append(np.load(io.BytesIO(done.stdout)))
    ordinary, near = made
    differ = {}
    for name in sorted(set(ordinary) - {"loops"}):
        one, two = (np.ravel(kind[name]) for kind in made)
        count = int(((one != two) & ~((one != one) & (two != two))).sum())
        differ |= {name: count} if count else {}
    return differ, sorted(set(near["loops"].tolist())), sum(ordinary[name].size for name in ordinary)


if __name__ == "__main__":
    kind, *arguments = sys.argv[1:]
    if kind in ("as it is", "near"):
        compute(kind == "near", *arguments)
    else:
        print(*compare(*sys.argv[1:]), sep="\n")
