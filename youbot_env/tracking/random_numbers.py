"""Random numbers from a counter: number k of a stream needs no number before it.

Philox4x32-10 of Salmon, Moraes, Dror, Shaw, "Parallel random numbers: as easy as 1, 2, 3", SC'11:
four words of 32 bits from a counter of four words and a key of two. An episode's numbers depend on
its key, its number and what they are for, so they are the same in whatever row, thread or batch.
"""

from __future__ import annotations

import numpy as np

from youbot_env.caching import njit
from youbot_env.simulation import lane_math_single as single
from youbot_env.simulation.lane_math import given, put

NOISE, MODEL, REFERENCE = 0, 1, 2
"""What a stream is for: so that noise switched on leaves model and reference as they were."""

_MASK = np.uint64(0xFFFFFFFF)
_HALF = np.uint64(32)
_FIRST, _SECOND = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)
_HALF_RANGE = np.int64(2**31)
_SHARE, _QUARTER = np.float32(2.0**-32), np.float32(0.25)
_BELOW_ONE = np.float32(1.0 - 2.0**-24)
_STEP_FIRST, _STEP_SECOND = np.uint64(0x9E3779B9), np.uint64(0xBB67AE85)


@njit(cache=True, error_model="numpy", forceinline=True)
def philox(c0, c1, c2, c3, k0, k1):
    """Four words of 32 bits, each in a uint64, from such words of a counter and a key."""
    for _ in range(10):
        a, b = _FIRST * c0, _SECOND * c2
        c0, c1, c2, c3 = (b >> _HALF) ^ c1 ^ k0, b & _MASK, (a >> _HALF) ^ c3 ^ k1, a & _MASK
        k0, k1 = (k0 + _STEP_FIRST) & _MASK, (k1 + _STEP_SECOND) & _MASK
    return c0, c1, c2, c3


@njit(cache=True, error_model="numpy", forceinline=True)
def words(key, episode, purpose, index):
    """Words number ``index`` of an episode's stream; key (uint64) and the others int64."""
    return philox(
        np.uint64(index) & _MASK,
        np.uint64(purpose),
        np.uint64(episode) & _MASK,
        np.uint64(index) >> _HALF,
        key & _MASK,
        key >> _HALF,
    )


@njit(cache=True, error_model="numpy", nogil=True)
def normal_numbers(keys, episodes, indices, lanes, width, out):
    """Four normal numbers of each of ``lanes`` rows, by Box and Muller, ``width`` apart in ``out``.

    They are in single precision, also where platforms are in double: noise has no more digits to
    lose, and the largest number is 6.7.
    """
    for i in range(lanes):
        key = np.uint64(given(keys, i))
        a, b, c, d = words(key, given(episodes, i), NOISE, given(indices, i))
        put(out, i, np.float32(a))
        put(out, width + i, np.float32(np.int64(b) - _HALF_RANGE))
        put(out, 2 * width + i, np.float32(c))
        put(out, 3 * width + i, np.float32(np.int64(d) - _HALF_RANGE))
    # A loop of its own: numbers of one size alone, as many at a time as an instruction takes.
    for i in range(lanes):
        size, other = _size(given(out, i)), _size(given(out, 2 * width + i))
        turns, more = _SHARE * given(out, width + i), _SHARE * given(out, 3 * width + i)
        put(out, i, size * single.sine_of_turns(turns))
        put(out, width + i, size * single.sine_of_turns(turns + _QUARTER))
        put(out, 2 * width + i, other * single.sine_of_turns(more))
        put(out, 3 * width + i, other * single.sine_of_turns(more + _QUARTER))


@njit(cache=True, error_model="numpy", forceinline=True)
def _size(word):
    """Length of two normal numbers side by side, from a random word."""
    # Half a step away from 0, whose logarithm is infinite.
    share = (word + np.float32(0.5)) * _SHARE
    share = _BELOW_ONE if share > _BELOW_ONE else share
    return np.sqrt(np.float32(-2.0) * single.log_of_share(share))
