"""One control period of a batch's rows, and the start of their episodes, whatever the platform is.

What follows from a set of effects, how the platform moves, stands behind the addresses in the last
row of ``places``. So this is compiled once on a machine, not once for each set. Code in single
precision is made from this source together with that of ``period_lanes``.
"""

from __future__ import annotations

import numpy as np

from youbot_env.caching import njit
from youbot_env.simulation.lane_calls import on_parameters, on_rows
from youbot_env.simulation.lane_code import DURATION, LANES, LATE
from youbot_env.simulation.lane_math import real, taken_before
from youbot_env.tracking import episode_draws as draw
from youbot_env.tracking.period_lanes import (
    ACTING,
    ACTIONS,
    ANGLES,
    APPLIED,
    BEGIN,
    CLOCK,
    DELAY,
    DEVIATION,
    DRAWN,
    ENDED,
    EPISODE,
    FIRST,
    INTEGRATE,
    KEY,
    KIND,
    LAST,
    NEVER,
    NEXT_STEP,
    OVER,
    PENDING,
    PERIOD,
    PIECE,
    PLACE,
    PLANT,
    PREVIEW,
    RATES,
    RESETS,
    RESOLUTION,
    SAME_STEP,
    SHARED,
    SHIFTS,
    SPEED,
    STATES,
    STEPS,
    SUBSTEPS,
    TABLE,
    TONES,
    TORQUE_LIMIT,
    WINDOW,
    ask_for,
    begin_counts,
    count,
    cube_at,
    describe,
    held_torque,
    judge,
    measure,
    next_beginning,
    numbers_at,
    observe,
    put_at_start,
    reference,
    reference_ahead,
    refused,
    row_at,
    shown_at,
    small_at,
    take,
    wanted_rate,
    whole_at,
)
from youbot_env.tracking.random_numbers import normal_numbers


@njit(cache=True, inner=True, error_model="numpy", nogil=True)
def move(x, p, w, lanes, tick, actions, numbers, whole, lengths, plant):
    """The plant under the action of a delay ago."""
    if plant[SHIFTS]:
        move_late(x, p, w, lanes, tick, actions, numbers, whole, lengths, plant)
        return
    slot = (tick - whole[DELAY]) % whole[ACTIONS]
    held_torque(p, lanes, actions, slot, numbers[TORQUE_LIMIT], w, 0)
    dt = numbers[PERIOD] / real(whole[SUBSTEPS])
    for i in range(lanes):
        w[DURATION * LANES + i] = dt
    on_rows(plant[INTEGRATE], x, w, w, lanes, whole[SUBSTEPS], lengths)


@njit(cache=True, inner=True, error_model="numpy", nogil=True)
def move_late(x, p, w, lanes, tick, actions, numbers, whole, lengths, plant):
    """The same where the model delays torques by any time: two actions act in a period."""
    on_rows(plant[SHIFTS], x, w, w[LATE * LANES :], lanes, 1, lengths)
    for part in range(2):
        for i in range(lanes):
            late = w[LATE * LANES + i] / numbers[PERIOD]
            late = late if late > 0.0 else 0.0
            # A delay of whole periods, to rounding, is one.
            whole_periods = np.floor(late + 1e-9)
            share = late - whole_periods
            share = share if share > 1e-9 else 0.0
            length = share if part == 0 else 1.0 - share
            w[DURATION * LANES + i] = length * numbers[PERIOD] / real(whole[SUBSTEPS])
            age = whole[DELAY] + np.int64(whole_periods) + (1 if part == 0 else 0)
            slot = (tick - min(age, whole[ACTIONS] - 1)) % whole[ACTIONS]
            for wheel in range(4):
                value = p[(actions + 4 * slot + wheel) * LANES + i]
                w[wheel * LANES + i] = numbers[TORQUE_LIMIT] * real(value)
        on_rows(plant[INTEGRATE], x, w, w, lanes, whole[SUBSTEPS], lengths)


@njit(cache=True, inner=True, error_model="numpy", nogil=True)
def finish(
    row, x, y, z, k, w, v, p, f, table, lanes, tick, numbers, whole, lengths, plant,
    seen, reward, report,
):  # fmt: skip
    """What follows the plant's motion: reference, sensors, reward and observation."""
    kept, preview = whole[ACTIONS], whole[PREVIEW]
    actions, counts = 3 * (preview + 1), 3 + 3 * (preview + 1)
    slot, past = tick % kept, (tick - 1) % kept
    newest = (tick + preview) % (preview + 1)
    reference(y, z, k, v, p, table, lanes, newest, preview, numbers, whole)
    if numbers[RESOLUTION] > 0.0:
        count(x, y, v, lanes, counts, tick % whole[WINDOW], whole[ANGLES], numbers)
    else:
        on_rows(plant[RATES], x, w, v[SPEED * LANES :], lanes, 1, lengths)
    noisy = numbers[DEVIATION] > 0.0
    if noisy:
        normal_numbers(k[KEY * LANES :], k[EPISODE * LANES :], k[CLOCK * LANES :], lanes, LANES, f)
    measure(v, f, lanes, numbers, noisy)
    ring = 3 + 3 * (tick % (preview + 1))
    judge(x, y, p, v, lanes, row, ring, actions, slot, past, numbers, reward)
    observe(v, p, lanes, row, tick, actions, numbers, whole, seen)
    if report.shape[0]:
        on_rows(plant[ACTING], x, w, v[APPLIED * LANES :], lanes, 1, lengths)
        for i in range(lanes):
            describe(
                x,
                y,
                p,
                v,
                i,
                row + i,
                tick,
                actions,
                k[CLOCK * LANES + i],
                numbers,
                whole,
                reward,
                report,
            )
            wanted_rate(y, z, k, v, table, i, row + i, numbers, whole, report)


@njit(cache=True, error_model="numpy", nogil=True)
def period(action, places, tick, moves, seen, reward, over, report, first, last):
    """One period of the rows first to last - 1, where ``first`` begins a block.

    ``places``: addresses of the arrays, as ``Batch`` lists them; a call with all of them would take
    longer than the period of a row. Returns how many of the rows must begin an episode, with
    SAME_STEP now, with NEXT_STEP in the next period; or -1
    less the flat index of the first action that is out of bounds, and nothing has moved then.
    ``moves``: 0 shows the start of those rows that ``begin_rows`` has prepared; 2 checks no bound
    and takes pieces of the rows, of ``PIECE`` each, in turn with other threads that do so.
    """
    X, Y = numbers_at(places, 0), numbers_at(places, 1)
    K, table = whole_at(places, 3), cube_at(places, 4)
    Z, numbers = small_at(places, 2), row_at(places, 5)
    lengths, w, v = row_at(places, 6), row_at(places, 7), row_at(places, 8)
    whole, taken = whole_at(places, 9)[0], whole_at(places, 10)
    plant = places[PLACE * PLANT :]
    P, start, f = shown_at(places, 11), row_at(places, 12), shown_at(places, 13)[0]
    if moves == 1:
        bad = refused(action, first, last)
        if bad >= 0:
            return -1 - bad
    preview, kept, new = whole[PREVIEW], whole[ACTIONS], 0
    actions, step = 3 * (preview + 1), LANES if moves else 1
    line, now = 64 // X.itemsize, (3 + 3 * (tick % (preview + 1))) * LANES
    coming = (3 + 3 * ((tick + preview) % (preview + 1))) * LANES
    stop = last
    while first < last:
        if moves == SHARED:
            first = taken_before(taken, PIECE)
            stop = min(first + PIECE, last)
        row = first - step
        while True:
            row = row + step if moves else next_beginning(K, row + 1, stop)
            if row >= stop:
                break
            b, i, lanes = row // LANES, row % LANES, last - row
            lanes = step if lanes > step else lanes
            x, y, z, k, p = X[b, i:], Y[b, i:], Z[b, i:], K[b, i:], P[b, i:]
            if moves and b + 1 < X.shape[0]:
                # A large batch lies in a cache that is slow, and slower where others use it too.
                ask_for(X[b + 1], line)
                ask_for(Z[b + 1], 32)
                # Of the reference: gains, the sample that counts now and the one that is written.
                for at in (0, now, coming):
                    ask_for(Y[b + 1, at : at + 3 * LANES], line)
                ask_for(K[b + 1], 8)
                ask_for(P[b + 1], 16)
            if moves:
                take(action, row, p, lanes, actions, tick % kept)
                move(x, p, w, lanes, tick, actions, numbers, whole, lengths, plant)
                for lane in range(lanes):
                    k[CLOCK * LANES + lane] += 1
                if whole[RESETS] == NEXT_STEP:
                    newest = actions + 4 * (tick % kept)
                    put_at_start(x, p, w, k, lanes, newest, start, whole[STATES])
            earned = reward[row]
            finish(
                row, x, y, z, k, w, v, p, f, table, lanes, tick, numbers, whole, lengths, plant,
                seen, reward, report,
            )  # fmt: skip
            if moves:
                new += ends(row, k, v, lanes, whole, over, reward)
            else:
                # A start earns nothing: with SAME_STEP the reward is the last step's.
                reward[row] = earned if whole[RESETS] == SAME_STEP else 0.0
                k[PENDING * LANES] = 0
        first = stop if moves == SHARED else last
    return new


@njit(cache=True, error_model="numpy", nogil=True)
def draw_references(
    Y, Z, K, whole, peaks, limits, jacobian, steps, fine, coarse, first, last
):  # fmt: skip
    """References of those rows first to last - 1 that begin an episode and follow no table."""
    tones = whole[TONES]
    phase, harmonic, gain = np.empty(3 * tones), np.empty(3 * tones), np.empty(3)
    work, known = draw.workspace(tones, steps), (fine, coarse)
    row = first - 1
    while True:
        row = next_beginning(K, row + 1, last)
        if row >= last:
            break
        b, i = row // LANES, row % LANES
        k = K[b, i:]
        if k[TABLE * LANES] >= 0:
            continue
        key, episode = np.uint64(k[KEY * LANES]), k[EPISODE * LANES]
        draw.draw_reference(
            *(tones, whole[FIRST], whole[LAST], peaks, limits, jacobian, steps, known, key),
            *(episode, phase, harmonic, gain, work),
        )
        for tone in range(3 * tones):
            Z[b, 2 * tone * LANES + i] = np.uint16(phase[tone] * draw.PHASES)
            Z[b, (2 * tone + 1) * LANES + i] = np.uint16(harmonic[tone])
        for axis in range(3):
            Y[b, axis * LANES + i] = gain[axis]


@njit(cache=True, error_model="numpy", nogil=True)
def begin_rows(places, tick, draws, start, seen, report, final, final_report, first, last):
    """Prepare the episodes of those rows first to last - 1 whose counters ask for one.

    Their references are drawn already. Of the episodes before them the last observation and report
    are kept in ``final`` and ``final_report``, where these have rows.
    """
    X, Y = numbers_at(places, 0), numbers_at(places, 1)
    K, table = whole_at(places, 3), cube_at(places, 4)
    Z, numbers = small_at(places, 2), row_at(places, 5)
    lengths, w, v = row_at(places, 6), row_at(places, 7), row_at(places, 8)
    whole, P = whole_at(places, 9)[0], shown_at(places, 11)
    plant = places[PLACE * PLANT :]
    (geometry, nominal, mean, spread, lower, upper) = draws
    states, preview = whole[STATES], whole[PREVIEW]
    actions, one = 3 * (preview + 1), last - last + 1
    theta, stated = np.empty(len(nominal)), np.empty(len(mean))
    sines = np.empty(6 * whole[TONES], np.uint16), np.empty(3 * whole[TONES], X.dtype)
    row = first - 1
    while True:
        row = next_beginning(K, row + 1, last)
        if row >= last:
            break
        b, i = row // LANES, row % LANES
        x, y, z, k, p = X[b, i:], Y[b, i:], Z[b, i:], K[b, i:], P[b, i:]
        if final.shape[0]:
            for column in range(seen.shape[0]):
                final[row, column] = seen[column, row]
            for column in range(final_report.shape[1] if report.shape[0] else 0):
                final_report[row, column] = report[row, column]
        key, episode = np.uint64(k[KEY * LANES]), k[EPISODE * LANES]
        for field in range(len(theta)):
            theta[field] = nominal[field]
        if whole[KIND] != draw.FIXED:
            for attempt in range(draw.ATTEMPTS):
                if draw.stated_parameters(
                    whole[KIND], mean, spread, lower, upper, key, episode, attempt, stated
                ) and on_parameters(plant[DRAWN], stated, geometry, lengths, theta):
                    break
                for field in range(len(theta)):
                    theta[field] = nominal[field]
        for field in range(states):
            x[field * LANES] = start[field]
        for field in range(len(theta)):
            x[(states + field) * LANES] = theta[field]
        k[CLOCK * LANES] = 0
        for field in range(4 * whole[ACTIONS]):
            p[(actions + field) * LANES] = 0.0
        for field in range(4):
            w[field * LANES] = 0.0
        reference_ahead(y, z, k, p, table, tick, numbers, whole, sines)
        if numbers[RESOLUTION] > 0.0:
            on_rows(plant[RATES], x, w, v[SPEED * LANES :], one, 1, lengths)
            window, counts = whole[WINDOW], 3 + 3 * (preview + 1)
            begin_counts(x, y, v, 0, counts, tick % window, window, whole[ANGLES], numbers)


@njit(cache=True, inner=True, error_model="numpy", nogil=True)
def ends(row, k, v, lanes, whole, over, reward):
    """Which episodes are over: by divergence, and else by their length; how many begin for it.

    A row that began its episode in this period has earned nothing and cannot end.
    """
    new, resets, steps = 0, whole[RESETS], whole[STEPS]
    ended, terminated, truncated = v[ENDED * LANES :], over[0, row:], over[1, row:]
    clock, pending, episode = k[CLOCK * LANES :], k[PENDING * LANES :], k[EPISODE * LANES :]
    begun = 0
    for i in range(lanes):
        began = (resets == NEXT_STEP) & (pending[i] == BEGIN)
        diverged, late = (ended[i] != 0.0) & (not began), (clock[i] >= steps) & (not began)
        terminated[i], truncated[i] = diverged, late
        is_over, begun = diverged | late, begun | (1 if began else 0)
        begins = (resets == SAME_STEP) & is_over
        pending[i] = BEGIN if begins else OVER if is_over else 0
        episode[i] += 1 if begins else 0
        new += 1 if is_over & (resets != NEVER) else 0
        # Marked, as a loop that vectorises writes to one kind of array less.
        ended[i] = 2.0 if began else ended[i]
    if begun:
        for i in range(lanes):
            if ended[i] == 2.0:
                reward[row + i] = 0.0
    return new
