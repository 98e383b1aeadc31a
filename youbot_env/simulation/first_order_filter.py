"""The recursion of a first-order filter, compiled: each sample once, with no array in between.

It serves the filters of `identification`, and stands here with what else is compiled: importing it
imports numba, which what filters nothing does without.
"""

from __future__ import annotations

import numpy as np

from youbot_env.caching import njit


@njit(cache=True, nogil=True)
def filtered(start, end, decay, weight_start, weight_end, out):
    """Fill out (N, W) with the response to signals at both ends of N - 1 intervals."""
    count, width = start.shape
    for c in range(width):
        out[0, c] = 0.0
    for k in range(count):
        for c in range(width):
            new = weight_start * start[k, c] + weight_end * end[k, c]
            out[k + 1, c] = decay * out[k, c] + new


@njit(cache=True, nogil=True)
def filtered_means(start, end, decay, weight_start, weight_end, first, size, out):
    """Fill out (n, W) with means of ``size`` successive samples of ``filtered``, from ``first`` on.

    The filtered signal itself, many times as large, is never held.
    """
    width, rows = start.shape[1], out.shape[0]
    now, total = np.zeros(width), np.zeros(width)
    share, row, held = 1.0 / size, 0, 0
    for sample in range(first + rows * size if rows else 0):
        if sample:
            for c in range(width):
                new = weight_start * start[sample - 1, c] + weight_end * end[sample - 1, c]
                now[c] = decay * now[c] + new
        if sample >= first:
            for c in range(width):
                total[c] += now[c]
            held += 1
            if held == size:
                for c in range(width):
                    out[row, c] = share * total[c]
                    total[c] = 0.0
                row, held = row + 1, 0
