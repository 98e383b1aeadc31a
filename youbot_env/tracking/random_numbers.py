"""Random numbers from a counter: number k of a stream needs no number before it.

Philox4x32-10 of Salmon, Moraes, Dror, Shaw, "Parallel random numbers: as easy as 1, 2, 3", SC'11:
four words of 32 bits from a counter of four words and a key of two. An episode's numbers depend on
its key, its number and what they are for, so they are the same in whatever row, thread or batch.
"""

from __future__ import annotations

import numpy as np

from youbot_env.caching import njit

NOISE, MODEL, REFERENCE = 0, 1, 2
"""What a stream is for: so that noise switched on leaves model and reference as they were."""

_MASK = np.uint64(0xFFFFFFFF)
_HALF = np.uint64(32)
_FIRST, _SECOND = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)
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
