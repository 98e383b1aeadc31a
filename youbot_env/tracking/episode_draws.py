"""What an episode draws at its start, compiled: its model's parameters and its reference.

It is in double precision whatever the platforms are simulated in, so that both kinds follow the
same reference.
"""

from __future__ import annotations

import math

import numpy as np

from youbot_env.caching import njit
from youbot_env.motions.multisine import PEAK_BOUND
from youbot_env.simulation import lane_math_single as single
from youbot_env.simulation.lane_math import bits_of, fma, given, number_of, put, sine_of_turns
from youbot_env.tracking.random_numbers import MODEL, REFERENCE, words

FIXED, UNIFORM, NORMAL = 0, 1, 2
"""How a model's parameters are drawn; see ``stated_parameters``."""

ATTEMPTS = 1000
"""Draws of a model until one is physical. Sources of which hardly a draw is are refused before."""

PHASES = 65536
"""Phases that a tone can have: two bytes of memory."""

PHASE_DRAWS = 16
"""Sets of phases tried for the flattest reference, as ``motions.multisine`` does."""

COARSE = 4
"""The flattest set is chosen on every fourth point of the grid on which its peak is then found."""

_TO_SHARE = 2.0**-32


@njit(cache=True, error_model="numpy", nogil=True)
def stated_parameters(kind, mean, spread, lower, upper, key, episode, attempt, out):
    """Parameters (Q,) as people state them; False if one leaves its bounds.

    UNIFORM: mean + spread[:, 0] u, with u from 0 to 1; NORMAL: mean + spread z, with z normal.
    """
    size = len(mean)
    for j in range(size):
        out[j] = mean[j]
    for j in range(size):
        a, b, c, _ = words(key, episode, MODEL, attempt * size + j)
        share = (np.float64(a) + (np.float64(b) + 0.5) * _TO_SHARE) * _TO_SHARE
        if kind == UNIFORM:
            out[j] += spread[j, 0] * share
        else:
            turn = 2.0 * math.pi * (np.float64(c) * _TO_SHARE)
            z = math.sqrt(-2.0 * math.log(share)) * math.cos(turn)
            for k in range(size):
                out[k] += spread[k, j] * z
    inside = True
    for j in range(size):
        inside = inside and lower[j] <= out[j] <= upper[j]
    return inside


@njit(cache=True, error_model="numpy", nogil=True)
def _harmonics(tones, first, last, key, episode, out):
    """Distinct harmonics (3 tones,), dealt to the axes: out[axis * tones + tone]. Counts draws."""
    needed, drawn = 3 * tones, 0
    chosen = np.empty(needed, np.int64)
    # Floyd's sampling without replacement, kept in order.
    for step in range(needed):
        top = last - needed + 1 + step
        word = words(key, episode, REFERENCE, drawn)[0]
        drawn += 1
        pick = first + np.int64((word * np.uint64(top - first + 1)) >> np.uint64(32))
        place = 0
        while place < step and chosen[place] < pick:
            place += 1
        if place < step and chosen[place] == pick:
            # Already there: the highest allowed one is not, and is greater than all.
            chosen[step] = top
        else:
            for k in range(step, place, -1):
                chosen[k] = chosen[k - 1]
            chosen[place] = pick
    # Three neighbours, one to each axis, so every axis covers the band.
    for tone in range(tones):
        a, b, _, _ = words(key, episode, REFERENCE, drawn)
        drawn += 1
        i = np.int64((a * np.uint64(3)) >> np.uint64(32))
        j = np.int64((b * np.uint64(2)) >> np.uint64(32))
        j = (i + 1 + j) % 3
        k = 3 - i - j
        out[i * tones + tone] = chosen[3 * tone]
        out[j * tones + tone] = chosen[3 * tone + 1]
        out[k * tones + tone] = chosen[3 * tone + 2]
    return drawn


@njit(cache=True, error_model="numpy", nogil=True)
def _largest(values):
    """The largest size of numbers, of single or double precision."""
    # Numbers that are not negative are in the order of their bits, and a search among whole numbers
    # vectorises.
    best = bits_of(abs(values[0]))
    for m in range(len(values)):
        bits = bits_of(abs(values[m]))
        best = bits if bits > best else best
    return number_of(best)


@njit(cache=True, error_model="numpy", nogil=True)
def _padded(length):
    """A length at which loops that take many numbers at a time leave no rest."""
    return -(-length // 64) * 64


@njit(cache=True, error_model="numpy", nogil=True)
def _flattest(tried, points, harmonic, work):
    """Number of the phases (draws, tones) [turns] that make the flattest sum of unit tones.

    Sums are in single precision, at ``points`` of a period, and phases count to a step of the finer
    grid: enough to choose. ``work``: see ``draw_reference``.
    """
    sine, cosine, row, a, b = work
    draws, tones = tried.shape
    for tone in range(tones):
        step, s, c = harmonic[tone] / points, sine[tone], cosine[tone]
        for m in range(len(s)):
            turns = step * np.float64(m)
            turns = turns - np.rint(turns)
            put(s, m, single.sine_of_turns(np.float32(turns)))
            put(c, m, single.sine_of_turns(np.float32(turns + 0.25)))
        for d in range(draws):
            turns = np.floor(tried[d, tone] * points * COARSE) / (points * COARSE)
            a[tone, d] = single.sine_of_turns(np.float32(turns + 0.25))
            b[tone, d] = single.sine_of_turns(np.float32(turns))
    best, lowest = 0, np.float32(np.inf)
    for d in range(draws):
        row[:] = 0.0
        # Two tones at a time: half the passes over the row. Those beyond the last are zero.
        for tone in range(0, len(sine), 2):
            p, q, r, t = a[tone, d], b[tone, d], a[tone + 1, d], b[tone + 1, d]
            s, c, z, w = sine[tone], cosine[tone], sine[tone + 1], cosine[tone + 1]
            for m in range(len(row)):
                sums = fma(p, given(s, m), fma(q, given(c, m), given(row, m)))
                put(row, m, fma(r, given(z, m), fma(t, given(w, m), sums)))
        highest = _largest(row)
        if highest < lowest:
            best, lowest = d, highest
    return best


@njit(cache=True, error_model="numpy", nogil=True)
def draw_reference(
    tones, first, last, peaks, limits, jacobian, steps, key, episode, phase, harmonic, gain
):
    """Random multisine of three axes, as ``motions.multisine``: see there.

    Parameters
    ----------
    tones, first, last : tones an axis, and the band's lowest and highest harmonic
    peaks (3,), limits (2,) : wanted peaks [m/s, m/s, rad/s]; of wheel speed [rad/s] and speed [m/s]
    jacobian (4, 3) : wheel rates per twist
    steps : points on which a peak is sought, a multiple of ``COARSE``
    phase, harmonic (3 tones,), gain (3,) : filled; phases in turns, multiples of 1 / PHASES
    """
    drawn = _harmonics(tones, first, last, key, episode, harmonic)
    # Points beyond the period's end are those of its beginning again.
    length, coarse = _padded(steps), _padded(steps // COARSE)
    values, row = np.empty((3, length)), np.empty(length)
    tried = np.empty((PHASE_DRAWS, tones))
    even = tones + tones % 2
    work = (
        np.zeros((even, coarse), np.float32),
        np.zeros((even, coarse), np.float32),
        np.empty(coarse, np.float32),
        np.zeros((even, PHASE_DRAWS), np.float32),
        np.zeros((even, PHASE_DRAWS), np.float32),
    )
    for axis in range(3):
        for tone in range(tones):
            for d in range(0, PHASE_DRAWS, 4):
                four = words(key, episode, REFERENCE, drawn)
                drawn += 1
                for k in range(4):
                    tried[d + k, tone] = np.float64(four[k] >> np.uint64(16)) / PHASES
        own = harmonic[axis * tones : (axis + 1) * tones]
        best = _flattest(tried, steps // COARSE, own, work)
        found = values[axis]
        for m in range(length):
            found[m] = 0.0
        for tone in range(tones):
            turns, step = tried[best, tone], own[tone] / steps
            phase[axis * tones + tone] = turns
            for m in range(length):
                found[m] += sine_of_turns(fma(step, np.float64(m), turns))
        gain[axis] = peaks[axis] / (PEAK_BOUND * _largest(found))
    # One factor for all axes keeps their proportions.
    x, y, z = PEAK_BOUND * gain[0], PEAK_BOUND * gain[1], PEAK_BOUND * gain[2]
    forward, left, turn = values[0], values[1], values[2]
    for m in range(length):
        a, b = x * forward[m], y * left[m]
        row[m] = a * a + b * b
    excess = max(1.0, math.sqrt(_largest(row)) / limits[1])
    for wheel in range(4):
        a, b, c = x * jacobian[wheel, 0], y * jacobian[wheel, 1], z * jacobian[wheel, 2]
        for m in range(length):
            row[m] = a * forward[m] + b * left[m] + c * turn[m]
        excess = max(excess, _largest(row) / limits[0])
    for axis in range(3):
        gain[axis] /= excess
