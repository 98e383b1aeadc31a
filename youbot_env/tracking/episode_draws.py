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

TOGETHER = 32
"""Numbers that loops take at a time."""

MOST_CARRIERS = 2**17
"""Numbers in a table of carriers (1 MiB) that is made once for all episodes of a batch. Where it
would be larger, each episode computes those of its own harmonics: the same numbers."""

WORDS_A_TONE = 16
"""Words of the stream that an episode takes for each tone of an axis: 3 to choose harmonics, 1 to
deal them, 3 * 16 phases of which 4 come at a time."""

_TO_SHARE = 2.0**-32
_32 = np.uint64(32)


@njit(cache=True, inner=True, error_model="numpy", nogil=True)
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


@njit(cache=True, inner=True, error_model="numpy", nogil=True)
def _drawn_words(key, episode, out):
    """All words of an episode's stream, ``out`` (4, n): in a loop that holds several at a time."""
    a, b, c, d = out[0], out[1], out[2], out[3]
    for j in range(out.shape[1]):
        e, f, g, h = words(key, episode, REFERENCE, j)
        a[j], b[j], c[j], d[j] = np.uint32(e), np.uint32(f), np.uint32(g), np.uint32(h)


@njit(cache=True, inner=True, error_model="numpy", nogil=True)
def _harmonics(tones, first, last, drawn, chosen, out):
    """Distinct harmonics (3 tones,), dealt to the axes: out[axis * tones + tone].

    ``chosen`` (3 tones,): workspace.
    """
    needed = 3 * tones
    if last - first + 1 == needed:
        for step in range(needed):
            chosen[step] = first + step
    else:
        # Floyd's sampling without replacement, kept in order.
        for step in range(needed):
            top = last - needed + 1 + step
            pick = first + np.int64((np.uint64(drawn[0, step]) * np.uint64(top - first + 1)) >> _32)
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
        i = np.int64((np.uint64(drawn[0, needed + tone]) * np.uint64(3)) >> _32)
        j = np.int64((np.uint64(drawn[1, needed + tone]) * np.uint64(2)) >> _32)
        j = (i + 1 + j) % 3
        k = 3 - i - j
        out[i * tones + tone] = chosen[3 * tone]
        out[j * tones + tone] = chosen[3 * tone + 1]
        out[k * tones + tone] = chosen[3 * tone + 2]


@njit(cache=True, inner=True, error_model="numpy", nogil=True)
def _largest(values):
    """The largest size of numbers, of single or double precision."""
    # Numbers that are not negative are in the order of their bits, and a search among whole numbers
    # vectorises.
    best = bits_of(abs(values[0]))
    for m in range(len(values)):
        bits = bits_of(abs(values[m]))
        best = bits if bits > best else best
    return number_of(best)


@njit(cache=True, inner=True, error_model="numpy", nogil=True)
def _padded(length):
    """A length at which loops that take many numbers at a time leave no rest."""
    return -(-length // TOGETHER) * TOGETHER


# A sum of tones at point m of a period is E + O, and E - O at the point that lies as far before the
# period's end: E = sum sin(phase) cos(h m), O = sum cos(phase) sin(h m). Half the points suffice.


@njit(cache=True, error_model="numpy", nogil=True)
def carriers(first, last, steps):
    """cos and sin of harmonics first to last at half a period's ``steps`` points, and on the coarse
    grid in single precision; of no harmonic where that takes more than ``MOST_CARRIERS``."""
    count, half, coarse = last - first + 1, _padded(steps // 2 + 1), _coarse_points(steps)
    count = count if 2 * count * half <= MOST_CARRIERS else 0
    found = np.empty((count, 2 * half)), np.empty((count, 2 * coarse), np.float32)
    for row in range(count):
        _carrier(first + row, steps, found[0][row], found[1][row])
    return found


@njit(cache=True, inner=True, error_model="numpy", nogil=True)
def _coarse_points(steps):
    return _padded(steps // COARSE // 2 + 1)


@njit(cache=True, inner=True, error_model="numpy", nogil=True)
def _carrier(harmonic, steps, fine, coarse):
    """One row of ``carriers``: cosines, then sines."""
    half, few, step = len(fine) // 2, len(coarse) // 2, np.float64(harmonic) / np.float64(steps)
    for m in range(half):
        turns = step * np.float64(m)
        put(fine, m, sine_of_turns(turns + 0.25))
        put(fine, half + m, sine_of_turns(turns))
    for m in range(few):
        turns = step * np.float64(COARSE * m)
        put(coarse, m, np.float32(sine_of_turns(turns + 0.25)))
        put(coarse, few + m, np.float32(sine_of_turns(turns)))


@njit(cache=True, inner=True, error_model="numpy", nogil=True)
def _flattest(tried, tones, steps, rows, carrier, work):
    """Number of the phases (tones, draws) [turns] that make the flattest sum of unit tones.

    Sums are in single precision on the coarse grid, and phases count to a step of the finer one:
    enough to choose. ``rows`` (tones,): of ``carrier``, the tones' own.
    """
    even, odd, a, b = work
    width, flat = len(even) // 2, carrier.reshape(-1)
    for at in range(tones * PHASE_DRAWS):
        turns = np.float32(np.floor(tried[at] * steps) / np.float64(steps))
        put(a, at, single.sine_of_turns(turns))
        put(b, at, single.sine_of_turns(turns + np.float32(0.25)))
    best, lowest = 0, np.float32(np.inf)
    for d in range(PHASE_DRAWS):
        for tone in range(0, len(rows), 8):
            at, old = tone * PHASE_DRAWS + d, width if tone else 0
            _add_eight(a, at, rows, tone, flat, 0, even, old)
            _add_eight(b, at, rows, tone, flat, width, odd, old)
        highest = _largest_of_sums(even, odd)
        best, lowest = (d, highest) if highest < lowest else (best, lowest)
    return best


@njit(cache=True, inner=True, error_model="numpy", forceinline=True)
def _add_eight(factors, at, rows, tone, flat, first, sums, old):
    """Eight tones on to the sums that begin at ``old``, into the second half of ``sums``.

    Factors stand ``PHASE_DRAWS`` apart from ``at`` on; carriers begin at ``first`` of their rows.
    """
    # Indices into flat arrays: a view of an array counts references, which costs as much as a loop.
    width = len(sums) // 2
    c0, c1 = factors[at], factors[at + PHASE_DRAWS]
    c2, c3 = factors[at + 2 * PHASE_DRAWS], factors[at + 3 * PHASE_DRAWS]
    c4, c5 = factors[at + 4 * PHASE_DRAWS], factors[at + 5 * PHASE_DRAWS]
    c6, c7 = factors[at + 6 * PHASE_DRAWS], factors[at + 7 * PHASE_DRAWS]
    r0, r1 = first + 2 * width * rows[tone], first + 2 * width * rows[tone + 1]
    r2, r3 = first + 2 * width * rows[tone + 2], first + 2 * width * rows[tone + 3]
    r4, r5 = first + 2 * width * rows[tone + 4], first + 2 * width * rows[tone + 5]
    r6, r7 = first + 2 * width * rows[tone + 6], first + 2 * width * rows[tone + 7]
    for m in range(width):
        x = fma(c0, given(flat, r0 + m), fma(c1, given(flat, r1 + m), given(sums, old + m)))
        y = fma(c2, given(flat, r2 + m), c3 * given(flat, r3 + m))
        z = fma(c4, given(flat, r4 + m), c5 * given(flat, r5 + m))
        w = fma(c6, given(flat, r6 + m), c7 * given(flat, r7 + m))
        put(sums, width + m, (x + y) + (z + w))


@njit(cache=True, inner=True, error_model="numpy", forceinline=True)
def _largest_of_sums(even, odd):
    """The largest size of E + O and E - O of two second halves, in single precision."""
    width, best = len(even) // 2, np.int32(0)
    for m in range(width):
        bits = bits_of(abs(even[width + m]) + abs(odd[width + m]))
        best = bits if bits > best else best
    return number_of(best)


@njit(cache=True, inner=True, error_model="numpy", nogil=True)
def workspace(tones, steps, ready):
    """Arrays that ``draw_reference`` works in, for any number of episodes.

    ``ready``: whether there is a table of carriers, so that episodes compute none of their own.
    """
    half, coarse = _padded(steps // 2 + 1), _coarse_points(steps)
    # Tones that are summed eight at a time: those beyond the last are 0. So is what sums begin at.
    eights = -(-tones // 8) * 8
    choose = (
        np.zeros(2 * coarse, np.float32),
        np.zeros(2 * coarse, np.float32),
        np.zeros(eights * PHASE_DRAWS, np.float32),
        np.zeros(eights * PHASE_DRAWS, np.float32),
    )
    rows = 0 if ready else 3 * tones
    own = np.empty((rows, 2 * half)), np.empty((rows, 2 * coarse), np.float32)
    sums = np.empty((3, 2 * half)), np.empty(half)
    small = (
        np.empty((4, WORDS_A_TONE * tones), np.uint32),
        np.empty(tones * PHASE_DRAWS),
        np.zeros(eights),
        np.zeros(eights),
        np.zeros(eights, np.int64),
        np.empty(3 * tones, np.int64),
    )
    return choose, own, sums, small


@njit(cache=True, inner=True, error_model="numpy", nogil=True)
def _sum_of_tones(a, b, rows, carrier, out):
    """E, then O, at half a period's points: tones of factors a and b (their number padded to 4)."""
    half, flat = len(out) // 2, carrier.reshape(-1)
    for m in range(2 * half):
        out[m] = 0.0
    for tone in range(0, len(a), 4):
        p, q, r, t = a[tone], a[tone + 1], a[tone + 2], a[tone + 3]
        e, f, g, h = b[tone], b[tone + 1], b[tone + 2], b[tone + 3]
        i, j = 2 * half * rows[tone], 2 * half * rows[tone + 1]
        k, n = 2 * half * rows[tone + 2], 2 * half * rows[tone + 3]
        for m in range(half):
            one = fma(p, given(flat, i + m), fma(q, given(flat, j + m), given(out, m)))
            put(out, m, one + fma(r, given(flat, k + m), t * given(flat, n + m)))
        for m in range(half, 2 * half):
            one = fma(e, given(flat, i + m), fma(f, given(flat, j + m), given(out, m)))
            put(out, m, one + fma(g, given(flat, k + m), h * given(flat, n + m)))


@njit(cache=True, inner=True, error_model="numpy", nogil=True)
def _peak(sums, row):
    """The largest size of E + O and E - O."""
    half = len(row)
    for m in range(half):
        put(row, m, abs(given(sums, m)) + abs(given(sums, half + m)))
    return _largest(row)


@njit(cache=True, inner=True, error_model="numpy", nogil=True)
def draw_reference(
    tones, first, last, peaks, limits, jacobian, steps, known, key, episode, phase, harmonic, gain,
    work,
):  # fmt: skip
    """Random multisine of three axes, as ``motions.multisine``: see there.

    Parameters
    ----------
    tones, first, last : tones an axis, and the band's lowest and highest harmonic
    peaks (3,), limits (2,) : wanted peaks [m/s, m/s, rad/s]; of wheel speed [rad/s] and speed [m/s]
    jacobian (4, 3) : wheel rates per twist
    steps : points on which a peak is sought, a multiple of ``COARSE``
    known : ``carriers`` of the band
    phase, harmonic (3 tones,), gain (3,) : filled; phases in turns, multiples of 1 / PHASES
    work : a ``workspace``
    """
    choose, own, (sums, row), (drawn, tried, a, b, rows, chosen) = work
    _drawn_words(key, episode, drawn)
    _harmonics(tones, first, last, drawn, chosen, harmonic)
    ready = len(known[0]) > 0
    fine, coarse = known if ready else own
    if not ready:
        for at in range(3 * tones):
            _carrier(harmonic[at], steps, fine[at], coarse[at])
    for axis in range(3):
        for tone in range(tones):
            at = axis * tones + tone
            rows[tone] = np.int64(harmonic[at]) - first if ready else at
            start = 4 * tones + 4 * at
            for d in range(PHASE_DRAWS):
                word = drawn[d % 4, start + d // 4]
                tried[tone * PHASE_DRAWS + d] = np.float64(word >> np.uint32(16)) / PHASES
        best = _flattest(tried, tones, steps, rows, coarse, choose)
        for tone in range(tones):
            turns = tried[tone * PHASE_DRAWS + best]
            phase[axis * tones + tone] = turns
            a[tone], b[tone] = sine_of_turns(turns), sine_of_turns(turns + 0.25)
        _sum_of_tones(a, b, rows, fine, sums[axis])
        gain[axis] = peaks[axis] / (PEAK_BOUND * _peak(sums[axis], row))
    # One factor for all axes keeps their proportions.
    x, y, z = PEAK_BOUND * gain[0], PEAK_BOUND * gain[1], PEAK_BOUND * gain[2]
    forward, left, turn, half = sums[0], sums[1], sums[2], len(row)
    for m in range(half):
        e, f = x * forward[m], y * left[m]
        g, h = x * forward[half + m], y * left[half + m]
        # The larger of (e + g)^2 + (f + h)^2 and (e - g)^2 + (f - h)^2.
        row[m] = e * e + f * f + g * g + h * h + 2.0 * abs(e * g + f * h)
    excess = max(1.0, math.sqrt(_largest(row)) / limits[1])
    for wheel in range(4):
        e, f, g = x * jacobian[wheel, 0], y * jacobian[wheel, 1], z * jacobian[wheel, 2]
        for m in range(half):
            even = e * forward[m] + f * left[m] + g * turn[m]
            n = half + m
            row[m] = abs(even) + abs(e * forward[n] + f * left[n] + g * turn[n])
        excess = max(excess, _largest(row) / limits[0])
    for axis in range(3):
        gain[axis] /= excess
