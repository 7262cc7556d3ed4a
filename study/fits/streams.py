"""Random streams by name. No generator is made anywhere else.

The name of a stream is the study's seed, a purpose, and words or numbers that distinguish it from similar streams. It
is hashed into a `SeedSequence` spawn key. So no number depends on the order of work, the number of workers or other
results, and any stream can be made again from its name. SFC64 is the fastest of NumPy's bit generators.
"""

import hashlib

import numpy as np

from study.arrays import Words
from study.fits.random import WORDS, seeded

Name = tuple[str | int | float, ...]
OldStream = np.random.RandomState


def stream(seed: int, *name: str | int | float) -> np.random.Generator:
    """Make the generator of a named stream.

    Args:
        seed: the study's seed.
        name: words and numbers; 1 and 1.0 are different names, floats count to the last bit.

    Returns:
        A fresh generator at the start of its stream.
    """
    return np.random.Generator(np.random.SFC64(_sequence(seed, name)))


def lanes(seed: int, *name: str | int | float) -> Words:
    """Make the state of a named stream for compiled loops: the parallel generators of `study.fits.random`.

    Every word of the first state is a hash of the name, which costs less than a `SeedSequence`.
    """
    return seeded(np.frombuffer(hashlib.shake_128(repr((seed, *name)).encode()).digest(8 * WORDS), dtype="<u8"))


def old_stream(seed: int, *name: str | int | float) -> OldStream:
    """Make the generator of a named stream for emcee, which draws from NumPy's old kind of generator."""
    return OldStream(np.random.MT19937(_sequence(seed, name)))


def _sequence(seed: int, name: Name) -> np.random.SeedSequence:
    digest = hashlib.blake2b(repr(name).encode(), digest_size=16).digest()
    key = tuple(int.from_bytes(digest[i : i + 4], "little") for i in range(0, 16, 4))
    return np.random.SeedSequence(seed, spawn_key=key)
