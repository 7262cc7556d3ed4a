"""Random streams by name, and random words and normal numbers in compiled loops. No generator is made anywhere else.

The name of a stream is the study's seed, a purpose, and words or numbers that distinguish it from similar streams. It
is hashed into a `SeedSequence` spawn key. So no number depends on the order of work, the number of workers or other
results, and any stream can be made again from its name. SFC64 is the fastest of NumPy's bit generators.

In compiled loops generators stand side by side, of which a processor steps several at a time. Each is SFC64, as in
NumPy, and its state is a column of an array. They give their words in turn. One more generator, the spare, gives the
words that are needed now and then, so that the others never wait.

Source: SFC64 by C. Doty-Humphrey (PractRand).

Normal numbers from random words, in compiled loops: NumPy's method and tables, in a fifth of its time.

The sign of a number is read from the table of layers instead of being a branch that no processor can predict, and the
words are made many at a time. One number in ninety lies outside its layer's rectangle;
the further words that it needs come from the spare generator.

Source: Marsaglia & Tsang, J. Stat. Softw. 5 (2000) 8, in 256 layers, as NumPy's `standard_normal` has it.
"""

import hashlib
import math

import numpy as np
from numba.np.random._constants import fi_double, ki_double, wi_double, ziggurat_nor_inv_r, ziggurat_nor_r

from study.arrays import Floats, Ints, Words
from study.fits.loops.jit import compiled, float_of

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
    """Make the state of a named stream for compiled loops: the parallel generators below.

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


Lane = tuple[np.uint64, np.uint64, np.uint64, np.uint64]
"""State of one generator: a, b, c and the counter."""

LANES = 32
WORDS = 3 * (LANES + 1)
"""Number of random words of 64 bits that seed a state."""
_WARM_UP = 12
_STEPS = 4
"""Steps that a generator takes while its state is in registers."""
_1, _3, _11, _12, _24, _40 = (np.uint64(k) for k in (1, 3, 11, 12, 24, 40))
_ONE = np.uint64(0x3FF0000000000000)
"""The bits of 1.0."""


def seeded(words: Words) -> Words:
    """Return the state (4, LANES + 1) that random words (WORDS,) seed, as NumPy seeds its own; the spare is last."""
    state = np.ones((4, LANES + 1), dtype=np.uint64)
    state[:3] = words.reshape(3, LANES + 1)
    _warm_up(state, np.empty(LANES, dtype=np.uint64))
    return state


@compiled
def next_word(lane: Lane) -> tuple[np.uint64, Lane]:
    """The next word of a generator, and its state after it."""
    a, b, c, count = lane
    bits = a + b + count
    return bits, (b ^ (b >> _11), c + (c << _3), ((c << _24) | (c >> _40)) + bits, count + _1)


@compiled
def spare(state: Words) -> Lane:
    """State of the spare generator, as a tuple that stays in registers."""
    return state[0, LANES], state[1, LANES], state[2, LANES], state[3, LANES]


@compiled
def put_back(state: Words, lane: Lane) -> None:
    """Store the state of the spare generator."""
    state[0, LANES], state[1, LANES], state[2, LANES], state[3, LANES] = lane


@compiled
def _step(state: Words, words: Words, steps: int) -> None:
    """Take some steps with each generator, whose number the compiler knows: LANES words, and so on."""
    first, second, third, counts = state[0, :LANES], state[1, :LANES], state[2, :LANES], state[3, :LANES]
    for k in range(LANES):
        lane = first[k], second[k], third[k], counts[k]
        for step in range(steps):
            words[step * LANES + k], lane = next_word(lane)
        first[k], second[k], third[k], counts[k] = lane


@compiled
def fill_words(state: Words, words: Words) -> None:
    """Fill a row with words, LANES at a time; its length is a multiple of that."""
    whole = words.size - words.size % (_STEPS * LANES)
    for start in range(0, whole, _STEPS * LANES):
        _step(state, words[start : start + _STEPS * LANES], _STEPS)
    for start in range(whole, words.size, LANES):
        _step(state, words[start : start + LANES], 1)


@compiled
def uniform(word: np.uint64) -> float:
    """A number in [0, 1) from the upper 53 bits of a word."""
    return np.int64(word >> _11) * (1.0 / 9007199254740992.0)


@compiled
def from_one(word: np.uint64) -> float:
    """A number in [1, 2), of which the upper 52 bits of a word are the fraction.

    Processors that turn several integers into floats at once are rare.
    """
    return float_of((word >> _12) | _ONE)


@compiled
def to_uniform(words: Words, row: Floats) -> None:
    """Turn words into as many numbers in [0, 1)."""
    for k in range(row.size):
        row[k] = from_one(words[k]) - 1.0


@compiled
def _warm_up(state: Words, words: Words) -> None:
    lane = spare(state)
    for _ in range(_WARM_UP):
        fill_words(state, words)
        _, lane = next_word(lane)
    put_back(state, lane)


_WIDTH = np.concatenate([wi_double, -np.asarray(wi_double)])
"""Width of each layer over 2⁵²; the second half is for negative numbers."""
_INSIDE = np.array(ki_double, dtype=np.uint64)
_HEIGHT = np.array(fi_double)
_EDGE, _INVERSE_EDGE = ziggurat_nor_r, ziggurat_nor_inv_r
_LAYERS = np.uint64(255)
_MANTISSA = np.uint64(2**52 - 1)
_SIGNED = np.uint64(511)
_1, _8, _9 = (np.uint64(k) for k in (1, 8, 9))


@compiled
def _outside(lane: Lane, bits: np.uint64, layer: np.uint64, x: float) -> tuple[float, bool, Lane]:
    """Draw a number outside its layer's rectangle.

    Returns the number, False if it is rejected, and the state of the generator.
    """
    if layer == 0:
        while True:
            first, lane = next_word(lane)
            second, lane = next_word(lane)
            beyond = -_INVERSE_EDGE * math.log1p(-uniform(first))
            height = -math.log1p(-uniform(second))
            if height + height > beyond * beyond:
                x = _EDGE + beyond
                return -x if (bits >> _9 >> _8) & _1 else x, True, lane
    first, lane = next_word(lane)
    height = (_HEIGHT[layer - 1] - _HEIGHT[layer]) * uniform(first) + _HEIGHT[layer]
    return x, height < math.exp(-0.5 * x * x), lane


@compiled
def _settled(bits: np.uint64, lane: Lane) -> tuple[float, Lane]:
    """The number of a word that may lie outside its layer's rectangle, and the state of the generator."""
    while True:
        layer = bits & _SIGNED
        size = (bits >> _9) & _MANTISSA
        x = np.int64(size) * _WIDTH[layer]
        if size < _INSIDE[layer & _LAYERS]:
            return x, lane
        x, accepted, lane = _outside(lane, bits, layer & _LAYERS, x)
        if accepted:
            return x, lane
        bits, lane = next_word(lane)


@compiled
def to_normals(words: Words, row: Floats, lane: Lane, outside: Ints) -> Lane:
    """Turn words into as many normal numbers.

    Numbers outside their layers' rectangles are listed, without a branch that a processor could mispredict, and settled
    after the others. ``lane`` is the state of another generator, for numbers that need more than their word; its state
    afterwards is returned. ``outside`` is memory for as many integers. `standard_normal` makes the same numbers of the
    same words, in the order in which it would ask for them.
    """
    count = 0
    for k in range(row.size):
        bits = words[k]
        layer = bits & _SIGNED
        size = (bits >> _9) & _MANTISSA
        row[k] = np.int64(size) * _WIDTH[layer]
        outside[count] = k
        count += size >= _INSIDE[layer & _LAYERS]
    for j in range(count):
        k = outside[j]
        row[k], lane = _settled(words[k], lane)
    return lane
