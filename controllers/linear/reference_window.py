"""The reference around the present: its last and coming samples, and interpolation between them.

A window ``nodes`` (n, 6) holds a sample a row, one period apart: twist (3,) [m/s, m/s, rad/s] and
acceleration (3,). Row ``past`` is the present sample; places in the window are counted in periods
from row 0, so that a delay or the age of a measurement is a place between two rows. All functions
are compiled and fill arrays that the caller keeps.
"""

from __future__ import annotations

from youbot_env.caching import njit


@njit(cache=True, error_model="numpy")
def reference_at(nodes, place, period, out):
    """Fill ``out`` (6,) with twist and acceleration at ``place``.

    A cubic Hermite polynomial between two rows; beyond the last (first) row, that row's
    acceleration is kept."""
    last = nodes.shape[0] - 1
    index = min(max(int(place), 0), last - 1)
    u = place - index
    for axis in range(3):
        if u > 1.0 or u < 0.0:
            edge = last if u > 1.0 else 0
            out[axis] = nodes[edge, axis] + (place - edge) * period * nodes[edge, 3 + axis]
            out[3 + axis] = nodes[edge, 3 + axis]
            continue
        v0, v1 = nodes[index, axis], nodes[index + 1, axis]
        a0, a1 = period * nodes[index, 3 + axis], period * nodes[index + 1, 3 + axis]
        rise = v1 - v0
        # Coefficients of u^2 and u^3 that meet both twists and both accelerations.
        bend, twist = 3.0 * rise - 2.0 * a0 - a1, a0 + a1 - 2.0 * rise
        out[axis] = v0 + u * (a0 + u * (bend + u * twist))
        out[3 + axis] = (a0 + u * (2.0 * bend + 3.0 * u * twist)) / period


@njit(cache=True, error_model="numpy")
def take_sample(nodes, past, seen, coming, has_slopes, period):
    """Move ``nodes`` on by one sample. ``seen`` (6,) is the present one, at index ``past``; the
    next ones, ``coming`` of them, are already there, with their accelerations if ``has_slopes``.
    Rows after them are filled with the last acceleration."""
    # Only the past is shifted: the caller has written the coming samples at their new rows.
    for row in range(past):
        nodes[row] = nodes[row + 1]
    nodes[past] = seen
    end = past + coming
    if not has_slopes:
        for row in range(past + 1, end + 1):
            for axis in range(3):
                if row < end:
                    # Central difference: exact where the reference is a parabola.
                    slope = 0.5 * (nodes[row + 1, axis] - nodes[row - 1, axis])
                else:
                    # The last known sample has one neighbour: a parabola through it and the
                    # acceleration before.
                    slope = 2.0 * (nodes[row, axis] - nodes[row - 1, axis])
                    slope -= period * nodes[row - 1, 3 + axis]
                nodes[row, 3 + axis] = slope / period
    for row in range(end + 1, nodes.shape[0]):
        for axis in range(3):
            slope = nodes[end, 3 + axis]
            nodes[row, axis] = nodes[end, axis] + (row - end) * period * slope
            nodes[row, 3 + axis] = slope


@njit(cache=True, error_model="numpy")
def extend_to_past(nodes, past, period):
    """Fill the rows before the first sample, as if its acceleration had been constant before."""
    for row in range(past):
        for axis in range(3):
            slope = nodes[past, 3 + axis]
            nodes[row, axis] = nodes[past, axis] - (past - row) * period * slope
            nodes[row, 3 + axis] = slope
