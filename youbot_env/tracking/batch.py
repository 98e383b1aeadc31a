"""Platforms that track references side by side, all rows in one compiled control period.

One platform is a batch of one: the same code, and the same bits. What happens to a row follows from
its key, the number of its episode and its actions, whatever its neighbours, its place in the batch
and the number of threads are.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from youbot_env.model.model import Model
from youbot_env.motions.base import Motion
from youbot_env.physics.effect import CLOCK
from youbot_env.physics.stated_parameters import to_public
from youbot_env.simulation.free_run import initial_state
from youbot_env.simulation.lane_layout import LANES
from youbot_env.simulation.platforms import drive_delay
from youbot_env.threads import threads as usual_threads
from youbot_env.tracking import handover, period_lanes as lanes
from youbot_env.tracking.actuation import reject
from youbot_env.tracking.draws import (
    drawn_motion,
    geometry_numbers,
    model_draws,
    reference_draws,
)
from youbot_env.tracking.episode_draws import FIXED, carriers
from youbot_env.tracking.period_code import period_kernel
from youbot_env.tracking.setup import Setup, checked_start, integration_steps
from youbot_env.tracking.task import REWARD_TERMS, reference_table
from youbot_env.tracking.workers import WORKERS, Call

Array = NDArray[np.float64]
Numbers = NDArray[np.floating[Any]]
"""Of a setup's precision."""

ROWS_A_THREAD = 2048
"""Fewer rows than this do not pay for a thread: handing over takes 10 us and, where the cores are
busy, ten times that; a row takes 0.05 us."""

NO_REPORT = np.empty((0, lanes.REPORT_COLUMNS))

NO_ACTION = np.zeros((0, 4), np.float32)

MASK = 2**64 - 1

INFO = {
    "tracking_error": slice(lanes.ERROR, lanes.ERROR + 3),
    "twist": slice(lanes.TWIST, lanes.TWIST + 3),
    "pose": slice(lanes.POSE, lanes.POSE + 3),
    "wheel_angle": slice(lanes.ANGLE, lanes.ANGLE + 4),
    "reference_twist": slice(lanes.WANTED, lanes.WANTED + 3),
    "reference_acceleration": slice(lanes.WANTED_RATE, lanes.WANTED_RATE + 3),
    "measured_twist": slice(lanes.MEASURED_AT, lanes.MEASURED_AT + 3),
    "wheel_speed": slice(lanes.SPEED_AT, lanes.SPEED_AT + 4),
    "commanded_torque": slice(lanes.COMMANDED_AT, lanes.COMMANDED_AT + 4),
    "applied_torque": slice(lanes.APPLIED_AT, lanes.APPLIED_AT + 4),
}
"""The columns of a report row that ``info`` shows as they are."""

SATURATED = slice(lanes.SATURATED_AT, lanes.SATURATED_AT + 4)
TERMS = slice(lanes.TERMS_AT, lanes.REWARD_AT)
TERM_NAMES = tuple(REWARD_TERMS)

NONE_HELD = (False,) * 4
"""No wheel's torque is an old one."""


@dataclass(frozen=True)
class Results:
    """Arrays that a step fills and hands out.

    columns (D, at least n) float32 and its view observation (n, D), reward (n,), over (2, n) bool:
    terminated and truncated, report (n, W) or (0, W)
    """

    columns: NDArray[np.float32]
    observation: NDArray[np.float32]
    reward: Array
    over: NDArray[np.bool_]
    report: Array

    @classmethod
    def empty(cls, rows: int, observed: int, reported: bool) -> Results:
        # Column by column, as gymnasium's own vector environments have them: rows lie side by side.
        columns = np.zeros((observed, _width(rows)), np.float32)
        return cls(
            columns,
            columns[:, :rows].T,
            np.zeros(rows),
            np.zeros((2, rows), np.bool_),
            np.zeros((rows, lanes.REPORT_COLUMNS)) if reported else NO_REPORT,
        )

    def __reduce__(self) -> tuple[Any, ...]:
        # A copy's observation is a view of its own columns.
        return _restored, (self.columns, self.reward, self.over, self.report)

    def unused(self) -> bool:
        """Whether nobody but this object refers to the arrays, so that they can be filled anew."""
        # 2: the attribute, and the argument of getrefcount. A view refers to its base.
        return (
            sys.getrefcount(self.observation) <= 2
            and sys.getrefcount(self.columns) <= 3
            and sys.getrefcount(self.reward) <= 2
            and sys.getrefcount(self.over) <= 2
            and (self.report is NO_REPORT or sys.getrefcount(self.report) <= 2)
        )


def _restored(
    columns: NDArray[np.float32], reward: Array, over: NDArray[np.bool_], report: Array
) -> Results:
    columns = np.ascontiguousarray(columns)
    seen = columns[:, : len(reward)].T
    return Results(columns, seen, reward, over, report if len(report) else NO_REPORT)


def _width(rows: int) -> int:
    """Numbers from one column of observations to the next.

    Lines of memory that lie a multiple of 4 KiB apart share the same few places of a first-level
    cache, and so would the columns of 8192 rows: writing them takes 5 % of a step then.
    """
    page, line = 1024, 16
    beyond = rows % page
    close = rows >= page and not 6 * line <= beyond <= page - 6 * line
    return rows + (9 * line - beyond) % page if close else rows


class Shared(NamedTuple):
    """Arrays of a batch that do not depend on how many rows there are.

    blocks : one block of x, y, z, k and p, see ``period_lanes``
    fixed : table of references, numbers, lengths, whole numbers, and which functions of a platform
        there are
    drawn : what models and references are drawn with, see ``period.drawn_with``
    start : state in which episodes begin
    workspace : fields of w
    """

    blocks: tuple[NDArray[Any], ...]
    fixed: tuple[NDArray[Any], ...]
    drawn: tuple[tuple[NDArray[Any], ...], tuple[NDArray[Any], ...]]
    start: NDArray[Any]
    workspace: int


class Batch:
    """``platforms`` rows of one setup whose platforms move as their model says.

    Parameters
    ----------
    setup : of all rows; its ``contact`` is None
    autoreset : what follows an episode: ``period_lanes.NEVER``, ``NEXT_STEP`` or ``SAME_STEP``
    reports : whether a step fills the report that ``info`` shows
    threads : most threads; None takes ``YOUBOT_THREADS`` or the cores

    Attributes
    ----------
    results : of the last call; new arrays each time, unless nobody holds the old ones any more
    """

    def __init__(
        self,
        setup: Setup,
        platforms: int = 1,
        *,
        autoreset: int = lanes.NEVER,
        reports: bool = True,
        threads: int | None = None,
    ) -> None:
        self.setup, self.platforms, self.reports = setup, platforms, reports
        self._draws = model_draws(setup.source)
        model = self.nominal = setup.source.draw(np.random.default_rng(0))
        self.structure, self.geometry = model.structure, model.geometry
        samples = setup.steps + 1 + setup.task.preview
        self._reference = reference_draws(setup.task, samples * setup.period, self.geometry)
        if setup.reference is None:  # so that what cannot be shows here, not at the first reset
            setup.task.reference(np.random.default_rng(0), samples * setup.period, model.geometry)
        self._start = self._state_of(setup.start)
        self._first = np.asarray(self._start, setup.real)
        self._settings(model, autoreset)
        self._lay_out(threads)
        self._set_draws()
        self._motions: list[Motion] = []
        self._table = np.zeros((1, samples, 6))
        self._seeded = np.zeros(platforms, np.bool_)
        self._own: dict[int, int] = {}
        if setup.reference is not None:
            self._add_table(setup.reference)
        self._kernel: Any = period_kernel(self.structure, setup.single)
        self._place()

    def _settings(self, model: Model, autoreset: int) -> None:
        """The numbers that compiled code reads, in the order of ``period_lanes``."""
        setup, task, sensors = self.setup, self.setup.task, self.setup.sensors
        numbers = np.zeros(lanes.NUMBERS, setup.real)
        numbers[lanes.PERIOD] = setup.period
        numbers[lanes.TURN] = setup.period / self._reference.period
        numbers[lanes.RAMP] = task.ramp
        numbers[lanes.TORQUE_LIMIT] = setup.actuation.torque_limit
        numbers[lanes.DEVIATION] = sensors.wheel_speed_noise
        numbers[lanes.RESOLUTION] = sensors.resolution
        numbers[lanes.SPAN] = sensors.window * setup.period
        inverse = model.geometry.body_twist(np.eye(4)).T
        numbers[lanes.INVERSE : lanes.SCALE] = inverse.ravel()
        packed = task.numbers(model.geometry)
        numbers[lanes.SCALE : lanes.NUMBERS] = packed[:-1]
        numbers[lanes.TWIST_LIMIT] = packed[-1]
        whole = np.zeros(lanes.WHOLE, np.int64)
        whole[lanes.PREVIEW], whole[lanes.HISTORY] = task.preview, task.action_history
        whole[lanes.DELAY] = setup.actuation.delay
        late = self._periods_late()
        whole[lanes.ACTIONS] = max(task.action_history, 2, setup.actuation.delay + 1 + late)
        whole[lanes.TONES], whole[lanes.WINDOW] = task.tones, sensors.window
        whole[lanes.STEPS], whole[lanes.SUBSTEPS] = setup.steps, integration_steps(setup)
        whole[lanes.RESETS], whole[lanes.STATES] = autoreset, len(self.structure.state_names)
        mechanism = self.structure.mechanism
        whole[lanes.ANGLES] = len(mechanism.velocity_state) + len(mechanism.pose_state)
        whole[lanes.KIND] = self._draws.kind
        whole[lanes.FIRST], whole[lanes.LAST] = self._reference.first, self._reference.last
        whole[lanes.PEAK_POINTS] = self._reference.steps
        whole[lanes.TURN_BITS] = int(setup.period / self._reference.period * 2**64) & MASK >> 1
        self._numbers, self._whole = numbers, whole
        self._next_step = autoreset == lanes.NEXT_STEP
        self._lengths = np.asarray(model.lengths, setup.real)

    def _periods_late(self) -> int:
        """Control periods by which the model may delay torques, at most; 0 without such effects."""
        if not self.structure.at(CLOCK):
            return 0
        rng, source = np.random.default_rng(0), self.setup.source
        models = [self._draws.model, *(source.draw(rng) for _ in range(self.setup.probes))]
        delays = [drive_delay(model).delay for model in models]
        # What is drawn beyond the probes is cut to the longest that is kept.
        spread = 0.0 if self._draws.kind == FIXED else 2.0 * float(np.ptp(delays))
        return int(np.ceil((max(delays) + spread) / self.setup.period)) + 1

    def _lay_out(self, threads: int | None) -> None:
        whole, blocks = self._whole, -(-self.platforms // LANES)
        fields = int(whole[lanes.STATES]) + len(self.structure.parameter_names)
        samples = 3 * int(whole[lanes.PREVIEW] + 1)
        task = 3 + samples + (4 * int(whole[lanes.WINDOW]) if self.setup.sensors.resolution else 0)
        self._x = np.zeros((blocks, fields * LANES), self.setup.real)
        self._y = np.zeros((blocks, task * LANES), self.setup.real)
        self._z = np.zeros((blocks, 6 * int(whole[lanes.TONES]) * LANES), np.uint16)
        seen = samples + 4 * int(whole[lanes.ACTIONS])
        self._p = np.zeros((blocks, seen * LANES), np.float32)
        self._k = np.zeros((blocks, lanes.COUNTERS * LANES), np.int64)
        self._k.reshape(blocks, lanes.COUNTERS, LANES)[:, lanes.PENDING] = 1
        self._k.reshape(blocks, lanes.COUNTERS, LANES)[:, lanes.TABLE] = -1
        wanted = usual_threads() if threads is None else threads
        self._threads = max(1, min(wanted, self.platforms // ROWS_A_THREAD, blocks))
        # Twice as many parts as threads: one that comes late leaves the others enough to do.
        count = min(2 * self._threads, blocks) if self._threads > 1 else 1
        edges = [blocks * part // count * LANES for part in range(count)]
        self._parts = list(zip(edges, [*edges[1:], self.platforms], strict=True))
        self._tick, self._taken = 0, np.zeros((1, 1), np.int64)
        self._places: list[NDArray[np.int64]] = []
        self._calls: list[NDArray[np.int64]] = []
        self._pool = [self._new_results()]
        self.results = self._pool[0]
        self._final = np.zeros((0, 0), np.float32)
        self._final_report = NO_REPORT
        if whole[lanes.RESETS] == lanes.SAME_STEP:
            self._final = np.zeros(self.results.observation.shape, np.float32)
            self._final_report = np.zeros_like(self.results.report)
        self._work: list[tuple[Numbers, Numbers, NDArray[np.float32]]] = []

    def _new_results(self) -> Results:
        return Results.empty(self.platforms, self.setup.task.observation_size, self.reports)

    def _set_draws(self) -> None:
        """What compiled code draws models and references with."""
        draws, reference = self._draws, self._reference
        model = (geometry_numbers(self.geometry), draws.model.theta, draws.mean)
        bounds = (draws.spread, draws.lower, draws.upper)
        wanted = (reference.peaks, reference.limits, self.geometry.wheel_jacobian)
        known = carriers(reference.first, reference.last, reference.steps)
        self._drawn_with = _matrices(*model, *bounds), (*_matrices(*wanted), *known)

    @property
    def bytes_a_row(self) -> int:
        """Memory of a row between steps, results that are handed out not counted."""
        kept = (self._x, self._y, self._z, self._k, self._p)
        return sum(a.itemsize * a.shape[1] for a in kept) // LANES

    def shared(self) -> Shared:
        """What all rows share, and a block as it is before an episode: for other machines."""
        plant = np.zeros(lanes.BEGIN_ROWS, np.int64)
        plant[lanes.SHIFTS] = bool(self.structure.at(CLOCK))
        arrays = (self._x, self._y, self._z, self._k, self._p)
        blocks = tuple(array[:1].copy() for array in arrays)
        follows = self.setup.reference is not None
        blocks[3].reshape(lanes.COUNTERS, LANES)[lanes.TABLE] = 0 if follows else -1
        self._whole[lanes.TABLES] = bool(self._motions)
        return Shared(
            blocks=blocks,
            fixed=(self._table, self._numbers, self._lengths, self._whole, plant),
            drawn=self._drawn_with,
            start=self._first,
            workspace=self._kernel.plant.workspace,
        )

    # Beginning episodes -------------------------------------------------------------------------

    def _state_of(self, start: Mapping[str, ArrayLike]) -> Array:
        found = checked_start(start, self.setup.task.largest_twist(self.geometry))
        return initial_state(self.nominal, **found)  # pyright: ignore[reportArgumentType]

    def begin(
        self,
        chosen: NDArray[np.bool_] | None = None,
        keys: NDArray[np.int64] | None = None,
        start: Mapping[str, ArrayLike] | None = None,
        reference: Motion | None = None,
    ) -> None:
        """Begin episodes of the rows chosen (n,), None for all.

        ``keys`` (n,) of their random numbers; without them each row goes on to its next episode,
        and one that has no key yet gets one from the machine's entropy.
        """
        chosen = np.ones(self.platforms, np.bool_) if chosen is None else chosen
        state = self._start
        if start:
            state = self._state_of({**self.setup.start, **start})
        counters = self._counters()
        rows = np.flatnonzero(chosen)
        at = (rows // LANES, rows % LANES)
        if keys is None:
            fresh = rows[~self._seeded[rows]]
            if len(fresh):
                keys = np.zeros(self.platforms, np.int64)
                keys[fresh] = (
                    np.random.SeedSequence().generate_state(len(fresh), np.uint64).view(np.int64)
                )
                self._set_keys(fresh, keys)
            old = rows[~np.isin(rows, fresh)]
            counters[old // LANES, lanes.EPISODE, old % LANES] += 1
        else:
            self._set_keys(rows, keys)
        if reference is not None:
            for row in rows.tolist():
                self._follow(row, reference)
        else:
            counters[at[0], lanes.TABLE, at[1]] = 0 if self.setup.reference is not None else -1
        self._whole[lanes.TABLES] = bool(self._motions)
        counters[at[0], lanes.PENDING, at[1]] = lanes.BEGIN
        self.results = self._renewed()
        self.results.reward[rows] = 0.0
        self._begin_rows(self.results, state)
        self.results.over[:, rows] = False

    def _begin_rows(self, shown: Results, state: Array) -> None:
        """Begin the episodes of the rows whose counters ask for it."""
        # A part is taken by whoever comes first: the next one of an iterator is one operation.
        parts = iter(self._parts)

        def begin(number: int) -> None:
            for rows in parts:
                self._begin_part(shown, state, number, rows)

        helpers = [lambda n=n: begin(n) for n in range(1, self._threads)]
        WORKERS.share(lambda: begin(0), helpers)

    def _begin_part(self, shown: Results, state: Array, number: int, rows: tuple[int, int]) -> None:
        start = np.asarray(state, self.setup.real)
        places, call = self._places[number], self._calls[number]
        handover.fill(call, *self._asked(NO_ACTION, shown, 0, *rows))
        addresses = places.ctypes.data, call.ctypes.data, start.ctypes.data
        self._kernel.begin_rows(*addresses, *rows)
        handover.done(call)

    def begin_alone(
        self,
        seed: int | None,
        rng: np.random.Generator,
        start: Mapping[str, ArrayLike] | None = None,
        reference: Motion | None = None,
    ) -> None:
        """Begin an episode of the only row: the first of a seed, or the one after the last.

        ``rng`` gives a row that has no seed yet its key.
        """
        keys = None
        if seed is not None:
            keys = keys_of([seed])
        elif not self._seeded[0]:
            keys = rng.integers(2**63, size=1)
        self.begin(None, keys, start, reference)

    def _set_keys(self, rows: NDArray[np.int64], keys: NDArray[np.int64]) -> None:
        counters = self._counters()
        counters[rows // LANES, lanes.KEY, rows % LANES] = keys[rows]
        counters[rows // LANES, lanes.EPISODE, rows % LANES] = 0
        self._seeded[rows] = True

    def _counters(self) -> NDArray[np.int64]:
        return self._k.reshape(len(self._k), lanes.COUNTERS, LANES)

    def _add_table(self, motion: Motion, slot: int | None = None) -> int:
        table = reference_table(motion, self.setup.period, self._table.shape[1])
        if slot is None:
            slot = len(self._motions)
            self._motions.append(motion)
        else:
            self._motions[slot] = motion
        if slot >= len(self._table):
            self._table = np.concatenate([self._table, table[None]])
            if self._places:
                self._place()
        self._table[slot] = table
        return slot

    def _follow(self, row: int, motion: Motion) -> None:
        """Let a row follow a motion of its own in its next episode."""
        if not self._motions:
            self._motions.append(motion)  # slot 0 is that of the setup's reference
        self._own[row] = self._add_table(motion, self._own.get(row))
        self._counters()[row // LANES, lanes.TABLE, row % LANES] = self._own[row]

    def _renewed(self) -> Results:
        """Results to write into: what was handed out belongs to the caller, rows are kept."""
        old, new = self.results, self._free_results()
        for name in ("columns", "reward", "over", "report"):
            getattr(new, name)[...] = getattr(old, name)
        return new

    def _free_results(self) -> Results:
        for results in self._pool:
            if results is not self.results and results.unused():
                return results
        results = self._new_results()
        # Two are enough for a caller that keeps none; one that keeps many gets new ones.
        if len(self._pool) < 4:
            self._pool.append(results)
        return results

    def _workspace(self, number: int) -> tuple[Numbers, Numbers, NDArray[np.float32]]:
        """What a thread works in: w, v and f."""
        while len(self._work) <= number:
            sizes, real = (
                (self._kernel.plant.workspace * LANES, lanes.WORK * LANES),
                self.setup.real,
            )
            normals = np.zeros((1, 4 * LANES), np.float32)
            self._work.append((np.zeros(sizes[0], real), np.zeros(sizes[1], real), normals))
        return self._work[number]

    # Stepping -----------------------------------------------------------------------------------

    def step(self, action: NDArray[Any]) -> Results:
        """One control period under actions (n, 4), C-contiguous, in [-1, 1].

        They count in single precision.

        Raises
        ------
        InputError
            If an action is NaN or out of bounds; nothing has moved then.
        """
        # A number too large for single precision would make numpy warn: first the check.
        if action.dtype != np.float32:
            bad = lanes.refused(action, 0, self.platforms)
            if bad >= 0:
                raise reject(action, bad)
            action = action.astype(np.float32)
        shown = self._free_results()
        if self._threads > 1:
            bad = lanes.refused(action, 0, self.platforms)
            if bad >= 0:
                raise reject(action.astype(float), bad)
        self._tick += 1
        call = self._calls[0]
        if self._threads > 1:
            self._taken[0] = 0
            handover.fill(call, *self._asked(action, shown, lanes.SHARED, 0, self.platforms))
            begins = WORKERS.share(lambda: handover.done(call), self._helpers)
        else:
            asked = self._asked(action, shown, 1, 0, self.platforms)
            begins = handover.filled_and_done(call, *asked)
            if begins < 0:
                self._tick -= 1
                raise reject(action, -1 - begins)
        if begins and not self._next_step:
            self._begin_rows(shown, self._start)
        self.results = shown
        return shown

    def _asked(
        self, action: NDArray[Any], shown: Results, moves: int, first: int, last: int
    ) -> tuple[Any, ...]:
        """What ``handover.fill`` writes of a call."""
        arrays = (action, shown.columns, shown.reward, shown.over, shown.report)
        return (*arrays, self._tick, moves, first, last)

    def _place(self) -> None:
        """List the addresses of the arrays anew: after one was replaced, and in a copy."""
        self._places = []
        addresses = self._kernel.addresses(self._draws.kind != FIXED)
        for number in range(self._threads):
            w, v, f = self._workspace(number)
            arrays = [self._x, self._y, self._z, self._k, self._p, self._table, self._numbers]
            arrays += [self._lengths, self._whole.reshape(1, -1), self._first, w, v, f, self._taken]
            models, wanted = self._drawn_with
            arrays += [*models, *wanted, self._final, self._final_report]
            listed = np.zeros((lanes.ARRAYS, lanes.PLACE), np.int64)
            for place, array in zip(listed, arrays, strict=True):
                assert array.flags.c_contiguous
                place[0] = array.ctypes.data
                place[1 : 1 + array.ndim] = array.shape
            self._places.append(np.concatenate([listed.ravel(), addresses]))
        self._calls, step = [], self._kernel.period
        for places in self._places:
            call = np.zeros(lanes.CALL, np.int64)
            call[lanes.PERIOD_CALL], call[lanes.PLACES_CALL] = step, places.ctypes.data
            self._calls.append(call)
        # Threads that share a step take pieces of one call.
        shared, others = self._calls[0].ctypes.data, self._places[1:]
        self._helpers = [Call(step, places.ctypes.data, shared) for places in others]

    def final(self) -> tuple[NDArray[np.float32], Array]:
        """Last observations (n, D) and reports of the episodes that ended in the last step, copies.

        Rows whose episode goes on hold zeros.
        """
        over = self.results.over.any(axis=0)
        observation, report = np.zeros_like(self._final), np.zeros_like(self._final_report)
        observation[over] = self._final[over]
        if len(report):
            report[over] = self._final_report[over]
        return observation, report

    # What is known of a row ---------------------------------------------------------------------

    @property
    def observation(self) -> NDArray[np.float32]:
        """(n, D) float32."""
        return self.results.observation

    @property
    def reward(self) -> Array:
        """(n,), each in [0, 1]."""
        return self.results.reward

    @property
    def terminated(self) -> NDArray[np.bool_]:
        """(n,): whether the twist has diverged, see ``TrackingTask.twist_limit``."""
        return self.results.over[0]

    @property
    def truncated(self) -> NDArray[np.bool_]:
        """(n,): whether the episode has had its length."""
        return self.results.over[1]

    @property
    def waiting(self) -> NDArray[np.bool_]:
        """(n,): whether a row's episode is over, or has not begun."""
        return self._counters()[:, lanes.PENDING].ravel()[: self.platforms] != 0

    @property
    def clock(self) -> NDArray[np.int64]:
        """(n,) control periods since each row's reset, a copy."""
        return self._counters()[:, lanes.CLOCK].ravel()[: self.platforms].copy()

    def set_clock(self, clock: ArrayLike) -> None:
        """Put the rows at other times (n,) [periods] of their episodes: ends and references follow.

        The samples ahead that are observed already stay; states do, too.
        """
        counters = self._counters()
        rows = np.arange(self.platforms)
        counters[rows // LANES, lanes.CLOCK, rows % LANES] = clock

    def _fields(self, array: NDArray[Any], row: int, first: int, last: int) -> Array:
        block = array[row // LANES].reshape(-1, LANES)
        return block[first:last, row % LANES].astype(float)

    def state(self, row: int) -> Array:
        """(S,), a copy, in the order of ``structure.state_names``."""
        return self._fields(self._x, row, 0, int(self._whole[lanes.STATES]))

    def set_state(self, row: int, state: ArrayLike) -> None:
        """Put a row into a state (S,), in the midst of its episode."""
        block = self._x[row // LANES].reshape(-1, LANES)
        block[: int(self._whole[lanes.STATES]), row % LANES] = state

    def parameters(self, row: int) -> dict[str, float]:
        """This episode's parameters by full name."""
        if self._draws.kind == FIXED:
            return self._draws.model.values.copy()
        states = int(self._whole[lanes.STATES])
        theta = self._fields(self._x, row, states, states + len(self._draws.model.theta))
        return to_public(self.structure, self.geometry, theta)

    def model(self, row: int) -> Model:
        """This episode's model."""
        if self._draws.kind == FIXED:
            return self._draws.model
        return self._draws.model.with_values(self.parameters(row))

    def reference(self, row: int) -> Motion | None:
        """The motion that a row follows; None before its first reset."""
        number = int(self._counters()[row // LANES, lanes.TABLE, row % LANES])
        if number >= 0:
            return self._motions[number]
        if not self._seeded[row]:
            return None
        tones = self._z[row // LANES].reshape(-1, LANES)[:, row % LANES]
        return drawn_motion(self._reference, tones, self._fields(self._y, row, 0, 3))

    def __getstate__(self) -> dict[str, Any]:
        # Compiled code is found again, not carried.
        addresses: dict[str, Any] = {"_kernel": None, "_places": [], "_work": []}
        addresses |= {"_calls": [], "_helpers": []}
        return {**self.__dict__, **addresses}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._kernel = period_kernel(self.structure, self.setup.single)
        self._place()


def _matrices(*arrays: ArrayLike) -> tuple[Array, ...]:
    """Numbers as compiled code reads them: in double precision, a vector as one row."""
    return tuple(np.atleast_2d(np.ascontiguousarray(array, float)) for array in arrays)


def keys_of(seeds: Sequence[int]) -> NDArray[np.int64]:
    """Keys of random numbers from seeds, whole numbers of at least 0; 64 bits of each count."""
    return np.array([int(seed) & MASK for seed in seeds], np.uint64).view(np.int64)


class StepInfo(dict[str, Any]):
    """``info`` of one row of a report, filled when it is first looked into.

    Building it takes as long as the period that it tells of, and most callers do not read it.
    """

    __slots__ = ("_held", "_more", "_row")

    def __init__(
        self, row: Array, more: Mapping[str, Any], held: Sequence[bool] = NONE_HELD
    ) -> None:
        self._row: Array | None = row
        self._more: Mapping[str, Any] | None = more
        self._held = held

    def fill(self) -> None:
        """Make it what it says it is."""
        line, more = self._row, self._more
        if line is None or more is None:
            return
        self._row = self._more = None
        put = super().__setitem__
        for name, where in INFO.items():
            put(name, line[where])
        put("saturated", line[SATURATED] != 0.0)
        put("held", np.array(self._held))
        put("reward_terms", dict(zip(TERM_NAMES, line[TERMS].tolist(), strict=True)))
        put("parameters", dict(more))
        put("time", float(line[lanes.TIME_AT]))

    def __reduce__(self) -> tuple[Any, ...]:
        return dict, (dict(self.items()),)


def _filled_first(name: str) -> Any:
    own = getattr(dict, name)

    def method(self: StepInfo, *arguments: Any, **named: Any) -> Any:
        self.fill()
        return own(self, *arguments, **named)

    method.__name__ = name
    return method


for _name in (
    *("__getitem__", "__setitem__", "__delitem__", "__iter__", "__reversed__", "__len__"),
    *("__contains__", "__eq__", "__ne__", "__or__", "__ror__", "__ior__", "__repr__"),
    *("get", "keys", "values", "items", "pop", "popitem", "setdefault", "update", "copy", "clear"),
):
    setattr(StepInfo, _name, _filled_first(_name))
