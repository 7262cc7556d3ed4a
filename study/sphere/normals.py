"""Normal numbers inside compiled loops: NumPy's own stream, to the bit, in a fifth of its time.

NumPy's `Generator.standard_normal` with its SFC64 bit generator, taken apart so that the generator's state stays in
registers and the sign of a number is read from the table of layers instead of being a branch that no processor can
foresee.

Source: Marsaglia & Tsang, J. Stat. Softw. 5 (2000) 8, in 256 layers; SFC64 by C. Doty-Humphrey (PractRand).
"""

import math
from typing import Any

import numpy as np
from numba.np.random._constants import fi_double, ki_double, wi_double, ziggurat_nor_inv_r, ziggurat_nor_r
from numpy.typing import NDArray

from study.sphere.compiled import compiled

State = NDArray[np.uint64]

_WIDTH = np.concatenate([wi_double, -np.asarray(wi_double)])
"""Width of each layer over 2⁵²; the second half is for negative numbers."""
_INSIDE = np.array(ki_double, dtype=np.uint64)
_HEIGHT = np.array(fi_double)
_EDGE, _INVERSE_EDGE = ziggurat_nor_r, ziggurat_nor_inv_r
_LAYERS = np.uint64(255)
_MANTISSA = np.uint64(2**52 - 1)
_1, _3, _8, _9, _11, _24, _40 = (np.uint64(k) for k in (1, 3, 8, 9, 11, 24, 40))
_SIGNED = np.uint64(511)


def state_of(rng: np.random.Generator) -> State:
    """The state of a generator that is of the kind SFC64, (4,)."""
    name = type(rng.bit_generator).__name__
    if name != "SFC64":
        raise TypeError(f"the generator draws from {name}: its bits must come from SFC64")
    found: Any = rng.bit_generator.state
    return np.array(found["state"]["state"], dtype=np.uint64)


@compiled
def loaded(state: Any) -> Any:
    """A state as a tuple, to be kept in registers."""
    return state[0], state[1], state[2], state[3]


@compiled
def _next(state: Any) -> Any:
    """64 bits, and the state after them."""
    a, b, c, counter = state
    bits = a + b + counter
    return bits, (b ^ (b >> _11), c + (c << _3), ((c << _24) | (c >> _40)) + bits, counter + _1)


@compiled
def _uniform(bits: Any) -> Any:
    return (bits >> _11) * (1.0 / 9007199254740992.0)


@compiled
def _outside(state: Any, bits: Any, layer: int, x: float) -> Any:
    """One time in ninety: a number beyond its layer's rectangle. Returns it, whether it counts, and the state."""
    if layer == 0:
        while True:
            first, state = _next(state)
            second, state = _next(state)
            beyond = -_INVERSE_EDGE * math.log1p(-_uniform(first))
            height = -math.log1p(-_uniform(second))
            if height + height > beyond * beyond:
                x = _EDGE + beyond
                return -x if (bits >> _9 >> _8) & _1 else x, True, state
    first, state = _next(state)
    height = (_HEIGHT[layer - 1] - _HEIGHT[layer]) * _uniform(first) + _HEIGHT[layer]
    return x, height < math.exp(-0.5 * x * x), state


@compiled
def fill_normal(state: Any, row: Any) -> Any:
    """Fill a row as ``standard_normal(out=row)`` would; takes and gives the state as a tuple (see `loaded`)."""
    for k in range(row.size):
        while True:
            bits, state = _next(state)
            layer = bits & _SIGNED
            size = (bits >> _9) & _MANTISSA
            x = size * _WIDTH[layer]
            if size < _INSIDE[layer & _LAYERS]:
                break
            x, counts, state = _outside(state, bits, layer & _LAYERS, x)
            if counts:
                break
        row[k] = x
    return state
