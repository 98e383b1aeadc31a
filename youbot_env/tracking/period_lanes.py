"""One control period of a block of rows around the plant: actions, references, sensors, reward.

Every function works on ``lanes`` rows of one block; see ``simulation.lane_layout`` for the form of
its fields. Loops over rows hold no call and no branch, so that the compiler turns them into vector
instructions; what is rare stands in loops of its own. Generated code in single precision is made
from this source.

Arrays of a block
-----------------
x : state, parameters
y : gains and coming samples of the reference, encoder counts
z : (uint16) phases [turns / 65536] and harmonics of the reference's tones
p : (float32) the coming samples of the reference as they are observed, past actions
k : (int64) ``CLOCK`` ... : a row's counters
v : workspace of the thread: ``Work``
f : (float32) the same: normal numbers
"""

from __future__ import annotations

import numba
import numpy as np

from youbot_env.caching import njit
from youbot_env.simulation.lane_layout import LANES
from youbot_env.simulation.lane_math import (
    fetch,
    fma,
    given,
    pointer,
    put,
    real,
    sine_of_turns,
    ticks,
    turns_of_tone,
)
from youbot_env.tracking.actuation import AT_LIMIT, BOUND_TOLERANCE

carray = numba.carray  # pyright: ignore[reportPrivateImportUsage]

CLOCK, KEY, EPISODE, PENDING, TABLE = range(5)
"""Counters of a row: periods since its reset, key of its random numbers, episode since the key was
set, ``OVER`` or ``BEGIN`` where its episode is over or a new one begins, which table its reference
follows (-1: its tones)."""

COUNTERS = 5

OVER, BEGIN = 1, 2

# Fields of v.
TAU, RISE, SUM, SPEED, MEASURED, APPLIED, SLOPE, ENDED, WORK = 0, 1, 2, 5, 9, 12, 16, 20, 21
"""Fields of the workspace: time of the reference in periods of its lowest harmonic, its window,
sums of its tones (3); measured wheel speeds (4) and twist (3), torques at the wheels (4), slopes of
the tones' sums (3) and of the window; 1 where an episode has diverged."""

# Whole numbers of a setup.
(
    PREVIEW,
    HISTORY,
    ACTIONS,
    DELAY,
    TONES,
    WINDOW,
    STEPS,
    SUBSTEPS,
    RESETS,
    TABLES,
    STATES,
    ANGLES,
    KIND,
    FIRST,
    LAST,
    TURN_BITS,
    PEAK_POINTS,
) = range(17)
WHOLE = 17
"""Coming samples and past actions observed, actions kept, periods of delay, tones an axis, periods
of the encoders' window, periods in an episode, integration steps, what follows an episode
(``NEVER``, ``NEXT_STEP``, ``SAME_STEP``), whether a row follows a table, size of the state, its
first wheel angle, how models are drawn, harmonics of the band, ``TURN`` in units of 2^-64, and
points on which a reference's peak is sought."""

SHARED = 2
"""How ``period`` moves rows that several threads share."""

NEVER, NEXT_STEP, SAME_STEP = 0, 1, 2

# Numbers of a setup.
PERIOD, TURN, RAMP, TORQUE_LIMIT, DEVIATION, RESOLUTION, SPAN, TWIST_LIMIT = range(8)
INVERSE, SCALE, WEIGHT, MARGIN = 8, 20, 23, 28
NUMBERS = 33
"""Control period [s], its share of the lowest harmonic's period, ramp [s], torque of an action of 1
[N m], noise [rad/s], angle of a count [rad], time over which counts are differenced [s], largest
twist over its scale; then the twist of wheel rates (3, 4), the twist's scales (3), weights and
margins (5) of the reward."""

# Columns of a report.
(ERROR, TWIST, POSE, ANGLE, WANTED, WANTED_RATE, TERMS_AT, REWARD_AT, ENDED_AT) = (
    *(0, 3, 6, 9, 13, 16, 19, 24, 25),
)
MEASURED_AT, SPEED_AT, COMMANDED_AT, APPLIED_AT, SATURATED_AT, TIME_AT = 26, 29, 33, 37, 41, 45
REPORT_COLUMNS = 46

PIECE = 2 * LANES
"""Rows that a thread takes at a time: some 10 us, so that none waits long for another."""

PLACE = 4
"""Numbers for each array in a list of places: its address and up to three lengths."""

X_AT, Y_AT, Z_AT, K_AT, P_AT = range(5)
TABLE_AT, NUMBERS_AT, LENGTHS_AT, WHOLE_AT, START_AT = range(5, 10)
W_AT, V_AT, F_AT, TAKEN_AT = range(10, 14)
GEOMETRY_AT, NOMINAL_AT, MEAN_AT, SPREAD_AT, LOWER_AT, UPPER_AT = range(14, 20)
PEAKS_AT, LIMITS_AT, JACOBIAN_AT, FINE_AT, COARSE_AT = range(20, 25)
FINAL_AT, FINAL_REPORT_AT = range(25, 27)
"""Arrays in a list of places: those of blocks, settings, a thread's workspace, what models and then
what references are drawn with, and what is kept of the episodes before."""

ARRAYS = 27
"""After them stand addresses of compiled functions."""

PLANT = ARRAYS
INTEGRATE, RATES, ACTING, SHIFTS, DRAWN, BEGIN_ROWS = range(6)
"""Such addresses, see ``simulation.lane_code``; 0 where the platform has no such function. The last
is that of ``period.begin_rows``."""

PLACES = PLACE * ARRAYS + 6

ACTION_CALL, SEEN_CALL, REWARD_CALL, OVER_CALL, REPORT_CALL = range(5)
ROWS_CALL, REPORTED_CALL, OBSERVED_CALL, WIDTH_CALL = range(5, 9)
TICK_CALL, MOVES_CALL, FIRST_CALL, LAST_CALL, PERIOD_CALL, PLACES_CALL = range(9, 15)
CALL = 15
"""Numbers of a call: addresses of actions, observations, rewards, ends and reports; rows, rows that
are reported, numbers observed, numbers from one column of them to the next; the tick, whether rows
move, the first row and the one after the last; the addresses of ``period.period`` and of the list
of places, which alone stay as they are from step to step."""


@njit(cache=True, inner=True, error_model="numpy", nogil=True)
def numbers_at(places, at):
    """A matrix of numbers from a list of places."""
    shape = (places[PLACE * at + 1], places[PLACE * at + 2])
    return carray(pointer(places[PLACE * at]), shape, real)


@njit(cache=True, inner=True, error_model="numpy", nogil=True)
def small_at(places, at):
    """A matrix of small whole numbers."""
    shape = (places[PLACE * at + 1], places[PLACE * at + 2])
    return carray(pointer(places[PLACE * at]), shape, np.uint16)


@njit(cache=True, inner=True, error_model="numpy", nogil=True)
def shown_at(places, at):
    """A matrix of numbers that are observed."""
    shape = (places[PLACE * at + 1], places[PLACE * at + 2])
    return carray(pointer(places[PLACE * at]), shape, np.float32)


@njit(cache=True, inner=True, error_model="numpy", nogil=True)
def whole_at(places, at):
    """A matrix of whole numbers."""
    shape = (places[PLACE * at + 1], places[PLACE * at + 2])
    return carray(pointer(places[PLACE * at]), shape, np.int64)


@njit(cache=True, inner=True, error_model="numpy", nogil=True)
def cube_at(places, at):
    """An array of three axes, in double precision."""
    shape = (places[PLACE * at + 1], places[PLACE * at + 2], places[PLACE * at + 3])
    return carray(pointer(places[PLACE * at]), shape, np.float64)


@njit(cache=True, inner=True, error_model="numpy", nogil=True)
def doubles_at(places, at):
    """A matrix in double precision."""
    shape = (places[PLACE * at + 1], places[PLACE * at + 2])
    return carray(pointer(places[PLACE * at]), shape, np.float64)


@njit(cache=True, inner=True, error_model="numpy", nogil=True)
def row_at(places, at):
    """Numbers in a row."""
    return carray(pointer(places[PLACE * at]), (places[PLACE * at + 1],), real)


@njit(cache=True, inner=True, error_model="numpy", nogil=True)
def ask_for(numbers, line):
    """Let a block's numbers, ``line`` to a line of the cache, come while others are used."""
    for at in range(0, len(numbers), line):
        fetch(numbers, at)


@njit(cache=True, error_model="numpy", nogil=True)
def refused(action, first, last):
    """Flat index of the first action of rows first to last - 1 that is out of bounds; -1."""
    limit, bad = action.dtype.type(1.0 + BOUND_TOLERANCE), np.int32(0)
    flat = action[first:last].reshape(-1)
    for at in range(len(flat)):
        # Written so that NaN fails too.
        bad |= np.int32(0 if abs(flat[at]) <= limit else 1)
    if bad == 0:
        return -1
    for row in range(first, last):
        for wheel in range(4):
            if not abs(action[row, wheel]) <= limit:
                return 4 * row + wheel
    return -1


@njit(cache=True, inner=True, error_model="numpy", forceinline=True)
def within_one(action):
    """An action cut to +-1."""
    value, one = np.float32(action), np.float32(1.0)
    value = one if value > one else value
    return -one if value < -one else value


@njit(cache=True, inner=True, error_model="numpy", nogil=True)
def take(action, row, p, lanes, at, slot):
    """Put actions from ``row`` on, cut to +-1, into the ring of past ones (from field ``at``)."""
    # All four in one loop: what stands side by side is then read side by side.
    flat, kept = action[row:].reshape(-1), p[(at + 4 * slot) * LANES :]
    for i in range(lanes):
        for wheel in range(4):
            put(kept, wheel * LANES + i, within_one(given(flat, 4 * i + wheel)))


@njit(cache=True, inner=True, error_model="numpy", nogil=True)
def held_torque(p, lanes, at, slot, limit, w, field):
    """Torques [N m] that the actions of a slot command, into four fields of w."""
    for wheel in range(4):
        source, target = p[(at + 4 * slot + wheel) * LANES :], w[(field + wheel) * LANES :]
        for i in range(lanes):
            target[i] = limit * real(source[i])


@njit(cache=True, inner=True, error_model="numpy", nogil=True)
def reference(y, z, k, v, p, table, lanes, slot, ahead, numbers, whole):
    """The reference's twist ``ahead`` samples after the clock, into a slot of the rings."""
    tones = whole[TONES]
    turn, step = numbers[TURN], numbers[PERIOD] / numbers[RAMP]
    shift, bits = np.int64(ahead), whole[TURN_BITS]
    for i in range(lanes):
        n = k[CLOCK * LANES + i] + shift
        v[TAU * LANES + i] = ticks(n, turn, bits)
        u = real(n) * step
        u = 1.0 if u > 1.0 else u
        v[RISE * LANES + i] = u * u * u * fma(u, fma(6.0, u, -15.0), 10.0)
    # Views of fields, not their numbers: only so are they known not to overlap.
    tau, rise = v[TAU * LANES :], v[RISE * LANES :]
    for axis in range(3):
        total = v[(SUM + axis) * LANES :]
        for i in range(lanes):
            total[i] = 0.0
        for tone in range(axis * tones, (axis + 1) * tones):
            pair = z[2 * tone * LANES :]
            for i in range(lanes):
                total[i] += sine_of_turns(turns_of_tone(pair[i], pair[LANES + i], tau[i]))
        wanted, gain = y[(3 + 3 * slot + axis) * LANES :], y[axis * LANES :]
        for i in range(lanes):
            wanted[i] = rise[i] * (gain[i] * total[i])
    follow_tables(y, k, table, lanes, slot, shift, whole)
    show(y, p, lanes, slot, numbers)


@njit(cache=True, inner=True, error_model="numpy", nogil=True)
def follow_tables(y, k, table, lanes, slot, shift, whole):
    """The same of rows that follow a table."""
    if whole[TABLES]:
        for i in range(lanes):
            number = k[TABLE * LANES + i]
            if 0 <= number < table.shape[0]:
                n = min(max(k[CLOCK * LANES + i] + shift, 0), table.shape[1] - 1)
                for axis in range(3):
                    y[(3 + 3 * slot + axis) * LANES + i] = table[number, n, axis]


@njit(cache=True, inner=True, error_model="numpy", nogil=True)
def show(y, p, lanes, slot, numbers):
    """A slot of the reference's samples as it is observed, once for all the times that it is."""
    limit = numbers[TWIST_LIMIT]
    for axis in range(3):
        wanted, share = y[(3 + 3 * slot + axis) * LANES :], 1.0 / numbers[SCALE + axis]
        scaled(wanted, lanes, share, limit, p[(3 * slot + axis) * LANES :])


@njit(cache=True, inner=True, error_model="numpy", nogil=True)
def reference_ahead(y, z, k, p, table, tick, numbers, whole, sines):
    """All samples but the newest that the first row sees at its start; bits as ``reference``'s.

    ``sines`` (2, 3 tones): workspace.
    """
    tones, preview, one = whole[TONES], whole[PREVIEW], whole[TONES] - whole[TONES] + 1
    turn, step, bits = numbers[TURN], numbers[PERIOD] / numbers[RAMP], whole[TURN_BITS]
    small, found = sines
    for tone in range(len(small)):
        small[tone] = z[tone * LANES]
    for ahead in range(preview):
        slot, n = (tick + ahead) % (preview + 1), k[CLOCK * LANES] + np.int64(ahead)
        clock, u = ticks(n, turn, bits), real(n) * step
        u = 1.0 if u > 1.0 else u
        rise = u * u * u * fma(u, fma(6.0, u, -15.0), 10.0)
        # Tones side by side, as there is but one row; their sum in turn.
        for tone in range(3 * tones):
            turns = turns_of_tone(small[2 * tone], small[2 * tone + 1], clock)
            found[tone] = sine_of_turns(turns)
        for axis in range(3):
            total = 0.0 * turn
            for tone in range(axis * tones, (axis + 1) * tones):
                total += found[tone]
            y[(3 + 3 * slot + axis) * LANES] = rise * (y[axis * LANES] * total)
        follow_tables(y, k, table, one, slot, np.int64(ahead), whole)
        show(y, p, one, slot, numbers)


@njit(cache=True, inner=True, error_model="numpy", nogil=True)
def put_at_start(x, p, w, k, lanes, action, start, states):
    """Rows of a block that begin now: where ``begin_rows`` put them before the plant moved.

    ``action``: field of the actions of this period, which do not count for them.
    """
    pending = k[PENDING * LANES :]
    for i in range(lanes):
        if pending[i] == BEGIN:
            for field in range(states):
                x[field * LANES + i] = start[field]
            for wheel in range(4):
                p[(action + wheel) * LANES + i] = 0.0
                w[wheel * LANES + i] = 0.0
            k[CLOCK * LANES + i] = 0


@njit(cache=True, inner=True, error_model="numpy", nogil=True)
def renew(k, lanes):
    """Let those rows of a block whose episode is over begin the next; how many."""
    pending, episode, over, found = k[PENDING * LANES :], k[EPISODE * LANES :], 0, 0
    for i in range(lanes):  # without a branch: most blocks hold none
        over |= 1 if pending[i] == OVER else 0
    if over:
        for i in range(lanes):
            if pending[i] == OVER:
                pending[i] = BEGIN
                episode[i] += 1
                found += 1
    return found


@njit(cache=True, inner=True, error_model="numpy", nogil=True)
def slopes(z, k, v, i, numbers, whole):
    """Of one row: slopes [1/s] of its tones' sums and of the window, into v; after reference()."""
    tones = whole[TONES]
    turn, ramp = numbers[TURN], numbers[RAMP]
    now = real(k[CLOCK * LANES + i])
    u = now * (numbers[PERIOD] / ramp)
    inside = u < 1.0
    rest = 1.0 - u
    v[(SLOPE + 3) * LANES + i] = 30.0 * u * u * rest * rest / ramp if inside else 0.0
    speed = 6.283185307179586 * turn / numbers[PERIOD]
    clock = ticks(k[CLOCK * LANES + i], turn, whole[TURN_BITS])
    for axis in range(3):
        value, slope = 0.0 * turn, 0.0 * turn
        for tone in range(axis * tones, (axis + 1) * tones):
            phase, harmonic = z[2 * tone * LANES + i], z[(2 * tone + 1) * LANES + i]
            turns = turns_of_tone(phase, harmonic, clock)
            value += sine_of_turns(turns)
            slope += real(harmonic) * speed * sine_of_turns(turns + 0.25)
        v[(SUM + axis) * LANES + i] = value
        v[(SLOPE + axis) * LANES + i] = slope


@njit(cache=True, inner=True, error_model="numpy", nogil=True)
def count(x, y, v, lanes, at, slot, angles, numbers):
    """Wheel speeds from whole counts over the window, instead of those in v; the ring moves on."""
    resolution, span = numbers[RESOLUTION], numbers[SPAN]
    for wheel in range(4):
        angle, kept = x[(angles + wheel) * LANES :], y[(at + 4 * slot + wheel) * LANES :]
        speed = v[(SPEED + wheel) * LANES :]
        for i in range(lanes):
            now = np.floor(angle[i] / resolution)
            speed[i] = (now - kept[i]) * resolution / span
            kept[i] = now


@njit(cache=True, inner=True, error_model="numpy", nogil=True)
def begin_counts(x, y, v, i, at, slot, window, angles, numbers):
    """Counts of one row as if it had always moved at its present speed; ``v``: wheel speeds."""
    resolution = numbers[RESOLUTION]
    for age in range(1, window + 1):
        place = at + 4 * ((slot - age) % window)
        for wheel in range(4):
            back = v[(SPEED + wheel) * LANES + i] * (real(age) * numbers[PERIOD])
            angle = x[(angles + wheel) * LANES + i] - back
            y[(place + wheel) * LANES + i] = np.floor(angle / resolution)


@njit(cache=True, inner=True, error_model="numpy", nogil=True)
def measure(v, f, lanes, numbers, noisy):
    """Add noise of normal numbers f to the wheel speeds in v; the twist that they tell."""
    if noisy:
        deviation = numbers[DEVIATION]
        for wheel in range(4):
            speed, normal = v[(SPEED + wheel) * LANES :], f[wheel * LANES :]
            for i in range(lanes):
                speed[i] = fma(deviation, real(normal[i]), speed[i])
    for axis in range(3):
        a, b = numbers[INVERSE + 4 * axis], numbers[INVERSE + 4 * axis + 1]
        c, d = numbers[INVERSE + 4 * axis + 2], numbers[INVERSE + 4 * axis + 3]
        for i in range(lanes):
            value = a * v[SPEED * LANES + i] + b * v[(SPEED + 1) * LANES + i]
            value = value + c * v[(SPEED + 2) * LANES + i] + d * v[(SPEED + 3) * LANES + i]
            v[(MEASURED + axis) * LANES + i] = value


@njit(cache=True, inner=True, error_model="numpy", forceinline=True)
def tolerance_of(square, margin):
    """``tolerance`` of an error whose square is given; NaN gives 0."""
    value = 1.0 / fma(9.0 / (margin * margin), square, 1.0)
    return value if value == value else 0.0


@njit(cache=True, inner=True, error_model="numpy", forceinline=True)
def sharpness(numbers, term):
    """What a squared error of a reward's term is multiplied with in ``loss_of``."""
    return 9.0 / (numbers[MARGIN + term] * numbers[MARGIN + term])


@njit(cache=True, inner=True, error_model="numpy", forceinline=True)
def loss_of(square, sharp):
    """1 over the ``tolerance`` of an error whose square is given; large for NaN.

    Cut where the tolerance is nothing beside 1, so that products of three stay finite.
    """
    value = fma(sharp, square, 1.0)
    return value if value < 1e12 else 1e12


@njit(cache=True, inner=True, error_model="numpy", nogil=True)
def judge(x, y, p, v, lanes, row, ring, at, slot, past, numbers, reward):
    """Rewards into ``reward`` from ``row`` on, and into v which episodes end (1.0: diverged).

    ``ring`` is the field of the reference now, ``at`` that of the past actions, ``slot`` and
    ``past`` the last two of them.
    """
    limit = numbers[TWIST_LIMIT]
    wanted, newest = y[ring * LANES :], p[(at + 4 * slot) * LANES :]
    before = p[(at + 4 * past) * LANES :]
    earned, ended = reward[row:], v[ENDED * LANES :]
    a, b, c = numbers[WEIGHT], numbers[WEIGHT + 1], numbers[WEIGHT + 2]
    d, e = numbers[WEIGHT + 3], numbers[WEIGHT + 4]
    o, q, r = sharpness(numbers, 0), sharpness(numbers, 1), sharpness(numbers, 2)
    s, t = sharpness(numbers, 3), sharpness(numbers, 4)
    for i in range(lanes):
        over = 0.0 * limit
        for axis in range(3):
            # Written so that NaN ends it.
            twist = given(x, axis * LANES + i)
            over = over if abs(twist) <= limit * numbers[SCALE + axis] else 1.0
        ahead = given(wanted, i) - given(x, i)
        left = given(wanted, LANES + i) - given(x, LANES + i)
        turn = given(wanted, 2 * LANES + i) - given(x, 2 * LANES + i)
        lost_x, lost_y = loss_of(ahead * ahead, o), loss_of(left * left, q)
        lost_w = loss_of(turn * turn, r)
        effort, change = 0.0 * limit, 0.0 * limit
        for wheel in range(4):
            now = real(given(newest, wheel * LANES + i))
            moved = now - real(given(before, wheel * LANES + i))
            effort += now * now * 0.25
            change += moved * moved * 0.25
        # a / u + b / v + ...: a division takes as long as ten products.
        found = fma(a, lost_y * lost_w, lost_x * fma(b, lost_w, c * lost_y))
        found = found / (lost_x * (lost_y * lost_w))
        loss, other = loss_of(effort, s), loss_of(change, t)
        put(earned, i, found + fma(d, other, e * loss) / (loss * other))
        put(ended, i, over)


@njit(cache=True, inner=True, error_model="numpy", forceinline=True)
def within(value, limit):
    """A number cut to the limits; NaN, which no policy could use, is 0."""
    value = value if value == value else 0.0 * limit
    value = limit if value > limit else value
    return -limit if value < -limit else value


@njit(cache=True, inner=True, error_model="numpy", nogil=True)
def observe(v, p, lanes, row, tick, at, numbers, whole, seen):
    """Observations of rows from ``row`` on; ``seen`` (D, n), so that rows lie side by side."""
    preview, history = whole[PREVIEW], whole[HISTORY]
    limit = numbers[TWIST_LIMIT]
    for axis in range(3):
        share = 1.0 / numbers[SCALE + axis]
        scaled(v[(MEASURED + axis) * LANES :], lanes, share, limit, seen[axis, row:])
    for ahead in range(1 + preview):
        slot = (tick + ahead) % (preview + 1)
        for axis in range(3):
            wanted, column = p[(3 * slot + axis) * LANES :], seen[3 + 3 * ahead + axis, row:]
            for i in range(lanes):
                put(column, i, given(wanted, i))
    for age in range(history):
        slot = (tick - age) % whole[ACTIONS]
        for wheel in range(4):
            action = p[(at + 4 * slot + wheel) * LANES :]
            column = seen[6 + 3 * preview + 4 * age + wheel, row:]
            for i in range(lanes):
                put(column, i, given(action, i))


@njit(cache=True, inner=True, error_model="numpy", forceinline=True)
def scaled(twist, lanes, share, limit, column):
    """A field over its scale, into a column of observations."""
    for i in range(lanes):
        put(column, i, np.float32(within(given(twist, i) * share, limit)))


@njit(cache=True, inner=True, error_model="numpy", nogil=True)
def describe(x, y, p, v, i, row, tick, at, clock, numbers, whole, reward, report):
    """A report's row of row ``i`` of a block."""
    line = report[row]
    ring = 3 + 3 * (tick % (whole[PREVIEW] + 1))
    slot, past = tick % whole[ACTIONS], (tick - 1) % whole[ACTIONS]
    angles = whole[ANGLES]
    for axis in range(3):
        wanted, twist = y[(ring + axis) * LANES + i], x[axis * LANES + i]
        line[ERROR + axis] = wanted - twist
        line[TWIST + axis] = twist
        line[POSE + axis] = x[(3 + axis) * LANES + i]
        line[WANTED + axis] = wanted
        line[MEASURED_AT + axis] = v[(MEASURED + axis) * LANES + i]
        line[TERMS_AT + axis] = tolerance_of((wanted - twist) ** 2, numbers[MARGIN + axis])
    effort, change = 0.0, 0.0
    for wheel in range(4):
        now = real(p[(at + 4 * slot + wheel) * LANES + i])
        effort += now * now * 0.25
        change += (now - real(p[(at + 4 * past + wheel) * LANES + i])) ** 2 * 0.25
        line[ANGLE + wheel] = x[(angles + wheel) * LANES + i]
        line[SPEED_AT + wheel] = v[(SPEED + wheel) * LANES + i]
        line[COMMANDED_AT + wheel] = numbers[TORQUE_LIMIT] * now
        line[APPLIED_AT + wheel] = v[(APPLIED + wheel) * LANES + i]
        line[SATURATED_AT + wheel] = 1.0 if abs(now) >= AT_LIMIT else 0.0
    line[TERMS_AT + 3] = tolerance_of(effort, numbers[MARGIN + 3])
    line[TERMS_AT + 4] = tolerance_of(change, numbers[MARGIN + 4])
    line[TIME_AT] = numbers[PERIOD] * clock
    line[REWARD_AT] = reward[row]
    line[ENDED_AT] = v[ENDED * LANES + i]


@njit(cache=True, inner=True, error_model="numpy", nogil=True)
def wanted_rate(y, z, k, v, table, i, row, numbers, whole, report):
    """Acceleration of the reference of row ``i`` [m/s^2, m/s^2, rad/s^2] into its report."""
    number = k[TABLE * LANES + i]
    if 0 <= number < table.shape[0]:
        n = min(max(k[CLOCK * LANES + i], 0), table.shape[1] - 1)
        for axis in range(3):
            report[row, WANTED_RATE + axis] = table[number, n, 3 + axis]
        return
    slopes(z, k, v, i, numbers, whole)
    u = real(k[CLOCK * LANES + i]) * (numbers[PERIOD] / numbers[RAMP])
    u = 1.0 if u > 1.0 else u
    rise = u * u * u * fma(u, fma(6.0, u, -15.0), 10.0)
    for axis in range(3):
        slope = v[(SLOPE + 3) * LANES + i] * v[(SUM + axis) * LANES + i]
        slope += rise * v[(SLOPE + axis) * LANES + i]
        report[row, WANTED_RATE + axis] = y[axis * LANES + i] * slope


@njit(cache=True, inner=True, error_model="numpy", nogil=True)
def next_beginning(K, row, last):
    """The first row from ``row`` on, before ``last``, that must begin an episode; else ``last``."""
    while row < last:
        b, i = row // LANES, row % LANES
        pending, found = K[b, PENDING * LANES + i : (PENDING + 1) * LANES], 0
        for j in range(len(pending)):  # without a branch: most blocks hold none
            found |= 1 if pending[j] == BEGIN else 0
        if found:
            for j in range(len(pending)):
                if pending[j] == BEGIN:
                    return min(row + j, last)
        row += LANES - i
    return last
