"""One control period of a batch's rows, and the start of their episodes, whatever the platform is.

What follows from a set of effects, how the platform moves, stands behind the addresses in the last
row of ``places``. So this is compiled once on a machine, not once for each set. Code in single
precision is made from this source together with that of ``period_lanes``.
"""

from __future__ import annotations

import numpy as np

from youbot_env.caching import njit
from youbot_env.simulation.lane_calls import copied, on_beginnings, on_parameters, on_rows
from youbot_env.simulation.lane_layout import DURATION, LANES, LATE
from youbot_env.simulation.lane_math import pointer, real, taken_before
from youbot_env.tracking import episode_draws as draw
from youbot_env.tracking.period_lanes import (
    ACTING,
    ACTION_CALL,
    ACTIONS,
    ANGLES,
    APPLIED,
    BEGIN,
    BEGIN_ROWS,
    CALL,
    CLOCK,
    COARSE_AT,
    DELAY,
    DEVIATION,
    DRAWN,
    ENDED,
    EPISODE,
    F_AT,
    FINAL_AT,
    FINAL_REPORT_AT,
    FINE_AT,
    FIRST,
    FIRST_CALL,
    GEOMETRY_AT,
    INTEGRATE,
    JACOBIAN_AT,
    K_AT,
    KEY,
    KIND,
    LAST,
    LAST_CALL,
    LENGTHS_AT,
    LIMITS_AT,
    LOWER_AT,
    MEAN_AT,
    MOVES_CALL,
    NEVER,
    NEXT_STEP,
    NOMINAL_AT,
    NUMBERS_AT,
    OBSERVED_CALL,
    OVER,
    OVER_CALL,
    P_AT,
    PEAK_POINTS,
    PEAKS_AT,
    PENDING,
    PERIOD,
    PIECE,
    PLACE,
    PLACES,
    PLANT,
    PREVIEW,
    RATES,
    REPORT_CALL,
    REPORT_COLUMNS,
    REPORTED_CALL,
    RESETS,
    RESOLUTION,
    REWARD_CALL,
    ROWS_CALL,
    SAME_STEP,
    SEEN_CALL,
    SHARED,
    SHIFTS,
    SPEED,
    SPREAD_AT,
    START_AT,
    STATES,
    STEPS,
    SUBSTEPS,
    TABLE,
    TABLE_AT,
    TAKEN_AT,
    TICK_CALL,
    TONES,
    TORQUE_LIMIT,
    UPPER_AT,
    V_AT,
    W_AT,
    WHOLE_AT,
    WIDTH_CALL,
    WINDOW,
    X_AT,
    Y_AT,
    Z_AT,
    ask_for,
    begin_counts,
    carray,
    count,
    cube_at,
    describe,
    doubles_at,
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
    renew,
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


@njit(cache=True, inner=True, error_model="numpy", nogil=True)
def seen_of(call):
    """Observations that a call fills, (D, at least n)."""
    shape = (call[OBSERVED_CALL], call[WIDTH_CALL])
    return carray(pointer(call[SEEN_CALL]), shape, np.float32)


@njit(cache=True, inner=True, error_model="numpy", nogil=True)
def report_of(call):
    """The report that a call fills, (n, W) or (0, W)."""
    shape = (call[REPORTED_CALL], REPORT_COLUMNS)
    return carray(pointer(call[REPORT_CALL]), shape, np.float64)


@njit(cache=True, error_model="numpy", no_cpython_wrapper=True)
def period(listed, asked):
    """One period of the rows FIRST_CALL to LAST_CALL - 1, where the first begins a block.

    It is called by its address, from Python and by threads that never enter Python. ``listed``:
    addresses of the arrays, as ``Batch`` lists them (``PLACES``); ``asked``: see ``CALL``. Returns
    how many of the rows must begin an episode, with SAME_STEP now, with NEXT_STEP in the next
    period; or -1 less the flat index of the first action that is out of bounds, and nothing has
    moved then. MOVES_CALL: 0 shows the start of those rows that ``begin_rows`` has prepared; 1
    moves rows, SHARED checks no bound and takes pieces of the rows, of ``PIECE`` each, in turn with
    other threads that do so.
    """
    places, call = carray(listed, (PLACES,), np.int64), carray(asked, (CALL,), np.int64)
    rows, tick, moves = call[ROWS_CALL], call[TICK_CALL], call[MOVES_CALL]
    first, last = call[FIRST_CALL], call[LAST_CALL]
    action = carray(pointer(call[ACTION_CALL]), (rows, 4), np.float32)
    seen, report = seen_of(call), report_of(call)
    reward = carray(pointer(call[REWARD_CALL]), (rows,), np.float64)
    over = carray(pointer(call[OVER_CALL]), (2, rows), np.bool_)
    X, Y = numbers_at(places, X_AT), numbers_at(places, Y_AT)
    K, table = whole_at(places, K_AT), cube_at(places, TABLE_AT)
    Z, numbers = small_at(places, Z_AT), row_at(places, NUMBERS_AT)
    lengths, w, v = row_at(places, LENGTHS_AT), row_at(places, W_AT), row_at(places, V_AT)
    whole, taken = whole_at(places, WHOLE_AT)[0], whole_at(places, TAKEN_AT)
    plant = places[PLACE * PLANT :]
    P, start, f = shown_at(places, P_AT), row_at(places, START_AT), shown_at(places, F_AT)[0]
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
                begins = renew(k, lanes) if whole[RESETS] == NEXT_STEP else 0
                if begins:
                    on_beginnings(plant[BEGIN_ROWS], places, call, start, row, row + lanes)
                take(action, row, p, lanes, actions, tick % kept)
                move(x, p, w, lanes, tick, actions, numbers, whole, lengths, plant)
                for lane in range(lanes):
                    k[CLOCK * LANES + lane] += 1
                if begins:
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


@njit(cache=True, inner=True, error_model="numpy", nogil=True)
def draw_reference(y, z, k, whole, wanted, work):
    """The reference of the first row of a block, which follows no table, into its tones.

    ``wanted``: of references, see ``drawn_with``; ``work``: a workspace of ``episode_draws``, and
    phases, harmonics (3 tones) and gains (3).
    """
    peaks, limits, jacobian, fine, coarse = wanted
    space, phase, harmonic, gain = work
    tones = whole[TONES]
    draw.draw_reference(
        *(tones, whole[FIRST], whole[LAST], peaks[0], limits[0], jacobian, whole[PEAK_POINTS]),
        *((fine, coarse), np.uint64(k[KEY * LANES]), k[EPISODE * LANES]),
        *(phase, harmonic, gain, space),
    )
    for tone in range(3 * tones):
        z[2 * tone * LANES] = np.uint16(phase[tone] * draw.PHASES)
        z[(2 * tone + 1) * LANES] = np.uint16(harmonic[tone])
    for axis in range(3):
        y[axis * LANES] = gain[axis]


@njit(cache=True, inner=True, error_model="numpy", nogil=True)
def draw_model(k, whole, plant, models, lengths, theta, stated):
    """Parameters of the model of the first row of a block, into theta; models: ``drawn_with``."""
    geometry, nominal, mean, spread, lower, upper = models
    copied(nominal[0], theta)
    if whole[KIND] == draw.FIXED:
        return
    key, episode = np.uint64(k[KEY * LANES]), k[EPISODE * LANES]
    for attempt in range(draw.ATTEMPTS):
        if draw.stated_parameters(
            *(whole[KIND], mean[0], spread, lower[0], upper[0]), key, episode, attempt, stated
        ) and on_parameters(plant[DRAWN], stated, geometry[0], lengths, theta):
            return
        copied(nominal[0], theta)


@njit(cache=True, inner=True, error_model="numpy", nogil=True)
def drawn_with(places):
    """What models and then references are drawn with."""
    models = (
        *(doubles_at(places, GEOMETRY_AT), doubles_at(places, NOMINAL_AT)),
        *(doubles_at(places, MEAN_AT), doubles_at(places, SPREAD_AT)),
        *(doubles_at(places, LOWER_AT), doubles_at(places, UPPER_AT)),
    )
    wanted = (
        *(doubles_at(places, PEAKS_AT), doubles_at(places, LIMITS_AT)),
        *(doubles_at(places, JACOBIAN_AT), doubles_at(places, FINE_AT)),
        shown_at(places, COARSE_AT),
    )
    return models, wanted


@njit(cache=True, inner=True, error_model="numpy", nogil=True)
def begin_row(
    x, y, z, k, p, w, v, table, start, tick, numbers, whole, lengths, plant, models, wanted, work,
    model_work, sines,
):  # fmt: skip
    """Prepare the episode of the first row of a block, which begins in the state ``start``.

    ``work``: see ``draw_reference``; ``model_work``: theta and stated parameters; ``sines``: see
    ``reference_ahead``.
    """
    states, preview, one = whole[STATES], whole[PREVIEW], whole[STATES] - whole[STATES] + 1
    actions, (theta, stated) = 3 * (preview + 1), model_work
    if k[TABLE * LANES] < 0:
        draw_reference(y, z, k, whole, wanted, work)
    draw_model(k, whole, plant, models, lengths, theta, stated)
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


@njit(cache=True, error_model="numpy", no_cpython_wrapper=True)
def begin_rows(listed, asked, start, first, last):
    """Prepare the episodes of those rows first to last - 1 whose counters ask for one.

    It is called by its address, see ``period``. They begin in the state ``start``. Of the episodes
    before them the last observation and report are kept where there is an array for them.
    """
    places, call = carray(listed, (PLACES,), np.int64), carray(asked, (CALL,), np.int64)
    tick, seen, report = call[TICK_CALL], seen_of(call), report_of(call)
    K = whole_at(places, K_AT)
    row = next_beginning(K, first, last)
    if row >= last:
        return 0
    X, Y = numbers_at(places, X_AT), numbers_at(places, Y_AT)
    Z, table = small_at(places, Z_AT), cube_at(places, TABLE_AT)
    numbers, lengths = row_at(places, NUMBERS_AT), row_at(places, LENGTHS_AT)
    w, v = row_at(places, W_AT), row_at(places, V_AT)
    whole, P = whole_at(places, WHOLE_AT)[0], shown_at(places, P_AT)
    final, final_report = shown_at(places, FINAL_AT), doubles_at(places, FINAL_REPORT_AT)
    plant = places[PLACE * PLANT :]
    models, wanted = drawn_with(places)
    tones = whole[TONES]
    space = draw.workspace(tones, whole[PEAK_POINTS], len(wanted[3]) > 0)
    work = space, np.empty(3 * tones), np.empty(3 * tones), np.empty(3)
    sines = np.empty(6 * tones, np.uint16), np.empty(3 * tones, X.dtype)
    model_work = np.empty(models[1].shape[1]), np.empty(models[2].shape[1])
    while row < last:
        b, i = row // LANES, row % LANES
        x, y, z, k, p = X[b, i:], Y[b, i:], Z[b, i:], K[b, i:], P[b, i:]
        for column in range(final.shape[1] if final.shape[0] else 0):
            final[row, column] = seen[column, row]
        for column in range(final_report.shape[1] if final_report.shape[0] else 0):
            final_report[row, column] = report[row, column]
        begin_row(
            x, y, z, k, p, w, v, table, start, tick, numbers, whole, lengths, plant, models,
            wanted, work, model_work, sines,
        )  # fmt: skip
        row = next_beginning(K, row + 1, last)
    return 0


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
